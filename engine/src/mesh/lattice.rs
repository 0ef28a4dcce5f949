//! A closed surface as a lattice of cubes, each filled in part.

use super::cell::quad_triangles;
use super::error::MeshError;
use super::generate::{fits, length, product};
use super::{CellData, Group, Mesh};
use crate::element_kind::ByKind;
use crate::memory;
use glam::DVec3;
use serde::Serialize;
use std::collections::HashMap;

/// Name of the cell data with the share of each cell that lies inside the surface, from which those of where that part lies have
/// theirs ([`Mesh::filled`]).
pub const FILLED: &str = "filled";

/// Lines along x through each row of cells: moments are exact along x and means over these lines across. In either direction
/// across no two lie at one place, so that a plane along an axis cuts off what it should to half of one in so many.
const LINES: usize = 256;

/// Least share of a cell that is kept. One that is nearly empty has nearly no mass and no stiffness, and would be turned
/// inside out by whatever pulls at it.
pub const LEAST_FILLED: f64 = 0.1;

const NAME: &str = "lattice";

/// What fills a cell: how much, and where in it, by moments of its local coordinates, which go from -1 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filled {
    /// Share of the volume, above 0 and at most 1.
    pub share: f64,
    /// Middle of what is filled.
    pub middle: [f64; 3],
    /// Covariances of the coordinates over it: xx, yy, zz, yz, zx, xy.
    pub spread: [f64; 6],
}

/// What the names of cell data end in, in the order of [`Filled`].
const ENDS: [&str; 10] = [
    "",
    "_middle_x",
    "_middle_y",
    "_middle_z",
    "_spread_x",
    "_spread_y",
    "_spread_z",
    "_skew_x",
    "_skew_y",
    "_skew_z",
];

/// Products of local coordinates in the order of [`Filled::spread`].
const PAIRS: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [1, 2], [2, 0], [0, 1]];

impl Filled {
    /// Everywhere by the same share.
    pub const fn evenly(share: f64) -> Self {
        let third = 1.0 / 3.0;
        Self { share, middle: [0.0; 3], spread: [third, third, third, 0.0, 0.0, 0.0] }
    }

    /// Whether it lies about the middle of the cell and as wide as that.
    pub fn is_even(&self) -> bool {
        Self::evenly(self.share) == *self
    }

    /// Whether a part of the cell can have such moments.
    pub fn is_possible(&self) -> bool {
        const SLACK: f64 = 1e-9;
        let Self { middle, spread: [xx, yy, zz, yz, zx, xy], .. } = *self;
        let minors = [xx * yy - xy * xy, yy * zz - yz * yz, zz * xx - zx * zx];
        let determinant = xx * minors[1] - xy * (xy * zz - yz * zx) + zx * (xy * yz - yy * zx);
        let inside = |(m, s): (f64, f64)| s >= -SLACK && s + m * m <= 1.0 + SLACK;
        middle.into_iter().zip([xx, yy, zz]).all(inside)
            && minors.into_iter().all(|minor| minor >= -SLACK)
            && determinant >= -SLACK
    }

    /// From the integrals of 1 and of first and second powers over the part, over the volume of the cell.
    fn of_moments([share, x, y, z, second @ ..]: &Moments) -> Self {
        if *share > 1.0 - 1e-9 {
            return Self::evenly(*share);
        }
        let middle = [x / share, y / share, z / share];
        let mut spread = second.map(|s| s / share);
        for (s, [i, j]) in spread.iter_mut().zip(PAIRS) {
            *s -= middle[i] * middle[j];
        }
        Self { share: *share, middle, spread }
    }

    fn numbers(&self) -> [f64; 10] {
        let Self { share, middle: [x, y, z], spread: [a, b, c, d, e, f] } = *self;
        [share, x, y, z, a, b, c, d, e, f]
    }
}

/// Integrals of 1, x, y, z and [`PAIRS`] over what is filled, in local coordinates, over the volume of the cell.
type Moments = [f64; 10];

/// What became of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LatticeReport {
    /// Edge of the cells (m).
    pub cell: f64,
    /// Volume (m^3) inside the surface.
    pub volume: f64,
    /// Volume (m^3) inside the surface that the cells hold.
    pub held: f64,
    /// Cells that the surface fills to less than [`LEAST_FILLED`], left out.
    pub nearly_empty: usize,
    /// Cells that hang together with the largest piece by no face, left out.
    pub apart: usize,
    /// Lines along which the way in and the way out do not match: the surface is doubtful there.
    pub odd_lines: usize,
}

impl Mesh {
    /// The triangles of a surface: those of the volume cells, or of a mesh without any its own.
    pub fn outside(&self) -> Vec<[u32; 3]> {
        if self.is_solid() {
            return self.surface_triangles();
        }
        let n = self.points.len() as u32;
        let halves = self.quads.iter().copied().flat_map(quad_triangles);
        let own = self.triangles.iter().copied().chain(halves);
        own.filter(|t| t.iter().all(|v| *v < n)).collect()
    }

    /// What fills the solid cells, tetrahedra first, by the cell data `name` and those of its vectors `name_middle`, `name_spread`
    /// (the squares) and `name_skew` (yz, zx, xy); evenly where there are none. `None` where there is no data of that name.
    pub fn filled(&self, name: &str) -> Option<Vec<Filled>> {
        let values = &self.data(name)?.values;
        let moments: Vec<&CellData> =
            ENDS.iter().filter_map(|end| self.data(&format!("{name}{end}"))).collect();
        let mut all: Vec<Filled> = [&values.tetrahedra[..], &values.hexahedra[..]]
            .concat()
            .into_iter()
            .map(Filled::evenly)
            .collect();
        if moments.len() == ENDS.len() {
            for (i, own) in all[values.tetrahedra.len()..].iter_mut().enumerate() {
                let at = |k: usize| moments[k].values.hexahedra[i];
                own.middle = std::array::from_fn(|k| at(1 + k));
                own.spread = std::array::from_fn(|k| at(4 + k));
            }
        }
        Some(all)
    }

    /// A lattice of cubes with edges of `cell` (m) along the axes, over what a closed surface encloses. The cell data
    /// [`FILLED`] tell how much of each cell lies inside and where ([`Mesh::filled`]): a body that is told has the mass of the
    /// organ and nearly its stiffness. Where triangles all turn one way, what lies inside any part of the surface is
    /// filled, also where parts overlap, and hollows whose surface turns inward stay empty; where they do not, every other
    /// layer is filled.
    ///
    /// The middle of the lattice is that of the surface. Cells that are nearly empty ([`LEAST_FILLED`]) and those that hang
    /// together with the largest piece by no face are left out. The group `body` has all cells.
    ///
    /// # Errors
    ///
    /// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`] for the edge, [`MeshError::Open`] where the surface is not
    /// closed, [`MeshError::NothingInside`] where no cell is filled.
    ///
    /// ```
    /// use sinew_engine::mesh::generate::sphere_triangles;
    ///
    /// let (lattice, report) = sphere_triangles(0.05, 3)?.lattice(0.0125)?;
    /// assert_eq!(lattice.hexahedra.len(), 304);
    /// assert!((0.97..1.0).contains(&(report.held / report.volume)));
    /// // the first cell is cut by the surface: what fills it lies towards the middle of the sphere
    /// let filled = lattice.filled("filled").expect("a lattice has it")[0];
    /// assert!(filled.share < 1.0 && filled.middle[0] > 0.0);
    /// # Ok::<(), sinew_engine::mesh::MeshError>(())
    /// ```
    pub fn lattice(&self, cell: f64) -> Result<(Mesh, LatticeReport), MeshError> {
        length(NAME, "cell", cell)?;
        let triangles = self.outside();
        let turned_alike = self.closed(&triangles)?;
        let mut corners = triangles.iter().flatten().map(|&v| self.points[v as usize]);
        let Some(first) = corners.next() else { return Err(self.nothing_inside(cell)) };
        let (low, high) = corners.fold((first, first), |(a, b), p| (a.min(p), b.max(p)));
        let extent = high - low;
        let counts = extent.to_array().map(|x| (x / cell).ceil().max(1.0) as usize);
        let cells = fits(NAME, "cells", product(&counts))? as u64;
        let lines = (counts[1] * counts[2] * LINES) as u64;
        memory::fits(&format!("{NAME} with {cells} cells"), || 500 * cells + 100 * lines)?;
        let [nx, ny, nz] = counts;
        let spanned = cell * DVec3::new(nx as f64, ny as f64, nz as f64);
        let origin = 0.5 * (low + high - spanned);
        let grid = LatticeGrid { origin, cell, n: counts, turned_alike };
        let (filled, odd_lines) = grid.moments(&self.points, &triangles);
        let volume = filled.iter().map(|moments| moments[0]).sum::<f64>() * cell.powi(3);
        let (kept, [nearly_empty, apart]) = kept(&filled, [nx, ny, nz]);
        if kept.is_empty() {
            return Err(self.nothing_inside(cell));
        }
        let mut mesh = Mesh {
            source: format!("lattice of {} m over {}", cell, self.source),
            ..Mesh::default()
        };
        let mut numbers: HashMap<[usize; 3], u32> = HashMap::new();
        let corner_of = super::cell::CUBE;
        for &[i, j, k] in &kept {
            mesh.hexahedra.push(corner_of.map(|[a, b, c]| {
                let at = [i + a, j + b, k + c];
                *numbers.entry(at).or_insert_with(|| {
                    let [x, y, z] = at.map(|i| i as f64);
                    mesh.points.push(origin + cell * DVec3::new(x, y, z));
                    mesh.points.len() as u32 - 1
                })
            }));
        }
        let own = |&at: &[usize; 3]| Filled::of_moments(&filled[index(at, counts)]).numbers();
        let numbers: Vec<[f64; 10]> = kept.iter().map(own).collect();
        let held = numbers.iter().map(|own| own[0]).sum::<f64>() * cell.powi(3);
        mesh.cell_data.extend(ENDS.iter().enumerate().map(|(k, end)| {
            let hexahedra = numbers.iter().map(|own| own[k]).collect();
            let values = ByKind { hexahedra, ..ByKind::default() };
            CellData { name: format!("{FILLED}{end}"), integer: false, values }
        }));
        mesh.groups.push(Group {
            name: "body".into(),
            dimension: 3,
            vertices: (0..mesh.points.len() as u32).collect(),
            cells: ByKind { hexahedra: (0..kept.len() as u32).collect(), ..ByKind::default() },
        });
        let report = LatticeReport { cell, volume, held, nearly_empty, apart, odd_lines };
        Ok((mesh, report))
    }

    fn nothing_inside(&self, cell: f64) -> MeshError {
        MeshError::NothingInside { file: self.source.clone(), cell }
    }

    /// Whether all `triangles` of a closed surface turn one way, those of [`outside`](Self::outside) for a mesh.
    ///
    /// # Errors
    ///
    /// [`MeshError::Open`] where an odd number of them have an edge in common.
    pub fn closed(&self, triangles: &[[u32; 3]]) -> Result<bool, MeshError> {
        let mut edges: Vec<([u32; 2], bool)> = triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .map(|[a, b]| ([a.min(b), a.max(b)], a < b))
            .collect();
        edges.sort_unstable();
        let same = || edges.chunk_by(|a, b| a.0 == b.0);
        let mut open = same().filter(|same| same.len() % 2 == 1);
        let Some(first) = open.next().map(|same| same[0].0) else {
            let forward = |same: &[_]| same.iter().filter(|(_, forward)| *forward).count();
            return Ok(same().all(|same| 2 * forward(same) == same.len()));
        };
        let ends = first.map(|v| self.points[v as usize].to_array());
        let count = 1 + open.count();
        Err(MeshError::Open { file: self.source.clone(), count, ends })
    }
}

/// Cells along the axes, and what tells inside from outside.
struct LatticeGrid {
    origin: DVec3,
    cell: f64,
    n: [usize; 3],
    /// Whether all triangles turn one way.
    turned_alike: bool,
}

impl LatticeGrid {
    /// Moments of what lies inside of every cell, by lines along x, and the lines on which that is doubtful.
    fn moments(&self, points: &[DVec3], triangles: &[[u32; 3]]) -> (Vec<Moments>, usize) {
        const SLACK: f64 = 1e-6;
        let Self { origin, cell, n, .. } = *self;
        let mut crossings: Vec<(usize, Crossing)> = Vec::new();
        for t in triangles {
            let [a, b, c] = t.map(|v| (points[v as usize] - origin) / cell);
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let rows = |axis: usize| {
                let first = low[axis].floor().max(0.0) as usize;
                first..(high[axis].ceil().max(0.0) as usize).min(n[axis])
            };
            for j in rows(1) {
                for k in rows(2) {
                    let ends = [low.y, high.y].map(|y| (y - j as f64) * LINES as f64);
                    let last = ((ends[1] + 1.0).max(0.0) as usize).min(LINES);
                    for line in ((ends[0] - 1.0).max(0.0) as usize).min(last)..last {
                        let [y, z] = LINE_PLACES[line];
                        let place = [y + j as f64, z + k as f64];
                        if place[1] < low.z - SLACK || place[1] > high.z + SLACK {
                            continue;
                        }
                        let place = [origin.y + cell * place[0], origin.z + cell * place[1]];
                        let found = crossing(points, *t, place);
                        crossings.extend(found.map(|x| ((j * n[2] + k) * LINES + line, x)));
                    }
                }
            }
        }
        crossings.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.x.total_cmp(&b.1.x)));
        let mut filled = vec![[0.0; 10]; n[0] * n[1] * n[2]];
        let mut doubtful = 0;
        for line in crossings.chunk_by(|a, b| a.0 == b.0) {
            let (row, [y, z]) = (line[0].0 / LINES, LINE_PLACES[line[0].0 % LINES]);
            let [y, z] = [2.0 * y - 1.0, 2.0 * z - 1.0];
            let mut layers = 0;
            let mut step = |crossing: &Crossing| {
                layers += if self.turned_alike { crossing.turn } else { 1 };
                if self.turned_alike { layers != 0 } else { layers % 2 != 0 }
            };
            for ends in line.windows(2) {
                if !step(&ends[0].1) {
                    continue;
                }
                let [from, to] = [ends[0].1.x, ends[1].1.x].map(|x| (x - origin.x) / cell);
                let last = (to.ceil().max(0.0) as usize).min(n[0]);
                for i in (from.floor().max(0.0) as usize).min(n[0])..last {
                    let x = i as f64;
                    let [a, b] = [from.max(x), to.min(x + 1.0)];
                    let length = (b - a).max(0.0) / LINES as f64;
                    let [a, b] = [2.0 * (a - x) - 1.0, 2.0 * (b - x) - 1.0];
                    let (mean, square) = (0.5 * (a + b), (a * a + a * b + b * b) / 3.0);
                    let own = [1.0, mean, y, z, square, y * y, z * z, y * z, z * mean, mean * y];
                    let to = &mut filled[index([i, row / n[2], row % n[2]], n)];
                    to.iter_mut().zip(own).for_each(|(to, own)| *to += length * own);
                }
            }
            doubtful += usize::from(step(&line[line.len() - 1].1));
        }
        (filled, doubtful)
    }
}

/// Where lines along x pass through a cell, from 0 to 1 along y and z: a lattice of one generator, that by which lines are the farthest
/// apart and the places across the least related, moved to where vertices and edges of modelled parts are not.
const LINE_PLACES: [[f64; 2]; LINES] = {
    let mut places = [[0.0; 2]; LINES];
    let mut n = 0;
    while n < LINES {
        let turned = 71 * n % LINES;
        places[n] = [(n as f64 + 0.4935) / LINES as f64, (turned as f64 + 0.5083) / LINES as f64];
        n += 1;
    }
    places
};

/// Where a line along x crosses a triangle, and which way that one turns.
#[derive(Clone, Copy)]
struct Crossing {
    x: f64,
    turn: i32,
}

/// Which side of an edge the line is on is computed from the edge alone, so that triangles on both sides of it agree.
fn crossing(points: &[DVec3], t: [u32; 3], [y, z]: [f64; 2]) -> Option<Crossing> {
    let p = t.map(|v| points[v as usize]);
    let area = |a: DVec3, b: DVec3| (a.y - y) * (b.z - z) - (a.z - z) * (b.y - y);
    let mut sides = [false; 3];
    let mut weights = [0.0; 3];
    for k in 0..3 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let turned = t[i] > t[j];
        let own = if turned { area(p[j], p[i]) } else { area(p[i], p[j]) };
        sides[k] = (own >= 0.0) != turned;
        weights[k] = if turned { -own } else { own };
    }
    let sum: f64 = weights.iter().sum();
    let inside = sides[0] == sides[1] && sides[1] == sides[2] && sum != 0.0;
    inside.then(|| Crossing {
        x: (0..3).map(|k| p[k].x * (weights[k] / sum)).sum(),
        turn: if sides[0] { 1 } else { -1 },
    })
}

fn index([i, j, k]: [usize; 3], [_, ny, nz]: [usize; 3]) -> usize {
    (i * ny + j) * nz + k
}

/// Cells of the piece that holds most, in the order of the lattice; how many were left out as nearly empty and as apart.
fn kept(filled: &[Moments], n: [usize; 3]) -> (Vec<[usize; 3]>, [usize; 2]) {
    let [nx, ny, nz] = n;
    let all =
        || (0..nx).flat_map(move |i| (0..ny).flat_map(move |j| (0..nz).map(move |k| [i, j, k])));
    let enough = |at: [usize; 3]| filled[index(at, n)][0] >= LEAST_FILLED;
    let nearly_empty = filled.iter().filter(|[share, ..]| *share > 0.0 && *share < LEAST_FILLED);
    let mut piece = vec![usize::MAX; filled.len()];
    let mut held = Vec::new();
    for start in all().filter(|at| enough(*at)) {
        if piece[index(start, n)] != usize::MAX {
            continue;
        }
        let number = held.len();
        piece[index(start, n)] = number;
        let (mut open, mut sum) = (vec![start], 0.0);
        while let Some(at) = open.pop() {
            sum += filled[index(at, n)][0];
            for axis in 0..3 {
                for next in [at[axis].checked_sub(1), Some(at[axis] + 1)].into_iter().flatten() {
                    let mut beside = at;
                    beside[axis] = next;
                    if next < n[axis] && enough(beside) && piece[index(beside, n)] == usize::MAX {
                        piece[index(beside, n)] = number;
                        open.push(beside);
                    }
                }
            }
        }
        held.push(sum);
    }
    let most = (0..held.len()).fold(0, |best, i| if held[i] > held[best] { i } else { best });
    let kept: Vec<_> = all().filter(|at| piece[index(*at, n)] == most).collect();
    let apart = piece.iter().filter(|p| **p != usize::MAX).count() - kept.len();
    (kept, [nearly_empty.count(), apart])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::generate::{box_tets, cup_hexahedra, sphere_triangles};
    use crate::mesh::{CheckOptions, check};
    use glam::DQuat;

    /// A turned surface has the same share, whatever way its triangles turn.
    #[test]
    fn holds_what_is_inside() {
        let ball = sphere_triangles(0.05, 4).unwrap();
        let cup = cup_hexahedra([0.03, 0.05], 0.02, 16, 24, 4).unwrap();
        for (mesh, cell) in [(ball, 0.01), (cup, 0.008)] {
            let exact = super::super::enclosed_volume(&mesh.points, &mesh.outside());
            for degrees in [0.0_f64, 31.0] {
                let turn = DQuat::from_axis_angle(DVec3::ONE.normalize(), degrees.to_radians());
                let mut mesh = mesh.transformed(1.0, turn, DVec3::new(0.1, -3.0, 7.0));
                let (alike, report) = mesh.lattice(cell).unwrap();
                assert!((report.volume / exact - 1.0).abs() < 2e-3, "{report:?} {exact}");
                // every third triangle turned round
                mesh.triangles.iter_mut().step_by(3).for_each(|t| t.swap(0, 1));
                let (lattice, report) = mesh.lattice(cell).unwrap();
                assert_eq!((report.odd_lines, alike.hexahedra), (0, lattice.hexahedra.clone()));
                let lost = 1.0 - report.held / exact;
                // what nearly empty cells would have held is left out
                assert!((-0.005..0.02).contains(&lost), "{lost} {report:?}");
                let checked = check(&lattice, &CheckOptions::default()).unwrap();
                assert!(
                    checked
                        .report
                        .findings
                        .iter()
                        .all(|f| f.severity < crate::mesh::Severity::Error)
                );
                let shares = &lattice.data(FILLED).unwrap().values.hexahedra;
                assert_eq!(shares.len(), lattice.hexahedra.len());
                assert!(shares.iter().all(|s| (LEAST_FILLED..=1.0 + 1e-12).contains(s)));
                let sum = shares.iter().sum::<f64>() * cell.powi(3);
                assert!((sum / report.held - 1.0).abs() < 1e-12);
                for own in lattice.filled(FILLED).unwrap() {
                    assert!(own.is_possible(), "{own:?}");
                    assert_eq!(own.is_even(), own.share > 1.0 - 1e-9);
                }
            }
        }
    }

    /// Planes of a box lie on those of the lattice, or cut its cells in two: exactly across x, to half a line otherwise.
    #[test]
    fn moments_of_a_box() {
        for (axis, slack) in [(0, 1e-9_f64), (1, 1e-2), (2, 1e-2)] {
            let at = |sizes: [f64; 3]| {
                let mut own = [0.0; 3];
                (0..3).for_each(|k| own[(axis + k) % 3] = sizes[k]);
                DVec3::from(own)
            };
            let mesh = box_tets(at([0.35, 0.2, 0.1]), [3, 2, 1]).unwrap();
            let (lattice, report) = mesh.lattice(0.1).unwrap();
            assert_eq!(lattice.hexahedra.len(), 8);
            assert!((report.held / 0.007 - 1.0).abs() < 0.1 * slack.max(1e-8), "{report:?}");
            let filled = lattice.filled(FILLED).unwrap();
            let (even, cut): (Vec<_>, Vec<_>) = filled.into_iter().partition(Filled::is_even);
            assert_eq!([even.len(), cut.len()], [4; 2]);
            for own in cut {
                let [middle, wide] =
                    [DVec3::from(own.middle).abs(), DVec3::from_slice(&own.spread)];
                assert!((own.share - 0.75).abs() < slack, "{own:?}");
                assert!((middle - at([0.25, 0.0, 0.0])).abs()[axis] < slack, "{own:?}");
                assert!(middle.distance(at([0.25, 0.0, 0.0])) < 1e-2, "{own:?}");
                assert!(wide.distance(at([0.1875, 1.0 / 3.0, 1.0 / 3.0])) < 1e-2, "{own:?}");
                assert!(own.spread[3..].iter().all(|s| s.abs() < 1e-2), "{own:?}");
            }
            assert!((lattice.bounds().unwrap().0[axis] + 0.025).abs() < 1e-15);
        }
    }

    #[test]
    fn what_is_not_closed_is_refused() {
        let mut ball = sphere_triangles(0.05, 2).unwrap();
        ball.source = "organ.stl".into();
        ball.triangles.pop();
        let error = ball.lattice(0.01).unwrap_err().to_string();
        assert!(error.starts_with("organ.stl: the surface is not closed: 3 edges"), "{error}");
        let ball = sphere_triangles(0.05, 2).unwrap();
        for wrong in [0.0, -0.01, f64::NAN, f64::INFINITY] {
            assert!(matches!(ball.lattice(wrong), Err(MeshError::InvalidParameter { .. })));
        }
        assert!(matches!(ball.lattice(1e-6), Err(MeshError::TooMany { .. })));
        assert!(matches!(Mesh::default().lattice(0.1), Err(MeshError::NothingInside { .. })));
        // thinner than a tenth of a cell
        let plate = box_tets(DVec3::new(0.1, 0.1, 0.001), [1, 1, 1]).unwrap();
        assert!(matches!(plate.lattice(0.05), Err(MeshError::NothingInside { .. })));
    }

    /// Parts that overlap are filled where they do, hollows are not.
    #[test]
    fn layers_of_surfaces() {
        let ball = |radius, at: DVec3| {
            sphere_triangles(radius, 4).unwrap().transformed(1.0, DQuat::IDENTITY, at)
        };
        let joined = |mut one: Mesh, two: Mesh| {
            let first = one.points.len() as u32;
            one.points.extend(two.points);
            one.triangles.extend(two.triangles.iter().map(|t| t.map(|v| v + first)));
            one.lattice(0.01).unwrap().1
        };
        let one = ball(0.05, DVec3::ZERO);
        let alone = one.lattice(0.01).unwrap().1.volume;
        let inner = ball(0.025, DVec3::ZERO);
        assert!((joined(one.clone(), inner.clone()).volume / alone - 1.0).abs() < 1e-12);
        let mut hollow = inner;
        hollow.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        assert!((joined(one.clone(), hollow).volume / alone - 0.875).abs() < 1e-3);
        // two balls at half a radius: what both hold counts once, 2 - (2 + d / r) (1 - d / 2 r)^2 / 2 of one
        let report = joined(one, ball(0.05, DVec3::new(0.025, 0.0, 0.0)));
        let expected = 2.0 - (2.0 + 0.25) * (1.0 - 0.25) * (1.0 - 0.25) / 2.0;
        assert!((report.volume / alone / expected - 1.0).abs() < 5e-3, "{report:?}");
        assert_eq!(report.odd_lines, 0);
    }

    /// Two balls that share nothing: the larger is kept, and the other one told.
    #[test]
    fn only_the_largest_piece_is_kept() {
        let mut two = sphere_triangles(0.05, 2).unwrap();
        let small = sphere_triangles(0.02, 2).unwrap();
        let first = two.points.len() as u32;
        two.points.extend(small.points.iter().map(|p| *p + DVec3::new(0.12, 0.0, 0.0)));
        two.triangles.extend(small.triangles.iter().map(|t| t.map(|v| v + first)));
        let (lattice, report) = two.lattice(0.01).unwrap();
        assert!(report.apart > 20, "{report:?}");
        assert!(lattice.points.iter().all(|p| p.x < 0.07));
        assert!(report.held < 0.96 * report.volume);
    }
}
