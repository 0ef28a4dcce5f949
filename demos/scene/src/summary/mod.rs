//! What a run reports: [`RunSummary`] as JSON (schema [`SCHEMA`]) and, through [`std::fmt::Display`],
//! as text for a terminal.

mod text;
mod touch;

pub use crate::warning::totals::{
    ContactTotals, EnergySummary, SolverFigures, TouchEnergy, VolumeSummary,
};
pub use crate::warning::{Level, Warning};
pub use text::Brief;
pub use touch::{ForceSummary, PairSummary, PullSummary, ToolSummary, TouchSummary, Touched};

use crate::assemble::{CutSummary, MaterialRanges, ResectionSummary};
use serde::{Deserialize, Serialize};
use sinew::engine::mesh::LatticeReport;
use sinew::engine::report::StepTotals;
use sinew::models::axes::description::{AxesDescription, AxisFamily, FibreForm};
use sinew::models::body::lumped::SpringRule;
use sinew::models::body::sheet::MembraneModel;
use sinew::models::body::{Evaluation, Integration, Model, VolumeRule};
use sinew::models::cutting::tear::TearReport;
use sinew::models::material::YoungPoisson;
use sinew::solvers::settings::SolverSettings;
use std::collections::BTreeMap;
use std::sync::LazyLock;

/// Version of the JSON summary.
pub const SCHEMA: &str = "sinew-run/1";

/// A run.
#[derive(Clone, Debug, Serialize)]
pub struct RunSummary {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// Whether all steps were carried out, and nothing forbids to trust them.
    pub completed: bool,
    /// Why not.
    pub failure: Option<String>,
    /// All steps were carried out, and `failure` says why their results are not to be trusted.
    pub untrusted: bool,
    /// The scene.
    pub scene: SceneSummary,
    /// Where it ran.
    pub machine: Machine,
    /// With which software.
    pub versions: Versions,
    /// How it was carried out.
    pub settings: RunSettings,
    /// The bodies.
    pub bodies: Vec<BodySummary>,
    /// The constraints.
    pub constraints: Vec<ConstraintSummary>,
    /// The loads.
    pub loads: Vec<LoadSummary>,
    /// The resections.
    pub resections: Vec<ResectionSummary>,
    /// The cuts.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cuts: Vec<CutSummary>,
    /// The pressures.
    pub pressures: Vec<PressureSummary>,
    /// Tools, pulls and contacts; `None` in scenes without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub touch: Option<TouchSummary>,
    /// Probe values at the end, by column of the CSV file.
    pub final_probes: Vec<(String, f64)>,
    /// Host time.
    pub timing: RunTiming,
    /// What the graphics processor did, if it carried out the steps.
    pub gpu: Option<GpuSummary>,
    /// Work and accuracy of the solver.
    pub solver: SolverSummary,
    /// Energies.
    pub energy: EnergySummary,
    /// Volume ratios.
    pub volume: VolumeSummary,
    /// Everything found, in the scene and during the run.
    pub warnings: Vec<Warning>,
    /// Files written.
    pub files: Vec<String>,
    /// 64-bit FNV-1a hash of displacements and velocities at the end: equal hashes mean equal
    /// results bit for bit.
    pub final_state_hash: String,
}

/// The scene of a run.
#[derive(Clone, Debug, Serialize)]
pub struct SceneSummary {
    /// Name.
    pub name: String,
    /// Description.
    pub description: String,
    /// File.
    pub file: String,
    /// `"dynamic"` or `"static"`.
    pub mode: &'static str,
    /// Acceleration of gravity (m/s^2).
    pub gravity: [f64; 3],
    /// Number of bodies.
    pub bodies: usize,
    /// Vertices that elements use, all bodies.
    pub vertices: usize,
    /// Tetrahedra, all bodies.
    pub tetrahedra: usize,
    /// Hexahedra, all bodies.
    pub hexahedra: usize,
    /// Edges, all bodies.
    pub edges: usize,
}

/// The machine of a run.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// Operating system.
    pub os: &'static str,
    /// Instruction set.
    pub architecture: &'static str,
    /// Processor, where the system tells.
    pub processor: Option<String>,
    /// Cores (hardware threads) available.
    pub cores: usize,
}

impl Machine {
    /// The machine that runs this program.
    pub fn this() -> Self {
        // the system takes milliseconds to write this where there are many cores
        static PROCESSOR: LazyLock<Option<String>> = LazyLock::new(|| {
            let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
            let line = text.lines().find(|line| line.starts_with("model name"))?;
            Some(line.split_once(':')?.1.trim().to_string())
        });
        Self {
            os: std::env::consts::OS,
            architecture: std::env::consts::ARCH,
            processor: PROCESSOR.clone(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
        }
    }
}

/// Software of a run.
#[derive(Clone, Debug, Serialize)]
pub struct Versions {
    /// Sinew.
    pub sinew: &'static str,
    /// Compiler.
    pub rustc: &'static str,
    /// Target of the compiler.
    pub target: &'static str,
    /// Optimisation level.
    pub optimisation: &'static str,
}

impl Versions {
    /// Those of this program.
    pub fn this() -> Self {
        Self {
            sinew: env!("CARGO_PKG_VERSION"),
            rustc: env!("SINEW_RUSTC"),
            target: env!("SINEW_TARGET"),
            optimisation: env!("SINEW_OPT_LEVEL"),
        }
    }
}

/// What the graphics processor did in a run.
#[derive(Clone, Debug, Default, Serialize)]
pub struct GpuSummary {
    /// Adapter, its interface and kind.
    pub adapter: String,
    /// Shaders ran on the main processor: times say nothing of a graphics processor.
    pub software: bool,
    /// Time on the device (s) by kind of work; empty where it cannot be told.
    pub device_s: Vec<(&'static str, f64)>,
    /// Time of the integrator on the host (s), waiting for the device included.
    pub host_s: f64,
    /// Submissions to the device.
    pub submissions: u64,
    /// Bytes sent to the device.
    pub bytes_up: u64,
    /// Bytes read back.
    pub bytes_down: u64,
    /// Linear solves that `f32` could not bring to the tolerance.
    pub stalled: u64,
}

/// Settings of a run.
#[derive(Clone, Debug, Serialize)]
pub struct RunSettings {
    /// Step length (s); of a static scene the share of the loads per step.
    pub dt: f64,
    /// Steps asked for.
    pub steps: u64,
    /// `"f64"` or `"f32"`.
    pub precision: &'static str,
    /// `"cpu"` or `"gpu"`.
    pub backend: &'static str,
    /// Threads used.
    pub threads: usize,
    /// `"single"` or `"multi"`.
    pub executor: &'static str,
    /// Instruction set of the kernels.
    pub instruction_set: &'static str,
    /// Integrator, tolerances and damping.
    pub solver: SolverSettings,
}

/// A body of a run.
#[derive(Clone, Debug, Serialize)]
pub struct BodySummary {
    /// Name.
    pub name: String,
    /// Mesh file or shape.
    pub source: String,
    /// Vertices that elements use.
    pub vertices: usize,
    /// Vertices of the mesh that no element uses.
    pub unused_vertices: usize,
    /// Tetrahedra.
    pub tetrahedra: usize,
    /// Hexahedra.
    pub hexahedra: usize,
    /// Edges: pairs of vertices that share an element.
    pub edges: usize,
    /// Volume (m^3).
    pub volume: f64,
    /// Mass (kg).
    pub mass: f64,
    /// Extent of the rest shape (m).
    pub extent: [f64; 3],
    /// Lowest quality of an element, 0 (flat) to 1 (regular).
    pub worst_quality: f64,
    /// Preset of the material.
    pub preset: Option<String>,
    /// Material; the mean of what a field of the mesh gives.
    pub material: YoungPoisson,
    /// Ends of what fields of the mesh give to the elements; empty where the material is the same everywhere.
    pub material_ranges: MaterialRanges,
    /// Energy.
    pub model: Model,
    /// Evaluation.
    pub evaluation: Evaluation,
    /// What keeps its volume.
    pub volume_rule: VolumeRule,
    /// How its hexahedra are integrated.
    pub integration: Integration,
    /// Where it is a lattice: how the surface was filled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lattice: Option<LatticeReport>,
    /// Points of the surface that it carries along.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub carried: Option<usize>,
    /// Where constants of lumped springs come from, where the scene says so.
    pub element_method: Option<SpringRule>,
    /// What tore, where it may.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tear: Option<TearReport>,
    /// Membrane.
    pub membrane: Option<MembraneSummary>,
    /// Axes.
    pub axes: Option<AxesSummary>,
}

/// Axes of a body in a summary.
#[derive(Clone, Debug, Serialize)]
pub struct AxesSummary {
    /// Families.
    pub families: Vec<FamilySummary>,
    /// Number of springs on angles between them.
    pub angles: usize,
    /// Modulus of the term of volume (Pa).
    pub volume_modulus: f64,
    /// Volume of the body over that at rest: smallest, largest and last, over the rows of the probe file.
    pub volume_ratio: [f64; 3],
}

/// A family in a summary.
#[derive(Clone, Debug, Serialize)]
pub struct FamilySummary {
    /// Name.
    pub name: String,
    /// Modulus (Pa).
    pub modulus: f64,
    /// What their springs measure.
    pub form: FibreForm,
    /// Viscosity (Pa s).
    pub viscosity: f64,
    /// Active stress (Pa) at full activation; `None` when passive.
    pub peak_stress: Option<f64>,
    /// Activation at the end.
    pub activation: Option<f64>,
}

impl From<&AxisFamily<'_>> for FamilySummary {
    fn from(f: &AxisFamily) -> Self {
        Self {
            name: f.name.to_string(),
            modulus: f.modulus,
            form: f.form,
            viscosity: f.viscosity,
            peak_stress: f.muscle.as_ref().map(|m| m.peak_stress),
            activation: None,
        }
    }
}

impl AxesSummary {
    /// Of a description, with the activation of a family and the volume ratios.
    pub(crate) fn new(
        axes: &AxesDescription,
        activation: impl Fn(&str) -> Option<f64>,
        volume_ratio: [f64; 3],
    ) -> Self {
        let families = axes.families.iter().map(|f| FamilySummary {
            activation: f.muscle.as_ref().and_then(|_| activation(&f.name)),
            ..FamilySummary::from(f)
        });
        Self {
            families: families.collect(),
            angles: axes.angles.len(),
            volume_modulus: axes.volume_modulus,
            volume_ratio,
        }
    }
}

/// The membrane of a body of a run.
#[derive(Clone, Debug, Serialize)]
pub struct MembraneSummary {
    /// Triangles.
    pub triangles: usize,
    /// Quadrilaterals.
    pub quads: usize,
    /// Area (m^2).
    pub area: f64,
    /// Thickness (m).
    pub thickness: f64,
    /// Material.
    pub material: YoungPoisson,
    /// Energy.
    pub model: MembraneModel,
    /// Evaluation.
    pub evaluation: Evaluation,
    /// Where constants of lumped springs come from, where the scene says so.
    pub element_method: Option<SpringRule>,
    /// Thickness (m) that resists bending, where it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bending: Option<f64>,
    /// Fibres in its triangles.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub fibres: Vec<FamilySummary>,
}

/// A pressure of a run.
#[derive(Clone, Debug, Serialize)]
pub struct PressureSummary {
    /// Name.
    pub name: String,
    /// Body.
    pub body: String,
    /// Number of triangles.
    pub triangles: usize,
    /// Pressure (Pa) at curve value 1.
    pub pressure: f64,
}

/// A constraint of a run.
#[derive(Clone, Debug, Serialize)]
pub struct ConstraintSummary {
    /// Name.
    pub name: String,
    /// Body.
    pub body: String,
    /// Number of vertices.
    pub vertices: usize,
    /// Held axes.
    pub axes: String,
    /// What it does.
    pub motion: String,
    /// Time (s) from which it acts, `None` from the start.
    pub from: Option<f64>,
    /// Time (s) until which it acts, `None` to the end.
    pub until: Option<f64>,
    /// Largest reaction (N) among the rows of the probe file, `None` without a probe on it.
    pub largest_reaction: Option<f64>,
}

/// A load of a run.
#[derive(Clone, Debug, Serialize)]
pub struct LoadSummary {
    /// Name.
    pub name: String,
    /// Body.
    pub body: String,
    /// Number of vertices.
    pub vertices: usize,
    /// Total force (N) at curve value 1.
    pub force: [f64; 3],
}

/// Host time of a run.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RunTiming {
    /// From reading the meshes to the last file (s).
    pub total_s: f64,
    /// Simulated time (s); zero for a static scene.
    pub simulated_s: f64,
    /// Simulated time over host time of the steps: 1 is real time, 2 twice as fast; `None` for a
    /// static scene.
    pub real_time_factor: Option<f64>,
    /// One step.
    pub step: StepTiming,
    /// Where the time went.
    pub stages: Vec<Stage>,
    /// Where the time of the steps went, as far as it is measured. Entries can contain others: the
    /// integrator runs linear solves and laws.
    pub systems: Vec<SystemSummary>,
}

/// Host time of a system or of a part of one.
#[derive(Clone, Debug, Serialize)]
pub struct SystemSummary {
    /// Name.
    pub name: &'static str,
    /// All runs (s).
    pub total_s: f64,
    /// Number of runs.
    pub runs: u64,
    /// Per step (ms).
    pub per_step_ms: f64,
    /// Share of the steps (0 to 1).
    pub share: f64,
}

/// Host time of a step.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct StepTiming {
    /// Steps carried out.
    pub count: u64,
    /// Mean (ms).
    pub mean_ms: f64,
    /// Median (ms).
    pub median_ms: f64,
    /// 99th percentile (ms).
    pub p99_ms: f64,
    /// Longest (ms).
    pub max_ms: f64,
}

/// Host times of any number of steps in little memory: counted in bins 0.2 % wide.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct StepTimes {
    count: u64,
    total: f64,
    last: f64,
    max: f64,
    /// Counts by the leading bits of the time in `f32`, which ascend with it.
    bins: BTreeMap<u32, u64>,
}

impl StepTimes {
    /// Bits of an `f32` that a bin does not look at: 9 of its 23 digits are left.
    const DROPPED: u32 = 14;

    /// Adds a step (s).
    pub fn add(&mut self, seconds: f64) {
        self.count += 1;
        self.total += seconds;
        self.last = seconds;
        self.max = self.max.max(seconds);
        *self.bins.entry((seconds as f32).to_bits() >> Self::DROPPED).or_default() += 1;
    }

    /// Number of steps.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Number of bins that hold a step.
    pub fn bins(&self) -> usize {
        self.bins.len()
    }

    /// All steps (s).
    pub fn total(&self) -> f64 {
        self.total
    }

    /// The last step (s); 0 before the first.
    pub fn last(&self) -> f64 {
        self.last
    }

    /// Mean, quantiles and the longest; quantiles are the middles of their bins.
    pub fn timing(&self) -> StepTiming {
        let quantile = |q: f64| {
            let mut left = (q * self.count as f64).ceil() as u64;
            let within = self.bins.iter().find(|&(_, &n)| {
                let found = left <= n;
                left -= n.min(left);
                found
            });
            let bits = |bin: u32| (bin << Self::DROPPED) | (1 << (Self::DROPPED - 1));
            within.map_or(0.0, |(&bin, _)| 1e3 * f64::from(f32::from_bits(bits(bin))))
        };
        StepTiming {
            count: self.count,
            mean_ms: 1e3 * self.total / self.count.max(1) as f64,
            median_ms: quantile(0.5),
            p99_ms: quantile(0.99),
            max_ms: 1e3 * self.max,
        }
    }
}

/// Host time of a stage.
#[derive(Clone, Debug, Serialize)]
pub struct Stage {
    /// Name.
    pub name: &'static str,
    /// All of it (s).
    pub total_s: f64,
    /// Per step (ms), over all steps; `None` for a stage that runs once.
    pub per_step_ms: Option<f64>,
    /// Share of the whole run (0 to 1).
    pub share: f64,
}

/// Work and accuracy of the solver over a run; in JSON all figures stand side by side.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SolverSummary {
    /// Sums.
    #[serde(flatten)]
    pub totals: StepTotals,
    /// What is no sum.
    #[serde(flatten)]
    pub figures: SolverFigures,
}

/// Name of a model in a scene file.
pub fn model_name(model: Model) -> &'static str {
    model.name()
}

/// Name of an evaluation in a scene file.
pub fn evaluation_name(evaluation: Evaluation) -> &'static str {
    match evaluation {
        Evaluation::Fused => "fused",
        Evaluation::Pooled => "pooled",
    }
}
