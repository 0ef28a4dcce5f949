//! Resections of a scene, built, and carried out step by step.

use crate::text::{pressure, short};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew::models::body::present::MassPolicy;
use sinew::models::resection::{Region, Removal, RemovalError};
use sinew::simulation::{BodyHandle, Simulation};

/// A resection in the simulation, and what it has done so far.
#[derive(Clone, Debug)]
pub struct BuiltResection {
    pub(super) body: BodyHandle,
    pub(super) action: Action,
    pub(super) mass: MassPolicy,
    /// Times (s) between which it acts.
    pub(super) from: f64,
    pub(super) until: f64,
    /// Sums so far.
    pub summary: ResectionSummary,
}

#[derive(Clone, Debug)]
pub(super) enum Action {
    /// Once.
    Once(Region),
    /// At every step.
    Always(Region),
    /// A ball along a path of times (s) and positions (m).
    Tool { path: Vec<(f64, DVec3)>, radius: f64 },
}

/// What a resection did.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ResectionSummary {
    /// Name.
    pub name: String,
    /// Body.
    pub body: String,
    /// Tetrahedra removed.
    pub removed: usize,
    /// Hexahedra removed.
    pub removed_hexahedra: usize,
    /// Membrane triangles removed.
    pub removed_triangles: usize,
    /// Membrane quadrilaterals removed.
    pub removed_quads: usize,
    /// Tetrahedra left in the body after its last removal.
    pub remaining: usize,
    /// Hexahedra left in the body after its last removal.
    pub remaining_hexahedra: usize,
    /// Membrane triangles left in the body after its last removal.
    pub remaining_triangles: usize,
    /// Membrane quadrilaterals left in the body after its last removal.
    pub remaining_quads: usize,
    /// Connected pieces of the body after its last removal.
    pub pieces: usize,
    /// Vertices that lost their last element.
    pub orphans: usize,
    /// Mass removed (kg).
    pub mass: f64,
    /// Elastic and kinetic energy (J) that left the scene.
    pub energy: f64,
    /// Host time of all removals (s).
    pub total_s: f64,
    /// Host time of the longest (s).
    pub longest_s: f64,
}

impl BuiltResection {
    /// What it removes, and when, in words.
    pub fn words(&self) -> String {
        let times = match (self.from > 0.0, self.until.is_finite()) {
            (false, false) => String::new(),
            (true, false) => format!(", from {} s", self.from),
            (false, true) => format!(", until {} s", self.until),
            (true, true) => format!(", from {} s until {} s", self.from, self.until),
        };
        let what = match &self.action {
            Action::Once(_) => "by a list".to_string(),
            Action::Always(Region::Sphere { radius, .. }) => {
                format!("in a sphere of radius {} m", short(*radius))
            }
            Action::Always(Region::Strain { above }) => format!("strained above {}", short(*above)),
            Action::Always(Region::Stress { above }) => {
                format!("with a stress above {}", pressure(*above))
            }
            Action::Always(_) => "in a region".to_string(),
            Action::Tool { path, radius } => {
                let (first, last) = (path[0].0, path[path.len() - 1].0);
                format!(
                    "by a ball of radius {} m along a path of {} points, {first} s to {last} s",
                    short(*radius),
                    path.len()
                )
            }
        };
        what + &times
    }

    /// Where (m) the ball that removes is at a time (s), and its radius (m).
    pub fn ball(&self, time: f64) -> Option<(DVec3, f64)> {
        let Action::Tool { path, radius } = &self.action else { return None };
        let leg = path.windows(2).find(|leg| time >= leg[0].0 && time <= leg[1].0)?;
        let [(t0, a), (t1, b)] = [leg[0], leg[1]];
        Some((a.lerp(b, (time - t0) / (t1 - t0)), *radius))
    }

    /// Until when (s) it acts; what acts once has the past here afterwards.
    pub(crate) fn until(&self) -> f64 {
        self.until
    }

    /// Goes on from where a run was.
    pub(crate) fn resume(&mut self, until: f64, summary: ResectionSummary) {
        (self.until, self.summary) = (until, summary);
    }

    /// Carries out what is due before the step from `time` to `time + dt` (s).
    ///
    /// # Errors
    /// When a removal cannot be carried out, such as of a tetrahedron that another one removed before.
    pub fn apply(
        &mut self,
        simulation: &mut Simulation,
        time: f64,
        dt: f64,
    ) -> Result<(), RemovalError> {
        // times are compared to within the rounding of the clock
        let slack = 1e-6 * dt;
        let now = time + slack;
        let due = now >= self.from && time - slack <= self.until;
        let regions = match &self.action {
            Action::Once(region) | Action::Always(region) if due => vec![region.clone()],
            Action::Tool { path, radius } => swept(path, *radius, now - dt, now),
            _ => return Ok(()),
        };
        if matches!(self.action, Action::Once(_)) {
            self.until = f64::NEG_INFINITY;
        }
        for region in regions {
            let removal = Removal { region, mass: self.mass };
            let report = simulation.remove_elements(self.body, &removal)?;
            let s = &mut self.summary;
            s.total_s += report.time.as_secs_f64();
            s.longest_s = s.longest_s.max(report.time.as_secs_f64());
            let lists = [&report.tetrahedra, &report.triangles, &report.hexahedra, &report.quads];
            if lists.iter().all(|list| list.is_empty()) {
                continue;
            }
            s.removed += report.tetrahedra.len();
            s.removed_triangles += report.triangles.len();
            s.removed_hexahedra += report.hexahedra.len();
            s.removed_quads += report.quads.len();
            (s.remaining, s.pieces) = (report.remaining, report.pieces);
            s.remaining_triangles = report.remaining_triangles;
            s.remaining_hexahedra = report.remaining_hexahedra;
            s.remaining_quads = report.remaining_quads;
            s.orphans += report.orphans.len();
            s.mass += report.mass;
            s.energy += report.elastic_energy + report.kinetic_energy;
        }
        Ok(())
    }
}

/// What a ball along `path` sweeps after `from` and up to `to` (s).
pub fn swept(path: &[(f64, DVec3)], radius: f64, from: f64, to: f64) -> Vec<Region> {
    let (first, last) = (path[0], path[path.len() - 1]);
    if to < first.0 || from >= last.0 {
        return Vec::new();
    }
    let at = |t: f64| {
        let after = path.partition_point(|p| p.0 <= t);
        match (path.get(after.wrapping_sub(1)), path.get(after)) {
            (Some(a), Some(b)) => a.1.lerp(b.1, (t - a.0) / (b.0 - a.0)),
            (Some(a), None) | (None, Some(a)) => a.1,
            (None, None) => first.1,
        }
    };
    let within = path.iter().filter(|p| p.0 > from && p.0 < to).map(|p| p.1);
    let points: Vec<DVec3> = [at(from)].into_iter().chain(within).chain([at(to)]).collect();
    let capsule = |w: &[DVec3]| Region::Capsule { from: w[0], to: w[1], radius };
    points.windows(2).map(capsule).collect()
}
