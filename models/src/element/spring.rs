//! Biquadratic springs: laws on the squared-length change of edges, one scalar at a time.
//!
//! For an edge `e = (a, b)` with rest length `L`,
//!
//! ```text
//! delta = |x_a - x_b|^2 - L^2 = (u_a - u_b) . (2 (X_a - X_b) + u_a - u_b)      (m^2)
//! W = sum_e k/4 delta_e^2 + sum_pairs c/2 delta_e delta_f                      (J)
//! s_e = dW/d(delta_e)                                                          (N/m)
//! f_a = -2 s_e (x_a - x_b),   f_b = -f_a                                       (N)
//! ```
//!
//! (Delingette 2008, section 3; angular springs couple adjacent edges, volumetric springs opposite
//! ones, and each unordered pair counts once.) Constants come from
//! [`SpringConstants`](crate::element::precompute::SpringConstants) and may be summed over the
//! elements round an edge or face: the pooled evaluation is one pass that fills `delta` per edge,
//! passes that add tensions `s` (scalars only), and one force pass per edge.
//!
//! The second form of `delta` is the one to use: `|x|^2 - L^2` cancels, and in `f32` leaves nothing
//! at strains of 1e-4.

use sinew_engine::scalar::{Real, add, dot, scale, sub};

use crate::element::matrix::{add_identity, add_outer};

/// Squared-length change `delta` (m^2) of an edge from `a` to `b`; `rest` is `X_a - X_b`.
#[inline(always)]
pub fn squared_length_change<S: Real>(rest: [S; 3], u_a: [S; 3], u_b: [S; 3]) -> S {
    let u = sub(u_a, u_b);
    dot(u, add(add(rest, rest), u))
}

/// Energy `k/4 delta^2` (J) of a tensile spring.
#[inline(always)]
pub fn tensile_energy<S: Real>(k: S, delta: S) -> S {
    S::from_f64(0.25) * k * delta * delta
}

/// Tension `k/2 delta` (N/m) of a tensile spring.
#[inline(always)]
pub fn tensile_tension<S: Real>(k: S, delta: S) -> S {
    S::from_f64(0.5) * k * delta
}

/// Energy `c/2 delta_e delta_f` (J) of an angular (`c`) or volumetric (`d`) spring between edges
/// `e` and `f`.
#[inline(always)]
pub fn coupling_energy<S: Real>(c: S, delta_e: S, delta_f: S) -> S {
    S::from_f64(0.5) * c * delta_e * delta_f
}

/// What an angular or volumetric spring adds to the tensions (N/m) of its edges: `c/2 delta_f` to
/// `e` and `c/2 delta_e` to `f`.
#[inline(always)]
pub fn coupling_tensions<S: Real>(c: S, delta_e: S, delta_f: S) -> [S; 2] {
    let half = S::from_f64(0.5) * c;
    [half * delta_f, half * delta_e]
}

/// Force (N) of an edge on its node `a`; node `b` gets the opposite. `edge` is `x_a - x_b`.
#[inline(always)]
pub fn edge_force<S: Real>(tension: S, edge: [S; 3]) -> [S; 3] {
    scale(edge, -(tension + tension))
}

/// How far an edge is stretched.
#[derive(Clone, Copy, Debug)]
pub struct Stretch<R> {
    /// Deformed edge `x` (m).
    pub edge: [R; 3],
    /// `2 L (l - L)` (m^2).
    pub change: R,
    /// `h = 2 L/l`: derivative of `change` by the edge is `h x`.
    pub slope: R,
    /// `1/l^2` (1/m^2).
    pub inverse_square: R,
}

impl<R: Real> Stretch<R> {
    /// Of an edge with rest vector `rest` (m) whose ends are displaced by `relative` (m) against each
    /// other.
    #[inline(always)]
    pub fn new(rest: [R; 3], relative: [R; 3]) -> Self {
        let edge = add(rest, relative);
        let delta = dot(relative, add(rest, edge));
        // the edges of a removed tetrahedron have no length; without moduli any will do
        let rest2 = dot(rest, rest);
        let rest2 = R::select(R::less(R::ZERO, rest2), rest2, R::ONE);
        let length2 = (rest2 + delta).max(R::from_f64(1e-12) * rest2);
        // 1/(L l): neither length is needed, only their ratio
        let p = (rest2 * length2).recip_sqrt();
        let shrink = rest2 * p;
        Self {
            edge,
            change: (delta + delta) * length2.mul_add(p, R::ONE).recip(),
            slope: shrink + shrink,
            inverse_square: shrink * p,
        }
    }

    /// `c (I - n n^T)` added to `m`.
    #[inline(always)]
    pub(crate) fn add_geometric(&self, m: &mut [R; 9], c: R) {
        add_outer(m, scale(self.edge, -(c * self.inverse_square)), self.edge);
        add_identity(m, c);
    }
}
