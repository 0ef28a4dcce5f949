//! Meshes from bytes, files, arrays and generators.

use crate::error::{EmbedError, InputError, Result};
use glam::DVec3;
use sinew::engine::connectivity::ByKind;
use sinew::engine::mesh::{Group, Mesh};
use sinew::touch::field::DistanceField;
use sinew_scene::assemble::generate;
use sinew_scene::error::hint;
use sinew_scene::mesh_tool::MeshInfo;
use sinew_scene::scene::{Generate, SHAPES, Selection};
use std::path::Path;
use std::sync::Arc;

/// Reads a mesh from the bytes of a file; the extension of `name` helps to tell the format.
///
/// # Errors
/// As [`Mesh::from_bytes`].
pub fn mesh_from_bytes(name: &str, bytes: &[u8]) -> Result<Mesh> {
    Ok(Mesh::from_bytes(name, bytes)?)
}

/// Reads a mesh file.
///
/// # Errors
/// As [`Mesh::read`].
pub fn mesh_from_file(path: &str) -> Result<Mesh> {
    Ok(Mesh::read(Path::new(path))?)
}

/// A mesh as flat arrays, in the [order of vertices](sinew::engine::mesh) of Gmsh and VTK.
#[derive(Clone, Copy, Debug, Default)]
pub struct MeshArrays<'a> {
    /// Three coordinates (m) a vertex.
    pub points: &'a [f64],
    /// Four vertices a tetrahedron.
    pub tetrahedra: &'a [u32],
    /// Eight vertices a hexahedron.
    pub hexahedra: &'a [u32],
    /// Three vertices a triangle.
    pub triangles: &'a [u32],
    /// Four vertices a quadrilateral.
    pub quads: &'a [u32],
    /// Names and vertices of groups.
    pub groups: &'a [(&'a str, &'a [u32])],
}

/// Makes a mesh of arrays. Groups get the cells all of whose vertices they hold.
///
/// # Errors
/// When a length does not fit, an index is beyond the points or a coordinate is not finite.
pub fn mesh_from_arrays(arrays: &MeshArrays) -> Result<Mesh> {
    let points = vectors("points", arrays.points)?;
    let count = points.len();
    let mut mesh = Mesh {
        source: "arrays".into(),
        tetrahedra: cells("tetrahedra", arrays.tetrahedra, count)?,
        hexahedra: cells("hexahedra", arrays.hexahedra, count)?,
        triangles: cells("triangles", arrays.triangles, count)?,
        quads: cells("quads", arrays.quads, count)?,
        points,
        ..Mesh::default()
    };
    for &(name, vertices) in arrays.groups {
        in_range(&format!("group `{name}`"), vertices, count)?;
        let mut held = vec![false; count];
        vertices.iter().for_each(|&v| held[v as usize] = true);
        let inside = |cell: &[u32]| cell.iter().all(|&v| held[v as usize]);
        let those = |kind| {
            let cells = (0..).zip(mesh.cells(kind));
            cells.filter(|(_, cell)| inside(cell)).map(|(i, _)| i).collect::<Vec<u32>>()
        };
        let mut vertices = vertices.to_vec();
        vertices.sort_unstable();
        vertices.dedup();
        let cells = ByKind::of(those);
        let solid = !(cells.tetrahedra.is_empty() && cells.hexahedra.is_empty());
        let faces = !(cells.triangles.is_empty() && cells.quads.is_empty());
        let dimension = if solid { 3 } else { 2 * u8::from(faces) };
        mesh.groups.push(Group { name: name.into(), dimension, vertices, cells });
    }
    Ok(mesh)
}

/// A mesh of a shape as below `generate` of a scene, such as `box = { size = [0.1, 0.1, 0.1], cells = [2, 2, 2] }`.
///
/// # Errors
/// When the text is not such a table, or a parameter is out of range.
pub fn mesh_from_generator(toml: &str) -> Result<Mesh> {
    let invalid = |problem: String| EmbedError::from(InputError::invalid("generate", problem));
    let shape: Generate =
        toml::from_str(toml).map_err(|e| invalid(e.message().replace('\n', ", ")))?;
    let names = || SHAPES.iter().map(|shape| shape.name).collect::<Vec<_>>().join(", ");
    generate(&shape)?.ok_or_else(|| invalid(format!("give one of {}", names())))
}

/// Vertices of a mesh by a table as below `select` of a scene, such as `half_space = { point = [0, 0, 0.05], normal = [0, 0, 1]
/// }`, ascending.
///
/// # Errors
/// When the text is not such a table, a place cannot be used, or no vertex is there.
pub fn mesh_select(mesh: &Mesh, toml: &str) -> Result<Vec<u32>> {
    let invalid = |problem: String| EmbedError::from(InputError::invalid("select", problem));
    let own: Selection =
        toml::from_str(toml).map_err(|e| invalid(e.message().replace('\n', ", ")))?;
    let places = own.zone().map(|(_, zone)| (zone.problem(), mesh.vertices_in(&zone)));
    let patch = own.patch.as_ref().map(|region| {
        let patch = region.patch();
        (patch.problem(), mesh.patch_vertices(&patch))
    });
    let group = own.group.as_ref().map(|name| group(mesh, name)).transpose()?;
    if let Some(list) = &own.vertices {
        in_range("vertices", list, mesh.points.len())?;
    }
    let all = own.all.filter(|all| *all).map(|_| (None, mesh.used_vertices()));
    let given = [
        places,
        patch,
        group.map(|group| (None, group.vertices.clone())),
        own.vertices.map(|list| (None, list)),
        all,
    ];
    let mut given = given.into_iter().flatten();
    let (Some((problem, mut chosen)), None) = (given.next(), given.next()) else {
        let keys = "`group`, `vertices`, `box`, `sphere`, `cylinder`, `half_space`, `patch` and `all = true`";
        return Err(invalid(format!("give exactly one of {keys}")));
    };
    if let Some(problem) = problem {
        return Err(invalid(problem.into()));
    }
    chosen.sort_unstable();
    chosen.dedup();
    if chosen.is_empty() {
        let (low, high) = mesh.bounds().unwrap_or_default();
        return Err(invalid(format!(
            "no vertex is there; {} reaches from {low} to {high} m",
            mesh.source
        )));
    }
    Ok(chosen)
}

/// Numbers that the file of a mesh keeps with its cells, for tetrahedra, then hexahedra, as materials that vary take them; in
/// a mesh without these for triangles, then quadrilaterals. NaN where there is none.
///
/// # Errors
/// When there are none of that name.
pub fn mesh_cell_data(mesh: &Mesh, name: &str) -> Result<Vec<f64>> {
    let data = mesh.data(name).ok_or_else(|| {
        let known = mesh.cell_data.iter().map(|d| d.name.as_str());
        let kind = "cell data";
        InputError::Unknown { kind, name: name.into(), hint: hint(kind, name, known) }
    })?;
    Ok(mesh.matter().into_iter().flat_map(|kind| data.values[kind].iter().copied()).collect())
}

/// What is in a mesh, as the command `sinew mesh info --json` writes it.
pub fn mesh_info_json(mesh: &Mesh) -> String {
    serde_json::to_string(&MeshInfo::of(mesh)).unwrap_or_default()
}

/// Which faces of a mesh a membrane has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MembraneCells<'a> {
    /// All triangles and quadrilaterals of the mesh.
    All,
    /// The boundary of its solid elements.
    Surface,
    /// Those of a group.
    Group(&'a str),
}

/// Triangles and quadrilaterals for a [`MembraneDescription`](crate::MembraneDescription).
///
/// # Errors
/// When there is no such group, or nothing to choose.
pub fn membrane_cells(mesh: &Mesh, which: MembraneCells) -> Result<(Vec<[u32; 3]>, Vec<[u32; 4]>)> {
    let (triangles, quads) = match which {
        MembraneCells::All => (mesh.triangles.clone(), mesh.quads.clone()),
        MembraneCells::Surface => {
            let surface = mesh.surface();
            (surface.triangles, surface.quads)
        }
        MembraneCells::Group(name) => {
            let group = group(mesh, name)?;
            (
                group.cells.triangles.iter().map(|&i| mesh.triangles[i as usize]).collect(),
                group.cells.quads.iter().map(|&i| mesh.quads[i as usize]).collect(),
            )
        }
    };
    if triangles.is_empty() && quads.is_empty() {
        let problem =
            format!("{which:?} of {} has no triangles and no quadrilaterals", mesh.source);
        return Err(InputError::invalid("membrane", problem).into());
    }
    Ok((triangles, quads))
}

/// The distance to a closed mesh, for [`Shape::Field`](crate::Shape::Field); `spacing` (m) of its grid is chosen without.
///
/// # Errors
/// When the surface is not closed, or the grid would be too fine.
pub fn distance_field(mesh: &Mesh, spacing: Option<f64>) -> Result<Arc<DistanceField>> {
    let which = if mesh.is_solid() { MembraneCells::Surface } else { MembraneCells::All };
    let (mut triangles, quads) = membrane_cells(mesh, which)?;
    triangles.extend(quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]));
    Ok(DistanceField::cached(&mesh.points, &triangles, spacing)?)
}

/// A group of a mesh.
pub fn group<'a>(mesh: &'a Mesh, name: &str) -> Result<&'a Group> {
    mesh.group(name).ok_or_else(|| {
        let known = mesh.groups.iter().map(|g| g.name.as_str());
        let kind = "group";
        InputError::Unknown { kind, name: name.into(), hint: hint(kind, name, known) }.into()
    })
}

/// Finite vectors from three numbers each.
pub(crate) fn vectors(what: &'static str, numbers: &[f64]) -> Result<Vec<DVec3>> {
    let (rows, rest) = numbers.as_chunks::<3>();
    if !rest.is_empty() {
        let expected = "three for each".into();
        return Err(InputError::Count { what, given: numbers.len(), expected }.into());
    }
    finite(what, numbers)?;
    Ok(rows.iter().map(|&row| DVec3::from_array(row)).collect())
}

/// So many finite vectors.
pub(crate) fn vectors_of(what: &'static str, numbers: &[f64], count: usize) -> Result<Vec<DVec3>> {
    if numbers.len() != 3 * count {
        let expected = format!("3 x {count}");
        return Err(InputError::Count { what, given: numbers.len(), expected }.into());
    }
    vectors(what, numbers)
}

/// Refuses numbers that are not finite.
pub(crate) fn finite(what: &'static str, numbers: &[f64]) -> Result<()> {
    match numbers.iter().position(|x| !x.is_finite()) {
        Some(index) => Err(InputError::NotFinite { what, index, value: numbers[index] }.into()),
        None => Ok(()),
    }
}

/// A finite vector.
pub(crate) fn vector(what: &'static str, numbers: [f64; 3]) -> Result<DVec3> {
    finite(what, &numbers).map(|()| DVec3::from_array(numbers))
}

/// Cells of `N` vertices from a flat list.
pub(crate) fn cells<const N: usize>(
    what: &'static str,
    list: &[u32],
    points: usize,
) -> Result<Vec<[u32; N]>> {
    let (cells, rest) = list.as_chunks::<N>();
    if !rest.is_empty() {
        let expected = format!("{N} for each");
        return Err(InputError::Count { what, given: list.len(), expected }.into());
    }
    in_range(what, list, points)?;
    Ok(cells.to_vec())
}

/// Refuses indices beyond the points.
pub(crate) fn in_range(what: &str, list: &[u32], count: usize) -> Result<()> {
    match list.iter().position(|&v| v as usize >= count) {
        Some(place) => {
            let (what, index, of) = (what.into(), list[place], "vertices");
            Err(InputError::Index { what, index, place, count, of }.into())
        }
        None => Ok(()),
    }
}
