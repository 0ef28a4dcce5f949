//! Criterion 4: cuts across cuts, and many at random: the material holds together.

use super::fields::{CutBlock, differing, strip};
use super::*;
use sinew::engine::mesh::generate::{box_tets, jitter_interior};
use sinew::engine::sets::DisjointSets;
use sinew::models::element::precompute::RestTetrahedron;

/// How far a material is from what always holds.
#[derive(Default)]
struct Soundness {
    /// Largest difference of a share of an element, with what is gone, from all of it.
    shares: f64,
    /// Largest difference of the volume of a cell from that which is kept, over that of its element.
    cells: f64,
    /// Edges of the skin with a triangle on one side only, copies without material, nodes of other vertices.
    open: usize,
    /// Sum of all area vectors of the skin over the square of the size.
    area: f64,
}

fn rest_of(material: &Material, rest: &[DVec3], point: u32) -> DVec3 {
    let point = &material.points[point as usize];
    point.vertices.iter().zip(point.weights).map(|(&v, w)| w * rest[v as usize]).sum()
}

impl Soundness {
    /// `gone` is the part of every element at each corner that was removed.
    fn look(
        &mut self,
        material: &Material,
        rest: &[DVec3],
        tetrahedra: &[[u32; 4]],
        gone: &[[f64; 4]],
    ) {
        let volume_of = |x: [DVec3; 4]| (x[1] - x[0]).cross(x[2] - x[0]).dot(x[3] - x[0]) / 6.0;
        let whole = |t: &[u32; 4]| volume_of(t.map(|v| rest[v as usize]));
        let mut shares = gone.to_vec();
        // a removal takes the cells of an element, and the element out of the list of whoever removes
        let mut left = vec![false; material.elements.len()];
        material.cells.iter().for_each(|cell| left[cell.element as usize] = true);
        for (element, _) in material.elements.iter().zip(&left).filter(|(_, left)| **left) {
            self.open += usize::from(element.vertices != tetrahedra[element.source as usize]);
            let empty = element.share() <= 0.0 || element.portion.iter().any(|w| *w < 0.0);
            self.open += usize::from(empty);
            let sum = &mut shares[element.source as usize];
            sum.iter_mut().zip(element.portion).for_each(|(sum, w)| *sum += w);
            for (v, n) in element.vertices.into_iter().zip(element.nodes) {
                let ghost = n.checked_sub(material.vertices);
                let of = ghost.map_or(n, |ghost| material.ghosts[ghost as usize]);
                self.open += usize::from(v != of);
            }
        }
        let off = |w: &f64| 4.0 * (w - 0.25).abs();
        self.shares = shares.iter().flatten().map(off).fold(self.shares, f64::max);
        for cell in &material.cells {
            let own = volume_of(cell.corners.map(|p| rest_of(material, rest, p)));
            let of = whole(&material.elements[cell.element as usize].vertices);
            self.cells = self.cells.max((own / of - cell.volume).abs());
        }
        let mut edges = std::collections::BTreeMap::<[u32; 2], i32>::new();
        let mut area = DVec3::ZERO;
        for (face, ..) in material.skin() {
            let x = face.map(|p| rest_of(material, rest, p));
            area += (x[1] - x[0]).cross(x[2] - x[0]);
            for i in 0..3 {
                let [a, b] = [face[i], face[(i + 1) % 3]];
                *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
            }
        }
        self.open += edges.values().filter(|sum| **sum != 0).count();
        let size = rest.iter().fold(0.0, |size: f64, x| size.max(x.length()));
        self.area = self.area.max(area.length() / (size * size));
    }

    fn judge(&self, row: &mut ValidationRow) {
        row.at_most("shares of volume", self.shares, 1e-12);
        row.at_most("volumes of cells", self.cells, 1e-12);
        row.at_most("open edges and copies out of order", self.open as f64, 0.0);
        row.at_most("area vectors of the skin", self.area, 1e-12);
    }
}

/// Connected pieces, by the nodes of elements.
fn pieces(material: &Material) -> usize {
    let mut sets = DisjointSets::new(material.vertices as usize + material.ghosts.len());
    for element in &material.elements {
        (1..4).for_each(|i| _ = sets.join(element.nodes[0], element.nodes[i]));
    }
    let roots = material.elements.iter().map(|e| sets.root(e.nodes[0]));
    roots.collect::<std::collections::BTreeSet<u32>>().len()
}

/// Number of motions without forces: diagonally pivoted factorisation of the scaled stiffness.
fn zero_modes(material: &Material, rest: &[DVec3]) -> Outcome<usize> {
    let mut place = vec![usize::MAX; material.vertices as usize + material.ghosts.len()];
    let mut count = 0;
    for n in material.elements.iter().flat_map(|e| e.nodes) {
        if place[n as usize] == usize::MAX {
            place[n as usize] = count;
            count += 1;
        }
    }
    let n = 3 * count;
    let mut k = vec![0.0; n * n];
    for element in &material.elements {
        let shape = element.vertices.map(|v| rest[v as usize].to_array());
        let own = RestTetrahedron::new(shape)?;
        let g: Vec<DVec3> = own.gradients.iter().map(|g| DVec3::from(*g)).collect();
        let volume = own.volume * element.share();
        for (a, b) in (0..4).flat_map(|a| (0..4).map(move |b| (a, b))) {
            for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
                let mut value = g[a][i] * g[b][j] + g[a][j] * g[b][i];
                if i == j {
                    value += g[a].dot(g[b]);
                }
                let row = 3 * place[element.nodes[a] as usize] + i;
                k[row * n + 3 * place[element.nodes[b] as usize] + j] += volume * value;
            }
        }
    }
    let scale: Vec<f64> = (0..n).map(|i| k[i * n + i].sqrt().recip()).collect();
    (0..n * n).for_each(|at| k[at] *= scale[at / n] * scale[at % n]);
    let mut left: Vec<usize> = (0..n).collect();
    while let Some(at) = (0..left.len()).max_by(|&a, &b| {
        let diagonal = |i: usize| k[left[i] * n + left[i]];
        diagonal(a).total_cmp(&diagonal(b))
    }) {
        let p = left[at];
        let pivot = k[p * n + p];
        if pivot < 1e-9 {
            break;
        }
        left.swap_remove(at);
        let row = k[p * n..(p + 1) * n].to_vec();
        for &i in &left {
            let factor = row[i] / pivot;
            if factor != 0.0 {
                left.iter().for_each(|&j| k[i * n + j] -= factor * row[j]);
            }
        }
    }
    Ok(left.len())
}

/// Two strokes that cross.
pub(super) fn recut(rows: &mut CutRows) {
    let root = rows.case.root();
    rows.add("crossing strokes", |row| {
        let block = CutBlock::read(&root)?;
        let (rest, tetrahedra) = (&block.mesh.points, &block.mesh.tetrahedra);
        (row.nodes, row.cells) = (rest.len(), tetrahedra.len());
        let mut material = block.material();
        let mut sound = Soundness::default();
        for stroke in root.get("strokes").list()? {
            cut(&mut material, rest, &strip(&stroke)?);
            sound.look(&material, rest, tetrahedra, &vec![[0.0; 4]; tetrahedra.len()]);
        }
        let results = root.get("results");
        let count = |key: &str| results.get(key).index().map(|n| n as usize);
        let nodes: std::collections::BTreeSet<u32> =
            material.elements.iter().flat_map(|e| e.nodes).collect();
        let own = [material.elements.len(), nodes.len(), zero_modes(&material, rest)?];
        let truth = [count("copies")?, count("vertices")?, count("zero_modes")?];
        row.at_most("copies, vertices, zero modes that differ", differing(&own, &truth), 0.0);
        let mut off = 0.0_f64;
        for element in results.get("shares").object()?.keys() {
            let shares = results.get("shares").get(element);
            let source: u32 = element.parse().map_err(|_| shares.error("an element as key"))?;
            let own = material.elements.iter().filter(|e| e.source == source);
            let mut own: Vec<f64> = own.map(|e| e.share()).collect();
            own.sort_by(f64::total_cmp);
            let truth = shares.numbers()?;
            off = if own.len() == truth.len() { off } else { f64::INFINITY };
            off = own.iter().zip(&truth).map(|(a, b)| (a - b).abs()).fold(off, f64::max);
        }
        row.at_most("shares", off, 1e-11);
        sound.judge(row);
        Ok(())
    });
}

/// Finite planes through blocks, ten for each, mixed with removals in every seventh of them.
pub(super) fn cuts(rows: &mut CutRows, entry: &CaseEntry) {
    let count = |key: &str| entry.get(key).index();
    let mut hinges = 0;
    rows.add("ten to a block", |row| {
        let (blocks, counted) = (count("blocks")?, count("zero_mode_blocks")?);
        let (mut sound, mut cuts, mut removed) = (Soundness::default(), 0, 0);
        for seed in 0..u64::from(blocks) {
            let mesh = jitter_interior(&box_tets(DVec3::ONE, [3; 3])?, 0.2, seed)?;
            (row.nodes, row.cells) = (mesh.points.len(), mesh.tetrahedra.len());
            let mut state = seed + 1;
            let mut next = move || {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (state >> 11) as f64 / (1u64 << 53) as f64
            };
            let mut material = Material::new(mesh.points.len(), &mesh.tetrahedra);
            let mut gone = vec![[0.0; 4]; mesh.tetrahedra.len()];
            for _ in 0..10 {
                let mut vector = || DVec3::new(next(), next(), next());
                let (centre, along, across) = (vector(), vector() - 0.5, vector() - 0.5);
                let blade =
                    [-1.0, 1.0].map(|s| [-1.0, 1.0].map(|t| centre + s * along + t * across));
                cut(&mut material, &mesh.points, &blade);
                cuts += 1;
                if seed % 7 == 3 {
                    let chosen = (next() * material.elements.len() as f64) as u32;
                    if material.cells.iter().any(|cell| cell.element == chosen) {
                        let own = &material.elements[chosen as usize];
                        let sum = &mut gone[own.source as usize];
                        sum.iter_mut().zip(own.portion).for_each(|(sum, w)| *sum += w);
                        material.keep(|e| e != chosen);
                        removed += 1;
                    }
                }
            }
            sound.look(&material, &mesh.points, &mesh.tetrahedra, &gone);
            if seed < u64::from(counted) && seed % 7 != 3 {
                hinges += zero_modes(&material, &mesh.points)?.abs_diff(6 * pieces(&material));
            }
        }
        sound.judge(row);
        row.remark(format!("{cuts} cuts, {removed} removals"));
        Ok(())
    });
    rows.add("zero modes", |row| {
        row.at_most("zero modes beside six to a piece", hinges as f64, 0.0);
        Ok(())
    });
}
