//! Cholesky factor of a symmetric matrix of 6x6 blocks within its envelope.

use sinew_engine::scalar::Scalar;
use sinew_engine::simd::VectorKernel;

/// Unknowns of a node.
pub const MODES: usize = 6;

/// Vector over the unknowns of a node, padded.
type Node<T> = [T; 8];
/// Column `k` holds the entries `(0..6, k)` of a block.
pub type Columns<T> = [Node<T>; MODES];

/// Column of the first block of each row of blocks.
#[derive(Clone, Debug, Default)]
pub struct Profile(Vec<u32>);

impl Profile {
    pub fn new(nodes: usize) -> Self {
        Self((0..nodes as u32).collect())
    }

    /// Notes that the nodes `a <= b` are coupled.
    pub fn couple(&mut self, [a, b]: [u32; 2]) {
        let first = &mut self.0[b as usize];
        *first = (*first).min(a);
    }

    /// Blocks off the diagonal of each row.
    fn widths(&self) -> impl Iterator<Item = usize> {
        self.0.iter().enumerate().map(|(row, &first)| row - first as usize)
    }

    /// Blocks off the diagonal.
    pub fn size(&self) -> usize {
        self.widths().sum()
    }
}

/// Cholesky factor by 6x6 blocks within the envelope of a symmetric matrix: every row of blocks is
/// stored from its first to the one before the diagonal.
#[derive(Clone, Debug, Default)]
pub struct Envelope<T> {
    profile: Profile,
    /// Where each row starts.
    start: Vec<usize>,
    /// The matrix, then its factor.
    work: Vec<Columns<f64>>,
    diagonal: Vec<Columns<f64>>,
    pub lower: Vec<Columns<T>>,
    /// Inverses of the diagonal blocks of the factor, with zero rows and columns for unknowns without
    /// a pivot.
    pub inverse: Vec<Columns<T>>,
    gathered: Vec<Columns<T>>,
}

/// Pivots below this share of the diagonal entry are rounding of the sums behind them.
const PIVOT: f64 = 1e-6;

impl<T: Scalar> Envelope<T> {
    pub fn new(profile: Profile) -> Self {
        let mut start = vec![0];
        for width in profile.widths() {
            start.push(start[start.len() - 1] + width);
        }
        let (size, nodes) = (profile.size(), profile.0.len());
        Self {
            profile,
            start,
            work: vec![[[0.0; 8]; MODES]; size],
            diagonal: vec![[[0.0; 8]; MODES]; nodes],
            lower: vec![[[T::ZERO; 8]; MODES]; size],
            inverse: vec![[[T::ZERO; 8]; MODES]; nodes],
            gathered: vec![[[T::ZERO; 8]; MODES]; nodes],
        }
    }

    /// Products of blocks that the factor takes, about.
    pub fn products(&self) -> f64 {
        self.profile.widths().map(|width| 0.5 * (width as f64).powi(2)).sum()
    }

    pub fn len(&self) -> usize {
        self.diagonal.len()
    }

    pub fn clear(&mut self) {
        self.work.fill([[0.0; 8]; MODES]);
        self.diagonal.fill([[0.0; 8]; MODES]);
    }

    /// Enters the block that couples the nodes `a <= b`, row-major with the rows of `a`.
    pub fn set(&mut self, [a, b]: [u32; 2], value: &[f64; 36]) {
        let (a, b) = (a as usize, b as usize);
        let to = if a == b {
            &mut self.diagonal[b]
        } else {
            &mut self.work[self.start[b] + a - self.profile.0[b] as usize]
        };
        for k in 0..MODES {
            to[k][..MODES].copy_from_slice(&value[MODES * k..MODES * (k + 1)]);
        }
    }

    /// Row by row: a row is the solution of a triangular system with the rows above it. A matrix that is not positive has no
    /// factor, and what goes on without its negative pivots may grow beyond all bounds: solutions are zero then.
    #[inline(always)]
    fn factorise(&mut self) {
        let mut positive = true;
        for row in 0..self.len() {
            let f = self.profile.0[row] as usize;
            let (above, own) = self.work.split_at_mut(self.start[row]);
            let own = &mut own[..row - f];
            for column in f..row {
                let of_column = self.profile.0[column] as usize;
                let from = f.max(of_column);
                let begin = self.start[column] + from - of_column;
                let (done, rest) = own.split_at_mut(column - f);
                let mut block = rest[0];
                let other = &above[begin..begin + column - from];
                for (x, y) in done[from - f..].iter().zip(other) {
                    subtract_outer(&mut block, x, y);
                }
                // times the transposed inverse of the diagonal block of `column`
                let inverse = &self.diagonal[column];
                let mut out = [[0.0; 8]; MODES];
                for k in 0..MODES {
                    for j in 0..=k {
                        for i in 0..8 {
                            out[k][i] += block[j][i] * inverse[j][k];
                        }
                    }
                }
                rest[0] = out;
            }
            let original = self.diagonal[row];
            let mut block = original;
            for x in own.iter() {
                subtract_outer(&mut block, x, x);
            }
            let (inverse, dropped, own_positive) = invert_factor(&block, &original);
            positive &= own_positive;
            self.diagonal[row] = inverse;
            for i in (0..MODES).filter(|&i| dropped[i]) {
                for x in own.iter_mut() {
                    for k in 0..MODES {
                        x[k][i] = 0.0;
                    }
                }
            }
        }
        let narrow = |x: &Columns<f64>| x.map(|c| c.map(T::from_f64));
        for (t, x) in self.lower.iter_mut().zip(&self.work) {
            *t = narrow(x);
        }
        for (t, x) in self.inverse.iter_mut().zip(&self.diagonal) {
            *t = if positive { narrow(x) } else { [[T::ZERO; 8]; MODES] };
        }
    }

    /// Solves in place.
    #[inline(always)]
    fn solve(&mut self, x: &mut [Node<T>]) {
        for row in 0..self.len() {
            let f = self.profile.0[row] as usize;
            // three sums, so that none has to wait for the last one
            let mut sums = [x[row], [T::ZERO; 8], [T::ZERO; 8]];
            for (block, y) in self.lower[self.start[row]..].iter().zip(&x[f..row]) {
                for k in 0..MODES {
                    sums[k % 3] = subtract_scaled(sums[k % 3], block[k], y[k]);
                }
            }
            let mut own = [T::ZERO; 8];
            for k in 0..MODES {
                own[k] = sums[0][k] + sums[1][k] + sums[2][k];
            }
            let mut out = [T::ZERO; 8];
            for k in 0..MODES {
                out = subtract_scaled(out, self.inverse[row][k], -own[k]);
            }
            x[row] = out;
        }
        self.gathered.fill([[T::ZERO; 8]; MODES]);
        for row in (0..self.len()).rev() {
            let f = self.profile.0[row] as usize;
            let mut own = x[row];
            for k in 0..MODES {
                own[k] -= sum8(&self.gathered[row][k]);
            }
            let mut out = [T::ZERO; 8];
            for k in 0..MODES {
                let mut terms = [T::ZERO; 8];
                for i in 0..MODES {
                    terms[i] = self.inverse[row][k][i] * own[i];
                }
                out[k] = sum8(&terms);
            }
            x[row] = out;
            let blocks = &self.lower[self.start[row]..];
            for (block, sum) in blocks.iter().zip(&mut self.gathered[f..row]) {
                for k in 0..MODES {
                    sum[k] = add_product(sum[k], block[k], out);
                }
            }
        }
    }
}

pub struct FactoriseEnvelope<'a, T>(pub &'a mut Envelope<T>);

impl<T: Scalar> VectorKernel for FactoriseEnvelope<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.0.factorise();
    }
}

pub struct SolveEnvelope<'a, T>(pub &'a mut Envelope<T>, pub &'a mut [Node<T>]);

impl<T: Scalar> VectorKernel for SolveEnvelope<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.0.solve(self.1);
    }
}

/// `t -= x y^T`, all by columns.
#[inline(always)]
fn subtract_outer(t: &mut Columns<f64>, x: &Columns<f64>, y: &Columns<f64>) {
    for j in 0..MODES {
        for k in 0..MODES {
            t[j] = subtract_scaled(t[j], x[k], y[k][j]);
        }
    }
}

/// `t - s x`.
#[inline(always)]
fn subtract_scaled<T: Scalar>(t: Node<T>, x: Node<T>, s: T) -> Node<T> {
    [
        t[0] - x[0] * s,
        t[1] - x[1] * s,
        t[2] - x[2] * s,
        t[3] - x[3] * s,
        t[4] - x[4] * s,
        t[5] - x[5] * s,
        t[6] - x[6] * s,
        t[7] - x[7] * s,
    ]
}

/// `t + x y`, entry by entry.
#[inline(always)]
fn add_product<T: Scalar>(t: Node<T>, x: Node<T>, y: Node<T>) -> Node<T> {
    [
        t[0] + x[0] * y[0],
        t[1] + x[1] * y[1],
        t[2] + x[2] * y[2],
        t[3] + x[3] * y[3],
        t[4] + x[4] * y[4],
        t[5] + x[5] * y[5],
        t[6] + x[6] * y[6],
        t[7] + x[7] * y[7],
    ]
}

#[inline(always)]
fn sum8<T: Scalar>(x: &Node<T>) -> T {
    ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]))
}

/// Inverse of the Cholesky factor of a block, the unknowns without a pivot, and whether no pivot is negative by more than
/// rounding; `original` is the diagonal block before elimination, against which pivots are measured.
fn invert_factor(
    block: &Columns<f64>,
    original: &Columns<f64>,
) -> (Columns<f64>, [bool; MODES], bool) {
    let mut l = [[0.0; MODES]; MODES];
    let mut dropped = [false; MODES];
    let mut positive = true;
    for i in 0..MODES {
        for j in 0..i {
            let dot: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            l[i][j] = if dropped[j] { 0.0 } else { (block[j][i] - dot) / l[j][j] };
        }
        let dot: f64 = (0..i).map(|k| l[i][k] * l[i][k]).sum();
        let pivot = block[i][i] - dot;
        // written so that a pivot that is not a number is dropped too
        let least = PIVOT * original[i][i].abs();
        dropped[i] = !(pivot > least && pivot.is_finite());
        positive &= pivot >= -least;
        if dropped[i] {
            l[i] = [0.0; MODES];
        } else {
            l[i][i] = pivot.sqrt();
        }
    }
    let mut inverse = [[0.0; 8]; MODES];
    for k in (0..MODES).filter(|&k| !dropped[k]) {
        inverse[k][k] = 1.0 / l[k][k];
        for i in (k + 1..MODES).filter(|&i| !dropped[i]) {
            let dot: f64 = (k..i).map(|j| l[i][j] * inverse[k][j]).sum();
            inverse[k][i] = -dot / l[i][i];
        }
    }
    (inverse, dropped, positive)
}
