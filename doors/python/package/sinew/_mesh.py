"""Meshes, and arrays on their way in."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._errors import ArgumentError


def floats(what: str, values: ArrayLike, columns: int = 0) -> NDArray[np.float64]:
    """Numbers as a flat array; with ``columns`` the last axis must have so many."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise TypeError(f"{what}: numbers are needed, not {array.dtype}")
    if columns and array.size and (array.ndim == 0 or array.shape[-1] != columns):
        raise ArgumentError(f"{what}: the shape is {array.shape}; the last axis must have {columns} numbers")
    return np.ascontiguousarray(array, np.float64).reshape(-1)


def vector(what: str, values: ArrayLike, count: int = 3) -> Any:
    """A vector as a tuple."""
    array = floats(what, values)
    if array.size != count:
        raise ArgumentError(f"{what}: {array.size} numbers given, {count} needed")
    return tuple(array.tolist())


def indices(what: str, values: ArrayLike, columns: int = 0) -> NDArray[np.uint32]:
    """Indices as a flat array; a mask of booleans stands for the places where it is true."""
    array = np.asarray(values)
    if array.dtype == bool and not columns:
        array = np.flatnonzero(array)
    if array.size == 0:
        return np.zeros(0, np.uint32)
    if array.dtype.kind not in "iu":
        raise TypeError(f"{what}: whole numbers are needed, not {array.dtype}")
    if columns and (array.ndim == 0 or array.shape[-1] != columns):
        raise ArgumentError(f"{what}: the shape is {array.shape}; the last axis must have {columns} indices")
    if int(array.min()) < 0 or int(array.max()) > 0xFFFF_FFFF:
        raise ArgumentError(f"{what}: {array.min()} to {array.max()} is out of range; indices count from 0")
    return np.ascontiguousarray(array, np.uint32).reshape(-1)


def toml(value: Any) -> str:
    """A value as in a scene file; numbers, texts, truth values and lists are written alike in JSON and TOML."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {toml(own)}" for key, own in value.items()) + " }"
    return json.dumps(value, default=lambda own: own.tolist())


class Mesh:
    """Points, solid elements, faces and groups; elements in the order of vertices of Gmsh and VTK.

    points: (n, 3), m. tetrahedra: (m, 4). hexahedra: (m, 8). triangles: (m, 3). quads: (m, 4).
    groups: names and vertices (indices, or a mask of n booleans); cells belong to a group that has all their vertices.
    """

    __slots__ = ("_own", "_groups")

    def __init__(
        self,
        points: ArrayLike,
        tetrahedra: ArrayLike = (),
        hexahedra: ArrayLike = (),
        triangles: ArrayLike = (),
        quads: ArrayLike = (),
        groups: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        cells = [
            indices("tetrahedra", tetrahedra, 4),
            indices("hexahedra", hexahedra, 8),
            indices("triangles", triangles, 3),
            indices("quads", quads, 4),
        ]
        named = [(str(name), indices(f"group `{name}`", list_)) for name, list_ in (groups or {}).items()]
        self._own = _native.Mesh.of_arrays(floats("points", points, 3), cells, named)
        self._groups: dict[str, NDArray[np.uint32]] | None = None

    @classmethod
    def _of(cls, own: _native.Mesh) -> Mesh:
        mesh = cls.__new__(cls)
        mesh._own = own
        mesh._groups = None
        return mesh

    @classmethod
    def from_bytes(cls, name: str, data: bytes) -> Mesh:
        """Reads the bytes of a file; the extension of ``name`` helps to tell the format."""
        return cls._of(_native.Mesh.of_bytes(name, data))

    @classmethod
    def from_meshio(cls, mesh: Any) -> Mesh:
        """From a ``meshio.Mesh``. Point sets, cell sets and physical groups of Gmsh become groups."""
        cells = mesh.cells_dict
        words = {"tetrahedra": "tetra", "hexahedra": "hexahedron", "triangles": "triangle", "quads": "quad"}
        groups: dict[str, ArrayLike] = {k: np.asarray(v) for k, v in (mesh.point_sets or {}).items()}
        for name, blocks in (mesh.cell_sets or {}).items():
            if name.startswith("gmsh:"):
                continue
            lists = [np.unique(block.data[np.asarray(own, np.int64)]) for block, own in zip(mesh.cells, blocks) if own is not None and len(own)]
            if lists:
                groups[name] = np.unique(np.concatenate(lists))
        physical = (mesh.cell_data or {}).get("gmsh:physical") or []
        for name, tag in (mesh.field_data or {}).items():
            own = [np.unique(b.data[np.asarray(p) == tag[0]]) for b, p in zip(mesh.cells, physical)]
            if any(part.size for part in own):
                groups[name] = np.unique(np.concatenate([part for part in own if part.size]))
        points = np.asarray(mesh.points)
        if points.ndim == 2 and points.shape[1] == 2:
            points = np.column_stack([points, np.zeros(len(points))])
        return cls(points, groups=groups, **{k: cells[v] for k, v in words.items() if v in cells})

    @classmethod
    def from_pyvista(cls, grid: Any) -> Mesh:
        """From a ``pyvista.UnstructuredGrid`` or ``PolyData``. Boolean point data become groups."""
        words = {10: "tetrahedra", 12: "hexahedra", 5: "triangles", 9: "quads"}
        if hasattr(grid, "cells_dict"):
            cells = {words[int(k)]: v for k, v in grid.cells_dict.items() if int(k) in words}
        else:
            cells = {"triangles": np.asarray(grid.triangulate().faces).reshape(-1, 4)[:, 1:]}
        data = {name: np.asarray(grid.point_data[name]) for name in grid.point_data.keys()}
        groups = {name: own for name, own in data.items() if own.dtype == bool and own.ndim == 1}
        return cls(np.asarray(grid.points), groups=groups, **cells)

    @property
    def points(self) -> NDArray[np.float64]:
        """Coordinates (m), (n, 3), read-only."""
        return self._own.points

    @property
    def tetrahedra(self) -> NDArray[np.uint32]:
        """Tetrahedra, (m, 4), read-only."""
        return self._own.cells()[0]

    @property
    def hexahedra(self) -> NDArray[np.uint32]:
        """Hexahedra, (m, 8), read-only."""
        return self._own.cells()[1]

    @property
    def triangles(self) -> NDArray[np.uint32]:
        """Triangles, (m, 3), read-only."""
        return self._own.cells()[2]

    @property
    def quads(self) -> NDArray[np.uint32]:
        """Quadrilaterals, (m, 4), read-only."""
        return self._own.cells()[3]

    @property
    def groups(self) -> dict[str, NDArray[np.uint32]]:
        """Names and vertices of groups."""
        if self._groups is None:
            self._groups = dict(self._own.groups())
        return self._groups

    @property
    def cell_data(self) -> dict[str, NDArray[np.float64]]:
        """Names and numbers that the file keeps with its cells, for ``Material`` and the like: of the tetrahedra, then of the
        hexahedra; in a mesh without these of the triangles, then of the quads. NaN where there is none."""
        return dict(self._own.cell_data())

    def select(self, **place: Any) -> NDArray[np.uint32]:
        """Vertices by a place as below ``select`` of scenes, ascending, such as
        ``select(half_space={"point": (0, 0, 0.05), "normal": (0, 0, 1)})``, ``select(patch={"near": (0, 0, 0.1)})``,
        ``box``, ``sphere``, ``cylinder``, ``group`` or ``all=True``."""
        return self._own.select("\n".join(f"{key} = {toml(value)}" for key, value in place.items()))

    @property
    def source(self) -> str:
        """Where it comes from."""
        return self._own.source

    def __repr__(self) -> str:
        names = ("points", "tetrahedra", "hexahedra", "triangles", "quads")
        counts = [f"{count} {name}" for name, count in zip(names, self._own.counts) if count]
        return f"<sinew.Mesh: {', '.join(counts)}, groups {list(self.groups)}>"


def read_mesh(path: str | os.PathLike[str]) -> Mesh:
    """Reads a mesh file (Gmsh, VTK, STL and the others that scenes read)."""
    return Mesh._of(_native.Mesh.of_file(os.fspath(path)))


def generate(shape: str, **parameters: Any) -> Mesh:
    """A mesh of a shape as below ``generate`` of scenes, such as ``generate("box", size=(0.1, 0.1, 0.1), cells=(2, 2, 2))``.

    A box has the groups x0, x1, y0, y1, z0 and z1.
    """
    return Mesh._of(_native.Mesh.of_generator(f"{shape} = {toml(parameters)}"))
