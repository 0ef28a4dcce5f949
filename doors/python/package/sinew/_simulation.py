"""Simulations, bodies, and what acts on them."""

from __future__ import annotations

import copyreg
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from . import _reports as reports
from . import _types as types
from ._errors import ArgumentError
from ._mesh import Mesh, floats, indices, toml, vector
from ._native import HapticDevice, Snapshot
from ._reports import Floats, Report
from ._types import Axes, Curve, Energy, Material, Membrane, Part, Pick, Pose, Run, Shape, Sine, Skin, Stiffness, Wrench


def _read_snapshot(data: bytes) -> Snapshot:
    """What pickles of snapshots call."""
    return Snapshot.from_bytes(data)


copyreg.pickle(Snapshot, lambda own: (_read_snapshot, (own.to_bytes(),)))

Vertices = str | ArrayLike
"""A group by its name, indices, or a mask."""

Over = tuple[float, float]
"""Times (s) at which a factor leaves 0 and reaches 1."""

_NO_TURN = (0.0, 0.0, 0.0, 1.0)


def _curve(curve: Curve | None, over: Over | None = None) -> Any:
    """A curve as the engine takes it."""
    if over is not None:
        if curve is not None:
            raise ArgumentError("give `over` or `curve`, not both")
        start, end = vector("over", over, 2)
        return [[start, 0.0], [end, 1.0]]
    if curve is None or isinstance(curve, Sine):
        return curve
    points = floats("curve", curve, 2).reshape(-1, 2)
    return [list(point) for point in points.tolist()]


class _Spec:
    """What the engine reads the attributes of."""

    def __init__(self, **own: Any) -> None:
        self.__dict__.update(own)


def _material(material: Material) -> _Spec:
    names = ("young", "poisson", "density")
    own = {name: floats(name, getattr(material, name)) for name in names}
    for name, numbers in own.items():
        if numbers.size == 0:
            raise ArgumentError(f"{name}: the array is empty; give one number, or one for each element")
    return _Spec(**own)


def _springs(springs: str | float | None) -> tuple[str, float | None] | None:
    if springs is None:
        return None
    return (springs, None) if isinstance(springs, str) else ("uniform", float(springs))


def _membrane(own: Membrane) -> _Spec:
    none: tuple[int, ...] = ()
    return _Spec(
        cells=own.cells,
        triangles=indices("triangles of the membrane", none if own.triangles is None else own.triangles, 3),
        quads=indices("quads of the membrane", none if own.quads is None else own.quads, 4),
        thickness=float(own.thickness),
        material=_material(own.material),
        plane=own.plane,
        model=own.model,
        evaluation=own.evaluation,
        springs=_springs(own.springs),
        bending=bool(own.bending),
        bending_thickness=None if own.bending_thickness is None else float(own.bending_thickness),
        bending_rest=own.bending_rest,
    )


def _axes(own: Axes) -> _Spec:
    names = [family.name for family in own.families]
    for pair in own.angles:
        for name in pair:
            if name not in names:
                raise ArgumentError(f"an angle names family `{name}`; there are {', '.join(names) or 'none'}")
    return _Spec(
        families=[
            _Spec(
                name=family.name,
                directions=floats("directions", family.directions, 3),
                modulus=float(family.modulus),
                form=family.form,
                viscosity=float(family.viscosity),
                share=None if family.share is None else floats("share", family.share),
                muscle=None
                if family.muscle is None
                else _Spec(**{**vars(family.muscle), "curve": _curve(family.muscle.curve)}),
            )
            for family in own.families
        ],
        angles=[([names.index(a), names.index(b)], float(g)) for (a, b), g in own.angles.items()],
        volume_modulus=float(own.volume_modulus),
    )


def _part(own: Part | Shape) -> _Spec:
    part = own if isinstance(own, Part) else Part(own)
    shape, mesh, numbers = part.shape, None, []
    if isinstance(shape, types.Sphere):
        kind, numbers = "sphere", [float(shape.radius)]
    elif isinstance(shape, types.Capsule):
        kind, numbers = "capsule", [float(shape.half_length), float(shape.radius)]
    elif isinstance(shape, types.Box):
        kind, numbers = "box", [*vector("half", shape.half), float(shape.rounding)]
    elif isinstance(shape, types.HalfSpace):
        kind = "half-space"
    elif isinstance(shape, types.Field):
        kind, mesh = "field", shape.mesh._own
        numbers = [] if shape.spacing is None else [float(shape.spacing)]
    else:
        raise TypeError(f"{shape!r} is no shape; use Sphere, Capsule, Box, HalfSpace or Field")
    at, rotation = vector("at", part.at), vector("rotation", part.rotation, 4)
    placed = {"at": at, "rotation": rotation, "cavity": bool(part.cavity), "jaw": float(part.jaw)}
    return _Spec(kind=kind, numbers=numbers, mesh=mesh, **placed)


def _tool_pose(position: ArrayLike, rotation: ArrayLike, opening: float) -> Any:
    return vector("position", position), vector("rotation", rotation, 4), float(opening)


class _Thing:
    """Something of a simulation, by its handle."""

    __slots__ = ("simulation", "handle", "name")
    _kind = ""

    def __init__(self, simulation: Simulation, handle: int, name: str) -> None:
        self.simulation = simulation
        self.handle = handle
        self.name = name

    @property
    def _own(self) -> _native.Engine:
        return self.simulation._own

    def __repr__(self) -> str:
        return f"<sinew.{type(self).__name__} {self.name!r}>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Thing) and self.handle == other.handle

    def __hash__(self) -> int:
        return hash(self.handle)


class _Removable(_Thing):
    __slots__ = ()

    def remove(self) -> None:
        """Takes it away; it cannot be used any more."""
        self._own.remove(self.handle)


class Body(_Thing):
    """A body. Arrays are in the order of the vertices and elements of its mesh.

    ``positions``, ``displacements`` and ``velocities`` are read-only views of arrays that are written anew at the end of every
    call that changes the state; ``.copy()`` keeps one. A mesh may get more vertices: ask for arrays again when
    ``surface_revision`` is another one. numpy itself reads large arrays with the interpreter's lock released: a
    thread that reads while another one steps uses :meth:`copy`, which never mixes two states.
    """

    __slots__ = ()
    _kind = "body"

    @property
    def mesh(self) -> Mesh:
        """Its mesh at rest, checked and repaired."""
        return Mesh._of(self._own.mesh(self.handle))

    @property
    def positions(self) -> Floats:
        """Positions (m), (n, 3), a view that is refreshed."""
        return self.simulation._own.view(self.handle, "positions")

    @property
    def displacements(self) -> Floats:
        """Displacements (m), (n, 3), a view that is refreshed."""
        return self.simulation._own.view(self.handle, "displacements")

    @property
    def velocities(self) -> Floats:
        """Velocities (m/s), (n, 3), a view that is refreshed."""
        return self.simulation._own.view(self.handle, "velocities")

    def copy(self, quantity: str = "positions") -> Floats:
        """A copy of ``"positions"``, ``"displacements"`` or ``"velocities"``, whole even while another thread steps."""
        return self._own.copy(self.handle, quantity)

    @property
    def masses(self) -> Floats:
        """Masses (kg), (n,)."""
        return self._own.numbers(self.handle, "masses")

    @property
    def elastic_forces(self) -> Floats:
        """Elastic forces (N) at the state as it is, (n, 3)."""
        return self._own.numbers(self.handle, "elastic_forces").reshape(-1, 3)

    @property
    def external_forces(self) -> Floats:
        """Forces (N) of gravity and loads in the last step, (n, 3)."""
        return self._own.numbers(self.handle, "external_forces").reshape(-1, 3)

    @property
    def contact_forces(self) -> Floats:
        """Forces (N) of tools, contact and pulls at the end of the last step, (n, 3)."""
        return self._own.numbers(self.handle, "contact_forces").reshape(-1, 3)

    @property
    def contact_pressures(self) -> Floats:
        """Pressures (Pa) of contact at the end of the last step, (n,)."""
        return self._own.numbers(self.handle, "contact_pressures")

    @property
    def volume_ratios(self) -> Floats:
        """Volume over that at rest of tetrahedra, then hexahedra (their smallest Gauss point), (m,)."""
        return self._own.numbers(self.handle, "volume_ratios")

    @property
    def area_ratios(self) -> Floats:
        """Area over that at rest of the triangles of its membrane, then of its quadrilaterals, (m,)."""
        return self._own.numbers(self.handle, "area_ratios")

    @property
    def volume(self) -> float:
        """Volume (m^3) of its solid elements as they are."""
        return self._own.volume(self.handle)

    @property
    def surface(self) -> NDArray[np.uint32]:
        """Triangles of its outside, (m, 3), made anew after removals."""
        return self._own.surface(self.handle)[0]

    @property
    def surface_revision(self) -> int:
        """A number that changes whenever the surface does."""
        return self._own.surface(self.handle)[1]

    def remaining(self, kind: str = "tetrahedra") -> NDArray[np.uint32]:
        """Indices of the ``"tetrahedra"``, ``"hexahedra"``, ``"triangles"`` or ``"quads"`` that are left, ascending."""
        return self._own.remaining(self.handle, kind)

    def vertices(self, which: Vertices) -> NDArray[np.uint32]:
        """Vertices of a group, or indices as they are."""
        if isinstance(which, str):
            return self._own.group(self.handle, which)
        mask = np.asarray(which)
        if mask.dtype == bool and mask.shape != (self._own.mesh(self.handle).counts[0],):
            raise ArgumentError(f"vertices: a mask of shape {mask.shape}; it needs one for each vertex")
        return indices("vertices", which)

    def faces(self, which: Vertices | None = None) -> NDArray[np.uint32]:
        """Triangles (m, 3) of the surface: all, those of a group, or given ones as they are."""
        if which is not None and not isinstance(which, str):
            return indices("triangles", which, 3).reshape(-1, 3)
        surface = self.surface
        if which is None:
            return surface
        return surface[np.isin(surface, self.vertices(which)).all(axis=1)]

    def set_state(self, displacements: ArrayLike, velocities: ArrayLike) -> None:
        """Sets displacements (m) and velocities (m/s), (n, 3) each."""
        u, v = floats("displacements", displacements, 3), floats("velocities", velocities, 3)
        self._own.set_state(self.handle, u, v)

    @contextmanager
    def writable(self) -> Iterator[tuple[Floats, Floats]]:
        """Copies of displacements and velocities to write into; the state is set from them at the end."""
        u, v = self.copy("displacements"), self.copy("velocities")
        yield u, v
        self.set_state(u, v)

    @property
    def material(self) -> Material:
        """Its material; numbers by element are arrays."""
        own = self._own.material(self.handle)
        return Material(*(numbers if numbers.size != 1 else float(numbers[0]) for numbers in own))

    def set_material(
        self,
        material: Material | None = None,
        *,
        young: ArrayLike | None = None,
        poisson: ArrayLike | None = None,
        density: ArrayLike | None = None,
    ) -> Energy:
        """Gives it another material from the next step on; what is not given stays. By how much (J) its energies change."""
        own = self.material if material is None else material
        given = (young, poisson, density)
        old = (own.young, own.poisson, own.density)
        new = Material(*(b if a is None else a for a, b in zip(given, old)))
        return Energy(*self._own.set_material(self.handle, _material(new)))

    def remove(
        self,
        *,
        tetrahedra: ArrayLike | None = None,
        hexahedra: ArrayLike | None = None,
        triangles: ArrayLike | None = None,
        quads: ArrayLike | None = None,
        sphere: tuple[ArrayLike, float] | None = None,
        capsule: tuple[ArrayLike, ArrayLike, float] | None = None,
        strain: float | None = None,
        stress: float | None = None,
        mass: str = "recompute",
    ) -> reports.Removal:
        """Removes elements: a list of one kind, a ``sphere`` (centre, radius) or ``capsule`` (from, to, radius) in m, or what is
        above a principal Green ``strain`` or a von Mises ``stress`` (Pa). Give one of them. ``mass`` says whether matter goes
        with them ("recompute") or stays at the vertices ("keep")."""
        lists = {"tetrahedra": tetrahedra, "hexahedra": hexahedra, "triangles": triangles, "quads": quads}
        places = {"sphere": sphere, "capsule": capsule, "strain": strain, "stress": stress}
        given = [kind for kind, value in {**lists, **places}.items() if value is not None]
        if len(given) != 1:
            raise ArgumentError(f"remove: give one region, not {' and '.join(given) or 'none'}")
        kind, empty = given[0], np.zeros(0, np.uint32)
        chosen, numbers = empty, []
        if kind in lists:
            chosen = indices(kind, lists[kind])  # type: ignore[arg-type]
        elif sphere is not None:
            numbers = [*vector("centre", sphere[0]), float(sphere[1])]
        elif capsule is not None:
            numbers = [*vector("from", capsule[0]), *vector("to", capsule[1]), float(capsule[2])]
        else:
            numbers = [float(places[kind])]  # type: ignore[arg-type]
        report = json.loads(self._own.remove_elements(self.handle, kind, chosen, numbers, mass))
        del report["time"]
        return reports.Removal(**report)

    def cut(self, strip: ArrayLike) -> reports.Cut:
        """Cuts a body along the surface that a blade sweeps, at once, in its present shape: one of solid elements, or of a membrane
        of triangles alone. ``strip``: both ends (m) of the edge of the blade, one position after another, (n, 2, 3)."""
        ends = np.asarray(strip, float)
        if ends.ndim != 3 or ends.shape[1:] != (2, 3):
            raise ArgumentError(f"strip: an array of shape {ends.shape}; it needs (n, 2, 3)")
        report = json.loads(self._own.cut(self.handle, floats("strip", ends.reshape(-1, 3), 3)))
        del report["time"]
        return reports.Cut(**report)

    def set_tear(self, strength: float | None, *, toughness: float | None = None, radius: float | None = None, max_speed: float | None = None) -> None:
        """Lets it tear where the tension, averaged over a ball of ``radius`` (m, at rest; 1.2 mean edges without), is above
        ``strength`` (Pa), and on from wounds where these release more energy than ``toughness`` (J/m^2; by strength without), no faster than ``max_speed`` (m/s; that of shear waves without). ``None``: it tears no more."""
        own = {"strength": strength, "toughness": toughness, "radius": radius, "max_speed": max_speed}
        self._own.set_tear(self.handle, None if strength is None else _lines(own))

    @property
    def glue(self) -> reports.GlueReport | None:
        """What the glue of its wounds does; ``None`` when it has none."""
        report = self._own.glue_report(self.handle)
        return None if report is None else reports.GlueReport(**json.loads(report))

    @property
    def tear(self) -> reports.TearReport | None:
        """What its tears did up to the last step; ``None`` when it does not tear."""
        report = self._own.tear_report(self.handle)
        return None if report is None else reports.TearReport(**json.loads(report))

    @property
    def skin(self) -> Skin:
        """What to draw of it, cut or not: its outside and both sides of its wounds."""
        (points, rest, depth), triangles, wound, revision = self._own.skin(self.handle)
        return Skin(points.reshape(-1, 3), rest.reshape(-1, 3), depth, triangles.reshape(-1, 3), wound, revision)

    def set_activation(self, family: str, activation: float) -> None:
        """Sets the activation (0 to 1) of an active family of fibres from the next step on."""
        self._own.set_activation(self.handle, family, activation)

    def set_axis_modulus(self, family: str, modulus: float) -> float:
        """Gives a family of fibres another modulus (Pa); by how much (J) the elastic energy changes."""
        return self._own.set_axis_modulus(self.handle, family, modulus)


class Constraint(_Removable):
    """Vertices that are held or moved."""

    __slots__ = ()
    _kind = "constraint"

    @property
    def reaction(self) -> Floats:
        """Force (N) on the body at the state as it is, (3,)."""
        return np.array(self._own.reaction(self.handle, (0.0, 0.0, 0.0))[0])

    def wrench(self, about: ArrayLike = (0.0, 0.0, 0.0)) -> Wrench:
        """Force (N) on the body, and its torque (N m) about a point (m)."""
        force, torque = self._own.reaction(self.handle, vector("about", about))
        return Wrench(np.array(force), np.array(torque))

    def set_target(
        self, by: ArrayLike = (0.0, 0.0, 0.0), rotation: ArrayLike = _NO_TURN, centre: ArrayLike = (0.0, 0.0, 0.0)
    ) -> None:
        """Where what it holds is at the end of the next step, from where it took hold: a translation (m), after a rotation
        (quaternion x, y, z, w) about a centre (m)."""
        pose = vector("by", by), vector("rotation", rotation, 4), vector("centre", centre)
        self._own.set_target(self.handle, pose)


class Load(_Removable):
    """Forces on vertices."""

    __slots__ = ()
    _kind = "load"


class Pressure(_Removable):
    """A follower pressure on faces."""

    __slots__ = ()
    _kind = "pressure"


class Tool(_Removable):
    """A rigid tool that touches bodies."""

    __slots__ = ()
    _kind = "tool"

    def move(self, position: ArrayLike, rotation: ArrayLike = _NO_TURN, opening: float = 0.0) -> None:
        """It is there at the end of the next step, evenly through the step. Position in m, quaternion x, y, z, w, opening in rad."""
        self._own.move_tool(self.handle, _tool_pose(position, rotation, opening))

    def place(self, position: ArrayLike, rotation: ArrayLike = _NO_TURN, opening: float = 0.0) -> None:
        """Puts it there at once, touching nothing on the way."""
        self._own.place_tool(self.handle, _tool_pose(position, rotation, opening))

    def set_grip(self, grip: bool) -> None:
        """Whether what touches it sticks to it, however little it is pressed."""
        self._own.set_grip(self.handle, grip)

    @property
    def report(self) -> reports.ToolReport:
        """What it felt in the last step."""
        return types.tool_report(self._own.tool_report(self.handle))

    @property
    def force(self) -> Floats:
        """Force (N) on it in the last step, (3,)."""
        return self.report.force


class Contact(_Removable):
    """Two bodies that touch each other."""

    __slots__ = ()
    _kind = "contact"

    @property
    def report(self) -> reports.ContactReport:
        """What they did to each other in the last step."""
        report: reports.ContactReport = types.of_json(reports.ContactReport, self._own.contact_report(self.handle))
        return report


class Pull(_Removable):
    """A spring and a damper from vertices to a moving hand."""

    __slots__ = ()
    _kind = "pull"

    def move(self, by: ArrayLike, rotation: ArrayLike = _NO_TURN, centre: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Where the hand is at the end of the next step, from where the vertices were when it took hold (m)."""
        pose = vector("by", by), vector("rotation", rotation, 4), vector("centre", centre)
        self._own.move_pull(self.handle, pose)

    @property
    def report(self) -> reports.PullReport:
        """What it did in the last step."""
        report: reports.PullReport = types.of_json(reports.PullReport, self._own.pull_report(self.handle))
        return report


class Haptic(Pull):
    """A patch that a haptic device holds by a spring inside the implicit step, from the next step on. Every ``step`` serves it;
    :meth:`remove` lets go."""

    __slots__ = ("device",)
    device: HapticDevice
    """For the thread of the device: ``device.exchange(position, velocity, seconds)`` at a kilohertz or so, with ``rotation`` (x, y,
    z, w) and ``angular_velocity`` (rad/s) of one that turns what it holds. Metres and m/s, in the axes of the simulation; where it is first is where the patch is when it is taken hold of. It never waits for a step,
    and outlives the simulation: the force falls to zero then."""

    def move(self, by: ArrayLike, rotation: ArrayLike = _NO_TURN, centre: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Raises ``ArgumentError``: its device moves it."""
        raise ArgumentError(f"the device moves haptic handle `{self.name}`; tell its place by `device.exchange`")


class HeldTool(Tool):
    """A tool that a haptic device holds by a spring inside the implicit step, from the next step on: it is where that and what it
    touches are in balance. Every ``step`` serves it; :meth:`release` lets go of it, :meth:`remove` takes the tool away."""

    __slots__ = ("device",)
    device: HapticDevice
    """For the thread of the device, as :attr:`Haptic.device`; where it is first is where the tool is."""

    def move(self, position: ArrayLike, rotation: ArrayLike = _NO_TURN, opening: float = 0.0) -> None:
        """Raises ``ArgumentError``: its device moves it."""
        raise ArgumentError(f"the device moves tool `{self.name}`; tell its place by `device.exchange`")

    place = move

    def open(self, opening: float) -> None:
        """The angle (rad) between its jaws at the end of the next step."""
        now = self.report
        self._own.move_tool(self.handle, _tool_pose(now.position, now.rotation, opening))

    def release(self) -> Tool:
        """Has the device let go: the tool stays where it stands, and what is returned moves it again."""
        self._own.let_go(self.handle)
        return Tool(self.simulation, self.handle, self.name)


class Reader:
    """The last two states of bodies and tools, each whole, for another thread than the one that steps; one reader a thread. It
    never waits for a step, and outlives the simulation."""

    __slots__ = ("_own",)

    def __init__(self, own: _native.Reader) -> None:
        self._own = own

    def update(self) -> bool:
        """Takes the last state; ``False`` where there is no new one."""
        return self._own.update()

    @property
    def step(self) -> int:
        """Steps done at the last state that was taken."""
        return self._own.clock()[0]

    @property
    def time(self) -> float:
        """Simulated time (s) of the last state that was taken."""
        return self._own.clock()[1]

    def positions(self, body: Body, time: float = math.inf) -> Floats:
        """Positions (m) of the vertices of a body, (n, 3): at a time (s) between the last two states that were taken, from that
        of the last one on those of it, to the bit."""
        return self._own.body(body.handle, False, time)

    def normals(self, body: Body, time: float = math.inf) -> Floats:
        """Unit normals of its outside likewise, (n, 3): means over triangles, weighted by area; 0 at vertices that are not on it, or
        in elements that were cut alone."""
        return self._own.body(body.handle, True, time)

    def wrench(self, tool: Tool, time: float = math.inf) -> Wrench:
        """Force (N) on a tool and torque (N m) about its origin likewise."""
        force, torque = self._own.tool(tool.handle, time)
        return Wrench(np.array(force), np.array(torque))


class _Line(_Removable):
    __slots__ = ()

    @property
    def report(self) -> reports.ThreadReport:
        """What it did in the last step."""
        report: reports.ThreadReport = types.of_json(reports.ThreadReport, self._own.thread_report(self.handle))
        return report


class Thread(_Line):
    """A thread through tissue."""

    __slots__ = ()
    _kind = "thread"

    def move(self, point: int, at: ArrayLike) -> None:
        """Moves a place in space that it goes through, by its number: it is there (m) at the end of the next step."""
        self._own.move_thread(self.handle, point, vector("at", at))

    def draw(self, length: float, end: int = 1) -> None:
        """Draws it past its first (0) or last (1) point: the length (m) in all by the end of the next step."""
        self._own.draw_thread(self.handle, end, float(length))

    def hold(self, end: int = 0) -> None:
        """Holds its free first (0) or last (1) end where it is: it slides through there no more."""
        self._own.hold_thread(self.handle, end)

    def tie(self) -> None:
        """Ties its ends together, and lets hands go."""
        self._own.tie_thread(self.handle)

    def cut(self, segment: int) -> tuple[Thread | None, Thread | None]:
        """Cuts it between two points that hold it, by the number of the segment: the parts before and behind it, ``None`` where
        no two points hold one. This one is then the first part that is left."""
        before, behind = (part and Thread(self.simulation, *part) for part in self._own.cut_thread(self.handle, segment))
        return before, behind


class Clip(_Line):
    """A clip, staple or knot between two points of tissue."""

    __slots__ = ()
    _kind = "clip"


def _thread_point(point: Any) -> tuple[int, Any]:
    """A place of tissue or in space, or the channel of a needle."""
    if isinstance(point, Tool):
        return point.handle, (0.0, 0.0, 0.0)
    if isinstance(point, tuple) and isinstance(point[0], Body):
        return point[0].handle, vector("point", point[1])
    return 0, vector("point", point)


def _lines(own: Mapping[str, Any]) -> str:
    """Keys of scenes that are given, as TOML."""
    return "\n".join(f"{key} = {toml(value)}" for key, value in own.items() if value is not None)


def _choices(**own: Any) -> _Spec:
    kept = dict.fromkeys(("precision", "backend", "threads", "executor", "instruction_set", "steps"))
    return _Spec(**{**kept, **own})


def _settings(solver: Mapping[str, Any] | str | None) -> str:
    return solver if isinstance(solver, str) else json.dumps(dict(solver or {}))


class Simulation:
    """A world of bodies.

    dt: length of a step (s). gravity: (3,), m/s^2. threads: 0 for one less than there are cores; results do not depend on it. precision: "f64" or
    "f32". instruction_set: "portable", "avx2", "avx512", or the best. solver: settings as below ``[solver]`` of scenes, as a
    dictionary or TOML.

    Steps run with the interpreter's lock released. Calls of other threads wait until the simulation is free.
    """

    def __init__(
        self,
        dt: float = 0.01,
        gravity: ArrayLike = (0.0, 0.0, -9.81),
        *,
        threads: int = 0,
        precision: str = "f64",
        backend: str = "cpu",
        instruction_set: str | None = None,
        solver: Mapping[str, Any] | str | None = None,
    ) -> None:
        choices = _choices(threads=threads, precision=precision, backend=backend, instruction_set=instruction_set)
        own = _native.Engine.create(choices, dt, vector("gravity", gravity), _settings(solver))
        self._take(own)

    def _take(self, own: _native.Engine) -> None:
        self._own = own
        self._facts = own.facts()
        self._bodies: dict[str, Body] = {}
        self._list_bodies()

    def _list_bodies(self) -> None:
        known = {body.handle: body for body in self._bodies.values()}
        self._bodies = {name: known.get(body.handle, body) for name, body in self._list(Body).items()}

    def _list(self, kind: type[Any]) -> dict[str, Any]:
        return {name: kind(self, handle, name) for handle, name in self._own.list(kind._kind)}

    @classmethod
    def from_scene(
        cls,
        path: str | os.PathLike[str],
        *,
        threads: int | None = None,
        precision: str | None = None,
        backend: str | None = None,
        executor: str | None = None,
        instruction_set: str | None = None,
        steps: int | None = None,
    ) -> Simulation:
        """The simulation of a scene file; what is given takes the place of what the scene says."""
        choices = _choices(
            threads=threads, precision=precision, backend=backend, executor=executor, instruction_set=instruction_set, steps=steps
        )
        own = cls.__new__(cls)
        own._take(_native.Engine.of_file(os.fspath(path), choices))
        return own

    @classmethod
    def from_scene_text(
        cls,
        text: str,
        files: Mapping[str, bytes] | Callable[[str], bytes] | str | os.PathLike[str] = ".",
        *,
        name: str = "scene.toml",
        **choices: Any,
    ) -> Simulation:
        """The simulation of a scene's text. Files that it names come from a folder, a dictionary, or a function of the path.

        ``name`` stands for the file in messages; the other arguments are those of :meth:`from_scene`."""

        def read(path: str) -> bytes:
            if callable(files):
                return bytes(files(path))
            if isinstance(files, Mapping):
                if path not in files:
                    raise FileNotFoundError(f"no file `{path}` among those given ({', '.join(files)})")
                return bytes(files[path])
            with open(os.path.join(files, path), "rb") as file:
                return file.read()

        own = cls.__new__(cls)
        own._take(_native.Engine.of_text(text, name, read, _choices(**choices)))
        return own

    # bodies

    def remove_body(self, body: Body) -> None:
        """Takes a body away, and what acts on nothing else; their objects cannot be used any more. Its name is free again."""
        self._own.remove(body.handle)
        self._list_bodies()

    def add_body(
        self,
        name: str,
        mesh: Mesh,
        material: Material,
        *,
        model: str = "svk_comp",
        evaluation: str = "fused",
        volume: str = "elements",
        integration: str | None = None,
        masses: str = "volume",
        springs: str | float | None = None,
        spare: int = 0,
        glue: float = 0.0,
        membrane: Membrane | None = None,
        axes: Axes | None = None,
    ) -> Body:
        """Adds a body; its mesh is checked and repaired first, see ``warnings``. Words are those of scene files. ``integration``: of
        hexahedra, "full" or "reduced". ``springs``: of mass-spring models a method of fitting, or one constant (N/m) for all.
        ``spare``: vertices kept for what cuts make, such as their number in the mesh; without, it cannot be cut.
        ``glue``: stiffness of what holds its wounds closed ahead of a blade, in Young's moduli over the mean edge of the mesh; 5 if any."""
        spec = _Spec(
            material=_material(material),
            model=model,
            evaluation=evaluation,
            volume=volume,
            integration=integration,
            masses=masses,
            springs=_springs(springs),
            spare=spare,
            glue=glue,
            membrane=None if membrane is None else _membrane(membrane),
            axes=None if axes is None else _axes(axes),
        )
        body = Body(self, self._own.add_body(name, mesh._own, spec), name)
        self._bodies[name] = body
        return body

    @property
    def bodies(self) -> dict[str, Body]:
        """Bodies by name."""
        return self._bodies

    @property
    def constraints(self) -> dict[str, Constraint]:
        """Constraints by name."""
        return self._list(Constraint)

    @property
    def loads(self) -> dict[str, Load]:
        """Loads by name."""
        return self._list(Load)

    @property
    def pressures(self) -> dict[str, Pressure]:
        """Pressures by name."""
        return self._list(Pressure)

    @property
    def tools(self) -> dict[str, Tool]:
        """Tools by name."""
        return self._list(Tool)

    @property
    def contacts(self) -> dict[str, Contact]:
        """Contacts between bodies by name."""
        return self._list(Contact)

    @property
    def strands(self) -> dict[str, Thread]:
        """Threads through tissue by name; ``threads`` counts those of the processor."""
        return self._list(Thread)

    @property
    def clips(self) -> dict[str, Clip]:
        """Clips by name."""
        return self._list(Clip)

    @property
    def pulls(self) -> dict[str, Pull]:
        """Pulls by name."""
        return self._list(Pull)

    def _name(self, kind: str, given: str | None, which: Any) -> str:
        """The name given, or a free one."""
        if given is not None:
            return given
        taken = {name for _, name in self._own.list(kind)}
        base = which if isinstance(which, str) else kind
        names = (base if i == 1 else f"{base}-{i}" for i in range(1, len(taken) + 2))
        return next(name for name in names if name not in taken)

    # what acts

    def _constrain(
        self,
        body: Body,
        which: Vertices,
        name: str | None,
        axes: str,
        times: tuple[float, float],
        curve: Any = None,
        by: Any = None,
        rotation: Any = None,
    ) -> Constraint:
        if not axes or set(axes) - set("xyz"):
            raise ArgumentError(f"axes: {axes!r}; give some of the letters x, y and z")
        own = self._name("constraint", name, which)
        spec = _Spec(
            name=own,
            vertices=body.vertices(which),
            axes=["x" in axes, "y" in axes, "z" in axes],
            by=by,
            rotation=rotation,
            curve=curve,
            begin=float(times[0]),
            until=float(times[1]),
        )
        return Constraint(self, self._own.add_constraint(body.handle, spec), own)

    def hold(
        self,
        body: Body,
        vertices: Vertices,
        *,
        name: str | None = None,
        axes: str = "xyz",
        begin: float = -math.inf,
        until: float = math.inf,
    ) -> Constraint:
        """Holds vertices from ``begin`` (s) until ``until`` (s), along some axes; ``Constraint.set_target`` moves them."""
        return self._constrain(body, vertices, name, axes, (begin, until))

    def move(
        self,
        body: Body,
        vertices: Vertices,
        *,
        by: ArrayLike,
        over: Over | None = None,
        curve: Curve | None = None,
        name: str | None = None,
        axes: str = "xyz",
        begin: float = -math.inf,
        until: float = math.inf,
    ) -> Constraint:
        """Moves vertices by (3,) or (k, 3) m, evenly between two times ``over`` (s), or by a curve."""
        way = floats("by", by, 3)
        return self._constrain(body, vertices, name, axes, (begin, until), _curve(curve, over), by=way)

    def turn(
        self,
        body: Body,
        vertices: Vertices,
        *,
        angle: float,
        axis: ArrayLike,
        centre: ArrayLike,
        over: Over | None = None,
        curve: Curve | None = None,
        name: str | None = None,
        begin: float = -math.inf,
        until: float = math.inf,
    ) -> Constraint:
        """Turns vertices by an angle (rad) about an axis through a centre (m)."""
        rotation = vector("centre", centre), vector("axis", axis), float(angle)
        return self._constrain(body, vertices, name, "xyz", (begin, until), _curve(curve, over), rotation=rotation)

    def load(
        self,
        body: Body,
        vertices: Vertices,
        forces: ArrayLike,
        *,
        over: Over | None = None,
        curve: Curve | None = None,
        name: str | None = None,
    ) -> Load:
        """Forces (N): (k, 3), or (3,) for all together, which they share evenly."""
        own, which = self._name("load", name, vertices), body.vertices(vertices)
        handle = self._own.add_load(body.handle, own, which, floats("forces", forces, 3), _curve(curve, over))
        return Load(self, handle, own)

    def pressure(
        self,
        body: Body,
        pressure: float,
        faces: Vertices | None = None,
        *,
        over: Over | None = None,
        curve: Curve | None = None,
        name: str | None = None,
    ) -> Pressure:
        """A follower pressure (Pa) along the normals of faces: triangles (m, 3), those of a group, or the whole surface."""
        own, which = self._name("pressure", name, faces), indices("triangles", body.faces(faces), 3)
        handle = self._own.add_pressure(body.handle, own, which, float(pressure), _curve(curve, over))
        return Pressure(self, handle, own)

    def traction(
        self,
        body: Body,
        traction: ArrayLike,
        faces: Vertices | None = None,
        *,
        over: Over | None = None,
        curve: Curve | None = None,
        name: str | None = None,
    ) -> Load:
        """A traction (3,) (N/m^2 at rest) that keeps its direction, on faces: triangles (m, 3), quadrilaterals (m, 4), those of
        a group, or the whole surface. Every vertex gets what its shape function says."""
        own = self._name("load", name, faces)
        group = faces if isinstance(faces, str) else None
        which = None
        if faces is not None and group is None:
            corners = 4 if np.asarray(faces).shape[-1:] == (4,) else 3
            which = corners, indices("faces", faces, corners)
        push = vector("traction", traction)
        return Load(self, self._own.add_traction(body.handle, own, which, group, push, _curve(curve, over)), own)

    def add_tool(
        self,
        name: str,
        parts: Shape | Part | Sequence[Shape | Part] = (),
        position: ArrayLike = (0.0, 0.0, 0.0),
        rotation: ArrayLike = _NO_TURN,
        opening: float = 0.0,
        *,
        path: Sequence[Pose] | None = None,
        by: ArrayLike | None = None,
        over: Over | None = None,
        curve: Curve | None = None,
        hinge: tuple[ArrayLike, ArrayLike] | None = None,
        friction: float = 0.0,
        grip: bool = False,
        points: str | int = "auto",
        stiffness: Stiffness = Stiffness(),
        exact: bool = False,
        keeps_side: bool = True,
        error_bar: bool = False,
        local_stiffness: bool = False,
        on: Body | tuple[Body, Vertices] | None = None,
        edge: Mapping[str, Any] | None = None,
        needle: Mapping[str, Any] | None = None,
        begin: float = -math.inf,
        until: float = math.inf,
    ) -> Tool:
        """Adds a rigid tool of one or more parts, or with an ``edge`` or a ``needle``, keys as in scenes, for bodies with ``spare``.

        It stays where ``Tool.move`` and ``Tool.place`` say, follows a ``path``, or goes ``by`` a translation (m) as ``over`` or
        ``curve`` say. ``hinge``: point (m) and axis of jaws. ``points`` that touch: "auto", "vertex", or 2 to 8 for points on
        faces. ``exact``: no penetration. ``on``: touches one body, or some faces of it, alone. ``Part(shape, cavity=True)`` keeps
        bodies inside."""
        several = parts if isinstance(parts, Sequence) else [parts]
        if isinstance(on, Body):
            on = (on, on.faces())
        spec = _Spec(
            name=name,
            parts=[_part(part) for part in several],
            hinge=None if hinge is None else (vector("hinge", hinge[0]), vector("hinge", hinge[1])),
            start=_tool_pose(position, rotation, opening),
            path=None if path is None else [(float(p.time), _tool_pose(p.position, p.rotation, p.opening)) for p in path],
            by=None if by is None else vector("by", by),
            curve=_curve(curve, over),
            friction=float(friction),
            grip=bool(grip),
            points=points,
            stiffness=stiffness,
            exact=exact,
            keeps_side=keeps_side,
            error_bar=error_bar,
            local_stiffness=local_stiffness,
            on=None if on is None else (on[0].handle, indices("triangles", on[0].faces(on[1]), 3)),
            edge=None if edge is None else _lines(edge),
            needle=None if needle is None else _lines(needle),
            begin=float(begin),
            until=float(until),
        )
        return Tool(self, self._own.add_tool(spec), name)

    def add_contact(
        self, a: Body, b: Body, *, friction: float = 0.0, stiffness: Stiffness = Stiffness(20.0), name: str | None = None
    ) -> Contact:
        """Lets two bodies touch each other; the same one twice for a body that touches itself."""
        own = self._name("contact", name, f"{a.name}-{b.name}")
        handle = self._own.add_contact(own, [a.handle, b.handle], float(friction), stiffness)
        return Contact(self, handle, own)

    def pull(
        self,
        body: Body,
        vertices: Vertices,
        *,
        stiffness: float,
        damping: float = 0.0,
        weights: ArrayLike = (),
        name: str | None = None,
    ) -> Pull:
        """Pulls on vertices by a spring (N/m) and a damper (N s/m) of all together; weights (k,) share them out."""
        own, which = self._name("pull", name, vertices), body.vertices(vertices)
        shares = floats("weights", np.asarray(weights, np.float64))
        handle = self._own.add_pull(body.handle, own, which, shares, (float(stiffness), float(damping)))
        return Pull(self, handle, own)

    def haptic(
        self,
        body: Body | Tool,
        vertices: Vertices | None = None,
        *,
        stiffness: float = 300.0,
        damping: float = 2.0,
        limit: float = 3.3,
        stale: float = 0.05,
        fade: float = 0.008,
        device_mass: float = 0.05,
        tolerance: float = 0.1,
        turns: bool = False,
        torque_limit: float = 0.1,
        device_inertia: float = 1e-5,
        name: str | None = None,
    ) -> Haptic | HeldTool:
        """Lets a haptic device hold vertices, or a tool in place of the body, by a spring ``stiffness`` (N/m); ``damping`` (N s/m) of the device; largest force
        ``limit`` (N); the force falls from ``stale`` seconds after the last step on, and goes over from step to step in ``fade``
        seconds; ``device_mass`` (kg) is what moves of the device; ``tolerance`` of its linear systems. A device that ``turns`` the
        vertices, too, about their mean, feels a torque up to ``torque_limit`` (N m); ``device_inertia`` (kg m^2) is what turns of it."""
        of_turns = (torque_limit, device_inertia)
        numbers = [float(x) for x in (stiffness, damping, limit, stale, fade, device_mass, tolerance, *of_turns)]
        made: Haptic | HeldTool
        if isinstance(body, Tool):
            if vertices is not None:
                raise ArgumentError("a tool is held without vertices; leave them out")
            own, none = name or body.name, np.empty(0, np.uint32)
            handle, device = self._own.add_haptic(body.handle, own, none, turns, numbers)
            made = HeldTool(self, handle, body.name)
        else:
            if vertices is None:
                raise ArgumentError("name the vertices of the body that the device holds, or a group")
            own, which = self._name("pull", name, vertices), body.vertices(vertices)
            handle, device = self._own.add_haptic(body.handle, own, which, turns, numbers)
            made = Haptic(self, handle, own)
        made.device = device
        return made

    def share(self, bodies: Sequence[Body] = (), tools: Sequence[Tool] = ()) -> Reader:
        """Shares bodies and tools with other threads: their state as it is, then that after every step and every way back. Without
        any all that there are now."""
        return Reader(self._own.share([body.handle for body in bodies], [tool.handle for tool in tools]))

    def add_thread(
        self, points: Sequence[tuple[Body, ArrayLike] | Tool | ArrayLike], *, stiffness: float, name: str | None = None, **keys: Any
    ) -> Thread:
        """Lays a thread of stiffness EA (N) through points: (body, place) for tissue at a place (m) in the present shape, a tool
        for the channel that its needle went through, a place for a hand. Keys are those of scenes: ``length`` (m), ``friction``,
        ``grip`` (N), ``tails`` (m), ``needle``, the name of the tool whose needle draws it through further points."""
        return Thread(self, *self._lay(Thread._kind, points, {**keys, "stiffness": stiffness}, name))

    def add_clip(
        self,
        a: tuple[Body, ArrayLike] | ArrayLike,
        b: tuple[Body, ArrayLike] | ArrayLike,
        *,
        stiffness: float,
        length: float = 0.0,
        strength: float | None = None,
        name: str | None = None,
    ) -> Clip:
        """Draws two points, as those of threads, together by a spring (N/m) once they are farther apart than ``length`` (m); it
        breaks above ``strength`` (N)."""
        keys = {"stiffness": stiffness, "length": length, "strength": strength}
        return Clip(self, *self._lay(Clip._kind, [a, b], keys, name))

    def _lay(self, kind: str, points: Sequence[Any], keys: Mapping[str, Any], name: str | None) -> tuple[int, str]:
        own = self._name(kind, name, None)
        ends = [_thread_point(point) for point in points]
        return self._own.add_thread(kind, _lines({**keys, "name": own}), ends), own

    def pick(self, origin: ArrayLike, direction: ArrayLike) -> Pick | None:
        """The first point of a surface that a ray from ``origin`` (m) meets."""
        found = self._own.pick(vector("origin", origin), vector("direction", direction))
        if found is None:
            return None
        handle, vertices, weights, position, distance = found
        name = next(body.name for body in self._bodies.values() if body.handle == handle)
        return Pick(name, np.array(vertices, np.uint32), np.array(weights), np.array(position), distance)

    # steps

    def step(self, n: int = 1) -> None:
        """Makes ``n`` steps with the lock released. Ctrl-C ends it between two steps. Raises :class:`StepError` at the first that
        fails; the state is then that before it."""
        self._own.step(n)

    def run(
        self,
        *,
        until: float | None = None,
        steps: int | None = None,
        probe: Callable[[Simulation], Any] | None = None,
        every: int = 1,
    ) -> Run:
        """Steps until a time (s), for a number of steps, or to the end of the scene; ``probe`` is called now and after every so
        many steps, and what it answers is kept (it must copy views)."""
        done, time, dt = self._own.clock()
        if until is not None and steps is not None:
            raise ArgumentError("give `until` or `steps`, not both")
        if until is not None:
            if not math.isfinite(until):
                raise ArgumentError(f"until: {until} s; give a finite time")
            steps = max(0, math.ceil((until - time) / dt - 1e-6))
        elif steps is None:
            planned = self._facts["steps_planned"]
            if planned is None:
                raise ArgumentError("give `until` or `steps`: there is no scene that says when to end")
            steps = max(0, planned - done)
        if every < 1:
            raise ArgumentError(f"every: {every}; it must be at least 1")
        if probe is None:
            self.step(steps)
            return Run(np.array([self.time]), None)
        times, values = [time], [probe(self)]
        while steps > 0:
            part = min(every, steps)
            self.step(part)
            steps -= part
            times.append(self.time)
            values.append(probe(self))
        return Run(np.array(times), np.array(values))

    def record(self, every: int = 1) -> None:
        """Records what :meth:`show` plays, from now on: the state after every so many steps, and the forces of tools, pulls and
        what moves after every one. A recording on its way is dropped; going back begins it anew. Of one that goes on
        for long, every second state is kept."""
        if every < 1:
            raise ArgumentError(f"every: {every}; it must be at least 1")
        self._own.record(every)

    def show(self) -> Page:
        """A player of what was recorded since :meth:`record`, which ends there, or else of the present state."""
        return Page(self._own.page())

    @property
    def time(self) -> float:
        """Simulated time (s)."""
        return self._own.clock()[1]

    @property
    def steps_done(self) -> int:
        """Steps done."""
        return self._own.clock()[0]

    @property
    def dt(self) -> float:
        """Length of the next step (s)."""
        return self._own.clock()[2]

    @dt.setter
    def dt(self, dt: float) -> None:
        self._own.set_dt(dt)

    @property
    def gravity(self) -> Floats:
        """Gravity (m/s^2), (3,)."""
        return np.array(self._own.gravity())

    @gravity.setter
    def gravity(self, gravity: ArrayLike) -> None:
        self._own.set_gravity(vector("gravity", gravity))

    @property
    def solver(self) -> dict[str, Any]:
        """Settings of the solver."""
        own: dict[str, Any] = json.loads(self._own.solver())
        return own

    @solver.setter
    def solver(self, solver: Mapping[str, Any] | str) -> None:
        self._own.set_solver(_settings(solver))

    @property
    def precision(self) -> str:
        """``"f64"`` or ``"f32"``."""
        return str(self._facts["precision"])

    @property
    def threads(self) -> int:
        """Threads."""
        return int(self._facts["threads"])

    @property
    def instruction_set(self) -> str:
        """Instruction set of the kernels."""
        return str(self._facts["instruction_set"])

    @property
    def steps_planned(self) -> int | None:
        """Steps that the scene asks for."""
        planned: int | None = self._facts["steps_planned"]
        return planned

    @property
    def report(self) -> Report:
        """What the last step did."""
        return types.report(self._own.report())

    @property
    def energy(self) -> Energy:
        """Energies (J) of the state as it is."""
        return Energy(*self._own.energy())

    @property
    def warnings(self) -> list[types.Warning]:
        """What looks unintended in meshes, materials and the scene, then what was not as it should be in the steps that led to
        the present state, with the codes of the command: a body was halted, contact did not converge, elements were inverted."""
        return [types.Warning(*own) for own in self._own.warnings()]

    @property
    def verdict(self) -> str | None:
        """Why the present state cannot be trusted although every step was carried out, as far as the steps that led to it tell,
        or ``None``. The command ``sinew run`` fails with this text."""
        return self._own.verdict()

    def snapshot(self) -> Snapshot:
        """Everything that the steps to come depend on, to :meth:`restore` and to pickle."""
        return self._own.snapshot()

    def restore(self, snapshot: Snapshot) -> None:
        """Takes up a state of this simulation, or of one built alike, to the bit. What was added since is gone, and its
        object says ``HandleError``. What was removed since is there again: in this simulation its object is good again, in another
        one ask by name."""
        self._own.restore(snapshot)
        self._list_bodies()

    def hash(self) -> int:
        """Hash of the state: the ``final_state_hash`` of the command, as a number."""
        return self._own.hash()

    def __repr__(self) -> str:
        done, time, dt = self._own.clock()
        scene = self._facts["scene"]
        name = f" {scene!r}" if scene else ""
        return f"<sinew.Simulation{name}: bodies {list(self._bodies)}, step {done}, t = {time:g} s, dt = {dt:g} s>"

    def _repr_html_(self) -> str:
        import html  # of notebooks alone

        energy = self.energy
        rows = []
        for body in self._bodies.values():
            points, tetrahedra, hexahedra, *_ = self._own.mesh(body.handle).counts
            smallest = body.volume_ratios.min(initial=np.inf)
            cells = (html.escape(body.name), points, tetrahedra, hexahedra, f"{body.masses.sum():.4g}", f"{smallest:.3f}" if np.isfinite(smallest) else "")
            rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
        heads = ("body", "vertices", "tetrahedra", "hexahedra", "mass (kg)", "least volume ratio")
        notes = "".join(f"<li>{html.escape(str(warning))}</li>" for warning in self.warnings)
        return (
            f"<p>{html.escape(repr(self))}</p><table><tr>{''.join(f'<th>{head}</th>' for head in heads)}</tr>{''.join(rows)}</table>"
            f"<p>elastic energy {energy.elastic:.4g} J, kinetic energy {energy.kinetic:.4g} J</p>"
            + (f"<ul>{notes}</ul>" if notes else "")
        )


class Page:
    """A player as one HTML file, which any browser opens without a network; a notebook shows it."""

    def __init__(self, html: str) -> None:
        self.html = html
        """The file."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file."""
        with open(path, "w", encoding="utf-8") as file:
            file.write(self.html)

    def __repr__(self) -> str:
        return f"<sinew.Page: {len(self.html) / 1e6:.1f} MB; save(path) writes it>"

    def _repr_html_(self) -> str:
        import html  # of notebooks alone

        return f'<iframe srcdoc="{html.escape(self.html)}" style="width: 100%; height: 560px; border: 0"></iframe>'


class Batch(Sequence[Simulation]):
    """Many simulations that step together, each on one of ``workers`` threads, with the lock released once.

    Give each simulation ``threads=1``."""

    def __init__(self, simulations: Sequence[Simulation], workers: int = 0) -> None:
        self._simulations = list(simulations)
        if workers < 0:
            raise ArgumentError(f"workers: {workers}; give 0 for one per core, or how many")
        self.workers = workers or os.cpu_count() or 1
        if len({id(simulation._own) for simulation in self._simulations}) < len(self._simulations):
            raise ArgumentError("a batch cannot hold a simulation twice")
        self._start = self.snapshot()

    def __len__(self) -> int:
        return len(self._simulations)

    def __getitem__(self, index: Any) -> Any:
        return self._simulations[index]

    def step(self, n: int = 1) -> None:
        """Makes ``n`` steps of each. One that fails stops, the others go on; then the first failure is raised, with its
        ``index``."""
        failed = _native.step_all([simulation._own for simulation in self._simulations], n, self.workers)
        if failed is not None:
            index, error = failed
            error.index = index
            raise error

    def snapshot(self) -> list[Snapshot]:
        """Snapshots of all."""
        return [simulation.snapshot() for simulation in self._simulations]

    def restore(self, snapshots: Sequence[Snapshot]) -> None:
        """Takes up one state each."""
        if len(snapshots) != len(self):
            raise ArgumentError(f"restore: {len(snapshots)} snapshots given, {len(self)} needed")
        for simulation, snapshot in zip(self._simulations, snapshots):
            simulation.restore(snapshot)

    def reset(self, mask: ArrayLike | None = None) -> None:
        """Takes up the state in which the batch was made: of all, or of those where a mask, (len,), is true."""
        chosen = np.ones(len(self), bool) if mask is None else np.asarray(mask)
        if chosen.dtype != bool or chosen.shape != (len(self),):
            raise ArgumentError(f"reset: a mask of {chosen.dtype} and shape {chosen.shape}; give {len(self)} booleans")
        for index in np.flatnonzero(chosen):
            self._simulations[index].restore(self._start[index])

    def hash(self) -> list[int]:
        """Hashes of all states."""
        return [simulation.hash() for simulation in self._simulations]
