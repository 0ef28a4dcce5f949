//! Tools, contact, pulls, picking.

use super::act::pose;
use super::call::{
    fill, invalid, null, optional_text, out_struct, quaternion, read, rotation, sinew_simulation,
    slice, tell, text, three, times, vector, with,
};
use super::reports::*;
use super::simulation::add;
use super::types::*;
use sinew_embed::{
    BodyContact, DVec3, Hinge, Part, Points, PullSpec, Result, Shape, Stiffness, Tool, ToolPose,
    distance_field,
};
use std::ffi::c_char;

unsafe fn part(part: &sinew_part, cavity: bool) -> Result<Part> {
    let p = read("part", part)?;
    let shape = match p.shape {
        SINEW_SPHERE => Shape::Sphere { radius: p.radius },
        SINEW_CAPSULE => Shape::Capsule { half_length: p.half_length, radius: p.radius },
        SINEW_BOX => Shape::Box { half: vector(p.half), rounding: p.rounding },
        SINEW_HALF_SPACE => Shape::HalfSpace,
        SINEW_CLOSED_MESH => {
            let mesh = p.mesh.as_ref().ok_or_else(|| null("mesh of a part"))?;
            let spacing = (p.spacing != 0.0).then_some(p.spacing);
            Shape::Field(distance_field(&mesh.0, spacing)?)
        }
        other => return Err(invalid("shape", format!("{other} is none"))),
    };
    let rotation = quaternion(p.quaternion);
    Ok(Part { shape, at: vector(p.at), rotation, cavity, jaw: p.jaw })
}

/// Adds a tool.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_tool_add(
    simulation: *mut sinew_simulation,
    tool: *const sinew_tool,
    out: *mut sinew_handle,
) -> sinew_status {
    add(simulation, out, |sim| {
        let t = read("tool", tool)?;
        let parts = slice("parts", t.parts, t.part_count)?;
        let cavity = t.flags & SINEW_CAVITY != 0;
        let parts = parts.iter().map(|own| part(own, cavity)).collect::<Result<Vec<Part>>>()?;
        let start = ToolPose {
            position: vector(t.position),
            rotation: quaternion(t.quaternion),
            opening: t.opening,
        };
        let mut own = Tool::of_parts(text("name", t.name)?, parts, start);
        if t.flags > 63 {
            return Err(invalid("flags", format!("{} is no sum of flags of tools", t.flags)));
        }
        let axis = if t.hinge_axis == [0.0; 3] { DVec3::Z } else { vector(t.hinge_axis) };
        own.hinge = Hinge { point: vector(t.hinge_point), axis };
        own.grip = t.flags & SINEW_GRIP != 0;
        own.exact = t.flags & SINEW_EXACT != 0;
        own.local_stiffness = t.flags & SINEW_LOCAL_STIFFNESS != 0;
        own.keeps_side = t.flags & SINEW_NEAREST_SIDE == 0;
        own.error_bar = t.flags & SINEW_ERROR_BAR != 0;
        own.friction = t.friction;
        own.points = match t.points {
            0 if own.exact => Points::Vertex,
            0 => Points::Auto,
            1 => Points::Vertex,
            n => Points::Faces(n),
        };
        if t.stiffness != 0.0 {
            own.stiffness = Stiffness::Relative(t.stiffness);
        }
        if let Some(text) = optional_text("edge", t.edge)? {
            sinew_embed::give_edge(&mut own, text)?;
        }
        own.needle = optional_text("needle", t.needle)?.map(sinew_embed::needle).transpose()?;
        if t.on_triangles.is_null() {
            return sim.add_tool(own, None);
        }
        let count = times("on_triangles", t.on_triangle_count, 3)?;
        let on = slice("on_triangles", t.on_triangles, count)?;
        sim.add_tool(own, Some((t.on_body, on)))
    })
}

/// Moves a tool: it is there at the end of the next step, evenly through the step. With `at_once` 1 it is put there without
/// touching anything on the way. `quaternion` may be NULL for no rotation.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_tool_move(
    simulation: *mut sinew_simulation,
    tool: sinew_handle,
    position: *const f64,
    quaternion: *const f64,
    opening: f64,
    at_once: u32,
) -> sinew_status {
    with(simulation, |sim| {
        let position = vector(three("position", position)?);
        let pose = ToolPose { position, rotation: rotation("quaternion", quaternion)?, opening };
        match at_once {
            0 => sim.move_tool(tool, pose),
            1 => sim.place_tool(tool, pose),
            other => Err(invalid("at_once", format!("{other} is neither 0 nor 1"))),
        }
    })
}

/// Whether what touches a tool sticks to it (1) or may slip (0).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_tool_grip(
    simulation: *mut sinew_simulation,
    tool: sinew_handle,
    grip: u32,
) -> sinew_status {
    with(simulation, |sim| sim.set_grip(tool, grip != 0))
}

/// What a tool felt in the last step.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_read_tool_report(
    simulation: *const sinew_simulation,
    tool: sinew_handle,
    report: *mut sinew_tool_report,
) -> sinew_status {
    with(simulation, |sim| {
        let place = out_struct("report", report)?;
        *place = sinew_tool_report::from(&sim.tool_report(tool)?);
        Ok(())
    })
}

/// What each part of a tool of several parts felt. `needed` says how many there are; `out` may be NULL with capacity 0 to ask.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_tool_parts(
    simulation: *const sinew_simulation,
    tool: sinew_handle,
    out: *mut sinew_part_report,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with(simulation, |sim| {
        let report = sim.tool_report(tool)?;
        let parts = report.parts.iter().map(sinew_part_report::from);
        fill(&parts.collect::<Vec<_>>(), out, capacity, needed)
    })
}

/// Lets two bodies touch each other, or one itself (the same handle twice).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_contact_add(
    simulation: *mut sinew_simulation,
    name: *const c_char,
    first: sinew_handle,
    second: sinew_handle,
    friction: f64,
    out: *mut sinew_handle,
) -> sinew_status {
    add(simulation, out, |sim| {
        let name = text("name", name)?;
        sim.add_contact(name, [first, second], friction, BodyContact::STIFFNESS)
    })
}

/// Force (N) on the first body of a contact in the last step, and the largest penetration (m). Either may be NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_contact_force(
    simulation: *const sinew_simulation,
    contact: sinew_handle,
    force: *mut f64,
    depth: *mut f64,
) -> sinew_status {
    with(simulation, |sim| {
        let report = sim.contact_report(contact)?;
        tell("force", force.cast(), report.force.to_array())?;
        tell("depth", depth, report.depth)
    })
}

/// Pulls on vertices.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_pull_add(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    pull: *const sinew_pull,
    out: *mut sinew_handle,
) -> sinew_status {
    add(simulation, out, |sim| {
        let p = read("pull", pull)?;
        let weights = if p.weights.is_null() { 0 } else { p.vertex_count };
        let spec = PullSpec {
            name: text("name", p.name)?,
            vertices: slice("vertices", p.vertices, p.vertex_count)?,
            weights: slice("weights", p.weights, weights)?,
            stiffness: p.stiffness,
            damping: p.damping,
        };
        sim.add_pull(body, &spec)
    })
}

/// Moves the hand of a pull, as `sinew_constraint_pose` moves what a constraint holds.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_pull_move(
    simulation: *mut sinew_simulation,
    pull: sinew_handle,
    position: *const f64,
    quaternion: *const f64,
    centre: *const f64,
) -> sinew_status {
    with(simulation, |sim| sim.move_pull(pull, pose(position, quaternion, centre)?))
}

/// Force (N) on the hand of a pull in the last step, and its mean distance (m) from what it draws. Either may be NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_pull_force(
    simulation: *const sinew_simulation,
    pull: sinew_handle,
    force: *mut f64,
    distance: *mut f64,
) -> sinew_status {
    with(simulation, |sim| {
        let report = sim.pull_report(pull)?;
        tell("force", force.cast(), report.force.to_array())?;
        tell("distance", distance, report.distance)
    })
}

/// The first point of a surface that a ray meets, three numbers each for origin (m) and direction. To meet nothing is no
/// error.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_pick(
    simulation: *mut sinew_simulation,
    origin: *const f64,
    direction: *const f64,
    result: *mut sinew_pick_result,
) -> sinew_status {
    with(simulation, |sim| {
        let place = out_struct("result", result)?;
        place.hit = 0;
        let pick = sim.pick(three("origin", origin)?, three("direction", direction)?)?;
        if let Some(pick) = pick {
            *place = sinew_pick_result {
                struct_size: place.struct_size,
                hit: 1,
                body: pick.body,
                vertices: pick.vertices,
                reserved: 0,
                weights: pick.weights,
                position: pick.position,
                distance: pick.distance,
            };
        }
        Ok(())
    })
}
