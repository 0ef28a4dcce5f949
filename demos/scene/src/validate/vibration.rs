//! Modes of free vibration, schema `sinew-fem-modes/1`: frequencies (energy column) and shapes
//! (displacement columns).

use super::body::{CaseBody, CaseCells, CaseLaw, CaseMaterial, mesh};
use super::compare::{nearest, worst};
use super::read::ReferenceCase;
use super::{CaseError, Rows, STATIC_TOLERANCE, Status, ValidationRow};
use crate::modes::{VibrationMode, modes};
use sinew::models::body::VolumeRule;
use sinew::prelude::*;
use std::time::Instant;

const KEYS: &str = "E cells fixed_group frequencies_hz lumped_mass mesh mode_shapes_first3 name nodes nu \
    rho total_mass";

pub(super) fn run(case: &ReferenceCase) -> Rows {
    let mut row = ValidationRow::new(&case.name(), "linear, modes", 0, 0);
    let outcome = run_modes(case, &mut row);
    Ok(vec![row.ended(outcome)])
}

fn run_modes(case: &ReferenceCase, row: &mut ValidationRow) -> Result<(), CaseError> {
    let root = case.root();
    root.refuse_unknown(KEYS)?;
    let mesh = mesh(case)?;
    let cells = CaseCells::of(&mesh).filter(|_| mesh.is_solid());
    let cells = cells.ok_or_else(|| CaseError::NotRun("the mesh has no solid elements".into()))?;
    (row.nodes, row.cells) = (mesh.points.len(), cells.len());
    let frequencies = root.get("frequencies_hz").numbers()?;
    let shapes = root.get("mode_shapes_first3").list()?;
    let shapes = shapes.map(|shape| shape.field(row.nodes)).collect::<Result<Vec<_>, _>>()?;
    if frequencies.is_empty() {
        return Err(root.get("frequencies_hz").error("at least one frequency"));
    }
    if shapes.len() > frequencies.len() {
        return Err(root.get("mode_shapes_first3").error("at most one per frequency"));
    }
    let group = root.get("fixed_group");
    let held = mesh.group(group.text()?).ok_or_else(|| group.error("a group of the mesh"))?;
    let law = CaseLaw::Solid(Model::Linear, VolumeRule::Elements);
    let material = CaseMaterial::read(&root, cells.len())?;
    let body = CaseBody::new(&mesh.points, cells, law, &material);
    let start = Instant::now();
    let (mut simulation, body) = body.simulation(case)?;
    let (found, iterations) = modes(&mut simulation, body, &held.vertices, frequencies.len())
        .map_err(|error| CaseError::of(&case.path, error))?;
    row.cg_iterations = iterations;
    let pairs = found.iter().zip(&frequencies);
    let off = pairs.map(|(mode, f)| (mode.frequency / f - 1.0).abs());
    row.energy_difference = off.fold(0.0, worst);
    (row.max_difference, row.rms_difference) = (0.0, 0.0);
    for (mode, truth) in found.iter().zip(&shapes) {
        // a mode has any length and sign, and modes of one frequency any mixture
        let same = |other: &&VibrationMode| (other.frequency / mode.frequency - 1.0).abs() < 1e-6;
        let together = found.iter().filter(same).map(|m| m.shape.clone());
        let shape = nearest(together, truth);
        row.worst_fields(&shape, truth);
    }
    row.seconds = start.elapsed().as_secs_f64();
    let tolerance = case.options.tolerance.unwrap_or(STATIC_TOLERANCE);
    if row.max_difference <= tolerance && row.energy_difference <= tolerance {
        row.status = Status::Pass;
    }
    row.note =
        format!("{} frequencies (energy column), {} shapes", frequencies.len(), shapes.len());
    Ok(())
}
