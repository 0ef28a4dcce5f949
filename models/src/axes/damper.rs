//! Dampers along axes (Bourguignon & Cani 2000, section 2.1): a viscous stress along a fibre in
//! proportion to the rate of its stretch.
//!
//! The stretched axis `F a = a + sum_j q_j u_j` of unit direction `n` lengthens at the rate
//! `n . sum_j q_j v_j` (1/s), and a damper takes the power `eta V` times its square. Its matrix
//! `eta V q_i q_j n n^T` (N s/m) is positive semidefinite, and takes nothing from rigid motion. The
//! chord of the printed springs is `L F a`, so that their damper (N s/m) is `eta V / L^2`: the same entity
//! serves both forms, with `q_j = (w+_j - w-_j) / L` there. In hexahedra the energy-consistent form has
//! one damper for every Gauss point.
//!
//! Implicit integrators freeze the matrix where their iteration starts, as they do with stiffness
//! damping; explicit ones refuse it, because it would need a linear system.

use bevy_ecs::prelude::*;
use sinew_engine::element::AxisVertices;
use sinew_engine::isoparametric::AxisHexahedronVertices;
use sinew_engine::law::LawInfo;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{ElementLaw, activate_dampers};
use sinew_engine::vertex::Displacement;

use bytemuck::TransparentWrapper;

use super::printed::{Blocks, Nodes, add_spread, spread_over};
use super::site::{AxisSite, add_blocks, local};
use crate::element::matrix::add_outer;
use crate::laws::{Elements, LawRow, mark, partition};

/// A damper along an axis of an element of `N` vertices.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[component(summary_tick)]
pub struct AxialDamper<const N: usize> {
    /// Unit vector at rest.
    pub axis: [f64; 3],
    /// Derivative of the stretched axis by the displacements of the vertices (1/m).
    pub shape: [f64; N],
    /// Viscosity along the axis times rest volume (J s).
    pub viscosity: f64,
}

impl<const N: usize> AxialDamper<N> {
    /// Viscous matrix (N s/m) at displacements `u` (m).
    ///
    /// ```
    /// use sinew_models::axes::damper::AxialDamper;
    /// // unit corner, fibre along x: its stretch follows vertices 0 and 1
    /// let damper = AxialDamper { axis: [1.0, 0.0, 0.0], shape: [-1.0, 1.0, 0.0, 0.0], viscosity: 0.5 };
    /// let matrix = damper.matrix(&[[0.0; 3]; 4]);
    /// assert_eq!(matrix[0][0][0], 0.5);
    /// assert_eq!(matrix[0][1][0], -0.5);
    /// assert_eq!(matrix[1][1][4], 0.0);
    /// ```
    pub fn matrix(&self, u: &Nodes<N>) -> Blocks<N> {
        let mut arm = self.axis;
        for (k, x) in spread_over(&self.shape, u).into_iter().enumerate() {
            arm[k] += x;
        }
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

fn activate<S: Scalar, const N: usize, V: AxisSite<N>>(
    world: &mut World,
    row: &'static LawRow,
    place: usize,
) {
    let law = ElementLaw::<S, (&V, &V::Blocks, &AxialDamper<N>)> {
        info: row.info,
        place,
        mark: Some(row.mark::<S>(world)),
        partition: partition::<V, S>,
        evaluate: |with, u, (sites, blocks, dampers), buffer| {
            let u = Displacement::peel_slice(u);
            with.workers.for_each(&mut buffer.spans, dampers.len() * 10 * N * N, |_, span| {
                span.clear_tangent();
                for i in span.elements.clone() {
                    let matrix = dampers[i].matrix(&local(u, sites[i].rows()));
                    add_blocks(span, &sites[i], &blocks[i], &matrix);
                }
            });
        },
    };
    activate_dampers(world, law);
}
