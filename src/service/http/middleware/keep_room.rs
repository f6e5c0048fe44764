use axum::extract::{Request, State};
use axum::http::Method;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::http::{AppState, Problem};

/// Refuses what may store something while the disk has room for deletions only.
pub(in crate::http) async fn keep_room(State(state): State<AppState>, request: Request, next: Next) -> Response {
    // Cancelling makes room, and a waiting job would otherwise run against its sender's will.
    let stores = [Method::POST, Method::PUT].contains(request.method()) && !request.uri().path().ends_with("/cancel");
    match if stores { state.service.store().check_room() } else { Ok(()) } {
        Ok(()) => next.run(request).await,
        Err(full) => Problem::from(full).into_response(),
    }
}
