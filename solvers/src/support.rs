//! Whether a body is held against rigid motion, without which its equilibrium is not unique.

use crate::state::NodeState;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::columns::single_table;
use sinew_engine::layout::UNUSED;
use sinew_engine::scalar::Scalar;
use sinew_engine::step::StepError;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::RestPosition;

/// Pivot of the rigid-motion matrix, relative to the largest, below which a motion counts as free.
const FREE: f64 = 1e-9;

/// Every connected piece of elements must have its six rigid motions held.
///
/// # Errors
/// [`StepError::InvalidSetting`] naming the body, a vertex of the piece and the number of motions
/// that are free.
pub fn check_support<S: Scalar>(world: &mut World, node: &NodeState<S>) -> Result<(), StepError> {
    let mut query = world.query::<&RestPosition>();
    let Some(rest) = single_table(query.contiguous_iter(world)) else { return Ok(()) };
    for body in &world.resource::<Topology>().bodies {
        let first = body.vertices.start as usize;
        let centre = rest[first].0;
        // Gram matrix of the held unknowns against the rigid motions, piece by piece
        let mut gram = vec![[[0.0; 6]; 6]; body.piece_count()];
        let mut sample = vec![0; body.piece_count()];
        for (local, &piece) in body.piece.iter().enumerate() {
            if piece == UNUSED {
                continue;
            }
            let row = first + local;
            sample[piece as usize] = body.vertex_order[local];
            let arm = (rest[row].0 - centre) / body.size;
            for k in (0..3).filter(|&k| !node.free(row, k)) {
                let axis = DVec3::AXES[k];
                let turn = arm.cross(axis);
                let w = [axis.x, axis.y, axis.z, turn.x, turn.y, turn.z];
                for i in 0..6 {
                    for j in 0..6 {
                        gram[piece as usize][i][j] += w[i] * w[j];
                    }
                }
            }
        }
        for (piece, gram) in gram.iter_mut().enumerate() {
            let free = 6 - rank(gram);
            if free > 0 {
                return Err(StepError::InvalidSetting(format!(
                    "body `{}`: {free} of the 6 rigid motions of the piece with vertex {} are not \
                     held, so its equilibrium is not unique; fix more vertices or axes, or use a \
                     dynamic integrator",
                    body.name, sample[piece]
                )));
            }
        }
    }
    Ok(())
}

/// Rank of a positive semi-definite matrix, by elimination with the largest pivot first.
fn rank(m: &mut [[f64; 6]; 6]) -> usize {
    let largest = (0..6).map(|i| m[i][i]).fold(0.0, f64::max);
    let mut used = [false; 6];
    for found in 0..6 {
        let pivot = (0..6).filter(|&i| !used[i]).max_by(|&a, &b| m[a][a].total_cmp(&m[b][b]));
        let Some(p) = pivot.filter(|&p| m[p][p] > FREE * largest) else { return found };
        used[p] = true;
        for i in (0..6).filter(|&i| !used[i]) {
            let factor = m[i][p] / m[p][p];
            for j in 0..6 {
                m[i][j] -= factor * m[p][j];
            }
        }
    }
    6
}

#[cfg(test)]
mod tests {
    use super::rank;

    #[test]
    fn rank_of_singular_and_regular_matrices() {
        let mut m = [[0.0; 6]; 6];
        assert_eq!(rank(&mut m.clone()), 0);
        for i in 0..6 {
            m[i][i] = 1.0 + i as f64;
        }
        assert_eq!(rank(&mut m.clone()), 6);
        m[3][3] = 1e-12;
        assert_eq!(rank(&mut m), 5);
    }
}
