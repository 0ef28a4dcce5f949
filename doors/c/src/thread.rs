//! Threads, clips and tears.

use super::call::{invalid, optional_text, out, sinew_simulation, slice, text, three, with};
use super::simulation::add;
use super::types::*;
use sinew_embed::{Kind, ThreadPoint};
use std::ffi::c_char;

/// Lays a thread through points, or sets a clip between two (`kind` is `SINEW_THREAD` or `SINEW_CLIP`), which takes hold in the
/// next step. `lines` as in a scene: `name`, `stiffness`, of threads `length`, `friction`, `grip`, `tails` and `needle` (the name of
/// the tool whose needle draws it through further points), of clips `length` and `strength`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_thread_add(
    simulation: *mut sinew_simulation,
    kind: u32,
    lines: *const c_char,
    points: *const sinew_thread_point,
    point_count: usize,
    out: *mut sinew_handle,
) -> sinew_status {
    add(simulation, out, |sim| {
        let known = Kind::ALL.into_iter().find(|own| *own as u32 == kind);
        let kind = known.ok_or_else(|| invalid("kind", format!("{kind} is none")))?;
        let points = slice("points", points, point_count)?.iter();
        let points = points.map(|own| ThreadPoint { of: own.of, at: own.at });
        sim.add_thread(kind, text("lines", lines)?, &points.collect::<Vec<_>>())
    })
}

/// Moves a place in space that a thread goes through, by its number: it is there (m) at the end of the next step.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_thread_move(
    simulation: *mut sinew_simulation,
    thread: sinew_handle,
    point: u32,
    position: *const f64,
) -> sinew_status {
    with(simulation, |sim| sim.move_thread(thread, point as usize, three("position", position)?))
}

/// Draws a thread past its first (`end` 0) or last (1) point: the length (m) in all by the end of the next step.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_thread_draw(
    simulation: *mut sinew_simulation,
    thread: sinew_handle,
    end: u32,
    length: f64,
) -> sinew_status {
    with(simulation, |sim| sim.draw_thread(thread, end as usize, length))
}

/// Holds a free end of a thread, the first (`end` 0) or last (1), where it is: it slides through there no more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_thread_hold(
    simulation: *mut sinew_simulation,
    thread: sinew_handle,
    end: u32,
) -> sinew_status {
    with(simulation, |sim| sim.hold_thread(thread, end as usize))
}

/// Ties the ends of a thread together, and lets hands go.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_thread_tie(
    simulation: *mut sinew_simulation,
    thread: sinew_handle,
) -> sinew_status {
    with(simulation, |sim| sim.tie_thread(thread))
}

/// Cuts a thread between two points that hold it, by the number of the segment. The parts before and behind it, 0 where no
/// two points hold one; the first that is left has the handle of the thread.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_thread_cut(
    simulation: *mut sinew_simulation,
    thread: sinew_handle,
    segment: u32,
    first: *mut sinew_handle,
    second: *mut sinew_handle,
) -> sinew_status {
    with(simulation, |sim| {
        let places = [out("first", first)?, out("second", second)?];
        let parts = sim.cut_thread(thread, segment as usize)?;
        places.into_iter().zip(parts).for_each(|(place, part)| *place = part.unwrap_or(0));
        Ok(())
    })
}

/// Lets a body of linear tetrahedra, or of a membrane of triangles alone, with `spare` vertices tear. `lines` as below `tear` of
/// a body in a scene: `strength`, `toughness`, `radius`, `max_speed`; NULL: it tears no more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_tear_set(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    lines: *const c_char,
) -> sinew_status {
    with(simulation, |sim| sim.set_tear(body, optional_text("lines", lines)?))
}
