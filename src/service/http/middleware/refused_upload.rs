use axum::extract::Request;
use axum::http::{HeaderValue, Method, Version, header};
use axum::middleware::Next;
use axum::response::Response;

/// Says that the connection ends after a refused upload, whose rest the service does not read.
pub(in crate::http) async fn close_refused_upload(request: Request, next: Next) -> Response {
    let has_headers_of_connections = request.version() <= Version::HTTP_11;
    let is_upload = request.method() == Method::PUT && has_headers_of_connections;
    let mut response = next.run(request).await;
    if is_upload && !response.status().is_success() {
        response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    }
    response
}
