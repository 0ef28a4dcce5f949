//! Simulations: making, freeing, stepping, settings.

use super::call::{
    fill, free, give, guarded, invalid, out, read, sinew_simulation, slice, slice_mut, text, three,
    with,
};
use super::types::*;
use sinew_embed::{
    Backend, EmbedError, Embedding, Folder, Handle, Kind, Options, Overrides, Precision, Result,
    choice, solver_settings, version,
};
use std::collections::HashMap;
use std::ffi::c_char;
use std::sync::{LazyLock, Mutex};

/// `SINEW_ABI` of the library.
#[unsafe(no_mangle)]
pub extern "C" fn sinew_abi_version() -> u32 {
    SINEW_ABI
}

static VERSION: LazyLock<std::ffi::CString> =
    LazyLock::new(|| std::ffi::CString::new(version()).unwrap_or_default());

/// Version of the library, such as "0.1.0".
#[unsafe(no_mangle)]
pub extern "C" fn sinew_version() -> *const c_char {
    VERSION.as_ptr()
}

/// Gives a new simulation to the caller.
unsafe fn begin(
    place: *mut *mut sinew_simulation,
    make: impl FnOnce() -> Result<Embedding>,
) -> sinew_status {
    guarded(|| give(place, || Ok(sinew_simulation(Mutex::new(make()?)))))
}

/// Makes a simulation without bodies.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_simulation_new(
    options: *const sinew_options,
    out: *mut *mut sinew_simulation,
) -> sinew_status {
    let make = || {
        let o = read("options", options)?;
        let one_of = |what: &str, given: u32| {
            let problem = || invalid(what, format!("{given} is none of its values, 0 and 1"));
            (given < 2).then_some(given == 1).ok_or_else(problem)
        };
        Embedding::new(&Options {
            precision: if one_of("precision", o.precision)? {
                Precision::F32
            } else {
                Precision::F64
            },
            backend: if one_of("backend", o.backend)? { Backend::Gpu } else { Backend::Cpu },
            threads: o.threads as usize,
            dt: o.dt,
            gravity: o.gravity,
            ..Options::default()
        })
    };
    begin(out, make)
}

fn overrides(threads: u32) -> Overrides {
    let threads = (threads > 0).then_some(threads as usize);
    Overrides { threads, ..Overrides::default() }
}

/// Makes the simulation of a scene file. With `threads` above 0 the scene's own number does not count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_simulation_from_scene(
    path: *const c_char,
    threads: u32,
    out: *mut *mut sinew_simulation,
) -> sinew_status {
    let make = || Embedding::from_scene_file(text("path", path)?, &overrides(threads));
    begin(out, make)
}

/// Makes the simulation of a scene in memory; `name` stands for its file in messages. Files that it names are looked for
/// among `files`, or in the current folder when there are none.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_simulation_from_text(
    toml: *const c_char,
    name: *const c_char,
    files: *const sinew_file,
    file_count: usize,
    threads: u32,
    out: *mut *mut sinew_simulation,
) -> sinew_status {
    let make = || {
        let (toml, name) = (text("toml", toml)?, text("name", name)?);
        let files = slice("files", files, file_count)?;
        if files.is_empty() {
            return Embedding::from_scene(toml, name, Folder(".".into()), &overrides(threads));
        }
        let mut known = HashMap::new();
        for file in files {
            let name = text("name of a file", file.name)?;
            let bytes = slice("bytes of a file", file.bytes, file.size)?;
            known.insert(name.to_string(), bytes.to_vec());
        }
        Embedding::from_scene(toml, name, known, &overrides(threads))
    };
    begin(out, make)
}

/// Frees a simulation that no call uses; NULL is fine.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_simulation_free(simulation: *mut sinew_simulation) {
    free(simulation)
}

/// Carries out `n` steps, up to the first that fails: `SINEW_STEP`, and the state is that before it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_step(simulation: *mut sinew_simulation, n: u32) -> sinew_status {
    with(simulation, |sim| sim.step(n))
}

/// Simulated time (s).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_time(
    simulation: *const sinew_simulation,
    seconds: *mut f64,
) -> sinew_status {
    with(simulation, |sim| {
        *out("seconds", seconds)? = sim.time();
        Ok(())
    })
}

/// Sets the length (s) of the steps to come.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_set_dt(simulation: *mut sinew_simulation, dt: f64) -> sinew_status {
    with(simulation, |sim| sim.set_dt(dt))
}

/// Sets gravity (m/s^2), three numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_set_gravity(
    simulation: *mut sinew_simulation,
    gravity: *const f64,
) -> sinew_status {
    with(simulation, |sim| sim.set_gravity(three("gravity", gravity)?))
}

/// Sets the solver: lines as below `[solver]` of a scene, such as "integrator = 'safe'", or JSON. What is left out has its
/// default.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_set_solver(
    simulation: *mut sinew_simulation,
    settings: *const c_char,
) -> sinew_status {
    with(simulation, |sim| sim.set_solver(solver_settings(text("settings", settings)?)?))
}

/// The thing of a kind (`SINEW_BODY` and so on) that has a name.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_find(
    simulation: *const sinew_simulation,
    kind: u32,
    name: *const c_char,
    handle: *mut sinew_handle,
) -> sinew_status {
    with(simulation, |sim| {
        let known = Kind::ALL.into_iter().find(|own| *own as u32 == kind);
        let kind = known.ok_or_else(|| invalid("kind", format!("{kind} is none")))?;
        *out("handle", handle)? = sim.find(kind, text("name", name)?)?;
        Ok(())
    })
}

/// Takes a body, constraint, load, pressure, tool, pull or contact away. With a body goes what acts on nothing else.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sinew_remove(
    simulation: *mut sinew_simulation,
    handle: sinew_handle,
) -> sinew_status {
    with(simulation, |sim| sim.remove(handle))
}

/// A word of scene files, or the default for NULL.
pub(super) unsafe fn word<T: Default + sinew_embed::DeserializeOwned>(
    kind: &'static str,
    name: *const c_char,
) -> Result<T> {
    let name = super::call::optional_text(kind, name)?;
    name.map_or_else(|| Ok(T::default()), |name| choice(kind, name))
}

/// Runs a call that gives a handle.
pub(super) unsafe fn add(
    simulation: *const sinew_simulation,
    place: *mut sinew_handle,
    call: impl FnOnce(&mut Embedding) -> Result<Handle>,
) -> sinew_status {
    with(simulation, |sim| {
        let place = out("out", place)?;
        *place = 0;
        *place = call(sim)?;
        Ok(())
    })
}

/// For tests, and in no header: panics in a call, on a thread of the pool if `pool` is not 0.
#[unsafe(no_mangle)]
#[doc(hidden)]
pub unsafe extern "C" fn sinew_test_panic(
    simulation: *mut sinew_simulation,
    pool: u32,
) -> sinew_status {
    with(simulation, |sim| {
        if pool != 0 {
            sim.on_pool(|| panic!("a panic on a thread of the pool"));
        }
        panic!("a panic in a call");
    })
}

/// Text for a buffer of the caller, with its zero byte.
pub(super) unsafe fn fill_text(
    value: String,
    data: *mut c_char,
    capacity: usize,
    needed: *mut usize,
) -> Result<()> {
    let mut bytes = value.into_bytes();
    bytes.push(0);
    let chars: Vec<c_char> = bytes.into_iter().map(|byte| byte as c_char).collect();
    fill(&chars, data, capacity, needed)
}

/// For positions straight into memory: the bytes that a stride and a count span.
pub(super) unsafe fn strided<'a>(
    data: *mut f32,
    count: usize,
    stride: usize,
) -> Result<&'a mut [u8]> {
    let problem = || -> EmbedError { invalid("stride_bytes", format!("{stride} is too much")) };
    let before = stride.checked_mul(count.saturating_sub(1)).ok_or_else(problem)?;
    let bytes = before.checked_add(12).ok_or_else(problem)?;
    slice_mut("xyz", data.cast::<u8>(), if count == 0 { 0 } else { bytes })
}
