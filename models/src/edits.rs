//! What was done to bodies after they were spawned: removed elements, other materials, other moduli of axes. Columns follow
//! from the bodies and this list alone, so that it is what snapshots store of them.

use crate::axes::change::set_axis_modulus;
use crate::axes::muscle;
use crate::body::change::set_material;
use crate::body::{SoftBody, VolumeRule};
use crate::laws::pressure;
use crate::material::YoungPoisson;
use crate::material::field::MaterialArrays;
use crate::resection::{MassPolicy, Region, Resection, remove_batch, rows_again};
use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};
use sinew_engine::columns::TableImage;
use sinew_engine::connectivity::{ByKind, ElementKind};
use sinew_engine::fnv::Fnv64;
use sinew_engine::law::partition_laws;
use sinew_engine::layout::UNUSED;
use sinew_engine::row::LocalRow;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::{ElementTables, Topology};
use sinew_engine::vertex::{BodyId, RestPosition};
use std::sync::{Arc, OnceLock, Weak};

/// Something that was done to a body between steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
}

impl Edit {
    /// Whether doing this is all that is left of having done `earlier` just before.
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

    /// Does it again, to a body that had all that came before.
    ///
    /// # Errors
    /// When it cannot be done to this body, as text; nothing is changed then.
    pub fn apply<S: Scalar>(&self, world: &mut World) -> Result<(), String> {
        let bodies = world.resource::<Topology>().bodies.len();
        match self {
            Self::Removal { body, elements, mass } => {
                let region = |kind: ElementKind| {
                    let list = elements[kind].clone();
                    match kind {
                        ElementKind::Tetrahedron => Region::Tetrahedra(list),
                        ElementKind::Triangle => Region::Triangles(list),
                        ElementKind::Hexahedron => Region::Hexahedra(list),
                        ElementKind::Quad => Region::Quads(list),
                    }
                };
                let used = ElementKind::ALL.into_iter().filter(|&kind| !elements[kind].is_empty());
                let regions: Vec<Region> = used.map(region).collect();
                let results = remove_batch::<S>(world, *body, &regions, *mass);
                results.into_iter().try_for_each(|result| match result {
                    Ok(_) => Ok(()),
                    Err(error) => Err(error.to_string()),
                })
            }
            Self::Material { body, material, arrays } if *body < bodies => {
                set_material::<S>(world, *body, &arrays.field(*material)).map_err(|e| e.to_string())
            }
            Self::AxisModulus { body, family, modulus } => {
                set_axis_modulus::<S>(world, *body, family, *modulus).map_err(|e| e.to_string())
            }
            Self::Material { body, .. } => Err(format!("there is no body number {body}")),
        }
    }
}

/// All edits of a world, in their order.
#[derive(Resource, Clone, Debug, Default)]
pub struct EditLog {
    edits: Vec<Arc<Edit>>,
    /// Of every body as it was spawned.
    hashes: Vec<u64>,
    /// Where the tables go before they change, if somebody still wants them as they are.
    image: Weak<OnceLock<Option<EditImage>>>,
}

/// The edits of a world at one time, and how to get back to it.
#[derive(Clone, Debug)]
pub struct EditState {
    /// The edits so far.
    pub edits: Vec<Arc<Edit>>,
    image: Arc<OnceLock<Option<EditImage>>>,
}

/// Tables and lists as they were before an edit.
struct EditImage {
    /// World that it belongs to.
    world: bevy_ecs::world::WorldId,
    tables: TableImage,
    topology: Topology,
    resection: Option<Resection>,
    bodies: Vec<(Entity, SoftBody)>,
}

impl std::fmt::Debug for EditImage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "EditImage of {:?}", self.world)
    }
}

impl EditState {
    /// A state that was read from a file.
    pub fn new(edits: Vec<Edit>) -> Self {
        Self { edits: edits.into_iter().map(Arc::new).collect(), image: Arc::default() }
    }

    /// That of a world as it is now; all such states share one image, which is made when the next edit comes.
    pub fn of(world: &mut World) -> Self {
        let mut log = world.get_resource_or_init::<EditLog>();
        let image = log.image.upgrade().unwrap_or_else(|| {
            let image = Arc::default();
            log.image = Arc::downgrade(&image);
            image
        });
        Self { edits: log.edits.clone(), image }
    }

    /// Makes a world have had these edits and no others; whether anything was changed. Activations, displacements and
    /// the like are the caller's to put back.
    ///
    /// # Errors
    /// When the world has had others and does not know what it was before; nothing is changed then. When one cannot be
    /// done to its bodies; those before it are then done.
    pub fn restore<S: Scalar>(&self, world: &mut World) -> Result<bool, EditError> {
        let log = world.get_resource_or_init::<EditLog>();
        if log.edits == self.edits {
            return Ok(false);
        }
        let done = log.edits.len();
        let goes_on = self.edits.get(..done).is_some_and(|start| start == log.edits);
        // whoever wants the tables as they are now wants them after this, too
        before_edit::<S>(world);
        if let Some(image) = self.image.get().and_then(|image| image.as_ref())
            && image.world == world.id()
        {
            image.put_back::<S>(world);
            let mut log = world.resource_mut::<EditLog>();
            log.edits.clone_from(&self.edits);
            log.image = Arc::downgrade(&self.image);
        } else if goes_on {
            for edit in &self.edits[done..] {
                edit.apply::<S>(world).map_err(|reason| EditError::Refused { reason })?;
            }
        } else {
            return Err(EditError::Other);
        }
        Ok(true)
    }
}

/// Edits that a world cannot be brought to.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EditError {
    /// It has had others.
    #[error(
        "elements were removed from its bodies, or their materials changed, in other ways than here: restore \
         into a simulation that was built anew"
    )]
    Other,
    /// One of them cannot be done.
    #[error("an edit of a body cannot be done again: {reason}")]
    Refused {
        /// Why.
        reason: String,
    },
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
    let mut log = world.get_resource_or_init::<EditLog>();
    // who wants the tables as they are now has to say so again
    log.image = Weak::new();
    if log.edits.last().is_some_and(|last| edit.replaces(last)) {
        log.edits.pop();
    }
    log.edits.push(Arc::new(edit));
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
            bodies: bodies.iter(world).map(|(entity, body)| (entity, body.clone())).collect(),
        })
    }

    fn put_back<S: Scalar>(&self, world: &mut World) {
        self.tables.put_back(world);
        let mut now = world.resource_mut::<Topology>();
        let mut topology = self.topology.clone();
        // who compares these numbers must not take what comes for what was
        if now.revision != topology.revision {
            topology.revision = now.revision + 1;
        }
        for (body, now) in topology.bodies.iter_mut().zip(&now.bodies) {
            body.changes = now.changes + 1;
            if body.splits != now.splits {
                body.splits = now.splits + 1;
            }
        }
        *now = topology;
        for (entity, body) in &self.bodies {
            if let Ok(mut entity) = world.get_entity_mut(*entity) {
                entity.insert(body.clone());
            }
        }
        partition_laws::<S>(world);
        let tables = ElementTables::of(world);
        world.insert_resource(tables);
        world.remove_resource::<Resection>();
        if let Some(resection) = &self.resection {
            rows_again(world, resection.clone());
        }
        pressure::refresh::<S>(world);
        muscle::apply_all::<S>(world);
    }
}

/// A number that two worlds share if their bodies were spawned alike, whatever was done to them since.
pub fn scene_hash<S: Scalar>(world: &mut World) -> u64 {
    let known = world.get_resource_or_init::<EditLog>().hashes.len();
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
            for kind in ElementKind::ALL {
                sum.numbers(body.order(kind));
            }
            sum.numbers(body.tetrahedra.as_flattened());
            if !body.tetrahedra10.is_empty() {
                sum.numbers(body.tetrahedra10.as_flattened());
            }
            sum.numbers(body.hexahedra.as_flattened());
            sum.numbers(body.membrane.as_flattened());
            sum.numbers(body.quads.as_flattened());
            sums.push(sum);
        }
        for (id, x) in rest.iter(world) {
            x.0.to_array().iter().for_each(|x| sums[id.0 as usize].add(x.to_bits()));
        }
        for own in soft.iter(world) {
            let SoftBody { material, arrays, model, evaluation, spring_rule, .. } = own;
            let SoftBody { given, masses, membrane, axes, volume, .. } = own;
            let law = own.law.map(|law| law.info.name);
            // none of these holds anything but names and numbers
            let what = (material, arrays, model, law, evaluation, spring_rule);
            sums[own.index].text(&format!("{what:?} {:?}", (given, masses, membrane, axes)));
            if *volume != VolumeRule::default() {
                sums[own.index].text(&format!("{volume:?}"));
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
