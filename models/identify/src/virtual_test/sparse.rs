//! A sparse symmetric system with held unknowns, factorised directly.
//!
//! Nodes are cut into two halves and the layer between them, again and again (nested dissection); the
//! layers are eliminated from the innermost to the first one, each as a small dense matrix (a front) of
//! its own nodes and of those they still touch. Springs with negative constants are indefinite: where
//! a block of `D` in `A = L D L^T` is not positive definite, all that is left of the front's own unknowns is
//! one block and is factorised with pivots.

use nalgebra::{DMatrix, Matrix3};

/// Residual of a right-hand side of order 1 above which a matrix counts as singular. Rounding leaves
/// about 1e-16 times the condition.
const SINGULAR: f64 = 1e-4;
/// Nodes of a part that is not cut any more.
const LEAF: usize = 24;
/// Unknowns that are eliminated at once.
const PANEL: usize = 48;
/// Corrections of a solution by that of its residual.
const REFINEMENTS: usize = 2;

/// A symmetric matrix over all unknowns, in blocks of a node by a node; unknowns that are held are
/// eliminated when it is solved.
pub(super) struct System {
    dimension: usize,
    /// per node and axis; nodes of plane bodies do not move along z
    free: Vec<bool>,
    /// neighbours of every node and the blocks that join them to it
    rows: Vec<Vec<(usize, Matrix3<f64>)>>,
}

impl System {
    /// All zero; `held` has `dimension` entries per node.
    pub(super) fn new(held: &[Option<f64>], dimension: usize) -> Self {
        let free = |i: usize| i % 3 < dimension && held[i / 3 * dimension + i % 3].is_none();
        let nodes = held.len() / dimension;
        Self { dimension, free: (0..3 * nodes).map(free).collect(), rows: vec![Vec::new(); nodes] }
    }

    /// Adds to an entry of the full matrix; both halves are to be added.
    pub(super) fn add(&mut self, row: usize, column: usize, value: f64) {
        let d = self.dimension;
        let (blocks, node) = (&mut self.rows[row / d], column / d);
        let place = blocks.iter().position(|b| b.0 == node).unwrap_or_else(|| {
            blocks.push((node, Matrix3::zeros()));
            blocks.len() - 1
        });
        blocks[place].1[(row % d, column % d)] += value;
    }

    /// Solves `A x = b` with the held unknowns at their values in `held`; says whether the matrix is
    /// positive definite. `None` if it is singular.
    pub(super) fn solve(&self, b: &[f64], held: &[f64]) -> Option<(Vec<f64>, bool)> {
        let (d, nodes) = (self.dimension, self.rows.len());
        // The second column is in no equilibrium with anything: if the matrix is singular and passed
        // the factorisation by rounding, the solution for it does not solve its system.
        let mut x = DMatrix::zeros(3 * nodes, 2);
        let mut right = DMatrix::zeros(3 * nodes, 2);
        for (i, &free) in self.free.iter().enumerate().filter(|(i, _)| i % 3 < d) {
            let own = i / 3 * d + i % 3;
            if free {
                (right[(i, 0)], right[(i, 1)]) = (b[own], probe(own));
            } else {
                x[(i, 0)] = held[own];
            }
        }
        let factor = Factor::of(self)?;
        for _ in 0..=REFINEMENTS {
            let residual = self.residual(&right, &x);
            x += factor.solve(residual);
        }
        let good = self.residual(&right, &x).column(1).amax() <= SINGULAR;
        let x: Vec<f64> = (0..nodes * d).map(|i| x[(i / d * 3 + i % d, 0)]).collect();
        (good && x.iter().all(|x| x.is_finite())).then_some((x, factor.definite))
    }

    /// `right - A x` where nothing is held, 0 elsewhere.
    fn residual(&self, right: &DMatrix<f64>, x: &DMatrix<f64>) -> DMatrix<f64> {
        let mut residual = right.clone();
        for (row, blocks) in self.rows.iter().enumerate() {
            for (column, block) in blocks {
                let product = block * x.fixed_rows::<3>(3 * column);
                let mut own = residual.fixed_rows_mut::<3>(3 * row);
                own -= product;
            }
        }
        for (i, _) in self.free.iter().enumerate().filter(|(_, free)| !**free) {
            residual.row_mut(i).fill(0.0);
        }
        residual
    }

    /// A block without the rows and columns of held unknowns, which have 1 on the diagonal.
    fn block(&self, row: usize, column: usize, block: &Matrix3<f64>) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| match self.free[3 * row + i] && self.free[3 * column + j] {
            true => block[(i, j)],
            false => f64::from(row == column && i == j),
        })
    }
}

/// Numbers between 1/2 and 1 of either sign without a pattern.
fn probe(i: usize) -> f64 {
    let hash = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11;
    let number = 0.5 + hash as f64 / (1u64 << 54) as f64;
    if hash & 1 == 0 { number } else { -number }
}

/// `A = L D L^T`.
struct Factor {
    /// Children come after their parents: elimination runs from the last to the first.
    fronts: Vec<Front>,
    definite: bool,
}

/// Nodes that are eliminated together.
struct Front {
    /// Which front takes what is left of this one; the first has none.
    parent: Option<usize>,
    /// Nodes that are eliminated here.
    own: usize,
    /// These, and the nodes that they still touch.
    nodes: Vec<usize>,
    panels: Vec<Panel>,
}

/// Unknowns that are eliminated at once.
struct Panel {
    /// First unknown in its front.
    start: usize,
    /// `D^-1`.
    inverse: DMatrix<f64>,
    /// `L` of the unknowns of the front that come after.
    below: DMatrix<f64>,
}

impl Factor {
    /// `None` if the matrix is singular.
    fn of(system: &System) -> Option<Self> {
        let mut fronts = dissect(&system.rows);
        let mut eliminated_in = vec![0; system.rows.len()];
        for (f, front) in fronts.iter().enumerate() {
            front.nodes.iter().for_each(|&node| eliminated_in[node] = f);
        }
        // what children leave to their parents: nodes, and a matrix of their unknowns
        let mut left: Vec<Vec<(Vec<usize>, DMatrix<f64>)>> = Vec::new();
        left.resize_with(fronts.len(), Vec::new);
        let mut place = vec![usize::MAX; system.rows.len()];
        let mut definite = true;
        for f in (0..fronts.len()).rev() {
            let front = &mut fronts[f];
            let children = std::mem::take(&mut left[f]);
            front.nodes.iter().enumerate().for_each(|(p, &node)| place[node] = p);
            let own = front.nodes.clone().into_iter().flat_map(|node| &system.rows[node]);
            let touched = own.map(|&(node, _)| node).filter(|&node| eliminated_in[node] < f);
            for node in touched.chain(children.iter().flat_map(|c| c.0.iter().copied())) {
                if place[node] == usize::MAX {
                    place[node] = front.nodes.len();
                    front.nodes.push(node);
                }
            }
            let size = 3 * front.nodes.len();
            let mut matrix = DMatrix::zeros(size, size);
            for (p, &row) in front.nodes[..front.own].iter().enumerate() {
                for (column, block) in &system.rows[row] {
                    let (q, block) = (place[*column], system.block(row, *column, block));
                    // those that were eliminated before are in what children leave
                    if eliminated_in[*column] <= f {
                        matrix.fixed_view_mut::<3, 3>(3 * p, 3 * q).copy_from(&block);
                        matrix.fixed_view_mut::<3, 3>(3 * q, 3 * p).copy_from(&block.transpose());
                    }
                }
            }
            for (nodes, rest) in children {
                for (j, q) in nodes.iter().map(|&node| place[node]).enumerate() {
                    for (i, p) in nodes.iter().map(|&node| place[node]).enumerate() {
                        let mut sum = matrix.fixed_view_mut::<3, 3>(3 * p, 3 * q);
                        sum += rest.fixed_view::<3, 3>(3 * i, 3 * j);
                    }
                }
            }
            front.nodes.iter().for_each(|&node| place[node] = usize::MAX);
            definite &= front.eliminate(&mut matrix)?;
            if let Some(parent) = front.parent {
                let first = 3 * front.own;
                let rest = matrix.view((first, first), (size - first, size - first)).into_owned();
                left[parent].push((front.nodes[front.own..].to_vec(), rest));
            }
        }
        Some(Self { fronts, definite })
    }

    fn solve(&self, mut right: DMatrix<f64>) -> DMatrix<f64> {
        let gather = |front: &Front, x: &DMatrix<f64>| {
            let row = |i: usize| 3 * front.nodes[i / 3] + i % 3;
            DMatrix::from_fn(3 * front.nodes.len(), 2, |i, j| x[(row(i), j)])
        };
        let scatter = |front: &Front, own: &DMatrix<f64>, x: &mut DMatrix<f64>| {
            for (i, &node) in front.nodes.iter().enumerate() {
                x.fixed_rows_mut::<3>(3 * node).copy_from(&own.fixed_rows::<3>(3 * i));
            }
        };
        for front in self.fronts.iter().rev() {
            let mut own = gather(front, &right);
            for Panel { start, inverse, below } in &front.panels {
                let end = start + inverse.nrows();
                let pivot = own.rows(*start, inverse.nrows()).into_owned();
                own.rows_mut(end, below.nrows()).gemm(-1.0, below, &pivot, 1.0);
            }
            scatter(front, &own, &mut right);
        }
        for front in &self.fronts {
            let mut own = gather(front, &right);
            for Panel { start, inverse, below } in front.panels.iter().rev() {
                let after = own.rows(start + inverse.nrows(), below.nrows()).into_owned();
                let pivot = inverse * own.rows(*start, inverse.nrows()) - below.tr_mul(&after);
                own.rows_mut(*start, inverse.nrows()).copy_from(&pivot);
            }
            scatter(front, &own, &mut right);
        }
        right
    }
}

impl Front {
    /// Eliminates the own unknowns of the front's matrix; what is left stands behind them. Says whether all
    /// pivots are positive definite; `None` if one is singular.
    fn eliminate(&mut self, matrix: &mut DMatrix<f64>) -> Option<bool> {
        let (size, own) = (matrix.nrows(), 3 * self.own);
        let mut definite = true;
        let mut start = 0;
        while start < own {
            let square = |width| matrix.view((start, start), (width, width)).into_owned();
            let mut width = PANEL.min(own - start);
            let inverse = match square(width).cholesky() {
                Some(factor) => factor.inverse(),
                None => {
                    definite = false;
                    // the more there is to choose pivots from the better
                    width = own - start;
                    square(width).full_piv_lu().try_inverse()?
                }
            };
            let (end, rest) = (start + width, size - start - width);
            let column = matrix.view((end, start), (rest, width)).into_owned();
            let below = &column * &inverse;
            let mut behind = matrix.view_mut((end, end), (rest, rest));
            behind.gemm(-1.0, &below, &column.transpose(), 1.0);
            self.panels.push(Panel { start, inverse, below });
            start = end;
        }
        Some(definite)
    }
}

/// Fronts of nested dissection, with their own nodes: a part is cut at the layer of nodes halfway from one
/// end to the other, distance being counted in edges.
fn dissect(rows: &[Vec<(usize, Matrix3<f64>)>]) -> Vec<Front> {
    let mut fronts = Vec::new();
    // part of every node, and whether a search has been there
    let mut part = vec![0; rows.len()];
    let mut parts = 0;
    let layers_from = |start: usize, inside: usize, part: &mut [usize], seen: usize| {
        let mut layers = vec![vec![start]];
        part[start] = seen;
        while let Some(last) = layers.last().filter(|last| !last.is_empty()) {
            let mut next = Vec::new();
            for &(node, _) in last.iter().flat_map(|&node| &rows[node]) {
                if part[node] == inside {
                    part[node] = seen;
                    next.push(node);
                }
            }
            layers.push(next);
        }
        layers.pop();
        layers
    };
    let mut stack = vec![((0..rows.len()).collect::<Vec<_>>(), None)];
    while let Some((nodes, parent)) = stack.pop() {
        let whole =
            |nodes: Vec<usize>| Front { parent, own: nodes.len(), nodes, panels: Vec::new() };
        if nodes.len() <= LEAF {
            fronts.push(whole(nodes));
            continue;
        }
        let [inside, seen, again] = [1, 2, 3].map(|k| parts + k);
        parts += 3;
        nodes.iter().for_each(|&node| part[node] = inside);
        let first = layers_from(nodes[0], inside, &mut part, seen);
        let reached = first.iter().map(Vec::len).sum::<usize>();
        if reached < nodes.len() {
            let (one, other) = nodes.into_iter().partition(|&node| part[node] == seen);
            stack.extend([(one, parent), (other, parent)]);
            continue;
        }
        // from one end of the part, not from its middle
        let end = first.last().map_or(nodes[0], |last| last[0]);
        let layers = layers_from(end, seen, &mut part, again);
        if layers.len() < 3 {
            fronts.push(whole(nodes));
            continue;
        }
        let mut before = 0;
        let half = layers.iter().position(|layer| {
            before += layer.len();
            2 * before >= reached
        });
        // with something on either side
        let middle = half.unwrap_or(1).clamp(1, layers.len() - 2);
        let front = fronts.len();
        stack.push((layers[..middle].concat(), Some(front)));
        stack.push((layers[middle + 1..].concat(), Some(front)));
        fronts.push(whole(layers[middle].clone()));
    }
    fronts
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Springs of a grid of `n` nodes a side, with their neighbours along axes and diagonals; one end is held.
    fn grid(n: usize, constant: impl Fn(usize) -> f64) -> (System, Vec<Option<f64>>, DMatrix<f64>) {
        let at = |i: usize| [i % n, i / n % n, i / (n * n)].map(|x| x as f64);
        let nodes = n * n * n;
        let held: Vec<_> = (0..3 * nodes).map(|i| (at(i / 3)[0] == 0.0).then_some(0.1)).collect();
        let mut system = System::new(&held, 3);
        let mut dense = DMatrix::zeros(3 * nodes, 3 * nodes);
        let mut spring = 0;
        for a in 0..nodes {
            for b in a + 1..nodes {
                let d: [f64; 3] = std::array::from_fn(|k| at(b)[k] - at(a)[k]);
                if d.iter().any(|d| d.abs() > 1.0) {
                    continue;
                }
                spring += 1;
                for (i, j) in (0..9).map(|k| (k / 3, k % 3)) {
                    let value = constant(spring) * d[i] * d[j];
                    for (p, q, sign) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
                        system.add(3 * p + i, 3 * q + j, sign * value);
                        dense[(3 * p + i, 3 * q + j)] += sign * value;
                    }
                }
            }
        }
        (system, held, dense)
    }

    #[test]
    fn solutions_are_those_of_a_dense_factorisation() {
        // every seventh constant negative: indefinite
        for negative in [false, true] {
            let constant = |s: usize| {
                if negative && s.is_multiple_of(7) { -2.0 } else { 1.0 + (s % 3) as f64 }
            };
            let (system, held, mut dense) = grid(5, constant);
            assert!(dissect(&system.rows).len() > 5);
            let force: Vec<f64> = (0..held.len()).map(probe).collect();
            let values: Vec<f64> = held.iter().map(|h| h.unwrap_or(0.0)).collect();
            let (x, definite) = system.solve(&force, &values).unwrap();
            let mut right = nalgebra::DVector::from_vec(force);
            right -= &dense * nalgebra::DVector::from_vec(values.clone());
            for i in (0..held.len()).filter(|&i| held[i].is_some()) {
                dense.row_mut(i).fill(0.0);
                dense.column_mut(i).fill(0.0);
                (dense[(i, i)], right[i]) = (1.0, values[i]);
            }
            let least = dense.clone().symmetric_eigenvalues().min();
            let exact = dense.lu().solve(&right).unwrap();
            let far = exact.iter().zip(&x).fold(0.0, |m: f64, (e, x)| m.max((e - x).abs()));
            assert!(far < 1e-11 * exact.amax(), "{far} of {}", exact.amax());
            assert_eq!((definite, definite), (least > 0.0, !negative));
        }
    }

    #[test]
    fn parts_that_nothing_holds_are_singular() {
        let (system, held, _) = grid(4, |_| 1.0);
        let zero = vec![0.0; held.len()];
        assert!(system.solve(&zero, &zero).is_some());
        let loose = System { free: vec![true; held.len()], ..system };
        assert!(loose.solve(&zero, &zero).is_none());
        // two bodies beside each other, one of them held
        let mut two = System::new(&[&held[..], &vec![None; held.len()]].concat(), 3);
        for (row, blocks) in loose.rows.iter().enumerate() {
            for (column, block) in blocks {
                for (i, j) in (0..9).map(|k| (k / 3, k % 3)) {
                    two.add(3 * row + i, 3 * column + j, block[(i, j)]);
                    two.add(held.len() + 3 * row + i, held.len() + 3 * column + j, block[(i, j)]);
                }
            }
        }
        let zero = vec![0.0; 2 * held.len()];
        assert!(two.solve(&zero, &zero).is_none());
        two.free[held.len()..]
            .copy_from_slice(&held.iter().map(Option::is_none).collect::<Vec<_>>());
        assert!(two.solve(&zero, &zero).is_some());
    }
}
