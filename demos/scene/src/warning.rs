//! What a scene or a run deserves a word about.

use serde::{Deserialize, Serialize};
use std::fmt;

/// How much a warning matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Worth knowing.
    Note,
    /// The run may not be what was meant.
    Warning,
}

impl Level {
    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Note => "note",
            Self::Warning => "warning",
        }
    }
}

/// Something that was found in the scene or during the run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Warning {
    /// Stable identifier, such as `mesh.inverted-winding`.
    pub code: String,
    /// How much it matters.
    pub level: Level,
    /// Body, constraint or stage.
    pub subject: String,
    /// What was found.
    pub message: String,
    /// What to do, or that nothing is to be done.
    pub remedy: String,
}

impl Warning {
    /// With its five parts in the order of the fields.
    pub fn new(
        code: impl Into<String>,
        level: Level,
        subject: impl Into<String>,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self {
            code: code.into(),
            level,
            subject: subject.into(),
            message: message.into(),
            remedy: remedy.into(),
        }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let level = self.level.name();
        write!(f, "{level} [{}] {}: {}", self.code, self.subject, self.message)?;
        if self.remedy.is_empty() { Ok(()) } else { write!(f, "; {}", self.remedy) }
    }
}
