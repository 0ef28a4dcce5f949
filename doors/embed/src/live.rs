//! The last two states for other threads, while a simulation runs.

use crate::embedding::Embedding;
use crate::error::{InputError, Result};
use crate::handle::{Handle, Kind};
use sinew::live::{StateReader, share};
use sinew::simulation::BodyHandle;

/// What is read of a shared body; the numbers never change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Shared {
    /// Positions (m), as [`Embedding::positions`].
    Positions = 0,
    /// Unit normals of the outside, weighted by area; 0 at vertices that are not on it.
    Normals = 1,
}

/// Has the last two states of some bodies and tools, each whole, on a thread of its own. Neither it nor the simulation waits for
/// the other. It outlives the simulation, and keeps what that gave last.
#[derive(Debug)]
pub struct Reader {
    own: StateReader,
    bodies: Vec<Handle>,
    tools: Vec<Handle>,
    numbers: Vec<[f64; 3]>,
}

fn place(kind: Kind, among: &[Handle], handle: Handle) -> Result<usize> {
    let problem = || format!("handle {handle} is none of what is shared here; share it, too");
    let found = among.iter().position(|own| *own == handle);
    Ok(found.ok_or_else(|| InputError::invalid(kind.name(), problem()))?)
}

fn number(time: f64) -> Result<f64> {
    let problem = "it is no number; give a time (s), or infinity for the last state";
    match time.is_nan() {
        true => Err(InputError::invalid("time", problem).into()),
        false => Ok(time),
    }
}

impl Reader {
    /// Takes the last state; false where there is no new one.
    pub fn update(&mut self) -> bool {
        self.own.update()
    }

    /// Steps done at the last state that was taken.
    pub fn step(&self) -> u64 {
        self.own.frames()[1].step
    }

    /// Simulated time (s) of the last state that was taken.
    pub fn time(&self) -> f64 {
        self.own.time()
    }

    /// Vectors of a shared body at a time (s) between the last two states that were taken, a vertex of its mesh each; from the time
    /// of the last state on those of it, to the bit.
    ///
    /// # Errors
    /// When the body is not shared here or the time is no number.
    pub fn body(&mut self, body: Handle, of: Shared, time: f64) -> Result<&[[f64; 3]]> {
        let (body, time) = (place(Kind::Body, &self.bodies, body)?, number(time)?);
        self.numbers.clear();
        match of {
            Shared::Positions => {
                let positions = self.own.each_position_at(body, time);
                self.numbers.extend(positions.map(|x| x.to_array()));
            }
            Shared::Normals => {
                let normals = self.own.each_normal_at(body, time);
                self.numbers.extend(normals.map(|x| x.to_array()));
            }
        }
        Ok(&self.numbers)
    }

    /// Force (N) on a shared tool and torque (N m) about its origin, likewise.
    ///
    /// # Errors
    /// When the tool is not shared here or the time is no number.
    pub fn tool(&self, tool: Handle, time: f64) -> Result<[[f64; 3]; 2]> {
        let (tool, time) = (place(Kind::Tool, &self.tools, tool)?, number(time)?);
        Ok(self.own.wrench_at(tool, time).map(|x| x.to_array()))
    }
}

impl Embedding {
    /// Shares bodies and tools with another thread: their state as it is, then that after every step, until the reader is dropped.
    /// Without bodies and tools all that there are now. A mesh that gets more vertices is shared as far as it goes now.
    ///
    /// # Errors
    /// When there is no such body or tool.
    pub fn share(&mut self, bodies: &[Handle], tools: &[Handle]) -> Result<Reader> {
        let all = |kind, own: &[Handle]| match bodies.is_empty() && tools.is_empty() {
            true => self.handles.list(kind).into_iter().map(|(handle, _)| handle).collect(),
            false => own.to_vec(),
        };
        let (bodies, tools) = (all(Kind::Body, bodies), all(Kind::Tool, tools));
        let index = |&body: &Handle| self.body(body);
        let indices = bodies.iter().map(index).collect::<Result<Vec<_>>>()?;
        let entity = |&tool: &Handle| self.touching(tool, Kind::Tool);
        let entities = tools.iter().map(entity).collect::<Result<Vec<_>>>()?;
        let handles: Vec<_> = indices.iter().map(|&index| BodyHandle(index)).collect();
        let simulation = &mut self.built.simulation;
        let (mut writer, mut own) = share(simulation, &handles, &entities);
        for (place, index) in indices.into_iter().enumerate() {
            writer.place_unused(place, &self.built.bodies[index].mesh.points);
        }
        writer.write(simulation);
        own.begin();
        self.writers.push(writer);
        Ok(Reader { own, bodies, tools, numbers: Vec::new() })
    }

    /// Gives the state to all readers that are still there.
    pub(crate) fn publish(&mut self) {
        self.writers.retain(|writer| writer.is_read());
        let simulation = &mut self.built.simulation;
        self.writers.iter_mut().for_each(|writer| writer.write(simulation));
    }
}
