//! Recovery from inversion on the device: when it begins and ends, as `sinew_solvers::recovery` has it. The
//! corotational energy takes the place of the body's own in every pass over its elements.

use glam::DVec3;
use sinew_engine::report::{StepReport, VolumeReport};
use sinew_engine::topology::{BodyRows, Topology};
use sinew_solvers::recovery::{ENTER, LEAVE_RATIO, LEAVE_STRAIN};

use crate::body::{DeviceBody, StepUniform, total};
use crate::context::Context;
use crate::error::GpuError;

/// What the decision for a body needs; its rows only.
pub(crate) struct Decision<'a> {
    pub index: usize,
    pub topology: &'a Topology,
    pub volumes: &'a VolumeReport,
    /// Displacements (m), and rest positions (m).
    pub u: &'a [[f32; 4]],
    pub rest: &'a [DVec3],
    /// Kinetic energy of the free unknowns less the potential of the loads (J).
    pub other: f64,
}

impl Decision<'_> {
    /// Decides whether the body recovers in the step to come. `start` is its energy (J) when recovery began.
    /// Says whether it was or is in recovery: the step then begins with the projected tangent.
    pub fn take(
        &self,
        on: bool,
        context: &Context,
        body: &mut DeviceBody,
        start: &mut Option<f64>,
        report: &mut StepReport,
    ) -> Result<bool, GpuError> {
        let was = start.is_some();
        let volumes = self.volumes;
        let of = |counts: &[u64]| counts.get(self.index).copied().unwrap_or(0) as f64;
        let mut is = on
            && if was {
                let smallest = volumes.smallest_by_body.get(self.index);
                smallest.is_some_and(|&j| j <= LEAVE_RATIO) || self.largest_strain() > LEAVE_STRAIN
            } else {
                of(&volumes.inverted_by_body) > ENTER * of(&volumes.elements_by_body)
            };
        if is != was && on {
            let mut energy = |recovering| {
                body.recovering = recovering;
                elastic_energy(context, body)
            };
            let (before, after) = (energy(was)?, energy(is)?);
            report.evaluations += 2;
            if is {
                *start = Some(self.other + before);
            } else if start.is_some_and(|start| self.other + after > start) {
                is = true;
            }
            if is != was {
                report.recovery_energy += after - before;
            }
        }
        if !is {
            *start = None;
        }
        body.recovering = is;
        report.recovering += u32::from(is);
        Ok(was || is)
    }

    /// Largest relative change of length of the edges.
    fn largest_strain(&self) -> f64 {
        let rows: &BodyRows = &self.topology.bodies[self.index];
        let edges = &self.topology.edges[rows.blocks.start as usize..rows.blocks.end as usize];
        let vector = |u: &[f32; 4]| DVec3::new(u[0].into(), u[1].into(), u[2].into());
        let strain = |edge: &[u32; 2]| {
            let [a, b] = edge.map(|row| (row - rows.vertices.start) as usize);
            let way = self.rest[a] - self.rest[b];
            let moved = vector(&self.u[a]) - vector(&self.u[b]);
            ((way + moved).length() / way.length() - 1.0).abs()
        };
        edges.iter().map(strain).fold(0.0, f64::max)
    }
}

/// Elastic energy (J) at the start of the step.
pub(crate) fn elastic_energy(context: &Context, body: &DeviceBody) -> Result<f64, GpuError> {
    let mut recorder = body.look_back(context, StepUniform::default());
    body.energies(&mut recorder);
    let energies = body.read_energies(&mut recorder);
    recorder.submit();
    Ok(total(&energies.wait::<[f32; 4]>(context)?, 1, 0, 0))
}
