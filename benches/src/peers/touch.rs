//! Contact beside rivals: a rigid ball is pressed into a block, held and dragged, with the same mesh, material,
//! lumped masses, damping and way of the ball in every engine.
//!
//! * **Truth**: the equilibrium of the St Venant-Kirchhoff body *on the same mesh* under the held ball, by
//!   converged Newton with exact contact (no penetration) of the vertices. An engine that lets the ball ride on
//!   flat faces solves another discrete problem: every row is also held against the equilibrium of points on faces.
//! * **Force**: what the engine says the ball feels. Where it does not say, what the clamp feels: elastic forces
//!   of its own energy at its own positions, and the momentum of the body. The two are compared in every row.
//! * **Turns**: all engines go through the same [`TURN`] of simulated time before the first goes on.

use super::beam::BodyFile;
use super::rival::{DAMPING, milliseconds, say};
use crate::toolbox::prelude::*;
use crate::toolbox::stats::median;
use bevy_ecs::entity::Entity;
use sinew::engine::mesh::generate::box_tets;
use sinew::touch::tool::{Points, Stiffness};

/// Block (m). As deep as one and a half balls' radii, and so wide that the ball stays a radius away from the sides.
pub const SIZE: DVec3 = DVec3::new(0.08, 0.06, 0.03);
/// Radius (m) of the ball: more than twice the mean edge, so that vertices are Sinew's points.
pub const RADIUS: f64 = 0.02;
/// Way (m) into the block: a fifth of its depth; the contact is then two edges wide to each side.
pub const DEPTH: f64 = 0.006;
/// Way (m) before the ball touches; with it the press takes two turns.
pub const GAP: f64 = 0.004;
/// Speed (m/s) of the press: far below the shear waves (1.9 m/s), so that the block follows.
const PRESS: f64 = 0.05;
/// Time (s) of holding: with [`DAMPING`] the motion fades to 5e-5.
const HOLD: f64 = 1.0;
/// Way (m) and speed (m/s) of the drag: four edges, of which the second half counts.
pub const DRAG: [f64; 2] = [0.02, 0.02];
/// Where the ball stands at first (m), off the lines of the mesh, so that symmetry hides nothing.
pub const AT: DVec3 = DVec3::new(0.031, 0.0315, SIZE.z + RADIUS + GAP);
/// Simulated time (s) of a turn; every step divides it.
pub const TURN: f64 = 0.1;
/// Largest imbalance of a vertex in a truth over the force, and depth over the ball's radius, that count as none.
const BALANCE: f64 = 1e-6;
/// Coefficient of friction of the second run.
pub const FRICTION: f64 = 0.3;
/// Times (s) of the end of the press, of the hold and of the drag.
pub const PHASES: [f64; 3] = {
    let pressed = (GAP + DEPTH) / PRESS;
    [pressed, pressed + HOLD, pressed + HOLD + DRAG[0] / DRAG[1]]
};

/// One engine in one setting under the ball.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct TouchRow {
    /// Engine; `truth` for equilibria.
    pub engine: String,
    /// Its version.
    pub version: String,
    /// Scene: size of the block.
    pub scene: String,
    /// Tetrahedra.
    pub elements: usize,
    /// Step, solver, points of contact in words.
    pub setting: String,
    /// Threads.
    pub threads: usize,
    /// `"f64"` or `"f32"`.
    pub precision: String,
    /// Force (N) on the ball at the end of the hold, against the press.
    pub force: Option<f64>,
    /// Its error (%) against the truth, exact contact of the vertices.
    pub error_percent: Option<f64>,
    /// The same against the equilibrium whose points are on the faces, for engines that keep the faces out.
    pub off_faces_percent: Option<f64>,
    /// Deepest penetration (mm) of a vertex of the surface at the end of any turn.
    pub depth_mm: Option<f64>,
    /// Median time (ms) of a step once the ball is pressed in, without friction.
    pub ms_per_step: Option<f64>,
    /// The same with friction.
    pub ms_with_friction: Option<f64>,
    /// Seconds of computation per simulated second of the run without friction.
    pub cost_per_simulated_second: Option<f64>,
    /// Largest less smallest force over the mean (%) in the second half of the drag without friction.
    pub ripple_percent: Option<f64>,
    /// Friction over coefficient times normal force (vector sums), mean of the second half of the drag.
    pub friction_ratio: Option<f64>,
    /// What else there is to know, in words.
    pub note: String,
}

/// The block.
pub struct TouchBlock {
    /// Its mesh.
    pub mesh: Mesh,
    /// Its material.
    pub material: YoungPoisson,
    /// Vertices of the clamp.
    pub fixed: Vec<u32>,
    /// Vertices of the surface that the ball meets.
    pub surface: Vec<u32>,
    name: String,
}

impl TouchBlock {
    /// Of so many cells along each edge, six tetrahedra each.
    ///
    /// # Errors
    /// When a number of cells is zero.
    pub fn new(cells: [usize; 3]) -> Result<Self> {
        let mesh = box_tets(SIZE, cells)?;
        let at = |z: f64| {
            let rows = 0..mesh.points.len() as u32;
            rows.filter(|&v| mesh.points[v as usize].z == z).collect::<Vec<u32>>()
        };
        let (fixed, surface) = (at(0.0), at(SIZE.z));
        let name = format!(
            "ball of {} mm, {} mm into a block {} x {} x {} m",
            1e3 * RADIUS,
            1e3 * DEPTH,
            SIZE.x,
            SIZE.y,
            SIZE.z
        );
        // soft tissue, as compressible as all three engines bear without locking
        let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.4, density: 1000.0 };
        Ok(Self { mesh, material, fixed, surface, name })
    }

    /// The form that rivals in other processes read.
    pub fn file(&self) -> BodyFile<'_> {
        BodyFile::new(&self.mesh, self.material.density, self.fixed.clone())
    }

    /// Place (m) of the ball at a time (s).
    pub fn place(t: f64) -> DVec3 {
        let down = (PRESS * t).min(GAP + DEPTH);
        let sideways = (DRAG[1] * (t - PHASES[1])).clamp(0.0, DRAG[0]);
        AT + DVec3::new(sideways, 0.0, -down)
    }

    /// How deep (m) a vertex of the surface is in the ball at a place, negative while apart.
    pub fn depth(&self, u: &[DVec3], place: DVec3) -> f64 {
        let x = |&v: &u32| self.mesh.points[v as usize] + u[v as usize];
        self.surface.iter().map(|v| RADIUS - x(v).distance(place)).fold(f64::NEG_INFINITY, f64::max)
    }

    /// A row without figures.
    pub fn row(&self, engine: &str, version: &str, setting: String) -> TouchRow {
        TouchRow {
            engine: engine.into(),
            version: version.into(),
            scene: self.name.clone(),
            elements: self.mesh.tetrahedra.len(),
            setting,
            threads: 1,
            precision: "f64".into(),
            ..TouchRow::default()
        }
    }

    /// The block in a world of ours.
    fn simulation(
        &self,
        model: Model,
        threads: usize,
        solver: SolverSettings,
    ) -> Result<(Simulation, BodyHandle, Entity)> {
        let mut simulation =
            Simulation::new(SimulationOptions { threads, exclusive: true, ..Default::default() })?;
        let description =
            BodyDescription { model, ..BodyDescription::new("block", &self.mesh, self.material) };
        let body = simulation.add_body(&description)?;
        let rows = simulation.rows(body, "clamp", &self.fixed)?;
        let clamp = simulation.add_constraint(Constraint::hold("clamp", rows));
        simulation.set_gravity(DVec3::ZERO);
        simulation.set_solver(solver);
        Ok((simulation, body, clamp))
    }
}

/// What a step of an engine says.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Wall time (ms).
    pub ms: f64,
    /// Force (N) on the ball.
    pub force: DVec3,
    /// The part of it that is friction, where it can be told.
    pub friction: Option<DVec3>,
}

/// A turn of an engine.
pub struct TouchTurn {
    /// Its steps.
    pub samples: Vec<Sample>,
    /// Displacements (m) at its end.
    pub displacements: Vec<DVec3>,
}

/// One engine in one setting.
pub trait Finger {
    /// Row without figures.
    fn row(&self, block: &TouchBlock) -> TouchRow;
    /// Step (s).
    fn step(&self) -> f64;
    /// Its energy.
    fn energy(&self) -> Model {
        Model::StVK
    }
    /// Whether the force is its own word, and not what the clamp feels.
    fn tells_force(&self) -> bool {
        true
    }
    /// Begins anew, at rest.
    fn start(&mut self, block: &TouchBlock, friction: f64) -> Result<()>;
    /// Makes steps at whose ends the ball is at these places (m).
    fn advance(&mut self, block: &TouchBlock, places: &[DVec3]) -> Result<TouchTurn>;
    /// What the runs said.
    fn remark(&self) -> String {
        String::new()
    }
}

/// What the clamp of a block feels.
pub struct TouchScale {
    simulation: Simulation,
    body: BodyHandle,
    clamp: Entity,
}

impl TouchScale {
    /// Of a block of ours with this energy.
    ///
    /// # Errors
    /// When it cannot be built.
    pub fn new(block: &TouchBlock, model: Model) -> Result<Self> {
        let (simulation, body, clamp) = block.simulation(model, 1, SolverSettings::default())?;
        Ok(Self { simulation, body, clamp })
    }

    /// Force (N) of the clamp on the body, which is that on the ball in equilibrium.
    pub fn weigh(&mut self, u: &[DVec3]) -> Result<DVec3> {
        self.simulation.set_state(self.body, u, &vec![DVec3::ZERO; u.len()])?;
        self.simulation.evaluate();
        Ok(self.simulation.reaction(self.clamp).unwrap_or(DVec3::NAN))
    }
}

/// An equilibrium under the held ball.
pub struct TouchTruth {
    /// Its energy.
    pub model: Model,
    /// Its row.
    pub row: TouchRow,
}

/// The equilibrium of an energy: exact contact of the vertices, or points on faces.
fn truth(block: &TouchBlock, model: Model, faces: Option<u32>) -> Result<TouchTruth> {
    let solver = SolverSettings {
        integrator: Integrator::QuasiStatic,
        linear_tolerance: 1e-8,
        max_newton_iterations: 300,
        ..Default::default()
    };
    let (mut simulation, body, clamp) = block.simulation(model, 0, solver)?;
    simulation.set_dt(1.0);
    let start = AT - DVec3::Z * GAP;
    let mut tool = Tool::new("ball", Shape::Sphere { radius: RADIUS }, start);
    match faces {
        Some(n) => (tool.points, tool.stiffness) = (Points::Faces(n), Stiffness::Relative(500.0)),
        None => tool = tool.exactly(),
    }
    let tool = simulation.add_tool(tool)?;
    let mut setting = format!("equilibrium of {}", model.name());
    setting += &faces.map_or(", exact, vertices".into(), |n| {
        format!(", {} points on every face, stiffness 500 E/edge", n * n)
    });
    // half a millimetre a step, and once more in place
    for i in 1..=13 {
        let down = (f64::from(i) / 12.0).min(1.0) * DEPTH;
        let place = start - DVec3::Z * down;
        simulation.move_tool(tool, place)?;
        simulation.step()?;
    }
    let report = simulation.report().clone();
    let felt = simulation.tool_report(tool).cloned().unwrap_or_default();
    let u = simulation.displacements(body);
    simulation.evaluate();
    let forces = simulation.elastic_forces(body).into_iter().zip(simulation.contact_forces(body));
    let free = forces.enumerate().filter(|(v, _)| !block.fixed.contains(&(*v as u32)));
    let (_, largest) = extremes(free.map(|(_, (elastic, contact))| (elastic + contact).length()));
    let held = simulation.reaction(clamp).unwrap_or(DVec3::NAN);
    let off = largest.max(felt.force.distance(held)) / felt.force.length();
    let depth = block.depth(&u, start - DVec3::Z * DEPTH);
    // judged by what it is asked for, balance and no penetration, whatever the solver says of itself
    if off.is_nan() || off > BALANCE || (faces.is_none() && depth.abs() > BALANCE * RADIUS) {
        let reason = format!(
            "out of balance by {off:.1e}, depth {depth:.1e} m, Newton step {:.1e} of the body, {} of its Newton and {} of \
             its contact loops at their cap",
            report.newton_step,
            u32::from(report.unconverged),
            report.contact.unconverged
        );
        return Err(BenchError::NoTruth { case: format!("{}, {setting}", block.name), reason });
    }
    let mut row = block.row("truth", env!("CARGO_PKG_VERSION"), setting);
    row.force = Some(felt.force.z);
    row.depth_mm = Some(1e3 * depth);
    let (least, _) = extremes(simulation.volume_ratios(body).into_iter());
    row.note = format!(
        "every vertex and the clamp in balance to {off:.0e} of it, Newton step {:.0e} of the body; smallest J {least:.2}",
        report.newton_step
    );
    Ok(TouchTruth { model, row })
}

fn extremes(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)))
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), x| (sum + x, n + 1.0));
    sum / n
}

/// A run of an engine, in samples by the time (s) of their ends.
#[derive(Default)]
pub struct Trace {
    /// Its steps.
    pub samples: Vec<(f64, Sample)>,
    /// Deepest penetration (m).
    pub depth: f64,
    /// The ball is in the surface as deep as if nothing had moved.
    pub through: bool,
    /// Displacements (m) at the end of the hold.
    pub held: Vec<DVec3>,
    /// Why it ended.
    pub failed: Option<String>,
}

impl Trace {
    fn between(&self, from: f64, to: f64) -> impl Iterator<Item = &Sample> + Clone {
        let inside = move |t: &f64| *t > from + 1e-9 && *t < to + 1e-9;
        self.samples.iter().filter(move |(t, _)| inside(t)).map(|(_, sample)| sample)
    }

    /// The second half of the drag.
    fn dragged(&self) -> impl Iterator<Item = &Sample> + Clone {
        self.between(0.5 * (PHASES[1] + PHASES[2]), PHASES[2])
    }
}

/// Runs all engines through press, hold and drag, in turns.
pub fn run(block: &TouchBlock, fingers: &mut [Box<dyn Finger + '_>], friction: f64) -> Vec<Trace> {
    let rest = vec![DVec3::ZERO; block.mesh.points.len()];
    let mut traces: Vec<Trace> = fingers
        .iter_mut()
        .map(|finger| {
            let failed = finger.start(block, friction).err().map(|e| e.to_string());
            Trace { failed, depth: f64::NEG_INFINITY, ..Trace::default() }
        })
        .collect();
    for turn in 0..(PHASES[2] / TURN).round() as usize {
        let end = TURN * (turn + 1) as f64;
        for (finger, trace) in fingers.iter_mut().zip(&mut traces) {
            if trace.failed.is_some() {
                continue;
            }
            let (h, done) = (finger.step(), trace.samples.len());
            let times = done + 1..=(end / h).round() as usize;
            let times: Vec<f64> = times.map(|i| h * i as f64).collect();
            let places: Vec<DVec3> = times.iter().map(|&t| TouchBlock::place(t)).collect();
            let finite = |t: &TouchTurn| {
                t.displacements.iter().all(|u| u.is_finite())
                    && t.samples.iter().all(|s| s.force.is_finite())
            };
            match finger.advance(block, &places) {
                Ok(turn) if finite(&turn) => {
                    trace.samples.extend(times.into_iter().zip(turn.samples));
                    let depth = block.depth(&turn.displacements, TouchBlock::place(end));
                    trace.depth = trace.depth.max(depth);
                    trace.through |=
                        end > PHASES[0] && depth > 0.9 * block.depth(&rest, TouchBlock::place(end));
                    if (end - PHASES[1]).abs() < 1e-9 {
                        trace.held = turn.displacements;
                    }
                }
                Ok(_) => trace.failed = Some(format!("not finite at {end:.1} s")),
                Err(error) => trace.failed = Some(format!("{error}, before {end:.1} s")),
            }
        }
    }
    traces
}

/// Fills a row from the runs without and with friction.
pub fn figures(
    row: &mut TouchRow,
    finger: &dyn Finger,
    truths: &[TouchTruth],
    faces: &TouchRow,
    runs: [&Trace; 2],
    clamp: Option<f64>,
) {
    let [smooth, rough] = runs;
    for (trace, which) in [(smooth, "without"), (rough, "with")] {
        if let Some(reason) = &trace.failed {
            say(&mut row.note, format!("no figures {which} friction: {reason}"));
        }
    }
    let vertical = |s: &Sample| s.force.z;
    let cost = |trace: &Trace| {
        let times: Vec<f64> = trace.between(PHASES[0], PHASES[2]).map(|s| s.ms).collect();
        trace.failed.is_none().then_some(median(&times)).flatten()
    };
    row.ms_per_step = cost(smooth);
    row.ms_with_friction = cost(rough);
    if smooth.held.is_empty() {
        return;
    }
    let settled = smooth.between(PHASES[1] - TURN, PHASES[1]).map(vertical);
    let force = mean(settled.clone());
    let (low, high) = extremes(settled);
    let off = |truth: &TouchRow| truth.force.map(|truth| 100.0 * (force / truth - 1.0));
    row.force = Some(force);
    row.error_percent = truths.first().and_then(|t| off(&t.row));
    row.off_faces_percent = off(faces);
    row.depth_mm = Some(1e3 * smooth.depth.max(rough.depth));
    if smooth.through {
        say(&mut row.note, "the ball goes through the surface");
    }
    if (high - low) > 0.01 * force.abs() {
        let moves = 100.0 * (high - low) / force.abs();
        say(&mut row.note, format!("does not settle: the held force moves by {moves:.1} %"));
    }
    let own = truths.iter().find(|t| t.model == finger.energy());
    if let Some(error) = own.and_then(|t| off(&t.row)).filter(|_| finger.energy() != Model::StVK) {
        let energy = finger.energy().name();
        say(
            &mut row.note,
            format!("{error:+.2} % from the equilibrium of its own energy ({energy})"),
        );
    }
    if let Some(clamp) = clamp.filter(|_| finger.tells_force()) {
        let off = 100.0 * (clamp / force - 1.0);
        say(&mut row.note, format!("the clamp feels {off:+.2} %"));
    }
    if smooth.failed.is_none() {
        let total: f64 = smooth.samples.iter().map(|(_, s)| s.ms).sum();
        row.cost_per_simulated_second = Some(1e-3 * total / PHASES[2]);
        let (low, high) = extremes(smooth.dragged().map(vertical));
        row.ripple_percent = Some(100.0 * (high - low) / mean(smooth.dragged().map(vertical)));
    }
    if rough.failed.is_none() {
        let ratios = rough.dragged().map(|s| {
            let friction = s.friction?;
            Some(friction.length() / (FRICTION * (s.force - friction).length()))
        });
        match ratios.collect::<Option<Vec<f64>>>() {
            Some(ratios) => row.friction_ratio = Some(mean(ratios.into_iter())),
            None => {
                let [x, z] =
                    [DVec3::X, DVec3::Z].map(|e| mean(rough.dragged().map(|s| s.force.dot(e))));
                let ratio = -x / (FRICTION * z);
                say(
                    &mut row.note,
                    format!("does not tell friction: sideways over its limit {ratio:.3}"),
                );
            }
        }
    }
}

/// Lets the engines compete; the rows of the truths stand before theirs.
///
/// # Errors
/// When a truth does not converge.
pub fn compete(block: &TouchBlock, fingers: &mut [Box<dyn Finger + '_>]) -> Result<Vec<TouchRow>> {
    let mut models = vec![Model::StVK];
    models.extend(fingers.iter().map(|f| f.energy()));
    let mut truths: Vec<TouchTruth> = Vec::new();
    for model in models {
        if truths.iter().all(|t| t.model != model) {
            truths.push(truth(block, model, None)?);
        }
    }
    let mut rows: Vec<TouchRow> = truths.iter().map(|t| t.row.clone()).collect();
    let mut faces = truth(block, Model::StVK, Some(4))?.row;
    faces.error_percent = faces.force.zip(truths[0].row.force).map(|(a, b)| 100.0 * (a / b - 1.0));
    rows.push(faces.clone());
    let [smooth, rough] = [0.0, FRICTION].map(|friction| run(block, fingers, friction));
    for (i, finger) in fingers.iter().enumerate() {
        let mut row = finger.row(block);
        let clamp = match smooth[i].held.as_slice() {
            [] => None,
            held => Some(TouchScale::new(block, finger.energy())?.weigh(held)?.z),
        };
        figures(&mut row, finger.as_ref(), &truths, &faces, [&smooth[i], &rough[i]], clamp);
        say(&mut row.note, finger.remark());
        rows.push(row);
    }
    Ok(rows)
}

/// One setting of Sinew.
struct SinewFinger {
    name: &'static str,
    model: Model,
    settings: SolverSettings,
    h: f64,
    /// Without penetration.
    exact: bool,
    points: Points,
    /// Built by a start.
    world: Option<(Simulation, BodyHandle, Entity)>,
    /// Steps, and those whose contact or Newton did not converge.
    steps: u32,
    missed: u32,
}

/// Default and safe steps of 10 ms with default contact, the default at the rivals' steps, the default energy, and
/// converged Newton with exact contact and with points on faces.
pub fn ours(quick: bool) -> Vec<Box<dyn Finger>> {
    let settings = |integrator| SolverSettings {
        integrator,
        mass_damping: DAMPING,
        ..SolverSettings::default()
    };
    let tight = SolverSettings { linear_tolerance: 1e-6, ..settings(Integrator::Newton) };
    let auto = settings(Integrator::Auto);
    let setting = |name, model, settings: &SolverSettings, h, exact, points| -> Box<dyn Finger> {
        let settings = settings.clone();
        let (steps, missed, world) = (0, 0, None);
        Box::new(SinewFinger { name, model, settings, h, exact, points, world, steps, missed })
    };
    let svk = Model::StVK;
    let usual = Points::Auto;
    let mut all = vec![
        setting("auto (default), StVK", svk, &auto, 0.01, false, usual),
        setting("safe, StVK", svk, &settings(Integrator::Safe), 0.01, false, usual),
        setting("newton, StVK, exact contact", svk, &tight, 0.01, true, Points::Vertex),
        setting(
            "newton, StVK, 16 points on every face",
            svk,
            &tight,
            0.01,
            false,
            Points::Faces(4),
        ),
    ];
    if !quick {
        all.push(setting("auto (default), StVK", svk, &auto, 0.002, false, usual));
        all.push(setting("auto, default energy", Model::default(), &auto, 0.01, false, usual));
    }
    if cfg!(feature = "rapier") {
        all.push(setting("auto (default), StVK", svk, &auto, 1.0 / 60.0, false, usual));
    }
    all
}

impl Finger for SinewFinger {
    fn row(&self, block: &TouchBlock) -> TouchRow {
        let tolerance = self.settings.linear_tolerance;
        let setting = format!("{}, h = {}, CG {tolerance:e}", self.name, milliseconds(self.h));
        block.row("Sinew", env!("CARGO_PKG_VERSION"), setting)
    }

    fn step(&self) -> f64 {
        self.h
    }

    fn energy(&self) -> Model {
        self.model
    }

    fn start(&mut self, block: &TouchBlock, friction: f64) -> Result<()> {
        let (mut simulation, body, _) = block.simulation(self.model, 1, self.settings.clone())?;
        simulation.set_dt(self.h);
        let ball = Tool::new("ball", Shape::Sphere { radius: RADIUS }, AT).with_friction(friction);
        let mut ball = ball.with_points(self.points);
        ball.exact = self.exact;
        let ball = simulation.add_tool(ball)?;
        self.world = Some((simulation, body, ball));
        Ok(())
    }

    fn advance(&mut self, _: &TouchBlock, places: &[DVec3]) -> Result<TouchTurn> {
        let Some((simulation, body, ball)) = &mut self.world else {
            return Err(BenchError::Rival("Sinew: not started".into()));
        };
        let mut samples = Vec::with_capacity(places.len());
        for &place in places {
            let begin = Instant::now();
            simulation.move_tool(*ball, place)?;
            simulation.step()?;
            let ms = begin.elapsed().as_secs_f64() * 1e3;
            let felt = simulation.tool_report(*ball).cloned().unwrap_or_default();
            samples.push(Sample { ms, force: felt.force, friction: Some(felt.friction) });
            let report = simulation.report();
            self.steps += 1;
            self.missed += u32::from(report.unconverged || report.contact.unconverged > 0);
        }
        Ok(TouchTurn { samples, displacements: simulation.displacements(*body) })
    }

    fn remark(&self) -> String {
        match self.missed {
            0 => String::new(),
            n => format!("contact or Newton at its cap in {n} of {} steps", self.steps),
        }
    }
}
