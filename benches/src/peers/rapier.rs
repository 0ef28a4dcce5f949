//! Rapier's soft bodies: corotational tetrahedra, by its finite-element solver and by constraints.

use super::beam::masses;
use super::cut::{self, Carver, CutBeam, CutOutcome, CutRow};
use super::rival::{BeamCase, DAMPING, PeerRow, Rival, milliseconds};
use super::touch::{self, Finger, Sample, TouchBlock, TouchRow, TouchScale, TouchTurn};
use crate::toolbox::error::{BenchError, Result};
use glam::DVec3;
use rapier3d::prelude::*;
use sinew::engine::mesh::Mesh;
use sinew::prelude::{BodyDescription, Model, Simulation, SimulationOptions, YoungPoisson};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

/// Its default step (s).
pub const STEP: f64 = 1.0 / 60.0;

/// Parts into which it cuts a step by default.
const SUBSTEPS: usize = 4;

/// Version in `Cargo.toml`; the crate does not tell its own.
const VERSION: &str = "0.36";

/// The constraint solver (its default), the finite-element solver with its default 20 iterations and with 300.
fn settings() -> [(SoftBodySolver, usize); 3] {
    let default = SoftFemParameters::default().max_linear_iterations;
    [
        (SoftBodySolver::Constraints, default),
        (SoftBodySolver::Fem, default),
        (SoftBodySolver::Fem, 300),
    ]
}

/// All settings in steps of `h` (s).
pub fn rivals(case: &BeamCase, h: f64) -> Vec<Box<dyn Rival>> {
    let masses: Vec<f32> = case.beam.masses().iter().map(|&m| m as f32).collect();
    settings()
        .into_iter()
        .map(|(solver, iterations)| -> Box<dyn Rival> {
            Box::new(RapierRun { solver, iterations, h, masses: masses.clone() })
        })
        .collect()
}

struct RapierRun {
    solver: SoftBodySolver,
    /// Cap on conjugate-gradient iterations per substep.
    iterations: usize,
    /// Step (s).
    h: f64,
    masses: Vec<f32>,
}

/// Rapier's units of length in a metre. Cells of less than 1.2e-7 cubic units have no stiffness there, which is most
/// cells of a body of a few centimetres in metres.
const UNIT: f64 = 10.0;

fn single(x: DVec3) -> Vector {
    let x = UNIT * x;
    Vector::new(x.x as f32, x.y as f32, x.z as f32)
}

fn double(x: Vector) -> DVec3 {
    DVec3::new(x.x.into(), x.y.into(), x.z.into()) / UNIT
}

/// A setting with steps of `h` (s), in words.
fn setting(solver: SoftBodySolver, iterations: usize, h: f64, substeps: usize) -> String {
    let solver = match solver {
        SoftBodySolver::Constraints => "constraints (its default)".to_owned(),
        SoftBodySolver::Fem => format!("FEM, at most {iterations} CG iterations"),
    };
    format!("corotational, {solver}, h = {} in {substeps} substeps", milliseconds(h))
}

/// A body of corotational tetrahedra that stays awake.
fn soft_body(
    mesh: &Mesh,
    masses: &[f32],
    material: &YoungPoisson,
    fixed: Vec<u32>,
) -> SoftBodyBuilder {
    SoftBodyBuilder::new(mesh.points.iter().copied().map(single).collect())
        .masses(masses.to_vec())
        .cells(mesh.tetrahedra.clone())
        .cell_model(SoftBodyCellModel::Corotational)
        .material(SoftBodyMaterial {
            young_modulus: (material.young_modulus / UNIT) as f32,
            poisson_ratio: material.poisson_ratio as f32,
            ..Default::default()
        })
        .pinned_particles(fixed)
        .can_sleep(false)
}

impl RapierRun {
    /// A world with the beam at rest in `u`; damping takes the place of ours.
    fn world(&self, case: &BeamCase, u: &[DVec3], damping: f64) -> (PhysicsWorld, SoftBodyHandle) {
        let beam = &case.beam;
        let mut world = PhysicsWorld::new();
        world.gravity = single(DVec3::Z * -beam.gravity);
        world.integration_parameters.dt = self.h as f32;
        world.integration_parameters.soft_bodies.fem.max_linear_iterations = self.iterations;
        let builder = soft_body(&beam.mesh, &self.masses, &beam.material, beam.fixed.clone())
            .solver(self.solver)
            .linear_damping(damping as f32)
            .no_surface_collider();
        let handle = world.insert_soft_body(builder);
        let body = &mut world.soft_bodies[handle];
        for (i, (p, u)) in beam.mesh.points.iter().zip(u).enumerate() {
            body.set_particle_position(i, single(*p + *u));
        }
        (world, handle)
    }
}

/// Displacements (m) of a body whose mesh stood at `start` (m).
fn moved(mesh: &Mesh, body: &SoftBody, start: DVec3) -> Vec<DVec3> {
    let places = mesh.points.iter().zip(body.particle_positions());
    places.map(|(p, x)| double(x) - *p - start).collect()
}

/// Displacements (m) of a body that stayed finite.
fn displacements(case: &BeamCase, body: &SoftBody) -> Result<Vec<DVec3>> {
    let u = moved(&case.beam.mesh, body, DVec3::ZERO);
    if u.iter().all(|u| u.is_finite()) {
        Ok(u)
    } else {
        Err(BenchError::Rival("Rapier: the state is not finite".into()))
    }
}

impl Rival for RapierRun {
    fn time(&mut self, case: &BeamCase, steps: usize) -> Result<Vec<f64>> {
        let (mut world, _) = self.world(case, &case.start(), 0.0);
        // the first step builds its matrix pattern
        world.step();
        Ok((0..steps)
            .map(|_| {
                let begin = Instant::now();
                world.step();
                begin.elapsed().as_secs_f64() * 1e3
            })
            .collect())
    }

    fn force(&mut self, _: &BeamCase) -> Result<Option<f64>> {
        // not reachable on its own
        Ok(None)
    }

    fn settle(&mut self, case: &BeamCase) -> Result<Vec<DVec3>> {
        let rest = vec![DVec3::ZERO; case.truth.len()];
        let (mut world, handle) = self.world(case, &rest, DAMPING);
        for _ in 0..case.settling(self.h).0 {
            world.step();
        }
        displacements(case, &world.soft_bodies[handle])
    }

    fn swing(&mut self, case: &BeamCase, steps: usize, every: usize) -> Result<Vec<Vec<DVec3>>> {
        let rest = vec![DVec3::ZERO; case.beam.mesh.points.len()];
        let (mut world, handle) = self.world(case, &rest, 0.0);
        (0..steps / every)
            .map(|_| {
                (0..every).for_each(|_| world.step());
                displacements(case, &world.soft_bodies[handle])
            })
            .collect()
    }

    fn energy(&self) -> Model {
        Model::Corotational
    }

    fn is_euler(&self) -> bool {
        // four shorter ones
        false
    }

    fn row(&self, case: &BeamCase) -> PeerRow {
        let setting = setting(self.solver, self.iterations, self.h, SUBSTEPS);
        let mut row = case.row("Rapier", VERSION, setting);
        row.precision = "f32".into();
        row.note =
            "its energy is corotational: against StVK only the reduced weight tells its error \
                    from the difference of the models"
                .into();
        row
    }

    fn step(&self) -> Option<f64> {
        Some(self.h)
    }
}

/// The constraint solver and the finite-element solver by default and, unless `quick`, the latter with enough
/// iterations. Steps down to 1/240 s, 8 substeps, stiffer contact, undamped strain and 2 000 iterations were tried
/// beside it: the force went from 11 % below the equilibrium of its energy to 5 % above, and settled no better. Two blocks have
/// the constraint solver with four times the substeps too.
pub fn fingers(block: &TouchBlock, quick: bool) -> Result<Vec<Box<dyn Finger>>> {
    let [default, ..] = settings();
    let more = block.way.blocks.then_some((default, 4 * SUBSTEPS));
    settings()
        .into_iter()
        .take(if quick { 2 } else { 3 })
        .map(|setting| (setting, SUBSTEPS))
        .chain(more)
        .map(|((solver, iterations), substeps)| -> Result<Box<dyn Finger>> {
            let scale = TouchScale::new(block, Model::Corotational)?;
            let masses = masses(&block.mesh, block.material.density);
            Ok(Box::new(RapierPress { solver, iterations, substeps, scale, masses, world: None }))
        })
        .collect()
}

/// A world, its block, and its ball or second block.
type Pressed = (PhysicsWorld, SoftBodyHandle, Comes);

/// What comes to a block.
#[derive(Clone, Copy)]
enum Comes {
    Ball(RigidBodyHandle),
    /// Another block, as much higher (m) as the skins of both are thick: they meet before the surfaces do.
    Block(SoftBodyHandle, f64),
}

struct RapierPress {
    solver: SoftBodySolver,
    /// Cap on conjugate-gradient iterations per substep.
    iterations: usize,
    substeps: usize,
    scale: TouchScale,
    masses: Vec<f64>,
    world: Option<Pressed>,
}

impl RapierPress {
    /// Momentum (kg m/s) of the block.
    fn momentum(&self, body: &SoftBody) -> DVec3 {
        self.masses.iter().zip(body.particle_velocities()).map(|(m, v)| *m * double(v)).sum()
    }
}

impl Finger for RapierPress {
    fn row(&self, block: &TouchBlock) -> TouchRow {
        let setting = setting(self.solver, self.iterations, STEP, self.substeps);
        let row = block.row("Rapier", VERSION, setting);
        let mut note = "its energy is corotational; it does not tell all of its contact force: that is what the clamp \
                        feels, with the momentum of the block"
            .to_owned();
        if block.way.blocks {
            note += "; the upper block is higher by both skins, and depth counts from there";
        }
        TouchRow { precision: "f32".into(), note, ..row }
    }

    fn step(&self) -> f64 {
        STEP
    }

    fn energy(&self) -> Model {
        Model::Corotational
    }

    fn tells_force(&self) -> bool {
        false
    }

    fn start(&mut self, block: &TouchBlock, friction: f64) -> Result<()> {
        let mut world = PhysicsWorld::new();
        world.gravity = single(DVec3::Z * -block.gravity);
        world.integration_parameters.num_solver_iterations = self.substeps;
        world.integration_parameters.dt = STEP as f32;
        world.integration_parameters.soft_bodies.fem.max_linear_iterations = self.iterations;
        let masses: Vec<f32> = self.masses.iter().map(|&m| m as f32).collect();
        let build = |mesh: &Mesh, fixed: &[u32]| {
            soft_body(mesh, &masses, &block.material, fixed.to_vec())
                .solver(self.solver)
                .linear_damping(block.damping as f32)
                .surface_collider(
                    ColliderBuilder::ball(0.05).density(0.0).friction(friction as f32),
                )
        };
        let lower = build(&block.mesh, &block.fixed);
        let skin = lower.particle_radius;
        let lower = world.insert_soft_body(lower);
        let comes = if block.way.blocks {
            let raised = 2.0 * f64::from(skin) / UNIT;
            let mut mesh = block.mesh.clone();
            mesh.points.iter_mut().for_each(|x| *x += block.way.start + DVec3::Z * raised);
            Comes::Block(world.insert_soft_body(build(&mesh, &block.surface)), raised)
        } else {
            // its skin meets the ball before the surface does: the ball is drawn in by as much
            let radius = (UNIT * touch::RADIUS) as f32 - skin;
            let start = single(block.way.start);
            let ball = RigidBodyBuilder::kinematic_position_based().translation(start);
            let shape = ColliderBuilder::ball(radius).friction(friction as f32);
            Comes::Ball(world.insert(ball, shape).0)
        };
        self.world = Some((world, lower, comes));
        Ok(())
    }

    fn advance(&mut self, block: &TouchBlock, places: &[DVec3]) -> Result<TouchTurn> {
        let Some((mut world, soft, comes)) = self.world.take() else {
            return Err(BenchError::Rival("Rapier: not started".into()));
        };
        let mut samples = Vec::with_capacity(places.len());
        let mut displacements = Vec::new();
        let mut before = self.momentum(&world.soft_bodies[soft]);
        for &place in places {
            match comes {
                Comes::Ball(ball) => {
                    world.bodies[ball].set_next_kinematic_translation(single(place));
                }
                Comes::Block(upper, raised) => {
                    let upper = &mut world.soft_bodies[upper];
                    for &v in &block.surface {
                        let x = block.mesh.points[v as usize] + place + DVec3::Z * raised;
                        upper.set_particle_kinematic_target(v as usize, single(x));
                    }
                }
            }
            let begin = Instant::now();
            world.step();
            let ms = begin.elapsed().as_secs_f64() * 1e3;
            let body = &world.soft_bodies[soft];
            displacements = moved(&block.mesh, body, DVec3::ZERO);
            let now = self.momentum(body);
            // the clamp holds what the ball presses, less what moves the block and what damps it
            let inertia = (now - before) / STEP + block.damping * now;
            let force = self.scale.weigh(&displacements)? - inertia;
            before = now;
            samples.push(Sample { ms, force, friction: None });
        }
        if let Comes::Block(upper, raised) = comes {
            let start = block.way.start + DVec3::Z * raised;
            displacements.extend(moved(&block.mesh, &world.soft_bodies[upper], start));
        }
        self.world = Some((world, soft, comes));
        Ok(TouchTurn { samples, displacements })
    }
}

/// A cut of a beam by each solver.
pub fn carvers() -> Vec<Box<dyn Carver>> {
    let carver =
        |(solver, iterations)| -> Box<dyn Carver> { Box::new(RapierCut { solver, iterations }) };
    settings().into_iter().map(carver).collect()
}

struct RapierCut {
    solver: SoftBodySolver,
    /// Cap on conjugate-gradient iterations per substep.
    iterations: usize,
}

/// A body that was cut, and the vertex of the mesh that every particle is or is a copy of.
struct RapierParts<'a> {
    beam: &'a CutBeam,
    roots: Vec<u32>,
}

impl RapierCut {
    /// The beam at rest under its load from now on.
    fn world(&self, beam: &CutBeam) -> (PhysicsWorld, SoftBodyHandle) {
        let mut world = PhysicsWorld::new();
        world.gravity = Vector::ZERO;
        world.integration_parameters.dt = cut::STEP as f32;
        world.integration_parameters.soft_bodies.fem.max_linear_iterations = self.iterations;
        let masses = masses(&beam.mesh, beam.material.density);
        let masses: Vec<f32> = masses.iter().map(|&m| m as f32).collect();
        let builder = soft_body(&beam.mesh, &masses, &beam.material, beam.fixed.clone())
            .solver(self.solver)
            .linear_damping(DAMPING as f32)
            .no_surface_collider();
        let handle = world.insert_soft_body(builder);
        let body = &mut world.soft_bodies[handle];
        for (vertex, force) in beam.forces() {
            body.add_particle_force(vertex as usize, single(force), true);
        }
        (world, handle)
    }

    /// Cuts, in the present shape, and how long (ms) that took.
    fn cut<'a>(
        beam: &'a CutBeam,
        world: &mut PhysicsWorld,
        body: SoftBodyHandle,
    ) -> Result<(RapierParts<'a>, f64)> {
        let begin = Instant::now();
        let event = world.cut_soft_body(body, &beam.triangle().map(single));
        let ms = begin.elapsed().as_secs_f64() * 1e3;
        let event =
            event.ok_or_else(|| BenchError::Rival("Rapier: the blade cuts nothing".into()))?;
        if !event.pieces.is_empty() {
            return Err(BenchError::Rival("Rapier: the cut leaves more than one body".into()));
        }
        let mut roots: Vec<u32> = (0..beam.mesh.points.len() as u32).collect();
        for (copy, source) in event.split_particles {
            let root = roots.get(source as usize).copied();
            match root {
                Some(root) if copy as usize == roots.len() => roots.push(root),
                _ => return Err(BenchError::Rival("Rapier: copies are not in order".into())),
            }
        }
        Ok((RapierParts { beam, roots }, ms))
    }
}

impl RapierParts<'_> {
    /// Place (m) at rest of a particle, and its displacement (m).
    fn corner(&self, body: &SoftBody, particle: u32) -> [DVec3; 2] {
        let rest = self.beam.mesh.points[self.roots[particle as usize] as usize];
        [rest, double(body.particle_position(particle as usize)) - rest]
    }

    /// Faces of one cell only that are none of the beam's.
    fn wound(&self, body: &SoftBody) -> Vec<cut::WoundFace> {
        let sorted = |mut face: [u32; 3]| {
            face.sort_unstable();
            face
        };
        let outside: BTreeSet<[u32; 3]> =
            self.beam.mesh.surface_triangles().into_iter().map(sorted).collect();
        let mut faces = BTreeMap::new();
        for cell in body.cells() {
            let [a, b, c, d] = cell.vertices;
            for face in [[b, c, d], [a, d, c], [a, b, d], [a, c, b]] {
                let entry = faces.entry(sorted(face)).or_insert((face, 0));
                entry.1 += 1;
            }
        }
        let alone = faces.into_values().filter(|(_, cells)| *cells == 1).map(|(face, _)| face);
        let inside =
            |face: &[u32; 3]| !outside.contains(&sorted(face.map(|p| self.roots[p as usize])));
        alone.filter(inside).map(|face| face.map(|p| self.corner(body, p))).collect()
    }

    /// Elastic energy (J) by its own law, and kinetic energy.
    fn energy(&self, body: &SoftBody) -> Result<f64> {
        let corners = (0..self.roots.len() as u32).map(|p| self.corner(body, p));
        let (rest, u): (Vec<DVec3>, Vec<DVec3>) = corners.map(|[rest, u]| (rest, u)).unzip();
        let cells: Vec<[u32; 4]> = body.cells().iter().map(|cell| cell.vertices).collect();
        let model = Model::Corotational;
        let description = BodyDescription {
            model,
            ..BodyDescription::from_parts("beam", &rest, &cells, self.beam.material)
        };
        let mut simulation =
            Simulation::new(SimulationOptions { threads: 1, ..Default::default() })?;
        let own = simulation.add_body(&description)?;
        simulation.set_state(own, &u, &vec![DVec3::ZERO; u.len()])?;
        let moving = body.particles().iter().filter(|p| !p.is_pinned());
        let kinetic = |p: &SoftBodyParticle| {
            0.5 * f64::from(p.mass()) * double(p.velocity()).length_squared()
        };
        Ok(simulation.evaluate() + moving.map(kinetic).sum::<f64>())
    }
}

impl Carver for RapierCut {
    fn row(&self, beam: &CutBeam) -> CutRow {
        let setting = setting(self.solver, self.iterations, cut::STEP, SUBSTEPS);
        let mut row = beam.row("Rapier", VERSION, setting, "f32");
        row.note =
            "cuts along faces; energies by its law, from its positions and velocities".into();
        row
    }

    fn carve(&mut self, beam: &CutBeam) -> Result<CutOutcome> {
        let (mut world, body) = self.world(beam);
        let (parts, cut_ms) = Self::cut(beam, &mut world, body)?;
        let mut ms = Vec::new();
        for _ in 0..cut::SETTLED[0] {
            let begin = Instant::now();
            world.step();
            ms.push(begin.elapsed().as_secs_f64() * 1e3);
        }
        let wound = parts.wound(&world.soft_bodies[body]);
        if wound.iter().flatten().any(|corner| !corner[1].is_finite()) {
            return Err(BenchError::Rival("Rapier: the state is not finite".into()));
        }
        let (mut world, body) = self.world(beam);
        for _ in 0..cut::SETTLED[1] {
            world.step();
        }
        let roots = (0..beam.mesh.points.len() as u32).collect();
        let before = RapierParts { beam, roots }.energy(&world.soft_bodies[body])?;
        let (parts, _) = Self::cut(beam, &mut world, body)?;
        let energy = [before, parts.energy(&world.soft_bodies[body])?];
        Ok(CutOutcome { wound, energy, cut_ms, ms })
    }
}
