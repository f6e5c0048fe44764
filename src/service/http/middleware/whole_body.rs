use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::{Body, Bytes, HttpBody};
use axum::extract::{Request, State};
use axum::http::{HeaderValue, Method, Version, header};
use axum::middleware::Next;
use axum::response::Response;
use futures::StreamExt;
use http_body::{Frame, SizeHint};

/// The longest pause in what a client sends after the answer: then it has stopped.
const PAUSE: Duration = Duration::from_secs(2);

/// Reads and drops what a handler leaves of a body, for `patience` at most.
///
/// A client that sends its whole body before it reads then gets the answer and not a closed connection. After a refused upload
/// the connection ends. A client that expects `100 Continue` has sent nothing while nobody has read, so nothing is read then.
pub(in crate::http) async fn take_whole_body(
    State(patience): State<Duration>,
    request: Request,
    next: Next,
) -> Response {
    let has_headers_of_connections = request.version() <= Version::HTTP_11;
    let is_upload = request.method() == Method::PUT && has_headers_of_connections;
    let is_sent = !request.headers().contains_key(header::EXPECT);
    let request = request.map(|body| Body::new(WholeBody { body, is_sent, patience }));
    let mut response = next.run(request).await;
    if is_upload && !response.status().is_success() {
        response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    }
    response
}

/// A body whose rest is read when it is dropped.
struct WholeBody {
    body: Body,
    /// Whether the client has sent the body, or was asked to.
    is_sent: bool,
    patience: Duration,
}

impl HttpBody for WholeBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        self.is_sent = true;
        let frame = Pin::new(&mut self.body).poll_frame(context);
        if matches!(frame, Poll::Ready(None | Some(Err(_)))) {
            self.body = Body::empty();
        }
        frame
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

impl Drop for WholeBody {
    fn drop(&mut self) {
        if !self.is_sent || self.body.is_end_stream() {
            return;
        }
        let mut pieces = std::mem::take(&mut self.body).into_data_stream();
        if let Ok(runtime) = tokio::runtime::Handle::try_current() {
            let rest = async move { while let Ok(Some(Ok(_))) = tokio::time::timeout(PAUSE, pieces.next()).await {} };
            runtime.spawn(tokio::time::timeout(self.patience, rest));
        }
    }
}
