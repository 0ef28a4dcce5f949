//! The block matrix of a body: the tangent is assembled, all 3x3 blocks of a row side by side, diagonal
//! included.
//!
//! Assembled and not matrix-free, by what has to be moved per product: the matrix has about 15 blocks of 36 bytes
//! a vertex row, 100 bytes a tetrahedron; element by element a product reads at least 64 bytes of constants and
//! vertices and writes and gathers 2 x 64 bytes of forces, and computes ten times as much. The assembly costs
//! some four products and there are tens of products for each; it also gives the diagonal blocks that the
//! preconditioner needs and serves projected tangents and damping alike.

use bytemuck::{Pod, Zeroable};
use sinew_adapter::wgpu;

use crate::context::{Context, GROUP, Pass, groups_for};
use crate::laws::DeviceElement;
use crate::lists::{TRANSPOSED, block_source, compressed};

/// Bytes of a block.
const BLOCK_BYTES: u64 = 36;
/// Most workgroups of kernels that sum.
pub const MAX_GROUPS: u32 = 512;
/// Most workgroups of products, which are the longest kernels of a step.
const MAX_PRODUCT_GROUPS: u32 = 1024;
/// Rows that a workgroup of a product works on at a time: four threads each, as in matrix.wgsl.
const GROUP_ROWS: u32 = GROUP / 4;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct PartUniform {
    first: u32,
    count: u32,
    partial: u32,
    groups: u32,
}

/// A range of rows whose values fit a binding.
pub struct MatrixPart {
    pub first: u32,
    pub count: u32,
    pub groups: u32,
    /// Blocks.
    pub entries: u32,
    pub values: wgpu::Buffer,
    pub damping: wgpu::Buffer,
    /// For products with the system, and with the damping matrix.
    system: wgpu::BindGroup,
    damping_bind: wgpu::BindGroup,
    uniform: wgpu::Buffer,
    row_start: wgpu::Buffer,
    pub columns: wgpu::Buffer,
}

/// Which blocks there are, and the parts.
pub struct MatrixPattern {
    row_start: Vec<u32>,
    columns: Vec<u32>,
    pub parts: Vec<MatrixPart>,
    /// Partial sums that a product leaves.
    pub groups: u32,
}

impl MatrixPattern {
    /// From the edges of a body, in rows relative to its first, lower first.
    pub fn new(
        context: &Context,
        n: u32,
        edges: impl Iterator<Item = [u32; 2]> + Clone,
        damping: bool,
    ) -> Self {
        let pairs = || {
            let both = edges.clone().flat_map(|[a, b]| [(a, b), (b, a)]);
            both.chain((0..n).map(|i| (i, i)))
        };
        let (row_start, mut columns) = compressed(n as usize, pairs);
        for row in 0..n as usize {
            columns[row_start[row] as usize..row_start[row + 1] as usize].sort_unstable();
        }
        let limit = (context.binding_limit / BLOCK_BYTES) as u32;
        let mut parts = Vec::new();
        let (mut first, mut partial) = (0, 0);
        while first < n {
            // at least one row, which no limit of an adapter comes near
            let within = |row: &u32| row_start[*row as usize] - row_start[first as usize] <= limit;
            let end = (first + 2..=n).take_while(within).last().unwrap_or(first + 1);
            let groups = (end - first).div_ceil(GROUP_ROWS);
            let share =
                (u64::from(MAX_PRODUCT_GROUPS) * u64::from(end - first)).div_ceil(u64::from(n));
            let groups = groups.min(share as u32).max(1);
            let own = row_start[first as usize]..row_start[end as usize];
            let starts: Vec<u32> = row_start[first as usize..=end as usize]
                .iter()
                .map(|start| start - own.start)
                .collect();
            let entries = own.end - own.start;
            let bytes = BLOCK_BYTES * u64::from(entries);
            let values = context.storage("matrix", bytes);
            let damping = context.storage("damping matrix", if damping { bytes } else { 0 });
            let uniform = PartUniform { first, count: end - first, partial, groups };
            let uniform = context.uniform("part", &uniform);
            let starts = context.filled("row starts", &starts);
            let own_columns = &columns[own.start as usize..own.end as usize];
            let own_columns = context.filled("columns", own_columns);
            let bind = |values| {
                context.bind(&context.layouts.part, &[&uniform, &starts, &own_columns, values])
            };
            parts.push(MatrixPart {
                first,
                count: end - first,
                groups,
                entries,
                system: bind(&values),
                damping_bind: bind(&damping),
                values,
                damping,
                uniform,
                row_start: starts,
                columns: own_columns,
            });
            first = end;
            partial += groups;
        }
        Self { row_start, columns, parts, groups: partial }
    }

    /// Columns of a row, ascending.
    pub fn row(&self, row: usize) -> &[u32] {
        &self.columns[self.row_start[row] as usize..self.row_start[row + 1] as usize]
    }

    /// Bytes of the values.
    pub fn bytes(&self) -> u64 {
        BLOCK_BYTES * self.columns.len() as u64
    }

    /// For every block of a part the blocks of the elements that make it up, in the order of the elements.
    pub fn block_lists(
        &self,
        part: &MatrixPart,
        kind: &DeviceElement,
        nodes: &[u32],
    ) -> (Vec<u32>, Vec<u32>) {
        let rows = part.first..part.first + part.count;
        let first_entry = self.row_start[part.first as usize];
        let mut found = Vec::new();
        let per_element = kind.blocks() as u32;
        for (element, nodes) in (0..).zip(nodes.chunks_exact(kind.vertices)) {
            for (a, &row) in nodes.iter().enumerate().filter(|(_, row)| rows.contains(row)) {
                let from = self.row_start[row as usize];
                let own = self.row(row as usize);
                for (b, column) in nodes.iter().enumerate() {
                    // the edge graph holds all pairs of an element
                    let at = own.binary_search(column).expect("pair of an element in the graph");
                    let source = block_source(kind, a, b);
                    let block =
                        (per_element * element + (source & !TRANSPOSED)) | (source & TRANSPOSED);
                    found.push((from + at as u32 - first_entry, block));
                }
            }
        }
        compressed(part.entries as usize, || found.iter().copied())
    }

    /// Bind groups that turn the tangent of each part into the system.
    pub fn shifts(
        &self,
        context: &Context,
        step: &wgpu::Buffer,
        vertices: &wgpu::Buffer,
        rows: &wgpu::Buffer,
    ) -> Vec<(wgpu::BindGroup, u32)> {
        let bind = |part: &MatrixPart| {
            let (starts, columns) = (&part.row_start, &part.columns);
            let (values, damping) = (&part.values, &part.damping);
            let buffers = [step, &part.uniform, vertices, starts, columns, values, damping, rows];
            (context.bind(&context.layouts.shift, &buffers), part.count)
        };
        self.parts.iter().map(bind).collect()
    }

    /// Product with the system, or with the damping matrix.
    pub fn product(
        &self,
        solver: &wgpu::BindGroup,
        entry: &'static str,
        damping: bool,
        pass: &mut Pass<'_>,
    ) {
        let kernel = pass.context.matrix_kernel(entry);
        for part in &self.parts {
            let values = if damping { &part.damping_bind } else { &part.system };
            pass.run(&kernel, &[solver, values], [part.groups, 1]);
        }
    }
}

/// Tangent to system, with the inverse diagonal blocks.
pub fn shift(shifts: &[(wgpu::BindGroup, u32)], pass: &mut Pass<'_>) {
    let layouts = [&pass.context.layouts.shift];
    let kernel = pass.context.kernel("shift", "shift", &layouts);
    for (bind, count) in shifts {
        pass.run(&kernel, &[bind], groups_for(u64::from(*count)));
    }
}
