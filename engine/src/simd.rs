//! Run-time choice of the instruction set for loops that the compiler vectorises.
//!
//! A [`VectorKernel`] is compiled twice from the same source, with AVX and with the vectors of the build.
//! AVX is enough, since all rows here have four numbers or eight: with AVX2 or AVX-512 the compiler
//! prefers to run one loop iteration per lane, and gathers, which is slower. None of the kernels fuses
//! multiplications and additions, so all instruction sets give the same bits.

/// A piece of work whose code is worth compiling for wider vectors. `run` and all that it calls must be
/// inlined (`#[inline(always)]`): a function that is not keeps the instruction set of the build.
pub trait VectorKernel {
    /// Result.
    type Output;
    /// Does the work.
    fn run(self) -> Self::Output;
}

/// Runs a kernel with the widest vectors that this machine has.
#[cfg(target_arch = "x86_64")]
pub fn vectorised<K: VectorKernel>(kernel: K) -> K::Output {
    #[target_feature(enable = "avx")]
    fn avx<K: VectorKernel>(kernel: K) -> K::Output {
        kernel.run()
    }
    // the standard library keeps the answer
    if is_x86_feature_detected!("avx") {
        // SAFETY: the one feature that `avx` enables was detected just above.
        unsafe { avx(kernel) }
    } else {
        kernel.run()
    }
}

/// Runs a kernel with the vectors of the build.
#[cfg(not(target_arch = "x86_64"))]
pub fn vectorised<K: VectorKernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [f32]);

    impl VectorKernel for Sum<'_> {
        type Output = f32;
        #[inline(always)]
        fn run(self) -> f32 {
            let mut lanes = [0.0; 16];
            for x in self.0.chunks_exact(16) {
                for k in 0..16 {
                    lanes[k] += x[k] * x[k];
                }
            }
            lanes.iter().sum()
        }
    }

    #[test]
    fn all_instruction_sets_give_the_same_bits() {
        let x: Vec<f32> = (0..1024).map(|i| (i as f32 * 0.37).sin()).collect();
        assert_eq!(vectorised(Sum(&x)).to_bits(), Sum(&x).run().to_bits());
    }
}
