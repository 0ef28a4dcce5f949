//! Vertices that lie at one place become one.

use super::Mesh;
use super::check::places::{build_tree, search_tree};
use crate::element_kind::ElementKind;
use serde::Serialize;

/// Share of the largest extent of a mesh within which vertices are merged where nothing else is said: rounding of single
/// precision.
pub const MERGE_TOLERANCE: f64 = 1e-6;

/// What became of vertices that lie at one place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Merged {
    /// Vertices that were merged into others.
    pub vertices: usize,
    /// Vertices that were left, since merging would have made cells flat.
    pub left: usize,
    /// Distance (m) within which they were looked for.
    pub distance: f64,
}

impl Mesh {
    /// The mesh with vertices merged that lie within `tolerance` times its largest extent of each other, such as those on both
    /// sides of a seam; cells, groups and data keep their order. Vertices of one cell are never merged, and neither are those
    /// that would be merged together with them.
    ///
    /// ```
    /// use glam::DVec3;
    /// use sinew_engine::mesh::generate::box_tets;
    /// use sinew_engine::mesh::merge::MERGE_TOLERANCE;
    ///
    /// let mut mesh = box_tets(DVec3::ONE, [1, 1, 1])?;
    /// // a second box beside it, with vertices of its own
    /// let beside = mesh.clone();
    /// mesh.points.extend(beside.points.iter().map(|p| *p + DVec3::X));
    /// mesh.tetrahedra.extend(beside.tetrahedra.iter().map(|t| t.map(|v| v + 8)));
    /// let (merged, report) = mesh.merged(MERGE_TOLERANCE);
    /// assert_eq!((report.vertices, merged.points.len()), (4, 12));
    /// # Ok::<(), sinew_engine::mesh::MeshError>(())
    /// ```
    pub fn merged(&self, tolerance: f64) -> (Mesh, Merged) {
        let extent = self.bounds().map_or(0.0, |(low, high)| (high - low).max_element());
        let distance = tolerance * extent;
        let mut places = self.places(distance);
        let merged = |places: &[u32]| (0..).zip(places).filter(|(v, place)| v != *place).count();
        let all = merged(&places);
        // places that two vertices of one cell share
        let mut flat = vec![false; self.points.len()];
        for kind in ElementKind::IN_FILES {
            for cell in self.cells(kind) {
                let of = |v: u32| places.get(v as usize).copied();
                for (i, &a) in cell.iter().enumerate() {
                    for &b in cell[i + 1..].iter().filter(|b| **b != a) {
                        if let Some(place) = of(a).filter(|place| of(b) == Some(*place)) {
                            flat[place as usize] = true;
                        }
                    }
                }
            }
        }
        for (v, place) in (0..).zip(&mut places) {
            if flat[*place as usize] {
                *place = v;
            }
        }
        let vertices = merged(&places);
        (self.renumbered(&places), Merged { vertices, left: all - vertices, distance })
    }

    /// The lowest vertex of those that each one hangs together with by steps of at most `distance` (m).
    fn places(&self, distance: f64) -> Vec<u32> {
        let count = self.points.len() as u32;
        let mut order: Vec<u32> =
            (0..count).filter(|&v| self.points[v as usize].is_finite()).collect();
        let mut axes = vec![0; order.len()];
        build_tree(&self.points, &mut order, &mut axes);
        let mut places: Vec<u32> = (0..count).collect();
        let mut seen = vec![false; count as usize];
        for first in 0..count {
            if std::mem::replace(&mut seen[first as usize], true) {
                continue;
            }
            let mut open = vec![first];
            while let Some(v) = open.pop() {
                let p = self.points[v as usize];
                let next = |seen: &[bool]| {
                    let near = |other: u32| {
                        !seen[other as usize] && p.distance(self.points[other as usize]) <= distance
                    };
                    search_tree(&self.points, &order, &axes, p, distance, &near)
                };
                while let Some(other) = next(&seen) {
                    seen[other as usize] = true;
                    places[other as usize] = first;
                    open.push(other);
                }
            }
        }
        places
    }

    /// The mesh without vertices that have another place than themselves.
    fn renumbered(&self, places: &[u32]) -> Mesh {
        let kept: Vec<u32> =
            (0..).zip(places).filter(|(v, place)| v == *place).map(|x| x.0).collect();
        let mut number = vec![0; places.len()];
        (0..).zip(&kept).for_each(|(new, &old)| number[old as usize] = new);
        // indices without a vertex stay so, for the check to find
        let new = |v: u32| places.get(v as usize).map_or(v, |&place| number[place as usize]);
        let mut mesh = self.clone();
        mesh.points = kept.iter().map(|&v| self.points[v as usize]).collect();
        if !mesh.lines.points.is_empty() {
            let lines = kept.iter().filter_map(|&v| self.lines.points.get(v as usize));
            mesh.lines.points = lines.copied().collect();
        }
        let lists = [
            mesh.tetrahedra.as_flattened_mut(),
            mesh.middles.as_flattened_mut(),
            mesh.hexahedra.as_flattened_mut(),
            mesh.triangles.as_flattened_mut(),
            mesh.quads.as_flattened_mut(),
        ];
        lists.into_iter().flatten().for_each(|v| *v = new(*v));
        for group in &mut mesh.groups {
            group.vertices.iter_mut().for_each(|v| *v = new(*v));
            group.vertices.sort_unstable();
            group.vertices.dedup();
        }
        mesh
    }
}
