//! What the bodies of a scene are cut into: other elements, other volumes, other sizes, and how far each is from the finest.
//!
//! The error of a mesh is that of its converged steps: the scene's `dt` by Newton's method, against the same on the finest cut,
//! at the vertices that both have. The error of a solver has no part in it.

use super::{AdviceSearch, AdviseError, Choice, Result};
use crate::measures::displacement_error;
use crate::table::Table;
use crate::table_of;
use serde::Serialize;
use sinew::models::body::{Evaluation, VolumeRule};
use sinew::prelude::*;
use sinew_scene::assemble::{BuildOptions, build};
use sinew_scene::scene::{BodyEntry, LoadedScene, SolidCells};
use std::collections::HashMap;

/// A way to cut the bodies of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cut {
    /// Ten-node tetrahedra in place of linear ones.
    pub second_order: bool,
    /// Hexahedra in place of tetrahedra; boxes and cylinders.
    pub hexahedra: bool,
    /// Volumes by clusters and means.
    pub clusters: bool,
    /// Cells of boxes along each axis: half or twice as many (-1, 1), or as they are.
    pub finer: i8,
}

/// A way that was tried.
#[derive(Clone, Debug, Serialize)]
pub struct CutRow {
    /// Keys of the bodies in the scene file; empty for the scene as it is.
    pub keys: String,
    /// Solid elements.
    pub elements: usize,
    /// Vertices.
    pub vertices: usize,
    /// Mean wall time (ms) per frame, or to the equilibrium, with the settings of the scene.
    pub frame_ms: f64,
    /// Error of the mesh (%); `None` when the run failed.
    pub error_percent: Option<f64>,
    /// What the reader must know.
    pub note: String,
    /// The way.
    #[serde(skip)]
    pub cut: Cut,
}

/// What the search over cuts found.
#[derive(Clone, Debug, Serialize)]
pub struct Cuts {
    /// Keys of the finest one, which errors are measured against.
    pub finest: String,
    /// Its solid elements.
    pub finest_elements: usize,
    /// All that were tried.
    pub rows: Vec<CutRow>,
    /// Index of the one chosen: the fastest that is near enough, or the nearest.
    pub best: usize,
    /// Whether it is near enough.
    pub met: bool,
}

impl Cut {
    /// Every way that could be open.
    fn all() -> Vec<Self> {
        let mut all = Vec::new();
        for finer in [0, -1, 1] {
            for clusters in [false, true] {
                for [second_order, hexahedra] in [[false, false], [true, false], [false, true]] {
                    all.push(Self { second_order, hexahedra, clusters, finer });
                }
            }
        }
        all
    }

    /// Writes it into a scene; false, where it cannot be, or changes nothing.
    fn apply(self, loaded: &mut LoadedScene) -> bool {
        let before = loaded.scene.bodies.clone();
        let open = loaded.scene.bodies.iter_mut().all(|body| self.change(body));
        open && loaded.scene.bodies != before
    }

    fn change(self, body: &mut BodyEntry) -> bool {
        let Self { second_order, hexahedra, clusters, finer } = self;
        // springs, fibres and bare sheets are bound to their elements
        let bound = body.axes.is_some() || !body.fibres.is_empty() || body.springs.is_some();
        if bound || body.evaluation != Evaluation::Fused {
            return false;
        }
        if finer != 0 || hexahedra {
            let Some(shape) = body.generate.as_mut().and_then(|shape| shape.cuboid.as_mut()) else {
                return false;
            };
            if shape.elements == SolidCells::Irregular {
                return false;
            }
            if hexahedra {
                if shape.elements == SolidCells::Hexahedra || body.second_order {
                    return false;
                }
                shape.elements = SolidCells::Hexahedra;
            }
            let coarse = finer < 0;
            if coarse && shape.cells.iter().any(|n| n % 2 == 1) {
                return false;
            }
            let scaled = |n: usize| match finer {
                0 => n,
                _ if coarse => n / 2,
                _ => 2 * n,
            };
            shape.cells = shape.cells.map(scaled);
        }
        if second_order {
            let tetrahedra = body
                .generate
                .as_ref()
                .and_then(|shape| shape.cuboid.as_ref())
                .is_none_or(|shape| shape.elements != SolidCells::Hexahedra);
            if !tetrahedra || !body.model.serves_tetrahedra10() {
                return false;
            }
            body.second_order = true;
        }
        if clusters {
            if !body.model.keeps_mean_volume() {
                return false;
            }
            // a preset would take another Poisson's ratio, and be another tissue
            let of_preset = body.material.preset.as_deref().and_then(|name| preset(name).ok());
            if body.volume == VolumeRule::Elements
                && let Some(preset) = of_preset
            {
                let own = body.material.poisson_ratio;
                body.material.poisson_ratio = own.or(Some(preset.material.poisson_ratio));
            }
            body.volume = VolumeRule::Clusters;
        }
        true
    }

    /// What it changes in a scene file.
    pub fn keys(self) -> String {
        let mut words = Vec::new();
        if self.hexahedra {
            words.push("elements = \"hexahedra\"");
        }
        if self.second_order {
            words.push("second_order = true");
        }
        if self.clusters {
            words.push("volume = \"clusters\"");
        }
        match self.finer {
            0 => {}
            ..0 => words.push("half the cells"),
            _ => words.push("twice the cells"),
        }
        words.join(", ")
    }
}

/// What a converged run of a cut gives.
pub struct CutMotion {
    /// Body and rest position (m) of every vertex.
    pub rest: Vec<(usize, DVec3)>,
    /// Displacements (m) at the times of comparison.
    pub states: Vec<Vec<DVec3>>,
    /// Solid elements.
    pub elements: usize,
    /// What the reader must know.
    pub note: String,
}

impl AdviceSearch<'_> {
    /// The converged steps of the scene as it is cut.
    fn converged(&self) -> Result<CutMotion> {
        let built = build(self.loaded, &BuildOptions::default())?;
        let rest = built.bodies.iter().enumerate();
        let rest = rest.flat_map(|(i, body)| body.mesh.points.iter().map(move |&x| (i, x)));
        let elements = built
            .bodies
            .iter()
            .map(|body| body.mesh.tetrahedra.len() + body.mesh.hexahedra.len())
            .sum();
        let rest = rest.collect();
        let choice = Choice {
            integrator: (!self.fixed).then_some(Integrator::Newton),
            precision: Some(Precision::F64),
            threads: Some(0),
            linear_tolerance: Some(1e-4),
            newton_tolerance: Some(1e-7),
            ..Choice::default()
        };
        let run = self.run(&choice, None)?;
        let note = if run.finished { run.note } else { format!("not finished: {}", run.note) };
        Ok(CutMotion { rest, states: run.states, elements, note })
    }

    /// Tries all ways to cut the scene; `tell` hears of each.
    pub(super) fn cuts(&self, largest: f64, tell: &mut impl FnMut(&str)) -> Result<Cuts> {
        let as_it_is = (Cut::default(), self.loaded.clone());
        let mut open: Vec<(Cut, LoadedScene)> = vec![as_it_is];
        for cut in Cut::all() {
            let mut loaded = self.loaded.clone();
            if cut.apply(&mut loaded) && open.iter().all(|(_, known)| known.scene != loaded.scene) {
                open.push((cut, loaded));
            }
        }
        // the finest: twice the cells where that can be, of second order, volumes by means
        let order = |cut: &Cut| (cut.finer, cut.second_order, cut.hexahedra, cut.clusters);
        let finest = (0..open.len()).max_by_key(|&i| order(&open[i].0)).unwrap_or(0);
        let (cut, loaded) = open.remove(finest);
        tell(&format!("mesh: the finest ({})", cut.keys()));
        let truth = AdviceSearch { loaded: &loaded, ..*self }.converged()?;
        if !truth.note.is_empty() {
            let scene = self.loaded.scene.name.clone();
            let reason = format!("of the finest mesh ({}): {}", cut.keys(), truth.note);
            return Err(AdviseError::NoTruth { scene, reason });
        }
        let mut rows = Vec::new();
        for (cut, loaded) in &open {
            let name = if *cut == Cut::default() { "as it is".into() } else { cut.keys() };
            tell(&format!("mesh: {name}"));
            let search = AdviceSearch { loaded, ..*self };
            let motion = search.converged()?;
            let error = if motion.note.is_empty() { distance(&motion, &truth) } else { None };
            let frames = search.run(&Choice::default(), None)?.frames;
            let total = 1e3 * frames.iter().sum::<f64>();
            let count = if self.fixed { 1 } else { frames.len().max(1) };
            rows.push(CutRow {
                keys: cut.keys(),
                elements: motion.elements,
                vertices: motion.rest.len(),
                frame_ms: total / count as f64,
                error_percent: error.map(|e| 100.0 * e),
                note: motion.note,
                cut: *cut,
            });
        }
        let by_chance = |row: &CutRow| row.error_percent.is_some_and(|own| error(&rows, row) > own);
        let by_chance: Vec<bool> = rows.iter().map(by_chance).collect();
        for (row, by_chance) in rows.iter_mut().zip(by_chance) {
            if by_chance {
                row.note = "near by chance: finer ones of its kind are farther away".into();
            }
        }
        let (best, met) = choose(&rows, largest);
        let finest_elements = truth.elements;
        Ok(Cuts { finest: cut.keys(), finest_elements, rows, best, met })
    }
}

/// Error (%) that a row counts with: no mesh is nearer than finer ones of its kind but by chance, where errors cancel.
fn error(rows: &[CutRow], row: &CutRow) -> f64 {
    let kind = |row: &CutRow| Cut { finer: 0, ..row.cut };
    let finer = rows.iter().filter(|r| kind(r) == kind(row) && r.cut.finer > row.cut.finer);
    let own = row.error_percent.unwrap_or(f64::INFINITY);
    finer.filter_map(|row| row.error_percent).fold(own, f64::max)
}

/// The fastest that is near enough, or the nearest; and which it is.
pub fn choose(rows: &[CutRow], largest: f64) -> (usize, bool) {
    let errors: Vec<f64> = rows.iter().map(|row| error(rows, row)).collect();
    let near = (0..rows.len()).filter(|&i| errors[i] <= 100.0 * largest);
    match near.min_by(|&a, &b| rows[a].frame_ms.total_cmp(&rows[b].frame_ms)) {
        Some(best) => (best, true),
        None => {
            let all = 0..rows.len();
            let nearest = all.min_by(|&a, &b| errors[a].total_cmp(&errors[b]));
            (nearest.unwrap_or(0), false)
        }
    }
}

/// Largest distance of a vertex from where the truth has it, over the largest true displacement of a vertex that both have.
pub fn distance(found: &CutMotion, truth: &CutMotion) -> Option<f64> {
    let low = truth.rest.iter().fold(DVec3::INFINITY, |low, (_, x)| low.min(*x));
    let high = truth.rest.iter().fold(DVec3::NEG_INFINITY, |high, (_, x)| high.max(*x));
    let size = (high - low).max_element();
    // much coarser than rounding, much finer than any element
    let place = |x: DVec3| ((x - low) * (1e6 / size)).round().as_i64vec3().to_array();
    let known: HashMap<_, usize> =
        truth.rest.iter().enumerate().map(|(i, (body, x))| ((*body, place(*x)), i)).collect();
    let both: Vec<[usize; 2]> = (found.rest.iter().enumerate())
        .filter_map(|(i, (body, x))| known.get(&(*body, place(*x))).map(|&j| [i, j]))
        .collect();
    let pick = |states: &[Vec<DVec3>], which: usize| -> Option<Vec<Vec<DVec3>>> {
        let state = |u: &Vec<DVec3>| both.iter().map(|pair| u.get(pair[which]).copied()).collect();
        states.iter().map(state).collect()
    };
    displacement_error(&pick(&found.states, 0)?, &pick(&truth.states, 1)?, both.len())
}

impl Cuts {
    /// The scene with the bodies cut as chosen.
    pub(super) fn chosen(&self, loaded: &LoadedScene) -> LoadedScene {
        let mut loaded = loaded.clone();
        self.rows[self.best].cut.apply(&mut loaded);
        loaded
    }

    /// All that were tried, fastest first; the chosen one is marked.
    pub fn table(&self, scene: &str, frame: &'static str) -> Table {
        let mut order: Vec<usize> = (0..self.rows.len()).collect();
        order.sort_by(|&a, &b| self.rows[a].frame_ms.total_cmp(&self.rows[b].frame_ms));
        let title = format!("Meshes tried on {scene}");
        let name = |row: &CutRow| match &row.keys[..] {
            "" => "as it is".to_string(),
            keys => keys.to_string(),
        };
        let rows = order.iter().map(|&i| &self.rows[i]);
        let mut table = table_of!("meshes", title; for r in rows;
            "bodies" => name(r), "elements" => r.elements, "vertices" => r.vertices, frame => r.frame_ms,
            "mesh error %" => r.error_percent, "note" => &r.note,
        );
        table.marked.extend(order.iter().position(|&i| i == self.best));
        table
    }
}
