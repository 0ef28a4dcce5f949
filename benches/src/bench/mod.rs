//! Speed against error, in one run and one report.

pub mod accuracy;
pub mod aims;
pub mod arrays;
pub mod cases;
pub mod elements;
pub mod error;
pub mod flops;
pub mod integrators;
pub mod kernels;
pub mod membranes;
pub mod plot;
pub mod refine;
pub mod report;
pub mod roofline;
pub mod scenes;
pub mod stats;
pub mod step;

pub use sinew_tune::{machine, table};

use crate::peers::PeerOptions;
use error::BenchError;
use machine::Watch;
use report::Report;
use stats::Rounds;

/// Part of the bench.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Laws and matrices.
    Kernels,
    /// Whole steps, loading and building.
    Step,
    /// Speed against error.
    Accuracy,
    /// Integrators beside each other.
    Integrators,
    /// Demo scenes.
    Scenes,
    /// Other engines beside ours.
    Peers,
}

impl Part {
    /// All, in the order of reports.
    pub const ALL: [Self; 6] =
        [Self::Kernels, Self::Step, Self::Accuracy, Self::Integrators, Self::Scenes, Self::Peers];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        ["kernels", "step", "accuracy", "integrators", "scenes", "peers"][self as usize]
    }
}

/// What is measured.
#[derive(Clone, Debug, Default)]
pub struct BenchOptions {
    /// Smaller sizes, fewer repeats.
    pub quick: bool,
    /// Sizes of the beams of kernels and steps (tetrahedra, about); chosen by `quick` when empty.
    pub sizes: Vec<usize>,
    /// Cases of the accuracy part; all when empty.
    pub cases: Vec<String>,
    /// Python with the package `mujoco`, for the rivals.
    pub python: Option<String>,
}

/// Runs parts of the bench; `tell` hears what is going on.
///
/// # Errors
/// When something cannot be set up or stepped, or a size or case makes no sense.
pub fn run(
    command: &str,
    parts: &[Part],
    options: &BenchOptions,
    mut tell: impl FnMut(&str),
) -> Result<Report, BenchError> {
    for &size in &options.sizes {
        if !(24..=5_000_000).contains(&size) {
            return Err(BenchError::Request {
                what: format!("a beam of {size} tetrahedra"),
                remedy: "choose a size between 24 and 5000000".into(),
            });
        }
    }
    let quick = options.quick;
    let mut report = Report::new(command, quick);
    let cores = report.machine.cores;
    let threads = if cores > 1 { vec![1, 2] } else { vec![1] };
    let sizes = |quick_sizes: &[usize]| match (options.sizes.is_empty(), quick) {
        (false, _) => options.sizes.clone(),
        (true, true) => quick_sizes.to_vec(),
        (true, false) => vec![5_000, 50_000, 500_000],
    };
    // of the quick and of the full bench
    let rounds = |most: [usize; 2], least: [usize; 2], seconds: [f64; 2]| {
        let i = usize::from(!quick);
        Rounds { most: most[i], least: least[i], seconds: seconds[i] }
    };
    for &part in parts {
        let watch = Watch::start();
        match part {
            Part::Kernels => {
                tell("limits of the machine");
                report.limits = roofline::probe(&report.machine, &threads);
                let rounds = rounds([8, 25], [3, 4], [0.15, 1.0]);
                let (sizes, threads) = (sizes(&[5_000, 50_000]), threads.clone());
                let kernels = kernels::SizeOptions { sizes, threads, rounds };
                report.kernels = Some(kernels::run(&kernels, &report.limits, &mut tell)?);
            }
            Part::Step => {
                let rounds = rounds([8, 12], [2, 3], [0.2, 0.5]);
                let (sizes, threads) = (sizes(&[5_000]), threads.clone());
                let step = kernels::SizeOptions { sizes, threads, rounds };
                report.step = Some(step::run(&step, &mut tell)?);
            }
            Part::Accuracy => {
                let rounds = rounds([3, 5], [1, 1], [0.05, 0.5]);
                let only = options.cases.clone();
                let python = options.python.clone().unwrap_or(PeerOptions::default().python);
                let accuracy = accuracy::AccuracyOptions { quick, rounds, only, python };
                report.accuracy = Some(accuracy::run(&accuracy, &mut tell)?);
            }
            Part::Integrators => {
                report.integrators = Some(integrators::run(quick, &mut tell)?);
            }
            Part::Scenes => {
                report.scenes = Some(scenes::run(quick.then_some(50), &mut tell)?);
            }
            Part::Peers => {
                tell("peers");
                let default = PeerOptions::default();
                let python = options.python.clone().unwrap_or(default.python);
                let only = options.cases.clone();
                let options = PeerOptions { quick, python, only, ..PeerOptions::default() };
                report.peers = Some(crate::peers::run(&options)?);
            }
        }
        report.add_load(part.name(), watch.finish());
    }
    report.work_out_aims();
    Ok(report)
}
