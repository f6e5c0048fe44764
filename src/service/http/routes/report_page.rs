//! The report as a page for a clinician, made by the template `report.html`.

use minijinja::value::Serde;
use minijinja::{AutoEscape, Environment, UndefinedBehavior, Value};
use serde::Serialize;
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;
use time::macros::format_description;

use super::report_appendix::{Appendix, appendix};
use super::report_clinical::{Clinical, clinical};
use super::report_errors::{Errors, errors};
use super::report_pictures::PictureRow;
use super::report_plan::{Plan, plan};
use super::report_table::{Table, movement, region, sentence};
use crate::http::Problem;
use prosopon_contract::{FaultKind, Findings, ReportDocument, SeverityName, WarningDocument};

/// The template and its name, whose ending `.html` stands for HTML.
const NAME: &str = "report.html";
const TEMPLATE: &str = include_str!("report.html");

/// Everything that the template shows.
#[derive(Debug, Serialize)]
struct Page<'a> {
    label: Option<&'a str>,
    finished: String,
    job: &'a str,
    session: &'a str,
    version: &'a str,
    attempt: u32,
    model: &'a str,
    /// Job that goes on with a better setting.
    continued_by: Option<String>,
    warnings: Vec<Group>,
    plan: Plan,
    regions: Table,
    clinical: Option<Clinical>,
    pictures: &'a [PictureRow],
    errors: Option<Errors>,
    appendix: Appendix,
}

/// Warnings of one severity.
#[derive(Debug, Serialize)]
struct Group {
    /// Class of the style sheet.
    class: &'static str,
    title: &'static str,
    findings: Vec<Finding>,
}

#[derive(Debug, Serialize)]
struct Finding {
    message: String,
    action: Option<String>,
    code: String,
}

/// Renders the report as one self-contained page: no script, no other file, all texts escaped.
///
/// The label is the session's.
pub(super) fn report_page(r: &ReportDocument, label: Option<&str>, pictures: &[PictureRow]) -> Result<String, Problem> {
    let moved = |(name, m): (&String, &prosopon_contract::RegionMotionDocument)| {
        std::iter::once(region(name)).chain(movement(m.forward_mm, m.down_mm, m.left_mm)).collect()
    };
    let page = Page {
        label,
        finished: date(&r.finished_at),
        job: &r.job,
        session: &r.session,
        version: &r.version,
        attempt: r.attempt,
        model: &r.model,
        continued_by: r.budget.as_ref().and_then(|b| b.continued_by).map(|job| job.to_string()),
        warnings: groups(&r.findings),
        plan: plan(&r.plan, &r.segment_names),
        regions: Table::new(
            "Mean movement of the skin by region, mm",
            &["region", "forward / back", "down / up", "left / right"],
            r.regions.iter().map(moved),
        ),
        clinical: r.clinical.as_ref().map(clinical),
        pictures,
        errors: r.error.as_ref().map(errors),
        appendix: appendix(r, &r.segment_names),
    };
    render(&page).map_err(|error| {
        tracing::error!(%error, "the report's page cannot be made");
        Problem::new(FaultKind::Internal, "the report's page cannot be made; see the log")
    })
}

fn render(page: &impl Serialize) -> Result<String, minijinja::Error> {
    let mut environment = Environment::new();
    environment.set_auto_escape_callback(|_| AutoEscape::Html);
    // A member that the template misspells is an error, not an empty text.
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.add_template(NAME, TEMPLATE)?;
    environment.get_template(NAME)?.render(Value::from(Serde(page)))
}

/// Warnings by severity, the gravest first.
fn groups(findings: &Findings) -> Vec<Group> {
    let of = |severity: SeverityName| {
        let same = findings.warnings.iter().filter(|w| w.severity == severity);
        let (class, title) = match severity {
            SeverityName::Unreliable => {
                ("unreliable", "Unreliable: do not rely on the result, or on the part named here")
            }
            SeverityName::Check => ("check", "Check: the result may differ from what was wanted"),
            SeverityName::Info => ("info", "For information"),
        };
        Group { class, title, findings: same.map(finding).collect() }
    };
    let all = [SeverityName::Unreliable, SeverityName::Check, SeverityName::Info].map(of);
    all.into_iter().filter(|group| !group.findings.is_empty()).collect()
}

fn finding(w: &WarningDocument) -> Finding {
    Finding { message: sentence(&w.message), action: w.action.as_deref().map(sentence), code: w.code.clone() }
}

/// An RFC 3339 time as "28 November 2026, 03:32 UTC"; other texts stay as they are.
fn date(text: &str) -> String {
    let form = format_description!("[day padding:none] [month repr:long] [year], [hour]:[minute] UTC");
    let time = OffsetDateTime::parse(text, &Rfc3339).ok().map(|t| t.to_offset(time::UtcOffset::UTC));
    time.and_then(|t| t.format(form).ok()).unwrap_or_else(|| text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// A report with as little as a stored one can have.
    fn report(warnings: &serde_json::Value) -> ReportDocument {
        serde_json::from_value(json!({
            "format_version": 1, "version": "0.1.0", "job": "job-id", "session": "session-id",
            "finished_at": "2026-11-08T03:02:35.499Z", "attempt": 1, "model": "linear",
            "parameters": {"steps": 2, "cuts": [{"name": "le_fort_1"}]},
            "inputs": {"skin": {"sha256": "aa", "source_sha256": null}},
            "phases": {"surfaces_s": 0.0, "field_s": 0.0, "cut_s": 0.0, "mesh_s": 0.0, "plan_s": 0.0, "solve_s": 1.0,
                "total_s": 1.0},
            "plan": {"label": "<i>plan</i>", "wall_s": 0.0, "reports": [], "paths": [{"segment": 1, "waypoints": [
                {"t": 1.0, "translation_mm": [0.0, -6.0, -1.5], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}]}]},
            "steps": [], "regions": {"cheek_left": {"forward_mm": 1.3, "down_mm": -0.5, "left_mm": 0.0}},
            "segment_names": {"1": "maxilla"}, "error": null, "regions_from_landmarks": true, "warnings": warnings
        }))
        .unwrap()
    }

    #[test]
    fn a_label_cannot_become_markup() {
        let page = report_page(&report(&json!([])), Some("<script>alert('1')</script>"), &[]).unwrap();
        assert!(!page.contains("<script"), "{page}");
        assert!(page.contains("&lt;script&gt;alert(") && page.contains("&lt;i&gt;plan"), "{page}");
    }

    #[test]
    fn the_plan_has_names_and_directions() {
        let page = report_page(&report(&json!([])), Some("Case 7"), &[]).unwrap();
        for part in
            ["Case 7", "maxilla", "6.0 mm forward", "1.5 mm down", "left cheek", "1.3 forward", "0.5 up", "le fort 1"]
        {
            assert!(page.contains(part), "{part}");
        }
    }

    #[test]
    fn the_gravest_warnings_come_first_and_whole() {
        let long = "a very long message ".repeat(40);
        let warnings = json!([
            {"code": "bone-overlap", "severity": "check", "message": long, "action": "Change the path."},
            {"code": "inside-out-elements", "severity": "unreliable", "message": "2 elements are inside out"}
        ]);
        let page = report_page(&report(&warnings), Some("Case 7"), &[]).unwrap();
        let grave = page.find("2 elements are inside out.").unwrap();
        let check = page.find("very long message").unwrap();
        assert!(grave < check, "the gravest first");
        assert_eq!(page.matches("very long message").count(), 40);
        assert!(page.contains("Change the path.") && page.contains("inside-out-elements"));
    }

    #[test]
    fn dates_are_readable() {
        assert_eq!(date("2026-11-08T03:02:35.499Z"), "8 November 2026, 03:02 UTC");
        assert_eq!(date("yesterday"), "yesterday");
    }
}
