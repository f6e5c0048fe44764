use std::fmt::Write;

use crate::http::Problem;
use prosopon_contract::{ErrorDocument, PathSample, PlanDocument, ReportDocument, from_json};

/// Style of the page: two columns below the pictures, one A4 sheet unless there are many warnings.
const STYLE: &str = "@page{size:A4;margin:8mm}*{box-sizing:border-box}body{font:9px/1.3 Helvetica,Arial,sans-serif;color:#222;max-width:194mm;\
margin:0 auto;padding:2mm 0}h1{font-size:15px;margin:0}h2{font-size:10px;margin:2mm 0 .6mm;color:#245}p{margin:.6mm 0}img{display:block;\
width:100%}.strip img{max-height:68mm;object-fit:contain}.columns:after{content:'';display:block;clear:both}.left{float:left;width:55%}\
.right{float:right;width:43%}table{border-collapse:collapse;width:100%}td,th{padding:.15mm 1mm;border-bottom:.2mm solid #ddd;\
text-align:right;font-weight:normal}th{color:#666}td:first-child,th:first-child{text-align:left}code{font-size:6.5px;word-break:break-all}\
ul{margin:0;padding-left:4mm}.note{color:#666;font-size:8px}";
/// Number of steps that fit on the page; the table shows the last ones.
const STEPS: usize = 6;

/// Renders the report as one self-contained page.
///
/// `pictures` are titles with PNG bytes: before and after, then the error.
pub(super) fn report_page(report: &str, pictures: &[(&str, Vec<u8>)]) -> Result<String, Problem> {
    let r: ReportDocument = from_json("the report", report)?;
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Prosopon report {}</title><style>{STYLE}</style>\
         <h1>Predicted skin after bone movement</h1><p>Job <code>{}</code>, session <code>{}</code>, {}. Model <b>{}</b>, Prosopon {}. \
         <b>Not a medical device.</b></p>",
        escape(&r.job),
        escape(&r.job),
        escape(&r.session),
        escape(&r.finished_at),
        escape(&r.model),
        escape(&r.version)
    );
    let picture = |page: &mut String, (title, png): &(&str, Vec<u8>)| {
        add(page, format_args!("<img alt=\"{title}\" src=\"data:image/png;base64,{}\">", base64(png)));
    };
    if let Some(first) = pictures.first() {
        page.push_str("<div class=\"strip\">");
        picture(&mut page, first);
        page.push_str("</div>");
    }
    page.push_str("<div class=\"columns\"><div class=\"left\">");
    pictures.iter().skip(1).for_each(|p| picture(&mut page, p));
    warnings(&mut page, &r.warnings);
    inputs(&mut page, &r);
    page.push_str("</div><div class=\"right\">");
    plan(&mut page, &r.plan);
    let regions = r.regions.iter().map(|(name, m)| vec![name.clone(), mm(m.forward_mm), mm(m.down_mm), mm(m.left_mm)]);
    table(&mut page, "Mean movement of the skin, mm", &["region", "forward", "down", "left"], regions);
    if let Some(error) = &r.error {
        errors(&mut page, error);
    }
    numerics(&mut page, &r);
    page.push_str("</div></div></html>\n");
    Ok(page)
}

fn warnings(page: &mut String, all: &[String]) {
    if all.is_empty() {
        return;
    }
    page.push_str("<h2>Warnings</h2><ul>");
    for warning in all {
        add(page, format_args!("<li>{}</li>", escape(warning)));
    }
    page.push_str("</ul>");
}

fn inputs(page: &mut String, r: &ReportDocument) {
    page.push_str("<h2>Inputs, SHA-256</h2><table>");
    for (name, input) in &r.inputs {
        let from = input.source_sha256.as_ref().unwrap_or(&input.sha256);
        add(page, format_args!("<tr><td>{}</td><td><code>{}</code></td></tr>", escape(name), escape(from)));
    }
    page.push_str("</table>");
}

/// Table of each segment's final movement, with LPS axes named as surgeons name them.
fn plan(page: &mut String, plan: &PlanDocument) {
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
    table(page, "Plan, mm", &["segment", "forward", "down", "left", "turn", "overlap", "gap"], rows);
}

fn errors(page: &mut String, error: &ErrorDocument) {
    let whole = std::iter::once(("counted", &error.whole)).chain(error.regions.iter().map(|(n, s)| (n.as_str(), s)));
    let rows = whole.chain(std::iter::once(("from reference", &error.backward))).map(|(name, s)| {
        let share = format!("{:.0} %", 100.0 * s.share_below_1_mm);
        vec![
            name.to_owned(),
            mm(s.mean_mm),
            mm(s.mean_abs_mm),
            mm(s.rms_mm),
            mm(s.p50_mm),
            mm(s.p90_mm),
            mm(s.p95_mm),
            mm(s.max_mm),
            share,
        ]
    });
    let title = format!("{} ({}), mm", error.title(), error.reference);
    let names = ["region", "mean", "abs", "RMS", "P50", "P90", "P95", "max", "< 1 mm"];
    table(page, &title, &names, rows);
    let w = &error.whole;
    add(
        page,
        format_args!(
            "<p class=\"note\">Variance {:.3} mm², L2 norm {:.1} mm over {} vertices, below 2 mm {:.1} %, below 3 mm {:.1} %. All values \
             except the L2 norm are weighted by area. Negative: the prediction lies behind the reference.</p>",
            w.variance_mm2,
            w.l2_norm_mm,
            w.count,
            100.0 * w.share_below_2_mm,
            100.0 * w.share_below_3_mm
        ),
    );
    if let Some(r) = &error.registration {
        add(
            page,
            format_args!(
                "<p class=\"note\">Registered on {} vertices: residual {:.3} mm, overlap {:.0} %, {} iterations.</p>",
                r.vertices,
                r.residual_mm,
                100.0 * r.overlap,
                r.iterations
            ),
        );
    }
}

/// Tables of steps and times, and notes on attachment and mesh.
fn numerics(page: &mut String, r: &ReportDocument) {
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
    let names = ["step", "outcome", "det F", "pen., mm", "residual", "iter.", "s"];
    table(page, "Steps", &names, steps);
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
    let names = phases.map(|p| p.0);
    table(page, "Time, s", &names, [phases.map(|p| format!("{:.1}", p.1)).to_vec()]);
    if let Some(a) = &r.attached {
        let tied: Vec<String> = a.tied_nodes.iter().map(|(segment, n)| format!("{n} to segment {segment}")).collect();
        add(
            page,
            format_args!(
                "<p class=\"note\">Nodes at bone: tied {}; {} sliding, {} free. {} fixed at the mesh's boundary, {} painted.</p>",
                if tied.is_empty() { "none".to_owned() } else { tied.join(", ") },
                a.sliding_nodes,
                a.free_nodes_at_bone,
                a.fixed_nodes,
                a.painted_nodes
            ),
        );
    }
    let mesh = match (&r.mesh, &r.tissue) {
        (Some(m), _) => format!(
            "{} tetrahedra, {} prisms, smallest dihedral angle {:.1}°, {} inverted, volume error {:.4}, at most {} mm from the skin",
            m.tetrahedra,
            m.prisms,
            m.min_dihedral_deg,
            m.inverted,
            m.volume_error,
            mm(m.max_skin_distance_mm)
        ),
        (None, Some(t)) => format!(
            "uploaded mesh of {} nodes, {} tetrahedra, {} wedges, {} sliding nodes",
            t.nodes, t.tetrahedra, t.wedges, t.sliding_nodes
        ),
        (None, None) => return,
    };
    add(page, format_args!("<p class=\"note\">Mesh: {mesh}.</p>"));
}

fn add(page: &mut String, text: std::fmt::Arguments<'_>) {
    // Writing to a string cannot fail.
    page.write_fmt(text).ok();
}

/// A table with a title; all text is escaped here.
fn table(page: &mut String, title: &str, names: &[&str], rows: impl IntoIterator<Item = Vec<String>>) {
    let mut rows = rows.into_iter().peekable();
    if rows.peek().is_none() {
        return;
    }
    add(page, format_args!("<h2>{}</h2><table><tr>", escape(title)));
    names.iter().for_each(|name| add(page, format_args!("<th>{}</th>", escape(name))));
    page.push_str("</tr>");
    for row in rows {
        page.push_str("<tr>");
        row.iter().for_each(|cell| add(page, format_args!("<td>{}</td>", escape(cell))));
        page.push_str("</tr>");
    }
    page.push_str("</table>");
}

/// Formats a length to 0.01 mm, without a negative zero.
fn mm(value: f64) -> String {
    let text = format!("{value:.2}");
    if text == "-0.00" { "0.00".to_owned() } else { text }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let [a, b, c] = [0, 1, 2].map(|i| u32::from(chunk.get(i).copied().unwrap_or(0)));
        let word = a << 16 | b << 8 | c;
        for place in 0..4 {
            let symbol = char::from(ALPHABET[(word >> (18 - 6 * place) & 63) as usize]);
            text.push(if place <= chunk.len() { symbol } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_as_in_rfc_4648() {
        let pairs =
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("fooba", "Zm9vYmE=")];
        for (plain, encoded) in pairs {
            assert_eq!(base64(plain.as_bytes()), encoded);
        }
    }

    #[test]
    fn nothing_moves_by_minus_zero() {
        assert_eq!([mm(-0.004), mm(0.0), mm(-0.006)], ["0.00", "0.00", "-0.01"]);
    }

    #[test]
    fn text_cannot_become_markup() {
        assert_eq!(escape("<script>\"&\""), "&lt;script&gt;&quot;&amp;&quot;");
    }
}
