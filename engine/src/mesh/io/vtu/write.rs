//! Writes VTU files and the index of a time series.

use super::super::cells::{Column, all_values, columns};
use super::super::grid::{array_name, cell_mask, mask};
use crate::element_kind::ElementKind;
use crate::mesh::error::MeshError;
use crate::mesh::{CellData, CellVertices, Group, Mesh};
use glam::DVec3;
use std::fmt::Write as _;
use std::path::Path;

/// What the VTU and VTK writers write, by default the points, cells, data and groups of a mesh; lengths must match
/// the points or cells.
#[derive(Clone, Copy, Debug)]
pub struct VtuData<'a> {
    /// Mesh with the cells: tetrahedra come first in the file, then hexahedra, triangles and quadrilaterals.
    pub mesh: &'a Mesh,
    /// Positions in metres.
    pub points: &'a [DVec3],
    /// Named vectors, one for each point, in any unit.
    pub point_vectors: &'a [(&'a str, &'a [DVec3])],
    /// Named numbers, one for each point, in any unit.
    pub point_scalars: &'a [(&'a str, &'a [f64])],
    /// Named numbers, one for each cell in the order of the file, in any unit.
    pub cell_scalars: &'a [(&'a str, &'a [f64])],
    /// Numbers kept with the mesh, written as they were read: three neighbours named `NAME_x`, `NAME_y`
    /// and `NAME_z` as one vector `NAME`.
    pub cell_data: &'a [CellData],
    /// Groups, written as 0/1 arrays named `group:<dimension>:<name>` on points and cells.
    pub groups: &'a [Group],
    /// Writes real numbers with 32 instead of 64 bits.
    pub single_precision: bool,
}

impl<'a> VtuData<'a> {
    /// Points, cells and groups of a mesh.
    pub fn of_mesh(mesh: &'a Mesh) -> Self {
        VtuData {
            mesh,
            points: &mesh.points,
            point_vectors: &[],
            point_scalars: &[],
            cell_scalars: &[],
            cell_data: &mesh.cell_data,
            groups: &mesh.groups,
            single_precision: false,
        }
    }

    pub(in crate::mesh::io) fn n_cells(&self) -> usize {
        ElementKind::ALL.into_iter().map(|kind| self.mesh.count(kind)).sum()
    }

    /// Number of the vertices of all cells together.
    pub(in crate::mesh::io) fn n_corners(&self) -> usize {
        self.cells().map(|cell| cell.len()).sum()
    }

    /// The vertices of every cell in the order of the file.
    pub(in crate::mesh::io) fn cells(&self) -> impl Iterator<Item = CellVertices> {
        ElementKind::IN_FILES.into_iter().flat_map(|kind| self.mesh.cells(kind))
    }

    /// The VTK type of every cell in the order of the file.
    pub(in crate::mesh::io) fn cell_types(&self) -> impl Iterator<Item = u8> {
        ElementKind::IN_FILES.into_iter().flat_map(|kind| {
            self.mesh.cells(kind).map(move |cell| match kind {
                ElementKind::Tetrahedron if cell.len() == 10 => 24,
                ElementKind::Tetrahedron => 10,
                ElementKind::Triangle => 5,
                ElementKind::Hexahedron => 12,
                ElementKind::Quad => 9,
            })
        })
    }

    pub(in crate::mesh::io) fn check_lengths(&self) -> Result<(), MeshError> {
        let (n_points, n_cells) = (self.points.len(), self.n_cells());
        let (expected, found) = (self.mesh.tetrahedra.len(), self.mesh.middles.len());
        if found != 0 && found != expected {
            let (what, entities) = ("vertices on edges".to_owned(), "tetrahedra");
            return Err(MeshError::LengthMismatch { what, entities, expected, found });
        }
        let vectors =
            self.point_vectors.iter().map(|(name, v)| (name, v.len(), n_points, "points"));
        let scalars =
            self.point_scalars.iter().map(|(name, v)| (name, v.len(), n_points, "points"));
        let cells = self.cell_scalars.iter().map(|(name, v)| (name, v.len(), n_cells, "cells"));
        const NAMES: [&str; 4] = ["tetrahedra", "hexahedra", "triangles", "quadrilaterals"];
        let data = self.cell_data.iter().flat_map(|data| {
            ElementKind::IN_FILES.into_iter().zip(NAMES).map(|(kind, cells)| {
                (&data.name, data.values[kind].len(), self.mesh.count(kind), cells)
            })
        });
        for (name, found, expected, entities) in data {
            if found != expected {
                let what = name.clone();
                return Err(MeshError::LengthMismatch { what, entities, expected, found });
            }
        }
        for (name, found, expected, entities) in vectors.chain(scalars).chain(cells) {
            if found != expected {
                let what = (*name).to_owned();
                return Err(MeshError::LengthMismatch { what, entities, expected, found });
            }
        }
        Ok(())
    }
}

/// Writes points, cells, data and groups as a VTU file.
///
/// # Errors
///
/// [`MeshError::LengthMismatch`] when data do not fit, [`MeshError::Io`] when the file cannot be
/// written.
pub fn write_vtu(path: &Path, data: &VtuData<'_>) -> Result<(), MeshError> {
    super::super::write_file(path, &encode_vtu(data)?)
}

/// The bytes of a VTU file: arrays appended raw, least significant byte first.
///
/// # Errors
///
/// [`MeshError::LengthMismatch`] when data do not fit.
pub fn encode_vtu(data: &VtuData<'_>) -> Result<Vec<u8>, MeshError> {
    data.check_lengths()?;
    let n_cells = data.n_cells();
    let mut out = Output { xml: String::new(), raw: Vec::new(), single: data.single_precision };
    out.xml.push_str(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" \
         byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<UnstructuredGrid>\n",
    );
    // Writing to a string cannot fail.
    let _ = writeln!(
        out.xml,
        "<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{n_cells}\">\n<PointData>",
        data.points.len()
    );
    for (name, values) in data.point_vectors {
        out.reals(name, 3, values.iter().flat_map(|v| v.to_array()));
    }
    for (name, values) in data.point_scalars {
        out.reals(name, 1, values.iter().copied());
    }
    for group in data.groups {
        let members = group.vertices.iter().map(|&v| v as usize);
        out.array("UInt8", &array_name(group), 1, &mask(data.points.len(), members));
    }
    out.xml.push_str("</PointData>\n<CellData>\n");
    for (name, values) in data.cell_scalars {
        out.reals(name, 1, values.iter().copied());
    }
    for column in columns(data.cell_data) {
        match column {
            Column::Scalar(array) if array.integer => {
                let bytes = all_values(array).flat_map(|v| (v as i64).to_le_bytes());
                out.array("Int64", &array.name, 1, &bytes.collect::<Vec<u8>>());
            }
            Column::Scalar(array) => out.reals(&array.name, 1, all_values(array)),
            Column::Vector(name, [x, y, z]) => {
                let yz = all_values(y).zip(all_values(z));
                out.reals(name, 3, all_values(x).zip(yz).flat_map(|(x, (y, z))| [x, y, z]));
            }
        }
    }
    for group in data.groups {
        out.array("UInt8", &array_name(group), 1, &cell_mask(group, data.mesh));
    }
    out.xml.push_str("</CellData>\n<Points>\n");
    out.reals("Points", 3, data.points.iter().flat_map(|p| p.to_array()));
    out.xml.push_str("</Points>\n<Cells>\n");
    let mut bytes = Vec::new();
    for cell in data.cells() {
        cell.iter().for_each(|&v| bytes.extend(i64::from(v).to_le_bytes()));
    }
    out.array("Int64", "connectivity", 1, &bytes);
    let mut end = 0;
    let ends = data.cells().flat_map(|cell| {
        end += cell.len() as i64;
        end.to_le_bytes()
    });
    out.array("Int64", "offsets", 1, &ends.collect::<Vec<u8>>());
    out.array("UInt8", "types", 1, &data.cell_types().collect::<Vec<u8>>());
    out.xml.push_str("</Cells>\n</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_");
    let mut bytes = out.xml.into_bytes();
    bytes.extend_from_slice(&out.raw);
    bytes.extend_from_slice(b"\n</AppendedData>\n</VTKFile>\n");
    Ok(bytes)
}

struct Output {
    xml: String,
    raw: Vec<u8>,
    single: bool,
}

impl Output {
    fn array(&mut self, kind: &str, name: &str, components: usize, bytes: &[u8]) {
        let name = escape(name);
        let offset = self.raw.len();
        let _ = writeln!(
            self.xml,
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" \
             format=\"appended\" offset=\"{offset}\"/>"
        );
        self.raw.extend_from_slice(&(bytes.len() as u64).to_le_bytes());
        self.raw.extend_from_slice(bytes);
    }

    fn reals(&mut self, name: &str, components: usize, values: impl Iterator<Item = f64>) {
        if self.single {
            let bytes: Vec<u8> = values.flat_map(|v| (v as f32).to_le_bytes()).collect();
            self.array("Float32", name, components, &bytes);
        } else {
            let bytes: Vec<u8> = values.flat_map(f64::to_le_bytes).collect();
            self.array("Float64", name, components, &bytes);
        }
    }
}

/// Text for an attribute; control characters, which XML forbids, become spaces.
fn escape(text: &str) -> String {
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    quick_xml::escape::escape(text).into_owned()
}

/// Writes the index of a time series: for each step its time (s) and its file, relative to the index.
///
/// # Errors
///
/// [`MeshError::Io`] when the file cannot be written.
pub fn write_pvd(path: &Path, steps: &[(f64, String)]) -> Result<(), MeshError> {
    let mut xml = String::from(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n<Collection>\n",
    );
    for (time, file) in steps {
        let _ =
            writeln!(xml, "<DataSet timestep=\"{time:?}\" part=\"0\" file=\"{}\"/>", escape(file));
    }
    xml.push_str("</Collection>\n</VTKFile>\n");
    super::super::write_file(path, xml.as_bytes())
}
