use std::fmt::Write;

use crate::http::Problem;
use crate::session::{FaultKind, ReportDocument};

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}\
table{border-collapse:collapse;margin:1rem 0}td,th{padding:.2rem .7rem;border-bottom:1px solid #ddd;text-align:right}\
td:first-child,th:first-child{text-align:left}img{max-width:100%}code{font-size:12px;word-break:break-all}";

/// The report as one page that needs nothing else. `pictures` are titles with PNG bytes.
pub(super) fn report_page(report: &str, pictures: &[(&str, Vec<u8>)]) -> Result<String, Problem> {
    let r: ReportDocument = serde_json::from_str(report).map_err(|error| {
        tracing::error!(%error, "a stored report cannot be read");
        Problem::new(FaultKind::Internal, "a stored report cannot be read; the log says more")
    })?;
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Prosopon report</title><style>{STYLE}</style>\
         <h1>Prediction report</h1><p>Job <code>{}</code>, model <b>{}</b>, software {}, {}. Not a medical device.</p>",
        escape(&r.job),
        escape(&r.model),
        escape(&r.version),
        escape(&r.finished_at)
    );
    for (title, png) in pictures {
        add(
            &mut page,
            format_args!("<h2>{title}</h2><img alt=\"{title}\" src=\"data:image/png;base64,{}\">", base64(png)),
        );
    }
    let regions = r.regions.iter().map(|(name, m)| vec![escape(name), mm(m.forward_mm), mm(m.down_mm), mm(m.left_mm)]);
    table(&mut page, "Mean movement, mm", &["region", "forward", "down", "left"], regions);
    if let Some(error) = &r.error {
        let whole = std::iter::once(("face", &error.whole)).chain(error.regions.iter().map(|(n, s)| (n.as_str(), s)));
        let rows = whole.map(|(name, s)| {
            vec![escape(name), mm(s.mean_mm), mm(s.mean_abs_mm), mm(s.rms_mm), mm(s.p95_mm), mm(s.max_mm)]
        });
        let title = format!("Signed error against {}, mm", escape(&error.reference));
        table(&mut page, &title, &["region", "mean", "mean abs", "RMS", "P95", "max"], rows);
    }
    let steps = r.steps.iter().map(|s| {
        vec![
            s.k.to_string(),
            format!("{:.3}", s.t),
            s.converged.to_string(),
            format!("{:.3}", s.min_det_f),
            format!("{:.4}", s.max_penetration_mm),
            format!("{:.1e}", s.relative_residual),
            s.newton_iterations.to_string(),
            format!("{:.1}", s.wall_s),
        ]
    });
    let names = ["step", "t", "converged", "min det F", "penetration, mm", "residual", "iterations", "time, s"];
    table(&mut page, "Steps", &names, steps);
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
    table(&mut page, "Time, s", &["phase", "s"], phases.map(|(n, s)| vec![n.to_owned(), format!("{s:.1}")]));
    if let Some(m) = &r.mesh {
        let mesh = [
            ("tetrahedra", m.tetrahedra.to_string()),
            ("prisms", m.prisms.to_string()),
            ("inverted", m.inverted.to_string()),
            ("smallest dihedral angle, degrees", format!("{:.1}", m.min_dihedral_deg)),
            ("volume error", format!("{:.4}", m.volume_error)),
            ("largest distance from the skin, mm", mm(m.max_skin_distance_mm)),
        ];
        table(&mut page, "Mesh", &["", ""], mesh.map(|(n, v)| vec![n.to_owned(), v]));
    }
    if let Some(t) = &r.tissue {
        let mesh = [
            ("nodes", t.nodes),
            ("tetrahedra", t.tetrahedra),
            ("wedges", t.wedges),
            ("sliding nodes", t.sliding_nodes),
        ];
        table(&mut page, "Ready mesh", &["", ""], mesh.map(|(n, v)| vec![n.to_owned(), v.to_string()]));
    }
    let inputs = r.inputs.iter().map(|(name, i)| vec![escape(name), format!("<code>{}</code>", escape(&i.sha256))]);
    table(&mut page, "Inputs", &["part", "SHA-256"], inputs);
    if !r.warnings.is_empty() {
        page.push_str("<h2>Warnings</h2><ul>");
        for warning in &r.warnings {
            add(&mut page, format_args!("<li>{}</li>", escape(warning)));
        }
        page.push_str("</ul>");
    }
    page.push_str("</html>\n");
    Ok(page)
}

fn add(page: &mut String, text: std::fmt::Arguments<'_>) {
    // Writing to a string cannot fail.
    page.write_fmt(text).ok();
}

fn table(page: &mut String, title: &str, names: &[&str], rows: impl IntoIterator<Item = Vec<String>>) {
    add(page, format_args!("<h2>{title}</h2><table><tr>"));
    names.iter().for_each(|name| add(page, format_args!("<th>{name}</th>")));
    page.push_str("</tr>");
    for row in rows {
        page.push_str("<tr>");
        row.iter().for_each(|cell| add(page, format_args!("<td>{cell}</td>")));
        page.push_str("</tr>");
    }
    page.push_str("</table>");
}

fn mm(value: f64) -> String {
    format!("{value:.2}")
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
    fn text_cannot_become_markup() {
        assert_eq!(escape("<script>\"&\""), "&lt;script&gt;&quot;&amp;&quot;");
    }
}
