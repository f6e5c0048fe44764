use std::io::Write;

use super::CommandResult;
use crate::demo::{self, DemoArgs};
use prosopon_service::config::ServeConfig;
use prosopon_service::{serve, telemetry};
use prosopon_store::{Store, StoreLocation};

/// Starts a service on an empty store, runs the main job on it, and stops it unless `--keep` is given.
pub(super) fn run(arguments: &DemoArgs) -> CommandResult {
    telemetry::start_log("warn");
    demo::clear(&arguments.out)?;
    let data = arguments.out.join("service");
    Store::erase(&data)
        .map_err(|source| serve::ServeError::Store { place: StoreLocation::default().with_directory(&data), source })?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let running = runtime.block_on(serve::start(ServeConfig::new(data)))?;
    let url = running.url();
    writeln!(std::io::stdout(), "the service listens on {url}")?;
    let done = demo::run(arguments, url.clone());
    if arguments.keep && done.is_ok() {
        writeln!(std::io::stdout(), "the service keeps running on {url}; press ctrl-c to stop it")?;
        runtime.block_on(async { tokio::signal::ctrl_c().await })?;
    }
    runtime.block_on(running.shut_down());
    Ok(done?)
}
