//! When the state comes down to the columns.
//!
//! After every step (the default): 32 bytes a vertex. Or when somebody asks for it: [`fetch_state`], which
//! `Simulation` calls before it reads or changes anything. A step then brings down sums alone, and volume ratios are
//! reduced on the device. What a step itself needs the state for comes first, and brings it down:
//!
//! * elements inside out, or a body in recovery, since energies then decide on its law;
//! * other held vertices than in the last step, which may be anywhere;
//! * a constraint that begins, a removal that was asked for, and muscles, whose work is found from the columns
//!   ([`columns_needed`]);
//! * new element columns or other bodies, explicit substeps, and bodies whose volume ratios only the processor has:
//!   springs without a law of tetrahedra.
//!
//! Systems of a host app that read columns between steps do not ask: they need the state after every step. The bits
//! are the same either way.

use bevy_ecs::prelude::*;
use sinew_engine::element::TetrahedronVertices;
use sinew_engine::isoparametric::HexahedronVertices;
use sinew_engine::load::Constraint;
use sinew_engine::report::VolumeReport;
use sinew_engine::scalar::Scalar;
use sinew_engine::step::{ColumnsBehind, StepClock, VolumesReported, write_positions};
use sinew_engine::topology::Topology;
use sinew_engine::vertex::BodyId;
use sinew_models::axes::muscle::Muscles;
use sinew_models::resection::RemovalRequest;
use sinew_solvers::state::{NodeState, write_state};
use std::ops::Range;

use crate::backend::{GpuBackend, vertex_constants, widen};
use crate::body::RowSlot;
use crate::error::GpuError;
use crate::safe::BodyOutput;

/// Brings displacements, velocities and positions in the columns up to date, if they are behind the device. Should the
/// device be lost, the columns stay those of an earlier step and the next step says so.
pub fn fetch_state<S: Scalar>(world: &mut World) {
    if !world.contains_resource::<ColumnsBehind>() {
        return;
    }
    let Some(mut backend) = world.remove_resource::<GpuBackend>() else { return };
    if let Err(error) = backend.bring_columns_up_to_date::<S>(world) {
        backend.readback.lost = Some(error);
    }
    world.insert_resource(backend);
}

/// Whether the next step reads columns outside the integrator: a constraint that begins, a removal, or muscles.
pub fn columns_needed(world: &mut World) -> bool {
    if world.contains_resource::<Muscles>() {
        return true;
    }
    let clock = *world.resource::<StepClock>();
    let end = clock.time + clock.dt;
    let begins = |c: &Constraint| c.start.len() != c.rows.len() && c.active(end);
    world.query::<&Constraint>().iter(world).any(begins)
        || world.query::<&RemovalRequest>().iter(world).next().is_some()
}

impl GpuBackend {
    /// Whether the state comes down to the columns only when somebody asks for it by [`fetch_state`]; after every
    /// step otherwise, which is the default.
    pub fn read_back_on_demand(&mut self, on_demand: bool) {
        self.readback.on_demand = on_demand;
    }

    /// Notes whether the columns are behind.
    pub(crate) fn mark_columns(&mut self, world: &mut World, behind: bool) {
        self.readback.behind = behind;
        if behind {
            world.insert_resource(ColumnsBehind);
        } else {
            world.remove_resource::<ColumnsBehind>();
        }
    }

    /// Displacements and velocities from the device, if the columns are behind.
    pub(crate) fn bring_columns_up_to_date<S: Scalar>(
        &mut self,
        world: &mut World,
    ) -> Result<(), GpuError> {
        if !self.readback.behind {
            return Ok(());
        }
        let mut recorder = self.context.record();
        let pending: Vec<_> = self
            .bodies
            .iter()
            .map(|resident| {
                [RowSlot::U, RowSlot::V].map(|slot| resident.body.read_rows(&mut recorder, slot))
            })
            .collect();
        recorder.submit();
        let count = world.resource::<Topology>().vertex_count();
        let [mut u, mut v] = [(); 2].map(|()| Vec::with_capacity(count));
        for (resident, [new_u, new_v]) in self.bodies.iter_mut().zip(pending) {
            let state = [new_u.wait(&self.context)?, new_v.wait(&self.context)?];
            for (to, from) in [&mut u, &mut v].into_iter().zip(&state) {
                let first = to.len();
                to.resize(first + from.len(), [S::ZERO; 4]);
                widen(&mut to[first..], from);
            }
            resident.state = state;
        }
        write_state(world, &u, &v);
        self.mark_columns(world, false);
        // as in a schedule: it has no way to fail but to be missing
        let _ = world.run_system_cached(write_positions::<S>);
        Ok(())
    }

    /// Whether a step has to know the state before it begins.
    pub(crate) fn needs_columns<S: Scalar>(
        &self,
        world: &World,
        node: &NodeState<S>,
        rows: &[Range<usize>],
        volumes: &VolumeReport,
    ) -> bool {
        let topology = world.resource::<Topology>();
        let inside_out = volumes.inverted_by_body.iter().any(|&count| count > 0);
        inside_out
            || self.bodies.iter().zip(rows).zip(&topology.bodies).any(|((resident, rows), body)| {
                let loaded = &resident.body.elements.loaded_rows;
                resident.recovery.recovers()
                    || !vertex_constants(node, rows.clone(), body, loaded)
                        .eq(resident.vertices.iter().copied())
            })
    }

    /// Whether every element of the world is one whose volume ratio the device has.
    pub(crate) fn has_all_volumes(&self, world: &mut World) -> bool {
        let mut counts = vec![0; self.bodies.len()];
        let mut solids = world
            .query_filtered::<&BodyId, Or<(With<TetrahedronVertices>, With<HexahedronVertices>)>>();
        for body in solids.iter(world) {
            if let Some(count) = counts.get_mut(body.0 as usize) {
                *count += 1;
            }
        }
        let own = self.bodies.iter().map(|resident| resident.body.elements.solid_elements());
        own.eq(counts)
    }

    /// Volume ratios at the end of a step, if the device has all of them.
    pub(crate) fn report_volumes(&self, world: &mut World, outputs: &[BodyOutput]) {
        let found: Option<Vec<_>> = outputs.iter().map(|output| output.volumes).collect();
        let Some(found) = found else {
            world.remove_resource::<VolumesReported>();
            return;
        };
        let own = self.bodies.iter().map(|resident| resident.body.elements.solid_elements());
        let report = VolumeReport {
            smallest_ratio: found.iter().map(|f| f.0).fold(f64::INFINITY, f64::min),
            inverted: found.iter().map(|f| f.1).sum(),
            inverted_by_body: found.iter().map(|f| f.1).collect(),
            smallest_by_body: found.iter().map(|f| f.0).collect(),
            elements_by_body: own.collect(),
            ..VolumeReport::default()
        };
        world.insert_resource(report);
        world.insert_resource(VolumesReported);
    }
}
