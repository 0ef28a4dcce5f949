//! Lists that say where each row or block gathers from: what belongs to a row, row after row.

use crate::laws::DeviceElement;

/// Marks a source block that is taken transposed, as in assemble.wgsl.
pub const TRANSPOSED: u32 = 1 << 31;

/// Compressed rows of (row, value) pairs, in the order in which they come.
pub fn compressed<T: Copy + Default, I: Iterator<Item = (u32, T)>>(
    rows: usize,
    entries: impl Fn() -> I,
) -> (Vec<u32>, Vec<T>) {
    let mut starts = vec![0; rows + 1];
    for (row, _) in entries() {
        starts[row as usize + 1] += 1;
    }
    for row in 0..rows {
        starts[row + 1] += starts[row];
    }
    let mut next = starts.clone();
    let mut values = vec![T::default(); starts[rows] as usize];
    for (row, value) in entries() {
        values[next[row as usize] as usize] = value;
        next[row as usize] += 1;
    }
    (starts, values)
}

/// Place of the block of local vertices `a`, `b` among those of an element, marked where it is the transpose.
pub fn block_source(kind: &DeviceElement, a: usize, b: usize) -> u32 {
    if a > b { kind.block(b, a) as u32 | TRANSPOSED } else { kind.block(a, b) as u32 }
}
