//! Reports.

use super::call::{out, sinew_simulation, tell, with};
use super::simulation::fill_text;
use super::types::*;
use std::ffi::c_char;

/// What the last step did, as JSON that ends with a zero byte. `needed` says how many bytes that is; `out` may be NULL with
/// capacity 0 to ask.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_report_json(
    simulation: *const sinew_simulation,
    out: *mut c_char,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with(simulation, |sim| fill_text(sim.report_json(), out, capacity, needed))
}

/// What looks unintended or was repaired in meshes, materials and the scene, then what was not as it should be in the steps
/// that led to the present state: JSON as in `sinew_report_json`, an array of objects with the texts `code`, `level` ("note"
/// or "warning"), `subject`, `message` and `remedy`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_warnings_json(
    simulation: *const sinew_simulation,
    out: *mut c_char,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with(simulation, |sim| fill_text(sim.warnings_json(), out, capacity, needed))
}

/// Why the present state cannot be trusted, although every step was carried out, as far as the steps that led to it tell: the
/// text with which the command `sinew run` fails. Empty, with `needed` 1, where it can be trusted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_verdict(
    simulation: *const sinew_simulation,
    out: *mut c_char,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with(simulation, |sim| fill_text(sim.verdict().unwrap_or_default(), out, capacity, needed))
}

/// Elastic and kinetic energy (J) of the state as it is. Either may be NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_energy(
    simulation: *mut sinew_simulation,
    elastic: *mut f64,
    kinetic: *mut f64,
) -> sinew_status {
    with(simulation, |sim| {
        let energy = sim.energy();
        tell("elastic", elastic, energy.elastic)?;
        tell("kinetic", kinetic, energy.kinetic)
    })
}

/// Hash of displacements and velocities: equal hashes mean equal results to the last bit.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_hash(
    simulation: *mut sinew_simulation,
    hash: *mut u64,
) -> sinew_status {
    with(simulation, |sim| {
        *out("hash", hash)? = sim.hash();
        Ok(())
    })
}
