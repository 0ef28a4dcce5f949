//! Dampers along axes (Bourguignon & Cani 2000, section 2.1): a viscous stress along a fibre in
//! proportion to the rate of its stretch.
//!
//! The stretched axis `F a = a + sum_j q_j u_j` of unit direction `n` lengthens at the rate
//! `n . sum_j q_j v_j` (1/s), and a damper takes the power `eta V` times its square. Its matrix
//! `eta V q_i q_j n n^T` (N s/m) is positive semidefinite, and takes nothing from rigid motion. In hexahedra
//! there is one damper for every Gauss point.
//!
//! Springs on chords `L F a` of an axis, as printed there, have the same entity: `q_j = (w+_j - w-_j) / L`, `eta V / L^2`
//! (N s/m). So have radial dampers of hexahedra (section 4.1): `q = (e_j - 1/8) / R_j`, with the force on vertex j alone
//! as printed ([`AxialDamper::spread`]).
//!
//! Implicit integrators freeze the matrix where their iteration starts, as they do with stiffness
//! damping. Explicit ones take the force at the velocity that they know, as the paper does.

use bevy_ecs::prelude::*;
use sinew_engine::element::AxisVertices;
use sinew_engine::isoparametric::{AxisHexahedronVertices, AxisTetrahedron10Vertices};
use sinew_engine::law::{LawInfo, ViscousRequest};
use sinew_engine::scalar::{Scalar, dot, scale};
use sinew_engine::schedule::{ElementLaw, activate_dampers};
use sinew_engine::vertex::Displacement;

use bytemuck::TransparentWrapper;

use super::site::{AxisSite, Blocks, Nodes, add_blocks, add_spread, local, spread_over};
use crate::element::matrix::add_outer;
use crate::frame::row::{Elements, LawRow, PlacedLaw, mark, partition};

/// A damper along an axis of an element of `N` vertices.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[component(summary_tick, clone_behavior = Ignore)]
pub struct AxialDamper<const N: usize> {
    /// Unit vector at rest.
    pub axis: [f64; 3],
    /// Derivative of the stretched axis by the displacements of the vertices (1/m).
    pub shape: [f64; N],
    /// What the force on a vertex is of the tension in the axis (1/m): `shape`, but for radial dampers of the printed
    /// form, whose reaction nobody takes. The matrix has `shape` in its place.
    pub spread: [f64; N],
    /// Viscosity along the axis times rest volume (J s).
    pub viscosity: f64,
}

impl<const N: usize> AxialDamper<N> {
    /// A damper whose force spreads as its shape has it.
    pub fn new(axis: [f64; 3], shape: [f64; N], viscosity: f64) -> Self {
        Self { axis, shape, spread: shape, viscosity }
    }

    /// The stretched axis.
    fn arm(&self, u: &Nodes<N>) -> [f64; 3] {
        let change = spread_over(&self.shape, u);
        [0, 1, 2].map(|k| self.axis[k] + change[k])
    }

    /// Viscous matrix (N s/m) at displacements `u` (m).
    ///
    /// ```
    /// use sinew_models::axes::damper::AxialDamper;
    /// // unit corner, fibre along x: its stretch follows vertices 0 and 1
    /// let damper = AxialDamper::new([1.0, 0.0, 0.0], [-1.0, 1.0, 0.0, 0.0], 0.5);
    /// let matrix = damper.matrix(&[[0.0; 3]; 4]);
    /// assert_eq!(matrix[0][0][0], 0.5);
    /// assert_eq!(matrix[0][1][0], -0.5);
    /// assert_eq!(matrix[1][1][4], 0.0);
    /// ```
    pub fn matrix(&self, u: &Nodes<N>) -> Blocks<N> {
        let arm = self.arm(u);
        let square: f64 = arm.iter().map(|x| x * x).sum();
        let mut blocks = [[[0.0; 9]; N]; N];
        // a fibre without length has no direction
        if square > 0.0 {
            let mut m = [0.0; 9];
            add_outer(&mut m, arm.map(|x| x * self.viscosity / square), arm);
            add_spread(&mut blocks, &self.shape, &self.shape, &m);
        }
        blocks
    }

    /// Forces (N) at displacements `u` (m) and velocities `v` (m/s).
    pub fn forces(&self, u: &Nodes<N>, v: &Nodes<N>) -> Nodes<N> {
        let arm = self.arm(u);
        let square: f64 = arm.iter().map(|x| x * x).sum();
        // a fibre without length has no direction
        let by = if square > 0.0 { 1.0 / square } else { 0.0 };
        let pull = -self.viscosity * by * dot(arm, spread_over(&self.shape, v));
        self.spread.map(|q| scale(arm, q * pull))
    }

    /// For every vertex the sum over all of `|df_a/dv_b|` (N s/m), whatever the displacements.
    pub fn bound(&self) -> [f64; N] {
        let sum: f64 = self.shape.iter().map(|q| q.abs()).sum();
        self.spread.map(|q| self.viscosity * q.abs() * sum)
    }

    /// Without viscosity, for removed elements.
    pub(crate) fn clear(&mut self) {
        self.viscosity = 0.0;
    }
}

/// Dampers in tetrahedra.
pub static IN_TETRAHEDRA: LawRow = LawRow::of_dampers(
    LawInfo::elastic("axial dampers"),
    Elements::AxesInTetrahedra,
    [mark::<AxialDamper<4>>; 2],
    [activate::<f64, 4, AxisVertices>, activate::<f32, 4, AxisVertices>],
);
/// Dampers in hexahedra.
pub static IN_HEXAHEDRA: LawRow = LawRow::of_dampers(
    LawInfo::elastic("axial dampers in hexahedra"),
    Elements::AxesInHexahedra,
    [mark::<AxialDamper<8>>; 2],
    [activate::<f64, 8, AxisHexahedronVertices>, activate::<f32, 8, AxisHexahedronVertices>],
);

/// Dampers in ten-node tetrahedra.
pub static IN_TETRAHEDRA10: LawRow = LawRow::of_dampers(
    LawInfo::elastic("axial dampers in ten-node tetrahedra"),
    Elements::AxesInTetrahedra10,
    [mark::<AxialDamper<10>>; 2],
    [
        activate::<f64, 10, AxisTetrahedron10Vertices>,
        activate::<f32, 10, AxisTetrahedron10Vertices>,
    ],
);

fn activate<S: Scalar, const N: usize, V: AxisSite<N>>(world: &mut World, law: PlacedLaw) {
    let law = ElementLaw::<S, (&V, &V::Blocks, &AxialDamper<N>)> {
        info: law.row.info,
        place: law.place,
        mark: Some(law.row.mark::<S>(world)),
        partition: partition::<V, S>,
        evaluate: |with, u, (sites, blocks, dampers), buffer| {
            let u = Displacement::peel_slice(u);
            let (spans, viscous) = (&mut buffer.spans, &buffer.viscous);
            with.workers.for_each(spans, dampers.len() * 10 * N * N, |_, span| {
                if *viscous == ViscousRequest::Matrix {
                    span.clear_tangent();
                } else {
                    span.drop_tangent();
                    span.clear_force();
                }
                for i in span.elements.clone() {
                    let (damper, rows) = (&dampers[i], sites[i].rows());
                    let forces = match viscous {
                        ViscousRequest::Matrix => {
                            let matrix = damper.matrix(&local(u, rows));
                            add_blocks(span, &sites[i], &blocks[i], &matrix);
                            continue;
                        }
                        ViscousRequest::Force(v) => damper.forces(&local(u, rows), &local(v, rows)),
                        ViscousRequest::Bound => damper.bound().map(|bound| [bound, 0.0, 0.0]),
                    };
                    for (&row, f) in rows.iter().zip(forces) {
                        span.add_force(row, f.map(S::from_f64));
                    }
                }
            });
        },
    };
    activate_dampers(world, law);
}
