//! A mesh in a testing machine: which nodes are held, which are loaded, and the loadings of the
//! virtual tests.

use super::{FitError, Result};
use glam::DVec3;
use sinew::engine::mesh::Mesh;
use sinew_identify::cells::Cells;
use sinew_identify::virtual_test::facets::{facets_within, nodes_at, traction_forces};
use sinew_identify::virtual_test::gauge::{MeasuredModuli, displacement_gradient, tensile_moduli};
use sinew_identify::virtual_test::{Loading, dimension};
use sinew_identify::{IdentifyError, LinearMaterial, Section};

/// Part of the length at each end that is gripped where the end is no flat face.
const GRIP: f64 = 0.05;
/// Distance from a common plane, over the length of the body, up to which an end counts as flat.
const FLAT: f64 = 1e-6;
/// Part of the length, round the middle, over which strain is measured.
const GAUGE: f64 = 0.5;

/// How a load is brought onto the loaded end (paper B does not say which it used).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// Consistent nodal forces of a constant traction.
    Traction,
    /// The same force on every node.
    EqualForces,
}

/// A virtual test of a body with one end held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Test {
    /// One end held, the other pulled along the axis.
    Tension,
    /// One end held, the other pushed across the axis and kept from tilting.
    Shear,
    /// One end held, the other twisted about the axis.
    Torsion,
    /// One end held, the other bent by a couple.
    Bending,
}

impl Test {
    /// All, in the order of reports.
    pub const ALL: [Self; 4] = [Self::Tension, Self::Shear, Self::Torsion, Self::Bending];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tension => "tension",
            Self::Shear => "shear",
            Self::Torsion => "torsion",
            Self::Bending => "bending",
        }
    }

    /// Whether a body of `dimension` axes can be tested so.
    pub fn serves(self, dimension: usize) -> bool {
        self != Self::Torsion || dimension == 3
    }
}

/// Which ends are gripped.
#[derive(Clone, Debug, Default)]
pub struct Grips {
    /// Axis of the test (0, 1 or 2) instead of that from the held to the loaded nodes, or the longest.
    pub axis: Option<usize>,
    /// Group of held nodes instead of the lower end along the axis.
    pub held: Option<String>,
    /// Group of loaded nodes instead of the upper end along the axis.
    pub loaded: Option<String>,
}

/// The elements of a mesh and the nodes they use, with both ends.
///
/// Solids are what a mesh with tetrahedra or hexahedra is tested as; its triangles and quadrilaterals
/// are then its surface.
#[derive(Clone, Debug)]
pub struct Rig {
    /// Rest positions (m) of the used nodes.
    pub points: Vec<[f64; 3]>,
    /// Index in the mesh of every used node, ascending.
    pub nodes: Vec<u32>,
    /// Section of plane elements.
    pub section: Section,
    /// Axis of the test: 0, 1 or 2.
    pub axis: usize,
    /// Held nodes, by their place in `points`.
    pub held: Vec<usize>,
    /// Loaded nodes, by their place in `points`.
    pub loaded: Vec<usize>,
    /// 2 for triangles and quadrilaterals, 3 for solids.
    pub dimension: usize,
    /// Facets of the loaded end; none where it is not flat.
    pub facets: Vec<Vec<u32>>,
    triangles: Vec<[u32; 3]>,
    quads: Vec<[u32; 4]>,
    tetrahedra: Vec<[u32; 4]>,
    hexahedra: Vec<[u32; 8]>,
}

impl Rig {
    /// The elements of a mesh over the nodes that they use; no ends yet.
    pub(super) fn without_ends(mesh: &Mesh, section: Section) -> Self {
        let solid = mesh.is_solid();
        let plane = |n: usize| if solid { 0 } else { n };
        let triangles = &mesh.triangles[..plane(mesh.triangles.len())];
        let quads = &mesh.quads[..plane(mesh.quads.len())];
        let mut used = vec![false; mesh.points.len()];
        triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
        quads.iter().flatten().for_each(|&v| used[v as usize] = true);
        mesh.tetrahedra.iter().flatten().for_each(|&v| used[v as usize] = true);
        mesh.hexahedra.iter().flatten().for_each(|&v| used[v as usize] = true);
        let nodes: Vec<u32> = (0..mesh.points.len() as u32).filter(|&v| used[v as usize]).collect();
        let mut place = vec![0; used.len()];
        nodes.iter().enumerate().for_each(|(i, &v)| place[v as usize] = i as u32);
        fn moved<const N: usize>(cells: &[[u32; N]], place: &[u32]) -> Vec<[u32; N]> {
            cells.iter().map(|c| c.map(|v| place[v as usize])).collect()
        }
        Self {
            points: nodes.iter().map(|&v| mesh.points[v as usize].to_array()).collect(),
            section,
            axis: 0,
            held: Vec::new(),
            loaded: Vec::new(),
            dimension: 3,
            facets: Vec::new(),
            triangles: moved(triangles, &place),
            quads: moved(quads, &place),
            tetrahedra: moved(&mesh.tetrahedra, &place),
            hexahedra: moved(&mesh.hexahedra, &place),
            nodes,
        }
    }

    /// Puts a checked mesh into the machine.
    ///
    /// # Errors
    /// [`FitError`] when a group is missing or its nodes are not usable, when both ends share nodes, or
    /// when a mesh of plane elements is not flat.
    pub fn new(mesh: &Mesh, section: Section, grips: &Grips) -> Result<Self> {
        let mut rig = Self::without_ends(mesh, section);
        let (points, nodes) = (&rig.points, &rig.nodes);
        if points.is_empty() {
            return Err(IdentifyError::NoElements.into());
        }
        let named = |name: &Option<String>| -> Result<Option<Vec<usize>>> {
            let Some(name) = name else { return Ok(None) };
            let group = mesh.group(name).ok_or_else(|| FitError::Group {
                mesh: mesh.source.clone(),
                group: name.clone(),
                known: mesh.groups.iter().map(|g| g.name.clone()).collect(),
            })?;
            let found: Vec<usize> =
                group.vertices.iter().filter_map(|v| nodes.binary_search(v).ok()).collect();
            if found.is_empty() {
                let (mesh, group) = (mesh.source.clone(), name.clone());
                return Err(FitError::EmptyGroup { mesh, group });
            }
            Ok(Some(found))
        };
        let (held, loaded) = (named(&grips.held)?, named(&grips.loaded)?);
        let mean = |set: &[usize]| {
            set.iter().map(|&n| DVec3::from(points[n])).sum::<DVec3>() / set.len() as f64
        };
        let span = match (&held, &loaded) {
            (Some(held), Some(loaded)) => (mean(loaded) - mean(held)).abs(),
            _ => extent(points),
        };
        let longest = if span.x >= span.y && span.x >= span.z {
            0
        } else if span.y >= span.z {
            1
        } else {
            2
        };
        let axis = grips.axis.unwrap_or(longest);
        if axis == 2 && rig.tetrahedra.is_empty() && rig.hexahedra.is_empty() {
            return Err(FitError::Axis { mesh: mesh.source.clone() });
        }
        let held = held.unwrap_or_else(|| end(points, axis, false));
        let loaded = loaded.unwrap_or_else(|| end(points, axis, true));
        if let Some(&node) = held.iter().find(|n| loaded.contains(n)) {
            return Err(FitError::SharedNode { mesh: mesh.source.clone(), node: nodes[node] });
        }
        (rig.axis, rig.held, rig.loaded) = (axis, held, loaded);
        rig.dimension = dimension(&rig.points, &rig.cells())?;
        let along: Vec<f64> = rig.loaded.iter().map(|&n| rig.points[n][axis]).collect();
        let low = along.iter().copied().fold(f64::INFINITY, f64::min);
        let high = along.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if high - low <= FLAT * extent(&rig.points).max_element() {
            rig.facets = facets_within(&rig.cells(), &rig.loaded);
        }
        Ok(rig)
    }

    /// Elements.
    pub fn cells(&self) -> Cells<'_> {
        Cells {
            triangles: &self.triangles,
            quads: &self.quads,
            tetrahedra: &self.tetrahedra,
            hexahedra: &self.hexahedra,
        }
    }

    /// Distance (m) of both ends along the axis, with the sign of the way from the held to the loaded one.
    pub fn length(&self) -> f64 {
        let mean = |set: &[usize]| {
            set.iter().map(|&n| self.points[n][self.axis]).sum::<f64>() / set.len() as f64
        };
        mean(&self.loaded) - mean(&self.held)
    }

    /// The first axis across.
    pub fn across(&self) -> usize {
        (0..self.dimension).find(|&d| d != self.axis).unwrap_or(0)
    }

    /// How much of the loaded end belongs to a node (m^2): its part of the facets, or the same for all
    /// nodes of an end that is not flat, whose area is volume over length.
    fn shares(&self) -> Vec<(usize, f64)> {
        if self.facets.is_empty() {
            let share = self.mean_section() / self.loaded.len() as f64;
            return self.loaded.iter().map(|&n| (n, share)).collect();
        }
        let unit = [1.0, 0.0, 0.0];
        let forces = traction_forces(&self.points, &self.facets, unit, self.section.thickness);
        let mut sums = vec![0.0; self.points.len()];
        forces.into_iter().for_each(|(n, f)| sums[n] += f[0]);
        self.loaded.iter().map(|&n| (n, sums[n])).collect()
    }

    /// Area (m^2) that the load acts on.
    pub fn area(&self) -> f64 {
        self.shares().iter().map(|s| s.1).sum()
    }

    /// Volume over length (m^2).
    fn mean_section(&self) -> f64 {
        let cells = self.cells();
        let measure: f64 = (0..cells.len())
            .filter_map(|e| cells.geometry(&self.points, e).ok())
            .map(|g| g.measure())
            .sum();
        let measure = if self.dimension == 2 { measure * self.section.thickness } else { measure };
        measure / self.length().abs()
    }

    /// Nodal forces (N) of the mean traction `traction` (Pa) on the loaded end.
    pub fn push(&self, traction: [f64; 3], reading: Reading) -> Vec<(usize, [f64; 3])> {
        let shares = self.shares();
        let mean = shares.iter().map(|s| s.1).sum::<f64>() / shares.len() as f64;
        let area = |own: f64| if reading == Reading::Traction { own } else { mean };
        shares.into_iter().map(|(n, own)| (n, traction.map(|t| t * area(own)))).collect()
    }

    /// One end held, the other loaded by the mean traction `traction` (Pa).
    pub fn pushed(&self, traction: [f64; 3], reading: Reading) -> Loading {
        let mut loading = Loading { forces: self.push(traction, reading), ..Loading::default() };
        loading.hold(&self.held, self.dimension, [0.0; 3]);
        loading
    }

    /// Loading of a test with stresses of about `stress` (Pa).
    pub fn loading(&self, test: Test, stress: f64) -> Loading {
        let (axis, across) = (self.axis, self.across());
        let along = stress * self.length().signum();
        let shares = self.shares();
        let total: f64 = shares.iter().map(|s| s.1).sum();
        let mut centre = [0.0; 3];
        for &(n, share) in &shares {
            for d in 0..3 {
                centre[d] += share * self.points[n][d] / total;
            }
        }
        let arm = |n: usize, d: usize| self.points[n][d] - centre[d];
        let mut unit = [0.0; 3];
        match test {
            Test::Tension => {
                unit[axis] = along;
                return self.pushed(unit, Reading::Traction);
            }
            Test::Shear => {
                unit[across] = stress;
                let mut loading = self.pushed(unit, Reading::Traction);
                loading.displacements.extend(self.loaded.iter().map(|&n| (n, axis, 0.0)));
                return loading;
            }
            Test::Torsion | Test::Bending => {}
        }
        // tractions that grow with the distance from the centre, `stress` at the farthest node
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        let twist = test == Test::Torsion;
        let distance = |n: usize| {
            if twist { arm(n, b).hypot(arm(n, c)) } else { arm(n, across).abs() }
        };
        let farthest = self.loaded.iter().map(|&n| distance(n)).fold(0.0, f64::max);
        let mut loading = self.pushed([0.0; 3], Reading::Traction);
        for ((_, force), (n, share)) in loading.forces.iter_mut().zip(shares) {
            let scale = if farthest > 0.0 { stress * share / farthest } else { 0.0 };
            if twist {
                force[b] = -scale * arm(n, c);
                force[c] = scale * arm(n, b);
            } else {
                force[axis] = scale * arm(n, across);
            }
        }
        loading
    }

    /// Free uniaxial tension by the traction `stress` (Pa): the held end slides on rollers, so that a
    /// straight homogeneous body is stretched evenly and shows its own moduli.
    pub fn free_tension(&self, stress: f64) -> Loading {
        let mut unit = [0.0; 3];
        unit[self.axis] = stress * self.length().signum();
        let mut loading =
            Loading { forces: self.push(unit, Reading::Traction), ..Loading::default() };
        loading.displacements.extend(self.held.iter().map(|&n| (n, self.axis, 0.0)));
        let others: Vec<usize> = (0..self.dimension).filter(|&d| d != self.axis).collect();
        let middle = others.iter().map(|&d| {
            self.held.iter().map(|&n| self.points[n][d]).sum::<f64>() / self.held.len() as f64
        });
        let middle: Vec<f64> = middle.collect();
        let off = |n: usize| -> f64 {
            others.iter().zip(&middle).map(|(&d, m)| (self.points[n][d] - m).powi(2)).sum()
        };
        let nearest = self.held.iter().copied().min_by(|&a, &b| off(a).total_cmp(&off(b)));
        let Some(pin) = nearest else { return loading };
        loading.displacements.extend(others.iter().map(|&d| (pin, d, 0.0)));
        if let [first, second] = others[..] {
            // no turn about the axis: the node farthest along the first axis across is held along the second
            let arm = |n: usize| (self.points[n][first] - self.points[pin][first]).abs();
            let far = self.held.iter().copied().max_by(|&a, &b| arm(a).total_cmp(&arm(b)));
            loading.displacements.extend(far.map(|n| (n, second, 0.0)));
        }
        loading
    }

    /// Nodes in the middle of the body, over half of its length.
    pub fn gauge(&self) -> Vec<usize> {
        let length = self.length();
        let start = self.held.iter().map(|&n| self.points[n][self.axis]).sum::<f64>()
            / self.held.len() as f64;
        let within = |n: &usize| {
            let part = (self.points[*n][self.axis] - start) / length;
            (part - 0.5).abs() <= 0.5 * GAUGE * (1.0 + 1e-9)
        };
        let nodes: Vec<usize> = (0..self.points.len()).filter(within).collect();
        // a mesh of one layer has no node in its middle
        let spans = displacement_gradient(&self.points, &self.points, &nodes, self.dimension);
        if spans.is_some() { nodes } else { (0..self.points.len()).collect() }
    }

    /// Moduli from the displacements of [`free_tension`](Self::free_tension) under `stress` (Pa).
    pub fn moduli(&self, displacements: &[[f64; 3]], stress: f64) -> Option<MeasuredModuli> {
        let gauge = self.gauge();
        tensile_moduli(&self.points, displacements, &gauge, self.dimension, self.axis, stress)
    }

    /// Mean displacement (m) of the loaded end along the first axis across.
    pub fn drift(&self, displacements: &[[f64; 3]]) -> f64 {
        let across = self.across();
        let sum: f64 = self.loaded.iter().map(|&n| displacements[n][across]).sum();
        sum / self.loaded.len() as f64
    }

    /// A stress (Pa) of a tenth of Young's modulus: an elongation of about 10 % in a straight body.
    pub fn stress(material: &LinearMaterial) -> f64 {
        0.1 * material.youngs_modulus
    }
}

/// Extent (m) along the axes.
fn extent(points: &[[f64; 3]]) -> DVec3 {
    let first = DVec3::from(points[0]);
    let (low, high) = points.iter().fold((first, first), |(low, high), p| {
        (low.min(DVec3::from(*p)), high.max(DVec3::from(*p)))
    });
    high - low
}

/// Nodes of an end along `axis`: its flat face if there are enough nodes on it, else all nodes within a
/// part of the length.
fn end(points: &[[f64; 3]], axis: usize, upper: bool) -> Vec<usize> {
    let along = points.iter().map(|p| p[axis]);
    let low = along.clone().fold(f64::INFINITY, f64::min);
    let high = along.fold(f64::NEG_INFINITY, f64::max);
    let (value, depth) = (if upper { high } else { low }, GRIP * (high - low));
    let face = nodes_at(points, axis, value);
    if face.len() >= 3 || (face.len() == 2 && points.iter().all(|p| p[2] == points[0][2])) {
        return face;
    }
    (0..points.len()).filter(|&n| (points[n][axis] - value).abs() <= depth).collect()
}
