"""A ball is pressed into soft and stiff tissue: force over depth, as a picture."""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import sinew

RADIUS, HEIGHT, DEPTH, STEPS = 0.015, 0.04, 0.006, 30


def curve(young: float) -> tuple[np.ndarray, np.ndarray]:
    """Depth (m) and force (N) of the ball."""
    mesh = sinew.generate("box", size=(0.08, 0.08, HEIGHT), cells=(12, 12, 6))
    sim = sinew.Simulation(dt=0.02, gravity=(0, 0, 0))
    tissue = sim.add_body("tissue", mesh, sinew.preset("liver", young=young))
    sim.hold(tissue, "z0")
    ball = sim.add_tool("ball", sinew.Sphere(RADIUS), (0.04, 0.04, HEIGHT + RADIUS))
    depths = np.linspace(0.0, DEPTH, STEPS)
    forces = []
    for depth in depths:
        ball.move((0.04, 0.04, HEIGHT + RADIUS - depth))
        sim.step()
        forces.append(ball.force[2])
    return depths, np.array(forces)


def main() -> None:
    figure, axes = plt.subplots(figsize=(6, 4))
    last = []
    for young in (3e3, 6e3, 12e3):
        depths, forces = curve(young)
        axes.plot(1e3 * depths, forces, label=f"E = {young / 1e3:g} kPa")
        last.append(forces[-1])
        assert (np.diff(forces[3:]) > 0).all(), "deeper is harder"
    axes.set_xlabel("depth (mm)")
    axes.set_ylabel("force (N)")
    axes.legend()
    out = sys.argv[1] if len(sys.argv) > 1 else "palpation.png"
    figure.savefig(out, dpi=120, bbox_inches="tight")
    print(f"force at {1e3 * DEPTH:g} mm: {', '.join(f'{force:.3f} N' for force in last)}; {out}")
    assert last[0] < last[1] < last[2]


if __name__ == "__main__":
    main()
