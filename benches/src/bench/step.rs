//! Whole steps: what one costs, against a plain linearised step of the same system, and how far it is
//! from the converged one.

use crate::toolbox::beam::{
    EXTENT, MATERIAL, as_in_a_step, beam, bend, bent, bent_with, cells_for, lend, request,
    take_back,
};
use crate::toolbox::prelude::*;
use crate::toolbox::stats::{Rounds, Spread, interleave};
use sinew::engine::lanes::InstructionSet;
use sinew::engine::law::TangentKind;
use sinew::engine::report::SystemTimes;
use sinew::engine::schedule::{Executor, ForceSchedule};
use sinew::engine::workers::Workers;
use sinew::models::body::Evaluation;
use sinew::snapshot::Snapshot;
use sinew::solvers::settings::{LinearPrecision, Preconditioner};
use sinew_tune::table::three_digits;
use std::collections::BTreeMap;
use std::hint::black_box;

/// One kind of step at one size.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StepRow {
    /// Tetrahedra.
    pub tetrahedra: usize,
    /// Integrator.
    pub integrator: String,
    /// Linear solver, empty for explicit integrators; with "portable" where that is the instruction set.
    pub solver: String,
    /// State that the step starts from.
    pub state: String,
    /// `f64` or `f32`.
    pub precision: String,
    /// Threads.
    pub threads: usize,
    /// Wall time of a step of 10 ms (ms).
    pub ms: Spread,
    /// Over one exact tangent with forces and one linear solve, from the swinging state.
    pub ratio_to_plain: Option<f64>,
    /// Conjugate-gradient iterations.
    pub cg_iterations: u32,
    /// Relative residual of the last linear solve.
    pub residual: f64,
    /// Times the projected tangent was used.
    pub projections: u32,
    /// Explicit substeps.
    pub substeps: u32,
    /// Largest distance from the converged step over the largest displacement of it (%).
    pub error_percent: Option<f64>,
}

/// From a file to a body that can be stepped.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BuildRow {
    /// Tetrahedra.
    pub tetrahedra: usize,
    /// Reading a Gmsh 2.2 file (s).
    pub read_s: Spread,
    /// Checking the mesh (s).
    pub check_s: Spread,
    /// Layout, entities, stiffnesses (s).
    pub build_s: Spread,
    /// All of it (s).
    pub total_s: Spread,
}

/// All steps.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StepsReport {
    /// Steps.
    pub rows: Vec<StepRow>,
    /// Loading and building.
    pub builds: Vec<BuildRow>,
    /// Going back.
    pub snapshots: Table,
    /// Bodies at rest.
    pub sleep: Table,
}

/// Step length (s).
const DT: f64 = 0.01;
/// Explicit steps per sample of small and of very large bodies: the stable step is estimated once in so many.
const EXPLICIT_STEPS: [u32; 2] = [10, 2];
/// Implicit steps per sample from the swinging state: preconditioners are kept for some steps.
const IMPLICIT_STEPS: u32 = 5;

/// Runs all steps; `tell` hears what is going on.
///
/// # Errors
/// When a beam cannot be built or stepped, or its file not be written.
pub fn run(
    sizes: &[usize],
    threads: &[usize],
    rounds: Rounds,
    mut tell: impl FnMut(&str),
) -> Result<StepsReport> {
    let (mut report, mut meshes) = (StepsReport::default(), Vec::new());
    for &size in sizes {
        let mesh = beam(cells_for(size))?;
        tell(&format!("step: {} tetrahedra", mesh.tetrahedra.len()));
        report.builds.push(build(&mesh, rounds)?);
        size_rows(&mesh, threads, rounds, &mut report.rows)?;
        meshes.push(mesh);
    }
    report.snapshots = snapshots(&meshes, rounds)?;
    if let Some(mesh) = meshes.first() {
        report.sleep = sleep(mesh, rounds)?;
    }
    Ok(report)
}

/// A state to step from.
struct StepStart {
    name: &'static str,
    u: Vec<DVec3>,
    v: Vec<DVec3>,
    /// Displacements after a converged implicit step, and after a converged motion.
    implicit: Vec<DVec3>,
    explicit: Vec<DVec3>,
}

impl StepStart {
    fn new(name: &'static str, mesh: &Mesh, u: &[DVec3], steps: u32, motion: bool) -> Result<Self> {
        let (mut simulation, body) =
            bent(mesh, Precision::F64, 0, Evaluation::Fused, Model::CompressibleStVK)?;
        simulation.set_dt(DT);
        simulation.set_state(body, u, &vec![DVec3::ZERO; u.len()])?;
        for _ in 0..steps {
            simulation.step()?;
        }
        let (u, v) = (simulation.displacements(body), simulation.velocities(body));
        let mut after = |settings: SolverSettings| -> Result<Vec<DVec3>> {
            simulation.set_solver(settings);
            simulation.set_state(body, &u, &v)?;
            simulation.step()?;
            Ok(simulation.displacements(body))
        };
        let implicit = after(SolverSettings {
            integrator: Integrator::Newton,
            linear_tolerance: 1e-4,
            newton_tolerance: 1e-8,
            max_linear_iterations: 50_000,
            ..Default::default()
        })?;
        let explicit = if motion {
            after(SolverSettings {
                integrator: Integrator::StormerVerlet,
                explicit_safety: 0.1,
                ..Default::default()
            })?
        } else {
            Vec::new()
        };
        Ok(Self { name, u, v, implicit, explicit })
    }
}

/// Linear solvers with their names. Very large bodies leave out what is slow.
fn solvers(precision: Precision, large: bool) -> Vec<(String, SolverSettings)> {
    let solver = |preconditioner: Preconditioner, linear_precision| {
        let digits = match (precision, linear_precision) {
            (Precision::F64, LinearPrecision::Full) => "f64",
            (Precision::F64, LinearPrecision::Mixed) => "mixed",
            (Precision::F32, _) => "f32",
        };
        let settings = SolverSettings {
            integrator: Integrator::Safe,
            preconditioner,
            linear_precision,
            ..SolverSettings::default()
        };
        (format!("{} {digits}", preconditioner.name()), settings)
    };
    let mut all = vec![solver(Preconditioner::Auto, LinearPrecision::Mixed)];
    let others = [
        Preconditioner::BlockJacobi,
        Preconditioner::IncompleteCholesky,
        Preconditioner::Multigrid,
    ];
    if !large {
        all.extend(others.map(|preconditioner| solver(preconditioner, LinearPrecision::Mixed)));
        if precision == Precision::F64 {
            all.push(solver(Preconditioner::Auto, LinearPrecision::Full));
            all.push(solver(Preconditioner::BlockJacobi, LinearPrecision::Full));
        }
    }
    all
}

/// A body of one number type; settings, threads and state are set before every sample.
struct StepSubject {
    simulation: Simulation,
    body: BodyHandle,
}

#[derive(Clone)]
struct StepVariant {
    subject: usize,
    start: usize,
    solver: String,
    settings: SolverSettings,
    instructions: InstructionSet,
    threads: usize,
    /// Seconds of linear solves per step, of every sample.
    solves: Vec<f64>,
    /// Seconds of force and exact tangent, of every sample.
    evaluations: Vec<f64>,
    row: Option<StepRow>,
}

/// Tetrahedra from which on only the default linear solver is measured, of fused bodies, with the best instruction set, and only
/// the kernels of the default energy, with and without compression term.
pub const LARGE: usize = 200_000;

fn size_rows(
    mesh: &Mesh,
    threads: &[usize],
    rounds: Rounds,
    rows: &mut Vec<StepRow>,
) -> Result<()> {
    // squeezed to three fifths of its length: the exact tangent is indefinite there
    let squeeze = |x: &DVec3| DVec3::new(-0.4 * x.x, 0.0, 0.0);
    let squeezed: Vec<DVec3> = mesh.points.iter().map(squeeze).collect();
    let starts = [
        StepStart::new("swinging", mesh, &bend(mesh), 3, true)?,
        StepStart::new("squeezed by 40 %", mesh, &squeezed, 0, false)?,
    ];
    let large = mesh.tetrahedra.len() > LARGE;
    let mut pools: BTreeMap<usize, Option<Workers>> = BTreeMap::new();
    for &n in threads {
        pools.insert(n, Some(Workers::new(n)?));
    }
    let mut subjects = Vec::new();
    let mut variants = Vec::new();
    let mut add = |subject, threads, start, solver: &str, settings: &SolverSettings| {
        variants.push(StepVariant {
            subject,
            start,
            solver: solver.to_string(),
            settings: settings.clone(),
            instructions: InstructionSet::best(),
            threads,
            solves: Vec::new(),
            evaluations: Vec::new(),
            row: None,
        });
    };
    for precision in [Precision::F64, Precision::F32] {
        let (mut simulation, body) =
            bent(mesh, precision, 1, Evaluation::Fused, Model::CompressibleStVK)?;
        simulation.set_dt(DT);
        let subject = subjects.len();
        subjects.push(StepSubject { simulation, body });
        for &threads in threads {
            for (name, settings) in solvers(precision, large) {
                add(subject, threads, 0, &name, &settings);
                // hard on preconditioners: the default and the simplest tell enough
                if matches!(
                    settings.preconditioner,
                    Preconditioner::Auto | Preconditioner::BlockJacobi
                ) && settings.linear_precision == LinearPrecision::default()
                {
                    add(subject, threads, 1, &name, &settings);
                }
            }
            let (name, safe) = &solvers(precision, true)[0];
            let settings = SolverSettings { integrator: Integrator::Auto, ..safe.clone() };
            add(subject, threads, 0, name, &settings);
            for integrator in [Integrator::SymplecticEuler, Integrator::StormerVerlet] {
                let settings = SolverSettings { integrator, ..Default::default() };
                add(subject, threads, 0, "", &settings);
            }
        }
    }
    // independent laws one after another, each on all threads, or side by side
    let executors = [Executor::SingleThreaded, Executor::MultiThreaded];
    for executor in executors.into_iter().filter(|_| !large) {
        let options = SimulationOptions { executor, exclusive: true, ..Default::default() };
        let model = Model::CompressibleStVK;
        let (mut simulation, body) = bent_with(options, mesh, Evaluation::Pooled, model)?;
        simulation.set_dt(DT);
        let subject = subjects.len();
        subjects.push(StepSubject { simulation, body });
        let (name, settings) = &solvers(Precision::F64, true)[0];
        for &threads in threads {
            add(
                subject,
                threads,
                0,
                &format!("{name} pooled, executor {}", executor.name()),
                settings,
            );
        }
    }
    // what the same bits on every machine cost
    let priced = |v: &&StepVariant| {
        v.start == 0
            && matches!(v.settings.integrator, Integrator::Auto | Integrator::StormerVerlet)
            && v.instructions != InstructionSet::Portable
    };
    let portable = |v: &StepVariant| StepVariant {
        instructions: InstructionSet::Portable,
        solver: format!("{} portable", v.solver).trim().to_string(),
        ..v.clone()
    };
    if !large {
        let portable: Vec<StepVariant> = variants.iter().filter(priced).map(portable).collect();
        variants.extend(portable);
    }
    let samples = interleave(&mut variants, rounds, |variant| {
        let subject = &mut subjects[variant.subject];
        let pool = pools.entry(variant.threads).or_default();
        variant.measure(subject, &starts[variant.start], mesh, pool)
    })?;

    // the plain step of the same precision, solver and threads
    let plain: Vec<(StepKey, f64)> = variants
        .iter()
        .filter(|v| v.start == 0 && v.settings.integrator == Integrator::Safe)
        .filter_map(|v| {
            let solve = Spread::of(&v.solves)?.median;
            Some((v.key(), solve + Spread::of(&v.evaluations)?.median))
        })
        .collect();
    for (variant, samples) in variants.into_iter().zip(samples) {
        let Some(spread) = Spread::warm(&samples) else { continue };
        let key = variant.key();
        let plain = plain.iter().find(|(k, _)| *k == key).map(|(_, seconds)| *seconds);
        let implicit = !variant.settings.integrator.is_explicit();
        if let Some(mut row) = variant.row {
            row.ms = spread.scaled(1e3);
            row.ratio_to_plain = plain.filter(|_| implicit).map(|p| spread.median / p);
            rows.push(row);
        }
    }
    Ok(())
}

/// Subject, solver, threads.
type StepKey = (usize, String, usize);

impl StepVariant {
    fn key(&self) -> StepKey {
        (self.subject, self.solver.clone(), self.threads)
    }

    /// Mean seconds of the steps of one sample.
    fn measure(
        &mut self,
        subject: &mut StepSubject,
        start: &StepStart,
        mesh: &Mesh,
        pool: &mut Option<Workers>,
    ) -> Result<f64> {
        let StepSubject { simulation: s, body } = subject;
        *pool = match pool.take() {
            Some(workers) => Some(workers.with_instruction_set(self.instructions)?),
            None => None,
        };
        lend(s.world_mut(), pool);
        let implicit = !self.settings.integrator.is_explicit();
        let swinging = start.name == "swinging";
        s.set_solver(self.settings.clone());
        // the subject was last used with other settings
        s.set_state(*body, &start.u, &start.v)?;
        s.step()?;
        s.set_state(*body, &start.u, &start.v)?;
        if self.settings.integrator == Integrator::Auto {
            // it starts with a safe step
            s.step()?;
        }
        if self.settings.integrator == Integrator::Safe && swinging {
            request(s, false, true, Some(TangentKind::Exact));
            self.evaluations.push(as_in_a_step(s, |world| {
                world.run_schedule(ForceSchedule);
                let clock = Instant::now();
                world.run_schedule(ForceSchedule);
                clock.elapsed().as_secs_f64()
            }));
        }
        s.world_mut().insert_resource(SystemTimes::default());
        let steps = match (implicit, swinging) {
            (false, _) => EXPLICIT_STEPS[usize::from(mesh.tetrahedra.len() > LARGE)],
            (true, true) => IMPLICIT_STEPS,
            (true, false) => 1,
        };
        let mut seconds = 0.0;
        for step in 0..steps {
            let clock = Instant::now();
            s.step()?;
            seconds += clock.elapsed().as_secs_f64();
            if step == 0 && self.row.is_none() {
                self.row = Some(self.first_row(s, *body, start, mesh));
            }
        }
        let steps = f64::from(steps);
        let times = s.world().resource::<SystemTimes>();
        let solve = times.entries.iter().find(|e| e.name == "linear solves");
        self.solves.extend(solve.map(|e| e.seconds / steps));
        take_back(s.world_mut(), pool);
        Ok(seconds / steps)
    }

    /// The row of the first step from the start, still without times.
    fn first_row(
        &self,
        s: &mut Simulation,
        body: BodyHandle,
        start: &StepStart,
        mesh: &Mesh,
    ) -> StepRow {
        let truth = match self.settings.integrator {
            // its row is its second step
            Integrator::Auto => None,
            Integrator::Safe => Some(&start.implicit),
            _ => Some(&start.explicit),
        };
        let found = s.displacements(body);
        let largest = |a: &[DVec3], b: &[DVec3]| {
            a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
        };
        let report = s.report();
        StepRow {
            tetrahedra: mesh.tetrahedra.len(),
            integrator: self.settings.integrator.name().to_string(),
            solver: self.solver.clone(),
            state: start.name.to_string(),
            precision: s.precision().name().to_string(),
            threads: self.threads,
            ms: Spread::default(),
            ratio_to_plain: None,
            cg_iterations: report.cg_iterations,
            residual: report.cg_residual,
            projections: report.projections,
            substeps: report.substeps,
            error_percent: truth.map(|t| 100.0 * largest(&found, t) / largest(t, &start.u)),
        }
    }
}

fn build(mesh: &Mesh, rounds: Rounds) -> Result<BuildRow> {
    let folder = std::env::temp_dir().join(format!("sinew-bench-{}", std::process::id()));
    let path = folder.join("beam.msh");
    let write = |reason: String| BenchError::Write { path: path.clone(), reason };
    std::fs::create_dir_all(&folder).map_err(|e| write(e.to_string()))?;
    sinew_scene::mesh_tool::write(&path, mesh).map_err(|e| write(e.to_string()))?;
    let mut times = [const { Vec::new() }; 4];
    let rounds = Rounds { most: rounds.most.min(5), ..rounds };
    let measured = interleave(&mut [()], rounds, |()| {
        let clock = Instant::now();
        let mut marks = vec![0.0];
        let found = Mesh::read(&path)?;
        marks.push(clock.elapsed().as_secs_f64());
        let checked = check(&found, &CheckOptions::default()).map_err(|e| BenchError::Request {
            what: e.to_string(),
            remedy: "report this: a generated beam is sound".into(),
        })?;
        marks.push(clock.elapsed().as_secs_f64());
        let mut simulation = Simulation::new(SimulationOptions::default())?;
        simulation.add_body(&BodyDescription::new("beam", &checked.mesh, MATERIAL))?;
        marks.push(clock.elapsed().as_secs_f64());
        for (i, times) in times.iter_mut().take(3).enumerate() {
            times.push(marks[i + 1] - marks[i]);
        }
        times[3].push(marks[3]);
        Ok::<f64, BenchError>(marks[3])
    });
    // nothing to be done about a folder that stays
    let _ = std::fs::remove_dir_all(&folder);
    measured?;
    let [read, check, build, total] = times.map(|t| Spread::of(&t));
    match (read, check, build, total) {
        (Some(read_s), Some(check_s), Some(build_s), Some(total_s)) => {
            Ok(BuildRow { tetrahedra: mesh.tetrahedra.len(), read_s, check_s, build_s, total_s })
        }
        _ => Err(write("its times are not numbers".into())),
    }
}

/// What a program that goes back every step pays, with the default and an explicit integrator: rows of times of a step,
/// of a snapshot and taking it up, of taking it up alone, to bytes, from bytes and taking it up.
fn snapshots(meshes: &[Mesh], rounds: Rounds) -> Result<Table> {
    let mut rows = Vec::new();
    for (mesh, integrator) in
        meshes.iter().flat_map(|m| [Integrator::Auto, Integrator::StormerVerlet].map(|i| (m, i)))
    {
        let (mut s, _) = bent(mesh, Precision::F64, 1, Evaluation::Fused, Model::CompressibleStVK)?;
        s.set_dt(DT);
        s.set_solver(SolverSettings { integrator, ..Default::default() });
        for _ in 0..3 {
            s.step()?;
        }
        let start = s.snapshot()?;
        let bytes = start.to_bytes();
        let samples = interleave(&mut [0, 1, 2, 3, 4], rounds, |what| {
            let clock = Instant::now();
            match what {
                0 => {
                    s.step()?;
                }
                1 => {
                    let now = s.snapshot()?;
                    s.restore(&now)?;
                }
                2 => {
                    s.restore(&start)?;
                }
                3 => drop(black_box(start.to_bytes())),
                _ => {
                    s.restore(&Snapshot::from_bytes(&bytes)?)?;
                }
            }
            Ok::<f64, BenchError>(clock.elapsed().as_secs_f64())
        })?;
        let ms: Vec<Option<f64>> =
            samples.iter().map(|s| Spread::warm(s).map(|s| 1e3 * s.median)).collect();
        rows.push((mesh.tetrahedra.len(), integrator, bytes.len(), ms));
    }
    let title = "Going back (f64, one thread)";
    let table = table_of!("snapshots", title; for (tetrahedra, integrator, bytes, ms) in rows;
        "tets" => tetrahedra, "integrator" => integrator.name(), "step ms" => ms[0],
        "snapshot, restore ms" => ms[1], "of a step %" => ms[1].zip(ms[0]).map(|(a, b)| 100.0 * a / b),
        "restore ms" => ms[2], "bytes" => bytes, "to bytes ms" => ms[3],
        "from bytes, restore ms" => ms[4],
    );
    Ok(table.note("going back is exact: there is no error to set beside it."))
}

/// Speed of all vertices over the size (1/s) below which beams of the table of sleep may sleep.
const SLEEP: f64 = 1e-4;

/// A beam that came to rest under its weight, beside one that a force never lets rest, or a tool that is far away.
fn at_rest(
    mesh: &Mesh,
    sleep_speed: f64,
    [rests, restless, tool]: [bool; 3],
) -> Result<Simulation> {
    let options = SimulationOptions { threads: 1, exclusive: true, ..Default::default() };
    let mut s = Simulation::new(options)?;
    for (name, at) in [("rests", 0.0), ("moves", 2.0 * EXTENT.y)]
        .into_iter()
        .filter(|(name, _)| if *name == "rests" { rests } else { restless })
    {
        let mesh = mesh.transformed(1.0, DQuat::IDENTITY, DVec3::Y * at);
        let body = s.add_body(&BodyDescription::new(name, &mesh, MATERIAL))?;
        let rows = s.group_rows(body, &mesh, "x0")?;
        s.add_constraint(Constraint::hold(format!("clamp of {name}"), rows));
        if name == "moves" {
            let forces = s.group_rows(body, &mesh, "x1")?;
            let forces = forces.into_iter().map(|row| (row, DVec3::Y * 1e-3)).collect();
            let curve = Curve::Sine { frequency: 2.0, phase: 0.0 };
            s.add_load(Load { name: name.into(), forces, curve });
        }
    }
    if tool {
        let far = DVec3::Z * 5.0 * EXTENT.x;
        s.add_tool(Tool::new("far", Shape::Sphere { radius: 0.01 }, far))?;
    }
    s.set_dt(DT);
    s.set_solver(SolverSettings { mass_damping: 10.0, sleep_speed, ..Default::default() });
    for _ in 0..400 {
        s.step()?;
    }
    Ok(s)
}

/// Steps of bodies at rest that may sleep, and of those that may not.
fn sleep(mesh: &Mesh, rounds: Rounds) -> Result<Table> {
    let alone = [true, false, false];
    let kinds = [
        ("at rest, awake", 0.0, alone, 0),
        ("at rest, asleep", SLEEP, alone, 0),
        ("at rest, awake, a tool far away", 0.0, [true, false, true], 2),
        ("at rest, asleep, a tool far away", SLEEP, [true, false, true], 2),
        ("one in motion", SLEEP, [false, true, false], 4),
        ("one in motion, one asleep", SLEEP, [true, true, false], 4),
    ];
    let mut all = kinds
        .iter()
        .map(|(_, speed, what, _)| at_rest(mesh, *speed, *what))
        .collect::<Result<Vec<_>>>()?;
    let samples = interleave(&mut all.iter_mut().collect::<Vec<_>>(), rounds, |s| {
        let clock = Instant::now();
        for _ in 0..IMPLICIT_STEPS {
            s.step()?;
        }
        Ok::<f64, BenchError>(clock.elapsed().as_secs_f64() / f64::from(IMPLICIT_STEPS))
    })?;
    let ms: Vec<Option<f64>> =
        samples.iter().map(|s| Spread::warm(s).map(|s| 1e3 * s.median)).collect();
    let rest = all[0].positions(BodyHandle(0));
    let mut rows = Vec::new();
    for (i, &(name, speed, what, beside)) in kinds.iter().enumerate() {
        let off = (what[0] && speed > 0.0).then(|| {
            let now = all[i].positions(BodyHandle(0));
            now.iter().zip(&rest).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max) / EXTENT.x
        });
        let more = ms[i].zip(ms[beside]).zip(ms[0]);
        let share = match beside {
            4 => more.map(|((own, without), awake)| 100.0 * (own - without) / awake),
            _ => more.map(|((own, awake), _)| 100.0 * own / awake),
        };
        rows.push((name, all[i].report().sleeping, ms[i], share, off));
    }
    let title = format!("Sleep ({} tetrahedra, f64, one thread)", mesh.tetrahedra.len());
    let table = table_of!("sleep", title; for (name, asleep, ms, share, off) in rows;
        "bodies" => name, "asleep" => asleep, "step ms" => ms, "of an awake step %" => share,
        "off rest, of the size" => off,
    );
    Ok(table.note(
        "of one in motion and one asleep: what the sleeper adds, over the step of an awake one. Off rest: the largest distance from \
         the body that stays awake.",
    ))
}

impl StepsReport {
    /// The fastest step of a kind on a number of threads, at the size nearest to one asked for.
    pub fn fastest(
        &self,
        tetrahedra: usize,
        threads: usize,
        pick: impl Fn(&StepRow) -> bool,
    ) -> Option<&StepRow> {
        self.rows
            .iter()
            .filter(|r| r.tetrahedra.abs_diff(tetrahedra) * 20 < tetrahedra)
            .filter(|r| r.threads == threads && pick(r))
            .min_by(|a, b| a.ms.median.total_cmp(&b.ms.median))
    }

    /// How many tetrahedra run in real time with the settings that a user gets without asking, and at what error: steps of
    /// 10 ms that take as long. Between two sizes times follow a power of the size.
    pub fn headline(&self) -> Option<String> {
        let default = |r: &&StepRow| {
            r.integrator == "auto" && r.solver == "auto mixed" && r.precision == "f64"
        };
        let threads = self.rows.iter().filter(default).map(|r| r.threads).max()?;
        let mut rows: Vec<_> =
            self.rows.iter().filter(default).filter(|r| r.threads == threads).collect();
        rows.sort_by_key(|r| r.tetrahedra);
        let (limit, last) = (1e3 * DT, *rows.last()?);
        let size = |r: &StepRow| (r.tetrahedra as f64).ln();
        let within = rows.iter().rposition(|r| r.ms.median <= limit);
        let count = match within.map(|i| (rows[i], rows.get(i + 1))) {
            None => format!("fewer than {}", rows[0].tetrahedra),
            Some((_, None)) => format!("more than {}", last.tetrahedra),
            Some((a, Some(b))) => {
                let share = (limit / a.ms.median).ln() / (b.ms.median / a.ms.median).ln();
                let found = (size(a) + share * (size(b) - size(a))).exp();
                format!("about {}", (found / 1000.0).round() * 1000.0)
            }
        };
        let each = rows.iter().map(|r| {
            let [ms, residual] = [r.ms.median, r.residual].map(three_digits);
            format!("{} take {ms} ms (linear residual {residual})", r.tetrahedra)
        });
        // the step that the default falls back to, where only that has a converged step to be held against
        let known = |r: &&StepRow| r.solver == "auto mixed" && r.state == last.state;
        let error = self.rows.iter().filter(known).find_map(|r| Some((r, r.error_percent?)));
        let error = error.map_or(String::new(), |(r, error)| {
            let error = three_digits(error);
            format!("; `{}` is {error} % from the converged step of the same length", r.integrator)
        });
        let each = each.collect::<Vec<_>>().join(", ");
        Some(format!(
            "In real time here: {count} tetrahedra, with the default settings in steps of {limit} ms, f64, {threads} \
             thread(s). {each}{error}."
        ))
    }

    /// For people.
    pub fn tables(&self) -> Vec<Table> {
        let title = format!(
            "Steps of 10 ms: beam {} x {} x {} m, E 10 kPa, nu 0.45, compression term, relative \
             residual 1e-3",
            EXTENT.x, EXTENT.y, EXTENT.z
        );
        let steps = table_of!("steps", title; for r in &self.rows;
            "tets" => r.tetrahedra, "integrator" => &r.integrator, "solver" => &r.solver,
            "state" => &r.state, "precision" => &r.precision, "threads" => r.threads,
            "ms" => r.ms.median, "quartiles" => r.ms.quartiles(), "least" => r.ms.minimum,
            "of plain" => r.ratio_to_plain, "CG its" => r.cg_iterations, "residual" => r.residual,
            "projections" => r.projections, "substeps" => r.substeps, "error %" => r.error_percent,
        )
        .note(
            "of plain: over forces and exact tangent plus one linear solve, of the swinging beam with \
             the same precision, solver and threads. error: largest distance from the converged step \
             (implicit Euler by Newton; explicit: Störmer-Verlet at a tenth of the stable step) over \
             its largest displacement.",
        )
        .note(format!(
            "times are means over {} explicit steps ({} of very large bodies), one estimate of the stable step \
             included, over {IMPLICIT_STEPS} implicit ones from the swinging state, and of one from the squeezed state.",
            EXPLICIT_STEPS[0], EXPLICIT_STEPS[1],
        ));
        let builds = table_of!("builds", "From a Gmsh file to a body (f64, one thread)"; for r in &self.builds;
            "tets" => r.tetrahedra, "read s" => r.read_s.median, "check s" => r.check_s.median,
            "build s" => r.build_s.median, "total s" => r.total_s.median, "least s" => r.total_s.minimum,
        );
        vec![steps, builds, self.snapshots.clone(), self.sleep.clone()]
    }
}
