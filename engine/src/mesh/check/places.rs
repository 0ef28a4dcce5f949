//! Vertices that lie at one place.

use super::{FindingCode, Findings, Severity, Sound, Tally};
use crate::mesh::Mesh;
use glam::DVec3;

/// Vertices nearer than this share of their middling edge count as one place.
const SAME_PLACE: f64 = 1e-9;

/// Median length of the edges at each vertex; a few edges to a stray vertex do not change it.
fn local_lengths(mesh: &Mesh, cells: &Sound) -> Vec<f64> {
    let n = mesh.points.len();
    let mut end = vec![0usize; n + 1];
    cells.for_edges(mesh, |i, j| {
        end[i as usize + 1] += 1;
        end[j as usize + 1] += 1;
    });
    for v in 0..n {
        end[v + 1] += end[v];
    }
    let mut next = end.clone();
    let mut lengths = vec![0.0f64; end[n]];
    cells.for_edges(mesh, |i, j| {
        let length = (mesh.points[i as usize] - mesh.points[j as usize]).length();
        for v in [i as usize, j as usize] {
            lengths[next[v]] = length;
            next[v] += 1;
        }
    });
    let median = |v: usize| {
        let list = &mut lengths[end[v]..end[v + 1]];
        let middle = list.len() / 2;
        if list.is_empty() { 0.0 } else { *list.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    (0..n).map(median).collect()
}

pub(super) fn duplicate_coordinates(
    mesh: &Mesh,
    cells: &Sound,
    used: &[u32],
    found: &mut Findings,
) {
    let p = |v: u32| mesh.points[v as usize];
    let local = local_lengths(mesh, cells);
    let mut pairs_in_cells = Tally::default();
    let near = |i: u32, j: u32| {
        let reach = local[i as usize].min(local[j as usize]);
        (p(i) - p(j)).length() <= SAME_PLACE * reach
    };
    let mut joined = std::collections::HashSet::new();
    // All pairs of a cell: opposite corners of a face are no edge, but may coincide as well.
    for (.., cell) in cells.matter(mesh) {
        for (k, &i) in cell.iter().enumerate() {
            for &j in &cell[k + 1..] {
                if near(i, j) && joined.insert((i.min(j), i.max(j))) {
                    pairs_in_cells.add(|| format!("vertices {i} and {j}"));
                }
            }
        }
    }
    // Vertices in different cells: the nearest other vertex within reach, by a tree of boxes.
    let mut order: Vec<u32> = used.iter().copied().filter(|&v| p(v).is_finite()).collect();
    let mut axes = vec![0u8; order.len()];
    build_tree(&mesh.points, &mut order, &mut axes);
    let mut seams = Tally::default();
    for &v in used.iter().filter(|&&v| p(v).is_finite()) {
        let accept = |other: u32| {
            let pair = (v.min(other), v.max(other));
            other != v && near(v, other) && !joined.contains(&pair)
        };
        let reach = SAME_PLACE * local[v as usize];
        if let Some(other) = search_tree(&mesh.points, &order, &axes, p(v), reach, &accept)
            && v > other
        {
            seams.add(|| format!("vertices {other} and {v}"));
        }
    }
    found.push(
        FindingCode::DuplicateCoordinates,
        Severity::Error,
        pairs_in_cells,
        |count| format!("{count} pairs of vertices of one cell lie at the same place"),
        "merge the vertices and remove the flat cells",
    );
    found.push(
        FindingCode::DuplicateCoordinates,
        Severity::Warning,
        seams,
        |count| format!("{count} vertices lie where another one lies, but in other cells"),
        "`sinew mesh merge` merges them, unless the body is meant to be cut open there",
    );
}

/// Orders points as a balanced tree: the middle of each slice splits the rest along its widest axis.
pub(in crate::mesh) fn build_tree(points: &[DVec3], order: &mut [u32], axes: &mut [u8]) {
    if order.len() < 2 {
        return;
    }
    let at = |v: u32| points[v as usize];
    let first = at(order[0]);
    let (low, high) =
        order.iter().fold((first, first), |(low, high), &v| (low.min(at(v)), high.max(at(v))));
    let axis = (high - low).max_position();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| {
        at(a)[axis].total_cmp(&at(b)[axis]).then(a.cmp(&b))
    });
    axes[middle] = axis as u8;
    let (left, right) = order.split_at_mut(middle);
    let (left_axes, right_axes) = axes.split_at_mut(middle);
    build_tree(points, left, left_axes);
    build_tree(points, &mut right[1..], &mut right_axes[1..]);
}

/// Any accepted vertex within `reach` of `point` along each axis.
pub(in crate::mesh) fn search_tree(
    points: &[DVec3],
    order: &[u32],
    axes: &[u8],
    point: DVec3,
    reach: f64,
    accept: &dyn Fn(u32) -> bool,
) -> Option<u32> {
    if order.is_empty() {
        return None;
    }
    let middle = order.len() / 2;
    let here = order[middle];
    if accept(here) {
        return Some(here);
    }
    let axis = axes[middle] as usize;
    let away = point[axis] - points[here as usize][axis];
    let left = || search_tree(points, &order[..middle], &axes[..middle], point, reach, accept);
    let right =
        || search_tree(points, &order[middle + 1..], &axes[middle + 1..], point, reach, accept);
    let found = if away <= reach { left() } else { None };
    if found.is_none() && away >= -reach { right() } else { found }
}
