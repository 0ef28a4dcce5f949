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
