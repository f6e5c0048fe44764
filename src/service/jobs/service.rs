use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, watch};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::events::panicked;
use super::heartbeat::Heartbeats;
use super::running::{Running, Worker};
use super::{CpuPool, ServiceSettings};
use prosopon_contract::{Fault, Halt};
use prosopon_geometry::control::Control;
use prosopon_session::Engine;
use prosopon_store::{Audit, JobId, Lane, Store, WorkerId};

/// Sessions and jobs over one store, one engine and one CPU pool.
#[derive(Debug)]
pub struct Service {
    pub(super) store: Store,
    pub(super) engine: Arc<dyn Engine>,
    pub(super) cpu: CpuPool,
    pub(super) settings: ServiceSettings,
    pub(super) audit: Audit,
    /// Id of this process for others on the same store.
    pub(super) worker: WorkerId,
    /// Notified when a job was accepted, by lane.
    pub(super) wake: [Notify; Lane::ALL.len()],
    pub(super) running: Mutex<Vec<Arc<Running>>>,
    /// Incremented whenever an event was stored.
    pub(super) changes: watch::Sender<u64>,
    /// Cancelled when no job is begun any more.
    pub(super) drain: CancellationToken,
    pub(super) stop: CancellationToken,
    pub(super) beats: Heartbeats,
    /// Workers that claim no job because the bucket refuses them.
    pub(super) refused: Mutex<Vec<Worker>>,
    pub(super) tasks: Mutex<Vec<JoinHandle<()>>>,
    /// Held while a stored result is read.
    pub(super) recalling: tokio::sync::Mutex<()>,
}

impl Service {
    /// The store.
    #[must_use]
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// The limits and retention times.
    #[must_use]
    pub fn settings(&self) -> &ServiceSettings {
        &self.settings
    }

    /// The numerics.
    #[must_use]
    pub fn engine(&self) -> &Arc<dyn Engine> {
        &self.engine
    }

    /// Stops beginning jobs and waits at most `patience` for the running ones.
    pub async fn drain(&self, patience: Duration) {
        self.drain.cancel();
        let mut changes = self.watch_changes();
        let idle = async {
            loop {
                changes.borrow_and_update();
                if self.running_jobs().is_empty() || changes.changed().await.is_err() {
                    return;
                }
            }
        };
        if tokio::time::timeout(patience, idle).await.is_err() {
            tracing::info!("a job still runs; it is interrupted, and the next start continues it");
        }
    }

    /// Stops the workers, interrupts the running jobs and waits for them at most `grace`.
    pub async fn shut_down(&self, grace: Duration) {
        self.stop.cancel();
        for running in self.running_jobs() {
            running.control.cancel();
        }
        let tasks = std::mem::take(&mut *self.tasks.lock().unwrap_or_else(PoisonError::into_inner));
        let ended = async {
            for task in tasks {
                task.await.ok();
            }
        };
        if tokio::time::timeout(grace, ended).await.is_err() {
            tracing::warn!("a running job did not stop in time; the next start continues it");
        }
    }

    /// Token that is cancelled when the service stops; event streams end with it.
    #[must_use]
    pub fn stopping(&self) -> &CancellationToken {
        &self.stop
    }

    /// Whether the service accepts and begins no jobs any more.
    #[must_use]
    pub fn is_draining(&self) -> bool {
        self.drain.is_cancelled()
    }

    /// Whether a worker of this process claims no job because the bucket refuses it.
    #[must_use]
    pub fn is_refused(&self) -> bool {
        !self.refused.lock().unwrap_or_else(PoisonError::into_inner).is_empty()
    }

    pub(super) fn set_refused(&self, worker: Worker, refused: bool) {
        let mut all = self.refused.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|other| *other != worker);
        if refused {
            all.push(worker);
        }
    }

    pub(super) fn running_jobs(&self) -> Vec<Arc<Running>> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Number of running jobs of a lane in this process.
    #[must_use]
    pub fn running_in(&self, lane: Lane) -> usize {
        self.running_jobs().iter().filter(|r| r.worker.lane == lane).count()
    }

    pub(super) fn running(&self, job: JobId) -> Option<Arc<Running>> {
        self.running_jobs().into_iter().find(|r| r.job == job)
    }

    pub(super) fn set_running(&self, running: Arc<Running>) {
        self.running.lock().unwrap_or_else(PoisonError::into_inner).push(running);
    }

    pub(super) fn unset_running(&self, running: &Arc<Running>) {
        // This process may have begun the same job again after its lease expired, so compare the attempt.
        self.running.lock().unwrap_or_else(PoisonError::into_inner).retain(|r| !Arc::ptr_eq(r, running));
    }

    pub(super) fn woken(&self, lane: Lane) -> &Notify {
        &self.wake[lane as usize]
    }

    pub(super) fn announce(&self) {
        self.changes.send_modify(|n| *n += 1);
    }

    /// A receiver that changes whenever an event was stored.
    #[must_use]
    pub fn watch_changes(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
    }

    /// Runs the short computation of a request on the threads for requests.
    ///
    /// The computation is cancelled when the caller drops the future.
    ///
    /// # Errors
    /// The computation's, or [`Internal`](prosopon_contract::FaultKind::Internal) when it panics.
    pub async fn compute<T: Send + 'static>(
        &self,
        work: impl FnOnce(&dyn Engine, &Control) -> Result<T, Halt> + Send + 'static,
    ) -> Result<T, Fault> {
        let control = Control::new();
        let _cancel_on_leave = CancelOnDrop(control.clone());
        let engine = Arc::clone(&self.engine);
        let done = self.cpu.run_request(move || work(engine.as_ref(), &control)).await;
        Ok(done.map_err(|_| panicked())??)
    }
}

struct CancelOnDrop(Control);

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.cancel();
    }
}
