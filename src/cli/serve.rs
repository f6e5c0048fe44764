use std::io::Write;
use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;

use super::CommandResult;
use crate::config::{ServeConfig, parse_listen};
use crate::http::HttpLimits;
use crate::jobs::ServiceSettings;
use crate::{serve, telemetry};

/// Options of `prosopon serve`.
#[derive(Debug, Args)]
pub(super) struct ServeArguments {
    /// Loopback address; port 0 picks a free one, printed and written to DATA/listen.
    #[arg(long, env = "PROSOPON_LISTEN", default_value = "127.0.0.1:8080", value_parser = parse_listen)]
    listen: SocketAddr,
    /// Directory of sessions and results; made when it is not there.
    #[arg(long, env = "PROSOPON_DATA")]
    data: PathBuf,
    /// Threads for numerics; 0 is one a core.
    #[arg(long, env = "PROSOPON_THREADS", default_value_t = 0)]
    threads: usize,
    /// Host name besides loopback that requests may be for; may be given more than once.
    #[arg(long = "allow-host", env = "PROSOPON_ALLOW_HOST", value_delimiter = ',')]
    allowed_hosts: Vec<String>,
    /// Longest surface upload, MB.
    #[arg(long, env = "PROSOPON_MAX_SURFACE_MB", default_value_t = 512)]
    max_surface_mb: u64,
    /// Longest CT upload, MB.
    #[arg(long, env = "PROSOPON_MAX_CT_MB", default_value_t = 2048)]
    max_ct_mb: u64,
    /// Jobs that may wait.
    #[arg(long, env = "PROSOPON_MAX_WAITING", default_value_t = 64)]
    max_waiting: u32,
}

impl From<ServeArguments> for ServeConfig {
    fn from(a: ServeArguments) -> Self {
        Self {
            listen: a.listen,
            data: a.data,
            threads: a.threads,
            allowed_hosts: a.allowed_hosts,
            limits: HttpLimits {
                max_surface_bytes: a.max_surface_mb.saturating_mul(1 << 20),
                max_ct_bytes: a.max_ct_mb.saturating_mul(1 << 20),
                ..HttpLimits::default()
            },
            service: ServiceSettings { max_waiting: a.max_waiting, ..ServiceSettings::default() },
        }
    }
}

/// Serves until SIGTERM or ctrl-c.
pub(super) fn run(arguments: ServeArguments) -> CommandResult {
    telemetry::start_log("info,sqlx=warn");
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
        // Before the start, so that a signal during it is not lost.
        let signal = stop_signal()?;
        let running = serve::start(arguments.into()).await?;
        writeln!(std::io::stdout(), "listening on {}", running.url())?;
        running.until(signal).await;
        Ok(())
    })
}

#[cfg(unix)]
fn stop_signal() -> std::io::Result<impl Future<Output = ()>> {
    use tokio::signal::unix::{SignalKind, signal};
    let (mut terminate, mut interrupt) = (signal(SignalKind::terminate())?, signal(SignalKind::interrupt())?);
    Ok(async move {
        tokio::select! {
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
        tracing::info!("asked to stop");
    })
}

#[cfg(not(unix))]
fn stop_signal() -> std::io::Result<impl Future<Output = ()>> {
    Ok(async {
        tokio::signal::ctrl_c().await.ok();
        tracing::info!("asked to stop");
    })
}
