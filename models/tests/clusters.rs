//! Clusters that a body grows for the means of its volume.

use sinew_models::body::clusters::{FEW, grow, neighbours, pieces};
use sinew_models::material::LameParameters;

const SOFT: LameParameters = LameParameters { lambda: 1e6, mu: 1e3 };

/// Six tetrahedra in each cell of a row of cubes.
fn row(cells: usize) -> (usize, Vec<[u32; 4]>) {
    let at = |x: usize, corner: usize| (4 * x + corner) as u32;
    let mut tetrahedra = Vec::new();
    for x in 0..cells {
        let [a, b, c, d] = [at(x, 0), at(x, 1), at(x, 2), at(x, 3)];
        let [e, f, g, h] = [at(x + 1, 0), at(x + 1, 1), at(x + 1, 2), at(x + 1, 3)];
        // round the diagonal a h
        let ring = [b, f, e, g, c, d];
        for i in 0..6 {
            tetrahedra.push([a, h, ring[i], ring[(i + 1) % 6]]);
        }
    }
    (4 * (cells + 1), tetrahedra)
}

#[test]
fn clusters_cover_the_body_and_hang_together() {
    let (vertices, tetrahedra) = row(12);
    let cluster = grow(vertices, &tetrahedra, &vec![SOFT; tetrahedra.len()]);
    let near = neighbours(&tetrahedra);
    let count = cluster.iter().max().map_or(0, |c| c + 1);
    for c in 0..count {
        let own: Vec<u32> =
            (0..tetrahedra.len() as u32).filter(|&t| cluster[t as usize] == c).collect();
        assert!(own.len() >= FEW);
        assert!(pieces(&own, &near, |_, _| true).iter().all(|&piece| piece == 0));
    }
    assert!((3..=12).contains(&count), "{count}");
}

#[test]
fn clusters_end_at_a_much_stiffer_material() {
    let (vertices, tetrahedra) = row(12);
    let mut lame = vec![SOFT; tetrahedra.len()];
    lame[36..].fill(LameParameters { lambda: 1e8, mu: 1e5 });
    let cluster = grow(vertices, &tetrahedra, &lame);
    assert!(cluster[..36].iter().all(|c| !cluster[36..].contains(c)));
}

#[test]
fn islands_are_clusters_of_their_own() {
    let (vertices, mut tetrahedra) = row(3);
    let n = vertices as u32;
    tetrahedra.push([n, n + 1, n + 2, n + 3]);
    let cluster = grow(vertices + 4, &tetrahedra, &vec![SOFT; tetrahedra.len()]);
    let island = cluster.last().copied();
    assert_eq!(cluster.iter().filter(|&&c| Some(c) == island).count(), 1);
}
