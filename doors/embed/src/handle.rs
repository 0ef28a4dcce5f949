//! Handles: numbers that stand for things of a simulation.

use bevy_ecs::entity::Entity;
use std::fmt;
use std::sync::atomic::{AtomicU32, Ordering};

/// A body, constraint, load, pressure, tool, pull, contact, thread or clip of a simulation. 0 is never one.
///
/// It holds the kind, a place in a table and a serial number that no other handle of the process has, so that one of
/// something that is gone or of another simulation is told.
pub type Handle = u64;

/// What a handle stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Kind {
    /// A body.
    Body = 1,
    /// A constraint.
    Constraint = 2,
    /// A load.
    Load = 3,
    /// A pressure.
    Pressure = 4,
    /// A tool.
    Tool = 5,
    /// A pull.
    Pull = 6,
    /// A contact between bodies.
    Contact = 7,
    /// A thread.
    Thread = 8,
    /// A clip.
    Clip = 9,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 9] = [
        Self::Body,
        Self::Constraint,
        Self::Load,
        Self::Pressure,
        Self::Tool,
        Self::Pull,
        Self::Contact,
        Self::Thread,
        Self::Clip,
    ];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Body => "body",
            Self::Constraint => "constraint",
            Self::Load => "load",
            Self::Pressure => "pressure",
            Self::Tool => "tool",
            Self::Pull => "pull",
            Self::Contact => "contact",
            Self::Thread => "thread",
            Self::Clip => "clip",
        }
    }

    /// Kind of a handle, if it has one.
    pub fn of(handle: Handle) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| *kind as u64 == handle >> 56)
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A handle that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum HandleError {
    /// A number that no door gave out.
    #[error("{handle} is no handle of a {wanted}; use what the call that added it returned")]
    None {
        /// The number.
        handle: Handle,
        /// What was wanted.
        wanted: Kind,
    },
    /// A number that no door gave out, where any kind would do.
    #[error("{0} is no handle; use what the call that added it returned")]
    Unknown(Handle),
    /// A handle of another kind.
    #[error("handle {handle} is that of a {found}, not of a {wanted}")]
    Kind {
        /// The handle.
        handle: Handle,
        /// What it stands for.
        found: Kind,
        /// What was wanted.
        wanted: Kind,
    },
    /// It was removed, or was made by another simulation.
    #[error("the {kind} of handle {handle} is gone, or belongs to another simulation")]
    Stale {
        /// The handle.
        handle: Handle,
        /// What it stood for.
        kind: Kind,
    },
}

/// What a handle leads to.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Target {
    /// Index of a body.
    Body(usize),
    /// An entity, and the index of its body if it has one.
    Entity(Entity),
    /// Index of a pull, thread or clip among those of the scene, which come and go.
    Scene(usize),
}

#[derive(Clone, Debug)]
struct Slot {
    kind: Kind,
    serial: u32,
    name: String,
    target: Target,
}

/// Handles of a simulation.
#[derive(Clone, Debug, Default)]
pub(crate) struct Handles {
    slots: Vec<Option<Slot>>,
    free: Vec<usize>,
}

/// Serial numbers given out by this process, from 1.
static SERIAL: AtomicU32 = AtomicU32::new(1);

fn handle(kind: Kind, index: usize, serial: u32) -> Handle {
    (kind as u64) << 56 | (index as u64 & 0xff_ffff) << 32 | u64::from(serial)
}

impl Handles {
    pub fn add(&mut self, kind: Kind, name: impl Into<String>, target: Target) -> Handle {
        let serial = SERIAL.fetch_add(1, Ordering::Relaxed);
        let slot = Some(Slot { kind, serial, name: name.into(), target });
        let index = match self.free.pop() {
            Some(index) => {
                self.slots[index] = slot;
                index
            }
            None => {
                self.slots.push(slot);
                self.slots.len() - 1
            }
        };
        handle(kind, index, serial)
    }

    fn slot(&self, handle: Handle, wanted: Kind) -> Result<(usize, &Slot), HandleError> {
        let Some(kind) = Kind::of(handle) else {
            return Err(HandleError::None { handle, wanted });
        };
        if kind != wanted {
            return Err(HandleError::Kind { handle, found: kind, wanted });
        }
        let (index, serial) = ((handle >> 32 & 0xff_ffff) as usize, handle as u32);
        match self.slots.get(index) {
            Some(Some(slot)) if slot.serial == serial && slot.kind == kind => Ok((index, slot)),
            _ => Err(HandleError::Stale { handle, kind }),
        }
    }

    pub fn get(&self, handle: Handle, wanted: Kind) -> Result<Target, HandleError> {
        self.slot(handle, wanted).map(|(_, slot)| slot.target)
    }

    /// Of whatever kind it is.
    pub fn any(&self, handle: Handle) -> Result<(Kind, &str, Target), HandleError> {
        let kind = Kind::of(handle).ok_or(HandleError::Unknown(handle))?;
        let (_, slot) = self.slot(handle, kind)?;
        Ok((slot.kind, &slot.name, slot.target))
    }

    pub fn remove(&mut self, handle: Handle) -> Result<(), HandleError> {
        let kind = Kind::of(handle).ok_or(HandleError::Unknown(handle))?;
        let (index, _) = self.slot(handle, kind)?;
        self.slots[index] = None;
        self.free.push(index);
        Ok(())
    }

    /// Takes away what stands for entities that are gone.
    pub fn retain(&mut self, is_there: impl Fn(Entity) -> bool) {
        for (index, slot) in self.slots.iter_mut().enumerate() {
            let gone = slot.as_ref().is_some_and(
                |slot| matches!(slot.target, Target::Entity(entity) if !is_there(entity)),
            );
            if gone {
                *slot = None;
                self.free.push(index);
            }
        }
    }

    /// All of a kind in the order in which they were made, with their names.
    pub fn list(&self, kind: Kind) -> Vec<(Handle, &str)> {
        let slots = self.slots.iter().enumerate();
        let mut own: Vec<(u32, usize, &str)> = slots
            .filter_map(|(i, slot)| slot.as_ref().map(|slot| (i, slot)))
            .filter(|(_, slot)| slot.kind == kind)
            .map(|(i, slot)| (slot.serial, i, slot.name.as_str()))
            .collect();
        own.sort_unstable();
        own.into_iter().map(|(serial, i, name)| (handle(kind, i, serial), name)).collect()
    }

    /// Whether one leads to an entity.
    pub fn lead_to(&self, entity: Entity) -> bool {
        let leads = |slot: &Slot| matches!(slot.target, Target::Entity(to) if to == entity);
        self.slots.iter().flatten().any(leads)
    }

    /// Leads every handle to what `to` makes of its target, and takes it away where that is nothing.
    pub fn redirect(&mut self, mut to: impl FnMut(Target) -> Option<Target>) {
        for (index, slot) in self.slots.iter_mut().enumerate() {
            let Some(own) = slot else { continue };
            match to(own.target) {
                Some(target) => own.target = target,
                None => {
                    *slot = None;
                    self.free.push(index);
                }
            }
        }
    }

    /// The handle of a body by its index.
    pub fn of_body(&self, body: usize) -> Option<Handle> {
        let found = |slot: &Slot| matches!(slot.target, Target::Body(index) if index == body);
        let index = self.slots.iter().position(|slot| slot.as_ref().is_some_and(found))?;
        self.slots[index].as_ref().map(|slot| handle(slot.kind, index, slot.serial))
    }
}
