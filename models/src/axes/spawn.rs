//! From a description of axes to entities.

use bevy_ecs::bundle::NoBundleEffect;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::element::{
    AxisBlocks, AxisTetrahedron, AxisVertices, ShapeGradientBundle, shape_gradient_bundle,
};
use sinew_engine::isoparametric::{
    AxisHexahedron, AxisHexahedronBlocks, AxisHexahedronVertices, AxisTetrahedron10Blocks,
    AxisTetrahedron10Vertices, PointsRest, RestPoints,
};
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;

use super::columns::*;
use super::damper::{self, AxialDamper};
use super::description::{AxesDescription, AxisFamily, AxisGroup};
use super::muscle::{self, Muscle, Muscles};
use super::points;
use super::softening::report_fibres;
use super::systems;
use crate::element::membrane::RestTriangle;
use crate::frame::hexahedra::{Brick, Shape, TenNodes};
use crate::frame::part::SolidPart;
use crate::frame::row::{self, LawRow};
use crate::frame::rules::Evaluation;

/// Rows and blocks of a tetrahedron, and where it comes from.
pub(super) type Place = (AxisVertices, AxisBlocks, AxisTetrahedron, BodyId);
/// The same of a hexahedron.
pub(super) type HexahedronRows =
    (AxisHexahedronVertices, AxisHexahedronBlocks, AxisHexahedron, BodyId);
/// The same of a ten-node tetrahedron.
type Tetrahedron10Rows =
    (AxisTetrahedron10Vertices, AxisTetrahedron10Blocks, AxisTetrahedron, BodyId);
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
pub(crate) type ShapesMade<S> = (FibreShape<S, 1>, FibreShape<S, 2>, FibreShape<S, 3>);
/// Direction and modulus of a biquadratic fibre.
pub(crate) type BiquadraticMade<S> = (DirectionBundle<S, 0>, AxialStiffness<S, 0>, AxisSource);

/// Of a tetrahedron of the layout.
pub(super) fn tetrahedron_place(part: &SolidPart, row: usize) -> Place {
    let SolidPart { layout, at, .. } = part;
    (
        AxisVertices(at.vertices(&layout.tetrahedra()[row])),
        AxisBlocks(at.blocks(&layout.cells.edges_of.tetrahedra.each::<6>()[row])),
        AxisTetrahedron(layout.order.tetrahedra[row]),
        at.body,
    )
}

/// Of a hexahedron of the layout.
pub(super) fn hexahedron_rows(part: &SolidPart, row: usize) -> HexahedronRows {
    let SolidPart { layout, at, .. } = part;
    (
        AxisHexahedronVertices(at.vertices(&layout.hexahedra()[row])),
        AxisHexahedronBlocks(at.blocks(&layout.cells.edges_of.hexahedra.each::<28>()[row])),
        AxisHexahedron(layout.order.hexahedra[row]),
        at.body,
    )
}

/// Of a ten-node tetrahedron of the layout.
fn tetrahedron10_rows(part: &SolidPart, row: usize) -> Tetrahedron10Rows {
    let SolidPart { layout, at, .. } = part;
    (
        AxisTetrahedron10Vertices(at.vertices(&layout.tetrahedra10()[row])),
        AxisTetrahedron10Blocks(at.blocks(&layout.cells.edges_of.tetrahedra.each::<45>()[row])),
        AxisTetrahedron(layout.order.tetrahedra[row]),
        at.body,
    )
}

/// Spawns the axes of a body, element by element in the order of the layout; in bodies of pooled springs, those that
/// are springs are a part of these.
pub(crate) fn spawn_axes<S: Scalar>(
    world: &mut World,
    axes: &AxesDescription,
    part: &SolidPart,
    evaluation: Evaluation,
) {
    let groups = axes.pack();
    if axes.has_biquadratic() {
        report_fibres::<S>(world);
    }
    let muscles = spawn_muscles::<S>(world, axes, part.at.body.0 as usize);
    let mut triads: Vec<(Place, ShapeGradientBundle<S>, TriadMade<S>)> = Vec::new();
    let mut fibres: Vec<(Place, ShapesMade<S>, FibreMade<S>)> = Vec::new();
    let mut biquadratics: Vec<(Place, ShapesMade<S>, BiquadraticMade<S>)> = Vec::new();
    let mut volumes: Vec<(Place, ShapeGradientBundle<S>, VolumeStiffness<S>, VolumeAlone)> =
        Vec::new();
    let mut dampers: Vec<(Place, AxialDamper<4>)> = Vec::new();
    for (row, shape) in part.rest.tetrahedra.iter().enumerate() {
        let place = tetrahedron_place(part, row);
        let t = part.layout.order.tetrahedra[row] as usize;
        for (axis, viscosity) in viscous(axes, t, shape.volume) {
            let shape = shape.gradients.map(|d| DVec3::from_array(d).dot(axis));
            dampers.push((place, AxialDamper::new(axis.to_array(), shape, viscosity)));
        }
        let d = [shape.gradients[1], shape.gradients[2], shape.gradients[3]];
        let shapes = |family: usize| {
            let a = unit(&axes.families[family], t);
            let [a, b, c] = d.map(|d| S::from_f64(DVec3::from_array(d).dot(a)));
            (FibreShape(a), FibreShape(b), FibreShape(c))
        };
        for group in &groups {
            match group {
                AxisGroup::Triad { .. } => {
                    let made = triad(axes, group, t, shape.volume);
                    triads.extend(made.map(|made| (place, shape_gradient_bundle(d), made)));
                }
                &AxisGroup::Fibre(index) => {
                    let made = fibre(axes, index, muscles[index], t, shape.volume);
                    fibres.extend(made.map(|made| (place, shapes(index), made)));
                }
                &AxisGroup::Biquadratic(index) => {
                    let made = biquadratic(axes, index, t, shape.volume);
                    biquadratics.extend(made.map(|made| (place, shapes(index), made)));
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
    if evaluation == Evaluation::Pooled {
        let marked = biquadratics.into_iter().map(|own| (own, PooledBiquadratic)).collect();
        spawn_rows::<S, _>(world, marked, &systems::BIQUADRATIC_PROJECTION);
    } else {
        let marked = biquadratics.into_iter().map(|own| (own, Biquadratic)).collect();
        spawn_rows::<S, _>(world, marked, &systems::BIQUADRATIC);
    }
    spawn_rows::<S, _>(world, volumes, &systems::VOLUMES);
    spawn_rows::<S, _>(world, dampers, &damper::IN_TETRAHEDRA);
    let in_hexahedra = AtPoints {
        rest: &part.rest.hexahedra,
        share: &|row| part.filled[row].share,
        rows: |row| hexahedron_rows(part, row),
        // directions of hexahedra follow those of tetrahedra
        element: |row| {
            part.layout.order.tetrahedra.len() + part.layout.order.hexahedra[row] as usize
        },
        laws: [
            &points::TRIADS,
            &points::FIBRES,
            &points::BIQUADRATIC,
            &points::VOLUMES,
            &damper::IN_HEXAHEDRA,
        ],
    };
    spawn_at_points::<S, Brick, _, 8, 28, 8>(world, axes, (&groups, &muscles), &in_hexahedra);
    let in_tetrahedra10 = AtPoints {
        rest: &part.rest.tetrahedra10,
        share: &|_| 1.0,
        rows: |row| tetrahedron10_rows(part, row),
        element: |row| part.layout.order.tetrahedra[row] as usize,
        laws: [
            &points::TRIADS10,
            &points::FIBRES10,
            &points::BIQUADRATIC10,
            &points::VOLUMES10,
            &damper::IN_TETRAHEDRA10,
        ],
    };
    spawn_at_points::<S, TenNodes, _, 10, 45, 4>(
        world,
        axes,
        (&groups, &muscles),
        &in_tetrahedra10,
    );
}

/// Spawns entities, if there are any, and puts their law into the schedule.
pub(crate) fn spawn_rows<S: Scalar, B: Bundle<Effect: NoBundleEffect>>(
    world: &mut World,
    rows: Vec<B>,
    law: &'static LawRow,
) {
    if !rows.is_empty() {
        world.spawn_batch(rows);
        row::activate::<S>(world, law);
    }
}

/// Elements of a kind in which axes lie at points.
struct AtPoints<'a, Rows, Element, const Q: usize> {
    rest: &'a [RestPoints<Q>],
    /// What share of an element is filled.
    share: &'a dyn Fn(usize) -> f64,
    /// Rows and blocks of an element of the layout.
    rows: Rows,
    /// Its number in lists of directions.
    element: Element,
    /// Laws of triads, fibres, biquadratic ones, terms of volume and dampers.
    laws: [&'static LawRow; 5],
}

fn spawn_at_points<S, E, R, const V: usize, const P: usize, const Q: usize>(
    world: &mut World,
    axes: &AxesDescription,
    (groups, muscles): (&[AxisGroup], &[u32]),
    of: &AtPoints<'_, impl Fn(usize) -> R, impl Fn(usize) -> usize, Q>,
) where
    S: Scalar,
    E: Shape<V, P, Q>,
    R: Bundle<Effect: NoBundleEffect> + Copy,
{
    type Placed<R, S, const Q: usize> = (R, PointsRest<S, Q>);
    let mut triads: Vec<(Placed<R, S, Q>, TriadMade<S>)> = Vec::new();
    let mut fibres: Vec<(Placed<R, S, Q>, FibreMade<S>)> = Vec::new();
    let mut biquadratics: Vec<(Placed<R, S, Q>, BiquadraticMade<S>, Biquadratic)> = Vec::new();
    let mut volumes: Vec<(Placed<R, S, Q>, VolumeStiffness<S>, VolumeAlone)> = Vec::new();
    let mut dampers: Vec<(R, AxialDamper<V>)> = Vec::new();
    let derivatives = E::derivatives::<f64>();
    for (row, rest) in of.rest.iter().enumerate() {
        let rows = (of.rows)(row);
        let filled = (of.share)(row);
        let mut shares = points::shares(rest);
        shares.volume = shares.volume.map(|v| filled * v);
        let place = (rows, shares.component::<S>());
        let volume = rest.total_volume();
        let e = (of.element)(row);
        for q in 0..Q {
            for (axis, viscosity) in viscous(axes, e, filled * rest.volume[q]) {
                let shape = points::shape_of(&derivatives, rest, q, axis);
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
                &AxisGroup::Biquadratic(index) => {
                    let made = biquadratic(axes, index, e, volume);
                    biquadratics.extend(made.map(|made| (place, made, Biquadratic)));
                }
                AxisGroup::Volume(modulus) => {
                    let stiffness = VolumeStiffness(S::from_f64(volume * modulus));
                    volumes.push((place, stiffness, VolumeAlone));
                }
            }
        }
    }
    let [of_triads, of_fibres, of_biquadratics, of_volumes, of_dampers] = of.laws;
    spawn_rows::<S, _>(world, triads, of_triads);
    spawn_rows::<S, _>(world, fibres, of_fibres);
    spawn_rows::<S, _>(world, biquadratics, of_biquadratics);
    spawn_rows::<S, _>(world, volumes, of_volumes);
    spawn_rows::<S, _>(world, dampers, of_dampers);
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

/// Direction and modulus of a biquadratic fibre in an element of volume `v` (m^3); `None` where it has no share.
fn biquadratic<S: Scalar>(
    axes: &AxesDescription,
    index: usize,
    element: usize,
    v: f64,
) -> Option<BiquadraticMade<S>> {
    let family = &axes.families[index];
    let axis = unit(family, element).to_array();
    biquadratic_along(family, index, axis, v * family.share(element))
}

/// The same along an axis (unit vector), where the share of the element in its volume is `weight` (m^3).
fn biquadratic_along<S: Scalar>(
    family: &AxisFamily,
    index: usize,
    axis: [f64; 3],
    weight: f64,
) -> Option<BiquadraticMade<S>> {
    (weight > 0.0).then(|| {
        (
            direction_bundle(axis),
            AxialStiffness(S::from_f64(family.modulus * weight)),
            AxisSource::new([Some(index), None, None], [weight, 0.0, 0.0]),
        )
    })
}

/// A biquadratic fibre of the family of number `index` in a triangle of volume `v` (m^3); `None` where it has no share.
pub(crate) fn sheet_fibre<S: Scalar>(
    family: &AxisFamily,
    index: usize,
    rest: &RestTriangle,
    (element, v): (usize, f64),
) -> Option<(ShapesMade<S>, BiquadraticMade<S>)> {
    let axis = rest.in_plane(unit(family, element).to_array())?;
    let [_, a, b] = rest.along(axis).map(S::from_f64);
    let made = biquadratic_along(family, index, axis, v * family.share(element))?;
    Some(((FibreShape(a), FibreShape(b), FibreShape(S::ZERO)), made))
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
