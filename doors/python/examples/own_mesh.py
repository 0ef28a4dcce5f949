"""A mesh of one's own through meshio: written as a VTU file, read again, with a set of points as group."""

import tempfile
from pathlib import Path

import meshio
import numpy as np
import sinew


def main() -> None:
    box = sinew.generate("box", size=(0.08, 0.03, 0.03), cells=(8, 3, 3))
    held = (box.points[:, 0] == 0).astype(float)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "beam.vtu"
        meshio.Mesh(box.points, {"tetra": box.tetrahedra}, point_data={"held": held}).write(path)
        read = meshio.read(path)
    read.point_sets = {"wall": np.flatnonzero(read.point_data["held"] > 0)}
    mesh = sinew.Mesh.from_meshio(read)
    print(mesh)
    sim = sinew.Simulation(solver={"integrator": "quasi-static"})
    beam = sim.add_body("beam", mesh, sinew.preset("liver", young=3e4))
    wall = sim.hold(beam, "wall")
    sim.step(3)
    tip = beam.displacements[:, 2].min()
    weight = 9.81 * beam.masses.sum()
    print(f"the tip hangs {-1e3 * tip:.2f} mm; the wall carries {wall.reaction[2]:.4f} N of {weight:.4f} N")
    assert tip < -1e-3 and abs(wall.reaction[2] - weight) < 1e-3 * weight


if __name__ == "__main__":
    main()
