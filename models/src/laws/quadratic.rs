//! Quadratic springs: laws on changes of length instead of squared length, for tetrahedra (TQS,
//! Delingette 2008, section 3) and for edges alone (plain mass-spring bodies).
//!
//! An edge of rest vector `X` and length `L`, now `x` and `l`, enters through
//!
//! ```text
//! delta  = l^2 - L^2 = (x - X) . (X + x)
//! change = 2 L (l - L) = 2 delta / (1 + l/L)              (m^2)
//! ```
//!
//! which is `delta` to first order. With `B` of
//! [`SpringConstants::matrix`](crate::element::precompute::SpringConstants::matrix), and `h = 2 L/l`:
//!
//! ```text
//! W   = 1/2 change^T B change,   s = B change             (J; N/m)
//! f_a = -sum_e h_e s_e (x_a - x_b)                        (N)
//! K   = Z^T B Z + sum_e h_e s_e (I - n n^T)               (N/m)
//! ```
//!
//! where row e of `Z` is `h_e (x_a - x_b)^T` at a and the negative at b, `n` the direction of the
//! edge, and the last sum stands for the edge's own four blocks. These are the springs of the paper:
//! `chi/4 dl^2 + gamma/2 dl dl' + xi/2 dl dl'` with `chi = 4 L^2 k`, `gamma = 4 L L' c` and
//! `xi = 4 L L' d` (printed with `c`; the sums over `gamma` and `xi` run over adjacent and opposite
//! pairs). Energy, force and tangent agree with the biquadratic ones to second, first and zeroth
//! order in the strain, at rest. The first part of `K` is semidefinite always, the second is where no
//! edge is in compression (`s >= 0`).
//!
//! A mass-spring body keeps the tensile part only: `W = sum_e k/4 change_e^2`, that is `kappa/2 (l -
//! L)^2` with `kappa = 2 L^2 k` summed over the tetrahedra round the edge. It is no approximation of
//! a material: on tetrahedra it is exact for no Poisson's ratio.
//!
//! Edges shorter than 1e-6 of their rest length count as that long where they are divided by, so that
//! everything is finite at `l = 0`, where the direction of the force is undefined and the force 0.
//! Squared lengths must be normal numbers when multiplied: in `f32` edges longer than 1e-9 m.

use bevy_ecs::prelude::*;
use bytemuck::TransparentWrapper;
use sinew_engine::element::{EdgeBlock, EdgeShapes, EdgeVertices, RestEdges};
use sinew_engine::lanes::{Lanes, MAX_LANES};
use sinew_engine::law::{LawInfo, RecoveringBodies, TangentKind};
use sinew_engine::scalar::{Real, Scalar, Single, add, cross, dot, scale, sub};
use sinew_engine::schedule::Evaluation;

use crate::element::matrix::{add_outer, part_of_tension, symmetrise};
use crate::element::spring::{Stretch, tensile_energy, tensile_tension};
use crate::element::tetrahedron::{CORE, Element, Nodes, TetrahedronTangent, assemble};
use crate::frame::columns::{self, LawColumns, TangentSum, add_vertices, work};
use crate::frame::law::TetrahedronLaw;
use crate::frame::row::{Elements, InRecovery, LawRow, PlacedLaw, activate_elements, mark};
use crate::laws::pooled::{TensileStiffness, add_edge_tangent};

/// Ends of the edges of a tetrahedron in the order of [`EDGES`](crate::element::precompute::EDGES), such that
/// the edge is `x_plus - x_minus`.
const ENDS: [[usize; 2]; 6] = [[1, 0], [2, 0], [3, 0], [1, 2], [1, 3], [2, 3]];

/// Edges of a tetrahedron.
#[inline(always)]
fn stretches<R: Real>(e: &Element<R>, u: &Nodes<R>) -> [Stretch<R>; 6] {
    // columns of Dm from the rows of its inverse
    let six = R::from_f64(6.0) * e.volume;
    let [d1, d2, d3] = e.gradients;
    let rest = [scale(cross(d2, d3), six), scale(cross(d3, d1), six), scale(cross(d1, d2), six)];
    let w = [sub(u[1], u[0]), sub(u[2], u[0]), sub(u[3], u[0])];
    [
        Stretch::new(rest[0], w[0]),
        Stretch::new(rest[1], w[1]),
        Stretch::new(rest[2], w[2]),
        Stretch::new(sub(rest[0], rest[1]), sub(w[0], w[1])),
        Stretch::new(sub(rest[0], rest[2]), sub(w[0], w[2])),
        Stretch::new(sub(rest[1], rest[2]), sub(w[1], w[2])),
    ]
}

/// `s = B change` through the strain that the changes amount to: with `g` the change of the Gram
/// matrix of the edges at vertex 0 and `d` that of the shape vectors, `D S D^T = lambda (tr E) d +
/// mu d g d`.
#[inline(always)]
fn tensions<R: Real>(e: &Element<R>, edges: &[Stretch<R>; 6]) -> [R; 6] {
    let half = R::from_f64(0.5);
    let [d1, d2, d3] = e.gradients;
    let (d12, d13, d23) = (dot(d1, d2), dot(d1, d3), dot(d2, d3));
    let d = [[dot(d1, d1), d12, d13], [d12, dot(d2, d2), d23], [d13, d23, dot(d3, d3)]];
    let (c0, c1, c2) = (edges[0].change, edges[1].change, edges[2].change);
    let g12 = half * (c0 + c1 - edges[3].change);
    let g13 = half * (c0 + c2 - edges[4].change);
    let g23 = half * (c1 + c2 - edges[5].change);
    let g = [[c0, g12, g13], [g12, c1, g23], [g13, g23, c2]];
    let trace = half * dot([d[0][0], d[1][1], d[2][2]], [c0, c1, c2])
        + dot([d12, d13, d23], [g12, g13, g23]);
    // times half the volume, which every tension has in front
    let half_volume = half * e.volume;
    let (pressure, mu) = (e.lambda * trace * half_volume, e.mu * half_volume);
    let mut dg = [[R::ZERO; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            dg[i][j] = dot(d[i], g[j]);
        }
    }
    let (t11, t22, t33) = (
        pressure.mul_add(d[0][0], mu * dot(dg[0], d[0])),
        pressure.mul_add(d[1][1], mu * dot(dg[1], d[1])),
        pressure.mul_add(d[2][2], mu * dot(dg[2], d[2])),
    );
    let (t12, t13, t23) = (
        pressure.mul_add(d12, mu * dot(dg[0], d[1])),
        pressure.mul_add(d13, mu * dot(dg[0], d[2])),
        pressure.mul_add(d23, mu * dot(dg[1], d[2])),
    );
    [t11 + t12 + t13, t12 + t22 + t23, t13 + t23 + t33, -t12, -t13, -t23]
}

/// `B`, N/m^3: edges ij and kl meet with `V/4 (lambda G_ij G_kl + mu (G_ik G_jl + G_il G_jk))`.
#[inline(always)]
fn matrix<R: Real>(e: &Element<R>) -> [[R; 6]; 6] {
    let mut shape = [[R::ZERO; 3]; 4];
    for a in 0..3 {
        shape[a + 1] = e.gradients[a];
        shape[0] = sub(shape[0], e.gradients[a]);
    }
    let mut g = [[R::ZERO; 4]; 4];
    for i in 0..4 {
        for j in i..4 {
            g[i][j] = dot(shape[i], shape[j]);
            g[j][i] = g[i][j];
        }
    }
    let quarter = R::from_f64(0.25) * e.volume;
    let (lambda, mu) = (e.lambda * quarter, e.mu * quarter);
    let mut b = [[R::ZERO; 6]; 6];
    for e in 0..6 {
        for f in e..6 {
            let ([i, j], [k, l]) = (ENDS[e], ENDS[f]);
            let shear = g[i][k].mul_add(g[j][l], g[i][l] * g[j][k]);
            b[e][f] = (lambda * g[i][j]).mul_add(g[k][l], mu * shear);
            b[f][e] = b[e][f];
        }
    }
    b
}

/// Tetrahedral quadratic springs, one tetrahedron at a time, the 21 constants taken from shape vectors and
/// moduli; also the mark of its tetrahedra. `compression` plays no part.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct QuadraticSprings;

/// Row of its tetrahedra in the table of laws.
pub static TETRAHEDRA: LawRow = LawRow::tetrahedra::<QuadraticSprings>();

impl TetrahedronLaw for QuadraticSprings {
    const NAME: &'static str = "quadratic springs";
    const HOLDS_PRESSURE: bool = false;
    type Mark = Self;
    const FOLDS_VOLUME: bool = false;
    const STRESS_PROJECTION: bool = false;
    #[inline(always)]
    fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        let edges = stretches(e, u);
        let s = tensions(e, &edges);
        let mut twice = R::ZERO;
        for i in 0..6 {
            twice = s[i].mul_add(edges[i].change, twice);
        }
        R::from_f64(0.5) * twice
    }
    #[inline(always)]
    fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Option<Nodes<R>> {
        let edges = stretches(e, u);
        let s = tensions(e, &edges);
        let mut f = [[R::ZERO; 3]; 4];
        for i in 0..6 {
            let [plus, minus] = ENDS[i];
            let pull = scale(edges[i].edge, edges[i].slope * s[i]);
            f[plus] = sub(f[plus], pull);
            if minus > 0 {
                f[minus] = add(f[minus], pull);
            }
        }
        for x in 0..3 {
            f[0][x] = -(f[1][x] + f[2][x] + f[3][x]);
        }
        Some(f)
    }
    /// Tangent `+d2W/du2`, N/m, or a semidefinite stand-in: `GaussNewton` is the first part of `K`
    /// alone, `Projected` leaves out the tensions of edges in compression.
    #[inline(always)]
    fn tangent<R: Real>(e: &Element<R>, u: &Nodes<R>, kind: TangentKind) -> TetrahedronTangent<R> {
        let edges = stretches(e, u);
        let s = tensions(e, &edges);
        let b = matrix(e);
        let mut z = [[R::ZERO; 3]; 6];
        let mut geometric = [[R::ZERO; 9]; 6];
        for i in 0..6 {
            z[i] = scale(edges[i].edge, edges[i].slope);
            let tension = part_of_tension(kind, s[i]);
            edges[i].add_geometric(&mut geometric[i], edges[i].slope * tension);
        }
        // products of vertex a = 1, 2, 3 with every edge: sum of B z over the edges at a
        let mut products = [[[R::ZERO; 3]; 6]; 3];
        for a in 0..3 {
            for i in 0..6 {
                let [plus, minus] = ENDS[i];
                if plus != a + 1 && minus != a + 1 {
                    continue;
                }
                for j in 0..6 {
                    let c = if plus == a + 1 { b[i][j] } else { -b[i][j] };
                    for x in 0..3 {
                        products[a][j][x] = c.mul_add(z[i][x], products[a][j][x]);
                    }
                }
            }
        }
        let mut core = [[R::ZERO; 9]; 6];
        for (block, [a, c]) in core.iter_mut().zip(CORE) {
            for j in 0..6 {
                let [plus, minus] = ENDS[j];
                let (at_a, at_c) = ([plus, minus].contains(&(a + 1)), plus == c + 1);
                if !at_c && minus != c + 1 {
                    continue;
                }
                let direction = if at_c { z[j] } else { [-z[j][0], -z[j][1], -z[j][2]] };
                add_outer(block, products[a][j], direction);
                if at_a {
                    for k in 0..9 {
                        let g = geometric[j][k];
                        block[k] += if a == c { g } else { -g };
                    }
                }
            }
            if a == c {
                symmetrise(block);
            }
        }
        assemble(&core)
    }
    /// Where an edge is in compression: there the exact tangent may be indefinite, and the projected
    /// one differs from it.
    #[inline(always)]
    fn is_clamped<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R::Mask {
        let s = tensions(e, &stretches(e, u));
        let mut least = R::ZERO;
        for tension in s {
            least = least.min(tension);
        }
        R::less(least, R::ZERO)
    }
}

/// Springs on edges only; also the mark of edges and tetrahedra of such bodies.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct MassSpring;

/// Row of the springs on edges in the table of laws.
pub static EDGE_SPRINGS: LawRow = LawRow::of_systems(
    LawInfo::elastic("edge springs"),
    Elements::Edges,
    [mark::<MassSpring>; 2],
    [activate_mass_spring::<f64>, activate_mass_spring::<Single>],
)
.yielding_to_pressure()
// on bodies that never recover, or beside a solid that does
.in_recovery(InRecovery::Unchanged);

/// Query data of springs on edges.
type EdgeData<S> =
    (&'static EdgeVertices, &'static EdgeBlock, RestEdges<S>, &'static TensileStiffness<S>);

fn activate_mass_spring<S: Scalar>(world: &mut World, law: PlacedLaw) {
    activate_elements::<EdgeVertices, S, EdgeData<S>>(
        world,
        law,
        |with, u, (nodes, block, rest, stiffness), buffer| {
            let columns = EdgeColumns {
                shapes: EdgeShapes::new(u, nodes, rest),
                block: EdgeBlock::peel_slice(block),
                stiffness: TensileStiffness::peel_slice(stiffness),
            };
            let work = stiffness.len() * work(with.request, [3, 4, 10]);
            // on bodies that never recover, or beside a solid that does
            let with = Evaluation { recovering: &RecoveringBodies::default(), ..with };
            columns::evaluate(&columns, with, work, buffer);
        },
    );
}

/// Columns of the edges of mass-spring bodies, as slices.
struct EdgeColumns<'a, S> {
    shapes: EdgeShapes<'a, S>,
    /// Tangent blocks.
    block: &'a [u32],
    /// Tensile stiffnesses `k` (N/m^3); the spring constant is `2 L^2 k`.
    stiffness: &'a [S],
}

impl<S: Scalar> EdgeColumns<'_, S> {
    #[inline(always)]
    fn stretch<L: Lanes<Scalar = S>>(&self, first: usize) -> (L, Stretch<L>) {
        let stretch = Stretch::new(self.shapes.rest(first), self.shapes.relative(first));
        (L::load(&self.stiffness[first..]), stretch)
    }
}

impl<S: Scalar> LawColumns<S> for EdgeColumns<'_, S> {
    #[inline(always)]
    fn add_energy<L: Lanes<Scalar = S>>(&self, first: usize, sums: &mut [f64; MAX_LANES]) {
        let (k, stretch) = self.stretch::<L>(first);
        tensile_energy(k, stretch.change).accumulate(sums);
    }
    #[inline(always)]
    fn add_forces<L: Lanes<Scalar = S>>(&self, first: usize, force: &mut [[S; 4]], row: usize) {
        let (k, stretch) = self.stretch::<L>(first);
        let f = scale(stretch.edge, stretch.slope * tensile_tension(k, stretch.change));
        add_vertices([[-f[0], -f[1], -f[2]], f], force, row, &self.shapes.nodes[first..]);
    }
    #[inline(always)]
    fn add_tangent<L: Lanes<Scalar = S>>(&self, first: usize, to: &mut TangentSum<S>) {
        let (k, stretch) = self.stretch::<L>(first);
        let mut tension = tensile_tension(k, stretch.change);
        // identified constants may be negative
        let mut along = k;
        match to.kind {
            TangentKind::Exact => {}
            TangentKind::GaussNewton => (tension, along) = (L::ZERO, k.max(L::ZERO)),
            TangentKind::Projected => {
                let negative = L::either(L::less(tension, L::ZERO), L::less(k, L::ZERO));
                to.count_clamped::<L>(negative);
                (tension, along) = (tension.max(L::ZERO), k.max(L::ZERO));
            }
        }
        let z = scale(stretch.edge, stretch.slope);
        let mut m = [L::ZERO; 9];
        add_outer(&mut m, scale(z, L::from_f64(0.5) * along), z);
        stretch.add_geometric(&mut m, stretch.slope * tension);
        add_edge_tangent(m, to.span, self.shapes.nodes, self.block, first);
    }
}
