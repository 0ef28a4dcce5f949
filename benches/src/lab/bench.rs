//! `sinew-lab bench`.

use clap::{Args, Subcommand};
use sinew_benches::bench::{BenchPart, run};
use sinew_benches::stability::SuiteOptions;
use sinew_benches::toolbox::options::BenchOptions;
use sinew_cli::{Outcome, print};
use std::path::PathBuf;

#[derive(Subcommand)]
pub enum BenchCommand {
    /// Laws, gather and matrices: ns per tetrahedron, roofline, error.
    Kernels(BenchArguments),
    /// Whole steps, loading and building.
    Step(BenchArguments),
    /// Speed against error of every method on every scene, with Pareto fronts; and of kinds of elements from
    /// compressible to nearly incompressible, beside MuJoCo flex (see --python) and Rapier (build with --features rapier).
    Accuracy(BenchArguments),
    /// Integrators beside each other: order, work against error, spin.
    Integrators(BenchArguments),
    /// The demo scenes as they are.
    Scenes(BenchArguments),
    /// Sinew beside MuJoCo flex (pip install mujoco; see --python) and Rapier (build with --features
    /// rapier), same mesh, material and load: beams, and a ball pressed into a block; what is absent is skipped
    /// with a message.
    Peers(BenchArguments),
    /// Frame times while one tetrahedron a frame is removed, on two threads; not part of `all`.
    Resection(BenchArguments),
    /// Steps in which a blade cuts beside steps without it, in turns; not part of `all`.
    Cutting(BenchArguments),
    /// Steps with contact beside those without, in turns: a tool far away, slow and fast, two bodies, a liver that is
    /// palpated; not part of `all`.
    Contact(BenchArguments),
    /// A haptic device that holds a liver: force beside a simulation at 1 kHz, devices that are let go, and what it costs; beside
    /// plain virtual coupling and a proxy, in turns; not part of `all`.
    Haptics(BenchArguments),
    /// Force passes and implicit steps on the graphics processor beside the processor, with the errors of both;
    /// not part of `all`. The environment variable SINEW_ADAPTER names an adapter.
    #[cfg(feature = "gpu")]
    Gpu(BenchArguments),
    /// Everything but `resection`, `cutting`, `contact`, `haptics`, `gpu` and `stability`, one report.
    All(BenchArguments),
    /// Run the hard cases and print the pass table; fails when a case misses that must pass.
    Stability(StabilityArguments),
}

#[derive(Args)]
pub struct BenchArguments {
    #[command(flatten)]
    options: BenchOptions,
    /// Folder for report.html, report.json, readme.md, one CSV per table and one SVG per chart.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the JSON report instead of tables.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
pub struct StabilityArguments {
    #[command(flatten)]
    options: SuiteOptions,
    /// File for the JSON form; `-` prints it instead of the tables.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Page with all cases: a file, or a folder for stability.html.
    #[arg(long, value_name = "FILE|DIR")]
    html: Option<PathBuf>,
}

/// What to measure, its name, and how.
fn measured(command: &BenchCommand) -> Option<(Vec<BenchPart>, &'static str, &BenchArguments)> {
    let (part, arguments) = match command {
        BenchCommand::Kernels(a) => (BenchPart::Kernels, a),
        BenchCommand::Step(a) => (BenchPart::Step, a),
        BenchCommand::Accuracy(a) => (BenchPart::Accuracy, a),
        BenchCommand::Integrators(a) => (BenchPart::Integrators, a),
        BenchCommand::Scenes(a) => (BenchPart::Scenes, a),
        BenchCommand::Peers(a) => (BenchPart::Peers, a),
        BenchCommand::Resection(a) => (BenchPart::Resection, a),
        BenchCommand::Cutting(a) => (BenchPart::Cutting, a),
        BenchCommand::Contact(a) => (BenchPart::Contact, a),
        BenchCommand::Haptics(a) => (BenchPart::Haptics, a),
        #[cfg(feature = "gpu")]
        BenchCommand::Gpu(a) => (BenchPart::Gpu, a),
        BenchCommand::All(a) => return Some((BenchPart::ALL.to_vec(), "all", a)),
        BenchCommand::Stability(_) => return None,
    };
    Some((vec![part], part.name(), arguments))
}

/// The command that makes such a report.
fn command(what: &str, options: &BenchOptions) -> String {
    let mut words = vec!["sinew-lab bench".to_string(), what.into()];
    if options.quick {
        words.push("--quick".into());
    }
    if !options.sizes.is_empty() {
        let sizes: Vec<String> = options.sizes.iter().map(usize::to_string).collect();
        words.push(format!("--tets {}", sizes.join(",")));
    }
    words.extend(options.cases.iter().map(|case| format!("--case \"{case}\"")));
    words.push("--out DIR".into());
    words.join(" ")
}

pub fn bench(bench: &BenchCommand) -> Outcome {
    match (bench, measured(bench)) {
        (BenchCommand::Stability(arguments), _) => stability(arguments),
        (_, Some((parts, what, arguments))) => measure(&parts, what, arguments),
        (_, None) => Ok(true),
    }
}

fn stability(arguments: &StabilityArguments) -> Outcome {
    let tell = |done: usize, all: usize| {
        if done == all || done.is_multiple_of(100) {
            eprintln!("{done} of {all} cases");
        }
    };
    let suite = sinew_benches::stability::run(&arguments.options, tell)?;
    let json = || serde_json::to_string_pretty(&suite);
    match &arguments.json {
        Some(path) if path.as_os_str() == "-" => print(format_args!("{}\n", json()?))?,
        path => {
            print(format_args!("{suite}"))?;
            if let Some(path) = path {
                let error = |e| format!("{}: {e}", path.display());
                std::fs::write(path, json()? + "\n").map_err(error)?;
                eprintln!("written to {}", path.display());
            }
        }
    }
    if let Some(path) = &arguments.html {
        eprintln!("written to {}", suite.write_html(path)?.display());
    }
    Ok(suite.passed())
}

fn measure(parts: &[BenchPart], what: &str, arguments: &BenchArguments) -> Outcome {
    if cfg!(debug_assertions) {
        eprintln!(
            "warning: this is a debug build; use `cargo run --release` for figures that count"
        );
    }
    let options = &arguments.options;
    let tell = |what: &str| eprintln!("{what}");
    let report = run(&command(what, options), parts, options, tell)?;
    if arguments.json {
        print(format_args!("{}\n", serde_json::to_string_pretty(&report)?))?;
    } else {
        print(format_args!("{}", report.text()))?;
    }
    if let Some(folder) = &arguments.out {
        let files = report.write(folder)?;
        eprintln!("{} files written to {}", files.len(), folder.display());
    }
    Ok(true)
}
