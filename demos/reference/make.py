"""Makes the cases of this folder whose elements differ in stiffness: two_stiffnesses_* (closed form) and
mixed_* (a small finite element program of its own, in double precision). Needs numpy: `python make.py`.

Tangents are complex-step derivatives of the forces, so nothing is derived twice by hand.
"""

import json
import pathlib

import numpy as np

HERE = pathlib.Path(__file__).parent
rng = np.random.default_rng(13)
units = "SI (m, N, Pa, kg)"


def write(name, case):
    (HERE / f"{name}.json").write_text(json.dumps(case, separators=(",", ":")) + "\n")


# ---- meshes (Gmsh 2.2, ASCII)

TYPES = {4: 4, 5: 8}  # Gmsh type: nodes


def read_mesh(name):
    lines = (HERE / "meshes" / name).read_text().split("\n")
    start = lines.index("$Nodes")
    nodes = [[float(x) for x in line.split()[1:]] for line in lines[start + 2 : start + 2 + int(lines[start + 1])]]
    start = lines.index("$Elements")
    cells = []
    for line in lines[start + 2 : start + 2 + int(lines[start + 1])]:
        numbers = [int(x) for x in line.split()]
        if numbers[1] in TYPES:
            cells.append([n - 1 for n in numbers[3 + numbers[2] :]])
    return np.array(nodes), np.array(cells)


def write_mesh(name, nodes, cells):
    kind = {4: 4, 8: 5}[cells.shape[1]]
    out = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", "1", '3 1 "body"', "$EndPhysicalNames", "$Nodes", str(len(nodes))]
    out += [f"{i + 1} " + " ".join(map(repr, map(float, x))) for i, x in enumerate(nodes)]
    out += ["$EndNodes", "$Elements", str(len(cells))]
    out += [f"{i + 1} {kind} 2 1 1 " + " ".join(str(n + 1) for n in cell) for i, cell in enumerate(cells)]
    (HERE / "meshes" / name).write_text("\n".join(out + ["$EndElements", ""]))


# ---- elements

CORNERS = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])


def points(nodes, cells):
    """Gradients (cell, point, node, axis) of the shape functions and weights (cell, point) in m^3."""
    if cells.shape[1] == 4:
        local = np.array([[[-1, -1, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1]]], float)
        weight = 1 / 6
    else:
        gauss = CORNERS / np.sqrt(3)
        factor = 1 + gauss[:, None, :] * CORNERS[None]
        others = np.stack([factor[..., 1] * factor[..., 2], factor[..., 2] * factor[..., 0], factor[..., 0] * factor[..., 1]], -1)
        local = CORNERS[None] * others / 8
        weight = 1
    jacobian = np.einsum("qak,cai->cqik", local, nodes[cells])
    gradients = np.einsum("qak,cqki->cqai", local, np.linalg.inv(jacobian))
    return gradients, weight * np.linalg.det(jacobian)


def cofactor(F):
    a, b, c = F[..., 0], F[..., 1], F[..., 2]
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], -1)


def density(law, F, lam, mu):
    """Energy density (Pa) and first Piola-Kirchhoff stress (Pa)."""
    one = np.eye(3)
    trace = lambda A: np.einsum("...ii", A)
    square = lambda A: np.einsum("...ij,...ij", A, A)
    lam, mu = lam[..., None, None], mu[..., None, None]
    flat = lambda x: x[..., 0, 0]
    if law == "linear":
        e = (F + np.swapaxes(F, -1, -2)) / 2 - one
        t = trace(e)[..., None, None]
        return flat(lam / 2 * t**2) + flat(mu) * square(e), lam * t * one + 2 * mu * e
    if law == "corotational":
        R = F
        for _ in range(12):  # polar decomposition of J > 0; analytic, unlike singular values
            R = (R + np.swapaxes(np.linalg.inv(R), -1, -2)) / 2
        t = trace(np.swapaxes(R, -1, -2) @ F - one)[..., None, None]
        return flat(mu) * square(F - R) + flat(lam / 2 * t**2), 2 * mu * (F - R) + lam * t * R
    E = (np.einsum("...ki,...kj", F, F) - one) / 2
    cof = cofactor(F)
    J = (np.einsum("...i,...i", F[..., 0], cof[..., 0]))[..., None, None]
    t = trace(E)[..., None, None]
    if law == "svk" or law == "svk_comp":
        W, P = flat(lam / 2 * t**2) + flat(mu) * square(E), F @ (lam * t * one + 2 * mu * E)
        if law == "svk_comp":
            less = np.where(J.real < 1, J - 1, 0)
            W, P = W + flat((lam + mu) / 2 * less**4), P + 2 * (lam + mu) * less**3 * cof
        return W, P
    if law == "svk_volume":
        return flat(mu) * square(E) + flat(lam / 2 * (J - 1) ** 2), F @ (2 * mu * E) + lam * (J - 1) * cof
    assert law == "neo_hookean"
    m, l = 4 / 3 * mu, lam + 5 / 6 * mu
    I = square(F)[..., None, None]
    shift = 3 * m / (4 * l)
    W = m / 2 * (I - 3) - m / 2 * np.log((I + 1) / 4) + l / 2 * ((J - 1 - shift) ** 2 - shift**2)
    return flat(W), m * (1 - 1 / (I + 1)) * F + l * (J - 1 - shift) * cof


class Body:
    def __init__(self, nodes, cells, E, nu):
        self.nodes, self.cells = nodes, cells
        self.gradients, self.weights = points(nodes, cells)
        ones = np.ones_like(self.weights)
        self.lam = (E * nu / ((1 + nu) * (1 - 2 * nu)))[:, None] * ones
        self.mu = (E / (2 * (1 + nu)))[:, None] * ones

    def evaluate(self, law, u):
        """Energy (J) and its derivative (N)."""
        F = np.eye(3) + np.einsum("cai,cqaj->cqij", u[self.cells], self.gradients)
        W, P = density(law, F, self.lam, self.mu)
        local = np.einsum("cq,cqij,cqaj->cai", self.weights, P, self.gradients)
        f = np.zeros(self.nodes.shape, local.dtype)
        np.add.at(f, self.cells, local)
        return np.sum(W * self.weights), f

    def minimise(self, law, u, free, more):
        """Newton on energy plus `more(u)`, which gives a force, over the unknowns `free`."""
        residual = lambda u: (self.evaluate(law, u)[1] + more(u))[free]
        for _ in range(40):
            r = residual(u)
            K = np.empty((len(r), len(r)))
            for j, (node, axis) in enumerate(zip(*np.nonzero(free))):
                probe = u.astype(complex)
                probe[node, axis] += 1e-40j
                K[:, j] = residual(probe).imag / 1e-40
            step = np.linalg.solve(K, r)
            u = u.copy()
            u[free] -= step
            if np.abs(step).max() < 1e-13:
                return u
        raise RuntimeError("no convergence")

    def mass(self, density):
        masses = np.zeros(len(self.nodes))
        volumes = self.weights.sum(1)
        np.add.at(masses, self.cells, (density * volumes / self.cells.shape[1])[:, None])
        return masses


def check_against_the_other_program():
    """The stored patch tests were computed by another program."""
    for kind in ("tet", "hex"):
        case = json.loads((HERE / f"patch_{kind}.json").read_text())
        nodes, cells = read_mesh(case["mesh"])
        E, nu = (np.full(len(cells), case["material"][key]) for key in ("E", "nu"))
        for law, result in case["results"].items():
            energy, f = Body(nodes, cells, E, nu).evaluate(law, np.array(result["u"]))
            held = {node for node, _, _ in case["dirichlet"]}
            inner = [n for n in range(len(nodes)) if n not in held]
            assert abs(energy / result["energy"] - 1) < 1e-12, (kind, law, energy)
            assert np.abs(f[inner]).max() < 1e-12 * np.abs(f).max(), (kind, law)


# ---- a bar of two stiffnesses, in series: 10, 40, 10, 40 kPa, each 1 cm long; nu = 0, so nothing happens across

KUHN = [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]]


def two_stiffnesses(kind):
    side, parts, force = 0.01, 4, 0.3  # m, -, N
    nodes = np.array([[x * side, y * side, z * side] for x in range(parts + 1) for y in range(2) for z in range(2)])
    index = lambda x, y, z: 4 * x + 2 * y + z
    bricks = [[index(x + i, j, k) for i, j, k in (CORNERS + 1) // 2] for x in range(parts)]
    cells = np.array(bricks if kind == "hex" else [[brick[i] for i in tet] for brick in bricks for tet in KUHN])
    cells = cells[rng.permutation(len(cells))]  # so that an order of one's own does not go unnoticed
    part = (nodes[cells].mean(1)[:, 0] / side).astype(int)
    moduli = np.where(np.arange(parts) % 2 == 0, 1e4, 4e4)
    mesh = f"bar_two_{kind}.msh"
    write_mesh(mesh, nodes, cells)
    stress = force / side**2
    stretches = {"linear": 1 + stress / moduli, "svk": np.empty(parts)}
    for i, E in enumerate(moduli):
        # E/2 (s^3 - s) = stress
        roots = np.roots([E / 2, 0, -E / 2, -stress])
        s = roots[np.abs(roots.imag) < 1e-9].real.max()
        for _ in range(3):
            s -= (E / 2 * (s**3 - s) - stress) / (E / 2 * (3 * s**2 - 1))
        stretches["svk"][i] = s
    stretches["svk_comp"] = stretches["svk"]
    results = {}
    for law, s in stretches.items():
        u = np.zeros_like(nodes)
        u[:, 0] = np.concatenate([[0], np.cumsum(side * (s - 1))])[np.arange(len(nodes)) // 4]
        strain = s - 1 if law == "linear" else (s**2 - 1) / 2
        energy = float(np.sum(moduli / 2 * strain**2) * side**3)
        body = Body(nodes, cells, moduli[part], np.zeros(len(cells)))
        found, f = body.evaluate(law, u)
        assert abs(found / energy - 1) < 1e-13 and np.abs(f[4:-4]).max() < 1e-14
        results[law] = {"status": "ok", "follower_load": False, "energy": energy, "reaction_on_group": {"x0": [-force, 0.0, 0.0]}, "u": u.tolist(), "made_by": "closed form"}
    # consistent with the shape functions on the end face
    end = np.arange(4 * parts, 4 * parts + 4)
    share = f[end, 0]
    write(
        f"two_stiffnesses_{kind}",
        {
            "schema": "sinew-fem-ref/1",
            "name": f"two_stiffnesses_{kind}",
            "about": "a bar of two stiffnesses in turn along its length, pulled by a dead force: springs in series; E holds one value per element",
            "mesh": mesh,
            "cell_type": kind,
            "nodes": len(nodes),
            "cells": len(cells),
            "material": {"E": moduli[part].tolist(), "nu": 0.0, "rho": 1000.0, "plane": None},
            "units": units,
            "extra_groups": {"x0": [0, 1, 2, 3]},
            "dirichlet": [[n, axis, 0.0] for n in range(4) for axis in range(3)],
            "nodal_loads": [[int(n), float(s), 0.0, 0.0] for n, s in zip(end, share)],
            "results": results,
        },
    )


# ---- a block whose elements all differ

LAWS = ["linear", "svk", "svk_comp", "corotational", "neo_hookean", "svk_volume"]


def mixed_material(cells):
    n = len(cells)
    round3 = lambda x: np.array([float(f"{v:.3g}") for v in x])
    return round3(10 ** rng.uniform(3.5, 4.5, n)), round3(rng.uniform(0.1, 0.45, n)), round3(rng.uniform(800, 1300, n))


def mixed(kind):
    nodes, cells = read_mesh(f"patch_{kind}.msh")
    E, nu, rho = mixed_material(cells)
    body = Body(nodes, cells, E, nu)
    bottom = np.nonzero(nodes[:, 2] == 0)[0]
    top = np.nonzero(nodes[:, 2] == nodes[:, 2].max())[0]
    way = np.array([0.006, 0.003, -0.005])
    free = np.ones(nodes.shape, bool)
    free[bottom] = free[top] = False
    loads = np.zeros(nodes.shape)
    loads[:, 1] = 30 * body.mass(rho)
    loads[~free] = 0
    results, u = {}, np.zeros(nodes.shape)
    for law in LAWS:
        for part in [1.0] if law == "linear" else [0.5, 1.0]:
            u = np.zeros(nodes.shape) if part == 0.5 or law == "linear" else u
            u[top] = part * way
            u = body.minimise(law, u, free, lambda _: -part * loads)
        energy, f = body.evaluate(law, u)
        reaction = {name: f[group].sum(0).tolist() for name, group in (("bottom", bottom), ("top", top))}
        residual = np.abs((f - loads)[free]).max() / np.abs(f).max()
        F = np.eye(3) + np.einsum("cai,cqaj->cqij", u[cells], body.gradients)
        results[law] = {
            "status": "ok",
            "follower_load": False,
            "energy": float(energy),
            "reaction_on_group": reaction,
            "min_cell_ratio": float(np.linalg.det(F).min()),
            "rel_residual": float(residual),
            "u": u.tolist(),
            "made_by": "make.py",
        }
        print(kind, law, energy, residual, results[law]["min_cell_ratio"])
    results["svk_fem"] = results["svk"]  # the same energy, evaluated in another way
    write(
        f"mixed_{kind}",
        {
            "schema": "sinew-fem-ref/1",
            "name": f"mixed_{kind}",
            "about": "a block sheared, pressed and pushed sideways; E, nu and rho hold one value per element",
            "mesh": f"patch_{kind}.msh",
            "cell_type": kind,
            "nodes": len(nodes),
            "cells": len(cells),
            "material": {"E": E.tolist(), "nu": nu.tolist(), "rho": rho.tolist(), "plane": None},
            "units": units,
            "extra_groups": {"bottom": bottom.tolist(), "top": top.tolist()},
            "dirichlet": [[int(n), axis, value] for group, to in ((bottom, 0 * way), (top, way)) for n in group for axis, value in enumerate(to.tolist())],
            "nodal_loads": [[n, 0.0, float(f), 0.0] for n, f in enumerate(loads[:, 1]) if f != 0],
            "results": results,
        },
    )


def mixed_steps():
    nodes, cells = read_mesh("patch_tet.msh")
    E, nu, rho = mixed_material(cells)
    body, law, h = Body(nodes, cells, E, nu), "svk_comp", 0.01
    gravity = np.array([0, 0, -9.81])
    mass = body.mass(rho)
    fixed = np.nonzero(nodes[:, 2] == 0)[0]
    free = np.ones(nodes.shape, bool)
    free[fixed] = False
    u = 0.1 * nodes * (nodes[:, 2:] / 0.04)  # swollen towards the top
    v = np.zeros(nodes.shape)
    v[:, 0] = 0.5 * nodes[:, 2] / 0.04
    start_u, start_v = u, v
    energy, f = body.evaluate(law, u)
    states = []
    for step in range(1, 9):
        aim = u + h * v + h**2 * gravity
        inertia = lambda x: mass[:, None] * (x - aim) / h**2
        new = body.minimise(law, u, free, inertia)
        u, v = new, (new - u) / h
        if step in (1, 4, 8):
            states.append({"step": step, "positions": (nodes + u).tolist(), "velocities": v.tolist(), "elastic_energy": float(body.evaluate(law, u)[0])})
    write(
        "mixed_steps",
        {
            "name": "mixed_steps",
            "about": "a swollen, thrown block on a fixed face; E, nu and rho hold one value per element; made by make.py",
            "units": "SI (m, kg, s, Pa)",
            "gravity": gravity.tolist(),
            "h": h,
            "vertices": nodes.tolist(),
            "elements": "tetrahedra",
            "tetrahedra": cells.tolist(),
            "model": "StVK + compression term (lambda+mu)/2 (J-1)^4 for J<1",
            "E": E.tolist(),
            "nu": nu.tolist(),
            "rho": rho.tolist(),
            "masses": mass.tolist(),
            "damping": 0,
            "fixed_vertices": fixed.tolist(),
            "initial_positions": (nodes + start_u).tolist(),
            "initial_velocities": start_v.tolist(),
            "initial_elastic_energy": float(energy),
            "initial_total_force": (mass[:, None] * gravity - f).tolist(),
            "implicit_euler": {"states": states},
        },
    )


check_against_the_other_program()
for kind in ("tet", "hex"):
    two_stiffnesses(kind)
    mixed(kind)
mixed_steps()
