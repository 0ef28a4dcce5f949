//! A first scene for a mesh of one's own, with a comment on every line that will be changed.

use crate::text::{short, wrapped};
use glam::DVec3;
use sinew::engine::mesh::{Group, Mesh, MeshError};
use sinew::models::material::{MaterialError, preset};
use std::collections::HashSet;
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
/// part, and pressed by a ball from the other side. A surface is filled with cubes.
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
         name = {:?}\ndt = 0.01           # s; a smaller step follows fast motion better\nduration = 3.0      # s\n\
         # [0.0, 0.0, -9.81] lets it hang, or lie; without, forces are those of the ball alone\ngravity = [0.0, 0.0, 0.0]\n\n\
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
    let about = format!(
        "{}: E = {} Pa, nu = {}, {} kg/m^3. {} Source: {}. Your own figures: material = {{ young_modulus = 5e3, \
         poisson_ratio = 0.45, density = 1060.0 }}",
        preset.name,
        short(of.young_modulus),
        short(of.poisson_ratio),
        short(of.density),
        preset.note,
        preset.source,
    );
    let _ = writeln!(
        text,
        "{}material = {{ preset = {:?} }}\n\
         model = \"neo_hookean\" # gets stiffer under a tool, as tissue does (docs/which-model.md)\n",
        wrapped(&about, 100, "# "),
        preset.name,
    );
    let groups: Vec<&str> =
        mesh.groups.iter().filter(|g| !g.vertices.is_empty()).map(|g| g.name.as_str()).collect();
    let corners = mesh.tetrahedra.as_flattened().iter().chain(mesh.hexahedra.as_flattened());
    let used: HashSet<u32> = corners.copied().collect();
    // a group of most vertices would hold everything, and cubes know none
    let part = |group: &&Group| {
        group.vertices.len() * 2 < mesh.points.len()
            && group.vertices.iter().any(|v| used.contains(v))
    };
    let held = HOLDS.iter().find_map(|word| {
        let named = |group: &&Group| group.name.to_lowercase().contains(word);
        mesh.groups.iter().filter(part).find(named)
    });
    text += "[[constraint]]\nname = \"hold\"\n";
    if !groups.is_empty() {
        let _ = writeln!(text, "# groups of the mesh: {}", groups.join(", "));
    }
    let middle = 0.5 * (low + high);
    let mut away = DVec3::Z;
    let _ = match held {
        Some(group) => {
            let points = group.vertices.iter().filter_map(|&v| mesh.points.get(v as usize));
            let sum: DVec3 = points.map(|p| *p * scale - middle).sum();
            away = (-sum).try_normalize().unwrap_or(DVec3::Z);
            writeln!(text, "select = {{ group = {:?} }}", group.name)
        }
        None => {
            let room = 0.05 * extent;
            // of cubes one layer of corners at least
            let top = low.z + if solid { 0.12 } else { 0.3 } * size.z;
            writeln!(
                text,
                "# its lowest part, a box (m); a group of the mesh is better: select = {{ group = \"...\" }}\n\
                 select = {{ box = {{ min = {}, max = {} }} }}",
                list(&(low - room).to_array()),
                list(&[high.x + room, high.y + room, top])
            )
        }
    };
    // opposite of what is held, on the point that is farthest out
    let out = |p: &DVec3| (*p * scale - middle).dot(away);
    let finite = mesh.points.iter().filter(|p| p.is_finite());
    let seat = finite.max_by(|a, b| out(a).total_cmp(&out(b))).map_or(middle, |p| *p * scale);
    let radius = 0.1 * extent;
    let depth = (0.1 * (seat - middle).dot(away)).min(0.4 * radius).max(0.02 * radius);
    let pose = |t: f64, gap: f64| {
        let [x, y, z] = (seat + away * (radius + gap)).to_array();
        list(&[t, x, y, z])
    };
    let gap = 0.1 * radius;
    let _ = write!(
        text,
        "\n# a ball presses {} mm deep, holds and lifts: time (s) and centre (m)\n\
         [[tool]]\nname = \"ball\"\nshape = \"sphere\"\nradius = {}\nfriction = 0.2\n\
         path = [\n    {},\n    {},\n    {},\n    {},\n]\n\n\
         # columns of the table, and graphs of the page\n\
         [[probe]]\nname = \"ball\"\ntool = \"ball\"\nrecord = [\"tool_force\", \"tool_depth\"]\n",
        short(1e3 * depth),
        short(radius),
        pose(0.0, gap),
        pose(1.0, -depth),
        pose(2.0, -depth),
        pose(2.5, gap),
    );
    Ok(text)
}

/// Numbers as a list of TOML.
fn list(numbers: &[f64]) -> String {
    format!("[{}]", numbers.iter().map(|x| short(*x)).collect::<Vec<_>>().join(", "))
}
