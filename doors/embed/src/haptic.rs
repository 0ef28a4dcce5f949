//! Haptic devices: a handle beside the simulation, a device for a thread of its own.

use crate::embedding::Embedding;
use crate::error::{Code, EmbedError, InputError, Result};
use crate::handle::{Handle, Kind, Target};
use glam::DVec3;
use sinew::haptics::{
    DeviceMotion, Feedback, HapticError, HapticFlags, HapticOptions, HapticTissue,
};
use sinew::simulation::{BodyHandle, Simulation};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The end of a handle at the device. It knows nothing of the simulation but what that gives away after every step, and is as
/// good as before when that is gone: the force falls to zero, as if no step were taken any more.
#[derive(Debug)]
pub struct HapticDevice(Mutex<sinew::haptics::HapticDevice>);

impl HapticDevice {
    /// Tells where the device is (m) and how fast it moves (m/s), and what it is to render for the next `seconds`: see
    /// [`sinew::haptics::HapticDevice::exchange`]. It neither waits nor asks for memory, whatever the simulation does.
    ///
    /// # Errors
    /// [`Code::Busy`] when another thread makes an exchange with the same device at this moment: a device belongs to one
    /// thread. Numbers that are not finite are no error, but `bad_input`.
    pub fn exchange(
        &self,
        position: [f64; 3],
        velocity: [f64; 3],
        seconds: f64,
    ) -> Result<Feedback> {
        let [x, v] = [position, velocity].map(DVec3::from_array);
        Ok(self.own()?.exchange(x, v, seconds))
    }

    /// The same of a device that [turns](HapticOptions::turns) what it holds: see [`sinew::haptics::HapticDevice::exchange_pose`].
    ///
    /// # Errors
    /// As those of [`exchange`](Self::exchange).
    pub fn exchange_pose(&self, motion: &DeviceMotion, seconds: f64) -> Result<Feedback> {
        Ok(self.own()?.exchange_pose(motion, seconds))
    }

    fn own(&self) -> Result<MutexGuard<'_, sinew::haptics::HapticDevice>> {
        let text = "another thread uses this haptic device at this moment; use it from one";
        self.0.try_lock().map_err(|_| EmbedError::new(Code::Busy, text))
    }
}

/// Flags as bits, by the order of [`HapticFlags`] from 1.
pub fn haptic_bits(flags: &HapticFlags) -> u32 {
    let HapticFlags { waiting, stale, limited, rising, damped, bad_input, .. } = *flags;
    let HapticFlags { with_inertia, projected, unsolved, unconverged, .. } = *flags;
    let force = [waiting, stale, limited, rising, damped, bad_input];
    let model = [with_inertia, projected, unsolved, unconverged];
    let all = force.into_iter().chain(model);
    all.enumerate().map(|(i, on)| u32::from(on) << i).sum()
}

/// When a step serves a haptic device.
#[derive(Clone, Copy)]
pub(crate) enum Moment {
    /// Before it, hands move.
    Before,
    /// After it, models are found.
    After,
}

/// What serves a haptic device. Only [`Embedding::add_haptic`] names the type, so that what offers no devices, such as the page, does
/// without the code.
pub(crate) trait Serve: Send {
    fn serve(
        &mut self,
        simulation: &mut Simulation,
        moment: Moment,
    ) -> std::result::Result<(), HapticError>;
    fn let_go(self: Box<Self>, simulation: &mut Simulation);
}

impl Serve for HapticTissue {
    fn serve(
        &mut self,
        simulation: &mut Simulation,
        moment: Moment,
    ) -> std::result::Result<(), HapticError> {
        match moment {
            Moment::Before => self.before_step(simulation),
            Moment::After => self.after_step(simulation).map(drop),
        }
    }

    fn let_go(self: Box<Self>, simulation: &mut Simulation) {
        self.release(simulation);
    }
}

impl Embedding {
    /// Serves haptic devices at one moment of a step. One whose pull is not there now is passed over: going back may bring it again.
    pub(crate) fn serve_haptics(&mut self, moment: Moment) -> Result<()> {
        for (_, served) in &mut self.haptics {
            match served.serve(&mut self.built.simulation, moment) {
                Ok(()) | Err(HapticError::Released(_)) => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// What a device holds by default: vertices of a body, or a tool and then no vertices.
    ///
    /// # Errors
    /// When there is no such body or tool.
    pub fn haptic_options(&self, held: Handle, vertices: &[u32]) -> Result<HapticOptions> {
        let vertices = vertices.to_vec();
        if Kind::of(held) == Some(Kind::Tool) {
            let tool = self.touching(held, Kind::Tool)?;
            return Ok(HapticOptions { vertices, ..HapticOptions::of_tool(tool) });
        }
        Ok(HapticOptions::new(BodyHandle(self.body(held)?), vertices))
    }

    /// Lets a haptic device hold a patch of a body, or a tool, from the next step on: see [`Simulation::haptic_handle`]. Every
    /// [`Embedding::step`] then serves the device. The handle is that of a [`Kind::Pull`], by which the device holds, or the tool's;
    /// [`Embedding::let_go`] ends it. Handles are no part of snapshots, but for their pull or tool.
    ///
    /// # Errors
    /// When the name is taken, an option, vertex or tool cannot be used, a device holds the tool already, or the backend has no pulls;
    /// nothing is added then.
    pub fn add_haptic(&mut self, options: HapticOptions) -> Result<(Handle, HapticDevice)> {
        let tool = options.tool.map(|tool| self.built.simulation.current(tool));
        let (name, options) = (options.name.clone(), HapticOptions { tool, ..options });
        let is_tool = |own: &Handle| self.touching(*own, Kind::Tool).ok() == tool;
        let tools = self.handles.list(Kind::Tool).into_iter().map(|(own, _)| own);
        let held = tool.and_then(|_| tools.into_iter().find(is_tool));
        match held {
            Some(tool) if self.haptics.iter().any(|(own, _)| *own == tool) => {
                let problem = "a device holds it already; let go of it, or add another tool";
                let name = self.name(tool)?;
                return Err(InputError::invalid(format!("tool `{name}`"), problem).into());
            }
            Some(_) => {}
            None if tool.is_some() => {
                let problem = "there is no such tool any more; make the options anew";
                return Err(InputError::invalid(format!("haptic handle `{name}`"), problem).into());
            }
            None => self.name_is_free(Kind::Pull, &name)?,
        }
        let (tissue, device) = self.built.simulation.haptic_handle(options)?;
        let add = || self.handles.add(Kind::Pull, name, Target::Entity(tissue.held()));
        let handle = held.unwrap_or_else(add);
        self.haptics.push((handle, Box::new(tissue)));
        let device = HapticDevice(Mutex::new(device));
        // where a lock is made at its first use, that is here
        drop(device.0.lock().unwrap_or_else(PoisonError::into_inner));
        Ok((handle, device))
    }

    /// Has a device let go of what it holds: its pull is gone, as by [`Embedding::remove`], and a tool stays where it stands and moves as
    /// it is told again. The force of the device falls as if the simulation had stopped. A tool on a spring that no device holds, as after
    /// going back to when one did, comes off it.
    ///
    /// # Errors
    /// When nobody holds by this handle.
    pub fn let_go(&mut self, held: Handle) -> Result<()> {
        let served = self.haptics.iter().position(|(own, _)| *own == held);
        let served = served.map(|at| self.haptics.remove(at).1);
        let is_pull = Kind::of(held) == Some(Kind::Pull);
        match served {
            // it may have gone with its body
            Some(_) if is_pull && self.handles.any(held).is_err() => {}
            Some(_) if is_pull => return self.remove(held),
            Some(served) => served.let_go(&mut self.built.simulation),
            None => {
                let tool = self.touching(held, Kind::Tool).ok();
                if !tool
                    .is_some_and(|tool| HapticTissue::take_off(&mut self.built.simulation, tool))
                {
                    let text = format!(
                        "nobody holds by handle {held:#x}: take that of a device's pull or tool"
                    );
                    return Err(EmbedError::new(Code::Handle, text));
                }
            }
        }
        self.epoch += 1;
        Ok(())
    }
}

/// An option of a skin in which 0 stands for the default and, where that makes sense, less than 0 for none.
pub fn or_default(given: f64, default: f64, may_be_none: bool) -> f64 {
    match given {
        0.0 => default,
        _ if may_be_none && given < 0.0 => 0.0,
        _ => given,
    }
}

impl From<HapticError> for EmbedError {
    fn from(error: HapticError) -> Self {
        let text = error.to_string();
        match error {
            HapticError::Simulation(error) => error.into(),
            HapticError::Step(error) => error.into(),
            HapticError::Invalid { name, problem } => {
                InputError::invalid(format!("haptic handle `{name}`"), problem).into()
            }
            HapticError::Gpu(_) => Self::new(Code::Backend, text),
            _ => Self::new(Code::Handle, text),
        }
    }
}
