use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::CommandResult;
use super::stop_signal::stop_signal;
use prosopon_service::config::{ServeConfig, Value};
use prosopon_service::{serve, telemetry};

/// Options of `prosopon serve` and `prosopon worker`.
///
/// Every setting can also be in the configuration file, or in the environment as `PROSOPON_` and its name.
#[derive(Debug, Args)]
pub(super) struct ServeArguments {
    /// Configuration file, TOML; `prosopon config check` prints all settings and faults.
    #[arg(long, env = "PROSOPON_CONFIG")]
    config: Option<PathBuf>,
    /// Address to listen on [default: 127.0.0.1:8080]; port 0 picks a free port, printed and written to DATA/listen.
    #[arg(long)]
    listen: Option<String>,
    /// Directory for sessions and results; created when missing.
    #[arg(long)]
    data: Option<PathBuf>,
    /// Postgres database for rows instead of DATA: postgres://user:password@host:5432/name. Prefer the environment variable
    /// PROSOPON_DATABASE, which hides the password from other users.
    #[arg(long)]
    database: Option<String>,
    /// Bucket of an S3-compatible store for large results instead of DATA: s3://bucket or s3://bucket/prefix. Endpoint,
    /// region and credentials come from the environment (AWS_ENDPOINT_URL, AWS_REGION, AWS_ACCESS_KEY_ID,
    /// AWS_SECRET_ACCESS_KEY).
    #[arg(long)]
    blobs: Option<String>,
    /// Serve only the API; other processes on the same database compute the jobs.
    #[arg(long)]
    no_worker: bool,
    /// Threads for numerics [default: 0, one per core].
    #[arg(long)]
    threads: Option<usize>,
    /// Host name, besides loopback, that requests may use; may be given more than once.
    #[arg(long = "allow-host", value_delimiter = ',')]
    allowed_hosts: Vec<String>,
    /// Largest surface upload, MB [default: 512].
    #[arg(long)]
    max_surface_mb: Option<u64>,
    /// Largest CT upload, MB [default: 2048].
    #[arg(long)]
    max_ct_mb: Option<u64>,
    /// Largest number of waiting jobs [default: 64].
    #[arg(long)]
    max_waiting: Option<u32>,
}

impl ServeArguments {
    /// Reads file, environment and flags; returns the configuration and its printed form without secrets.
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

/// Computes jobs until SIGTERM or ctrl-c.
pub(super) fn work(arguments: &ServeArguments) -> CommandResult {
    let (config, printed) = arguments.read()?;
    let config = ServeConfig { api: false, ..config };
    config.check()?;
    run_with(config, printed)
}

fn run_with(config: ServeConfig, printed: String) -> CommandResult {
    // Dropped last, so that spans that end with the service are sent too.
    let _traces = telemetry::start(&config)?;
    tracing::info!(configuration = printed, "configured");
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
        // Installed before the start, so that a signal during the start is not lost.
        let signal = stop_signal()?;
        let running = serve::start(config).await?;
        writeln!(std::io::stdout(), "listening on {}", running.url())?;
        Ok(running.until(signal).await?)
    })
}
