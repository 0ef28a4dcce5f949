//! Advice on settings.

use sinew_scene::scene::LoadedScene;
use sinew_tune::advise::{Request, advise, parse_budget, parse_error};
use std::path::Path;

#[test]
fn budgets_and_errors_are_read() {
    assert_eq!(parse_budget("16ms"), Ok(0.016));
    assert_eq!(parse_budget(" 0.5 s"), Ok(0.5));
    assert_eq!(parse_budget("250us"), Ok(0.00025));
    assert_eq!(parse_budget("50fps"), Ok(0.02));
    assert_eq!(parse_error("2%"), Ok(0.02));
    for bad in ["16", "ms", "-1ms", "0ms", "1h", "nan s", "", "0fps"] {
        assert!(parse_budget(bad).unwrap_err().contains("16ms"), "{bad}");
    }
    for bad in ["2", "0%", "-1%", "%", "two%", "inf%", ""] {
        assert!(parse_error(bad).unwrap_err().contains("2%"), "{bad}");
    }
}

const SCENE: &str = r#"
    name = "small"
    dt = 0.02
    duration = 0.2
    [solver]
    mass_damping = 5.0
    [[body]]
    name = "beam"
    generate = { box = { size = [0.1, 0.05, 0.05], cells = [2, 1, 1] } }
    material = { young_modulus = 2e5, poisson_ratio = 0.4, density = 1000.0 }
    [[constraint]]
    name = "clamp"
    select = { group = "x0" }
"#;

#[test]
fn a_generous_request_is_met_and_an_absurd_one_is_not() {
    let scene = LoadedScene::parse(SCENE, Path::new("small.toml")).unwrap();
    let generous = Request { budget_s: 1.0, error: 0.02, mesh_error: None };
    let advice = advise(&scene, generous, |_| {}).unwrap();
    let best = &advice.rows[advice.best];
    assert!(advice.met && best.error_percent.unwrap() <= 2.0, "{}", advice.text(true));
    assert!(advice.text(false).contains(&best.options));
    // another energy is another material
    assert!(advice.rows.iter().all(|row| row.choice.model.is_none()), "{}", advice.text(true));
    // the command makes the same choice
    let mut again = scene.clone();
    best.choice.apply(&mut again);
    assert_eq!(again.scene.dt, best.choice.dt);

    let absurd = Request { budget_s: 1e-9, error: 0.02, mesh_error: None };
    let advice = advise(&scene, absurd, |_| {}).unwrap();
    assert!(!advice.met && advice.text(false).contains("CANNOT"));
}

#[test]
fn a_mesh_that_bends_is_found() {
    let scene = SCENE.replace("cells = [2, 1, 1] }", "cells = [4, 2, 2] }");
    let scene = scene.replace("0.4, density", "0.49, density");
    let scene = scene.replace("name = \"beam\"", "name = \"beam\"\nmodel = \"neo_hookean\"");
    let scene = LoadedScene::parse(&scene, Path::new("small.toml")).unwrap();
    let request = Request { budget_s: 1.0, error: 0.05, mesh_error: Some(0.05) };
    let advice = advise(&scene, request, |_| {}).unwrap();
    let cuts = advice.cuts.as_ref().unwrap();
    let text = advice.text(false);
    let of = |keys: &str| {
        let row = cuts.rows.iter().find(|row| row.keys == keys).unwrap();
        row.error_percent.unwrap()
    };
    // linear tetrahedra lock, clusters do so less, ten-node tetrahedra do not
    assert!(of("") > 1.2 * of("volume = \"clusters\""), "{text}");
    let quadratic = of("second_order = true, volume = \"clusters\"");
    assert!(quadratic < 5.0 && of("") > 4.0 * quadratic, "{text}");
    assert!(cuts.met && text.contains(&cuts.rows[cuts.best].keys), "{text}");
}
