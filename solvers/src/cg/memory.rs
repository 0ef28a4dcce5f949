//! Values that conjugate gradients keep between solves, for snapshots. Iterates depend on the values of the
//! preconditioner, within the tolerance: without them a restored state would not go on with the same bits.

use super::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The values of a preconditioner. They change at refreshes only, so that snapshots between two share them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
struct Values<T: Scalar> {
    /// Pattern that the preconditioner was made for, where it is another one now.
    pattern: Option<Arc<Pattern>>,
    /// Connected piece of every row when the aggregates were chosen.
    pieces: Vec<u32>,
    cholesky: Vec<FactorValues<T>>,
    coarse: Option<CoarseValues<T>>,
    /// Whether the matrix had a low-rank part.
    corrected: bool,
}

/// A kept preconditioner, and how well it did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub struct PreconditionerMemory<T: Scalar> {
    kept: KeptFor,
    values: Arc<Values<T>>,
}

/// The last copy of the values, while it holds.
#[derive(Clone, Debug, Default)]
pub(super) struct SharedValues<T: Scalar>(Option<Arc<Values<T>>>);

impl<T: Scalar> SharedValues<T> {
    pub fn forget(&mut self) {
        self.0 = None;
    }
}

/// Kept values that do not belong to the bodies they are given to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryMisfit;

impl<T: Scalar> ConjugateGradients<T> {
    /// Forgets the last copy of the values: the pattern is another one.
    pub fn forget_copy(&mut self) {
        self.shared.forget();
    }

    /// The kept preconditioner, if the next solve may use it.
    pub fn memory(
        &mut self,
        (topology, bodies, pattern): (&Topology, &Range<usize>, &Arc<Pattern>),
    ) -> Option<PreconditionerMemory<T>> {
        let kept = self.kept_for(topology, bodies)?.clone();
        let values = self.shared.0.get_or_insert_with(|| {
            let (own, pieces) = &self.laid_out_for;
            Arc::new(Values {
                pattern: (own != pattern).then(|| own.clone()),
                pieces: pieces.clone(),
                cholesky: self.cholesky.values(),
                coarse: self.coarse.as_ref().map(CoarseSpace::values),
                corrected: self.correction.is_some(),
            })
        });
        Some(PreconditionerMemory { kept, values: values.clone() })
    }

    /// Restores a kept preconditioner; `rest` (m) belongs to the rows of the bodies.
    ///
    /// # Errors
    /// When it does not belong to them; nothing is kept then.
    pub fn recall(
        &mut self,
        topology: &Topology,
        bodies: &Range<usize>,
        (pattern, rest): (&Arc<Pattern>, &[DVec3]),
        memory: Option<&PreconditionerMemory<T>>,
    ) -> Result<(), MemoryMisfit> {
        let now = self.kept.take();
        let Some(PreconditionerMemory { kept, values }) = memory else {
            self.shared.forget();
            return Ok(());
        };
        let same = self.shared.0.as_ref().is_some_and(|shared| Arc::ptr_eq(shared, values));
        if !same {
            self.shared.forget();
            let n = pattern.len();
            let own = values.pattern.as_ref();
            let is_sound = own.is_none_or(|own| own.is_sound(n) && own.ends() == pattern.ends());
            let fits =
                is_sound && values.pieces.len() == n && kept.held.len() == n && rest.len() == n;
            if !fits || matches!(kept.kind, Preconditioner::Auto | Preconditioner::Direct) {
                return Err(MemoryMisfit);
            }
            let corrected = values.corrected;
            let own = own.unwrap_or(pattern);
            if now.is_none_or(|now| now.kind != kept.kind)
                || self.laid_out_for.0 != *own
                || self.laid_out_for.1 != values.pieces
                || self.correction.is_some() != corrected
            {
                let (piece, ends) = (&values.pieces, &ends(topology, bodies));
                self.lay_out(own, Rows { rest, piece, ends }, kept.kind, corrected);
            }
            let coarse = match (&mut self.coarse, &values.coarse) {
                (None, None) => true,
                (Some(coarse), Some(values)) => coarse.recall(values),
                _ => false,
            };
            if !(coarse && self.cholesky.recall(&values.cholesky)) {
                return Err(MemoryMisfit);
            }
            self.shared.0 = Some(values.clone());
        }
        self.kept = Some(KeptFor { splits: splits(topology, bodies), ..kept.clone() });
        Ok(())
    }
}
