//! Static fields, schema `sinew-fem-ref/1`: one equilibrium of a mesh, compared law by law.

use super::body::{CaseBody, CaseCells, CaseLaw, CaseMaterial, mesh, plane_state};
use super::compare::{difference, largest};
use super::problem::{StaticProblem, StaticSolution, read_held};
use super::quadratic;
use super::read::{CaseEntry, ReferenceCase};
use super::{CaseError, Rows, STATIC_TOLERANCE, Status, ValidationRow};
use glam::DVec3;

/// Keys of a case; those of elements and clusters belong to laws that are not built.
const KEYS: &str = "cell_type cells dirichlet extra_groups loads_continuum material mesh name \
    nodal_load_sum nodal_loads nodes results schema cluster_lambda clusters \
    element_lambda element_quartic quadratic_mean_dilatation";

const MATERIAL_KEYS: &str = "E nu rho plane";

const RESULT_KEYS: &str = "cluster_pressure continuum discrete_vs_continuum energy final_nodal_loads \
    follower_load max_disp mean_disp_on_group min_cell_ratio mixed plain_vs_continuum \
    quadratic_mean_dilatation reaction_on_group status u";

pub(super) fn run(case: &ReferenceCase) -> Rows {
    let root = case.root();
    root.refuse_unknown(KEYS)?;
    root.get("material").refuse_unknown(MATERIAL_KEYS)?;
    let count = |key: &str| root.get(key).index().unwrap_or(0) as usize;
    let results = root.get("results");
    let mut rows = Vec::new();
    for law in results.object()?.keys() {
        let result = results.get(law);
        let mut row = ValidationRow::new(&case.name(), law, count("nodes"), count("cells"));
        let outcome = run_law(case, law, &result, Clusters::Given, &mut row);
        rows.push(row.ended(outcome));
        if root.get("clusters").is_list() && !result.get("discrete_vs_continuum").is_absent() {
            let mut row = ValidationRow::new(&case.name(), law, count("nodes"), count("cells"));
            let outcome = run_law(case, law, &result, Clusters::Own, &mut row);
            row.remark("clusters of the engine".into());
            rows.push(row.ended(outcome));
        }
        if !result.get("quadratic_mean_dilatation").is_absent() {
            let mut row = ValidationRow::new(&case.name(), law, 0, count("cells"));
            let outcome = run_quadratic(case, law, &result, &mut row);
            row.remark("ten-node tetrahedra".into());
            rows.push(row.ended(outcome));
        }
    }
    Ok(rows)
}

/// The same with ten-node tetrahedra, for which some cases have results of their own.
fn run_quadratic(
    case: &ReferenceCase,
    law: &str,
    result: &CaseEntry,
    row: &mut ValidationRow,
) -> Result<(), CaseError> {
    let mesh = mesh(case)?;
    let held = read_held(&case.root().get("dirichlet"), mesh.points.len())?;
    quadratic::run(case, law, (result, &mesh, &held), row)
}

/// Whose clusters of tetrahedra keep volumes.
#[derive(Clone, Copy, PartialEq)]
enum Clusters {
    /// Those of the case: its stored field belongs to them.
    Given,
    /// Those of the engine, which have to be as near to the continuum.
    Own,
}

/// How much farther from the continuum the engine's own clusters may be than those of a case: other clusters are another
/// discretisation.
const OWN_CLUSTERS: f64 = 1.15;

/// What stored numbers of twelve digits leave of a peak that is prescribed (%).
const ROUNDING: f64 = 1e-8;

fn run_law(
    case: &ReferenceCase,
    law: &str,
    result: &CaseEntry,
    whose: Clusters,
    row: &mut ValidationRow,
) -> Result<(), CaseError> {
    let root = case.root();
    let kind = root.get("cell_type").text()?;
    let law = CaseLaw::find(law, kind)?;
    result.refuse_unknown_results(RESULT_KEYS)?;
    let status = result.get("status").text()?;
    if status != "ok" {
        return Err(CaseError::NotRun(format!("the reference has no solution: {status}")));
    }
    let mesh = mesh(case)?;
    let cells = CaseCells::of(&mesh).filter(|cells| cells.kind() == kind);
    let cells =
        cells.ok_or_else(|| root.get("cell_type").error("the kind of cells of the mesh"))?;
    let material = root.get("material");
    let plane = plane_state(&material.get("plane"))?;
    let material = CaseMaterial::read(&material, cells.len())?;
    let points = &mesh.points;
    let clusters = match (cells, root.get("clusters")) {
        (CaseCells::Tetrahedra(_), given) if given.is_list() && whose == Clusters::Given => {
            Some(given.indices()?)
        }
        _ => None,
    };
    let body = CaseBody::new(points, cells, law, &material);
    let body = CaseBody { clusters: clusters.as_deref(), plane, ..body };
    (row.nodes, row.cells) = (points.len(), cells.len());
    let truth = result.get("u").field(points.len())?;
    let problem = StaticProblem::read(case, result, &mesh)?;
    if problem.pressure.is_some() {
        row.note = "follower pressure".into();
    }

    let clean = match result.get("min_cell_ratio").given() {
        Some(ratio) => ratio.number()? > 0.0,
        None => true,
    };
    let solution = problem.settle(case, &body, clean, row)?;

    let StaticSolution { mut simulation, body, converged, .. } = solution;
    let energy = simulation.evaluate();
    let u = simulation.displacements(body);
    let continuum = result.get("continuum").get("u").given();
    let continuum = continuum.map(|field| field.field(points.len())).transpose()?;
    if let Some(continuum) = &continuum {
        row.beside_continuum(&u, continuum, largest(continuum));
    }
    if whose == Clusters::Own {
        let stored = result.get("discrete_vs_continuum");
        let rms = stored.get("e_rms_percent").number()?;
        let mut near = row.continuum_rms_percent <= OWN_CLUSTERS * rms;
        // where displacements are prescribed the largest is one of them
        if let (Some(peak), Some(truth)) = (stored.get("peak_percent").given(), continuum) {
            let own = 100.0 * (largest(&u) / largest(&truth) - 1.0);
            row.remark(format!("peak {own:+.2} %"));
            // peaks nearer to each other than the truth is known tell nothing
            let continuum = result.get("continuum");
            let mut known = f64::INFINITY;
            for name in ["change_from_previous_level", "difference_to_quadratic_mean_dilatation"] {
                if let Some(share) = continuum.get(name).given().and_then(|x| x.number().ok()) {
                    known = known.min(100.0 * share);
                }
            }
            let known = if known.is_finite() { known } else { 0.0 };
            let allowed = known.max(OWN_CLUSTERS * peak.number()?.abs());
            near &= own.abs() <= allowed + ROUNDING;
        }
        if converged && near {
            row.status = Status::Pass;
        }
        return Ok(());
    }
    (row.max_difference, row.rms_difference) = difference(&u, &truth, largest(&truth));
    let expected = result.get("energy").number()?;
    row.energy_difference = (energy - expected).abs() / expected.abs();
    let elastic = simulation.elastic_forces(body);
    let external = simulation.external_forces(body);
    let groups = problem.reactions(case, result, &mesh, &elastic, &external)?;
    row.reaction_difference = reaction_difference(&groups, largest(&elastic));
    let tolerance = case.options.tolerance.unwrap_or(STATIC_TOLERANCE);
    let energy_tolerance = tolerance.max(1e-12);
    if converged
        && row.max_difference <= tolerance
        && row.energy_difference <= energy_tolerance
        && (row.reaction_difference.is_nan() || row.reaction_difference <= tolerance)
    {
        row.status = Status::Pass;
    }
    Ok(())
}

/// Largest difference of a group's reaction over the largest reaction of all groups; NaN without groups.
fn reaction_difference(groups: &[[DVec3; 2]], largest_force: f64) -> f64 {
    let largest_off = groups.iter().map(|[a, b]| a.distance(*b)).fold(0.0, f64::max);
    // a body whose reactions cancel within every group is measured by its nodal forces instead
    let scale = groups.iter().map(|[_, b]| b.length()).fold(largest_force, f64::max);
    if !groups.is_empty() && scale > 0.0 { largest_off / scale } else { f64::NAN }
}
