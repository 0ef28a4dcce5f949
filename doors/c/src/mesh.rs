//! Meshes.

use super::call::{fill, free, give, guarded, invalid, null, read, slice, text, times};
use super::simulation::fill_text;
use super::types::*;
use sinew_embed::{
    Mesh, MeshArrays, Result, group, mesh_cell_data, mesh_from_arrays, mesh_from_bytes,
    mesh_from_file, mesh_info_json, mesh_select,
};
use std::ffi::c_char;

/// A mesh; it never changes, and any number of threads may use it at once.
pub struct sinew_mesh(pub(super) Mesh);

/// Reads a mesh file (Gmsh, VTK, TetGen, OBJ, STL).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_mesh_from_file(
    path: *const c_char,
    out: *mut *mut sinew_mesh,
) -> sinew_status {
    guarded(|| give(out, || Ok(sinew_mesh(mesh_from_file(text("path", path)?)?))))
}

/// Reads a mesh from the bytes of a file; the extension of `name` helps to tell the format.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_mesh_from_bytes(
    name: *const c_char,
    bytes: *const u8,
    size: usize,
    out: *mut *mut sinew_mesh,
) -> sinew_status {
    let make = || mesh_from_bytes(text("name", name)?, slice("bytes", bytes, size)?);
    guarded(|| give(out, || Ok(sinew_mesh(make()?))))
}

/// Makes a mesh of arrays, which are copied.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_mesh_from_arrays(
    arrays: *const sinew_mesh_arrays,
    out: *mut *mut sinew_mesh,
) -> sinew_status {
    let make = || {
        let a = read("arrays", arrays)?;
        let cells = |what: &str, data: *const u32, count: usize, each: usize| {
            slice(what, data, times(what, count, each)?)
        };
        let listed = slice("groups", a.groups, a.group_count)?;
        let mut groups = Vec::new();
        for group in listed {
            let name = text("name of a group", group.name)?;
            groups
                .push((name, cells("vertices of a group", group.vertices, group.vertex_count, 1)?));
        }
        mesh_from_arrays(&MeshArrays {
            points: slice("points", a.points, times("points", a.point_count, 3)?)?,
            tetrahedra: cells("tetrahedra", a.tetrahedra, a.tetrahedron_count, 4)?,
            hexahedra: cells("hexahedra", a.hexahedra, a.hexahedron_count, 8)?,
            triangles: cells("triangles", a.triangles, a.triangle_count, 3)?,
            quads: cells("quads", a.quads, a.quad_count, 4)?,
            groups: &groups,
        })
    };
    guarded(|| give(out, || Ok(sinew_mesh(make()?))))
}

/// Runs a call on a mesh.
unsafe fn with_mesh(
    mesh: *const sinew_mesh,
    call: impl FnOnce(&Mesh) -> Result<()>,
) -> sinew_status {
    guarded(|| match mesh.as_ref() {
        Some(own) => call(&own.0),
        None => Err(null("mesh")),
    })
}

/// What is in a mesh as JSON: counts, extent, groups, cell data with their smallest and largest numbers, as `sinew mesh info
/// --json` writes it. As `sinew_report_json`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_mesh_info_json(
    mesh: *const sinew_mesh,
    out: *mut c_char,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with_mesh(mesh, |mesh| fill_text(mesh_info_json(mesh), out, capacity, needed))
}

/// Points (m) of a mesh, three numbers each.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_mesh_points(
    mesh: *const sinew_mesh,
    xyz: *mut f64,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with_mesh(mesh, |mesh| {
        let all: Vec<f64> = mesh.points.iter().flat_map(|p| p.to_array()).collect();
        fill(&all, xyz, capacity, needed)
    })
}

/// Vertices of the cells of a kind (`SINEW_TETRAHEDRA` and so on): four, eight, three or four each. Of tetrahedra with ten nodes
/// the corners.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_mesh_cells(
    mesh: *const sinew_mesh,
    kind: u32,
    vertices: *mut u32,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with_mesh(mesh, |mesh| {
        let all = match kind {
            SINEW_TETRAHEDRA => mesh.tetrahedra.as_flattened(),
            SINEW_HEXAHEDRA => mesh.hexahedra.as_flattened(),
            SINEW_TRIANGLES => mesh.triangles.as_flattened(),
            SINEW_QUADS => mesh.quads.as_flattened(),
            _ => return Err(invalid("kind", format!("{kind} is none"))),
        };
        fill(all, vertices, capacity, needed)
    })
}

/// Vertices of a group of a mesh.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_mesh_group(
    mesh: *const sinew_mesh,
    name: *const c_char,
    vertices: *mut u32,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with_mesh(mesh, |mesh| {
        fill(&group(mesh, text("name", name)?)?.vertices, vertices, capacity, needed)
    })
}

/// Numbers that the file of a mesh keeps with its cells, for tetrahedra, then hexahedra, as the lists of `sinew_material` take
/// them; in a mesh without these for triangles, then quadrilaterals. NaN where there is none.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_mesh_cell_data(
    mesh: *const sinew_mesh,
    name: *const c_char,
    values: *mut f64,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with_mesh(mesh, |mesh| {
        fill(&mesh_cell_data(mesh, text("name", name)?)?, values, capacity, needed)
    })
}

/// Vertices of a mesh by a table as below `select` of a scene, such as "half_space = { point = [0, 0, 0.05], normal = [0, 0, 1] }"
/// or "patch = { near = [0, 0, 0.1] }". `SINEW_ARGUMENT` where no vertex is there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_mesh_select(
    mesh: *const sinew_mesh,
    selection: *const c_char,
    vertices: *mut u32,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    with_mesh(mesh, |mesh| {
        fill(&mesh_select(mesh, text("selection", selection)?)?, vertices, capacity, needed)
    })
}

/// Frees a mesh; bodies made of it stay. NULL is fine.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_mesh_free(mesh: *mut sinew_mesh) {
    free(mesh)
}
