//! A first scene for a mesh of one's own, with a comment on every line that will be changed.

use crate::text::short;
use sinew::engine::mesh::{Mesh, MeshError};
use sinew::models::material::{MaterialError, preset};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Why there is no scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NewSceneError {
    /// The mesh cannot be read.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// There is no such tissue.
    #[error(transparent)]
    Tissue(#[from] MaterialError),
    /// There is nothing in the mesh.
    #[error("{}: the mesh has no extent; export it again", .0.display())]
    Empty(PathBuf),
}

/// Diagonal (m) above which a mesh is taken to be in millimetres: nobody is so large.
const LARGE: f64 = 4.0;
/// Words in the names of groups that people hold bodies by.
const HOLDS: [&str; 8] = ["held", "fix", "ligament", "clamp", "anchor", "base", "bottom", "z0"];

/// The text of a scene with the mesh of a file, which it calls `name`: of this tissue, held at a group of the mesh or its lowest
/// part, and pressed from above by a ball. A surface is filled with cubes.
///
/// # Errors
/// When the mesh cannot be read or is empty, or no preset has this name.
pub fn new_scene(file: &Path, name: &str, tissue: &str) -> Result<String, NewSceneError> {
    let (mesh, preset) = (Mesh::read(file)?, preset(tissue)?);
    let empty = || NewSceneError::Empty(file.into());
    let (low, high) = mesh.bounds().ok_or_else(empty)?;
    let millimetres = (high - low).length() > LARGE;
    let scale = if millimetres { 1e-3 } else { 1.0 };
    let (low, high) = (low * scale, high * scale);
    let size = high - low;
    let extent = size.length();
    if !(extent > 0.0 && extent.is_finite()) {
        return Err(empty());
    }
    let solid = mesh.is_solid();
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let mut text = format!(
        "# Written by `sinew new`: look through every line, then `sinew run` it. Metres, seconds, kilograms, newtons, pascals;\n\
         # all keys are in demos/scenes/README.md.\n\n\
         name = {:?}\ndt = 0.01           # s; a smaller step follows fast motion better\nduration = 3.0      # s\n\n\
         [[body]]\nname = \"organ\"\nmesh = {name:?}\n",
        stem.as_ref()
    );
    if millimetres {
        let _ = writeln!(
            text,
            "scale = 0.001       # the mesh measures {} across: taken for millimetres",
            short(extent / scale)
        );
    }
    if !solid {
        let cell = format!("{:.1e}", extent / 18.0).parse().unwrap_or(extent);
        let _ = writeln!(
            text,
            "# a surface: cubes of this edge (m) fill it; tetrahedra follow it closer (docs/own-mesh.md)\nlattice = {}",
            short(cell)
        );
    }
    let of = &preset.material;
    let _ = writeln!(
        text,
        "# {}: E = {} Pa, nu = {}, {} kg/m^3. {}\n# Source: {}.\n\
         # Your own figures: material = {{ young_modulus = 5e3, poisson_ratio = 0.45, density = 1060.0 }}\n\
         material = {{ preset = {:?} }}\n\
         model = \"neo_hookean\" # gets stiffer under a tool, as tissue does (docs/which-model.md)\n",
        preset.name,
        short(of.young_modulus),
        short(of.poisson_ratio),
        short(of.density),
        preset.note,
        preset.source,
        preset.name,
    );
    let groups: Vec<&str> =
        mesh.groups.iter().filter(|g| !g.vertices.is_empty()).map(|g| g.name.as_str()).collect();
    // a group of all vertices would hold everything
    let part = |name: &str| {
        let count = mesh.groups.iter().filter(|g| g.name == name).map(|g| g.vertices.len()).max();
        count.is_some_and(|count| count * 2 < mesh.points.len())
    };
    let held = HOLDS.iter().find_map(|word| {
        groups.iter().find(|name| solid && name.to_lowercase().contains(word) && part(name))
    });
    text += "[[constraint]]\nname = \"hold\"\n";
    if !groups.is_empty() {
        let _ = writeln!(text, "# groups of the mesh: {}", groups.join(", "));
    }
    let _ = match held {
        Some(group) => writeln!(text, "select = {{ group = {group:?} }}"),
        None => {
            let room = 0.05 * extent;
            // of cubes one layer of corners at least
            let top = low.z + if solid { 0.12 } else { 0.3 } * size.z;
            let list = |x: f64, y: f64, z: f64| [x, y, z].map(short).join(", ");
            writeln!(
                text,
                "# its lowest part, a box (m); a group of the mesh is better: select = {{ group = \"...\" }}\n\
                 select = {{ box = {{ min = [{}], max = [{}] }} }}",
                list(low.x - room, low.y - room, low.z - room),
                list(high.x + room, high.y + room, top)
            )
        }
    };
    // the highest point is under the ball
    let top =
        mesh.points.iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap_or_default() * scale;
    let radius = 0.1 * extent;
    let depth = (0.12 * size.z).min(0.4 * radius).max(0.02 * radius);
    let pose = |t: f64, z: f64| format!("[{}]", [t, top.x, top.y, z].map(short).join(", "));
    let (far, near) = (top.z + 1.1 * radius, top.z + radius - depth);
    let _ = write!(
        text,
        "\n# a ball presses from above, {} mm deep, holds and lifts: time (s) and centre (m)\n\
         [[tool]]\nname = \"ball\"\nshape = \"sphere\"\nradius = {}\nfriction = 0.2\n\
         path = [{}, {}, {}, {}]\n\n\
         # columns of the table, and graphs of the page\n\
         [[probe]]\nname = \"ball\"\ntool = \"ball\"\nrecord = [\"tool_force\", \"tool_depth\"]\n",
        short(1e3 * depth),
        short(radius),
        pose(0.0, far),
        pose(1.0, near),
        pose(2.0, near),
        pose(2.5, far),
    );
    Ok(text)
}
