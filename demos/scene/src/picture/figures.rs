//! The figures that pictures of the gallery print, and what documents quote of the same runs: in one file beside the
//! pictures, written by the command that draws them, so that a test can tell when the code has gone on.

use super::job::nearest;
use crate::summary::RunSummary;
use crate::text::short;
use serde::{Deserialize, Serialize};
use sinew_render::scale::with_unit;
use sinew_render::scene::Recording;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Name of the file.
pub const FIGURES: &str = "figures.json";

/// Figures of all scenes, by name.
pub type GalleryFigures = BTreeMap<String, SceneFigures>;

/// What the picture of a scene prints and what its run found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneFigures {
    /// CRC-32 of the picture that was drawn with them.
    pub picture: String,
    /// Second line of the caption: model, integrator, step and size.
    pub caption: String,
    /// Time (s) of the picture, of a static scene the share of the loads.
    pub time: f64,
    /// What the colours show, and its unit.
    pub colours: Option<[String; 2]>,
    /// Value at the end of the colour bar.
    pub colours_end: Option<f64>,
    /// Forces (N) that the caption names: at the time of the picture, and the largest of the run.
    pub forces: BTreeMap<String, [f64; 2]>,
    /// Elements of all bodies.
    pub elements: usize,
    /// Steps.
    pub steps: u64,
    /// Step (s); of a static scene the share of the loads.
    pub dt: f64,
    /// Whether there is no time, but shares of the loads.
    pub is_static: bool,
    /// Mean estimate of the error of linearisation, of the size of the body.
    pub linearisation_error: f64,
    /// Linear systems with contact per step, where something touches.
    pub contact_rounds: Option<f64>,
    /// Loops of contact that ended at their cap, where something touches.
    pub contact_not_found: Option<u64>,
    /// Elements that were inverted at the end.
    pub inverted: u64,
}

impl SceneFigures {
    /// Of a run, with the picture at a time.
    pub fn new(recording: &Recording, summary: &RunSummary, at: f64) -> Self {
        let frame = &recording.frames[nearest(recording, Some(at))];
        let largest = |points: &[[f64; 2]]| points.iter().map(|p| p[1]).fold(0.0, f64::max);
        let forces = recording.forces.iter();
        let forces = forces.map(|s| (s.name.clone(), [s.at(frame.time), largest(&s.points)]));
        let field = recording.fields.first();
        let touch = summary.touch.as_ref();
        Self {
            picture: String::new(),
            caption: recording.subtitle.clone(),
            time: frame.time,
            colours: field.map(|f| [f.label.clone(), f.unit.clone()]),
            colours_end: field.map(|f| f64::from(f.range[1])),
            forces: forces.collect(),
            elements: summary.bodies.iter().map(elements).sum(),
            steps: summary.timing.step.count,
            dt: summary.settings.dt,
            is_static: recording.is_static,
            linearisation_error: summary.solver.figures.linearisation_error_mean,
            contact_rounds: touch.map(|t| t.figures.inner_iterations_mean),
            contact_not_found: touch.map(|t| t.figures.unconverged),
            inverted: summary.volume.inverted_final,
        }
    }

    /// Notes the file of the picture that was drawn with these figures.
    pub fn drawn(&mut self, png: &[u8]) {
        self.picture = checksum(png);
    }

    /// What the picture says in numbers.
    pub fn words(&self) -> String {
        let mut words = self.caption.clone();
        if let (Some([label, unit]), Some(end)) = (&self.colours, self.colours_end) {
            let _ = write!(words, "; {label} up to {}", with_unit(end, unit));
        }
        for (name, [now, largest]) in &self.forces {
            let [now, largest] = [now, largest].map(|force| with_unit(*force, "N"));
            let _ = write!(words, "; {} {now}, at most {largest}", name.replace('_', " "));
        }
        words
    }

    /// What differs from figures of another run by more than a share of the larger value, in words. Counts that hang on
    /// rounding, such as loops of contact that ended at their cap, are told and not compared.
    pub fn differences(&self, other: &Self, tolerance: f64) -> Vec<String> {
        let mut found = Vec::new();
        let mut same = |what: &str, equal: bool, texts: [String; 2]| {
            if !equal {
                found.push(format!("{what}: {} and {}", texts[0], texts[1]));
            }
        };
        let debug =
            |a: &dyn std::fmt::Debug, b: &dyn std::fmt::Debug| [format!("{a:?}"), format!("{b:?}")];
        same("caption", self.caption == other.caption, debug(&self.caption, &other.caption));
        same("colours", self.colours == other.colours, debug(&self.colours, &other.colours));
        let counts = |f: &Self| [f.elements as u64, f.steps];
        same(
            "elements and steps",
            counts(self) == counts(other),
            debug(&counts(self), &counts(other)),
        );
        let names = |f: &Self| f.forces.keys().cloned().collect::<Vec<_>>();
        same("forces", names(self) == names(other), debug(&names(self), &names(other)));
        let mut near = |what: &str, a: f64, b: f64, scale: f64| {
            let equal = (a - b).abs() <= tolerance * scale;
            same(what, equal, debug(&a, &b));
        };
        for (what, a, b) in [("time", self.time, other.time), ("step", self.dt, other.dt)] {
            near(what, a, b, a.abs());
        }
        let ends = [self, other].map(|f| f.colours_end.unwrap_or(0.0));
        near("end of the colour bar", ends[0], ends[1], ends[0].abs());
        for (name, [now, largest]) in &self.forces {
            let [b_now, b_largest] = other.forces.get(name).copied().unwrap_or_default();
            // a force on its way through 0 is as exact as the largest one
            near(&format!("force of {name}"), *now, b_now, *largest);
            near(&format!("largest force of {name}"), *largest, b_largest, *largest);
        }
        found
    }
}

/// CRC-32 (IEEE) in eight hexadecimal digits.
///
/// ```
/// assert_eq!(sinew_scene::picture::checksum(b"123456789"), "cbf43926");
/// ```
pub fn checksum(bytes: &[u8]) -> String {
    let crc = bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8)
            .fold(crc ^ u32::from(*byte), |c, _| (c >> 1) ^ (0xedb8_8320 & (c & 1).wrapping_neg()))
    });
    format!("{:08x}", !crc)
}

fn elements(body: &crate::summary::BodySummary) -> usize {
    let membrane = body.membrane.as_ref().map_or(0, |m| m.triangles + m.quads);
    body.tetrahedra + body.hexahedra + membrane
}

/// The table of `docs/numbers.md`: what these runs are and what the solver found, which holds on every machine.
pub fn scenes_table(figures: &GalleryFigures) -> String {
    let mut text = String::from(
        "| scene | elements | steps | linearisation error, mean | contact: systems per step, loops not found | largest forces |\n\
         |---|---|---|---|---|---|\n",
    );
    for (name, f) in figures {
        let steps = match f.is_static {
            true => format!("{} of the loads", f.steps),
            false => format!("{} of {} ms", f.steps, short(1e3 * f.dt)),
        };
        let error = match f.linearisation_error {
            // none is estimated while every body may be touched
            error if f.is_static || error == 0.0 => String::new(),
            error => format!("{:.1e}", error).replace("e-", "e−"),
        };
        let contact = match (f.contact_rounds, f.contact_not_found) {
            (Some(rounds), Some(lost)) => format!("{rounds:.1}, {lost}"),
            _ => String::new(),
        };
        let forces: Vec<String> = f
            .forces
            .iter()
            .map(|(name, [_, largest])| {
                format!("{} {}", name.replace('_', " "), with_unit(*largest, "N"))
            })
            .collect();
        let _ = writeln!(
            text,
            "| `{name}` | {} | {steps} | {error} | {contact} | {} |",
            f.elements,
            forces.join(", ")
        );
    }
    text
}

/// A text with what stands between `<!-- NAME -->` and `<!-- end of NAME -->` replaced; `None` without these lines.
pub fn with_block(text: &str, name: &str, content: &str) -> Option<String> {
    let (start, end) = (format!("<!-- {name} -->\n"), format!("<!-- end of {name} -->"));
    let from = text.find(&start)? + start.len();
    let to = from + text[from..].find(&end)?;
    Some(format!("{}{content}{}", &text[..from], &text[to..]))
}
