//! Operations per element, counted and not estimated: the element functions run once with a number
//! type that counts. A multiplication, an addition, a division and a square root count one each,
//! a fused
//! multiply-add two, comparisons and sign changes nothing.

use sinew::engine::scalar::{Calculation, Real};
use sinew::models::element::precompute::RestTetrahedron;
use sinew::models::element::tetrahedron::{self, Element};
use sinew::models::material::YoungPoisson;
use std::cell::Cell;
use std::hint::black_box;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

/// A number that counts what is done to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Counted(pub f64);

fn counted(x: f64) -> Counted {
    COUNT.set(COUNT.get() + 1);
    Counted(x)
}

/// Operations of a function of counted numbers.
pub fn count<R>(run: impl FnOnce() -> R) -> u64 {
    COUNT.set(0);
    black_box(run());
    COUNT.get()
}

macro_rules! operator {
    ($name:ident, $method:ident, $assign:ident, $assign_method:ident) => {
        impl $name for Counted {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                counted(self.0.$method(other.0))
            }
        }
        impl $assign for Counted {
            fn $assign_method(&mut self, other: Self) {
                *self = self.$method(other);
            }
        }
    };
}
operator!(Add, add, AddAssign, add_assign);
operator!(Sub, sub, SubAssign, sub_assign);
operator!(Mul, mul, MulAssign, mul_assign);

impl Div for Counted {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        counted(self.0 / other.0)
    }
}

impl Neg for Counted {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Real for Counted {
    type Mask = bool;
    const ZERO: Self = Self(0.0);
    const ONE: Self = Self(1.0);
    fn from_f64(x: f64) -> Self {
        Self(x)
    }
    fn mul_add(self, b: Self, c: Self) -> Self {
        self * b + c
    }
    fn sqrt(self) -> Self {
        counted(self.0.sqrt())
    }
    fn abs(self) -> Self {
        Self(self.0.abs())
    }
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0))
    }
    fn less(self, other: Self) -> bool {
        self.0 < other.0
    }
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    fn any(mask: bool) -> bool {
        mask
    }
    fn both(a: bool, b: bool) -> bool {
        a & b
    }
    fn either(a: bool, b: bool) -> bool {
        a | b
    }
    fn apart<C: Calculation<Self>>(calculation: C) -> C::Output {
        calculation.run()
    }
}

/// Operations per tetrahedron of the fused law, in the formulas of `sinew_models::element::tetrahedron`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ElementFlops {
    /// Energy.
    pub energy: u64,
    /// Forces and adding them up.
    pub forces: u64,
    /// Exact tangent and adding its ten blocks up.
    pub tangent: u64,
    /// Forces of the compression term alone and adding them up.
    pub compression: u64,
}

impl ElementFlops {
    /// Counts, with or without the compression term, in a compressed element.
    pub fn count(compression: bool) -> Self {
        let zero = Self { energy: 0, forces: 0, tangent: 0, compression: 0 };
        let corner = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let material = YoungPoisson { young_modulus: 1.0, poisson_ratio: 0.3, density: 1.0 };
        let (Ok(rest), Ok(lame)) = (RestTetrahedron::new(corner), material.lame()) else {
            return zero;
        };
        let plain = Element::<f64>::new(&rest, lame, compression);
        let gradients = plain.gradients.map(|d| d.map(Counted));
        let moduli = [plain.lambda, plain.mu, plain.compression].map(Counted);
        let e = Element::plain(gradients, Counted(plain.volume), moduli);
        let squeezed = corner.map(|x| [-0.1, -0.2, 0.1].map(|s| Counted(s * (x[0] + x[1] - x[2]))));
        Self {
            energy: count(|| tetrahedron::energy(&e, &squeezed)) + 1,
            forces: count(|| tetrahedron::forces(&e, &squeezed)) + 12,
            tangent: count(|| tetrahedron::exact_tangent(&e, &squeezed)) + 90,
            compression: count(|| tetrahedron::compression::forces(&e, &squeezed)) + 12,
        }
    }
}

/// Operations of the force of pooled springs, with or without the compression term. Per edge: change of squared
/// length 14, tension 2, force 4, adding it to both ends 6, adding the tensile tension 1; per triangle
/// (angular) and per tetrahedron (volumetric): three pairs of springs with 4 operations and 2 additions
/// to sums of tensions each, and one addition to the tension of every edge.
pub fn pooled_flops(edges: f64, triangles: f64, tetrahedra: f64, compressible: bool) -> f64 {
    let compression = if compressible { ElementFlops::count(true).compression as f64 } else { 0.0 };
    27.0 * edges + 21.0 * triangles + (24.0 + compression) * tetrahedra
}
