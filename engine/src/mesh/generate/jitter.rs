//! Meshes with vertices moved at random, and cells cut at random.

use super::box_hexahedra;
use crate::mesh::Mesh;
use crate::mesh::cell::{corner_jacobian, determinant, for_equal_cells};
use crate::mesh::error::MeshError;
use crate::mesh::split::pulled_tetrahedra;
use glam::DVec3;

/// The splitmix64 sequence of random numbers.
struct SplitMix(u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in -1 to 1.
    fn signed(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

fn fraction_between_0_and_1(generator: &'static str, fraction: f64) -> Result<(), MeshError> {
    if (0.0..=1.0).contains(&fraction) {
        return Ok(());
    }
    Err(MeshError::InvalidParameter {
        generator,
        parameter: "fraction",
        value: fraction.to_string(),
        remedy: "give a fraction of the edge length between 0 and 1",
    })
}

/// Sizes that a move may not shrink to less than a tenth: the volume of a tetrahedron, the Jacobian
/// determinants at the corners of a hexahedron, and the vector area of a triangle or of the corners
/// of a quadrilateral; volumes stand in the first component.
struct Sizes {
    list: [DVec3; 8],
    count: usize,
}

impl Sizes {
    fn of(points: &[DVec3], cell: &[u32], solid: bool) -> Sizes {
        let p = |i: usize| points[cell[i] as usize];
        let mut list = [DVec3::ZERO; 8];
        let count = match (cell.len(), solid) {
            (8, _) => {
                let corners = std::array::from_fn(p);
                for (corner, size) in list.iter_mut().enumerate() {
                    size.x = determinant(corner_jacobian(&corners, corner));
                }
                8
            }
            (4, true) => {
                list[0].x = determinant([p(1) - p(0), p(2) - p(0), p(3) - p(0)]);
                1
            }
            (4, false) => {
                for (i, size) in list.iter_mut().enumerate().take(4) {
                    *size = (p((i + 1) % 4) - p(i)).cross(p((i + 3) % 4) - p(i));
                }
                4
            }
            _ => {
                list[0] = (p(1) - p(0)).cross(p(2) - p(0));
                1
            }
        };
        Sizes { list, count }
    }

    fn kept(&self, before: &Sizes) -> bool {
        let pairs = self.list.iter().zip(&before.list).take(self.count);
        pairs.into_iter().all(|(now, before)| now.dot(*before) >= 0.1 * before.length_squared())
    }
}

/// The mesh with every interior vertex moved at random, by at most `fraction` (0 to 1) of its shortest
/// edge along each axis; the same `seed` gives the same mesh.
///
/// A move that would leave a cell, or a corner of a hexahedron or quadrilateral, less than a tenth of
/// its volume or area is halved, up to eight times, and then left out. In a mesh without volumes,
/// vertices move in the plane of their faces.
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] when `fraction` is not between 0 and 1.
pub fn jitter_interior(mesh: &Mesh, fraction: f64, seed: u64) -> Result<Mesh, MeshError> {
    fraction_between_0_and_1("jitter_interior", fraction)?;
    let n = mesh.points.len();
    let solid = mesh.is_solid();
    let inside = |cell: &&[u32]| cell.iter().all(|&v| (v as usize) < n);
    let cells: Vec<&[u32]> = if solid {
        let hexes = mesh.hexahedra.iter().map(|c| c.as_slice());
        mesh.tetrahedra.iter().map(|c| c.as_slice()).chain(hexes).filter(inside).collect()
    } else {
        let quads = mesh.quads.iter().map(|c| c.as_slice());
        mesh.triangles.iter().map(|c| c.as_slice()).chain(quads).filter(inside).collect()
    };
    let mut interior = vec![false; n];
    let mut cells_of: Vec<Vec<u32>> = vec![Vec::new(); n];
    for (i, cell) in cells.iter().enumerate() {
        for &v in *cell {
            interior[v as usize] = true;
            cells_of[v as usize].push(i as u32);
        }
    }
    if solid {
        let surface = mesh.surface();
        let quads = surface.quads.iter().flatten();
        for &v in surface.triangles.iter().flatten().chain(quads) {
            interior[v as usize] = false;
        }
    } else {
        let sides = |cell: &[u32]| {
            let n = cell.len();
            (0..n).map(|i| [cell[i], cell[(i + 1) % n]]).collect::<Vec<_>>()
        };
        let edges: Vec<[u32; 2]> = cells.iter().flat_map(|cell| sides(cell)).collect();
        for_equal_cells(&edges, n, |equal| {
            if let &[([a, b], _)] = equal {
                interior[a as usize] = false;
                interior[b as usize] = false;
            }
        });
    }

    let mut jittered = mesh.clone();
    let points = &mut jittered.points;
    let mut random = SplitMix(seed);
    for v in (0..n).filter(|&v| interior[v]) {
        let here = points[v];
        let mut shortest = f64::INFINITY;
        let mut normal = DVec3::ZERO;
        let mut before = Vec::new();
        for &cell in &cells_of[v] {
            let cell = cells[cell as usize];
            for &other in cell.iter().filter(|&&other| other as usize != v) {
                shortest = shortest.min((points[other as usize] - here).length());
            }
            let sizes = Sizes::of(points, cell, solid);
            if !solid {
                normal += sizes.list.iter().sum::<DVec3>();
            }
            before.push(sizes);
        }
        let random = DVec3::new(random.signed(), random.signed(), random.signed());
        let mut step = random * (fraction * shortest);
        step -= step.project_onto_normalized(normal.try_normalize().unwrap_or(DVec3::ZERO));
        for _ in 0..8 {
            points[v] = here + step;
            let kept = cells_of[v]
                .iter()
                .zip(&before)
                .all(|(&cell, before)| Sizes::of(points, cells[cell as usize], solid).kept(before));
            if kept && points[v].is_finite() {
                break;
            }
            points[v] = here;
            step *= 0.5;
        }
    }
    jittered.source = format!("{}, interior moved by {fraction} (seed {seed})", mesh.source);
    Ok(jittered)
}

/// A box of tetrahedra without a preferred direction: every brick is cut into six tetrahedra at
/// random, so that its neighbours fit, and then the interior vertices are moved as
/// [`jitter_interior`] does; the same `seed` gives the same mesh.
///
/// Every vertex draws a priority; each face of a brick is cut along the diagonal from its first
/// vertex, and the brick from its own first vertex. `size` in metres; vertices and groups as those of
/// [`box_tets`](super::box_tets), whose diagonals all point the same way. Large moves give slivers: of
/// 8 x 8 x 8 cells the worst quality over five seeds was 0.57, 0.31, 0.18, 0.05 and 0.007 at a
/// `fraction` of 0, 0.1, 0.15, 0.2 and 0.3.
///
/// ```
/// use glam::DVec3;
/// use sinew_engine::mesh::generate::irregular_box_tets;
///
/// let mesh = irregular_box_tets(DVec3::splat(0.1), [4, 4, 4], 0.3, 1)?;
/// assert_eq!(mesh.tetrahedra.len(), 6 * 64);
/// assert!((mesh.total_volume() - 1e-3).abs() < 1e-16);
/// # Ok::<(), sinew_engine::mesh::MeshError>(())
/// ```
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn irregular_box_tets(
    size: DVec3,
    n: [usize; 3],
    fraction: f64,
    seed: u64,
) -> Result<Mesh, MeshError> {
    const NAME: &str = "irregular_box_tets";
    fraction_between_0_and_1(NAME, fraction)?;
    super::solids::box_counts(NAME, "tetrahedra", size, n, 6)?;
    let mut mesh = box_hexahedra(size, n)?;
    // Another sequence than that of the moves, which start from the seed itself.
    let mut random = SplitMix(!seed);
    let priority: Vec<u64> = mesh.points.iter().map(|_| random.next()).collect();
    let hexahedra = std::mem::take(&mut mesh.hexahedra);
    let cut = |&cell: &[u32; 8]| pulled_tetrahedra(cell, |v| priority[v as usize]);
    mesh.tetrahedra = hexahedra.iter().flat_map(cut).collect();
    super::name_grid_sides(&mut mesh, n);
    let mut mesh = jitter_interior(&mesh, fraction, seed)?;
    let ([x, y, z], [nx, ny, nz]) = (size.to_array(), n);
    mesh.source = format!(
        "{NAME} {x} x {y} x {z} m, {nx} x {ny} x {nz} cells, moved by {fraction} (seed {seed})"
    );
    Ok(mesh)
}
