//! Derivatives of moduli.

use sinew::models::material::YoungPoisson;
use sinew_tune::fit_data::gradient::split;

#[test]
fn the_derivative_of_the_moduli_is_split_exactly() {
    for (nu, other) in [(0.3, 0.0), (0.1, 0.4), (0.49, 0.0), (-0.3, 0.4)] {
        let lame = |nu: f64| {
            let m = YoungPoisson { young_modulus: 1.0, poisson_ratio: nu, density: 1.0 };
            m.lame().unwrap()
        };
        let (a, b) = split(nu, other);
        let h = 1e-6;
        let (up, down) = (lame(nu + h), lame(nu - h));
        let slopes = [(up.lambda - down.lambda) / (2.0 * h), (up.mu - down.mu) / (2.0 * h)];
        let found =
            [a * lame(nu).lambda + b * lame(other).lambda, a * lame(nu).mu + b * lame(other).mu];
        for (slope, found) in slopes.into_iter().zip(found) {
            assert!((found / slope - 1.0).abs() < 1e-7, "{nu}: {found} {slope}");
        }
    }
}
