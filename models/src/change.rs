//! Another material for a body that exists: every number derived from it is computed again, in the
//! order of [`spawn_body`](crate::body::spawn_body), so that body and a new one agree to the last bit.

use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::element::{
    EdgeBlock, TETRAHEDRON_FACES, TetrahedronBlocks, TetrahedronIndex, TetrahedronVertices,
};
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::{BodyId, Mass, RestPosition};
use std::collections::HashMap;

use crate::body::{Model, SoftBody, moduli_bundle};
use crate::field::{FieldError, MaterialField};
use crate::fused::{CompressionModulus, FirstLameParameter, ShearModulus};
use crate::pooled::{AngularStiffness, TensileStiffness, TriangleVertices, VolumetricStiffness};
use crate::precompute::{ADJACENT_PAIRS, RestTetrahedron, SpringConstants};

/// Gives body number `body` (index into [`Topology::bodies`]) the material of `field`: moduli of the
/// tetrahedra, constants of pooled and edge springs, masses. Displacements and velocities stay.
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
    let rows = world.resource::<Topology>().bodies[body].clone();
    let lame = field.lame(rows.tetrahedra.len())?;
    let mut model = Model::default();
    for mut soft in world.query::<&mut SoftBody>().iter_mut(world) {
        if soft.index == body {
            soft.material = field.material;
            model = soft.model;
        }
    }
    let own = |id: &BodyId| id.0 as usize == body;
    let rest: Vec<DVec3> = world.query::<&RestPosition>().iter(world).map(|x| x.0).collect();
    let springs = world.query::<(&EdgeBlock, &BodyId)>().iter(world).any(|(_, id)| own(id));

    let mut mass = vec![0.0; rows.vertices.len()];
    let mut tensile = vec![0.0; if springs { rows.blocks.len() } else { 0 }];
    let mut angular: HashMap<[u32; 3], [f64; 3]> = HashMap::new();
    let mut tetrahedra = world.query::<(
        &TetrahedronVertices,
        &TetrahedronBlocks,
        &TetrahedronIndex,
        &BodyId,
        (&mut FirstLameParameter<S>, &mut ShearModulus<S>, &mut CompressionModulus<S>),
        Option<(
            &mut VolumetricStiffness<S, 0>,
            &mut VolumetricStiffness<S, 1>,
            &mut VolumetricStiffness<S, 2>,
        )>,
    )>();
    for (nodes, blocks, index, id, moduli, volumetric) in tetrahedra.iter_mut(world) {
        if !own(id) {
            continue;
        }
        let lame = lame[index.0 as usize];
        let (mut first, mut shear, mut compression) = moduli;
        (*first, *shear, *compression) = moduli_bundle::<S>(lame, model);
        let points = nodes.0.map(|v| rest[v as usize].to_array());
        // it had a volume when the body was made
        let Ok(shape) = RestTetrahedron::new(points) else { continue };
        let density = field.at(index.0 as usize).density;
        for v in nodes.0 {
            mass[(v - rows.vertices.start) as usize] += density * shape.volume / 4.0;
        }
        if !springs {
            continue;
        }
        let constants = SpringConstants::new(&shape, lame);
        for (k, block) in constants.tensile.iter().zip(blocks.0) {
            tensile[(block - rows.blocks.start) as usize] += k;
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
    for (block, id, mut k) in
        world.query::<(&EdgeBlock, &BodyId, &mut TensileStiffness<S>)>().iter_mut(world)
    {
        if own(id) {
            k.0 = S::from_f64(tensile[(block.0 - rows.blocks.start) as usize]);
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
    for ((_, mut m), new) in own_masses.zip(mass) {
        m.0 = S::from_f64(new);
    }
    Ok(())
}
