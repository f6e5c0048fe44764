use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use prosopon_geometry::{Severity, Warning};

/// How far a result can be relied on after a warning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SeverityName {
    /// A fact for the report; nothing to do. Notes have it, warnings never.
    Info,
    /// The result may differ from what was wanted: someone should look.
    Check,
    /// The result, or the part that the message names, is not to be relied on.
    Unreliable,
}

impl From<Severity> for SeverityName {
    fn from(severity: Severity) -> Self {
        match severity {
            Severity::Info => Self::Info,
            Severity::Check => Self::Check,
            Severity::Unreliable => Self::Unreliable,
        }
    }
}

/// One finding: what it is, how much it matters, where, and what to do.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(from = "StoredWarning")]
pub struct WarningDocument {
    /// Stable name of the kind; `api/warnings.md` lists them.
    pub code: String,
    /// How much it matters.
    pub severity: SeverityName,
    /// One sentence: what, where, how much, with units.
    pub message: String,
    /// What to do about it; absent when there is nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub action: Option<String>,
}

/// A warning as it was stored: a mere text before warnings had codes.
#[derive(Deserialize)]
#[serde(untagged)]
enum StoredWarning {
    Text(String),
    Document {
        code: String,
        severity: SeverityName,
        message: String,
        #[serde(default)]
        action: Option<String>,
    },
}

impl From<StoredWarning> for WarningDocument {
    fn from(stored: StoredWarning) -> Self {
        match stored {
            StoredWarning::Text(message) => {
                Self { code: "text".to_owned(), severity: SeverityName::Check, message, action: None }
            }
            StoredWarning::Document { code, severity, message, action } => Self { code, severity, message, action },
        }
    }
}

impl From<Warning> for WarningDocument {
    fn from(w: Warning) -> Self {
        let action = (!w.action.is_empty()).then(|| w.action.to_owned());
        Self { code: w.code.to_owned(), severity: w.severity.into(), message: w.message, action }
    }
}

impl WarningDocument {
    /// A warning from its row: JSON, or the mere text that earlier versions stored.
    #[must_use]
    pub fn from_row(stored: &str) -> Self {
        serde_json::from_str(stored).unwrap_or_else(|_| StoredWarning::Text(stored.to_owned()).into())
    }

    /// The same about `subject`: "subject: message".
    #[must_use]
    pub fn about(&self, subject: impl std::fmt::Display) -> Self {
        Self { message: format!("{subject}: {}", self.message), ..self.clone() }
    }
}

impl std::fmt::Display for WarningDocument {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.message)?;
        self.action.iter().try_for_each(|action| write!(f, ". {action}"))
    }
}

/// What was noticed while a result was made: warnings, and notes that need no action.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Findings {
    /// What someone should look at, or what is not to be relied on. A normal run has none.
    #[serde(default)]
    pub warnings: Vec<WarningDocument>,
    /// Facts that need no action.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<WarningDocument>,
}

impl Findings {
    /// Adds a finding unless it is there.
    pub fn push(&mut self, finding: WarningDocument) {
        let list = if finding.severity == SeverityName::Info { &mut self.notes } else { &mut self.warnings };
        if !list.contains(&finding) {
            list.push(finding);
        }
    }

    /// Warnings, then notes.
    pub fn iter(&self) -> impl Iterator<Item = &WarningDocument> {
        self.warnings.iter().chain(&self.notes)
    }
}

impl<W: Into<WarningDocument>> Extend<W> for Findings {
    fn extend<I: IntoIterator<Item = W>>(&mut self, found: I) {
        found.into_iter().for_each(|w| self.push(w.into()));
    }
}

impl<W: Into<WarningDocument>> FromIterator<W> for Findings {
    fn from_iter<I: IntoIterator<Item = W>>(found: I) -> Self {
        let mut findings = Self::default();
        findings.extend(found);
        findings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_are_no_warnings_and_older_texts_are_read() {
        let found: Findings = [
            Warning::info("stiff-elements", "elements are stiff"),
            Warning::unreliable("inside-out-elements", "2 elements are inside out").act("Use a smaller step."),
            Warning::info("stiff-elements", "elements are stiff"),
        ]
        .into_iter()
        .collect();
        assert_eq!((found.warnings.len(), found.notes.len()), (1, 1));
        let text = serde_json::to_string(&found).unwrap();
        assert_eq!(serde_json::from_str::<Findings>(&text).unwrap(), found);
        assert_eq!(found.warnings[0].to_string(), "2 elements are inside out. Use a smaller step.");
        let old: Findings = serde_json::from_str(r#"{"warnings": ["a wide gap"]}"#).unwrap();
        assert_eq!((old.warnings[0].message.as_str(), old.warnings[0].severity), ("a wide gap", SeverityName::Check));
        assert_eq!(WarningDocument::from_row("a wide gap"), old.warnings[0]);
        assert_eq!(WarningDocument::from_row(&serde_json::to_string(&found.warnings[0]).unwrap()), found.warnings[0]);
    }
}
