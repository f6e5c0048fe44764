use axum::extract::Path;
use axum::response::Html;
use pulldown_cmark::{Options, Parser, html};

use crate::http::Problem;
use prosopon_contract::FaultKind;

/// Description of all problems.
const PROBLEMS: &str = include_str!("../../../../api/problems.md");

/// Explain a problem
///
/// Returns the page that the `type` of a problem names: what is wrong, and what client and operator can do.
#[utoipa::path(get, path = "/problems/{kind}", operation_id = "getProblemPage", tag = "health", params(("kind" = String, Path, description = "Kind of the problem.")),
    responses((status = 200, description = "The page.", body = String, content_type = "text/html")))]
pub(in crate::http) async fn problem_page(Path(kind): Path<String>) -> Result<Html<String>, Problem> {
    let section = section(&kind);
    let section = section.ok_or_else(|| Problem::new(FaultKind::NotFound, "there is no problem of this kind"))?;
    let mut page = format!(
        "<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content=\"width=device-width\">\
         <title>{kind}</title><style>body{{font:16px/1.5 sans-serif;max-width:42em;margin:2em auto;padding:0 1em;\
         color-scheme:light dark}}</style>"
    );
    html::push_html(&mut page, Parser::new_ext(section, Options::ENABLE_TABLES));
    Ok(Html(page))
}

/// The section of a kind of problem with its heading. A kind that has one needs no escapes.
fn section(kind: &str) -> Option<&'static str> {
    let heading = format!("## {kind}\n");
    let begin = PROBLEMS
        .match_indices(&heading)
        .map(|(at, _)| at)
        .find(|at| PROBLEMS.get(..*at).is_some_and(|before| before.ends_with('\n')))?;
    let rest = PROBLEMS.get(begin..)?;
    let end = rest.match_indices("\n## ").next().map_or(rest.len(), |(at, _)| at);
    rest.get(..end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_a_page() {
        for kind in FaultKind::ALL {
            let section = section(kind.slug()).unwrap();
            assert!(section.contains("- Client:") && section.matches("## ").count() == 1, "{section}");
        }
        assert_eq!(section("nothing"), None);
    }
}
