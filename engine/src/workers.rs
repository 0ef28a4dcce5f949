//! The one thread pool. Work is always cut into *fixed* pieces, by size and never by thread count,
//! and sums run over the pieces in order: results are the same bit for bit for any thread count.

use crate::lanes::{InstructionSet, InstructionSetError, Kernel, dispatch_on};
use crate::scalar::Scalar;
use bevy_ecs::prelude::Resource;
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Below this much work (nanoseconds, estimated) a parallel region costs more than it saves.
const PARALLEL_THRESHOLD_NS: usize = 40_000;
/// The same inside [`Workers::enter`], where the other threads are awake.
const AWAKE_THRESHOLD_NS: usize = 8_000;

/// Threads that carry out parallel regions, and the instruction set that kernels run with.
///
/// rayon rather than bevy's task pool: bevy's pool is one per process and cannot be sized per
/// simulation, and a region costs about the same in both.
#[derive(Resource, Clone)]
pub struct Workers {
    pool: Option<Arc<rayon::ThreadPool>>,
    threads: usize,
    stay_awake: bool,
    instruction_set: InstructionSet,
}

/// How many threads, and how they treat what else runs on the machine. Results do not depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Threads {
    /// Number of threads; 0 means one per core.
    pub count: usize,
    /// Threads of a pool with one per core each keep to a core of their own. A program that has threads of its own
    /// beside them then waits for those cores, or they for it.
    pub pinned: bool,
    /// Threads without work stay awake until the step ends, so that its many small regions need no hand-over.
    pub awake: bool,
}

impl From<usize> for Threads {
    /// So many threads with the machine to themselves.
    fn from(count: usize) -> Self {
        Self { count, pinned: true, awake: true }
    }
}

/// Threads or instructions that cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorkersError {
    /// More than any machine could use.
    #[error("{threads} threads asked for, at most {MAX_THREADS} make sense; 0 means one per core")]
    TooMany {
        /// Threads asked for.
        threads: usize,
    },
    /// An instruction set that does not exist or that the machine lacks.
    #[error(transparent)]
    InstructionSet(#[from] InstructionSetError),
    /// The operating system refused to start them.
    #[error("cannot start {threads} worker threads: {source}; ask for fewer threads")]
    Refused {
        /// Threads asked for.
        threads: usize,
        /// Cause.
        source: rayon::ThreadPoolBuildError,
    },
}

/// Most threads of a pool.
const MAX_THREADS: usize = 512;

impl Default for Workers {
    fn default() -> Self {
        Self::serial()
    }
}

impl Workers {
    /// Everything on the calling thread, as [`new(1)`](Self::new), but it cannot fail: where the
    /// environment names no usable instruction set it takes the best of this machine.
    pub fn serial() -> Self {
        let instruction_set = InstructionSet::default_set().unwrap_or(InstructionSet::best());
        Self { pool: None, threads: 1, stay_awake: true, instruction_set }
    }

    /// A pool of `threads`; a number is of threads that have the machine to themselves, 0 means one per core. The
    /// instruction set is [`InstructionSet::default_set`].
    ///
    /// # Errors
    /// When the threads cannot be started, or are more than 512, or the environment names an instruction
    /// set that does not exist or that this machine does not have.
    pub fn new(threads: impl Into<Threads>) -> Result<Self, WorkersError> {
        let Threads { count: threads, pinned, awake: stay_awake } = threads.into();
        let threads = if threads == 0 {
            std::thread::available_parallelism().map_or(1, |n| n.get())
        } else {
            threads
        };
        let instruction_set = InstructionSet::default_set()?;
        if threads == 1 {
            return Ok(Self { pool: None, threads, stay_awake, instruction_set });
        }
        Self::check_count(threads)?;
        let mut pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        if pinned {
            pool = pool.start_handler(move |thread| pin(thread, threads));
        }
        let pool = pool.build().map_err(|source| WorkersError::Refused { threads, source })?;
        Ok(Self { pool: Some(Arc::new(pool)), threads, stay_awake, instruction_set })
    }

    /// Refuses a number of threads of no use.
    ///
    /// # Errors
    /// When it is more than 512.
    pub fn check_count(threads: usize) -> Result<(), WorkersError> {
        if threads > MAX_THREADS { Err(WorkersError::TooMany { threads }) } else { Ok(()) }
    }

    /// The same threads with another instruction set. Results depend on it in the last digits; with
    /// [`InstructionSet::Portable`] they are the same on every machine.
    ///
    /// # Errors
    /// When this machine does not have it.
    pub fn with_instruction_set(self, set: InstructionSet) -> Result<Self, WorkersError> {
        Ok(Self { instruction_set: set.checked()?, ..self })
    }

    /// Instruction set of the kernels.
    pub fn instruction_set(&self) -> InstructionSet {
        self.instruction_set
    }

    /// Runs a kernel on the calling thread.
    #[inline]
    pub fn dispatch<S: Scalar, K: Kernel<S>>(&self, kernel: K) -> K::Output {
        dispatch_on(self.instruction_set, kernel)
    }

    /// Number of threads.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// Runs `f` on a thread of the pool while the others stay awake ([`Threads::awake`]), so that many small regions
    /// follow each other without a hand-over: waking a thread takes as long as 5 000 tetrahedra do.
    pub fn enter<R: Send>(&self, f: impl FnOnce() -> R + Send) -> R {
        match &self.pool {
            Some(pool) if pool.current_thread_index().is_none() => pool.install(|| {
                if !self.stay_awake {
                    return f();
                }
                let this = pool.current_thread_index();
                let finished = AtomicBool::new(false);
                rayon::scope(|scope| {
                    let _finish = SetOnDrop(&finished);
                    scope.spawn_broadcast(|_, thread| {
                        if Some(thread.index()) != this {
                            stay_awake(&finished);
                        }
                    });
                    f()
                })
            }),
            _ => f(),
        }
    }

    /// Whether a region of this much work is worth its hand-over.
    fn pays(&self, pool: &rayon::ThreadPool, work_ns: usize) -> bool {
        let awake = self.stay_awake && pool.current_thread_index().is_some();
        work_ns > if awake { AWAKE_THRESHOLD_NS } else { PARALLEL_THRESHOLD_NS }
    }

    /// Calls `f(index, item)` for every item, in parallel when the whole is worth it.
    ///
    /// `work_ns` is a rough estimate of the total work in nanoseconds.
    #[inline]
    pub fn for_each<T: Send>(
        &self,
        items: &mut [T],
        work_ns: usize,
        f: impl Fn(usize, &mut T) + Send + Sync,
    ) {
        self.each(items, work_ns, &f);
    }

    /// [`for_each`](Self::for_each), compiled once for a type of items: with a loop of its own for every closure
    /// the parallel loops were a fifth of the machine code, and an item is work enough for an indirect call.
    #[inline(never)]
    fn each<T: Send>(&self, items: &mut [T], work_ns: usize, f: &(dyn Fn(usize, &mut T) + Sync)) {
        match &self.pool {
            Some(pool) if items.len() > 1 && self.pays(pool, work_ns) => {
                pool.install(|| items.par_iter_mut().enumerate().for_each(|(i, t)| f(i, t)));
            }
            _ => items.iter_mut().enumerate().for_each(|(i, t)| f(i, t)),
        }
    }

    /// Calls `f(first_row, rows)` for consecutive chunks of `chunk` rows.
    #[inline]
    pub fn for_chunks<T: Send>(
        &self,
        rows: &mut [T],
        chunk: usize,
        work_ns: usize,
        f: impl Fn(usize, &mut [T]) + Send + Sync,
    ) {
        self.chunks(rows, chunk, work_ns, &f);
    }

    /// [`for_chunks`](Self::for_chunks), compiled once for a type of rows.
    #[inline(never)]
    fn chunks<T: Send>(
        &self,
        rows: &mut [T],
        chunk: usize,
        work_ns: usize,
        f: &(dyn Fn(usize, &mut [T]) + Sync),
    ) {
        match &self.pool {
            Some(pool) if rows.len() > chunk && self.pays(pool, work_ns) => {
                pool.install(|| {
                    rows.par_chunks_mut(chunk).enumerate().for_each(|(i, c)| f(i * chunk, c))
                });
            }
            _ => rows.chunks_mut(chunk).enumerate().for_each(|(i, c)| f(i * chunk, c)),
        }
    }

    /// Sum over `0..n` of `f`, added up per chunk of fixed size and then over chunks in order.
    pub fn sum(
        &self,
        n: usize,
        work_ns: usize,
        f: impl Fn(std::ops::Range<usize>) -> f64 + Send + Sync,
    ) -> f64 {
        const CHUNK: usize = 2048;
        if n <= CHUNK {
            return f(0..n);
        }
        let mut partial = vec![0.0; n.div_ceil(CHUNK)];
        self.for_each(&mut partial, work_ns, |i, p| {
            *p = f(i * CHUNK..((i + 1) * CHUNK).min(n));
        });
        partial.iter().sum()
    }
}

/// Keeps a thread of a pool that has one for every core on a core of its own. Left to themselves, two
/// threads that are woken for a step may share one core for milliseconds before they are moved apart,
/// longer than the step takes. A smaller pool is left to the system, which may need to move it out of
/// the way of other programs.
fn pin(thread: usize, threads: usize) {
    if let Some(cores) = core_affinity::get_core_ids().filter(|cores| cores.len() == threads)
        && let Some(&core) = cores.get(thread)
    {
        // refused at worst, which costs speed only
        core_affinity::set_for_current(core);
    }
}

/// Sets a flag when it goes, also when a panic unwinds.
struct SetOnDrop<'a>(&'a AtomicBool);

impl Drop for SetOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Takes work of the pool as soon as there is any, until `finished`; makes way for other programs.
fn stay_awake(finished: &AtomicBool) {
    let mut idle = 0_u32;
    while !finished.load(Ordering::Acquire) {
        if rayon::yield_now() == Some(rayon::Yield::Executed) {
            idle = 0;
            continue;
        }
        idle += 1;
        if idle.is_multiple_of(64) {
            std::thread::yield_now();
        } else {
            std::hint::spin_loop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absurd_thread_counts_are_refused() {
        assert!(matches!(Workers::new(100_000), Err(WorkersError::TooMany { threads: 100_000 })));
        assert_eq!(Workers::new(1).unwrap().threads(), 1);
    }

    #[test]
    fn sums_do_not_depend_on_the_number_of_threads() {
        let f = |r: std::ops::Range<usize>| r.map(|i| 1.0 / (1.0 + i as f64)).sum::<f64>();
        let serial = Workers::serial().sum(100_000, usize::MAX, f);
        for threads in [2, 3, 8] {
            assert_eq!(Workers::new(threads).unwrap().sum(100_000, usize::MAX, f), serial);
        }
    }
}
