//! Speed against error, in one run and one report.

pub mod accuracy;
pub mod aims;
pub mod arrays;
pub mod bar;
pub mod cases;
pub mod contact;
pub mod cutting;
pub mod elements;
pub mod flops;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod haptics;
pub mod integrators;
pub mod kernels;
pub mod membranes;
pub mod report;
pub mod resection;
pub mod roofline;
pub mod scenes;
pub mod spring_products;
pub mod step;
pub mod subject;

use crate::toolbox::error::{BenchError, Result};
use crate::toolbox::options::BenchOptions;
use crate::toolbox::stats::Rounds;
use report::BenchReport;
use sinew_tune::machine::Watch;

/// Part of the bench.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BenchPart {
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
    /// Frame times while elements are removed.
    Resection,
    /// Steps in which a blade cuts beside those without it.
    Cutting,
    /// Steps with contact beside those without.
    Contact,
    /// A haptic device beside couplings that are usual, and what it costs.
    Haptics,
    /// Graphics processor beside processor.
    #[cfg(feature = "gpu")]
    Gpu,
}

impl BenchPart {
    /// Those of `all`, in the order of reports.
    pub const ALL: [Self; 6] =
        [Self::Kernels, Self::Step, Self::Accuracy, Self::Integrators, Self::Scenes, Self::Peers];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Kernels => "kernels",
            Self::Step => "step",
            Self::Accuracy => "accuracy",
            Self::Integrators => "integrators",
            Self::Scenes => "scenes",
            Self::Peers => "peers",
            Self::Resection => "resection",
            Self::Cutting => "cutting",
            Self::Contact => "contact",
            Self::Haptics => "haptics",
            #[cfg(feature = "gpu")]
            Self::Gpu => "gpu",
        }
    }
}

/// Runs parts of the bench; `tell` hears what is going on.
///
/// # Errors
/// When something cannot be set up or stepped, or a size or case makes no sense.
pub fn run(
    command: &str,
    parts: &[BenchPart],
    options: &BenchOptions,
    mut tell: impl FnMut(&str),
) -> Result<BenchReport> {
    for &size in &options.sizes {
        if !(24..=5_000_000).contains(&size) {
            return Err(BenchError::Request {
                what: format!("a beam of {size} tetrahedra"),
                remedy: "choose a size between 24 and 5000000".into(),
            });
        }
    }
    // beside other parts, those that take many minutes are as short as in a quick bench: one page has to be there in minutes
    let (quick, brief) = (options.quick, options.quick || parts.len() > 1);
    let short = BenchOptions { quick: brief, ..options.clone() };
    let mut report = BenchReport::new(command, quick);
    let cores = report.machine.cores;
    let threads = if cores > 1 { vec![1, 2] } else { vec![1] };
    // so many of the usual sizes, of the quick and of the full bench
    let sizes = |count: [usize; 2]| match options.sizes.is_empty() {
        false => options.sizes.clone(),
        true => [5_000, 50_000, 500_000][..count[usize::from(!quick)]].to_vec(),
    };
    // of the quick and of the full bench
    let rounds = |most: [usize; 2], least: [usize; 2], seconds: [f64; 2]| {
        let i = usize::from(!quick);
        Rounds { most: most[i], least: least[i], seconds: seconds[i] }
    };
    for &part in parts {
        let watch = Watch::start();
        let mut aims = Vec::new();
        match part {
            BenchPart::Kernels => {
                tell("limits of the machine");
                report.limits = roofline::probe(&report.machine, &threads);
                let rounds = rounds([8, 25], [3, 3], [0.15, 0.3]);
                let limits = &report.limits;
                let found = kernels::run(&sizes([2, 3]), &threads, rounds, limits, &mut tell)?;
                report.kernels = Some(found);
            }
            BenchPart::Step => {
                let rounds = rounds([8, 12], [2, 2], [0.2, 0.3]);
                let sizes = sizes([1, if brief { 2 } else { 3 }]);
                report.step = Some(step::run(&sizes, &threads, rounds, &mut tell)?);
            }
            BenchPart::Accuracy => {
                let rounds = rounds([3, 5], [1, 1], [0.05, 0.5]);
                report.accuracy = Some(accuracy::run(&short, rounds, &mut tell)?);
            }
            BenchPart::Integrators => report.tables.extend(integrators::run(brief, &mut tell)?),
            BenchPart::Scenes => {
                report.tables.push(scenes::run(brief.then_some(50), &mut tell)?);
            }
            BenchPart::Peers => {
                tell("peers");
                report.peers = Some(crate::peers::run(&short)?);
            }
            BenchPart::Resection => {
                let frames = if quick { 100 } else { 500 };
                report.tables.extend(resection::run(&sizes([1, 2]), frames, 2, &mut tell)?);
            }
            BenchPart::Cutting => {
                let found = cutting::run(&sizes([1, 2]), &threads, &mut tell)?;
                report.tables.push(found.0);
                aims = found.1;
            }
            BenchPart::Contact => {
                let (repeats, kinds) = (if brief { 2 } else { 5 }, &options.cases);
                let sizes = sizes([1, if brief { 1 } else { 2 }]);
                let found = contact::run(&sizes, &threads, repeats, kinds, &mut tell)?;
                report.tables.push(found.0);
                aims = found.1;
            }
            BenchPart::Haptics => {
                let found = haptics::run(quick, &mut tell)?;
                report.tables.extend(found.0);
                aims = found.1;
            }
            #[cfg(feature = "gpu")]
            BenchPart::Gpu => {
                let steps = if quick { 5 } else { 20 };
                report.tables.extend(gpu::run(&sizes([1, 2]), steps, &mut tell)?);
            }
        }
        report.add_load(part.name(), watch.finish());
        report.add_aims(part.name(), aims);
    }
    report.work_out_aims();
    Ok(report)
}
