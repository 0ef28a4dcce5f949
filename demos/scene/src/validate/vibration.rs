//! Modes of free vibration, schema `sinew-fem-modes/1`: frequencies (energy column) and shapes
//! (displacement columns).

use super::body::{CaseBody, CaseCells, CaseLaw, CaseMaterial, mesh};
use super::compare::{difference, largest, nearest, worst};
use super::read::ReferenceCase;
use super::{CaseError, STATIC_TOLERANCE, Status, ValidateOptions, ValidationRow};
use crate::modes::{VibrationMode, modes};
use sinew::models::body::VolumeRule;
use sinew::models::body::sheet::PlaneState;
use sinew::prelude::*;
use std::time::Instant;

const KEYS: &str = "E cells fixed_group frequencies_hz lumped_mass mesh mode_shapes_first3 name nodes nu \
    rho total_mass";

pub(super) fn run(
    case: &ReferenceCase,
    options: &ValidateOptions,
) -> Result<Vec<ValidationRow>, CaseError> {
    let mut row = ValidationRow::new(&case.name(), "linear, modes", 0, 0);
    let outcome = run_modes(case, options, &mut row);
    Ok(vec![row.ended(outcome)])
}

fn run_modes(
    case: &ReferenceCase,
    options: &ValidateOptions,
    row: &mut ValidationRow,
) -> Result<(), CaseError> {
    let root = case.root();
    root.refuse_unknown(KEYS)?;
    let mesh = mesh(case, options)?;
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
    let body = CaseBody {
        points: &mesh.points,
        cells,
        law: CaseLaw::Solid(Model::Linear, VolumeRule::Elements),
        clusters: None,
        material: &CaseMaterial::read(&root, cells.len())?,
        thickness: 1.0,
        plane: PlaneState::Stress,
    };
    let start = Instant::now();
    let (mut simulation, body) = body.simulation(case, options)?;
    let (found, iterations) = modes(&mut simulation, body, &held.vertices, frequencies.len())
        .map_err(|source| CaseError::Modes { case: case.path.clone(), source })?;
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
        let (max, rms) = difference(&shape, truth, largest(truth));
        row.max_difference = worst(row.max_difference, max);
        row.rms_difference = worst(row.rms_difference, rms);
    }
    row.seconds = start.elapsed().as_secs_f64();
    let tolerance = options.tolerance.unwrap_or(STATIC_TOLERANCE);
    if row.max_difference <= tolerance && row.energy_difference <= tolerance {
        row.status = Status::Pass;
    }
    row.note =
        format!("{} frequencies (energy column), {} shapes", frequencies.len(), shapes.len());
    Ok(())
}
