//! Explicit steps of a world on the device: how many substeps, and what to do when the energy grows.

use bevy_ecs::prelude::World;
use sinew_engine::report::StepReport;
use sinew_engine::scalar::Scalar;
use sinew_engine::step::{StepClock, StepError};
use sinew_engine::substep::WithinStep;
use sinew_engine::topology::Topology;
use sinew_solvers::explicit::{MAX_REFINEMENTS, estimate_stable_step, unstable};
use sinew_solvers::settings::SolverSettings;
use sinew_solvers::stability::STRAIN_CHANGE;
use sinew_solvers::state::NodeState;
use std::ops::Range;

use crate::backend::{GpuBackend, add_angular, refused};
use crate::explicit::ExplicitStep;
use crate::recovery::elastic_energy;
use crate::report::Phase;
use crate::safe::BodyOutput;

impl GpuBackend {
    /// Explicit substeps of all bodies, not yet accepted.
    pub(crate) fn explicit_steps<S: Scalar>(
        &mut self,
        world: &mut World,
        settings: &SolverSettings,
        node: &NodeState<S>,
        rows: &[Range<usize>],
        report: &mut StepReport,
    ) -> Result<Vec<BodyOutput>, StepError> {
        let clock = *world.resource::<StepClock>();
        let mut within = WithinStep::default();
        within.read(world, &node.u, &node.prescribed, &node.fixed);
        // bodies as the columns have them
        for (i, rows) in rows.iter().enumerate() {
            let body = &world.resource::<Topology>().bodies[i];
            let resident = &mut self.bodies[i];
            let known = resident.vertices.clone();
            resident.tell(&self.context, node, rows.clone(), body, false);
            if known != resident.vertices {
                self.limit.known = None;
            }
        }
        // number of substeps
        let limit = self.stable_step::<S>(world, rows);
        report.stable_step = limit;
        let needed = self.limit.caution.substeps(&clock, limit, settings)?;
        // the step of every body, with more substeps where its energy grows
        let mut outputs = Vec::with_capacity(rows.len());
        let (mut grown, mut scale, mut refined) = (0.0, 0.0, false);
        for (i, rows) in rows.iter().enumerate() {
            let resident = &mut self.bodies[i];
            let context = &self.context;
            if !resident.carries_low {
                let mut recorder = context.record();
                recorder.pass(Phase::Rows, |pass| resident.body.each_row(pass, "forget_low"));
                recorder.submit();
            }
            let elastic = elastic_energy(context, &resident.body).map_err(refused)?;
            let [kinetic, held] = node.kinetic_energy(rows.clone(), &node.v);
            let now: Vec<_> = resident.state[0].clone();
            let step = ExplicitStep {
                context,
                body: &resident.body,
                settings,
                dt: clock.dt,
                rows: rows.clone(),
                load: &resident.load,
                place: [&now, &resident.target],
                before: [elastic, kinetic, held],
            };
            let mut substeps = needed;
            let mut refinements = 0;
            let mut own = StepReport { evaluations: 1, ..StepReport::default() };
            let (output, growth) = loop {
                let found = step.attempt(substeps, &mut within, &mut own).map_err(refused)?;
                if let Some(found) = found {
                    break found;
                }
                substeps = substeps.saturating_mul(2);
                refinements += 1;
                if refinements > MAX_REFINEMENTS || substeps > settings.max_substeps {
                    self.limit.known = None;
                    return Err(unstable(&clock, substeps / 2, limit));
                }
            };
            // the device has places between start and end in that slot
            resident.target.clear();
            refined |= refinements > 0;
            grown += growth[0];
            scale += growth[1];
            own.substeps = substeps;
            own.refinements = refinements;
            add_angular(&mut own, resident.centre);
            report.add_body(&own);
            outputs.push(output);
        }
        if self.limit.caution.book([grown, scale], refined) {
            self.limit.known = None;
        }
        Ok(outputs)
    }

    /// Largest stable explicit step (s), estimated on the processor, where an edge has changed enough.
    fn stable_step<S: Scalar>(&mut self, world: &mut World, rows: &[Range<usize>]) -> f64 {
        let topology = world.resource::<Topology>();
        let mut strain = Vec::with_capacity(topology.edges.len());
        for ((resident, rows), body) in self.bodies.iter().zip(rows).zip(&topology.bodies) {
            let blocks = body.blocks.start as usize..body.blocks.end as usize;
            let u = &resident.state[0];
            strain.extend(topology.edges[blocks].iter().map(|edge| {
                let [a, b] = edge.map(|row| row as usize);
                let way = (self.rest[a] - self.rest[b]).as_vec3();
                let [c, d] = [u[a - rows.start], u[b - rows.start]];
                let moved = glam::Vec3::new(c[0] - d[0], c[1] - d[1], c[2] - d[2]);
                moved.dot(2.0 * way + moved) / way.length_squared()
            }));
        }
        if let Some((limit, before)) = &self.limit.known {
            let apart =
                before.iter().zip(&strain).all(|(a, b)| (a - b).abs() <= STRAIN_CHANGE as f32);
            if apart && before.len() == strain.len() {
                return *limit;
            }
        }
        let limit = estimate_stable_step::<S>(world);
        self.limit.known = Some((limit, strain));
        limit
    }
}
