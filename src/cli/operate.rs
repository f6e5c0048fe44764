//! Commands for operators: configuration, keys, audit, migration, backup.

use std::io::Write;
use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::CommandResult;
use super::serve::ServeArguments;
use prosopon_service::config::encryption_keys;
use prosopon_service::http::auth::{ApiKey, Scope, Scopes, new_key};
use prosopon_store::{
    AuditEntry, AuditReport, BackupReport, DatabaseUrl, Keyring, SetBack, back_up, restore, scrub, verify_audit,
};

/// Subcommands of `prosopon config`.
#[derive(Debug, Subcommand)]
pub(super) enum ConfigCommand {
    /// Read file, environment and flags as `serve` does; print every setting without secrets, or every fault.
    Check(ServeArguments),
}

/// Subcommands of `prosopon auth`.
#[derive(Debug, Subcommand)]
pub(super) enum AuthCommand {
    /// Create an API key: print its token, which is shown only once, and its entry for the configuration.
    Key(KeyArguments),
}

#[derive(Debug, Args)]
pub(super) struct KeyArguments {
    /// Name of the key, as the audit log shows it.
    #[arg(long)]
    id: String,
    /// Tenant whose data the key opens.
    #[arg(long, default_value = "local")]
    tenant: String,
    /// Scopes of the key: read, write, admin.
    #[arg(long, value_delimiter = ',', default_value = "read,write")]
    scopes: Vec<String>,
}

/// Subcommands of `prosopon audit`.
#[derive(Debug, Subcommand)]
pub(super) enum AuditCommand {
    /// Verify that no entry of the audit log was changed, removed, or cut off before the end recorded in the store.
    Verify(VerifyArguments),
}

#[derive(Debug, Args)]
pub(super) struct VerifyArguments {
    /// Data directory with the log.
    #[arg(long, env = "PROSOPON_DATA")]
    data: PathBuf,
    /// Address of the service's database, if its rows are in Postgres.
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

/// Options of `prosopon backup`, which is for the embedded store; Postgres and buckets have their own tools.
#[derive(Debug, Args)]
pub(super) struct BackupArguments {
    /// Data directory of the service, which may be running.
    #[arg(long, env = "PROSOPON_DATA")]
    data: PathBuf,
    /// New directory for the backup.
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    keys: KeySource,
}

/// Where the keys of encrypted values are.
#[derive(Debug, Args)]
struct KeySource {
    /// Configuration file of the service, for `[encryption]`; PROSOPON_ENCRYPTION__KEY_FILE and …__KEYS are read too.
    #[arg(long, env = "PROSOPON_CONFIG")]
    config: Option<PathBuf>,
}

/// Subcommands of `prosopon encryption`.
#[derive(Debug, Subcommand)]
pub(super) enum EncryptionCommand {
    /// Make a key for blobs and backups: two lines for a key file. Whoever loses it loses the data.
    Key,
}

/// Options of `prosopon scrub`, which is for the embedded store; the service itself checks values in a bucket.
#[derive(Debug, Args)]
pub(super) struct ScrubArguments {
    /// Data directory of the service, which may be running.
    #[arg(long, env = "PROSOPON_DATA")]
    data: PathBuf,
    #[command(flatten)]
    keys: KeySource,
}

/// Options of `prosopon restore`.
#[derive(Debug, Args)]
pub(super) struct RestoreArguments {
    /// Directory of the backup.
    #[arg(long)]
    from: PathBuf,
    /// Data directory to restore into; it must not contain a store.
    #[arg(long, env = "PROSOPON_DATA")]
    data: PathBuf,
    #[command(flatten)]
    keys: KeySource,
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
    // The same checks as in `serve`.
    let tenant_id = tenant.parse().map_err(|e| format!("tenant `{tenant}`: {e}"))?;
    let parsed: Result<Scopes, String> = scopes.iter().map(|s| s.parse::<Scope>()).collect();
    let scopes_of_key = parsed.map_err(|e| format!("scope {e}"))?;
    let made = ApiKey { id: id.clone(), tenant: tenant_id, scopes: scopes_of_key, hash: key.hash.clone() };
    match made.faults() {
        faults if faults.is_empty() => {}
        faults => return Err(faults.join("\n").into()),
    }
    let out = &mut std::io::stdout();
    writeln!(out, "# The token, which is not shown again:\n# {}\n[[auth.keys]]", key.token)?;
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
            "{} times, a start of the service found that entries were removed: look for `{}` in the log",
            report.gaps,
            AuditEntry::GAP
        );
        return Err(detail.into());
    }
    match &report.anchored_at {
        Some(at) => {
            writeln!(out, "the end that the store recorded at {at} is present; {} entries are later", report.later)?
        }
        None => writeln!(out, "the store has recorded no end: entries missing at the end cannot be found")?,
    }
    note_clock(&report, out)?;
    Ok(())
}

/// Reports where the clock was set back; that is no tampering.
fn note_clock(report: &AuditReport, out: &mut impl Write) -> std::io::Result<()> {
    const SHOWN: usize = 5;
    for SetBack { file, line, from, to } in report.set_back.iter().take(SHOWN) {
        writeln!(out, "note: the clock was set back from {from} to {to} before {file}, line {line}")?;
    }
    if let Some(more) = report.set_back.len().checked_sub(SHOWN).filter(|more| *more > 0) {
        writeln!(out, "note: the clock was set back {more} more times")?;
    }
    if report.branches > 0 {
        let n = report.branches;
        writeln!(
            out,
            "note: {n} starts of an earlier version left the last entry out of the chain, because the clock was set back; entries \
             removed directly before them cannot be found"
        )?;
    }
    Ok(())
}

pub(super) fn migrate(arguments: &MigrateArguments) -> CommandResult {
    let database = address(&arguments.database)?;
    let (found, known) = runtime()?.block_on(database.migrate())?;
    let done = if found == known { "nothing to do" } else { "upgraded" };
    writeln!(std::io::stdout(), "{database}: found format {found}, this version has format {known}: {done}")?;
    Ok(())
}

/// Parses the address of a database; clap would print a faulty address together with its password.
fn address(text: &str) -> Result<DatabaseUrl, String> {
    text.parse().map_err(|fault| format!("database: {fault}"))
}

pub(super) fn backup(arguments: &BackupArguments) -> CommandResult {
    let keys = encryption_keys(arguments.keys.config.as_deref())?;
    report_backup(runtime()?.block_on(back_up(&arguments.data, &arguments.out, &keys))?, !keys.is_empty())
}

pub(super) fn restore_from(arguments: &RestoreArguments) -> CommandResult {
    let keys = encryption_keys(arguments.keys.config.as_deref())?;
    report_backup(runtime()?.block_on(restore(&arguments.from, &arguments.data, &keys))?, !keys.is_empty())
}

pub(super) fn encryption(command: &EncryptionCommand) -> CommandResult {
    let EncryptionCommand::Key = command;
    let (key, id) = Keyring::new_key()?;
    writeln!(std::io::stdout(), "# {id}\n{key}")?;
    Ok(())
}

fn runtime() -> std::io::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_current_thread().enable_all().build()
}

fn report_backup(report: BackupReport, encrypted: bool) -> CommandResult {
    writeln!(std::io::stdout(), "{} files, {} bytes", report.files, report.bytes)?;
    if encrypted && report.plain > 0 {
        let plain = report.plain;
        writeln!(std::io::stdout(), "{plain} values are not encrypted: the service has not stored them again yet")?;
    }
    whole(&report.damaged, &[])
}

pub(super) fn scrub_store(arguments: &ScrubArguments) -> CommandResult {
    let keys = encryption_keys(arguments.keys.config.as_deref())?;
    let found = runtime()?.block_on(scrub(&arguments.data, &keys))?;
    writeln!(std::io::stdout(), "{} values, {} bytes", found.values, found.bytes)?;
    if found.unsealed > 0 {
        writeln!(std::io::stdout(), "{} of them have no seal: an earlier version wrote them", found.unsealed)?;
    }
    for (id, values) in &found.encrypted {
        writeln!(std::io::stdout(), "{values} of them are encrypted with the key {id}")?;
    }
    whole(&found.damaged, &found.missing)
}

/// An error that names the damaged and missing values; `Ok` when there are none.
fn whole(damaged: &[String], missing: &[String]) -> CommandResult {
    let lines = damaged.iter().map(|key| format!("damaged: {key}"));
    let lines: Vec<String> = lines.chain(missing.iter().map(|key| format!("missing: {key}"))).collect();
    if lines.is_empty() {
        return Ok(());
    }
    let begin = format!("{} values are damaged or missing (session/value); all others are intact", lines.len());
    Err(format!("{begin}\n{}", lines.join("\n")).into())
}
