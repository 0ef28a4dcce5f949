//! Speed against error of the rivals, a chart for each scene.

use super::{PeerReport, PeerRow, TouchRow};
use crate::toolbox::plot::{ChartPanel, Series, panels};
use crate::toolbox::prelude::*;

/// Places in the list of colours of Sinew, and of the first and second setting of a rival.
const COLOURS: [(&str, usize); 8] = [
    ("Sinew safe", 0),
    ("Sinew auto", 5),
    ("Sinew explicit", 7),
    ("MuJoCo, its cap", 4),
    ("MuJoCo, converged", 1),
    ("Rapier constraints", 6),
    ("Rapier, its cap", 3),
    ("Rapier, converged", 2),
];

/// What a row counts as in the legend; none for equilibria, which have no steps.
fn name(row: &PeerRow) -> Option<&'static str> {
    let has = |word: &str| row.setting.contains(word);
    let capped = has("its default") || has("at most 20 CG");
    Some(match (row.engine.as_str(), capped) {
        ("Sinew", _) if has("default") || has("auto,") => "Sinew auto",
        ("Sinew", _) if has("safe") => "Sinew safe",
        ("Sinew", _) if has("explicit") => "Sinew explicit",
        ("MuJoCo", true) => "MuJoCo, its cap",
        ("MuJoCo", false) => "MuJoCo, converged",
        ("Rapier", _) if has("constraints") => "Rapier constraints",
        ("Rapier", true) => "Rapier, its cap",
        ("Rapier", false) => "Rapier, converged",
        _ => return None,
    })
}

/// Points of the rows that have both figures, by name, cheapest first.
fn series<'a>(points: impl Iterator<Item = (&'a str, Option<f64>, Option<f64>)>) -> Vec<Series> {
    let mut all: Vec<Series> = COLOURS
        .iter()
        .map(|(name, colour)| {
            Series::new(*name, Vec::new(), *colour).hollow(!name.starts_with("Sinew"))
        })
        .collect();
    for (name, cost, error) in points {
        if let Some((place, point)) =
            all.iter().position(|s| s.name == name).zip(cost.zip(error.map(f64::abs)))
        {
            all[place].points.push([point.0, point.1]);
        }
    }
    all.iter_mut().for_each(|s| s.points.sort_by(|a, b| a[0].total_cmp(&b[0])));
    all
}

impl PeerReport {
    /// Charts of the largest beam of each rival, of the ball and of two blocks, which a page shows at once, and how many these are; then
    /// of the other beams, and of all beams in one picture.
    ///
    /// # Errors
    /// When one cannot be drawn.
    pub fn charts(&self) -> Result<(Vec<Chart>, usize)> {
        let mut scenes: Vec<&PeerRow> = Vec::new();
        // rows without a point make no chart
        let points = self
            .rows
            .iter()
            .filter(|r| name(r).and(r.cost_per_simulated_second).and(r.swing_percent).is_some());
        for row in points {
            if scenes.iter().all(|s| s.scene != row.scene) {
                scenes.push(row);
            }
        }
        // the largest of each beam, then of the rest the largest first
        scenes.sort_by_key(|s| std::cmp::Reverse(s.elements));
        let beam = |s: &PeerRow| s.scene.split(',').next().map(str::to_owned);
        let (mut first, mut rest): (Vec<&PeerRow>, Vec<&PeerRow>) = (Vec::new(), Vec::new());
        for scene in scenes {
            let known = first.iter().any(|s| beam(s) == beam(scene));
            if known { rest.push(scene) } else { first.push(scene) }
        }
        let mut leading = first.len();
        let beams: Vec<ChartPanel> = first
            .into_iter()
            .chain(rest)
            .enumerate()
            .map(|(i, scene)| {
                let rows = self.rows.iter().filter(|r| r.scene == scene.scene);
                let point = |r: &'_ PeerRow| {
                    name(r).map(|n| (n, r.cost_per_simulated_second, r.swing_percent))
                };
                let title = scene.scene.split_once(", ").map_or(&*scene.scene, |(_, rest)| rest);
                ChartPanel {
                    name: format!("peers-beam-{}", i + 1),
                    title: format!("Beam, {title}"),
                    series: series(rows.filter_map(point)),
                }
            })
            .collect();
        let touched = |r: &TouchRow| {
            let row = PeerRow {
                engine: r.engine.clone(),
                setting: r.setting.clone(),
                ..PeerRow::default()
            };
            // contact has settings of its own: all of ours that take steps are one line of the legend
            let name = if r.engine == "Sinew" { Some("Sinew safe") } else { name(&row) };
            name.map(|n| (n, r.cost_per_simulated_second, r.error_percent))
        };
        let points = |rows: &[TouchRow]| series(rows.iter().filter_map(touched));
        let contact = [
            ("peers-ball", "Ball on a block: error of the held force", points(&self.touch)),
            ("peers-blocks", "Two blocks: error of the held force", points(&self.bodies)),
        ];
        let cost = "s of computation per simulated s";
        let axes = |error| [cost, error];
        let drawn = |panel: &ChartPanel| panel.series.iter().any(|s| !s.points.is_empty());
        let mut charts = match beams.is_empty() {
            true => Vec::new(),
            false => panels("peers-beams", axes("error of the motion (%)"), &beams, false)?,
        };
        for (name, title, series) in contact {
            let panel = ChartPanel { name: name.into(), title: title.into(), series };
            if drawn(&panel) {
                let axes = axes("error (%), below 1e-4 at the floor");
                charts.splice(leading..leading, panels(name, axes, &[panel], false)?);
                leading += 1;
            }
        }
        Ok((charts, leading))
    }
}
