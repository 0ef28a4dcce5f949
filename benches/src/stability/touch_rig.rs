//! The block, the hand and the steps that the cases of contact and friction share.

use super::prelude::*;
use bevy_ecs::entity::Entity;

/// Block (m) that tools meet, length of a step (s), and the radius (m) of probes.
pub(super) const BLOCK: DVec3 = DVec3::new(0.1, 0.1, 0.05);
pub(super) const STEP: f64 = 0.01;
pub(super) const RADIUS: f64 = 0.02;
/// Damping (1/s) of the way to rest.
pub(super) const DAMPING: f64 = 3.5;

/// The same in single precision.
pub(super) fn single(setting: &CaseSetting) -> CaseSetting {
    CaseSetting { precision: Precision::F32, ..*setting }
}

/// A tool and where it is.
pub(super) struct ToolHand {
    pub tool: Entity,
    pub at: DVec3,
}

impl ToolHand {
    pub fn new(run: &mut CaseRun, tool: Tool) -> Result<Self> {
        let at = tool.start.position;
        Ok(Self { tool: run.simulation.add_tool(tool)?, at })
    }

    /// A ball.
    pub fn ball(run: &mut CaseRun, radius: f64, at: DVec3) -> Result<Self> {
        Self::new(run, Tool::new("ball", Shape::Sphere { radius }, at))
    }

    /// Goes on by so much of the way in the next step.
    pub fn shift(&mut self, run: &mut CaseRun, way: DVec3) -> Result<()> {
        self.at += way;
        Ok(run.simulation.move_tool(self.tool, self.at)?)
    }

    /// Goes somewhere evenly at a speed (m/s), in whole steps of `dt` (s).
    pub fn go(&mut self, run: &mut CaseRun, to: DVec3, speed: f64, dt: f64) -> Result<()> {
        let from = self.at;
        let steps = (from.distance(to) / (speed * dt)).ceil().max(1.0);
        for i in 1..=steps as u32 {
            let at = from.lerp(to, (f64::from(i) / steps).min(1.0));
            run.simulation.move_tool(self.tool, at)?;
            run.step()?;
        }
        self.at = to;
        Ok(())
    }

    pub fn force(&self, run: &CaseRun) -> DVec3 {
        run.simulation.tool_report(self.tool).map_or(DVec3::NAN, |report| report.force)
    }
}

/// Soft tissue held at some sides, with damping.
pub(super) fn held<'a>(
    setting: &CaseSetting,
    mesh: &'a Mesh,
    sides: &[&str],
) -> Result<CaseRun<'a>> {
    let mut run = CaseRun::damped(setting, mesh, 0.45)?;
    run.simulation.set_dt(STEP);
    for side in sides {
        run.clamp(side)?;
    }
    run.open_books();
    Ok(run)
}
