//! The springs of Bourguignon & Cani 2000 in the form that the paper gives them, for tetrahedra (`N` = 4)
//! and hexahedra (`N` = 8), in the code's own letters. With the chords `l_i = sum_j spread_ij x_j` of three
//! axes, their directions `n_i` and lengths `|l_i|`:
//!
//! ```text
//! axial   (2.1)  f = -(k (|l| - L) + kd (ldot.n)) n              on the plus end, opposite on the minus end
//! angular (2.2)  f_i = -k m_ij n_j,  f_j = -k m_ij n_i,  m_ij = n_i.n_j - c_ij
//! volume  (3.1)  tetrahedron: f_j = -k (S - S_0) r_j,  S = sum_j |x_j - x_B|
//!         (4.1)  hexahedron:  f_j = -(k (|x_j - x_B| - R_j) + kd (v_j - v_B).r_j) r_j
//! ```
//!
//! `r_j` is the direction from the barycentre `x_B` to vertex j. All constants are those of one element (N/m,
//! N for angles, N s/m), so results depend on the mesh.
//!
//! What is wrong with them, and what stands beside them here:
//!
//! * The axial springs are right; their tangent and a semidefinite form of it are exact.
//! * The angular forces have no energy and a moment, `-k m (|l_i| - |l_j|) n_i x n_j`, unless the chords are
//!   equally long: a free element gains angular momentum and energy. [`AngularForm::Energy`] is the gradient of
//!   `kappa/2 m^2` (kappa in J).
//! * The volume forces have a resultant on irregular elements, which so propel themselves.
//!   [`VolumeForm::Balanced`] subtracts the mean force; that is the gradient of `k/2 (S - S_0)^2`, or of
//!   `sum_j k/2 (|x_j - x_B| - R_j)^2`. Neither measures volume: both are blind to inversion.
//!
//! Solvers need an energy and a tangent of the printed forces. They are given those of the energy form with
//! the same stiffness at rest, `kappa = k sqrt(L_i L_j)`, and of the balanced form. Explicit integrators use
//! the printed forces as they are (their watch over the energy may see it grow); implicit ones find an
//! equilibrium only as far as their line search, which goes by that energy, lets them.

use sinew::engine::scalar::{dot, scale, sub};
use sinew::models::axes::element::AXIS_PAIRS;
use sinew::models::axes::site::{Blocks, Nodes, add_spread, spread_over};
use sinew::models::element::matrix::{add_identity, add_outer, transposed};

/// Forces of the angular springs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AngularForm {
    /// As printed.
    Printed,
    /// With an energy.
    Energy,
}

/// Forces of the volume springs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VolumeForm {
    /// As printed.
    Printed,
    /// Without a resultant, which gives them an energy.
    Balanced,
}

/// Which second derivative.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Curvature {
    /// All of it.
    Exact,
    /// What is semidefinite: of the axial springs with tension across the chord where there is tension.
    Definite,
    /// `k g g^T` alone.
    GaussNewton,
}

/// Springs along three axes of an element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxialSprings<const N: usize> {
    /// Shares of the vertices in the chords.
    pub spread: [[f64; N]; 3],
    /// Rest lengths (m).
    pub length: [f64; 3],
    /// Stiffnesses (N/m).
    pub stiffness: [f64; 3],
    /// Damping constants (N s/m).
    pub damping: [f64; 3],
}

/// A vector and its direction; zero vectors have the direction 0.
#[derive(Clone, Copy, Debug)]
struct Arm {
    length: f64,
    direction: [f64; 3],
}

impl Arm {
    fn new(v: [f64; 3]) -> Self {
        let length = dot(v, v).sqrt();
        let inverse = if length > 0.0 { 1.0 / length } else { 0.0 };
        Self { length, direction: scale(v, inverse) }
    }
}

/// The chords of three axes.
fn arms<const N: usize>(spread: &[[f64; N]; 3], x: &Nodes<N>) -> [Arm; 3] {
    spread.map(|weights| Arm::new(spread_over(&weights, x)))
}

fn spread_force<const N: usize>(to: &mut Nodes<N>, weights: &[f64; N], force: [f64; 3]) {
    for j in 0..N {
        for k in 0..3 {
            to[j][k] += weights[j] * force[k];
        }
    }
}

impl<const N: usize> AxialSprings<N> {
    /// Energy (J) at positions `x` (m).
    pub fn energy(&self, x: &Nodes<N>) -> f64 {
        let arms = arms(&self.spread, x);
        (0..3).map(|i| 0.5 * self.stiffness[i] * (arms[i].length - self.length[i]).powi(2)).sum()
    }

    /// Elastic forces (N).
    pub fn forces(&self, x: &Nodes<N>) -> Nodes<N> {
        let mut f = [[0.0; 3]; N];
        for (i, arm) in arms(&self.spread, x).into_iter().enumerate() {
            let tension = self.stiffness[i] * (arm.length - self.length[i]);
            spread_force(&mut f, &self.spread[i], scale(arm.direction, -tension));
        }
        f
    }

    /// Forces of the dampers (N) at velocities `v` (m/s).
    pub fn damping_forces(&self, x: &Nodes<N>, v: &Nodes<N>) -> Nodes<N> {
        let mut f = [[0.0; 3]; N];
        for (i, arm) in arms(&self.spread, x).into_iter().enumerate() {
            let rate = dot(spread_over(&self.spread[i], v), arm.direction);
            let tension = self.damping[i] * rate;
            spread_force(&mut f, &self.spread[i], scale(arm.direction, -tension));
        }
        f
    }

    /// Tangent `k (n n^T + (1 - L/|l|)(I - n n^T))`.
    pub fn tangent(&self, x: &Nodes<N>, curvature: Curvature) -> Blocks<N> {
        let mut blocks = [[[0.0; 9]; N]; N];
        for (i, arm) in arms(&self.spread, x).into_iter().enumerate() {
            let k = self.stiffness[i];
            let across = 1.0 - self.length[i] / arm.length.max(1e-6 * self.length[i]);
            let across = match curvature {
                Curvature::Exact => k * across,
                Curvature::Definite => k * across.max(0.0),
                Curvature::GaussNewton => 0.0,
            };
            let mut m = [0.0; 9];
            add_outer(&mut m, scale(arm.direction, k - across), arm.direction);
            add_identity(&mut m, across);
            add_spread(&mut blocks, &self.spread[i], &self.spread[i], &m);
        }
        blocks
    }

    /// Matrix of the dampers (N s/m), semidefinite.
    pub fn damping_matrix(&self, x: &Nodes<N>) -> Blocks<N> {
        let mut blocks = [[[0.0; 9]; N]; N];
        for (i, arm) in arms(&self.spread, x).into_iter().enumerate() {
            let mut m = [0.0; 9];
            add_outer(&mut m, scale(arm.direction, self.damping[i]), arm.direction);
            add_spread(&mut blocks, &self.spread[i], &self.spread[i], &m);
        }
        blocks
    }
}

/// Springs on the angles between three axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AngularSprings<const N: usize> {
    /// Shares of the vertices in the chords.
    pub spread: [[f64; N]; 3],
    /// Cosines at rest, in the order of [`AXIS_PAIRS`].
    pub cosine: [f64; 3],
    /// Stiffnesses of the printed form (N).
    pub printed: [f64; 3],
    /// Stiffnesses of the energy form (J).
    pub stiffness: [f64; 3],
}

impl<const N: usize> AngularSprings<N> {
    /// Energy (J) of the energy form at positions `x` (m).
    pub fn energy(&self, x: &Nodes<N>) -> f64 {
        let arms = arms(&self.spread, x);
        let of = |p: usize| {
            let [i, j] = AXIS_PAIRS[p];
            let m = dot(arms[i].direction, arms[j].direction) - self.cosine[p];
            0.5 * self.stiffness[p] * m * m
        };
        of(0) + of(1) + of(2)
    }

    /// Forces (N).
    pub fn forces(&self, x: &Nodes<N>, form: AngularForm) -> Nodes<N> {
        let arms = arms(&self.spread, x);
        let mut f = [[0.0; 3]; N];
        for p in 0..3 {
            let [i, j] = AXIS_PAIRS[p];
            let (a, b) = (&arms[i], &arms[j]);
            let m = dot(a.direction, b.direction) - self.cosine[p];
            let (k, [first, second]) = match form {
                AngularForm::Printed => (self.printed[p], [b.direction, a.direction]),
                AngularForm::Energy => (self.stiffness[p], cosine_gradient(a, b)),
            };
            spread_force(&mut f, &self.spread[i], scale(first, -k * m));
            spread_force(&mut f, &self.spread[j], scale(second, -k * m));
        }
        f
    }

    /// Tangent of the energy form; its semidefinite forms are the same.
    pub fn tangent(&self, x: &Nodes<N>, curvature: Curvature) -> Blocks<N> {
        let arms = arms(&self.spread, x);
        let mut blocks = [[[0.0; 9]; N]; N];
        for p in 0..3 {
            let [i, j] = AXIS_PAIRS[p];
            let (a, b) = (&arms[i], &arms[j]);
            let k = self.stiffness[p];
            let cosine = dot(a.direction, b.direction);
            let [first, second] = cosine_gradient(a, b);
            let [mut own, mut other, mut mixed] = [[0.0; 9]; 3];
            add_outer(&mut own, scale(first, k), first);
            add_outer(&mut other, scale(second, k), second);
            add_outer(&mut mixed, scale(first, k), second);
            if curvature == Curvature::Exact && a.length > 0.0 && b.length > 0.0 {
                let force = k * (cosine - self.cosine[p]);
                for (m, n, o, length) in [
                    (&mut own, a.direction, b.direction, a.length),
                    (&mut other, b.direction, a.direction, b.length),
                ] {
                    let factor = -force / (length * length);
                    add_outer(m, scale(n, factor), o);
                    add_outer(m, scale(o, factor), n);
                    add_identity(m, factor * cosine);
                    add_outer(m, scale(n, -3.0 * factor * cosine), n);
                }
                let factor = force / (a.length * b.length);
                add_identity(&mut mixed, factor);
                add_outer(&mut mixed, scale(a.direction, -factor), a.direction);
                add_outer(&mut mixed, scale(b.direction, -factor), b.direction);
                add_outer(&mut mixed, scale(a.direction, factor * cosine), b.direction);
            }
            add_spread(&mut blocks, &self.spread[i], &self.spread[i], &own);
            add_spread(&mut blocks, &self.spread[j], &self.spread[j], &other);
            add_spread(&mut blocks, &self.spread[i], &self.spread[j], &mixed);
            add_spread(&mut blocks, &self.spread[j], &self.spread[i], &transposed(&mixed));
        }
        blocks
    }
}

/// Derivatives of the cosine by the two chords (1/m); 0 for chords without length.
fn cosine_gradient(a: &Arm, b: &Arm) -> [[f64; 3]; 2] {
    if a.length == 0.0 || b.length == 0.0 {
        return [[0.0; 3]; 2];
    }
    let cosine = dot(a.direction, b.direction);
    [
        scale(sub(b.direction, scale(a.direction, cosine)), 1.0 / a.length),
        scale(sub(a.direction, scale(b.direction, cosine)), 1.0 / b.length),
    ]
}

/// Directions and lengths from the barycentre to the vertices.
fn radii<const N: usize>(x: &Nodes<N>) -> [Arm; N] {
    let centre = spread_over(&[1.0 / N as f64; N], x);
    x.map(|x| Arm::new(sub(x, centre)))
}

/// Subtracts the mean vector.
fn balance<const N: usize>(f: &mut Nodes<N>) {
    let mean = spread_over(&[1.0 / N as f64; N], f);
    for f in f {
        *f = sub(*f, mean);
    }
}

/// Springs against changes of volume, with `N` vertices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VolumeSprings<const N: usize> {
    /// One, of tetrahedra (section 3.1).
    Sum(RadiusSum<N>),
    /// One for every vertex, of hexahedra (section 4.1).
    Radial(RadialSprings<N>),
}

impl<const N: usize> VolumeSprings<N> {
    /// Energy (J) of the balanced form at positions `x` (m).
    pub fn energy(&self, x: &Nodes<N>) -> f64 {
        match self {
            Self::Sum(springs) => springs.energy(x),
            Self::Radial(springs) => springs.energy(x),
        }
    }

    /// Elastic forces (N).
    pub fn forces(&self, x: &Nodes<N>, form: VolumeForm) -> Nodes<N> {
        match self {
            Self::Sum(springs) => springs.forces(x, form),
            Self::Radial(springs) => springs.forces(x, form),
        }
    }

    /// Tangent of the balanced form.
    pub fn tangent(&self, x: &Nodes<N>, curvature: Curvature) -> Blocks<N> {
        match self {
            Self::Sum(springs) => springs.tangent(x, curvature),
            Self::Radial(springs) => springs.tangent(x, curvature),
        }
    }

    /// Without stiffness, for removed elements.
    pub(crate) fn clear(&mut self) {
        match self {
            Self::Sum(springs) => springs.stiffness = 0.0,
            Self::Radial(springs) => (springs.stiffness, springs.damping) = (0.0, 0.0),
        }
    }
}

/// Spring on the sum of the distances from the barycentre, of tetrahedra.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadiusSum<const N: usize> {
    /// Sum at rest (m).
    pub rest: f64,
    /// Stiffness (N/m).
    pub stiffness: f64,
}

impl<const N: usize> RadiusSum<N> {
    fn change(&self, radii: &[Arm; N]) -> f64 {
        radii.iter().map(|r| r.length).sum::<f64>() - self.rest
    }

    /// Energy (J) of the balanced form at positions `x` (m).
    pub fn energy(&self, x: &Nodes<N>) -> f64 {
        0.5 * self.stiffness * self.change(&radii(x)).powi(2)
    }

    /// Forces (N).
    pub fn forces(&self, x: &Nodes<N>, form: VolumeForm) -> Nodes<N> {
        let radii = radii(x);
        let tension = self.stiffness * self.change(&radii);
        let mut f = radii.map(|r| scale(r.direction, -tension));
        if form == VolumeForm::Balanced {
            balance(&mut f);
        }
        f
    }

    /// Tangent of the balanced form; its semidefinite forms are the same.
    pub fn tangent(&self, x: &Nodes<N>, curvature: Curvature) -> Blocks<N> {
        let radii = radii(x);
        let mut g = radii.map(|r| r.direction);
        balance(&mut g);
        let mut blocks = [[[0.0; 9]; N]; N];
        for a in 0..N {
            for b in 0..N {
                add_outer(&mut blocks[a][b], scale(g[a], self.stiffness), g[b]);
            }
        }
        if curvature == Curvature::Exact {
            let tension = self.stiffness * self.change(&radii);
            add_radial_curvature(&mut blocks, &radii, &[0.0; N], &[tension; N]);
        }
        blocks
    }
}

/// Springs and dampers from the barycentre to every vertex, of hexahedra.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadialSprings<const N: usize> {
    /// Distances at rest (m).
    pub rest: [f64; N],
    /// Stiffness (N/m).
    pub stiffness: f64,
    /// Damping constant (N s/m).
    pub damping: f64,
}

impl<const N: usize> RadialSprings<N> {
    /// Energy (J) of the balanced form at positions `x` (m).
    pub fn energy(&self, x: &Nodes<N>) -> f64 {
        let own = radii(x).into_iter().zip(self.rest);
        own.map(|(r, rest)| 0.5 * self.stiffness * (r.length - rest).powi(2)).sum()
    }

    /// Elastic forces (N).
    pub fn forces(&self, x: &Nodes<N>, form: VolumeForm) -> Nodes<N> {
        let radii = radii(x);
        let mut f = std::array::from_fn(|j| {
            let tension = self.stiffness * (radii[j].length - self.rest[j]);
            scale(radii[j].direction, -tension)
        });
        if form == VolumeForm::Balanced {
            balance(&mut f);
        }
        f
    }

    /// Forces of the dampers (N) at velocities `v` (m/s).
    pub fn damping_forces(&self, x: &Nodes<N>, v: &Nodes<N>, form: VolumeForm) -> Nodes<N> {
        let (radii, centre) = (radii(x), spread_over(&[1.0 / N as f64; N], v));
        let mut f = std::array::from_fn(|j| {
            let rate = dot(sub(v[j], centre), radii[j].direction);
            scale(radii[j].direction, -self.damping * rate)
        });
        if form == VolumeForm::Balanced {
            balance(&mut f);
        }
        f
    }

    /// Tangent of the balanced form.
    pub fn tangent(&self, x: &Nodes<N>, curvature: Curvature) -> Blocks<N> {
        let radii = radii(x);
        let along = [self.stiffness; N];
        let tension: [f64; N] = std::array::from_fn(|j| {
            let tension = self.stiffness * (radii[j].length - self.rest[j]);
            match curvature {
                Curvature::Exact => tension,
                Curvature::Definite => tension.max(0.0),
                Curvature::GaussNewton => 0.0,
            }
        });
        let mut blocks = [[[0.0; 9]; N]; N];
        add_radial_curvature(&mut blocks, &radii, &along, &tension);
        blocks
    }
}

/// Adds `P^T diag(along r r^T + tension/|.| (I - r r^T)) P`, `P` taking the barycentre away.
fn add_radial_curvature<const N: usize>(
    blocks: &mut Blocks<N>,
    radii: &[Arm; N],
    along: &[f64; N],
    tension: &[f64; N],
) {
    let share = 1.0 / N as f64;
    for j in 0..N {
        let across = if radii[j].length > 0.0 { tension[j] / radii[j].length } else { 0.0 };
        let mut m = [0.0; 9];
        add_outer(&mut m, scale(radii[j].direction, along[j] - across), radii[j].direction);
        add_identity(&mut m, across);
        let weights: [f64; N] = std::array::from_fn(|a| if a == j { 1.0 - share } else { -share });
        add_spread(blocks, &weights, &weights, &m);
    }
}
