//! Recovery from inversion on the device: when it begins and ends, as `sinew_solvers::recovery` has it. The
//! corotational energy takes the place of the body's own in every pass over its elements.

use glam::DVec3;
use sinew_engine::report::StepReport;
use sinew_engine::topology::{BodyRows, Topology};
use sinew_solvers::recovery::{
    BodyShape, BodyState, LEAVE_STRAIN, RecoveryPlan, RecoveryUnending, SwapEnergies, is_crushed,
};

use crate::body::{DeviceBody, StepUniform};
use crate::context::Context;
use crate::elements::BodyEnergies;
use crate::error::GpuError;

/// What the decision for a body needs; its rows only.
pub(crate) struct Decision<'a> {
    pub index: usize,
    pub topology: &'a Topology,
    pub shape: BodyShape,
    /// Displacements (m), and rest positions (m).
    pub u: &'a [[f32; 4]],
    pub rest: &'a [DVec3],
    /// Kinetic energy of the free unknowns, and work of the dead loads along the displacements (J).
    pub kinetic: f64,
    pub load_potential: f64,
    /// Loads over what the material can hold, for a body that may begin.
    pub load: f64,
}

impl Decision<'_> {
    /// Decides whether the body recovers in the step to come. Says whether it was or is in recovery: the step
    /// then begins with the projected tangent.
    pub fn take(
        &self,
        on: bool,
        context: &Context,
        body: &mut DeviceBody,
        state: &mut BodyState,
        report: &mut StepReport,
    ) -> Result<bool, Refusal> {
        let was = state.recovers();
        if !on {
            *state = BodyState::Own;
            body.recovering = false;
            return Ok(was);
        }
        let mut plan = state.plan(&self.shape, || self.largest_strain() <= LEAVE_STRAIN);
        if was || plan == RecoveryPlan::Begin {
            let mut energies = |recovering| {
                body.recovering = recovering;
                report.evaluations += 1;
                elastic_energies(context, body)
            };
            let before = energies(was)?;
            if plan == RecoveryPlan::Begin && is_crushed(self.load, before.total()) {
                plan = RecoveryPlan::Stay;
                report.recoveries_refused += 1;
            }
            if state.rests(self.kinetic, before.total()) && plan == RecoveryPlan::Stay {
                plan = RecoveryPlan::GiveUp;
            }
            if plan != RecoveryPlan::Stay {
                let after = energies(plan == RecoveryPlan::Begin)?;
                let other = self.kinetic - self.load_potential;
                let (old, new) = (before.total(), after.total());
                let swap = SwapEnergies { old, new, other };
                if state.follow(plan, &self.shape, swap)? {
                    report.recovery_energy += after.elastic - before.elastic;
                    report.recoveries_given_up += u32::from(plan == RecoveryPlan::GiveUp);
                }
            }
        }
        body.recovering = state.recovers();
        report.recovering += u32::from(state.recovers());
        Ok(was || state.recovers())
    }

    /// Largest relative change of length of the edges.
    fn largest_strain(&self) -> f64 {
        let rows: &BodyRows = &self.topology.bodies[self.index];
        let vector = |u: &[f32; 4]| DVec3::new(u[0].into(), u[1].into(), u[2].into());
        let strain = |edge: [u32; 2]| {
            let [a, b] = edge.map(|row| (row - rows.vertices.start) as usize);
            let way = self.rest[a] - self.rest[b];
            let moved = vector(&self.u[a]) - vector(&self.u[b]);
            ((way + moved).length() / way.length() - 1.0).abs()
        };
        self.topology.used_edges(self.index).map(strain).fold(0.0, f64::max)
    }
}

/// Elastic energy (J), with the potential of loads that are laws, at the start of the step.
pub(crate) fn elastic_energy(context: &Context, body: &DeviceBody) -> Result<f64, GpuError> {
    Ok(elastic_energies(context, body)?.total())
}

fn elastic_energies(context: &Context, body: &DeviceBody) -> Result<BodyEnergies, GpuError> {
    let mut recorder = body.look_back(context, StepUniform::default());
    body.energies(&mut recorder);
    let energies = body.read_energies(&mut recorder);
    recorder.submit();
    Ok(body.elements.sum_energies(&energies.wait::<[f32; 4]>(context)?))
}

/// Why a decision could not be taken.
pub(crate) enum Refusal {
    Device(GpuError),
    Unending(RecoveryUnending),
}

impl From<GpuError> for Refusal {
    fn from(error: GpuError) -> Self {
        Self::Device(error)
    }
}

impl From<RecoveryUnending> for Refusal {
    fn from(error: RecoveryUnending) -> Self {
        Self::Unending(error)
    }
}
