//! Contact beside rivals: a rigid ball is pressed into a block, held and dragged, with the same mesh, material,
//! lumped masses, damping and way of the ball in every engine. The same for a second block in place of the ball is in
//! [`bodies`].
//!
//! * **Truth** of the ball: the equilibrium of the St Venant-Kirchhoff body *on the same mesh* under the held ball, by
//!   converged Newton with exact contact (no penetration) of the vertices. An engine that lets the ball ride on
//!   flat faces solves another discrete problem: every row is also held against the equilibrium of points on faces.
//! * **Force**: what the engine says the ball feels. Where it does not say, what the clamp feels: elastic forces
//!   of its own energy at its own positions, and the momentum of the body. The two are compared in every row.
//! * **Turns**: all engines go through the same [`TURN`] of simulated time before the first goes on.

use super::beam::BodyFile;
use super::bodies;
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
/// Speed (m/s) of the press: far below the shear waves (1.9 m/s, of two blocks 1.3 m/s), so that the block follows.
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
/// The way of the ball.
pub const BALL: TouchWay =
    TouchWay { start: AT, gap: GAP, depth: DEPTH, drag: DRAG, blocks: false };

/// The way of what is pressed on a block: down along z, held there, then dragged along x.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TouchWay {
    /// Where it begins (m): centre of the ball, or corner of the second block where x, y and z are least.
    pub start: DVec3,
    /// Way (m) down before it touches.
    pub gap: f64,
    /// Way (m) from there into the block.
    pub depth: f64,
    /// Way (m) and speed (m/s) of the drag.
    pub drag: [f64; 2],
    /// A second block comes, held at its top, in place of a ball. What is dragged over its edge has ever less area in contact:
    /// steps are timed in the drag alone, where both blocks move, and ripple is off a parabola.
    pub blocks: bool,
}

impl TouchWay {
    /// Times (s) of the end of the press, of the hold and of the drag.
    pub const fn phases(&self) -> [f64; 3] {
        let pressed = (self.gap + self.depth) / PRESS;
        [pressed, pressed + HOLD, pressed + HOLD + self.drag[0] / self.drag[1]]
    }

    /// Place (m) at a time (s).
    pub fn place(&self, t: f64) -> DVec3 {
        let down = (PRESS * t).min(self.gap + self.depth);
        let sideways = (self.drag[1] * (t - self.phases()[1])).clamp(0.0, self.drag[0]);
        self.start + DVec3::new(sideways, 0.0, -down)
    }
}

/// One engine in one setting under the ball, or with two blocks.
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
    /// Force (N) on the ball or upper block at the end of the hold, against the press.
    pub force: Option<f64>,
    /// Its error (%) against the truth on the same mesh: exact contact of the vertices; of two blocks, contact by default.
    pub error_percent: Option<f64>,
    /// The same against a second equilibrium: that whose points are on the faces, for engines that keep the faces out; of
    /// two blocks, that on a finer mesh.
    pub off_second_percent: Option<f64>,
    /// Deepest penetration (mm) of a vertex of the surface at the end of any turn.
    pub depth_mm: Option<f64>,
    /// Median time (ms) of a step once the ball is pressed in, or while two blocks are dragged, without friction.
    pub ms_per_step: Option<f64>,
    /// The same with friction.
    pub ms_with_friction: Option<f64>,
    /// Seconds of computation per simulated second of the run without friction.
    pub cost_per_simulated_second: Option<f64>,
    /// Largest less smallest force over the mean (%) in the second half of the drag without friction.
    pub ripple_percent: Option<f64>,
    /// Friction over coefficient times normal force (vector sums), mean of the second half of the drag. Of two blocks,
    /// everything sideways counts as friction.
    pub friction_ratio: Option<f64>,
    /// Median time (ms) of a step of two blocks that swing apart from each other.
    pub ms_apart: Option<f64>,
    /// `ms_per_step` over `ms_apart`.
    pub over_apart: Option<f64>,
    /// `ms_with_friction` over `ms_apart`.
    pub friction_over_apart: Option<f64>,
    /// What else there is to know, in words.
    pub note: String,
}

/// The block, and what is pressed on it.
#[derive(Clone)]
pub struct TouchBlock {
    /// Its mesh; a second block is the same, moved.
    pub mesh: Mesh,
    /// Its material.
    pub material: YoungPoisson,
    /// Vertices of the clamp; of a second block, those that meet the first.
    pub fixed: Vec<u32>,
    /// Vertices of the surface that the ball or second block meets; of a second block, those that are held.
    pub surface: Vec<u32>,
    /// What the ball or the second block does.
    pub way: TouchWay,
    /// Gravity (m/s^2) against z.
    pub gravity: f64,
    /// Mass-proportional damping (1/s).
    pub damping: f64,
    /// Cells along each edge.
    pub cells: [usize; 3],
    name: String,
}

impl TouchBlock {
    /// Under a ball, of so many cells along each edge, six tetrahedra each.
    ///
    /// # Errors
    /// When a number of cells is zero.
    pub fn new(cells: [usize; 3]) -> Result<Self> {
        let [radius, depth] = [RADIUS, DEPTH].map(|x| 1e3 * x);
        // soft tissue, as compressible as all three engines bear without locking
        let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.4, density: 1000.0 };
        Self::of(
            SIZE,
            cells,
            material,
            BALL,
            format!("ball of {radius} mm, {depth} mm into a block"),
        )
    }

    /// A box of such edges (m), clamped at z = 0; its edges complete the name.
    ///
    /// # Errors
    /// When a number of cells is zero.
    pub fn of(
        size: DVec3,
        cells: [usize; 3],
        material: YoungPoisson,
        way: TouchWay,
        name: String,
    ) -> Result<Self> {
        let mesh = box_tets(size, cells)?;
        let at = |z: f64| {
            let rows = 0..mesh.points.len() as u32;
            rows.filter(|&v| mesh.points[v as usize].z == z).collect::<Vec<u32>>()
        };
        let (fixed, surface) = (at(0.0), at(size.z));
        let name = format!("{name} {} x {} x {} m", size.x, size.y, size.z);
        let (gravity, damping) = (0.0, DAMPING);
        Ok(Self { mesh, material, fixed, surface, way, gravity, damping, cells, name })
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        1 + usize::from(self.way.blocks)
    }

    /// The form that rivals in other processes read.
    pub fn file(&self) -> BodyFile<'_> {
        BodyFile::new(&self.mesh, self.material.density, self.fixed.clone())
    }

    /// How deep (m) a vertex of the surface is in the ball at a place or in the other block, negative while apart.
    pub fn depth(&self, u: &[DVec3], place: DVec3) -> f64 {
        if self.way.blocks {
            return bodies::depth(self, u);
        }
        let x = |&v: &u32| self.mesh.points[v as usize] + u[v as usize];
        self.surface.iter().map(|v| RADIUS - x(v).distance(place)).fold(f64::NEG_INFINITY, f64::max)
    }

    /// A row without figures.
    pub fn row(&self, engine: &str, version: &str, setting: String) -> TouchRow {
        TouchRow {
            engine: engine.into(),
            version: version.into(),
            scene: self.name.clone(),
            elements: self.blocks() * self.mesh.tetrahedra.len(),
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
        simulation.set_gravity(DVec3::Z * -self.gravity);
        simulation.set_solver(solver);
        Ok((simulation, body, clamp))
    }

    /// The same with the ball, or with the second block, which has the friction of the ball.
    fn world(
        &self,
        model: Model,
        threads: usize,
        solver: SolverSettings,
        ball: Tool,
    ) -> Result<TouchWorld> {
        let (mut simulation, body, clamp) = self.simulation(model, threads, solver)?;
        if !self.way.blocks {
            let ball = simulation.add_tool(ball)?;
            return Ok(TouchWorld {
                simulation,
                bodies: vec![body],
                clamp,
                comes: Comes::Ball(ball),
            });
        }
        let mut mesh = self.mesh.clone();
        mesh.points.iter_mut().for_each(|x| *x += self.way.start);
        let upper =
            BodyDescription { model, ..BodyDescription::new("upper", &mesh, self.material) };
        let upper = simulation.add_body(&upper)?;
        let rows = simulation.rows(upper, "hand", &self.surface)?;
        let hand = simulation.add_constraint(Constraint::hold("hand", rows));
        let pair = BodyContact::new("blocks", [body, upper]).with_friction(ball.friction);
        let comes = Comes::Block { contact: simulation.add_body_contact(pair), hand };
        Ok(TouchWorld { simulation, bodies: vec![body, upper], clamp, comes })
    }
}

/// What comes to a block of ours.
#[derive(Clone, Copy)]
enum Comes {
    Ball(Entity),
    Block { contact: Entity, hand: Entity },
}

/// A block in a world of ours, and what comes to it.
struct TouchWorld {
    simulation: Simulation,
    /// Lower and upper.
    bodies: Vec<BodyHandle>,
    clamp: Entity,
    comes: Comes,
}

impl TouchWorld {
    /// A step, at whose end the ball or the held side of the second block is there.
    fn step_to(&mut self, block: &TouchBlock, place: DVec3) -> Result<()> {
        match self.comes {
            Comes::Ball(ball) => self.simulation.move_tool(ball, place)?,
            Comes::Block { hand, .. } => {
                self.simulation.set_target(hand, Pose::from(place - block.way.start))?;
            }
        }
        self.simulation.step()?;
        Ok(())
    }

    /// Force (N) on the ball or second block in the last step, and the part of it that is friction.
    fn felt(&self) -> [DVec3; 2] {
        match self.comes {
            Comes::Ball(ball) => {
                let felt = self.simulation.tool_report(ball).cloned().unwrap_or_default();
                [felt.force, felt.friction]
            }
            Comes::Block { contact, .. } => {
                let felt = self.simulation.body_contact_report(contact).copied();
                [-felt.unwrap_or_default().force, DVec3::ZERO]
            }
        }
    }

    /// Displacements (m), body after body.
    fn displacements(&mut self) -> Vec<DVec3> {
        self.bodies.iter().flat_map(|&body| self.simulation.displacements(body)).collect()
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
    /// Displacements (m) at its end, those of a second block last.
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
    /// Makes steps at whose ends the ball or second block is at these places (m).
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

/// The equilibrium of an energy: exact contact of the vertices, or points on faces; of two blocks, contact by default.
pub(super) fn truth(block: &TouchBlock, model: Model, faces: Option<u32>) -> Result<TouchTruth> {
    let solver = SolverSettings {
        integrator: Integrator::QuasiStatic,
        linear_tolerance: 1e-8,
        max_newton_iterations: 300,
        ..Default::default()
    };
    let way = &block.way;
    let start = way.start - DVec3::Z * way.gap;
    let mut tool = Tool::new("ball", Shape::Sphere { radius: RADIUS }, start);
    let mut setting = format!("equilibrium of {}", model.name());
    match faces {
        _ if way.blocks => setting += ", contact by default",
        Some(n) => {
            (tool.points, tool.stiffness) = (Points::Faces(n), Stiffness::Relative(500.0));
            setting += &format!(", {} points on every face, stiffness 500 E/edge", n * n);
        }
        None => {
            tool = tool.exactly();
            setting += ", exact, vertices";
        }
    }
    let mut world = block.world(model, 0, solver, tool)?;
    world.simulation.set_dt(1.0);
    // a twelfth of the depth a step, and once more in place
    for i in 1..=13 {
        let down = (f64::from(i) / 12.0).min(1.0) * way.depth;
        world.step_to(block, start - DVec3::Z * down)?;
    }
    let [force, _] = world.felt();
    let u = world.displacements();
    let TouchWorld { simulation, bodies, clamp, .. } = &mut world;
    let report = simulation.report().clone();
    simulation.evaluate();
    let mut largest = 0.0_f64;
    for (body, held) in bodies.iter().zip([&block.fixed, &block.surface]) {
        let forces =
            simulation.elastic_forces(*body).into_iter().zip(simulation.contact_forces(*body));
        let free = forces.enumerate().filter(|(v, _)| !held.contains(&(*v as u32)));
        let (_, most) = extremes(free.map(|(_, (elastic, contact))| (elastic + contact).length()));
        largest = largest.max(most);
    }
    let held = simulation.reaction(*clamp).unwrap_or(DVec3::NAN);
    let off = largest.max(force.distance(held)) / force.length();
    let depth = block.depth(&u, start - DVec3::Z * way.depth);
    let exact = faces.is_none() && !way.blocks;
    // judged by what it is asked for, balance and no penetration, whatever the solver says of itself
    if off.is_nan() || off > BALANCE || (exact && depth.abs() > BALANCE * RADIUS) {
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
    row.force = Some(force.z);
    row.depth_mm = Some(1e3 * depth);
    let ratios = bodies.iter().flat_map(|&body| simulation.volume_ratios(body));
    let (least, _) = extremes(ratios);
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
    /// What was pressed, and how.
    pub way: TouchWay,
    /// Its steps.
    pub samples: Vec<(f64, Sample)>,
    /// Deepest penetration (m).
    pub depth: f64,
    /// The ball or second block is in the surface as deep as if nothing had moved.
    pub through: bool,
    /// Displacements (m) at the end of the hold.
    pub held: Vec<DVec3>,
    /// Why it ended.
    pub failed: Option<String>,
}

impl Trace {
    /// Steps that end in such a time (s).
    pub fn between(&self, from: f64, to: f64) -> impl Iterator<Item = &Sample> + Clone {
        let inside = move |t: &f64| *t > from + 1e-9 && *t < to + 1e-9;
        self.samples.iter().filter(move |(t, _)| inside(t)).map(|(_, sample)| sample)
    }

    /// The second half of the drag.
    fn dragged(&self) -> impl Iterator<Item = &Sample> + Clone {
        let [_, held, dragged] = self.way.phases();
        self.between(0.5 * (held + dragged), dragged)
    }

    /// Median time (ms) of the steps that count.
    fn cost(&self) -> Option<f64> {
        let [pressed, held, dragged] = self.way.phases();
        let from = if self.way.blocks { held } else { pressed };
        let times: Vec<f64> = self.between(from, dragged).map(|s| s.ms).collect();
        self.failed.is_none().then_some(median(&times)).flatten()
    }

    /// Largest less smallest vertical force over the mean (%) in the second half of the drag.
    fn ripple(&self) -> f64 {
        let forces: Vec<f64> = self.dragged().map(|s| s.force.z).collect();
        let over = if self.way.blocks { bodies::off_parabola(&forces) } else { forces.clone() };
        let (low, high) = extremes(over.into_iter());
        100.0 * (high - low) / mean(forces.into_iter())
    }
}

/// Runs all engines through press, hold and drag, in turns.
pub fn run(block: &TouchBlock, fingers: &mut [Box<dyn Finger + '_>], friction: f64) -> Vec<Trace> {
    run_until(block, fingers, friction, block.way.phases()[2])
}

/// The first seconds of that.
pub fn run_until(
    block: &TouchBlock,
    fingers: &mut [Box<dyn Finger + '_>],
    friction: f64,
    until: f64,
) -> Vec<Trace> {
    let way = block.way;
    let [pressed, hold, _] = way.phases();
    let rest = vec![DVec3::ZERO; block.mesh.points.len()];
    let mut traces: Vec<Trace> = fingers
        .iter_mut()
        .map(|finger| {
            let failed = finger.start(block, friction).err().map(|e| e.to_string());
            Trace { way, failed, depth: f64::NEG_INFINITY, ..Trace::default() }
        })
        .collect();
    for turn in 0..(until / TURN).round() as usize {
        let end = TURN * (turn + 1) as f64;
        // what would be the depth if nothing gave way
        let whole = if way.blocks { way.depth } else { block.depth(&rest, way.place(end)) };
        for (finger, trace) in fingers.iter_mut().zip(&mut traces) {
            if trace.failed.is_some() {
                continue;
            }
            let (h, done) = (finger.step(), trace.samples.len());
            let times = done + 1..=(end / h).round() as usize;
            let times: Vec<f64> = times.map(|i| h * i as f64).collect();
            let places: Vec<DVec3> = times.iter().map(|&t| way.place(t)).collect();
            let finite = |t: &TouchTurn| {
                t.displacements.iter().all(|u| u.is_finite())
                    && t.samples.iter().all(|s| s.force.is_finite())
            };
            match finger.advance(block, &places) {
                Ok(turn) if finite(&turn) => {
                    trace.samples.extend(times.into_iter().zip(turn.samples));
                    let depth = block.depth(&turn.displacements, way.place(end));
                    trace.depth = trace.depth.max(depth);
                    trace.through |= end > pressed && depth > 0.9 * whole;
                    if (end - hold).abs() < 1e-9 {
                        trace.held = turn.displacements;
                    }
                }
                Ok(_) => trace.failed = Some(format!("not finite at {end:.1} s")),
                Err(error) => trace.failed = Some(format!("{error}, before {end:.1} s")),
            }
        }
    }
    if way.blocks {
        // engines divide the force in different ways where faces are not level: the same division for all
        for (_, sample) in traces.iter_mut().flat_map(|trace| &mut trace.samples) {
            sample.friction = Some(sample.force.with_z(0.0));
        }
    }
    traces
}

/// Fills a row from the runs without and with friction.
pub fn figures(
    row: &mut TouchRow,
    finger: &dyn Finger,
    truths: &[TouchTruth],
    second: &TouchRow,
    runs: [&Trace; 2],
    clamp: Option<f64>,
) {
    let [smooth, rough] = runs;
    let [_, hold, end] = smooth.way.phases();
    for (trace, which) in [(smooth, "without"), (rough, "with")] {
        if let Some(reason) = &trace.failed {
            say(&mut row.note, format!("no figures {which} friction: {reason}"));
        }
    }
    let vertical = |s: &Sample| s.force.z;
    row.ms_per_step = smooth.cost();
    row.ms_with_friction = rough.cost();
    if smooth.held.is_empty() {
        return;
    }
    let settled = smooth.between(hold - TURN, hold).map(vertical);
    let force = mean(settled.clone());
    let (low, high) = extremes(settled);
    let off = |truth: &TouchRow| truth.force.map(|truth| 100.0 * (force / truth - 1.0));
    row.force = Some(force);
    row.error_percent = truths.first().and_then(|t| off(&t.row));
    row.off_second_percent = off(second);
    row.depth_mm = Some(1e3 * smooth.depth.max(rough.depth));
    if smooth.through {
        say(&mut row.note, "goes through the surface");
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
        row.cost_per_simulated_second = Some(1e-3 * total / end);
        row.ripple_percent = Some(smooth.ripple());
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
/// When a truth of the ball does not converge. Of two blocks, its row then says so.
pub fn compete(block: &TouchBlock, fingers: &mut [Box<dyn Finger + '_>]) -> Result<Vec<TouchRow>> {
    let mut models = vec![Model::StVK];
    models.extend(fingers.iter().map(|f| f.energy()));
    let mut truths: Vec<TouchTruth> = Vec::new();
    for model in models {
        if truths.iter().all(|t| t.model != model) {
            truths.push(match block.way.blocks {
                true => bodies::truth_or_reason(block, model)?,
                false => truth(block, model, None)?,
            });
        }
    }
    let mut rows: Vec<TouchRow> = truths.iter().map(|t| t.row.clone()).collect();
    let mut second = match block.way.blocks {
        true => bodies::truth_or_reason(&bodies::finer(block)?, Model::StVK)?.row,
        false => truth(block, Model::StVK, Some(4))?.row,
    };
    let off = second.force.zip(truths[0].row.force).map(|(a, b)| 100.0 * (a / b - 1.0));
    second.error_percent = off;
    rows.push(second.clone());
    let [smooth, rough] = [0.0, FRICTION].map(|friction| run(block, fingers, friction));
    let apart = block.way.blocks.then(|| bodies::apart(block, fingers));
    for (i, finger) in fingers.iter().enumerate() {
        let mut row = finger.row(block);
        let clamp = match smooth[i].held.get(..block.mesh.points.len()) {
            None => None,
            Some(held) => Some(TouchScale::new(block, finger.energy())?.weigh(held)?.z),
        };
        figures(&mut row, finger.as_ref(), &truths, &second, [&smooth[i], &rough[i]], clamp);
        row.ms_apart = apart.as_ref().and_then(|apart| apart[i]);
        let over = |ms: Option<f64>| Some(ms? / row.ms_apart?);
        [row.over_apart, row.friction_over_apart] =
            [over(row.ms_per_step), over(row.ms_with_friction)];
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
    world: Option<TouchWorld>,
    /// Steps, and those whose contact or Newton did not converge.
    steps: u32,
    missed: u32,
}

/// Default and safe steps of 10 ms with default contact, the default at the rivals' steps, the default energy, and
/// converged Newton with exact contact and with points on faces.
pub fn ours(quick: bool) -> Vec<Box<dyn Finger>> {
    let setting = |name, exact, points| -> Box<dyn Finger> {
        let finger = SinewFinger::new(name, Model::StVK, tight(), 0.01);
        Box::new(SinewFinger { exact, points, ..finger })
    };
    let mut all = usual(quick);
    let exact = setting("newton, StVK, exact contact", true, Points::Vertex);
    let faces = setting("newton, StVK, 16 points on every face", false, Points::Faces(4));
    all.splice(2..2, [exact, faces]);
    if !quick {
        let (name, model) = ("auto, default energy", Model::default());
        let auto = settings(Integrator::Auto);
        all.push(Box::new(SinewFinger::new(name, model, auto, 0.01)));
    }
    all
}

/// Default and safe steps of 10 ms with default contact, and the default at the rivals' steps.
fn usual(quick: bool) -> Vec<Box<dyn Finger>> {
    let setting = |name, integrator, h| -> Box<dyn Finger> {
        Box::new(SinewFinger::new(name, Model::StVK, settings(integrator), h))
    };
    let auto = "auto (default), StVK";
    let mut all =
        vec![setting(auto, Integrator::Auto, 0.01), setting("safe, StVK", Integrator::Safe, 0.01)];
    if !quick {
        all.push(setting(auto, Integrator::Auto, 0.002));
    }
    if cfg!(feature = "rapier") {
        all.push(setting(auto, Integrator::Auto, 1.0 / 60.0));
    }
    all
}

fn settings(integrator: Integrator) -> SolverSettings {
    SolverSettings { integrator, ..SolverSettings::default() }
}

fn tight() -> SolverSettings {
    SolverSettings { linear_tolerance: 1e-6, ..settings(Integrator::Newton) }
}

/// The usual steps with two blocks, and converged ones.
pub fn ours_with_blocks(quick: bool) -> Vec<Box<dyn Finger>> {
    let mut all = usual(quick);
    all.insert(2, Box::new(SinewFinger::new("newton, StVK", Model::StVK, tight(), 0.01)));
    all
}

impl SinewFinger {
    fn new(name: &'static str, model: Model, settings: SolverSettings, h: f64) -> Self {
        let (exact, points) = (false, Points::Auto);
        Self { name, model, settings, h, exact, points, world: None, steps: 0, missed: 0 }
    }
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
        let ball = Tool::new("ball", Shape::Sphere { radius: RADIUS }, block.way.start);
        let mut ball = ball.with_friction(friction).with_points(self.points);
        ball.exact = self.exact;
        let settings = SolverSettings { mass_damping: block.damping, ..self.settings.clone() };
        let mut world = block.world(self.model, 1, settings, ball)?;
        world.simulation.set_dt(self.h);
        self.world = Some(world);
        Ok(())
    }

    fn advance(&mut self, block: &TouchBlock, places: &[DVec3]) -> Result<TouchTurn> {
        let Some(world) = &mut self.world else {
            return Err(BenchError::Rival("Sinew: not started".into()));
        };
        let mut samples = Vec::with_capacity(places.len());
        for &place in places {
            let begin = Instant::now();
            world.step_to(block, place)?;
            let ms = begin.elapsed().as_secs_f64() * 1e3;
            let [force, friction] = world.felt();
            samples.push(Sample { ms, force, friction: Some(friction) });
            let report = world.simulation.report();
            self.steps += 1;
            self.missed += u32::from(report.unconverged || report.contact.unconverged > 0);
        }
        Ok(TouchTurn { samples, displacements: world.displacements() })
    }

    fn remark(&self) -> String {
        match self.missed {
            0 => String::new(),
            n => format!("contact or Newton at its cap in {n} of {} steps", self.steps),
        }
    }
}
