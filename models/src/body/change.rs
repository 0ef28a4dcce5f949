//! Another material for a body that exists: every number derived from it is computed again, as
//! [`spawn_body`](crate::body::spawn::spawn_body) computes it, so that body and a new one agree to the last bit.

use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::compiled_here;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::element::{EdgeVertices, RestVolume, TetrahedronIndex};
use sinew_engine::isoparametric::{HexahedronIndex, HexahedronVertices};
use sinew_engine::layout::{Cells, UNUSED};
use sinew_engine::resource::{put, take};
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::{BodyId, Mass, RestPosition, WeightShift};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use crate::body::description::SoftBody;
use crate::body::edit_log::{Edit, before_edit, log_edit};
use crate::body::lumped::ElementSprings;
use crate::body::matter::{Chosen, Items, Matter, chosen};
use crate::body::present::Resection;
use crate::body::spawn::volumetric_bundle;
use crate::frame::moduli::moduli_bundle;
use crate::frame::moduli::{CompressionModulus, FirstLameParameter, ShearModulus};
use crate::frame::reduced::HourglassStiffness;
use crate::laws::models::Model;
use crate::laws::pooled::{
    AngularStiffness, TensileStiffness, TriangleVertices, VolumetricStiffness,
};
use crate::laws::quadratic::MassSpring;
use crate::material::LameParameters;
use crate::material::field::{FieldError, MaterialArrays, MaterialField};

/// Gives the solid elements of body number `body` (index into [`Topology::bodies`]) the material of `field`:
/// moduli, constants of pooled and edge springs, masses. Displacements and velocities stay; so does the
/// material of its membrane. Arrays of the field are those of the whole mesh, also after removals.
///
/// Removed elements stay removed, and masses are summed over what is left: what
/// [`MassPolicy::Keep`](crate::body::present::MassPolicy::Keep) left of removed elements at vertices that have
/// others goes; a vertex without elements keeps the mass that it has, whatever the new material.
///
/// What solvers remember is not touched: `sinew::simulation::Simulation::set_material` does that too.
///
/// # Errors
/// When the field cannot be used; nothing is changed then.
///
/// # Panics
/// When there is no such body.
pub fn set_material<S: Scalar>(
    world: &mut World,
    body: usize,
    field: &MaterialField,
) -> Result<(), FieldError> {
    compiled_here!(S, change(world: &mut World, body: usize, field: &MaterialField) -> Result<(), FieldError>)
}

fn change<S: Scalar>(
    world: &mut World,
    body: usize,
    field: &MaterialField,
) -> Result<(), FieldError> {
    let rows = world.resource::<Topology>().bodies[body].clone();
    let mut query = world.query::<(Entity, &SoftBody)>();
    let found = query.iter(world).find(|(_, soft)| soft.index == body);
    let Some((entity, mut soft)) = found.map(|(entity, soft)| (entity, soft.clone())) else {
        return Ok(());
    };
    // what is filled is a matter of shape
    let kept = soft.arrays.clone();
    let field = &MaterialField { filled: kept.field(field.material).filled, ..*field };
    let lame = field.lame(rows.mesh_elements(ElementKind::Tetrahedron), rows.hexahedra().len())?;
    let rest = rest_positions(world, rows.vertices.clone());
    let rest_of = |row: u32| rest[row as usize];
    let matter = Matter { field: *field, ..soft.matter(&rows.ordered, &rest_of) };
    let springs = if soft.springs.is_empty() {
        soft.springs.clone()
    } else {
        Arc::new(matter.element_springs()?)
    };
    let left = left_of(world, body, &rows);
    let mut masses = matter.masses(Items::All(rest.len()), &left);
    soft.masses.apply(&mut masses);
    let shifts = matter.weight_shifts(Items::All(rest.len()), &left);
    before_edit::<S>(world);
    set_moduli::<S>(world, body, soft.model, &lame);
    set_hourglass_stiffness::<S>(world, body, (soft.model, rows.vertices.start), &matter, &lame);
    if matter.is_pooled() || !springs.is_empty() {
        set_springs::<S>(world, body, (&matter, &springs), (&left, &lame));
    }
    let mut query = world.query::<(&BodyId, &mut Mass<S>, &mut WeightShift<S>)>();
    let own = query.iter_mut(world).filter(|(id, ..)| id.0 as usize == body);
    for (((_, mut m, mut shift), new), &piece) in
        own.zip(masses.into_iter().zip(shifts)).zip(&rows.piece)
    {
        if piece != UNUSED {
            (m.0, shift.0) = (S::from_f64(new.0), S::from_f64(new.1));
        }
    }
    world.resource_mut::<Topology>().bodies[body].changes += 1;
    soft.material = field.material;
    soft.arrays = MaterialArrays::of(field);
    soft.springs = springs;
    let (material, arrays) = (soft.material, soft.arrays.clone());
    world.entity_mut(entity).insert(soft);
    log_edit(world, Edit::Material { body, material, arrays });
    Ok(())
}

/// Writes the moduli of the elements that are left; `lame` are the Lamé parameters (Pa) of all of the mesh, hexahedra after
/// tetrahedra.
fn set_moduli<S: Scalar>(world: &mut World, body: usize, model: Model, lame: &[LameParameters]) {
    let mut query = world.query::<(
        (&BodyId, &RestVolume<S>, AnyOf<(&TetrahedronIndex, &HexahedronIndex)>),
        (&mut FirstLameParameter<S>, &mut ShearModulus<S>, &mut CompressionModulus<S>),
    )>();
    let ordered = world.resource::<Topology>().bodies[body].ordered.clone();
    let first = ordered.mesh_elements(ElementKind::Tetrahedron);
    for ((id, volume, (t, h)), (mut lambda, mut mu, mut compression)) in query.iter_mut(world) {
        // removed ones have no volume
        if id.0 as usize == body && volume.0 != S::ZERO {
            let tetrahedron = |t: &TetrahedronIndex| ordered.source(ElementKind::Tetrahedron, t.0);
            let index = t.map_or(first, |t| tetrahedron(t) as usize);
            let index = index + h.map_or(0, |h| h.0 as usize);
            (*lambda, *mu, *compression) =
                moduli_bundle::<S>(model.lame(lame[index]), model.has_compression());
        }
    }
}

/// Writes the stiffness of the hourglass modes of the elements that are left; `lame` as above, `first` is the first vertex row of
/// the body.
fn set_hourglass_stiffness<S: Scalar>(
    world: &mut World,
    body: usize,
    (model, first): (Model, u32),
    matter: &Matter,
    lame: &[LameParameters],
) {
    type Element<S> = (
        &'static BodyId,
        &'static HexahedronVertices,
        &'static HexahedronIndex,
        &'static RestVolume<S>,
    );
    let mut query = world.query::<(Element<S>, &mut HourglassStiffness<S>)>();
    for ((id, nodes, index, volume), mut stiffness) in query.iter_mut(world) {
        if id.0 as usize == body && volume.0 != S::ZERO {
            let place = matter.ordered.order.tetrahedra.len() + index.0 as usize;
            let points = nodes.0.map(|row| (matter.rest_of)(row - first).to_array());
            let filled = matter.field.filled_at(place);
            *stiffness = HourglassStiffness::new(&points, model.lame(lame[place]), &filled);
        }
    }
}

/// Sums the constants of pooled springs of a body again, after the modulus of its fibres was changed.
pub(super) fn sum_springs<S: Scalar>(world: &mut World, body: usize) {
    let rows = world.resource::<Topology>().bodies[body].clone();
    let mut query = world.query::<&SoftBody>();
    let found = query.iter(world).find(|soft| soft.index == body);
    let Some(soft) = found.cloned() else { return };
    let rest = rest_positions(world, rows.vertices.clone());
    let rest_of = |row: u32| rest[row as usize];
    let matter = soft.matter(&rows.ordered, &rest_of);
    let lame =
        matter.field.lame(rows.mesh_elements(ElementKind::Tetrahedron), rows.hexahedra().len());
    // a membrane alone has no material of solid elements
    let lame = lame.unwrap_or_default();
    let left = left_of(world, body, &rows);
    set_springs::<S>(world, body, (&matter, &soft.springs), (&left, &lame));
}

/// Rest positions (m) of the vertices in these rows.
fn rest_positions(world: &mut World, rows: Range<u32>) -> Vec<DVec3> {
    let mut rest = world.query::<&RestPosition>();
    rest.iter(world).skip(rows.start as usize).take(rows.len()).map(|x| x.0).collect()
}

/// Elements of a body that were not removed.
fn left_of(world: &World, body: usize, rows: &BodyRows) -> Chosen {
    let resection = world.get_resource::<Resection>().and_then(|r| r.connectivity(body));
    chosen(&rows.ordered, |kind, e| resection.is_none_or(|r| r.is_present(kind, e)))
}

/// Writes the constants of all springs, summed over the elements `left`.
fn set_springs<S: Scalar>(
    world: &mut World,
    body: usize,
    (matter, springs): (&Matter, &ElementSprings),
    (left, lame): (&Chosen, &[LameParameters]),
) {
    let resection = take::<Resection>(world);
    let cells = match resection.connectivity(body) {
        Some(connectivity) => Cow::Borrowed(&connectivity.cells),
        None => {
            let ordered = matter.ordered;
            Cow::Owned(Cells::new(ordered.row_count(), &ordered.nodes))
        }
    };
    let (edges, triangles) = (Items::All(cells.edges.len()), Items::All(cells.triangles.len()));
    let of_left = |&t: &u32| lame[matter.place(ElementKind::Tetrahedron, t)];
    let of_left: Vec<_> = left[ElementKind::Tetrahedron].iter().map(of_left).collect();
    let alone = matter.edge_springs(springs, &cells, edges, left);
    let pooled = matter.pooled_springs(&cells, [edges, triangles], left, &of_left);
    let first = world.resource::<Topology>().bodies[body].vertices.start;
    let own = |id: &BodyId| id.0 as usize == body;

    let mut query =
        world.query::<(&EdgeVertices, &BodyId, &mut TensileStiffness<S>, Has<MassSpring>)>();
    for (nodes, id, mut k, is_alone) in query.iter_mut(world) {
        if own(id)
            && let Ok(edge) = cells.edges.binary_search(&nodes.0.map(|v| v - first))
        {
            k.0 = S::from_f64(if is_alone { alone[edge] } else { pooled.tensile[edge] });
        }
    }
    let mut query = world.query::<(
        &TriangleVertices,
        &BodyId,
        (&mut AngularStiffness<S, 0>, &mut AngularStiffness<S, 1>, &mut AngularStiffness<S, 2>),
    )>();
    for (corners, id, (mut c0, mut c1, mut c2)) in query.iter_mut(world) {
        if own(id)
            && let Ok(triangle) = cells.triangles.binary_search(&corners.0.map(|v| v - first))
            && let Some(c) = pooled.angular[triangle]
        {
            [c0.0, c1.0, c2.0] = c.map(S::from_f64);
        }
    }
    let rows = matter.ordered.rows_of(ElementKind::Tetrahedron);
    let mut query = world.query::<(
        (&TetrahedronIndex, &BodyId),
        (
            &mut VolumetricStiffness<S, 0>,
            &mut VolumetricStiffness<S, 1>,
            &mut VolumetricStiffness<S, 2>,
        ),
    )>();
    for ((index, id), (mut d0, mut d1, mut d2)) in query.iter_mut(world) {
        if own(id)
            && let Ok(t) = left[ElementKind::Tetrahedron].binary_search(&rows[index.0 as usize])
        {
            (*d0, *d1, *d2) = volumetric_bundle::<S>(pooled.volumetric[t]);
        }
    }
    put(world, resection);
}
