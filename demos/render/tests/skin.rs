//! Surfaces with smooth normals and sharp edges.

use sinew_render::skin::{CREASE_ANGLE, Facet, Skin, without_loose_ends};

/// A cube of two triangles a side, outward.
fn cube() -> (Vec<[f32; 3]>, Vec<Facet>) {
    let points = (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|x: i32| x as f32)).collect();
    let quads: [[u32; 4]; 6] =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let facets = quads.iter().flat_map(|&[a, b, c, d]| [([a, b, c], 0), ([a, c, d], 0)]).collect();
    (points, facets)
}

#[test]
fn a_cube_keeps_its_edges_and_its_sides_are_flat() {
    let (points, facets) = cube();
    let skin = Skin::new(&facets, &points, CREASE_ANGLE);
    assert_eq!(skin.points.len(), 24);
    assert_eq!(skin.creases.len(), 12);
    let normals = skin.normals(&points);
    for (v, n) in normals.iter().enumerate() {
        assert_eq!(n.iter().filter(|x| x.abs() > 0.999).count(), 1, "{v}: {n:?}");
        // outward
        let p = points[skin.points[v] as usize];
        let out: f32 = (0..3).map(|k| n[k] * (p[k] - 0.5)).sum();
        assert!(out > 0.4);
    }
}

#[test]
fn a_smooth_cube_has_normals_along_its_diagonals() {
    let (points, facets) = cube();
    let skin = Skin::new(&facets, &points, 100.0);
    assert_eq!((skin.points.len(), skin.creases.len()), (8, 0));
    for (v, n) in skin.normals(&points).iter().enumerate() {
        let p = points[skin.points[v] as usize];
        for k in 0..3 {
            // angles weigh both triangles of a side as the one of the next
            assert!((n[k] - (p[k] - 0.5) * 2.0 / 3f32.sqrt()).abs() < 1e-5, "{v}: {n:?}");
        }
    }
}

#[test]
fn a_wound_is_smooth_and_ends_in_an_edge() {
    // two triangles of a wound at 60 degrees to each other, one of them narrow, then one of the surface
    let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, -0.005, 0.00866]];
    let facets = [([0, 1, 2], 0), ([1, 0, 3], 0)];
    let depth = [0.1, 0.2, 0.0, 0.0];
    let skin = Skin::with_wounds(&facets, &points, &depth, CREASE_ANGLE);
    assert_eq!((skin.points.len(), skin.creases.len()), (4, 4));
    assert_eq!((skin.wound(0), skin.depth.len()), (Some(0.1), 4));
    assert_eq!(Skin::new(&facets, &points, CREASE_ANGLE).points.len(), 6);
    // the narrow one hardly counts
    let up = skin.normals(&points)[0];
    assert!(up[2] > 0.9999, "{up:?}");
    let other = [f32::NAN; 4];
    assert!(Skin::with_wounds(&facets, &points, &other, CREASE_ANGLE).depth.is_empty());
}

#[test]
fn bodies_and_rims_end_a_surface() {
    let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    let sheet = [([0, 1, 2], 0), ([1, 3, 2], 0)];
    let skin = Skin::new(&sheet, &points, CREASE_ANGLE);
    assert_eq!((skin.points.len(), skin.creases.len()), (4, 4));
    let parted = [([0, 1, 2], 0), ([1, 3, 2], 1)];
    let skin = Skin::new(&parted, &points, CREASE_ANGLE);
    assert_eq!((skin.points.len(), skin.creases.len()), (6, 5));
    assert_eq!(skin.body, [0, 0, 0, 1, 1, 1]);
    let mut loose = vec![[0, 1], [1, 2], [0, 2], [2, 3], [3, 4]];
    without_loose_ends(&mut loose);
    assert_eq!(loose, [[0, 1], [1, 2], [0, 2]]);
    // degenerate ones and wrong indices are left out
    let odd = [([0, 0, 1], 0), ([0, 1, 9], 0)];
    assert_eq!(Skin::new(&odd, &points, CREASE_ANGLE), Skin::default());
}
