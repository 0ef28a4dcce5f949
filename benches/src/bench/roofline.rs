//! What this machine can do at most: fused multiply-adds and read bandwidth, probed in the same run
//! as the kernels that are held against it.
//!
//! The probes are plain loops over arrays, compiled once per instruction set; the one that the
//! machine has is chosen at run time.

use crate::toolbox::prelude::*;
use std::hint::black_box;
use std::sync::Barrier;

use sinew_tune::machine::MachineNotes;

/// Limits for a number of threads.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MachineLimits {
    /// Threads at once, each with data of its own.
    pub threads: usize,
    /// Multiply-adds in `f64` (GFLOP/s, two per multiply-add).
    pub fma_f64: f64,
    /// The same in `f32`.
    pub fma_f32: f64,
    /// Read bandwidth by size of the data.
    pub read: Vec<ReadLimit>,
}

/// Read bandwidth of one level of the memory.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReadLimit {
    /// `L1`, `L2`, `L3` or `memory`.
    pub level: String,
    /// Data per thread (KiB).
    pub kib: usize,
    /// All threads together (GB/s).
    pub gb_per_s: f64,
    /// Size of all data (bytes) up to which this level counts.
    pub holds_bytes: f64,
}

impl MachineLimits {
    /// The level that holds so much data, all threads together.
    pub fn level(&self, bytes: f64) -> Option<&ReadLimit> {
        self.read.iter().find(|r| bytes <= r.holds_bytes)
    }

    /// Shortest possible time (s) for so many operations and so many bytes out of a working set, and
    /// what limits it.
    pub fn bound(
        &self,
        precision: &str,
        flops: f64,
        bytes: f64,
        working_set: f64,
    ) -> (f64, String) {
        let peak = if precision == "f32" { self.fma_f32 } else { self.fma_f64 };
        let arithmetic = flops / (peak * 1e9);
        match self.level(working_set) {
            Some(level) if bytes / (level.gb_per_s * 1e9) > arithmetic => {
                (bytes / (level.gb_per_s * 1e9), format!("read {}", level.level))
            }
            _ => (arithmetic, "multiply-add".to_string()),
        }
    }
}

/// Probes the limits for each number of threads; about a third of a second per number.
pub fn probe(machine: &MachineNotes, threads: &[usize]) -> Vec<MachineLimits> {
    let [l1, l2, l3] = machine.caches_kib.map(|kib| kib.map(|kib| kib as usize));
    let (l1, l2, l3) = (l1.unwrap_or(32), l2.unwrap_or(512), l3.unwrap_or(8192));
    threads
        .iter()
        .map(|&n| {
            // well inside each level; the third is shared
            let sizes = [
                ("L1", l1 / 2, (l1 * n) as f64),
                ("L2", (l1 * 2).max(l2 / 2), (l2 * n) as f64),
                ("L3", (l2 * 2).max(l3 / 4 / n), l3 as f64),
                ("memory", (l3 * 4 / n).min(1 << 18), f64::INFINITY),
            ];
            let read = |(level, kib, holds): (&str, usize, f64)| ReadLimit {
                level: level.to_string(),
                kib,
                gb_per_s: read_rate(n, kib * 1024) / 1e9,
                holds_bytes: holds * 1024.0,
            };
            MachineLimits {
                threads: n,
                fma_f64: rate(n, || (), |(), k| fma_f64(k)) / 1e9,
                fma_f32: rate(n, || (), |(), k| fma_f32(k)) / 1e9,
                read: sizes.map(read).to_vec(),
            }
        })
        .collect()
}

/// Best rate (units per second, all threads together) of `work(state, k)`, which does `k` units of
/// work and returns how many it did.
pub fn rate<T>(
    threads: usize,
    state: impl Fn() -> T + Sync,
    work: impl Fn(&mut T, usize) -> f64 + Sync,
) -> f64 {
    const SAMPLES: usize = 7;
    const SECONDS: f64 = 3e-3;
    let barrier = Barrier::new(threads);
    let one = || {
        let mut state = state();
        // a sample long enough for the clock
        let mut k = 1;
        loop {
            let start = Instant::now();
            work(&mut state, k);
            if start.elapsed().as_secs_f64() > SECONDS {
                break;
            }
            k *= 2;
        }
        let mut rates = Vec::with_capacity(SAMPLES);
        for _ in 0..SAMPLES {
            barrier.wait();
            let start = Instant::now();
            let done = work(&mut state, k);
            rates.push(done / start.elapsed().as_secs_f64());
        }
        rates
    };
    let all: Vec<Vec<f64>> = std::thread::scope(|scope| {
        let started: Vec<_> = (0..threads).map(|_| scope.spawn(one)).collect();
        started.into_iter().filter_map(|thread| thread.join().ok()).collect()
    });
    let together = |sample: usize| all.iter().map(|rates| rates[sample]).sum::<f64>();
    (0..SAMPLES).map(together).fold(0.0, f64::max)
}

fn read_rate(threads: usize, bytes: usize) -> f64 {
    let fill = || vec![1.0_f64; (bytes / 8).next_multiple_of(LANES_READ)];
    rate(threads, fill, |data, k| {
        for _ in 0..k {
            black_box(sum(black_box(data)));
        }
        (k * data.len() * 8) as f64
    })
}

/// Accumulators for the probes of reading.
pub const LANES_READ: usize = 64;

macro_rules! multiply_add {
    ($t:ty, $lanes:expr, $k:expr, |$x:ident, $a:ident, $b:ident| $next:expr) => {{
        let mut lanes = [0.5 as $t; $lanes];
        let ($a, $b) = (black_box(0.999 as $t), black_box(0.001 as $t));
        for _ in 0..$k * 64 {
            for $x in &mut lanes {
                *$x = $next;
            }
        }
        black_box(&lanes);
        ($k * 64 * $lanes * 2) as f64
    }};
}

#[inline(always)]
fn sum_loop(data: &[f64]) -> f64 {
    let mut lanes = [0.0; LANES_READ];
    for chunk in data.chunks_exact(LANES_READ) {
        for (lane, x) in lanes.iter_mut().zip(chunk) {
            *lane += x;
        }
    }
    lanes.iter().sum()
}

#[cfg(target_arch = "x86_64")]
mod dispatch {
    //! The only place that calls code for instruction sets found at run time.
    use super::sum_loop;
    use std::hint::black_box;

    // twelve vector registers of accumulators hide the latency of a multiply-add
    macro_rules! for_instruction_set {
        ($features:literal, $bytes:literal, $f64:ident, $f32:ident, $sum:ident) => {
            #[target_feature(enable = $features)]
            fn $f64(k: usize) -> f64 {
                multiply_add!(f64, { 12 * $bytes / 8 }, k, |x, a, b| x.mul_add(a, b))
            }
            #[target_feature(enable = $features)]
            fn $f32(k: usize) -> f64 {
                multiply_add!(f32, { 12 * $bytes / 4 }, k, |x, a, b| x.mul_add(a, b))
            }
            #[target_feature(enable = $features)]
            fn $sum(data: &[f64]) -> f64 {
                sum_loop(data)
            }
        };
    }
    for_instruction_set!("avx512f,fma", 64, fma_f64_512, fma_f32_512, sum_512);
    for_instruction_set!("avx2,fma", 32, fma_f64_256, fma_f32_256, sum_256);

    macro_rules! choose {
        ($wide:ident, $narrow:ident, $plain:expr, $argument:expr) => {
            if std::is_x86_feature_detected!("avx512f") && std::is_x86_feature_detected!("fma") {
                // SAFETY: the instruction sets were found just now.
                unsafe { $wide($argument) }
            } else if std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma")
            {
                // SAFETY: the instruction sets were found just now.
                unsafe { $narrow($argument) }
            } else {
                $plain
            }
        };
    }

    /// Operations of `k` rounds of multiply-adds in `f64`, which it does.
    pub fn fma_f64(k: usize) -> f64 {
        choose!(fma_f64_512, fma_f64_256, super::multiply_add_f64(k), k)
    }

    /// The same in `f32`.
    pub fn fma_f32(k: usize) -> f64 {
        choose!(fma_f32_512, fma_f32_256, super::multiply_add_f32(k), k)
    }

    /// Sum of numbers, with as many accumulators as reading needs.
    pub fn sum(data: &[f64]) -> f64 {
        choose!(sum_512, sum_256, sum_loop(data), data)
    }
}

#[cfg(not(target_arch = "x86_64"))]
mod dispatch {
    /// Operations of `k` rounds of multiply-adds in `f64`, which it does.
    pub fn fma_f64(k: usize) -> f64 {
        super::multiply_add_f64(k)
    }
    /// The same in `f32`.
    pub fn fma_f32(k: usize) -> f64 {
        super::multiply_add_f32(k)
    }
    /// Sum of numbers, with as many accumulators as reading needs.
    pub fn sum(data: &[f64]) -> f64 {
        super::sum_loop(data)
    }
}

pub use dispatch::{fma_f32, fma_f64, sum};

/// Multiplications and additions of the instruction set that every such processor has; fused where
/// that is so (`mul_add` would call a library function elsewhere).
fn multiply_add_f64(k: usize) -> f64 {
    multiply_add!(f64, 24, k, |x, a, b| *x * a + b)
}

fn multiply_add_f32(k: usize) -> f64 {
    multiply_add!(f32, 48, k, |x, a, b| *x * a + b)
}
