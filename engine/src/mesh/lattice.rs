//! A closed surface as a lattice of cubes, each filled by a share.

use super::cell::quad_triangles;
use super::error::MeshError;
use super::generate::{fits, length, product};
use super::{CellData, Group, Mesh};
use crate::element_kind::ByKind;
use glam::DVec3;
use serde::Serialize;
use std::collections::HashMap;

/// Name of the cell data with the share of each cell that lies inside the surface.
pub const FILLED: &str = "filled";

/// Lines along x through each row of cells, in either direction: shares are exact along x and means of 64 lines across.
const LINES: usize = 8;

/// Least share of a cell that is kept. One that is nearly empty has nearly no mass and no stiffness, and would be turned
/// inside out by whatever pulls at it.
pub const LEAST_FILLED: f64 = 0.1;

const NAME: &str = "lattice";

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

    /// A lattice of cubes with edges of `cell` (m) along the axes, over what a closed surface encloses. The cell data
    /// [`FILLED`] has the share of each cell that lies inside: a body whose stiffness and density are multiplied by it has the
    /// mass of the organ and nearly its stiffness. Where triangles all turn one way, what lies inside any part of the surface is
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
        fits(NAME, "cells", product(&counts))?;
        let [nx, ny, nz] = counts;
        let spanned = cell * DVec3::new(nx as f64, ny as f64, nz as f64);
        let origin = 0.5 * (low + high - spanned);
        let grid = LatticeGrid { origin, cell, n: counts, turned_alike };
        let (filled, odd_lines) = grid.shares(&self.points, &triangles);
        let volume = filled.iter().sum::<f64>() * cell.powi(3);
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
        let shares: Vec<f64> = kept.iter().map(|&at| filled[index(at, [nx, ny, nz])]).collect();
        let held = shares.iter().sum::<f64>() * cell.powi(3);
        let values = ByKind { hexahedra: shares, ..ByKind::default() };
        mesh.cell_data.push(CellData { name: FILLED.into(), integer: false, values });
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

    /// Refuses a surface with an edge that an odd number of its triangles have; whether all of them turn one way.
    fn closed(&self, triangles: &[[u32; 3]]) -> Result<bool, MeshError> {
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
    /// Share of every cell that lies inside, by lines along x, and the lines on which that is doubtful.
    fn shares(&self, points: &[DVec3], triangles: &[[u32; 3]]) -> (Vec<f64>, usize) {
        let Self { origin, cell, n, .. } = *self;
        let spacing = cell / LINES as f64;
        // lines at places that vertices and edges of modelled parts are not at
        let [y0, z0] = [origin.y + 0.5 * spacing * 0.9871, origin.z + 0.5 * spacing * 1.0167];
        let lines = [n[1] * LINES, n[2] * LINES];
        let mut crossings: Vec<(usize, Crossing)> = Vec::new();
        for t in triangles {
            let [a, b, c] = t.map(|v| points[v as usize]);
            let range = |axis: usize, start: f64, count: usize| {
                let ends = [a[axis], b[axis], c[axis]];
                let low = ends.into_iter().fold(f64::INFINITY, f64::min);
                let high = ends.into_iter().fold(f64::NEG_INFINITY, f64::max);
                let first = ((low - start) / spacing).floor().max(0.0) as usize;
                let last = ((high - start) / spacing).ceil().max(0.0) as usize;
                first..(last + 1).min(count)
            };
            for j in range(1, y0, lines[0]) {
                let y = y0 + j as f64 * spacing;
                for k in range(2, z0, lines[1]) {
                    let z = z0 + k as f64 * spacing;
                    let found = crossing(points, *t, [y, z]);
                    crossings.extend(found.map(|x| (j * lines[1] + k, x)));
                }
            }
        }
        crossings.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.x.total_cmp(&b.1.x)));
        let mut filled = vec![0.0; n[0] * n[1] * n[2]];
        let mut doubtful = 0;
        let part = 1.0 / (LINES * LINES) as f64;
        for line in crossings.chunk_by(|a, b| a.0 == b.0) {
            let (j, k) = (line[0].0 / lines[1], line[0].0 % lines[1]);
            let row = |i: usize| index([i, j / LINES, k / LINES], n);
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
                    filled[row(i)] += part * (to.min(x + 1.0) - from.max(x)).max(0.0);
                }
            }
            doubtful += usize::from(step(&line[line.len() - 1].1));
        }
        (filled, doubtful)
    }
}

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
fn kept(filled: &[f64], n: [usize; 3]) -> (Vec<[usize; 3]>, [usize; 2]) {
    let [nx, ny, nz] = n;
    let all =
        || (0..nx).flat_map(move |i| (0..ny).flat_map(move |j| (0..nz).map(move |k| [i, j, k])));
    let enough = |at: [usize; 3]| filled[index(at, n)] >= LEAST_FILLED;
    let nearly_empty = filled.iter().filter(|share| **share > 0.0 && **share < LEAST_FILLED);
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
            sum += filled[index(at, n)];
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
            }
        }
    }

    /// Planes of a box lie on those of the lattice, or cut its cells in two.
    #[test]
    fn shares_of_a_box_are_exact_along_x() {
        let mesh = box_tets(DVec3::new(0.35, 0.2, 0.1), [3, 2, 1]).unwrap();
        let (lattice, report) = mesh.lattice(0.1).unwrap();
        assert_eq!(lattice.hexahedra.len(), 8);
        assert!((report.held / 0.007 - 1.0).abs() < 1e-9, "{report:?}");
        let shares = &lattice.data(FILLED).unwrap().values.hexahedra;
        let at_ends = shares.iter().filter(|s| (*s - 0.75).abs() < 1e-9).count();
        assert_eq!(at_ends, 4, "{shares:?}");
        assert!((lattice.bounds().unwrap().0.x + 0.025).abs() < 1e-15);
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
