//! Another material for a body that exists: every number derived from it is computed again, in the
//! order of [`spawn_body`](crate::body::spawn_body), so that body and a new one agree to the last bit.

use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::element::{
    EdgeBlock, MembraneBlocks, MembraneVertices, RestVolume, TETRAHEDRON_FACES, TetrahedronBlocks,
    TetrahedronIndex, TetrahedronVertices,
};
use sinew_engine::layout::UNUSED;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::{BodyId, Mass, RestPosition};
use std::collections::HashMap;

use crate::body::{Evaluation, Model, SoftBody, moduli_bundle};
use crate::field::{FieldError, MaterialArrays, MaterialField};
use crate::fused::{CompressionModulus, FirstLameParameter, ShearModulus};
use crate::membrane::{self, RestTriangle};
use crate::pooled::{AngularStiffness, TensileStiffness, TriangleVertices, VolumetricStiffness};
use crate::precompute::{ADJACENT_PAIRS, RestTetrahedron, SpringConstants};
use crate::quadratic::MassSpring;
use crate::sheet::{MembraneModel, surface};

/// Gives the tetrahedra of body number `body` (index into [`Topology::bodies`]) the material of `field`:
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
    let rows = world.resource::<Topology>().bodies[body].clone();
    let lame = field.lame(rows.tetrahedra.len())?;
    let mut query = world.query::<&mut SoftBody>();
    let Some(mut soft) = query.iter_mut(world).find(|soft| soft.index == body) else {
        return Ok(());
    };
    soft.material = field.material;
    soft.arrays = MaterialArrays::of(field);
    let soft = soft.clone();
    let own = |id: &BodyId| id.0 as usize == body;
    let rest: Vec<DVec3> = world.query::<&RestPosition>().iter(world).map(|x| x.0).collect();
    let springs = world.query::<(&EdgeBlock, &BodyId)>().iter(world).any(|(_, id)| own(id));

    let mut mass = vec![0.0; rows.vertices.len()];
    // constants of pooled springs, and of edges that are springs by themselves
    let mut tensile = [(); 2].map(|()| vec![0.0; if springs { rows.blocks.len() } else { 0 }]);
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
        if !pooled && soft.model != Model::MassSpring {
            continue;
        }
        let constants = SpringConstants::new(&shape, lame);
        for (k, block) in constants.tensile.iter().zip(blocks.0) {
            tensile[usize::from(!pooled)][place(block)] += k;
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
    if let Some((thickness, material, model, evaluation)) = soft.membrane {
        let (moduli, surface_density) = surface(&material, thickness);
        let pooled = evaluation == Evaluation::Pooled;
        let springs = pooled || model == MembraneModel::MassSpring;
        let mut triangles = world.query::<(&MembraneVertices, &MembraneBlocks, &BodyId)>();
        for (nodes, blocks, _) in triangles.iter(world).filter(|(_, _, id)| own(id)) {
            let points = nodes.0.map(|v| rest[v as usize].to_array());
            // removed ones have no area
            let Ok(shape) = RestTriangle::new(points) else { continue };
            for v in nodes.0 {
                mass[(v - rows.vertices.start) as usize] += surface_density * shape.area / 3.0;
            }
            if !springs {
                continue;
            }
            let constants = membrane::SpringConstants::new(&shape, moduli);
            for (k, block) in constants.tensile.iter().zip(blocks.0) {
                tensile[usize::from(!pooled)][place(block)] += k;
            }
            if pooled {
                let sum = angular.entry(nodes.0).or_default();
                for m in 0..3 {
                    sum[m] += constants.angular[m];
                }
            }
        }
    }
    let mut edges =
        world.query::<(&EdgeBlock, &BodyId, &mut TensileStiffness<S>, Has<MassSpring>)>();
    for (block, id, mut k, alone) in edges.iter_mut(world) {
        if own(id) {
            k.0 = S::from_f64(tensile[usize::from(alone)][place(block.0)]);
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
