//! Meshes.

use super::call::{free, give, guarded, read, slice, text, times};
use super::types::*;
use sinew_embed::{Mesh, MeshArrays, mesh_from_arrays, mesh_from_bytes, mesh_from_file};
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

/// Frees a mesh; bodies made of it stay. NULL is fine.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_mesh_free(mesh: *mut sinew_mesh) {
    free(mesh)
}
