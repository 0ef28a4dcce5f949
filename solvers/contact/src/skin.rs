//! Contact surfaces of bodies: areas and stiffness of points, and the boxes of the broad phase.

use crate::beside::facet_corners;
use crate::point::outer;
use crate::standing::encloses;
use glam::{DMat3, DVec3};
use sinew_engine::row::VertexRow;
use sinew_engine::surface::BodySurface;

/// Vertices per box of the broad phase. Vertex order is local, so a block is a patch.
const BLOCK: usize = 64;

/// First number in keys of points that cuts made.
const MADE: u32 = 1 << 31;

/// Points of surfaces that cuts made: means of vertex rows. They have numbers as rows have, from that of the rows of the world on.
#[derive(Clone, Debug)]
pub(crate) struct MadePoints {
    first: u32,
    /// Where those of each start in `shares`; one more than points.
    start: Vec<u32>,
    /// Rows of all and their shares.
    shares: Vec<(VertexRow, f64)>,
}

impl Default for MadePoints {
    fn default() -> Self {
        Self::none(u32::MAX as usize)
    }
}

impl MadePoints {
    /// None, in a world of so many rows.
    pub fn none(rows: usize) -> Self {
        Self { first: rows as u32, start: vec![0], shares: Vec::new() }
    }

    /// Adds those of a body with this first row; the number of the first of them.
    pub fn push(&mut self, surface: &BodySurface, first: VertexRow) -> u32 {
        let from = self.first + self.start.len() as u32 - 1;
        for point in &surface.points {
            self.shares.extend(point.shares().map(|(row, own)| (VertexRow(row + first.0), own)));
            self.start.push(self.shares.len() as u32);
        }
        from
    }

    /// Rows that a row or point is a mean of, with their shares.
    pub fn rows(&self, of: VertexRow) -> impl Iterator<Item = (VertexRow, f64)> {
        let range = of.0.checked_sub(self.first).and_then(|made| {
            let ends = self.start.get(made as usize..made as usize + 2)?;
            Some(ends[0] as usize..ends[1] as usize)
        });
        let alone = range.is_none().then_some((of, 1.0));
        self.shares[range.unwrap_or(0..0)].iter().copied().chain(alone)
    }

    /// Calls `f` with all rows that some rows and points with their shares are means of; one may come several times.
    pub fn expand<const N: usize>(
        &self,
        rows: [VertexRow; N],
        weights: [f64; N],
    ) -> impl Iterator<Item = (VertexRow, f64)> {
        let used = rows.into_iter().zip(weights).filter(|(_, weight)| *weight != 0.0);
        used.flat_map(|(of, weight)| self.rows(of).map(move |(row, own)| (row, weight * own)))
    }

    /// A column of rows for rows and points.
    #[inline]
    pub fn mean(&self, of: VertexRow, column: &(impl Fn(VertexRow) -> DVec3 + ?Sized)) -> DVec3 {
        if of.0 < self.first {
            return column(of);
        }
        self.rows(of).map(|(row, weight)| weight * column(row)).sum()
    }
}

/// The contact surface of a body, or the part of it that a tool may touch.
#[derive(Clone, Debug, Default)]
pub(crate) struct ContactSkin {
    /// Vertex rows of the world, and points that cuts made, ascending.
    pub rows: Vec<VertexRow>,
    /// Rest position (m) of each.
    pub rest: Vec<DVec3>,
    /// Number of the first point that a cut could make.
    first_made: u32,
    /// Faces up to here were laid open by cuts.
    wounds: usize,
    /// Of every vertex of a wound those that are at most two edges away along the surface, itself included, ascending; of others
    /// none.
    round_wounds: Vec<Vec<u32>>,
    /// Share of each (m^2, at rest) in the faces round it: the integral of its shape function.
    pub area: Vec<f64>,
    /// Young's modulus (Pa) there.
    pub young: Vec<f64>,
    /// Triangles and faces with four corners, as places in `rows`; outward, but for those of membranes. The last two
    /// corners of a triangle are the same.
    pub faces: Vec<[u32; 4]>,
    /// Rest area (m^2) per unit of the area in which shape functions are measured, at every corner.
    pub corner_area: Vec<[f64; 4]>,
    /// Faces from here on are membranes, which have two sides.
    pub sheets: usize,
    /// Edges of membranes that belong to one face alone, ascending.
    rims: Vec<[u32; 2]>,
    /// Mean edge (m) of the faces at rest.
    pub edge: f64,
    /// All of its vertices are held in this step: a wall.
    pub held: bool,
    /// Places (m) of the vertices at the start of the step.
    pub at: Vec<DVec3>,
    /// Places (m) at which distances of other points from the faces were last taken.
    pub seen: Vec<DVec3>,
    /// Outward unit normals at the start of the step; zero at vertices of membranes.
    pub normals: Vec<DVec3>,
    /// Ways (m) that they would go in the step with the velocities of its start.
    pub motion: Vec<DVec3>,
    /// How far (m) each may come in the step.
    pub way: Vec<f64>,
    /// Boxes of blocks, grown by that.
    boxes: Vec<[DVec3; 2]>,
    /// The box of all.
    pub hull: [DVec3; 2],
}

impl ContactSkin {
    /// Of a body whose first vertex row is `first`, and the first point that cuts made `made`; `rest` are the rest positions (m)
    /// of all rows and such points. With `only`, triangles of world rows, of those of them that belong to the body.
    pub fn new(
        surface: &BodySurface,
        [first, made]: [u32; 2],
        rest: &dyn Fn(VertexRow) -> DVec3,
        only: Option<&[[VertexRow; 3]]>,
    ) -> Self {
        let own_rows = (surface.young_modulus.len() - surface.points.len()) as u32;
        let in_world = |v: u32| VertexRow(v.checked_sub(own_rows).map_or(v + first, |p| p + made));
        let in_body = |row: VertexRow| match surface.points.is_empty() || row.0 < made {
            true => row.0 - first,
            false => row.0 - made + own_rows,
        };
        let world = |f: [u32; 4]| f.map(in_world);
        let mut faces: Vec<Face> = joined(&surface.triangles, surface.halves).map(world).collect();
        let mut solid: Vec<Face> = faces.iter().flat_map(parts_of).collect();
        solid.sort_unstable();
        let (mut sheets, mut wounds) = (faces.len(), surface.wounds);
        // a membrane that covers a solid is touched as the solid is
        let covers = |part: &Face| solid.binary_search(part).is_ok();
        let bare = |f: &Face| {
            let parts: Vec<Face> = parts_of(f).collect();
            !covers(&parts[0]) && !parts[1..].chunks(2).any(|cut| cut.iter().all(covers))
        };
        let mut bare: Vec<Face> =
            joined(&surface.sheets, surface.sheet_halves).map(world).filter(bare).collect();
        turn_alike(&mut bare);
        faces.append(&mut bare);
        if let Some(only) = only {
            let triangle = |&[a, b, c]: &[VertexRow; 3]| sorted([a, b, c, c]);
            let mut wanted: Vec<Face> = only.iter().map(triangle).collect();
            wanted.sort_unstable();
            let keep = |f: &Face| parts_of(f).any(|part| wanted.binary_search(&part).is_ok());
            [wounds, sheets] =
                [wounds, sheets].map(|n| faces[..n].iter().filter(|f| keep(f)).count());
            faces.retain(keep);
        }
        let mut rows: Vec<VertexRow> = faces.iter().flatten().copied().collect();
        rows.sort_unstable();
        rows.dedup();
        let mut skin = Self { sheets, wounds, first_made: made, ..Self::default() };
        let place = |row| rows.binary_search(&row).unwrap_or(0) as u32;
        skin.area = vec![0.0; rows.len()];
        let mut length = 0.0;
        for face in &faces {
            let x = face.map(rest);
            let corner_area = corner_areas(x);
            let local = face.map(place);
            for (v, share) in local.into_iter().zip(shares(local, corner_area)) {
                skin.area[v as usize] += share;
            }
            length += mean_edge(x);
            skin.faces.push(local);
            skin.corner_area.push(corner_area);
        }
        skin.edge = if faces.is_empty() { 0.0 } else { length / faces.len() as f64 };
        skin.rims = rims(&skin.faces[sheets..]);
        let young = |row: &VertexRow| surface.young_modulus.get(in_body(*row) as usize).copied();
        skin.young = rows.iter().map(|row| young(row).unwrap_or(0.0)).collect();
        skin.rest = rows.iter().map(|row| rest(*row)).collect();
        skin.rows = rows;
        if wounds > 0 {
            skin.round_wounds = skin.rings();
        }
        skin
    }

    /// See [`round_wounds`](Self::round_wounds).
    fn rings(&self) -> Vec<Vec<u32>> {
        let mut next: Vec<Vec<u32>> = vec![Vec::new(); self.rows.len()];
        for face in &self.faces {
            corners(face).iter().for_each(|v| next[*v as usize].extend(corners(face)));
        }
        let mut rings = vec![Vec::new(); self.rows.len()];
        for &v in self.faces[..self.wounds].iter().flatten() {
            let ring: &mut Vec<u32> = &mut rings[v as usize];
            if ring.is_empty() {
                ring.extend(next[v as usize].iter().flat_map(|w| &next[*w as usize]));
                ring.sort_unstable();
                ring.dedup();
            }
        }
        rings
    }

    /// What stands in keys for a row or a point that a cut made: the same whatever is cut later.
    pub fn key(&self, row: VertexRow) -> VertexRow {
        VertexRow(row.0.checked_sub(self.first_made).map_or(row.0, |made| MADE + made))
    }

    /// Whether a vertex cannot touch a face since it is near at rest. Of the two sides of a wound it can, unless it is near along the surface.
    pub fn near_at_rest(&self, vertex: usize, face: usize) -> bool {
        let here = self.rest[vertex];
        let is_near = |v: &u32| {
            *v as usize == vertex || self.rest[*v as usize].distance(here) < 2.0 * self.edge
        };
        let own = corners(&self.faces[face]);
        let round =
            self.round_wounds.get(vertex).filter(|round| face < self.wounds && !round.is_empty());
        let along = |round: &Vec<u32>| own.iter().any(|v| round.binary_search(v).is_ok());
        own.iter().any(is_near) && round.is_none_or(along)
    }

    /// Whether it was at rest at the last [refit](Self::refit), and is at rest there now.
    fn rests(&self, x: &dyn Fn(VertexRow) -> DVec3, v: &dyn Fn(VertexRow) -> DVec3) -> bool {
        let own = self.rows.iter().zip(self.at.iter().zip(&self.motion));
        let rests = |(&row, (at, motion)): (&VertexRow, (&DVec3, &DVec3))| {
            *motion == DVec3::ZERO && v(row) == DVec3::ZERO && x(row) == *at
        };
        self.at.len() == self.rows.len() && own.into_iter().all(rests)
    }

    /// Takes the places (m) at the start of a step of `dt` (s), and velocities (m/s), of all rows.
    pub fn refit(
        &mut self,
        dt: f64,
        x: &dyn Fn(VertexRow) -> DVec3,
        v: &dyn Fn(VertexRow) -> DVec3,
    ) {
        if self.rests(x, v) {
            // trial states of a step that was undone may have been seen
            self.seen.clone_from(&self.at);
            return;
        }
        self.at.clear();
        self.at.extend(self.rows.iter().map(|&row| x(row)));
        self.seen.clone_from(&self.at);
        self.motion.clear();
        self.motion.extend(self.rows.iter().map(|&row| v(row) * dt));
        self.way.clear();
        let edge = self.edge;
        self.way.extend(self.motion.iter().map(|motion| way_of(*motion, edge)));
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

    /// How far (m) each vertex may come in the step beside what all of them move alike.
    pub fn ways_within(&self) -> Vec<f64> {
        let rigid = RigidMotion::of(&self.at, &self.motion);
        let beside = |(at, motion): (&DVec3, &DVec3)| way_of(*motion - rigid.at(*at), self.edge);
        self.at.iter().zip(&self.motion).map(beside).collect()
    }

    /// Largest way (m) that a vertex has come in the step beside what all of them moved alike, where they are at `x` (m) now.
    pub fn largest_way(&self, x: &dyn Fn(VertexRow) -> DVec3) -> f64 {
        let ways = self.rows.iter().zip(&self.at).map(|(row, at)| x(*row) - *at);
        let motion: Vec<DVec3> = ways.collect();
        let rigid = RigidMotion::of(&self.at, &motion);
        let beside = |(at, motion): (&DVec3, &DVec3)| (*motion - rigid.at(*at)).length();
        self.at.iter().zip(&motion).map(beside).fold(0.0, f64::max)
    }

    /// The box (m) of a face at the start of the step, and how far (m) its vertices may come in it, given `ways` (m) of all.
    pub fn bounds(&self, face: usize, ways: &[f64]) -> ([DVec3; 2], f64) {
        let mut own = EMPTY;
        let mut way = 0.0_f64;
        for &v in corners(&self.faces[face]) {
            let at = self.at[v as usize];
            own = [own[0].min(at), own[1].max(at)];
            way = way.max(ways[v as usize]);
        }
        (own, way)
    }

    /// Triangles in the form of [`Facet`](crate::beside::Facet) that a face consists of, as places in `rows`.
    pub fn facets(&self, face: usize) -> impl Iterator<Item = [u32; 4]> + use<> {
        let [a, b, c, d] = self.faces[face];
        let count = if c == d { 1 } else { 4 };
        [[a, b, c, d], [b, c, d, a], [c, d, a, b], [d, a, b, c]].into_iter().take(count)
    }

    /// Whether a point of a facet, by the shares of its corners, lies on the rim of a membrane.
    pub fn on_rim(&self, facet: [u32; 4], weights: [f64; 3]) -> bool {
        let used: Vec<u32> =
            facet.into_iter().zip(weights).filter(|(_, w)| *w > 1e-9).map(|(v, _)| v).collect();
        let is_rim = |[a, b]: [u32; 2]| self.rims.binary_search(&[a.min(b), a.max(b)]).is_ok();
        // the third corner may be the middle of a face
        let middle = facet[2] != facet[3] && weights[2] > 1e-9;
        match used[..] {
            [a] if !middle => self.rims.iter().any(|rim| rim.contains(&a)),
            [a, b] if !middle => is_rim([a, b]),
            _ => false,
        }
    }

    /// Area normal (m^2) of a face at the start of the step.
    fn area_normal(&self, face: usize) -> DVec3 {
        let [a, b, c, d] = self.faces[face].map(|v| self.at[v as usize]);
        // of a triangle, `d` is `c`
        0.5 * (c - a).cross(d - b)
    }

    /// Outward unit normal of a face at the start of the step; zero for a membrane.
    pub fn outward(&self, face: usize) -> DVec3 {
        if face < self.sheets { self.area_normal(face).normalize_or_zero() } else { DVec3::ZERO }
    }

    /// Whether its solids go round a point at the start of the step.
    pub fn encloses(&self, p: DVec3) -> bool {
        let x = |row: VertexRow| self.at[row.index()];
        let facets = (0..self.sheets).flat_map(|face| self.facets(face));
        self.hull[0].cmple(p).all()
            && p.cmple(self.hull[1]).all()
            && encloses(p, facets.map(|f| facet_corners(&f.map(VertexRow), &x)))
    }

    /// Finds the normals of the vertices, where something is near.
    pub fn find_normals(&mut self) {
        if !self.normals.is_empty() {
            return;
        }
        let mut normals = vec![DVec3::ZERO; self.rows.len()];
        for face in 0..self.sheets {
            let normal = self.area_normal(face);
            for &v in corners(&self.faces[face]) {
                normals[v as usize] += normal;
            }
        }
        self.normals = normals.into_iter().map(DVec3::normalize_or_zero).collect();
    }

    /// Calls `f` with the places in `rows` of all vertices whose blocks meet something by their boxes (m).
    pub fn near(&self, meets: impl Fn(&[DVec3; 2]) -> bool, mut f: impl FnMut(usize)) {
        if !meets(&self.hull) {
            return;
        }
        for (block, own) in self.boxes.iter().enumerate() {
            if meets(own) {
                let end = ((block + 1) * BLOCK).min(self.rows.len());
                (block * BLOCK..end).for_each(&mut f);
            }
        }
    }

    /// Rest area (m^2) round a point of a face, given by the shares of its corners, if it stood for the whole face.
    pub fn part_area(&self, face: usize, weights: &[f64; 4]) -> f64 {
        self.corner_area[face].iter().zip(weights).map(|(area, weight)| area * weight).sum()
    }

    /// Mean of a vertex column over a face.
    pub fn mean(&self, column: &[f64], face: usize) -> f64 {
        let own = corners(&self.faces[face]);
        own.iter().map(|&v| column[v as usize]).sum::<f64>() / own.len() as f64
    }
}

/// How far (m) a vertex may come that begins a step with this motion (m), on a surface with edges of this mean length (m): the
/// forces of the step change its speed.
fn way_of(motion: DVec3, edge: f64) -> f64 {
    1.5 * motion.length() + 0.25 * edge
}

/// What a surface moves as a whole in a step, as far as its start tells. Distances within it do not change by that.
#[derive(Clone, Copy, Debug, Default)]
struct RigidMotion {
    centre: DVec3,
    /// Way (m) of the centre, and turn (rad) about it.
    way: DVec3,
    turn: DVec3,
}

impl RigidMotion {
    /// That from which the motions (m) of some places (m) differ least.
    fn of(at: &[DVec3], motion: &[DVec3]) -> Self {
        let all = || at.iter().zip(motion);
        let count = all().count().max(1) as f64;
        let centre = all().map(|(at, _)| *at).sum::<DVec3>() / count;
        let way = all().map(|(_, motion)| *motion).sum::<DVec3>() / count;
        let (mut moment, mut spin, mut size) = (DMat3::ZERO, DVec3::ZERO, 0.0);
        for (at, motion) in all() {
            let arm = *at - centre;
            size += arm.length_squared();
            moment -= outer(arm, arm);
            spin += arm.cross(*motion - way);
        }
        moment += DMat3::from_diagonal(DVec3::splat(size));
        // none about the axis of a line
        let turn = moment.inverse() * spin;
        Self { centre, way, turn: if turn.is_finite() { turn } else { DVec3::ZERO } }
    }

    /// Way (m) that it takes a place.
    fn at(&self, x: DVec3) -> DVec3 {
        self.way + self.turn.cross(x - self.centre)
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

/// Vertex rows of a face; the last two of a triangle are the same.
type Face = [VertexRow; 4];

/// Corners of a face, each once.
pub(crate) fn corners<T: PartialEq>(face: &[T; 4]) -> &[T] {
    if face[2] == face[3] { &face[..3] } else { face }
}

/// The faces that triangles are, those from `halves` on two and two.
fn joined(triangles: &[[u32; 3]], halves: usize) -> impl Iterator<Item = [u32; 4]> + '_ {
    let (whole, halves) = triangles.split_at(halves.min(triangles.len()));
    let pairs = halves.as_chunks::<2>().0.iter().map(|&[[a, b, c], [_, _, d]]| [a, b, c, d]);
    whole.iter().map(|&[a, b, c]| [a, b, c, c]).chain(pairs)
}

/// Turns membrane faces, of any winding, so that those that share an edge show the same side.
fn turn_alike(faces: &mut [Face]) {
    // edge, face, and whether the face goes along it upward
    let mut edges: Vec<([VertexRow; 2], usize, bool)> = Vec::new();
    for (i, face) in faces.iter().enumerate() {
        edges.extend(round(corners(face)).map(|[a, b]| ([a.min(b), a.max(b)], i, a < b)));
    }
    edges.sort_unstable();
    // faces across edges, and whether they show the other side
    let mut across: Vec<(usize, usize, bool)> = Vec::new();
    for two in edges.chunk_by(|a, b| a.0 == b.0).filter(|of_edge| of_edge.len() == 2) {
        let opposed = two[0].2 == two[1].2;
        across.extend([(two[0].1, two[1].1, opposed), (two[1].1, two[0].1, opposed)]);
    }
    across.sort_unstable();
    let mut sides: Vec<Option<bool>> = vec![None; faces.len()];
    for seed in 0..faces.len() {
        if sides[seed].is_some() {
            continue;
        }
        sides[seed] = Some(false);
        let mut front = vec![seed];
        while let Some(own) = front.pop() {
            let first = across.partition_point(|(from, ..)| *from < own);
            for &(_, next, opposed) in across[first..].iter().take_while(|(from, ..)| *from == own)
            {
                if sides[next].is_none() {
                    sides[next] = sides[own].map(|turned| turned != opposed);
                    front.push(next);
                }
            }
        }
    }
    for (face, _) in faces.iter_mut().zip(sides).filter(|(_, turned)| *turned == Some(true)) {
        let [a, b, c, d] = *face;
        *face = if c == d { [b, a, c, c] } else { [a, d, c, b] };
    }
}

/// Edges of a face, from corner to corner.
fn round<T: Copy>(corners: &[T]) -> impl Iterator<Item = [T; 2]> + '_ {
    corners.iter().zip(corners.iter().cycle().skip(1)).map(|(&a, &b)| [a, b])
}

/// Edges of one face alone, ascending.
fn rims(faces: &[[u32; 4]]) -> Vec<[u32; 2]> {
    let mut edges = Vec::new();
    for face in faces {
        edges.extend(round(corners(face)).map(|[a, b]| [a.min(b), a.max(b)]));
    }
    edges.sort_unstable();
    edges.chunk_by(|a, b| a == b).filter(|same| same.len() == 1).map(|same| same[0]).collect()
}

fn sorted([a, b, c, d]: Face) -> Face {
    let mut f = [a, b, c, d];
    f.sort_unstable();
    // as it is written for triangles
    if f[0] == f[1] || f[1] == f[2] { [f[0], f[2], f[3], f[3]] } else { f }
}

/// A face in ascending order, and of one with four corners the triangles that it may be cut into, one cut after the
/// other.
fn parts_of(&[a, b, c, d]: &Face) -> impl Iterator<Item = Face> + use<> {
    let halves = [[a, b, c, c], [a, c, d, d], [b, c, d, d], [b, d, a, a]];
    let cut = if c == d { 0 } else { 4 };
    std::iter::once(sorted([a, b, c, d])).chain(halves.into_iter().take(cut).map(sorted))
}

/// Twice the area (m^2) of the triangle at each corner of a face with four corners, the area of a triangle at each of
/// its own: what the area is per unit of that of the shape functions.
fn corner_areas(x: [DVec3; 4]) -> [f64; 4] {
    let at = |i: usize, next: usize, last: usize| (x[next] - x[i]).cross(x[last] - x[i]).length();
    if x[2] == x[3] {
        return [0.5 * at(0, 1, 2); 4];
    }
    [at(0, 1, 3), at(1, 2, 0), at(2, 3, 1), at(3, 0, 2)]
}

/// Integrals of the shape functions of the corners over a face.
fn shares(face: [u32; 4], area: [f64; 4]) -> [f64; 4] {
    if face[2] == face[3] {
        let third = area[0] / 3.0;
        return [third, third, third, 0.0];
    }
    let of = |i: usize| {
        4.0 * area[i] + 2.0 * (area[(i + 1) % 4] + area[(i + 3) % 4]) + area[(i + 2) % 4]
    };
    [0, 1, 2, 3].map(|i| of(i) / 36.0)
}

/// Mean edge (m) of the triangles of a face, whichever way it is cut.
fn mean_edge([a, b, c, d]: [DVec3; 4]) -> f64 {
    let round = a.distance(b) + b.distance(c);
    if c == d {
        return (round + c.distance(a)) / 3.0;
    }
    (round + c.distance(d) + d.distance(a) + a.distance(c) + b.distance(d)) / 6.0
}

/// Shares of the corners at the points `faces(n)` of a face. Triangle: centres of `n^2` equal triangles, for 2 the three
/// Gauss points of second order. Four corners: `n` by `n` centres of equal parts, for 2 the Gauss points.
pub(crate) fn face_points(n: u32, four: bool) -> Vec<[f64; 4]> {
    if four {
        let place = |i: u32| match n {
            2 => 0.5 + (f64::from(i) - 0.5) / 3.0_f64.sqrt(),
            _ => (f64::from(i) + 0.5) / f64::from(n),
        };
        let both = (0..n).flat_map(|i| (0..n).map(move |j| (place(i), place(j))));
        return both
            .map(|(u, v)| [(1.0 - u) * (1.0 - v), u * (1.0 - v), u * v, (1.0 - u) * v])
            .collect();
    }
    if n == 2 {
        let (a, b) = (2.0 / 3.0, 1.0 / 6.0);
        return vec![[a, b, b, 0.0], [b, a, b, 0.0], [b, b, a, 0.0]];
    }
    let mut points = Vec::new();
    let size = 3.0 * f64::from(n);
    for i in 0..n {
        for j in 0..n - i {
            let mut add = |third: f64| {
                let (a, b) =
                    ((3.0 * f64::from(i) + third) / size, (3.0 * f64::from(j) + third) / size);
                points.push([1.0 - a - b, a, b, 0.0]);
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
            let points = face_points(n, false);
            assert_eq!(points.len(), if n == 2 { 3 } else { (n * n) as usize });
            for k in 0..3 {
                let mean = points.iter().map(|w| w[k]).sum::<f64>() / points.len() as f64;
                assert!((mean - 1.0 / 3.0).abs() < 1e-15);
            }
            assert!(points.iter().all(|w| (w.iter().sum::<f64>() - 1.0).abs() < 1e-15));
        }
    }

    #[test]
    fn points_on_faces_with_four_corners_integrate_over_a_trapezium() {
        let x = [[0.0, 0.0], [3.0, 0.0], [2.0, 1.0], [0.5, 1.0]];
        let x = x.map(|[x, y]| DVec3::new(x, y, 2.0));
        let area = corner_areas(x);
        for n in 2..=8 {
            let points = face_points(n, true);
            assert_eq!(points.len(), (n * n) as usize);
            let share = |w: &[f64; 4]| {
                w.iter().zip(area).map(|(w, a)| w * a).sum::<f64>() / points.len() as f64
            };
            let sum: f64 = points.iter().map(share).sum();
            assert!((sum - 2.25).abs() < 1e-14, "{n}: {sum}");
            for w in &points {
                assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-15);
            }
            if n > 2 {
                continue;
            }
            // exact for the shape functions
            for (k, exact) in shares([0, 1, 2, 3], area).into_iter().enumerate() {
                let integral: f64 = points.iter().map(|w| w[k] * share(w)).sum();
                assert!((integral - exact).abs() < 1e-14, "{k}: {integral} {exact}");
            }
        }
        assert!((shares([0, 1, 2, 3], area).iter().sum::<f64>() - 2.25).abs() < 1e-14);
    }

    #[test]
    fn areas_add_up_and_a_covered_membrane_counts_once() {
        let rest =
            [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::X + DVec3::Y, DVec3::new(0.5, 0.5, -1.0)];
        let surface = BodySurface {
            triangles: vec![[0, 1, 2], [1, 3, 2]],
            halves: 2,
            sheets: vec![[2, 1, 0], [0, 1, 4]],
            sheet_halves: 2,
            young_modulus: vec![1.0; 5],
            ..BodySurface::default()
        };
        let skin = ContactSkin::new(&surface, [0, 9], &|row| rest[row.index()], None);
        assert_eq!((skin.faces.len(), skin.sheets), (3, 2));
        let total: f64 = skin.area.iter().sum();
        let of_faces: f64 = skin.corner_area.iter().map(|area| area[0]).sum();
        assert!((total - of_faces).abs() < 1e-15);
        let only = ContactSkin::new(
            &surface,
            [0, 9],
            &|row| rest[row.index()],
            Some(&[[2, 3, 1].map(VertexRow)]),
        );
        assert_eq!((only.rows.len(), only.faces.len(), only.sheets), (3, 1, 1));
        assert!((only.area[0] - 1.0 / 6.0).abs() < 1e-15);
    }

    #[test]
    fn membranes_of_any_winding_show_one_side_and_know_their_rims() {
        let rest = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y, 2.0 * DVec3::X];
        let surface = BodySurface {
            sheets: vec![[0, 1, 2], [0, 3, 2], [2, 1, 4]],
            sheet_halves: 3,
            young_modulus: vec![1.0; 5],
            ..BodySurface::default()
        };
        let mut skin = ContactSkin::new(&surface, [0, 9], &|row| rest[row.index()], None);
        skin.refit(0.0, &|row| rest[row.index()], &|_| DVec3::ZERO);
        let up: Vec<f64> = (0..3).map(|face| skin.area_normal(face).z).collect();
        assert_eq!(up, [0.5; 3]);
        assert_eq!(skin.rims, [[0, 1], [0, 3], [1, 4], [2, 3], [2, 4]]);
        assert!(skin.on_rim([0, 1, 2, 2], [0.5, 0.5, 0.0]));
        assert!(!skin.on_rim([0, 1, 2, 2], [0.5, 0.0, 0.5]));
        assert!(skin.on_rim([0, 1, 2, 2], [0.0, 0.0, 1.0]));
    }

    #[test]
    fn a_face_with_four_corners_is_one_whatever_covers_it_and_however_it_is_cut() {
        let rest = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
        let skin = |sheets: Vec<[u32; 3]>, sheet_halves, only: Option<[u32; 3]>| {
            let surface = BodySurface {
                triangles: vec![[0, 1, 2], [0, 2, 3]],
                halves: 0,
                sheets,
                sheet_halves,
                young_modulus: vec![1.0; 4],
                ..BodySurface::default()
            };
            let only = only.map(|t| [t.map(VertexRow)]);
            ContactSkin::new(
                &surface,
                [0, 9],
                &|row| rest[row.index()],
                only.as_ref().map(|o| &o[..]),
            )
        };
        let alone = skin(vec![], 0, None);
        assert_eq!(alone.faces, [[0, 1, 2, 3]]);
        assert_eq!(alone.area, [0.25; 4]);
        // by a quadrilateral, by triangles of the other cut
        for (sheets, halves) in [(vec![[3, 2, 1], [3, 1, 0]], 0), (vec![[1, 0, 3], [1, 3, 2]], 2)] {
            assert_eq!(skin(sheets, halves, None).faces.len(), 1);
        }
        assert_eq!(skin(vec![], 0, Some([3, 0, 1])).faces.len(), 1);
        assert_eq!(skin(vec![], 0, Some([3, 3, 1])).faces.len(), 0);
    }
}
