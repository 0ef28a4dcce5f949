//! From a description of axes to entities.

use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::element::{
    AxisBlocks, AxisTetrahedron, AxisVertices, ShapeGradientBundle, shape_gradient_bundle,
};
use sinew_engine::layout::BodyLayout;
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;

use super::columns::*;
use super::description::{AxesDescription, AxisFamily, AxisForm, AxisGroup};
use super::muscle::{self, Muscle, Muscles};
use super::printed::VolumeForm;
use super::printed_system::{self, PrintedAxes, PrintedModuli};
use super::systems::{AxesOnlyBodies, activate_fibres, activate_triads, activate_volumes};
use crate::precompute::RestTetrahedron;

type Place = (AxisVertices, AxisBlocks, AxisTetrahedron, BodyId);
type TriadBundle<S> = (
    Place,
    ShapeGradientBundle<S>,
    (DirectionBundle<S, 0>, DirectionBundle<S, 1>, DirectionBundle<S, 2>),
    (AxialStiffness<S, 0>, AxialStiffness<S, 1>, AxialStiffness<S, 2>),
    (AxisAngleStiffness<S, 0>, AxisAngleStiffness<S, 1>, AxisAngleStiffness<S, 2>),
    VolumeStiffness<S>,
);
type FibreBundle<S> = (
    Place,
    (FibreShape<S, 1>, FibreShape<S, 2>, FibreShape<S, 3>),
    DirectionBundle<S, 0>,
    (
        AxialStiffness<S, 0>,
        FibreShortening<S>,
        FibreActive<S>,
        FibreOffset<S>,
        FibreInverseWidth<S>,
    ),
    (PassiveStiffness<S>, PeakTension<S>, MuscleIndex),
);
type VolumeBundle<S> = (Place, ShapeGradientBundle<S>, VolumeStiffness<S>);

/// Where the rows of a body begin.
#[derive(Clone, Copy)]
pub(crate) struct Offsets {
    pub vertex: u32,
    pub block: u32,
    pub body: BodyId,
}

/// Spawns the axes of a body that lie in its tetrahedra, in their order; `alone` when it has no other law.
pub(crate) fn spawn_axes<S: Scalar>(
    world: &mut World,
    axes: &AxesDescription,
    layout: &BodyLayout,
    rest: &[RestTetrahedron],
    at: Offsets,
    alone: bool,
) {
    let body = at.body.0 as usize;
    world.init_resource::<AxesOnlyBodies>();
    if alone {
        world.resource_mut::<AxesOnlyBodies>().set(body);
    }
    let groups = axes.pack();
    let muscles = spawn_muscles::<S>(world, axes, body);
    let mut triads: Vec<TriadBundle<S>> = Vec::new();
    let mut fibres: Vec<FibreBundle<S>> = Vec::new();
    let mut volumes: Vec<VolumeBundle<S>> = Vec::new();
    let scalar = S::from_f64;
    for (row, &original) in layout.tetrahedron_order.iter().enumerate() {
        let place = (
            AxisVertices(layout.tetrahedra[row].map(|v| v + at.vertex)),
            AxisBlocks(layout.tetrahedron_edges[row].map(|b| b + at.block)),
            AxisTetrahedron(original),
            at.body,
        );
        let (shape, t) = (&rest[row], original as usize);
        let d = [shape.gradients[1], shape.gradients[2], shape.gradients[3]];
        let v = shape.volume;
        for group in &groups {
            match group {
                AxisGroup::Triad { axes: of, axial, angles, volume } => {
                    let family = |i: usize| of[i].map(|f| &axes.families[f]);
                    let share = |i: usize| family(i).map_or(0.0, |f| f.share(t));
                    let [a, b, c] = triad_directions(of.map(|f| f.map(|f| &axes.families[f])), t);
                    let y = [0, 1, 2].map(|i| scalar(v * axial[i] * share(i)));
                    // an angle is as present as the less present of its axes
                    let g = super::element::AXIS_PAIRS.map(|[i, j]| share(i).min(share(j)));
                    let g = [0, 1, 2].map(|k| scalar(v * angles[k] * g[k]));
                    triads.push((
                        place,
                        shape_gradient_bundle(d),
                        (direction_bundle(a), direction_bundle(b), direction_bundle(c)),
                        (AxialStiffness(y[0]), AxialStiffness(y[1]), AxialStiffness(y[2])),
                        (
                            AxisAngleStiffness(g[0]),
                            AxisAngleStiffness(g[1]),
                            AxisAngleStiffness(g[2]),
                        ),
                        VolumeStiffness(scalar(v * volume)),
                    ));
                }
                &AxisGroup::Fibre(index) => {
                    let family = &axes.families[index];
                    let share = family.share(t);
                    if share == 0.0 {
                        continue;
                    }
                    let a = unit(family, t);
                    let q = d.map(|d| scalar(DVec3::from_array(d).dot(a)));
                    let stiffness = scalar(v * family.modulus * share);
                    let settings = family.muscle.as_ref();
                    let peak = settings.map_or(0.0, |m| m.peak_stress);
                    let (optimum, width) =
                        settings.map_or((1.0, 1.0), |m| (m.optimal_stretch, m.width));
                    fibres.push((
                        place,
                        (FibreShape(q[0]), FibreShape(q[1]), FibreShape(q[2])),
                        direction_bundle(a.to_array()),
                        (
                            AxialStiffness(stiffness),
                            FibreShortening(S::ZERO),
                            FibreActive(S::ZERO),
                            FibreOffset(scalar(1.0 - optimum)),
                            FibreInverseWidth(scalar(1.0 / width)),
                        ),
                        (
                            PassiveStiffness(stiffness),
                            PeakTension(scalar(v * peak * share)),
                            MuscleIndex(muscles[index]),
                        ),
                    ));
                }
                AxisGroup::Volume(modulus) => {
                    let stiffness = VolumeStiffness(scalar(v * modulus));
                    volumes.push((place, shape_gradient_bundle(d), stiffness));
                }
            }
        }
    }
    if !triads.is_empty() {
        world.spawn_batch(triads);
        activate_triads::<S>(world);
    }
    if !fibres.is_empty() {
        world.spawn_batch(fibres);
        activate_fibres::<S>(world);
    }
    if !volumes.is_empty() {
        world.spawn_batch(volumes);
        activate_volumes::<S>(world);
    }
}

/// Spawns the axes of a body in the printed form.
pub(crate) fn spawn_printed<S: Scalar>(
    world: &mut World,
    axes: &AxesDescription,
    layout: &BodyLayout,
    rest_of: &dyn Fn(u32) -> DVec3,
    at: Offsets,
    alone: bool,
) {
    world.init_resource::<AxesOnlyBodies>();
    if alone {
        world.resource_mut::<AxesOnlyBodies>().set(at.body.0 as usize);
    }
    let form = match axes.form {
        AxisForm::PrintedBalanced => VolumeForm::Balanced,
        _ => VolumeForm::Printed,
    };
    let groups = axes.pack();
    let mut printed = Vec::new();
    for (row, &original) in layout.tetrahedron_order.iter().enumerate() {
        let (nodes, t) = (layout.tetrahedra[row], original as usize);
        let points = nodes.map(rest_of);
        let [a, b, c] = [points[1] - points[0], points[2] - points[0], points[3] - points[0]];
        let volume = a.dot(b.cross(c)) / 6.0;
        for group in &groups {
            let (families, axial, angular, volume_modulus) = match *group {
                AxisGroup::Triad { axes, axial, angles, volume } => (axes, axial, angles, volume),
                AxisGroup::Fibre(i) => {
                    ([Some(i), None, None], [axes.families[i].modulus, 0.0, 0.0], [0.0; 3], 0.0)
                }
                AxisGroup::Volume(modulus) => ([None; 3], [0.0; 3], [0.0; 3], modulus),
            };
            let families = families.map(|f| f.map(|f| &axes.families[f]));
            let share = families.map(|f| f.map_or(0.0, |f| f.share(t)));
            let pairs = super::element::AXIS_PAIRS.map(|[i, j]| share[i].min(share[j]));
            let moduli = PrintedModuli {
                axial: [0, 1, 2].map(|i| axial[i] * share[i]),
                angular: [0, 1, 2].map(|k| angular[k] * pairs[k]),
                volume: volume_modulus,
            };
            let directions = triad_directions(families, t).map(DVec3::from_array);
            // an axis through the barycentre of a tetrahedron with volume meets two faces
            if let Some(springs) = PrintedAxes::new(points, volume, directions, moduli, form) {
                printed.push((
                    AxisVertices(nodes.map(|v| v + at.vertex)),
                    AxisBlocks(layout.tetrahedron_edges[row].map(|b| b + at.block)),
                    AxisTetrahedron(original),
                    at.body,
                    springs,
                ));
            }
        }
    }
    if !printed.is_empty() {
        world.spawn_batch(printed);
        printed_system::activate::<S>(world);
    }
}

/// Indices of the muscles of all families, [`NO_MUSCLE`] for passive ones.
fn spawn_muscles<S: Scalar>(world: &mut World, axes: &AxesDescription, body: usize) -> Vec<u32> {
    let mut indices = vec![NO_MUSCLE; axes.families.len()];
    for (family, index) in axes.families.iter().zip(&mut indices) {
        if let Some(settings) = &family.muscle {
            muscle::install::<S>(world);
            let muscles = &mut world.resource_mut::<Muscles>().0;
            *index = muscles.len() as u32;
            muscles.push(Muscle::new(body, family.name.to_string(), settings.clone()));
        }
    }
    indices
}

/// Unit vector of a family; where it has none, which its share of 0 allows, any.
fn unit(family: &AxisFamily, tetrahedron: usize) -> DVec3 {
    family.direction(tetrahedron).try_normalize().unwrap_or(DVec3::X)
}

/// Unit vectors of three axes, of which the third may be left open.
pub(crate) fn triad_directions(
    families: [Option<&AxisFamily>; 3],
    tetrahedron: usize,
) -> [[f64; 3]; 3] {
    let of = |f: Option<&AxisFamily>| f.map(|f| unit(f, tetrahedron));
    let a = of(families[0]).unwrap_or(DVec3::X);
    let b = of(families[1]).unwrap_or_else(|| a.any_orthonormal_vector());
    let c = of(families[2])
        .unwrap_or_else(|| a.cross(b).try_normalize().unwrap_or(a.any_orthonormal_vector()));
    [a, b, c].map(|v| v.to_array())
}
