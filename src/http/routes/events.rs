use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures::{Stream, StreamExt, stream};

use crate::http::dto::render_event;
use crate::http::extract::Ids;
use crate::http::{AppState, Problem};
use crate::jobs::EventFeed;
use crate::session::FaultKind;
use crate::store::{EventRecord, JobId};

/// Follow a job
///
/// Server-Sent Events `status`, `progress`, `step`, `warning`, `end`; ids count up and Last-Event-ID replays from there.
/// With `Accept: application/x-ndjson` the same as lines `{id, event, data}`. 204 when nothing comes after the given id.
#[utoipa::path(get, path = "/v1/jobs/{job}/events", tag = "jobs",
    params(("job" = Uuid, Path), ("Last-Event-ID" = Option<u64>, Header)),
    responses((status = 200, description = "events", content(
        (String = "text/event-stream"), (String = "application/x-ndjson"))),
        (status = 204, description = "the job has ended and all was sent")))]
pub(in crate::http) async fn events(
    State(state): State<AppState>,
    Ids(id): Ids<JobId>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = state.service.job(id).await?;
    let last = last_event_id(&headers)?;
    if job.state.has_ended() && state.service.store().events(id, last).await?.is_empty() {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let events = feed(EventFeed::new(Arc::clone(&state.service), id, last));
    let lines = headers.get(header::ACCEPT).is_some_and(|a| a == "application/x-ndjson");
    if lines {
        let lines = events.map(move |event| {
            let line = serde_json::json!({ "id": event.seq, "event": event.kind, "data": render_event(id, &event) });
            Ok::<_, Infallible>(format!("{line}\n"))
        });
        let headers = [(header::CONTENT_TYPE, "application/x-ndjson"), (header::CACHE_CONTROL, "no-store")];
        return Ok((headers, Body::from_stream(lines)).into_response());
    }
    let events = events.map(move |event| {
        let data = render_event(id, &event).to_string();
        Ok::<_, Infallible>(Event::default().id(event.seq.to_string()).event(event.kind).data(data))
    });
    Ok(Sse::new(events).keep_alive(KeepAlive::new().interval(Duration::from_secs(15))).into_response())
}

fn last_event_id(headers: &HeaderMap) -> Result<u64, Problem> {
    let Some(value) = headers.get("last-event-id") else { return Ok(0) };
    let number = value.to_str().ok().and_then(|v| v.parse().ok());
    number.ok_or_else(|| Problem::new(FaultKind::MalformedRequest, "Last-Event-ID must be a number"))
}

/// Events one by one; ends when the feed ends or fails (the log says why).
fn feed(feed: EventFeed) -> impl Stream<Item = EventRecord> + Send {
    stream::unfold(feed, |mut feed| async move {
        let batch = feed.next().await.unwrap_or_default();
        (!batch.is_empty()).then_some((stream::iter(batch), feed))
    })
    .flatten()
}
