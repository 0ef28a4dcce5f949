//! What acts on bodies: constraints, loads, pressures.

use super::call::{
    invalid, read, rotation, sinew_simulation, slice, tell, text, three, times, vector, with,
};
use super::simulation::add;
use super::types::*;
use sinew_embed::{ConstraintSpec, Curve, Motion, Pose, TractionOn};
use std::ffi::c_char;

/// Holds vertices where they are; `sinew_constraint_pose` moves them.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_hold(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    name: *const c_char,
    vertices: *const u32,
    vertex_count: usize,
    out: *mut sinew_handle,
) -> sinew_status {
    add(simulation, out, |sim| {
        let vertices = slice("vertices", vertices, vertex_count)?;
        sim.add_constraint(body, &ConstraintSpec::hold(text("name", name)?, vertices))
    })
}

/// Holds or moves vertices over time.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_constraint_add(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    constraint: *const sinew_constraint,
    out: *mut sinew_handle,
) -> sinew_status {
    add(simulation, out, |sim| {
        let c = read("constraint", constraint)?;
        let vertices = slice("vertices", c.vertices, c.vertex_count)?;
        let mut spec = ConstraintSpec::hold(text("name", c.name)?, vertices);
        spec.motion = match c.motion {
            SINEW_HOLD => Motion::Hold,
            SINEW_TRANSLATE => Motion::Translate(vector(c.translation)),
            SINEW_ROTATE => {
                let (centre, axis) = (vector(c.centre), vector(c.axis));
                Motion::Rotate { centre, axis, angle: c.angle }
            }
            other => return Err(invalid("motion", format!("{other} is none"))),
        };
        if c.axes > 7 {
            return Err(invalid("axes", format!("{} is no sum of 1, 2 and 4", c.axes)));
        }
        if c.axes != 0 {
            spec.axes = [1, 2, 4].map(|bit| c.axes & bit != 0);
        }
        if !c.curve.is_null() {
            let numbers = slice("curve", c.curve, times("curve", c.curve_count, 2)?)?;
            spec.curve = Curve::Points(numbers.as_chunks::<2>().0.to_vec());
        }
        if c.from != 0.0 {
            spec.from = c.from;
        }
        if c.until != 0.0 {
            spec.until = c.until;
        }
        sim.add_constraint(body, &spec)
    })
}

/// Where what a constraint holds is at the end of the next step, relative to where it took hold: turned about `centre` (m)
/// by `quaternion` (x, y, z, w), then shifted by `position` (m). NULL is no shift, no rotation, the origin.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_constraint_pose(
    simulation: *mut sinew_simulation,
    constraint: sinew_handle,
    position: *const f64,
    quaternion: *const f64,
    centre: *const f64,
) -> sinew_status {
    with(simulation, |sim| sim.set_target(constraint, pose(position, quaternion, centre)?))
}

pub(super) unsafe fn pose(
    position: *const f64,
    quaternion: *const f64,
    centre: *const f64,
) -> sinew_embed::Result<Pose> {
    let place = |what: &str, data: *const f64| {
        if data.is_null() { Ok([0.0; 3]) } else { three(what, data) }
    };
    Ok(Pose {
        translation: vector(place("position", position)?),
        rotation: rotation("quaternion", quaternion)?,
        centre: vector(place("centre", centre)?),
    })
}

/// Force (N) of a constraint on its body at the state as it is, and its torque (N m) about a point (m; NULL: the origin).
/// Either may be NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_reaction(
    simulation: *mut sinew_simulation,
    constraint: sinew_handle,
    about: *const f64,
    force: *mut f64,
    torque: *mut f64,
) -> sinew_status {
    with(simulation, |sim| {
        let about = if about.is_null() { [0.0; 3] } else { three("about", about)? };
        let wrench = sim.reaction(constraint, about)?;
        tell("force", force.cast(), wrench.force)?;
        tell("torque", torque.cast(), wrench.torque)
    })
}

/// Adds forces (N) on vertices: three numbers for each (`force_count` is `vertex_count`), or three for all together
/// (`force_count` is 1).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_load_add(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    name: *const c_char,
    vertices: *const u32,
    vertex_count: usize,
    forces: *const f64,
    force_count: usize,
    out: *mut sinew_handle,
) -> sinew_status {
    add(simulation, out, |sim| {
        let vertices = slice("vertices", vertices, vertex_count)?;
        let forces = slice("forces", forces, times("forces", force_count, 3)?)?;
        sim.add_load(body, text("name", name)?, vertices, forces, Curve::Constant)
    })
}

/// Adds a pressure (Pa) on triangles, three vertices each, that pushes along their normals as they turn.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_pressure_add(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    name: *const c_char,
    triangles: *const u32,
    triangle_count: usize,
    pressure: f64,
    out: *mut sinew_handle,
) -> sinew_status {
    add(simulation, out, |sim| {
        let count = times("triangles", triangle_count, 3)?;
        let triangles = slice("triangles", triangles, count)?;
        sim.add_pressure(body, text("name", name)?, triangles, pressure, Curve::Constant)
    })
}

/// Adds a traction (three numbers, N/m^2 at rest) that keeps its direction, on faces with `corners` vertices each (3 or 4), or
/// without faces (`face_count` is 0) on the whole surface. Every vertex gets what its shape function says. It is a load.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_traction_add(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    name: *const c_char,
    faces: *const u32,
    face_count: usize,
    corners: u32,
    traction: *const f64,
    out: *mut sinew_handle,
) -> sinew_status {
    add(simulation, out, |sim| {
        let count = times("faces", face_count, corners as usize)?;
        let faces = slice("faces", faces, count)?;
        let on = match corners {
            _ if face_count == 0 => TractionOn::Whole,
            3 => TractionOn::Triangles(faces),
            4 => TractionOn::Quads(faces),
            _ => return Err(invalid("corners", "a face has 3 or 4 of them")),
        };
        let traction = three("traction", traction)?;
        sim.add_traction(body, text("name", name)?, on, traction, Curve::Constant)
    })
}
