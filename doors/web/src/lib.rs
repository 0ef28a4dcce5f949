//! The engine for a page: WebAssembly without imports of its own, called with numbers and with bytes.
//!
//! Texts, files and arrays go through two stretches of this memory. Who calls asks for room with `sinew_room`, writes there,
//! and calls the door that reads it. What a door answers lies at `sinew_answer`, up to the next call; every door returns a
//! [`Code`](sinew_embed::Code), and where that is not 0 the answer is the text of the error. After a panic, which ends a call
//! with a trap, the answer is what it said, and nothing more can be called. No address of a caller is ever read, so there is no
//! `unsafe` here but the names of exports.
#![deny(unsafe_code)]

mod page;

use page::Page;
use sinew_embed::Result;
use std::cell::RefCell;

thread_local! {
    static PAGE: RefCell<Page> = RefCell::default();
    /// Kept apart: it is written while the page is in use.
    static ANSWER: RefCell<Vec<u8>> = RefCell::default();
}

/// Runs a door and keeps its answer.
fn with(door: impl FnOnce(&mut Page) -> Result<Vec<u8>>) -> i32 {
    std::panic::set_hook(Box::new(|panic| answer(panic.to_string().into_bytes())));
    let (code, bytes) = match PAGE.with_borrow_mut(door) {
        Ok(bytes) => (0, bytes),
        Err(error) => (error.code as i32, error.text.into_bytes()),
    };
    answer(bytes);
    code
}

fn answer(bytes: Vec<u8>) {
    ANSWER.with(|own| *own.borrow_mut() = bytes);
}

macro_rules! doors {
    ($($(#[$about:meta])* $name:ident = $door:ident($($argument:ident: $type:ty),*);)*) => {$(
        $(#[$about])*
        #[allow(unsafe_code, reason = "the name of an export")]
        #[unsafe(no_mangle)]
        pub extern "C" fn $name($($argument: $type),*) -> i32 {
            with(|page| page.$door($($argument),*))
        }
    )*};
}

/// Address of room for so many bytes, which the next door reads.
#[allow(unsafe_code, reason = "the name of an export")]
#[unsafe(no_mangle)]
pub extern "C" fn sinew_room(bytes: usize) -> *mut u8 {
    PAGE.with_borrow_mut(|page| page.room(bytes).as_mut_ptr())
}

/// Address of the last answer.
#[allow(unsafe_code, reason = "the name of an export")]
#[unsafe(no_mangle)]
pub extern "C" fn sinew_answer() -> *const u8 {
    ANSWER.with_borrow(|answer| answer.as_ptr())
}

/// Bytes of the last answer.
#[allow(unsafe_code, reason = "the name of an export")]
#[unsafe(no_mangle)]
pub extern "C" fn sinew_answer_length() -> usize {
    ANSWER.with_borrow(Vec::len)
}

doors! {
    /// Keeps a file for scenes: its name, a zero byte, what is in it.
    sinew_file = file();
    /// Makes the simulation of a scene; room holds its text. That before is gone.
    sinew_open = open();
    /// Answers names: bodies, constraints, tools, pulls; and the material of every body, as JSON.
    sinew_names = names();
    /// Answers colours, and where the scene at rest stands and ends, as pictures have it; and a ball of this radius (m), as JSON.
    sinew_look = look(radius: f64);
    /// Carries out so many steps.
    sinew_step = step(count: u32);
    /// Answers what the last step did, the reactions of constraints, and the force of the hand, as JSON.
    sinew_report = report();
    /// Answers the hash of the state, sixteen digits.
    sinew_hash = hash();
    /// Answers positions (m) of all points to draw a body by, three `f32` each.
    sinew_points = points(body: u32);
    /// Answers what else is needed to draw a body: numbers of points and triangles and the corners of triangles, 32 bits each,
    /// then a byte for every point: 0 on the outside, and in wounds from 1 on, the deeper the more. It changes when the
    /// revision in `sinew_report` does.
    sinew_surface = surface(body: u32);
    /// Answers where a ray (m) meets a body first, as JSON: body, vertices, weights, place, distance; or `null`.
    sinew_pick = pick(x: f64, y: f64, z: f64, along_x: f64, along_y: f64, along_z: f64);
    /// Takes hold of the place picked last, by a spring (N/m) and a damper (N s/m), letting go of what was held before.
    sinew_pull = pull(stiffness: f64, damping: f64);
    /// Where the hand is at the end of the next step, by how far (m) it moved since it took hold.
    sinew_move = move_hand(x: f64, y: f64, z: f64);
    /// Lets go.
    sinew_release = release();
    /// Moves a tool that the scene does not move: it is there (m) at the end of the next step; at once with `jump` 1.
    sinew_tool = tool(tool: u32, x: f64, y: f64, z: f64, jump: u32);
    /// Cuts a body along what a blade sweeps; room holds its two ends (m), position after position, six `f64` each. Answers
    /// what the cut did, as JSON.
    sinew_cut = cut(body: u32);
    /// Gives a body another Young's modulus (Pa) and Poisson's ratio.
    sinew_material = material(body: u32, young_modulus: f64, poisson_ratio: f64);
    /// Sets the length (s) of the steps to come.
    sinew_dt = set_dt(dt: f64);
    /// Sets the solver; room holds lines as below `[solver]` of a scene, or JSON.
    sinew_solver = set_solver();
}
