//! Single elements, schema `sinew-fem-elements/1`: energies and forces at given displacements.

use super::body::{CaseBody, CaseCells, CaseLaw, CaseMaterial};
use super::read::{CaseEntry, ReferenceCase};
use super::{CaseError, Rows, STATIC_TOLERANCE, Status, ValidationRow};
use glam::DVec3;
use sinew::engine::isoparametric::{gauss_point, quad_derivatives};
use std::time::Instant;

const KEYS: &str = "E cases name nu rho schema";
/// Keys of an element; all others are names of laws.
const ELEMENT_KEYS: [&str; 3] = ["cell", "points", "u"];
/// An element of every kind, in the order of the table.
const CELLS: [CaseCells; 4] = [
    CaseCells::Tetrahedra(&[[0, 1, 2, 3]]),
    CaseCells::Hexahedra(&[[0, 1, 2, 3, 4, 5, 6, 7]]),
    CaseCells::Triangles(&[[0, 1, 2]]),
    CaseCells::Quads(&[[0, 1, 2, 3]]),
];

pub(super) fn run(case: &ReferenceCase) -> Rows {
    let root = case.root();
    root.refuse_unknown(KEYS)?;
    let elements: Vec<CaseEntry> = root.get("cases").list()?.collect();
    let material = CaseMaterial::read(&root, elements.len())?;
    // kinds and laws that occur
    let mut groups: Vec<(usize, &str)> = Vec::new();
    for element in &elements {
        let kind = element.get("cell");
        let text = kind.text()?;
        let known = CELLS.iter().position(|cell| cell.kind() == text);
        let known = known.ok_or_else(|| kind.error("tet, hex, tri or quad"))?;
        for law in element.object()?.keys().filter(|key| !ELEMENT_KEYS.contains(&key.as_str())) {
            if !groups.contains(&(known, law)) {
                groups.push((known, law));
            }
        }
    }
    groups.sort_unstable();
    let mut rows = Vec::new();
    for (kind, law) in groups {
        let cell = CELLS[kind];
        let of_kind =
            |element: &CaseEntry| element.get("cell").text().is_ok_and(|kind| kind == cell.kind());
        let chosen = elements.iter().enumerate().filter(|(_, element)| of_kind(element));
        let chosen: Vec<_> = chosen.map(|(i, e)| (e, material.of_element(i))).collect();
        let mut row = ValidationRow::new(&case.name(), law, 0, chosen.len());
        row.note = format!("forces and energies of single elements ({})", cell.kind());
        let outcome = run_cells(case, law, &chosen, cell, &mut row);
        rows.push(row.ended(outcome));
    }
    Ok(rows)
}

/// Energies and forces of single elements of one kind that have this law.
fn run_cells(
    case: &ReferenceCase,
    law_name: &str,
    elements: &[(&CaseEntry, CaseMaterial)],
    cells: CaseCells,
    row: &mut ValidationRow,
) -> Result<(), CaseError> {
    let law = CaseLaw::find(law_name, cells.kind())?;
    let nodes = cells.nodes();
    row.nodes = nodes * elements.len();
    (row.max_difference, row.rms_difference, row.energy_difference) = (0.0, 0.0, 0.0);
    let start = Instant::now();
    let mut compared = 0;
    for (element, material) in elements {
        let Some(truth) = element.get(law_name).given() else { continue };
        let points = element.get("points").field(nodes)?;
        let u = element.get("u").field(nodes)?;
        if law_name == "svk_comp" && matches!(law, CaseLaw::Membrane(_)) && turns_over(&points, &u)
        {
            // signed areas of the plane there; in space a membrane has no wrong side
            row.note.push_str("; one turned over left out");
            continue;
        }
        let body = CaseBody::new(&points, cells, law, material);
        let (mut simulation, body) = body.displaced(case, &u)?;
        let energy = simulation.evaluate();
        let forces: Vec<DVec3> = simulation.elastic_forces(body).iter().map(|f| -*f).collect();
        row.worst_fields(&forces, &truth.get("f").field(nodes)?);
        row.worst_energy(energy, truth.get("energy").number()?);
        compared += 1;
    }
    row.seconds = start.elapsed().as_secs_f64();
    if compared == 0 {
        return Err(CaseError::NotRun("every one of these elements is turned over".into()));
    }
    let tolerance = case.options.tolerance.unwrap_or(STATIC_TOLERANCE);
    if row.max_difference <= tolerance && row.energy_difference <= tolerance {
        row.status = Status::Pass;
    }
    Ok(())
}

/// Whether displacements `u` turn a triangle, or a quadrilateral at some Gauss point, of the plane z = 0
/// over.
fn turns_over(points: &[DVec3], u: &[DVec3]) -> bool {
    let moved: Vec<DVec3> = points.iter().zip(u).map(|(p, u)| *p + *u).collect();
    let area = |x: &[DVec3], q: usize| {
        if let [a, b, c] = *x {
            return (b - a).cross(c - a).z;
        }
        let [xi, eta, _] = gauss_point(q);
        let derivatives = quad_derivatives([xi, eta]);
        let along =
            |j: usize| -> DVec3 { x.iter().zip(&derivatives).map(|(x, d)| *x * d[j]).sum() };
        along(0).cross(along(1)).z
    };
    (0..4).any(|q| area(points, q) * area(&moved, q) <= 0.0)
}
