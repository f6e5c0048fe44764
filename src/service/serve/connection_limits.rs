use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use axum_server::accept::Accept;
use futures::future::BoxFuture;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio_io_timeout::TimeoutStream;

/// Closes connections whose client accepts no data for a while, and refuses those above the limit.
///
/// So slow clients cannot hold memory and file descriptors.
#[derive(Debug, Clone)]
pub(super) struct LimitingAcceptor<A> {
    inner: A,
    stalled: Duration,
    connections: Arc<Semaphore>,
}

impl<A> LimitingAcceptor<A> {
    pub(super) fn new(inner: A, stalled: Duration, most: usize) -> Self {
        Self { inner, stalled, connections: Arc::new(Semaphore::new(most.min(Semaphore::MAX_PERMITS))) }
    }
}

impl<A, I, S> Accept<I, S> for LimitingAcceptor<A>
where
    A: Accept<I, S> + Clone + Send + 'static,
    A::Stream: AsyncRead + AsyncWrite + Send,
    A::Service: Send,
    A::Future: Send,
    I: Send + 'static,
    S: Send + 'static,
{
    type Stream = WriteTimeoutStream<A::Stream>;
    type Service = A::Service;
    type Future = BoxFuture<'static, io::Result<(Self::Stream, Self::Service)>>;

    fn accept(&self, stream: I, service: S) -> Self::Future {
        let (inner, stalled) = (self.inner.clone(), self.stalled);
        let permit = Arc::clone(&self.connections).try_acquire_owned();
        Box::pin(async move {
            let Ok(permit) = permit else {
                metrics::counter!("prosopon_connections_refused_total").increment(1);
                return Err(io::Error::other("too many connections"));
            };
            let (stream, service) = inner.accept(stream, service).await?;
            Ok((WriteTimeoutStream::new(stream, stalled, permit), service))
        })
    }
}

/// A connection that fails when a write waits too long.
#[derive(Debug)]
pub(super) struct WriteTimeoutStream<T> {
    stream: Pin<Box<TimeoutStream<T>>>,
    _permit: OwnedSemaphorePermit,
}

impl<T: AsyncRead + AsyncWrite> WriteTimeoutStream<T> {
    fn new(stream: T, stalled: Duration, permit: OwnedSemaphorePermit) -> Self {
        let mut stream = TimeoutStream::new(stream);
        stream.set_write_timeout(Some(stalled));
        Self { stream: Box::pin(stream), _permit: permit }
    }
}

/// Counts a write that ended because the client took nothing.
fn counted<R>(written: Poll<io::Result<R>>) -> Poll<io::Result<R>> {
    if let Poll::Ready(Err(error)) = &written
        && error.kind() == io::ErrorKind::TimedOut
    {
        metrics::counter!("prosopon_connections_stalled_total").increment(1);
    }
    written
}

impl<T: AsyncRead + AsyncWrite> AsyncRead for WriteTimeoutStream<T> {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        self.stream.as_mut().poll_read(cx, buffer)
    }
}

impl<T: AsyncRead + AsyncWrite> AsyncWrite for WriteTimeoutStream<T> {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        counted(self.stream.as_mut().poll_write(cx, bytes))
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        counted(self.stream.as_mut().poll_write_vectored(cx, slices))
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        counted(self.stream.as_mut().poll_flush(cx))
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        counted(self.stream.as_mut().poll_shutdown(cx))
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::AsyncWriteExt;

    use super::*;

    #[tokio::test]
    async fn a_client_that_takes_nothing_is_let_go() {
        let (here, there) = tokio::io::duplex(16);
        let permit = Arc::new(Semaphore::new(1)).try_acquire_owned().unwrap();
        let mut watched = WriteTimeoutStream::new(here, Duration::from_millis(50), permit);
        let error = watched.write_all(&[0; 64]).await.unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        drop(there);
    }
}
