//! Which tetrahedra form a cluster: plain lists.
//!
//! Clusters grow round vertices: one that holds all tetrahedra round a vertex has a vertex that can move volume between
//! them, which is what keeps pressures of neighbours from oscillating. No cluster reaches over a gap, nor, at its birth, from
//! one material to a much stiffer one.

use crate::material::LameParameters;
use sinew_engine::layout::starts;
use std::collections::BTreeMap;

const NONE: u32 = u32::MAX;
/// Clusters of fewer elements join a neighbour: they would be as stiff as elements alone.
pub const FEW: usize = 3;

/// Cluster of every tetrahedron, counted from 0 in the order of their first elements; `tetrahedra` by vertex rows
/// below `vertices`.
pub fn grow(vertices: usize, tetrahedra: &[[u32; 4]], lame: &[LameParameters]) -> Vec<u32> {
    let classes: Vec<i32> = lame.iter().map(octave).collect();
    let neighbours = neighbours(tetrahedra);
    let joined = |a: u32, b: u32| classes[a as usize] == classes[b as usize];
    let mut round: Vec<[u32; 2]> =
        (0..).zip(tetrahedra).flat_map(|(t, nodes)| nodes.map(|v| [v, t])).collect();
    round.sort_unstable();
    let start = starts(vertices, round.iter().map(|entry| entry[0]));
    let star = |v: u32| &round[start[v as usize] as usize..start[v as usize + 1] as usize];
    let mut order: Vec<u32> = (0..vertices as u32).collect();
    order.sort_by_key(|&v| (std::cmp::Reverse(star(v).len()), v));
    let mut cluster = vec![NONE; tetrahedra.len()];
    let mut sizes: Vec<usize> = Vec::new();
    for v in order {
        let own = star(v);
        if !own.is_empty() && own.iter().all(|&[_, t]| cluster[t as usize] == NONE) {
            own.iter().for_each(|&[_, t]| cluster[t as usize] = sizes.len() as u32);
            sizes.push(own.len());
        }
    }
    loop {
        let mut changed = false;
        for t in 0..tetrahedra.len() {
            if cluster[t] != NONE {
                continue;
            }
            let near = neighbours[t].iter().filter(|&&n| n != NONE && joined(t as u32, n));
            let near = near.map(|&n| cluster[n as usize]).filter(|&c| c != NONE);
            if let Some(smallest) = near.min_by_key(|&c| (sizes[c as usize], c)) {
                cluster[t] = smallest;
                sizes[smallest as usize] += 1;
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
    // what hangs together only by vertices and edges, or not by its material; and islands
    let all: Vec<u32> = (0..tetrahedra.len() as u32).collect();
    let connected = pieces(&all, &neighbours, |a, b| {
        cluster[a as usize] == cluster[b as usize] && joined(a, b)
    });
    merge_few(connected, &neighbours)
}

/// Power of two next to the part of `lambda` that goes to the cluster, in half steps.
fn octave(lame: &LameParameters) -> i32 {
    let shared = lame.lambda - lame.lambda.min(0.25 * lame.mu);
    if shared > 0.0 { libm::log2(shared).round() as i32 } else { i32::MIN }
}

/// Tetrahedra across the faces of each, `u32::MAX` where there are none.
pub fn neighbours(tetrahedra: &[[u32; 4]]) -> Vec<[u32; 4]> {
    let mut faces: Vec<([u32; 3], u32, u32)> = Vec::with_capacity(4 * tetrahedra.len());
    for (t, nodes) in (0..).zip(tetrahedra) {
        for opposite in 0..4 {
            let mut face =
                [nodes[(opposite + 1) % 4], nodes[(opposite + 2) % 4], nodes[(opposite + 3) % 4]];
            face.sort_unstable();
            faces.push((face, t, opposite as u32));
        }
    }
    faces.sort_unstable();
    let mut of = vec![[NONE; 4]; tetrahedra.len()];
    for pair in faces.windows(2) {
        let [(face, t, k), (other, s, l)] = [pair[0], pair[1]];
        if face == other {
            of[t as usize][k as usize] = s;
            of[s as usize][l as usize] = t;
        }
    }
    of
}

/// Piece of each of some elements, which are in ascending order, counted from 0 in that order: neighbours that are
/// `together` are in one.
pub fn pieces(
    elements: &[u32],
    neighbours: &[impl AsRef<[u32]>],
    together: impl Fn(u32, u32) -> bool,
) -> Vec<u32> {
    let mut piece = vec![NONE; elements.len()];
    let mut next = 0;
    for first in 0..elements.len() {
        if piece[first] != NONE {
            continue;
        }
        piece[first] = next;
        let mut open = vec![first];
        while let Some(place) = open.pop() {
            let element = elements[place];
            for &n in neighbours[element as usize].as_ref().iter().filter(|&&n| n != NONE) {
                if let Ok(at) = elements.binary_search(&n)
                    && piece[at] == NONE
                    && together(element, n)
                {
                    piece[at] = next;
                    open.push(at);
                }
            }
        }
        next += 1;
    }
    piece
}

/// Lets clusters of very few elements join the smallest neighbour, and numbers what is left anew.
fn merge_few(mut cluster: Vec<u32>, neighbours: &[[u32; 4]]) -> Vec<u32> {
    let count = cluster.iter().max().map_or(0, |&c| c as usize + 1);
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); count];
    for (t, &c) in cluster.iter().enumerate() {
        members[c as usize].push(t as u32);
    }
    for few in 0..count {
        if members[few].is_empty() || members[few].len() >= FEW {
            continue;
        }
        let near = members[few].iter().flat_map(|&t| neighbours[t as usize]);
        let near = near.filter(|&n| n != NONE).map(|n| cluster[n as usize] as usize);
        let near = near.filter(|&c| c != few).min_by_key(|&c| (members[c].len(), c));
        if let Some(to) = near {
            let moved = std::mem::take(&mut members[few]);
            moved.iter().for_each(|&t| cluster[t as usize] = to as u32);
            members[to].extend(moved);
        }
    }
    number(&cluster)
}

/// The same clusters counted from 0 in the order of their first elements.
pub fn number(cluster: &[u32]) -> Vec<u32> {
    let mut known = BTreeMap::new();
    let mut own = |&c: &u32| {
        let next = known.len() as u32;
        *known.entry(c).or_insert(next)
    };
    cluster.iter().map(&mut own).collect()
}
