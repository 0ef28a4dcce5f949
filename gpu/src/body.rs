//! One body on the device: its rows, elements and matrix. Bodies share nothing, as on the CPU.

use bytemuck::{Pod, Zeroable};
use sinew_adapter::wgpu;
use sinew_engine::law::TangentKind;

use crate::coarse::{Coarse, CoarseBuffers, CoarseParts, CoarsePlan};
use crate::context::{Context, GROUP, Pass, PassRecorder, PendingRead, groups_for};
use crate::elements::DeviceElements;
use crate::error::GpuError;
use crate::laws::{DeviceLaw, ElementColumns};
use crate::matrix::{MAX_GROUPS, MatrixPattern, shift};
use crate::report::Phase;

/// Slots of vertex rows, as in prelude.wgsl.
#[derive(Clone, Copy, Debug)]
#[repr(u64)]
pub enum RowSlot {
    U = 0,
    V = 1,
    Y = 2,
    Target = 5,
    Load = 6,
    Force = 7,
    Step = 9,
    P = 12,
    Q = 13,
    Rest = 17,
}

/// Number of slots.
const SLOTS: u64 = 19;
/// Most sums per workgroup that a measurement leaves.
const SUMS: u32 = 3;

/// `Step` of prelude.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct StepUniform {
    pub n: u32,
    pub groups: u32,
    pub matrix_groups: u32,
    pub max_iterations: u32,
    pub h: f32,
    pub rate: f32,
    pub inertia: f32,
    pub mass_damping: f32,
    pub stiffness_damping: f32,
    pub t: f32,
    pub tolerance: f32,
    pub scale: f32,
    pub piece: u32,
    pub piece_mass: f32,
    pub kind: u32,
    pub warm: u32,
    pub keep: f32,
    pub kick: f32,
    pub drift: f32,
    pub coarse_groups: u32,
    pub smoother: [f32; 2],
    pub padding: [u32; 2],
}

/// `kind` of a [`StepUniform`].
pub fn kind_number(kind: TangentKind) -> u32 {
    match kind {
        TangentKind::Exact => 0,
        TangentKind::GaussNewton => 1,
        TangentKind::Projected => 2,
    }
}

/// `Vertex` of prelude.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct VertexConstants {
    pub mass: f32,
    pub held: u32,
    pub piece: u32,
    pub loaded: u32,
}

/// `CgState` of cg.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct CgState {
    pub phase: u32,
    pub iterations: u32,
    pub restarts: u32,
    pub fresh: u32,
    pub rz: f32,
    pub reference: f32,
    pub residual: f32,
    pub curvature: f32,
}

/// What a body is built from.
pub struct BodyParts<'a> {
    pub n: u32,
    pub edges: Vec<[u32; 2]>,
    pub laws: &'a [(DeviceLaw, ElementColumns)],
    /// Rest positions (m) from the centre of the body.
    pub rest: Vec<[f32; 4]>,
    pub with_matrix: bool,
    pub with_damping: bool,
    /// What aggregates are chosen by, where motions of them are part of the preconditioner.
    pub coarse: Option<CoarseParts<'a>>,
}

pub struct DeviceBody {
    pub n: u32,
    /// Workgroups of kernels with sums.
    pub groups: u32,
    pub elements: DeviceElements,
    pub matrix: Option<Matrix>,
    pub coarse: Option<Coarse>,
    /// Moves by the corotational energy.
    pub recovering: bool,
    rows: wgpu::Buffer,
    vertices: wgpu::Buffer,
    sums: wgpu::Buffer,
    cg: wgpu::Buffer,
    step: wgpu::Buffer,
    /// For kernels over rows.
    pub solver: wgpu::BindGroup,
    /// For kernels over elements.
    pub row_bind: wgpu::BindGroup,
}

pub struct Matrix {
    pub pattern: MatrixPattern,
    pub shifts: Vec<(wgpu::BindGroup, u32)>,
}

impl DeviceBody {
    pub fn new(context: &Context, parts: BodyParts<'_>) -> Result<Self, GpuError> {
        let n = parts.n;
        let groups = n.div_ceil(GROUP).clamp(1, MAX_GROUPS);
        context.fits("the vertex rows of a body", 16 * SLOTS * u64::from(n))?;
        let rows = context.storage("vertex rows", 16 * SLOTS * u64::from(n));
        let vertices = context.storage("vertices", 16 * u64::from(n));
        let step = context.uniform("step", &StepUniform::default());
        let cg = context.filled("conjugate gradients", &[CgState::default()]);
        let pattern = parts.with_matrix.then(|| {
            MatrixPattern::new(context, n, parts.edges.iter().copied(), parts.with_damping)
        });
        let first_sum = SUMS * groups;
        let elements = DeviceElements::new(context, parts.laws, n, first_sum, pattern.as_ref());
        let sums = context.storage("sums", 16 * u64::from(first_sum + elements.energy_sums));
        let matrix_groups = pattern.as_ref().map_or(0, |p| p.groups);
        let plan = parts.coarse.as_ref().filter(|_| pattern.is_some());
        let plan = plan.and_then(|parts| CoarsePlan::new(context, parts));
        let coarse_groups = plan.as_ref().map_or(0, |plan| plan.groups);
        let partials = groups + matrix_groups + coarse_groups;
        let partials = context.storage("partial sums", 16 * u64::from(partials));
        let buffers = CoarseBuffers {
            step: &step,
            rows: &rows,
            vertices: &vertices,
            partials: &partials,
            cg: &cg,
        };
        let coarse = plan
            .zip(pattern.as_ref())
            .map(|(plan, pattern)| Coarse::new(context, plan, pattern, &buffers));
        let matrix = pattern.map(|pattern| {
            let shifts = pattern.shifts(context, &step, &vertices, &rows);
            Matrix { pattern, shifts }
        });
        let layouts = &context.layouts;
        let solver =
            context.bind(&layouts.solver, &[&step, &rows, &vertices, &partials, &cg, &sums]);
        let row_bind = context.bind(&layouts.rows, &[&step, &rows, &sums]);
        let body = Self {
            n,
            groups,
            elements,
            matrix,
            coarse,
            recovering: false,
            rows,
            vertices,
            sums,
            cg,
            step,
            solver,
            row_bind,
        };
        body.write_rows(context, RowSlot::Rest, &parts.rest);
        Ok(body)
    }

    /// Sets the uniform of the submissions to come.
    pub fn set(&self, context: &Context, step: StepUniform) {
        let matrix_groups = self.matrix.as_ref().map_or(0, |m| m.pattern.groups);
        let step = StepUniform { n: self.n, groups: self.groups, matrix_groups, ..step };
        context.write(&self.step, 0, &[step]);
    }

    fn offset(&self, slot: RowSlot) -> u64 {
        16 * slot as u64 * u64::from(self.n)
    }

    pub fn write_rows(&self, context: &Context, slot: RowSlot, rows: &[[f32; 4]]) {
        context.write(&self.rows, self.offset(slot), rows);
    }

    pub fn write_vertices(&self, context: &Context, vertices: &[VertexConstants]) {
        context.write(&self.vertices, 0, vertices);
    }

    /// Asks for a slot.
    pub fn read_rows(&self, recorder: &mut PassRecorder<'_>, slot: RowSlot) -> PendingRead {
        recorder.read(&self.rows, self.offset(slot), 16 * u64::from(self.n))
    }

    /// Asks for the sums of a measurement that leaves `per_group` rows per workgroup.
    pub fn read_sums(&self, recorder: &mut PassRecorder<'_>, per_group: u32) -> PendingRead {
        recorder.read(&self.sums, 0, 16 * u64::from(per_group * self.groups))
    }

    /// Asks for the energies of the elements.
    pub fn read_energies(&self, recorder: &mut PassRecorder<'_>) -> PendingRead {
        let count = u64::from(self.elements.energy_sums.max(1));
        let first = 16 * u64::from(SUMS * self.groups);
        recorder.read(&self.sums, first.min(self.sums.size() - 16), 16 * count)
    }

    pub fn read_cg(&self, recorder: &mut PassRecorder<'_>) -> PendingRead {
        recorder.read(&self.cg, 0, size_of::<CgState>() as u64)
    }

    fn run(&self, pass: &mut Pass<'_>, entry: &'static str, groups: [u32; 2]) {
        pass.run(&pass.context.vector_kernel(entry), &[&self.solver], groups);
    }

    /// A kernel with one thread per vertex row.
    pub fn each_row(&self, pass: &mut Pass<'_>, entry: &'static str) {
        self.run(pass, entry, groups_for(u64::from(self.n)));
    }

    /// A kernel that sums over rows.
    pub fn summing(&self, pass: &mut Pass<'_>, entry: &'static str) {
        self.run(pass, entry, [self.groups, 1]);
    }

    /// A kernel of one workgroup.
    pub fn single(&self, pass: &mut Pass<'_>, entry: &'static str) {
        self.run(pass, entry, [1, 1]);
    }

    /// A product with the system or the damping matrix.
    pub fn product(&self, pass: &mut Pass<'_>, entry: &'static str, damping: bool) {
        if let Some(matrix) = &self.matrix {
            matrix.pattern.product(&self.solver, entry, damping, pass);
        }
    }

    /// Begins to record with the state at the start of a step as the point of evaluation.
    pub fn look_back<'c>(&self, context: &'c Context, step: StepUniform) -> PassRecorder<'c> {
        self.set(context, step);
        let mut recorder = context.record();
        recorder.pass(Phase::Rows, |pass| self.each_row(pass, "look_back"));
        recorder
    }

    /// Bytes that a force pass moves at least: constants, indices, slots written and read, lists, rows.
    pub fn force_bytes(&self) -> u64 {
        let with_forces = self.elements.chunks.iter().filter(|chunk| chunk.law.row.forces);
        let elements = with_forces.map(|chunk| {
            let (vertices, constants) = (chunk.law.kind.vertices, chunk.law.kind.constants);
            // index, slot written and read, place in the list
            let bytes = vertices * (4 + 16 + 16 + 4) + 4 * constants;
            u64::from(chunk.count) * bytes as u64
        });
        elements.sum::<u64>() + u64::from(self.n) * (16 + 4 + 16)
    }

    /// Energies at the point of evaluation.
    pub fn energies(&self, recorder: &mut PassRecorder<'_>) {
        recorder.pass(Phase::Forces, |pass| {
            self.elements.energies(self.recovering, &self.row_bind, pass);
        });
    }

    /// Volume ratios at the point of evaluation, in place of the energies.
    pub fn volumes(&self, recorder: &mut PassRecorder<'_>) {
        recorder.pass(Phase::Rows, |pass| self.elements.volumes(&self.row_bind, pass));
    }

    /// Forces at the point of evaluation.
    pub fn forces(&self, recorder: &mut PassRecorder<'_>) {
        recorder.pass(Phase::Forces, |pass| {
            self.elements.forces(self.recovering, &self.row_bind, pass);
        });
    }

    /// Tangent at the point of evaluation, of the kind in the uniform.
    pub fn tangent(&self, recorder: &mut PassRecorder<'_>, kind: TangentKind, damping: bool) {
        recorder.pass(Phase::Tangent, |pass| {
            self.elements.tangent(self.recovering, &self.row_bind, (kind, damping), pass);
        });
    }

    /// Tangent to system.
    pub fn shift(&self, recorder: &mut PassRecorder<'_>) {
        if let Some(matrix) = &self.matrix {
            recorder.pass(Phase::Tangent, |pass| shift(&matrix.shifts, pass));
        }
    }
}

/// Sum in `f64` of entry `k` of every row `at` of `per_group`.
pub fn total(sums: &[[f32; 4]], per_group: usize, at: usize, k: usize) -> f64 {
    sums.iter().skip(at).step_by(per_group).map(|row| f64::from(row[k])).sum()
}
