//! Hinges and their couplings: derivatives, rigid motion, folds and collapse, and what a plate must do on any mesh.

use glam::{DQuat, DVec3};
use sinew_models::element::hinge::{Hinge, Nodes};
use sinew_models::element::plate::{Branching, Couplings, Neighbours, couplings};

/// Numbers between -1 and 1, the same every time.
fn random(mut seed: u64) -> impl FnMut() -> f64 {
    move || {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// A hinge of two triangles of all shapes, bent at rest.
fn nodes(next: &mut impl FnMut() -> f64) -> Nodes<f64> {
    let plain = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.4, 0.9, 0.0], [0.6, -0.8, 0.0]];
    plain.map(|x: [f64; 3]| x.map(|x| x + 0.25 * next()))
}

fn step(u: &Nodes<f64>, v: &Nodes<f64>, h: f64) -> Nodes<f64> {
    std::array::from_fn(|a| std::array::from_fn(|x| u[a][x] + h * v[a][x]))
}

fn along(a: &Nodes<f64>, b: &Nodes<f64>) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a * b).sum()
}

fn largest(a: &Nodes<f64>) -> f64 {
    a.iter().flatten().fold(0.0, |m, x| m.max(x.abs()))
}

/// The difference quotient of fourth order.
fn slope(f: impl Fn(f64) -> f64, h: f64) -> f64 {
    (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)
}

#[test]
fn derivatives_of_hinges() {
    let mut next = random(1);
    for flat in [false, true] {
        for case in 0..300 {
            let hinge = Hinge::new(&nodes(&mut next), flat);
            // up to folded over and inside out
            let size = [1e-3, 0.1, 1.0][case % 3];
            let mut vectors =
                || -> Nodes<f64> { std::array::from_fn(|_| [next(), next(), next()]) };
            let (u, v) = (step(&[[0.0; 3]; 4], &vectors(), size), vectors());
            let state = hinge.state(&u);
            if state.fade < 1.0 {
                continue;
            }
            let steep = largest(&state.gradient).max(1.0);
            let h = 1e-3 / steep;
            let of =
                |f: fn(&Hinge<f64>, &Nodes<f64>) -> f64| slope(|t| f(&hinge, &step(&u, &v, t)), h);
            let sigma = of(|e, u| e.state(u).sigma);
            let kappa = of(|e, u| e.state(u).kappa);
            assert!((sigma - along(&state.of_sigma, &v)).abs() < 1e-8 * steep, "sigma {case}");
            assert!((kappa - along(&state.of_kappa, &v)).abs() < 1e-8 * steep, "kappa {case}");
            // sine and cosine are those of one angle
            assert!((state.sin.hypot(state.cos) - 1.0).abs() < 1e-12);
            let second = hinge.second_derivative(&u);
            for a in 0..4 {
                for x in 0..3 {
                    let found = slope(|t| hinge.state(&step(&u, &v, t)).gradient[a][x], h);
                    let expected: f64 = (0..4)
                        .flat_map(|b| (0..3).map(move |y| (b, y)))
                        .map(|(b, y)| second[a][b][3 * x + y] * v[b][y])
                        .sum();
                    let unit = steep * steep;
                    assert!((found - expected).abs() < 1e-7 * unit, "{case}: {found} {expected}");
                    for b in 0..4 {
                        for y in 0..3 {
                            let other = second[b][a][3 * y + x];
                            let difference = second[a][b][3 * x + y] - other;
                            assert!(difference.abs() < 1e-11 * unit, "symmetric");
                        }
                    }
                }
            }
        }
    }
}

/// Angles are those that geometry gives, whichever of the two triangles comes first.
#[test]
fn angles_of_hinges() {
    let points = [DVec3::ZERO, DVec3::X, DVec3::new(0.3, 1.0, 0.0), DVec3::new(0.7, -1.0, 0.0)];
    let hinge = Hinge::new(&points.map(|p| p.to_array()), false);
    let turned = [1, 0, 3, 2].map(|i| points[i].to_array());
    let other = Hinge::new(&turned, false);
    for degrees in [1e-6_f64, 10.0, 90.0, 179.0, 181.0, -30.0, -120.0] {
        let angle = degrees.to_radians();
        let moved = DQuat::from_rotation_x(angle) * points[2] - points[2];
        let u = [DVec3::ZERO, DVec3::ZERO, moved, DVec3::ZERO].map(|u| u.to_array());
        let state = hinge.state(&u);
        // a corner that rises makes the angle negative
        assert!((state.sin + angle.sin()).abs() < 1e-15 + 1e-12 * angle.sin().abs(), "{degrees}");
        assert!((state.cos - angle.cos()).abs() < 1e-12, "{degrees}");
        let seen = other.state(&[u[1], u[0], u[3], u[2]]);
        assert!((seen.sin - state.sin).abs() < 1e-12, "{degrees}");
    }
}

#[test]
fn rigid_motion_changes_nothing() {
    let mut next = random(3);
    for case in 0..100 {
        let rest = nodes(&mut next);
        for flat in [false, true] {
            let hinge = Hinge::new(&rest, flat);
            let bend: Nodes<f64> = std::array::from_fn(|_| std::array::from_fn(|_| 0.1 * next()));
            let axis = DVec3::new(next(), next(), next()).normalize();
            let turn = DQuat::from_axis_angle(axis, 3.0 * next());
            let shift = DVec3::new(next(), next(), next());
            let moved: Nodes<f64> = std::array::from_fn(|a| {
                let x = DVec3::from_array(rest[a]);
                (turn * (x + DVec3::from_array(bend[a])) + shift - x).to_array()
            });
            let (before, after) = (hinge.state(&bend), hinge.state(&moved));
            assert!((before.sigma - after.sigma).abs() < 1e-13, "{case}");
            assert!((before.kappa - after.kappa).abs() < 1e-13, "{case}");
            let single = hinge.cast::<f32>().state(&moved.map(|u| u.map(|x| x as f32)));
            assert!((f64::from(single.sigma) - after.sigma).abs() < 2e-5, "{case}");
        }
    }
}

/// Small angles keep their digits in single precision: nothing cancels.
#[test]
fn small_angles_in_single_precision() {
    let mut next = random(4);
    for flat in [false, true] {
        let mut rest = nodes(&mut next);
        if flat {
            rest.iter_mut().for_each(|x| x[2] = 0.0);
        }
        let hinge = Hinge::new(&rest, false);
        for size in [1e-3, 1e-6, 1e-9] {
            let u: Nodes<f64> = std::array::from_fn(|_| std::array::from_fn(|_| size * next()));
            let u = u.map(|u| u.map(|x| f64::from(x as f32)));
            let double = hinge.state(&u).sigma;
            let single = hinge.cast::<f32>().state(&u.map(|u| u.map(|x| x as f32))).sigma;
            let error = (f64::from(single) - double).abs();
            assert!(error < 5e-6 * size, "{flat} {size}: {single} {double}");
        }
    }
}

/// Triangles without area, edges without length and folds give finite numbers; the energy of a fold is that of the
/// largest angle, and nothing jumps there.
#[test]
fn collapsed_and_folded_hinges_are_finite() {
    let rest = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.4, 1.0, 0.0], [0.6, -1.0, 0.0]];
    let hinge = Hinge::new(&rest, false);
    let to = |targets: Nodes<f64>| -> Nodes<f64> {
        std::array::from_fn(|a| std::array::from_fn(|x| targets[a][x] - rest[a][x]))
    };
    let collapsed = [
        [[0.0; 3]; 4],
        [[0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.6, -1.0, 0.0]],
        [[0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.0, 0.0]],
        [[0.0; 3], [0.0; 3], [0.4, 1.0, 0.0], [0.6, -1.0, 0.0]],
    ];
    for targets in collapsed {
        let u = to(targets);
        let state = hinge.state(&u);
        assert!(state.sigma.abs() < 1e-6 && state.kappa.abs() < 1e-6, "{state:?}");
        for gradient in [&state.of_sigma, &state.of_kappa] {
            assert!(largest(gradient) < 1.0, "{gradient:?}");
        }
        let single = hinge.cast::<f32>().state(&u.map(|u| u.map(|x| x as f32)));
        assert!(single.of_sigma.as_flattened().iter().all(|x| x.is_finite()));
        let second = hinge.second_derivative(&u);
        assert!(second.as_flattened().as_flattened().iter().all(|x| (x * state.fade).abs() < 1e3));
    }
    // on the way to a collapse energies and forces belong together
    let mut next = random(5);
    for _ in 0..200 {
        let height = 0.02 + 0.1 * next().abs();
        let u = to([[0.0; 3], [1.0, 0.0, 0.0], [0.4, 0.3 * height, height], [0.6, -1.0, 0.0]]);
        let v: Nodes<f64> = std::array::from_fn(|_| [next(), next(), next()]);
        let state = hinge.state(&u);
        let h = 1e-5;
        let sigma = slope(|t| hinge.state(&step(&u, &v, t)).sigma, h);
        let kappa = slope(|t| hinge.state(&step(&u, &v, t)).kappa, h);
        let unit = largest(&state.of_sigma).max(largest(&state.of_kappa));
        // the factor has kinks in its second derivative
        assert!((sigma - along(&state.of_sigma, &v)).abs() < 1e-5 * unit, "{height}");
        assert!((kappa - along(&state.of_kappa, &v)).abs() < 1e-5 * unit, "{height}");
    }
    let folded = |below: f64| {
        hinge.state(&to([[0.0; 3], [1.0, 0.0, 0.0], [0.4, -1.0, below], [0.6, -1.0, 0.0]]))
    };
    let (above, below) = (folded(1e-9), folded(-1e-9));
    assert!((above.kappa - 2.0).abs() < 1e-12);
    for a in 0..4 {
        for x in 0..3 {
            assert!((above.of_sigma[a][x] - below.of_sigma[a][x]).abs() < 1e-7);
            assert!((above.of_kappa[a][x] - below.of_kappa[a][x]).abs() < 1e-7);
        }
    }
}

/// A square of triangles, diagonals at random or alternating, inner vertices moved.
fn square(n: usize, alternating: bool, shake: f64) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let mut next = random(7);
    let at = |i: usize, j: usize| (j * (n + 1) + i) as u32;
    let mut points = Vec::new();
    for j in 0..=n {
        for i in 0..=n {
            let inner = i > 0 && j > 0 && i < n && j < n;
            let mut moved = || if inner { shake * next() } else { 0.0 };
            points.push([(i as f64 + moved()) / n as f64, (j as f64 + moved()) / n as f64, 0.0]);
        }
    }
    let mut triangles = Vec::new();
    for j in 0..n {
        for i in 0..n {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            let other = if alternating { (i + j) % 2 == 1 } else { next() > 0.0 };
            let pair = if other { [[a, b, d], [b, c, d]] } else { [[a, b, c], [a, c, d]] };
            triangles.extend(pair.map(|mut t| {
                t.sort_unstable();
                t
            }));
        }
    }
    (points, triangles)
}

/// Angles of the hinges for small deflections `w` along z.
fn angles(near: &Neighbours, points: &[[f64; 3]], w: &[f64]) -> Vec<f64> {
    let of = |nodes: &[u32; 4]| {
        let hinge = Hinge::new(&nodes.map(|v| points[v as usize]), false);
        hinge.state(&nodes.map(|v| [0.0, 0.0, 1e-6 * w[v as usize]])).sigma / 1e-6
    };
    near.hinges().iter().map(of).collect()
}

fn times(c: &Couplings, theta: &[f64]) -> Vec<f64> {
    let row = |e: usize| c.start[e] as usize..c.start[e + 1] as usize;
    let of = |e| row(e).map(|k| c.value[k] * theta[c.hinge[k] as usize]).sum();
    (0..theta.len()).map(of).collect()
}

/// Constant curvature is in equilibrium on any mesh: its moments need no forces inside. This is what hinges without
/// couplings miss.
#[test]
fn constant_curvature_is_exact_on_any_mesh() {
    const N: usize = 12;
    for (alternating, shake) in [(true, 0.0), (false, 0.0), (false, 0.3), (true, 0.3)] {
        let (points, triangles) = square(N, alternating, shake);
        let near = Neighbours::new(triangles).unwrap();
        for nu in [0.0, 0.3, 0.45] {
            let moduli = [nu, 0.5 * (1.0 - nu)];
            let c = couplings(&near, |v| points[v as usize], moduli);
            for [xx, yy, xy] in
                [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, -0.4, 0.7]]
            {
                let form = |x: f64, y: f64| 0.5 * (xx * x * x + yy * y * y) + xy * x * y;
                let w: Vec<f64> = points.iter().map(|p| form(p[0], p[1])).collect();
                let theta = angles(&near, &points, &w);
                let moment = times(&c, &theta);
                // forces, from the derivative of the work of the moments
                let mut force = vec![0.0_f64; points.len()];
                for (nodes, m) in near.hinges().iter().zip(&moment) {
                    let hinge = Hinge::new(&nodes.map(|v| points[v as usize]), false);
                    let gradient = hinge.state(&[[0.0; 3]; 4]).of_sigma;
                    for (v, g) in nodes.iter().zip(gradient) {
                        force[*v as usize] += m * g[2];
                    }
                }
                let rim = force.iter().fold(0.0_f64, |m, f| m.max(f.abs()));
                for (x, f) in points.iter().zip(&force) {
                    // patches of three triangles, the rim relaxes
                    let away = x[0].min(x[1]).min(1.0 - x[0]).min(1.0 - x[1]);
                    if away > 3.6 / N as f64 {
                        assert!(f.abs() < 1e-7 * rim, "{alternating} {shake}: {f} of {rim}");
                    }
                }
            }
        }
    }
}

/// A closed surface has no rim: a sphere that is bent flat has the energy of its curvature.
#[test]
fn a_sphere_has_the_energy_of_its_curvature() {
    // an icosahedron, its edges halved three times
    let g = 0.5 * (1.0 + 5.0_f64.sqrt());
    let corners = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ];
    let mut points: Vec<DVec3> =
        corners.iter().map(|&c| DVec3::from_array(c).normalize()).collect();
    let mut triangles: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    let mut errors = Vec::new();
    for _ in 0..4 {
        let mut middles = std::collections::BTreeMap::new();
        let mut finer = Vec::new();
        for &[a, b, c] in &triangles {
            let mut middle = |a: u32, b: u32| {
                *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                    points.push((points[a as usize] + points[b as usize]).normalize());
                    points.len() as u32 - 1
                })
            };
            let [x, y, z] = [middle(a, b), middle(b, c), middle(c, a)];
            finer.extend([[a, x, z], [x, b, y], [z, y, c], [x, y, z]]);
        }
        triangles = finer;
        let sorted = triangles.iter().map(|&t| {
            let mut t = t;
            t.sort_unstable();
            t
        });
        let near = Neighbours::new(sorted.collect()).unwrap();
        let nu = 0.3;
        let c = couplings(&near, |v| points[v as usize].to_array(), [nu, 0.5 * (1.0 - nu)]);
        let of = |nodes: &[u32; 4]| {
            Hinge::new(&nodes.map(|v| points[v as usize].to_array()), true)
                .state(&[[0.0; 3]; 4])
                .sigma
        };
        let theta: Vec<f64> = near.hinges().iter().map(of).collect();
        let energy: f64 = times(&c, &theta).iter().zip(&theta).map(|(m, t)| 0.5 * m * t).sum();
        // D (1 + nu) per area for curvatures of 1 in both directions, times 4 pi
        errors.push(energy / (4.0 * std::f64::consts::PI * (1.0 + nu)) - 1.0);
    }
    assert!(errors[3].abs() < 0.005, "{errors:?}");
    assert!(errors[3].abs() < 0.5 * errors[2].abs(), "{errors:?}");
}

#[test]
fn branches_are_found() {
    let triangles = vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]];
    let branching = Neighbours::new(triangles).unwrap_err();
    assert_eq!(branching, Branching { edge: [0, 1], count: 3 });
    assert_eq!(Neighbours::new(vec![[0, 1, 2], [1, 2, 3]]).unwrap().hinges(), [[1, 2, 0, 3]]);
}
