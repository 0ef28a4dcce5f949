//! Kernels over several elements at once.
//!
//! A [`Kernel`] is a loop over elements written once for any [`Lanes`] type: a register that holds the
//! same quantity of 1, 4, 8 or 16 neighbouring elements. [`dispatch_on`] runs it with an [`InstructionSet`]
//! that is chosen at run time (AVX-512, AVX2 with FMA, or one element at a time) and that its code was
//! compiled for, so nothing needs `target-cpu=native`.
//!
//! ```
//! use sinew_engine::lanes::{InstructionSet, Kernel, Lanes, dispatch_on};
//! use sinew_engine::scalar::{Real, Scalar};
//!
//! /// `y += a x`
//! struct Axpy<'a, S>(S, &'a [S], &'a mut [S]);
//!
//! impl<S: Scalar> Kernel<S> for Axpy<'_, S> {
//!     type Output = ();
//!     #[inline(always)]
//!     fn run<L: Lanes<Scalar = S>>(self) {
//!         let Axpy(a, x, y) = self;
//!         let whole = x.len() - x.len() % L::COUNT;
//!         for i in (0..whole).step_by(L::COUNT) {
//!             L::splat(a).mul_add(L::load(&x[i..]), L::load(&y[i..])).store(&mut y[i..]);
//!         }
//!         for i in whole..x.len() {
//!             y[i] = a * x[i] + y[i];
//!         }
//!     }
//! }
//!
//! let x: Vec<f64> = (0..21).map(f64::from).collect();
//! let mut y = vec![1.0; 21];
//! dispatch_on(InstructionSet::best(), Axpy(2.0, &x, &mut y));
//! assert_eq!(y[20], 41.0);
//! ```
//!
//! The `unsafe` code here is calls of vector instructions. They are sound because the register types
//! are private to this module and reach a kernel only through [`dispatch_on`], which has asked the machine
//! first; all memory access is through slices, bounds checked, single numbers a batch at a time. Against plain
//! arrays, which would need none of this, the force kernels are 1.3 to 1.6 times faster.
//!
//! Pitfall: closures inside a kernel are compiled without the instruction set. Use functions marked
//! `#[inline(always)]`.

use crate::scalar::{Real, Scalar};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::str::FromStr;
use std::sync::LazyLock;

/// Most lanes of any register.
pub const MAX_LANES: usize = 16;

/// A register with the same quantity of [`COUNT`](Lanes::COUNT) neighbouring elements.
///
/// `of` arguments list, per element, indices (vertex rows or blocks); `local` chooses one of them.
pub trait Lanes: Real {
    /// Type of one lane.
    type Scalar: Scalar;
    /// Number of lanes.
    const COUNT: usize;

    /// The same number in every lane.
    fn splat(x: Self::Scalar) -> Self;

    /// The first [`COUNT`](Lanes::COUNT) numbers of `from`.
    ///
    /// # Panics
    /// When there are fewer.
    fn load(from: &[Self::Scalar]) -> Self;

    /// Writes the lanes to the start of `to`.
    ///
    /// # Panics
    /// When there is no room.
    fn store(self, to: &mut [Self::Scalar]);

    /// First three entries of the rows `of[lane][local]`.
    #[inline(always)]
    fn load_rows<const M: usize>(
        rows: &[[Self::Scalar; 4]],
        of: &[[u32; M]],
        local: usize,
    ) -> [Self; 3] {
        let mut buffer = [[Self::Scalar::ZERO; MAX_LANES]; 3];
        for (lane, of) in of[..Self::COUNT].iter().enumerate() {
            let row = &rows[of[local] as usize];
            for k in 0..3 {
                buffer[k][lane] = row[k];
            }
        }
        [Self::load(&buffer[0]), Self::load(&buffer[1]), Self::load(&buffer[2])]
    }

    /// Adds the lanes of `value` to the rows `of[lane][local] - first`, lane after lane.
    #[inline(always)]
    fn add_rows<const M: usize>(
        value: [Self; 3],
        rows: &mut [[Self::Scalar; 4]],
        first: usize,
        of: &[[u32; M]],
        local: usize,
    ) {
        let mut buffer = [[Self::Scalar::ZERO; MAX_LANES]; 3];
        for k in 0..3 {
            value[k].store(&mut buffer[k]);
        }
        for (lane, of) in of[..Self::COUNT].iter().enumerate() {
            let row = &mut rows[of[local] as usize - first];
            for k in 0..3 {
                row[k] += buffer[k][lane];
            }
        }
    }

    /// Adds the lanes of nine numbers to the blocks `of[lane][local] - first`, lane after lane.
    #[inline(always)]
    fn add_blocks<const M: usize>(
        value: &[Self; 9],
        blocks: &mut [[Self::Scalar; 9]],
        first: usize,
        of: &[[u32; M]],
        local: usize,
    ) {
        let mut buffer = [[Self::Scalar::ZERO; MAX_LANES]; 9];
        for k in 0..9 {
            value[k].store(&mut buffer[k]);
        }
        for (lane, of) in of[..Self::COUNT].iter().enumerate() {
            let block = &mut blocks[of[local] as usize - first];
            for k in 0..9 {
                block[k] += buffer[k][lane];
            }
        }
    }

    /// Whether all indices are among `len` from `first` on: one look at a batch in place of one for every index.
    #[inline(always)]
    fn are_within(indices: &[u32], first: usize, len: usize) -> bool {
        indices.iter().all(|&index| (index as usize).wrapping_sub(first) < len)
    }

    /// Numbers at `of[lane]`.
    ///
    /// # Panics
    /// When one is not there.
    #[inline(always)]
    fn gather<const M: usize>(from: &[Self::Scalar], of: &[[u32; M]]) -> [Self; M] {
        let of = &of[..Self::COUNT];
        assert!(Self::are_within(of.as_flattened(), 0, from.len()));
        let mut values = [Self::ZERO; M];
        for local in 0..M {
            let mut buffer = [Self::Scalar::ZERO; MAX_LANES];
            for (lane, of) in of.iter().enumerate() {
                // SAFETY: asserted above.
                buffer[lane] = unsafe { *from.get_unchecked(of[local] as usize) };
            }
            values[local] = Self::load(&buffer);
        }
        values
    }

    /// Adds the lanes to the numbers `of[lane] - first`, local by local and lane after lane.
    ///
    /// # Panics
    /// When one is not there.
    #[inline(always)]
    fn add_at<const M: usize>(
        values: [Self; M],
        to: &mut [Self::Scalar],
        first: usize,
        of: &[[u32; M]],
    ) {
        let of = &of[..Self::COUNT];
        assert!(Self::are_within(of.as_flattened(), first, to.len()));
        for local in 0..M {
            let mut buffer = [Self::Scalar::ZERO; MAX_LANES];
            values[local].store(&mut buffer);
            for (lane, of) in of.iter().enumerate() {
                // SAFETY: asserted above.
                unsafe { *to.get_unchecked_mut(of[local] as usize - first) += buffer[lane] };
            }
        }
    }

    /// Adds every lane to a sum of its own, in `f64`.
    #[inline(always)]
    fn accumulate(self, sums: &mut [f64; MAX_LANES]) {
        let mut buffer = [Self::Scalar::ZERO; MAX_LANES];
        self.store(&mut buffer);
        for lane in 0..Self::COUNT {
            sums[lane] += buffer[lane].to_f64();
        }
    }
}

/// The last, incomplete batch of a column as an array of its own: `column[first..end]`, then its last
/// entry repeated. Kernels make the repeated elements inert (zero stiffness).
///
/// # Panics
/// When the range is empty or longer than [`MAX_LANES`].
#[inline]
pub fn padded<T: Copy>(column: &[T], first: usize, end: usize) -> [T; MAX_LANES] {
    let mut copy = [column[end - 1]; MAX_LANES];
    copy[..end - first].copy_from_slice(&column[first..end]);
    copy
}

/// A loop over elements that any register type can carry out.
pub trait Kernel<S: Scalar> {
    /// Result.
    type Output;
    /// Whether it is compiled for AVX-512 too; without, such machines run it with AVX2. For kernels that
    /// only serve comparison: each instruction set costs compile time.
    const WIDE: bool = true;
    /// The loop; mark implementations `#[inline(always)]`.
    fn run<L: Lanes<Scalar = S>>(self) -> Self::Output;
}

/// What a kernel does with one register full of elements.
pub trait Batch<S: Scalar> {
    /// As [`Kernel::WIDE`].
    const WIDE: bool = true;
    /// The elements from `first` on; mark implementations `#[inline(always)]`.
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize);
}

/// The kernel that carries out a [`Batch`] for a range of elements: full registers first, then the
/// remainder one by one. Gives the batch back, with what it has summed up.
pub struct Batches<B>(pub Range<usize>, pub B);

impl<S: Scalar, B: Batch<S>> Kernel<S> for Batches<B> {
    type Output = B;
    const WIDE: bool = B::WIDE;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) -> B {
        let Self(elements, mut batch) = self;
        let mut first = elements.start;
        if L::COUNT > 1 {
            while first + L::COUNT <= elements.end {
                batch.batch::<L>(first);
                first += L::COUNT;
            }
        }
        // a place of its own: what a function gets by reference could not stay in registers above
        let mut rest = batch;
        one_by_one(&mut rest, first..elements.end);
        rest
    }
}

/// The one copy of a batch for single elements, whatever registers came before it.
#[inline(never)]
fn one_by_one<S: Scalar, B: Batch<S>>(batch: &mut B, elements: Range<usize>) {
    for element in elements {
        batch.batch::<S::One>(element);
    }
}

/// Instruction sets that kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum InstructionSet {
    /// One element at a time in plain operations of IEEE 754 (`+ - * / sqrt`), each rounded, in the order
    /// of the source: the same bits on every machine.
    Portable,
    /// 256-bit registers with fused multiply-add: 4 `f64` or 8 `f32`.
    Avx2,
    /// 512-bit registers: 8 `f64` or 16 `f32`.
    Avx512,
}

/// An instruction set that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum InstructionSetError {
    /// No set has this name.
    #[error("there is no instruction set `{0}`; choose portable, avx2 or avx512")]
    Unknown(String),
    /// The machine lacks it.
    #[error(
        "this machine has no {}; leave the instruction set out to get the best it has, or choose portable",
        .0.name()
    )]
    Unavailable(InstructionSet),
    /// The environment asks for one that cannot be used.
    #[error("environment variable {}: {}", InstructionSet::VARIABLE, .0)]
    Environment(Box<Self>),
}

impl InstructionSet {
    /// All, narrowest first.
    pub const ALL: [Self; 3] = [Self::Portable, Self::Avx2, Self::Avx512];
    /// Environment variable that chooses the set of a whole process by its name.
    pub const VARIABLE: &str = "SINEW_INSTRUCTION_SET";

    /// Whether this machine has it.
    pub fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                Self::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// Those of this machine, narrowest first.
    pub fn available() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|set| set.is_available())
    }

    /// The widest of this machine.
    pub fn best() -> Self {
        Self::available().last().unwrap_or(Self::Portable)
    }

    /// What [`Self::VARIABLE`] names, [`best`](Self::best) where it is not set. Read once per process.
    ///
    /// # Errors
    /// When the variable names no set, or one that this machine does not have.
    pub fn default_set() -> Result<Self, InstructionSetError> {
        static CHOSEN: LazyLock<Result<InstructionSet, InstructionSetError>> =
            LazyLock::new(|| match std::env::var_os(InstructionSet::VARIABLE) {
                None => Ok(InstructionSet::best()),
                Some(name) => (name.to_string_lossy().parse())
                    .and_then(InstructionSet::checked)
                    .map_err(|error| InstructionSetError::Environment(Box::new(error))),
            });
        CHOSEN.clone()
    }

    /// Itself when this machine has it.
    ///
    /// # Errors
    /// When it does not.
    pub fn checked(self) -> Result<Self, InstructionSetError> {
        if self.is_available() { Ok(self) } else { Err(InstructionSetError::Unavailable(self)) }
    }

    /// Name in scenes, commands, the environment and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }
}

impl FromStr for InstructionSet {
    type Err = InstructionSetError;
    fn from_str(name: &str) -> Result<Self, InstructionSetError> {
        let mut sets = Self::ALL.into_iter();
        sets.find(|set| set.name() == name)
            .ok_or_else(|| InstructionSetError::Unknown(name.to_string()))
    }
}

/// Runs a kernel with a given instruction set, or the next narrower one that it is compiled for.
///
/// # Panics
/// When this machine does not have it; ask [`InstructionSet::is_available`] first.
#[inline]
pub fn dispatch_on<S: Scalar, K: Kernel<S>>(set: InstructionSet, kernel: K) -> K::Output {
    assert!(set.is_available(), "this machine has no {}", set.name());
    match set {
        InstructionSet::Portable => run_portable(kernel),
        // SAFETY: the machine has the instruction set, by the assertion above.
        InstructionSet::Avx512 if K::WIDE => unsafe { S::run_avx512(kernel) },
        // SAFETY: as above; what has AVX-512 has AVX2 and FMA.
        InstructionSet::Avx2 | InstructionSet::Avx512 => unsafe { S::run_avx2(kernel) },
    }
}

/// A function of its own, so that no caller gets another copy of the kernel.
#[inline(never)]
fn run_portable<S: Scalar, K: Kernel<S>>(kernel: K) -> K::Output {
    kernel.run::<S::One>()
}

pub(crate) mod sealed {
    use super::{Kernel, Lanes};
    use crate::scalar::Scalar;

    /// How a scalar type fills registers. Sealed: the register types must not be reachable from outside.
    pub trait Registers: Sized {
        /// One lane.
        type One: Lanes<Scalar = Self>;
        /// Runs with 256-bit registers.
        ///
        /// # Safety
        /// The machine has AVX2 and FMA.
        unsafe fn run_avx2<K: Kernel<Self>>(kernel: K) -> K::Output
        where
            Self: Scalar;
        /// Runs with 512-bit registers.
        ///
        /// # Safety
        /// The machine has AVX-512 F, DQ and VL, AVX2 and FMA.
        unsafe fn run_avx512<K: Kernel<Self>>(kernel: K) -> K::Output
        where
            Self: Scalar;
    }
}
use sealed::Registers;

macro_rules! one_lane {
    ($t:ident) => {
        impl Lanes for $t {
            type Scalar = Self;
            const COUNT: usize = 1;
            #[inline(always)]
            fn splat(x: Self) -> Self {
                x
            }
            #[inline(always)]
            fn load(from: &[Self]) -> Self {
                from[0]
            }
            #[inline(always)]
            fn store(self, to: &mut [Self]) {
                to[0] = self;
            }
        }
    };
}
one_lane!(f32);
one_lane!(f64);

#[cfg(not(target_arch = "x86_64"))]
mod no_registers {
    use super::{Kernel, Registers, run_portable};
    macro_rules! registers {
        ($t:ident) => {
            impl Registers for $t {
                type One = $t;
                unsafe fn run_avx2<K: Kernel<$t>>(kernel: K) -> K::Output {
                    run_portable(kernel)
                }
                unsafe fn run_avx512<K: Kernel<$t>>(kernel: K) -> K::Output {
                    run_portable(kernel)
                }
            }
        };
    }
    registers!(f32);
    registers!(f64);
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Kernel, Lanes, Real, Registers};
    use crate::scalar::Calculation;
    use std::arch::x86_64::*;
    use std::mem::transmute;
    use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

    #[inline(never)]
    #[target_feature(enable = "avx2,fma")]
    fn run_avx2<L: Lanes, K: Kernel<L::Scalar>>(kernel: K) -> K::Output {
        kernel.run::<L>()
    }

    #[inline(never)]
    #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2,fma")]
    fn run_avx512<L: Lanes, K: Kernel<L::Scalar>>(kernel: K) -> K::Output {
        kernel.run::<L>()
    }

    #[inline(never)]
    #[target_feature(enable = "avx2,fma")]
    fn apart_avx2<R: Real, C: Calculation<R>>(calculation: C) -> C::Output {
        calculation.run()
    }

    #[inline(never)]
    #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2,fma")]
    fn apart_avx512<R: Real, C: Calculation<R>>(calculation: C) -> C::Output {
        calculation.run()
    }

    macro_rules! registers {
        ($t:ident, $avx2:ident, $avx512:ident) => {
            impl Registers for $t {
                type One = $t;
                unsafe fn run_avx2<K: Kernel<$t>>(kernel: K) -> K::Output {
                    // SAFETY: promised by the caller.
                    unsafe { run_avx2::<$avx2, K>(kernel) }
                }
                unsafe fn run_avx512<K: Kernel<$t>>(kernel: K) -> K::Output {
                    // SAFETY: promised by the caller.
                    unsafe { run_avx512::<$avx512, K>(kernel) }
                }
            }
        };
    }
    registers!(f32, F32x8, F32x16);
    registers!(f64, F64x4, F64x8);

    /// Calls vector instructions.
    macro_rules! vector {
        ($e:expr) => {
            // SAFETY: a value of a register type exists only inside `dispatch_on`, which has made sure
            // that the machine has the instructions; loads and stores go through slices whose length
            // was checked just before.
            unsafe { $e }
        };
    }

    /// A register type with its operators.
    macro_rules! register {
        ($name:ident, $raw:ident, $add:ident, $sub:ident, $mul:ident, $div:ident) => {
            #[derive(Clone, Copy, Debug)]
            #[repr(transparent)]
            struct $name($raw);

            register!(operators $name: Add add $add, Sub sub $sub, Mul mul $mul, Div div $div);
            register!(assign $name: AddAssign add_assign +, SubAssign sub_assign -, MulAssign mul_assign *);
            impl Neg for $name {
                type Output = Self;
                #[inline(always)]
                fn neg(self) -> Self {
                    Self::from_f64(-0.0) - self
                }
            }
        };
        (operators $name:ident: $($operator:ident $f:ident $intrinsic:ident),*) => {$(
            impl $operator for $name {
                type Output = Self;
                #[inline(always)]
                fn $f(self, b: Self) -> Self {
                    Self(vector!($intrinsic(self.0, b.0)))
                }
            }
        )*};
        (assign $name:ident: $($operator:ident $f:ident $sign:tt),*) => {$(
            impl $operator for $name {
                #[inline(always)]
                fn $f(&mut self, b: Self) {
                    *self = *self $sign b;
                }
            }
        )*};
    }
    register!(F64x8, __m512d, _mm512_add_pd, _mm512_sub_pd, _mm512_mul_pd, _mm512_div_pd);
    register!(F32x16, __m512, _mm512_add_ps, _mm512_sub_ps, _mm512_mul_ps, _mm512_div_ps);
    register!(F64x4, __m256d, _mm256_add_pd, _mm256_sub_pd, _mm256_mul_pd, _mm256_div_pd);
    register!(F32x8, __m256, _mm256_add_ps, _mm256_sub_ps, _mm256_mul_ps, _mm256_div_ps);

    /// What is the same in every [`Real`].
    macro_rules! real {
        ($s:ident, $n:literal, $apart:ident, $fma:ident, $sqrt:ident, $min:ident, $max:ident) => {
            #[inline(always)]
            fn apart<C: Calculation<Self>>(calculation: C) -> C::Output {
                vector!($apart(calculation))
            }
            const ZERO: Self = {
                // SAFETY: a register is plain bits of the same size.
                unsafe { transmute::<[$s; $n], Self>([0.0; $n]) }
            };
            const ONE: Self = {
                // SAFETY: as above.
                unsafe { transmute::<[$s; $n], Self>([1.0; $n]) }
            };
            #[inline(always)]
            fn from_f64(x: f64) -> Self {
                Self::splat(x as $s)
            }
            #[inline(always)]
            fn mul_add(self, b: Self, c: Self) -> Self {
                Self(vector!($fma(self.0, b.0, c.0)))
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                Self(vector!($sqrt(self.0)))
            }
            #[inline(always)]
            fn abs(self) -> Self {
                self.max(-self)
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                Self(vector!($max(self.0, other.0)))
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                Self(vector!($min(self.0, other.0)))
            }
        };
    }

    /// Comparisons whose masks are the bits of a number, as AVX-512 has them, or, where `$any` looks at the
    /// signs of the lanes, registers.
    macro_rules! comparisons {
        (bits $mask:ty, $compare:ident, $blend:ident) => {
            type Mask = $mask;
            #[inline(always)]
            fn less(self, other: Self) -> $mask {
                vector!($compare::<_CMP_LT_OQ>(self.0, other.0))
            }
            #[inline(always)]
            fn select(mask: $mask, yes: Self, no: Self) -> Self {
                Self(vector!($blend(mask, no.0, yes.0)))
            }
            #[inline(always)]
            fn any(mask: $mask) -> bool {
                mask != 0
            }
            #[inline(always)]
            fn both(a: $mask, b: $mask) -> $mask {
                a & b
            }
            #[inline(always)]
            fn either(a: $mask, b: $mask) -> $mask {
                a | b
            }
        };
        (lanes $compare:ident, $blend:ident, $any:ident, $and:ident, $or:ident) => {
            type Mask = Self;
            #[inline(always)]
            fn less(self, other: Self) -> Self {
                Self(vector!($compare::<_CMP_LT_OQ>(self.0, other.0)))
            }
            #[inline(always)]
            fn select(mask: Self, yes: Self, no: Self) -> Self {
                Self(vector!($blend(no.0, yes.0, mask.0)))
            }
            #[inline(always)]
            fn any(mask: Self) -> bool {
                vector!($any(mask.0)) != 0
            }
            #[inline(always)]
            fn both(a: Self, b: Self) -> Self {
                Self(vector!($and(a.0, b.0)))
            }
            #[inline(always)]
            fn either(a: Self, b: Self) -> Self {
                Self(vector!($or(a.0, b.0)))
            }
        };
    }

    impl Real for F64x8 {
        real!(f64, 8, apart_avx512, _mm512_fmadd_pd, _mm512_sqrt_pd, _mm512_min_pd, _mm512_max_pd);
        comparisons!(bits u8, _mm512_cmp_pd_mask, _mm512_mask_blend_pd);
        #[inline(always)]
        fn recip(self) -> Self {
            // 14 bits, then the geometric series to its fourth term
            let y = Self(vector!(_mm512_rcp14_pd(self.0)));
            let e = (-self).mul_add(y, Self::ONE);
            let y = y.mul_add(e, y);
            y.mul_add(e * e, y)
        }
        #[inline(always)]
        fn recip_sqrt(self) -> Self {
            // 14 bits, then the binomial series to its fourth term
            let y = Self(vector!(_mm512_rsqrt14_pd(self.0)));
            let e = (-(self * y)).mul_add(y, Self::ONE);
            let series = e.mul_add(Self::from_f64(0.3125), Self::from_f64(0.375));
            (y * e).mul_add(e.mul_add(series, Self::from_f64(0.5)), y)
        }
    }
    impl Real for F32x16 {
        real!(f32, 16, apart_avx512, _mm512_fmadd_ps, _mm512_sqrt_ps, _mm512_min_ps, _mm512_max_ps);
        comparisons!(bits u16, _mm512_cmp_ps_mask, _mm512_mask_blend_ps);
        #[inline(always)]
        fn recip(self) -> Self {
            let y = Self(vector!(_mm512_rcp14_ps(self.0)));
            y.mul_add((-self).mul_add(y, Self::ONE), y)
        }
        #[inline(always)]
        fn recip_sqrt(self) -> Self {
            let y = Self(vector!(_mm512_rsqrt14_ps(self.0)));
            let e = (-(self * y)).mul_add(y, Self::ONE);
            (y * e).mul_add(e.mul_add(Self::from_f64(0.375), Self::from_f64(0.5)), y)
        }
    }
    impl Real for F64x4 {
        real!(f64, 4, apart_avx2, _mm256_fmadd_pd, _mm256_sqrt_pd, _mm256_min_pd, _mm256_max_pd);
        comparisons!(lanes _mm256_cmp_pd, _mm256_blendv_pd, _mm256_movemask_pd, _mm256_and_pd, _mm256_or_pd);
    }
    impl Real for F32x8 {
        real!(f32, 8, apart_avx2, _mm256_fmadd_ps, _mm256_sqrt_ps, _mm256_min_ps, _mm256_max_ps);
        comparisons!(lanes _mm256_cmp_ps, _mm256_blendv_ps, _mm256_movemask_ps, _mm256_and_ps, _mm256_or_ps);
    }

    /// The first part of [`Lanes`]: one number per lane.
    macro_rules! numbers {
        ($s:ident, $n:literal, $set1:ident, $load:ident, $store:ident) => {
            type Scalar = $s;
            const COUNT: usize = $n;
            #[inline(always)]
            fn splat(x: $s) -> Self {
                Self(vector!($set1(x)))
            }
            #[inline(always)]
            fn load(from: &[$s]) -> Self {
                let from: &[$s; $n] = from[..$n].try_into().expect("length was cut");
                Self(vector!($load(from.as_ptr())))
            }
            #[inline(always)]
            fn store(self, to: &mut [$s]) {
                let to: &mut [$s; $n] = (&mut to[..$n]).try_into().expect("length was cut");
                vector!($store(to.as_mut_ptr(), self.0));
            }
            #[inline(always)]
            fn are_within(indices: &[u32], first: usize, len: usize) -> bool {
                are_within(indices, first, len)
            }
        };
    }

    /// [`Lanes::are_within`], eight at a time. In plain Rust the compiler puts the vectors together from the single
    /// indices that it loads anyway.
    #[inline(always)]
    fn are_within(indices: &[u32], first: usize, len: usize) -> bool {
        let (Ok(low), Some(high)) =
            (u32::try_from(first), first.saturating_add(len).checked_sub(1))
        else {
            return false;
        };
        let high = u32::try_from(high).unwrap_or(u32::MAX);
        let (chunks, rest) = indices.as_chunks::<8>();
        let all = vector!({
            let (low, high) = (_mm256_set1_epi32(low as i32), _mm256_set1_epi32(high as i32));
            let (mut lowest, mut highest) = (high, low);
            for chunk in chunks {
                let own = _mm256_loadu_si256(chunk.as_ptr().cast());
                lowest = _mm256_min_epu32(lowest, own);
                highest = _mm256_max_epu32(highest, own);
            }
            let in_order = _mm256_and_si256(
                _mm256_cmpeq_epi32(_mm256_max_epu32(lowest, low), lowest),
                _mm256_cmpeq_epi32(_mm256_min_epu32(highest, high), highest),
            );
            _mm256_movemask_epi8(in_order) == -1
        });
        all && rest.iter().all(|&index| low <= index && index <= high)
    }

    /// Row `of[lane][local]`.
    #[inline(always)]
    fn row<T, const M: usize>(rows: &[T], of: &[[u32; M]], local: usize, lane: usize) -> *const T {
        &raw const rows[of[lane][local] as usize]
    }

    #[inline(always)]
    fn row_mut<'a, T, const M: usize>(
        rows: &'a mut [T],
        first: usize,
        of: &[[u32; M]],
        local: usize,
        lane: usize,
    ) -> &'a mut T {
        &mut rows[of[lane][local] as usize - first]
    }

    impl Lanes for F64x8 {
        numbers!(f64, 8, _mm512_set1_pd, _mm512_loadu_pd, _mm512_storeu_pd);
        #[inline(always)]
        fn load_rows<const M: usize>(
            rows: &[[f64; 4]],
            of: &[[u32; M]],
            local: usize,
        ) -> [Self; 3] {
            let of = &of[..8];
            // rows k and k + 4 side by side, then a 4x4 transpose in both halves at once
            let mut pair = [Self::ZERO.0; 4];
            for k in 0..4 {
                let low = row(rows, of, local, k).cast::<f64>();
                let high = row(rows, of, local, k + 4).cast::<f64>();
                pair[k] = vector!(_mm512_insertf64x4::<1>(
                    _mm512_castpd256_pd512(_mm256_loadu_pd(low)),
                    _mm256_loadu_pd(high)
                ));
            }
            vector!({
                let xz01 = _mm512_unpacklo_pd(pair[0], pair[1]);
                let xz23 = _mm512_unpacklo_pd(pair[2], pair[3]);
                let yw01 = _mm512_unpackhi_pd(pair[0], pair[1]);
                let yw23 = _mm512_unpackhi_pd(pair[2], pair[3]);
                let first = _mm512_setr_epi64(0, 1, 8, 9, 4, 5, 12, 13);
                let second = _mm512_setr_epi64(2, 3, 10, 11, 6, 7, 14, 15);
                [
                    Self(_mm512_permutex2var_pd(xz01, first, xz23)),
                    Self(_mm512_permutex2var_pd(yw01, first, yw23)),
                    Self(_mm512_permutex2var_pd(xz01, second, xz23)),
                ]
            })
        }
        #[inline(always)]
        fn add_rows<const M: usize>(
            value: [Self; 3],
            rows: &mut [[f64; 4]],
            first: usize,
            of: &[[u32; M]],
            local: usize,
        ) {
            let of = &of[..8];
            let [x, y, z] = value;
            let packed = vector!({
                let zero = _mm512_setzero_pd();
                let (xy0, xy1) = (_mm512_unpacklo_pd(x.0, y.0), _mm512_unpackhi_pd(x.0, y.0));
                let (z0, z1) = (_mm512_unpacklo_pd(z.0, zero), _mm512_unpackhi_pd(z.0, zero));
                let low = _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11);
                let high = _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15);
                // lanes (0, 2), (1, 3), (4, 6), (5, 7)
                [
                    _mm512_permutex2var_pd(xy0, low, z0),
                    _mm512_permutex2var_pd(xy1, low, z1),
                    _mm512_permutex2var_pd(xy0, high, z0),
                    _mm512_permutex2var_pd(xy1, high, z1),
                ]
            });
            for (lane, source, upper) in [
                (0, 0, false),
                (1, 1, false),
                (2, 0, true),
                (3, 1, true),
                (4, 2, false),
                (5, 3, false),
                (6, 2, true),
                (7, 3, true),
            ] {
                let to = row_mut(rows, first, of, local, lane).as_mut_ptr();
                vector!({
                    let part = if upper {
                        _mm512_extractf64x4_pd::<1>(packed[source])
                    } else {
                        _mm512_castpd512_pd256(packed[source])
                    };
                    _mm256_storeu_pd(to, _mm256_add_pd(_mm256_loadu_pd(to), part));
                });
            }
        }
        #[inline(always)]
        fn add_blocks<const M: usize>(
            value: &[Self; 9],
            blocks: &mut [[f64; 9]],
            first: usize,
            of: &[[u32; M]],
            local: usize,
        ) {
            let of = &of[..8];
            let mut last = [0.0; 8];
            value[8].store(&mut last);
            let rows = transpose8(value);
            for lane in 0..8 {
                let block = row_mut(blocks, first, of, local, lane);
                block[8] += last[lane];
                let to = block.as_mut_ptr();
                vector!(_mm512_storeu_pd(to, _mm512_add_pd(_mm512_loadu_pd(to), rows[lane])));
            }
        }
    }

    /// Transpose of the first eight registers.
    #[inline(always)]
    fn transpose8(v: &[F64x8; 9]) -> [__m512d; 8] {
        vector!({
            let mut pairs = [_mm512_setzero_pd(); 8];
            for k in 0..4 {
                // (even lanes, odd lanes) of values 2k and 2k + 1
                pairs[2 * k] = _mm512_unpacklo_pd(v[2 * k].0, v[2 * k + 1].0);
                pairs[2 * k + 1] = _mm512_unpackhi_pd(v[2 * k].0, v[2 * k + 1].0);
            }
            let mut rows = [_mm512_setzero_pd(); 8];
            for odd in 0..2 {
                let (a, b) = (pairs[odd], pairs[odd + 2]);
                let (c, d) = (pairs[odd + 4], pairs[odd + 6]);
                // 128-bit pieces: piece p of a pair belongs to lane 2p + odd
                let ab02 = _mm512_shuffle_f64x2::<0x88>(a, b);
                let ab13 = _mm512_shuffle_f64x2::<0xdd>(a, b);
                let cd02 = _mm512_shuffle_f64x2::<0x88>(c, d);
                let cd13 = _mm512_shuffle_f64x2::<0xdd>(c, d);
                rows[odd] = _mm512_shuffle_f64x2::<0x88>(ab02, cd02);
                rows[4 + odd] = _mm512_shuffle_f64x2::<0xdd>(ab02, cd02);
                rows[2 + odd] = _mm512_shuffle_f64x2::<0x88>(ab13, cd13);
                rows[6 + odd] = _mm512_shuffle_f64x2::<0xdd>(ab13, cd13);
            }
            rows
        })
    }

    impl Lanes for F32x16 {
        numbers!(f32, 16, _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps);
        #[inline(always)]
        fn load_rows<const M: usize>(
            rows: &[[f32; 4]],
            of: &[[u32; M]],
            local: usize,
        ) -> [Self; 3] {
            let of = &of[..16];
            // rows k, k + 4, k + 8, k + 12 in one register, then a 4x4 transpose in every quarter
            let mut quad = [Self::ZERO.0; 4];
            for k in 0..4 {
                let p0 = row(rows, of, local, k).cast::<f32>();
                let p1 = row(rows, of, local, k + 4).cast::<f32>();
                let p2 = row(rows, of, local, k + 8).cast::<f32>();
                let p3 = row(rows, of, local, k + 12).cast::<f32>();
                quad[k] = vector!({
                    let low = _mm256_insertf128_ps::<1>(
                        _mm256_castps128_ps256(_mm_loadu_ps(p0)),
                        _mm_loadu_ps(p1),
                    );
                    let high = _mm256_insertf128_ps::<1>(
                        _mm256_castps128_ps256(_mm_loadu_ps(p2)),
                        _mm_loadu_ps(p3),
                    );
                    _mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high)
                });
            }
            vector!({
                let xy01 = _mm512_unpacklo_ps(quad[0], quad[1]);
                let xy23 = _mm512_unpacklo_ps(quad[2], quad[3]);
                let zw01 = _mm512_unpackhi_ps(quad[0], quad[1]);
                let zw23 = _mm512_unpackhi_ps(quad[2], quad[3]);
                [
                    Self(_mm512_shuffle_ps::<0x44>(xy01, xy23)),
                    Self(_mm512_shuffle_ps::<0xee>(xy01, xy23)),
                    Self(_mm512_shuffle_ps::<0x44>(zw01, zw23)),
                ]
            })
        }
        #[inline(always)]
        fn add_rows<const M: usize>(
            value: [Self; 3],
            rows: &mut [[f32; 4]],
            first: usize,
            of: &[[u32; M]],
            local: usize,
        ) {
            let of = &of[..16];
            let [x, y, z] = value;
            // register k holds lanes k, k + 4, k + 8, k + 12
            let packed = vector!({
                let zero = _mm512_setzero_ps();
                let (xy01, xy23) = (_mm512_unpacklo_ps(x.0, y.0), _mm512_unpackhi_ps(x.0, y.0));
                let (z01, z23) = (_mm512_unpacklo_ps(z.0, zero), _mm512_unpackhi_ps(z.0, zero));
                [
                    _mm512_shuffle_ps::<0x44>(xy01, z01),
                    _mm512_shuffle_ps::<0xee>(xy01, z01),
                    _mm512_shuffle_ps::<0x44>(xy23, z23),
                    _mm512_shuffle_ps::<0xee>(xy23, z23),
                ]
            });
            macro_rules! quarter {
                ($q:literal) => {
                    for k in 0..4 {
                        let to = row_mut(rows, first, of, local, 4 * $q + k).as_mut_ptr();
                        vector!({
                            let part = _mm512_extractf32x4_ps::<$q>(packed[k]);
                            _mm_storeu_ps(to, _mm_add_ps(_mm_loadu_ps(to), part));
                        });
                    }
                };
            }
            quarter!(0);
            quarter!(1);
            quarter!(2);
            quarter!(3);
        }
        #[inline(always)]
        fn add_blocks<const M: usize>(
            value: &[Self; 9],
            blocks: &mut [[f32; 9]],
            first: usize,
            of: &[[u32; M]],
            local: usize,
        ) {
            let of = &of[..16];
            let mut last = [0.0; 16];
            value[8].store(&mut last);
            // quarter q of register k: values 0..4 (then 4..8) of lane 4 q + k
            let low = quarters([value[0], value[1], value[2], value[3]]);
            let high = quarters([value[4], value[5], value[6], value[7]]);
            macro_rules! quarter {
                ($q:literal) => {
                    for k in 0..4 {
                        let lane = 4 * $q + k;
                        let block = row_mut(blocks, first, of, local, lane);
                        block[8] += last[lane];
                        let to = block.as_mut_ptr();
                        vector!({
                            let part = _mm256_insertf128_ps::<1>(
                                _mm256_castps128_ps256(_mm512_extractf32x4_ps::<$q>(low[k])),
                                _mm512_extractf32x4_ps::<$q>(high[k]),
                            );
                            _mm256_storeu_ps(to, _mm256_add_ps(_mm256_loadu_ps(to), part));
                        });
                    }
                };
            }
            quarter!(0);
            quarter!(1);
            quarter!(2);
            quarter!(3);
        }
    }

    /// 4x4 transpose in every quarter.
    #[inline(always)]
    fn quarters(v: [F32x16; 4]) -> [__m512; 4] {
        vector!({
            let a01 = _mm512_unpacklo_ps(v[0].0, v[1].0);
            let a23 = _mm512_unpackhi_ps(v[0].0, v[1].0);
            let b01 = _mm512_unpacklo_ps(v[2].0, v[3].0);
            let b23 = _mm512_unpackhi_ps(v[2].0, v[3].0);
            [
                _mm512_shuffle_ps::<0x44>(a01, b01),
                _mm512_shuffle_ps::<0xee>(a01, b01),
                _mm512_shuffle_ps::<0x44>(a23, b23),
                _mm512_shuffle_ps::<0xee>(a23, b23),
            ]
        })
    }

    impl Lanes for F64x4 {
        numbers!(f64, 4, _mm256_set1_pd, _mm256_loadu_pd, _mm256_storeu_pd);
        #[inline(always)]
        fn load_rows<const M: usize>(
            rows: &[[f64; 4]],
            of: &[[u32; M]],
            local: usize,
        ) -> [Self; 3] {
            let of = &of[..4];
            let mut r = [Self::ZERO; 4];
            for lane in 0..4 {
                let from = row(rows, of, local, lane).cast::<f64>();
                r[lane] = Self(vector!(_mm256_loadu_pd(from)));
            }
            let [x, y, z, _] = transpose4(r);
            [x, y, z]
        }
        #[inline(always)]
        fn add_rows<const M: usize>(
            value: [Self; 3],
            rows: &mut [[f64; 4]],
            first: usize,
            of: &[[u32; M]],
            local: usize,
        ) {
            let of = &of[..4];
            let parts = transpose4([value[0], value[1], value[2], Self::ZERO]);
            for (lane, part) in parts.into_iter().enumerate() {
                let to = row_mut(rows, first, of, local, lane).as_mut_ptr();
                vector!(_mm256_storeu_pd(to, _mm256_add_pd(_mm256_loadu_pd(to), part.0)));
            }
        }
    }

    #[inline(always)]
    fn transpose4(v: [F64x4; 4]) -> [F64x4; 4] {
        vector!({
            let a = _mm256_unpacklo_pd(v[0].0, v[1].0);
            let b = _mm256_unpackhi_pd(v[0].0, v[1].0);
            let c = _mm256_unpacklo_pd(v[2].0, v[3].0);
            let d = _mm256_unpackhi_pd(v[2].0, v[3].0);
            [
                F64x4(_mm256_permute2f128_pd::<0x20>(a, c)),
                F64x4(_mm256_permute2f128_pd::<0x20>(b, d)),
                F64x4(_mm256_permute2f128_pd::<0x31>(a, c)),
                F64x4(_mm256_permute2f128_pd::<0x31>(b, d)),
            ]
        })
    }

    impl Lanes for F32x8 {
        numbers!(f32, 8, _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps);
        #[inline(always)]
        fn load_rows<const M: usize>(
            rows: &[[f32; 4]],
            of: &[[u32; M]],
            local: usize,
        ) -> [Self; 3] {
            let of = &of[..8];
            let mut pair = [Self::ZERO.0; 4];
            for k in 0..4 {
                let low = row(rows, of, local, k).cast::<f32>();
                let high = row(rows, of, local, k + 4).cast::<f32>();
                pair[k] = vector!(_mm256_insertf128_ps::<1>(
                    _mm256_castps128_ps256(_mm_loadu_ps(low)),
                    _mm_loadu_ps(high)
                ));
            }
            let [x, y, z, _] = halves(pair);
            [Self(x), Self(y), Self(z)]
        }
        #[inline(always)]
        fn add_rows<const M: usize>(
            value: [Self; 3],
            rows: &mut [[f32; 4]],
            first: usize,
            of: &[[u32; M]],
            local: usize,
        ) {
            let of = &of[..8];
            let parts = halves([value[0].0, value[1].0, value[2].0, Self::ZERO.0]);
            for lane in 0..8 {
                let to = row_mut(rows, first, of, local, lane).as_mut_ptr();
                vector!({
                    let part = if lane < 4 {
                        _mm256_castps256_ps128(parts[lane])
                    } else {
                        _mm256_extractf128_ps::<1>(parts[lane - 4])
                    };
                    _mm_storeu_ps(to, _mm_add_ps(_mm_loadu_ps(to), part));
                });
            }
        }
    }

    /// 4x4 transpose in both halves.
    #[inline(always)]
    fn halves(v: [__m256; 4]) -> [__m256; 4] {
        vector!({
            let a01 = _mm256_unpacklo_ps(v[0], v[1]);
            let a23 = _mm256_unpackhi_ps(v[0], v[1]);
            let b01 = _mm256_unpacklo_ps(v[2], v[3]);
            let b23 = _mm256_unpackhi_ps(v[2], v[3]);
            [
                _mm256_shuffle_ps::<0x44>(a01, b01),
                _mm256_shuffle_ps::<0xee>(a01, b01),
                _mm256_shuffle_ps::<0x44>(a23, b23),
                _mm256_shuffle_ps::<0xee>(a23, b23),
            ]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    /// Gathers through `of` and adds the same back `first` lower.
    struct Move<'a, S> {
        from: &'a [S],
        of: &'a [[u32; 3]; MAX_LANES],
        to: &'a mut [S],
        first: usize,
    }

    impl<S: Scalar> Kernel<S> for Move<'_, S> {
        type Output = usize;
        #[inline(always)]
        fn run<L: Lanes<Scalar = S>>(self) -> usize {
            L::add_at(L::gather(self.from, self.of), self.to, self.first, self.of);
            L::COUNT
        }
    }

    fn indices_are_checked<S: Scalar>() {
        let from: Vec<S> = (0..20).map(|i| S::from_f64(f64::from(i))).collect();
        for set in InstructionSet::available() {
            let mut of = [[0; 3]; MAX_LANES];
            for (lane, of) in of.iter_mut().enumerate() {
                *of = [4, 5, 6].map(|place| place + (lane % 14) as u32);
            }
            let moved = |of: &_, from: &[S], room: usize, first: usize| {
                let mut to = vec![S::ZERO; room];
                let kernel = Move { from, of, to: &mut to, first };
                let count = catch_unwind(AssertUnwindSafe(|| dispatch_on(set, kernel)));
                count.map(|count| (count, to))
            };
            let (count, to) = moved(&of, &from, 16, 4).unwrap();
            let mut expected = vec![S::ZERO; 16];
            for own in &of[..count] {
                own.iter().for_each(|&place| expected[place as usize - 4] += from[place as usize]);
            }
            assert_eq!(to, expected, "{set:?}");
            for lane in 0..count {
                for local in 0..3 {
                    let good = of[lane][local];
                    for bad in [20, u32::MAX] {
                        of[lane][local] = bad;
                        assert!(moved(&of, &from, 16, 4).is_err(), "{set:?} {lane} {local}");
                    }
                    // there to read, but below and above where there is room
                    of[lane][local] = 3;
                    assert!(moved(&of, &from, 16, 4).is_err(), "{set:?} {lane} {local}");
                    of[lane][local] = 19;
                    assert!(moved(&of, &from, 15, 4).is_err(), "{set:?} {lane} {local}");
                    of[lane][local] = good;
                }
            }
            assert!(moved(&of, &[], 16, 4).is_err() && moved(&of, &from, 0, 4).is_err());
        }
    }

    #[test]
    fn indices_of_a_batch_are_checked() {
        indices_are_checked::<f64>();
        indices_are_checked::<f32>();
    }
}
