//! The beams that all engines share.

use crate::toolbox::prelude::*;
use sinew::engine::mesh::generate::box_tets;
use sinew::models::body::Integration;

/// A clamped body under its own weight: a beam, or one of another shape.
#[derive(Clone, Debug)]
pub struct Beam {
    /// Scene in words.
    pub name: String,
    /// Mesh; a beam lies along x from the clamp at x = 0.
    pub mesh: Mesh,
    /// Vertices of the clamp.
    pub fixed: Vec<u32>,
    /// Material.
    pub material: YoungPoisson,
    /// Gravity (m/s^2) against z.
    pub gravity: f64,
    /// How its hexahedra are integrated.
    pub integration: Integration,
}

/// What rivals in other processes read.
#[derive(Serialize)]
pub struct BodyFile<'a> {
    points: Vec<[f64; 3]>,
    tetrahedra: &'a [[u32; 4]],
    fixed: Vec<u32>,
    masses: Vec<f64>,
}

impl<'a> BodyFile<'a> {
    /// A mesh, its density (kg/m^3) and the vertices of its clamp.
    pub fn new(mesh: &'a Mesh, density: f64, fixed: Vec<u32>) -> Self {
        Self {
            points: mesh.points.iter().map(|p| p.to_array()).collect(),
            tetrahedra: &mesh.tetrahedra,
            fixed,
            masses: masses(mesh, density),
        }
    }
}

impl Beam {
    /// 0.4 x 0.1 x 0.1 m, 1 MPa, six tetrahedra per cell: the beam of the MuJoCo rows.
    ///
    /// # Errors
    /// When a number of cells is zero.
    pub fn mujoco(cells: [usize; 3], poisson_ratio: f64) -> Result<Self> {
        let mesh = box_tets(DVec3::new(0.4, 0.1, 0.1), cells)?;
        let material = YoungPoisson { young_modulus: 1e6, poisson_ratio, density: 1000.0 };
        Ok(Self::new("beam 0.4 x 0.1 x 0.1 m", mesh, material, 9.81))
    }

    /// 0.2 x 0.05 x 0.05 m, 300 kPa, five tetrahedra per cell: the beam of the Rapier rows.
    ///
    /// # Errors
    /// When a number of cells is zero.
    pub fn rapier(cells: [usize; 3], poisson_ratio: f64, gravity: f64) -> Result<Self> {
        let mut mesh = box_tets(DVec3::new(0.2, 0.05, 0.05), cells)?;
        mesh.tetrahedra = five_per_cell(cells);
        // faces and groups were those of the other split
        mesh.triangles = mesh.surface_triangles();
        mesh.groups.clear();
        let material = YoungPoisson { young_modulus: 3e5, poisson_ratio, density: 1000.0 };
        Ok(Self::new("beam 0.2 x 0.05 x 0.05 m", mesh, material, gravity))
    }

    fn new(size: &str, mesh: Mesh, material: YoungPoisson, gravity: f64) -> Self {
        let name = format!(
            "{size}, {} tetrahedra, nu {}, g {gravity} m/s^2",
            mesh.tetrahedra.len(),
            material.poisson_ratio
        );
        let (fixed, integration) = (at_zero(&mesh), Integration::default());
        Self { name, fixed, mesh, material, gravity, integration }
    }

    /// Lumped masses (kg): a quarter of each tetrahedron to each of its vertices.
    pub fn masses(&self) -> Vec<f64> {
        masses(&self.mesh, self.material.density)
    }

    /// Mean vertical displacement (m) of the free end.
    pub fn tip(&self, u: &[DVec3]) -> f64 {
        let end = self.mesh.points.iter().map(|p| p.x).fold(f64::NEG_INFINITY, f64::max);
        let (sum, n) = (self.mesh.points.iter().zip(u))
            .filter(|(p, _)| p.x == end)
            .fold((0.0, 0.0), |(sum, n), (_, u)| (sum + u.z, n + 1.0));
        sum / n
    }

    /// The form that rivals in other processes read.
    pub fn file(&self) -> BodyFile<'_> {
        BodyFile::new(&self.mesh, self.material.density, self.fixed.clone())
    }
}

/// Vertices of a mesh at x = 0.
pub fn at_zero(mesh: &Mesh) -> Vec<u32> {
    (0..mesh.points.len() as u32).filter(|&v| mesh.points[v as usize].x == 0.0).collect()
}

/// Lumped masses (kg): a quarter of each tetrahedron to each of its vertices.
pub fn masses(mesh: &Mesh, density: f64) -> Vec<f64> {
    let mut masses = vec![0.0; mesh.points.len()];
    for &tetrahedron in &mesh.tetrahedra {
        let volume = mesh.signed_volume(tetrahedron).unwrap_or(0.0);
        for v in tetrahedron {
            masses[v as usize] += 0.25 * volume * density;
        }
    }
    masses
}

/// Five tetrahedra per cell, mirrored from cell to cell so that faces meet; vertices as in
/// [`box_tets`].
fn five_per_cell([nx, ny, nz]: [usize; 3]) -> Vec<[u32; 4]> {
    let mut result = Vec::with_capacity(5 * nx * ny * nz);
    for i in 0..nx {
        for j in 0..ny {
            for k in 0..nz {
                let odd = (i + j + k) % 2;
                // corner (a, b, c) of the cell, mirrored along x in odd cells
                let v = |[a, b, c]: [usize; 3]| {
                    (((i + (a ^ odd)) * (ny + 1) + j + b) * (nz + 1) + k + c) as u32
                };
                const CORNERS: [[[usize; 3]; 4]; 5] = [
                    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
                    [[1, 1, 0], [0, 1, 0], [1, 0, 0], [1, 1, 1]],
                    [[1, 0, 1], [0, 0, 1], [1, 1, 1], [1, 0, 0]],
                    [[0, 1, 1], [1, 1, 1], [0, 0, 1], [0, 1, 0]],
                    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]],
                ];
                for corners in CORNERS {
                    let [a, b, c, d] = corners.map(v);
                    // mirrored cells wind the other way
                    result.push(if odd == 0 { [a, b, c, d] } else { [a, b, d, c] });
                }
            }
        }
    }
    result
}
