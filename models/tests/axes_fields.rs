//! Fibre fields: where they come from, and what is refused.

use glam::DVec3;
use sinew_engine::mesh::Mesh;
use sinew_engine::mesh::generate::{
    box_hexahedra, box_tets, cup_hexahedra, cylinder_tets, jitter_interior,
};
use sinew_models::axes::field::{
    self, FibreError, FibreField, Laplace, Second, across, angles_by_formula, circular,
    from_cell_data, from_formula, helicoidal, hemicircular, to_cell_data,
};

fn block() -> Mesh {
    let mesh = box_tets(DVec3::new(2.0, 1.0, 1.0), [6, 3, 3]).unwrap();
    jitter_interior(&mesh, 0.2, 5).unwrap()
}

fn centres(mesh: &Mesh) -> Vec<DVec3> {
    let of = |t: &[u32; 4]| t.iter().map(|&v| mesh.points[v as usize]).sum::<DVec3>() / 4.0;
    mesh.tetrahedra.iter().map(of).collect()
}

fn assert_units(field: &FibreField, mesh: &Mesh) {
    assert_eq!(field.directions.len(), mesh.tetrahedra.len());
    assert!(field.directions.iter().all(|d| (d.length() - 1.0).abs() < 1e-14));
}

#[test]
fn cell_data_come_back() {
    let mut mesh = block();
    let given = field::random(&mesh, 3);
    assert_units(&given, &mesh);
    let data = to_cell_data("fibre", &given.directions, &mesh);
    mesh.cell_data.extend(data);
    let found = from_cell_data(&mesh, "fibre").unwrap();
    assert!(found.directions.iter().zip(&given.directions).all(|(a, b)| a.distance(*b) < 1e-15));
    assert_eq!(found.repaired, 0);
    // lengths are repaired and counted, vectors that are none are not
    for data in &mut mesh.cell_data {
        data.values.tetrahedra[7] *= 2.0;
    }
    assert_eq!(from_cell_data(&mesh, "fibre").unwrap().repaired, 1);
    for bad in [0.0, f64::NAN] {
        mesh.cell_data.iter_mut().for_each(|data| data.values.tetrahedra[4] = bad);
        let error = from_cell_data(&mesh, "fibre").unwrap_err();
        assert!(matches!(error, FibreError::Direction { element: 4, .. }), "{error}");
    }
    let error = from_cell_data(&mesh, "muscle").unwrap_err().to_string();
    assert!(error.contains("`muscle_x`") && error.contains("fibre_x"), "{error}");
}

#[test]
fn formulas() {
    let mesh = block();
    let found = from_formula(&mesh, ["x+1", "sin(y)", "0.5*z^2"]).unwrap();
    for (d, x) in found.directions.iter().zip(centres(&mesh)) {
        let expected = DVec3::new(x.x + 1.0, x.y.sin(), 0.5 * x.z * x.z).normalize();
        assert!(d.distance(expected) < 1e-14);
    }
    for (bad, part) in [("x +", "formula of y"), ("2*w", "variables"), ("0*x", "no direction")] {
        let error = from_formula(&mesh, ["0", bad, "0"]).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
}

/// One tetrahedron whose barycentre is `centre` to the last bit, if that has few binary digits.
fn tetrahedron_about(centre: DVec3) -> Mesh {
    let corners = [DVec3::splat(-0.25), DVec3::X, DVec3::Y, DVec3::Z];
    let corners = corners.map(|c| centre + c - DVec3::splat(0.1875));
    Mesh { points: corners.to_vec(), tetrahedra: vec![[0, 1, 2, 3]], ..Mesh::default() }
}

#[test]
fn formulas_have_the_values_of_arithmetic() {
    let (x, y, z) = (0.25_f64, -1.5_f64, 2.0_f64);
    let mesh = tetrahedron_about(DVec3::new(x, y, z));
    for (text, value) in [
        ("-y", -y),
        (" 1 + 2*x - y/ z/4 ", 1.0 + 2.0 * x - y / z / 4.0),
        ("-z^2", -4.0),
        ("(-z)^2", 4.0),
        ("2^z^3", 256.0),
        ("2^-z", 0.25),
        ("1e-3 + 2.5E2*.5 - 3.", 1e-3 + 125.0 - 3.0),
        ("2 - -3", 5.0),
        ("atan2(y, x) + min(x, y)*max(x, pow(z, 3))", y.atan2(x) + y * 8.0),
        ("sin(pi/6) + cos(tau) + ln(e)", (std::f64::consts::PI / 6.0).sin() + 2.0),
        ("sqrt(abs(y)) * exp(x)", 1.5_f64.sqrt() * x.exp()),
        ("z*sin((x - 1)*(y + 2))", z * ((x - 1.0) * (y + 2.0)).sin()),
    ] {
        let found = angles_by_formula(&mesh, [text, "0"]).unwrap()[0][0];
        assert!((found - value).abs() <= 1e-15 * value.abs(), "{text}: {found} {value}");
    }
}

#[test]
fn what_cannot_be_read_is_named() {
    let mesh = tetrahedron_about(DVec3::ZERO);
    let deep = "(".repeat(100_000);
    for (text, said) in [
        ("", "missing at the end"),
        ("x +", "missing at the end"),
        ("2*w", "`w` is none of the variables x, y, z and the functions abs"),
        ("sinus(x)", "`sinus`"),
        ("sin x", "`(` is missing before `x`"),
        ("sin(x", "`)` is missing at the end"),
        ("atan2(x)", "`,` is missing before `)`"),
        ("2x", "`x` is left over"),
        ("x)", "`)` is left over"),
        ("1.2.3", "`1.2.3` is no number"),
        ("1e", "`1e` is no number"),
        ("x % y", "`% y` is left over"),
        ("*x", "missing before `*x`"),
        ("µ", "`µ`"),
        (&deep, "within each other"),
    ] {
        let error = angles_by_formula(&mesh, ["0", text]);
        let Err(FibreError::Formula { component: "elevation", reason: error, .. }) = error else {
            panic!("{text} was read")
        };
        assert!(error.contains(said), "{text}: {error}");
    }
}

#[test]
fn laplace_rule_in_a_block() {
    let mesh = block();
    let group = |name: &str| mesh.group(name).unwrap().vertices.clone();
    let (inner, outer) = (group("x0"), group("x1"));
    let rule = Laplace::solve(&mesh, &inner, &outer).unwrap();
    // the potential is linear, which linear elements solve exactly
    for ((d, depth), x) in rule.transmural.iter().zip(&rule.depth).zip(centres(&mesh)) {
        assert!(d.distance(DVec3::X) < 1e-8, "{d}");
        assert!((depth - 0.5 * x.x).abs() < 1e-9);
    }
    // helix angles from 60 degrees to -60 degrees
    let angle = 60.0_f64.to_radians();
    let helix = rule.helix(DVec3::Z, angle, -angle).unwrap();
    assert_units(&helix, &mesh);
    for (d, x) in helix.directions.iter().zip(centres(&mesh)) {
        let at = angle * (1.0 - x.x);
        assert!(d.distance(DVec3::new(0.0, at.cos(), at.sin())) < 1e-7, "{d}");
    }
    assert!(Laplace::solve(&mesh, &inner, &[]).unwrap_err().to_string().contains("outer"));
    let error = Laplace::solve(&mesh, &inner, &inner).unwrap_err();
    assert!(matches!(error, FibreError::Overlap { .. }), "{error}");
    // square to the wall there is no direction round the axis
    assert!(rule.helix(DVec3::X, 0.0, 0.0).is_err());
}

#[test]
fn generators() {
    let mesh = cylinder_tets(1.0, 2.0, 4, 4).unwrap();
    let (low, high) = mesh.bounds().unwrap();
    let axis = DVec3::new(1.0, 2.0, -1.0).normalize();
    let centre = 0.5 * (low + high);
    let pitch = 0.4_f64;
    let (rings, helix) = (
        circular(&mesh, centre, 3.0 * axis).unwrap(),
        helicoidal(&mesh, centre, axis, pitch).unwrap(),
    );
    for ((ring, screw), x) in rings.directions.iter().zip(&helix.directions).zip(centres(&mesh)) {
        let across = x - centre - axis * axis.dot(x - centre);
        assert!(ring.dot(axis).abs() < 1e-14 && ring.dot(across).abs() < 1e-14);
        assert!((screw.dot(axis) - pitch.sin()).abs() < 1e-14);
    }
    // half circles about the middle of the side below
    let block = block();
    let arcs = hemicircular(&block, DVec3::Y, -DVec3::Z).unwrap();
    let middle = DVec3::new(1.0, 0.5, 0.0);
    for (d, x) in arcs.directions.iter().zip(centres(&block)) {
        assert!(d.y.abs() < 1e-14 && d.dot(x - middle).abs() < 1e-13);
    }
    // no direction is preferred at random, and a seed says all
    let wild = field::random(&mesh, 11);
    assert_units(&wild, &mesh);
    assert_eq!(wild, field::random(&mesh, 11));
    assert_ne!(wild, field::random(&mesh, 12));
    let n = wild.directions.len() as f64;
    for k in 0..3 {
        let mean: f64 = wild.directions.iter().map(|d| d[k] * d[k]).sum::<f64>() / n;
        assert!((mean - 1.0 / 3.0).abs() < 3.0 / n.sqrt(), "{mean}");
    }
    assert!(circular(&mesh, centre, DVec3::ZERO).is_err());
    assert!(helicoidal(&mesh, centre, axis, f64::NAN).is_err());
}

/// Every course of fibres has two axes across it, by its rule, and a course that leaves none is told by its element.
#[test]
fn axes_across_fibres_complete_a_triad() {
    let mesh = cylinder_tets(1.0, 2.0, 4, 4).unwrap();
    let (low, high) = mesh.bounds().unwrap();
    let (centre, axis) = (0.5 * (low + high), DVec3::new(1.0, 2.0, -1.0).normalize());
    let helix = helicoidal(&mesh, centre, 5.0 * axis, 0.4).unwrap().directions;
    let away = Second::Away { centre, axis: 5.0 * axis };
    let wild = field::random(&mesh, 11).directions;
    let towards = DVec3::new(0.1, 0.2, 3.0);
    let each: Vec<DVec3> = helix.clone();
    let courses = [
        (&helix, away),
        (&wild, Second::Coordinate),
        (&wild, Second::Towards(towards)),
        (&wild, Second::Each(each.clone())),
    ];
    for (fibres, second) in &courses {
        let [b, c] = across(fibres, second, &mesh).unwrap();
        assert_eq!((b.len(), c.len()), (fibres.len(), fibres.len()));
        for (i, &a) in fibres.iter().enumerate() {
            let of = [a.dot(b[i]), a.dot(c[i]), b[i].dot(c[i]), b[i].length() - 1.0];
            assert!(of.iter().all(|x| x.abs() < 1e-14), "{second:?}: {of:?}");
            assert!((a.cross(b[i]).dot(c[i]) - 1.0).abs() < 1e-14);
            let wanted = match second {
                Second::Away { .. } => {
                    let x = centres(&mesh)[i] - centre;
                    (x - axis * axis.dot(x)).normalize()
                }
                Second::Towards(_) => (towards - a * a.dot(towards)).normalize(),
                Second::Each(own) => (own[i] - a * a.dot(own[i])).normalize(),
                Second::Coordinate => {
                    let sines = DVec3::AXES.map(|e| (e - a * a.dot(e)).length());
                    let most = sines.iter().copied().fold(0.0, f64::max);
                    let e = DVec3::AXES[sines.iter().position(|s| *s == most).unwrap()];
                    (e - a * a.dot(e)).normalize()
                }
            };
            assert!(b[i].distance(wanted) < 1e-9, "{second:?}: {} {wanted}", b[i]);
        }
    }
    let mut fibres = wild;
    fibres[7] = DVec3::new(0.0, 0.6, 0.8);
    let error = across(&fibres, &Second::Towards(DVec3::new(0.0, 3.0, 4.0)), &mesh).unwrap_err();
    assert!(matches!(error, FibreError::Parallel { element: 7, .. }), "{error}");
    let mut each = each;
    each[9] = fibres[9];
    let error = across(&fibres, &Second::Each(each), &mesh).unwrap_err();
    assert!(matches!(error, FibreError::Parallel { element: 9, .. }), "{error}");
}

#[test]
fn hexahedra_follow_the_tetrahedra() {
    // a layer of tetrahedra under a layer of hexahedra, and cell data that come back
    let mut mesh = box_hexahedra(DVec3::new(2.0, 1.0, 1.0), [6, 3, 3]).unwrap();
    let inside = jitter_interior(&mesh, 0.2, 5).unwrap();
    mesh.points = inside.points;
    let lowest: Vec<[u32; 8]> = mesh.hexahedra.drain(..9).collect();
    let lowest = Mesh { points: mesh.points.clone(), hexahedra: lowest, ..Mesh::default() };
    mesh.tetrahedra = lowest.split_into_simplices().tetrahedra;
    let (tetrahedra, hexahedra) = (mesh.tetrahedra.len(), mesh.hexahedra.len());
    assert_eq!((tetrahedra, hexahedra), (54, 45));
    let given = field::random(&mesh, 3);
    assert_eq!(given.directions.len(), 99);
    let data = to_cell_data("fibre", &given.directions, &mesh);
    assert_eq!((data[0].values.tetrahedra.len(), data[0].values.hexahedra.len()), (54, 45));
    mesh.cell_data.extend(data);
    let found = from_cell_data(&mesh, "fibre").unwrap();
    assert!(found.directions.iter().zip(&given.directions).all(|(a, b)| a.distance(*b) < 1e-15));
    let found = from_formula(&mesh, ["x", "y", "z"]).unwrap();
    let eight = |h: [u32; 8]| h.iter().map(|&v| mesh.points[v as usize]).sum::<DVec3>() / 8.0;
    for (d, h) in found.directions[54..].iter().zip(&mesh.hexahedra) {
        assert!(d.distance(eight(*h).normalize()) < 1e-14);
    }
    // the potential of two opposite sides is linear in between, whatever the cells
    let side = |x: f64| -> Vec<u32> {
        let on = |v: &u32| (mesh.points[*v as usize].x - x).abs() < 1e-12;
        (0..mesh.points.len() as u32).filter(on).collect()
    };
    let laplace = Laplace::solve(&mesh, &side(0.0), &side(2.0)).unwrap();
    assert_eq!(laplace.depth.len(), 99);
    for direction in &laplace.transmural {
        assert!(direction.distance(DVec3::X) < 1e-6, "{direction}");
    }
    mesh.hexahedra[3][2] = 1_000_000;
    let error = from_formula(&mesh, ["x", "y", "1"]).unwrap_err();
    assert!(matches!(error, FibreError::Shape { element: 57 }), "{error}");
}

#[test]
fn fibres_turn_through_the_wall_of_a_cup_of_hexahedra() {
    let mesh = cup_hexahedra([0.02, 0.04], 0.01, 4, 4, 3).unwrap();
    let group = |name: &str| mesh.group(name).unwrap().vertices.clone();
    let laplace = Laplace::solve(&mesh, &group("inner"), &group("outer")).unwrap();
    let fibres = laplace.helix(DVec3::Z, 60f64.to_radians(), -(60f64.to_radians())).unwrap();
    assert_eq!(fibres.directions.len(), mesh.hexahedra.len());
    let layers = laplace.depth.chunks(mesh.hexahedra.len() / 3);
    for (layer, depths) in layers.enumerate() {
        let middle = (layer as f64 + 0.5) / 3.0;
        // curvature makes the potential steeper inside: halfway through a sphere of these radii it is 0.6
        assert!(depths.iter().all(|d| (d - middle).abs() < 0.13), "{layer}: {depths:?}");
    }
    for ((fibre, through), depth) in
        fibres.directions.iter().zip(&laplace.transmural).zip(&laplace.depth)
    {
        assert!(fibre.dot(*through).abs() < 1e-12);
        let round = DVec3::Z.cross(*through).normalize();
        let angle = fibre.dot(through.cross(round)).atan2(fibre.dot(round)).to_degrees();
        assert!((angle - (60.0 - 120.0 * depth)).abs() < 1e-9, "{angle} at {depth}");
    }
}
