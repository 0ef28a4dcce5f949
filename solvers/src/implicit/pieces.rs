//! Steps of bodies in pieces. A body has one line search and one energy cap; where either has to shorten or slow something, it does so
//! to the pieces that are the cause: what is cut off falls as it must, although what is held overshoots. Bodies that share a solve share
//! both, too; where none of them is in pieces, all is done to all of them.

use super::line_search::LineSearch;
use super::step::{ImplicitScratch, Step};
use super::touch::At;
use crate::state::evaluate;
use sinew_contact::limits::Limits;
use sinew_engine::law::ElasticEnergy;
use sinew_engine::layout::UNUSED;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use std::collections::BTreeMap;
use std::ops::Range;

/// Most step lengths of a body in pieces.
const OWN_STEPS: usize = 8;
/// Most halvings of one of them.
const PIECE_HALVINGS: u32 = 12;

impl<S: Scalar> Step<'_, S> {
    /// Shortens a step that is too long by those pieces whose own step is, each by itself, contact taken as linear. Whether one
    /// was; the direction is then that of all, and to be tried. Newton, which goes on until all pieces are where they belong, has
    /// no need of it.
    pub(super) fn shorten_pieces(&mut self, search: &mut LineSearch) -> bool {
        if search.by_pieces.is_some() {
            return false;
        }
        search.by_pieces = Some(false);
        let (index, rows) = (search.body, self.bodies[search.body].rows.clone());
        let (piece, count) = pieces(self.world.resource(), &self.bodies[index].bodies);
        if count < 2 {
            return false;
        }
        let ImplicitScratch { direction, bend, .. } = &*self.scratch;
        let straight = direction[rows.clone()].to_vec();
        let bend = bend.get(rows.clone()).unwrap_or(&[]).to_vec();
        let set = |scratch: &mut ImplicitScratch<S>, fractions: &[f64]| {
            for (at, row) in rows.clone().enumerate() {
                let t = S::from_f64(fractions[piece[at]]);
                // what is not finite stays where it is
                let part = |d: S, t: S| if t == S::ZERO { t } else { t * d };
                scratch.direction[row] = straight[at].map(|d| part(d, t));
                if let Some(bend) = bend.get(at) {
                    scratch.bend[row] = bend.map(|d| part(d, t * t));
                }
            }
        };
        let (mut fractions, mut failed) = (Vec::new(), false);
        for own in 0..count {
            let alone: Vec<f64> = (0..count).map(|p| if p == own { 1.0 } else { 0.0 }).collect();
            set(self.scratch, &alone);
            let (mut search, contact) = self.search_again(index);
            // noise of a solve in a piece at rest leads nowhere
            let falls = search.slope < 0.0;
            let accepted = falls
                && (0..PIECE_HALVINGS).any(|_| {
                    self.scratch.set_trial(&self.bodies[index], search.fraction);
                    evaluate(self.world, &self.scratch.trial, true, false, None);
                    self.report.evaluations += 1;
                    let elastic = self.elastic_change(index);
                    let accepted =
                        search.accepts(search.change(elastic + contact * search.fraction));
                    if !accepted {
                        self.report.backtracks += 1;
                        search.fraction *= 0.5;
                    }
                    accepted
                });
            fractions.push(if accepted { search.fraction } else { 0.0 });
            failed |= falls && !accepted;
        }
        set(self.scratch, &fractions);
        let mut of_all = self.search_again(index).0;
        // where none is too fast for itself, they are too fast for each other
        let is_shorter = fractions.iter().any(|t| *t < 1.0) && of_all.slope < 0.0;
        if is_shorter {
            self.report.line_search_failures += u32::from(failed);
        } else {
            set(self.scratch, &vec![1.0; count]);
            of_all = self.search_again(index).0;
        }
        *search = of_all;
        search.by_pieces = Some(is_shorter);
        is_shorter
    }

    /// By how much (J) the elastic energy of a body at the displacements evaluated is another than at the iterate.
    fn elastic_change(&self, index: usize) -> f64 {
        let body = &self.bodies[index];
        body.sum(&self.world.resource::<ElasticEnergy>().by_body) - body.elastic
    }

    /// The rows of a body with more energy than its budget, of those pieces that have gained some themselves; all of them where
    /// there is but one piece. `stored` is the energy (J) of contact.
    pub(super) fn rows_in_excess(&mut self, index: usize, stored: f64) -> Vec<usize> {
        let rows = self.bodies[index].rows.clone();
        let (piece, count) = pieces(self.world.resource(), &self.bodies[index].bodies);
        if count < 2 {
            return rows.collect();
        }
        let mut gains = vec![false; count];
        for (own, gains) in gains.iter_mut().enumerate() {
            let scratch = &mut *self.scratch;
            scratch.trial.clone_from(&scratch.iterate);
            let (mut kinetic, mut loads) = (0.0, 0.0);
            for row in rows.clone().filter(|row| piece[row - rows.start] == own) {
                for k in scratch.node.free_axes(row) {
                    scratch.trial[row][k] = scratch.node.u[row][k];
                }
                let of = |u: &[[S; 4]]| scratch.node.load_potential(row..row + 1, u);
                loads += of(&scratch.iterate) - of(&scratch.trial);
                let of = |v: &[[S; 4]]| scratch.node.kinetic_energy(row..row + 1, v)[0];
                kinetic += of(&scratch.velocity) - of(&scratch.node.v);
            }
            evaluate(self.world, &self.scratch.trial, true, false, None);
            self.report.evaluations += 1;
            let contact = stored - self.contact_energy(index, At::Trial, Limits::Keep);
            *gains = kinetic + contact - self.elastic_change(index) - loads > 0.0;
        }
        // what others find of elements and contact is that at the end of the step
        evaluate(self.world, &self.scratch.iterate, true, false, None);
        self.contact_energy(index, At::Iterate, Limits::Keep);
        self.report.evaluations += 1;
        rows.clone().filter(|row| gains[piece[row - rows.start]]).collect()
    }
}

/// Number of the piece of every row of some bodies that share a solve, and how many there are: one where no body is in pieces. The
/// smallest pieces, and rows without elements, go with the last.
fn pieces(topology: &Topology, bodies: &Range<usize>) -> (Vec<usize>, usize) {
    let of_rows = bodies
        .clone()
        .flat_map(|body| topology.bodies[body].piece.iter().map(move |&piece| (body, piece)));
    if bodies.clone().all(|body| topology.bodies[body].piece_count() < 2) {
        return (vec![0; of_rows.count()], 1);
    }
    let mut sizes = BTreeMap::<(usize, u32), usize>::new();
    of_rows.clone().for_each(|own| *sizes.entry(own).or_default() += 1);
    let mut largest: Vec<_> =
        sizes.into_iter().filter(|((_, piece), _)| *piece != UNUSED).collect();
    // a stable sort: the first of equals first
    largest.sort_by_key(|(_, size)| std::cmp::Reverse(*size));
    largest.truncate(OWN_STEPS);
    let count = largest.len();
    let last = count.saturating_sub(1);
    let number = |own| largest.iter().position(|(of, _)| *of == own).unwrap_or(last);
    (of_rows.map(number).collect(), count)
}
