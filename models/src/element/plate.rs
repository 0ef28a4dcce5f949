//! How the angles at the edges of a triangulated plate store energy: constants from plate theory, for any
//! triangulation. Plain numbers.
//!
//! ```text
//! E   = sum_T A_T/2 (lambda tr(k)^2 + 2 mu k:k) = 1/2 theta^T C theta          lambda, mu in N m
//! k   = 1/A_T sum_e l_e p_{T,e} n_e n_e^T                                       of triangle T, over its three edges
//! ```
//!
//! `theta_e` is the angle at edge `e`, which is where the slope across it jumps. Of that jump the part `p_{T,e}` lies between
//! triangle `T` and the slope in the middle of the edge, and the rest between there and the neighbour. So the slope in
//! the middle is one number for both, as in Morley's plate element (L. S. D. Morley, Aeronautical Quarterly 19, 1968), and
//! constant moments are in equilibrium whatever the mesh. There that slope is an unknown of its own. Here it follows from the
//! angles round the two triangles: a plate of constant curvature `H` gives the angles `theta_x = r_x : H` and the part
//! `p = r_{T,e} : H`, and
//!
//! ```text
//! p_{T,e} = sum_x c_x theta_x    with sum_x c_x r_x = r_{T,e}    and c as near as possible to (A_T / (A_T + A_T'), 0, ...)
//! r_{T,e} = (q^2 - l^2/4)/(2h) t t^T - q (t n^T + n t^T)/2 + h/2 n n^T,    r_x = sum of those of its two triangles
//! ```
//!
//! for a triangle of height `h` over an edge of direction `t` and outward normal `n`, whose corner lies `q` beside the
//! middle of the edge. Angles `x` are those at the edges of both triangles: five inside of a mesh. Then constant curvature
//! is exact too, on any mesh, and the deflection converges. Hinges without these couplings, and any element of one
//! triangle with its three neighbours, depend on the pattern of the mesh however fine it is ("Bending" in
//! `docs/numbers.md`).
//!
//! No moment acts across a free edge: the curvature that follows from that is eliminated in its triangle.
//!
//! On a curved rest shape the triangles round an edge are laid out in its plane.

use std::collections::BTreeMap;

use super::projection::symmetric_eigen;

/// Triangles with their neighbours. Vertices of a triangle ascend; edge `i` lies opposite vertex `i`.
#[derive(Clone, Debug, Default)]
pub struct Neighbours {
    /// Vertices of the triangles.
    triangles: Vec<[u32; 3]>,
    /// Hinge at every edge, where it has one.
    hinge_at: Vec<[Option<u32>; 3]>,
    /// The two triangles of every hinge, with the number of their edge.
    sides: Vec<[(u32, usize); 2]>,
    /// Vertices of every hinge: the edge, and the corners opposite to it.
    nodes: Vec<[u32; 4]>,
}

/// An edge that more than two triangles have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Branching {
    /// Its ends.
    pub edge: [u32; 2],
    /// Number of triangles.
    pub count: usize,
}

/// Ends of an edge of a triangle, the lower first.
fn ends(triangle: [u32; 3], i: usize) -> [u32; 2] {
    let [a, b, c] = triangle;
    [[b, c], [a, c], [a, b]][i]
}

/// Whether edge `i`, from its lower end to the higher one, then its opposite vertex, go round as the vertices do.
fn turns(i: usize) -> f64 {
    [1.0, -1.0, 1.0][i]
}

impl Neighbours {
    /// Of triangles whose vertices ascend.
    ///
    /// # Errors
    /// When more than two have an edge.
    pub fn new(triangles: Vec<[u32; 3]>) -> Result<Self, Branching> {
        let all = (0_u32..).zip(&triangles);
        let mut edges: Vec<_> =
            all.flat_map(|(t, &nodes)| (0..3).map(move |i| (ends(nodes, i), t, i))).collect();
        edges.sort_unstable();
        let mut own = Self { hinge_at: vec![[None; 3]; triangles.len()], ..Self::default() };
        for round in edges.chunk_by(|a, b| a.0 == b.0) {
            let edge = round[0].0;
            match *round {
                [_] => {}
                [(_, t, i), (_, s, j)] => {
                    let hinge = own.nodes.len() as u32;
                    own.hinge_at[t as usize][i] = Some(hinge);
                    own.hinge_at[s as usize][j] = Some(hinge);
                    own.sides.push([(t, i), (s, j)]);
                    let corners = [triangles[t as usize][i], triangles[s as usize][j]];
                    own.nodes.push([edge[0], edge[1], corners[0], corners[1]]);
                }
                _ => return Err(Branching { edge, count: round.len() }),
            }
        }
        own.triangles = triangles;
        Ok(own)
    }

    /// Vertices of all hinges: the ends of the edge, the lower first, then the corners opposite to it.
    pub fn hinges(&self) -> &[[u32; 4]] {
        &self.nodes
    }

    /// What lies beyond an edge of a triangle.
    fn beyond(&self, t: u32, i: usize) -> Option<(u32, usize)> {
        let sides = self.sides[self.hinge_at[t as usize][i]? as usize];
        Some(if sides[0] == (t, i) { sides[1] } else { sides[0] })
    }

    /// 1 where the normal of a hinge is that of a triangle as its vertices ascend, else -1.
    fn sign(&self, hinge: u32, (t, i): (u32, usize)) -> f64 {
        if self.sides[hinge as usize][0] == (t, i) { turns(i) } else { -turns(i) }
    }

    /// Hinges that a triangle's energy depends on: at its edges and at those of its neighbours.
    fn round(&self, t: u32) -> Vec<u32> {
        let mut found = Vec::new();
        for i in 0..3 {
            let Some(hinge) = self.hinge_at[t as usize][i] else { continue };
            found.push(hinge);
            if let Some((s, _)) = self.beyond(t, i) {
                found.extend(self.hinge_at[s as usize].iter().flatten());
            }
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Pairs of vertices, the lower first, that the energy of some triangle couples.
    pub fn couplings(&self) -> Vec<[u32; 2]> {
        let mut pairs = Vec::new();
        for t in 0..self.triangles.len() as u32 {
            let mut nodes: Vec<u32> =
                self.round(t).iter().flat_map(|&h| self.nodes[h as usize]).collect();
            nodes.sort_unstable();
            nodes.dedup();
            for (i, &b) in nodes.iter().enumerate() {
                pairs.extend(nodes[..i].iter().map(|&a| [a, b]));
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }
}

/// Entries of `C` (J) in rows: hinges that a hinge is coupled with, itself among them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Couplings {
    /// First entry of every row; one more than rows.
    pub start: Vec<u32>,
    /// Hinge of every entry, ascending in a row.
    pub hinge: Vec<u32>,
    /// Its value (J).
    pub value: Vec<f64>,
}

/// A plane vector.
type Plane = [f64; 2];

/// Of symmetric matrices: `xx`, `yy` and `2 xy` of `n n^T`.
fn square([x, y]: Plane) -> [f64; 3] {
    [x * x, y * y, 2.0 * x * y]
}

fn product(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// An edge of a triangle, laid out in a plane.
#[derive(Clone, Copy, Debug, Default)]
struct Side {
    /// Length (m).
    length: f64,
    /// Height of the triangle over it (m).
    height: f64,
    /// How far the corner lies beside its middle, towards the higher end (m).
    beside: f64,
}

/// Part `r : H` of the jump of slopes at an edge that belongs to the triangle on one side, as factors of `H_xx`, `H_yy` and
/// `sqrt(2) H_xy`, whose lengths do not depend on the axes; `tangent` points to the higher end, `outward` away from the triangle.
fn part(side: &Side, tangent: Plane, outward: Plane) -> [f64; 3] {
    let Side { length, height, beside } = *side;
    let along = 0.5 * (beside * beside - 0.25 * length * length) / height;
    let [t, n] = [tangent, outward];
    let mixed = [t[0] * n[0], t[1] * n[1], t[0] * n[1] + t[1] * n[0]];
    let [tt, nn] = [square(t), square(n)];
    let entry = |i: usize| along * tt[i] - beside * mixed[i] + 0.5 * height * nn[i];
    [entry(0), entry(1), std::f64::consts::FRAC_1_SQRT_2 * entry(2)]
}

/// The plate on its triangles.
struct Plate<'a> {
    near: &'a Neighbours,
    sides: Vec<[Side; 3]>,
    area: Vec<f64>,
}

/// A triangle that is laid out in the plane: tangents and outward normals of its edges.
type Frames = [(Plane, Plane); 3];

impl Plate<'_> {
    /// Frames of a triangle at these places of its vertices.
    fn frames(places: &[Plane; 3]) -> Frames {
        std::array::from_fn(|i| {
            let (from, to) = [(1, 2), (0, 2), (0, 1)][i];
            let [a, b, corner] = [places[from], places[to], places[i]];
            let d = [b[0] - a[0], b[1] - a[1]];
            let length = d[0].hypot(d[1]);
            let t = [d[0] / length, d[1] / length];
            let n = [t[1], -t[0]];
            let inward = (corner[0] - a[0]) * n[0] + (corner[1] - a[1]) * n[1] > 0.0;
            (t, if inward { [-n[0], -n[1]] } else { n })
        })
    }

    /// Places of the vertices of a triangle of its own.
    fn laid_out(&self, t: u32) -> [Plane; 3] {
        let Side { length, height, beside } = self.sides[t as usize][2];
        [[0.0, 0.0], [length, 0.0], [0.5 * length + beside, height]]
    }

    /// Places of the vertices of what lies beyond edge `i` of a triangle at `places`.
    fn continued(
        &self,
        (t, i): (u32, usize),
        places: &[Plane; 3],
        frames: &Frames,
        (s, j): (u32, usize),
    ) -> [Plane; 3] {
        let (tangent, outward) = frames[i];
        let Side { length, height, beside } = self.sides[s as usize][j];
        let own = self.near.triangles[t as usize];
        let lower = places[if i == 0 { 1 } else { 0 }];
        let corner: Plane = std::array::from_fn(|x| {
            lower[x] + (0.5 * length + beside) * tangent[x] + height * outward[x]
        });
        let other = self.near.triangles[s as usize];
        std::array::from_fn(|v| match own.iter().position(|&w| w == other[v]) {
            Some(k) if v != j => places[k],
            _ => corner,
        })
    }

    /// The jump at edge `i` of a triangle in a plate of constant curvature.
    fn jump(&self, (t, i): (u32, usize), frame: (Plane, Plane)) -> Option<[f64; 3]> {
        let (s, j) = self.near.beyond(t, i)?;
        let (tangent, outward) = frame;
        let own = part(&self.sides[t as usize][i], tangent, outward);
        let other = part(&self.sides[s as usize][j], tangent, outward.map(|x| -x));
        Some(std::array::from_fn(|x| own[x] + other[x]))
    }

    /// Part `p_{T,e}` of a triangle at its edge `i`: hinges with their factors, by the normal of the triangle.
    fn shares(&self, t: u32, i: usize, places: &[Plane; 3], frames: &Frames) -> Vec<(u32, f64)> {
        let near = self.near;
        let Some((s, j)) = near.beyond(t, i) else { return Vec::new() };
        let at = |t: u32, i: usize| near.hinge_at[t as usize][i];
        let Some(hinge) = at(t, i) else { return Vec::new() };
        let beyond = self.continued((t, i), places, frames, (s, j));
        let frames_beyond = Self::frames(&beyond);
        // the neighbour's normal by that of the triangle
        let turned = near.sign(hinge, (t, i)) * near.sign(hinge, (s, j));
        let mut known: Vec<(u32, f64, [f64; 3])> = Vec::new();
        for (t, skip, frames, turned) in
            [(t, None, frames, 1.0), (s, Some(j), &frames_beyond, turned)]
        {
            for k in (0..3).filter(|&k| Some(k) != skip) {
                if let (Some(x), Some(jump)) = (at(t, k), self.jump((t, k), frames[k]))
                    && known.iter().all(|(y, ..)| *y != x)
                {
                    known.push((x, turned * near.sign(x, (t, k)), jump));
                }
            }
        }
        let own_share = self.area[t as usize] / (self.area[t as usize] + self.area[s as usize]);
        let start = |x: u32| if x == hinge { own_share } else { 0.0 };
        let mut wanted = part(&self.sides[t as usize][i], frames[i].0, frames[i].1);
        let mut normal = [[0.0; 3]; 3];
        for (x, _, jump) in &known {
            for a in 0..3 {
                wanted[a] -= start(*x) * jump[a];
                for b in 0..3 {
                    normal[a][b] += jump[a] * jump[b];
                }
            }
        }
        // where too few angles are known, what they tell and no more
        let (values, vectors) = symmetric_eigen(normal, true);
        let largest = values.into_iter().fold(0.0, f64::max);
        let mut factor = [0.0; 3];
        for (k, &value) in values.iter().enumerate().filter(|(_, v)| **v > TELLING * largest) {
            let along = (0..3).map(|a| vectors[a][k] * wanted[a]).sum::<f64>() / value;
            (0..3).for_each(|a| factor[a] += along * vectors[a][k]);
        }
        known
            .iter()
            .map(|(x, sign, jump)| (*x, sign * (start(*x) + product(jump, &factor))))
            .collect()
    }
}

/// Curvatures of which the angles tell less than this share of what they tell of the others are left out.
const TELLING: f64 = 1e-3;

/// Entries of `C` for triangles with rest positions `rest_of` (m) and the moduli `lambda`, `mu` (N m) of the plate.
pub fn couplings(
    near: &Neighbours,
    rest_of: impl Fn(u32) -> [f64; 3],
    [lambda, mu]: [f64; 2],
) -> Couplings {
    let mut plate = Plate { near, sides: Vec::new(), area: Vec::new() };
    for &nodes in &near.triangles {
        let sides: [Side; 3] = std::array::from_fn(|i| {
            let [a, b] = ends(nodes, i);
            let sub = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
            let edge = sub(rest_of(b), rest_of(a));
            let corner = sub(rest_of(nodes[i]), rest_of(a));
            let length = product(&edge, &edge).sqrt();
            let along = product(&edge, &corner) / length;
            let height: [f64; 3] = std::array::from_fn(|x| corner[x] - along * edge[x] / length);
            let height = product(&height, &height).sqrt();
            Side { length, height, beside: along - 0.5 * length }
        });
        plate.area.push(0.5 * sides[0].length * sides[0].height);
        plate.sides.push(sides);
    }
    let mut rows: Vec<BTreeMap<u32, f64>> = vec![BTreeMap::new(); near.nodes.len()];
    for t in 0..near.triangles.len() as u32 {
        let area = plate.area[t as usize];
        let places = plate.laid_out(t);
        let frames = Plate::frames(&places);
        let mut moduli =
            [[lambda + 2.0 * mu, lambda, 0.0], [lambda, lambda + 2.0 * mu, 0.0], [0.0, 0.0, mu]];
        let mut curvature: BTreeMap<u32, [f64; 3]> = BTreeMap::new();
        for i in 0..3 {
            let nn = square(frames[i].1);
            if near.hinge_at[t as usize][i].is_none() {
                relax(&mut moduli, &nn);
                continue;
            }
            let length = plate.sides[t as usize][i].length;
            for (x, share) in plate.shares(t, i, &places, &frames) {
                let own = curvature.entry(x).or_default();
                (0..3).for_each(|a| own[a] += share * length / area * nn[a]);
            }
        }
        for (&x, k) in &curvature {
            let moment = moduli.map(|row| area * product(&row, k));
            for (&y, k) in &curvature {
                *rows[x as usize].entry(y).or_default() += product(&moment, k);
            }
        }
    }
    let mut all = Couplings { start: vec![0], ..Couplings::default() };
    for row in rows {
        for (hinge, value) in row {
            all.hinge.push(hinge);
            all.value.push(value);
        }
        all.start.push(all.hinge.len() as u32);
    }
    all
}

/// Moduli where no moment acts along `nn`.
fn relax(moduli: &mut [[f64; 3]; 3], nn: &[f64; 3]) {
    let moment = moduli.map(|row| product(&row, nn));
    let stiffness = product(&moment, nn);
    let size = moduli[0][0].abs() + moduli[1][1].abs() + moduli[2][2].abs();
    // without any stiffness left there is nothing to relax
    if stiffness > 1e-12 * size {
        for a in 0..3 {
            for b in 0..3 {
                moduli[a][b] -= moment[a] * moment[b] / stiffness;
            }
        }
    }
}
