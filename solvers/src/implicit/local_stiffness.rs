//! Change of a tool's force with small motions of the tool, with the tissue moving along within the step. Haptic
//! devices and rigid bodies that go on between two steps need it.
//!
//! A tool that ends its way by `c` further changes the forces on the tissue it touches by `C (c - B x)`, `C` being the
//! tangents of its points and `B` their shares of the unknowns, and the tissue gives way by `(A + C) x = B^T C c`. Three
//! solves with the last matrix give `x` for the three axes.

use super::newton::{BookSolve, system_matrix};
use super::step::{ImplicitScratch, Step};
use super::touch::At;
use crate::cg::CgStatus;
use crate::state::Rows;
use glam::DVec3;
use sinew_contact::limits::Limits;
use sinew_contact::set::ContactSet;
use sinew_engine::scalar::Scalar;

impl<S: Scalar> Step<'_, S> {
    /// Finds the local stiffness of all tools that ask for it, at the end of the step.
    pub fn find_local_stiffness(&mut self) {
        if !self.contact.as_ref().is_some_and(ContactSet::asks_stiffness) {
            return;
        }
        for index in 0..self.bodies.len() {
            self.contact_energy(index, At::Iterate, Limits::Keep);
        }
        let Some(mut contact) = self.contact.take() else { return };
        for tool in contact.tools_with_stiffness() {
            let n = self.scratch.node.len();
            let zero = || vec![[S::ZERO; 4]; n];
            let mut ways: [Rows<S>; 3] = [zero(), zero(), zero()];
            let mut found = true;
            for (axis, way) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().zip(&mut ways) {
                let mut force = zero();
                contact.for_motion(tool, axis, |row, f| {
                    for k in self.scratch.node.free_axes(row) {
                        force[row][k] += S::from_f64(f[k]);
                    }
                });
                for body in self.bodies.iter().filter(|body| body.touched) {
                    let blocks = contact.blocks(&body.bodies);
                    let ImplicitScratch { linear, rest, node, damping, .. } = &mut *self.scratch;
                    let mut system = system_matrix(self.world, &body.weights, node, damping);
                    system.contact = Some(&blocks);
                    let options = self.settings.linear_options();
                    let (b, x) = (&force[body.rows.clone()], &mut way[body.rows.clone()]);
                    let outcome = linear.solve(&system, rest, body.bodies.clone(), b, x, &options);
                    self.report.book(&outcome);
                    found &= outcome.status == CgStatus::Converged;
                }
            }
            if found {
                contact.keep_stiffness(tool, &|axis, row| {
                    let way = ways[axis][row.index()].map(Scalar::to_f64);
                    DVec3::new(way[0], way[1], way[2])
                });
            }
        }
        self.contact = Some(contact);
    }
}
