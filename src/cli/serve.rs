use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::CommandResult;
use super::stop_signal::stop_signal;
use prosopon_service::config::{ServeConfig, Value};
use prosopon_service::{serve, telemetry};

/// Options of `prosopon serve` and `prosopon worker`. Every setting can also stand in the configuration, or in the environment as `PROSOPON_` and its name.
#[derive(Debug, Args)]
pub(super) struct ServeArguments {
    /// Configuration, TOML; `prosopon config check` tells all settings and faults.
    #[arg(long, env = "PROSOPON_CONFIG")]
    config: Option<PathBuf>,
    /// Address [default: 127.0.0.1:8080]; port 0 picks a free one, printed and written to DATA/listen.
    #[arg(long)]
    listen: Option<String>,
    /// Directory of sessions and results; made when it is not there.
    #[arg(long)]
    data: Option<PathBuf>,
    /// Postgres database for rows instead of DATA: postgres://user:password@host:5432/name. Rather in the environment, where others do
    /// not see the password: PROSOPON_DATABASE.
    #[arg(long)]
    database: Option<String>,
    /// Bucket of an S3-compatible store for large results instead of DATA: s3://bucket or s3://bucket/prefix; endpoint, region and
    /// credentials from the environment (AWS_ENDPOINT_URL, AWS_REGION, AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY).
    #[arg(long)]
    blobs: Option<String>,
    /// Compute no jobs: other processes on the same database do.
    #[arg(long)]
    no_worker: bool,
    /// Threads for numerics [default: 0, one a core].
    #[arg(long)]
    threads: Option<usize>,
    /// Host name besides loopback that requests may be for; may be given more than once.
    #[arg(long = "allow-host", value_delimiter = ',')]
    allowed_hosts: Vec<String>,
    /// Longest surface upload, MB [default: 512].
    #[arg(long)]
    max_surface_mb: Option<u64>,
    /// Longest CT upload, MB [default: 2048].
    #[arg(long)]
    max_ct_mb: Option<u64>,
    /// Jobs that may wait [default: 64].
    #[arg(long)]
    max_waiting: Option<u32>,
}

impl ServeArguments {
    /// File, environment and flags together, and how that is printed.
    pub(super) fn read(&self) -> Result<(ServeConfig, String), prosopon_service::config::ConfigError> {
        let mut flags: BTreeMap<&'static str, Value> = BTreeMap::new();
        let mut set = |path, value: Option<Value>| flags.extend(value.map(|value| (path, value)));
        set("listen", self.listen.clone().map(Value::from));
        set("data", self.data.as_ref().map(|d| Value::from(d.to_string_lossy().into_owned())));
        set("database", self.database.clone().map(Value::from));
        set("blobs", self.blobs.clone().map(Value::from));
        set("worker", self.no_worker.then(|| Value::from(false)));
        set("threads", self.threads.map(Value::from));
        set("allow_host", (!self.allowed_hosts.is_empty()).then(|| Value::from(self.allowed_hosts.clone())));
        set("max_surface_mb", self.max_surface_mb.map(Value::from));
        set("max_ct_mb", self.max_ct_mb.map(Value::from));
        set("max_waiting", self.max_waiting.map(Value::from));
        ServeConfig::read(self.config.as_deref(), &flags)
    }
}

/// Serves until SIGTERM or ctrl-c.
pub(super) fn run(arguments: &ServeArguments) -> CommandResult {
    let (config, printed) = arguments.read()?;
    run_with(config, printed)
}

/// Computes until SIGTERM or ctrl-c.
pub(super) fn work(arguments: &ServeArguments) -> CommandResult {
    let (config, printed) = arguments.read()?;
    let config = ServeConfig { api: false, ..config };
    config.check()?;
    run_with(config, printed)
}

fn run_with(config: ServeConfig, printed: String) -> CommandResult {
    // Dropped last, so that what ends with the service is sent too.
    let _traces = telemetry::start(&config)?;
    tracing::info!(configuration = printed, "configured");
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
        // Before the start, so that a signal during it is not lost.
        let signal = stop_signal()?;
        let running = serve::start(config).await?;
        writeln!(std::io::stdout(), "listening on {}", running.url())?;
        running.until(signal).await;
        Ok(())
    })
}
