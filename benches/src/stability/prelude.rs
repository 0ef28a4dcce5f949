//! What every group of hard cases speaks of.

pub(super) use super::rows::{CasePart, Check, Figures, PassColumn};
pub(super) use super::runner::{
    CaseOutcome, CaseRandom, CaseRun, CaseSetting, Cases, Fall, GRAVITY, Result, Scope, bend,
    nearest, tissue,
};
pub(super) use sinew::engine::mesh::MeshError;
pub(super) use sinew::engine::mesh::generate::{box_tets, jitter_interior};
pub(super) use sinew::prelude::*;
pub(super) use std::sync::Arc;
