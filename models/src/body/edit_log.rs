//! What was done to bodies after they were spawned, and what they were before.

use bevy_ecs::prelude::*;
use bevy_ecs::world::WorldId;
use serde::{Deserialize, Serialize};
use sinew_engine::columns::TableImage;
use sinew_engine::connectivity::{ByKind, ElementKind};
use sinew_engine::fnv::Fnv64;
use sinew_engine::isoparametric::OwnPoints;
use sinew_engine::layout::UNUSED;
use sinew_engine::resource::ensure;
use sinew_engine::row::LocalRow;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::{BodyId, RestPosition};
use std::sync::{Arc, OnceLock, Weak};

use super::description::SoftBody;
use super::present::{MassPolicy, Resection};
use crate::cutting::stroke::Stroke;
use crate::frame::rules::{Integration, VolumeRule};
use crate::material::YoungPoisson;
use crate::material::field::MaterialArrays;

/// Something that was done to a body between steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Edit {
    /// Elements were removed.
    Removal {
        /// Index of the body.
        body: usize,
        /// Which, by their indices in the user's mesh or list.
        elements: ByKind<Vec<u32>>,
        /// What became of their mass.
        mass: MassPolicy,
    },
    /// It was given another material.
    Material {
        /// Index of the body.
        body: usize,
        /// Material of elements without one of their own.
        material: YoungPoisson,
        /// What varies of it.
        arrays: MaterialArrays,
    },
    /// A family of its axes was given another modulus.
    AxisModulus {
        /// Index of the body.
        body: usize,
        /// Name of the family.
        family: String,
        /// Modulus (Pa).
        modulus: f64,
    },
    /// It was cut.
    Cut {
        /// Index of the body.
        body: usize,
        /// What the blade did to its material.
        stroke: Stroke,
    },
}

impl Edit {
    /// Whether this edit makes `earlier` superfluous, so that the log may drop it.
    fn replaces(&self, earlier: &Self) -> bool {
        match (self, earlier) {
            (Self::Material { body, .. }, Self::Material { body: of, .. }) => body == of,
            (
                Self::AxisModulus { body, family, .. },
                Self::AxisModulus { body: of, family: other, .. },
            ) => body == of && family == other,
            _ => false,
        }
    }
}

/// All edits of a world, in their order.
#[derive(Resource, Clone, Debug, Default)]
pub struct EditLog {
    pub(crate) edits: Vec<Arc<Edit>>,
    /// Of every body as it was spawned.
    hashes: Vec<u64>,
    /// Where the tables go before they change, if somebody still wants them as they are.
    pub(crate) image: Weak<OnceLock<Option<EditImage>>>,
}

/// Tables and lists as they were before an edit.
pub(crate) struct EditImage {
    /// World that it belongs to.
    pub world: WorldId,
    pub tables: TableImage,
    pub topology: Topology,
    pub resection: Option<Resection>,
    pub points: OwnPoints,
    pub bodies: Vec<(Entity, SoftBody)>,
}

impl std::fmt::Debug for EditImage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "EditImage of {:?}", self.world)
    }
}

impl EditImage {
    fn take(world: &mut World) -> Option<Self> {
        let tables = TableImage::take(world)?;
        let mut bodies = world.query::<(Entity, &SoftBody)>();
        Some(Self {
            world: world.id(),
            tables,
            topology: world.resource::<Topology>().clone(),
            resection: world.get_resource::<Resection>().cloned(),
            points: world.get_resource::<OwnPoints>().cloned().unwrap_or_default(),
            bodies: bodies.iter(world).map(|(entity, body)| (entity, body.clone())).collect(),
        })
    }
}

/// Notes what bodies are before they are changed. Call it before every edit that may succeed.
pub(crate) fn before_edit<S: Scalar>(world: &mut World) {
    scene_hash::<S>(world);
    let Some(image) = world.resource::<EditLog>().image.upgrade() else { return };
    if image.get().is_none() {
        let made = EditImage::take(world);
        let _ = image.set(made);
    }
}

/// Notes an edit that was done.
pub(crate) fn log_edit(world: &mut World, edit: Edit) {
    let mut log = ensure::<EditLog>(world);
    // who wants the tables as they are now has to say so again
    log.image = Weak::new();
    if log.edits.last().is_some_and(|last| edit.replaces(last)) {
        log.edits.pop();
    }
    log.edits.push(Arc::new(edit));
}

/// A number that two worlds share if their bodies were spawned alike, whatever was done to them since.
pub fn scene_hash<S: Scalar>(world: &mut World) -> u64 {
    let known = ensure::<EditLog>(world).hashes.len();
    let count = world.resource::<Topology>().bodies.len();
    if known < count {
        let mut soft = world.query::<&SoftBody>();
        let mut rest = world.query::<(&BodyId, &RestPosition)>();
        let mut sums: Vec<Sum> = Vec::new();
        for body in &world.resource::<Topology>().bodies {
            let mut sum = Sum::default();
            sum.text(&body.name);
            let vertices: Vec<u32> = body.vertex_order.iter().map(|vertex| vertex.0).collect();
            let row = |row: &Option<LocalRow>| row.map_or(UNUSED, |row| row.0);
            let rows: Vec<u32> = body.row_of_vertex.iter().map(row).collect();
            sum.numbers(&vertices);
            sum.numbers(&rows);
            if body.spare > 0 {
                sum.add(body.spare as u64);
            }
            for kind in ElementKind::ALL {
                sum.numbers(&body.order[kind]);
            }
            sum.numbers(body.tetrahedra().as_flattened());
            if !body.tetrahedra10().is_empty() {
                sum.numbers(body.tetrahedra10().as_flattened());
            }
            sum.numbers(body.nodes.hexahedra.flat());
            sum.numbers(body.nodes.triangles.flat());
            sum.numbers(body.nodes.quads.flat());
            sums.push(sum);
        }
        for (id, x) in rest.iter(world) {
            x.0.to_array().iter().for_each(|x| sums[id.0 as usize].add(x.to_bits()));
        }
        for own in soft.iter(world) {
            let SoftBody { material, arrays, model, evaluation, spring_rule, .. } = own;
            let SoftBody { given, masses, membrane, axes, volume, integration, .. } = own;
            let law = own.law.map(|law| law.info.name);
            // none of these holds anything but names and numbers
            let what = (material, arrays, model, law, evaluation, spring_rule);
            sums[own.index].text(&format!("{what:?} {:?}", (given, masses, membrane, axes)));
            if *volume != VolumeRule::default() {
                sums[own.index].text(&format!("{volume:?}"));
            }
            if *integration != Integration::default() {
                sums[own.index].text(&format!("{integration:?}"));
            }
            if let Some(glue) = &own.glue {
                sums[own.index].text(&format!("{glue:?}"));
            }
        }
        let hashes = sums[known..].iter().map(|sum| sum.0.0);
        world.resource_mut::<EditLog>().hashes.extend(hashes);
    }
    let mut all = Sum::default();
    all.text(S::NAME);
    world.resource::<EditLog>().hashes.iter().for_each(|&hash| all.add(hash));
    all.0.0
}

/// A hash over words.
#[derive(Default)]
struct Sum(Fnv64);

impl Sum {
    fn add(&mut self, word: u64) {
        self.0.add(word);
        self.0.fold(32);
    }

    fn numbers(&mut self, list: &[u32]) {
        self.add(list.len() as u64);
        list.iter().for_each(|&number| self.add(u64::from(number)));
    }

    fn text(&mut self, text: &str) {
        self.add(text.len() as u64);
        text.bytes().for_each(|byte| self.add(u64::from(byte)));
    }
}
