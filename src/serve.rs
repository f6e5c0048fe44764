//! A running service: store, numerics, jobs and HTTP put together.
//!
//! Invariant: what is started here is stopped here, in the order in which requests depend on it.

use std::future::Future;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpListener;
use tokio::task::JoinHandle;

use crate::config::{ConfigError, ServeConfig};
use crate::http::{AppState, app};
use crate::jobs::{CpuPool, Service};
use crate::session::{Engine, Fault, Numerics};
use crate::store::{Store, StoreError};
use crate::telemetry;

/// Longest wait for a running job and open requests when the service stops.
const GRACE: Duration = Duration::from_secs(20);

/// Why the service did not start.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The data directory.
    #[error("the data directory {directory} cannot be used")]
    Store {
        /// Where it is.
        directory: String,
        /// What is wrong with it.
        source: StoreError,
    },
    /// The address.
    #[error("cannot listen on {address}")]
    Listen {
        /// Address asked for.
        address: SocketAddr,
        /// What the system says.
        source: std::io::Error,
    },
    /// The CPU pool.
    #[error("the CPU pool cannot be started")]
    Pool(#[from] rayon::ThreadPoolBuildError),
    /// Jobs left by an earlier run.
    #[error("jobs of an earlier run cannot be taken up: {}", .0.detail)]
    Jobs(Box<Fault>),
}

/// A service that answers requests until it is stopped.
#[derive(Debug)]
pub struct Running {
    address: SocketAddr,
    service: Arc<Service>,
    server: JoinHandle<std::io::Result<()>>,
}

/// Starts the service with the real numerics.
///
/// # Errors
/// [`ServeError`].
pub async fn start(config: ServeConfig) -> Result<Running, ServeError> {
    let engine = Arc::new(Numerics::new(config.service.import));
    start_with(config, engine).await
}

/// Starts the service with the given numerics.
///
/// # Errors
/// [`ServeError`].
pub async fn start_with(config: ServeConfig, engine: Arc<dyn Engine>) -> Result<Running, ServeError> {
    config.check()?;
    let store_error = |source| ServeError::Store { directory: config.data.display().to_string(), source };
    let store = Store::open(&config.data).await.map_err(store_error)?;
    let state = state(&config, store, engine).await?;
    let listen_error = |source| ServeError::Listen { address: config.listen, source };
    let listener = TcpListener::bind(config.listen).await.map_err(listen_error)?;
    let address = listener.local_addr().map_err(listen_error)?;
    // For scripts that asked for a free port: whole or not there.
    let note = config.data.join("listen");
    let fresh = config.data.join("listen.new");
    tokio::fs::write(&fresh, format!("http://{address}\n")).await.map_err(|e| store_error(e.into()))?;
    tokio::fs::rename(&fresh, &note).await.map_err(|e| store_error(e.into()))?;
    let service = Arc::clone(&state.service);
    let stopping = service.stopping().clone().cancelled_owned();
    let server = axum::serve(listener, app(state)).with_graceful_shutdown(stopping);
    tracing::info!(%address, data = %config.data.display(), version = env!("CARGO_PKG_VERSION"), "serving");
    Ok(Running { address, service, server: tokio::spawn(server.into_future()) })
}

/// The state of the router over an open store.
///
/// # Errors
/// [`ServeError::Pool`], [`ServeError::Jobs`].
pub async fn state(config: &ServeConfig, store: Store, engine: Arc<dyn Engine>) -> Result<AppState, ServeError> {
    let cpu = CpuPool::new(config.threads)?;
    let service = Service::start(store, engine, cpu, config.service);
    Ok(AppState {
        service: service.await.map_err(|f| ServeError::Jobs(Box::new(f)))?,
        limits: config.limits,
        metrics: telemetry::start_metrics(),
        allowed_hosts: config.allowed_hosts.clone().into(),
    })
}

impl Running {
    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// `http://` and the address.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Sessions and jobs.
    #[must_use]
    pub fn service(&self) -> &Arc<Service> {
        &self.service
    }

    /// Stops taking requests, interrupts the running job (the next start takes it up) and closes the store.
    pub async fn shut_down(self) {
        self.service.shut_down(GRACE).await;
        if tokio::time::timeout(GRACE, self.server).await.is_err() {
            tracing::warn!("open requests did not end in time");
        }
        self.service.store().close().await;
        tracing::info!("stopped");
    }

    /// Serves until `stop` is ready.
    pub async fn until(self, stop: impl Future<Output = ()>) {
        stop.await;
        self.shut_down().await;
    }
}
