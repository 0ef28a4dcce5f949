//! Meshes.

use crate::engine::{read_only, rows3};
use crate::error::raise;
use crate::input::{Floats, Indices};
use numpy::prelude::*;
use numpy::{PyArray1, PyArrayDyn};
use pyo3::prelude::*;
use sinew_embed::{
    MeshArrays, mesh_cell_data, mesh_from_arrays, mesh_from_bytes, mesh_from_file,
    mesh_from_generator, mesh_select,
};
use std::sync::Arc;

/// A mesh.
#[pyclass(frozen, module = "sinew._native")]
pub struct Mesh(pub Arc<sinew_embed::Mesh>);

impl From<sinew_embed::Mesh> for Mesh {
    fn from(mesh: sinew_embed::Mesh) -> Self {
        Self(Arc::new(mesh))
    }
}

/// Cells as an array of shape (m, N).
fn cells<'py, const N: usize>(py: Python<'py>, list: &[[u32; N]]) -> PyResult<Bound<'py, PyAny>> {
    let flat = PyArray1::from_vec(py, list.as_flattened().to_vec());
    read_only(flat.reshape([list.len(), N])?.cast_into::<PyArrayDyn<u32>>()?)
}

#[pymethods]
impl Mesh {
    /// From flat arrays; groups by names and vertices.
    #[staticmethod]
    fn of_arrays(
        py: Python<'_>,
        points: Floats,
        cells: [Indices; 4],
        groups: Vec<(String, Indices)>,
    ) -> PyResult<Self> {
        let mesh = py.detach(|| {
            let [tetrahedra, hexahedra, triangles, quads] = &cells;
            let groups: Vec<(&str, &[u32])> =
                groups.iter().map(|(name, list)| (name.as_str(), list.0.as_slice())).collect();
            mesh_from_arrays(&MeshArrays {
                points: &points.0,
                tetrahedra: &tetrahedra.0,
                hexahedra: &hexahedra.0,
                triangles: &triangles.0,
                quads: &quads.0,
                groups: &groups,
            })
        });
        mesh.map(Self::from).map_err(raise)
    }

    /// From a file.
    #[staticmethod]
    fn of_file(py: Python<'_>, path: &str) -> PyResult<Self> {
        py.detach(|| mesh_from_file(path)).map(Self::from).map_err(raise)
    }

    /// From the bytes of a file.
    #[staticmethod]
    fn of_bytes(py: Python<'_>, name: &str, bytes: &[u8]) -> PyResult<Self> {
        py.detach(|| mesh_from_bytes(name, bytes)).map(Self::from).map_err(raise)
    }

    /// From a table as below `generate` of a scene.
    #[staticmethod]
    fn of_generator(py: Python<'_>, toml: &str) -> PyResult<Self> {
        py.detach(|| mesh_from_generator(toml)).map(Self::from).map_err(raise)
    }

    /// Where it comes from.
    #[getter]
    fn source(&self) -> &str {
        &self.0.source
    }

    /// Coordinates (m).
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let points = self.0.points.iter().flat_map(|x| x.to_array()).collect();
        read_only(rows3(py, points)?.cast_into::<PyArrayDyn<f64>>()?)
    }

    /// Tetrahedra, hexahedra, triangles, quadrilaterals.
    fn cells<'py>(&self, py: Python<'py>) -> PyResult<[Bound<'py, PyAny>; 4]> {
        Ok([
            cells(py, &self.0.tetrahedra)?,
            cells(py, &self.0.hexahedra)?,
            cells(py, &self.0.triangles)?,
            cells(py, &self.0.quads)?,
        ])
    }

    /// Numbers of points, tetrahedra, hexahedra, triangles and quadrilaterals.
    #[getter]
    fn counts(&self) -> [usize; 5] {
        let Self(mesh) = self;
        let cells = [mesh.tetrahedra.len(), mesh.hexahedra.len()];
        [mesh.points.len(), cells[0], cells[1], mesh.triangles.len(), mesh.quads.len()]
    }

    /// Names and numbers of cell data.
    fn cell_data<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Vec<(String, Bound<'py, PyArray1<f64>>)>> {
        let names = self.0.cell_data.iter().map(|data| data.name.clone());
        names
            .map(|name| {
                let values = mesh_cell_data(&self.0, &name).map_err(raise)?;
                Ok((name, PyArray1::from_vec(py, values)))
            })
            .collect()
    }

    /// Vertices by a table as below `select` of a scene.
    fn select<'py>(&self, py: Python<'py>, toml: &str) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let found = py.detach(|| mesh_select(&self.0, toml)).map_err(raise)?;
        Ok(PyArray1::from_vec(py, found))
    }

    /// Names and vertices of groups.
    fn groups<'py>(&self, py: Python<'py>) -> Vec<(String, Bound<'py, PyArray1<u32>>)> {
        let vertices = |list: &Vec<u32>| PyArray1::from_vec(py, list.clone());
        self.0.groups.iter().map(|group| (group.name.clone(), vertices(&group.vertices))).collect()
    }
}
