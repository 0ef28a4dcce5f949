//! Errors of the engine as exceptions, which `package/sinew/_errors.py` defines.

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use sinew_embed::EmbedError;
use std::any::Any;

/// The exception of an error; where a step failed, with number (from 0) and start time (s) of that step.
fn exception(error: &EmbedError, at: Option<(u64, f64)>) -> PyErr {
    static MAKE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    Python::attach(|py| {
        let make = MAKE
            .get_or_try_init(py, || py.import("sinew._errors")?.getattr("make").map(Bound::unbind));
        let made = make.and_then(|make| make.call1(py, (error.code as i32, &error.text, at)));
        made.map_or_else(|e| e, |made| PyErr::from_value(made.into_bound(py)))
    })
}

/// The exception of an error.
pub fn raise(error: EmbedError) -> PyErr {
    exception(&error, None)
}

/// The exception of an error in a step.
pub fn raise_at(error: EmbedError, step: u64, time: f64) -> PyErr {
    exception(&error, Some((step, time)))
}

/// What a panic said.
pub fn panic_text(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(|text| (*text).to_string());
    text.or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "a panic without a text".into())
}
