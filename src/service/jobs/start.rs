use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use super::heartbeat::Heartbeats;
use super::recovery::recover;
use super::running::Worker;
use super::{CpuPool, Service, ServiceSettings, janitor, others, worker};
use prosopon_contract::Fault;
use prosopon_session::Engine;
use prosopon_store::{Audit, Store, WorkerId};

impl Service {
    /// Recovers the jobs of an earlier run and starts the workers and background tasks.
    ///
    /// # Errors
    /// The store's.
    pub async fn start(
        store: Store,
        engine: Arc<dyn Engine>,
        cpu: CpuPool,
        audit: Audit,
        settings: ServiceSettings,
    ) -> Result<Arc<Self>, Fault> {
        let stop = CancellationToken::new();
        let workers = if settings.computes_jobs { Worker::all(settings.parallel_jobs) } else { Vec::new() };
        let service = Arc::new(Self {
            store: store.with_quota(settings.session_quota),
            engine,
            cpu,
            settings,
            audit,
            worker: WorkerId::new(),
            wake: Default::default(),
            running: Mutex::default(),
            changes: watch::Sender::new(0),
            drain: stop.child_token(),
            stop,
            beats: Heartbeats::new(workers.clone()),
            refused: Mutex::default(),
            tasks: Mutex::default(),
            recalling: tokio::sync::Mutex::default(),
        });
        service.store.keep_free(service.settings.min_free);
        service.check_audit_end().await?;
        // In a shared store, running jobs may belong to other processes; `take_over` waits for their leases to expire.
        let abandoned = if service.store.is_shared() { Vec::new() } else { service.store.abandoned().await? };
        recover(&service, abandoned).await?;
        let mut tasks = vec![tokio::spawn(janitor::anchor_audit(Arc::clone(&service)))];
        if settings.runs_maintenance {
            tasks.push(tokio::spawn(janitor::run_maintenance(Arc::clone(&service))));
        }
        if service.store.is_shared() {
            tasks.push(tokio::spawn(others::follow(Arc::clone(&service))));
            tasks.push(tokio::spawn(others::take_over(Arc::clone(&service))));
        }
        tasks
            .extend(workers.into_iter().map(|worker| tokio::spawn(worker::work_through(Arc::clone(&service), worker))));
        *service.tasks.lock().unwrap_or_else(PoisonError::into_inner) = tasks;
        Ok(service)
    }
}
