//! Two soft blocks in contact beside rivals, in the frame of [`touch`](super::touch): a second block of the same mesh is
//! pressed on the first by its held top face, held there and dragged, with the same material, lumped masses, damping and
//! motion in every engine.
//!
//! * **Truth**: the equilibrium on the same mesh under the held face, by converged Newton with Sinew's contact of default
//!   stiffness, which lets surfaces into each other by half a percent of an edge. The equilibrium on a mesh of half the
//!   edge, which every row is held against too, tells what the mesh costs.
//! * **Depth**: the largest height by which a vertex of either of the faces that meet is beyond the other face.
//! * **Without contact**: the same two blocks a block's width apart swing undamped under their own weight while the upper one
//!   goes the same way: blocks that hang at rest would cost next to nothing.

use super::touch::{Finger, TURN, TouchBlock, TouchTruth, TouchWay, Trace, run_until, truth};
use crate::toolbox::prelude::*;
use crate::toolbox::stats::median;

/// Edges (m) of a block: those of `sinew-lab bench contact`, so that figures can be compared.
pub const SIZE: DVec3 = DVec3::new(0.1, 0.1, 0.05);
/// Soft tissue, nearly incompressible, as soft as liver; all engines bear it.
const TISSUE: YoungPoisson =
    YoungPoisson { young_modulus: 5e3, poisson_ratio: 0.45, density: 1000.0 };
/// Way (m) before the blocks touch: with it the press takes one turn.
const GAP: f64 = 0.001;
/// The upper block is shifted, so that no vertex lies on a vertex, edge or diagonal of the other. Pressed by 4 mm both blocks
/// are shorter by 4 %. The drag goes over two to four edges, of which the second half counts: friction, which shears the
/// blocks by 4 to 5 mm, slips everywhere by then; it is as fast as the press.
pub const WAY: TouchWay = TouchWay {
    start: DVec3::new(0.003, 0.002, SIZE.z + GAP),
    gap: GAP,
    depth: 0.004,
    drag: [0.03, 0.05],
    blocks: true,
};
/// Way (m) by which the upper block is higher where the two are apart.
const APART: f64 = 0.1;
/// Time (s) of the run apart, of which all but the first turn counts: several periods (0.1 s) of a block along z.
const SWING: f64 = 0.6;

impl TouchBlock {
    /// Two blocks, of so many cells along each edge, six tetrahedra each.
    ///
    /// # Errors
    /// When a number of cells is zero.
    pub fn pair(cells: [usize; 3]) -> Result<Self> {
        Self::of(SIZE, cells, TISSUE, WAY, "two blocks of".into())
    }
}

/// Cells along each edge: cubes of a seventh and of a twelfth of the width, 1 176 and 5 184 tetrahedra a block.
pub fn cells(quick: bool) -> [usize; 3] {
    if quick { [7, 7, 4] } else { [12, 12, 6] }
}

/// The same blocks of half the edge.
///
/// # Errors
/// When they cannot be made.
pub fn finer(block: &TouchBlock) -> Result<TouchBlock> {
    TouchBlock::pair(block.cells.map(|n| 2 * n))
}

/// The equilibrium of an energy, or a row that says why there is none.
///
/// # Errors
/// When the blocks cannot be made or stepped.
pub fn truth_or_reason(block: &TouchBlock, model: Model) -> Result<TouchTruth> {
    match truth(block, model, None) {
        Err(BenchError::NoTruth { case, reason }) => {
            let mut row = block.row("truth", env!("CARGO_PKG_VERSION"), case);
            row.note = format!("does not converge: {reason}");
            Ok(TouchTruth { model, row })
        }
        other => other,
    }
}

/// Median time (ms) of a step of every engine with the blocks apart, where it can be made.
pub fn apart(block: &TouchBlock, fingers: &mut [Box<dyn Finger + '_>]) -> Vec<Option<f64>> {
    let mut block = block.clone();
    block.way.start.z += APART;
    (block.gravity, block.damping) = (9.81, 0.0);
    let traces = run_until(&block, fingers, 0.0, SWING);
    let cost = |trace: &Trace| {
        let times: Vec<f64> = trace.between(TURN, SWING).map(|s| s.ms).collect();
        trace.failed.is_none().then(|| median(&times)).flatten()
    };
    traces.iter().map(cost).collect()
}

/// Largest height (m) by which a vertex of either face is beyond the other, negative while apart. Both are nearly level.
pub fn depth(block: &TouchBlock, u: &[DVec3]) -> f64 {
    let n = block.mesh.points.len();
    let place = |upper: bool, v: u32| {
        let v = v as usize;
        let start = if upper { block.way.start + u[n + v] } else { u[v] };
        block.mesh.points[v] + start
    };
    let mut deepest = f64::NEG_INFINITY;
    for upper in [false, true] {
        // vertices of one block, faces of the other
        let [own, other] =
            [[&block.surface, &block.fixed], [&block.fixed, &block.surface]][usize::from(upper)];
        let faces = block.mesh.triangles.iter().filter(|t| t.iter().all(|v| other.contains(v)));
        for corners in faces.map(|t| t.map(|v| place(!upper, v))) {
            let [a, b, c] = corners.map(|x| x.truncate());
            let area = (b - a).perp_dot(c - a);
            for x in own.iter().map(|&v| place(upper, v)) {
                let q = x.truncate();
                let weights = [(b - q).perp_dot(c - q), (c - q).perp_dot(a - q)].map(|w| w / area);
                let weights = [weights[0], weights[1], 1.0 - weights[0] - weights[1]];
                if weights.iter().all(|&w| w >= 0.0) {
                    let z: f64 = corners.iter().zip(weights).map(|(x, w)| w * x.z).sum();
                    deepest = deepest.max(if upper { z - x.z } else { x.z - z });
                }
            }
        }
    }
    deepest
}

/// Values at even distances less the parabola nearest to them, in the sense of least squares.
pub fn off_parabola(values: &[f64]) -> Vec<f64> {
    let middle = 0.5 * (values.len() as f64 - 1.0);
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let mut rest = values.to_vec();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let remove = |from: &mut [f64], along: &[f64]| {
        let share = dot(from, along) / dot(along, along);
        from.iter_mut().zip(along).for_each(|(x, y)| *x -= share * y);
    };
    for power in 0..3 {
        let mut next: Vec<f64> =
            (0..values.len()).map(|i| (i as f64 - middle).powi(power)).collect();
        basis.iter().for_each(|known| remove(&mut next, known));
        remove(&mut rest, &next);
        basis.push(next);
    }
    rest
}
