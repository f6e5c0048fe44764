//! The running service: assembles store, numerics, jobs and HTTP, starts and stops them.
//!
//! Invariant: this module stops everything that it starts, in the order in which requests depend on it. Futures are boxed,
//! because an `async fn` and everything it awaits would be compiled again in every package that calls it.

mod connection_limits;
mod keys;
mod tls;
mod watch;

use std::future::Future;
use std::net::{IpAddr, SocketAddr};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use axum_server::Handle;
use axum_server::accept::DefaultAcceptor;
use axum_server::tls_rustls::RustlsAcceptor;
use futures::future::{BoxFuture, LocalBoxFuture};
use hyper_util::rt::{TokioExecutor, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;

use self::connection_limits::LimitingAcceptor;
use crate::config::{ConfigError, ConnectionLimits, ServeConfig};
use crate::http::auth::{Access, AuthError, Authenticator, Links};
use crate::http::{AppState, app, worker_app};
use crate::telemetry;
use prosopon_contract::Fault;
use prosopon_jobs::{CpuPool, Service, ServiceSettings, StuckComputation};
use prosopon_session::{Engine, Numerics};
use prosopon_store::{Audit, Store, StoreError};

/// Time between two checks that the data directory is still there.
const LOOK_FOR_DIRECTORY_EVERY: Duration = Duration::from_secs(1);
/// Longest wait for an interrupted job, for open requests and for the database when the service stops.
const GRACE: Duration = Duration::from_secs(20);
/// Longest wait for the other jobs to return to the queue when a computation cannot be stopped.
const HANDS_BACK: Duration = Duration::from_secs(5);
/// Largest head of a request, bytes.
const HEAD_BYTES: usize = 64 << 10;
/// Largest number of header fields of a request.
const HEAD_FIELDS: usize = 64;

/// Why the service did not start.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The configuration has faults.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The store cannot be opened.
    #[error("{place} cannot be used")]
    Store {
        /// Database, bucket or directory of the store.
        place: String,
        /// Cause.
        source: StoreError,
    },
    /// The address cannot be listened on.
    #[error("cannot listen on {address}")]
    Listen {
        /// Configured address.
        address: SocketAddr,
        /// Cause given by the system.
        source: std::io::Error,
    },
    /// The threads of the CPU pool cannot be started.
    #[error("the CPU pool cannot be started")]
    Pool(#[from] rayon::ThreadPoolBuildError),
    /// The audit log cannot be opened.
    #[error("the audit log cannot be written")]
    Audit(#[source] std::io::Error),
    /// Authentication cannot be set up.
    #[error(transparent)]
    Auth(#[from] AuthError),
    /// Certificate or key cannot be read.
    #[error("certificate or key cannot be read")]
    Tls(#[source] std::io::Error),
    /// Jobs of an earlier run cannot be resumed.
    #[error("jobs of an earlier run cannot be resumed: {}", .0.detail)]
    Jobs(Box<Fault>),
}

/// Why the service ended by itself.
#[derive(Debug, thiserror::Error)]
pub enum ServiceEnd {
    /// What it writes would be lost.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A computation cannot be stopped within the process.
    #[error(transparent)]
    Stuck(#[from] StuckComputation),
}

/// A service that answers requests until it is stopped.
#[derive(Debug)]
pub struct Running {
    address: SocketAddr,
    scheme: &'static str,
    service: Arc<Service>,
    server: JoinHandle<std::io::Result<()>>,
    handle: Handle<SocketAddr>,
    drain: Duration,
}

/// Starts the service with the built-in numerics.
///
/// # Errors
/// [`ServeError`] if any part cannot be started.
pub fn start(config: ServeConfig) -> LocalBoxFuture<'static, Result<Running, ServeError>> {
    let engine = Arc::new(Numerics::new(config.service.import).with_cache_bytes(config.cache_bytes));
    start_with(config, engine)
}

/// Starts the service with the given numerics.
///
/// # Errors
/// [`ServeError`] if any part cannot be started.
pub fn start_with(
    config: ServeConfig,
    engine: Arc<dyn Engine>,
) -> LocalBoxFuture<'static, Result<Running, ServeError>> {
    Box::pin(started(config, engine))
}

async fn started(config: ServeConfig, engine: Arc<dyn Engine>) -> Result<Running, ServeError> {
    config.check()?;
    let store_error = |source| ServeError::Store { place: config.places.with_directory(&config.data), source };
    let store = Store::open_at(&config.data, &config.places).await.map_err(store_error)?;
    let state = state(&config, store, engine).await?;
    let listen_error = |source| ServeError::Listen { address: config.listen, source };
    let listener = TcpListener::bind(config.listen).await.map_err(listen_error)?;
    let address = listener.local_addr().map_err(listen_error)?;
    let listener = listener.into_std().map_err(listen_error)?;
    let tls = match &config.tls {
        Some(files) => Some((tls::load(files).await.map_err(ServeError::Tls)?, files.clone())),
        None => None,
    };
    let scheme = if tls.is_some() { "https" } else { "http" };
    if tls.is_none() && !address.ip().is_loopback() {
        tracing::warn!(
            "bearer tokens are sent without encryption; configure [tls], or let only a proxy with TLS reach this address"
        );
    }
    note_address(&config.data, scheme, address).await.map_err(|e| store_error(e.into()))?;
    let service = Arc::clone(&state.service);
    if let (Access::Tokens(authenticator), Some(source)) = (&state.access, config.source.clone()) {
        tokio::spawn(keys::renew(Arc::clone(authenticator), source, service.stopping().clone()));
    }
    let routes = if config.api { app(state) } else { worker_app(state) };
    let (routes, handle, limits) = (routes.into_make_service(), Handle::new(), config.connections);
    let mut server = axum_server::from_tcp(listener).map_err(listen_error)?.handle(handle.clone());
    bound(server.http_builder(), limits);
    let server = server.first_request_timeout(limits.head);
    let server = match tls {
        Some((tls, files)) => {
            tokio::spawn(tls::renew(tls.clone(), files, service.stopping().clone()));
            tokio::spawn(server.acceptor(patient(RustlsAcceptor::new(tls), limits)).serve(routes))
        }
        None => tokio::spawn(server.acceptor(patient(DefaultAcceptor::new(), limits)).serve(routes)),
    };
    tracing::info!(%address, data = %config.data.display(), version = env!("CARGO_PKG_VERSION"), "serving");
    Ok(Running { address, scheme, service, server, handle, drain: config.drain })
}

fn patient<A>(acceptor: A, limits: ConnectionLimits) -> LimitingAcceptor<A> {
    LimitingAcceptor::new(acceptor, limits.stalled, limits.most)
}

/// Makes the server refuse slow and large request heads before any handler sees them.
fn bound(builder: &mut Builder<TokioExecutor>, limits: ConnectionLimits) {
    builder.http1().timer(TokioTimer::new()).header_read_timeout(limits.head);
    builder.http1().max_buf_size(HEAD_BYTES).max_headers(HEAD_FIELDS);
    let most = u32::try_from(HEAD_BYTES).unwrap_or(u32::MAX);
    builder.http2().timer(TokioTimer::new()).max_header_list_size(most).max_concurrent_streams(100);
    builder.http2().keep_alive_interval(Duration::from_secs(30)).keep_alive_timeout(limits.head);
}

/// Writes the address to the file `listen`, for scripts that asked for a free port.
///
/// The file appears atomically.
async fn note_address(data: &Path, scheme: &str, address: SocketAddr) -> std::io::Result<()> {
    let fresh = data.join("listen.new");
    tokio::fs::write(&fresh, format!("{scheme}://{address}\n")).await?;
    tokio::fs::rename(&fresh, data.join("listen")).await
}

/// Makes the state of the router over an open store.
///
/// # Errors
/// [`ServeError::Pool`], [`ServeError::Audit`], [`ServeError::Auth`], [`ServeError::Jobs`].
pub fn state(
    config: &ServeConfig,
    store: Store,
    engine: Arc<dyn Engine>,
) -> BoxFuture<'_, Result<AppState, ServeError>> {
    Box::pin(state_over(config, store, engine))
}

async fn state_over(config: &ServeConfig, store: Store, engine: Arc<dyn Engine>) -> Result<AppState, ServeError> {
    let cpu = CpuPool::new(config.threads, config.service.parallel_jobs)?;
    let access = match &config.auth {
        Some(auth) => Access::Tokens(Authenticator::new(auth.clone())?),
        None => Access::Open,
    };
    let audit = Audit::open(&config.data).map_err(ServeError::Audit)?;
    let settings = ServiceSettings { runs_maintenance: config.api, ..config.service };
    let service = Service::start(store, engine, cpu, audit, settings).await;
    Ok(AppState {
        service: service.map_err(|f| ServeError::Jobs(Box::new(f)))?,
        limits: config.limits,
        metrics: telemetry::start_metrics(),
        allowed_hosts: config.allowed_hosts.clone().into(),
        access,
        links: Links::default(),
        origins: config.origins.clone().into(),
        tls: config.tls.is_some(),
    })
}

impl Running {
    /// Address on which the service listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// URL of the service. If it listens on all interfaces, the URL names loopback.
    #[must_use]
    pub fn url(&self) -> String {
        let mut address = self.address;
        if address.ip().is_unspecified() {
            address.set_ip(IpAddr::from([127, 0, 0, 1]));
        }
        format!("{}://{address}", self.scheme)
    }

    /// The service behind the API: sessions and jobs.
    #[must_use]
    pub fn service(&self) -> &Arc<Service> {
        &self.service
    }

    /// Stops the service.
    ///
    /// It takes no new jobs, waits for running jobs up to the configured time, interrupts the rest (the next start resumes
    /// them), lets open requests end and closes the store.
    pub fn shut_down(self) -> BoxFuture<'static, ()> {
        Box::pin(self.ended(GRACE))
    }

    async fn ended(self, grace: Duration) {
        self.service.drain(self.drain).await;
        self.service.shut_down(grace).await;
        self.handle.graceful_shutdown(Some(grace));
        match tokio::time::timeout(grace + Duration::from_secs(1), self.server).await {
            Ok(Ok(Ok(()))) => {}
            Ok(ended) => tracing::warn!(?ended, "the server ended with an error"),
            Err(_) => tracing::warn!("open requests did not end in time"),
        }
        // A database that does not answer would block the shutdown.
        if tokio::time::timeout(grace, self.service.store().close()).await.is_err() {
            tracing::warn!("the database did not close its connections in time");
        }
        tracing::info!("stopped");
    }

    /// Serves until `stop` completes, the data directory is gone or a computation ignores its stop, then shuts down.
    ///
    /// Other running jobs return to the queue; the next start, or another worker, continues them.
    ///
    /// # Errors
    /// [`StoreError::DirectoryGone`], or [`StuckComputation`].
    pub async fn until(self, stop: impl Future<Output = ()>) -> Result<(), ServiceEnd> {
        let service = Arc::clone(&self.service);
        let store = self.service.store().clone();
        let gone = async {
            loop {
                tokio::time::sleep(LOOK_FOR_DIRECTORY_EVERY).await;
                if let Err(gone) = store.check_directory() {
                    return gone;
                }
            }
        };
        tokio::select! {
            () = stop => {
                self.shut_down().await;
                Ok(())
            }
            gone = gone => {
                tracing::error!(%gone, "the service ends, because what it writes is lost");
                // Results of running jobs and requests would be lost too, so none is waited for.
                Self { drain: Duration::ZERO, ..self }.ended(LOOK_FOR_DIRECTORY_EVERY).await;
                Err(gone.into())
            }
            stuck = service.until_stuck() => {
                tracing::error!(%stuck, "the service ends, so that its supervisor starts a new process");
                Self { drain: Duration::ZERO, ..self }.ended(HANDS_BACK).await;
                Err(stuck.into())
            }
        }
    }
}
