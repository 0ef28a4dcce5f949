//! Springs of single elements.

use glam::DVec3;
use sinew::engine::mesh::generate::{box_tets, quad_grid, triangle_grid};
use sinew::models::material::YoungPoisson;
use sinew_scene::cell_springs::{CellFibres, CellSpring, SpringTable};

const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 1e4, poisson_ratio: 1.0 / 3.0, density: 1000.0 };

/// All 21 together give the energy of a strain: a uniform stretch by `s` of a tetrahedron stores
/// `V (9/2 lambda + 3 mu) ((s^2 - 1)/2)^2`.
#[test]
fn the_springs_of_a_tetrahedron_store_the_energy_of_the_material() {
    let mesh = box_tets([1.0, 2.0, 0.5].into(), [1, 1, 1]).unwrap();
    let table = SpringTable::of(&mesh, MATERIAL, None, None, &[2]).unwrap();
    let cell = &table.cells[0];
    let strain: f64 = 0.5 * (1.1 * 1.1 - 1.0);
    let change = |e: [u32; 2]| {
        let [a, b] = e.map(|v| mesh.points[v as usize]);
        2.0 * strain * a.distance_squared(b)
    };
    let energy = |s: &CellSpring| match &s.edges[..] {
        [e] => 0.25 * s.biquadratic * change(*e).powi(2),
        [e, f] => 0.5 * s.biquadratic * change(*e) * change(*f),
        _ => unreachable!(),
    };
    let found: f64 = cell.springs.iter().map(energy).sum();
    let lame = MATERIAL.lame().unwrap();
    let volume = 1.0 / 6.0;
    let expected = volume * (4.5 * lame.lambda + 3.0 * lame.mu) * strain * strain;
    assert!((found / expected - 1.0).abs() < 1e-12, "{found} {expected}");
    let text = table.to_string();
    assert!(text.contains("volumetric") && text.lines().count() == 2 + 2 + 21, "{text}");
}

/// Fibres add to the constants, as many as there are: a stretch along them stores `V Y/2 ((s^2 - 1)/2)^2` more.
#[test]
fn fibres_add_to_the_springs() {
    let mesh = box_tets([1.0, 2.0, 0.5].into(), [1, 1, 1]).unwrap();
    let direction = DVec3::new(1.0, 2.0, -0.5);
    let fibres = Some(CellFibres { direction: direction.to_array(), modulus: 3e4 });
    let table = SpringTable::of(&mesh, MATERIAL, fibres, None, &[2]).unwrap();
    let plain = SpringTable::of(&mesh, MATERIAL, None, None, &[2]).unwrap();
    let unit = direction.normalize();
    let stretched = |x: DVec3| x + 0.2 * unit * unit.dot(x);
    let change = |e: [u32; 2]| {
        let [a, b] = e.map(|v| mesh.points[v as usize]);
        stretched(a).distance_squared(stretched(b)) - a.distance_squared(b)
    };
    let mut energy = 0.0;
    for (with, without) in table.cells[0].springs.iter().zip(&plain.cells[0].springs) {
        let own = with.of_fibres.unwrap();
        assert!(
            (with.biquadratic - without.biquadratic - own).abs() <= 1e-12 * with.biquadratic.abs()
        );
        assert_eq!(without.of_fibres, None);
        energy += match &with.edges[..] {
            [e] => 0.25 * own * change(*e).powi(2),
            [e, f] => 0.5 * own * change(*e) * change(*f),
            _ => unreachable!(),
        };
    }
    let strain: f64 = 0.5 * (1.2 * 1.2 - 1.0);
    let expected = 0.5 * 3e4 * strain * strain / 6.0;
    assert!((energy / expected - 1.0).abs() < 1e-12, "{energy} {expected}");
    let text = table.to_string();
    assert!(text.contains("fibres of 30000 Pa") && text.contains("of fibres (N/m^3)"), "{text}");
    let none = Some(CellFibres { direction: [0.0; 3], modulus: 1.0 });
    let error = SpringTable::of(&mesh, MATERIAL, none, None, &[0]).unwrap_err().to_string();
    assert!(error.contains("--fibre"), "{error}");
    let sheet = triangle_grid([1.0, 1.0].into(), [1, 1]).unwrap();
    let of = |direction| {
        let fibres = Some(CellFibres { direction, modulus: 3e4 });
        SpringTable::of(&sheet, MATERIAL, fibres, Some(1e-3), &[0])
    };
    // the part in the plane counts
    assert_eq!(of([1.0, 1.0, 0.0]).unwrap().cells, of([2.0, 2.0, 5.0]).unwrap().cells);
    let error = of([0.0, 0.0, 1.0]).unwrap_err().to_string();
    assert!(error.contains("square to it"), "{error}");
}

/// On equilateral triangles at a Poisson's ratio of 1/3 nothing but the edges is left.
#[test]
fn sheets_have_springs_too() {
    let mut mesh = triangle_grid([1.0, 1.0].into(), [1, 1]).unwrap();
    mesh.points = vec![DVec3::ZERO, DVec3::X, DVec3::new(0.5, 0.75_f64.sqrt(), 0.0)];
    mesh.triangles = vec![[0, 1, 2]];
    mesh.groups.clear();
    let table = SpringTable::of(&mesh, MATERIAL, None, Some(0.001), &[0]).unwrap();
    let springs = &table.cells[0].springs;
    let size = |kind: &str| {
        let own = springs.iter().filter(|s| s.kind == kind).map(|s| s.biquadratic.abs());
        own.fold(0.0, f64::max)
    };
    assert_eq!(springs.len(), 6);
    assert!(size("angular") < 1e-12 * size("tensile"), "{springs:?}");
    let error = SpringTable::of(&mesh, MATERIAL, None, None, &[0]).unwrap_err().to_string();
    assert!(error.contains("--thickness"), "{error}");
    let quads = quad_grid([1.0, 1.0].into(), [1, 1]).unwrap();
    let error = SpringTable::of(&quads, MATERIAL, None, Some(0.001), &[0]).unwrap_err();
    assert!(error.to_string().contains("`sinew fit`"), "{error}");
}
