//! Meshes whose tetrahedra have a vertex on every edge.

use super::cell::{second_order_triangles, ten};
use super::{Group, LINEAR, Mesh};
use crate::element_kind::ByKind;
use crate::isoparametric::{
    MIDDLES, TETRAHEDRON_POINTS, folded_tetrahedron, tetrahedron10_derivatives,
};
use crate::surface::closest_point;
use glam::DVec3;
use serde::Serialize;
use std::collections::{BTreeMap, HashMap};

/// What became of the vertices on edges of the surface that were put on another one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PutOnSurface {
    /// Vertices that lie on it now.
    pub moved: usize,
    /// Vertices that stayed, because it is farther away than a quarter of their edge.
    pub far: usize,
    /// Vertices that stayed, because an element would have folded.
    pub folded: usize,
    /// Longest way (m) of a vertex.
    pub largest: f64,
}

impl Mesh {
    /// Whether its tetrahedra have a vertex on every edge.
    pub fn is_second_order(&self) -> bool {
        !self.middles.is_empty()
    }

    /// All vertices of a tetrahedron of a mesh of second order: corners, then those on the edges.
    pub fn second_order(&self, tetrahedron: usize) -> Option<[u32; 10]> {
        let middles = self.middles.get(tetrahedron).filter(|middles| **middles != LINEAR)?;
        Some(ten(*self.tetrahedra.get(tetrahedron)?, *middles))
    }

    /// Signed volume (m^3) of a tetrahedron of either order, curved ones as their elements have it: by four points, which is
    /// exact where edges are straight. `None` when an index is out of range.
    pub fn tetrahedron_volume(&self, tetrahedron: usize) -> Option<f64> {
        let Some(vertices) = self.second_order(tetrahedron) else {
            return self.signed_volume(*self.tetrahedra.get(tetrahedron)?);
        };
        let mut points = [DVec3::ZERO; 10];
        for (point, v) in points.iter_mut().zip(vertices) {
            *point = *self.points.get(v as usize)?;
        }
        let at = |l: [f64; 4]| {
            let mut edges = [DVec3::ZERO; 3];
            for (d, p) in tetrahedron10_derivatives(l).iter().zip(&points) {
                for j in 0..3 {
                    edges[j] += d[j] * (*p - points[0]);
                }
            }
            edges[0].dot(edges[1].cross(edges[2]))
        };
        Some(TETRAHEDRON_POINTS.into_iter().map(at).sum::<f64>() / 24.0)
    }

    /// The mesh with a vertex in the middle of every edge of a tetrahedron, behind those that it has, and four triangles for each
    /// one; unchanged if it is of second order already.
    ///
    /// Edges stay straight. Groups get the new vertices on the edges of their cells, a group of points those of triangles
    /// all of whose corners it has, and one of lines those between two of its points. Cell data of triangles go to the parts.
    /// Hexahedra and quadrilaterals stay as they are.
    ///
    /// ```
    /// use glam::DVec3;
    /// use sinew_engine::mesh::generate::box_tets;
    ///
    /// let linear = box_tets(DVec3::ONE, [1, 1, 1])?;
    /// let mesh = linear.with_second_order();
    /// assert_eq!((linear.points.len(), mesh.points.len()), (8, 27));
    /// assert_eq!((mesh.tetrahedra.len(), mesh.middles.len(), mesh.triangles.len()), (6, 6, 48));
    /// assert!((mesh.total_volume() - 1.0).abs() < 1e-14);
    /// # Ok::<(), sinew_engine::mesh::MeshError>(())
    /// ```
    pub fn with_second_order(&self) -> Mesh {
        let mut mesh = self.clone();
        if self.tetrahedra.is_empty() || self.is_second_order() {
            return mesh;
        }
        let mut known: HashMap<[u32; 2], u32> = HashMap::new();
        let points = &mut mesh.points;
        let mut middle = |a: u32, b: u32| {
            *known.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                // an index out of range is a finding of the check, which names it
                let at = |v: u32| self.points.get(v as usize).copied().unwrap_or(DVec3::NAN);
                points.push(0.5 * (at(a.min(b)) + at(a.max(b))));
                (points.len() - 1) as u32
            })
        };
        let edges = |t: &[u32; 4]| MIDDLES.map(|[a, b]| [t[a], t[b]]);
        mesh.middles = Vec::with_capacity(self.tetrahedra.len());
        for t in &self.tetrahedra {
            mesh.middles.push(edges(t).map(|[a, b]| middle(a, b)));
        }
        let parts = |&[a, b, c]: &[u32; 3], middle: &mut dyn FnMut(u32, u32) -> u32| {
            second_order_triangles([a, b, c, middle(a, b), middle(b, c), middle(c, a)])
        };
        mesh.triangles = self.triangles.iter().flat_map(|t| parts(t, &mut middle)).collect();
        let surface = self.surface_triangles();
        for group in &mut mesh.groups {
            let Group { dimension, vertices, cells, .. } = group;
            let ByKind { tetrahedra, triangles, .. } = cells;
            let corners = std::mem::take(vertices);
            vertices.clone_from(&corners);
            let has = |v: &u32| corners.binary_search(v).is_ok();
            let mut add = |[a, b]: [u32; 2]| vertices.extend(known.get(&[a.min(b), a.max(b)]));
            let round = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]];
            let own = tetrahedra.iter().filter_map(|&t| self.tetrahedra.get(t as usize));
            own.flat_map(edges).for_each(&mut add);
            let own = triangles.iter().filter_map(|&t| self.triangles.get(t as usize));
            own.flat_map(round).for_each(&mut add);
            if *dimension == 0 {
                let inside = surface.iter().filter(|t| t.iter().all(has));
                inside.flat_map(round).for_each(&mut add);
            } else if *dimension == 1 {
                let inside = surface.iter().flat_map(round).filter(|edge| edge.iter().all(has));
                inside.for_each(&mut add);
            }
            vertices.sort_unstable();
            vertices.dedup();
            let cut = std::mem::take(triangles);
            triangles.extend(cut.into_iter().flat_map(|t| (0..4).map(move |i| 4 * t + i)));
        }
        for data in &mut mesh.cell_data {
            let values = std::mem::take(&mut data.values.triangles);
            data.values.triangles = values.into_iter().flat_map(|value| [value; 4]).collect();
        }
        let lines = std::mem::take(&mut mesh.lines.cells.triangles);
        mesh.lines.cells.triangles = lines.into_iter().flat_map(|line| [line; 4]).collect();
        // the new vertices stand on no line
        mesh.lines.points.clear();
        mesh
    }

    /// Puts the vertices on the edges of the surface of a mesh of second order on the nearest points of a finer surface, that of
    /// `onto`, so that elements are curved as the body is. Corners stay.
    ///
    /// A vertex stays in the middle where the surface is farther away than a quarter of its edge, and where an element would
    /// fold.
    pub fn put_middles_on(&mut self, onto: &Mesh) -> PutOnSurface {
        let on_surface = self.surface_triangles();
        let mut edges: BTreeMap<u32, [u32; 2]> = BTreeMap::new();
        for (t, middles) in self.tetrahedra.iter().zip(&self.middles) {
            for (&middle, [a, b]) in middles.iter().zip(MIDDLES) {
                edges.insert(middle, [t[a], t[b]]);
            }
        }
        let triangles: Vec<([DVec3; 3], DVec3, f64)> = onto
            .surface_triangles()
            .iter()
            .map(|t| {
                let corners = t.map(|v| onto.points[v as usize]);
                let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
                (corners, centre, corners.iter().map(|x| x.distance(centre)).fold(0.0, f64::max))
            })
            .collect();
        let mut done = PutOnSurface::default();
        let mut moved: BTreeMap<u32, DVec3> = BTreeMap::new();
        let mut own: Vec<u32> = on_surface.into_iter().flatten().collect();
        own.sort_unstable();
        own.dedup();
        for (v, [a, b]) in own.into_iter().filter_map(|v| Some((v, *edges.get(&v)?))) {
            let [x, a, b] = [v, a, b].map(|v| self.points[v as usize]);
            let (mut nearest, mut way) = (x, 0.25 * a.distance(b));
            let mut found = false;
            for (corners, centre, radius) in &triangles {
                if x.distance(*centre) - radius > way {
                    continue;
                }
                let w = closest_point(x, *corners);
                let at: DVec3 = (0..3).map(|k| w[k] * corners[k]).sum();
                if at.distance(x) <= way {
                    (nearest, way, found) = (at, at.distance(x), true);
                }
            }
            if found {
                moved.insert(v, std::mem::replace(&mut self.points[v as usize], nearest));
            } else {
                done.far += 1;
            }
        }
        // one that goes back may fold a neighbour: until none does
        loop {
            let folds = |i: &usize| {
                let vertices = self.second_order(*i);
                let points = vertices.map(|ten| ten.map(|v| self.points[v as usize].to_array()));
                points.is_some_and(|points| folded_tetrahedron(&points).is_some())
            };
            let folded = (0..self.tetrahedra.len()).filter(folds);
            let back: Vec<u32> = folded.flat_map(|i| self.middles[i]).collect();
            let before = done.folded;
            for v in back {
                if let Some(x) = moved.remove(&v) {
                    self.points[v as usize] = x;
                    done.folded += 1;
                }
            }
            if done.folded == before {
                break;
            }
        }
        let way = |(v, x): (&u32, &DVec3)| self.points[*v as usize].distance(*x);
        done.largest = moved.iter().map(way).fold(0.0, f64::max);
        done.moved = moved.len();
        done
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::generate::box_tets;
    use crate::mesh::{CheckOptions, FindingCode, check, enclosed_volume};

    #[test]
    fn surface_and_groups_follow() {
        let mesh = box_tets(DVec3::new(2.0, 1.0, 1.0), [2, 1, 1]).unwrap().with_second_order();
        let surface = mesh.surface_triangles();
        assert_eq!(surface.len(), 4 * 20);
        assert!((enclosed_volume(&mesh.points, &surface) - 2.0).abs() < 1e-14);
        let end = mesh.group("x1").unwrap();
        assert_eq!((end.vertices.len(), end.cells.triangles.len()), (9, 8));
        assert!(end.vertices.iter().all(|&v| mesh.points[v as usize].x == 2.0));
        for &t in &end.cells.triangles {
            let corners = mesh.triangles[t as usize];
            assert!(corners.iter().all(|v| end.vertices.binary_search(v).is_ok()));
        }
        assert_eq!(mesh.with_second_order(), mesh);
        let mut edges = mesh.edges();
        edges.sort_unstable();
        edges.dedup();
        // 12 + 4 outer, 2 x 5 + ... every edge of the linear mesh in two halves
        let mut linear = box_tets(DVec3::ONE, [2, 1, 1]).unwrap().edges();
        linear.sort_unstable();
        linear.dedup();
        assert_eq!(edges.len(), 2 * linear.len());
    }

    #[test]
    fn inverted_and_folded_cells_are_found() {
        let sound = box_tets(DVec3::splat(0.1), [1, 1, 1]).unwrap().with_second_order();
        let report = check(&sound, &CheckOptions::default()).unwrap().report;
        assert!(report.findings.is_empty(), "{report}");
        assert_eq!(report.statistics.used_vertices, 27);
        // turned round, and turned back by the check
        let mut turned = sound.clone();
        turned.tetrahedra[2].swap(2, 3);
        turned.middles[2] = super::super::cell::mirrored_middles(turned.middles[2]);
        let checked = check(&turned, &CheckOptions::default()).unwrap();
        assert!(checked.report.finding(FindingCode::InvertedWinding).is_some());
        assert_eq!(checked.mesh.middles, sound.middles);
        // the order of Gmsh taken for that of VTK
        let mut wrong = sound.clone();
        wrong.middles[1].swap(4, 5);
        let error = check(&wrong, &CheckOptions::default()).unwrap_err();
        let finding = error.report.finding(FindingCode::NonConvexCell).unwrap();
        assert!(finding.entity.starts_with("tetrahedron 1 "), "{finding}");
        // a vertex of an edge pushed through the cell
        let mut pushed = sound.clone();
        let [a, b] = [0, 1].map(|i| sound.points[sound.tetrahedra[3][i] as usize]);
        pushed.points[sound.middles[3][0] as usize] = a + 0.1 * (b - a);
        let error = check(&pushed, &CheckOptions::default()).unwrap_err();
        assert!(error.to_string().contains("tetrahedron 3 "), "{error}");
        // both orders in one mesh
        let mut mixed = sound.clone();
        mixed.middles.pop();
        let error = check(&mixed, &CheckOptions::default()).unwrap_err();
        assert!(error.report.finding(FindingCode::MixedOrder).is_some(), "{error}");
    }

    #[test]
    fn middles_are_put_on_a_finer_surface() {
        let ball = |shells| crate::mesh::generate::sphere_tets(0.05, shells).unwrap();
        let (coarse, fine) = (ball(2), ball(16));
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.05_f64.powi(3);
        let mut mesh = coarse.with_second_order();
        let done = mesh.put_middles_on(&fine);
        assert!(done.moved > 40 && done.folded == 0 && done.far == 0, "{done:?}");
        // corners stay, what moved lies on the ball, the volume is that of the ball to a part of what was missing
        assert_eq!(mesh.points[..coarse.points.len()], coarse.points[..]);
        let missing = |mesh: &Mesh| 1.0 - mesh.total_volume() / exact;
        assert!(missing(&mesh).abs() < 0.1 * missing(&coarse), "{}", missing(&mesh));
        assert!(check(&mesh, &CheckOptions::default()).is_ok());
        // a surface that is nowhere near leaves everything as it is
        let mut mesh = coarse.with_second_order();
        let mut away = fine;
        away.points.iter_mut().for_each(|x| x.x += 1.0);
        let done = mesh.put_middles_on(&away);
        assert_eq!((done.moved, mesh), (0, coarse.with_second_order()));
    }

    #[test]
    fn what_would_fold_stays() {
        // a surface that turns a slim element inside out within a quarter of its edges
        let mut linear = box_tets(DVec3::new(1.0, 1.0, 0.1), [1, 1, 1]).unwrap();
        linear.groups.clear();
        let mut onto = box_tets(DVec3::new(1.0, 1.0, 0.1), [4, 4, 1]).unwrap();
        for x in onto.points.iter_mut().filter(|x| x.z > 0.05) {
            x.z = -0.05;
        }
        let mut mesh = linear.with_second_order();
        let done = mesh.put_middles_on(&onto);
        assert!(done.folded > 0, "{done:?}");
        assert!(check(&mesh, &CheckOptions::default()).is_ok());
    }
}
