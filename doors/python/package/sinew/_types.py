"""Plain data: materials, membranes, axes, shapes, reports. SI units."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native

if TYPE_CHECKING:
    from ._mesh import Mesh

Floats = NDArray[np.float64]


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

    volume_viscosity: float = 0.0
    """Viscosity (Pa s) of radial springs of hexahedra in the printed forms."""

    form: str = "energy_consistent"
    """Formulas: ``"energy_consistent"``, ``"printed"`` or ``"printed_balanced"``."""


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
    """What looks unintended in meshes and materials, or was repaired."""

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


@dataclass(frozen=True, eq=False)
class PartReport:
    """What one part of a tool felt in the last step."""

    force: Floats
    """Force (N) on it, (3,)."""

    torque: Floats
    """Torque (N m) on it about the tool's origin, (3,)."""

    depth: float
    """Largest penetration (m)."""

    sticking: int
    """Points that touch it and stick."""

    slipping: int
    """Points that touch it and slip."""


@dataclass(frozen=True, eq=False)
class ToolReport:
    """What a tool felt in the last step, at its end."""

    position: Floats
    """Place of its origin (m), (3,)."""

    rotation: Floats
    """Its rotation, a quaternion (x, y, z, w)."""

    opening: float
    """Its opening (rad)."""

    velocity: Floats
    """Velocity of its origin (m/s), (3,)."""

    angular_velocity: Floats
    """Angular velocity (rad/s), (3,)."""

    force: Floats
    """Force (N) on the tool, normal and friction, (3,)."""

    torque: Floats
    """Torque (N m) on the tool about its origin, (3,)."""

    normal: Floats
    """The part of the force that pressure makes (N), (3,)."""

    friction: Floats
    """The part of the force that friction makes (N), (3,)."""

    work: float
    """Work (J) done by the tool since it came."""

    dissipation: float
    """Energy (J) that friction has taken since it came."""

    energy: float
    """Energy (J) stored in its contacts."""

    area: float
    """Area (m^2, at rest) that touches it."""

    depth: float
    """Largest penetration (m)."""

    pressure: float
    """Largest pressure (Pa)."""

    centre: Floats
    """Centre of pressure (m), (3,); its origin while nothing touches it."""

    sticking: int
    """Points that touch it and stick."""

    slipping: int
    """Points that touch it and slip."""

    lag: float
    """What it is behind its target (m)."""

    drawn_in: float
    """How far (m) its surfaces are drawn in, because it appeared inside of a body."""

    other_points: Floats | None
    """Force (N) by points of the other kind, with ``error_bar``."""

    local_stiffness: Floats | None
    """Change of its force (N) per motion (m), (3, 3), with ``local_stiffness``."""

    parts: tuple[PartReport, ...]
    """What each part felt; empty for a tool of one part."""


@dataclass(frozen=True, eq=False)
class ContactReport:
    """What two bodies did to each other in the last step."""

    force: Floats
    """Force (N) on the first body, (3,)."""

    area: float
    """Area (m^2, at rest) in contact."""

    depth: float
    """Largest penetration (m)."""

    dissipation: float
    """Energy (J) that friction has taken."""

    sticking: int
    """Points that stick."""

    slipping: int
    """Points that slip."""


@dataclass(frozen=True, eq=False)
class PullReport:
    """What a pull did in the last step."""

    force: Floats
    """Force (N) on the hand that pulls, (3,)."""

    torque: Floats
    """Torque (N m) on the hand, (3,)."""

    distance: float
    """Mean distance (m) of the patch from where it is drawn to."""

    work: float
    """Work (J) done by the hand since it took hold."""


@dataclass(frozen=True)
class Fallbacks:
    """Bodies that took the safe step instead of linearised BDF2, by reason."""

    start: int
    """There is no history: first step, state, held axes or masses changed, much other step length."""

    indefinite: int
    """The tangent was not positive definite."""

    shortened: int
    """The full step did not lower the incremental potential enough."""

    energy: int
    """The energy would have gone above its budget."""

    inverted: int
    """An element would have been turned inside out."""

    waiting: int
    """A step shortly before failed, or elements are inverted."""


@dataclass(frozen=True)
class ContactFigures:
    """What contact did in a step; all 0 in a simulation without."""

    points: int
    """Points in contact at the end of the step, and those of them that stick."""

    sticking: int
    """See the line before."""

    inner_iterations: int
    """Iterations of the inner loop of all bodies: linear systems with the contact of the last iterate."""

    unconverged: int
    """Inner loops that ended at their cap."""

    depth: float | None
    """Largest penetration (m), and the largest over the mean edge of its surface."""

    depth_over_edge: float | None
    """See the line before."""

    substeps: int
    """Parts in which the step was made because a tool was fast."""

    lagging: int
    """Tools that did not reach their target, and by how much (m) the worst."""

    lag: float | None
    """See the line before."""

    drawn_in: int
    """Parts of tools that appeared inside of bodies and are drawn in until the bodies have made way."""

    buried: int
    """Points too deep inside of another body to tell its sides, which are left out."""

    impacts: int
    """Bodies that took the safe step because of an impact."""

    energy: float | None
    """Energy (J) stored in contacts and pulls at the end of the step. It is no part of the elastic energy."""

    work: float | None
    """Energy (J) that moving tools and pulls put into their contacts at the start of the step, with the bodies where they were: an upper bound of their work, which the step then dissipates down to."""

    friction_dissipation: float | None
    """Energy (J) that friction took."""


@dataclass(frozen=True)
class Volume:
    """Volume ratios J at the end of a step."""

    smallest_ratio: float | None
    """Smallest deformed volume over rest volume, of hexahedra at their Gauss points."""

    inverted: int
    """Tetrahedra, and hexahedra of some Gauss point, with J <= 0."""

    inverted_by_body: list[int]
    """The same for each body."""

    smallest_by_body: list[float | None]
    """Smallest ratio of each body."""

    elements_by_body: list[int]
    """Tetrahedra and hexahedra of each body."""

    largest_mean_change: float
    """Largest magnitude of the mean of J - 1 over what keeps its volume as a mean (``volume="clusters"``): clusters of
    tetrahedra, or single hexahedra and ten-node tetrahedra; 0 without any."""


@dataclass(frozen=True)
class Report:
    """What the last step did. Numbers that are not finite are ``None``, as in JSON."""

    step: int
    """Steps done."""

    time: float
    """Simulated time (s)."""

    dt: float
    """Length of the next step (s)."""

    newton_iterations: int
    """Newton iterations (linear systems) of the step."""

    cg_iterations: int
    """Conjugate-gradient iterations, all linear systems together."""

    cg_caps: int
    """Linear solves that stopped at the iteration cap."""

    cg_residual: float | None
    """Relative residual of the last linear solve."""

    preconditioner: str
    """Preconditioner of the last linear solve, empty without one."""

    preconditioner_refreshes: int
    """Times the values of preconditioners were computed anew; other solves used those of earlier ones."""

    preconditioner_breakdowns: int
    """Incomplete factorisations of parts of a body that broke down and were repeated with weaker couplings."""

    precision_fallbacks: int
    """Linear solves that mixed precision could not bring to the tolerance and full precision took over."""

    unconverged: bool
    """Newton ended at its iteration cap without reaching the tolerance."""

    newton_step: float | None
    """Length of the last Newton step over body size."""

    projections: int
    """Times the projected tangent was used: the exact one was indefinite, or elements inverted."""

    clamped_elements: int
    """Elements clamped in those."""

    backtracks: int
    """Halvings of the line search."""

    gradient_fallbacks: int
    """Linear solves replaced by the preconditioned gradient, because even the projected tangent gave no descent."""

    line_search_failures: int
    """Line searches that found no decrease: the body stays where it was, and in a dynamic step comes to a halt there."""

    energy_caps: int
    """The energy cap scaled the velocity."""

    second_order_steps: int
    """Bodies that took a linearised BDF2 step."""

    fallbacks: Fallbacks
    """Bodies that did not."""

    recovering: int
    """Bodies that moved by the corotational energy to recover from inversion."""

    recovery_energy: float | None
    """Elastic energy (J) that changing to that energy and back added."""

    recoveries_refused: int
    """Bodies that have many inverted elements but do not recover: loads crush them."""

    recoveries_given_up: int
    """Bodies whose recovery took too long and was given up in this step; they move by their own law again."""

    load_parts: int
    """Parts in which the equilibrium was found, and times a part was halved because Newton did not converge or turned elements inside out."""

    load_partings: int
    """See the line before."""

    substeps: int
    """Explicit substeps."""

    refinements: int
    """Steps repeated with more substeps because the energy grew."""

    stable_step: float | None
    """Largest stable explicit step (s), 0 when not estimated."""

    linearisation_error: float | None
    """Distance of the accepted decrease of the incremental potential from what the linearised step predicted, relative: 0 for a step in which linearisation is exact, near 1 when it says little."""

    elastic_energy: float | None
    """Elastic energy (J) at the end of the step."""

    kinetic_energy: float | None
    """Kinetic energy (J) at the end of the step, held vertices included."""

    load_work: float | None
    """Work (J) of gravity and loads during the step: along the way for explicit integrators, the loads of the step's end acting all the way for implicit ones. 0 for equilibria."""

    constraint_work: float | None
    """Work (J) of the constraints. Explicit integrators integrate the reaction along the way. Implicit ones book the energy it takes to move the held vertices at once, the rest following after: an upper bound, which the step then dissipates down to. 0 for equilibria."""

    dissipation: float | None
    """Energy (J) that went away during the step: kinetic and elastic energy at its start plus work, less both energies at its end. Damping and the integrator's own dissipation; 0 for equilibria."""

    damping_dissipation: float | None
    """The part of it that Rayleigh damping took (J), by its power at the end of the step, for explicit integrators by the mean of both ends. The rest is the integrator's."""

    momentum: list[float]
    """Total momentum of the step end (kg m/s)."""

    angular_momentum: list[float]
    """Total angular momentum about the origin at the step end (kg m^2/s)."""

    evaluations: int
    """Force evaluations of any kind."""

    contact: ContactFigures
    """Contact with tools and between bodies."""

    volume: Volume
    """Volume ratios."""

    smallest_area_ratio: float | None
    """Smallest area ratio of membranes, if there are any."""


@dataclass(frozen=True)
class Removal:
    """What a removal of elements did."""

    tetrahedra: list[int]
    """Tetrahedra removed, by their indices in the user's mesh, ascending."""

    triangles: list[int]
    """Membrane triangles removed, by their indices in the user's list, ascending."""

    hexahedra: list[int]
    """Hexahedra removed, by their indices in the user's mesh, ascending."""

    quads: list[int]
    """Membrane quadrilaterals removed, by their indices in the user's list, ascending."""

    remaining: int
    """Tetrahedra left in the body."""

    remaining_triangles: int
    """Membrane triangles left in the body."""

    remaining_hexahedra: int
    """Hexahedra left in the body."""

    remaining_quads: int
    """Membrane quadrilaterals left in the body."""

    edges: int
    """Mesh edges that no element uses any more."""

    faces: int
    """Mesh faces that no element uses any more."""

    pressure_faces: int
    """Faces that follower pressures lost with them."""

    orphans: list[int]
    """Vertices that lost their last element, by their indices in the user's mesh, ascending."""

    pieces: int
    """Connected pieces of the body now; vertices without elements are none."""

    volume: float
    """Volume of the removed solid elements (m^3, at rest)."""

    mass: float
    """Mass removed (kg); 0 when masses are kept."""

    elastic_energy: float
    """Elastic energy (J) that left with the elements."""

    kinetic_energy: float
    """Kinetic energy (J) that left with the mass."""

    compacted: bool
    """Whether tables and edge graph were compacted."""


def asdict(own: Any) -> dict[str, Any]:
    """A report as a dictionary: that of a step is what the JSON of the engine says."""
    return dataclasses.asdict(own)


def of_dict(kind: type[Any], own: Mapping[str, Any]) -> Any:
    """A report with arrays in place of lists."""
    arrays = {k: np.array(v) if isinstance(v, list) else v for k, v in own.items()}
    return kind(**arrays)


def tool_report(own: Mapping[str, Any]) -> ToolReport:
    """The report of a tool from its fields."""
    parts = tuple(of_dict(PartReport, part) for part in own["parts"])
    report: ToolReport = of_dict(ToolReport, {**own, "parts": parts})
    return report


def report(own: dict[str, Any]) -> Report:
    """The report of a step from its JSON."""
    own["fallbacks"] = Fallbacks(**own["fallbacks"])
    own["contact"] = ContactFigures(**own["contact"])
    own["volume"] = Volume(**own["volume"])
    return Report(**own)
