//! Writes Gmsh 2.2 text.

use super::super::cells::{Column, columns};
use crate::element_kind::ElementKind;
use crate::mesh::error::MeshError;
use crate::mesh::{CellData, CellVertices, Mesh, cell};
use std::fmt::Write as _;
use std::path::Path;

/// The cells in the order in which they are listed, faces first, with their type numbers.
const KINDS: [(ElementKind, u8); 4] = [
    (ElementKind::Triangle, 2),
    (ElementKind::Quad, 3),
    (ElementKind::Tetrahedron, 4),
    (ElementKind::Hexahedron, 5),
];

/// Type of tetrahedra of second order.
const TETRAHEDRON10: u8 = 11;

/// Writes a mesh with its groups as Gmsh 2.2 text.
///
/// # Errors
///
/// [`MeshError::Io`] when the file cannot be written.
pub fn write_gmsh(path: &Path, mesh: &Mesh) -> Result<(), MeshError> {
    super::super::write_file(path, encode_gmsh(mesh).as_bytes())
}

/// The text of a mesh in the format Gmsh 2.2.
///
/// Numbers are written so that reading gives the same bits. A cell in several groups is listed once
/// for each. Vertices of a group that none of its cells has are listed as points of a node set of the
/// same name, except that a group of dimension 1 is first turned into the boundary lines between its
/// vertices. Quotation marks and control characters in names become apostrophes and spaces.
pub fn encode_gmsh(mesh: &Mesh) -> String {
    let mut elements = Elements { text: String::new(), count: 0 };
    let mut names = Vec::new();
    let mut tags_of = KINDS.map(|(cell, _)| vec![Vec::new(); mesh.count(cell)]);
    for (tag, group) in (1..).zip(&mesh.groups) {
        let mut covered: Vec<u32> = Vec::new();
        for ((cell, _), tags_of) in KINDS.into_iter().zip(&mut tags_of) {
            for &index in &group.cells[cell] {
                if let Some(tags) = tags_of.get_mut(index as usize) {
                    tags.push(tag);
                    covered.extend(vertices(mesh, cell, index as usize).iter());
                }
            }
        }
        if group.dimension == 1 {
            for [a, b] in boundary_edges(mesh) {
                let inside = |v: u32| group.vertices.binary_search(&v).is_ok();
                if inside(a) && inside(b) {
                    elements.push(1, tag, &[a, b]);
                    covered.extend([a, b]);
                }
            }
        }
        covered.sort_unstable();
        let mut alone =
            group.vertices.iter().filter(|v| covered.binary_search(v).is_err()).peekable();
        let node_set = group.dimension == 0;
        if !node_set || group.vertices.is_empty() {
            names.push((group.dimension, tag, &group.name));
        }
        if alone.peek().is_some() {
            names.push((0, tag, &group.name));
        }
        for &vertex in alone {
            elements.push(15, tag, &[vertex]);
        }
    }
    // number of each cell, for its data; one that is listed more than once has several
    let mut numbers = [const { Vec::new() }; 4];
    for (((cell, kind), tags_of), numbers) in KINDS.into_iter().zip(&tags_of).zip(&mut numbers) {
        for (index, tags) in tags_of.iter().enumerate() {
            let vertices = vertices(mesh, cell, index);
            let kind = if vertices.len() == 10 { TETRAHEDRON10 } else { kind };
            elements.push_each(kind, tags, &vertices);
            numbers.push(elements.count);
        }
    }

    let mut text = String::from("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n");
    // Writing to a string cannot fail.
    if !names.is_empty() {
        let _ = writeln!(text, "$PhysicalNames\n{}", names.len());
        for (dimension, tag, name) in names {
            let name = plain(name);
            let _ = writeln!(text, "{dimension} {tag} \"{name}\"");
        }
        text.push_str("$EndPhysicalNames\n");
    }
    let _ = writeln!(text, "$Nodes\n{}", mesh.points.len());
    for (i, p) in mesh.points.iter().enumerate() {
        let _ = writeln!(text, "{} {:?} {:?} {:?}", i + 1, p.x, p.y, p.z);
    }
    let _ = writeln!(text, "$EndNodes\n$Elements\n{}", elements.count);
    text.push_str(&elements.text);
    text.push_str("$EndElements\n");
    for column in columns(&mesh.cell_data) {
        let (name, components) = match &column {
            Column::Scalar(data) => (data.name.as_str(), vec![*data]),
            Column::Vector(name, data) => (*name, data.to_vec()),
        };
        let mut lines = String::new();
        let mut count = 0;
        for ((cell, _), numbers) in KINDS.into_iter().zip(&numbers) {
            for (index, number) in numbers.iter().enumerate() {
                let value = |data: &&CellData| data.values[cell].get(index).copied();
                let values = components.iter().map(value).map(|v| v.unwrap_or(f64::NAN));
                // What is left out reads as NaN.
                if values.clone().all(f64::is_nan) {
                    continue;
                }
                count += 1;
                let _ = write!(lines, "{number}");
                values.for_each(|value| {
                    let _ = write!(lines, " {value:?}");
                });
                lines.push('\n');
            }
        }
        let (name, n) = (plain(name), components.len());
        let _ = writeln!(text, "$ElementData\n1\n\"{name}\"\n1\n0.0\n3\n0\n{n}\n{count}");
        text.push_str(&lines);
        text.push_str("$EndElementData\n");
    }
    text
}

/// A name without quotation marks and control characters.
fn plain(name: &str) -> String {
    let shown = |c: char| match c {
        '"' => '\'',
        c if c.is_control() => ' ',
        c => c,
    };
    name.chars().map(shown).collect()
}

struct Elements {
    text: String,
    count: usize,
}

impl Elements {
    fn push(&mut self, kind: u8, tag: usize, vertices: &[u32]) {
        self.count += 1;
        let _ = write!(self.text, "{} {kind} 2 {tag} 1", self.count);
        for &vertex in vertices {
            let _ = write!(self.text, " {}", u64::from(vertex) + 1);
        }
        self.text.push('\n');
    }

    fn push_each(&mut self, kind: u8, tags: &[usize], vertices: &[u32]) {
        for &tag in if tags.is_empty() { &[0][..] } else { tags } {
            self.push(kind, tag, vertices);
        }
    }
}

/// Vertices of a cell of the mesh in the order of Gmsh; none for one that it does not have.
fn vertices(mesh: &Mesh, kind: ElementKind, index: usize) -> CellVertices {
    let mut cell = mesh.cell(kind, index).unwrap_or(CellVertices::of(&[]));
    if cell.len() == 10 {
        cell.swap(8, 9);
    }
    cell
}

/// Edges that exactly one triangle or quadrilateral has.
fn boundary_edges(mesh: &Mesh) -> Vec<[u32; 2]> {
    let n = mesh.points.len();
    let mut edges = Vec::new();
    for kind in [ElementKind::Triangle, ElementKind::Quad] {
        for cell in mesh.cells(kind).filter(|cell| cell.iter().all(|&v| (v as usize) < n)) {
            cell::edges(kind, &cell, |a, b| edges.push([a, b]));
        }
    }
    let mut boundary = Vec::new();
    crate::mesh::for_equal_cells(&edges, n, |equal| {
        if let &[(edge, _)] = equal {
            boundary.push(edge);
        }
    });
    boundary
}
