//! How much memory there is, asked before much of it is taken: a mesh that does not fit is refused with its
//! size, in place of an abort in the middle of it.

use crate::element_kind::ByKind;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Environment variable with the most memory (bytes) to use, such as `4000000000`; by default what the machine
/// has left.
pub const VARIABLE: &str = "SINEW_MEMORY_LIMIT";

/// More memory is needed than there is.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{what} needs about {} and {} are free; use fewer elements, or raise the limit ({VARIABLE}, ulimit)",
    readable(*.needed),
    readable(*.free)
)]
pub struct TooLarge {
    /// What needs it.
    pub what: String,
    /// Estimate (bytes).
    pub needed: u64,
    /// What is free (bytes).
    pub free: u64,
}

fn readable(bytes: u64) -> String {
    let mib = bytes as f64 / f64::from(1 << 20);
    if mib < 1024.0 { format!("{mib:.0} MiB") } else { format!("{:.1} GiB", mib / 1024.0) }
}

/// Memory (bytes) that may still be taken: [`VARIABLE`], or what the machine says is available, and no more than
/// the limit of the process allows. `None` where nobody says.
pub fn free() -> Option<u64> {
    let own = std::env::var(VARIABLE).ok().and_then(|bytes| bytes.trim().parse().ok());
    let machine = || line_of("/proc/meminfo", "MemAvailable:").map(|kib| kib * 1024);
    let limit = line_of("/proc/self/limits", "Max address space").map(|limit| {
        let used = line_of("/proc/self/status", "VmSize:").unwrap_or(0) * 1024;
        limit.saturating_sub(used)
    });
    [own.or_else(machine), limit].into_iter().flatten().min()
}

/// First number of the line that begins with `name`; none where it is "unlimited".
fn line_of(file: &str, name: &str) -> Option<u64> {
    let text = std::fs::read_to_string(file).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse().ok()
}

/// Refuses what needs more memory than there is.
///
/// # Errors
/// When `needed` (bytes) is more than [`free`].
///
/// ```
/// use sinew_engine::memory::fits;
/// assert!(fits("a small body", || 1000).is_ok());
/// let error = fits("a body of 1e12 tetrahedra", || 1500 * 1_000_000_000_000).unwrap_err();
/// assert!(error.to_string().starts_with("a body of 1e12 tetrahedra needs about 1396983"));
/// ```
pub fn fits(what: &str, needed: impl FnOnce() -> u64) -> Result<(), TooLarge> {
    const SMALL: u64 = 64 << 20;
    let needed = needed();
    // not worth asking
    if needed < SMALL {
        return Ok(());
    }
    match free() {
        Some(free) if needed > free => Err(TooLarge { what: what.to_string(), needed, free }),
        _ => Ok(()),
    }
}

/// Memory (bytes) that a body takes while it is built and simulated, by its numbers of elements, and how many of the tetrahedra are of second order: measured per element, with
/// matrices and preconditioner.
pub fn of_body(counts: &ByKind<usize>, second_order: usize) -> u64 {
    10_000 * second_order as u64
        + 1500 * counts.tetrahedra as u64
        + 6000 * counts.hexahedra as u64
        + 600 * (counts.triangles + 2 * counts.quads) as u64
}

/// Reads a file that is one: not a folder, a pipe or a device, and no larger than fits into the memory three times.
///
/// # Errors
/// As [`std::fs::read`], and when it is none of that.
pub fn read_file(path: &Path) -> io::Result<Vec<u8>> {
    let about = std::fs::metadata(path)?;
    if !about.is_file() {
        let kind = if about.is_dir() { "a folder" } else { "no regular file" };
        return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("it is {kind}")));
    }
    let size = about.len();
    fits("reading it", || 3 * size)
        .map_err(|error| io::Error::new(io::ErrorKind::FileTooLarge, error))?;
    let mut bytes = Vec::new();
    bytes
        .try_reserve_exact(usize::try_from(size).unwrap_or(usize::MAX))
        .map_err(io::Error::other)?;
    // a file may grow meanwhile
    File::open(path)?.take(size).read_to_end(&mut bytes)?;
    Ok(bytes)
}
