//! Cases, columns and checks of the pass table: what the groups of hard cases and their report speak of.

use serde::{Deserialize, Serialize};
use sinew::models::body::{Integration, VolumeRule};
use sinew::prelude::*;

/// What solids are cut into.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SolidCells {
    /// Linear tetrahedra.
    #[default]
    Tetrahedra,
    /// Ten-node tetrahedra: the same ones with vertices in the middle of their edges.
    Tetrahedra10,
    /// Hexahedra: the cells that the tetrahedra of boxes are cut from.
    Hexahedra,
    /// The same with reduced integration.
    #[serde(rename = "reduced-hexahedra")]
    ReducedHexahedra,
}

impl SolidCells {
    /// How hexahedra are integrated.
    pub fn integration(self) -> Integration {
        match self {
            Self::ReducedHexahedra => Integration::Reduced,
            _ => Integration::Full,
        }
    }
}

impl std::fmt::Display for SolidCells {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Tetrahedra => "tetrahedra",
            Self::Tetrahedra10 => "tetrahedra10",
            Self::Hexahedra => "hexahedra",
            Self::ReducedHexahedra => "reduced-hexahedra",
        })
    }
}

/// A column of the pass table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct PassColumn {
    /// Integrator.
    pub integrator: Integrator,
    /// Energy.
    pub model: Model,
    /// What keeps the volume of bodies.
    pub volume: VolumeRule,
    /// What solids are cut into.
    pub cells: SolidCells,
    /// Recovery from inversion switched on; not every integrator has it.
    pub recovery: bool,
}

impl PassColumn {
    /// The default setting.
    pub const DEFAULT: Self = Self {
        integrator: Integrator::Auto,
        model: Model::CompressibleStVK,
        volume: VolumeRule::Elements,
        cells: SolidCells::Tetrahedra,
        recovery: true,
    };

    /// Whether the suite must pass with it: the integrators that are meant for anything, with the
    /// energy that undoes inversion and recovery as by default. The others are shown for comparison.
    pub fn required(self) -> bool {
        self.recovers()
            && self.model == Model::CompressibleStVK
            && self.cells == SolidCells::Tetrahedra
    }

    /// Whether the elements of solids, or what keeps their volume, are not the default ones.
    pub fn other_elements(self) -> bool {
        self.cells != Self::DEFAULT.cells || self.volume != Self::DEFAULT.volume
    }

    /// Whether bodies with many inverted elements recover by another energy.
    pub fn recovers(self) -> bool {
        self.recovery && self.integrator.recovers()
    }

    /// Name in tables; what is default goes without saying.
    pub fn name(self) -> String {
        let mut name = self.integrator.name().to_string();
        if self.model != Self::DEFAULT.model {
            name = format!("{name} {}", self.model.name());
        }
        if self.cells != SolidCells::Tetrahedra {
            name = format!("{name}, {}", self.cells);
        }
        if self.volume == VolumeRule::Clusters {
            name += ", clusters";
        }
        if self.integrator.recovers() && !self.recovery {
            name += ", no recovery";
        }
        name
    }
}

/// A subgroup of cases: a row of the pass table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct CasePart {
    /// Number of its group, 1 to 14.
    pub group: u8,
    /// What its cases have in common.
    pub name: &'static str,
    /// What they must meet, beside finite states and bounded energy.
    pub criterion: &'static str,
}

/// A measured quantity against its limit.
#[derive(Clone, Debug, Serialize)]
pub struct Check {
    /// What was measured.
    pub what: &'static str,
    /// Its value.
    pub measured: f64,
    /// The value that it is held against.
    pub limit: f64,
    /// Whether it must stay at or below the limit, not at or above it.
    pub at_most: bool,
    /// Whether it does.
    pub pass: bool,
}

impl Check {
    /// Must not be larger; NaN is.
    pub fn at_most(what: &'static str, measured: f64, limit: f64) -> Self {
        Self { what, measured, limit, at_most: true, pass: measured <= limit }
    }

    /// Must not be smaller; NaN is.
    pub fn at_least(what: &'static str, measured: f64, limit: f64) -> Self {
        Self { what, measured, limit, at_most: false, pass: measured >= limit }
    }

    /// Must be none.
    pub fn none(what: &'static str, count: u64) -> Self {
        Self::at_most(what, count as f64, 0.0)
    }

    /// Must be so.
    pub fn holds(what: &'static str, holds: bool) -> Self {
        Self::at_least(what, f64::from(u8::from(holds)), 1.0)
    }
}

/// What a case went through.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Figures {
    /// Steps.
    pub steps: u64,
    /// Linear systems, all steps together.
    pub solves: u64,
    /// Most linear systems in one step.
    pub most_solves: u32,
    /// Steps on a projected tangent.
    pub projected: u64,
    /// Steps whose velocity the energy cap scaled.
    pub capped: u64,
    /// Steps with a gradient in place of a solution, or without a decrease.
    pub fallbacks: u64,
    /// Steps in which Newton's method did not converge.
    pub unconverged: u64,
    /// Steps in recovery from inversion.
    pub recovering: u64,
    /// Explicit substeps, all steps together.
    pub substeps: u64,
    /// Largest rise of total energy above its start plus outside work, over the energy scale.
    pub energy_excess: Option<f64>,
    /// Most inverted elements in a step.
    pub most_inverted: u64,
    /// Inverted elements at the end.
    pub inverted: u64,
    /// Root mean square of relative edge-length change at the end.
    pub edge_error: Option<f64>,
    /// Hash of the last state.
    pub hash: u64,
}

/// How a case ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CaseStatus {
    /// All criteria met.
    Pass,
    /// One was not.
    Fail,
}

/// Result of one case in one column.
#[derive(Clone, Debug, Serialize)]
pub struct HardCaseRow {
    /// Subgroup.
    pub part: CasePart,
    /// What was run.
    pub case: String,
    /// With what; none where neither integrator nor model matters.
    pub column: Option<PassColumn>,
    /// How it ended.
    pub status: CaseStatus,
    /// Counted in the pass criterion, or shown for comparison only.
    pub required: bool,
    /// Why it may miss a criterion, for required cases that do so on some machine or with some setting.
    pub known: Option<&'static KnownMiss>,
    /// The criteria one by one.
    pub checks: Vec<Check>,
    /// What it went through.
    pub figures: Figures,
    /// What stopped it.
    pub note: String,
    /// Wall time (s).
    pub seconds: f64,
}

impl HardCaseRow {
    /// Whether all that it misses is what it is known to miss.
    pub fn excused(&self) -> bool {
        let mut missed = self.checks.iter().filter(|c| !c.pass).peekable();
        self.known.is_some_and(|known| {
            missed.peek().is_some() && missed.all(|c| known.checks.contains(&c.what))
        })
    }
}

/// A criterion that a required case is known to miss on some machine or with some setting.
#[derive(Debug, PartialEq, Eq, Serialize)]
pub struct KnownMiss {
    /// Name of its subgroup.
    pub part: &'static str,
    /// Names of its cases, whole: a part of a name would excuse cases that pass everywhere.
    pub cases: &'static [&'static str],
    /// What is missed.
    pub checks: &'static [&'static str],
    /// Why, and what helps.
    pub reason: &'static str,
}
