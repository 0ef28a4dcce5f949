//! The number type of a simulation: `f64` (default) or `f32`, chosen at run time by instantiating
//! the same generic code twice, and the few operations on 3-vectors and 3x3 matrices that the
//! kernels need.
//!
//! Kernels work on `[S; 3]` and row-major `[S; 9]` rather than on glam types so that one source
//! serves both precisions and SIMD lanes; glam is the vocabulary of the public edge.

use crate::lanes::sealed::Registers;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fmt::{Debug, Display, LowerExp};
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// Real numbers of one or several lanes: what the element functions are written in, so that one
/// source serves `f32`, `f64` and the vector registers of [`crate::lanes`].
pub trait Real:
    Copy
    + Debug
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
{
    /// Result of a comparison, lane by lane.
    type Mask: Copy;
    /// Zero.
    const ZERO: Self;
    /// One.
    const ONE: Self;
    /// Nearest value to `x`, in every lane.
    fn from_f64(x: f64) -> Self;
    /// `self * b + c`, rounded once where the machine can; `f32` and `f64`, the registers of the portable set,
    /// round twice everywhere.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// `1 / self` of a finite normal number, to two units in the last place: cheaper than a division
    /// where the machine has an estimate to start from.
    #[inline(always)]
    fn recip(self) -> Self {
        Self::ONE / self
    }
    /// `1 / sqrt(self)` of a finite positive normal number, to two units in the last place.
    #[inline(always)]
    fn recip_sqrt(self) -> Self {
        Self::ONE / self.sqrt()
    }
    /// Absolute value.
    fn abs(self) -> Self;
    /// Larger of two numbers.
    fn max(self, other: Self) -> Self;
    /// Smaller of two numbers.
    fn min(self, other: Self) -> Self;
    /// `self < other`; false where either is not a number.
    fn less(self, other: Self) -> Self::Mask;
    /// `yes` where the mask holds, `no` elsewhere.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// Whether the mask holds anywhere.
    fn any(mask: Self::Mask) -> bool;
    /// Where both masks hold.
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Where either mask holds.
    fn either(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Carries out a calculation as a function of its own.
    fn apart<C: Calculation<Self>>(calculation: C) -> C::Output;
}

/// A calculation that many kernels share and that is long: compiled once for each type of number ([`Real::apart`]).
pub trait Calculation<R: Real> {
    /// Result.
    type Output;
    /// Does it; mark implementations `#[inline(always)]`.
    fn run(self) -> Self::Output;
}

#[inline(never)]
fn run_apart<R: Real, C: Calculation<R>>(calculation: C) -> C::Output {
    calculation.run()
}

/// A floating-point type in which a simulation can be carried out.
pub trait Scalar:
    Real<Mask = bool>
    + Default
    + Display
    + LowerExp
    + PartialOrd
    + bytemuck::Pod
    + Registers
    + Serialize
    + DeserializeOwned
{
    /// Unit round-off times two (distance from 1 to the next larger number).
    const EPSILON: Self;
    /// `"f32"` or `"f64"`.
    const NAME: &'static str;
    /// Four of them.
    type Row: Row<Self>;
    /// Exact widening.
    fn to_f64(self) -> f64;
    /// Neither infinite nor NaN.
    fn is_finite(self) -> bool;
}

/// Four numbers in one register, where the machine has such: a row of a 3x3 block or of a field, and one number more.
/// Operations are entry by entry and round like those of single numbers.
pub trait Row<S>:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Send + Sync + 'static
{
    /// From four numbers that lie in memory: built from computed ones it would wait for them to get there.
    fn new(x: [S; 4]) -> Self;
    /// The same number four times.
    fn splat(x: S) -> Self;
    /// The numbers.
    fn to_array(self) -> [S; 4];
    /// Sums of the entries of three rows and a zero; each is `(x[0] + x[2]) + (x[1] + x[3])`.
    fn sums(rows: [Self; 3]) -> Self;
}

macro_rules! scalar {
    ($t:ident, $row:ty, $matrix:ty) => {
        impl Row<$t> for $row {
            #[inline(always)]
            fn new(x: [$t; 4]) -> Self {
                // one load, where entries one by one would be shuffled together
                bytemuck::must_cast(x)
            }
            #[inline(always)]
            fn splat(x: $t) -> Self {
                Self::splat(x)
            }
            #[inline(always)]
            fn to_array(self) -> [$t; 4] {
                bytemuck::must_cast(self)
            }
            #[inline(always)]
            fn sums([x, y, z]: [Self; 3]) -> Self {
                let m = <$matrix>::from_cols(x, y, z, Self::ZERO).transpose();
                (m.x_axis + m.z_axis) + (m.y_axis + m.w_axis)
            }
        }

        impl Real for $t {
            type Mask = bool;
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            #[inline(always)]
            fn apart<C: Calculation<Self>>(calculation: C) -> C::Output {
                run_apart(calculation)
            }
            #[inline(always)]
            fn from_f64(x: f64) -> Self {
                x as $t
            }
            #[inline(always)]
            fn mul_add(self, b: Self, c: Self) -> Self {
                // a library call where the compiler may not assume the instruction
                self * b + c
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                $t::sqrt(self)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                $t::abs(self)
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }
            #[inline(always)]
            fn less(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
            fn select(mask: bool, yes: Self, no: Self) -> Self {
                if mask { yes } else { no }
            }
            #[inline(always)]
            fn any(mask: bool) -> bool {
                mask
            }
            #[inline(always)]
            fn both(a: bool, b: bool) -> bool {
                a & b
            }
            #[inline(always)]
            fn either(a: bool, b: bool) -> bool {
                a | b
            }
        }

        impl Scalar for $t {
            const EPSILON: Self = $t::EPSILON;
            const NAME: &'static str = stringify!($t);
            type Row = $row;
            #[inline(always)]
            fn to_f64(self) -> f64 {
                self as f64
            }
            #[inline(always)]
            fn is_finite(self) -> bool {
                $t::is_finite(self)
            }
        }
    };
}
scalar!(f32, glam::Vec4, glam::Mat4);
scalar!(f64, glam::DVec4, glam::DMat4);

/// The number type of worlds with [`Precision::F32`](crate::precision::Precision::F32). In WebAssembly there are none, so that nothing is compiled
/// twice: a page loads half as much.
#[cfg(not(target_arch = "wasm32"))]
pub type Single = f32;
/// The number type of worlds with [`Precision::F32`](crate::precision::Precision::F32): there are none.
#[cfg(target_arch = "wasm32")]
pub type Single = f64;

/// Calls the generic `$function` for `f64` or `f32`, whichever `$S` is, through two functions that are
/// not generic: it is then compiled in the crate that holds it and not again in every crate and test that
/// uses it, which for functions that reach all kernels saves minutes.
#[macro_export]
macro_rules! compiled_here {
    ($S:ident, $function:ident($($argument:ident: $type:ty),*) $(-> $result:ty)?) => {{
        #[inline(never)]
        fn double($($argument: $type),*) $(-> $result)? {
            $function::<f64>($($argument),*)
        }
        #[inline(never)]
        fn single($($argument: $type),*) $(-> $result)? {
            $function::<$crate::scalar::Single>($($argument),*)
        }
        let is_double = size_of::<$S>() == size_of::<f64>();
        if is_double { double($($argument),*) } else { single($($argument),*) }
    }};
}

/// Sum of two vectors.
#[inline(always)]
pub fn add<S: Real>(a: [S; 3], b: [S; 3]) -> [S; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Difference of two vectors.
#[inline(always)]
pub fn sub<S: Real>(a: [S; 3], b: [S; 3]) -> [S; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Vector times number.
#[inline(always)]
pub fn scale<S: Real>(a: [S; 3], s: S) -> [S; 3] {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// Scalar product.
#[inline(always)]
pub fn dot<S: Real>(a: [S; 3], b: [S; 3]) -> S {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

/// Vector product.
#[inline(always)]
pub fn cross<S: Real>(a: [S; 3], b: [S; 3]) -> [S; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// First three entries of a padded row.
#[inline(always)]
pub fn xyz<S: Copy>(a: [S; 4]) -> [S; 3] {
    [a[0], a[1], a[2]]
}

/// Row-major 3x3 matrix times vector.
#[inline(always)]
pub fn mat_vec<S: Real>(m: &[S; 9], v: [S; 3]) -> [S; 3] {
    [dot([m[0], m[1], m[2]], v), dot([m[3], m[4], m[5]], v), dot([m[6], m[7], m[8]], v)]
}
