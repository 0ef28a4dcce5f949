//! States of a simulation, kept and taken up again.

use super::call::{fill, free, give, guarded, null, sinew_simulation, slice, with};
use super::types::*;
use sinew_embed::Snapshot;
use std::sync::OnceLock;

/// A state of a simulation; it never changes, and any number of threads may use it at once.
pub struct sinew_snapshot {
    own: Snapshot,
    /// Made when they are first asked for: callers ask twice.
    bytes: OnceLock<Vec<u8>>,
}

impl sinew_snapshot {
    fn new(own: Snapshot) -> Self {
        Self { own, bytes: OnceLock::new() }
    }
}

/// Keeps everything that the steps to come depend on, in memory. Free it with `sinew_snapshot_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_snapshot_take(
    simulation: *mut sinew_simulation,
    out: *mut *mut sinew_snapshot,
) -> sinew_status {
    with(simulation, |sim| give(out, || Ok(sinew_snapshot::new(sim.snapshot()?))))
}

/// Takes up a state of this simulation, or of one that was built by the same calls or from the same scene. Handles of what was
/// removed since are good again, those of what was added since are not. Anything else answers `SINEW_SNAPSHOT` and changes
/// nothing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_snapshot_restore(
    simulation: *mut sinew_simulation,
    snapshot: *const sinew_snapshot,
) -> sinew_status {
    let snapshot = snapshot.as_ref();
    let restored = |sim: &mut sinew_embed::Embedding| {
        sim.restore(&snapshot.ok_or_else(|| null("snapshot"))?.own)
    };
    with(simulation, restored)
}

/// A snapshot as bytes, for a file. `needed` says how many they are; `data` may be NULL with capacity 0 to ask.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_snapshot_to_bytes(
    snapshot: *const sinew_snapshot,
    data: *mut u8,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    guarded(|| {
        let snapshot = snapshot.as_ref().ok_or_else(|| null("snapshot"))?;
        let bytes = snapshot.bytes.get_or_init(|| snapshot.own.to_bytes());
        fill(bytes, data, capacity, needed)
    })
}

/// Reads what `sinew_snapshot_to_bytes` gave, in any process. Bytes of anything else answer `SINEW_SNAPSHOT`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_snapshot_from_bytes(
    bytes: *const u8,
    size: usize,
    out: *mut *mut sinew_snapshot,
) -> sinew_status {
    let make = || Snapshot::from_bytes(slice("bytes", bytes, size)?);
    guarded(|| give(out, || Ok(sinew_snapshot::new(make()?))))
}

/// Frees a snapshot. NULL is fine.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_snapshot_free(snapshot: *mut sinew_snapshot) {
    free(snapshot)
}
