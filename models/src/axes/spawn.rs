//! From a description of axes to entities.

use bevy_ecs::bundle::NoBundleEffect;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::element::{
    AxisBlocks, AxisTetrahedron, AxisVertices, ShapeGradientBundle, shape_gradient_bundle,
};
use sinew_engine::isoparametric::{
    AxisHexahedron, AxisHexahedronBlocks, AxisHexahedronVertices, Derivatives, HexahedronRest,
};
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;

use super::change::AxisSource;
use super::columns::*;
use super::damper::{self, AxialDamper};
use super::description::{AxesDescription, AxisFamily, AxisGroup};
use super::hexahedra;
use super::muscle::{self, Muscle, Muscles};
use super::systems;
use crate::body::SolidPart;
use crate::laws::{self, LawRow};

/// Rows and blocks of a tetrahedron, and where it comes from.
pub(super) type Place = (AxisVertices, AxisBlocks, AxisTetrahedron, BodyId);
/// The same of a hexahedron.
pub(super) type HexahedronRows =
    (AxisHexahedronVertices, AxisHexahedronBlocks, AxisHexahedron, BodyId);
type HexahedronPlace<S> = (HexahedronRows, HexahedronRest<S>);
/// Directions and moduli of a triad.
type TriadMade<S> = (
    (DirectionBundle<S, 0>, DirectionBundle<S, 1>, DirectionBundle<S, 2>),
    AxialBundle<S>,
    AngleBundle<S>,
    VolumeStiffness<S>,
    AxisSource,
);
/// Direction and moduli of a fibre.
type FibreMade<S> = (
    DirectionBundle<S, 0>,
    (
        AxialStiffness<S, 0>,
        FibreShortening<S>,
        FibreActive<S>,
        FibreOffset<S>,
        FibreInverseWidth<S>,
    ),
    (PassiveStiffness<S>, PeakTension<S>, MuscleIndex, AxisSource),
);
type FibreShapes<S> = (FibreShape<S, 1>, FibreShape<S, 2>, FibreShape<S, 3>);

/// Of a tetrahedron of the layout.
pub(super) fn tetrahedron_place(part: &SolidPart, row: usize) -> Place {
    let SolidPart { layout, at, .. } = part;
    (
        AxisVertices(at.vertices(&layout.tetrahedra[row])),
        AxisBlocks(at.blocks(&layout.cells.tetrahedron_edges[row])),
        AxisTetrahedron(layout.tetrahedron_order[row]),
        at.body,
    )
}

/// Of a hexahedron of the layout.
pub(super) fn hexahedron_rows(part: &SolidPart, row: usize) -> HexahedronRows {
    let SolidPart { layout, at, .. } = part;
    (
        AxisHexahedronVertices(at.vertices(&layout.hexahedra[row])),
        AxisHexahedronBlocks(at.blocks(&layout.cells.hexahedron_edges[row])),
        AxisHexahedron(layout.hexahedron_order[row]),
        at.body,
    )
}

/// Spawns the axes of a body, element by element in the order of the layout.
pub(crate) fn spawn_axes<S: Scalar>(world: &mut World, axes: &AxesDescription, part: &SolidPart) {
    let groups = axes.pack();
    let muscles = spawn_muscles::<S>(world, axes, part.at.body.0 as usize);
    let mut triads: Vec<(Place, ShapeGradientBundle<S>, TriadMade<S>)> = Vec::new();
    let mut fibres: Vec<(Place, FibreShapes<S>, FibreMade<S>)> = Vec::new();
    let mut volumes: Vec<(Place, ShapeGradientBundle<S>, VolumeStiffness<S>, VolumeAlone)> =
        Vec::new();
    let mut dampers: Vec<(Place, AxialDamper<4>)> = Vec::new();
    for (row, &original) in part.layout.tetrahedron_order.iter().enumerate() {
        let place = tetrahedron_place(part, row);
        let (shape, t) = (&part.rest.tetrahedra[row], original as usize);
        for (axis, viscosity) in viscous(axes, t, shape.volume) {
            let shape = shape.gradients.map(|d| DVec3::from_array(d).dot(axis));
            dampers.push((place, AxialDamper::new(axis.to_array(), shape, viscosity)));
        }
        let d = [shape.gradients[1], shape.gradients[2], shape.gradients[3]];
        for group in &groups {
            match group {
                AxisGroup::Triad { .. } => {
                    let made = triad(axes, group, t, shape.volume);
                    triads.extend(made.map(|made| (place, shape_gradient_bundle(d), made)));
                }
                &AxisGroup::Fibre(index) => {
                    if let Some(made) = fibre(axes, index, muscles[index], t, shape.volume) {
                        let a = unit(&axes.families[index], t);
                        let q = d.map(|d| S::from_f64(DVec3::from_array(d).dot(a)));
                        let shapes = (FibreShape(q[0]), FibreShape(q[1]), FibreShape(q[2]));
                        fibres.push((place, shapes, made));
                    }
                }
                AxisGroup::Volume(modulus) => {
                    let stiffness = VolumeStiffness(S::from_f64(shape.volume * modulus));
                    volumes.push((place, shape_gradient_bundle(d), stiffness, VolumeAlone));
                }
            }
        }
    }
    spawn_rows::<S, _>(world, triads, &systems::TRIADS);
    spawn_rows::<S, _>(world, fibres, &systems::FIBRES);
    spawn_rows::<S, _>(world, volumes, &systems::VOLUMES);
    spawn_rows::<S, _>(world, dampers, &damper::IN_TETRAHEDRA);
    spawn_in_hexahedra::<S>(world, axes, (&groups, &muscles), part);
}

/// Spawns entities, if there are any, and puts their law into the schedule.
pub(super) fn spawn_rows<S: Scalar, B: Bundle<Effect: NoBundleEffect>>(
    world: &mut World,
    rows: Vec<B>,
    law: &'static LawRow,
) {
    if !rows.is_empty() {
        world.spawn_batch(rows);
        laws::activate::<S>(world, law);
    }
}

fn spawn_in_hexahedra<S: Scalar>(
    world: &mut World,
    axes: &AxesDescription,
    (groups, muscles): (&[AxisGroup], &[u32]),
    part: &SolidPart,
) {
    let mut triads: Vec<(HexahedronPlace<S>, TriadMade<S>)> = Vec::new();
    let mut fibres: Vec<(HexahedronPlace<S>, FibreMade<S>)> = Vec::new();
    let mut volumes: Vec<(HexahedronPlace<S>, VolumeStiffness<S>, VolumeAlone)> = Vec::new();
    let mut dampers: Vec<(HexahedronRows, AxialDamper<8>)> = Vec::new();
    let derivatives = Derivatives::<f64, 8, 3, 8>::hexahedron();
    for (row, &original) in part.layout.hexahedron_order.iter().enumerate() {
        let rows = hexahedron_rows(part, row);
        let rest = &part.rest.hexahedra[row];
        let place = (rows, hexahedra::shares(rest).component::<S>());
        let volume = rest.total_volume();
        // directions of hexahedra follow those of tetrahedra
        let e = part.layout.tetrahedra.len() + original as usize;
        for q in 0..8 {
            for (axis, viscosity) in viscous(axes, e, rest.volume[q]) {
                let shape = hexahedra::shape_of(&derivatives, rest, q, axis);
                dampers.push((rows, AxialDamper::new(axis.to_array(), shape, viscosity)));
            }
        }
        for group in groups {
            match group {
                AxisGroup::Triad { .. } => {
                    triads.extend(triad(axes, group, e, volume).map(|made| (place, made)));
                }
                &AxisGroup::Fibre(index) => {
                    let made = fibre(axes, index, muscles[index], e, volume);
                    fibres.extend(made.map(|made| (place, made)));
                }
                AxisGroup::Volume(modulus) => {
                    let stiffness = VolumeStiffness(S::from_f64(volume * modulus));
                    volumes.push((place, stiffness, VolumeAlone));
                }
            }
        }
    }
    spawn_rows::<S, _>(world, triads, &hexahedra::TRIADS);
    spawn_rows::<S, _>(world, fibres, &hexahedra::FIBRES);
    spawn_rows::<S, _>(world, volumes, &hexahedra::VOLUMES);
    spawn_rows::<S, _>(world, dampers, &damper::IN_HEXAHEDRA);
}

/// Axes and viscosities times `v` (m^3, of an element or of a part of it) of the viscous families in an
/// element.
fn viscous<'a>(
    axes: &'a AxesDescription,
    element: usize,
    v: f64,
) -> impl Iterator<Item = (DVec3, f64)> + 'a {
    let present = axes.families.iter().filter(move |f| f.viscosity * f.share(element) > 0.0);
    present.map(move |f| (unit(f, element), v * f.viscosity * f.share(element)))
}

/// Directions and moduli of a triad in an element of volume `v` (m^3); `None` for other groups.
fn triad<S: Scalar>(
    axes: &AxesDescription,
    group: &AxisGroup,
    element: usize,
    v: f64,
) -> Option<TriadMade<S>> {
    let AxisGroup::Triad { axes: of, axial, angles, volume } = group else { return None };
    let families = of.map(|f| f.map(|f| &axes.families[f]));
    let share = families.map(|f| f.map_or(0.0, |f| f.share(element)));
    let [a, b, c] = triad_directions(families, element);
    let weight = share.map(|share| v * share);
    let modulus = axial.map(|f| f.map_or(0.0, |f| axes.families[f].modulus));
    let y = [0, 1, 2].map(|i| modulus[i] * weight[i]);
    // an angle is as present as the less present of its axes
    let g = super::element::AXIS_PAIRS.map(|[i, j]| share[i].min(share[j]));
    let g = [0, 1, 2].map(|k| v * angles[k] * g[k]);
    Some((
        (direction_bundle(a), direction_bundle(b), direction_bundle(c)),
        axial_bundle(y),
        angle_bundle(g),
        VolumeStiffness(S::from_f64(v * volume)),
        AxisSource::new(*axial, weight),
    ))
}

/// Direction and moduli of a fibre in an element of volume `v` (m^3); `None` where it has no share.
fn fibre<S: Scalar>(
    axes: &AxesDescription,
    index: usize,
    muscle: u32,
    element: usize,
    v: f64,
) -> Option<FibreMade<S>> {
    let family = &axes.families[index];
    let share = family.share(element);
    if share == 0.0 {
        return None;
    }
    let scalar = S::from_f64;
    let weight = v * share;
    let stiffness = scalar(family.modulus * weight);
    let settings = family.muscle.as_ref();
    let peak = settings.map_or(0.0, |m| m.peak_stress);
    let (optimum, width) = settings.map_or((1.0, 1.0), |m| (m.optimal_stretch, m.width));
    Some((
        direction_bundle(unit(family, element).to_array()),
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
            MuscleIndex(muscle),
            AxisSource::new([Some(index), None, None], [weight, 0.0, 0.0]),
        ),
    ))
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
pub(super) fn unit(family: &AxisFamily, tetrahedron: usize) -> DVec3 {
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
