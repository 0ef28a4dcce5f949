//! `sinew bench`.

use crate::{Outcome, print};
use clap::{Args, ValueEnum};
use sinew_benches::bench::{BenchOptions, Part, run};
use std::path::PathBuf;

#[derive(Args)]
pub struct BenchArguments {
    /// What to measure.
    what: What,
    /// Smaller sizes and fewer repeats: a minute or two instead of a quarter of an hour.
    #[arg(long)]
    quick: bool,
    /// Folder for report.html, report.json, readme.md, one CSV per table and one SVG per chart.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the JSON report instead of tables.
    #[arg(long)]
    json: bool,
    /// Sizes of the beams of kernels and steps in tetrahedra, such as 5000,50000.
    #[arg(long, value_name = "N", value_delimiter = ',')]
    tets: Vec<usize>,
    /// Only this case of the accuracy part; may be given several times.
    #[arg(long = "case", value_name = "NAME")]
    cases: Vec<String>,
    /// Python with the package `mujoco` [default: python3].
    #[arg(long, value_name = "PATH")]
    python: Option<String>,
}

#[derive(Clone, Copy, ValueEnum)]
enum What {
    /// Laws, gather and matrices: ns per tetrahedron, roofline, error.
    Kernels,
    /// Whole steps, loading and building.
    Step,
    /// Speed against error of every method on every scene, with Pareto fronts.
    Accuracy,
    /// Integrators beside each other: order, work against error, spin.
    Integrators,
    /// The demo scenes as they are.
    Scenes,
    /// Sinew beside MuJoCo flex (pip install mujoco; see --python) and Rapier (build with --features
    /// sinew-cli/rapier), same mesh, material and load; what is absent is skipped with a message.
    Peers,
    /// Everything, one report.
    All,
}

impl BenchArguments {
    fn parts(&self) -> Vec<Part> {
        match self.what {
            What::Kernels => vec![Part::Kernels],
            What::Step => vec![Part::Step],
            What::Accuracy => vec![Part::Accuracy],
            What::Integrators => vec![Part::Integrators],
            What::Scenes => vec![Part::Scenes],
            What::Peers => vec![Part::Peers],
            What::All => {
                vec![
                    Part::Kernels,
                    Part::Step,
                    Part::Accuracy,
                    Part::Integrators,
                    Part::Scenes,
                    Part::Peers,
                ]
            }
        }
    }

    /// The command that makes such a report.
    fn command(&self) -> String {
        let what = self.what.to_possible_value().map_or(String::new(), |v| v.get_name().into());
        let mut words = vec!["sinew bench".to_string(), what];
        if self.quick {
            words.push("--quick".into());
        }
        if !self.tets.is_empty() {
            let sizes: Vec<String> = self.tets.iter().map(usize::to_string).collect();
            words.push(format!("--tets {}", sizes.join(",")));
        }
        words.extend(self.cases.iter().map(|case| format!("--case \"{case}\"")));
        words.push("--out DIR".into());
        words.join(" ")
    }
}

pub fn bench(arguments: &BenchArguments) -> Outcome {
    if cfg!(debug_assertions) {
        eprintln!(
            "warning: this is a debug build; use `cargo run --release` for figures that count"
        );
    }
    let options = BenchOptions {
        quick: arguments.quick,
        sizes: arguments.tets.clone(),
        cases: arguments.cases.clone(),
        python: arguments.python.clone(),
    };
    let tell = |what: &str| eprintln!("{what}");
    let report = run(&arguments.command(), &arguments.parts(), &options, tell)?;
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
