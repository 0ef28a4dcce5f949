//! Springs that a file gives to a body: what `sinew fit --out` writes, read back by the key `springs` of a scene.

use crate::error::SceneError;
use crate::scene::Key;
use serde::{Deserialize, Serialize};
use sinew::engine::connectivity::ElementKind;
use sinew::engine::mesh::Mesh;
use sinew::identify::cells::Cells;
use sinew::identify::mass::MassLumping;
use sinew::identify::mesh::mesh_masses;
use sinew::identify::{ElementKind as IdentifyKind, Section};
use sinew::models::body::MassRule;
use sinew::models::body::lumped::GivenSprings;
use std::collections::BTreeMap;
use std::path::Path;

/// Version of the files.
pub const SCHEMA: &str = "sinew-body/1";

/// Distance, over the distance of the vertices, that a rest length may be off.
const SAME_LENGTH: f64 = 1e-6;
/// Distance, over the largest, up to which sums of constants and masses are those of the file.
const SAME: f64 = 1e-9;
/// Masses may come from another program with fewer digits.
const SAME_MASS: f64 = 1e-6;
/// Largest constant (N/m): no material of a body that can be seen has more.
const STIFFEST: f64 = 1e15;

/// A spring of a body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodySpring {
    /// Vertices of the mesh, the lower first.
    pub nodes: [u32; 2],
    /// Constant (N/m), summed over the elements round the pair.
    pub constant: f64,
    /// Rest length (m).
    pub rest_length: f64,
}

/// Constants (N/m) of every element of the mesh, in the order of the file; pairs of local nodes in
/// lexicographic order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ElementConstants {
    /// 3 for each triangle.
    pub triangles: Vec<Vec<f64>>,
    /// 6 for each quadrilateral.
    pub quads: Vec<Vec<f64>>,
    /// 6 for each tetrahedron.
    pub tetrahedra: Vec<Vec<f64>>,
    /// 28 for each hexahedron.
    pub hexahedra: Vec<Vec<f64>>,
}

impl ElementConstants {
    /// The list of a kind.
    pub fn list(&mut self, kind: IdentifyKind) -> &mut Vec<Vec<f64>> {
        match kind {
            IdentifyKind::Triangle => &mut self.triangles,
            IdentifyKind::Quad => &mut self.quads,
            IdentifyKind::Tetrahedron => &mut self.tetrahedra,
            IdentifyKind::Hexahedron => &mut self.hexahedra,
        }
    }

    /// Lists by the name of their kind in files.
    pub fn kinds(&self) -> [(&'static str, &Vec<Vec<f64>>); 4] {
        [
            ("triangle", &self.triangles),
            ("quad", &self.quads),
            ("tetrahedron", &self.tetrahedra),
            ("hexahedron", &self.hexahedra),
        ]
    }

    /// Constants of an element, where they are as many as its pairs.
    fn of(&self, kind: ElementKind, element: usize, pairs: usize) -> Option<&[f64]> {
        let list = match kind {
            ElementKind::Triangle => &self.triangles,
            ElementKind::Quad => &self.quads,
            ElementKind::Tetrahedron => &self.tetrahedra,
            ElementKind::Hexahedron => &self.hexahedra,
        };
        list.get(element).map(Vec::as_slice).filter(|own| own.len() == pairs)
    }
}

/// What a scene needs of a file; more is written for people and other programs.
#[derive(Deserialize)]
struct SpringFile {
    schema: String,
    springs: Vec<BodySpring>,
    #[serde(default)]
    masses: Vec<f64>,
    #[serde(default)]
    mass_lumping: MassLumping,
    #[serde(default)]
    element_constants: ElementConstants,
}

/// Springs of a body.
pub(crate) struct Springs {
    /// Constants of every element.
    pub constants: GivenSprings,
    /// How masses are shared out, where the file has any.
    pub masses: Option<MassRule>,
}

/// What masses are compared with.
pub(crate) struct Matter {
    /// Density (kg/m^3), the same everywhere; `None` where elements have their own.
    pub density: Option<f64>,
    /// Thickness (m) of triangles and quadrilaterals.
    pub thickness: f64,
}

/// A file of springs, and what is said of it.
struct SpringsReader<'a> {
    key: &'a Key<'a>,
    name: String,
    mesh: &'a Mesh,
}

/// Reads the springs of a body from a file named relative to the scene; `mesh` is its mesh in place.
///
/// # Errors
/// [`SceneError::Value`] at `key`, naming file and spring or vertex and what to do.
pub(crate) fn read(
    key: &Key,
    path: &Path,
    mesh: &Mesh,
    matter: &Matter,
) -> Result<Springs, SceneError> {
    let full = key.loaded.resolve(path);
    let reader = SpringsReader { key, name: full.display().to_string(), mesh };
    let again = "write it with `sinew fit MESH --out FILE.json`";
    let bytes = key.loaded.read_bytes(path).map_err(|e| reader.fault(e.to_string(), again))?;
    let file: SpringFile =
        serde_json::from_slice(&bytes).map_err(|e| reader.fault(e.to_string(), again))?;
    if file.schema != SCHEMA {
        return Err(reader.fault(format!("schema `{}` is not `{SCHEMA}`", file.schema), again));
    }
    let constants = reader.constants(&file)?;
    reader.check_masses(&file, matter)?;
    let lumping = (!file.masses.is_empty()).then_some(file.mass_lumping);
    Ok(Springs { constants, masses: lumping.map(MassRule::from) })
}

/// Pairs of the vertices of an element in lexicographic order of their places.
fn pairs(nodes: &[u32]) -> impl Iterator<Item = [u32; 2]> {
    nodes
        .iter()
        .enumerate()
        .flat_map(move |(i, &a)| nodes[i + 1..].iter().map(move |&b| [a.min(b), a.max(b)]))
}

impl SpringsReader<'_> {
    fn fault(&self, found: impl std::fmt::Display, remedy: &str) -> SceneError {
        self.key.value(format!("{}: {found}", self.name), remedy)
    }

    /// The elements that springs may join the vertices of, by kind and index.
    fn elements(&self) -> impl Iterator<Item = (ElementKind, usize, &[u32])> {
        fn of<const N: usize>(
            kind: ElementKind,
            list: &[[u32; N]],
        ) -> impl Iterator<Item = (ElementKind, usize, &[u32])> {
            list.iter().enumerate().map(move |(i, e)| (kind, i, e.as_slice()))
        }
        let mesh = self.mesh;
        of(ElementKind::Tetrahedron, &mesh.tetrahedra)
            .chain(of(ElementKind::Hexahedron, &mesh.hexahedra))
            .chain(of(ElementKind::Triangle, &mesh.triangles))
            .chain(of(ElementKind::Quad, &mesh.quads))
            .filter(|e| {
                // the faces of a solid are no elements
                let solid = matches!(e.0, ElementKind::Tetrahedron | ElementKind::Hexahedron);
                solid == self.mesh.is_solid()
            })
    }

    /// The springs of the file by pair, checked one by one.
    fn by_pair(&self, file: &SpringFile) -> Result<BTreeMap<[u32; 2], f64>, SceneError> {
        let points = &self.mesh.points;
        let mut sums = BTreeMap::new();
        let other = "the file is of another mesh: fit that of the body again";
        for (i, s) in file.springs.iter().enumerate() {
            let [a, b] = s.nodes;
            let of = format!("spring {i} (from 0)");
            if a == b || [a, b].iter().any(|&v| v as usize >= points.len()) {
                let found = format!("{of} joins vertices {a} and {b} of {}", points.len());
                return Err(self.fault(found, other));
            }
            if s.constant.is_nan() || s.constant.abs() > STIFFEST {
                let found = format!("{of} has the constant {:e} N/m", s.constant);
                return Err(self.fault(found, "give a finite constant; 1e15 N/m is the most"));
            }
            let distance = points[a as usize].distance(points[b as usize]);
            let off = (s.rest_length - distance).abs();
            if off.is_nan() || off > SAME_LENGTH * distance {
                let found = format!(
                    "{of} is {} m long at rest, its vertices {a} and {b} are {distance} m apart",
                    s.rest_length
                );
                let remedy = "fit the mesh with the scale that the scene gives it; springs of a scene have no \
                              tension at rest";
                return Err(self.fault(found, remedy));
            }
            if sums.insert([a.min(b), a.max(b)], s.constant).is_some() {
                let found = format!("{of} joins vertices {a} and {b} a second time");
                return Err(self.fault(found, "add the constants up to one spring"));
            }
        }
        Ok(sums)
    }

    /// Constants of every element: those of the file where they add up to its springs, else equal parts of these.
    fn constants(&self, file: &SpringFile) -> Result<GivenSprings, SceneError> {
        let springs = self.by_pair(file)?;
        let mut round: BTreeMap<[u32; 2], (f64, f64)> = BTreeMap::new();
        for (kind, element, nodes) in self.elements() {
            let count = nodes.len() * (nodes.len() - 1) / 2;
            let own = file.element_constants.of(kind, element, count);
            for (i, pair) in pairs(nodes).enumerate() {
                let entry = round.entry(pair).or_default();
                entry.0 += 1.0;
                entry.1 += own.map_or(f64::NAN, |own| own[i]);
            }
        }
        if let Some(i) = file.springs.iter().position(|s| {
            let [a, b] = s.nodes;
            !round.contains_key(&[a.min(b), a.max(b)])
        }) {
            let [a, b] = file.springs[i].nodes;
            let found =
                format!("spring {i} (from 0) joins vertices {a} and {b}, which share no element");
            return Err(self.fault(found, "springs join vertices of one element; leave it out"));
        }
        let constant = |pair: &[u32; 2]| springs.get(pair).copied().unwrap_or(0.0);
        let largest = springs.values().fold(0.0, |m: f64, k| m.max(k.abs()));
        let consistent =
            round.iter().all(|(pair, (_, sum))| (sum - constant(pair)).abs() <= SAME * largest);
        let mut given = GivenSprings::default();
        for (kind, element, nodes) in self.elements() {
            let count = nodes.len() * (nodes.len() - 1) / 2;
            match file.element_constants.of(kind, element, count).filter(|_| consistent) {
                Some(own) => given.add(kind, nodes, own),
                None => {
                    let parts: Vec<f64> =
                        pairs(nodes).map(|pair| constant(&pair) / round[&pair].0).collect();
                    given.add(kind, nodes, &parts);
                }
            }
        }
        Ok(given)
    }

    /// Masses of the file must be those that the scene gives the body.
    fn check_masses(&self, file: &SpringFile, matter: &Matter) -> Result<(), SceneError> {
        if file.masses.is_empty() {
            return Ok(());
        }
        let remedy =
            "give the body the density that was fitted with, or take `masses` out of the file";
        let (mesh, count) = (self.mesh, self.mesh.points.len());
        if file.masses.len() != count {
            let found = format!("there are {} masses for {count} vertices", file.masses.len());
            return Err(self.fault(found, "fit the mesh of the body again"));
        }
        let Some(density) = matter.density else {
            return Err(self.fault("there are masses, and the scene has a density field", remedy));
        };
        let solid = mesh.is_solid();
        let cells = Cells {
            triangles: if solid { &[] } else { &mesh.triangles },
            quads: if solid { &[] } else { &mesh.quads },
            tetrahedra: &mesh.tetrahedra,
            hexahedra: &mesh.hexahedra,
        };
        let points: Vec<[f64; 3]> = mesh.points.iter().map(|p| p.to_array()).collect();
        let section = Section { thickness: matter.thickness, ..Section::default() };
        let own = mesh_masses(&points, &cells, density, &section, file.mass_lumping)
            .map_err(|e| self.fault(e, "fit the mesh of the body again"))?;
        let largest = own.iter().copied().fold(0.0, f64::max);
        let off =
            |(a, b): (&f64, &f64)| (a - b).abs().is_nan() || (a - b).abs() > SAME_MASS * largest;
        match own.iter().zip(&file.masses).position(off) {
            Some(v) => {
                let (given, own) = (file.masses[v], own[v]);
                let found = format!(
                    "vertex {v} (from 0) has {given} kg; with {density} kg/m^3 it has {own} kg"
                );
                Err(self.fault(found, remedy))
            }
            None => Ok(()),
        }
    }
}
