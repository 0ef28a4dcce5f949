//! Cuts of the material of ten-node tetrahedra and hexahedra. Those of linear tetrahedra are rows of `sinew validate`: cases of a
//! separate program, random cuts, distance from the blade.

use glam::DVec3;
use sinew_engine::mesh::generate::{box_hexahedra, box_tets, jitter_interior};
use sinew_models::cutting::material::Material;

/// Cuts a material at its rest shape.
fn cut(material: &mut Material, rest: &[DVec3], strip: &[[DVec3; 2]]) {
    let sources = material.ghosts.clone();
    let at = |node: u32| match node.checked_sub(material.vertices) {
        None => rest[node as usize],
        Some(ghost) => rest[sources[ghost as usize] as usize],
    };
    let (_, stroke) = material.stroke(strip, &at);
    material.open(&stroke);
}

/// Ten-node tetrahedra and hexahedra: parts of every element add up, the skin is closed, middles belong to who holds them.
#[test]
fn other_elements_hold_together() {
    for seed in 0..6 {
        let bricks = box_hexahedra(DVec3::ONE, [3; 3]).unwrap();
        let bricks = jitter_interior(&bricks, 0.2, seed).unwrap();
        let tets = jitter_interior(&box_tets(DVec3::ONE, [2; 3]).unwrap(), 0.2, seed).unwrap();
        let ten = tets.with_second_order();
        let all: Vec<[u32; 10]> =
            (0..ten.tetrahedra.len()).map(|t| ten.second_order(t).unwrap()).collect();
        let materials = [
            (Material::of_hexahedra(bricks.points.len(), &bricks.hexahedra), &bricks.points),
            (Material::of_ten_nodes(ten.points.len(), &all), &ten.points),
        ];
        for (mut material, rest) in materials {
            let (count, size) = (material.elements.len(), material.order.size());
            for k in 0..3 {
                let (a, b) = (f64::from(k) * 0.21 + 0.13, seed as f64 * 0.07);
                let edge = |s: f64| [DVec3::new(a, -0.3 + b, s), DVec3::new(1.0 - a, 1.3, s + b)];
                cut(&mut material, rest, &[edge(-0.2), edge(1.2 - b)]);
            }
            assert!(material.elements.len() > count + 10 && !material.ghosts.is_empty());
            let mut shares = vec![0.0; count];
            let mut moved_by = std::collections::BTreeMap::<u32, u32>::new();
            for element in &material.elements {
                shares[element.source as usize] += element.share();
                for i in 0..size {
                    let (vertex, node) = (element.vertex(i), element.node(i));
                    let ghost = node.checked_sub(material.vertices);
                    assert_eq!(vertex, ghost.map_or(node, |g| material.ghosts[g as usize]));
                    // nobody's ghost is of two vertices
                    assert_eq!(*moved_by.entry(node).or_insert(vertex), vertex);
                }
            }
            assert!(shares.iter().all(|share| (share - 1.0).abs() < 1e-13));
            // every vertex of the mesh still moves something
            assert!((0..material.vertices).all(|v| moved_by.contains_key(&v)));
            let mut edges = std::collections::BTreeMap::<[u32; 2], i32>::new();
            for (face, ..) in material.skin() {
                for i in 0..3 {
                    let [a, b] = [face[i], face[(i + 1) % 3]];
                    *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
                }
            }
            assert!(edges.values().all(|sum| *sum == 0), "the skin is closed");
        }
    }
}
