"""An environment for learning: a hand lifts the top of a soft block to a height that is asked for."""

from typing import Any

import gymnasium as gym
import numpy as np
import sinew


class Lift(gym.Env):
    """Action: velocity of the hand (3,), in units of its limit. Observation: hand, wanted height, mean of the top, force (8,)."""

    metadata: dict[str, Any] = {"render_modes": []}
    limit = 0.002  # m a step

    def __init__(self, length: int = 80) -> None:
        self.action_space = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)
        self.observation_space = gym.spaces.Box(-10.0, 10.0, (8,), np.float32)
        mesh = sinew.generate("box", size=(0.06, 0.06, 0.04), cells=(4, 4, 3))
        self.sim = sinew.Simulation(dt=0.02, gravity=(0, 0, 0), threads=1)
        self.block = self.sim.add_body("block", mesh, sinew.preset("liver"))
        self.sim.hold(self.block, "z0")
        self.top = self.block.vertices("z1")
        # nothing is built again: a reset takes this state up
        self.pull = self.sim.pull(self.block, "z1", stiffness=200.0, damping=0.5)
        self.start = self.sim.snapshot()
        self.length = length

    def _observe(self) -> np.ndarray:
        top = self.block.displacements[self.top].mean(axis=0)
        force = self.pull.report.force[2]
        return np.concatenate([self.hand, [self.wanted], top, [force]]).astype(np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        self.sim.restore(self.start)
        self.hand = np.zeros(3)
        self.wanted = self.np_random.uniform(0.004, 0.012)
        self.count = 0
        return self._observe(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        self.hand = self.hand + self.limit * np.clip(action, -1.0, 1.0)
        self.pull.move(self.hand)
        self.sim.step()
        self.count += 1
        seen = self._observe()
        miss = float(np.linalg.norm(seen[4:7] - (0.0, 0.0, self.wanted)))
        return seen, -1e3 * miss, miss < 5e-4, self.count >= self.length, {"miss": miss}


def main() -> None:
    from gymnasium.utils.env_checker import check_env

    env = Lift()
    check_env(env, skip_render_check=True)
    hits = 0
    for episode in range(5):
        seen, _ = env.reset(seed=episode)
        done = late = False
        while not (done or late):
            # half of what is missing, on all axes: the tetrahedra of the block lean to one side
            missing = np.array([0.0, 0.0, seen[3]]) - seen[4:7]
            action = 0.5 * missing / env.limit
            seen, reward, done, late, info = env.step(action.astype(np.float32))
        hits += done
        print(f"episode {episode}: {env.count} steps, {1e3 * info['miss']:.2f} mm off")
    assert hits == 5


if __name__ == "__main__":
    main()
