//! `sinew mesh fill`: tetrahedra inside a closed surface, made by Gmsh, which is run as a program of its own.

use crate::mesh_tool::{ConvertError, MeshInfo, read, scaled, write};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::io::write_gmsh;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A surface that cannot be filled.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FillError {
    /// The surface or the file to write.
    #[error(transparent)]
    Convert(#[from] ConvertError),
    /// The edge is no length.
    #[error("edge is {0}; give the length (m) that edges of tetrahedra are to have, above 0")]
    Edge(f64),
    /// There is no mesher.
    #[error(
        "there is no command `gmsh`, which makes the tetrahedra: install it (`pip install gmsh`, a package of the system, or gmsh.info) \
         and run this again, or `gmsh -3 {RECIPE} -o {FILLED}` in {0} where it is installed; `sinew mesh lattice` needs no Gmsh"
    )]
    NoMesher(PathBuf),
    /// It cannot be started.
    #[error("gmsh cannot be run: {0}")]
    Run(#[source] std::io::Error),
    /// The folder for its files.
    #[error("{path}: {source}")]
    Folder {
        /// Which one.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// It made nothing.
    #[error(
        "{surface}: Gmsh made no tetrahedra ({said}); a surface that cuts itself must be mended first, or be filled by \
         `sinew mesh lattice` or fTetWild; what Gmsh was given is in {folder}"
    )]
    NotFilled {
        /// File of the surface.
        surface: PathBuf,
        /// Its first error or warning.
        said: String,
        /// Folder of the recipe and the surface.
        folder: PathBuf,
    },
}

const RECIPE: &str = "recipe.geo";
const SURFACE: &str = "surface.msh";
const FILLED: &str = "filled.msh";

/// Commands of Gmsh that fill [`SURFACE`]: triangles stay as they are, or are made anew with edges of a length.
fn recipe(edge: Option<f64>) -> String {
    let anew = edge.map_or(String::new(), |edge| {
        format!(
            "// new triangles; edges of the surface sharper than 45 degrees stay\nClassifySurfaces{{Pi / 4, 1, 1, Pi}};\nCreateGeometry;\n\
             Mesh.MeshSizeMin = {edge:e};\nMesh.MeshSizeMax = {edge:e};\n"
        )
    });
    format!(
        "Merge \"{SURFACE}\";\n{anew}Surface Loop(1) = Surface{{:}};\nVolume(1) = {{1}};\nPhysical Volume(\"body\") = {{1}};\n\
         Physical Surface(\"surface\") = Surface{{:}};\n"
    )
}

/// Fills the closed surface in `from`, with every coordinate multiplied by `scale`, and writes tetrahedra with the groups
/// `body` and `surface`. Triangles stay as they are, unless the `edge` (m) that they should have is given. The elements of a
/// solid mesh are made anew within its surface.
///
/// # Errors
/// When the surface is not closed, one of the files or numbers cannot be used, Gmsh is not installed or fills nothing. Then the
/// folder `TO.fill` beside the file to be written keeps what Gmsh was given.
pub fn fill(from: &Path, to: &Path, edge: Option<f64>, scale: f64) -> Result<MeshInfo, FillError> {
    if let Some(edge) = edge.filter(|edge| !(*edge > 0.0 && edge.is_finite())) {
        return Err(FillError::Edge(edge));
    }
    let mesh = scaled(from, scale)?;
    let triangles = mesh.outside();
    mesh.closed(&triangles).map_err(ConvertError::from)?;
    // Gmsh would take points inside of a solid mesh for its own
    let mut surface = Mesh { triangles, source: mesh.source, ..Mesh::default() };
    let mut places = vec![None; mesh.points.len()];
    for v in surface.triangles.iter_mut().flatten() {
        let old = *v as usize;
        *v = *places[old].get_or_insert_with(|| {
            surface.points.push(mesh.points[old]);
            surface.points.len() as u32 - 1
        });
    }
    let folder = PathBuf::from(format!("{}.fill", to.display()));
    let of_folder = |source| FillError::Folder { path: folder.clone(), source };
    std::fs::create_dir_all(&folder).map_err(of_folder)?;
    std::fs::write(folder.join(RECIPE), recipe(edge)).map_err(of_folder)?;
    write_gmsh(&folder.join(SURFACE), &surface).map_err(ConvertError::from)?;
    let said =
        match Command::new("gmsh").args(["-3", RECIPE, "-o", FILLED]).current_dir(&folder).output()
        {
            Ok(said) => said,
            Err(error) if error.kind() == ErrorKind::NotFound => {
                return Err(FillError::NoMesher(folder));
            }
            Err(error) => return Err(FillError::Run(error)),
        };
    let filled = read(&folder.join(FILLED)).ok().filter(|mesh| !mesh.tetrahedra.is_empty());
    let Some(filled) = filled else {
        let said = [said.stderr, said.stdout].concat();
        let said = String::from_utf8_lossy(&said);
        let first = said.lines().find(|line| line.contains("Error") || line.contains("Warning"));
        let said = first.unwrap_or("it said nothing").trim().to_owned();
        return Err(FillError::NotFilled { surface: from.into(), said, folder });
    };
    write(to, &filled)?;
    std::fs::remove_dir_all(&folder).map_err(of_folder)?;
    Ok(MeshInfo { source: to.display().to_string(), ..MeshInfo::of(&filled) })
}
