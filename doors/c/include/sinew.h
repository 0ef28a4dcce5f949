/* Sinew: deformable bodies of soft tissue. SI units throughout.
 *
 * Written from the sources of crate sinew-c; do not edit. docs/c.md tells how to build the library and use this header.
 *
 * - Functions answer SINEW_OK or a code; sinew_last_error() says in words what went wrong and what to do.
 * - Set the member struct_size of structures to their sizeof, everything else that is not needed to 0.
 * - Lists of unknown length: ask with NULL and capacity 0, which tells `needed`, then once more with room for it.
 * - A simulation may be used by one thread at a time, and by another one later; a call while another one runs answers
 *   SINEW_BUSY. After SINEW_PANIC it can only be freed.
 */

#ifndef SINEW_H
#define SINEW_H

#include <stddef.h>
#include <stdint.h>

// Raised when a structure or the meaning of a function changes; functions are only added.
#define SINEW_ABI 8

// No error.
#define SINEW_OK 0

// An argument that cannot be used.
#define SINEW_ARGUMENT 1

// A mesh.
#define SINEW_MESH 2

// A material.
#define SINEW_MATERIAL 3

// A scene file.
#define SINEW_SCENE 4

// A step that could not be carried out; the state is that before it.
#define SINEW_STEP 5

// What the machine or the build does not have.
#define SINEW_BACKEND 6

// A file.
#define SINEW_IO 7

// A snapshot.
#define SINEW_SNAPSHOT 8

// A handle of something that is gone, of another kind or of another simulation.
#define SINEW_HANDLE 9

// Another call uses the simulation at this moment.
#define SINEW_BUSY 10

// The engine panicked, now or before; the simulation can only be freed.
#define SINEW_PANIC 99

// Kinds for `sinew_find`: a body.
#define SINEW_BODY 1

// A constraint.
#define SINEW_CONSTRAINT 2

// A load.
#define SINEW_LOAD 3

// A pressure.
#define SINEW_PRESSURE 4

// A tool.
#define SINEW_TOOL 5

// A pull.
#define SINEW_PULL 6

// A contact between bodies.
#define SINEW_CONTACT 7

// A thread.
#define SINEW_THREAD 8

// A clip.
#define SINEW_CLIP 9

// Number type of 64 bits (default).
#define SINEW_F64 0

// Number type of 32 bits.
#define SINEW_F32 1

// Steps are computed on the processor (default).
#define SINEW_CPU 0

// Steps are computed on a graphics processor.
#define SINEW_GPU 1

// Numbers of the points to draw of a body, three each: positions (m).
#define SINEW_SKIN_POINTS 0

// The same at rest (m): coordinates of what is drawn inside of the body.
#define SINEW_SKIN_REST 1

// One each: depth (m, at rest) of points of wounds below the surface of the mesh, 0 at all others.
#define SINEW_SKIN_DEPTH 2

// Motions of constraints: none; they can be given poses.
#define SINEW_HOLD 0

// A translation.
#define SINEW_TRANSLATE 1

// A rotation.
#define SINEW_ROTATE 2

// Shapes: a ball of `radius`.
#define SINEW_SPHERE 0

// A rod with round ends along x: `half_length`, `radius`.
#define SINEW_CAPSULE 1

// A box with round edges: `half`, `rounding`.
#define SINEW_BOX 2

// All points with z <= 0.
#define SINEW_HALF_SPACE 3

// A closed mesh: `mesh`, `spacing`.
#define SINEW_CLOSED_MESH 4

// Flags of tools: what touches it does not slip.
#define SINEW_GRIP 1

// No penetration (integrators "newton" and "quasi-static").
#define SINEW_EXACT 2

// Finds how its force answers to small motions.
#define SINEW_LOCAL_STIFFNESS 4

// Points inside leave through the nearest side, not through that by which they came.
#define SINEW_NEAREST_SIDE 8

// Also finds the force that points of the other kind give. It is no bound on the error.
#define SINEW_ERROR_BAR 16

// Its parts are cavities: bodies may not leave their inside.
#define SINEW_CAVITY 32

// Regions: elements by their indices.
#define SINEW_LIST 0

// Those whose barycentre lies in a ball round `from`.
#define SINEW_BALL 1

// Those whose barycentre lies in a ball that is swept from `from` to `to`.
#define SINEW_SWEPT_BALL 2

// Those whose largest principal Green strain is above `above`.
#define SINEW_STRAIN_ABOVE 3

// Those whose von Mises stress (Pa) is above `above`.
#define SINEW_STRESS_ABOVE 4

// Kinds of elements in lists: tetrahedra.
#define SINEW_TETRAHEDRA 0

// Hexahedra.
#define SINEW_HEXAHEDRA 1

// Triangles of a membrane.
#define SINEW_TRIANGLES 2

// Quadrilaterals of a membrane.
#define SINEW_QUADS 3

// What `sinew_read` reads, three numbers a vertex: positions (m).
#define SINEW_POSITIONS 0

// Displacements (m).
#define SINEW_DISPLACEMENTS 1

// Velocities (m/s).
#define SINEW_VELOCITIES 2

// Elastic forces (N) at the state as it is.
#define SINEW_ELASTIC_FORCES 3

// Forces (N) of gravity and loads in the last step.
#define SINEW_EXTERNAL_FORCES 4

// Forces (N) of tools, contact and pulls at the end of the last step.
#define SINEW_CONTACT_FORCES 5

// One number a vertex: pressures (Pa) of contact.
#define SINEW_CONTACT_PRESSURES 6

// Masses (kg).
#define SINEW_MASSES 7

// One number an element: volume over that at rest, of tetrahedra, then hexahedra.
#define SINEW_VOLUME_RATIOS 8

// Area over that at rest, of triangles of the membrane, then quadrilaterals.
#define SINEW_AREA_RATIOS 9

// Of a body that tears, eight numbers: area (m^2, at rest) that tore, elements parted, vertices made, tears that began without
// a wound, largest mean principal stress (Pa) where it may tear, largest energy release (J/m^2), pieces, and way (m) that a
// tear may still go.
#define SINEW_TEAR 10

// Of a thread or clip, seven numbers: largest tension (N), length (m), work of hands (J), energy (J) lost, points lost, 1 if it
// broke, 1 if the step did not converge.
#define SINEW_THREAD_REPORT 11

// Of each point that holds a thread or clip, its number.
#define SINEW_THREAD_HELD 12

// Where these points are (m), three numbers each.
#define SINEW_THREAD_POINTS 13

// Tension (N) from one of them to the next.
#define SINEW_THREAD_TENSIONS 14

// Distances (m) from one of them to the next: across a wound, how far apart its lips are there.
#define SINEW_THREAD_SPANS 15

// Free lengths (m) between them.
#define SINEW_THREAD_FREE 16

// Length (m) that slid through every point, held or not, towards the first.
#define SINEW_THREAD_SLID 17

// Forces (N) on what holds its first and its last point, three numbers each.
#define SINEW_THREAD_ENDS 18

// Of a body with glue, three numbers: springs that hold, energy (J) in them, and energy (J) that was in those that blades have
// passed.
#define SINEW_GLUE 19

// Flags of `sinew_haptic_feedback`, several by `|`. No step has answered yet: no force.
#define SINEW_HAPTIC_WAITING 1

// The last step is too old: the force falls, or is zero.
#define SINEW_HAPTIC_STALE 2

// Force or torque was cut to its limit.
#define SINEW_HAPTIC_LIMITED 4

// The force rises no faster than 50 N/s, a torque by as much of its limit: first contact, or the simulation answers again.
#define SINEW_HAPTIC_RISING 8

// The device has got more energy than it gave; damping was added.
#define SINEW_HAPTIC_DAMPED 16

// A number was not finite, a quaternion not of length 1, or time ran backwards: no force.
#define SINEW_HAPTIC_BAD_INPUT 32

// Nothing supports the body: the model is that of one step from rest, not of rest.
#define SINEW_HAPTIC_WITH_INERTIA 64

// The tangent was indefinite; the model is that of the projected one.
#define SINEW_HAPTIC_PROJECTED 128

// The model was not found in this step; that of an earlier one counts, or none.
#define SINEW_HAPTIC_UNSOLVED 256

// The step itself did not converge.
#define SINEW_HAPTIC_UNCONVERGED 512

// Numbers for `sinew_live_read`: positions (m) of a body.
#define SINEW_LIVE_POSITIONS 0

// Unit normals of the outside of a body at its vertices, means over triangles weighted by area; 0 at vertices that are not on it,
// or in elements that were cut alone.
#define SINEW_LIVE_NORMALS 1

// Force (N) on a tool, then torque (N m) about its origin.
#define SINEW_LIVE_WRENCH 2

// The end of a haptic handle at the device, for one thread beside that of the simulation. It stays good when the simulation is
// freed: its force falls to zero then.
typedef struct sinew_haptic_device sinew_haptic_device;

// The last states of a simulation, for one thread beside that of the simulation. It stays good when the simulation is freed.
typedef struct sinew_live sinew_live;

// A mesh; it never changes, and any number of threads may use it at once.
typedef struct sinew_mesh sinew_mesh;

// A simulation. One thread at a time may use it; a second call while one runs answers `SINEW_BUSY`.
typedef struct sinew_simulation sinew_simulation;

// A state of a simulation; it never changes, and any number of threads may use it at once.
typedef struct sinew_snapshot sinew_snapshot;

// 0, or what kind of error `sinew_last_error` tells of.
typedef int32_t sinew_status;

// How a simulation is carried out. All 0 but `struct_size` and `dt` is fine; then there is no gravity.
typedef struct sinew_options {
  // sizeof(sinew_options)
  uint32_t struct_size;
  // `SINEW_F64` or `SINEW_F32`
  uint32_t precision;
  // 0: one less than there are cores. Results do not depend on it.
  uint32_t threads;
  // `SINEW_CPU` or `SINEW_GPU`
  uint32_t backend;
  // Length of a step (s).
  double dt;
  // Gravity (m/s^2).
  double gravity[3];
} sinew_options;

// A file that a scene names.
typedef struct sinew_file {
  // Path as in the scene.
  const char *name;
  // Its bytes.
  const uint8_t *bytes;
  // Their number.
  size_t size;
} sinew_file;

// A body, constraint, load, pressure, tool, pull, contact, thread or clip of a simulation; 0 is never one.
typedef uint64_t sinew_handle;

// A group of vertices.
typedef struct sinew_group {
  // Name.
  const char *name;
  // Vertices.
  const uint32_t *vertices;
  // Their number.
  size_t vertex_count;
} sinew_group;

// A mesh as arrays, in the order of vertices of Gmsh and VTK; what is not there is NULL and 0.
typedef struct sinew_mesh_arrays {
  // sizeof(sinew_mesh_arrays)
  uint32_t struct_size;
  // 0
  uint32_t reserved;
  // Three coordinates (m) a vertex.
  const double *points;
  // Number of vertices.
  size_t point_count;
  // Four vertices a tetrahedron.
  const uint32_t *tetrahedra;
  // Number of tetrahedra.
  size_t tetrahedron_count;
  // Eight vertices a hexahedron.
  const uint32_t *hexahedra;
  // Number of hexahedra.
  size_t hexahedron_count;
  // Three vertices a triangle.
  const uint32_t *triangles;
  // Number of triangles.
  size_t triangle_count;
  // Four vertices a quadrilateral.
  const uint32_t *quads;
  // Number of quadrilaterals.
  size_t quad_count;
  // Groups of vertices.
  const struct sinew_group *groups;
  // Number of groups.
  size_t group_count;
} sinew_mesh_arrays;

// A material: a preset, values, or both; a value that is not 0 takes the place of the preset's.
typedef struct sinew_material {
  // sizeof(sinew_material)
  uint32_t struct_size;
  // 0
  uint32_t reserved;
  // Name of a tissue preset, or NULL.
  const char *preset;
  // Young's modulus (Pa).
  double young_modulus;
  // Poisson's ratio.
  double poisson_ratio;
  // Density (kg/m^3).
  double density;
  // Young's modulus (Pa) of every tetrahedron, then of every hexahedron, or NULL.
  const double *young_moduli;
  // Poisson's ratios, likewise.
  const double *poisson_ratios;
  // Densities (kg/m^3), likewise.
  const double *densities;
  // Number of entries of each of these lists.
  size_t element_count;
} sinew_material;

// A membrane on or instead of a solid.
typedef struct sinew_membrane {
  // sizeof(sinew_membrane)
  uint32_t struct_size;
  // 0: `group`, or all faces of the mesh; 1: the boundary of its solid elements.
  uint32_t surface;
  // Group of faces, or NULL.
  const char *group;
  // Thickness (m).
  double thickness;
  // Material, without lists; NULL for that of the body.
  const struct sinew_material *material;
  // Energy, such as "trbs"; NULL for the default.
  const char *model;
  // "stress" (default when NULL) or "strain".
  const char *plane;
} sinew_membrane;

// What activation does to fibres.
typedef struct sinew_muscle {
  // sizeof(sinew_muscle)
  uint32_t struct_size;
  // 0
  uint32_t reserved;
  // Active stress (Pa) at full activation and optimal stretch.
  double peak_stress;
  // Stretch at which it is largest; 0 for 1.
  double optimal_stretch;
  // Half width of the length-tension curve; 0 for 0.5.
  double width;
  // Relative growth of the modulus at full activation.
  double stiffening;
  // Relative shortening of the rest length at full activation.
  double shortening;
} sinew_muscle;

// A family of fibres.
typedef struct sinew_fibre {
  // sizeof(sinew_fibre)
  uint32_t struct_size;
  // 0
  uint32_t reserved;
  // Name, unique in the body.
  const char *name;
  // Three numbers a direction.
  const double *directions;
  // 1, or one for every solid element.
  size_t direction_count;
  // Modulus (Pa) along the fibres.
  double modulus;
  // Viscosity (Pa s) along them.
  double viscosity;
  // Makes them active; NULL for passive ones.
  const struct sinew_muscle *muscle;
  // What their springs measure; NULL for stretch.
  const char *form;
} sinew_fibre;

// What a body is made of. Names are those of scene files; NULL is the default.
typedef struct sinew_body {
  // sizeof(sinew_body)
  uint32_t struct_size;
  // 0
  uint32_t reserved;
  // Name, unique among bodies.
  const char *name;
  // Material.
  const struct sinew_material *material;
  // Energy, such as "svk_comp".
  const char *model;
  // "fused" or "pooled".
  const char *evaluation;
  // Where constants of model "mass_spring" come from, such as "frobenius" or "uniform".
  const char *springs;
  // Constant (N/m) for "uniform", otherwise 0.
  double spring_constant;
  // How the mass is shared out: "volume", "nodal" or "equal".
  const char *masses;
  // Membrane, or NULL.
  const struct sinew_membrane *membrane;
  // Families of fibres, or NULL.
  const struct sinew_fibre *fibres;
  // Their number.
  size_t fibre_count;
  // Modulus (Pa) of the term of volume beside them.
  double volume_modulus;
  // What keeps its volume: "elements", or "clusters" for nearly incompressible tissue.
  const char *volume;
  // Vertices kept for what cuts make of it, such as their number in the mesh; without, it cannot be cut.
  size_t spare;
  // Stiffness of what holds its wounds closed ahead of a blade, in Young's moduli over the mean edge: 0 for none, 5 is a good value.
  double glue;
} sinew_body;

// Which elements to remove.
typedef struct sinew_region {
  // sizeof(sinew_region)
  uint32_t struct_size;
  // `SINEW_LIST`, `SINEW_BALL` and so on.
  uint32_t kind;
  // `SINEW_TETRAHEDRA` and so on, for lists.
  uint32_t element;
  // 0: the mass of removed elements goes; 1: vertices keep it.
  uint32_t keep_mass;
  // Indices.
  const uint32_t *list;
  // Their number.
  size_t list_count;
  // Centre, or start of the path (m).
  double from[3];
  // End of the path (m).
  double to[3];
  // Radius (m).
  double radius;
  // Limit of strain or stress.
  double above;
} sinew_region;

// What a cut did.
typedef struct sinew_cut_report {
  // sizeof(sinew_cut_report), set by the caller
  uint32_t struct_size;
  // 0
  uint32_t reserved;
  // Tetrahedra that it parted.
  size_t separated;
  // Copies of tetrahedra that it made.
  size_t copies;
  // Vertices that it made.
  size_t vertices;
  // Vertices that further cuts may make.
  size_t spare;
  // Connected pieces of the body now.
  size_t pieces;
  // Least share of a tetrahedron of the body now.
  double least_share;
  // Area (m^2, at rest) of one side of the wound.
  double area;
} sinew_cut_report;

// A constraint.
typedef struct sinew_constraint {
  // sizeof(sinew_constraint)
  uint32_t struct_size;
  // `SINEW_HOLD`, `SINEW_TRANSLATE` or `SINEW_ROTATE`
  uint32_t motion;
  // Name, unique among constraints.
  const char *name;
  // Vertices.
  const uint32_t *vertices;
  // Their number.
  size_t vertex_count;
  // Sum of 1 (x), 2 (y) and 4 (z); 0 for all.
  uint32_t axes;
  // 0
  uint32_t reserved;
  // Translation (m).
  double translation[3];
  // Point (m) on the axis of rotation.
  double centre[3];
  // Direction of that axis.
  double axis[3];
  // Angle (rad).
  double angle;
  // Pairs of time (s) and factor on the motion; NULL for 1 at all times.
  const double *curve;
  // Number of pairs.
  size_t curve_count;
  // Time (s) from which it acts.
  double from;
  // Time (s) after which it lets go; 0 for never.
  double until;
} sinew_constraint;

// A rigid part of a tool. Quaternions are x, y, z, w; all 0 is no rotation.
typedef struct sinew_part {
  // sizeof(sinew_part)
  uint32_t struct_size;
  // `SINEW_SPHERE` and so on.
  uint32_t shape;
  // Mesh of `SINEW_CLOSED_MESH`.
  const struct sinew_mesh *mesh;
  // Distance (m) of the grid points that hold the distance to it; 0 chooses.
  double spacing;
  // Radius (m).
  double radius;
  // Half the distance (m) between the centres of the ends.
  double half_length;
  // Half sizes (m), rounding included.
  double half[3];
  // Radius (m) of the edges.
  double rounding;
  // Place (m) of its centre in the frame of the tool.
  double at[3];
  // Rotation in the frame of the tool.
  double quaternion[4];
  // Share of the opening by which it turns about the hinge: 0.5 and -0.5 for two jaws.
  double jaw;
} sinew_part;

// A rigid tool.
typedef struct sinew_tool {
  // sizeof(sinew_tool)
  uint32_t struct_size;
  // Sum of `SINEW_GRIP` and others.
  uint32_t flags;
  // Name, unique among tools.
  const char *name;
  // Parts.
  const struct sinew_part *parts;
  // Their number.
  size_t part_count;
  // A point (m) on the hinge of its jaws, in its frame.
  double hinge_point[3];
  // Direction of the hinge; all 0 for z.
  double hinge_axis[3];
  // Place (m) of its origin.
  double position[3];
  // Its rotation.
  double quaternion[4];
  // Angle (rad) between its jaws.
  double opening;
  // Coefficient of friction.
  double friction;
  // Stiffness of contact, times Young's modulus over the mean edge; 0 for the default.
  double stiffness;
  // 0: what touches it is chosen; 1: vertices; 2 to 8: so many points along an edge of a face.
  uint32_t points;
  // 0
  uint32_t reserved;
  // The body that it touches, if not all.
  sinew_handle on_body;
  // Triangles of it, three vertices each; NULL for all.
  const uint32_t *on_triangles;
  // Their number.
  size_t on_triangle_count;
  // Its sharp edge, in lines as below `edge` of a tool in a scene, or NULL. It needs no parts then.
  const char *edge;
  // Its needle, in lines as below `needle`, or NULL.
  const char *needle;
} sinew_tool;

// Forces on a tool and its contacts at the end of the last step.
typedef struct sinew_tool_report {
  // sizeof(sinew_tool_report), set by the caller
  uint32_t struct_size;
  // Number of its parts, if there are several.
  uint32_t parts;
  // Where the tool was: place (m) of its origin.
  double position[3];
  // Way (m) from where the hand would have it to there, of a tool on a spring.
  double yields[3];
  // Its rotation.
  double quaternion[4];
  // Its opening (rad).
  double opening;
  // Velocity (m/s) of its origin.
  double velocity[3];
  // Angular velocity (rad/s).
  double angular_velocity[3];
  // Force (N) on the tool: normal, friction, of what it cuts, and of the thread that its needle draws.
  double force[3];
  // Torque (N m) on the tool about its origin.
  double torque[3];
  // Torque (N m) about the hinge with which tissue holds its jaws open: the energy per angle (rad) that closing them
  // takes.
  double closing;
  // The part of the force that pressure makes (N).
  double normal[3];
  // The part of the force that friction makes (N).
  double friction[3];
  // Work (J) done by the tool on bodies since it came, by the force at the end of every step. That on the thread of
  // its needle is in the report of the thread.
  double work;
  // Energy (J) that friction has taken since it came.
  double dissipation;
  // Energy (J) stored in its contacts: penetration and sticking.
  double energy;
  // Area (m^2, at rest) that touches it.
  double area;
  // Largest penetration (m).
  double depth;
  // Largest pressure (Pa).
  double pressure;
  // Centre of pressure (m); its origin while nothing touches it.
  double centre[3];
  // Points that touch it and stick.
  uint32_t sticking;
  // Points that touch it and slip.
  uint32_t slipping;
  // Distance (m) to its target, where its way was longer than the substeps of a step can follow.
  double lag;
  // How far (m) the surfaces of its shapes are drawn in, because it appeared partly inside of a body; of a cavity
  // how far they are widened, because it appeared with tissue outside. A tool wholly inside touches nothing, and is
  // counted as buried.
  double drawn_in;
  // A part of it went through the surface of a body, and touches nothing of that body until it is out.
  uint32_t pierced;
  // Force (N) by points of the other kind at the same state, if `SINEW_ERROR_BAR` asks for it. It is no estimate of
  // the error: these points have not pushed the tissue away, so it may be several times what they give in a run of
  // their own. All 0 without.
  double other_points[3];
  // Change of its force (N) per motion (m) of its pose at the end of the step, with the tissue moving along within
  // the step, if `SINEW_LOCAL_STIFFNESS` asks for it of an implicit integrator: the force is about `force +
  // local_stiffness * way`. Symmetric; limits of friction as they are. Exact for `newton`, to the tolerance of the
  // linear solver. All 0 without.
  double local_stiffness[9];
  // Whether the step that these forces are of did not converge: they are not to be relied on.
  uint32_t unconverged;
  // Area (m^2, in the shapes of the steps) that its edge swept through tissue against its toughness since it came.
  double cut_area;
  // Energy (J) that this took, or the tip of its needle.
  double fracture;
  // Elements that its edge parted since it came.
  uint32_t separated;
  // Vertices that this made.
  uint32_t cut_vertices;
  // Length (m) of its needle in tissue.
  double inserted;
  // Force (N) of the tissue on the tip of its needle, against the direction of the tip.
  double tip_force;
  // Force (N) of the channel along the shaft, positive where it holds the needle back from going in.
  double shaft_force;
  // Surfaces that gave way to its needle since it came.
  uint32_t punctures;
} sinew_tool_report;

// Forces on one part of a tool, such as one of two jaws.
typedef struct sinew_part_report {
  // Force (N) on it, normal and friction.
  double force[3];
  // Torque (N m) on it about the tool's origin.
  double torque[3];
  // Largest penetration (m).
  double depth;
  // Points that touch it and stick.
  uint32_t sticking;
  // Points that touch it and slip.
  uint32_t slipping;
} sinew_part_report;

// A spring and a damper from vertices to a moving pose.
typedef struct sinew_pull {
  // sizeof(sinew_pull)
  uint32_t struct_size;
  // 0
  uint32_t reserved;
  // Name, unique among pulls.
  const char *name;
  // Vertices.
  const uint32_t *vertices;
  // Their number.
  size_t vertex_count;
  // Share of each in the stiffness; NULL for all the same.
  const double *weights;
  // Stiffness (N/m) of all together.
  double stiffness;
  // Damping (N s/m) of all together.
  double damping;
} sinew_pull;

// What a ray met.
typedef struct sinew_pick_result {
  // sizeof(sinew_pick_result), set by the caller
  uint32_t struct_size;
  // 1, or 0 when it met nothing.
  uint32_t hit;
  // Body.
  sinew_handle body;
  // Vertices of the triangle.
  uint32_t vertices[3];
  // 0
  uint32_t reserved;
  // Barycentric coordinates of the point in it, for the weights of a pull.
  double weights[3];
  // The point (m).
  double position[3];
  // Its distance (m) from the origin of the ray.
  double distance;
} sinew_pick_result;

// What a thread or clip goes through.
typedef struct sinew_thread_point {
  // A body of solid elements, whose tissue at the place is meant; a tool, for the channel that its needle went
  // through; 0 for a place in space, such as a hand.
  sinew_handle of;
  // The place (m), in the present shape.
  double at[3];
} sinew_thread_point;

// How a haptic device holds vertices; 0 is the default of a number.
typedef struct sinew_haptic_options {
  // sizeof(sinew_haptic_options)
  uint32_t struct_size;
  // 1: the device turns the vertices, too, about their mean, and feels a torque; 0: it does not.
  uint32_t turns;
  // Name, unique among pulls.
  const char *name;
  // Vertices. They share the stiffness evenly, each by a spring of its own.
  const uint32_t *vertices;
  // Their number.
  size_t vertex_count;
  // Stiffness (N/m) of the coupling: 300 by default, and at most 1000 for what light devices render stably.
  double stiffness;
  // Damping (N s/m) of the motion of the device: 2 by default, below 0 none.
  double damping;
  // Largest force (N): 3.3 by default.
  double limit;
  // Age (s) of the last step from which the force falls, to zero within another 50 ms: 0.05 by default. It has to be longer
  // than a step takes.
  double stale;
  // Time (s) in which the force goes over from one step's model to the next one's: 0.008 by default, below 0 none.
  double fade;
  // Moving mass (kg) of the device, which limits what damping may be added in a cycle: 0.05 by default.
  double device_mass;
  // Relative residual of the linear systems of the model: 0.1 by default.
  double tolerance;
  // Largest torque (N m) on a hand that turns: 0.1 by default.
  double torque_limit;
  // Moving moment of inertia (kg m^2) of a device that turns, which limits what damping of turns may be added in a cycle: 1e-5 by
  // default.
  double device_inertia;
} sinew_haptic_options;

// What a haptic device is to render until the next exchange.
typedef struct sinew_haptic_feedback {
  // sizeof(sinew_haptic_feedback), set by the caller
  uint32_t struct_size;
  // Sum of `SINEW_HAPTIC_WAITING` and so on.
  uint32_t flags;
  // Force (N) on the hand.
  double force[3];
  // Time (s) since the model of the last step arrived.
  double age;
  // Steps that had been taken when that model was made.
  uint64_t step;
  // Simulated time (s) at the end of that step.
  double time;
  // Energy (J) that the hand has given so far; below zero it has got some.
  double energy;
  // Exchanges in which damping was added so far.
  uint64_t dampings;
  // Torque (N m) on the hand about where the device is; 0 where it does not turn what it holds.
  double torque[3];
} sinew_haptic_feedback;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Text of the last call of this thread that failed, in UTF-8; empty before the first. It stays until the next call of this
// thread that fails.
const char *sinew_last_error(void);

// `SINEW_ABI` of the library.
uint32_t sinew_abi_version(void);

// Version of the library, such as "0.1.0".
const char *sinew_version(void);

// Makes a simulation without bodies.
sinew_status sinew_simulation_new(const struct sinew_options *options,
                                  struct sinew_simulation **out);

// Makes the simulation of a scene file. With `threads` above 0 the scene's own number does not count.
sinew_status sinew_simulation_from_scene(const char *path,
                                         uint32_t threads,
                                         struct sinew_simulation **out);

// Makes the simulation of a scene in memory; `name` stands for its file in messages. Files that it names are looked for
// among `files`, or in the current folder when there are none.
sinew_status sinew_simulation_from_text(const char *toml,
                                        const char *name,
                                        const struct sinew_file *files,
                                        size_t file_count,
                                        uint32_t threads,
                                        struct sinew_simulation **out);

// Frees a simulation that no call uses; NULL is fine.
void sinew_simulation_free(struct sinew_simulation *simulation);

// Carries out `n` steps, up to the first that fails: `SINEW_STEP`, and the state is that before it.
sinew_status sinew_step(struct sinew_simulation *simulation, uint32_t n);

// Simulated time (s).
sinew_status sinew_time(const struct sinew_simulation *simulation, double *seconds);

// Sets the length (s) of the steps to come.
sinew_status sinew_set_dt(struct sinew_simulation *simulation, double dt);

// Sets gravity (m/s^2), three numbers.
sinew_status sinew_set_gravity(struct sinew_simulation *simulation, const double *gravity);

// Sets the solver: lines as below `[solver]` of a scene, such as "integrator = 'safe'", or JSON. What is left out has its
// default.
sinew_status sinew_set_solver(struct sinew_simulation *simulation,
                              const char *settings);

// The thing of a kind (`SINEW_BODY` and so on) that has a name.
sinew_status sinew_find(const struct sinew_simulation *simulation,
                        uint32_t kind,
                        const char *name,
                        sinew_handle *handle);

// Takes a body, constraint, load, pressure, tool, pull or contact away. With a body goes what acts on nothing else.
sinew_status sinew_remove(struct sinew_simulation *simulation,
                          sinew_handle handle);

// Keeps everything that the steps to come depend on, in memory. Free it with `sinew_snapshot_free`.
sinew_status sinew_snapshot_take(struct sinew_simulation *simulation, struct sinew_snapshot **out);

// Takes up a state of this simulation, or of one that was built by the same calls or from the same scene. Handles of what was
// removed since are good again, those of what was added since are not. Anything else answers `SINEW_SNAPSHOT` and changes
// nothing.
sinew_status sinew_snapshot_restore(struct sinew_simulation *simulation,
                                    const struct sinew_snapshot *snapshot);

// A snapshot as bytes, for a file. `needed` says how many they are; `data` may be NULL with capacity 0 to ask.
sinew_status sinew_snapshot_to_bytes(const struct sinew_snapshot *snapshot,
                                     uint8_t *data,
                                     size_t capacity,
                                     size_t *needed);

// Reads what `sinew_snapshot_to_bytes` gave, in any process. Bytes of anything else answer `SINEW_SNAPSHOT`.
sinew_status sinew_snapshot_from_bytes(const uint8_t *bytes,
                                       size_t size,
                                       struct sinew_snapshot **out);

// Frees a snapshot. NULL is fine.
void sinew_snapshot_free(struct sinew_snapshot *snapshot);

// Reads a mesh file (Gmsh, VTK, TetGen, OBJ, STL).
sinew_status sinew_mesh_from_file(const char *path, struct sinew_mesh **out);

// Reads a mesh from the bytes of a file; the extension of `name` helps to tell the format.
sinew_status sinew_mesh_from_bytes(const char *name,
                                   const uint8_t *bytes,
                                   size_t size,
                                   struct sinew_mesh **out);

// Makes a mesh of arrays, which are copied.
sinew_status sinew_mesh_from_arrays(const struct sinew_mesh_arrays *arrays,
                                    struct sinew_mesh **out);

// What is in a mesh as JSON: counts, extent, groups, cell data with their smallest and largest numbers, as `sinew mesh info
// --json` writes it. As `sinew_report_json`.
sinew_status sinew_mesh_info_json(const struct sinew_mesh *mesh,
                                  char *out,
                                  size_t capacity,
                                  size_t *needed);

// Points (m) of a mesh, three numbers each.
sinew_status sinew_mesh_points(const struct sinew_mesh *mesh,
                               double *xyz,
                               size_t capacity,
                               size_t *needed);

// Vertices of the cells of a kind (`SINEW_TETRAHEDRA` and so on): four, eight, three or four each. Of tetrahedra with ten nodes
// the corners.
sinew_status sinew_mesh_cells(const struct sinew_mesh *mesh,
                              uint32_t kind,
                              uint32_t *vertices,
                              size_t capacity,
                              size_t *needed);

// Vertices of a group of a mesh.
sinew_status sinew_mesh_group(const struct sinew_mesh *mesh,
                              const char *name,
                              uint32_t *vertices,
                              size_t capacity,
                              size_t *needed);

// Numbers that the file of a mesh keeps with its cells, for tetrahedra, then hexahedra, as the lists of `sinew_material` take
// them; in a mesh without these for triangles, then quadrilaterals. NaN where there is none.
sinew_status sinew_mesh_cell_data(const struct sinew_mesh *mesh,
                                  const char *name,
                                  double *values,
                                  size_t capacity,
                                  size_t *needed);

// Vertices of a mesh by a table as below `select` of a scene, such as "half_space = { point = [0, 0, 0.05], normal = [0, 0, 1] }"
// or "patch = { near = [0, 0, 0.1] }". `SINEW_ARGUMENT` where no vertex is there.
sinew_status sinew_mesh_select(const struct sinew_mesh *mesh,
                               const char *selection,
                               uint32_t *vertices,
                               size_t capacity,
                               size_t *needed);

// Frees a mesh; bodies made of it stay. NULL is fine.
void sinew_mesh_free(struct sinew_mesh *mesh);

// Adds a body of a mesh.
sinew_status sinew_body_add(struct sinew_simulation *simulation,
                            const struct sinew_mesh *mesh,
                            const struct sinew_body *body,
                            sinew_handle *out);

// Number of vertices of the mesh of a body: length of every list of vertices. It may grow: ask again when the revision that
// `sinew_surface` tells is another one.
sinew_status sinew_vertex_count(const struct sinew_simulation *simulation,
                                sinew_handle body,
                                size_t *count);

// Vertices of a group of its mesh. `needed` says how many there are, `out` may be NULL with capacity 0 to ask.
sinew_status sinew_group_vertices(const struct sinew_simulation *simulation,
                                  sinew_handle body,
                                  const char *group,
                                  uint32_t *out,
                                  size_t capacity,
                                  size_t *needed);

// Reads numbers of a body in the order of its mesh, or of a thread or clip: `SINEW_POSITIONS` and so on. `needed` says how many numbers there are,
// `out` may be NULL with capacity 0 to ask.
sinew_status sinew_read(struct sinew_simulation *simulation,
                        sinew_handle body,
                        uint32_t quantity,
                        double *out,
                        size_t capacity,
                        size_t *needed);

// Positions (m) as three `float` a vertex straight into a vertex buffer: those of vertex `i` begin `i * stride_bytes` after
// `xyz`, and nothing else is written.
sinew_status sinew_positions_f32(struct sinew_simulation *simulation,
                                 sinew_handle body,
                                 float *xyz,
                                 size_t vertices,
                                 size_t stride_bytes);

// Sets displacements (m) and velocities (m/s), three numbers a vertex each.
sinew_status sinew_set_state(struct sinew_simulation *simulation,
                             sinew_handle body,
                             const double *displacements,
                             const double *velocities,
                             size_t vertices);

// Triangles to draw a body by, three vertices each. `needed` says how many indices there are, `revision` (or NULL) changes
// with them; `out` may be NULL with capacity 0 to ask.
sinew_status sinew_surface(struct sinew_simulation *simulation,
                           sinew_handle body,
                           uint32_t *triangles,
                           size_t capacity,
                           size_t *needed,
                           uint64_t *revision);

// Gives a body another material from the next step on.
sinew_status sinew_set_material(struct sinew_simulation *simulation,
                                sinew_handle body,
                                const struct sinew_material *material);

// Sets the activation (0 to 1) of a family of active fibres.
sinew_status sinew_set_activation(struct sinew_simulation *simulation,
                                  sinew_handle body,
                                  const char *family,
                                  double activation);

// Removes elements from a body; `removed` (or NULL) is how many went.
sinew_status sinew_remove_elements(struct sinew_simulation *simulation,
                                   sinew_handle body,
                                   const struct sinew_region *region,
                                   size_t *removed);

// Cuts a body along the surface that a blade sweeps, at once, in its present shape: one of solid elements, or of a membrane of
// triangles alone; demos/scenes/README.md tells which. `strip` holds both ends (m) of the edge of the blade, six numbers a
// position, at two positions or more. The body needs `spare`. `report` may be NULL.
sinew_status sinew_cut(struct sinew_simulation *simulation,
                       sinew_handle body,
                       const double *strip,
                       size_t position_count,
                       struct sinew_cut_report *report);

// Reads numbers of the points to draw of a body, cut or not: `SINEW_SKIN_POINTS` and so on. They are those of all vertices of
// its mesh, then of all points of a surface that it carries, then of points that cuts made. `needed` says how many numbers there are, `out` may be NULL with capacity 0 to ask.
sinew_status sinew_skin_read(struct sinew_simulation *simulation,
                             sinew_handle body,
                             uint32_t quantity,
                             double *out,
                             size_t capacity,
                             size_t *needed);

// Triangles of these points, outward, three points each: the outside of a body and both sides of its wounds. `needed` says how
// many indices there are, `revision` (or NULL) changes with them; `out` may be NULL with capacity 0 to ask.
sinew_status sinew_skin_triangles(struct sinew_simulation *simulation,
                                  sinew_handle body,
                                  uint32_t *triangles,
                                  size_t capacity,
                                  size_t *needed,
                                  uint64_t *revision);

// Of each of these triangles 1 if a cut laid it open, else 0. `needed` says how many there are, `out` may be NULL with capacity
// 0 to ask.
sinew_status sinew_skin_wound(struct sinew_simulation *simulation,
                              sinew_handle body,
                              uint32_t *out,
                              size_t capacity,
                              size_t *needed);

// Holds vertices where they are; `sinew_constraint_pose` moves them.
sinew_status sinew_hold(struct sinew_simulation *simulation,
                        sinew_handle body,
                        const char *name,
                        const uint32_t *vertices,
                        size_t vertex_count,
                        sinew_handle *out);

// Holds or moves vertices over time.
sinew_status sinew_constraint_add(struct sinew_simulation *simulation,
                                  sinew_handle body,
                                  const struct sinew_constraint *constraint,
                                  sinew_handle *out);

// Where what a constraint holds is at the end of the next step, relative to where it took hold: turned about `centre` (m)
// by `quaternion` (x, y, z, w), then shifted by `position` (m). NULL is no shift, no rotation, the origin.
sinew_status sinew_constraint_pose(struct sinew_simulation *simulation,
                                   sinew_handle constraint,
                                   const double *position,
                                   const double *quaternion,
                                   const double *centre);

// Force (N) of a constraint on its body at the state as it is, and its torque (N m) about a point (m; NULL: the origin).
// Either may be NULL.
sinew_status sinew_reaction(struct sinew_simulation *simulation,
                            sinew_handle constraint,
                            const double *about,
                            double *force,
                            double *torque);

// Adds forces (N) on vertices: three numbers for each (`force_count` is `vertex_count`), or three for all together
// (`force_count` is 1).
sinew_status sinew_load_add(struct sinew_simulation *simulation,
                            sinew_handle body,
                            const char *name,
                            const uint32_t *vertices,
                            size_t vertex_count,
                            const double *forces,
                            size_t force_count,
                            sinew_handle *out);

// Adds a pressure (Pa) on triangles, three vertices each, that pushes along their normals as they turn.
sinew_status sinew_pressure_add(struct sinew_simulation *simulation,
                                sinew_handle body,
                                const char *name,
                                const uint32_t *triangles,
                                size_t triangle_count,
                                double pressure,
                                sinew_handle *out);

// Adds a traction (three numbers, N/m^2 at rest) that keeps its direction, on faces with `corners` vertices each (3 or 4), or
// without faces (`face_count` is 0) on the whole surface. Every vertex gets what its shape function says. It is a load.
sinew_status sinew_traction_add(struct sinew_simulation *simulation,
                                sinew_handle body,
                                const char *name,
                                const uint32_t *faces,
                                size_t face_count,
                                uint32_t corners,
                                const double *traction,
                                sinew_handle *out);

// Adds a tool.
sinew_status sinew_tool_add(struct sinew_simulation *simulation,
                            const struct sinew_tool *tool,
                            sinew_handle *out);

// Moves a tool: it is there at the end of the next step, evenly through the step. With `at_once` 1 it is put there without
// touching anything on the way. `quaternion` may be NULL for no rotation.
sinew_status sinew_tool_move(struct sinew_simulation *simulation,
                             sinew_handle tool,
                             const double *position,
                             const double *quaternion,
                             double opening,
                             uint32_t at_once);

// Whether what touches a tool sticks to it (1) or may slip (0).
sinew_status sinew_tool_grip(struct sinew_simulation *simulation, sinew_handle tool, uint32_t grip);

// What a tool felt in the last step.
sinew_status sinew_read_tool_report(const struct sinew_simulation *simulation,
                                    sinew_handle tool,
                                    struct sinew_tool_report *report);

// What each part of a tool of several parts felt. `needed` says how many there are; `out` may be NULL with capacity 0 to ask.
sinew_status sinew_tool_parts(const struct sinew_simulation *simulation,
                              sinew_handle tool,
                              struct sinew_part_report *out,
                              size_t capacity,
                              size_t *needed);

// Lets two bodies touch each other, or one itself (the same handle twice).
sinew_status sinew_contact_add(struct sinew_simulation *simulation,
                               const char *name,
                               sinew_handle first,
                               sinew_handle second,
                               double friction,
                               sinew_handle *out);

// Force (N) on the first body of a contact in the last step, and the largest penetration (m). Either may be NULL.
sinew_status sinew_contact_force(const struct sinew_simulation *simulation,
                                 sinew_handle contact,
                                 double *force,
                                 double *depth);

// Pulls on vertices.
sinew_status sinew_pull_add(struct sinew_simulation *simulation,
                            sinew_handle body,
                            const struct sinew_pull *pull,
                            sinew_handle *out);

// Moves the hand of a pull, as `sinew_constraint_pose` moves what a constraint holds.
sinew_status sinew_pull_move(struct sinew_simulation *simulation,
                             sinew_handle pull,
                             const double *position,
                             const double *quaternion,
                             const double *centre);

// Force (N) on the hand of a pull in the last step, and its mean distance (m) from what it draws. Either may be NULL.
sinew_status sinew_pull_force(const struct sinew_simulation *simulation,
                              sinew_handle pull,
                              double *force,
                              double *distance);

// The first point of a surface that a ray meets, three numbers each for origin (m) and direction. To meet nothing is no
// error.
sinew_status sinew_pick(struct sinew_simulation *simulation,
                        const double *origin,
                        const double *direction,
                        struct sinew_pick_result *result);

// Lays a thread through points, or sets a clip between two (`kind` is `SINEW_THREAD` or `SINEW_CLIP`), which takes hold in the
// next step. `lines` as in a scene: `name`, `stiffness`, of threads `length`, `friction`, `grip`, `tails` and `needle` (the name of
// the tool whose needle draws it through further points), of clips `length` and `strength`.
sinew_status sinew_thread_add(struct sinew_simulation *simulation,
                              uint32_t kind,
                              const char *lines,
                              const struct sinew_thread_point *points,
                              size_t point_count,
                              sinew_handle *out);

// Moves a place in space that a thread goes through, by its number: it is there (m) at the end of the next step.
sinew_status sinew_thread_move(struct sinew_simulation *simulation,
                               sinew_handle thread,
                               uint32_t point,
                               const double *position);

// Draws a thread past its first (`end` 0) or last (1) point: the length (m) in all by the end of the next step.
sinew_status sinew_thread_draw(struct sinew_simulation *simulation,
                               sinew_handle thread,
                               uint32_t end,
                               double length);

// Holds a free end of a thread, the first (`end` 0) or last (1), where it is: it slides through there no more.
sinew_status sinew_thread_hold(struct sinew_simulation *simulation,
                               sinew_handle thread,
                               uint32_t end);

// Ties the ends of a thread together, and lets hands go.
sinew_status sinew_thread_tie(struct sinew_simulation *simulation, sinew_handle thread);

// Cuts a thread between two points that hold it, by the number of the segment. The parts before and behind it, 0 where no
// two points hold one; the first that is left has the handle of the thread.
sinew_status sinew_thread_cut(struct sinew_simulation *simulation,
                              sinew_handle thread,
                              uint32_t segment,
                              sinew_handle *first,
                              sinew_handle *second);

// Lets a body of linear tetrahedra, or of a membrane of triangles alone, with `spare` vertices tear. `lines` as below `tear` of
// a body in a scene: `strength`, `toughness`, `radius`, `max_speed`; NULL: it tears no more.
sinew_status sinew_tear_set(struct sinew_simulation *simulation,
                            sinew_handle body,
                            const char *lines);

// Lets a haptic device hold vertices of a body from the next step on, where both are then: the place of the device at its first
// exchange is where the vertices are when they are taken hold of. Every `sinew_step` serves it. `out` is a pull:
// `sinew_pull_force` reads it. A tool in place of the body, with options of no vertices, is held itself from where
// it is, and `out` is the tool, of which `sinew_tool_move` then sets the opening alone. `sinew_haptic_release` lets go of either. Free the device with `sinew_haptic_free`, before or after the simulation.
// On a graphics processor it is `SINEW_BACKEND`.
sinew_status sinew_haptic_add(struct sinew_simulation *simulation,
                              sinew_handle body,
                              const struct sinew_haptic_options *options,
                              sinew_handle *out,
                              struct sinew_haptic_device **device);

// Has a device let go of what it holds, by the handle that `sinew_haptic_add` gave: a pull is gone, a tool stays where it stands and moves
// as it is told again. The force of the device falls to zero; free it all the same.
sinew_status sinew_haptic_release(struct sinew_simulation *simulation,
                                  sinew_handle held);

// Tells where the device is (m) and how fast it moves (m/s), three numbers each, and what it is to render until the next
// exchange; `seconds` have passed since the last one. One that turns what it holds stays as it is turned. It never waits, takes no lock of the simulation and asks for no memory.
// Numbers that are not finite are `SINEW_OK` with `SINEW_HAPTIC_BAD_INPUT` and no force. Two threads at once on one device:
// `SINEW_BUSY` for the second.
sinew_status sinew_haptic_exchange(const struct sinew_haptic_device *device,
                                   const double *position,
                                   const double *velocity,
                                   double seconds,
                                   struct sinew_haptic_feedback *feedback);

// The same of a device that turns what it holds (`turns` of its options): also its orientation, a quaternion (x, y, z, w), and its
// angular velocity (rad/s). At its first exchange nothing is turned. A quaternion that has not length 1 is bad input; NULL is no turn.
sinew_status sinew_haptic_exchange_pose(const struct sinew_haptic_device *device,
                                        const double *position,
                                        const double *quaternion,
                                        const double *velocity,
                                        const double *angular_velocity,
                                        double seconds,
                                        struct sinew_haptic_feedback *feedback);

// Frees a device that no call uses; NULL is fine. What it holds stays where it was until `sinew_haptic_release`.
void sinew_haptic_free(struct sinew_haptic_device *device);

// Shares bodies and tools with another thread: their state as it is, then that after every step and every way back. Without any
// all that there are now. Free it with `sinew_live_free`, before or after the simulation; nothing is written any more then.
sinew_status sinew_live_share(struct sinew_simulation *simulation,
                              const sinew_handle *bodies,
                              size_t body_count,
                              const sinew_handle *tools,
                              size_t tool_count,
                              struct sinew_live **out);

// Takes the last state, whole: whether (1 or 0) it is one that was not taken yet, the steps that were done and the simulated time
// (s). Any may be NULL. It never waits.
sinew_status sinew_live_update(struct sinew_live *live,
                               uint32_t *is_new,
                               uint64_t *step,
                               double *seconds);

// Numbers of a shared body, three a vertex of its mesh (`SINEW_LIVE_POSITIONS`, `SINEW_LIVE_NORMALS`), or of a shared tool, six
// (`SINEW_LIVE_WRENCH`), at a time (s) between the last two states that were taken; `INFINITY` for the last one, to the bit.
// `needed` says how many there are; `data` may be NULL with capacity 0 to ask.
sinew_status sinew_live_read(struct sinew_live *live,
                             sinew_handle handle,
                             uint32_t quantity,
                             double seconds,
                             double *data,
                             size_t capacity,
                             size_t *needed);

// Frees a reader that no call uses; NULL is fine.
void sinew_live_free(struct sinew_live *live);

// What the last step did, as JSON that ends with a zero byte. `needed` says how many bytes that is; `out` may be NULL with
// capacity 0 to ask.
sinew_status sinew_report_json(const struct sinew_simulation *simulation,
                               char *out,
                               size_t capacity,
                               size_t *needed);

// What looks unintended or was repaired in meshes, materials and the scene, then what was not as it should be in the steps
// that led to the present state: JSON as in `sinew_report_json`, an array of objects with the texts `code`, `level` ("note"
// or "warning"), `subject`, `message` and `remedy`.
sinew_status sinew_warnings_json(const struct sinew_simulation *simulation,
                                 char *out,
                                 size_t capacity,
                                 size_t *needed);

// Why the present state cannot be trusted, although every step was carried out, as far as the steps that led to it tell: the
// text with which the command `sinew run` fails. Empty, with `needed` 1, where it can be trusted.
sinew_status sinew_verdict(const struct sinew_simulation *simulation,
                           char *out,
                           size_t capacity,
                           size_t *needed);

// Elastic and kinetic energy (J) of the state as it is. Either may be NULL.
sinew_status sinew_energy(struct sinew_simulation *simulation, double *elastic, double *kinetic);

// Hash of displacements and velocities: equal hashes mean equal results to the last bit.
sinew_status sinew_hash(struct sinew_simulation *simulation, uint64_t *hash);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* SINEW_H */
