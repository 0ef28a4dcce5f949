//! Steps with contact beside the same steps without, turn by turn in one run: a tool far away, pressing slowly,
//! fast, two bodies, and a liver that is palpated at 100 steps a second. Every time has the error of the force.

use crate::bench::cases::demo_mesh;
use crate::bench::error::BenchError;
use crate::bench::machine::{Load, MachineNotes, Watch};
use crate::bench::stats::Spread;
use glam::DVec3;
use serde::Serialize;
use sinew::engine::mesh::generate::box_tets;
use sinew::prelude::*;
use std::error::Error;
use std::fmt;
use std::time::Instant;

/// What is measured.
#[derive(Clone, Debug)]
pub struct ContactOptions {
    /// Sizes of the block (tetrahedra, about).
    pub sizes: Vec<usize>,
    /// Times that every run is made.
    pub repeats: usize,
    /// Kinds by name; all when empty.
    pub kinds: Vec<String>,
}

/// Length of a step (s), steps of a run, and those after which the force is held against converged steps.
const STEP: f64 = 0.01;
const STEPS: usize = 60;
const CHECKED: [usize; 3] = [15, 35, 55];
/// Edges of the block (m).
const BLOCK: DVec3 = DVec3::new(0.1, 0.1, 0.05);
/// Soft tissue, nearly incompressible, as stiff as liver.
const TISSUE: YoungPoisson =
    YoungPoisson { young_modulus: 5e3, poisson_ratio: 0.45, density: 1000.0 };
/// Radius (m) of the probe, and what it comes to be above the block at first.
const RADIUS: f64 = 0.02;
const ABOVE: f64 = 0.001;

/// What touches the block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// A probe that nothing can reach.
    Far,
    /// A probe presses by 8 mm at 0.1 m/s and then drags at that speed, with friction 0.3.
    Slow,
    /// The same without friction.
    Smooth,
    /// A probe comes at 1 m/s by 15 mm, and goes back as fast, again and again.
    Fast,
    /// A second block like it is pressed on it by 4 mm and dragged, with friction 0.3.
    Bodies,
    /// The same without friction.
    SmoothBodies,
    /// A liver is palpated at three times a second by 15 mm.
    Liver,
}

impl Kind {
    /// All, in the order of reports.
    pub const ALL: [Self; 7] = [
        Self::Far,
        Self::Slow,
        Self::Smooth,
        Self::Fast,
        Self::Bodies,
        Self::SmoothBodies,
        Self::Liver,
    ];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        ["far", "slow", "slow, smooth", "fast", "two bodies", "two, smooth", "liver"][self as usize]
    }

    /// Time of a step with contact over that of one without; of the liver, over the time that it stands for.
    pub fn aim(self) -> f64 {
        [1.01, 1.5, 1.5, 3.0, 2.0, 2.0, 1.0 / 3.0][self as usize]
    }

    /// Coefficient of friction.
    fn friction(self) -> f64 {
        match self {
            Self::Slow | Self::Bodies | Self::Liver => 0.3,
            Self::Far | Self::Smooth | Self::Fast | Self::SmoothBodies => 0.0,
        }
    }

    /// Way (m) of the tool, or of the held side of the second block, after so many steps, from where it begins.
    fn way(self, step: usize) -> DVec3 {
        let t = step as f64 * STEP;
        // down to a depth at a speed, then sideways as fast
        let press = |depth: f64, speed: f64| {
            let down = (speed * t).min(depth);
            DVec3::new(speed * t - down, 0.0, -down)
        };
        match self {
            Self::Far => DVec3::ZERO,
            Self::Slow | Self::Smooth => press(ABOVE + 0.008, 0.1),
            Self::Fast => {
                let deep = ABOVE + 0.015;
                let phase = (t / deep) % 2.0;
                DVec3::NEG_Z * deep * if phase > 1.0 { 2.0 - phase } else { phase }
            }
            Self::Bodies | Self::SmoothBodies => press(0.004, 0.05),
            Self::Liver => {
                DVec3::NEG_Z * 0.0075 * (1.0 - libm::cos(6.0 * std::f64::consts::PI * t))
            }
        }
    }
}

/// A block or liver with or without contact.
struct Scene {
    simulation: Simulation,
    /// Tool or contact between bodies.
    contact: Option<bevy_ecs::entity::Entity>,
    /// Held side of the second block.
    handle: Option<bevy_ecs::entity::Entity>,
    kind: Kind,
    done: usize,
}

fn settings(integrator: Integrator) -> SolverSettings {
    let default = SolverSettings { integrator, ..SolverSettings::default() };
    match integrator {
        Integrator::Auto => default,
        _ => SolverSettings {
            newton_tolerance: 1e-9,
            linear_tolerance: 1e-6,
            max_newton_iterations: 100,
            ..default
        },
    }
}

impl Scene {
    fn new(kind: Kind, mesh: &Mesh, threads: usize, touched: bool) -> Result<Self, Box<dyn Error>> {
        let mut simulation = Simulation::new(SimulationOptions { threads, ..Default::default() })?;
        simulation.set_dt(STEP);
        let (mut contact, mut handle) = (None, None);
        if kind == Kind::Liver {
            let material = preset("liver")?.material;
            let body = simulation.add_body(&BodyDescription::new("liver", mesh, material))?;
            let rows = simulation.group_rows(body, mesh, "ligament")?;
            simulation.add_constraint(Constraint::hold("ligament", rows));
            simulation
                .set_solver(SolverSettings { mass_damping: 4.0, ..settings(Integrator::Auto) });
            // it sags before it is met from above, halfway to what is farthest from the ligament: above the middle
            // a finger would press on held vertices
            for _ in 0..50 {
                simulation.step()?;
            }
            let places = simulation.positions(body);
            let middle = places.iter().sum::<DVec3>() / places.len() as f64;
            let held = mesh.group("ligament").map_or(&[][..], |group| &group.vertices);
            let held = held.iter().map(|&v| places[v as usize]).sum::<DVec3>() / held.len() as f64;
            let far = |x: &DVec3| x.distance_squared(held);
            let farthest = places.iter().max_by(|a, b| far(a).total_cmp(&far(b)));
            let above = middle.midpoint(*farthest.unwrap_or(&middle));
            let pick = simulation.pick(above + DVec3::Z, DVec3::NEG_Z);
            let at = pick.map_or(above, |pick| pick.position);
            if touched {
                let probe = Shape::Sphere { radius: 0.01 };
                let probe =
                    Tool::new("finger", probe, at + DVec3::Z * 0.01).with_friction(kind.friction());
                contact = Some(simulation.add_tool(probe)?);
            }
            return Ok(Self { simulation, contact, handle, kind, done: 0 });
        }
        simulation.set_solver(settings(Integrator::Auto));
        // a block at rest would need no iterations: its own weight makes it swing
        simulation.set_gravity(9.81 * DVec3::new(0.5, 0.0, -1.0).normalize());
        let body = simulation.add_body(&BodyDescription::new("block", mesh, TISSUE))?;
        let rows = simulation.group_rows(body, mesh, "z0")?;
        simulation.add_constraint(Constraint::hold("floor", rows));
        if matches!(kind, Kind::Bodies | Kind::SmoothBodies) {
            let mut upper = mesh.clone();
            // shifted, so that no vertex lies on a vertex
            let shift = DVec3::new(0.003, 0.002, BLOCK.z);
            upper.points.iter_mut().for_each(|x| *x += shift);
            let upper_body = simulation.add_body(&BodyDescription::new("upper", &upper, TISSUE))?;
            let rows = simulation.group_rows(upper_body, &upper, "z1")?;
            handle = Some(simulation.add_constraint(Constraint::hold("hand", rows)));
            if touched {
                let pair = BodyContact::new("blocks", [body.0, upper_body.0]);
                let pair = pair.with_friction(kind.friction());
                contact = Some(simulation.add_body_contact(pair));
            }
        } else if touched {
            let height = if kind == Kind::Far { 1.0 } else { RADIUS + ABOVE };
            let at = DVec3::new(0.4 * BLOCK.x, 0.5 * BLOCK.y, BLOCK.z + height);
            let probe = Tool::new("probe", Shape::Sphere { radius: RADIUS }, at);
            contact = Some(simulation.add_tool(probe.with_friction(kind.friction()))?);
        }
        Ok(Self { simulation, contact, handle, kind, done: 0 })
    }

    /// One step; its wall time (s).
    fn step(&mut self) -> Result<f64, Box<dyn Error>> {
        let way = self.kind.way(self.done + 1);
        if let Some(handle) = self.handle {
            self.simulation.set_target(handle, Pose::from(way))?;
        } else if let Some(tool) = self.contact {
            let last = self.kind.way(self.done);
            let at = self.simulation.world().get::<Tool>(tool).map(|tool| tool.start.position);
            let at = at.unwrap_or_default();
            if self.done == 0 || way != last {
                self.simulation.move_tool(tool, at + way)?;
            }
        }
        self.done += 1;
        let clock = Instant::now();
        self.simulation.step()?;
        Ok(clock.elapsed().as_secs_f64())
    }

    /// Force (N) of the contact in the last step.
    fn force(&self) -> DVec3 {
        let s = &self.simulation;
        let Some(contact) = self.contact else { return DVec3::ZERO };
        match (s.tool_report(contact), s.body_contact_report(contact)) {
            (Some(tool), _) => tool.force,
            (_, Some(pair)) => pair.force,
            _ => DVec3::ZERO,
        }
    }
}

/// Sums over the steps of a run.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Counts {
    /// Linear systems per step.
    pub solves: f64,
    /// Iterations of conjugate gradients per step.
    pub iterations: f64,
    /// Points in contact, largest of a step.
    pub points: u32,
    /// Rounds of the inner loop per step.
    pub rounds: f64,
    /// Inner loops that ended at their cap.
    pub unconverged: u32,
    /// Parts of steps because the tool was fast.
    pub substeps: u32,
    /// Steps that were taken by linearised BDF2.
    pub second_order: u32,
}

impl Counts {
    fn add(&mut self, simulation: &Simulation) {
        let report = simulation.report();
        self.solves += f64::from(report.newton_iterations) / STEPS as f64;
        self.iterations += f64::from(report.cg_iterations) / STEPS as f64;
        self.points = self.points.max(report.contact.points);
        self.rounds += f64::from(report.contact.inner_iterations) / STEPS as f64;
        self.unconverged += report.contact.unconverged;
        self.substeps = self.substeps.max(report.contact.substeps);
        self.second_order += u32::from(report.second_order_steps > 0);
    }
}

/// One kind of contact at one size.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// What touches.
    pub kind: Kind,
    /// Tetrahedra of all bodies.
    pub tetrahedra: usize,
    /// Threads.
    pub threads: usize,
    /// Mean step (ms) of the smallest of the repeats of every step, and of their medians.
    pub with_ms: [f64; 2],
    /// The same without contact.
    pub without_ms: [f64; 2],
    /// With over without, of smallest and of medians; of the liver over the time that a step stands for.
    pub ratio: [f64; 2],
    /// Slowest step (ms) with contact, smallest of the repeats.
    pub slowest_ms: f64,
    /// What the smallest ratio is held against.
    pub aim: f64,
    /// Whether it is met.
    pub met: bool,
    /// Counts with contact and without.
    pub counts: [Counts; 2],
    /// Largest force (N) of the run.
    pub force: f64,
    /// Force of single steps against the implicit Euler step by `newton` from the same state, over the largest force of
    /// the run (%); the largest of those checked.
    pub off_newton: f64,
    /// The same against the step by `bdf2`.
    pub off_bdf2: f64,
    /// Converged steps that did not converge: their differences say little.
    pub unconverged_truths: u32,
}

/// All rows.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Schema of the JSON form.
    pub schema: &'static str,
    /// Where it ran.
    pub machine: MachineNotes,
    /// What else the machine did.
    pub load: Load,
    /// Repeats of every run.
    pub repeats: usize,
    /// One per kind, size and number of threads.
    pub rows: Vec<Row>,
}

/// Measures.
///
/// # Errors
/// When there is no such kind, a mesh or body cannot be made or a step fails.
pub fn run(options: &ContactOptions, tell: impl Fn(&str)) -> Result<Report, Box<dyn Error>> {
    let watch = Watch::start();
    let machine = MachineNotes::now();
    let threads: &[usize] = if machine.cores > 1 { &[1, 2] } else { &[1] };
    if let Some(name) = options.kinds.iter().find(|n| !Kind::ALL.iter().any(|k| k.name() == **n)) {
        let names = Kind::ALL.map(Kind::name).join("`, `");
        let remedy = format!("choose from `{names}`");
        return Err(BenchError::Request { what: format!("contact `{name}`"), remedy }.into());
    }
    let wanted = |k: &Kind| options.kinds.is_empty() || options.kinds.iter().any(|n| n == k.name());
    let mut rows = Vec::new();
    for &size in &options.sizes {
        let n = (size as f64 / 24.0).cbrt().round().max(1.0) as usize;
        let mesh = box_tets(BLOCK, [2 * n, 2 * n, n])?;
        for kind in Kind::ALL.into_iter().filter(|k| *k != Kind::Liver && wanted(k)) {
            tell(&format!("{} tetrahedra, {}", mesh.tetrahedra.len(), kind.name()));
            rows.extend(measure(kind, &mesh, threads, options.repeats)?);
        }
    }
    if wanted(&Kind::Liver) {
        tell("liver");
        let mesh = demo_mesh("liver.msh")?;
        let most = &threads[threads.len() - 1..];
        rows.extend(measure(Kind::Liver, &mesh, most, options.repeats)?);
    }
    let (schema, load, repeats) = ("sinew-bench-contact/1", watch.finish(), options.repeats);
    Ok(Report { schema, machine, load, repeats, rows })
}

fn measure(
    kind: Kind,
    mesh: &Mesh,
    threads: &[usize],
    repeats: usize,
) -> Result<Vec<Row>, Box<dyn Error>> {
    let mut rows = Vec::new();
    let mut errors = None;
    for &threads in threads {
        let mut times = [vec![Vec::new(); STEPS], vec![Vec::new(); STEPS]];
        let mut counts = [Counts::default(); 2];
        let mut forces = Vec::new();
        for repeat in 0..repeats.max(1) {
            let mut scenes =
                [Scene::new(kind, mesh, threads, true)?, Scene::new(kind, mesh, threads, false)?];
            for step in 0..STEPS {
                // who comes first changes, for what is left in caches
                let order = if (step + repeat) % 2 == 0 { [0, 1] } else { [1, 0] };
                for i in order {
                    times[i][step].push(scenes[i].step()?);
                    if repeat == 0 {
                        counts[i].add(&scenes[i].simulation);
                    }
                }
                if repeat == 0 {
                    forces.push(scenes[0].force());
                }
            }
        }
        let largest = forces.iter().map(|f| f.length()).fold(0.0, f64::max);
        if errors.is_none() {
            let off = |integrator| off(kind, mesh, integrator, &forces);
            errors = Some([off(Integrator::Newton)?, off(Integrator::Bdf2)?]);
        }
        let [(off_newton, first), (off_bdf2, second)] = errors
            .unwrap_or_default()
            .map(|(off, missed)| (if largest > 0.0 { 100.0 * off / largest } else { 0.0 }, missed));
        let [with, without] = times.each_ref().map(|steps| {
            let spreads: Vec<Spread> = steps.iter().filter_map(|t| Spread::of(t)).collect();
            let mean = |pick: fn(&Spread) -> f64| {
                1e3 * spreads.iter().map(pick).sum::<f64>() / STEPS as f64
            };
            let slowest = spreads.iter().map(|s| 1e3 * s.minimum).fold(0.0, f64::max);
            ([mean(|s| s.minimum), mean(|s| s.median)], slowest)
        });
        let beside = if kind == Kind::Liver { [1e3 * STEP; 2] } else { without.0 };
        let ratio = [0, 1].map(|i| with.0[i] / beside[i]);
        rows.push(Row {
            kind,
            tetrahedra: mesh.tetrahedra.len()
                * if matches!(kind, Kind::Bodies | Kind::SmoothBodies) { 2 } else { 1 },
            threads,
            with_ms: with.0,
            without_ms: without.0,
            ratio,
            slowest_ms: with.1,
            aim: kind.aim(),
            met: ratio[0] <= kind.aim(),
            counts,
            force: largest,
            off_newton,
            off_bdf2,
            unconverged_truths: first + second,
        });
    }
    Ok(rows)
}

/// Largest difference (N) of the force of a step from that of a converged one from the same state, and how many of
/// those did not converge.
fn off(
    kind: Kind,
    mesh: &Mesh,
    integrator: Integrator,
    forces: &[DVec3],
) -> Result<(f64, u32), Box<dyn Error>> {
    let (mut largest, mut missed) = (0.0_f64, 0);
    if kind == Kind::Far {
        return Ok((largest, missed));
    }
    for last in CHECKED {
        let mut scene = Scene::new(kind, mesh, 1, true)?;
        for _ in 0..last {
            scene.step()?;
        }
        let mut settings = settings(integrator);
        settings.mass_damping = if kind == Kind::Liver { 4.0 } else { 0.0 };
        scene.simulation.set_solver(settings);
        scene.step()?;
        missed += u32::from(scene.simulation.report().unconverged);
        largest = largest.max(scene.force().distance(forces[last]));
    }
    Ok((largest, missed))
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "Steps of 10 ms with contact beside those without, {STEPS} of them, {} times in turns; block of \
             {} x {} x {} m, E 5 kPa, nu 0.45, auto, mixed precision\n{}",
            self.repeats,
            BLOCK.x,
            BLOCK.y,
            BLOCK.z,
            self.machine.line()
        )?;
        writeln!(
            f,
            "  kind             tets threads  with ms (median)  without (median)  ratio (median)   aim       \
             slowest  rounds (capped)  CG with/without  points  off newton  off bdf2"
        )?;
        for r in &self.rows {
            let [with, without] = &r.counts;
            writeln!(
                f,
                "  {:<12} {:8} {:7} {:8.3} ({:6.3}) {:8.3} ({:6.3}) {:6.3} ({:6.3}) {:5.2} {:<7} {:8.3} {:7.2} ({:2}) \
                 {:10.1} / {:6.1} {:7} {:8.2} % {:7.2} %{}",
                r.kind.name(),
                r.tetrahedra,
                r.threads,
                r.with_ms[0],
                r.with_ms[1],
                r.without_ms[0],
                r.without_ms[1],
                r.ratio[0],
                r.ratio[1],
                r.aim,
                if r.met { "met" } else { "MISSED" },
                r.slowest_ms,
                with.rounds,
                with.unconverged,
                with.iterations,
                without.iterations,
                with.points,
                r.off_newton,
                r.off_bdf2,
                match r.unconverged_truths {
                    0 => String::new(),
                    n => format!(" ({n} not converged)"),
                },
            )?;
        }
        writeln!(
            f,
            "ratio: with over without, by the smallest of the repeats of every step; of the liver, over the time \
             that a step stands for.\noff: force after {CHECKED:?} steps against the converged step from the same \
             state, implicit Euler and BDF2, over the largest force of the run."
        )?;
        if let Some(warning) = self.load.warning(self.machine.cores) {
            writeln!(f, "{warning}")?;
        }
        Ok(())
    }
}
