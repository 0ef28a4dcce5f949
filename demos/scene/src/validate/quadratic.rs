//! Ten-node tetrahedra on the mesh of a static case, each keeping its mean volume: `quadratic_mean_dilatation` of a result.

use super::body::{CaseBody, CaseCells, CaseLaw, CaseMaterial};
use super::compare::{difference, largest};
use super::problem::{Held, StaticProblem};
use super::read::{CaseEntry, ReferenceCase};
use super::{CaseError, Status, ValidationRow};
use glam::DVec3;
use sinew::engine::isoparametric::MIDDLES;
use sinew::engine::mesh::{Group, Mesh};
use std::collections::{BTreeMap, HashMap};

/// Relative difference of displacements and of energy at which a case passes: what the references were solved to.
const TOLERANCES: [f64; 2] = [1e-8, 2e-8];

/// A mesh of second order made from the one of the case.
struct SecondOrder<'a> {
    linear: &'a Mesh,
    mesh: Mesh,
    /// Vertex in the middle of an edge, the lower end first.
    middles: HashMap<[u32; 2], u32>,
}

impl<'a> SecondOrder<'a> {
    fn new(linear: &'a Mesh) -> Self {
        let mesh = linear.with_second_order();
        let mut middles = HashMap::new();
        for (t, of_edges) in mesh.tetrahedra.iter().zip(&mesh.middles) {
            for ([a, b], &middle) in MIDDLES.map(|[a, b]| [t[a], t[b]]).into_iter().zip(of_edges) {
                middles.insert([a.min(b), a.max(b)], middle);
            }
        }
        Self { linear, mesh, middles }
    }

    /// Corners of the faces of a group, with the vertices in the middles of their edges.
    fn faces(&self, group: &Group) -> Vec<([u32; 3], [u32; 3])> {
        let middle = |a: u32, b: u32| self.middles.get(&[a.min(b), a.max(b)]).copied();
        let face = |&t: &u32| {
            let [a, b, c] = *self.linear.triangles.get(t as usize)?;
            Some(([a, b, c], [middle(a, b)?, middle(b, c)?, middle(c, a)?]))
        };
        group.cells.triangles.iter().filter_map(face).collect()
    }

    /// Prescribed displacements: those of the case, and in the middles of the edges of faces of a group that is held as a
    /// whole, along the same axes, the means of the ends.
    fn held(&self, corners: &Held) -> Held {
        let mut held = corners.clone();
        for group in self.linear.groups.iter().filter(|group| group.dimension == 2) {
            let axes = |v: &u32| corners.get(v).map_or(0, |own| own.0);
            let whole = group.vertices.iter().map(axes).fold(7, |all, own| all & own);
            if whole == 0 {
                continue;
            }
            for ([a, b, c], middles) in self.faces(group) {
                for ([from, to], middle) in [[a, b], [b, c], [c, a]].into_iter().zip(middles) {
                    let mean = 0.5 * (corners[&from].1 + corners[&to].1);
                    let own = held.entry(middle).or_default();
                    own.0 |= whole;
                    for axis in (0..3).filter(|axis| whole >> axis & 1 == 1) {
                        own.1[axis] = mean[axis];
                    }
                }
            }
        }
        held
    }

    /// Loads (N) that the shape functions make of those of the continuum.
    fn loads(&self, root: &CaseEntry) -> Result<Vec<(u32, DVec3)>, CaseError> {
        let mut sums: BTreeMap<u32, DVec3> = BTreeMap::new();
        let Some(loads) = root.get("loads_continuum").given() else { return Ok(Vec::new()) };
        for load in loads.list()? {
            match load.at(0).text()? {
                "body" => {
                    let density = load.at(1).vector()?;
                    for i in 0..self.mesh.tetrahedra.len() {
                        let whole = self.mesh.tetrahedron_volume(i).unwrap_or(0.0) * density;
                        for (a, v) in self.mesh.second_order(i).into_iter().flatten().enumerate() {
                            let share = if a < 4 { -0.05 } else { 0.2 };
                            *sums.entry(v).or_default() += share * whole;
                        }
                    }
                }
                "traction" => {
                    let name = load.at(1);
                    let group = self.linear.group_of_dimension(name.text()?, 2);
                    let group = group.ok_or_else(|| name.error("a group of faces of the mesh"))?;
                    let traction = load.at(2).vector()?;
                    for (corners, middles) in self.faces(group) {
                        let [a, b, c] = corners.map(|v| self.linear.points[v as usize]);
                        let area = 0.5 * (b - a).cross(c - a).length();
                        for v in middles {
                            *sums.entry(v).or_default() += area / 3.0 * traction;
                        }
                    }
                }
                "prescribed" => {}
                other => {
                    let why = format!("loads `{other}` on ten-node tetrahedra are not built");
                    return Err(CaseError::NotRun(why));
                }
            }
        }
        Ok(sums.into_iter().collect())
    }
}

/// Solves with ten-node tetrahedra and compares at the vertices of the case's mesh.
pub(super) fn run(
    case: &ReferenceCase,
    law: &str,
    (result, linear, corners): (&CaseEntry, &Mesh, &Held),
    row: &mut ValidationRow,
) -> Result<(), CaseError> {
    let truth = result.get("quadratic_mean_dilatation");
    let quadratic = SecondOrder::new(linear);
    let mesh = &quadratic.mesh;
    let root = case.root();
    let cells = CaseCells::Tetrahedra10(&mesh.tetrahedra, &mesh.middles);
    let law = CaseLaw::find(law, cells.kind())?;
    let material = CaseMaterial::read(&root.get("material"), cells.len())?;
    (row.nodes, row.cells) = (mesh.points.len(), cells.len());
    let nodes = truth.get("nodes");
    if nodes.index()? as usize != row.nodes {
        return Err(nodes.error(format!("{} nodes, as the mesh of second order has", row.nodes)));
    }
    let body = CaseBody::new(&mesh.points, cells, law, &material);
    let problem = StaticProblem {
        held: quadratic.held(corners),
        loads: quadratic.loads(&root)?,
        pressure: None,
        start: None,
    };
    let mut solution = problem.settle(case, &body, true, row)?;
    let energy = solution.simulation.evaluate();
    let mut u = solution.simulation.displacements(solution.body);
    u.truncate(linear.points.len());
    let expected = truth.get("u_vertices").field(u.len())?;
    (row.max_difference, row.rms_difference) = difference(&u, &expected, largest(&expected));
    let expected = truth.get("energy").number()?;
    row.energy_difference = (energy - expected).abs() / expected.abs();
    if let Some(continuum) = result.get("continuum").get("u").given() {
        let continuum = continuum.field(u.len())?;
        row.beside_continuum(&u, &continuum, largest(&continuum));
    }
    let [tolerance, energy_tolerance] = case.options.tolerance.map_or(TOLERANCES, |own| [own; 2]);
    if solution.converged
        && row.max_difference <= tolerance
        && row.energy_difference <= energy_tolerance
    {
        row.status = Status::Pass;
    }
    Ok(())
}
