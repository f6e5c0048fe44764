use axum::extract::Path;
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::response::{Html, IntoResponse, Response};
use include_dir::{Dir, File, include_dir};

use crate::http::Problem;
use prosopon_contract::FaultKind;

/// The built viewer; no file where the program was built without npm.
static VIEWER: Dir<'static> = include_dir!("$OUT_DIR/viewer");

/// Pages of the viewer load nothing but its own files, and talk to this service only.
const VIEWER_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' blob:; \
    frame-ancestors 'none'; base-uri 'none'; form-action 'none'";
/// Names of these files change with their content.
const FOR_EVER: &str = "public, max-age=31536000, immutable";

/// Show the viewer
///
/// Returns the page of the viewer. A program that was built without npm has none: then this page says how to get it.
#[utoipa::path(get, path = "/", operation_id = "home", tag = "health", responses((status = 200, description = "The page.", body = String, content_type = "text/html")))]
pub(in crate::http) async fn page() -> Response {
    match VIEWER.get_file("index.html") {
        Some(file) => ([(CONTENT_SECURITY_POLICY, VIEWER_POLICY)], send(file, "no-cache")).into_response(),
        None => Html(include_str!("page.html")).into_response(),
    }
}

/// Sends a file of the viewer.
pub(in crate::http) async fn viewer_file(Path(name): Path<String>) -> Result<Response, Problem> {
    let file = VIEWER.get_file(format!("assets/{name}"));
    let file = file.ok_or_else(|| Problem::new(FaultKind::NotFound, format!("there is no file /assets/{name}")))?;
    Ok(send(file, FOR_EVER))
}

/// Sends the icon of the viewer.
pub(in crate::http) async fn viewer_icon() -> Result<Response, Problem> {
    let file = VIEWER.get_file("icon.svg").ok_or_else(|| Problem::new(FaultKind::NotFound, "there is no icon"))?;
    Ok(send(file, "no-cache"))
}

fn send(file: &'static File<'static>, caching: &'static str) -> Response {
    let media_type = mime_guess::from_path(file.path()).first_or_octet_stream().to_string();
    ([(CONTENT_TYPE, media_type), (CACHE_CONTROL, caching.to_owned())], file.contents()).into_response()
}
