//! Elements on the device: chunks that fit the binding limit, each with the lists that bring its forces to
//! vertices and its tangent blocks to the matrix.

use bytemuck::{Pod, Zeroable};
use sinew_adapter::wgpu;

use crate::context::{Context, GROUP, groups_for};
use crate::laws::{self, DeviceLaw, ElementColumns, ElementKind};
use crate::matrix::{Pattern, TRANSPOSED};

/// Bytes of a tangent block of nine `f32`.
const BLOCK_BYTES: u64 = 36;
/// Bytes of a force.
const SLOT_BYTES: u64 = 16;
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
    fn chunk_size(context: &Context, kind: ElementKind, with_matrix: bool) -> usize {
        let [slots, blocks] = work_bytes(kind);
        let bytes = if with_matrix { blocks } else { slots };
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
        let with_matrix = pattern.is_some();
        let size = |law: &DeviceLaw| Self::chunk_size(context, law.kind, with_matrix);
        let largest = |k: usize| {
            let bytes = laws.iter().map(|(law, columns)| {
                let count = (columns.nodes.len() / law.kind.vertices()).min(size(law));
                count as u64 * work_bytes(law.kind)[k]
            });
            bytes.max().unwrap_or(0)
        };
        let slots = context.storage("forces of elements", largest(0));
        let block_bytes = if with_matrix { largest(1) } else { 0 };
        let blocks = context.storage("tangents of elements", block_bytes);
        let mut sums = first_sum;
        let mut chunks = Vec::new();
        for (law, columns) in laws {
            let kind = law.kind;
            let nodes = columns.nodes.chunks(size(law) * kind.vertices());
            for (nodes, data) in nodes.zip(columns.data.chunks(size(law) * kind.constants())) {
                let count = (nodes.len() / kind.vertices()) as u32;
                let energy_groups = count.div_ceil(GROUP).min(MAX_ENERGY_GROUPS);
                let uniform = ChunkUniform {
                    count,
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
                        let (starts, sources) = pattern.block_lists(part, kind, nodes);
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
                    count,
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

    /// Vertices of the largest element, which bound the eigenvalues of a sum of element matrices against its diagonal
    /// blocks: each matrix lies below as many times its own diagonal as it has vertices.
    pub fn most_vertices(&self) -> f64 {
        self.chunks.iter().map(|chunk| chunk.law.kind.vertices()).max().unwrap_or(1) as f64
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

    /// Number of elements if all are tetrahedra: then volume ratios can be had here.
    pub fn tetrahedra(&self) -> Option<u64> {
        let all = self.chunks.iter().all(|chunk| chunk.law.kind == ElementKind::Tetrahedron);
        all.then(|| self.chunks.iter().map(|chunk| u64::from(chunk.count)).sum())
    }

    /// Smallest volume ratio and inverted elements at the point of evaluation, into the places of the energies; of
    /// bodies of tetrahedra only.
    pub fn volumes(
        &self,
        context: &Context,
        rows: &wgpu::BindGroup,
        pass: &mut wgpu::ComputePass<'_>,
    ) {
        pass.set_bind_group(0, rows, &[]);
        for chunk in &self.chunks {
            pass.set_pipeline(&chunk.kernel(context, false, "volumes"));
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
        // laws of tetrahedra have the same columns; springs stay what they are, as on the CPU
        let recovering = recovering && self.law.kind == ElementKind::Tetrahedron;
        let law = if recovering { laws::corotational::LAW } else { self.law };
        context.pipeline(law.name, || law.source(), entry, &layouts)
    }
}

/// Bytes of the forces of an element, and of its tangent blocks.
fn work_bytes(kind: ElementKind) -> [u64; 2] {
    [SLOT_BYTES * kind.vertices() as u64, BLOCK_BYTES * kind.blocks() as u64]
}

/// Slots of the elements round each of `n` vertices, in the order of the elements: starts and slots.
fn force_lists(nodes: &[u32], n: u32) -> (Vec<u32>, Vec<u32>) {
    compressed(n as usize, || nodes.iter().copied().zip(0..))
}

/// Compressed rows of (row, value) pairs, in the order in which they come.
pub(crate) fn compressed<T: Copy + Default, I: Iterator<Item = (u32, T)>>(
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

/// Place of the block of local vertices `a`, `b` among those of an element: first the vertices, then the pairs.
pub(crate) fn block_source(kind: ElementKind, a: usize, b: usize) -> u32 {
    const TETRAHEDRON: [[u32; 4]; 4] = [[0, 4, 5, 6], [4, 1, 7, 8], [5, 7, 2, 9], [6, 8, 9, 3]];
    const EDGE: [[u32; 2]; 2] = [[0, 2], [2, 1]];
    let place = match kind {
        ElementKind::Tetrahedron => TETRAHEDRON[a][b],
        ElementKind::Edge => EDGE[a][b],
    };
    if a > b { place | TRANSPOSED } else { place }
}
