//! Surfaces ready for drawing: corners that share a smooth normal are one vertex, corners on either side of
//! a sharp edge are two.

use glam::Vec3;
use std::collections::HashMap;

/// Angle (degrees) between faces above which their common edge stays sharp.
pub const CREASE_ANGLE: f32 = 40.0;
/// The same within a wound, whose triangles may be narrow: the side of a cut is smooth, and its end is not.
const WOUND_ANGLE: f32 = 80.0;

/// Triangles of a surface over the points of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Skin {
    /// The point under each vertex.
    pub points: Vec<u32>,
    /// Body of each vertex, counted from 0.
    pub body: Vec<u16>,
    /// Three vertices each, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Edges by their points where the surface is sharp, or ends; without those that end nowhere.
    pub creases: Vec<[u32; 2]>,
    /// Depth (m) of each vertex that lies on a wound below the surface there was, NaN of others; empty without wounds.
    pub depth: Vec<f32>,
}

/// A triangle by its points and the index of its body.
pub type Facet = ([u32; 3], u16);

impl Skin {
    /// Joins and splits the corners of `facets` by the shape `rest` (m): an edge is sharp where faces meet at
    /// more than `crease` degrees, where only one or more than two faces meet, or where bodies do.
    ///
    /// Facets without area or with an index out of range are left out.
    pub fn new(facets: &[Facet], rest: &[[f32; 3]], crease: f32) -> Self {
        Self::with_wounds(facets, rest, &[], crease)
    }

    /// [`new`](Self::new) with wounds: `depth` (m) tells which of the points lie on one, NaN of those that do not. A wound
    /// shares no points with what is not wound.
    pub fn with_wounds(facets: &[Facet], rest: &[[f32; 3]], depth: &[f32], crease: f32) -> Self {
        let at = |v: u32| rest.get(v as usize).map(|p| Vec3::from_array(*p));
        let mut kept = Vec::with_capacity(facets.len());
        for &(t, body) in facets {
            if let [Some(a), Some(b), Some(c)] = t.map(at)
                && let Some(normal) = (b - a).cross(c - a).try_normalize()
            {
                kept.push((t, body, normal));
            }
        }
        // the (facet, corner) pairs at every edge
        let mut edges: HashMap<[u32; 2], Vec<u32>> = HashMap::with_capacity(2 * kept.len());
        for (f, (t, ..)) in kept.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                edges.entry([a.min(b), a.max(b)]).or_default().push(f as u32);
            }
        }
        let corner = |f: u32, v: u32| {
            3 * f + kept[f as usize].0.iter().position(|&w| w == v).unwrap_or(0) as u32
        };
        let mut parent: Vec<u32> = (0..3 * kept.len() as u32).collect();
        fn root(parent: &mut [u32], mut i: u32) -> u32 {
            while parent[i as usize] != i {
                parent[i as usize] = parent[parent[i as usize] as usize];
                i = parent[i as usize];
            }
            i
        }
        let depth_of = |v: u32| depth.get(v as usize).copied().unwrap_or(f32::NAN);
        let least = [crease, crease.max(WOUND_ANGLE)].map(|angle| angle.to_radians().cos());
        let mut creases = Vec::new();
        for (&edge, faces) in &edges {
            let smooth = match faces[..] {
                [f, g] => {
                    let (f, g) = (&kept[f as usize], &kept[g as usize]);
                    let is_wound = !depth_of(edge[0]).is_nan();
                    f.1 == g.1 && f.2.dot(g.2) > least[usize::from(is_wound)]
                }
                _ => false,
            };
            if smooth {
                for v in edge {
                    let a = root(&mut parent, corner(faces[0], v));
                    let b = root(&mut parent, corner(faces[1], v));
                    parent[a.max(b) as usize] = a.min(b);
                }
            } else {
                creases.push(edge);
            }
        }
        creases.sort_unstable();
        without_loose_ends(&mut creases);
        let mut skin = Self { creases, ..Self::default() };
        let mut vertex = vec![u32::MAX; parent.len()];
        for (f, (t, body, _)) in kept.iter().enumerate() {
            let corners = [0, 1, 2].map(|k| {
                let root = root(&mut parent, 3 * f as u32 + k as u32) as usize;
                if vertex[root] == u32::MAX {
                    vertex[root] = skin.points.len() as u32;
                    skin.points.push(t[k]);
                    skin.body.push(*body);
                }
                vertex[root]
            });
            skin.triangles.push(corners);
        }
        let depths = skin.points.iter().map(|&v| depth_of(v));
        if depths.clone().any(|depth| !depth.is_nan()) {
            skin.depth = depths.collect();
        }
        skin
    }

    /// Depth (m) of a vertex on a wound.
    pub fn wound(&self, vertex: usize) -> Option<f32> {
        self.depth.get(vertex).copied().filter(|depth| !depth.is_nan())
    }

    /// Unit normals of the vertices on the shape `points` (m): those of the faces around, weighted by their
    /// angles at the vertex, so that they do not depend on how flat parts are cut; in wounds by their areas, since narrow
    /// triangles there have wide angles and no sure normal.
    pub fn normals(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let at = |v: u32| Vec3::from_array(points[self.points[v as usize] as usize]);
        let mut sums = vec![Vec3::ZERO; self.points.len()];
        for &t in &self.triangles {
            let p = t.map(at);
            let area = (p[1] - p[0]).cross(p[2] - p[0]);
            let Some(normal) = area.try_normalize() else { continue };
            if self.wound(t[0] as usize).is_some() {
                t.iter().for_each(|&v| sums[v as usize] += area);
                continue;
            }
            for k in 0..3 {
                let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
                sums[t[k] as usize] += normal * a.angle_between(b);
            }
        }
        sums.into_iter().map(|n| n.try_normalize().unwrap_or(Vec3::Z).to_array()).collect()
    }
}

/// Takes away edges until every end meets another one: on a round body a few faces are steep to each other by
/// chance, and lines there would be noise.
pub fn without_loose_ends(edges: &mut Vec<[u32; 2]>) {
    loop {
        let mut ends: HashMap<u32, u32> = HashMap::new();
        edges.iter().flatten().for_each(|&v| *ends.entry(v).or_default() += 1);
        let before = edges.len();
        edges.retain(|edge| edge.iter().all(|v| ends[v] > 1));
        if edges.len() == before {
            return;
        }
    }
}
