//! Unstructured meshes of nearly equal triangles and tetrahedra. Points push each other apart along the edges of
//! their Delaunay mesh until all edges are about equally long, and points outside go back to the boundary
//! (Persson & Strang 2004, A Simple Mesh Generator in MATLAB). Tetrahedra that stay flat are opened afterwards by
//! moving their points. The same region gives the same mesh: nothing is drawn at random but small fixed moves.

use glam::DVec3;
use std::collections::BTreeMap;

/// A simplex; the last place of a triangle is [`NONE`].
pub(crate) type Cell = [u32; 4];
const NONE: u32 = u32::MAX;

/// Turns of relaxation.
const TURNS: usize = 200;
/// Part of the mean edge that a point may move before the Delaunay mesh is made again.
const STALE: f64 = 0.1;
/// Angle (degrees) between two open faces above which a tetrahedron on the boundary is no more than a film.
const FILM: f64 = 130.0;
/// Angle (degrees) between faces below which points round a tetrahedron are moved.
const FLAT: f64 = 20.0;
/// Sweeps over such points, and tries at each distance (over the spacing).
const SWEEPS: u64 = 30;
const TRIES: u64 = 12;
const REACHES: [f64; 4] = [0.2, 0.1, 0.05, 0.02];
/// Distance from the boundary, over the spacing, up to which a point lies on it.
const SKIN: f64 = 1e-3;

/// What is meshed.
pub(crate) struct Region<'a> {
    /// 2 for triangles in the plane z = 0, 3 for tetrahedra.
    pub dimension: usize,
    /// Lower and upper corner (m) of a box round the region.
    pub bounds: [DVec3; 2],
    /// Distance (m) of a point from the boundary, negative inside.
    pub distance: &'a dyn Fn(DVec3) -> f64,
    /// Points that stay where they are: those of corners and edges.
    pub fixed: Vec<DVec3>,
    /// How much longer edges are for every spacing of depth.
    pub grade: f64,
}

fn splitmix(i: u64) -> f64 {
    let mut z = i.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64 - 0.5
}

/// Three numbers between -0.5 and 0.5 that depend on `i` alone.
fn scatter(i: u64) -> DVec3 {
    DVec3::new(splitmix(3 * i + 1), splitmix(3 * i + 2), splitmix(3 * i + 3))
}

/// Whether `q` lies inside the circle or sphere through the corners of an upright cell.
fn encloses(p: &[DVec3], cell: Cell, q: DVec3, dimension: usize) -> bool {
    let r = |i: usize| p[cell[i] as usize] - q;
    let [a, b, c] = [r(0), r(1), r(2)];
    let det = |a: DVec3, b: DVec3, c: DVec3| a.dot(b.cross(c));
    let lift = |a: DVec3| a.length_squared();
    if dimension == 2 {
        let up = |a: DVec3| DVec3::new(a.x, a.y, lift(a));
        return det(up(a), up(b), up(c)) > 0.0;
    }
    let d = r(3);
    let (even, odd) = (lift(a) * det(b, c, d) + lift(c) * det(a, b, d), lift(b) * det(a, c, d));
    even - odd - lift(d) * det(a, b, c) > 0.0
}

/// Twice the area of a triangle, six times the volume of a tetrahedron; negative where it is turned over.
fn size(p: &[DVec3], cell: Cell, dimension: usize) -> f64 {
    let r = |i: usize| p[cell[i] as usize] - p[cell[0] as usize];
    if dimension == 2 { r(1).cross(r(2)).z } else { r(1).dot(r(2).cross(r(3))) }
}

fn upright(p: &[DVec3], mut cell: Cell, dimension: usize) -> Cell {
    if size(p, cell, dimension) < 0.0 {
        cell.swap(0, 1);
    }
    cell
}

/// The sides of a cell: edges of a triangle, faces of a tetrahedron, each in ascending order.
fn sides(cell: Cell, dimension: usize) -> impl Iterator<Item = [u32; 3]> {
    (0..=dimension).map(move |skip| {
        let mut side = [NONE; 3];
        let kept = (0..=dimension).filter(|&i| i != skip).map(|i| cell[i]);
        side.iter_mut().zip(kept).for_each(|(s, v)| *s = v);
        side.sort_unstable();
        side
    })
}

/// Delaunay mesh of the convex hull (Bowyer 1981, Watson 1981). Points are first moved by a millionth of the extent,
/// so that no two circumscribed spheres are the same.
fn delaunay(points: &[DVec3], dimension: usize) -> Vec<Cell> {
    let first = points[0];
    let (low, high) = points.iter().fold((first, first), |(l, h), p| (l.min(*p), h.max(*p)));
    let (extent, n) = ((high - low).max_element(), points.len() as u32);
    let flat = DVec3::new(1.0, 1.0, if dimension == 3 { 1.0 } else { 0.0 });
    let moved = |(i, p): (usize, &DVec3)| *p + 1e-6 * extent * flat * scatter(i as u64);
    let mut p: Vec<DVec3> = points.iter().enumerate().map(moved).collect();
    // a simplex far round all points
    let corners = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.1], [-1.0, 1.1, -1.0], [-1.1, -1.0, 1.0]];
    let flat_corners = [[0.0, 1.0, 0.0], [-0.87, -0.51, 0.0], [0.86, -0.5, 0.0]];
    let corners = if dimension == 2 { &flat_corners[..] } else { &corners[..] };
    p.extend(corners.iter().map(|c| 0.5 * (low + high) + 60.0 * extent * DVec3::from_array(*c)));
    let all = [n, n + 1, n + 2, if dimension == 3 { n + 3 } else { NONE }];
    let mut cells = vec![upright(&p, all, dimension)];
    let mut hollow: Vec<[u32; 3]> = Vec::new();
    for v in 0..n {
        hollow.clear();
        cells.retain(|&cell| {
            let hit = encloses(&p, cell, p[v as usize], dimension);
            if hit {
                hollow.extend(sides(cell, dimension));
            }
            !hit
        });
        // sides that two removed cells shared lie inside the hollow
        hollow.sort_unstable();
        for equal in hollow.chunk_by(|a, b| a == b).filter(|equal| equal.len() == 1) {
            let [a, b, c] = equal[0];
            let cell = if dimension == 2 { [a, b, v, NONE] } else { [a, b, c, v] };
            cells.push(upright(&p, cell, dimension));
        }
    }
    cells.retain(|cell| cell[..=dimension].iter().all(|&v| v < n));
    cells
}

fn cosine(u: DVec3, v: DVec3) -> f64 {
    u.dot(v) / (u.length_squared() * v.length_squared()).sqrt()
}

/// Cosine of the angle inside a tetrahedron between the two faces that lie opposite these corners.
fn fold(p: &[DVec3], cell: Cell, [k, l]: [usize; 2]) -> f64 {
    let at = |i: usize| p[cell[i] as usize];
    let mut ends = (0..4).filter(|i| *i != k && *i != l).map(at);
    let (Some(a), Some(b)) = (ends.next(), ends.next()) else { return 1.0 };
    let along = (b - a).normalize_or_zero();
    let [u, v] = [at(k) - a, at(l) - a].map(|u| u - u.dot(along) * along);
    cosine(u, v)
}

/// Smallest and largest angle (degrees) at the corners of a triangle, or between the faces of a tetrahedron.
pub(crate) fn angles(p: &[DVec3], cell: Cell, dimension: usize) -> [f64; 2] {
    let at = |i: usize| p[cell[i] as usize];
    let mut cosines = [1.0_f64, -1.0_f64];
    let mut add = |cosine: f64| {
        cosines = [cosines[0].min(cosine), cosines[1].max(cosine)];
    };
    if dimension == 2 {
        for i in 0..3 {
            add(cosine(at((i + 1) % 3) - at(i), at((i + 2) % 3) - at(i)));
        }
    } else {
        for opposite in [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]] {
            add(fold(p, cell, opposite));
        }
    }
    [cosines[1], cosines[0]].map(|c| libm::acos(c.clamp(-1.0, 1.0)).to_degrees())
}

impl Region<'_> {
    /// The nearest point of the boundary, about; `spacing` (m) is that of the mesh.
    fn onto(&self, mut p: DVec3, spacing: f64) -> DVec3 {
        let step = 1e-4 * spacing;
        let slope = |p: DVec3, axis: DVec3| {
            (self.distance)(p + step * axis) - (self.distance)(p - step * axis)
        };
        for _ in 0..4 {
            let z = if self.dimension == 3 { slope(p, DVec3::Z) } else { 0.0 };
            let gradient = DVec3::new(slope(p, DVec3::X), slope(p, DVec3::Y), z) / (2.0 * step);
            p -= (self.distance)(p) * gradient / gradient.length_squared().max(1e-12);
        }
        p
    }

    fn on_boundary(&self, p: DVec3, spacing: f64) -> bool {
        (self.distance)(p).abs() < SKIN * spacing
    }

    /// Points of equilateral triangles, or of body-centred cubes.
    fn lattice(&self, spacing: f64) -> Vec<DVec3> {
        let plane = self.dimension == 2;
        let steps = if plane {
            DVec3::new(1.0, 0.75_f64.sqrt(), 1.0) * spacing
        } else {
            DVec3::new(1.1, 1.1, 0.55) * spacing
        };
        let [low, high] = self.bounds;
        let [nx, ny, nz] = ((high - low) / steps).floor().to_array().map(|n| n as usize);
        let mut points = Vec::new();
        for k in 0..=nz {
            for j in 0..=ny {
                let shift = if plane {
                    DVec3::X * (0.5 * (j % 2) as f64)
                } else {
                    DVec3::new(0.5, 0.5, 0.0) * (k % 2) as f64
                };
                let place = |i| low + steps * (DVec3::new(i as f64, j as f64, k as f64) + shift);
                points.extend((0..=nx).map(place));
            }
        }
        points
    }

    /// The `count` deepest points of the widest lattice that has so many inside, not too near to the fixed ones,
    /// and its spacing (m).
    fn start(&self, count: usize) -> (Vec<DVec3>, f64) {
        let margin = if self.dimension == 2 { 0.4 } else { 0.0 };
        let mut spacing = (self.bounds[1] - self.bounds[0]).max_element();
        loop {
            let far = |p: &DVec3| self.fixed.iter().all(|q| q.distance(*p) > 0.5 * spacing);
            let lattice = self.lattice(spacing).into_iter().map(|p| ((self.distance)(p), p));
            let mut inside: Vec<(f64, DVec3)> =
                lattice.filter(|(d, p)| *d < -margin * spacing && far(p)).collect();
            if inside.len() >= count {
                inside.sort_by(|a, b| a.0.total_cmp(&b.0));
                inside.truncate(count);
                return (inside.into_iter().map(|point| point.1).collect(), spacing);
            }
            spacing *= 0.995;
        }
    }

    /// Cells whose middle is inside, without films on the boundary.
    fn cells(&self, points: &[DVec3], spacing: f64) -> Vec<Cell> {
        let dimension = self.dimension;
        let mut cells = delaunay(points, dimension);
        cells.retain(|c| {
            let corners = c[..=dimension].iter().map(|&v| points[v as usize]);
            let middle = corners.sum::<DVec3>() / (dimension + 1) as f64;
            (self.distance)(middle) < -SKIN * spacing
        });
        cells.iter_mut().for_each(|c| *c = upright(points, *c, dimension));
        if dimension == 3 {
            self.peel(points, &mut cells, spacing);
        }
        cells
    }

    /// Removes tetrahedra with all points on the boundary whose two open faces lie nearly in one plane.
    fn peel(&self, points: &[DVec3], cells: &mut Vec<Cell>, spacing: f64) {
        loop {
            let mut count = BTreeMap::<[u32; 3], u32>::new();
            let faces = cells.iter().flat_map(|c| sides(*c, 3));
            faces.for_each(|f| *count.entry(f).or_default() += 1);
            let before = cells.len();
            cells.retain(|c| {
                let open = sides(*c, 3).enumerate().filter(|(_, f)| count[f] == 1);
                // side i lies opposite corner i
                let open: Vec<usize> = open.map(|(i, _)| i).collect();
                let [k, l] = open[..] else { return true };
                let cosine = fold(points, *c, [k, l]);
                libm::acos(cosine.clamp(-1.0, 1.0)).to_degrees() <= FILM
                    || c.iter().any(|&v| !self.on_boundary(points[v as usize], spacing))
            });
            if cells.len() == before {
                return;
            }
        }
    }

    /// One turn: how far every point is pushed (m).
    fn push(&self, points: &[DVec3], edges: &[[u32; 2]], spacing: f64) -> Vec<DVec3> {
        let plane = self.dimension == 2;
        // longer than there is room for, so that points are pressed against the boundary
        let (press, step) = if plane { (1.2, 0.2) } else { (1.1, 0.1) };
        let ends = |e: &[u32; 2]| e.map(|v| points[v as usize]);
        let wanted = |e: &[u32; 2]| {
            let [a, b] = ends(e);
            1.0 - self.grade * (self.distance)(0.5 * (a + b)).min(0.0) / spacing
        };
        let power = |x: f64| if plane { x * x } else { x * x * x };
        let sums = edges.iter().fold([0.0; 2], |[is, should], e| {
            let [a, b] = ends(e);
            [is + power(a.distance(b)), should + power(wanted(e))]
        });
        let ratio = sums[0] / sums[1];
        let mean = if plane { ratio.sqrt() } else { libm::cbrt(ratio) };
        let mut pushed = vec![DVec3::ZERO; points.len()];
        for e in edges {
            let [a, b] = ends(e);
            let length = a.distance(b);
            let short = (press * mean * wanted(e) - length).max(0.0);
            let own = (a - b) * (step * short / length);
            pushed[e[0] as usize] += own;
            pushed[e[1] as usize] -= own;
        }
        pushed
    }

    /// A mesh of `count` points, the fixed ones first.
    pub fn mesh(&self, count: usize) -> (Vec<DVec3>, Vec<Cell>) {
        let fixed = self.fixed.len();
        let (free, spacing) = self.start(count - fixed);
        let mut points = self.fixed.clone();
        points.extend(free);
        let (mut before, mut edges): (Vec<DVec3>, Vec<[u32; 2]>) = Default::default();
        for _ in 0..TURNS {
            let stale = |(p, q): (&DVec3, &DVec3)| p.distance(*q) > STALE * spacing;
            if before.is_empty() || points.iter().zip(&before).any(stale) {
                before.clone_from(&points);
                edges.clear();
                for c in self.cells(&points, spacing) {
                    let corners = &c[..=self.dimension];
                    for (i, &a) in corners.iter().enumerate() {
                        edges.extend(corners[i + 1..].iter().map(|&b| [a.min(b), a.max(b)]));
                    }
                }
                edges.sort_unstable();
                edges.dedup();
            }
            let pushed = self.push(&points, &edges, spacing);
            for (p, push) in points.iter_mut().zip(pushed).skip(fixed) {
                *p += push;
                if (self.distance)(*p) > 0.0 {
                    *p = self.onto(*p, spacing);
                }
            }
        }
        let cells = self.cells(&points, spacing);
        if self.dimension == 3 {
            self.open(&mut points, &cells, spacing);
        }
        (points, cells)
    }

    /// Moves free points of flat tetrahedra wherever the flattest round them becomes less flat.
    fn open(&self, points: &mut [DVec3], cells: &[Cell], spacing: f64) {
        let mut round = vec![Vec::new(); points.len()];
        cells.iter().for_each(|c| c.iter().for_each(|&v| round[v as usize].push(*c)));
        let flattest = |points: &[DVec3], v: usize| {
            let angle = |c: &Cell| {
                let [low, high] = angles(points, *c, 3);
                if size(points, *c, 3) > 0.0 { low.min(180.0 - high) } else { -1.0 }
            };
            round[v].iter().map(angle).fold(f64::INFINITY, f64::min)
        };
        for sweep in 0..SWEEPS {
            let mut moved = false;
            for v in self.fixed.len()..points.len() {
                let mut best = flattest(points, v);
                if best > FLAT {
                    continue;
                }
                let skin = self.on_boundary(points[v], spacing);
                for (reach, turn) in REACHES.iter().flat_map(|r| (0..TRIES).map(move |t| (r, t))) {
                    let here = points[v];
                    let seed = (sweep * points.len() as u64 + v as u64) * 100 + turn;
                    let there = here + *reach * spacing * scatter(seed).normalize_or_zero();
                    if skin {
                        points[v] = self.onto(there, spacing);
                    } else if (self.distance)(there) < -0.1 * spacing {
                        points[v] = there;
                    }
                    let angle = flattest(points, v);
                    if angle > best {
                        (best, moved) = (angle, true);
                    } else {
                        points[v] = here;
                    }
                }
            }
            if !moved {
                return;
            }
        }
    }
}
