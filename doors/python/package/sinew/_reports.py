"""Reports. Written by test `lists` of sinew-embed; do not edit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PartReport:
    """Forces on one part of a tool, such as one of two jaws."""

    force: Floats
    """Force (N) on it, normal and friction; (3,)."""

    torque: Floats
    """Torque (N m) on it about the tool's origin; (3,)."""

    depth: float
    """Largest penetration (m)."""

    sticking: int
    """Points that touch it and stick."""

    slipping: int
    """Points that touch it and slip."""


@dataclass(frozen=True, eq=False)
class ToolReport:
    """Forces on a tool and its contacts at the end of the last step."""

    position: Floats
    """Where the tool was: place (m) of its origin; (3,)."""

    yields: Floats
    """Way (m) from where the hand would have it to there, of a tool on a spring; (3,)."""

    rotation: Floats
    """Its rotation; a quaternion (x, y, z, w)."""

    opening: float
    """Its opening (rad)."""

    velocity: Floats
    """Velocity (m/s) of its origin; (3,)."""

    angular_velocity: Floats
    """Angular velocity (rad/s); (3,)."""

    force: Floats
    """Force (N) on the tool: normal, friction, of what it cuts, and of the thread that its needle draws; (3,)."""

    torque: Floats
    """Torque (N m) on the tool about its origin; (3,)."""

    closing: float
    """Torque (N m) about the hinge with which tissue holds its jaws open: the energy per angle (rad) that closing them
    takes."""

    normal: Floats
    """The part of the force that pressure makes (N); (3,)."""

    friction: Floats
    """The part of the force that friction makes (N); (3,)."""

    work: float
    """Work (J) done by the tool on bodies since it came, by the force at the end of every step. That on the thread of
    its needle is in the report of the thread."""

    dissipation: float
    """Energy (J) that friction has taken since it came."""

    energy: float
    """Energy (J) stored in its contacts: penetration and sticking."""

    area: float
    """Area (m^2, at rest) that touches it."""

    depth: float
    """Largest penetration (m)."""

    pressure: float
    """Largest pressure (Pa)."""

    centre: Floats
    """Centre of pressure (m); its origin while nothing touches it; (3,)."""

    sticking: int
    """Points that touch it and stick."""

    slipping: int
    """Points that touch it and slip."""

    lag: float
    """Distance (m) to its target, where its way was longer than the substeps of a step can follow."""

    drawn_in: float
    """How far (m) the surfaces of its shapes are drawn in, because it appeared partly inside of a body; of a cavity how
    far they are widened, because it appeared with tissue outside. A tool wholly inside touches nothing, and is counted
    as buried."""

    pierced: bool
    """A part of it went through the surface of a body, and touches nothing of that body until it is out."""

    other_points: Floats | None
    """Force (N) by points of the other kind at the same state, if ``error_bar`` asks for it. It is no estimate of the
    error: these points have not pushed the tissue away, so it may be several times what they give in a run of their
    own; (3,). ``None`` without."""

    local_stiffness: Floats | None
    """Change of its force (N) per motion (m) of its pose at the end of the step, with the tissue moving along within
    the step, if ``local_stiffness`` asks for it of an implicit integrator: the force is about ``force + local_stiffness
    * way``. Symmetric; limits of friction as they are. Exact for ``newton``, to the tolerance of the linear solver; (3,
    3). ``None`` without."""

    unconverged: bool
    """Whether the step that these forces are of did not converge: they are not to be relied on."""

    cut_area: float
    """Area (m^2, in the shapes of the steps) that its edge swept through tissue against its toughness since it came."""

    fracture: float
    """Energy (J) that this took, or the tip of its needle."""

    separated: int
    """Elements that its edge parted since it came."""

    cut_vertices: int
    """Vertices that this made."""

    inserted: float
    """Length (m) of its needle in tissue."""

    tip_force: float
    """Force (N) of the tissue on the tip of its needle, against the direction of the tip."""

    shaft_force: float
    """Force (N) of the channel along the shaft, positive where it holds the needle back from going in."""

    punctures: int
    """Surfaces that gave way to its needle since it came."""

    parts: tuple[PartReport, ...]
    """Forces on each part, in their order; empty for a tool of one part."""


@dataclass(frozen=True, eq=False)
class ContactReport:
    """Contact of two bodies at the end of the last step."""

    force: Floats
    """Force (N) on the first body; 0 for a body that touches itself; (3,)."""

    area: float
    """Area (m^2, at rest) in contact: the mean of both sides."""

    depth: float
    """Largest penetration (m)."""

    dissipation: float
    """Energy (J) that friction has taken."""

    sticking: int
    """Points that stick."""

    slipping: int
    """Points that slip."""

    unconverged: bool
    """Whether the step that these forces are of did not converge: they are not to be relied on."""


@dataclass(frozen=True, eq=False)
class PullReport:
    """Force and work of a pull at the end of the last step."""

    force: Floats
    """Force (N) on the hand that pulls; (3,)."""

    torque: Floats
    """Torque (N m) on the hand about the moved centre of the pose; (3,)."""

    distance: float
    """Weighted mean distance (m) of the patch from the place that it is drawn to."""

    work: float
    """Work (J) done by the hand since it took hold, by the force at the end of every step or explicit substep."""

    unconverged: bool
    """Whether the step that these forces are of did not converge: they are not to be relied on."""


@dataclass(frozen=True, eq=False)
class ThreadReport:
    """State of a thread or clip at the end of the last step."""

    held: list[int]
    """Points that hold it, by their numbers, ascending, and where they are (m)."""

    points: Floats
    """Places (m) of these; (n, 3)."""

    tension: Floats
    """Tension (N) from one of them to the next; (n,)."""

    spans: Floats
    """Distances (m) from one of them to the next: where a segment crosses a wound, how far apart its lips are there;
    (n,)."""

    length: float
    """Sum of these (m)."""

    free: Floats
    """Free lengths (m) between them; (n,)."""

    slid: Floats
    """Length (m) that slid through every point, held or not, since it took hold, towards the first; 0 at knots;
    (n,)."""

    ends: Floats
    """Force (N) on what holds its first and its last point; (2, 3)."""

    lost: int
    """Points that it lost: elements that held them were removed, or its end slipped off."""

    broken: bool
    """It broke, and does nothing any more."""

    work: float
    """Work (J) of hands that move and draw it, by the forces at the end of every step or explicit substep."""

    dissipation: float
    """Energy (J) that friction took, and what was stored when it broke."""

    unconverged: bool
    """Whether the step that these forces are of did not converge: they are not to be relied on."""


@dataclass(frozen=True)
class GlueReport:
    """What holds the wounds of a body closed ahead of blades."""

    springs: int
    """Springs that hold."""

    energy: float
    """Energy (J) in them."""

    released: float
    """Energy (J) that was in those that blades have passed, as they did."""


@dataclass(frozen=True)
class TearReport:
    """What tears of a body did up to the last step."""

    area: float
    """Area (m^2, at rest) of one side of what tore."""

    separated: int
    """Elements that tears parted."""

    vertices: int
    """Vertices that they made."""

    begun: int
    """Tears that began without a wound."""

    stress: float
    """Largest averaged principal stress (Pa) at the ends of wounds, and where a tear may begin if it is above the
    strength there, as the last step began."""

    energy_release: float
    """Largest energy release (J/m^2) at the ends of wounds as the last step began; 0 without a toughness."""

    pieces: int
    """Connected pieces of the body when it last tore."""

    way: float
    """Way (m) that a tear may still go at its largest speed."""


@dataclass(frozen=True)
class Fallbacks:
    """Bodies that took the safe step instead of linearised BDF2, by reason. Integrators that converge BDF2 count their
    first steps under ``start``."""

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
    """What contact did in a step; all 0 in a world without."""

    points: int
    """Points in contact at the end of the step."""

    sticking: int
    """Those of them that stick."""

    inner_iterations: int
    """Iterations of the inner loop of all bodies: linear systems with the contact of the last iterate."""

    unconverged: int
    """Inner loops that ended at their cap."""

    missed: bool
    """Whether something touched or pulled in a step that did not converge: Newton's iteration or contact was not found,
    or a body was halted. Forces are not to be relied on then."""

    depth: float | None
    """Largest penetration (m)."""

    depth_over_edge: float | None
    """Largest penetration over the mean edge of the surface."""

    substeps: int
    """Parts in which the step was made because a tool was fast."""

    lagging: int
    """Tools that did not reach their target."""

    lag: float | None
    """By how much (m) the worst of them is behind."""

    drawn_in: int
    """Parts of tools, and contacts of bodies, that appeared with something inside of a body and are drawn in until it
    has made way."""

    buried: int
    """Points too deep inside of another body to tell its sides, which are left out, and tools wholly inside of a
    body."""

    pierced: int
    """Parts of tools that went through the surface of a body, and touch nothing of it until they are out."""

    impacts: int
    """Bodies that took the safe step because of an impact."""

    energy: float | None
    """Energy (J) stored in contacts and pulls at the end of the step. It is no part of the elastic energy."""

    work: float | None
    """Energy (J) that moving tools and pulls put into their contacts at the start of the step, with the bodies where
    they were: an upper bound of their work, which the step then dissipates down to."""

    friction_dissipation: float | None
    """Energy (J) that friction took."""


@dataclass(frozen=True)
class Volume:
    """Volume ratios J at the end of the step."""

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

    largest_mean_change: float | None
    """Largest magnitude of the mean of ``J - 1`` over a cluster: tetrahedra that keep their volume together, or one
    element that keeps the mean of its points; 0 without any. Of such elements only means are kept: the ratios above
    need not be near 1."""


@dataclass(frozen=True)
class Report:
    """What the last step did."""

    step: int
    """Steps done."""

    time: float | None
    """Simulated time (s)."""

    dt: float | None
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
    """Line searches that found no decrease: the body stays where it was, and in a dynamic step comes to a halt
    there."""

    energy_caps: int
    """The energy cap scaled the velocity."""

    second_order_steps: int
    """Bodies that took a linearised BDF2 step."""

    fallbacks: Fallbacks
    """Bodies that did not."""

    sleeping: int
    """Bodies that slept: at rest, with nothing near, and left where they are."""

    recovering: int
    """Bodies that moved by the corotational energy to recover from inversion."""

    recovery_energy: float | None
    """Elastic energy (J) that changing to that energy and back added."""

    recoveries_refused: int
    """Bodies that have many inverted elements but do not recover: loads crush them."""

    recoveries_given_up: int
    """Bodies whose recovery took too long and was given up in this step; they move by their own law again."""

    load_parts: int
    """Parts in which the equilibrium was found."""

    load_partings: int
    """Times a part of the loads was halved, because Newton did not converge or turned elements inside out."""

    substeps: int
    """Explicit substeps."""

    refinements: int
    """Steps repeated with more substeps because the energy grew."""

    stable_step: float | None
    """Largest stable explicit step (s), 0 when not estimated."""

    linearisation_error: float | None
    """Distance of the accepted decrease of the incremental potential from what the linearised step predicted, relative:
    0 for a step in which linearisation is exact, near 1 when it says little."""

    elastic_energy: float | None
    """Elastic energy (J) at the end of the step."""

    kinetic_energy: float | None
    """Kinetic energy (J) at the end of the step, held vertices included."""

    load_work: float | None
    """Work (J) of gravity and loads during the step: along the way for explicit integrators, the loads of the step's
    end acting all the way for implicit ones. 0 for equilibria."""

    constraint_work: float | None
    """Work (J) of the constraints. Explicit integrators integrate the reaction along the way. Implicit ones book the
    energy it takes to move the held vertices at once, the rest following after: an upper bound, which the step then
    dissipates down to. 0 for equilibria."""

    dissipation: float | None
    """Energy (J) that went away during the step: kinetic and elastic energy at its start plus work, less both energies
    at its end. Damping and the integrator's own dissipation; 0 for equilibria."""

    damping_dissipation: float | None
    """The part of it that Rayleigh damping took (J), by its power at the end of the step, for explicit integrators by
    the mean of both ends. The rest is the integrator's."""

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
    """What a removal did."""

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
    """Faces that follower pressures and tractions lost with them."""

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


@dataclass(frozen=True)
class Cut:
    """What a cut did."""

    separated: list[int]
    """Elements that it parted, by their numbers, ascending."""

    copies: list[list[int]]
    """Number of every copy that came to be, and of the element of the mesh that it is of."""

    vertices: int
    """Vertices that it made."""

    spare: int
    """Vertices that further cuts may make."""

    pieces: int
    """Connected pieces of the body now; what glue holds together is one."""

    least_share: float
    """Least share of an element of the body now; of hexahedra in local coordinates."""

    area: float
    """Area (m^2, at rest) of one side of the wound; of a membrane its length times the thickness."""

    elastic_energy: float
    """Elastic energy (J) that the body has more than before because clusters of volume fell apart; 0 without."""
