//! What every call does: locks the simulation, catches panics, keeps the error text; and pointers of the caller made safe.
#![deny(unsafe_op_in_unsafe_fn)]

use super::reports::*;
use super::types::*;
use sinew_embed::{Code, DQuat, DVec3, EmbedError, Embedding, InputError, Result};
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, TryLockError};

/// A simulation. One thread at a time may use it; a second call while one runs answers `SINEW_BUSY`.
pub struct sinew_simulation(pub(super) Mutex<Embedding>);

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Text of the last call of this thread that failed, in UTF-8; empty before the first. It stays until the next call of this
/// thread that fails.
#[unsafe(no_mangle)]
pub extern "C" fn sinew_last_error() -> *const c_char {
    LAST.with(|last| last.borrow().as_ptr())
}

fn keep(error: EmbedError) -> sinew_status {
    let text = CString::new(error.text.replace('\0', " ")).unwrap_or_default();
    LAST.with(|last| *last.borrow_mut() = text);
    error.code as sinew_status
}

/// What a panic said.
fn said(payload: &(dyn std::any::Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(|text| (*text).to_string());
    text.or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "a panic without text".into())
}

/// Runs a call that needs no simulation.
pub(super) fn guarded(call: impl FnOnce() -> Result<()>) -> sinew_status {
    match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(())) => SINEW_OK,
        Ok(Err(error)) => keep(error),
        Err(payload) => keep(EmbedError::new(Code::Panic, said(&*payload))),
    }
}

/// Runs a call on a simulation.
///
/// # Safety
/// `simulation` is NULL or came from this library and was not freed.
pub(super) unsafe fn with(
    simulation: *const sinew_simulation,
    call: impl FnOnce(&mut Embedding) -> Result<()>,
) -> sinew_status {
    // SAFETY: the caller's promise; shared access is enough, the lock gives the rest
    let Some(simulation) = (unsafe { simulation.as_ref() }) else {
        return guarded(|| Err(null("simulation")));
    };
    let mut own = match simulation.0.try_lock() {
        Ok(own) => own,
        Err(TryLockError::WouldBlock) => {
            let text = "another call uses the simulation at this moment; wait for it";
            return keep(EmbedError::new(Code::Busy, text));
        }
        // after a panic nothing but `check` is called
        Err(TryLockError::Poisoned(own)) => own.into_inner(),
    };
    match catch_unwind(AssertUnwindSafe(|| own.check().and_then(|()| call(&mut own)))) {
        Ok(Ok(())) => SINEW_OK,
        Ok(Err(error)) => keep(error),
        Err(payload) => {
            let text = said(&*payload);
            own.poison(text.clone());
            keep(EmbedError::new(Code::Panic, text))
        }
    }
}

pub(super) fn null(what: &str) -> EmbedError {
    invalid(what, "it is NULL")
}

pub(super) fn invalid(what: &str, problem: impl Into<String>) -> EmbedError {
    InputError::Invalid { what: what.into(), problem: problem.into() }.into()
}

/// So many values of the caller; NULL is allowed for none.
///
/// # Safety
/// `data` is NULL or points to so many values, which stay as they are for `'a`.
pub(super) unsafe fn slice<'a, T>(what: &str, data: *const T, count: usize) -> Result<&'a [T]> {
    match usable(what, data, count)? {
        false => Ok(&[]),
        // SAFETY: the caller's promise; not NULL, aligned, of a size that can be
        true => Ok(unsafe { std::slice::from_raw_parts(data, count) }),
    }
}

/// Memory of the caller to write so many values into.
///
/// # Safety
/// `data` is NULL or points to so many values that nothing else uses for `'a`.
pub(super) unsafe fn slice_mut<'a, T>(
    what: &str,
    data: *mut T,
    count: usize,
) -> Result<&'a mut [T]> {
    match usable(what, data, count)? {
        false => Ok(&mut []),
        // SAFETY: the caller's promise; not NULL, aligned, of a size that can be
        true => Ok(unsafe { std::slice::from_raw_parts_mut(data, count) }),
    }
}

/// Whether there is anything at a pointer to `count` values.
fn usable<T>(what: &str, data: *const T, count: usize) -> Result<bool> {
    if count == 0 {
        return Ok(false);
    }
    if data.is_null() {
        return Err(null(what));
    }
    if !data.is_aligned() {
        return Err(invalid(what, "its address is not that of such a number"));
    }
    if count.checked_mul(size_of::<T>()).is_none_or(|bytes| bytes > isize::MAX as usize) {
        return Err(invalid(what, format!("{count} entries are more than memory holds")));
    }
    Ok(true)
}

/// A product of sizes.
pub(super) fn times(what: &str, count: usize, each: usize) -> Result<usize> {
    let product = count.checked_mul(each);
    product.ok_or_else(|| invalid(what, format!("{count} entries are more than memory holds")))
}

/// A text of the caller.
///
/// # Safety
/// `data` is NULL or points to a text that ends with a zero byte and stays as it is for `'a`.
pub(super) unsafe fn text<'a>(what: &str, data: *const c_char) -> Result<&'a str> {
    // SAFETY: the caller's promise
    unsafe { optional_text(what, data) }?.ok_or_else(|| null(what))
}

/// A text of the caller that may be absent.
///
/// # Safety
/// As [`text`].
pub(super) unsafe fn optional_text<'a>(what: &str, data: *const c_char) -> Result<Option<&'a str>> {
    if data.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller's promise; not NULL
    let text = unsafe { CStr::from_ptr(data) };
    text.to_str().map(Some).map_err(|_| invalid(what, "it is not UTF-8"))
}

/// Structures that begin with their size.
///
/// # Safety
/// The first member is `struct_size: u32`, all bits are valid values.
pub(super) unsafe trait Sized32: Copy {}

macro_rules! sized {
    ($($name:ident)*) => {$(
        // SAFETY: `struct_size` is the first member; numbers and pointers only
        unsafe impl Sized32 for $name {}
    )*};
}

sized! {
    sinew_options sinew_mesh_arrays sinew_material sinew_membrane sinew_muscle sinew_fibre sinew_body sinew_constraint
    sinew_part sinew_tool sinew_tool_report sinew_pull sinew_pick_result sinew_region sinew_cut_report
    sinew_haptic_options sinew_haptic_feedback
}

/// A structure of the caller, after a look at its size.
///
/// # Safety
/// `data` is NULL or points to a structure of this type, or of an earlier one whose `struct_size` says so.
pub(super) unsafe fn read<T: Sized32>(what: &str, data: *const T) -> Result<T> {
    // SAFETY: the caller's promise
    unsafe { check_size(what, data) }?;
    // SAFETY: the caller's promise; not NULL, aligned, of the size of this type
    Ok(unsafe { *data })
}

/// A structure of the caller to write to.
///
/// # Safety
/// As [`read`], and nothing else uses it for `'a`.
pub(super) unsafe fn out_struct<'a, T: Sized32>(what: &str, data: *mut T) -> Result<&'a mut T> {
    // SAFETY: the caller's promise
    unsafe { check_size(what, data) }?;
    // SAFETY: the caller's promise; not NULL, aligned, of the size of this type
    Ok(unsafe { &mut *data })
}

/// # Safety
/// As [`read`].
unsafe fn check_size<T: Sized32>(what: &str, data: *const T) -> Result<()> {
    usable(what, data, 1)?;
    // SAFETY: not NULL, aligned, and every structure begins with its size
    let given = unsafe { *data.cast::<u32>() } as usize;
    let known = size_of::<T>();
    match given == known {
        true => Ok(()),
        false => Err(invalid(
            what,
            format!(
                "its struct_size is {given}; in ABI {SINEW_ABI} it is {known}: set it to sizeof"
            ),
        )),
    }
}

/// A place for one result.
///
/// # Safety
/// `data` is NULL or points to a value that nothing else uses for `'a`.
pub(super) unsafe fn out<'a, T>(what: &str, data: *mut T) -> Result<&'a mut T> {
    usable(what, data, 1)?;
    // SAFETY: the caller's promise; not NULL, aligned
    Ok(unsafe { &mut *data })
}

/// Gives a result that the caller need not want.
///
/// # Safety
/// As [`out`].
pub(super) unsafe fn tell<T>(what: &str, place: *mut T, value: T) -> Result<()> {
    if !place.is_null() {
        // SAFETY: the caller's promise
        *unsafe { out(what, place) }? = value;
    }
    Ok(())
}

/// Makes a thing that the caller owns from now on, up to [`free`].
///
/// # Safety
/// `place` is NULL or points to a pointer.
pub(super) unsafe fn give<T>(place: *mut *mut T, make: impl FnOnce() -> Result<T>) -> Result<()> {
    // SAFETY: the caller's promise
    let place = unsafe { out("out", place) }?;
    *place = std::ptr::null_mut();
    *place = Box::into_raw(Box::new(make()?));
    Ok(())
}

/// Drops what [`give`] made; NULL is fine.
///
/// # Safety
/// It came from [`give`], was not freed and is not used any more.
pub(super) unsafe fn free<T>(own: *mut T) {
    if !own.is_null() {
        guarded(|| {
            // SAFETY: the caller's promise; it was made by Box::into_raw
            drop(unsafe { Box::from_raw(own) });
            Ok(())
        });
    }
}

/// Three numbers of the caller.
///
/// # Safety
/// `data` is NULL or points to three numbers.
pub(super) unsafe fn three(what: &str, data: *const f64) -> Result<[f64; 3]> {
    // SAFETY: the caller's promise
    let values = unsafe { slice(what, data, 3) }?;
    Ok([values[0], values[1], values[2]])
}

/// A rotation of the caller; none where it is NULL.
///
/// # Safety
/// `data` is NULL or points to four numbers.
pub(super) unsafe fn rotation(what: &str, data: *const f64) -> Result<DQuat> {
    if data.is_null() {
        return Ok(DQuat::IDENTITY);
    }
    // SAFETY: the caller's promise
    let values = unsafe { slice(what, data, 4) }?;
    Ok(quaternion([values[0], values[1], values[2], values[3]]))
}

/// A rotation; all 0 is none.
pub(super) fn quaternion(values: [f64; 4]) -> DQuat {
    if values == [0.0; 4] { DQuat::IDENTITY } else { DQuat::from_array(values) }
}

pub(super) fn vector(values: [f64; 3]) -> DVec3 {
    DVec3::from_array(values)
}

/// Tells how many values there are, and gives them where there is room for all.
///
/// # Safety
/// `data` is NULL or points to `capacity` values, `needed` is NULL or points to a number.
pub(super) unsafe fn fill<T: Copy>(
    values: &[T],
    data: *mut T,
    capacity: usize,
    needed: *mut usize,
) -> Result<()> {
    // SAFETY: the caller's promise
    if let Ok(needed) = unsafe { out("needed", needed) } {
        *needed = values.len();
    } else if data.is_null() {
        return Err(null("needed"));
    }
    if data.is_null() && capacity == 0 {
        return Ok(());
    }
    if capacity < values.len() {
        let problem = format!("room for {capacity} entries, {} are needed", values.len());
        return Err(invalid("buffer", problem));
    }
    // SAFETY: the caller's promise
    unsafe { slice_mut("buffer", data, capacity) }?[..values.len()].copy_from_slice(values);
    Ok(())
}
