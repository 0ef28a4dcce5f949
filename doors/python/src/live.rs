//! What other threads use while a simulation runs: haptic devices, and readers of the last states. Neither ever waits for a step.

use crate::engine::rows3;
use crate::error::raise;
use crate::input::Vec3;
use numpy::PyArray2;
use pyo3::prelude::*;
use sinew_embed::{DQuat, DeviceMotion, Feedback, Handle, InputError, Shared};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What a haptic device is to render until the next exchange.
#[pyclass(frozen, get_all, module = "sinew._native")]
pub struct HapticFeedback {
    /// Force (N) on the hand.
    force: (f64, f64, f64),
    /// Torque (N m) on it about where the device is; zero where it does not turn what it holds.
    torque: (f64, f64, f64),
    /// Time (s) since the model of the last step arrived.
    age: f64,
    /// Steps that had been taken when that model was made.
    step: u64,
    /// Simulated time (s) at the end of that step.
    time: f64,
    /// Energy (J) that the hand has given so far; below zero it has got some.
    energy: f64,
    /// Exchanges in which damping was added so far.
    dampings: u64,
    /// No step has answered yet: no force.
    waiting: bool,
    /// The last step is too old: the force falls, or is zero.
    stale: bool,
    /// Force or torque was cut to its limit.
    limited: bool,
    /// The force rises no faster than 50 N/s, a torque by as much of its limit: first contact, or the simulation answers again.
    rising: bool,
    /// The device has got more energy than it gave; damping was added.
    damped: bool,
    /// A number was not finite, a rotation not of length 1, or time ran backwards: no force.
    bad_input: bool,
    /// Nothing supports the body: the model is that of one step from rest, not of rest.
    with_inertia: bool,
    /// The tangent was indefinite; the model is that of the projected one.
    projected: bool,
    /// The model was not found in this step; that of an earlier one counts, or none.
    unsolved: bool,
    /// The step itself did not converge.
    unconverged: bool,
}

impl From<Feedback> for HapticFeedback {
    fn from(felt: Feedback) -> Self {
        let Feedback { force, torque, age, step, time, energy, dampings, flags } = felt;
        Self {
            force: force.into(),
            torque: torque.into(),
            age,
            step,
            time,
            energy,
            dampings,
            waiting: flags.waiting,
            stale: flags.stale,
            limited: flags.limited,
            rising: flags.rising,
            damped: flags.damped,
            bad_input: flags.bad_input,
            with_inertia: flags.with_inertia,
            projected: flags.projected,
            unsolved: flags.unsolved,
            unconverged: flags.unconverged,
        }
    }
}

#[pymethods]
impl HapticFeedback {
    fn __repr__(&self) -> String {
        let Self { force: (x, y, z), age, step, .. } = self;
        format!("<sinew.HapticFeedback ({x:.4}, {y:.4}, {z:.4}) N, step {step}, {age:.4} s old>")
    }
}

/// The end of a haptic handle at the device.
#[pyclass(frozen, module = "sinew._native")]
pub struct HapticDevice(pub sinew_embed::HapticDevice);

#[pymethods]
impl HapticDevice {
    /// Tells where the device is (m), how fast it moves (m/s) and how many seconds have passed since the last call; what it is to
    /// render until the next one. Of one that turns what it holds also its orientation (x, y, z, w) and angular velocity (rad/s).
    #[pyo3(signature = (position, velocity, seconds, rotation=None, angular_velocity=None))]
    fn exchange(
        &self,
        position: Vec3,
        velocity: Vec3,
        seconds: f64,
        rotation: Option<[f64; 4]>,
        angular_velocity: Option<Vec3>,
    ) -> PyResult<HapticFeedback> {
        let felt = match (rotation, angular_velocity) {
            (None, None) => self.0.exchange(position, velocity, seconds),
            (None, Some(_)) => Err(InputError::Invalid {
                what: "angular_velocity".into(),
                problem: "give `rotation`, too".into(),
            }
            .into()),
            (Some(rotation), spin) => {
                let motion = DeviceMotion {
                    position: position.into(),
                    velocity: velocity.into(),
                    rotation: DQuat::from_array(rotation),
                    angular_velocity: spin.unwrap_or_default().into(),
                };
                self.0.exchange_pose(&motion, seconds)
            }
        };
        felt.map(HapticFeedback::from).map_err(raise)
    }
}

/// The last two states of shared bodies and tools.
#[pyclass(frozen, module = "sinew._native")]
pub struct Reader(pub Mutex<sinew_embed::Reader>);

impl Reader {
    /// It is held for a copy at most, and with the lock of the interpreter.
    fn own(&self) -> MutexGuard<'_, sinew_embed::Reader> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Reader {
    /// Takes the last state; false where there is no new one.
    fn update(&self) -> bool {
        self.own().update()
    }

    /// Steps done and simulated time (s) of the last state that was taken.
    fn clock(&self) -> (u64, f64) {
        let own = self.own();
        (own.step(), own.time())
    }

    /// Positions (m) or normals of a body at a time (s), (n, 3).
    fn body<'py>(
        &self,
        py: Python<'py>,
        body: Handle,
        normals: bool,
        time: f64,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let of = if normals { Shared::Normals } else { Shared::Positions };
        let numbers = self.own().body(body, of, time).map(|own| own.as_flattened().to_vec());
        rows3(py, numbers.map_err(raise)?)
    }

    /// Force (N) and torque (N m) on a tool at a time (s).
    fn tool(&self, tool: Handle, time: f64) -> PyResult<[Vec3; 2]> {
        self.own().tool(tool, time).map_err(raise)
    }
}
