"""Young's modulus from data: a block sags, its top is measured with noise, scipy finds the modulus."""

import numpy as np
import sinew
from scipy.optimize import minimize_scalar

TRUTH, NOISE = 5200.0, 2e-5

mesh = sinew.generate("box", size=(0.08, 0.03, 0.03), cells=(8, 3, 3))


def sag(young: float) -> np.ndarray:
    """Displacements (m) of the free end at some times, (k, n, 3)."""
    sim = sinew.Simulation(dt=0.02)
    body = sim.add_body("block", mesh, sinew.preset("liver", young=young))
    sim.hold(body, "x0")
    end = body.vertices("x1")
    return sim.run(steps=30, every=5, probe=lambda s: body.displacements[end].copy()).values


def main() -> None:
    measured = sag(TRUTH)
    measured += np.random.default_rng(1).normal(0.0, NOISE, measured.shape)

    def misfit(log_young: float) -> float:
        return float(((sag(np.exp(log_young)) - measured) ** 2).sum() / NOISE**2)

    found = minimize_scalar(misfit, bounds=(np.log(2e3), np.log(2e4)), method="bounded", options={"xatol": 1e-4})
    young = float(np.exp(found.x))
    print(f"E = {young:.0f} Pa after {found.nfev} runs; the truth is {TRUTH:.0f} Pa")
    assert abs(young / TRUTH - 1) < 0.01


if __name__ == "__main__":
    main()
