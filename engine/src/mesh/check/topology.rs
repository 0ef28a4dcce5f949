//! How cells hang together: repeated cells, faces and edges of too many cells, parts.

use super::{
    FindingCode, Findings, MeshStatistics, Severity, Sound, Tally, cell_name, kind_name,
    vertex_list,
};
use crate::element_kind::ElementKind;
use crate::mesh::cell::hexahedron_faces;
use crate::mesh::{Mesh, Surface, for_equal_cells};
use crate::sets::DisjointSets;
use std::collections::HashSet;

pub(super) fn duplicate_cells(mesh: &Mesh, cells: &Sound, found: &mut Findings) {
    fn repeats<'a, const N: usize>(
        mesh: &Mesh,
        cells: impl Iterator<Item = (usize, &'a [u32; N])>,
        kind: ElementKind,
    ) -> Tally {
        let (at, list): (Vec<usize>, Vec<[u32; N]>) = cells.map(|(i, cell)| (i, *cell)).unzip();
        let mut tally = Tally::default();
        for_equal_cells(&list, mesh.points.len(), |equal| {
            if let [first, others @ ..] = equal {
                for other in others {
                    tally.add(|| {
                        let (kind, list) = (kind_name(kind), vertex_list(&other.0));
                        let [first, other] = [first, other].map(|cell| at[cell.1 as usize]);
                        format!("{kind} {other} (vertices {list}) repeats {kind} {first}")
                    });
                }
            }
        });
        tally
    }
    // Beside volumes, faces only mark the surface, and a repeated one does no harm.
    let faces = if mesh.is_solid() { Severity::Warning } else { Severity::Error };
    for (severity, tally) in [
        (Severity::Error, repeats(mesh, cells.tetrahedra(mesh), ElementKind::Tetrahedron)),
        (Severity::Error, repeats(mesh, cells.hexahedra(mesh), ElementKind::Hexahedron)),
        (faces, repeats(mesh, cells.triangles(mesh), ElementKind::Triangle)),
        (faces, repeats(mesh, cells.quads(mesh), ElementKind::Quad)),
    ] {
        found.push(
            FindingCode::DuplicateCell,
            severity,
            tally,
            |count| format!("{count} cells have the same vertices as another one"),
            "remove the repeated cells",
        );
    }
}

/// A face in a message, which has no number of its own.
fn face_name(vertices: &[u32]) -> String {
    format!("face (vertices {})", vertex_list(vertices))
}

pub(super) fn manifold(mesh: &Mesh, cells: &Sound, found: &mut Findings) {
    let surface = if mesh.is_solid() {
        let tets: Vec<usize> = cells.tetrahedra(mesh).map(|(i, _)| i).collect();
        let hexes: Vec<[u32; 8]> = cells.hexahedra(mesh).map(|(_, &cell)| cell).collect();
        let faces = mesh.faces(&tets, &hexes);
        let mut tally = Tally::default();
        faces.crowded_triangles.iter().for_each(|face| tally.add(|| face_name(face)));
        faces.crowded_quads.iter().for_each(|face| tally.add(|| face_name(face)));
        found.push(
            FindingCode::NonManifoldFace,
            Severity::Error,
            tally,
            |count| format!("{count} faces belong to more than two cells"),
            "remove the cells that overlap others",
        );
        let mut tally = Tally::default();
        faces.mixed.iter().for_each(|face| tally.add(|| face_name(face)));
        found.push(
            FindingCode::NonConformingFace,
            Severity::Warning,
            tally,
            |count| {
                format!(
                    "{count} quadrilateral faces of hexahedra lie against triangles of tetrahedra"
                )
            },
            "the two sides part a little between the vertices there; split the hexahedra into \
             tetrahedra where accuracy matters",
        );
        // what is left of a mesh with errors is no body
        if found.0.iter().all(|f| f.severity != Severity::Error) {
            one_across(mesh, cells, &faces.boundary.quads, found);
        }
        faces.boundary
    } else {
        Surface {
            triangles: cells.triangles(mesh).map(|(_, &cell)| cell).collect(),
            quads: cells.quads(mesh).map(|(_, &cell)| cell).collect(),
        }
    };
    let triangles = surface.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let quads = surface.quads.iter().flat_map(|&[a, b, c, d]| [[a, b], [b, c], [c, d], [d, a]]);
    let edges: Vec<[u32; 2]> = triangles.chain(quads).collect();
    let mut tally = Tally::default();
    for_equal_cells(&edges, mesh.points.len(), |equal| {
        if let [([a, b], _), _, _, ..] = equal {
            tally.add(|| format!("edge (vertices {a} {b})"));
        }
    });
    found.push(
        FindingCode::NonManifoldEdge,
        Severity::Warning,
        tally,
        |count| format!("{count} edges of the surface belong to more than two of its faces"),
        "parts that meet only along an edge turn about it like a hinge; join them by a face if they should not",
    );
}

/// Places of opposite sides among the faces of a hexahedron.
const OPPOSITE: [[usize; 2]; 3] = [[0, 1], [2, 4], [3, 5]];

/// Hexahedra that reach from one side of a body to the other: no hexahedron of eight vertices bends as the continuum there.
fn one_across(mesh: &Mesh, cells: &Sound, boundary: &[[u32; 4]], found: &mut Findings) {
    let sorted = |mut face: [u32; 4]| {
        face.sort_unstable();
        face
    };
    let outside: HashSet<[u32; 4]> = boundary.iter().copied().map(sorted).collect();
    let (mut tally, mut all) = (Tally::default(), 0);
    for (i, cell) in cells.hexahedra(mesh) {
        all += 1;
        let faces = hexahedron_faces(*cell).map(|face| outside.contains(&sorted(face)));
        if OPPOSITE.iter().any(|[a, b]| faces[*a] && faces[*b]) {
            tally.add(|| cell_name(mesh, ElementKind::Hexahedron, i, cell));
        }
    }
    // steps of a lattice jut out here and there
    if all < 2 || 10 * tally.count < all {
        return;
    }
    found.push(
        FindingCode::OneCellAcross,
        Severity::Info,
        tally,
        |count| {
            format!(
                "{count} of {all} hexahedra reach from one side of the body to the other, where it bends too little (full \
                 integration) or by up to a fifth too much (reduced)"
            )
        },
        "two hexahedra across are enough with reduced integration",
    );
}

pub(super) fn components(
    mesh: &Mesh,
    cells: &Sound,
    used: &[u32],
    statistics: &mut MeshStatistics,
    found: &mut Findings,
) {
    let mut sets = DisjointSets::new(mesh.points.len());
    cells.for_edges(mesh, |i, j| {
        sets.join(i, j);
    });
    let mut tally = Tally::default();
    for &v in used {
        if sets.root(v) == v {
            tally.add(|| format!("part of vertex {v}"));
        }
    }
    statistics.components = tally.count;
    if tally.count > 1 {
        found.push(
            FindingCode::SeveralComponents,
            Severity::Warning,
            tally,
            |count| format!("the mesh falls into {count} parts that share no vertex"),
            "merge vertices at the seams unless the parts should move freely",
        );
    }
}
