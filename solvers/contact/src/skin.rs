//! Contact surfaces of bodies: areas and stiffness of points, and the boxes of the broad phase.

use glam::DVec3;
use sinew_engine::row::VertexRow;
use sinew_engine::surface::BodySurface;

/// Vertices per box of the broad phase. Vertex order is local, so a block is a patch.
const BLOCK: usize = 64;

/// The contact surface of a body, or the part of it that a tool may touch.
#[derive(Clone, Debug, Default)]
pub(crate) struct ContactSkin {
    /// Vertex rows of the world, ascending.
    pub rows: Vec<VertexRow>,
    /// A third of the rest areas (m^2) of the faces round each.
    pub area: Vec<f64>,
    /// Young's modulus (Pa) there.
    pub young: Vec<f64>,
    /// Triangles, as places in `rows`; outward, but for those of membranes.
    pub faces: Vec<[u32; 3]>,
    /// Their rest areas (m^2).
    pub face_area: Vec<f64>,
    /// Faces from here on are membranes, which have two sides.
    pub sheets: usize,
    /// Mean edge (m) of the faces at rest.
    pub edge: f64,
    /// Places (m) of the vertices at the start of the step.
    pub at: Vec<DVec3>,
    /// Outward unit normals there; zero at vertices of membranes.
    pub normals: Vec<DVec3>,
    /// How far (m) each may come in the step.
    pub way: Vec<f64>,
    /// Boxes of blocks, grown by that.
    boxes: Vec<[DVec3; 2]>,
    /// The box of all.
    pub hull: [DVec3; 2],
}

impl ContactSkin {
    /// Of a body whose first vertex row is `first`; `rest` are the rest positions (m) of all rows. With `only`,
    /// triangles of world rows, of those of them that belong to the body.
    pub fn new(
        surface: &BodySurface,
        first: VertexRow,
        rest: &[DVec3],
        only: Option<&[[VertexRow; 3]]>,
    ) -> Self {
        let world = |t: &[u32; 3]| t.map(|v| VertexRow(v + first.0));
        let sorted = |mut t: [VertexRow; 3]| {
            t.sort_unstable();
            t
        };
        let mut faces: Vec<[VertexRow; 3]> = surface.triangles.iter().map(world).collect();
        let mut solid: Vec<[VertexRow; 3]> = faces.iter().map(|t| sorted(*t)).collect();
        solid.sort_unstable();
        let mut sheets = faces.len();
        // a membrane that covers a solid is touched as the solid is
        let bare = |t: &[VertexRow; 3]| solid.binary_search(&sorted(*t)).is_err();
        faces.extend(surface.sheets.iter().map(world).filter(bare));
        if let Some(only) = only {
            let mut wanted: Vec<[VertexRow; 3]> = only.iter().map(|t| sorted(*t)).collect();
            wanted.sort_unstable();
            let keep = |t: &[VertexRow; 3]| wanted.binary_search(&sorted(*t)).is_ok();
            sheets = faces[..sheets].iter().filter(|t| keep(t)).count();
            faces.retain(keep);
        }
        let mut rows: Vec<VertexRow> = faces.iter().flatten().copied().collect();
        rows.sort_unstable();
        rows.dedup();
        let mut skin = Self { sheets, ..Self::default() };
        let place = |row| rows.binary_search(&row).unwrap_or(0) as u32;
        skin.area = vec![0.0; rows.len()];
        let mut length = 0.0;
        for face in &faces {
            let [a, b, c] = face.map(|row| rest[row.index()]);
            let area = 0.5 * (b - a).cross(c - a).length();
            length += a.distance(b) + b.distance(c) + c.distance(a);
            let local = face.map(place);
            for v in local {
                skin.area[v as usize] += area / 3.0;
            }
            skin.faces.push(local);
            skin.face_area.push(area);
        }
        skin.edge = if faces.is_empty() { 0.0 } else { length / (3 * faces.len()) as f64 };
        skin.young = rows
            .iter()
            .map(|row| {
                surface.young_modulus.get((row.0 - first.0) as usize).copied().unwrap_or(0.0)
            })
            .collect();
        skin.rows = rows;
        skin
    }

    /// Takes the places (m) at the start of a step of `dt` (s), and velocities (m/s), of all rows.
    pub fn refit(
        &mut self,
        dt: f64,
        x: &dyn Fn(VertexRow) -> DVec3,
        v: &dyn Fn(VertexRow) -> DVec3,
    ) {
        self.at.clear();
        self.at.extend(self.rows.iter().map(|&row| x(row)));
        self.way.clear();
        // forces of the step change the speed that it begins with
        let way = |&row: &VertexRow| 1.5 * v(row).length() * dt + 0.25 * self.edge;
        self.way.extend(self.rows.iter().map(way));
        self.boxes.clear();
        self.normals.clear();
        self.hull = EMPTY;
        for (at, way) in self.at.chunks(BLOCK).zip(self.way.chunks(BLOCK)) {
            let mut own = EMPTY;
            for (x, way) in at.iter().zip(way) {
                own = [own[0].min(*x - *way), own[1].max(*x + *way)];
            }
            self.hull = [self.hull[0].min(own[0]), self.hull[1].max(own[1])];
            self.boxes.push(own);
        }
    }

    /// Area normal (m^2) of a face at the start of the step.
    fn area_normal(&self, face: usize) -> DVec3 {
        let [a, b, c] = self.faces[face].map(|v| self.at[v as usize]);
        0.5 * (b - a).cross(c - a)
    }

    /// Outward unit normal of a face at the start of the step; zero for a membrane.
    pub fn outward(&self, face: usize) -> DVec3 {
        if face < self.sheets { self.area_normal(face).normalize_or_zero() } else { DVec3::ZERO }
    }

    /// Finds the normals of the vertices, where something is near.
    pub fn find_normals(&mut self) {
        let mut normals = vec![DVec3::ZERO; self.rows.len()];
        for face in 0..self.sheets {
            let normal = self.area_normal(face);
            for &v in &self.faces[face] {
                normals[v as usize] += normal;
            }
        }
        self.normals = normals.into_iter().map(DVec3::normalize_or_zero).collect();
    }

    /// Calls `f` with the places in `rows` of all vertices whose blocks reach into a box.
    pub fn near(&self, of: &[DVec3; 2], mut f: impl FnMut(usize)) {
        if !overlap(&self.hull, of) {
            return;
        }
        for (block, own) in self.boxes.iter().enumerate() {
            if overlap(own, of) {
                let end = ((block + 1) * BLOCK).min(self.rows.len());
                (block * BLOCK..end).for_each(&mut f);
            }
        }
    }

    /// Mean of a vertex column over a face.
    pub fn mean(&self, column: &[f64], face: usize) -> f64 {
        self.faces[face].iter().map(|&v| column[v as usize]).sum::<f64>() / 3.0
    }
}

/// A box that holds nothing.
pub(crate) const EMPTY: [DVec3; 2] = [DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY)];

/// Whether two boxes have a point in common.
pub(crate) fn overlap(a: &[DVec3; 2], b: &[DVec3; 2]) -> bool {
    a[0].cmple(b[1]).all() && b[0].cmple(a[1]).all()
}

/// A box grown on all sides.
pub(crate) fn grown([low, high]: [DVec3; 2], by: f64) -> [DVec3; 2] {
    [low - by, high + by]
}

/// Barycentric coordinates of the points `faces(n)` of a triangle: centres of `n^2` equal triangles, for 2 the three
/// Gauss points of second order.
pub(crate) fn face_points(n: u32) -> Vec<[f64; 3]> {
    if n == 2 {
        let (a, b) = (2.0 / 3.0, 1.0 / 6.0);
        return vec![[a, b, b], [b, a, b], [b, b, a]];
    }
    let mut points = Vec::new();
    let size = 3.0 * f64::from(n);
    for i in 0..n {
        for j in 0..n - i {
            let mut add = |third: f64| {
                let (a, b) =
                    ((3.0 * f64::from(i) + third) / size, (3.0 * f64::from(j) + third) / size);
                points.push([1.0 - a - b, a, b]);
            };
            add(1.0);
            if i + j + 1 < n {
                add(2.0);
            }
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_on_faces_integrate_linear_fields() {
        for n in 2..=8 {
            let points = face_points(n);
            assert_eq!(points.len(), if n == 2 { 3 } else { (n * n) as usize });
            for k in 0..3 {
                let mean = points.iter().map(|w| w[k]).sum::<f64>() / points.len() as f64;
                assert!((mean - 1.0 / 3.0).abs() < 1e-15);
            }
            assert!(points.iter().all(|w| (w.iter().sum::<f64>() - 1.0).abs() < 1e-15));
        }
    }

    #[test]
    fn areas_add_up_and_a_covered_membrane_counts_once() {
        let rest =
            [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::X + DVec3::Y, DVec3::new(0.5, 0.5, -1.0)];
        let surface = BodySurface {
            triangles: vec![[0, 1, 2], [1, 3, 2]],
            sheets: vec![[2, 1, 0], [0, 1, 4]],
            young_modulus: vec![1.0; 5],
        };
        let skin = ContactSkin::new(&surface, VertexRow(0), &rest, None);
        assert_eq!((skin.faces.len(), skin.sheets), (3, 2));
        let total: f64 = skin.area.iter().sum();
        assert!((total - skin.face_area.iter().sum::<f64>()).abs() < 1e-15);
        let only =
            ContactSkin::new(&surface, VertexRow(0), &rest, Some(&[[2, 3, 1].map(VertexRow)]));
        assert_eq!((only.rows.len(), only.faces.len(), only.sheets), (3, 1, 1));
        assert!((only.area[0] - 1.0 / 6.0).abs() < 1e-15);
    }
}
