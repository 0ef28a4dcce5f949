//! Plain types of the header. Sizes of structures are checked by their first member, so that they can grow.

use std::ffi::c_char;

/// Raised when a structure or the meaning of a function changes; functions are only added.
pub const SINEW_ABI: u32 = 8;

/// 0, or what kind of error `sinew_last_error` tells of.
pub type sinew_status = i32;

/// No error.
pub const SINEW_OK: i32 = 0;
/// An argument that cannot be used.
pub const SINEW_ARGUMENT: i32 = 1;
/// A mesh.
pub const SINEW_MESH: i32 = 2;
/// A material.
pub const SINEW_MATERIAL: i32 = 3;
/// A scene file.
pub const SINEW_SCENE: i32 = 4;
/// A step that could not be carried out; the state is that before it.
pub const SINEW_STEP: i32 = 5;
/// What the machine or the build does not have.
pub const SINEW_BACKEND: i32 = 6;
/// A file.
pub const SINEW_IO: i32 = 7;
/// A snapshot.
pub const SINEW_SNAPSHOT: i32 = 8;
/// A handle of something that is gone, of another kind or of another simulation.
pub const SINEW_HANDLE: i32 = 9;
/// Another call uses the simulation at this moment.
pub const SINEW_BUSY: i32 = 10;
/// The engine panicked, now or before; the simulation can only be freed.
pub const SINEW_PANIC: i32 = 99;

/// A body, constraint, load, pressure, tool, pull, contact, thread or clip of a simulation; 0 is never one.
pub type sinew_handle = u64;

/// Kinds for `sinew_find`: a body.
pub const SINEW_BODY: u32 = 1;
/// A constraint.
pub const SINEW_CONSTRAINT: u32 = 2;
/// A load.
pub const SINEW_LOAD: u32 = 3;
/// A pressure.
pub const SINEW_PRESSURE: u32 = 4;
/// A tool.
pub const SINEW_TOOL: u32 = 5;
/// A pull.
pub const SINEW_PULL: u32 = 6;
/// A contact between bodies.
pub const SINEW_CONTACT: u32 = 7;
/// A thread.
pub const SINEW_THREAD: u32 = 8;
/// A clip.
pub const SINEW_CLIP: u32 = 9;

/// Number type of 64 bits (default).
pub const SINEW_F64: u32 = 0;
/// Number type of 32 bits.
pub const SINEW_F32: u32 = 1;
/// Steps are computed on the processor (default).
pub const SINEW_CPU: u32 = 0;
/// Steps are computed on a graphics processor.
pub const SINEW_GPU: u32 = 1;

/// How a simulation is carried out. All 0 but `struct_size` and `dt` is fine; then there is no gravity.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_options {
    /// sizeof(sinew_options)
    pub struct_size: u32,
    /// `SINEW_F64` or `SINEW_F32`
    pub precision: u32,
    /// 0: one less than there are cores. Results do not depend on it.
    pub threads: u32,
    /// `SINEW_CPU` or `SINEW_GPU`
    pub backend: u32,
    /// Length of a step (s).
    pub dt: f64,
    /// Gravity (m/s^2).
    pub gravity: [f64; 3],
}

/// A file that a scene names.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_file {
    /// Path as in the scene.
    pub name: *const c_char,
    /// Its bytes.
    pub bytes: *const u8,
    /// Their number.
    pub size: usize,
}

/// A group of vertices.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_group {
    /// Name.
    pub name: *const c_char,
    /// Vertices.
    pub vertices: *const u32,
    /// Their number.
    pub vertex_count: usize,
}

/// A mesh as arrays, in the order of vertices of Gmsh and VTK; what is not there is NULL and 0.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_mesh_arrays {
    /// sizeof(sinew_mesh_arrays)
    pub struct_size: u32,
    /// 0
    pub reserved: u32,
    /// Three coordinates (m) a vertex.
    pub points: *const f64,
    /// Number of vertices.
    pub point_count: usize,
    /// Four vertices a tetrahedron.
    pub tetrahedra: *const u32,
    /// Number of tetrahedra.
    pub tetrahedron_count: usize,
    /// Eight vertices a hexahedron.
    pub hexahedra: *const u32,
    /// Number of hexahedra.
    pub hexahedron_count: usize,
    /// Three vertices a triangle.
    pub triangles: *const u32,
    /// Number of triangles.
    pub triangle_count: usize,
    /// Four vertices a quadrilateral.
    pub quads: *const u32,
    /// Number of quadrilaterals.
    pub quad_count: usize,
    /// Groups of vertices.
    pub groups: *const sinew_group,
    /// Number of groups.
    pub group_count: usize,
}

/// A material: a preset, values, or both; a value that is not 0 takes the place of the preset's.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_material {
    /// sizeof(sinew_material)
    pub struct_size: u32,
    /// 0
    pub reserved: u32,
    /// Name of a tissue preset, or NULL.
    pub preset: *const c_char,
    /// Young's modulus (Pa).
    pub young_modulus: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Density (kg/m^3).
    pub density: f64,
    /// Young's modulus (Pa) of every tetrahedron, then of every hexahedron, or NULL.
    pub young_moduli: *const f64,
    /// Poisson's ratios, likewise.
    pub poisson_ratios: *const f64,
    /// Densities (kg/m^3), likewise.
    pub densities: *const f64,
    /// Number of entries of each of these lists.
    pub element_count: usize,
}

/// A membrane on or instead of a solid.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_membrane {
    /// sizeof(sinew_membrane)
    pub struct_size: u32,
    /// 0: `group`, or all faces of the mesh; 1: the boundary of its solid elements.
    pub surface: u32,
    /// Group of faces, or NULL.
    pub group: *const c_char,
    /// Thickness (m).
    pub thickness: f64,
    /// Material, without lists; NULL for that of the body.
    pub material: *const sinew_material,
    /// Energy, such as "trbs"; NULL for the default.
    pub model: *const c_char,
    /// "stress" (default when NULL) or "strain".
    pub plane: *const c_char,
}

/// What activation does to fibres.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_muscle {
    /// sizeof(sinew_muscle)
    pub struct_size: u32,
    /// 0
    pub reserved: u32,
    /// Active stress (Pa) at full activation and optimal stretch.
    pub peak_stress: f64,
    /// Stretch at which it is largest; 0 for 1.
    pub optimal_stretch: f64,
    /// Half width of the length-tension curve; 0 for 0.5.
    pub width: f64,
    /// Relative growth of the modulus at full activation.
    pub stiffening: f64,
    /// Relative shortening of the rest length at full activation.
    pub shortening: f64,
}

/// A family of fibres.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_fibre {
    /// sizeof(sinew_fibre)
    pub struct_size: u32,
    /// 0
    pub reserved: u32,
    /// Name, unique in the body.
    pub name: *const c_char,
    /// Three numbers a direction.
    pub directions: *const f64,
    /// 1, or one for every solid element.
    pub direction_count: usize,
    /// Modulus (Pa) along the fibres.
    pub modulus: f64,
    /// Viscosity (Pa s) along them.
    pub viscosity: f64,
    /// Makes them active; NULL for passive ones.
    pub muscle: *const sinew_muscle,
    /// What their springs measure; NULL for stretch.
    pub form: *const c_char,
}

/// What a body is made of. Names are those of scene files; NULL is the default.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_body {
    /// sizeof(sinew_body)
    pub struct_size: u32,
    /// 0
    pub reserved: u32,
    /// Name, unique among bodies.
    pub name: *const c_char,
    /// Material.
    pub material: *const sinew_material,
    /// Energy, such as "svk_comp".
    pub model: *const c_char,
    /// "fused" or "pooled".
    pub evaluation: *const c_char,
    /// Where constants of model "mass_spring" come from, such as "frobenius" or "uniform".
    pub springs: *const c_char,
    /// Constant (N/m) for "uniform", otherwise 0.
    pub spring_constant: f64,
    /// How the mass is shared out: "volume", "nodal" or "equal".
    pub masses: *const c_char,
    /// Membrane, or NULL.
    pub membrane: *const sinew_membrane,
    /// Families of fibres, or NULL.
    pub fibres: *const sinew_fibre,
    /// Their number.
    pub fibre_count: usize,
    /// Modulus (Pa) of the term of volume beside them.
    pub volume_modulus: f64,
    /// What keeps its volume: "elements", or "clusters" for nearly incompressible tissue.
    pub volume: *const c_char,
    /// Vertices kept for what cuts make of it, such as their number in the mesh; without, it cannot be cut.
    pub spare: usize,
    /// Stiffness of what holds its wounds closed ahead of a blade, in Young's moduli over the mean edge: 0 for none, 5 is a good value.
    pub glue: f64,
}

/// What a cut did.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_cut_report {
    /// sizeof(sinew_cut_report), set by the caller
    pub struct_size: u32,
    /// 0
    pub reserved: u32,
    /// Tetrahedra that it parted.
    pub separated: usize,
    /// Copies of tetrahedra that it made.
    pub copies: usize,
    /// Vertices that it made.
    pub vertices: usize,
    /// Vertices that further cuts may make.
    pub spare: usize,
    /// Connected pieces of the body now.
    pub pieces: usize,
    /// Least share of a tetrahedron of the body now.
    pub least_share: f64,
    /// Area (m^2, at rest) of one side of the wound.
    pub area: f64,
}

/// Numbers of the points to draw of a body, three each: positions (m).
pub const SINEW_SKIN_POINTS: u32 = 0;
/// The same at rest (m): coordinates of what is drawn inside of the body.
pub const SINEW_SKIN_REST: u32 = 1;
/// One each: depth (m, at rest) of points of wounds below the surface of the mesh, 0 at all others.
pub const SINEW_SKIN_DEPTH: u32 = 2;

/// Motions of constraints: none; they can be given poses.
pub const SINEW_HOLD: u32 = 0;
/// A translation.
pub const SINEW_TRANSLATE: u32 = 1;
/// A rotation.
pub const SINEW_ROTATE: u32 = 2;

/// A constraint.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_constraint {
    /// sizeof(sinew_constraint)
    pub struct_size: u32,
    /// `SINEW_HOLD`, `SINEW_TRANSLATE` or `SINEW_ROTATE`
    pub motion: u32,
    /// Name, unique among constraints.
    pub name: *const c_char,
    /// Vertices.
    pub vertices: *const u32,
    /// Their number.
    pub vertex_count: usize,
    /// Sum of 1 (x), 2 (y) and 4 (z); 0 for all.
    pub axes: u32,
    /// 0
    pub reserved: u32,
    /// Translation (m).
    pub translation: [f64; 3],
    /// Point (m) on the axis of rotation.
    pub centre: [f64; 3],
    /// Direction of that axis.
    pub axis: [f64; 3],
    /// Angle (rad).
    pub angle: f64,
    /// Pairs of time (s) and factor on the motion; NULL for 1 at all times.
    pub curve: *const f64,
    /// Number of pairs.
    pub curve_count: usize,
    /// Time (s) from which it acts.
    pub from: f64,
    /// Time (s) after which it lets go; 0 for never.
    pub until: f64,
}

/// Shapes: a ball of `radius`.
pub const SINEW_SPHERE: u32 = 0;
/// A rod with round ends along x: `half_length`, `radius`.
pub const SINEW_CAPSULE: u32 = 1;
/// A box with round edges: `half`, `rounding`.
pub const SINEW_BOX: u32 = 2;
/// All points with z <= 0.
pub const SINEW_HALF_SPACE: u32 = 3;
/// A closed mesh: `mesh`, `spacing`.
pub const SINEW_CLOSED_MESH: u32 = 4;

/// A rigid part of a tool. Quaternions are x, y, z, w; all 0 is no rotation.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_part {
    /// sizeof(sinew_part)
    pub struct_size: u32,
    /// `SINEW_SPHERE` and so on.
    pub shape: u32,
    /// Mesh of `SINEW_CLOSED_MESH`.
    pub mesh: *const super::sinew_mesh,
    /// Distance (m) of the grid points that hold the distance to it; 0 chooses.
    pub spacing: f64,
    /// Radius (m).
    pub radius: f64,
    /// Half the distance (m) between the centres of the ends.
    pub half_length: f64,
    /// Half sizes (m), rounding included.
    pub half: [f64; 3],
    /// Radius (m) of the edges.
    pub rounding: f64,
    /// Place (m) of its centre in the frame of the tool.
    pub at: [f64; 3],
    /// Rotation in the frame of the tool.
    pub quaternion: [f64; 4],
    /// Share of the opening by which it turns about the hinge: 0.5 and -0.5 for two jaws.
    pub jaw: f64,
}

/// Flags of tools: what touches it does not slip.
pub const SINEW_GRIP: u32 = 1;
/// No penetration (integrators "newton" and "quasi-static").
pub const SINEW_EXACT: u32 = 2;
/// Finds how its force answers to small motions.
pub const SINEW_LOCAL_STIFFNESS: u32 = 4;
/// Points inside leave through the nearest side, not through that by which they came.
pub const SINEW_NEAREST_SIDE: u32 = 8;
/// Also finds the force that points of the other kind give. It is no bound on the error.
pub const SINEW_ERROR_BAR: u32 = 16;
/// Its parts are cavities: bodies may not leave their inside.
pub const SINEW_CAVITY: u32 = 32;

/// A rigid tool.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_tool {
    /// sizeof(sinew_tool)
    pub struct_size: u32,
    /// Sum of `SINEW_GRIP` and others.
    pub flags: u32,
    /// Name, unique among tools.
    pub name: *const c_char,
    /// Parts.
    pub parts: *const sinew_part,
    /// Their number.
    pub part_count: usize,
    /// A point (m) on the hinge of its jaws, in its frame.
    pub hinge_point: [f64; 3],
    /// Direction of the hinge; all 0 for z.
    pub hinge_axis: [f64; 3],
    /// Place (m) of its origin.
    pub position: [f64; 3],
    /// Its rotation.
    pub quaternion: [f64; 4],
    /// Angle (rad) between its jaws.
    pub opening: f64,
    /// Coefficient of friction.
    pub friction: f64,
    /// Stiffness of contact, times Young's modulus over the mean edge; 0 for the default.
    pub stiffness: f64,
    /// 0: what touches it is chosen; 1: vertices; 2 to 8: so many points along an edge of a face.
    pub points: u32,
    /// 0
    pub reserved: u32,
    /// The body that it touches, if not all.
    pub on_body: sinew_handle,
    /// Triangles of it, three vertices each; NULL for all.
    pub on_triangles: *const u32,
    /// Their number.
    pub on_triangle_count: usize,
    /// Its sharp edge, in lines as below `edge` of a tool in a scene, or NULL. It needs no parts then.
    pub edge: *const c_char,
    /// Its needle, in lines as below `needle`, or NULL.
    pub needle: *const c_char,
}

/// What a thread or clip goes through.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_thread_point {
    /// A body of solid elements, whose tissue at the place is meant; a tool, for the channel that its needle went
    /// through; 0 for a place in space, such as a hand.
    pub of: sinew_handle,
    /// The place (m), in the present shape.
    pub at: [f64; 3],
}

/// A spring and a damper from vertices to a moving pose.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_pull {
    /// sizeof(sinew_pull)
    pub struct_size: u32,
    /// 0
    pub reserved: u32,
    /// Name, unique among pulls.
    pub name: *const c_char,
    /// Vertices.
    pub vertices: *const u32,
    /// Their number.
    pub vertex_count: usize,
    /// Share of each in the stiffness; NULL for all the same.
    pub weights: *const f64,
    /// Stiffness (N/m) of all together.
    pub stiffness: f64,
    /// Damping (N s/m) of all together.
    pub damping: f64,
}

/// What a ray met.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_pick_result {
    /// sizeof(sinew_pick_result), set by the caller
    pub struct_size: u32,
    /// 1, or 0 when it met nothing.
    pub hit: u32,
    /// Body.
    pub body: sinew_handle,
    /// Vertices of the triangle.
    pub vertices: [u32; 3],
    /// 0
    pub reserved: u32,
    /// Barycentric coordinates of the point in it, for the weights of a pull.
    pub weights: [f64; 3],
    /// The point (m).
    pub position: [f64; 3],
    /// Its distance (m) from the origin of the ray.
    pub distance: f64,
}

/// Regions: elements by their indices.
pub const SINEW_LIST: u32 = 0;
/// Those whose barycentre lies in a ball round `from`.
pub const SINEW_BALL: u32 = 1;
/// Those whose barycentre lies in a ball that is swept from `from` to `to`.
pub const SINEW_SWEPT_BALL: u32 = 2;
/// Those whose largest principal Green strain is above `above`.
pub const SINEW_STRAIN_ABOVE: u32 = 3;
/// Those whose von Mises stress (Pa) is above `above`.
pub const SINEW_STRESS_ABOVE: u32 = 4;

/// Kinds of elements in lists: tetrahedra.
pub const SINEW_TETRAHEDRA: u32 = 0;
/// Hexahedra.
pub const SINEW_HEXAHEDRA: u32 = 1;
/// Triangles of a membrane.
pub const SINEW_TRIANGLES: u32 = 2;
/// Quadrilaterals of a membrane.
pub const SINEW_QUADS: u32 = 3;

/// Which elements to remove.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_region {
    /// sizeof(sinew_region)
    pub struct_size: u32,
    /// `SINEW_LIST`, `SINEW_BALL` and so on.
    pub kind: u32,
    /// `SINEW_TETRAHEDRA` and so on, for lists.
    pub element: u32,
    /// 0: the mass of removed elements goes; 1: vertices keep it.
    pub keep_mass: u32,
    /// Indices.
    pub list: *const u32,
    /// Their number.
    pub list_count: usize,
    /// Centre, or start of the path (m).
    pub from: [f64; 3],
    /// End of the path (m).
    pub to: [f64; 3],
    /// Radius (m).
    pub radius: f64,
    /// Limit of strain or stress.
    pub above: f64,
}

/// What `sinew_read` reads, three numbers a vertex: positions (m).
pub const SINEW_POSITIONS: u32 = 0;
/// Displacements (m).
pub const SINEW_DISPLACEMENTS: u32 = 1;
/// Velocities (m/s).
pub const SINEW_VELOCITIES: u32 = 2;
/// Elastic forces (N) at the state as it is.
pub const SINEW_ELASTIC_FORCES: u32 = 3;
/// Forces (N) of gravity and loads in the last step.
pub const SINEW_EXTERNAL_FORCES: u32 = 4;
/// Forces (N) of tools, contact and pulls at the end of the last step.
pub const SINEW_CONTACT_FORCES: u32 = 5;
/// One number a vertex: pressures (Pa) of contact.
pub const SINEW_CONTACT_PRESSURES: u32 = 6;
/// Masses (kg).
pub const SINEW_MASSES: u32 = 7;
/// One number an element: volume over that at rest, of tetrahedra, then hexahedra.
pub const SINEW_VOLUME_RATIOS: u32 = 8;
/// Area over that at rest, of triangles of the membrane, then quadrilaterals.
pub const SINEW_AREA_RATIOS: u32 = 9;
/// Of a body that tears, eight numbers: area (m^2, at rest) that tore, elements parted, vertices made, tears that began without
/// a wound, largest mean principal stress (Pa) where it may tear, largest energy release (J/m^2), pieces, and way (m) that a
/// tear may still go.
pub const SINEW_TEAR: u32 = 10;
/// Of a thread or clip, seven numbers: largest tension (N), length (m), work of hands (J), energy (J) lost, points lost, 1 if it
/// broke, 1 if the step did not converge.
pub const SINEW_THREAD_REPORT: u32 = 11;
/// Of each point that holds a thread or clip, its number.
pub const SINEW_THREAD_HELD: u32 = 12;
/// Where these points are (m), three numbers each.
pub const SINEW_THREAD_POINTS: u32 = 13;
/// Tension (N) from one of them to the next.
pub const SINEW_THREAD_TENSIONS: u32 = 14;
/// Distances (m) from one of them to the next: across a wound, how far apart its lips are there.
pub const SINEW_THREAD_SPANS: u32 = 15;
/// Free lengths (m) between them.
pub const SINEW_THREAD_FREE: u32 = 16;
/// Length (m) that slid through every point, held or not, towards the first.
pub const SINEW_THREAD_SLID: u32 = 17;
/// Forces (N) on what holds its first and its last point, three numbers each.
pub const SINEW_THREAD_ENDS: u32 = 18;
/// Of a body with glue, three numbers: springs that hold, energy (J) in them, and energy (J) that was in those that blades have
/// passed.
pub const SINEW_GLUE: u32 = 19;

/// Flags of `sinew_haptic_feedback`, several by `|`. No step has answered yet: no force.
pub const SINEW_HAPTIC_WAITING: u32 = 1;
/// The last step is too old: the force falls, or is zero.
pub const SINEW_HAPTIC_STALE: u32 = 2;
/// Force or torque was cut to its limit.
pub const SINEW_HAPTIC_LIMITED: u32 = 4;
/// The force rises no faster than 50 N/s, a torque by as much of its limit: first contact, or the simulation answers again.
pub const SINEW_HAPTIC_RISING: u32 = 8;
/// The device has got more energy than it gave; damping was added.
pub const SINEW_HAPTIC_DAMPED: u32 = 16;
/// A number was not finite, a quaternion not of length 1, or time ran backwards: no force.
pub const SINEW_HAPTIC_BAD_INPUT: u32 = 32;
/// Nothing supports the body: the model is that of one step from rest, not of rest.
pub const SINEW_HAPTIC_WITH_INERTIA: u32 = 64;
/// The tangent was indefinite; the model is that of the projected one.
pub const SINEW_HAPTIC_PROJECTED: u32 = 128;
/// The model was not found in this step; that of an earlier one counts, or none.
pub const SINEW_HAPTIC_UNSOLVED: u32 = 256;
/// The step itself did not converge.
pub const SINEW_HAPTIC_UNCONVERGED: u32 = 512;

/// How a haptic device holds vertices; 0 is the default of a number.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_haptic_options {
    /// sizeof(sinew_haptic_options)
    pub struct_size: u32,
    /// 1: the device turns the vertices, too, about their mean, and feels a torque; 0: it does not.
    pub turns: u32,
    /// Name, unique among pulls.
    pub name: *const c_char,
    /// Vertices. They share the stiffness evenly, each by a spring of its own.
    pub vertices: *const u32,
    /// Their number.
    pub vertex_count: usize,
    /// Stiffness (N/m) of the coupling: 300 by default, and at most 1000 for what light devices render stably.
    pub stiffness: f64,
    /// Damping (N s/m) of the motion of the device: 2 by default, below 0 none.
    pub damping: f64,
    /// Largest force (N): 3.3 by default.
    pub limit: f64,
    /// Age (s) of the last step from which the force falls, to zero within another 50 ms: 0.05 by default. It has to be longer
    /// than a step takes.
    pub stale: f64,
    /// Time (s) in which the force goes over from one step's model to the next one's: 0.008 by default, below 0 none.
    pub fade: f64,
    /// Moving mass (kg) of the device, which limits what damping may be added in a cycle: 0.05 by default.
    pub device_mass: f64,
    /// Relative residual of the linear systems of the model: 0.1 by default.
    pub tolerance: f64,
    /// Largest torque (N m) on a hand that turns: 0.1 by default.
    pub torque_limit: f64,
    /// Moving moment of inertia (kg m^2) of a device that turns, which limits what damping of turns may be added in a cycle: 1e-5 by
    /// default.
    pub device_inertia: f64,
}

/// What a haptic device is to render until the next exchange.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct sinew_haptic_feedback {
    /// sizeof(sinew_haptic_feedback), set by the caller
    pub struct_size: u32,
    /// Sum of `SINEW_HAPTIC_WAITING` and so on.
    pub flags: u32,
    /// Force (N) on the hand.
    pub force: [f64; 3],
    /// Time (s) since the model of the last step arrived.
    pub age: f64,
    /// Steps that had been taken when that model was made.
    pub step: u64,
    /// Simulated time (s) at the end of that step.
    pub time: f64,
    /// Energy (J) that the hand has given so far; below zero it has got some.
    pub energy: f64,
    /// Exchanges in which damping was added so far.
    pub dampings: u64,
    /// Torque (N m) on the hand about where the device is; 0 where it does not turn what it holds.
    pub torque: [f64; 3],
}

/// Numbers for `sinew_live_read`: positions (m) of a body.
pub const SINEW_LIVE_POSITIONS: u32 = 0;
/// Unit normals of the outside of a body at its vertices, means over triangles weighted by area; 0 at vertices that are not on it,
/// or in elements that were cut alone.
pub const SINEW_LIVE_NORMALS: u32 = 1;
/// Force (N) on a tool, then torque (N m) about its origin.
pub const SINEW_LIVE_WRENCH: u32 = 2;
