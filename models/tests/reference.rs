//! Comparison with reference vectors computed elsewhere, by other routes: tetrahedra with the
//! energy differentiated automatically and checked in 50-digit arithmetic, and the compression curve of
//! Delingette 2008 (Fig. 2, left). Single elements of a finite element program are in
//! `demos/scene/tests/validation.rs`.
//!
//! Units of the errors: energy `E V`, force `E V^(2/3)`, matrices their largest entry.

use crate::common;

use common::json::{flat, number, numbers, rows};
use common::{Worst, max_abs, max_difference, reference};
use sinew_models::element::precompute::{
    ADJACENT_EDGES, ADJACENT_PAIRS, EDGES, OPPOSITE_EDGES, OPPOSITE_PAIRS, RestTetrahedron,
    SpringConstants,
};
use sinew_models::element::spring;
use sinew_models::element::tetrahedron::{self, Element, TangentKind, compression};
use sinew_models::frame::law::TetrahedronLaw;
use sinew_models::laws::quadratic::QuadraticSprings;
use sinew_models::material::{LameParameters, YoungPoisson};

const TOLERANCE: f64 = 1e-9;

struct Case {
    rest_points: [[f64; 3]; 4],
    rest: RestTetrahedron,
    lame: LameParameters,
    element: Element<f64>,
    energy_unit: f64,
    force_unit: f64,
}

impl Case {
    fn new(rest_points: [[f64; 3]; 4], young_modulus: f64, poisson_ratio: f64) -> Self {
        let rest = RestTetrahedron::new(rest_points).unwrap();
        let material = YoungPoisson { young_modulus, poisson_ratio, density: 1000.0 };
        let lame = material.lame().unwrap();
        Self {
            rest_points,
            rest,
            lame,
            element: Element::new(&rest, lame, true),
            energy_unit: young_modulus * rest.volume,
            force_unit: young_modulus * rest.volume.powf(2.0 / 3.0),
        }
    }

    fn displacement(&self, deformed: [[f64; 3]; 4]) -> [[f64; 3]; 4] {
        std::array::from_fn(|a| std::array::from_fn(|x| deformed[a][x] - self.rest_points[a][x]))
    }
}

#[test]
fn pair_orders_are_those_of_the_reference() {
    let file = reference("tetrahedra.json");
    let indices = |key: &str| flat(&file[key]).iter().map(|&x| x as usize).collect::<Vec<_>>();
    assert_eq!(indices("edge_order"), EDGES.as_flattened());
    assert_eq!(indices("adjacent_pairs"), ADJACENT_PAIRS.as_flattened());
    assert_eq!(indices("opposite_pairs"), OPPOSITE_PAIRS.as_flattened().as_flattened());
}

#[test]
fn tetrahedra() {
    let mut worst = Worst::default();
    let file = reference("tetrahedra.json");
    for case in file["cases"].as_array().unwrap() {
        let name = case["name"].as_str().unwrap();
        let c = Case::new(rows(&case["rest"]), number(&case["E"]), number(&case["nu"]));
        let u = c.displacement(rows(&case["deformed"]));
        let stvk = Element { compression: 0.0, ..c.element };

        // Rest shape and material.
        worst.same(
            "Lamé parameters",
            &[c.lame.lambda, c.lame.mu],
            &[number(&case["lambda"]), number(&case["mu"])],
            name,
        );
        worst.same("rest volume", &[c.rest.volume], &[number(&case["rest_volume"])], name);
        let gradients = c.rest.gradients.as_flattened();
        worst.same("shape vectors", gradients, &flat(&case["shape_vectors"]), name);

        // Springs.
        let tbs = &case["tbs"];
        let springs = SpringConstants::new(&c.rest, c.lame);
        worst.same("k", &springs.tensile, &numbers(&tbs["k"]), name);
        worst.same("c", &springs.angular, &numbers(&tbs["c"]), name);
        // For a regular shape and nu = 0 some d vanish: measured against k.
        let k_unit = max_abs(&springs.tensile);
        worst.note("d", max_difference(&springs.volumetric, &numbers(&tbs["d"])), k_unit, name);
        let mut delta = [0.0; 6];
        for e in 0..6 {
            let [a, b] = EDGES[e];
            let rest = sinew_engine::scalar::sub(c.rest_points[a], c.rest_points[b]);
            delta[e] = spring::squared_length_change(rest, u[a], u[b]);
        }
        let size = max_abs(&numbers(&case["rest_len2"]));
        worst.note("delta", max_difference(&delta, &numbers(&tbs["delta2"])), size, name);
        let mut tension = [0.0; 6];
        let mut unit = 0.0;
        for (e, row) in springs.matrix().iter().enumerate() {
            for f in 0..6 {
                tension[e] += row[f] * delta[f];
                unit += (row[f] * delta[f]).abs();
            }
        }
        // Small strains leave the reference's own delta with few digits: the unit is its size
        // before cancellation.
        let unit = unit.max(k_unit * size);
        worst.beside("edge tension", &tension, &numbers(&tbs["edge_tension"]), unit, name);

        // Elastic element.
        let (w, f) = (tetrahedron::energy(&stvk, &u), tetrahedron::forces(&stvk, &u));
        worst.note("energy", (w - number(&tbs["energy"])).abs(), c.energy_unit, name);
        worst.beside("forces", f.as_flattened(), &flat(&tbs["forces"]), c.force_unit, name);
        let exact = tetrahedron::tangent(&stvk, &u, TangentKind::Exact).to_dense();
        let hessian = flat(&tbs["hessian"]);
        worst.same("exact tangent", exact.as_flattened(), &hessian, name);
        let gauss_newton = tetrahedron::tangent(&stvk, &u, TangentKind::GaussNewton).to_dense();
        let material = flat(&tbs["hessian_material"]);
        worst.same("material tangent", gauss_newton.as_flattened(), &material, name);

        // Quadratic springs; where an edge has no length their tangent is singular.
        let tqs = &case["tqs"];
        let chi: Vec<f64> =
            (0..6).map(|e| 4.0 * springs.tensile[e] * number(&case["rest_len2"][e])).collect();
        worst.same("chi", &chi, &numbers(&tqs["chi_printed"]), name);
        let w_tqs = QuadraticSprings::energy(&stvk, &u);
        worst.note("TQS energy", (w_tqs - number(&tqs["energy"])).abs(), c.energy_unit, name);
        let f_tqs = QuadraticSprings::forces(&stvk, &u).unwrap();
        worst.beside("TQS forces", f_tqs.as_flattened(), &flat(&tqs["forces"]), c.force_unit, name);
        let t_tqs = QuadraticSprings::tangent(&stvk, &u, TangentKind::Exact).to_dense();
        worst.same("TQS tangent", t_tqs.as_flattened(), &flat(&tqs["hessian"]), name);

        // Compression term, alone and in the sum.
        let comp = &case["compression"];
        let j = tetrahedron::volume_ratio(&c.element, &u);
        let j_unit = number(&comp["J"]).abs().max(1.0);
        worst.note("J", (j - number(&comp["J"])).abs(), j_unit, name);
        let w_comp = compression::energy(&c.element, &u);
        let theirs = number(&comp["energy"]);
        worst.note("compression energy", (w_comp - theirs).abs(), c.energy_unit, name);
        let f_comp = compression::forces(&c.element, &u);
        worst.beside(
            "compression forces",
            f_comp.as_flattened(),
            &flat(&comp["forces"]),
            c.force_unit,
            name,
        );
        // Near J = 1 this tangent is tiny and its terms J - 1 noise: the unit is the elastic one.
        let k_unit = max_abs(&hessian);
        let k_comp = compression::tangent(&c.element, &u, TangentKind::Exact).to_dense();
        let theirs = flat(&comp["hessian"]);
        let error = max_difference(k_comp.as_flattened(), &theirs);
        worst.note("compression exact tangent", error, k_unit.max(max_abs(&theirs)), name);
        let k_comp = compression::tangent(&c.element, &u, TangentKind::GaussNewton).to_dense();
        let theirs = flat(&comp["hessian_gauss_newton"]);
        let error = max_difference(k_comp.as_flattened(), &theirs);
        worst.note("compression Gauss-Newton", error, k_unit.max(max_abs(&theirs)), name);

        let (w_all, f_all) =
            (tetrahedron::energy(&c.element, &u), tetrahedron::forces(&c.element, &u));
        worst.note("sum energy", (w_all - w - w_comp).abs(), c.energy_unit, name);
        for a in 0..4 {
            for x in 0..3 {
                let error = (f_all[a][x] - f[a][x] - f_comp[a][x]).abs();
                worst.note("sum forces", error, c.force_unit, name);
            }
        }
        let sums = [
            (TangentKind::Exact, &hessian, flat(&comp["hessian"])),
            (TangentKind::GaussNewton, &material, flat(&comp["hessian_gauss_newton"])),
        ];
        for (kind, elastic, more) in sums {
            let k = tetrahedron::tangent(&c.element, &u, kind).to_dense();
            let sum: Vec<f64> = elastic.iter().zip(&more).map(|(a, b)| a + b).collect();
            worst.same("sum tangents", k.as_flattened(), &sum, name);
        }
    }
    worst.check(TOLERANCE);
}

#[test]
fn pooled_pair_tables_give_the_matrix() {
    let rest =
        RestTetrahedron::new([[0.1, 0.0, 0.2], [1.0, 0.1, 0.0], [0.0, 0.9, 0.1], [0.2, 0.3, 1.1]])
            .unwrap();
    let springs = SpringConstants::new(&rest, LameParameters { lambda: 2.0, mu: 1.0 });
    let delta = [0.1, -0.2, 0.3, 0.05, -0.15, 0.25];
    let mut tension = [0.0; 6];
    let mut energy = 0.0;
    for e in 0..6 {
        tension[e] += spring::tensile_tension(springs.tensile[e], delta[e]);
        energy += spring::tensile_energy(springs.tensile[e], delta[e]);
    }
    let angular = springs.angular.iter().zip(ADJACENT_EDGES);
    let volumetric = springs.volumetric.iter().zip(OPPOSITE_EDGES);
    for (&c, [e, f]) in angular.chain(volumetric) {
        let [to_e, to_f] = spring::coupling_tensions(c, delta[e], delta[f]);
        tension[e] += to_e;
        tension[f] += to_f;
        energy += spring::coupling_energy(c, delta[e], delta[f]);
    }
    let b = springs.matrix();
    let mut half_product = 0.0;
    for e in 0..6 {
        let mut row = 0.0;
        for f in 0..6 {
            row += b[e][f] * delta[f];
        }
        assert!((row - tension[e]).abs() < 1e-15);
        half_product += 0.5 * row * delta[e];
    }
    assert!((half_product - energy).abs() < 1e-15);
}

#[test]
fn compression_curve() {
    let mut worst = Worst::default();
    let file = reference("compression_curve.json");
    for case in file["cases"].as_array().unwrap() {
        let name = case["name"].as_str().unwrap();
        let c = Case::new(rows(&case["rest"]), number(&case["E"]), number(&case["nu"]));
        let stvk = Element { compression: 0.0, ..c.element };
        let moving = number(&case["moving_vertex"]) as usize;
        assert_eq!(moving, 3);
        // The altitude runs along the shape vector, with length 1/|D|.
        let d = c.rest.gradients[moving];
        let length = sinew_engine::scalar::dot(d, d).sqrt();
        worst.note("altitude", (1.0 / length - number(&case["altitude"])).abs(), 1.0, name);
        let (force_svk, force_comp) = (numbers(&case["force_svk"]), numbers(&case["force_comp"]));
        let (energy_svk, energy_comp) =
            (numbers(&case["energy_svk"]), numbers(&case["energy_comp"]));
        for (n, s) in numbers(&case["s"]).into_iter().enumerate() {
            let mut u = [[0.0; 3]; 4];
            u[moving] = d.map(|x| (s - 1.0) * x / (length * length));
            let j = tetrahedron::volume_ratio(&c.element, &u);
            worst.note("J", (j - s).abs(), 1.0, name);
            let parts = [
                (tetrahedron::energy(&stvk, &u), tetrahedron::forces(&stvk, &u)),
                (compression::energy(&c.element, &u), compression::forces(&c.element, &u)),
            ];
            let theirs = [(energy_svk[n], force_svk[n]), (energy_comp[n], force_comp[n])];
            for ((w, f), (w_ref, f_ref)) in parts.into_iter().zip(theirs) {
                let outward = sinew_engine::scalar::dot(f[moving], d) / length;
                worst.note("energy", (w - w_ref).abs(), c.energy_unit, name);
                worst.note("force", (outward - f_ref).abs(), c.force_unit, name);
            }
        }
    }
    worst.check(TOLERANCE);
}
