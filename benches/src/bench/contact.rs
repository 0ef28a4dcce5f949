//! Steps with contact beside the same steps without, turn by turn in one run: a tool far away, pressing slowly,
//! fast, two bodies, and a liver that is palpated at 100 steps a second. Every time has the error of the force.

use crate::toolbox::aim::BenchAim;
use crate::toolbox::meshes::demo_mesh;
use crate::toolbox::prelude::*;
use crate::toolbox::stats::Spread;
use bevy_ecs::entity::Entity;
use sinew::engine::mesh::generate::box_tets;

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

/// What comes to a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Comes {
    /// A probe that nothing can reach.
    Nothing,
    /// A probe.
    Probe,
    /// A second block like the first.
    Block,
    /// A finger, to a liver in place of the block.
    Finger,
}

/// A kind of contact.
struct ContactKind {
    name: &'static str,
    comes: Comes,
    friction: f64,
    /// Time of a step with contact over that of one without; of the liver, over the time that it stands for.
    aim: f64,
    /// Way (m) of the tool, or of the held side of the second block, after a time (s), from where it begins.
    way: fn(f64) -> DVec3,
}

impl ContactKind {
    const fn new(
        name: &'static str,
        comes: Comes,
        friction: f64,
        aim: f64,
        way: fn(f64) -> DVec3,
    ) -> Self {
        Self { name, comes, friction, aim, way }
    }
}

/// All, in the order of reports.
static KINDS: [ContactKind; 7] = [
    ContactKind::new("far", Comes::Nothing, 0.0, 1.01, |_| DVec3::ZERO),
    ContactKind::new("slow", Comes::Probe, 0.3, 1.5, slow),
    ContactKind::new("slow, smooth", Comes::Probe, 0.0, 1.5, slow),
    ContactKind::new("fast", Comes::Probe, 0.0, 3.0, fast),
    ContactKind::new("two bodies", Comes::Block, 0.3, 2.0, pressed),
    ContactKind::new("two, smooth", Comes::Block, 0.0, 2.0, pressed),
    ContactKind::new("liver", Comes::Finger, 0.3, 1.0 / 3.0, palpated),
];

/// Down to a depth (m) at a speed (m/s), then sideways as fast, after `t` s.
fn press(t: f64, depth: f64, speed: f64) -> DVec3 {
    let down = (speed * t).min(depth);
    DVec3::new(speed * t - down, 0.0, -down)
}

/// A probe presses by 8 mm at 0.1 m/s and then drags at that speed.
fn slow(t: f64) -> DVec3 {
    press(t, ABOVE + 0.008, 0.1)
}

/// A probe comes at 1 m/s by 15 mm, and goes back as fast, again and again.
fn fast(t: f64) -> DVec3 {
    let deep = ABOVE + 0.015;
    let phase = (t / deep) % 2.0;
    DVec3::NEG_Z * deep * if phase > 1.0 { 2.0 - phase } else { phase }
}

/// A second block is pressed on the first by 4 mm and dragged.
fn pressed(t: f64) -> DVec3 {
    press(t, 0.004, 0.05)
}

/// A liver is palpated three times a second by 15 mm.
fn palpated(t: f64) -> DVec3 {
    DVec3::NEG_Z * 0.0075 * (1.0 - libm::cos(6.0 * std::f64::consts::PI * t))
}

/// A block or liver with or without contact.
struct ContactScene {
    simulation: Simulation,
    /// Tool or contact between bodies.
    contact: Option<Entity>,
    /// Held side of the second block.
    handle: Option<Entity>,
    kind: &'static ContactKind,
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

impl ContactScene {
    fn new(kind: &'static ContactKind, mesh: &Mesh, threads: usize, touched: bool) -> Result<Self> {
        let mut simulation =
            Simulation::new(SimulationOptions { threads, exclusive: true, ..Default::default() })?;
        simulation.set_dt(STEP);
        let (mut contact, mut handle) = (None, None);
        if kind.comes == Comes::Finger {
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
                    Tool::new("finger", probe, at + DVec3::Z * 0.01).with_friction(kind.friction);
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
        if kind.comes == Comes::Block {
            let mut upper = mesh.clone();
            // shifted, so that no vertex lies on a vertex
            let shift = DVec3::new(0.003, 0.002, BLOCK.z);
            upper.points.iter_mut().for_each(|x| *x += shift);
            let upper_body = simulation.add_body(&BodyDescription::new("upper", &upper, TISSUE))?;
            let rows = simulation.group_rows(upper_body, &upper, "z1")?;
            handle = Some(simulation.add_constraint(Constraint::hold("hand", rows)));
            if touched {
                let pair = BodyContact::new("blocks", [body, upper_body]);
                let pair = pair.with_friction(kind.friction);
                contact = Some(simulation.add_body_contact(pair));
            }
        } else if touched {
            let height = if kind.comes == Comes::Nothing { 1.0 } else { RADIUS + ABOVE };
            let at = DVec3::new(0.4 * BLOCK.x, 0.5 * BLOCK.y, BLOCK.z + height);
            let probe = Tool::new("probe", Shape::Sphere { radius: RADIUS }, at);
            contact = Some(simulation.add_tool(probe.with_friction(kind.friction))?);
        }
        Ok(Self { simulation, contact, handle, kind, done: 0 })
    }

    /// Way after so many steps.
    fn way(&self, steps: usize) -> DVec3 {
        (self.kind.way)(steps as f64 * STEP)
    }

    /// One step; its wall time (s).
    fn step(&mut self) -> Result<f64> {
        let way = self.way(self.done + 1);
        if let Some(handle) = self.handle {
            self.simulation.set_target(handle, Pose::from(way))?;
        } else if let Some(tool) = self.contact {
            let last = self.way(self.done);
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

/// Over the steps of a run.
#[derive(Clone, Copy, Default)]
struct ContactCounts {
    /// Linear systems and iterations of conjugate gradients per step.
    solves: f64,
    iterations: f64,
    /// Points in contact, largest of a step.
    points: u32,
    /// Rounds of the inner loop per step, and inner loops that ended at their cap.
    rounds: f64,
    unconverged: u32,
    /// Parts of steps because the tool was fast.
    substeps: u32,
    /// Steps that were taken by linearised BDF2.
    second_order: u32,
}

impl ContactCounts {
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
struct ContactRow {
    kind: &'static ContactKind,
    /// Of all bodies.
    tetrahedra: usize,
    threads: usize,
    /// Mean step (ms) of the smallest of the repeats of every step, and of their medians, with contact and without.
    with_ms: [f64; 2],
    without_ms: [f64; 2],
    /// With over without; of the liver over the time that a step stands for.
    ratio: [f64; 2],
    /// Slowest step (ms) with contact, smallest of the repeats.
    slowest_ms: f64,
    /// With contact and without.
    counts: [ContactCounts; 2],
    /// Largest force (N) of the run.
    force: f64,
    /// Force of single steps against the converged step from the same state, implicit Euler and BDF2, over the
    /// largest force of the run (%); the largest of those checked.
    off: [f64; 2],
    /// Converged steps that did not converge: their differences say little.
    unconverged_truths: u32,
}

/// Measures kinds of contact, all where none is named, with every number of threads; blocks have about these sizes
/// (tetrahedra), and every run is made so many times.
///
/// # Errors
/// When there is no such kind, a mesh or body cannot be made or a step fails.
pub fn run(
    sizes: &[usize],
    threads: &[usize],
    repeats: usize,
    kinds: &[String],
    mut tell: impl FnMut(&str),
) -> Result<(Table, Vec<BenchAim>)> {
    if let Some(name) = kinds.iter().find(|n| !KINDS.iter().any(|k| k.name == **n)) {
        let names = KINDS.each_ref().map(|k| k.name).join("`, `");
        let remedy = format!("choose from `{names}`");
        return Err(BenchError::Request { what: format!("contact `{name}`"), remedy });
    }
    let named = |k: &&ContactKind| kinds.iter().any(|name| name == k.name);
    let (livers, blocks): (Vec<&ContactKind>, Vec<_>) = KINDS
        .iter()
        .filter(|k| kinds.is_empty() || named(k))
        .partition(|k| k.comes == Comes::Finger);
    let mut rows = Vec::new();
    for &size in sizes {
        let n = (size as f64 / 24.0).cbrt().round().max(1.0) as usize;
        let mesh = box_tets(BLOCK, [2 * n, 2 * n, n])?;
        for &kind in &blocks {
            tell(&format!("contact: {} tetrahedra, {}", mesh.tetrahedra.len(), kind.name));
            rows.extend(measure(kind, &mesh, threads, repeats)?);
        }
    }
    for kind in livers {
        tell(&format!("contact: {}", kind.name));
        let most = &threads[threads.len().saturating_sub(1)..];
        rows.extend(measure(kind, &demo_mesh("liver.msh")?, most, repeats)?);
    }
    let aims = rows.iter().map(|r| {
        let what = format!(
            "step with contact over that without or, of the liver, over real time: {}, {} tets, {} threads",
            r.kind.name, r.tetrahedra, r.threads
        );
        BenchAim::at_most(what, r.kind.aim, "x", r.ratio[0])
    });
    Ok((table(&rows), aims.collect()))
}

fn measure(
    kind: &'static ContactKind,
    mesh: &Mesh,
    threads: &[usize],
    repeats: usize,
) -> Result<Vec<ContactRow>> {
    let mut rows = Vec::new();
    let mut errors = None;
    for &threads in threads {
        let mut times = [vec![Vec::new(); STEPS], vec![Vec::new(); STEPS]];
        let mut counts = [ContactCounts::default(); 2];
        let mut forces = Vec::new();
        for repeat in 0..repeats.max(1) {
            let scene = |touched| ContactScene::new(kind, mesh, threads, touched);
            let mut scenes = [scene(true)?, scene(false)?];
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
        let [(newton, first), (bdf2, second)] = errors
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
        let beside = if kind.comes == Comes::Finger { [1e3 * STEP; 2] } else { without.0 };
        let ratio = [0, 1].map(|i| with.0[i] / beside[i]);
        rows.push(ContactRow {
            kind,
            tetrahedra: mesh.tetrahedra.len() * if kind.comes == Comes::Block { 2 } else { 1 },
            threads,
            with_ms: with.0,
            without_ms: without.0,
            ratio,
            slowest_ms: with.1,
            counts,
            force: largest,
            off: [newton, bdf2],
            unconverged_truths: first + second,
        });
    }
    Ok(rows)
}

/// Largest difference (N) of the force of a step from that of a converged one from the same state, and how many of
/// those did not converge.
fn off(
    kind: &'static ContactKind,
    mesh: &Mesh,
    integrator: Integrator,
    forces: &[DVec3],
) -> Result<(f64, u32)> {
    let (mut largest, mut missed) = (0.0_f64, 0);
    if kind.comes == Comes::Nothing {
        return Ok((largest, missed));
    }
    for last in CHECKED {
        let mut scene = ContactScene::new(kind, mesh, 1, true)?;
        for _ in 0..last {
            scene.step()?;
        }
        let mut settings = settings(integrator);
        settings.mass_damping = if kind.comes == Comes::Finger { 4.0 } else { 0.0 };
        scene.simulation.set_solver(settings);
        scene.step()?;
        missed += u32::from(scene.simulation.report().unconverged);
        largest = largest.max(scene.force().distance(forces[last]));
    }
    Ok((largest, missed))
}

fn table(rows: &[ContactRow]) -> Table {
    let title = format!(
        "Steps of 10 ms with contact beside those without, {STEPS} of them in turns: block of {} x {} x {} m, E 5 kPa, \
         nu 0.45, auto, mixed precision",
        BLOCK.x, BLOCK.y, BLOCK.z
    );
    table_of!("contact", title; for r in rows;
        where { let [with, without] = &r.counts; }
        "kind" => r.kind.name, "tets" => r.tetrahedra, "threads" => r.threads, "with ms" => r.with_ms[0],
        "median" => r.with_ms[1], "without ms" => r.without_ms[0], "median" => r.without_ms[1],
        "ratio" => r.ratio[0], "of medians" => r.ratio[1], "aim" => r.kind.aim, "slowest ms" => r.slowest_ms,
        "rounds" => with.rounds, "capped" => with.unconverged, "CG with" => with.iterations,
        "CG without" => without.iterations, "solves with" => with.solves,
        "solves without" => without.solves, "BDF2 steps" => with.second_order, "parts" => with.substeps,
        "points" => with.points, "force N" => r.force, "off newton %" => r.off[0],
        "off bdf2 %" => r.off[1],
        "not converged" => r.unconverged_truths,
    )
    .note(
        "with, without: means over the steps, of the smallest and of the median of the repeats of every step; ratio: \
         with over without; of the liver, over the time that a step stands for.",
    )
    .note(format!(
        "off: force after {CHECKED:?} steps against the converged step from the same state, implicit Euler and BDF2, \
         over the largest force of the run; not converged: of those steps.",
    ))
}
