#!/usr/bin/env python3
"""Makes stomach.msh, a stomach-like organ of tetrahedra beside liver.msh.

A bent bag of three ellipsoids in the frame of the liver, cut back to 4 mm
from it.  It comes from no scan, atlas or other mesh, and is not anatomy.

    python stomach.py [OUT.msh [N]]    (default: stomach.msh beside this file;
                                        N vertices of the surface, 200 or so)

Steps and packages are those of liver.py.
"""
import os
import sys

import numpy as np

import liver

of_liver = liver.organ


def stomach(p):
    fundus = liver.ellipsoid(p, (0.078, 0.030, -0.012), (0.034, 0.034, 0.036))
    middle = liver.ellipsoid(p, (0.072, 0.026, -0.048), (0.032, 0.034, 0.042),
                             pitch=0.3)
    outlet = liver.ellipsoid(p, (0.028, 0.034, -0.074), (0.042, 0.024, 0.025))
    f = liver.smin(liver.smin(fundus, middle, 0.025), outlet, 0.020)
    return liver.smax(f, 0.004 - of_liver(p), 0.010)


def main():
    out = sys.argv[1] if len(sys.argv) > 1 else os.path.join(
        os.path.dirname(os.path.abspath(__file__)), "stomach.msh")
    liver.organ = stomach
    v, t = liver.coarse_surface(int(sys.argv[2]) if len(sys.argv) > 2 else 200)
    x, k = liver.tetrahedralise(v, t)
    x = liver.relax(x, k)
    f = liver.boundary(k)
    liver.write(out, x, k, f, np.full(len(f), 2))
    q = liver.quality(x, k)
    print(f"{len(x)} vertices, {len(k)} tetrahedra, quality {q.min():.3f}, "
          f"{1000 * liver.volumes(x, k).sum():.3f} L")


if __name__ == "__main__":
    main()
