//! Edits of bodies ([`Edit`]) done again and taken back. Columns follow from the bodies and the list of edits alone, so
//! that it is what snapshots store of them.

use bevy_ecs::prelude::*;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::law::partition_laws;
use sinew_engine::resource::{ensure, put};
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::{ElementTables, Topology};
use sinew_engine::vertex::RecentCuts;
use std::sync::{Arc, OnceLock};

use crate::axes::muscle;
use crate::body::axis_modulus::set_axis_modulus;
use crate::body::change::set_material;
use crate::body::edit_log::{Edit, EditImage, EditLog, before_edit};
use crate::body::present::{Resection, rows_again};
use crate::cutting::{glue, open_again};
use crate::laws::{bending, pressure};
use crate::resection::{Region, remove_batch};

impl Edit {
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
            Self::Cut { body, stroke } => {
                open_again::<S>(world, *body, stroke).map_err(|e| e.to_string())
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

/// The edits of a world at one time, and how to get back to it.
#[derive(Clone, Debug)]
pub struct EditState {
    /// The edits so far.
    pub edits: Vec<Arc<Edit>>,
    image: Arc<OnceLock<Option<EditImage>>>,
}

impl EditState {
    /// A state that was read from a file.
    pub fn new(edits: Vec<Edit>) -> Self {
        Self { edits: edits.into_iter().map(Arc::new).collect(), image: Arc::default() }
    }

    /// That of a world as it is now; all such states share one image, which is made when the next edit comes.
    pub fn of(world: &mut World) -> Self {
        let mut log = ensure::<EditLog>(world);
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
        let log = ensure::<EditLog>(world);
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
        "its bodies were cut, lost elements or got other materials in other ways than here: restore \
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

impl EditImage {
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
        put(world, self.points.clone());
        partition_laws::<S>(world);
        let tables = ElementTables::of(world);
        world.insert_resource(tables);
        put(world, Resection::default());
        RecentCuts::<S>::take(world);
        if let Some(resection) = &self.resection {
            rows_again(world, resection.clone());
        }
        bending::refresh::<S>(world, None);
        pressure::refresh::<S>(world, None);
        glue::refresh::<S>(world, None);
        muscle::apply_all::<S>(world);
    }
}
