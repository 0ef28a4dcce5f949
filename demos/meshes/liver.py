#!/usr/bin/env python3
"""Makes liver.msh, a liver-like organ of tetrahedra for the Sinew demos.

The shape is our own: three ellipsoids blended into one body, a large ball
pressed into the underside, a notch in the front rim.  It comes from no scan,
atlas or other mesh, and is not anatomy.

    python liver.py [OUT.msh [N]]    (default: liver.msh beside this file; N
                                      vertices of the surface, 505 or so)
    python liver.py liver_coarse.msh 60

Steps: marching cubes of the implicit shape on a 1.6 mm lattice; uniform
remeshing (ACVD clustering); edge flips and tangential smoothing with the
vertices held on the implicit surface; tetrahedra by Gmsh (Delaunay, then the
Gmsh and Netgen optimisers, surface kept as it is); a last seeded relaxation
of inner vertices.  One thread in Gmsh, fixed seeds, coordinates rounded to
10 nm: the same versions give the same file.

Made with Python 3.11, gmsh 4.15.2, numpy 2.4.6, scikit-image 0.26.0,
pyacvd 0.4.0, pyvista 0.49.1 (vtk 9.7.2).  Other versions may give other
counts.

Axes, in metres: x along the organ (big right lobe at -x, thin left lobe at
+x), -y the front, z up.

Physical groups, in MSH 2.2 ASCII:
  2 1 "ligament"  triangles over the crest of the dome and a little behind,
                  where the organ hangs from the diaphragm (hold these)
  2 2 "tool"      a small patch round the lower front rim of the left lobe,
                  where a grasper holds (move these)
  2 3 "surface"   every other boundary triangle
  3 4 "body"      all tetrahedra
Every boundary triangle is in exactly one surface group and faces outward.
Border vertices are shared between adjacent groups.
"""
import os
import sys

import gmsh
import numpy as np
import pyacvd
import pyvista as pv
from skimage.measure import marching_cubes

N_SURFACE = 505          # default of vertices asked of the surface remesher
EDGE_FACTOR = 0.785      # inner tet size over mean surface edge length
RIM = np.array([0.0, -0.6, -0.8])       # which way the free rim looks


# ---------------------------------------------------------------- the shape
def smin(a, b, k):
    """Polynomial smooth minimum (smooth union of signed fields), blend k."""
    h = np.clip(0.5 + 0.5 * (b - a) / k, 0.0, 1.0)
    return b * (1 - h) + a * h - k * h * (1 - h)


def smax(a, b, k):
    return -smin(-a, -b, k)


def ellipsoid(p, c, r, yaw=0.0, pitch=0.0):
    """Approximate signed distance; pitch turns about y (x towards z)."""
    q = p - np.asarray(c)
    x, y, z = q[..., 0], q[..., 1], q[..., 2]
    c1, s1 = np.cos(pitch), np.sin(pitch)
    x, z = c1 * x + s1 * z, -s1 * x + c1 * z
    c2, s2 = np.cos(yaw), np.sin(yaw)
    x, y = c2 * x + s2 * y, -s2 * x + c2 * y
    k0 = np.sqrt((x / r[0]) ** 2 + (y / r[1]) ** 2 + (z / r[2]) ** 2)
    k1 = np.sqrt((x / r[0] ** 2) ** 2 + (y / r[1] ** 2) ** 2
                 + (z / r[2] ** 2) ** 2)
    return k0 * (k0 - 1.0) / np.maximum(k1, 1e-9)


def organ(p):
    """Implicit organ, negative inside; metres; z up, -y the front."""
    right = ellipsoid(p, (-0.038, 0.006, -0.010), (0.057, 0.060, 0.074),
                      pitch=0.26)
    middle = ellipsoid(p, (0.008, -0.006, 0.006), (0.058, 0.050, 0.046),
                       pitch=-0.12)
    left = ellipsoid(p, (0.054, -0.018, 0.010), (0.052, 0.040, 0.021),
                     pitch=-0.14, yaw=-0.12)
    f = smin(smin(right, middle, 0.028), left, 0.026)
    # underside: a big ball pressed in from below, behind and the left
    n = np.array([0.33, 0.58, -0.75])
    n /= np.linalg.norm(n)
    ball = 0.145
    c = np.array([0.004, -0.002, -0.020]) + ball * n
    f = smax(f, ball - np.linalg.norm(p - c, axis=-1), 0.015)
    # the notch in the front rim between the lobes
    n = ellipsoid(p, (0.026, -0.062, -0.030), (0.008, 0.036, 0.027),
                  pitch=-0.25)
    f = smax(f, -n, 0.018)
    return f


def grad(p, h=1e-5):
    g = np.empty_like(p)
    for i in range(3):
        e = np.zeros(3)
        e[i] = h
        g[:, i] = (organ(p + e) - organ(p - e)) / (2 * h)
    return g


def project(p, n=12):
    """Newton steps along the gradient on to organ(p) = 0."""
    p = p.copy()
    for _ in range(n):
        g = grad(p)
        s = organ(p) / np.maximum((g * g).sum(1), 0.05)
        p -= np.clip(s, -0.004, 0.004)[:, None] * g
    return p


# ---------------------------------------------------------- surface triangles
def fine_surface(h=0.0016):
    lo, hi = np.array([-0.125, -0.085, -0.105]), np.array([0.13, 0.085, 0.085])
    n = np.ceil((hi - lo) / h).astype(int) + 1
    ax = [lo[i] + h * np.arange(n[i]) for i in range(3)]
    f = organ(np.stack(np.meshgrid(*ax, indexing="ij"), -1))
    v, t, _, _ = marching_cubes(f, 0.0, spacing=(h, h, h),
                                allow_degenerate=False)
    return v + lo, t


def outward(v, t):
    a, b, c = (v[t[:, i]] for i in range(3))
    if np.einsum("ij,ij->i", a, np.cross(b, c)).sum() < 0:
        t = t[:, [0, 2, 1]]
    return t


def edges_of(t):
    e = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), 1)
    return e


def check_closed(t):
    _, n = np.unique(edges_of(t), axis=0, return_counts=True)
    assert (n == 2).all(), "surface is not a closed manifold"


def flip_delaunay(v, t, sweeps=10):
    """Flip an edge when the two angles facing it sum to more than pi."""
    t = [list(x) for x in t]
    for _ in range(sweeps):
        where = {}
        for k, x in enumerate(t):
            for i in range(3):
                where[(x[i], x[(i + 1) % 3])] = k
        touched, done = set(), 0
        for (a, b), k in sorted(where.items()):
            if a > b:
                continue
            m = where[(b, a)]
            if k in touched or m in touched:
                continue
            c = next(i for i in t[k] if i not in (a, b))
            d = next(i for i in t[m] if i not in (a, b))
            if (c, d) in where or (d, c) in where:
                continue

            def ang(o):
                u, w = v[a] - v[o], v[b] - v[o]
                return np.arccos(np.clip(u @ w / np.linalg.norm(u)
                                         / np.linalg.norm(w), -1, 1))
            if ang(c) + ang(d) < np.pi + 0.02:
                continue
            n0 = np.cross(v[b] - v[a], v[c] - v[a])
            n1 = np.cross(v[d] - v[a], v[b] - v[a])
            if n0 @ n1 < 0.7 * np.linalg.norm(n0) * np.linalg.norm(n1):
                continue
            t[k], t[m] = [a, d, c], [d, b, c]
            touched |= {k, m}
            done += 1
        if not done:
            break
    return np.array(t)


def coarse_surface(vertices):
    v, t = fine_surface()
    t = outward(v, t)
    m = pv.PolyData(v, np.column_stack([np.full(len(t), 3), t]).ravel())
    c = pyacvd.Clustering(m)
    c.subdivide(1)
    c.cluster(vertices)
    r = c.create_mesh()
    v = project(np.asarray(r.points, float))
    t = outward(v, np.asarray(r.faces).reshape(-1, 4)[:, 1:])
    check_closed(t)
    for _ in range(15):                      # tangential smoothing + flips
        t = flip_delaunay(v, t)
        e = np.unique(edges_of(t), axis=0)
        s, n = np.zeros_like(v), np.zeros(len(v))
        for i, j in ((0, 1), (1, 0)):
            np.add.at(s, e[:, i], v[e[:, j]])
            np.add.at(n, e[:, i], 1)
        d = s / n[:, None] - v
        g = grad(v)
        g /= np.linalg.norm(g, axis=1)[:, None]
        d -= (d * g).sum(1)[:, None] * g
        v = project(v + 0.4 * d)
    t = outward(v, flip_delaunay(v, t))
    check_closed(t)
    return np.round(v, 8), t


# ----------------------------------------------------------------- tetrahedra
def tetrahedralise(v, t):
    e = np.unique(edges_of(t), axis=0)
    h = np.linalg.norm(v[e[:, 0]] - v[e[:, 1]], axis=1).mean() * EDGE_FACTOR
    gmsh.initialize(["liver", "-nt", "1"])
    o = gmsh.option.setNumber
    o("General.Terminal", 0)
    o("General.NumThreads", 1)
    o("Mesh.Algorithm3D", 1)
    o("Mesh.RandomSeed", 1)
    o("Mesh.MeshSizeMin", 0.6 * h)
    o("Mesh.MeshSizeMax", h)
    o("Mesh.MeshSizeExtendFromBoundary", 0)
    o("Mesh.Optimize", 1)
    o("Mesh.OptimizeNetgen", 1)
    o("Mesh.OptimizeThreshold", 0.5)
    gmsh.model.add("liver")
    gmsh.model.addDiscreteEntity(2, 1)
    gmsh.model.mesh.addNodes(2, 1, np.arange(1, len(v) + 1), v.ravel())
    gmsh.model.mesh.addElementsByType(1, 2, [], t.ravel() + 1)
    gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop([1])], 1)
    gmsh.model.geo.synchronize()
    gmsh.model.mesh.generate(3)
    for _ in range(4):
        gmsh.model.mesh.optimize("Netgen")
        gmsh.model.mesh.optimize("Relocate3D")
        gmsh.model.mesh.optimize("")
    tag, x, _ = gmsh.model.mesh.getNodes()
    x = x.reshape(-1, 3)
    _, q = gmsh.model.mesh.getElementsByType(4)
    gmsh.finalize()
    at = np.full(tag.max() + 1, -1)
    at[tag] = np.arange(len(tag))
    k = at[q].reshape(-1, 4)
    used = np.unique(k)
    new = np.full(len(x), -1)
    new[used] = np.arange(len(used))
    x, k = np.round(x[used], 8), new[k]
    neg = volumes(x, k) < 0
    k[neg] = k[neg][:, [0, 1, 3, 2]]
    return x, k


def volumes(x, k):
    a, b, c, d = (x[k[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6


def quality(x, k):
    p = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    l2 = sum(((x[k[:, i]] - x[k[:, j]]) ** 2).sum(1) for i, j in p) / 6
    return 6 * np.sqrt(2) * volumes(x, k) / l2 ** 1.5


def boundary(k):
    """Faces of one tet only, turned outward (tets are positive)."""
    f = np.concatenate([k[:, [0, 2, 1]], k[:, [0, 1, 3]],
                        k[:, [0, 3, 2]], k[:, [1, 2, 3]]])
    _, i, n = np.unique(np.sort(f, 1), axis=0, return_index=True,
                        return_counts=True)
    return f[np.sort(i[n == 1])]


def relax(x, k, sweeps=60):
    """Move inner vertices where that lifts the worst tet around them."""
    inner = np.setdiff1d(np.arange(len(x)), np.unique(boundary(k)))
    ring = {i: np.where((k == i).any(1))[0] for i in inner}
    rng = np.random.default_rng(7)
    step = 0.002
    for s in range(sweeps):
        for i in inner:
            r = k[ring[i]]
            q0 = quality(x, r)
            best, old = np.sort(q0)[0], x[i].copy()
            if best > 0.6:
                continue
            for _ in range(6):
                keep = x[i].copy()
                x[i] = keep + rng.normal(0, step, 3)
                q1 = quality(x, r).min()
                if q1 > best:
                    best = q1
                else:
                    x[i] = keep
        step *= 0.95
    return np.round(x, 8)


# --------------------------------------------------------------------- groups
def pick_groups(x, f):
    c = x[f].mean(1)
    n = np.cross(x[f[:, 1]] - x[f[:, 0]], x[f[:, 2]] - x[f[:, 0]])
    n /= np.linalg.norm(n, axis=1)[:, None]
    g = np.full(len(f), 2)                                   # surface
    # a long band over the crest of the dome, a little to the back
    u = (c[:, 0] + 0.018) / 0.066
    w = (c[:, 1] - 0.018) / 0.019
    g[(u ** 2 + w ** 2 < 1) & (n[:, 2] > 0.25)] = 0          # ligament
    near = {}
    for i, t in enumerate(f):
        for j in range(3):
            near.setdefault(frozenset((t[j], t[j - 1])), []).append(i)
    pair = np.array(list(near.values()))
    side = [[] for _ in f]
    for i, j in pair:
        side[i].append(j)
        side[j].append(i)
    for _ in range(4):                        # trim the ragged border
        for i, s in enumerate(side):
            m = (g[s] == 0).sum()
            g[i] = 0 if m >= 2 else 2
    # the front lower rim of the left lobe
    sv = np.unique(f)
    on = sv[np.abs(x[sv, 0] - 0.066) < 0.010]
    tip = x[on[np.argmax(x[on] @ RIM)]]
    d = np.linalg.norm(x - tip, axis=1)
    near = np.zeros(len(x), bool)
    near[sv[np.argsort(d[sv])[:9]]] = True
    g[near[f].all(1)] = 1                                    # tool
    return g


def write(path, x, k, f, g):
    names = ["ligament", "tool", "surface"]
    with open(path, "w", newline="\n") as o:
        o.write("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n4\n")
        for i, s in enumerate(names):
            o.write(f'2 {i + 1} "{s}"\n')
        o.write('3 4 "body"\n$EndPhysicalNames\n')
        o.write(f"$Nodes\n{len(x)}\n")
        for i, p in enumerate(x):
            o.write("%d %.9g %.9g %.9g\n" % (i + 1, *(p + 0.0)))
        o.write(f"$EndNodes\n$Elements\n{len(f) + len(k)}\n")
        i = 0
        for j in np.argsort(g, kind="stable"):
            i += 1
            o.write("%d 2 2 %d %d %d %d %d\n" % (i, g[j] + 1, g[j] + 1,
                                                 *(f[j] + 1)))
        for q in k:
            i += 1
            o.write("%d 4 2 4 1 %d %d %d %d\n" % (i, *(q + 1)))
        o.write("$EndElements\n")


def main():
    out = sys.argv[1] if len(sys.argv) > 1 else os.path.join(
        os.path.dirname(os.path.abspath(__file__)), "liver.msh")
    v, t = coarse_surface(int(sys.argv[2]) if len(sys.argv) > 2 else N_SURFACE)
    x, k = tetrahedralise(v, t)
    x = relax(x, k)
    f = boundary(k)
    g = pick_groups(x, f)
    write(out, x, k, f, g)
    q = quality(x, k)
    print(f"{len(x)} vertices, {len(k)} tetrahedra, {len(f)} triangles, "
          f"quality min {q.min():.3f} mean {q.mean():.3f}, "
          f"volume {1000 * volumes(x, k).sum():.4f} L")


if __name__ == "__main__":
    main()
