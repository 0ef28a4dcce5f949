//! Another material for a body that exists: every number derived from it is computed again, in the
//! order of [`spawn_body`](crate::body::spawn_body), so that body and a new one agree to the last bit.

use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::compiled_here;
use sinew_engine::connectivity::Connectivity;
use sinew_engine::element::{
    EdgeBlock, EdgeVertices, MembraneBlocks, MembraneVertices, RestVolume, TETRAHEDRON_FACES,
    TetrahedronBlocks, TetrahedronIndex, TetrahedronVertices,
};
use sinew_engine::isoparametric::{
    HexahedronIndex, HexahedronVertices, QuadVertices, RestHexahedron, RestQuad,
};
use sinew_engine::layout::UNUSED;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::{BodyId, Mass, RestPosition};
use std::collections::HashMap;
use std::sync::Arc;

use crate::body::lumped::{self, Sources};
use crate::body::sheet::MembraneModel;
use crate::body::{Evaluation, Model, SoftBody, moduli_bundle};
use crate::element::membrane::{self, RestTriangle};
use crate::element::precompute::{ADJACENT_PAIRS, RestTetrahedron, SpringConstants};
use crate::frame::tetrahedra::{CompressionModulus, FirstLameParameter, ShearModulus};
use crate::laws::pooled::{
    AngularStiffness, TensileStiffness, TriangleVertices, VolumetricStiffness,
};
use crate::laws::quadratic::MassSpring;
use crate::material::field::{FieldError, MaterialArrays, MaterialField};
use crate::resection::Resection;

/// Gives the solid elements of body number `body` (index into [`Topology::bodies`]) the material of `field`:
/// moduli, constants of pooled and edge springs, masses. Displacements and velocities stay; so does the
/// material of its membrane. Arrays of the field are those of the whole mesh, also after removals.
///
/// Removed elements stay removed, and masses are summed over what is left: what
/// [`MassPolicy::Keep`](crate::resection::MassPolicy::Keep) left of removed elements at vertices that have
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
    let lame = field.lame(rows.tetrahedra.len(), rows.hexahedra.len())?;
    let mut query = world.query::<(Entity, &SoftBody)>();
    let found = query.iter(world).find(|(_, soft)| soft.index == body);
    let Some((entity, mut soft)) = found.map(|(entity, soft)| (entity, soft.clone())) else {
        return Ok(());
    };
    soft.material = field.material;
    soft.arrays = MaterialArrays::of(field);
    let own = |id: &BodyId| id.0 as usize == body;
    let rest: Vec<DVec3> = world.query::<&RestPosition>().iter(world).map(|x| x.0).collect();
    if !soft.springs.is_empty() {
        let rest_of = |row: u32| rest[(rows.vertices.start + row) as usize];
        let material = |at: usize| match at.checked_sub(rows.tetrahedra.len()) {
            None => field.at(rows.tetrahedron_order[at] as usize),
            Some(h) => field.at(rows.tetrahedra.len() + rows.hexahedron_order[h] as usize),
        };
        let is_spring = soft.model == Model::MassSpring;
        let sources = Sources {
            elements: rows.elements(),
            rest_of: &rest_of,
            solid: is_spring.then_some((&material as _, soft.spring_method)),
            sheet: soft.membrane.filter(|m| m.model == MembraneModel::MassSpring),
        };
        let springs = sources.springs(|kind, at| rows.order(kind)[at] as usize)?;
        soft.springs = Arc::new(springs);
    }
    world.entity_mut(entity).insert(soft.clone());
    let springs = world.query::<(&EdgeBlock, &BodyId)>().iter(world).any(|(_, id)| own(id));

    let mut mass = vec![0.0; rows.vertices.len()];
    let mut tensile = vec![0.0; if springs { rows.blocks.len() } else { 0 }];
    let place = |block: u32| (block - rows.blocks.start) as usize;
    let mut angular: HashMap<[u32; 3], [f64; 3]> = HashMap::new();
    let mut tetrahedra = world.query::<(
        &TetrahedronVertices,
        &TetrahedronBlocks,
        &TetrahedronIndex,
        (&BodyId, &RestVolume<S>),
        (&mut FirstLameParameter<S>, &mut ShearModulus<S>, &mut CompressionModulus<S>),
        Option<(
            &mut VolumetricStiffness<S, 0>,
            &mut VolumetricStiffness<S, 1>,
            &mut VolumetricStiffness<S, 2>,
        )>,
    )>();
    for (nodes, blocks, index, (id, volume), moduli, volumetric) in tetrahedra.iter_mut(world) {
        // removed ones have no volume
        if !own(id) || volume.0 == S::ZERO {
            continue;
        }
        let lame = lame[index.0 as usize];
        let (mut first, mut shear, mut compression) = moduli;
        (*first, *shear, *compression) = moduli_bundle::<S>(lame, soft.model);
        let points = nodes.0.map(|v| rest[v as usize].to_array());
        // it had a volume when the body was made
        let Ok(shape) = RestTetrahedron::new(points) else { continue };
        let density = field.at(index.0 as usize).density;
        for v in nodes.0 {
            mass[(v - rows.vertices.start) as usize] += density * shape.volume / 4.0;
        }
        let pooled = soft.evaluation == Evaluation::Pooled;
        if !pooled {
            continue;
        }
        let constants = SpringConstants::new(&shape, lame);
        for (k, block) in constants.tensile.iter().zip(blocks.0) {
            tensile[place(block)] += k;
        }
        let Some((mut d0, mut d1, mut d2)) = volumetric else { continue };
        let [c0, c1, c2] = constants.volumetric.map(S::from_f64);
        (d0.0, d1.0, d2.0) = (c0, c1, c2);
        for (c, [apex, j, k]) in constants.angular.iter().zip(ADJACENT_PAIRS) {
            let face = (0..4).find(|v| ![apex, j, k].contains(v)).unwrap_or(0);
            let mut corners = TETRAHEDRON_FACES[face].map(|v| nodes.0[v]);
            corners.sort_unstable();
            let m = corners.iter().position(|&v| v == nodes.0[apex]).unwrap_or(0);
            angular.entry(corners).or_default()[m] += c;
        }
    }
    let mut hexahedra = world.query::<(
        &HexahedronVertices,
        &HexahedronIndex,
        (&BodyId, &RestVolume<S>),
        (&mut FirstLameParameter<S>, &mut ShearModulus<S>, &mut CompressionModulus<S>),
    )>();
    for (nodes, index, (id, volume), moduli) in hexahedra.iter_mut(world) {
        if !own(id) || volume.0 == S::ZERO {
            continue;
        }
        let at = rows.tetrahedra.len() + index.0 as usize;
        let (mut first, mut shear, mut compression) = moduli;
        (*first, *shear, *compression) = moduli_bundle::<S>(lame[at], soft.model);
        let points = nodes.0.map(|v| rest[v as usize].to_array());
        let Ok(shape) = RestHexahedron::new(points) else { continue };
        let density = field.at(at).density;
        for (v, volume) in nodes.0.into_iter().zip(shape.vertex_volumes()) {
            mass[(v - rows.vertices.start) as usize] += density * volume;
        }
    }
    if let Some(settings) = soft.membrane {
        let (moduli, surface_density) = settings.surface();
        let mut triangles = world.query::<(&MembraneVertices, &MembraneBlocks, &BodyId)>();
        for (nodes, blocks, _) in triangles.iter(world).filter(|(_, _, id)| own(id)) {
            let points = nodes.0.map(|v| rest[v as usize].to_array());
            // removed ones have no area
            let Ok(shape) = RestTriangle::new(points) else { continue };
            for v in nodes.0 {
                mass[(v - rows.vertices.start) as usize] += surface_density * shape.area / 3.0;
            }
            if !settings.is_pooled() {
                continue;
            }
            let constants = membrane::SpringConstants::new(&shape, moduli);
            for (k, block) in constants.tensile.iter().zip(blocks.0) {
                tensile[place(block)] += k;
            }
            let sum = angular.entry(nodes.0).or_default();
            for m in 0..3 {
                sum[m] += constants.angular[m];
            }
        }
        let mut quads = world.query::<(&QuadVertices, &BodyId)>();
        for (nodes, _) in quads.iter(world).filter(|(_, id)| own(id)) {
            let points = nodes.0.map(|v| rest[v as usize].to_array());
            // removed ones have no area
            let Ok(shape) = RestQuad::new(points) else { continue };
            for (v, area) in nodes.0.into_iter().zip(shape.vertex_areas()) {
                mass[(v - rows.vertices.start) as usize] += surface_density * area;
            }
        }
    }
    if !soft.springs.is_empty() {
        set_edge_springs::<S>(world, &soft, &rows, &rest);
    }
    let mut edges = world
        .query_filtered::<(&EdgeBlock, &BodyId, &mut TensileStiffness<S>), Without<MassSpring>>();
    for (block, id, mut k) in edges.iter_mut(world) {
        if own(id) {
            k.0 = S::from_f64(tensile[place(block.0)]);
        }
    }
    let mut triangles = world.query::<(
        &TriangleVertices,
        &BodyId,
        &mut AngularStiffness<S, 0>,
        &mut AngularStiffness<S, 1>,
        &mut AngularStiffness<S, 2>,
    )>();
    for (corners, id, mut c0, mut c1, mut c2) in triangles.iter_mut(world) {
        if own(id)
            && let Some(c) = angular.get(&corners.0)
        {
            (c0.0, c1.0, c2.0) = (S::from_f64(c[0]), S::from_f64(c[1]), S::from_f64(c[2]));
        }
    }
    let mut masses = world.query::<(&BodyId, &mut Mass<S>)>();
    let own_masses = masses.iter_mut(world).filter(|(id, _)| own(id));
    for (((_, mut m), new), &piece) in own_masses.zip(mass).zip(&rows.piece) {
        if piece != UNUSED {
            m.0 = S::from_f64(new);
        }
    }
    Ok(())
}

/// Sums the constants of the edges of a body that are springs by themselves over the elements left.
fn set_edge_springs<S: Scalar>(
    world: &mut World,
    soft: &SoftBody,
    rows: &BodyRows,
    rest: &[DVec3],
) {
    let resection = world.get_resource::<Resection>();
    let connectivity = match resection.and_then(|r| r.connectivity(soft.index)) {
        Some(connectivity) => connectivity.clone(),
        None => Connectivity::new(rows),
    };
    let mut edges = world
        .query_filtered::<(&EdgeVertices, &BodyId, &mut TensileStiffness<S>), With<MassSpring>>();
    for (nodes, id, mut k) in edges.iter_mut(world) {
        if id.0 as usize != soft.index {
            continue;
        }
        let [a, b] = nodes.0;
        let local = [a - rows.vertices.start, b - rows.vertices.start];
        if let Ok(edge) = connectivity.cells.edges.binary_search(&local) {
            let sum = soft.springs.at_edge(&connectivity, edge as u32);
            let way = rest[a as usize] - rest[b as usize];
            k.0 = S::from_f64(lumped::tensile_stiffness(sum, way.to_array()));
        }
    }
}
