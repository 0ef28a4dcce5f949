//! One simulation, shared by the threads of a Python program.
//!
//! A call takes the simulation out of its place, works on it with the interpreter's lock released, takes the lock again,
//! refreshes the arrays that somebody asked for, and puts it back. Whoever finds the place empty waits in line, without the
//! lock: so nobody waits for the simulation with the lock held, and no thread can write an array that Python code reads.

use crate::error::{panic_text, raise, raise_at};
use numpy::prelude::*;
use numpy::{PyArray2, PyArrayDyn};
use pyo3::prelude::*;
use sinew_embed::{Code, EmbedError, Embedding, Handle, Quantity, Result, choice};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long steps go on before signals are looked at.
pub const TURN: Duration = Duration::from_millis(10);

/// An array that somebody asked for, and the view of it that was given out.
struct View {
    body: Handle,
    quantity: Quantity,
    epoch: u64,
    base: Py<PyArray2<f64>>,
    view: Py<PyAny>,
}

struct Place {
    own: Option<Box<Embedding>>,
    /// Numbers of the line: that of the next comer, and that of who works now or may do so next.
    next: u64,
    serving: u64,
}

/// A simulation and its arrays.
pub struct Shared {
    place: Mutex<Place>,
    returned: Condvar,
    views: Mutex<Vec<View>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Calls `work`; a panic in it is an error, after which the simulation refuses everything.
pub fn guarded<T>(
    engine: &mut Embedding,
    work: impl FnOnce(&mut Embedding) -> Result<T>,
) -> Result<T> {
    engine.check()?;
    catch_unwind(AssertUnwindSafe(|| work(engine))).unwrap_or_else(|payload| {
        let text = panic_text(&*payload);
        engine.poison(text.clone());
        Err(EmbedError::new(Code::Panic, text))
    })
}

/// Makes up to `left` steps, at least one, and no more after `end`.
pub fn some_steps(engine: &mut Embedding, left: &mut u32, end: Instant) -> Result<()> {
    while *left > 0 {
        engine.step(1)?;
        *left -= 1;
        if Instant::now() >= end {
            break;
        }
    }
    Ok(())
}

impl Shared {
    pub fn new(own: Embedding) -> Self {
        let place = Place { own: Some(Box::new(own)), next: 0, serving: 0 };
        Self { place: Mutex::new(place), returned: Condvar::new(), views: Mutex::new(Vec::new()) }
    }

    /// Takes the simulation out, after those who came before. It must be [put](Self::put) back.
    pub fn take(&self, py: Python<'_>) -> Box<Embedding> {
        let mut place = lock(&self.place);
        let ticket = place.next;
        place.next += 1;
        if place.serving == ticket
            && let Some(own) = place.own.take()
        {
            return own;
        }
        drop(place);
        py.detach(|| {
            let mut place = lock(&self.place);
            loop {
                if place.serving == ticket
                    && let Some(own) = place.own.take()
                {
                    return own;
                }
                place = self.returned.wait(place).unwrap_or_else(PoisonError::into_inner);
            }
        })
    }

    pub fn put(&self, own: Box<Embedding>) {
        let mut place = lock(&self.place);
        place.own = Some(own);
        place.serving += 1;
        drop(place);
        self.returned.notify_all();
    }

    /// Calls `work` with the interpreter's lock released, then brings arrays up to date.
    pub fn with<T: Send>(
        &self,
        work: impl FnOnce(&mut Embedding) -> Result<T> + Send,
    ) -> PyResult<T> {
        Python::attach(|py| {
            let mut own = self.take(py);
            let result = py.detach(|| guarded(&mut own, work));
            let refreshed = self.refresh(py, &mut own);
            self.put(own);
            let value = result.map_err(raise)?;
            refreshed.map(|()| value)
        })
    }

    /// Calls `work`, which is short and changes no state, with the lock held.
    pub fn read<T>(&self, work: impl FnOnce(&mut Embedding) -> Result<T>) -> PyResult<T> {
        let mut own = Python::attach(|py| self.take(py));
        let result = guarded(&mut own, work);
        self.put(own);
        result.map_err(raise)
    }

    /// Makes steps; signals are heard between them.
    pub fn step(&self, py: Python<'_>, count: u32) -> PyResult<()> {
        let mut left = count;
        loop {
            let mut own = self.take(py);
            let end = Instant::now() + TURN;
            let result = py.detach(|| guarded(&mut own, |own| some_steps(own, &mut left, end)));
            let (step, time) = (own.steps_done(), own.time());
            let refreshed = self.refresh(py, &mut own);
            self.put(own);
            result.map_err(|error| raise_at(error, step, time))?;
            refreshed?;
            py.check_signals()?;
            if left == 0 {
                return Ok(());
            }
        }
    }

    /// Writes arrays anew that are of another state.
    pub fn refresh(&self, py: Python<'_>, own: &mut Embedding) -> PyResult<()> {
        if own.is_poisoned() {
            return Ok(());
        }
        let epoch = own.epoch();
        let mut views = lock(&self.views);
        // arrays of a body that has got more vertices are made anew when somebody asks
        views.retain(|view| {
            let (count, body) = (view.base.bind(py).len() / 3, view.body);
            view.epoch == epoch || own.vertex_count(body).is_ok_and(|now| now == count)
        });
        for view in views.iter_mut().filter(|view| view.epoch != epoch) {
            let mut out = view.base.bind(py).try_readwrite()?;
            let (body, quantity, out) = (view.body, view.quantity, out.as_slice_mut()?);
            guarded(own, |own| read(own, body, quantity, out)).map_err(raise)?;
            view.epoch = epoch;
        }
        Ok(())
    }

    fn known<T>(
        &self,
        body: Handle,
        quantity: Quantity,
        use_it: impl FnOnce(&View) -> T,
    ) -> Option<T> {
        let views = lock(&self.views);
        views.iter().find(|view| view.body == body && view.quantity == quantity).map(use_it)
    }

    /// The read-only array of a body, as of the end of the last call; it is refreshed from now on.
    pub fn view(&self, py: Python<'_>, body: Handle, quantity: Quantity) -> PyResult<Py<PyAny>> {
        if let Some(view) = self.known(body, quantity, |view| view.view.clone_ref(py)) {
            return Ok(view);
        }
        let mut own = self.take(py);
        let made = self.new_view(py, &mut own, body, quantity);
        self.put(own);
        made
    }

    fn new_view(
        &self,
        py: Python<'_>,
        own: &mut Embedding,
        body: Handle,
        quantity: Quantity,
    ) -> PyResult<Py<PyAny>> {
        // another thread may have asked for it meanwhile
        if let Some(view) = self.known(body, quantity, |view| view.view.clone_ref(py)) {
            return Ok(view);
        }
        let count = guarded(own, |own| own.vertex_count(body)).map_err(raise)?;
        let base = PyArray2::<f64>::zeros(py, [count, 3], false);
        {
            let mut out = base.readwrite();
            let out = out.as_slice_mut()?;
            guarded(own, |own| read(own, body, quantity, out)).map_err(raise)?;
        }
        let view = base.call_method0("view")?;
        view.getattr("flags")?.setattr("writeable", false)?;
        let epoch = own.epoch();
        let (base, view) = (base.unbind(), view.unbind());
        let given = view.clone_ref(py);
        lock(&self.views).push(View { body, quantity, epoch, base, view });
        Ok(given)
    }

    /// A copy of that array that no other thread can write while it is made.
    pub fn copy(&self, py: Python<'_>, body: Handle, quantity: Quantity) -> PyResult<Py<PyAny>> {
        self.view(py, body, quantity)?;
        let base = self.known(body, quantity, |view| view.base.clone_ref(py));
        let numbers = match &base {
            Some(base) => base.bind(py).readonly().as_slice()?.to_vec(),
            None => Vec::new(),
        };
        rows3(py, numbers).map(|copy| copy.into_any().unbind())
    }
}

/// Which vectors of a body are refreshed, by their name.
pub fn refreshed(name: &str) -> Result<Quantity> {
    let known = choice("quantity", name)?;
    match known {
        Quantity::Positions | Quantity::Displacements | Quantity::Velocities => Ok(known),
        _ => Err(EmbedError::new(
            Code::Argument,
            format!("`{name}` is no view; it can be positions, displacements or velocities"),
        )),
    }
}

fn read(own: &mut Embedding, body: Handle, quantity: Quantity, out: &mut [f64]) -> Result<()> {
    out.copy_from_slice(&own.numbers(body, quantity)?);
    Ok(())
}

/// An array of shape (n, 3).
pub fn rows3(py: Python<'_>, numbers: Vec<f64>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let count = numbers.len() / 3;
    numpy::PyArray1::from_vec(py, numbers).reshape([count, 3])
}

/// An array that cannot be written.
pub fn read_only<'py, T: numpy::Element>(
    array: Bound<'py, PyArrayDyn<T>>,
) -> PyResult<Bound<'py, PyAny>> {
    array.getattr("flags")?.setattr("writeable", false)?;
    Ok(array.into_any())
}
