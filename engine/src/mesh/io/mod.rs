//! Readers and writers of mesh files.
//!
//! Every reader takes bytes, so that it can be tried on anything, and answers with a mesh or with a
//! [`MeshError`] that names file and place; it makes room for data only after it has seen them.

mod cells;
pub mod gmsh;
mod grid;
pub mod obj;
mod scan;
pub mod stl;
pub mod tetgen;
pub mod vtk;
pub mod vtu;

pub use gmsh::{encode_gmsh, read_gmsh, write_gmsh};
pub use obj::read_obj;
pub use stl::read_stl;
pub use tetgen::read_tetgen;
pub use vtk::{encode_vtk, read_vtk, write_vtk};
pub use vtu::{VtuData, encode_vtu, read_vtu, write_pvd, write_vtu};

use super::Mesh;
use super::error::{MeshError, shown};
use std::path::Path;

fn io_error(path: &Path, source: std::io::Error) -> MeshError {
    MeshError::Io { path: path.display().to_string(), source }
}

fn read_file(path: &Path) -> Result<Vec<u8>, MeshError> {
    std::fs::read(path).map_err(|source| io_error(path, source))
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), MeshError> {
    std::fs::write(path, bytes).map_err(|source| io_error(path, source))
}

/// Reads a file of any known format; see [`Mesh::read`].
pub(super) fn read(path: &Path) -> Result<Mesh, MeshError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let extension = extension.as_deref().unwrap_or("");
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    if matches!(extension, "node" | "ele") {
        let node = path.with_extension("node");
        let face = path.with_extension("face");
        let ele = path.with_extension("ele");
        let face = if face.exists() { Some(read_file(&face)?) } else { None };
        return read_tetgen(&read_file(&node)?, &read_file(&ele)?, face.as_deref(), &name);
    }
    let data = read_file(path)?;
    let start = data.trim_ascii_start();
    let starts = |text: &str| start.starts_with(text.as_bytes());
    if starts("$MeshFormat") || starts("$NOD") {
        read_gmsh(&data, &name)
    } else if starts("# vtk DataFile") {
        read_vtk(&data, &name)
    } else if starts("<?xml") || starts("<VTKFile") {
        read_vtu(&data, &name)
    } else {
        match extension {
            "msh" => read_gmsh(&data, &name),
            "vtk" => read_vtk(&data, &name),
            "vtu" => read_vtu(&data, &name),
            "obj" => read_obj(&data, &name),
            "stl" => read_stl(&data, &name),
            _ if starts("solid") || stl::is_binary(&data) => read_stl(&data, &name),
            _ if starts("v ") => read_obj(&data, &name),
            _ => Err(MeshError::UnknownFormat { file: name.into_owned(), start: shown(start) }),
        }
    }
}
