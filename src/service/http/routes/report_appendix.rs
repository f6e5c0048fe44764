//! The appendix of the report's page: how the prediction was computed, and from what.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::Value;

use super::report_plan::segment_name;
use super::report_table::{Table, mm, region, sentence};
use prosopon_contract::{
    AttachedDocument, BudgetDocument, ExpectedDocument, LeftOutDocument, LockingName, MeshDocument, ReportDocument,
    StepDocument, TissueDocument,
};

/// Number of steps in the table, the last ones; the JSON report has all.
const STEPS: usize = 12;

/// How the prediction was computed.
#[derive(Debug, Serialize)]
pub(super) struct Appendix {
    parameters: Table,
    /// Sentences on mesh and attachment.
    mesh: Vec<String>,
    /// What was asked of error and time, and what came of it.
    budget: Option<Table>,
    steps: Table,
    times: Table,
    inputs: Table,
    /// Sentences of the notes.
    notes: Vec<String>,
}

pub(super) fn appendix(r: &ReportDocument, names: &BTreeMap<u32, String>) -> Appendix {
    Appendix {
        parameters: Table::new("Model and materials", &["setting", "value"], parameters(r)),
        mesh: mesh(r, names),
        budget: r.budget.as_ref().map(budget),
        steps: steps(&r.steps),
        times: times(r),
        inputs: inputs(r),
        notes: r.findings.notes.iter().map(|note| sentence(&note.to_string())).collect(),
    }
}

/// Rows of the settings; those without a value are left out, cuts are listed by name.
fn parameters(r: &ReportDocument) -> Vec<Vec<String>> {
    let mut rows = vec![vec!["model".to_owned(), r.model.clone()]];
    for (name, value) in r.parameters.as_object().into_iter().flatten() {
        let text = if name == "cuts" { cut_names(value) } else { setting(value) };
        rows.extend(text.map(|text| vec![words_of(name), text]));
    }
    rows
}

/// The name of a setting for readers: `depth_mm` is "depth, mm".
fn words_of(name: &str) -> String {
    let (words, unit) = name.strip_suffix("_mm").map_or((name, ""), |words| (words, ", mm"));
    format!("{}{unit}", words.replace('_', " "))
}

/// A setting as text; `None` for null and for empty lists and objects.
fn setting(value: &Value) -> Option<String> {
    match value {
        Value::Null => None,
        Value::Bool(yes) => Some(if *yes { "yes" } else { "no" }.to_owned()),
        Value::Number(number) => Some(number.to_string()),
        Value::String(text) => Some(text.clone()),
        Value::Array(items) => (!items.is_empty()).then(|| value.to_string()),
        Value::Object(members) => (!members.is_empty()).then(|| value.to_string()),
    }
}

fn cut_names(cuts: &Value) -> Option<String> {
    let cuts = cuts.as_array().filter(|cuts| !cuts.is_empty())?;
    let name = |(i, cut): (usize, &Value)| match cut.get("name").and_then(Value::as_str) {
        Some(name) => name.replace('_', " "),
        None => format!("cut {i}"),
    };
    Some(cuts.iter().enumerate().map(name).collect::<Vec<_>>().join(", "))
}

fn mesh(r: &ReportDocument, names: &BTreeMap<u32, String>) -> Vec<String> {
    let built = match (&r.mesh, &r.tissue) {
        (Some(m), _) => Some(built(m)),
        (None, Some(t)) => Some(uploaded(t)),
        (None, None) => None,
    };
    let regions = match (r.regions.is_empty(), r.regions_from_landmarks) {
        (true, _) => None,
        (false, true) => Some("Landmarks placed the regions of the face.".to_owned()),
        (false, false) => Some("Proportions of the skin placed the regions of the face.".to_owned()),
    };
    let unconfirmed: Vec<String> = r.unconfirmed_landmarks.iter().map(|name| region(name)).collect();
    let unconfirmed =
        (!unconfirmed.is_empty()).then(|| format!("Landmarks that nobody has confirmed: {}.", unconfirmed.join(", ")));
    let attached = r.attached.as_ref().map(|a| attachment(a, names));
    [built, attached, r.left_out.as_ref().map(left_out), regions, unconfirmed].into_iter().flatten().collect()
}

fn built(m: &MeshDocument) -> String {
    format!(
        "Mesh: {} tetrahedra, {} prisms, smallest dihedral angle {:.1}°, {} inverted, volume error {:.4}, at most {} mm from the \
         skin.",
        m.tetrahedra,
        m.prisms,
        m.min_dihedral_deg,
        m.inverted,
        m.volume_error,
        mm(m.max_skin_distance_mm)
    )
}

fn uploaded(t: &TissueDocument) -> String {
    format!(
        "Uploaded mesh of {} nodes, {} tetrahedra, {} wedges, {} sliding nodes.",
        t.nodes, t.tetrahedra, t.wedges, t.sliding_nodes
    )
}

fn attachment(a: &AttachedDocument, names: &BTreeMap<u32, String>) -> String {
    let by_segment = |nodes: &BTreeMap<u32, usize>| {
        let parts: Vec<String> = nodes.iter().map(|(id, n)| format!("{n} to {}", segment_name(*id, names))).collect();
        if parts.is_empty() { "none".to_owned() } else { parts.join(", ") }
    };
    format!(
        "Nodes at bone: tied {}; gliding {}; {} sliding, {} free. {} fixed at the mesh's boundary, {} painted.",
        by_segment(&a.tied_nodes),
        by_segment(&a.gliding_nodes),
        a.sliding_nodes,
        a.free_nodes_at_bone,
        a.fixed_nodes,
        a.painted_nodes
    )
}

fn left_out(l: &LeftOutDocument) -> String {
    format!(
        "{} of {} nodes were left out because the plan hardly moves them; their neighbours move by at most {} mm.",
        l.nodes,
        l.of_nodes,
        mm(l.border_mm)
    )
}

fn budget(b: &BudgetDocument) -> Table {
    let setting = |edge_mm: f64, locking: LockingName| format!("{edge_mm} mm edges, locking {}", locking.as_str());
    let cost = |e: &ExpectedDocument| {
        let at_most = format!("at most {} mm and {} s in 95 % of scenes", mm(e.error_at_most_mm), e.wall_at_most_s);
        format!("about {} mm in {} s; {at_most}", mm(e.error_mm), e.wall_s)
    };
    let row = |name: &str, text: String| vec![name.to_owned(), text];
    let mut rows = Vec::new();
    rows.extend(b.asked.max_error_mm.map(|most| row("error asked for", format!("at most {most} mm"))));
    rows.extend(b.within_s.map(|most| row("time for mesh and path", format!("at most {most} s"))));
    rows.push(row("chosen", setting(b.chosen.edge_mm, b.chosen.locking)));
    rows.push(row("why", sentence(&b.why)));
    rows.push(row("expected", cost(&b.expected)));
    let estimated = b.estimated.map_or_else(|| "not known".to_owned(), |e| format!("{} mm", mm(e.error_mm)));
    rows.push(row("error estimated afterwards", estimated));
    rows.extend(b.spent_s.map(|s| row("time taken", format!("{s:.1} s"))));
    rows.extend(b.tried.iter().map(|t| {
        let tried = setting(t.chosen.edge_mm, t.chosen.locking);
        row("tried before", format!("{tried}: {} mm in {:.1} s", mm(t.estimated.error_mm), t.spent_s))
    }));
    rows.extend(b.continued_by.map(|job| row("goes on in job", job.to_string())));
    rows.extend(
        b.alternatives
            .iter()
            .map(|a| row("alternative", format!("{}: {}", setting(a.edge_mm, a.locking), cost(&a.expected)))),
    );
    let note = "The error is that of the computation, not how far the patient's face will be from the prediction.";
    Table::new("Budget of error and time", &["quantity", "value"], rows).with_notes([note.to_owned()])
}

fn steps(steps: &[StepDocument]) -> Table {
    let left_out = steps.len().saturating_sub(STEPS);
    let rows = steps.iter().skip(left_out).map(|s| {
        vec![
            s.k.to_string(),
            s.outcome.replace('_', " "),
            format!("{:.2}", s.min_det_f),
            format!("{:.3}", s.max_penetration_mm),
            format!("{:.0e}", s.relative_residual),
            s.newton_iterations.to_string(),
            format!("{:.1}", s.wall_s),
        ]
    });
    let names = ["step", "outcome", "det F", "pen., mm", "residual", "iter.", "s"];
    let note = (left_out > 0).then(|| format!("The last {STEPS} of {} steps.", steps.len()));
    Table::new("Steps", &names, rows).with_notes(note)
}

fn times(r: &ReportDocument) -> Table {
    let p = &r.phases;
    let phases = [
        ("surfaces", p.surfaces_s),
        ("field", p.field_s),
        ("cut", p.cut_s),
        ("mesh", p.mesh_s),
        ("plan", p.plan_s),
        ("solve", p.solve_s),
        ("total", p.total_s),
    ];
    Table::new("Time, s", &["phase", "s"], phases.map(|(name, s)| vec![name.to_owned(), format!("{s:.1}")]))
}

fn inputs(r: &ReportDocument) -> Table {
    let rows = r.inputs.iter().map(|(name, input)| {
        vec![name.replace('_', " "), input.source_sha256.as_ref().unwrap_or(&input.sha256).clone()]
    });
    Table::new("Inputs, SHA-256", &["input", "hash"], rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn settings_without_a_value_are_left_out() {
        assert_eq!([json!(null), json!({}), json!([])].map(|v| setting(&v)), [None, None, None]);
        assert_eq!(setting(&json!("tet")).as_deref(), Some("tet"));
        assert_eq!(words_of("leave_out_below_mm"), "leave out below, mm");
        assert_eq!(setting(&json!(true)).as_deref(), Some("yes"));
        assert_eq!(setting(&json!(0.03)).as_deref(), Some("0.03"));
        assert_eq!(cut_names(&json!([{"name": "le_fort_1"}, {}])).as_deref(), Some("le fort 1, cut 1"));
    }
}
