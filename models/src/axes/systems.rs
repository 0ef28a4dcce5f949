//! The systems of axes: one law per table, each with a buffer of its own, beside whatever else the body is
//! made of.

use bevy_ecs::prelude::*;
use sinew_engine::element::AxisVertices;
use sinew_engine::lanes::{Lanes, MAX_LANES};
use sinew_engine::law::{EvaluationRequest, LawBuffer, LawInfo, TangentKind};
use sinew_engine::scalar::{Scalar, Single};
use sinew_engine::schedule::Evaluation;

use super::columns::*;
use super::element::AxisElement;
use crate::frame::columns::{self, LawColumns, TangentSum, add_vertices, work};
use crate::frame::row::{Elements, LawRow, PlacedLaw, activate_elements, mark};
use crate::frame::tetrahedra::add_tangent;

/// Marks tetrahedra of bodies that consist of axes alone: no law of a material acts on them.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct AxesOnly;

/// Triads of axes with their angles and the term of volume.
pub static TRIADS: LawRow = LawRow::of_systems(
    LawInfo::elastic("axes"),
    Elements::AxesInTetrahedra,
    [mark::<AxisAngleStiffness<f64, 0>>, mark::<AxisAngleStiffness<Single, 0>>],
    [triads::<f64>, triads::<Single>],
);
/// Single fibres, passive and active.
pub static FIBRES: LawRow = LawRow::of_systems(
    LawInfo::elastic("fibres"),
    Elements::AxesInTetrahedra,
    [mark::<FibreActive<f64>>, mark::<FibreActive<Single>>],
    [fibres::<f64>, fibres::<Single>],
);
/// Biquadratic fibres.
pub static BIQUADRATIC: LawRow = LawRow::of_systems(
    LawInfo::elastic("biquadratic fibres"),
    Elements::AxesInTetrahedra,
    [mark::<Biquadratic>; 2],
    [biquadratic::<f64>, biquadratic::<Single>],
);
/// The projected tangent of biquadratic fibres whose springs are pooled with those of the material: the eigenvalues that
/// are clamped belong to a fibre, as those of a material to a tetrahedron ([`PooledProjection`]). Each of the two is
/// projected by itself.
///
/// [`PooledProjection`]: crate::laws::svk::PooledProjection
pub static BIQUADRATIC_PROJECTION: LawRow = LawRow {
    forces: false,
    ..LawRow::of_systems(
        LawInfo::elastic("projected tangent of biquadratic fibres"),
        Elements::AxesInTetrahedra,
        [mark::<PooledBiquadratic>; 2],
        [biquadratic_projection::<f64>, biquadratic_projection::<Single>],
    )
    .with_tangent(|kind| kind == TangentKind::Projected)
};
/// Biquadratic fibres in membrane triangles.
pub static SHEET_BIQUADRATIC: LawRow = LawRow {
    elements: Elements::AxesInTriangles,
    mark: [mark::<SheetBiquadratic>; 2],
    info: LawInfo::elastic("biquadratic fibres of membranes"),
    ..BIQUADRATIC
};
/// The projected tangent of those whose springs are pooled, as [`BIQUADRATIC_PROJECTION`].
pub static SHEET_PROJECTION: LawRow = LawRow {
    elements: Elements::AxesInTriangles,
    mark: [mark::<PooledSheetBiquadratic>; 2],
    info: LawInfo::elastic("projected tangent of biquadratic fibres of membranes"),
    ..BIQUADRATIC_PROJECTION
};
/// The term of volume without axes.
pub static VOLUMES: LawRow = LawRow::of_systems(
    LawInfo::elastic("volume preservation"),
    Elements::AxesInTetrahedra,
    [mark::<VolumeAlone>; 2],
    [volumes::<f64>, volumes::<Single>],
);

fn triads<S: Scalar>(world: &mut World, law: PlacedLaw) {
    activate_elements::<AxisVertices, S, TriadData<S>>(world, law, |with, u, data, buffer| {
        evaluate(&TriadColumns::new(u, data), with, buffer);
    });
}

fn fibres<S: Scalar>(world: &mut World, law: PlacedLaw) {
    activate_elements::<AxisVertices, S, FibreData<S>>(world, law, |with, u, data, buffer| {
        evaluate(&FibreColumns::new(u, data), with, buffer);
    });
}

fn biquadratic<S: Scalar>(world: &mut World, law: PlacedLaw) {
    activate_elements::<AxisVertices, S, BiquadraticData<S>>(
        world,
        law,
        |with, u, data, buffer| {
            evaluate(&BiquadraticColumns::new(u, data), with, buffer);
        },
    );
}

fn biquadratic_projection<S: Scalar>(world: &mut World, law: PlacedLaw) {
    activate_elements::<AxisVertices, S, BiquadraticData<S>>(
        world,
        law,
        |with, u, data, buffer| {
            let tangent = with.request.tangent.filter(|&kind| kind == TangentKind::Projected);
            let request = &EvaluationRequest { energy: false, force: false, tangent };
            evaluate(&BiquadraticColumns::new(u, data), Evaluation { request, ..with }, buffer);
        },
    );
}

fn volumes<S: Scalar>(world: &mut World, law: PlacedLaw) {
    activate_elements::<AxisVertices, S, VolumeData<S>>(world, law, |with, u, data, buffer| {
        evaluate(&VolumeColumns::new(u, data), with, buffer);
    });
}

/// Energy, force and tangent of every range, silent for bodies that recover.
pub(crate) fn evaluate<S: Scalar, C: AxisColumns<S>>(
    columns: &C,
    with: Evaluation,
    buffer: &mut LawBuffer<S>,
) {
    let work = columns.nodes().len() * work(with.request, [6, 8, 60]);
    columns::evaluate(&Axes(columns), with, work, buffer);
}

/// A table as columns of a law.
struct Axes<'a, C>(&'a C);

impl<S: Scalar, C: AxisColumns<S>> LawColumns<S> for Axes<'_, C> {
    #[inline(always)]
    fn add_energy<L: Lanes<Scalar = S>>(&self, first: usize, sums: &mut [f64; MAX_LANES]) {
        let u = self.0.displacements::<L>(first);
        self.0.element::<L>(first).energy(&u).accumulate(sums);
    }
    #[inline(always)]
    fn add_forces<L: Lanes<Scalar = S>>(&self, first: usize, force: &mut [[S; 4]], row: usize) {
        let u = self.0.displacements::<L>(first);
        let forces = self.0.element::<L>(first).forces(&u);
        add_vertices(forces, force, row, &self.0.nodes()[first..]);
    }
    #[inline(always)]
    fn add_tangent<L: Lanes<Scalar = S>>(&self, first: usize, to: &mut TangentSum<S>) {
        let u = self.0.displacements::<L>(first);
        let e = self.0.element::<L>(first);
        if to.kind == TangentKind::Projected {
            to.count_clamped::<L>(e.is_clamped(&u));
        }
        let mut t = e.tangent(&u, to.kind);
        add_tangent(&mut t, to.span, &self.0.nodes()[first..], &self.0.blocks()[first..]);
    }
}
