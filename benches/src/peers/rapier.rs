//! Rapier's soft bodies: corotational tetrahedra, by its finite-element solver and by constraints.

use super::{Case, DAMPING, PeerRow, Rival};
use crate::bench::error::BenchError;
use glam::DVec3;
use rapier3d::prelude::*;
use std::time::Instant;

/// Its default step (s).
const STEP: f64 = 1.0 / 60.0;

/// Version in `Cargo.toml`; the crate does not tell its own.
const VERSION: &str = "0.36";

/// The constraint solver (its default), the finite-element solver with its default 20 iterations and
/// with 300.
pub(super) fn rivals(case: &Case) -> Vec<Box<dyn Rival>> {
    let default = SoftFemParameters::default().max_linear_iterations;
    let settings = [
        (SoftBodySolver::Constraints, default),
        (SoftBodySolver::Fem, default),
        (SoftBodySolver::Fem, 300),
    ];
    let masses: Vec<f32> = case.beam.masses().iter().map(|&m| m as f32).collect();
    settings
        .into_iter()
        .map(|(solver, iterations)| -> Box<dyn Rival> {
            Box::new(Run { solver, iterations, masses: masses.clone() })
        })
        .collect()
}

struct Run {
    solver: SoftBodySolver,
    /// Cap on conjugate-gradient iterations per substep.
    iterations: usize,
    masses: Vec<f32>,
}

fn single(x: DVec3) -> Vector {
    Vector::new(x.x as f32, x.y as f32, x.z as f32)
}

impl Run {
    /// A world with the beam at rest in `u`; damping takes the place of ours.
    fn world(&self, case: &Case, u: &[DVec3], damping: f64) -> (PhysicsWorld, SoftBodyHandle) {
        let beam = &case.beam;
        let mut world = PhysicsWorld::new();
        world.gravity = Vector::new(0.0, 0.0, -beam.gravity as f32);
        world.integration_parameters.dt = STEP as f32;
        world.integration_parameters.soft_bodies.fem.max_linear_iterations = self.iterations;
        let builder = SoftBodyBuilder::new(beam.mesh.points.iter().copied().map(single).collect())
            .masses(self.masses.clone())
            .cells(beam.mesh.tetrahedra.clone())
            .cell_model(SoftBodyCellModel::Corotational)
            .material(SoftBodyMaterial {
                young_modulus: beam.material.young_modulus as f32,
                poisson_ratio: beam.material.poisson_ratio as f32,
                ..Default::default()
            })
            .solver(self.solver)
            .pinned_particles(beam.fixed())
            .linear_damping(damping as f32)
            .no_surface_collider()
            .can_sleep(false);
        let handle = world.insert_soft_body(builder);
        let body = &mut world.soft_bodies[handle];
        for (i, (p, u)) in beam.mesh.points.iter().zip(u).enumerate() {
            body.set_particle_position(i, single(*p + *u));
        }
        (world, handle)
    }
}

impl Rival for Run {
    fn time(&mut self, case: &Case, steps: usize) -> Result<Vec<f64>, BenchError> {
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

    fn force(&mut self, _: &Case) -> Result<Option<f64>, BenchError> {
        // not reachable on its own
        Ok(None)
    }

    fn settle(&mut self, case: &Case) -> Result<Vec<DVec3>, BenchError> {
        let rest = vec![DVec3::ZERO; case.truth.len()];
        let (mut world, handle) = self.world(case, &rest, DAMPING);
        for _ in 0..case.settling(STEP).0 {
            world.step();
        }
        let body = &world.soft_bodies[handle];
        let u: Vec<DVec3> = (case.beam.mesh.points.iter().zip(body.particle_positions()))
            .map(|(p, x)| DVec3::new(x.x.into(), x.y.into(), x.z.into()) - *p)
            .collect();
        if u.iter().all(|u| u.is_finite()) {
            Ok(u)
        } else {
            Err(BenchError::Rival("Rapier: the state is not finite".into()))
        }
    }

    fn row(&self, case: &Case) -> PeerRow {
        let solver = match self.solver {
            SoftBodySolver::Constraints => "constraints (its default)".to_owned(),
            SoftBodySolver::Fem => format!("FEM, at most {} CG iterations", self.iterations),
        };
        let h = super::milliseconds(STEP);
        let setting = format!("corotational, {solver}, h = {h} in its 4 substeps");
        let mut row = case.row("Rapier", VERSION, setting);
        row.precision = "f32".into();
        row.note =
            "its energy is corotational: against StVK only the reduced weight tells its error \
                    from the difference of the models"
                .into();
        row
    }

    fn step(&self) -> Option<f64> {
        Some(STEP)
    }
}
