//! What a run reports: [`RunSummary`] as JSON (schema [`SCHEMA`]) and, through [`std::fmt::Display`],
//! as text for a terminal.

use crate::axes::AxesSummary;
use crate::resection::ResectionSummary;
use serde::Serialize;
use sinew::identify::ElementMethod;
use sinew::models::body::{Evaluation, Model};
use sinew::models::material::YoungPoisson;
use sinew::models::sheet::MembraneModel;
use sinew::solvers::settings::SolverSettings;
use std::fmt;

/// Version of the JSON summary.
pub const SCHEMA: &str = "sinew-run/1";

/// How much a warning matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Worth knowing.
    Note,
    /// The run may not be what was meant.
    Warning,
}

/// Something that was found in the scene or during the run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Warning {
    /// Stable identifier, such as `mesh.inverted-winding`.
    pub code: String,
    /// How much it matters.
    pub level: Level,
    /// Body, constraint or stage.
    pub subject: String,
    /// What was found.
    pub message: String,
    /// What to do, or that nothing is to be done.
    pub remedy: String,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let level = if self.level == Level::Note { "note" } else { "warning" };
        write!(f, "{level} [{}] {}: {}", self.code, self.subject, self.message)?;
        if self.remedy.is_empty() { Ok(()) } else { write!(f, "; {}", self.remedy) }
    }
}

/// A run.
#[derive(Clone, Debug, Serialize)]
pub struct RunSummary {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// Whether all steps were carried out.
    pub completed: bool,
    /// Why not.
    pub failure: Option<String>,
    /// The scene.
    pub scene: SceneSummary,
    /// Where it ran.
    pub machine: Machine,
    /// With which software.
    pub versions: Versions,
    /// How it was carried out.
    pub settings: Settings,
    /// The bodies.
    pub bodies: Vec<BodySummary>,
    /// The constraints.
    pub constraints: Vec<ConstraintSummary>,
    /// The loads.
    pub loads: Vec<LoadSummary>,
    /// The resections.
    pub resections: Vec<ResectionSummary>,
    /// The pressures.
    pub pressures: Vec<PressureSummary>,
    /// Probe values at the end, by column of the CSV file.
    pub final_probes: Vec<(String, f64)>,
    /// Host time.
    pub timing: Timing,
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
        let processor = std::fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
            let line = text.lines().find(|line| line.starts_with("model name"))?;
            Some(line.split_once(':')?.1.trim().to_string())
        });
        Self {
            os: std::env::consts::OS,
            architecture: std::env::consts::ARCH,
            processor,
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
pub struct Settings {
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
    /// Material.
    pub material: YoungPoisson,
    /// Energy.
    pub model: Model,
    /// Evaluation.
    pub evaluation: Evaluation,
    /// How constants of lumped springs are found, where the scene says so.
    pub element_method: Option<ElementMethod>,
    /// Membrane.
    pub membrane: Option<MembraneSummary>,
    /// Axes.
    pub axes: Option<AxesSummary>,
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
    /// How constants of lumped springs are found, where the scene says so.
    pub element_method: Option<ElementMethod>,
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
pub struct Timing {
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

impl StepTiming {
    /// From the times of all steps (s).
    pub fn of(mut seconds: Vec<f64>) -> Self {
        if seconds.is_empty() {
            return Self::default();
        }
        seconds.sort_unstable_by(f64::total_cmp);
        let n = seconds.len();
        let quantile = |q: f64| 1e3 * seconds[((q * n as f64).ceil() as usize).clamp(1, n) - 1];
        Self {
            count: n as u64,
            mean_ms: 1e3 * seconds.iter().sum::<f64>() / n as f64,
            median_ms: quantile(0.5),
            p99_ms: quantile(0.99),
            max_ms: quantile(1.0),
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

/// Work and accuracy of the solver over a run.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SolverSummary {
    /// Conjugate-gradient iterations.
    pub cg_iterations: u64,
    /// Most in one step.
    pub cg_iterations_max: u32,
    /// Newton iterations (linear systems).
    pub newton_iterations: u64,
    /// Most in one step.
    pub newton_iterations_max: u32,
    /// Force evaluations of any kind.
    pub evaluations: u64,
    /// Largest relative residual at which a linear solve ended a step.
    pub worst_residual: f64,
    /// Largest last Newton step over body size.
    pub worst_newton_step: f64,
    /// Mean over the steps of how far the decrease of the incremental potential was from what the
    /// last linearisation predicted, relative: 0 exact, near 1 when it said little.
    pub linearisation_error_mean: f64,
    /// The largest of them.
    pub linearisation_error_max: f64,
    /// Linear solves that stopped at the iteration cap.
    pub cg_caps: u64,
    /// Preconditioner of the last linear solve, empty without one.
    pub preconditioner: String,
    /// Times the values of preconditioners were computed anew.
    pub preconditioner_refreshes: u64,
    /// Restarts of incomplete factorisations after breakdowns.
    pub preconditioner_breakdowns: u64,
    /// Linear solves that mixed precision left to full precision.
    pub precision_fallbacks: u64,
    /// Linear solves replaced by the preconditioned gradient.
    pub gradient_fallbacks: u64,
    /// Fallbacks: indefinite tangents replaced by the projected one.
    pub projections: u64,
    /// Elements clamped in those.
    pub clamped_elements: u64,
    /// Halvings of the line search.
    pub backtracks: u64,
    /// Line searches without a decrease.
    pub line_search_failures: u64,
    /// Steps whose velocity the energy cap scaled.
    pub energy_caps: u64,
    /// Steps whose Newton iteration did not converge.
    pub unconverged_steps: u64,
    /// Bodies' steps that linearised BDF2 took, and that it left to the safe step: no history, tangent
    /// not positive definite, step shortened, energy over its budget, elements turned inside out, waiting
    /// after one of these.
    pub second_order_steps: u64,
    /// See there.
    pub fallbacks: [u64; 6],
    /// Bodies' steps in recovery from inversion.
    pub recovering: u64,
    /// Times a part of the loads of an equilibrium was halved.
    pub load_partings: u64,
    /// Explicit substeps.
    pub substeps: u64,
    /// Explicit steps repeated with more substeps.
    pub refinements: u64,
    /// Smallest stable explicit step (s), `None` when not estimated.
    pub stable_step: Option<f64>,
}

/// Energies of a run (J).
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct EnergySummary {
    /// Elastic plus kinetic energy at the start, and what recovery from inversion added by changing laws.
    pub initial: f64,
    /// Work of gravity and loads.
    pub load_work: f64,
    /// Energy put in by moving constraints: an upper bound of their work.
    pub constraint_work: f64,
    /// Energy that changes of activation put into muscles.
    pub activation_work: f64,
    /// Energy that left with removed elements.
    pub removed: f64,
    /// Elastic energy at the end.
    pub elastic: f64,
    /// Kinetic energy at the end.
    pub kinetic: f64,
    /// `initial + load_work + constraint_work + activation_work - removed - elastic - kinetic`: taken out by damping and
    /// by the integrator; `None` for a series of equilibria.
    pub dissipated: Option<f64>,
    /// The part of it that damping took; the rest is the integrator's.
    pub damping: f64,
    /// Largest elastic energy.
    pub elastic_max: f64,
    /// Largest kinetic energy.
    pub kinetic_max: f64,
}

/// Volume ratios J of a run.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct VolumeSummary {
    /// Smallest J of all steps.
    pub smallest_j: f64,
    /// When (s).
    pub smallest_j_time: f64,
    /// Smallest J at the end.
    pub final_smallest_j: f64,
    /// Most tetrahedra with J <= 0 at one time.
    pub inverted_max: u64,
    /// Tetrahedra with J <= 0 at the end.
    pub inverted_final: u64,
}

/// Counts in words, those of 0 left out: "3 tetrahedra and 2 triangles".
pub fn counted(counts: &[(&str, usize)]) -> String {
    let words: Vec<String> = counts
        .iter()
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| format!("{count} {name}"))
        .collect();
    match &words[..] {
        [] => format!("0 {}", counts.first().map_or("elements", |(name, _)| name)),
        words => words.join(" and "),
    }
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

fn springs_by(method: ElementMethod) -> String {
    let recalled =
        if method.recalled() { " (formula recalled, not read in the original)" } else { "" };
    format!("springs by {}{recalled}", method.name())
}

/// A number with about four digits, plain where that is short.
pub fn short(x: f64) -> String {
    let size = x.abs();
    if x == 0.0 {
        "0".into()
    } else if !(1e-3..1e5).contains(&size) {
        format!("{x:.2e}")
    } else {
        let digits = (3 - size.log10().floor() as i32).clamp(0, 6) as usize;
        let text = format!("{x:.digits$}");
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').into()
        } else {
            text
        }
    }
}

/// A pressure in the unit that suits it.
fn pressure(x: f64) -> String {
    match x {
        x if x >= 1e6 => format!("{} MPa", short(x / 1e6)),
        x if x >= 1e3 => format!("{} kPa", short(x / 1e3)),
        x => format!("{} Pa", short(x)),
    }
}

/// A time in the unit that suits it.
fn seconds(x: f64) -> String {
    match x {
        x if x >= 120.0 => format!("{:.0} min {:02.0} s", (x / 60.0).floor(), x % 60.0),
        x if x >= 1.0 => format!("{x:.2} s"),
        x if x >= 1e-3 => format!("{:.1} ms", x * 1e3),
        x => format!("{:.0} us", x * 1e6),
    }
}

impl RunSummary {
    /// Width of the first column: the longest label.
    fn label_width(&self) -> usize {
        let bodies = self.bodies.iter().map(|b| b.name.chars().count());
        let constraints = self.constraints.iter().map(|c| c.name.chars().count());
        let loads = self.loads.iter().map(|l| l.name.chars().count());
        let resections = self.resections.iter().map(|r| r.name.chars().count() + 2);
        let axes = self.bodies.iter().filter_map(|b| b.axes.as_ref());
        let fibres = axes.flat_map(|a| &a.families).map(|f| f.name.chars().count() + 4);
        // 5 for "body " and its like
        let longest = bodies.chain(constraints).chain(loads).chain(resections).chain(fibres).max();
        longest.unwrap_or(0).clamp(10, 30) + 5
    }

    fn headline(&self) -> String {
        let steps = self.timing.step.count;
        if !self.completed {
            return format!("FAILED after {steps} of {} steps", self.settings.steps);
        }
        match self.timing.real_time_factor {
            Some(_) => format!(
                "{} simulated in {}",
                seconds(self.timing.simulated_s),
                seconds(self.timing.total_s)
            ),
            None => format!("equilibrium found in {}", seconds(self.timing.total_s)),
        }
    }
}

/// A block of the report: its first line carries the title.
struct Block<'f, 'g> {
    f: &'f mut fmt::Formatter<'g>,
    title: &'static str,
    width: usize,
}

impl Block<'_, '_> {
    fn line(&mut self, label: &str, text: impl fmt::Display) -> fmt::Result {
        if !self.title.is_empty() {
            writeln!(self.f, "\n{}", self.title)?;
            self.title = "";
        }
        writeln!(self.f, "  {label:<0$} {text}", self.width)
    }
}

impl fmt::Display for RunSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {}", self.scene.name, self.headline())?;
        if let Some(failure) = &self.failure {
            writeln!(f, "  error: {failure}")?;
        }
        self.what(f)?;
        self.speed(f)?;
        self.accuracy(f)?;
        if !self.final_probes.is_empty() {
            writeln!(f, "\nResults at the end")?;
        }
        let width = self.final_probes.iter().map(|(name, _)| name.chars().count()).max();
        for (name, value) in &self.final_probes {
            writeln!(f, "  {name:<0$}  {1:>9}", width.unwrap_or(0), short(*value))?;
        }
        writeln!(f, "\nWarnings")?;
        for warning in &self.warnings {
            let level = if warning.level == Level::Note { "note" } else { "warning" };
            let Warning { code, subject, message, remedy, .. } = warning;
            writeln!(f, "  {level} [{code}] {subject}: {message}\n    -> {remedy}")?;
        }
        if self.warnings.is_empty() {
            writeln!(f, "  none")?;
        }
        writeln!(f, "\nFiles")?;
        for file in &self.files {
            writeln!(f, "  {file}")?;
        }
        if self.files.is_empty() {
            writeln!(
                f,
                "  none; use --out DIR for frames and probes, --json FILE for the figures"
            )?;
        }
        Ok(())
    }
}

impl RunSummary {
    fn what(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut block = Block { f, width: self.label_width(), title: "What was simulated" };
        block.line("scene", format!("{} ({})", self.scene.file, self.scene.mode))?;
        for body in &self.bodies {
            let m = &body.material;
            block.line(
                &format!("body {}", body.name),
                format!(
                    "{} vertices, {}, {} x {} x {} cm, {} kg; {}",
                    body.vertices,
                    counted(&[("tetrahedra", body.tetrahedra), ("hexahedra", body.hexahedra)]),
                    short(body.extent[0] * 100.0),
                    short(body.extent[1] * 100.0),
                    short(body.extent[2] * 100.0),
                    short(body.mass),
                    body.source,
                ),
            )?;
            let preset =
                body.preset.as_ref().map_or(String::new(), |name| format!(" (preset {name})"));
            if body.tetrahedra + body.hexahedra > 0 {
                block.line(
                    "",
                    format!(
                        "E = {}, nu = {}, {} kg/m^3{preset}; model {}, {}",
                        pressure(m.young_modulus),
                        m.poisson_ratio,
                        short(m.density),
                        model_name(body.model),
                        match (body.model, body.element_method) {
                            (Model::MassSpring, Some(method)) => springs_by(method),
                            _ => format!("{} evaluation", evaluation_name(body.evaluation)),
                        },
                    ),
                )?;
            }
            if let Some(axes) = &body.axes {
                for family in &axes.families {
                    let viscous = match family.viscosity {
                        0.0 => String::new(),
                        viscosity => format!(", viscosity {} Pa s", short(viscosity)),
                    };
                    let active = family.peak_stress.map_or(String::new(), |stress| {
                        format!(
                            ", active stress up to {}, activation {} at the end",
                            pressure(stress),
                            short(family.activation.unwrap_or(0.0))
                        )
                    });
                    block.line(
                        &format!("  fibres {}", family.name),
                        format!("{}{viscous}{active}", pressure(family.modulus)),
                    )?;
                }
                let [smallest, largest, last] = axes.volume_ratio;
                block.line(
                    "  axes",
                    format!(
                        "{} angle(s), volume modulus {}; volume over rest from {} to {}, {} at the end",
                        axes.angles,
                        pressure(axes.volume_modulus),
                        short(smallest),
                        short(largest),
                        short(last)
                    ),
                )?;
            }
            if let Some(sheet) = &body.membrane {
                let m = &sheet.material;
                block.line(
                    "  membrane",
                    format!(
                        "{}, {} cm^2, {} mm; E = {}, nu = {}, {} kg/m^3; model {}, {}",
                        counted(&[("triangles", sheet.triangles), ("quadrilaterals", sheet.quads)]),
                        short(sheet.area * 1e4),
                        short(sheet.thickness * 1e3),
                        pressure(m.young_modulus),
                        m.poisson_ratio,
                        short(m.density),
                        sheet.model.name(),
                        match (sheet.model, sheet.element_method) {
                            (MembraneModel::MassSpring, Some(method)) => springs_by(method),
                            _ => format!("{} evaluation", evaluation_name(sheet.evaluation)),
                        },
                    ),
                )?;
            }
        }
        for c in &self.constraints {
            let window = match (c.from, c.until) {
                (None, None) => String::new(),
                (Some(a), None) => format!(", from {a} s"),
                (None, Some(b)) => format!(", until {b} s"),
                (Some(a), Some(b)) => format!(", from {a} s to {b} s"),
            };
            let force = c
                .largest_reaction
                .map_or(String::new(), |r| format!("; largest reaction {} N", short(r)));
            block.line(
                &format!("hold {}", c.name),
                format!(
                    "{} vertices of {} along {}, {}{window}{force}",
                    c.vertices, c.body, c.axes, c.motion
                ),
            )?;
        }
        for p in &self.pressures {
            block.line(
                &format!("pressure {}", p.name),
                format!("{} on {} triangles of {}", pressure(p.pressure), p.triangles, p.body),
            )?;
        }
        for load in &self.loads {
            let [x, y, z] = load.force.map(short);
            block.line(
                &format!("load {}", load.name),
                format!("[{x}, {y}, {z}] N on {} vertices of {}", load.vertices, load.body),
            )?;
        }
        for r in &self.resections {
            let removed = counted(&[
                ("tetrahedra", r.removed),
                ("hexahedra", r.removed_hexahedra),
                ("triangles", r.removed_triangles),
                ("quadrilaterals", r.removed_quads),
            ]);
            let remaining = counted(&[
                ("tetrahedra", r.remaining),
                ("hexahedra", r.remaining_hexahedra),
                ("triangles", r.remaining_triangles),
                ("quadrilaterals", r.remaining_quads),
            ]);
            block.line(
                &format!("resect {}", r.name),
                format!(
                    "{removed} of {} ({remaining} left in {} piece(s), {} vertices without any), {} kg, {} J; {} in \
                     all, {} longest",
                    r.body,
                    r.pieces,
                    r.orphans,
                    short(r.mass),
                    short(r.energy),
                    seconds(r.total_s),
                    seconds(r.longest_s)
                ),
            )?;
        }
        let integrator = self.settings.solver.integrator.resolve().name();
        if self.scene.mode == "static" {
            let steps = self.settings.steps;
            block.line("integrator", format!("{integrator}, {steps} load step(s)"))
        } else {
            block.line(
                "integrator",
                format!(
                    "{integrator}, dt = {}, {} steps, {} simulated",
                    seconds(self.settings.dt),
                    self.timing.step.count,
                    seconds(self.timing.simulated_s)
                ),
            )?;
            let s = &self.settings.solver;
            block.line(
                "damping",
                format!("mass {} 1/s, stiffness {} s", s.mass_damping, s.stiffness_damping),
            )
        }
    }

    fn speed(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut block = Block { f, width: self.label_width(), title: "How fast" };
        let step = &self.timing.step;
        block.line(
            "per step",
            format!(
                "{} ms median, {} ms 99th percentile, {} ms longest",
                short(step.median_ms),
                short(step.p99_ms),
                short(step.max_ms)
            ),
        )?;
        if let Some(factor) = self.timing.real_time_factor {
            let words = if factor >= 1.0 {
                format!("{}x faster than real time", short(factor))
            } else {
                format!("{}x slower than real time", short(1.0 / factor))
            };
            block.line("real time", format!("factor {} ({words})", short(factor)))?;
        }
        let machine = self.machine.processor.as_deref().unwrap_or(self.machine.architecture);
        block.line(
            "on",
            format!(
                "{} thread(s), {}; {machine}, {} cores, {}",
                self.settings.threads, self.settings.precision, self.machine.cores, self.machine.os
            ),
        )?;
        if let Some(gpu) = &self.gpu {
            let device: f64 = gpu.device_s.iter().map(|(_, s)| s).sum();
            let parts: Vec<_> =
                gpu.device_s.iter().map(|(n, s)| format!("{n} {}", seconds(*s))).collect();
            let software = if gpu.software { "no measure of speed; " } else { "" };
            block.line(
                "gpu",
                format!(
                    "{}; steps in f32; {software}device {} ({}), host {}; {:.1} MB up, {:.1} MB down",
                    gpu.adapter,
                    seconds(device),
                    parts.join(", "),
                    seconds(gpu.host_s),
                    gpu.bytes_up as f64 * 1e-6,
                    gpu.bytes_down as f64 * 1e-6
                ),
            )?;
        }
        let stages: Vec<String> = self
            .timing
            .stages
            .iter()
            .map(|s| format!("{} {} ({:.0} %)", s.name, seconds(s.total_s), 100.0 * s.share))
            .collect();
        block.line("time went to", stages.join(", "))?;
        for (i, system) in self.timing.systems.iter().enumerate() {
            block.line(
                if i == 0 { "time per system" } else { "" },
                format!(
                    "{:<24} {:>8} ms per step, {:>3.0} % of the steps, {} runs",
                    system.name,
                    short(system.per_step_ms),
                    100.0 * system.share,
                    system.runs
                ),
            )?;
        }
        let s = &self.solver;
        let per_step = |total: u64| short(total as f64 / step.count.max(1) as f64);
        if s.newton_iterations > 0 {
            block.line(
                "iterations",
                format!(
                    "CG {} per step (most {}), Newton {} per step (most {})",
                    per_step(s.cg_iterations),
                    s.cg_iterations_max,
                    per_step(s.newton_iterations),
                    s.newton_iterations_max
                ),
            )?;
        }
        if s.substeps > 0 {
            let stable = s
                .stable_step
                .map_or(String::new(), |h| format!(", smallest stable step {}", seconds(h)));
            block.line("substeps", format!("{} per step{stable}", per_step(s.substeps)))?;
        }
        Ok(())
    }

    fn accuracy(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut block = Block { f, width: self.label_width(), title: "How accurately" };
        let s = &self.solver;
        if s.newton_iterations > 0 {
            block.line(
                "linear systems",
                format!(
                    "worst relative residual {:.1e} (tolerance {:.0e}), {} at the iteration cap; \
                     preconditioner {}, computed {} times",
                    s.worst_residual,
                    self.settings.solver.linear_tolerance,
                    s.cg_caps,
                    s.preconditioner,
                    s.preconditioner_refreshes
                ),
            )?;
            if !self.settings.solver.integrator.converges() {
                let [start, indefinite, shortened, energy, inverted, waiting] = s.fallbacks;
                if s.second_order_steps > 0 {
                    block.line(
                        "linearised BDF2",
                        format!(
                            "{} steps; safe steps: {start} at a start, {indefinite} indefinite, \
                             {shortened} shortened, {energy} energy, {inverted} inverted, {waiting} \
                             waiting",
                            s.second_order_steps
                        ),
                    )?;
                }
                block.line(
                    "linearisation",
                    format!(
                        "energy decrease off its prediction by {:.1e} in the mean, {:.1e} at most",
                        s.linearisation_error_mean, s.linearisation_error_max
                    ),
                )?;
            } else {
                block.line(
                    "Newton",
                    format!(
                        "largest last step {:.1e} of the body size, {} steps unconverged",
                        s.worst_newton_step, s.unconverged_steps
                    ),
                )?;
            }
        }
        block.line(
            "safeguards",
            format!(
                "{} tangents projected, {} gradient fallbacks, {} backtracks, {} failed line \
                 searches, {} energy caps, {} refinements",
                s.projections,
                s.gradient_fallbacks,
                s.backtracks,
                s.line_search_failures,
                s.energy_caps,
                s.refinements
            ),
        )?;
        let e = &self.energy;
        match e.dissipated {
            Some(dissipated) => block.line(
                "energy (J)",
                format!(
                    "{} initial + {} loads + {} constraints{}{} = {} elastic + {} kinetic + {} damped + \
                     {} by the integrator",
                    short(e.initial),
                    short(e.load_work),
                    short(e.constraint_work),
                    if e.activation_work == 0.0 {
                        String::new()
                    } else {
                        format!(" + {} muscles", short(e.activation_work))
                    },
                    if e.removed == 0.0 {
                        String::new()
                    } else {
                        format!(" - {} removed", short(e.removed))
                    },
                    short(e.elastic),
                    short(e.kinetic),
                    short(e.damping),
                    short(dissipated - e.damping)
                ),
            )?,
            None => block.line("energy (J)", format!("{} elastic", short(e.elastic)))?,
        }
        let v = &self.volume;
        let when = if self.scene.mode == "static" {
            String::new()
        } else {
            format!(" at {} s", short(v.smallest_j_time))
        };
        block.line(
            "volume ratio J",
            format!(
                "smallest {}{when}, {} at the end; inverted elements: at most {}, {} at the end",
                short(v.smallest_j),
                short(v.final_smallest_j),
                v.inverted_max,
                v.inverted_final
            ),
        )?;
        block.line("state hash", &self.final_state_hash)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let texts: Vec<String> =
            [0.0, 1.0, 1060.0, 0.012345, 1234.5678, 3.2e-9, 1e7].map(short).into();
        assert_eq!(texts, ["0", "1", "1060", "0.01235", "1235", "3.20e-9", "1.00e7"]);
        assert_eq!(pressure(5000.0), "5 kPa");
        assert_eq!(seconds(0.0166667), "16.7 ms");
        assert_eq!(seconds(125.0), "2 min 05 s");
    }

    #[test]
    fn quantiles_are_taken_from_the_sorted_times() {
        let t = StepTiming::of((1..=200).rev().map(|i| f64::from(i) * 1e-3).collect());
        assert_eq!((t.count, t.median_ms, t.p99_ms, t.max_ms), (200, 100.0, 198.0, 200.0));
        assert_eq!(StepTiming::of(Vec::new()).median_ms, 0.0);
    }
}
