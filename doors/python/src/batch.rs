//! Many simulations at once.

use crate::engine::{TURN, guarded, some_steps};
use crate::error::{raise, raise_at};
use crate::simulation::Engine;
use pyo3::prelude::*;
use sinew_embed::{Code, EmbedError, Embedding};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// One of them at work.
struct Turn {
    own: Box<Embedding>,
    left: u32,
    error: Option<EmbedError>,
}

/// Makes `count` steps of every simulation on `workers` threads. A simulation that fails stops, the others go on; answers the
/// index of the first that failed, and its exception.
#[pyfunction]
pub fn step_all(
    py: Python<'_>,
    engines: Vec<Py<Engine>>,
    count: u32,
    workers: usize,
) -> PyResult<Option<(usize, PyErr)>> {
    // always in the same order, so that two batches that share some never wait for each other
    let mut order: Vec<usize> = (0..engines.len()).collect();
    order.sort_by_key(|&i| engines[i].as_ptr().addr());
    if order.windows(2).any(|pair| engines[pair[0]].is(&engines[pair[1]])) {
        let text = "a batch cannot hold a simulation twice";
        return Err(raise(EmbedError::new(Code::Argument, text)));
    }
    let mut left = vec![count; engines.len()];
    let mut failed: Option<(usize, PyErr)> = None;
    loop {
        let turns: Vec<Mutex<Turn>> = order
            .iter()
            .map(|&i| Turn { own: engines[i].get().0.take(py), left: left[i], error: None })
            .map(Mutex::new)
            .collect();
        py.detach(|| work(&turns, workers));
        let mut refreshed = Ok(());
        for (&i, turn) in order.iter().zip(turns) {
            let Turn { mut own, left: rest, error } =
                turn.into_inner().unwrap_or_else(PoisonError::into_inner);
            let (step, time) = (own.steps_done(), own.time());
            let shared = &engines[i].get().0;
            refreshed = refreshed.and(shared.refresh(py, &mut own));
            shared.put(own);
            left[i] = rest;
            if let Some(error) = error {
                left[i] = 0;
                if failed.as_ref().is_none_or(|(first, _)| i < *first) {
                    failed = Some((i, raise_at(error, step, time)));
                }
            }
        }
        refreshed?;
        py.check_signals()?;
        if left.iter().all(|&left| left == 0) {
            return Ok(failed);
        }
    }
}

/// A turn of each, the calling thread being one of the workers.
fn work(turns: &[Mutex<Turn>], workers: usize) {
    let (next, end) = (AtomicUsize::new(0), Instant::now() + TURN);
    let some = || {
        while let Some(turn) = turns.get(next.fetch_add(1, Ordering::Relaxed)) {
            let mut turn = turn.lock().unwrap_or_else(PoisonError::into_inner);
            let Turn { own, left, error } = &mut *turn;
            *error = guarded(own, |own| some_steps(own, left, end)).err();
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..workers.min(turns.len()) {
            // without it the others do its work
            let _ = std::thread::Builder::new().spawn_scoped(scope, some);
        }
        some();
    });
}
