"""Plain data: materials, membranes, axes, shapes; and reports from what the engine says. SI units."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._reports import ContactFigures, Fallbacks, Floats, PartReport, Report, ToolReport, Volume

if TYPE_CHECKING:
    from ._mesh import Mesh


@dataclass(frozen=True, eq=False)
class Material:
    """An isotropic material. Each number may also be an array of one per solid element, tetrahedra first."""

    young: ArrayLike
    """Young's modulus (Pa)."""

    poisson: ArrayLike = 0.45
    """Poisson's ratio."""

    density: ArrayLike = 1000.0
    """Mass per volume at rest (kg/m^3)."""


def preset(
    name: str,
    *,
    young: ArrayLike | None = None,
    poisson: ArrayLike | None = None,
    density: ArrayLike | None = None,
) -> Material:
    """The material of a tissue, such as ``"liver"``, with other numbers where they are given."""
    own = _native.preset(name)
    given = (young, poisson, density)
    return Material(*(own[i] if new is None else new for i, new in enumerate(given)))


@dataclass(frozen=True)
class Sine:
    """A factor over time: ``sin(2 pi frequency t + phase)``."""

    frequency: float
    """Frequency (Hz)."""

    phase: float = 0.0
    """Phase (rad)."""


Curve = Sine | Sequence[Sequence[float]]
"""A factor over time: a sine, or (time in s, factor) points with straight lines between, constant outside."""


@dataclass(frozen=True, eq=False)
class Membrane:
    """A membrane beside the solid elements of a body, or instead of them."""

    thickness: float
    """Thickness (m)."""

    material: Material
    """Its material; Young's modulus in Pa, as of a solid."""

    cells: str | None = "all"
    """``"all"`` triangles and quadrilaterals of the mesh, the ``"surface"`` of its solid, a group, or ``None``."""

    triangles: ArrayLike | None = None
    """With ``cells = None``: triangles, (m, 3)."""

    quads: ArrayLike | None = None
    """With ``cells = None``: quadrilaterals, (m, 4)."""

    plane: str = "stress"
    """``"stress"`` or ``"strain"``."""

    model: str = "trbs"
    """Energy, a word of scene files."""

    evaluation: str = "fused"
    """``"fused"`` or ``"pooled"``."""

    springs: str | float | None = None
    """Of mass-spring models: a method of fitting, or one constant (N/m) for all."""

    bending: bool = False
    """Whether triangles resist bending, as a plate of the material."""

    bending_thickness: float | None = None
    """Thickness (m) of that plate; ``thickness`` without it."""

    bending_rest: str = "meshed"
    """Its shape without moments: ``"meshed"`` or ``"flat"``."""


@dataclass(frozen=True)
class Muscle:
    """What activation does to fibres."""

    peak_stress: float = 0.0
    """Active stress (Pa) at full activation and optimal stretch."""

    optimal_stretch: float = 1.0
    """Stretch at which it is largest."""

    width: float = 0.5
    """Half width of the length-tension curve."""

    stiffening: float = 0.0
    """Relative growth of the modulus at full activation."""

    shortening: float = 0.0
    """Relative shortening of the rest length at full activation."""

    curve: Curve | None = None
    """Activation over time; without it what ``Body.set_activation`` said last."""


@dataclass(frozen=True, eq=False)
class Family:
    """Fibres of one kind."""

    name: str
    """Name, unique in the body."""

    directions: ArrayLike
    """One direction, (3,), or one per solid element, (m, 3)."""

    modulus: float
    """Modulus along the fibres (Pa)."""

    form: str = field(default="stretch", kw_only=True)
    """``"stretch"``, or ``"biquadratic"``: fibres of St Venant-Kirchhoff, a part of pooled springs."""

    viscosity: float = 0.0
    """Viscosity along the fibres (Pa s)."""

    share: ArrayLike | None = None
    """Factor on everything, one per solid element."""

    muscle: Muscle | None = None
    """Makes the fibres active."""


@dataclass(frozen=True, eq=False)
class Axes:
    """Axes of anisotropy beside the model of a body, or with model ``"axes"`` instead of one."""

    families: Sequence[Family] = ()
    """Fibres."""

    angles: Mapping[tuple[str, str], float] = field(default_factory=dict)
    """Moduli (Pa) of springs on angles between two families."""

    volume_modulus: float = 0.0
    """Modulus (Pa) of the term of volume."""


@dataclass(frozen=True)
class Sphere:
    """A ball."""

    radius: float
    """Radius (m)."""


@dataclass(frozen=True)
class Capsule:
    """A rod with round ends along the x axis."""

    half_length: float
    """Half the distance between the centres of its ends (m)."""

    radius: float
    """Radius (m)."""


@dataclass(frozen=True)
class Box:
    """A box with rounded edges."""

    half: tuple[float, float, float]
    """Half sizes (m), rounding included."""

    rounding: float
    """Radius (m) of its edges; several times the penetration."""


@dataclass(frozen=True)
class HalfSpace:
    """All points with z <= 0: a table or floor whose normal is the z axis."""


@dataclass(frozen=True)
class Field:
    """A closed mesh."""

    mesh: Mesh
    """Its surface counts."""

    spacing: float | None = None
    """Spacing (m) of the grid of distances; chosen without."""


Shape = Sphere | Capsule | Box | HalfSpace | Field


@dataclass(frozen=True)
class Part:
    """A rigid part of a tool."""

    shape: Shape
    """Its shape."""

    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of the shape in the frame of the tool (m)."""

    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Rotation in that frame, a quaternion (x, y, z, w)."""

    jaw: float = 0.0
    """Share of the opening by which it turns about the hinge: 0.5 and -0.5 for two jaws."""

    cavity: bool = False
    """It is hollow: bodies may not leave its inside, as organs the abdomen; of several cavities they have to be in all. A half-space
    is none."""


@dataclass(frozen=True)
class Pose:
    """Where a tool is at a time of its path."""

    time: float
    """Time (s)."""

    position: tuple[float, float, float]
    """Place of its origin (m)."""

    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Rotation, a quaternion (x, y, z, w)."""

    opening: float = 0.0
    """Angle (rad) between its jaws."""


@dataclass(frozen=True)
class Stiffness:
    """Stiffness of contact: pressure over penetration."""

    value: float = 50.0
    """A factor, or Pa/m."""

    relative: bool = True
    """Times Young's modulus there over the mean edge."""


@dataclass(frozen=True)
class Warning:
    """What looks unintended or was repaired, or was not as it should be in steps."""

    code: str
    """Stable identifier, such as ``mesh.inverted-winding``."""

    level: str
    """``"note"`` or ``"warning"``."""

    subject: str
    """Body, constraint or stage."""

    message: str
    """What was found."""

    remedy: str
    """What to do, or that nothing is to be done."""

    def __str__(self) -> str:
        text = f"{self.level} [{self.code}] {self.subject}: {self.message}"
        return f"{text}; {self.remedy}" if self.remedy else text


@dataclass(frozen=True)
class Energy:
    """Energies (J) of the state as it is."""

    elastic: float
    """Elastic energy (J)."""

    kinetic: float
    """Kinetic energy (J)."""


@dataclass(frozen=True, eq=False)
class Wrench:
    """A force and its torque."""

    force: Floats
    """Force (N), (3,)."""

    torque: Floats
    """Torque (N m), (3,), about the point asked for."""


@dataclass(frozen=True, eq=False)
class Skin:
    """What to draw of a body that may be cut."""

    points: Floats
    """Positions (m), (n, 3): of all vertices of the mesh, then of points that cuts made. A wound has points of its own."""

    rest: Floats
    """The same at rest (m), (n, 3): coordinates of what is drawn inside of the body."""

    depth: Floats
    """Depth (m, at rest) of the points of wounds below the surface of the mesh, (n,); 0 at all others."""

    triangles: NDArray[np.uint32]
    """Triangles of points, outward, (m, 3)."""

    wound: NDArray[np.bool_]
    """Whether each was laid open by a cut, (m,)."""

    revision: int
    """Changes whenever anything but the points does, and never comes again."""


@dataclass(frozen=True, eq=False)
class Pick:
    """A point of a surface that a ray met."""

    body: str
    """Name of the body."""

    vertices: NDArray[np.uint32]
    """Vertices of the triangle, (3,)."""

    weights: Floats
    """Barycentric coordinates of the point in it, (3,)."""

    position: Floats
    """The point (m), (3,)."""

    distance: float
    """Distance (m) from the origin of the ray."""


@dataclass(frozen=True, eq=False)
class Run:
    """What ``Simulation.run`` recorded."""

    time: Floats
    """Times (s), (k,)."""

    values: Any
    """What the probe answered at these times, as an array of k rows; ``None`` without a probe."""


def asdict(own: Any) -> dict[str, Any]:
    """A report as a dictionary: that of a step is what the JSON of the engine says."""
    return dataclasses.asdict(own)


def _arrays(kind: type[Any], own: Mapping[str, Any]) -> Any:
    arrays = {k: np.array(v, np.float64) if isinstance(v, list) and k != "held" else v for k, v in own.items()}
    return kind(**arrays)


def of_json(kind: type[Any], text: str) -> Any:
    """A report with arrays in place of lists."""
    return _arrays(kind, json.loads(text))


def tool_report(text: str) -> ToolReport:
    """The report of a tool."""
    own = json.loads(text)
    parts = tuple(_arrays(PartReport, part) for part in own.pop("parts"))
    stiffness = own.pop("local_stiffness")
    # it comes by columns
    matrix = None if stiffness is None else np.reshape(stiffness, (3, 3)).T
    report: ToolReport = _arrays(ToolReport, {**own, "parts": parts, "local_stiffness": matrix})
    return report


def report(text: str) -> Report:
    """The report of a step."""
    own = json.loads(text)
    own["fallbacks"] = Fallbacks(**own["fallbacks"])
    own["contact"] = ContactFigures(**own["contact"])
    own["volume"] = Volume(**own["volume"])
    return Report(**own)
