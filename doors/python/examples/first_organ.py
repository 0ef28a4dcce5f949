"""A scene: follow a vertex, ask for forces, cut something away."""

from pathlib import Path

import numpy as np
import sinew

SCENES = Path(__file__).resolve().parents[3] / "demos" / "scenes"


def main() -> None:
    sim = sinew.Simulation.from_scene(SCENES / "liver.toml")
    print(sim)
    name, organ = next(iter(sim.bodies.items()))
    run = sim.run(steps=20, probe=lambda s: s.bodies[name].positions[7].copy())
    print(f"vertex 7 moved {1e3 * np.linalg.norm(run.values[-1] - run.values[0]):.2f} mm in {run.time[-1]:.2f} s")
    for constraint in sim.constraints.values():
        print(f"{constraint.name} holds with {np.linalg.norm(constraint.reaction):.3f} N")
    centre = organ.positions.mean(axis=0)
    report = organ.remove(sphere=(centre, 0.01))
    print(f"{len(report.tetrahedra)} tetrahedra cut away, {1e3 * report.mass:.2f} g, in {report.pieces} piece(s)")
    sim.step(5)
    assert np.isfinite(organ.positions).all() and organ.volume_ratios.min() > 0
    assert len(organ.remaining()) == report.remaining


if __name__ == "__main__":
    main()
