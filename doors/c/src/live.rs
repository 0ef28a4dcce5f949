//! What other threads use while a simulation runs: haptic devices, and readers of the last states. Nothing here looks at the
//! simulation after it was made, so that a step never keeps it waiting.

use super::call::out as place;
use super::call::{
    fill, free, give, guarded, invalid, null, out_struct, read, sinew_simulation, slice, tell,
    text, three, vector, with,
};
use super::types::*;
use sinew_embed::{
    Code, DQuat, DeviceMotion, EmbedError, Feedback, HapticDevice, HapticOptions, Reader, Result,
    Shared, haptic_bits, or_default,
};
use std::sync::Mutex;

/// The end of a haptic handle at the device, for one thread beside that of the simulation. It stays good when the simulation is
/// freed: its force falls to zero then.
pub struct sinew_haptic_device(HapticDevice);

/// The last states of a simulation, for one thread beside that of the simulation. It stays good when the simulation is freed.
pub struct sinew_live(Mutex<Reader>);

/// Lets a haptic device hold vertices of a body from the next step on, where both are then: the place of the device at its first
/// exchange is where the vertices are when they are taken hold of. Every `sinew_step` serves it. `out` is a pull:
/// `sinew_pull_force` reads it. A tool in place of the body, with options of no vertices, is held itself from where
/// it is, and `out` is the tool, of which `sinew_tool_move` then sets the opening alone. `sinew_haptic_release` lets go of either. Free the device with `sinew_haptic_free`, before or after the simulation.
/// On a graphics processor it is `SINEW_BACKEND`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_haptic_add(
    simulation: *mut sinew_simulation,
    body: sinew_handle,
    options: *const sinew_haptic_options,
    out: *mut sinew_handle,
    device: *mut *mut sinew_haptic_device,
) -> sinew_status {
    with(simulation, |sim| {
        let o = read("options", options)?;
        let handle = place("out", out)?;
        place("device", device)?;
        *handle = 0;
        let or = sim.haptic_options(body, slice("vertices", o.vertices, o.vertex_count)?)?;
        let given = HapticOptions {
            name: text("name", o.name)?.into(),
            stiffness: or_default(o.stiffness, or.stiffness, false),
            damping: or_default(o.damping, or.damping, true),
            limit: or_default(o.limit, or.limit, false),
            stale: or_default(o.stale, or.stale, false),
            fade: or_default(o.fade, or.fade, true),
            device_mass: or_default(o.device_mass, or.device_mass, false),
            tolerance: or_default(o.tolerance, or.tolerance, false),
            turns: o.turns != 0,
            torque_limit: or_default(o.torque_limit, or.torque_limit, false),
            device_inertia: or_default(o.device_inertia, or.device_inertia, false),
            ..or
        };
        give(device, || {
            let (pull, own) = sim.add_haptic(given)?;
            *handle = pull;
            Ok(sinew_haptic_device(own))
        })
    })
}

/// Has a device let go of what it holds, by the handle that `sinew_haptic_add` gave: a pull is gone, a tool stays where it stands and moves
/// as it is told again. The force of the device falls to zero; free it all the same.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_haptic_release(
    simulation: *mut sinew_simulation,
    held: sinew_handle,
) -> sinew_status {
    with(simulation, |sim| sim.let_go(held))
}

/// Tells where the device is (m) and how fast it moves (m/s), three numbers each, and what it is to render until the next
/// exchange; `seconds` have passed since the last one. One that turns what it holds stays as it is turned. It never waits, takes no lock of the simulation and asks for no memory.
/// Numbers that are not finite are `SINEW_OK` with `SINEW_HAPTIC_BAD_INPUT` and no force. Two threads at once on one device:
/// `SINEW_BUSY` for the second.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_haptic_exchange(
    device: *const sinew_haptic_device,
    position: *const f64,
    velocity: *const f64,
    seconds: f64,
    feedback: *mut sinew_haptic_feedback,
) -> sinew_status {
    feeling(device, feedback, |own| {
        own.exchange(three("position", position)?, three("velocity", velocity)?, seconds)
    })
}

/// The same of a device that turns what it holds (`turns` of its options): also its orientation, a quaternion (x, y, z, w), and its
/// angular velocity (rad/s). At its first exchange nothing is turned. A quaternion that has not length 1 is bad input; NULL is no turn.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_haptic_exchange_pose(
    device: *const sinew_haptic_device,
    position: *const f64,
    quaternion: *const f64,
    velocity: *const f64,
    angular_velocity: *const f64,
    seconds: f64,
    feedback: *mut sinew_haptic_feedback,
) -> sinew_status {
    feeling(device, feedback, |own| {
        let motion = DeviceMotion {
            position: vector(three("position", position)?),
            velocity: vector(three("velocity", velocity)?),
            rotation: match quaternion.is_null() {
                true => DQuat::IDENTITY,
                false => DQuat::from_slice(slice("quaternion", quaternion, 4)?),
            },
            angular_velocity: vector(three("angular_velocity", angular_velocity)?),
        };
        own.exchange_pose(&motion, seconds)
    })
}

/// Runs an exchange with a device, and tells what is to be rendered.
unsafe fn feeling(
    device: *const sinew_haptic_device,
    feedback: *mut sinew_haptic_feedback,
    exchange: impl FnOnce(&HapticDevice) -> Result<Feedback>,
) -> sinew_status {
    guarded(|| {
        let device = device.as_ref().ok_or_else(|| null("device"))?;
        let to = out_struct("feedback", feedback)?;
        let felt = exchange(&device.0)?;
        *to = sinew_haptic_feedback {
            struct_size: to.struct_size,
            flags: haptic_bits(&felt.flags),
            force: felt.force.to_array(),
            age: felt.age,
            step: felt.step,
            time: felt.time,
            energy: felt.energy,
            dampings: felt.dampings,
            torque: felt.torque.to_array(),
        };
        Ok(())
    })
}

/// Frees a device that no call uses; NULL is fine. What it holds stays where it was until `sinew_haptic_release`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_haptic_free(device: *mut sinew_haptic_device) {
    free(device)
}

/// Shares bodies and tools with another thread: their state as it is, then that after every step and every way back. Without any
/// all that there are now. Free it with `sinew_live_free`, before or after the simulation; nothing is written any more then.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_live_share(
    simulation: *mut sinew_simulation,
    bodies: *const sinew_handle,
    body_count: usize,
    tools: *const sinew_handle,
    tool_count: usize,
    out: *mut *mut sinew_live,
) -> sinew_status {
    with(simulation, |sim| {
        let bodies = slice("bodies", bodies, body_count)?;
        let tools = slice("tools", tools, tool_count)?;
        give(out, || Ok(sinew_live(Mutex::new(sim.share(bodies, tools)?))))
    })
}

/// Runs a call on a reader, which waits for nobody.
unsafe fn reading(
    live: *const sinew_live,
    call: impl FnOnce(&mut Reader) -> Result<()>,
) -> sinew_status {
    guarded(|| {
        let live = live.as_ref().ok_or_else(|| null("live"))?;
        let busy = "another thread reads here at this moment; give each thread a reader";
        let own = live.0.try_lock();
        call(&mut *own.map_err(|_| EmbedError::new(Code::Busy, busy))?)
    })
}

/// Takes the last state, whole: whether (1 or 0) it is one that was not taken yet, the steps that were done and the simulated time
/// (s). Any may be NULL. It never waits.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_live_update(
    live: *mut sinew_live,
    is_new: *mut u32,
    step: *mut u64,
    seconds: *mut f64,
) -> sinew_status {
    reading(live, |own| {
        tell("is_new", is_new, own.update().into())?;
        tell("step", step, own.step())?;
        tell("seconds", seconds, own.time())
    })
}

/// Numbers of a shared body, three a vertex of its mesh (`SINEW_LIVE_POSITIONS`, `SINEW_LIVE_NORMALS`), or of a shared tool, six
/// (`SINEW_LIVE_WRENCH`), at a time (s) between the last two states that were taken; `INFINITY` for the last one, to the bit.
/// `needed` says how many there are; `data` may be NULL with capacity 0 to ask.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_live_read(
    live: *mut sinew_live,
    handle: sinew_handle,
    quantity: u32,
    seconds: f64,
    data: *mut f64,
    capacity: usize,
    needed: *mut usize,
) -> sinew_status {
    reading(live, |own| {
        let of = match quantity {
            SINEW_LIVE_POSITIONS => Shared::Positions,
            SINEW_LIVE_NORMALS => Shared::Normals,
            SINEW_LIVE_WRENCH => {
                let wrench = own.tool(handle, seconds)?;
                return fill(wrench.as_flattened(), data, capacity, needed);
            }
            other => return Err(invalid("quantity", format!("{other} is none"))),
        };
        fill(own.body(handle, of, seconds)?.as_flattened(), data, capacity, needed)
    })
}

/// Frees a reader that no call uses; NULL is fine.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_live_free(live: *mut sinew_live) {
    free(live)
}
