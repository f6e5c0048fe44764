use axum::response::Html;

/// What this is
///
/// A page that says it and links to the documentation.
#[utoipa::path(get, path = "/", tag = "health", responses((status = 200, description = "the page", body = String, content_type = "text/html")))]
pub(in crate::http) async fn page() -> Html<&'static str> {
    Html(include_str!("page.html"))
}
