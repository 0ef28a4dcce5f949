//! Run-time choice of the instruction set for loops that the compiler vectorises.
//!
//! A [`Kernel`] is compiled three times from the same source. None of the kernels fuses
//! multiplications and additions, so all instruction sets give the same bits.

/// A piece of work whose code is worth compiling for wider vectors. `run` and all that it calls must be
/// inlined (`#[inline(always)]`): a function that is not keeps the instruction set of the build.
pub(crate) trait Kernel {
    /// Result.
    type Output;
    /// Does the work.
    fn run(self) -> Self::Output;
}

/// Runs a kernel with the widest vectors that this machine has.
#[cfg(target_arch = "x86_64")]
pub(crate) fn vectorised<K: Kernel>(kernel: K) -> K::Output {
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi1,bmi2")]
    fn avx512<K: Kernel>(kernel: K) -> K::Output {
        kernel.run()
    }
    #[target_feature(enable = "avx2,bmi1,bmi2")]
    fn avx2<K: Kernel>(kernel: K) -> K::Output {
        kernel.run()
    }
    // the standard library keeps the answers
    let bits = is_x86_feature_detected!("bmi1") && is_x86_feature_detected!("bmi2");
    let two = bits && is_x86_feature_detected!("avx2");
    let wide = two
        && is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512bw");
    if wide {
        // SAFETY: every feature that `avx512` enables was detected just above.
        unsafe { avx512(kernel) }
    } else if two {
        // SAFETY: every feature that `avx2` enables was detected just above.
        unsafe { avx2(kernel) }
    } else {
        kernel.run()
    }
}

/// Runs a kernel with the vectors of the build.
#[cfg(not(target_arch = "x86_64"))]
pub(crate) fn vectorised<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [f32]);

    impl Kernel for Sum<'_> {
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
