//! Elements on the device: chunks that fit the binding limit, each with the lists that bring its forces to
//! vertices and its tangent blocks to the matrix.

use bevy_ecs::entity::Entity;
use bytemuck::{Pod, Zeroable};
use sinew_adapter::wgpu;
use sinew_engine::law::TangentKind;
use std::ops::Range;

use crate::context::{Context, GROUP, Pass, groups_for};
use crate::laws::{DeviceElement, DeviceLaw, ElementColumns};
use crate::lists::compressed;
use crate::matrix::MatrixPattern;

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
    rows: u32,
    factor: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct GatherUniform {
    entries: u32,
    padding: [u32; 3],
}

/// Some elements of one law.
pub struct Chunk {
    pub law: DeviceLaw,
    pub count: u32,
    /// Workgroups of passes over its elements.
    threads: [u32; 2],
    uniform: (wgpu::Buffer, ChunkUniform),
    /// Constants of the elements.
    data: wgpu::Buffer,
    /// Partial energies it leaves in the sums.
    pub energy_groups: u32,
    pub bind: wgpu::BindGroup,
    pub gather: wgpu::BindGroup,
    /// To each part of the matrix: bind group and number of blocks.
    pub assemble: Vec<(wgpu::BindGroup, wgpu::BindGroup, u32)>,
}

/// Energies (J) of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyEnergies {
    /// Stored in its elements.
    pub elastic: f64,
    /// Potential of the loads that are laws.
    pub load: f64,
}

impl BodyEnergies {
    /// What solvers minimise.
    pub fn total(&self) -> f64 {
        self.elastic + self.load
    }
}

/// The elements of one law, or of one load that is a law.
struct Set {
    law: &'static str,
    load: Option<Entity>,
    nodes: Vec<u32>,
    chunks: Range<usize>,
}

/// All elements of a body, chunk by chunk in the order of their laws.
pub struct DeviceElements {
    pub chunks: Vec<Chunk>,
    rows: u32,
    sets: Vec<Set>,
    /// Entries of the sums that energies take.
    pub energy_sums: u32,
    /// Those of them that are potentials of loads.
    load_sums: Range<usize>,
    /// Vertex rows on which loads that are laws act.
    pub loaded_rows: Vec<u32>,
    /// Rayleigh damping of the step (s).
    stiffness_damping: f64,
}

impl DeviceElements {
    /// Elements in a chunk at most.
    fn chunk_size(context: &Context, kind: DeviceElement, with_matrix: bool) -> usize {
        let [slots, blocks] = work_bytes(&kind);
        let bytes = slots.max(4 * kind.constants as u64);
        let bytes = if with_matrix { bytes.max(blocks) } else { bytes };
        (context.binding_limit / bytes).clamp(1, MAX_CHUNK) as usize
    }

    /// Uploads elements. `first_sum` is the first entry of the sums that is theirs, `matrices` the buffers of
    /// values and damping values of the parts.
    pub fn new(
        context: &Context,
        laws: &[(DeviceLaw, ElementColumns)],
        n: u32,
        first_sum: u32,
        pattern: Option<&MatrixPattern>,
    ) -> Self {
        let with_matrix = pattern.is_some();
        let size = |law: &DeviceLaw| Self::chunk_size(context, law.kind, with_matrix);
        let largest = |k: usize| {
            let bytes = laws.iter().map(|(law, columns)| {
                let count = (columns.nodes.len() / law.kind.vertices).min(size(law));
                count as u64 * work_bytes(&law.kind)[k]
            });
            bytes.max().unwrap_or(0)
        };
        // work space that all chunks share
        let slots = context.storage("forces of elements", largest(0));
        let block_bytes = if with_matrix { largest(1) } else { 0 };
        let blocks = context.storage("tangents of elements", block_bytes);
        let mut sums = first_sum;
        let mut chunks = Vec::new();
        let mut sets = Vec::with_capacity(laws.len());
        // elements, cut into chunks, with their lists
        for (law, columns) in laws {
            let kind = &law.kind;
            let first_chunk = chunks.len();
            let nodes = columns.nodes.chunks(size(law) * kind.vertices);
            for (nodes, data) in nodes.zip(columns.data.chunks(size(law) * kind.constants)) {
                let count = (nodes.len() / kind.vertices) as u32;
                let threads = u64::from(count) * kind.threads as u64;
                let most = u64::from(MAX_ENERGY_GROUPS);
                let energy_groups = threads.div_ceil(u64::from(GROUP)).min(most) as u32;
                let values = ChunkUniform { count, sums, rows: n, factor: 0.0 };
                let uniform = context.uniform("chunk", &values);
                let node_buffer = context.filled("nodes", nodes);
                let data = context.filled("constants of elements", data);
                let (starts, sources) = force_lists(nodes, n);
                let starts = context.filled("starts", &starts);
                let sources = context.filled("slots of vertices", &sources);
                let assemble = pattern.map_or(Vec::new(), |pattern| {
                    let parts = pattern.parts.iter().map(|part| {
                        let (starts, sources) = pattern.block_lists(part, kind, nodes);
                        let uniform = GatherUniform { entries: part.entries, padding: [0; 3] };
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
                    threads: groups_for(threads),
                    energy_groups,
                    bind: context.bind(&context.layouts.chunk, &bind),
                    gather: context.bind(&context.layouts.gather, &gather),
                    assemble,
                    uniform: (uniform, values),
                    data,
                });
                sums += energy_groups;
            }
            sets.push(Set {
                law: law.name(),
                load: columns.load,
                nodes: columns.nodes.clone(),
                chunks: first_chunk..chunks.len(),
            });
        }
        // which sums and rows belong to loads
        let energies = |chunks: &[Chunk]| chunks.iter().map(|c| c.energy_groups as usize).sum();
        let is_load = |chunk: &Chunk| chunk.law.is_load();
        let start = chunks.iter().position(is_load).unwrap_or(chunks.len());
        let end = chunks.iter().rposition(is_load).map_or(start, |last| last + 1);
        let load_sums = energies(&chunks[..start])..energies(&chunks[..end]);
        let loads = laws.iter().filter(|(law, _)| law.is_load());
        let mut loaded_rows: Vec<_> =
            loads.flat_map(|(_, columns)| &columns.nodes).copied().collect();
        loaded_rows.sort_unstable();
        loaded_rows.dedup();
        Self {
            chunks,
            rows: n,
            sets,
            energy_sums: sums - first_sum,
            load_sums,
            loaded_rows,
            stiffness_damping: 0.0,
        }
    }

    /// Whether these are all elements of the laws `names`, as they were uploaded but for their constants.
    pub fn serve(&self, names: &[&str], laws: &[(DeviceLaw, ElementColumns)]) -> bool {
        let own = self.sets.iter().filter(|set| names.contains(&set.law));
        own.map(|set| (set.law, set.load, &set.nodes))
            .eq(laws.iter().map(|(law, columns)| (law.name(), columns.load, &columns.nodes)))
    }

    /// Uploads the constants of elements that [`serve`](Self::serve).
    pub fn write(&self, context: &Context, laws: &[(DeviceLaw, ElementColumns)]) {
        for (law, columns) in laws {
            let of = |set: &&Set| set.law == law.name() && set.load == columns.load;
            let Some(set) = self.sets.iter().find(of) else { continue };
            let mut data = &columns.data[..];
            for chunk in &self.chunks[set.chunks.clone()] {
                let (own, rest) = data.split_at(chunk.count as usize * law.kind.constants);
                context.write(&chunk.data, 0, own);
                data = rest;
            }
        }
    }

    /// Makes `value` the factor of the elements of a load.
    pub fn set_factor(&mut self, context: &Context, load: Entity, value: f32) {
        for set in self.sets.iter().filter(|set| set.load == Some(load)) {
            for chunk in &mut self.chunks[set.chunks.clone()] {
                chunk.set_factor(context, value);
            }
        }
    }

    /// Takes note of the stiffness damping (s): dampers are divided by it, since the whole damping matrix is
    /// multiplied by it. Without it the matrix is that of the dampers.
    pub fn set_stiffness_damping(&mut self, context: &Context, value: f64) {
        self.stiffness_damping = value;
        let factor = if value > 0.0 { (1.0 / value) as f32 } else { 1.0 };
        for chunk in self.chunks.iter_mut().filter(|chunk| chunk.law.row.is_damper) {
            chunk.set_factor(context, factor);
        }
    }

    /// What the damping matrix has to be multiplied by (s); 0 where there is no damping.
    pub fn damping_factor(&self) -> f64 {
        let dampers = self.chunks.iter().any(|chunk| chunk.law.row.is_damper);
        if self.stiffness_damping > 0.0 { self.stiffness_damping } else { f64::from(dampers) }
    }

    /// Whether loads are among the elements.
    pub fn has_loads(&self) -> bool {
        !self.load_sums.is_empty()
    }

    /// Elastic energy and potential of loads (J) from what a pass left.
    pub fn sum_energies(&self, sums: &[[f32; 4]]) -> BodyEnergies {
        let add = |part: &[[f32; 4]]| part.iter().map(|sum| f64::from(sum[0])).sum::<f64>();
        let Range { start, end } = self.load_sums;
        let elastic = add(&sums[..start]) + add(&sums[end..]);
        BodyEnergies { elastic, load: add(&sums[start..end]) }
    }

    /// Vertices of the largest element, which bound the eigenvalues of a sum of element matrices against its diagonal
    /// blocks: each matrix lies below as many times its own diagonal as it has vertices.
    pub fn most_vertices(&self) -> f64 {
        self.chunks.iter().map(|chunk| chunk.law.kind.vertices).max().unwrap_or(1) as f64
    }

    /// Energies at the point of evaluation into the sums. Here and below laws of a recovering body give way to
    /// the corotational energy.
    pub fn energies(&self, recovering: bool, rows: &wgpu::BindGroup, pass: &mut Pass<'_>) {
        for chunk in &self.chunks {
            let kernel = match chunk.law.now(recovering).filter(|law| law.row.forces) {
                Some(law) => kernel(pass.context, law, "energies"),
                None => silence(pass.context, "no_energies"),
            };
            pass.run(&kernel, &[rows, &chunk.bind], [chunk.energy_groups, 1]);
        }
    }

    /// Smallest volume ratio and inverted elements at the point of evaluation, into the places of the energies.
    pub fn volumes(&self, rows: &wgpu::BindGroup, pass: &mut Pass<'_>) {
        for chunk in &self.chunks {
            let kernel = if chunk.law.volumes {
                kernel(pass.context, &chunk.law, "volumes")
            } else {
                silence(pass.context, "no_volumes")
            };
            pass.run(&kernel, &[rows, &chunk.bind], [chunk.energy_groups, 1]);
        }
    }

    /// Elements whose volume ratios are measured.
    pub fn solid_elements(&self) -> u64 {
        let solid = self.chunks.iter().filter(|chunk| chunk.law.volumes);
        solid.map(|chunk| u64::from(chunk.count)).sum()
    }

    /// Forces at the point of evaluation.
    pub fn forces(&self, recovering: bool, rows: &wgpu::BindGroup, pass: &mut Pass<'_>) {
        let mut first = true;
        for chunk in &self.chunks {
            let Some(law) = chunk.law.now(recovering).filter(|law| law.row.forces) else {
                continue;
            };
            chunk.run(law, "forces", rows, pass);
            self.gather(chunk, if first { "gather_forces" } else { "add_forces" }, rows, pass);
            first = false;
        }
        if let Some(chunk) = self.chunks.first().filter(|_| first) {
            self.gather(chunk, "no_forces", rows, pass);
        }
    }

    /// Slots of a chunk to vertex rows.
    fn gather(
        &self,
        chunk: &Chunk,
        entry: &'static str,
        rows: &wgpu::BindGroup,
        pass: &mut Pass<'_>,
    ) {
        let layouts = [&pass.context.layouts.rows, &pass.context.layouts.gather];
        let kernel = pass.context.kernel("gather", entry, &layouts);
        pass.run(&kernel, &[rows, &chunk.gather], groups_for(u64::from(self.rows)));
    }

    /// Tangent at the point of evaluation, of the kind in the uniform, into the values of the parts, or into
    /// those of the damping.
    pub fn tangent(
        &self,
        recovering: bool,
        rows: &wgpu::BindGroup,
        (kind, damping): (TangentKind, bool),
        pass: &mut Pass<'_>,
    ) {
        let assemble = |chunk: &Chunk, entry, pass: &mut Pass<'_>| {
            let layouts = [&pass.context.layouts.assemble];
            let kernel = pass.context.kernel("assemble", entry, &layouts);
            for (values, damping_values, entries) in &chunk.assemble {
                let values = if damping { damping_values } else { values };
                pass.run(&kernel, &[values], groups_for(9 * u64::from(*entries)));
            }
        };
        let (mut first, mut first_load) = (true, true);
        for chunk in &self.chunks {
            let takes_part = |law: &&DeviceLaw| {
                let elastic = !damping || self.stiffness_damping > 0.0;
                law.row.is_damper && damping || elastic && law.has_tangent(kind)
            };
            let Some(law) = chunk.law.now(recovering).filter(takes_part) else { continue };
            if law.is_load() {
                chunk.run(law, "row_sums", rows, pass);
                let entry = if first_load { "gather_row_sums" } else { "add_row_sums" };
                self.gather(chunk, entry, rows, pass);
                first_load = false;
            }
            chunk.run(law, "tangents", rows, pass);
            assemble(chunk, if first { "gather_blocks" } else { "add_blocks" }, pass);
            first = false;
        }
        if let Some(chunk) = self.chunks.first().filter(|_| first) {
            assemble(chunk, "no_blocks", pass);
        }
    }
}

fn kernel(context: &Context, law: &DeviceLaw, entry: &'static str) -> wgpu::ComputePipeline {
    let layouts = [&context.layouts.rows, &context.layouts.chunk];
    context.pipeline(law.name(), || law.source(), entry, &layouts)
}

fn silence(context: &Context, entry: &'static str) -> wgpu::ComputePipeline {
    let layouts = [&context.layouts.rows, &context.layouts.chunk];
    context.kernel("silence", entry, &layouts)
}

impl Chunk {
    fn set_factor(&mut self, context: &Context, value: f32) {
        let (buffer, values) = &mut self.uniform;
        if values.factor != value {
            values.factor = value;
            context.write(buffer, 0, &[*values]);
        }
    }

    /// A pass over the elements by a law.
    fn run(
        &self,
        law: &DeviceLaw,
        entry: &'static str,
        rows: &wgpu::BindGroup,
        pass: &mut Pass<'_>,
    ) {
        pass.run(&kernel(pass.context, law, entry), &[rows, &self.bind], self.threads);
    }
}

/// Bytes of the forces of an element, and of its tangent blocks.
fn work_bytes(kind: &DeviceElement) -> [u64; 2] {
    [SLOT_BYTES * kind.vertices as u64, BLOCK_BYTES * kind.blocks() as u64]
}

/// Slots of the elements round each of `n` vertices, in the order of the elements: starts and slots.
fn force_lists(nodes: &[u32], n: u32) -> (Vec<u32>, Vec<u32>) {
    compressed(n as usize, || nodes.iter().copied().zip(0..))
}
