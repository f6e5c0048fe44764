use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use tokio::sync::oneshot;

/// The computation panicked; the log has the message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the computation panicked")]
pub struct Panicked;

/// The threads that run numerics; async code never computes.
///
/// Short computations of requests have separate threads, so that they do not wait for a whole job. Each worker has separate
/// threads too, because a thread that waits for a part of one job would otherwise begin another job.
///
/// Work whose caller has gone before it starts is skipped. Clones share the threads.
#[derive(Debug, Clone)]
pub struct CpuPool {
    jobs: Arc<[rayon::ThreadPool]>,
    requests: Arc<rayon::ThreadPool>,
}

impl CpuPool {
    /// Starts `threads` threads for jobs, divided among `parallel_jobs` workers, and as many for requests.
    ///
    /// With `threads` = 0 there is one thread per core.
    ///
    /// # Errors
    /// When the threads cannot be started.
    pub fn new(threads: usize, parallel_jobs: usize) -> Result<Self, rayon::ThreadPoolBuildError> {
        let all = if threads == 0 { std::thread::available_parallelism().map_or(1, usize::from) } else { threads };
        let pool = |name: String, threads: usize| {
            let builder = rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(16 << 20);
            builder.thread_name(move |index| format!("{name}-{index}")).build()
        };
        let each = (all / parallel_jobs.max(1)).max(1);
        let jobs: Result<Vec<_>, _> = (0..parallel_jobs.max(1)).map(|n| pool(format!("job-{n}"), each)).collect();
        Ok(Self { jobs: jobs?.into(), requests: Arc::new(pool("request".to_owned(), all)?) })
    }

    /// Runs the `work` of a job on the threads of a worker; workers are numbered from 0.
    ///
    /// # Errors
    /// [`Panicked`] when `work` panics; the pool stays usable.
    pub async fn run_job<T: Send + 'static>(
        &self,
        worker: usize,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Panicked> {
        run(&self.jobs[worker % self.jobs.len()], work).await
    }

    /// Runs the short `work` of a request on the threads for requests.
    ///
    /// # Errors
    /// [`Panicked`] when `work` panics; the pool stays usable.
    pub async fn run_request<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Panicked> {
        run(&self.requests, work).await
    }
}

async fn run<T: Send + 'static>(
    pool: &rayon::ThreadPool,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Panicked> {
    let (sender, receiver) = oneshot::channel();
    let span = tracing::Span::current();
    pool.spawn(move || {
        if sender.is_closed() {
            return;
        }
        let result = span.in_scope(|| catch_unwind(AssertUnwindSafe(work)));
        let result = result.map_err(|payload| {
            let message = payload
                .downcast_ref::<&str>()
                .map(|s| (*s).to_owned())
                .or_else(|| payload.downcast_ref::<String>().cloned())
                .unwrap_or_default();
            tracing::error!(message, "a computation panicked");
            Panicked
        });
        // The caller may have left meanwhile.
        sender.send(result).ok();
    });
    // The sender is dropped unused only when the pool is torn down.
    receiver.await.unwrap_or(Err(Panicked))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_panic_becomes_an_error_and_the_pool_goes_on() {
        let pool = CpuPool::new(1, 1).unwrap();
        assert_eq!(pool.run_job(0, || -> u8 { panic!("planted") }).await, Err(Panicked));
        assert_eq!(pool.run_job(0, || 7).await, Ok(7));
    }

    #[tokio::test]
    async fn a_request_does_not_wait_for_a_job() {
        let pool = CpuPool::new(1, 1).unwrap();
        let (release, gate) = std::sync::mpsc::channel::<()>();
        let job = tokio::spawn({
            let pool = pool.clone();
            async move { pool.run_job(0, move || gate.recv().is_ok()).await }
        });
        tokio::task::yield_now().await;
        assert_eq!(pool.run_request(|| 7).await, Ok(7));
        release.send(()).unwrap();
        assert_eq!(job.await.unwrap(), Ok(true));
    }

    #[tokio::test]
    async fn jobs_of_two_workers_do_not_wait_for_each_other() {
        let pool = CpuPool::new(1, 2).unwrap();
        let (release, gate) = std::sync::mpsc::channel::<()>();
        let first = tokio::spawn({
            let pool = pool.clone();
            async move { pool.run_job(0, move || gate.recv().is_ok()).await }
        });
        tokio::task::yield_now().await;
        assert_eq!(pool.run_job(1, || 7).await, Ok(7));
        release.send(()).unwrap();
        assert_eq!(first.await.unwrap(), Ok(true));
    }

    #[tokio::test]
    async fn work_nobody_waits_for_is_skipped() {
        let pool = CpuPool::new(1, 1).unwrap();
        let (release, gate) = std::sync::mpsc::channel::<()>();
        let blocker = tokio::spawn({
            let pool = pool.clone();
            async move { pool.run_job(0, move || gate.recv().is_ok()).await }
        });
        tokio::task::yield_now().await;
        let (ran, was_run) = std::sync::mpsc::channel();
        let abandoned = tokio::spawn({
            let pool = pool.clone();
            async move { pool.run_job(0, move || ran.send(()).unwrap()).await }
        });
        tokio::task::yield_now().await;
        abandoned.abort();
        assert!(abandoned.await.is_err());
        release.send(()).unwrap();
        blocker.await.unwrap().unwrap();
        pool.run_job(0, || ()).await.unwrap();
        assert!(was_run.try_recv().is_err());
    }
}
