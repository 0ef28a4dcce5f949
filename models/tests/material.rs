//! Constants of materials: what is refused, what is found, presets.

use sinew_models::material::field::{FieldError, MaterialField};
use sinew_models::material::{
    LameParameters, MAX_POISSON_RATIO, MaterialError, YoungPoisson, preset, presets,
};

const GOOD: YoungPoisson = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1000.0 };

#[test]
fn lame_parameters_give_back_young_and_poisson() {
    for nu in [-0.9, -0.2, 0.0, 0.3, 0.45, 0.49, MAX_POISSON_RATIO] {
        let LameParameters { lambda, mu } =
            YoungPoisson { poisson_ratio: nu, ..GOOD }.lame().unwrap();
        let e = mu * (3.0 * lambda + 2.0 * mu) / (lambda + mu);
        assert!((e / 1e4 - 1.0).abs() < 1e-12, "{e}");
        // Forming lambda + mu cancels nothing; 1 - 2 nu loses what nu lost as a decimal.
        assert!((lambda / (2.0 * (lambda + mu)) - nu).abs() < 1e-12);
    }
}

#[test]
fn each_bad_value_has_its_own_error_with_value_and_remedy() {
    let cases = [
        (YoungPoisson { young_modulus: f64::NAN, ..GOOD }, "Young's modulus is NaN", "finite"),
        (YoungPoisson { density: f64::INFINITY, ..GOOD }, "density is inf", "finite"),
        (YoungPoisson { young_modulus: 0.0, ..GOOD }, "is 0 Pa", "positive"),
        (YoungPoisson { young_modulus: -3.0, ..GOOD }, "-3 Pa", "positive"),
        (YoungPoisson { poisson_ratio: -1.0, ..GOOD }, "is -1:", "above -1"),
        (YoungPoisson { poisson_ratio: 0.5, ..GOOD }, "is 0.5:", "below 0.5"),
        (YoungPoisson { poisson_ratio: 0.49995, ..GOOD }, "0.49995", "clusters"),
        (YoungPoisson { density: 0.0, ..GOOD }, "density is 0 kg/m^3", "positive"),
    ];
    for (material, value, remedy) in cases {
        let message = material.validate().unwrap_err().to_string();
        assert!(message.contains(value) && message.contains(remedy), "{message}");
        assert!(material.lame().is_err());
    }
    assert_eq!(GOOD.validate(), Ok(()));
}

#[test]
fn findings_name_the_likely_slip() {
    let codes = |m: YoungPoisson| m.findings().iter().map(|f| f.code).collect::<Vec<_>>();
    assert!(codes(GOOD).is_empty());
    assert_eq!(codes(YoungPoisson { young_modulus: 5.0, ..GOOD }), ["material.young.range"]);
    assert_eq!(codes(YoungPoisson { young_modulus: 25.0, ..GOOD }), ["material.young.kilopascal"]);
    assert_eq!(codes(YoungPoisson { young_modulus: 2e11, ..GOOD }), ["material.young.range"]);
    assert_eq!(codes(YoungPoisson { poisson_ratio: 0.495, ..GOOD }), ["material.poisson.locking"]);
    assert_eq!(codes(YoungPoisson { poisson_ratio: -0.1, ..GOOD }), ["material.poisson.auxetic"]);
    assert_eq!(codes(YoungPoisson { density: 1.06, ..GOOD }), ["material.density.unit"]);
    assert_eq!(codes(YoungPoisson { density: 30_000.0, ..GOOD }), ["material.density.range"]);
}

#[test]
fn presets_are_usable_sourced_and_sorted() {
    for preset in presets() {
        assert_eq!(preset.material.validate(), Ok(()));
        assert!(preset.material.findings().is_empty(), "{}", preset.name);
        assert!(preset.note.contains("ssumed") && !preset.source.is_empty());
    }
    assert!(presets().windows(2).all(|w| w[0].name < w[1].name));
}

#[test]
fn unknown_presets_are_answered_with_names() {
    let suggestions = |name| match preset(name).unwrap_err() {
        MaterialError::UnknownPreset { suggestions, .. } => suggestions,
        other => panic!("{other}"),
    };
    assert_eq!(suggestions("livr"), ["liver"]);
    assert_eq!(suggestions("cardiac muscle"), ["muscle"]);
    assert_eq!(suggestions("steel").len(), presets().len());
    assert_eq!(preset(" KIDNEY ").unwrap().name, "kidney");
}

#[test]
fn bad_values_name_the_tetrahedron() {
    let base = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1e3 };
    let bad = [0.3, 0.5, 0.3];
    let field = MaterialField { poisson_ratio: Some(&bad), ..base.into() };
    let error = field.validate(3, 0).unwrap_err();
    assert_eq!(
        error,
        FieldError::Tetrahedron {
            tetrahedron: 1,
            source: Box::new(MaterialError::PoissonRatioTooHigh { value: 0.5 })
        }
    );
    assert!(error.to_string().contains("tetrahedron 1"), "{error}");
    let error = field.validate(2, 0).unwrap_err();
    assert!(error.to_string().contains("3 values for 2 solid elements"), "{error}");
    let bad = [1e3, f64::NAN];
    let field = MaterialField { density: Some(&bad), ..base.into() };
    assert!(matches!(field.validate(2, 0), Err(FieldError::Tetrahedron { tetrahedron: 1, .. })));
    let error = field.validate(1, 1).unwrap_err();
    assert!(error.to_string().contains("hexahedron 0"), "{error}");
    let field = MaterialField { young_modulus: Some(&bad[..1]), ..base.into() };
    assert_eq!(field.lame(1, 0).unwrap().len(), 1);
}
