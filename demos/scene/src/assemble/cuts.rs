//! Cuts of a scene: checked, built, and made when they are due.

use super::scene::BuiltScene;
use super::select::which_body;
use crate::error::SceneError;
use crate::scene::{CutEntry, Key, Mode};
use crate::text::short;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew::models::cutting::CutError;
use sinew::simulation::{BodyHandle, Simulation};

/// A cut in the simulation, and what it did.
#[derive(Clone, Debug)]
pub struct BuiltCut {
    body: BodyHandle,
    time: f64,
    strip: Vec<[DVec3; 2]>,
    pub(super) done: bool,
    /// What it did, once it was made.
    pub summary: CutSummary,
}

/// What a cut did.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct CutSummary {
    /// Name.
    pub name: String,
    /// Body.
    pub body: String,
    /// Elements that it parted.
    pub separated: usize,
    /// Copies that came to be.
    pub copies: usize,
    /// Vertices that it made.
    pub vertices: usize,
    /// Vertices that were left for further cuts.
    pub spare: usize,
    /// Connected pieces of the body afterwards.
    pub pieces: usize,
    /// Area (m^2, at rest) of one side of the wound.
    pub area: f64,
    /// Host time (s).
    pub total_s: f64,
}

/// Vertices to keep for so many cuts of a body of so many vertices: planes across it, whatever their direction in a body
/// that is not very flat.
pub(super) fn spare(cuts: usize, vertices: usize) -> usize {
    cuts * (6.0 * (vertices as f64).powf(2.0 / 3.0)).ceil() as usize
}

/// A cut of a scene.
pub(super) fn cut(
    key: &Key,
    entry: &CutEntry,
    built: &mut BuiltScene,
) -> Result<BuiltCut, SceneError> {
    if built.plan.mode == Mode::Static {
        let remedy = "leave it out, or use mode = \"dynamic\"";
        return Err(key.value("a cut in a static scene", remedy));
    }
    let body = &built.bodies[which_body(key, entry.body.as_deref(), &built.bodies)?];
    let time = key.at("time").not_negative(entry.time, "time", "s")?;
    let at = key.at("strip");
    if entry.strip.len() < 2 {
        let found = format!("{} position(s) of the blade", entry.strip.len());
        return Err(at.value(found, "give two at least: the cut is the surface between them"));
    }
    let mut strip = Vec::with_capacity(entry.strip.len());
    for (i, &[p, q]) in entry.strip.iter().enumerate() {
        strip.push([at.entry(i).finite(p)?, at.entry(i).finite(q)?]);
    }
    if strip.iter().all(|[p, q]| p == q) {
        return Err(at.value("a blade without length", "give its edge two different ends"));
    }
    let (name, body, handle) = (entry.name.clone(), body.name.clone(), body.handle);
    built.simulation.check_cut(handle).map_err(|error| key.at("body").error(error))?;
    let summary = CutSummary { name, body, pieces: 1, ..CutSummary::default() };
    Ok(BuiltCut { body: handle, time, strip, done: false, summary })
}

impl BuiltCut {
    /// When it is made, and how, in words.
    pub fn words(&self) -> String {
        format!("at {} s, by a blade at {} positions", short(self.time), self.strip.len())
    }

    /// Goes on from where a run was: what it did, if it was made.
    pub(super) fn resume(&mut self, summary: Option<&CutSummary>) {
        self.done = summary.is_some();
        if let Some(summary) = summary {
            self.summary = summary.clone();
        }
    }

    /// Makes it, if it is due before the step that begins at `time` (s).
    pub(super) fn apply(
        &mut self,
        simulation: &mut Simulation,
        time: f64,
        dt: f64,
    ) -> Result<(), CutError> {
        // times are compared to within the rounding of the clock
        if self.done || time + 1e-6 * dt < self.time {
            return Ok(());
        }
        let report = simulation.cut(self.body, &self.strip)?;
        self.done = true;
        let CutSummary { name, body, .. } = std::mem::take(&mut self.summary);
        self.summary = CutSummary {
            name,
            body,
            separated: report.separated.len(),
            copies: report.copies.len(),
            vertices: report.vertices,
            spare: report.spare,
            pieces: report.pieces,
            area: report.area,
            total_s: report.time.as_secs_f64(),
        };
        Ok(())
    }
}
