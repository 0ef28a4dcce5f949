//! The `sinew` command. Results go to stdout, progress and errors to stderr; the exit code is 0 when
//! all went well, 1 for bad input or a failed run, 2 for a wrong command line, 3 for a sweep with failed runs.
#![allow(clippy::print_stderr, reason = "a command speaks to its terminal")]

mod advise;
mod fit;
mod fit_data;
mod generate;
mod new;
mod plot;
mod progress;
mod render;
mod sweep;
#[cfg(feature = "view")]
mod view;

use advise::{AdviseArguments, advise_scene};
use clap::{Args, CommandFactory, Parser, Subcommand};
use clap_complete::{Shell, generate as completions};
use fit::{FitArguments, fit};
use generate::GeneratedShape;
use progress::Progress;
use sinew::engine::lanes::InstructionSet;
use sinew::engine::mesh::merge::MERGE_TOLERANCE;
use sinew::engine::schedule::Executor;
use sinew::models::body::Evaluation;
use sinew::models::material::YoungPoisson;
use sinew::prelude::{Integrator, Model};
use sinew::simulation::{Backend, Precision};
use sinew_cli::{Outcome, PrecisionArgument, choice, exit_code, print, quiet_driver};
use sinew_scene::assemble::{BuildOptions, generate};
use sinew_scene::cell_springs::{CellFibres, SpringTable};
use sinew_scene::check::{check_file, mistakes};
use sinew_scene::fill::fill;
use sinew_scene::mesh_tool::{MeshInfo, convert, lattice, merge, read, write};
use sinew_scene::picture::{page_beside, run_to_page};
use sinew_scene::run::{LogOptions, Observer, RunOptions, Silent, replay, run};
use sinew_scene::scene::{BackendName, ExecutorName, LoadedScene};
use sinew_scene::schema::schema;
use sinew_scene::validate::{ValidateOptions, validate};
use sinew_tune::advise::Choice;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

macro_rules! say {
    ($($argument:tt)*) => { print(format_args!($($argument)*))? };
}

macro_rules! sayln {
    ($($argument:tt)*) => { print(format_args!("{}\n", format_args!($($argument)*)))? };
}

/// Soft tissue: simulate scenes, check meshes, validate against reference solutions, fit, advise.
#[derive(Parser)]
#[command(
    name = "sinew",
    version,
    about,
    after_help = "Benches, hard cases and rivals are the other command: `sinew-lab`, that is `cargo run \
                  --release -p sinew-benches -- --help`."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Simulate a scene and report what happened.
    Run(RunArguments),
    /// Simulate a scene and make a page with a player of it, in a build with the feature `render` also pictures and films.
    Render(Box<render::RenderArguments>),
    /// Open a window in which a scene runs, is pulled at by the mouse and cut.
    #[cfg(feature = "view")]
    View(view::ViewArguments),
    /// In a build with the feature `view`: a window in which a scene runs.
    #[cfg(not(feature = "view"))]
    #[command(hide = true, disable_help_flag = true)]
    View(Elsewhere),
    /// Write a commented scene for a mesh of your own.
    New(new::NewArguments),
    /// List the tissues, with sources and how far publications differ.
    Presets(new::PresetArguments),
    /// Draw what runs recorded over time, several runs over each other.
    Plot(plot::PlotArguments),
    /// Benches are of `sinew-lab`.
    #[command(hide = true, disable_help_flag = true)]
    Bench(Elsewhere),
    /// Do again what `sinew run --record` wrote, and stop at the first state that differs.
    Replay(ReplayArguments),
    /// Check a scene or a mesh without simulating it.
    Check(CheckArguments),
    /// Run reference cases and compare with their stored truth.
    Validate(ValidateArguments),
    /// Find the settings that run a scene within a budget of time and error on this machine.
    Advise(AdviseArguments),
    /// Find the springs of a mesh and say what they are worth, or, with --data, the material constants of a
    /// static scene from measured displacements or forces.
    Fit(FitArguments),
    /// Run a scene many times with other values: plan, run in parts on any machines, merge into one table.
    #[command(subcommand)]
    Sweep(sweep::SweepCommand),
    /// Print the JSON schema of scene files, for editors.
    Schema,
    /// Print what makes a shell complete this command; `source <(sinew completions bash)`.
    Completions {
        /// Which shell.
        shell: Shell,
    },
    /// Look at, convert or generate a mesh.
    #[command(subcommand)]
    Mesh(MeshCommand),
}

#[derive(Args)]
struct RunArguments {
    /// Scene file (TOML).
    scene: PathBuf,
    /// Folder for frames (VTU, PVD), probes (CSV) and summary (JSON).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Page with an interactive player, for any browser [default: NAME.html beside the other files, in `out` without --out;
    /// none with --resume, and without --out none with --quiet or --json -].
    #[arg(long, value_name = "FILE", conflicts_with = "resume")]
    page: Option<PathBuf>,
    /// No page.
    #[arg(long, conflicts_with = "page")]
    no_page: bool,
    /// File for the JSON summary; `-` prints it instead of the report.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    build: BuildArguments,
    /// Time integrator.
    #[arg(long, value_parser = choice::<Integrator>)]
    integrator: Option<Integrator>,
    /// Step (s) of a dynamic scene.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    dt: Option<f64>,
    /// Parts in which a static scene applies its loads.
    #[arg(long, value_name = "N")]
    load_steps: Option<u32>,
    /// Relative residual at which a linear system counts as solved.
    #[arg(long, value_name = "X")]
    linear_tolerance: Option<f64>,
    /// Newton step over body size at which Newton has converged.
    #[arg(long, value_name = "X")]
    newton_tolerance: Option<f64>,
    /// Evaluation of all bodies: fused or pooled.
    #[arg(long, value_parser = choice::<Evaluation>)]
    evaluation: Option<Evaluation>,
    #[arg(long, value_parser = choice::<Model>, help = format!("Energy of all bodies: {}", models()))]
    model: Option<Model>,
    /// Leave a checkpoint in the folder of --out every so much simulated time, such as 0.5s or 20ms; the last two are
    /// kept until the run is complete.
    #[arg(long, value_name = "TIME", value_parser = simulated_time)]
    checkpoint: Option<f64>,
    /// Go on from the last checkpoint in the folder of --out, as if the run had never stopped; from the beginning where
    /// there is none.
    #[arg(long)]
    resume: bool,
    /// Write every input and hashes of the state to a file, for `sinew replay`.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Steps between the hashes of --record.
    #[arg(long, value_name = "N", default_value_t = 10, requires = "record", value_parser = clap::value_parser!(u64).range(1..))]
    hash_every: u64,
    /// The whole report: settings, times, accuracy.
    #[arg(long, short, conflicts_with = "quiet")]
    verbose: bool,
    /// No progress bar and no report.
    #[arg(long, short)]
    quiet: bool,
}

// how a scene is carried out; without a word of documentation, which would become that of the command
#[derive(Args)]
struct BuildArguments {
    /// Threads, 0 for one per core; results do not depend on it.
    #[arg(long)]
    threads: Option<usize>,
    /// Independent systems run one after another (single) or side by side (multi); results do not depend on it.
    #[arg(long, value_parser = choice::<ExecutorName>)]
    executor: Option<ExecutorName>,
    /// Instruction set: portable (the same bits on every machine), avx2 or avx512; the best there is without.
    #[arg(long, value_parser = choice::<InstructionSet>)]
    instruction_set: Option<InstructionSet>,
    /// Number type of the state.
    #[arg(long)]
    precision: Option<PrecisionArgument>,
    /// Where steps are computed: cpu, or gpu in a build with that feature (the environment variable
    /// SINEW_ADAPTER names an adapter).
    #[arg(long, value_parser = choice::<BackendName>)]
    backend: Option<BackendName>,
    /// Carry out this many steps instead of the whole scene.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    steps: Option<u64>,
}

impl BuildArguments {
    fn options(&self) -> BuildOptions {
        BuildOptions {
            precision: self.precision.map(Precision::from),
            backend: self.backend.map(Backend::from),
            threads: self.threads,
            beside_host: false,
            steps: self.steps,
            executor: self.executor.map(Executor::from),
            instruction_set: self.instruction_set,
        }
    }
}

/// Whatever is given to a command that is not in this program.
#[derive(Args)]
struct Elsewhere {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    _arguments: Vec<String>,
}

/// Tells where a command is; 2, as for a wrong command line.
fn elsewhere(told: &str) -> ExitCode {
    eprintln!("error: {told}");
    ExitCode::from(2)
}

#[derive(Args)]
struct ReplayArguments {
    /// Log that `sinew run --record` wrote.
    log: PathBuf,
    /// Where the scene file is, if it is no more where it was.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Threads, 0 for one per core; results do not depend on it.
    #[arg(long)]
    threads: Option<usize>,
}

/// A time such as `2s`, `0.5s` or `20ms`, in seconds.
fn simulated_time(text: &str) -> Result<f64, String> {
    let (number, unit) = match text.strip_suffix("ms") {
        Some(number) => (number, 1e-3),
        None => (text.strip_suffix('s').unwrap_or(text), 1.0),
    };
    match number.trim().parse::<f64>() {
        Ok(time) if time > 0.0 && time.is_finite() => Ok(time * unit),
        _ => Err("give a positive time, such as 0.5s or 20ms".into()),
    }
}

/// Names of models that every body can have.
fn models() -> String {
    Model::ALL.map(Model::name).join(", ")
}

#[derive(Args)]
struct CheckArguments {
    /// Scene (.toml) or mesh (.msh, .vtk, .vtu, .node, .ele, .obj, .stl).
    file: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
struct ValidateArguments {
    /// Case files (JSON) or folders of them [default: the cases that come with Sinew, demos/reference].
    cases: Vec<PathBuf>,
    /// File for the JSON report; `-` prints it instead of the table.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Relative difference at which a case passes [default: 1e-6 static, 1e-8 trajectories].
    #[arg(long, value_name = "X")]
    tolerance: Option<f64>,
    /// Folder with the meshes of the cases [default: meshes beside the case or its folder].
    #[arg(long, value_name = "DIR")]
    meshes: Option<PathBuf>,
    /// Sum the energy spring by spring instead of tetrahedron by tetrahedron.
    #[arg(long)]
    pooled: bool,
    /// Threads, 0 for one per core.
    #[arg(long, default_value_t = 1)]
    threads: usize,
}

#[derive(Subcommand)]
enum MeshCommand {
    /// What is in a mesh file.
    Info {
        /// Mesh file.
        file: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// From one format to another; extensions tell which.
    Convert {
        /// Mesh file to read.
        from: PathBuf,
        /// Mesh file to write (.msh, .vtk, .vtu).
        to: PathBuf,
        /// Factor on all coordinates (0.001 for a mesh in millimetres).
        #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
        scale: f64,
        /// A vertex in the middle of every edge: linear tetrahedra become ten-node ones.
        #[arg(long)]
        second_order: bool,
        /// Mesh or surface file on which the vertices on edges of the surface are put: elements are curved as the body is. Takes
        /// the same scale.
        #[arg(long, value_name = "FILE")]
        onto: Option<PathBuf>,
    },
    /// Makes one vertex of those that lie at one place, as on both sides of a seam.
    Merge {
        /// Mesh file to read.
        from: PathBuf,
        /// Mesh file to write (.msh, .vtk, .vtu).
        to: PathBuf,
        /// Distance within which vertices are one, as a share of the size of the mesh.
        #[arg(long, default_value_t = MERGE_TOLERANCE, allow_negative_numbers = true)]
        tolerance: f64,
    },
    /// Tetrahedra inside a closed surface, by Gmsh, which must be installed.
    Fill {
        /// Surface file (.stl, .obj) or mesh, whose inside is filled anew.
        from: PathBuf,
        /// Mesh file to write (.msh, .vtk, .vtu).
        to: PathBuf,
        /// Edge of the tetrahedra (m), with new triangles on the surface [default: triangles stay as they are].
        #[arg(long, value_name = "M", allow_negative_numbers = true)]
        edge: Option<f64>,
        /// Factor on all coordinates (0.001 for a surface in millimetres).
        #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
        scale: f64,
    },
    /// Cubes over what a closed surface encloses; the cell data `filled` says how much of each.
    Lattice {
        /// Surface file (.stl, .obj) or mesh.
        from: PathBuf,
        /// Mesh file to write (.msh, .vtk, .vtu).
        to: PathBuf,
        /// Edge of the cubes (m).
        #[arg(long, allow_negative_numbers = true)]
        cell: f64,
        /// Factor on all coordinates (0.001 for a surface in millimetres).
        #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
        scale: f64,
    },
    /// The springs of tetrahedra or triangles that are St Venant-Kirchhoff elasticity: 21 of a tetrahedron, 6 of
    /// a triangle (Delingette 2008).
    Springs {
        /// Mesh file.
        file: PathBuf,
        /// Young's modulus (Pa).
        #[arg(long, allow_negative_numbers = true)]
        young: f64,
        /// Poisson's ratio.
        #[arg(long, allow_negative_numbers = true)]
        poisson: f64,
        /// Thickness (m) of triangles, in plane stress.
        #[arg(long, allow_negative_numbers = true)]
        thickness: Option<f64>,
        /// Direction of biquadratic fibres, whose springs are added.
        #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], requires = "fibre_modulus", allow_negative_numbers = true)]
        fibre: Option<Vec<f64>>,
        /// Modulus (Pa) along the fibres.
        #[arg(long, requires = "fibre", allow_negative_numbers = true)]
        fibre_modulus: Option<f64>,
        /// Which cell, counted from 0; may be given several times.
        #[arg(long, default_values_t = [0])]
        cell: Vec<usize>,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// A shape as below `generate` of a scene; lengths in metres.
    #[command(subcommand)]
    Generate(GeneratedShape),
}

fn main() -> ExitCode {
    quiet_driver();
    exit_code(match Cli::parse().command {
        Command::Run(arguments) => {
            let scene = arguments.scene.clone();
            run_scene(arguments).map_err(|error| all_mistakes(&scene, error))
        }
        Command::Render(arguments) => render::render_scene(*arguments),
        #[cfg(feature = "view")]
        Command::View(arguments) => view::view_scene(arguments),
        #[cfg(not(feature = "view"))]
        Command::View(_) => {
            return elsewhere(
                "this build opens no window: cargo run --release -p sinew-cli --features view -- view SCENE; `sinew run` writes a page without",
            );
        }
        Command::Schema => print_schema(),
        Command::Completions { shell } => print_completions(shell),
        Command::New(arguments) => new::new(&arguments),
        Command::Presets(arguments) => new::list(&arguments),
        Command::Plot(arguments) => plot::plot(&arguments),
        Command::Bench(_) => {
            return elsewhere(
                "benches are a command of their own, `sinew-lab`: cargo run --release -p sinew-benches -- bench",
            );
        }
        Command::Replay(arguments) => replay_log(&arguments),
        Command::Check(arguments) => check_scene_or_mesh(&arguments),
        Command::Validate(arguments) => validate_cases(arguments),
        Command::Advise(arguments) => advise_scene(&arguments),
        Command::Mesh(command) => mesh(command),
        Command::Fit(arguments) => fit(&arguments),
        Command::Sweep(command) => return sweep::sweep(command),
    })
}

fn print_completions(shell: Shell) -> Outcome {
    let mut script = Vec::new();
    completions(shell, &mut Cli::command(), "sinew", &mut script);
    say!("{}", String::from_utf8(script)?);
    Ok(true)
}

fn print_schema() -> Outcome {
    sayln!("{}", serde_json::to_string_pretty(&schema())?);
    Ok(true)
}

/// Everything that is wrong in a scene, with the lines and marks, where an error is one of its mistakes.
fn all_mistakes(scene: &Path, error: Box<dyn Error>) -> Box<dyn Error> {
    let (found, first) = (mistakes(scene), error.to_string());
    if !found.iter().any(|(mistake, _)| *mistake == first) {
        return error;
    }
    let told =
        found.iter().map(|(mistake, mark)| format!("{mistake}\n{mark}").trim_end().to_string());
    told.collect::<Vec<_>>().join("\nerror: ").into()
}

fn run_scene(arguments: RunArguments) -> Outcome {
    let mut scene = LoadedScene::read(&arguments.scene)?;
    let replaced = Choice {
        integrator: arguments.integrator,
        dt: arguments.dt,
        load_steps: arguments.load_steps,
        linear_tolerance: arguments.linear_tolerance,
        newton_tolerance: arguments.newton_tolerance,
        evaluation: arguments.evaluation,
        model: arguments.model,
        // these have options of their own
        precision: None,
        threads: None,
    };
    replaced.apply(&mut scene);
    let options = [
        ("dt", "--dt", arguments.dt.is_some()),
        ("load_steps", "--load-steps", arguments.load_steps.is_some()),
        ("threads", "--threads", arguments.build.threads.is_some()),
        ("solver.integrator", "--integrator", arguments.integrator.is_some()),
        ("solver.linear_tolerance", "--linear-tolerance", arguments.linear_tolerance.is_some()),
        ("solver.newton_tolerance", "--newton-tolerance", arguments.newton_tolerance.is_some()),
    ];
    options.into_iter().filter(|o| o.2).for_each(|(key, option, _)| scene.replaced_by(key, option));
    let print_json = arguments.json.as_deref().is_some_and(|path| path.as_os_str() == "-");
    let options = RunOptions {
        build: arguments.build.options(),
        out: arguments.out,
        json: arguments.json.filter(|_| !print_json),
        interrupt: Some(interrupt()?),
        checkpoint: arguments.checkpoint,
        resume: arguments.resume,
        record: arguments.record.map(|path| LogOptions { path, hash_every: arguments.hash_every }),
    };
    let mut progress = Progress::default();
    let observer: &mut dyn Observer = if arguments.quiet { &mut Silent } else { &mut progress };
    let beside = || {
        // a run that tells nobody of a file leaves none
        let told = options.out.is_some() || !(arguments.quiet || print_json);
        let wanted = told && !arguments.no_page && !arguments.resume;
        wanted.then(|| page_beside(&scene, options.out.as_deref()))
    };
    let asked = arguments.page.is_some();
    let summary = match arguments.page.or_else(beside) {
        Some(page) => run_to_page(&scene, &options, &page, asked, observer),
        None => run(&scene, &options, observer).map_err(Into::into),
    };
    let summary = summary.inspect_err(|_| {
        // what is there would pass for what this run wrote
        if let Some(folder) = options.out.iter().find(|f| f.join("summary.json").is_file()) {
            eprintln!("warning: what is in {} is of an earlier run", folder.display());
        }
    })?;
    if print_json {
        sayln!("{}", serde_json::to_string_pretty(&summary)?);
    } else if arguments.verbose {
        say!("{summary}");
    } else if !arguments.quiet {
        say!("{}", summary.brief());
    }
    if let Some(failure) = &summary.failure {
        eprintln!("error: {}: {failure}", arguments.scene.display());
    }
    Ok(summary.completed)
}

fn replay_log(arguments: &ReplayArguments) -> Outcome {
    let done = replay(&arguments.log, arguments.scene.as_deref(), arguments.threads)?;
    sayln!(
        "{} steps with {} inputs repeated, {} of {} hashes equal; last state {:016x}",
        done.steps,
        done.inputs,
        done.hashes,
        done.hashes,
        done.hash
    );
    if !done.whole {
        eprintln!(
            "warning: {} has no last line: the program that wrote it died",
            arguments.log.display()
        );
    }
    Ok(true)
}

/// Set when the user or the system asks the command to end. A second time it ends at once.
fn interrupt() -> Result<Arc<AtomicBool>, ctrlc::Error> {
    let asked = Arc::new(AtomicBool::new(false));
    let told = Arc::clone(&asked);
    ctrlc::set_handler(move || {
        if told.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })?;
    Ok(asked)
}

fn validate_cases(arguments: ValidateArguments) -> Outcome {
    let options = ValidateOptions {
        tolerance: arguments.tolerance,
        meshes: arguments.meshes,
        evaluation: if arguments.pooled { Evaluation::Pooled } else { Evaluation::Fused },
        threads: arguments.threads,
    };
    let report =
        validate(&arguments.cases, &options, |row| eprintln!("{}: {}", row.case, row.law))?;
    let text = serde_json::to_string_pretty(&report)?;
    match arguments.json {
        Some(path) if path.as_os_str() == "-" => sayln!("{text}"),
        json => {
            say!("{report}");
            if let Some(path) = json {
                std::fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))?;
                sayln!("written to {}", path.display());
            }
        }
    }
    Ok(report.passed())
}

fn check_scene_or_mesh(arguments: &CheckArguments) -> Outcome {
    let summary = check_file(&arguments.file);
    if arguments.json {
        sayln!("{}", serde_json::to_string_pretty(&summary)?);
    } else {
        say!("{summary}");
    }
    Ok(summary.usable)
}

fn mesh(command: MeshCommand) -> Outcome {
    match command {
        MeshCommand::Info { file, json } => {
            let info = MeshInfo::of(&read(&file)?);
            if json {
                sayln!("{}", serde_json::to_string_pretty(&info)?);
            } else {
                say!("{info}");
            }
        }
        MeshCommand::Convert { from, to, scale, second_order, onto } => {
            let info = convert(&from, &to, scale, second_order, onto.as_deref())?;
            say!("{info}");
            sayln!("written to {}", to.display());
        }
        MeshCommand::Merge { from, to, tolerance } => {
            say!("{}", merge(&from, &to, tolerance)?);
            sayln!("written to {}", to.display());
        }
        MeshCommand::Fill { from, to, edge, scale } => {
            say!("{}", fill(&from, &to, edge, scale)?);
            return check_scene_or_mesh(&CheckArguments { file: to, json: false });
        }
        MeshCommand::Lattice { from, to, cell, scale } => {
            say!("{}", lattice(&from, &to, cell, scale)?);
            sayln!("written to {}", to.display());
        }
        MeshCommand::Springs {
            file,
            young,
            poisson,
            thickness,
            fibre,
            fibre_modulus,
            cell,
            json,
        } => {
            let material =
                YoungPoisson { young_modulus: young, poisson_ratio: poisson, density: 1000.0 };
            let fibres = fibre.zip(fibre_modulus).map(|(direction, modulus)| CellFibres {
                direction: [direction[0], direction[1], direction[2]],
                modulus,
            });
            let table = SpringTable::of(&read(&file)?, material, fibres, thickness, &cell)?;
            if json {
                sayln!("{}", serde_json::to_string_pretty(&table)?);
            } else {
                say!("{table}");
            }
        }
        MeshCommand::Generate(generated) => {
            if let Some(mesh) = generate(&generated.shape()?)? {
                write(&generated.out, &mesh)?;
                say!("{}", MeshInfo::of(&mesh));
                sayln!("written to {}", generated.out.display());
            }
        }
    }
    Ok(true)
}
