//! The top of a scene file.

use super::body::BodyEntry;
use super::conditions::{ConstraintEntry, LoadEntry, PressureEntry, Selection};
use super::resection::{CutEntry, ResectionEntry};
use super::thread::{ClipEntry, ThreadEntry};
use super::touch::{ContactEntry, PullEntry, ToolEntry};
use serde::{Deserialize, Serialize};
use sinew::engine::lanes::InstructionSet;
use sinew::engine::schedule::Executor;
use sinew::simulation::{Backend, Precision};
use sinew::solvers::settings::SolverSettings;

/// A scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Name for reports and files.
    pub name: String,
    /// One or two sentences: what happens and what to look at.
    #[serde(default)]
    pub description: String,
    /// Motion over time, or one equilibrium.
    #[serde(default)]
    pub mode: Mode,
    /// Acceleration of gravity (m/s^2); default `[0, 0, -9.81]`.
    #[serde(default = "default_gravity")]
    pub gravity: [f64; 3],
    /// Step length (s); dynamic scenes.
    pub dt: Option<f64>,
    /// Simulated time (s); dynamic scenes.
    pub duration: Option<f64>,
    /// Parts in which gravity, loads and motions are applied; static scenes, default 1.
    pub load_steps: Option<u32>,
    /// Number type, `"f64"` (default) or `"f32"`.
    #[serde(default)]
    pub precision: PrecisionName,
    /// Where steps are computed, `"cpu"` (default) or `"gpu"`.
    #[serde(default)]
    pub backend: BackendName,
    /// Threads; 0 (default) means one per core. Results do not depend on it.
    #[serde(default)]
    pub threads: usize,
    /// Whether independent systems run one after another (default) or side by side. Results do not depend on
    /// it.
    #[serde(default)]
    pub executor: ExecutorName,
    /// Instruction set of the kernels, the best of the machine without it. Results depend on it in the last
    /// digits.
    pub instruction_set: Option<InstructionSet>,
    /// Integrator, tolerances and damping.
    #[serde(default)]
    pub solver: SolverSettings,
    /// Bodies.
    #[serde(default, rename = "body")]
    pub bodies: Vec<BodyEntry>,
    /// Held and moved vertices.
    #[serde(default, rename = "constraint")]
    pub constraints: Vec<ConstraintEntry>,
    /// Forces.
    #[serde(default, rename = "load")]
    pub loads: Vec<LoadEntry>,
    /// Elements that are removed on the way.
    #[serde(default, rename = "resection")]
    pub resections: Vec<ResectionEntry>,
    /// Cuts that are made on the way.
    #[serde(default, rename = "cut")]
    pub cuts: Vec<CutEntry>,
    /// Follower pressures.
    #[serde(default, rename = "pressure")]
    pub pressures: Vec<PressureEntry>,
    /// Rigid tools.
    #[serde(default, rename = "tool")]
    pub tools: Vec<ToolEntry>,
    /// Springs to moving hands.
    #[serde(default, rename = "pull")]
    pub pulls: Vec<PullEntry>,
    /// Bodies that may touch each other.
    #[serde(default, rename = "contact")]
    pub contacts: Vec<ContactEntry>,
    /// Threads through tissue.
    #[serde(default, rename = "thread")]
    pub strands: Vec<ThreadEntry>,
    /// Clips between points of tissue.
    #[serde(default, rename = "clip")]
    pub clips: Vec<ClipEntry>,
    /// Columns of the CSV file.
    #[serde(default, rename = "probe")]
    pub probes: Vec<ProbeEntry>,
    /// What is written, and how often.
    #[serde(default)]
    pub output: Output,
}

fn default_gravity() -> [f64; 3] {
    [0.0, 0.0, -9.81]
}

/// Kind of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Motion over time.
    #[default]
    Dynamic,
    /// Equilibrium under the full loads.
    Static,
}

/// Words of a scene file that stand for values of the library.
macro_rules! words {
    ($(
        $(#[$about:meta])*
        $name:ident for $target:ident { $($(#[$variant_about:meta])* $variant:ident => $value:ident,)* }
    )*) => {$(
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(rename_all = "lowercase")]
        pub enum $name {
            $($(#[$variant_about])* $variant,)*
        }

        impl From<$name> for $target {
            fn from(name: $name) -> Self {
                match name {
                    $($name::$variant => Self::$value,)*
                }
            }
        }
    )*};
}

words! {
    /// Number type of the state.
    #[derive(Default)]
    PrecisionName for Precision {
        /// 64-bit.
        #[default]
        F64 => F64,
        /// 32-bit.
        F32 => F32,
    }

    /// Where steps are computed.
    #[derive(Default)]
    BackendName for Backend {
        /// The processor.
        #[default]
        Cpu => Cpu,
        /// A graphics processor; needs the cargo feature `gpu`.
        Gpu => Gpu,
    }

    /// How independent systems run.
    #[derive(Default)]
    ExecutorName for Executor {
        /// One after another, each of them on all threads.
        #[default]
        Single => SingleThreaded,
        /// Side by side.
        Multi => MultiThreaded,
    }
}

/// Columns of the CSV file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProbeEntry {
    /// Name, unique among probes; the columns start with it.
    pub name: String,
    /// Name of the body; may be left out when there is only one.
    pub body: Option<String>,
    /// Which vertices; the whole body without it.
    pub select: Option<Selection>,
    /// Name of a constraint, for `reaction`.
    pub constraint: Option<String>,
    /// Name of a tool, for what it feels.
    pub tool: Option<String>,
    /// Number of a part of the tool, from 0, for what that part feels.
    pub part: Option<usize>,
    /// Name of a pull, likewise.
    pub pull: Option<String>,
    /// Name of a contact, likewise.
    pub contact: Option<String>,
    /// Name of a thread, likewise.
    pub thread: Option<String>,
    /// Name of a clip, likewise.
    pub clip: Option<String>,
    /// What to record: keys of [`PROBES`](crate::probe::PROBES).
    pub record: Vec<String>,
}

/// What is written.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Output {
    /// VTU frames per simulated second; default 30. Either this or `every`.
    pub frames_per_second: Option<f64>,
    /// Steps from one VTU frame to the next. Either this or `frames_per_second`.
    pub every: Option<u64>,
    /// Steps from one row of the CSV file to the next; default 1.
    pub probe_every: Option<u64>,
}
