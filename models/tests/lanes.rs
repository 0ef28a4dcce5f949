//! Kernels over registers of elements against the same functions one element at a time: every
//! instruction set of this machine, both number types, 1 to 33 elements, also degenerate ones.

use crate::common::{self, Columns, Motion, Sums};

use proptest::prelude::*;
use sinew_engine::lanes::{InstructionSet, Kernel, Lanes, MAX_LANES, dispatch_on};
use sinew_engine::scalar::Scalar;
use sinew_engine::workers::Workers;
use sinew_models::element::precompute::RestTetrahedron;
use sinew_models::element::tetrahedron::{Element, TangentKind};
use sinew_models::laws::svk::FusedStVK;
use sinew_models::material::YoungPoisson;

/// A strip of tetrahedra in which neighbours share three vertices, and its deformation.
#[derive(Clone)]
struct Strip {
    nodes: Vec<[u32; 4]>,
    rest: Vec<RestTetrahedron>,
    displacement: Vec<[f64; 4]>,
    compression: bool,
}

fn strip(count: usize, noise: &[f64], motion: Motion, compression: bool) -> Strip {
    let (points, nodes, moved) = common::strip(count, noise, motion);
    let shape = |t: &[u32; 4]| {
        RestTetrahedron::new(t.map(|v| points[v as usize].to_array())).expect("it has a volume")
    };
    let rest = nodes.iter().map(shape).collect();
    let displacement = moved.iter().map(|u| [u.x, u.y, u.z, 0.0]).collect();
    Strip { nodes, rest, displacement, compression }
}

impl Strip {
    /// Energy, forces, diagonal and off-diagonal blocks, clamped elements; from the kernels with an
    /// instruction set, or one by one without.
    fn evaluate<S: Scalar>(&self, kind: TangentKind, set: Option<InstructionSet>) -> Sums {
        let material = YoungPoisson { young_modulus: 1.0, poisson_ratio: 0.4, density: 1.0 };
        let lame = material.lame().unwrap();
        let elements: Vec<Element<S>> =
            self.rest.iter().map(|r| Element::new(r, lame, self.compression)).collect();
        let u: Vec<[S; 4]> = self.displacement.iter().map(|u| u.map(S::from_f64)).collect();
        let columns = Columns::new(&elements, self.nodes.clone(), u);
        match set {
            Some(set) => Sums::by_registers::<FusedStVK, S>(&columns, kind, set),
            None => Sums::one_by_one::<FusedStVK, S>(&elements, &columns, kind),
        }
    }
}

/// Largest difference over largest value.
fn off_by<const N: usize>(a: &[[f64; N]], b: &[[f64; N]], floor: f64) -> f64 {
    assert_eq!(a.len(), b.len());
    let scale = a.as_flattened().iter().fold(floor, |m, x| m.max(x.abs()));
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    pairs.fold(0.0, |m: f64, (x, y)| {
        assert!(x.is_finite() && y.is_finite());
        m.max((x - y).abs() / scale)
    })
}

fn compare<S: Scalar>(strip: &Strip) {
    let tolerance = 400.0 * S::EPSILON.to_f64();
    let largest = |m: &[[f64; 9]]| m.as_flattened().iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    // stiffness at rest times element size (1): what forces are made of before they cancel
    let rest = Strip { displacement: vec![[0.0; 4]; strip.displacement.len()], ..strip.clone() };
    let stiffness = largest(&rest.evaluate::<f64>(TangentKind::Exact, None).diagonal);
    for kind in common::KINDS {
        let expected = strip.evaluate::<S>(kind, None);
        for set in InstructionSet::available() {
            let found = strip.evaluate::<S>(kind, Some(set));
            let name = format!("{} {} {kind:?} {}", set.name(), S::NAME, strip.nodes.len());
            let scale = stiffness.max(largest(&expected.diagonal));
            assert!(off_by(&expected.force, &found.force, scale) < tolerance, "force {name}");
            assert!(
                off_by(&expected.diagonal, &found.diagonal, scale) < tolerance,
                "diagonal {name}"
            );
            assert!(off_by(&expected.off, &found.off, scale) < tolerance, "off-diagonal {name}");
            let energy = (expected.energy - found.energy).abs();
            assert!(
                energy <= tolerance * expected.energy.max(scale * 1e-3),
                "energy {name}: {energy}"
            );
            // an eigenvalue at the threshold may fall on either side
            assert!(expected.clamped.abs_diff(found.clamped) <= 1, "clamped {name}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn every_instruction_set_gives_what_single_elements_give(
        count in 1usize..=33,
        noise in prop::collection::vec(-1.0..1.0f64, 97),
        size in prop::sample::select(vec![1e-6, 1e-3, 0.1, 0.6, 3.0]),
        compression: bool,
    ) {
        let strip = strip(count, &noise, Motion::Random(size), compression);
        compare::<f64>(&strip);
        compare::<f32>(&strip);
    }
}

#[test]
fn every_remainder_and_degenerate_elements() {
    let noise = common::noise();
    for count in 1..=33 {
        for motion in [Motion::Rest, Motion::Random(0.3), Motion::Collapsed, Motion::Mirrored] {
            for compression in [false, true] {
                let strip = strip(count, &noise, motion, compression);
                compare::<f64>(&strip);
                compare::<f32>(&strip);
            }
        }
    }
}

#[test]
fn this_machine_is_told_apart() {
    let used = Workers::new(1).unwrap().instruction_set();
    assert!(used.is_available() && InstructionSet::Portable.is_available());
    assert_eq!(InstructionSet::default_set(), Ok(used));
    assert_eq!(Workers::serial().instruction_set(), used);
    for set in InstructionSet::ALL {
        assert_eq!(set.name().parse(), Ok(set));
        assert_eq!(Workers::serial().with_instruction_set(set).is_ok(), set.is_available());
    }
    let unknown = "AVX-512".parse::<InstructionSet>().unwrap_err().to_string();
    assert!(InstructionSet::ALL.iter().all(|set| unknown.contains(set.name())), "{unknown}");
}

/// One element at a time rounds product and sum apart, on machines that fuse them too.
#[test]
fn portable_arithmetic_is_not_fused() {
    struct Fused;
    impl Kernel<f64> for Fused {
        type Output = bool;
        #[inline(always)]
        fn run<L: Lanes<Scalar = f64>>(self) -> bool {
            let x = 1.0 + f64::EPSILON;
            let mut rest = [0.0; MAX_LANES];
            // 1 + 2 eps + eps^2 less its rounded value
            L::splat(x).mul_add(L::splat(x), -L::splat(x * x)).store(&mut rest);
            rest[0] != 0.0
        }
    }
    for set in InstructionSet::available() {
        assert_eq!(dispatch_on(set, Fused), set != InstructionSet::Portable, "{}", set.name());
    }
}
