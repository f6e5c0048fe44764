//! What an operator does beside serving.

use std::io::Write;
use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::CommandResult;
use super::serve::ServeArguments;
use prosopon_service::http::auth::{ApiKey, Scope, Scopes, new_key};
use prosopon_store::{AuditEntry, BackupReport, DatabaseUrl, back_up, restore, scrub, verify_audit};

/// Calls of `prosopon config`.
#[derive(Debug, Subcommand)]
pub(super) enum ConfigCommand {
    /// Read file, environment and flags as `serve` does: print every setting without secrets, or every fault.
    Check(ServeArguments),
}

/// Calls of `prosopon auth`.
#[derive(Debug, Subcommand)]
pub(super) enum AuthCommand {
    /// Make an API key: prints the token, once, and what the configuration needs.
    Key(KeyArguments),
}

#[derive(Debug, Args)]
pub(super) struct KeyArguments {
    /// Name of the key, as the audit log shows it.
    #[arg(long)]
    id: String,
    /// Whose data it opens.
    #[arg(long, default_value = "local")]
    tenant: String,
    /// What it allows: read, write, admin.
    #[arg(long, value_delimiter = ',', default_value = "read,write")]
    scopes: Vec<String>,
}

/// Calls of `prosopon audit`.
#[derive(Debug, Subcommand)]
pub(super) enum AuditCommand {
    /// Follow the chain of the audit log to the end that the store notes: was an entry changed, removed or cut off?
    Verify(VerifyArguments),
}

#[derive(Debug, Args)]
pub(super) struct VerifyArguments {
    /// Directory with the log.
    #[arg(long, env = "PROSOPON_DATA")]
    data: PathBuf,
    /// The database of the service, where its rows are in one.
    #[arg(long, env = "PROSOPON_DATABASE", hide_env_values = true)]
    database: Option<String>,
}

/// Options of `prosopon migrate`.
#[derive(Debug, Args)]
pub(super) struct MigrateArguments {
    /// Address of the database, postgres://user:password@host:5432/name.
    #[arg(long, env = "PROSOPON_DATABASE", hide_env_values = true)]
    database: String,
}

/// Options of `prosopon backup`: of the embedded store. Postgres and buckets have tools of their own.
#[derive(Debug, Args)]
pub(super) struct BackupArguments {
    /// Directory of sessions and results; the service may be running.
    #[arg(long, env = "PROSOPON_DATA")]
    data: PathBuf,
    /// New directory for the backup.
    #[arg(long)]
    out: PathBuf,
}

/// Options of `prosopon scrub`: of the embedded store. For values elsewhere the service does it by itself.
#[derive(Debug, Args)]
pub(super) struct ScrubArguments {
    /// Directory of sessions and results; the service may be running.
    #[arg(long, env = "PROSOPON_DATA")]
    data: PathBuf,
}

/// Options of `prosopon restore`.
#[derive(Debug, Args)]
pub(super) struct RestoreArguments {
    /// A backup.
    #[arg(long)]
    from: PathBuf,
    /// Directory without a store.
    #[arg(long, env = "PROSOPON_DATA")]
    data: PathBuf,
}

pub(super) fn config(command: &ConfigCommand) -> CommandResult {
    let ConfigCommand::Check(arguments) = command;
    let (_, printed) = arguments.read()?;
    std::io::stdout().write_all(printed.as_bytes())?;
    Ok(())
}

pub(super) fn auth(command: &AuthCommand) -> CommandResult {
    let AuthCommand::Key(KeyArguments { id, tenant, scopes }) = command;
    let key = new_key(id).map_err(|e| e.to_string())?;
    // Only what `serve` takes.
    let tenant_id = tenant.parse().map_err(|e| format!("tenant `{tenant}`: {e}"))?;
    let parsed: Result<Scopes, String> = scopes.iter().map(|s| s.parse::<Scope>()).collect();
    let scopes_of_key = parsed.map_err(|e| format!("scope {e}"))?;
    let made = ApiKey { id: id.clone(), tenant: tenant_id, scopes: scopes_of_key, hash: key.hash.clone() };
    match made.faults() {
        faults if faults.is_empty() => {}
        faults => return Err(faults.join("\n").into()),
    }
    let out = &mut std::io::stdout();
    writeln!(out, "# The token, shown this once:\n# {}\n[[auth.keys]]", key.token)?;
    writeln!(out, "id = {id:?}\ntenant = {tenant:?}\nscopes = {scopes:?}\nhash = {:?}", key.hash)?;
    Ok(())
}

pub(super) fn audit(command: &AuditCommand) -> CommandResult {
    let AuditCommand::Verify(VerifyArguments { data, database }) = command;
    let database = database.as_deref().map(address).transpose()?;
    let report = runtime()?.block_on(verify_audit(data, database.as_ref()))?;
    let out = &mut std::io::stdout();
    writeln!(out, "{} entries, none changed or removed", report.entries)?;
    if report.gaps > 0 {
        let detail = format!(
            "a start of the service found entries removed, {} times: look for `{}`",
            report.gaps,
            AuditEntry::GAP
        );
        return Err(detail.into());
    }
    match report.anchored_at {
        Some(at) => {
            writeln!(out, "the end as noted in the store at {at} is there; {} entries are later", report.later)?
        }
        None => writeln!(out, "the store notes no end: entries missing at the end would not show")?,
    }
    Ok(())
}

pub(super) fn migrate(arguments: &MigrateArguments) -> CommandResult {
    let database = address(&arguments.database)?;
    let (found, known) = runtime()?.block_on(database.migrate())?;
    let done = if found == known { "nothing to do" } else { "done" };
    writeln!(std::io::stdout(), "{database}: had format {found}, this version's is {known}: {done}")?;
    Ok(())
}

/// Read here and not by clap, which would quote a faulty address with its password.
fn address(text: &str) -> Result<DatabaseUrl, String> {
    text.parse().map_err(|fault| format!("database: {fault}"))
}

pub(super) fn backup(arguments: &BackupArguments) -> CommandResult {
    told(runtime()?.block_on(back_up(&arguments.data, &arguments.out))?)
}

pub(super) fn restore_from(arguments: &RestoreArguments) -> CommandResult {
    told(runtime()?.block_on(restore(&arguments.from, &arguments.data))?)
}

fn runtime() -> std::io::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_current_thread().enable_all().build()
}

fn told(report: BackupReport) -> CommandResult {
    writeln!(std::io::stdout(), "{} files, {} bytes", report.files, report.bytes)?;
    whole(&report.damaged, &[])
}

pub(super) fn scrub_store(arguments: &ScrubArguments) -> CommandResult {
    let found = runtime()?.block_on(scrub(&arguments.data))?;
    writeln!(std::io::stdout(), "{} values, {} bytes", found.values, found.bytes)?;
    if found.unsealed > 0 {
        writeln!(std::io::stdout(), "{} of them have no seal: an earlier version wrote them", found.unsealed)?;
    }
    whole(&found.damaged, &found.missing)
}

/// An error that names values which are not what was stored.
fn whole(damaged: &[String], missing: &[String]) -> CommandResult {
    let lines = damaged.iter().map(|key| format!("damaged: {key}"));
    let lines: Vec<String> = lines.chain(missing.iter().map(|key| format!("missing: {key}"))).collect();
    if lines.is_empty() {
        return Ok(());
    }
    let begin = format!("{} values are not what was stored (session/value; all others are)", lines.len());
    Err(format!("{begin}\n{}", lines.join("\n")).into())
}
