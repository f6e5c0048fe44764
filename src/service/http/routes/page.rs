use axum::response::Html;

/// Show the start page
///
/// Returns a page that describes the service and links to the documentation.
#[utoipa::path(get, path = "/", operation_id = "home", tag = "health", responses((status = 200, description = "The page.", body = String, content_type = "text/html")))]
pub(in crate::http) async fn page() -> Html<&'static str> {
    Html(include_str!("page.html"))
}
