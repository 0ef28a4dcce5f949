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
use super::error::MeshError;
use std::borrow::Cow;
use std::io::ErrorKind;
use std::path::Path;

fn io_error(path: &Path, source: std::io::Error) -> MeshError {
    MeshError::Io { path: path.display().to_string(), source }
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), MeshError> {
    std::fs::write(path, bytes).map_err(|source| io_error(path, source))
}

/// Extension in lower case and name of a file, which messages give.
fn parts(path: &Path) -> (String, Cow<'_, str>) {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    (extension.unwrap_or_default(), name)
}

fn is_tetgen(extension: &str) -> bool {
    matches!(extension, "node" | "ele")
}

/// Reads a mesh of any known format from the files that `open` gives; see [`Mesh::read_with`].
pub(super) fn read_with(
    path: &Path,
    open: &dyn Fn(&Path) -> std::io::Result<Vec<u8>>,
) -> Result<Mesh, MeshError> {
    let file = |path: &Path| open(path).map_err(|source| io_error(path, source));
    let (extension, name) = parts(path);
    if !is_tetgen(&extension) {
        return from_bytes(path, &file(path)?);
    }
    let (node, ele) = (file(&path.with_extension("node"))?, file(&path.with_extension("ele"))?);
    let face = match file(&path.with_extension("face")) {
        Ok(face) => Some(face),
        Err(MeshError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => None,
        Err(error) => return Err(error),
    };
    read_tetgen(&node, &ele, face.as_deref(), &name)
}

/// Reads a file of any known format that needs no other; see [`Mesh::from_bytes`].
pub(super) fn from_bytes(path: &Path, data: &[u8]) -> Result<Mesh, MeshError> {
    let (extension, name) = parts(path);
    if is_tetgen(&extension) {
        return Err(MeshError::SeveralFiles { file: name.into_owned() });
    }
    let start = data.trim_ascii_start();
    let starts = |text: &str| start.starts_with(text.as_bytes());
    if starts("$MeshFormat") || starts("$NOD") {
        read_gmsh(data, &name)
    } else if starts("# vtk DataFile") {
        read_vtk(data, &name)
    } else if starts("<?xml") || starts("<VTKFile") {
        read_vtu(data, &name)
    } else {
        match &*extension {
            "msh" => read_gmsh(data, &name),
            "vtk" => read_vtk(data, &name),
            "vtu" => read_vtu(data, &name),
            "obj" => read_obj(data, &name),
            "stl" => read_stl(data, &name),
            _ if starts("solid") || stl::is_binary(data) => read_stl(data, &name),
            _ if starts("v ") => read_obj(data, &name),
            _ => Err(MeshError::UnknownFormat { file: name.into_owned() }),
        }
    }
}
