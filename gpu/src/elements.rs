//! Elements on the device: chunks that fit the binding limit, each with the lists that bring its forces to
//! vertices and its tangent blocks to the matrix.

use bytemuck::{Pod, Zeroable};
use sinew_adapter::wgpu;

use crate::context::{Context, GROUP, groups_for};
use crate::laws::{self, DeviceLaw, ElementColumns};
use crate::matrix::{Pattern, TRANSPOSED};

/// Bytes of the tangent blocks of a tetrahedron: ten blocks of nine `f32`.
const BLOCK_BYTES: u64 = 360;
/// Bytes of its forces.
const SLOT_BYTES: u64 = 64;
/// Most elements of a chunk, which bounds the work space.
const MAX_CHUNK: u64 = 1 << 19;
/// Most workgroups that sum energies.
const MAX_ENERGY_GROUPS: u32 = 512;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct ChunkUniform {
    count: u32,
    sums: u32,
    accumulate: u32,
    rows: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct GatherUniform {
    entries: u32,
    accumulate: u32,
    padding: [u32; 2],
}

/// Some elements of one law.
pub(crate) struct Chunk {
    pub law: DeviceLaw,
    pub count: u32,
    /// Partial energies it leaves in the sums.
    pub energy_groups: u32,
    pub bind: wgpu::BindGroup,
    pub gather: wgpu::BindGroup,
    /// To each part of the matrix: bind group and number of blocks.
    pub assemble: Vec<(wgpu::BindGroup, wgpu::BindGroup, u32)>,
}

/// All elements of a body.
pub(crate) struct Elements {
    pub chunks: Vec<Chunk>,
    /// Entries of the sums that energies take.
    pub energy_sums: u32,
}

impl Elements {
    /// Elements in a chunk at most.
    pub fn chunk_size(context: &Context, with_matrix: bool) -> usize {
        let bytes = if with_matrix { BLOCK_BYTES } else { SLOT_BYTES };
        (context.binding_limit / bytes).clamp(1, MAX_CHUNK) as usize
    }

    /// Uploads elements. `first_sum` is the first entry of the sums that is theirs, `matrices` the buffers of
    /// values and damping values of the parts.
    pub fn new(
        context: &Context,
        laws: &[(DeviceLaw, ElementColumns)],
        n: u32,
        first_sum: u32,
        pattern: Option<&Pattern>,
    ) -> Self {
        let size = Self::chunk_size(context, pattern.is_some());
        let largest = laws.iter().map(|(_, c)| c.nodes.len().min(size)).max().unwrap_or(0) as u64;
        let slots = context.storage("forces of elements", SLOT_BYTES * largest);
        let block_bytes = if pattern.is_some() { BLOCK_BYTES * largest } else { 0 };
        let blocks = context.storage("tangents of elements", block_bytes);
        let mut sums = first_sum;
        let mut chunks = Vec::new();
        for (law, columns) in laws {
            for (nodes, data) in columns.nodes.chunks(size).zip(columns.data.chunks(size)) {
                let energy_groups = (nodes.len() as u32).div_ceil(GROUP).min(MAX_ENERGY_GROUPS);
                let uniform = ChunkUniform {
                    count: nodes.len() as u32,
                    sums,
                    accumulate: u32::from(!chunks.is_empty()),
                    rows: n,
                };
                let uniform = context.uniform("chunk", &uniform);
                let node_buffer = context.filled("nodes", nodes);
                let data = context.filled("constants of elements", data);
                let (starts, sources) = force_lists(nodes, n);
                let starts = context.filled("starts", &starts);
                let sources = context.filled("slots of vertices", &sources);
                let assemble = pattern.map_or(Vec::new(), |pattern| {
                    let parts = pattern.parts.iter().map(|part| {
                        let (starts, sources) = pattern.block_lists(part, nodes);
                        let uniform = GatherUniform {
                            entries: part.entries,
                            accumulate: u32::from(!chunks.is_empty()),
                            padding: [0; 2],
                        };
                        let uniform = context.uniform("gather", &uniform);
                        let starts = context.filled("starts", &starts);
                        let sources = context.filled("blocks of entries", &sources);
                        let bind = |values: &wgpu::Buffer| {
                            let buffers = [&uniform, &blocks, &starts, &sources, values];
                            context.bind(&context.layouts.assemble, &buffers)
                        };
                        (bind(&part.values), bind(&part.damping), part.entries)
                    });
                    parts.collect()
                });
                let bind = [&uniform, &node_buffer, &data, &slots, &blocks];
                let gather = [&uniform, &slots, &starts, &sources];
                chunks.push(Chunk {
                    law: *law,
                    count: nodes.len() as u32,
                    energy_groups,
                    bind: context.bind(&context.layouts.chunk, &bind),
                    gather: context.bind(&context.layouts.gather, &gather),
                    assemble,
                });
                sums += energy_groups;
            }
        }
        Self { chunks, energy_sums: sums - first_sum }
    }

    /// Energies at the point of evaluation into the sums. Here and below a recovering body has the
    /// corotational energy in place of its own.
    pub fn energies(
        &self,
        context: &Context,
        recovering: bool,
        rows: &wgpu::BindGroup,
        pass: &mut wgpu::ComputePass<'_>,
    ) {
        pass.set_bind_group(0, rows, &[]);
        for chunk in &self.chunks {
            pass.set_pipeline(&chunk.kernel(context, recovering, "energies"));
            pass.set_bind_group(1, &chunk.bind, &[]);
            pass.dispatch_workgroups(chunk.energy_groups, 1, 1);
        }
    }

    /// Forces at the point of evaluation.
    pub fn forces(
        &self,
        context: &Context,
        recovering: bool,
        rows: &wgpu::BindGroup,
        n: u32,
        pass: &mut wgpu::ComputePass<'_>,
    ) {
        let layouts = [&context.layouts.rows, &context.layouts.gather];
        let gather = context.pipeline("gather", crate::sources::gather, "gather_forces", &layouts);
        pass.set_bind_group(0, rows, &[]);
        for chunk in &self.chunks {
            pass.set_pipeline(&chunk.kernel(context, recovering, "forces"));
            pass.set_bind_group(1, &chunk.bind, &[]);
            let [x, y] = groups_for(u64::from(chunk.count));
            pass.dispatch_workgroups(x, y, 1);
            pass.set_pipeline(&gather);
            pass.set_bind_group(1, &chunk.gather, &[]);
            let [x, y] = groups_for(u64::from(n));
            pass.dispatch_workgroups(x, y, 1);
        }
    }

    /// Tangent at the point of evaluation into the values of the parts, or into those of the damping.
    pub fn tangent(
        &self,
        context: &Context,
        recovering: bool,
        rows: &wgpu::BindGroup,
        damping: bool,
        pass: &mut wgpu::ComputePass<'_>,
    ) {
        let layouts = [&context.layouts.assemble];
        let assemble =
            context.pipeline("assemble", crate::sources::assemble, "gather_blocks", &layouts);
        for chunk in &self.chunks {
            pass.set_bind_group(0, rows, &[]);
            pass.set_pipeline(&chunk.kernel(context, recovering, "tangents"));
            pass.set_bind_group(1, &chunk.bind, &[]);
            let [x, y] = groups_for(u64::from(chunk.count));
            pass.dispatch_workgroups(x, y, 1);
            pass.set_pipeline(&assemble);
            for (values, damping_values, entries) in &chunk.assemble {
                pass.set_bind_group(0, if damping { damping_values } else { values }, &[]);
                let [x, y] = groups_for(9 * u64::from(*entries));
                pass.dispatch_workgroups(x, y, 1);
            }
        }
    }
}

impl Chunk {
    fn kernel(
        &self,
        context: &Context,
        recovering: bool,
        entry: &'static str,
    ) -> wgpu::ComputePipeline {
        let layouts = [&context.layouts.rows, &context.layouts.chunk];
        // all laws have the same columns
        let law = if recovering { laws::corotational::LAW } else { self.law };
        context.pipeline(law.name, || law.source(), entry, &layouts)
    }
}

/// Slots of the elements round each of `n` vertices, in the order of the elements: starts and slots.
fn force_lists(nodes: &[[u32; 4]], n: u32) -> (Vec<u32>, Vec<u32>) {
    let entries = || nodes.iter().flatten().copied().zip(0..);
    compressed(n as usize, entries)
}

/// Compressed rows of (row, value) pairs, in the order in which they come.
pub(crate) fn compressed<I: Iterator<Item = (u32, u32)>>(
    rows: usize,
    entries: impl Fn() -> I,
) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0; rows + 1];
    for (row, _) in entries() {
        starts[row as usize + 1] += 1;
    }
    for row in 0..rows {
        starts[row + 1] += starts[row];
    }
    let mut next = starts.clone();
    let mut values = vec![0; starts[rows] as usize];
    for (row, value) in entries() {
        values[next[row as usize] as usize] = value;
        next[row as usize] += 1;
    }
    (starts, values)
}

/// Place of the block of local vertices `a`, `b` among the ten blocks of a tetrahedron.
pub(crate) fn block_source(a: usize, b: usize) -> u32 {
    const OFF: [[u32; 4]; 4] = [[0, 4, 5, 6], [4, 1, 7, 8], [5, 7, 2, 9], [6, 8, 9, 3]];
    if a > b { OFF[a][b] | TRANSPOSED } else { OFF[a][b] }
}
