use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::report_clinical::{beside_baselines, clinical};
use super::report_table::{mm, table};
use crate::http::Problem;
use prosopon_contract::{
    AttachedDocument, ErrorDocument, Findings, PathSample, PlanDocument, ReportDocument, SeverityName, from_json,
};

/// Style of the page: two columns below the pictures, one A4 sheet unless there are many warnings.
const STYLE: &str = "@page{size:A4;margin:8mm}*{box-sizing:border-box}body{font:9px/1.3 Helvetica,Arial,sans-serif;color:#222;max-width:194mm;\
margin:0 auto;padding:2mm 0}h1{font-size:15px;margin:0}h2{font-size:10px;margin:2mm 0 .6mm;color:#245}p{margin:.6mm 0}img{display:block;\
width:100%}.strip img{max-height:68mm;object-fit:contain}.columns:after{content:'';display:block;clear:both}.left{float:left;width:55%}\
.right{float:right;width:43%}table{border-collapse:collapse;width:100%}td,th{padding:.15mm 1mm;border-bottom:.2mm solid #ddd;\
text-align:right;font-weight:normal}th{color:#666}td:first-child,th:first-child{text-align:left}code{font-size:6.5px;word-break:break-all}\
ul{margin:0;padding-left:4mm}.note{color:#666;font-size:8px}.unreliable{color:#a00;font-weight:bold}";
/// Number of steps that fit on the page; the table shows the last ones.
const STEPS: usize = 6;

/// Renders the report as one self-contained page.
///
/// `pictures` are titles with PNG bytes: before and after, then the error.
pub(super) fn report_page(report: &str, pictures: &[(&str, Vec<u8>)]) -> Result<String, Problem> {
    let r: ReportDocument = from_json("the report", report)?;
    let (first, others) = pictures.split_at(pictures.len().min(1));
    let regions = r.regions.iter().map(|(name, m)| vec![name.clone(), mm(m.forward_mm), mm(m.down_mm), mm(m.left_mm)]);
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            meta charset="utf-8";
            title { "Prosopon report " (r.job) }
            style { (PreEscaped(STYLE)) }
            h1 { "Predicted skin after bone movement" }
            p {
                "Job " code { (r.job) } ", session " code { (r.session) } ", " (r.finished_at) ". Model " b { (r.model) }
                ", Prosopon " (r.version) ". " b { "Not a medical device." }
            }
            div class="strip" { @for (title, png) in first { (picture(title, png)) } }
            div class="columns" {
                div class="left" {
                    @for (title, png) in others { (picture(title, png)) }
                    (warnings(&r.findings))
                    @if let Some(measured) = &r.clinical { (clinical(measured)) }
                    (inputs(&r))
                    (notes(&r.findings))
                }
                div class="right" {
                    (plan(&r.plan))
                    (table("Mean movement of the skin, mm", &["region", "forward", "down", "left"], regions))
                    @if let Some(error) = &r.error { (errors(error)) (beside_baselines(error)) }
                    (numerics(&r))
                }
            }
        }
    };
    Ok(page.into_string())
}

fn picture(title: &str, png: &[u8]) -> Markup {
    html! { img alt=(title) src={ "data:image/png;base64," (STANDARD.encode(png)) }; }
}

fn warnings(findings: &Findings) -> Markup {
    html! {
        @if !findings.warnings.is_empty() {
            h2 { "Warnings" }
            ul {
                @for warning in &findings.warnings {
                    li class=[(warning.severity == SeverityName::Unreliable).then_some("unreliable")] { (warning.to_string()) }
                }
            }
        }
    }
}

fn notes(findings: &Findings) -> Markup {
    html! {
        @if !findings.notes.is_empty() {
            h2 { "Notes" }
            ul class="note" { @for note in &findings.notes { li { (note.message) } } }
        }
    }
}

fn inputs(r: &ReportDocument) -> Markup {
    html! {
        h2 { "Inputs, SHA-256" }
        table {
            @for (name, input) in &r.inputs {
                tr { td { (name) } td { code { (input.source_sha256.as_ref().unwrap_or(&input.sha256)) } } }
            }
        }
    }
}

/// End position of each segment, its translation given in the surgeon's directions.
fn plan(plan: &PlanDocument) -> Markup {
    let rows = plan.paths.iter().map(|path| {
        let report = plan.reports.iter().find(|r| r.segment == path.segment);
        let end = path.waypoints.last();
        let moved = report.map(|r| r.centroid_displacement_mm).or(end.map(|w| w.translation_mm)).unwrap_or_default();
        let turned = end.map_or(0.0, |w| 2.0 * w.quaternion_xyzw[3].abs().min(1.0).acos().to_degrees());
        let most = |of: fn(&PathSample) -> f64| match report {
            Some(r) => mm(r.along.iter().map(of).fold(0.0, f64::max)),
            None => "–".to_owned(),
        };
        vec![
            path.segment.to_string(),
            mm(-moved[1]),
            mm(-moved[2]),
            mm(moved[0]),
            format!("{turned:.1}°"),
            most(|s| s.overlap_mm),
            most(|s| s.gap_mm),
        ]
    });
    table("Plan, mm", &["segment", "forward", "down", "left", "turn", "overlap", "gap"], rows)
}

fn errors(error: &ErrorDocument) -> Markup {
    let whole = std::iter::once(("counted", &error.whole)).chain(error.regions.iter().map(|(n, s)| (n.as_str(), s)));
    let rows = whole.chain(std::iter::once(("from reference", &error.backward))).map(|(name, s)| {
        let share = format!("{:.0} %", 100.0 * s.share_below_1_mm);
        let lengths = [s.mean_mm, s.mean_abs_mm, s.rms_mm, s.p50_mm, s.p90_mm, s.p95_mm, s.max_mm].map(mm);
        std::iter::once(name.to_owned()).chain(lengths).chain([share]).collect()
    });
    let title = format!("{} ({}), mm", error.title(), error.reference);
    let names = ["region", "mean", "abs", "RMS", "P50", "P90", "P95", "max", "< 1 mm"];
    let w = &error.whole;
    html! {
        (table(&title, &names, rows))
        p class="note" {
            "Variance " (format!("{:.3}", w.variance_mm2)) " mm², L2 norm " (format!("{:.1}", w.l2_norm_mm)) " mm over " (w.count)
            " vertices, below 2 mm " (format!("{:.1}", 100.0 * w.share_below_2_mm)) " %, below 3 mm "
            (format!("{:.1}", 100.0 * w.share_below_3_mm)) " %. All values except the L2 norm are weighted by area. "
            "Negative: the prediction lies behind the reference."
        }
        @if let Some(r) = &error.registration {
            p class="note" {
                "Registered on " (r.vertices) " vertices: residual " (format!("{:.3}", r.residual_mm)) " mm, overlap "
                (format!("{:.0}", 100.0 * r.overlap)) " %, " (r.iterations) " iterations."
            }
        }
    }
}

/// Tables of steps and times, and notes on attachment and mesh.
fn numerics(r: &ReportDocument) -> Markup {
    let steps = r.steps.iter().skip(r.steps.len().saturating_sub(STEPS)).map(|s| {
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
    html! {
        (table("Steps", &["step", "outcome", "det F", "pen., mm", "residual", "iter.", "s"], steps))
        (table("Time, s", &phases.map(|p| p.0), [phases.map(|p| format!("{:.1}", p.1)).to_vec()]))
        @if let Some(attached) = &r.attached { (attachment(attached)) }
        @if let Some(mesh) = mesh(r) { p class="note" { "Mesh: " (mesh) "." } }
    }
}

fn attachment(a: &AttachedDocument) -> Markup {
    let tied: Vec<String> = a.tied_nodes.iter().map(|(segment, n)| format!("{n} to segment {segment}")).collect();
    html! {
        p class="note" {
            "Nodes at bone: tied " (if tied.is_empty() { "none".to_owned() } else { tied.join(", ") }) "; " (a.sliding_nodes)
            " sliding, " (a.free_nodes_at_bone) " free. " (a.fixed_nodes) " fixed at the mesh's boundary, " (a.painted_nodes)
            " painted."
        }
    }
}

fn mesh(r: &ReportDocument) -> Option<String> {
    match (&r.mesh, &r.tissue) {
        (Some(m), _) => Some(format!(
            "{} tetrahedra, {} prisms, smallest dihedral angle {:.1}°, {} inverted, volume error {:.4}, at most {} mm from the skin",
            m.tetrahedra,
            m.prisms,
            m.min_dihedral_deg,
            m.inverted,
            m.volume_error,
            mm(m.max_skin_distance_mm)
        )),
        (None, Some(t)) => Some(format!(
            "uploaded mesh of {} nodes, {} tetrahedra, {} wedges, {} sliding nodes",
            t.nodes, t.tetrahedra, t.wedges, t.sliding_nodes
        )),
        (None, None) => None,
    }
}
