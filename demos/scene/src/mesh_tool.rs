//! `sinew mesh`: what is in a mesh file, from one format to another, and simple shapes.

use glam::DVec3;
use serde::Serialize;
use sinew::engine::mesh::io::{VtuData, write_gmsh, write_vtk, write_vtu};
use sinew::engine::mesh::merge::Merged;
use sinew::engine::mesh::{CellData, LatticeReport, Mesh, MeshError, PutOnSurface};
use std::fmt;
use std::path::{Path, PathBuf};

/// A mesh file that cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConvertError {
    /// Reading or writing.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The extension names no format that can be written.
    #[error("{0}: cannot write this format; use the extension .msh, .vtk or .vtu")]
    Format(PathBuf),
    /// There is nothing in it.
    #[error("{0}: the file holds no vertices; export the mesh again")]
    Empty(PathBuf),
    /// Second order is for tetrahedra.
    #[error("{0}: there are no tetrahedra to make second-order ones of; leave --second-order out")]
    NoTetrahedra(PathBuf),
    /// Only vertices in the middle of edges are put on a surface.
    #[error("{0}: linear elements have no vertices to put there; add --second-order")]
    NotSecondOrder(PathBuf),
    /// A file without a surface.
    #[error("{0}: there is no surface to put vertices on; give triangles, or solid elements")]
    NoSurface(PathBuf),
    /// A coordinate is not finite, or beyond what volumes can be computed of.
    #[error(
        "{path}: vertex {vertex} (counted from 0) lies at {at:?} m: coordinates must be finite and at most \
         {MOST:e} m; export the mesh again, or check its scale"
    )]
    Coordinate {
        /// Path of the file.
        path: PathBuf,
        /// Which vertex.
        vertex: usize,
        /// Where it is said to be (m).
        at: [f64; 3],
    },
    /// The tolerance is not usable.
    #[error(
        "tolerance is {0}; give a share of the size of the mesh above 0 and below 1, such as 1e-6"
    )]
    Tolerance(f64),
    /// The scale is not usable.
    #[error("scale is {0}; give a positive factor (0.001 for a mesh in millimetres)")]
    Scale(f64),
}

/// Largest coordinate (m) of a mesh: its volume is still a number.
const MOST: f64 = 1e50;

/// What is in a mesh.
#[derive(Clone, Debug, Serialize)]
pub struct MeshInfo {
    /// `"sinew-mesh/1"`.
    pub schema: &'static str,
    /// File or generator.
    pub source: String,
    /// Vertices.
    pub vertices: usize,
    /// Tetrahedra.
    pub tetrahedra: usize,
    /// Whether they have a vertex on every edge.
    pub second_order: bool,
    /// What became of these where they were put on a surface.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub put_on_surface: Option<PutOnSurface>,
    /// Hexahedra.
    pub hexahedra: usize,
    /// Triangles in the file.
    pub triangles: usize,
    /// Quadrilaterals in the file.
    pub quads: usize,
    /// Triangles that bound the tetrahedra.
    pub boundary_triangles: usize,
    /// Quadrilaterals that bound the hexahedra.
    pub boundary_quads: usize,
    /// Sum of the signed volumes of the tetrahedra and hexahedra (m^3).
    pub volume: f64,
    /// Smallest and largest corner (m).
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Shortest, mean and longest edge of the tetrahedra and hexahedra, or of the faces in a mesh without
    /// them (m).
    pub edge_lengths: Option<[f64; 3]>,
    /// Groups.
    pub groups: Vec<GroupInfo>,
    /// Numbers that the file keeps with its cells, for materials that vary (`young_modulus_field`) and the like.
    pub data: Vec<DataInfo>,
    /// Cells of kinds that Sinew cannot use, with their number.
    pub skipped: Vec<(String, usize)>,
    /// What became of vertices that lie at one place, where they were merged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub merged: Option<Merged>,
    /// How a surface was filled, where the mesh is a lattice over it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lattice: Option<LatticeReport>,
}

/// Cell data of a mesh.
#[derive(Clone, Debug, Serialize)]
pub struct DataInfo {
    /// Name.
    pub name: String,
    /// Whether the file holds whole numbers.
    pub integer: bool,
    /// Cells that have a number.
    pub cells: usize,
    /// Cells that have none, or one that is not finite.
    pub without: usize,
    /// Smallest number; `None` where no cell has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smallest: Option<f64>,
    /// Largest number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest: Option<f64>,
}

impl DataInfo {
    fn of(data: &CellData) -> Self {
        let (mut cells, mut without, mut ends) = (0, 0, None);
        for &value in data.values.in_files().into_iter().flatten() {
            if !value.is_finite() {
                without += 1;
                continue;
            }
            cells += 1;
            let (low, high) = ends.unwrap_or((value, value));
            ends = Some((value.min(low), value.max(high)));
        }
        let CellData { name, integer, .. } = data;
        let (smallest, largest) = (ends.map(|e| e.0), ends.map(|e| e.1));
        Self { name: name.clone(), integer: *integer, cells, without, smallest, largest }
    }
}

/// A group of a mesh.
#[derive(Clone, Debug, Serialize)]
pub struct GroupInfo {
    /// Name.
    pub name: String,
    /// 0 points, 1 lines, 2 faces, 3 volumes.
    pub dimension: u8,
    /// Vertices.
    pub vertices: usize,
    /// Triangles.
    pub triangles: usize,
    /// Quadrilaterals.
    pub quads: usize,
    /// Tetrahedra.
    pub tetrahedra: usize,
    /// Hexahedra.
    pub hexahedra: usize,
}

impl MeshInfo {
    /// What is in `mesh`.
    pub fn of(mesh: &Mesh) -> Self {
        let mut edges = mesh.edges();
        edges.sort_unstable();
        edges.dedup();
        let surface = mesh.surface();
        let point = |i: u32| mesh.points.get(i as usize).copied();
        let lengths: Vec<f64> = edges
            .iter()
            .filter_map(|&[a, b]| Some(point(a)?.distance(point(b)?)))
            .filter(|length| length.is_finite())
            .collect();
        let edge_lengths = (!lengths.is_empty()).then(|| {
            let shortest = lengths.iter().copied().fold(f64::INFINITY, f64::min);
            let longest = lengths.iter().copied().fold(0.0, f64::max);
            [shortest, lengths.iter().sum::<f64>() / lengths.len() as f64, longest]
        });
        Self {
            schema: "sinew-mesh/1",
            source: mesh.source.clone(),
            vertices: mesh.points.len(),
            tetrahedra: mesh.tetrahedra.len(),
            second_order: mesh.is_second_order(),
            put_on_surface: None,
            hexahedra: mesh.hexahedra.len(),
            triangles: mesh.triangles.len(),
            quads: mesh.quads.len(),
            boundary_triangles: surface.triangles.len(),
            boundary_quads: surface.quads.len(),
            volume: mesh.total_volume(),
            bounds: mesh.bounds().map(|(low, high)| [low.to_array(), high.to_array()]),
            edge_lengths,
            groups: mesh
                .groups
                .iter()
                .map(|group| GroupInfo {
                    name: group.name.clone(),
                    dimension: group.dimension,
                    vertices: group.vertices.len(),
                    triangles: group.cells.triangles.len(),
                    quads: group.cells.quads.len(),
                    tetrahedra: group.cells.tetrahedra.len(),
                    hexahedra: group.cells.hexahedra.len(),
                })
                .collect(),
            data: mesh.cell_data.iter().map(DataInfo::of).collect(),
            skipped: mesh.skipped.iter().map(|s| (s.kind.clone(), s.count)).collect(),
            merged: None,
            lattice: None,
        }
    }
}

impl fmt::Display for MeshInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.source)?;
        writeln!(f, "  vertices    {}", self.vertices)?;
        let order = if self.second_order { " of second order" } else { "" };
        writeln!(f, "  tetrahedra  {}{order}", self.tetrahedra)?;
        if let Some(put) = self.put_on_surface {
            let PutOnSurface { moved, far, folded, largest } = put;
            writeln!(
                f,
                "  curved      {moved} vertices put on the surface, {largest:.3e} m at most"
            )?;
            if far + folded > 0 {
                writeln!(
                    f,
                    "  straight    {far} edges, the surface is farther than a quarter of them; {folded}, elements would fold"
                )?;
            }
        }
        if self.hexahedra > 0 {
            writeln!(f, "  hexahedra   {}", self.hexahedra)?;
        }
        writeln!(
            f,
            "  triangles   {} in the file, {} on the boundary",
            self.triangles, self.boundary_triangles
        )?;
        if self.quads + self.boundary_quads > 0 {
            writeln!(
                f,
                "  quads       {} in the file, {} on the boundary",
                self.quads, self.boundary_quads
            )?;
        }
        writeln!(f, "  volume      {:.6e} m^3", self.volume)?;
        if let Some([low, high]) = self.bounds {
            for (k, axis) in ["x", "y", "z"].into_iter().enumerate() {
                let label = if k == 0 { "extent" } else { "" };
                let (a, b) = (low[k], high[k]);
                writeln!(f, "  {label:<11} {axis} {a:+.5} to {b:+.5} m ({:.5} m)", b - a)?;
            }
        }
        if let Some([shortest, mean, longest]) = self.edge_lengths {
            writeln!(f, "  edges       {shortest:.5} to {longest:.5} m, mean {mean:.5} m")?;
        }
        for (i, group) in self.groups.iter().enumerate() {
            let label = if i == 0 { "groups" } else { "" };
            let kind = ["points", "lines", "faces", "volume"][usize::from(group.dimension.min(3))];
            write!(
                f,
                "  {label:<11} {:<16} {kind:<7} {:>7} vertices {:>7} triangles {:>7} tetrahedra",
                group.name, group.vertices, group.triangles, group.tetrahedra
            )?;
            for (count, cells) in [(group.quads, "quads"), (group.hexahedra, "hexahedra")] {
                if count > 0 {
                    write!(f, " {count:>7} {cells}")?;
                }
            }
            writeln!(f)?;
        }
        for (i, data) in self.data.iter().enumerate() {
            let label = if i == 0 { "cell data" } else { "" };
            let DataInfo { name, cells, without, .. } = data;
            write!(f, "  {label:<11} {name:<16} {cells:>7} cells")?;
            if let (Some(smallest), Some(largest)) = (data.smallest, data.largest) {
                write!(f, ", {smallest} to {largest}")?;
            }
            match without {
                0 => writeln!(f)?,
                _ => writeln!(f, ", {without} cells without")?,
            }
        }
        if let Some(Merged { vertices, left, distance }) = self.merged {
            writeln!(
                f,
                "  merged      {vertices} vertices that lay within {distance:.3e} m of another"
            )?;
            if left > 0 {
                writeln!(f, "  left        {left} vertices: cells would become flat")?;
            }
        }
        if let Some(LatticeReport { volume, held, nearly_empty, apart, odd_lines, .. }) =
            self.lattice
        {
            writeln!(
                f,
                "  surface     encloses {volume:.6e} m^3, {:.2} % of it in the cells",
                100.0 * held / volume
            )?;
            writeln!(f, "  left out    {nearly_empty} nearly empty cells, {apart} apart")?;
            if odd_lines > 0 {
                writeln!(
                    f,
                    "  doubtful    {odd_lines} lines cross the surface an odd number of times"
                )?;
            }
        }
        for (kind, count) in &self.skipped {
            writeln!(f, "  skipped     {count} x {kind}")?;
        }
        Ok(())
    }
}

/// Reads a mesh that has vertices, all of them somewhere.
///
/// # Errors
/// When the file cannot be read, is empty, or has a coordinate that is not finite.
pub fn read(path: &Path) -> Result<Mesh, ConvertError> {
    let mesh = Mesh::read(path)?;
    check_points(path, &mesh)?;
    Ok(mesh)
}

fn check_points(path: &Path, mesh: &Mesh) -> Result<(), ConvertError> {
    if mesh.points.is_empty() {
        return Err(ConvertError::Empty(path.into()));
    }
    let usable = |p: &DVec3| p.to_array().iter().all(|x| x.abs() <= MOST);
    match mesh.points.iter().position(|p| !usable(p)) {
        None => Ok(()),
        Some(vertex) => {
            let at = mesh.points[vertex].to_array();
            Err(ConvertError::Coordinate { path: path.into(), vertex, at })
        }
    }
}

/// Writes a mesh in the format of the extension: `.msh` (Gmsh), `.vtk` or `.vtu`.
///
/// # Errors
/// When the extension is another one or the file cannot be written.
pub fn write(path: &Path, mesh: &Mesh) -> Result<(), ConvertError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        Some("msh") => Ok(write_gmsh(path, mesh)?),
        Some("vtk") => Ok(write_vtk(path, &VtuData::of_mesh(mesh))?),
        Some("vtu") => Ok(write_vtu(path, &VtuData::of_mesh(mesh))?),
        _ => Err(ConvertError::Format(path.into())),
    }
}

/// Reads one file and writes another in which vertices that lie within `tolerance` times the largest extent of each other
/// are one.
///
/// # Errors
/// When one of the files or the tolerance cannot be used.
pub fn merge(from: &Path, to: &Path, tolerance: f64) -> Result<MeshInfo, ConvertError> {
    if !(tolerance > 0.0 && tolerance < 1.0) {
        return Err(ConvertError::Tolerance(tolerance));
    }
    let (mesh, merged) = read(from)?.merged(tolerance);
    write(to, &mesh)?;
    Ok(MeshInfo { merged: Some(merged), ..MeshInfo::of(&mesh) })
}

/// Reads a closed surface, with every coordinate multiplied by `scale`, and writes a lattice of cubes over what it encloses.
///
/// # Errors
/// When one of the files, the edge `cell` (m) of the cubes or the scale cannot be used.
pub fn lattice(from: &Path, to: &Path, cell: f64, scale: f64) -> Result<MeshInfo, ConvertError> {
    let (mesh, report) = scaled(from, scale)?.lattice(cell)?;
    write(to, &mesh)?;
    Ok(MeshInfo { lattice: Some(report), ..MeshInfo::of(&mesh) })
}

/// Reads a mesh, with every coordinate multiplied by `scale`.
pub(crate) fn scaled(from: &Path, scale: f64) -> Result<Mesh, ConvertError> {
    if !(scale > 0.0 && scale.is_finite()) {
        return Err(ConvertError::Scale(scale));
    }
    let mut mesh = read(from)?;
    if scale != 1.0 {
        mesh.points.iter_mut().for_each(|p| *p *= scale);
        check_points(from, &mesh)?;
    }
    Ok(mesh)
}

/// Reads one file and writes another, with every coordinate multiplied by `scale` and, if asked for, a vertex in the middle of
/// every edge of a tetrahedron.
///
/// # Errors
/// When one of the files or the scale cannot be used.
pub fn convert(
    from: &Path,
    to: &Path,
    scale: f64,
    second_order: bool,
    onto: Option<&Path>,
) -> Result<MeshInfo, ConvertError> {
    let mut mesh = scaled(from, scale)?;
    if second_order {
        if mesh.tetrahedra.is_empty() {
            return Err(ConvertError::NoTetrahedra(from.into()));
        }
        mesh = mesh.with_second_order();
    }
    let put = match onto {
        Some(path) if !mesh.is_second_order() => {
            return Err(ConvertError::NotSecondOrder(path.into()));
        }
        Some(path) => {
            let surface = scaled(path, scale)?;
            if surface.surface_triangles().is_empty() {
                return Err(ConvertError::NoSurface(path.into()));
            }
            Some(mesh.put_middles_on(&surface))
        }
        None => None,
    };
    write(to, &mesh)?;
    Ok(MeshInfo { put_on_surface: put, ..MeshInfo::of(&mesh) })
}
