//! What a stage noticed that its caller should know.
//!
//! Return a warning with the result of the stage: `src/service/jobs/work/report.rs` collects those of a solve in its report. List
//! its code in `api/warnings.md`; `tests/layers` compares the two.

use std::fmt;

/// How far a result can be relied on after a [`Warning`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// A fact for the report; nothing to do. Never shown as a warning.
    Info,
    /// The result may differ from what was wanted: someone should look.
    Check,
    /// The result, or the part that the message names, is not to be relied on.
    Unreliable,
}

/// One finding of a stage: what it is, how much it matters, where, and what to do.
///
/// ```
/// use prosopon_geometry::{Severity, Warning};
///
/// let found = Warning::check("uneven-slices", "the slices are 0.9 to 1.4 mm apart").act("Export the series without resampling.");
/// assert_eq!(found.severity, Severity::Check);
/// assert_eq!(found.to_string(), "the slices are 0.9 to 1.4 mm apart. Export the series without resampling.");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Warning {
    /// Stable name of the kind, in kebab case; clients may depend on it.
    pub code: &'static str,
    /// How much it matters.
    pub severity: Severity,
    /// One sentence without a full stop: what, where, how much, with units.
    pub message: String,
    /// What the caller can do, a full sentence; empty when there is nothing.
    pub action: &'static str,
}

impl Warning {
    /// A fact for the report.
    #[must_use]
    pub fn info(code: &'static str, message: impl Into<String>) -> Self {
        Self { code, severity: Severity::Info, message: message.into(), action: "" }
    }

    /// Someone should look.
    #[must_use]
    pub fn check(code: &'static str, message: impl Into<String>) -> Self {
        Self { severity: Severity::Check, ..Self::info(code, message) }
    }

    /// Not to be relied on.
    #[must_use]
    pub fn unreliable(code: &'static str, message: impl Into<String>) -> Self {
        Self { severity: Severity::Unreliable, ..Self::info(code, message) }
    }

    /// The same with what to do about it.
    #[must_use]
    pub fn act(self, action: &'static str) -> Self {
        Self { action, ..self }
    }

    /// The same with the places in its message moved; see [`moved_places`](crate::moved_places).
    #[must_use]
    pub fn moved(self, motion: &crate::Motion) -> Self {
        Self { message: crate::moved_places(&self.message, motion), ..self }
    }

    /// The same about `subject`: "subject: message".
    #[must_use]
    pub fn about(self, subject: impl fmt::Display) -> Self {
        Self { message: format!("{subject}: {}", self.message), ..self }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)?;
        if self.action.is_empty() { Ok(()) } else { write!(f, ". {}", self.action) }
    }
}
