//! The system of the printed springs, on tetrahedra: for comparison, one element at a time in `f64`.

use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::columns::single_table;
use sinew_engine::element::{AxisBlocks, AxisVertices, TETRAHEDRON_EDGES};
use sinew_engine::law::{EvaluationRequest, Law, LawBuffer, RecoveringBodies, Span, TangentKind};
use sinew_engine::scalar::{Scalar, xyz};
use sinew_engine::schedule::{
    ColumnWatch, ForceSystems, activate_law, column_changed, declare_inputs,
};
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::time::Instant;

use super::attachment;
use super::element::AXIS_PAIRS;
use super::printed::{
    AngularForm, AngularSprings, AxialSprings, Blocks, Curvature, Nodes, RadiusSum, VolumeForm,
};
use super::systems::{AxesOnlyBodies, Silence};

/// The springs of Bourguignon & Cani 2000 in their printed form.
pub struct PrintedSprings;

impl Law for PrintedSprings {
    const NAME: &'static str = "axes, printed form";
    const ORDER: u8 = 28;
}

/// Printed springs of up to three axes in a tetrahedron.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[component(summary_tick)]
pub struct PrintedAxes {
    /// Rest positions of the vertices relative to the barycentre (m).
    pub rest: Nodes<4>,
    /// Springs along the axes.
    pub axial: AxialSprings<4>,
    /// Springs between them.
    pub angular: AngularSprings<4>,
    /// Spring on the sum of the radii.
    pub volume: RadiusSum<4>,
    /// Form of the latter's forces.
    pub form: VolumeForm,
}

/// Moduli (Pa) of the axes of an element, already multiplied by what share of them it has.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PrintedModuli {
    /// Along the axes.
    pub axial: [f64; 3],
    /// Between them, in the order of [`AXIS_PAIRS`].
    pub angular: [f64; 3],
    /// Of volume.
    pub volume: f64,
}

impl PrintedAxes {
    /// Springs in a tetrahedron of vertices `points` (m) and volume `volume` (m^3) along the unit vectors `axes`;
    /// `None` where an axis meets no face.
    pub fn new(
        points: [DVec3; 4],
        volume: f64,
        axes: [DVec3; 3],
        moduli: PrintedModuli,
        form: VolumeForm,
    ) -> Option<Self> {
        let mut ends = [None; 3];
        for (end, axis) in ends.iter_mut().zip(axes) {
            *end = attachment::tetrahedron(points, axis);
        }
        let ends = [ends[0]?, ends[1]?, ends[2]?];
        let (spread, length) = (ends.map(|e| e.spread()), ends.map(|e| e.length));
        let centre = points.iter().sum::<DVec3>() / 4.0;
        let rest = points.map(|x| (x - centre).to_array());
        let sum: f64 = points.iter().map(|x| x.distance(centre)).sum();
        let radius = sum / 4.0;
        let pairs = [0, 1, 2].map(|p| {
            let [i, j] = AXIS_PAIRS[p];
            let stiffness = moduli.angular[p] * volume;
            (axes[i].dot(axes[j]), stiffness / (length[i] * length[j]).sqrt(), stiffness)
        });
        Some(Self {
            rest,
            axial: AxialSprings {
                spread,
                length,
                stiffness: [0, 1, 2].map(|i| moduli.axial[i] * volume / length[i].powi(2)),
                damping: [0.0; 3],
            },
            angular: AngularSprings {
                spread,
                cosine: pairs.map(|p| p.0),
                printed: pairs.map(|p| p.1),
                stiffness: pairs.map(|p| p.2),
            },
            volume: RadiusSum {
                rest: sum,
                stiffness: 9.0 * moduli.volume * volume / (16.0 * radius * radius),
            },
            form,
        })
    }

    /// Without stiffness, for removed elements.
    pub(crate) fn clear(&mut self) {
        self.axial.stiffness = [0.0; 3];
        (self.angular.printed, self.angular.stiffness) = ([0.0; 3], [0.0; 3]);
        self.volume.stiffness = 0.0;
    }

    fn positions(&self, u: &Nodes<4>) -> Nodes<4> {
        let mut x = self.rest;
        for a in 0..4 {
            for k in 0..3 {
                x[a][k] += u[a][k] - u[0][k];
            }
        }
        x
    }

    /// Energy (J) of the forms that have one.
    pub fn energy(&self, u: &Nodes<4>) -> f64 {
        let x = self.positions(u);
        self.axial.energy(&x) + self.angular.energy(&x) + self.volume.energy(&x)
    }

    /// Forces (N).
    pub fn forces(&self, u: &Nodes<4>) -> Nodes<4> {
        let x = self.positions(u);
        let mut f = self.axial.forces(&x);
        let (angular, volume) =
            (self.angular.forces(&x, AngularForm::Printed), self.volume.forces(&x, self.form));
        for a in 0..4 {
            for k in 0..3 {
                f[a][k] += angular[a][k] + volume[a][k];
            }
        }
        f
    }

    /// Tangent (N/m) of the forms that have an energy.
    pub fn tangent(&self, u: &Nodes<4>, kind: TangentKind) -> Blocks<4> {
        let curvature = match kind {
            TangentKind::Exact => Curvature::Exact,
            TangentKind::Projected => Curvature::Definite,
            TangentKind::GaussNewton => Curvature::GaussNewton,
        };
        let x = self.positions(u);
        let mut sum = self.axial.tangent(&x, curvature);
        for more in [self.angular.tangent(&x, curvature), self.volume.tangent(&x, curvature)] {
            for a in 0..4 {
                for b in 0..4 {
                    for k in 0..9 {
                        sum[a][b][k] += more[a][b][k];
                    }
                }
            }
        }
        sum
    }
}

/// Puts the printed springs into the force schedule.
pub fn activate<S: Scalar>(world: &mut World) {
    activate_law::<PrintedSprings, S>(world, |schedule| {
        schedule.add_systems(evaluate::<S>.in_set(ForceSystems::Evaluate));
    });
    declare_inputs(
        world,
        PrintedSprings::NAME,
        &[column_changed::<AxisVertices> as ColumnWatch, column_changed::<PrintedAxes>],
    );
}

fn evaluate<S: Scalar>(
    request: Res<EvaluationRequest>,
    workers: Res<Workers>,
    recovering: Res<RecoveringBodies>,
    alone: Res<AxesOnlyBodies>,
    mut buffer: ResMut<LawBuffer<PrintedSprings, S>>,
    vertices: Query<&Displacement<S>>,
    axes: Query<(&AxisVertices, &AxisBlocks, &PrintedAxes)>,
) {
    let start = Instant::now();
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let Some((nodes, blocks, axes)) = single_table(axes.contiguous_iter()) else { return };
    let silence = Silence { recovering: &recovering, alone: &alone };
    workers.for_each(&mut buffer.spans, axes.len() * 500, |_, span| {
        if silence.holds(span.body) {
            span.silence();
            span.force.clear();
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
            let local = nodes[i].0.map(|v| xyz(u[v as usize].0).map(S::to_f64));
            if request.energy {
                energy += axes[i].energy(&local);
            }
            if request.force {
                for (&v, f) in nodes[i].0.iter().zip(axes[i].forces(&local)) {
                    span.add_force(v, f.map(S::from_f64));
                }
            }
            if let Some(kind) = request.tangent {
                add_blocks(span, &nodes[i].0, &blocks[i].0, &axes[i].tangent(&local, kind));
            }
        }
        if request.energy {
            span.energy = energy;
        }
    });
    buffer.time = start.elapsed();
}

fn add_blocks<S: Scalar>(
    span: &mut Span<S>,
    nodes: &[u32; 4],
    blocks: &[u32; 6],
    tangent: &Blocks<4>,
) {
    for a in 0..4 {
        span.add_diagonal(nodes[a], &tangent[a][a].map(S::from_f64));
    }
    for (&block, [a, b]) in blocks.iter().zip(TETRAHEDRON_EDGES) {
        span.add_off_diagonal(block, nodes[a], nodes[b], &tangent[a][b].map(S::from_f64));
    }
}
