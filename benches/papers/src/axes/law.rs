//! The system of the printed springs: for comparison, one element at a time in `f64`.

use super::attachment::{self, Attachment};
use super::springs::{
    AngularForm, AngularSprings, AxialSprings, Curvature, RadialSprings, RadiusSum, VolumeForm,
    VolumeSprings,
};
use bevy_ecs::prelude::*;
use bytemuck::TransparentWrapper;
use glam::DVec3;
use sinew::engine::element::AxisVertices;
use sinew::engine::isoparametric::AxisHexahedronVertices;
use sinew::engine::law::{LawBuffer, LawInfo, TangentKind};
use sinew::engine::scalar::Scalar;
use sinew::engine::schedule::Evaluation;
use sinew::engine::vertex::Displacement;
use sinew::models::axes::element::AXIS_PAIRS;
use sinew::models::axes::site::{AxisSite, Blocks, Nodes, add_blocks, local};
use sinew::models::frame::row::{Elements, LawRow, PlacedLaw, activate_elements, mark};

/// The springs of Bourguignon & Cani 2000 in their printed form, in tetrahedra. A body with
/// [`Model::Own`](sinew::models::laws::models::Model::Own) of it has no other law.
pub static IN_TETRAHEDRA: LawRow = LawRow::of_systems(
    LawInfo::elastic("axes, printed form"),
    Elements::AxesInTetrahedra,
    [mark::<PrintedAxes<4>>; 2],
    [activate::<f64, 4, AxisVertices>, activate::<f32, 4, AxisVertices>],
)
.with_family(&[&IN_HEXAHEDRA])
.with_removal(clear::<4>);
/// The same in hexahedra.
pub static IN_HEXAHEDRA: LawRow = LawRow::of_systems(
    LawInfo::elastic("axes in hexahedra, printed form"),
    Elements::AxesInHexahedra,
    [mark::<PrintedAxes<8>>; 2],
    [activate::<f64, 8, AxisHexahedronVertices>, activate::<f32, 8, AxisHexahedronVertices>],
)
.with_removal(clear::<8>);

/// Springs of removed elements have no stiffness.
fn clear<const N: usize>(entity: &mut EntityWorldMut) {
    if let Some(mut axes) = entity.get_mut::<PrintedAxes<N>>() {
        axes.axial.stiffness = [0.0; 3];
        (axes.angular.printed, axes.angular.stiffness) = ([0.0; 3], [0.0; 3]);
        axes.volume.clear();
    }
}

/// Printed springs of up to three axes in an element of `N` vertices.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[component(summary_tick, clone_behavior = Ignore)]
pub struct PrintedAxes<const N: usize> {
    /// Rest positions of the vertices relative to the barycentre (m).
    pub rest: Nodes<N>,
    /// Springs along the axes.
    pub axial: AxialSprings<N>,
    /// Springs between them.
    pub angular: AngularSprings<N>,
    /// Springs on the radii.
    pub volume: VolumeSprings<N>,
    /// Form of the latter's forces.
    pub form: VolumeForm,
}

/// Moduli (Pa) of the axes of an element.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PrintedModuli {
    /// Along the axes.
    pub axial: [f64; 3],
    /// Factor on these.
    pub share: [f64; 3],
    /// Between them, in the order of [`AXIS_PAIRS`], already multiplied by what share of them it has.
    pub angular: [f64; 3],
    /// Of volume.
    pub volume: f64,
}

/// Elements that can hold printed springs.
pub(crate) trait PrintedElement<const N: usize> {
    /// Ends of an axis; `None` where it meets no two faces.
    fn ends(points: [DVec3; N], axis: DVec3) -> Option<Attachment<N>>;
    /// Springs against changes of volume, of vertices at `radii` (m) from the barycentre in an element of
    /// volume `volume` (m^3): with a modulus `modulus` (Pa) they hold against small dilation as
    /// `modulus/2 (J-1)^2` does.
    fn volume_springs(radii: [f64; N], volume: f64, modulus: f64) -> VolumeSprings<N>;
}

/// Marks the two kinds of elements.
pub(crate) struct Printed;

impl PrintedElement<4> for Printed {
    fn ends(points: [DVec3; 4], axis: DVec3) -> Option<Attachment<4>> {
        attachment::tetrahedron(points, axis)
    }
    fn volume_springs(radii: [f64; 4], volume: f64, modulus: f64) -> VolumeSprings<4> {
        let rest: f64 = radii.iter().sum();
        VolumeSprings::Sum(RadiusSum { rest, stiffness: 9.0 * modulus * volume / (rest * rest) })
    }
}

impl PrintedElement<8> for Printed {
    fn ends(points: [DVec3; 8], axis: DVec3) -> Option<Attachment<8>> {
        attachment::hexahedron(points, axis)
    }
    fn volume_springs(radii: [f64; 8], volume: f64, modulus: f64) -> VolumeSprings<8> {
        let squares: f64 = radii.iter().map(|r| r * r).sum();
        let stiffness = 9.0 * modulus * volume / squares;
        VolumeSprings::Radial(RadialSprings { rest: radii, stiffness, damping: 0.0 })
    }
}

fn axial_weight(volume: f64, length: f64) -> f64 {
    volume / (length * length)
}

impl<const N: usize> PrintedAxes<N> {
    /// Springs between the `ends` of the unit vectors `axes` in an element of vertices `points` (m) and volume
    /// `volume` (m^3).
    pub(crate) fn new(
        points: [DVec3; N],
        volume: f64,
        (axes, ends): ([DVec3; 3], [Attachment<N>; 3]),
        moduli: PrintedModuli,
        form: VolumeForm,
    ) -> Self
    where
        Printed: PrintedElement<N>,
    {
        let (spread, length) = (ends.map(|e| e.spread()), ends.map(|e| e.length));
        let centre = points.iter().sum::<DVec3>() / N as f64;
        let pairs = [0, 1, 2].map(|p| {
            let [i, j] = AXIS_PAIRS[p];
            let stiffness = moduli.angular[p] * volume;
            (axes[i].dot(axes[j]), stiffness / (length[i] * length[j]).sqrt(), stiffness)
        });
        let radii = points.map(|x| x.distance(centre));
        Self {
            rest: points.map(|x| (x - centre).to_array()),
            axial: AxialSprings {
                spread,
                length,
                stiffness: [0, 1, 2]
                    .map(|i| moduli.axial[i] * axial_weight(moduli.share[i] * volume, length[i])),
                // dampers are entities of their own
                damping: [0.0; 3],
            },
            angular: AngularSprings {
                spread,
                cosine: pairs.map(|p| p.0),
                printed: pairs.map(|p| p.1),
                stiffness: pairs.map(|p| p.2),
            },
            volume: Printed::volume_springs(radii, volume, moduli.volume),
            form,
        }
    }

    fn positions(&self, u: &Nodes<N>) -> Nodes<N> {
        let mut x = self.rest;
        for a in 0..N {
            for k in 0..3 {
                x[a][k] += u[a][k] - u[0][k];
            }
        }
        x
    }

    /// Energy (J) of the forms that have one.
    pub fn energy(&self, u: &Nodes<N>) -> f64 {
        let x = self.positions(u);
        self.axial.energy(&x) + self.angular.energy(&x) + self.volume.energy(&x)
    }

    /// Forces (N).
    pub fn forces(&self, u: &Nodes<N>) -> Nodes<N> {
        let x = self.positions(u);
        let mut f = self.axial.forces(&x);
        let (angular, volume) =
            (self.angular.forces(&x, AngularForm::Printed), self.volume.forces(&x, self.form));
        for a in 0..N {
            for k in 0..3 {
                f[a][k] += angular[a][k] + volume[a][k];
            }
        }
        f
    }

    /// Tangent (N/m) of the forms that have an energy.
    pub fn tangent(&self, u: &Nodes<N>, kind: TangentKind) -> Blocks<N> {
        let curvature = match kind {
            TangentKind::Exact => Curvature::Exact,
            TangentKind::Projected => Curvature::Definite,
            TangentKind::GaussNewton => Curvature::GaussNewton,
        };
        let x = self.positions(u);
        let mut sum = self.axial.tangent(&x, curvature);
        for more in [self.angular.tangent(&x, curvature), self.volume.tangent(&x, curvature)] {
            for a in 0..N {
                for b in 0..N {
                    for k in 0..9 {
                        sum[a][b][k] += more[a][b][k];
                    }
                }
            }
        }
        sum
    }
}

fn activate<S: Scalar, const N: usize, V: AxisSite<N>>(world: &mut World, law: PlacedLaw) {
    let evaluate = evaluate::<S, N, V>;
    activate_elements::<V, S, (&V, &V::Blocks, &PrintedAxes<N>)>(world, law, evaluate);
}

fn evaluate<S: Scalar, const N: usize, V: AxisSite<N>>(
    Evaluation { request, workers, recovering, .. }: Evaluation,
    u: &[Displacement<S>],
    (sites, blocks, axes): (&[V], &[V::Blocks], &[PrintedAxes<N>]),
    buffer: &mut LawBuffer<S>,
) {
    let u = Displacement::peel_slice(u);
    workers.for_each(&mut buffer.spans, axes.len() * 30 * N * N, |_, span| {
        if recovering.contains(span.body) {
            span.silence();
            return;
        }
        if request.force {
            span.clear_force();
        }
        match request.tangent {
            Some(_) => span.clear_tangent(),
            None => span.drop_tangent(),
        }
        let mut energy = 0.0;
        for i in span.elements.clone() {
            let u = local(u, sites[i].rows());
            if request.energy {
                energy += axes[i].energy(&u);
            }
            if request.force {
                for (&v, f) in sites[i].rows().iter().zip(axes[i].forces(&u)) {
                    span.add_force(v, f.map(S::from_f64));
                }
            }
            if let Some(kind) = request.tangent {
                add_blocks(span, &sites[i], &blocks[i], &axes[i].tangent(&u, kind));
            }
        }
        if request.energy {
            span.energy = energy;
        }
    });
}
