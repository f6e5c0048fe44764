use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures::{Stream, StreamExt, stream};
use uuid::Uuid;

use crate::http::auth::Principal;
use crate::http::dto::{JobEventLine, SentEvent, render_event};
use crate::http::extract::Ids;
use crate::http::{AppState, Problem};
use prosopon_contract::{Fault, FaultKind};
use prosopon_jobs::EventFeed;
use prosopon_store::{EventRecord, JobId, JobKind};

/// Shortest reconnection delay of clients.
///
/// A random delay of up to the same length is added, so that clients do not all reconnect at once.
const RETRY: Duration = Duration::from_millis(1500);

/// An item of the stream.
#[derive(Debug)]
enum StreamItem {
    Event(EventRecord),
    /// Sent after a silence, with the number of the last event.
    Heartbeat(u64),
}

/// Follow a job
///
/// Streams the Server-Sent Events `status`, `progress`, `step`, `warning` and `end`. Ids increase; with `Last-Event-ID` the
/// stream starts after that event. The answer is 204 if no event follows it. If events after it are no longer stored, the
/// stream starts with `resync`: read the job's status to see what was missed. A job that is deleted with its session ends as
/// `cancelled` with the problem `gone`. Comments break long silences.
///
/// With `Accept: application/x-ndjson` the stream has one line `{id, event, data}` per event, and lines with the event
/// `heartbeat` instead of comments.
#[utoipa::path(get, path = "/v1/jobs/{job}/events", operation_id = "followJob", tag = "jobs",
    params(("job" = Uuid, Path), ("Last-Event-ID" = Option<u64>, Header)),
    responses((status = 200, description = "The stream of events.", content(
        (SentEvent = "text/event-stream"), (JobEventLine = "application/x-ndjson"))),
        (status = 204, description = "The job has ended and all events were sent.")))]
pub(in crate::http) async fn events(
    State(state): State<AppState>,
    Ids(id): Ids<JobId>,
    sender: Principal,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let events = EventFeed::open(Arc::clone(&state.service), id, last_event_id(&headers)?).await?;
    if events.is_spent() {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let has_report = state.service.job(id).await?.kind == JobKind::Solve;
    let revoked = Box::pin(state.access.clone().until_revoked(sender));
    let heartbeat = state.limits.heartbeat;
    if headers.get(header::ACCEPT).is_some_and(|a| a == "application/x-ndjson") {
        let lines = stream_items(events, Some(heartbeat))
            .take_until(revoked)
            .map(move |item| Ok::<_, Infallible>(line((id, has_report), &item)));
        let headers = [(header::CONTENT_TYPE, "application/x-ndjson"), (header::CACHE_CONTROL, "no-store")];
        return Ok((headers, Body::from_stream(lines)).into_response());
    }
    let first = stream::once(async { Ok::<_, Infallible>(Event::default().retry(retry())) });
    let events =
        first.chain(stream_items(events, None).take_until(revoked).map(move |item| Ok(sse((id, has_report), item))));
    Ok(Sse::new(events).keep_alive(KeepAlive::new().interval(heartbeat)).into_response())
}

fn line((job, has_report): (JobId, bool), item: &StreamItem) -> String {
    let line = match item {
        StreamItem::Event(event) => {
            serde_json::json!({ "id": event.seq, "event": event.kind, "data": render_event(job, has_report, event) })
        }
        StreamItem::Heartbeat(last) => serde_json::json!({ "id": last, "event": "heartbeat", "data": {} }),
    };
    format!("{line}\n")
}

fn sse((job, has_report): (JobId, bool), item: StreamItem) -> Event {
    match item {
        StreamItem::Event(event) => {
            let data = render_event(job, has_report, &event).to_string();
            Event::default().id(event.seq.to_string()).event(event.kind).data(data)
        }
        StreamItem::Heartbeat(_) => Event::default().comment(""),
    }
}

fn retry() -> Duration {
    let most = RETRY.as_millis();
    RETRY + Duration::from_millis(u64::try_from(Uuid::new_v4().as_u128() % most.max(1)).unwrap_or(0))
}

fn last_event_id(headers: &HeaderMap) -> Result<u64, Problem> {
    let Some(value) = headers.get("last-event-id") else { return Ok(0) };
    // The store counts in signed 64-bit integers.
    let number = value.to_str().ok().and_then(|v| v.parse().ok()).filter(|n| *n <= i64::MAX.unsigned_abs());
    let refused = || Fault::new(FaultKind::MalformedRequest, "must be a whole number from 0 on").at("Last-Event-ID");
    number.ok_or_else(|| refused().into())
}

/// Events one by one, and heartbeats after a silence of that length.
///
/// Ends when the feed ends or fails; the log has the reason.
fn stream_items(feed: EventFeed, heartbeat: Option<Duration>) -> impl Stream<Item = StreamItem> + Send {
    stream::unfold(feed, move |mut feed| async move {
        let batch = match heartbeat {
            Some(silence) => match tokio::time::timeout(silence, feed.next()).await {
                Ok(batch) => batch.unwrap_or_default(),
                Err(_) => {
                    let beat = vec![StreamItem::Heartbeat(feed.last())];
                    return Some((stream::iter(beat), feed));
                }
            },
            None => feed.next().await.unwrap_or_default(),
        };
        let item: Vec<StreamItem> = batch.into_iter().map(StreamItem::Event).collect();
        (!item.is_empty()).then_some((stream::iter(item), feed))
    })
    .flatten()
}
