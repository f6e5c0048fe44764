mod walk;

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use futures::future::BoxFuture;
use serde::{Deserialize, Serialize};

use super::MetaStore;
use super::directory::{LOCAL_LOG, create_private, log_name};
use super::location::DatabaseUrl;
use super::postgres::PostgresMeta;
use super::records::{later, now_rfc3339};
use super::sqlite::{DATABASE, SqliteMeta};
use walk::{CUT_OFF, Line, Walk, chained};

/// Steps of the clock below this are no reason for a note: a time server makes them too.
const SMALL_STEP: Duration = Duration::from_secs(2);

/// One entry of the audit log: who did what to which session or job, with what outcome; no contents.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AuditEntry {
    /// When, RFC 3339; filled in by [`Audit::record`].
    pub at: String,
    /// Tenant whose data the request concerned.
    pub tenant: String,
    /// Name of the API key or subject of the token; `local` without authentication.
    ///
    /// The service's own entries have `service`, `retention` (unused session) or `deleted before` (end of the time to restore).
    pub who: String,
    /// Method and route, for example `DELETE /v1/sessions/{session}`.
    pub what: String,
    /// Id in the path, or id of what the request created.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// HTTP status.
    pub status: u16,
    /// Id of the request, which the service's log also has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub request_id: Option<String>,
}

impl AuditEntry {
    /// `what` of an entry about a blob that does not match its seal.
    pub const DAMAGED: &str = "a stored value is damaged";
    /// `what` of an entry about a blob that a row names and that does not exist.
    pub const MISSING: &str = "a stored value is missing";
    /// `what` of an entry by which a start of the service reports that earlier entries were removed.
    pub const GAP: &str = "entries before this one were removed";
}

/// Why an audit log cannot be verified.
#[derive(Debug, thiserror::Error)]
pub enum AuditFault {
    /// A line is not an entry, was changed or moved, or follows a removed line.
    #[error("{file}, line {line}: this line or one before it was changed, moved or removed")]
    Broken {
        /// Path of the file.
        file: String,
        /// Number of the line, from 1.
        line: usize,
    },
    /// The log ends before the anchor that the store holds.
    #[error(
        "entries after number {entries} were removed: the end of the log that the store recorded at {at} is missing"
    )]
    CutOff {
        /// Number of entries found.
        entries: usize,
        /// When the store recorded the end, RFC 3339.
        at: String,
    },
    /// The directory has no audit log.
    #[error("there is no audit log in {directory}")]
    Missing {
        /// The directory that was searched.
        directory: String,
    },
    /// The store that holds the anchor cannot be read.
    #[error("the store that holds the recorded end of the audit log cannot be read")]
    Store(#[from] super::StoreError),
    /// A file of the log cannot be read.
    #[error("the audit log cannot be read")]
    Io(#[from] io::Error),
}

/// Result of a successful verification: nothing was changed or removed up to the recorded end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AuditReport {
    /// Number of entries.
    pub entries: usize,
    /// When the store last recorded the end of the log, RFC 3339.
    pub anchored_at: Option<String>,
    /// Number of entries after the recorded end; removals among them cannot be found.
    pub later: usize,
    /// Number of [`AuditEntry::GAP`] entries: starts of the service that found the end of the log removed.
    pub gaps: usize,
    /// Entries before which the clock was set back, in the order of the log.
    pub set_back: Vec<SetBack>,
    /// Number of starts of an earlier version that did not continue the last entry, because the clock was set back.
    ///
    /// The entries before such a start have no recorded end: removals directly before it cannot be found.
    pub branches: usize,
}

/// An entry whose time is before that of the entry before it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SetBack {
    /// Path of its file.
    pub file: String,
    /// Number of its line, from 1.
    pub line: usize,
    /// Time of the entry before, RFC 3339.
    pub from: String,
    /// Time of the entry, RFC 3339.
    pub to: String,
}

/// Verifies the audit log of a data directory up to the end that the store recorded.
///
/// The store is the directory's own database, or `database` when given.
///
/// A success proves that no entry up to the recorded end was changed or removed unless the store was changed too. It cannot
/// show that entries after that end (a few seconds at most) were removed, and it does not protect against someone who can write
/// both the log and the store. For that, ship the log to another machine.
///
/// The entries are followed by their chain, whatever the files are called and whatever the clock showed.
///
/// # Errors
/// [`AuditFault`].
pub fn verify_audit<'a>(
    data: &'a Path,
    database: Option<&'a DatabaseUrl>,
) -> BoxFuture<'a, Result<AuditReport, AuditFault>> {
    Box::pin(follow_to_the_anchor(data, database))
}

async fn follow_to_the_anchor(data: &Path, database: Option<&DatabaseUrl>) -> Result<AuditReport, AuditFault> {
    let (meta, log): (Option<Box<dyn MetaStore>>, _) = match database {
        Some(url) => (Some(Box::new(PostgresMeta::open_beside(url.options()).await?)), log_name(data)?),
        None if data.join(DATABASE).is_file() => {
            (Some(Box::new(SqliteMeta::open_beside(data).await?)), Some(LOCAL_LOG.to_owned()))
        }
        None => (None, None),
    };
    let mut anchor = None;
    if let Some(meta) = meta {
        let noted = match &log {
            Some(log) => meta.audit_anchor(log).await,
            None => Ok(None),
        };
        meta.close().await;
        anchor = noted?;
    }
    if anchor.is_none() && !data.join("audit").is_dir() {
        return Err(AuditFault::Missing { directory: data.display().to_string() });
    }
    Audit::verify(data, anchor)
}

/// Append-only log, one file a month: `audit/2026-11.jsonl`.
///
/// When the clock is set back, the file of the latest month goes on, so that the names of the files keep the order of the entries.
#[derive(Debug)]
pub struct Audit {
    directory: Option<PathBuf>,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    /// Latest month that has a file.
    month: String,
    file: Option<File>,
    chain: String,
    /// Entries that could not be written since the last one that was.
    lost: u64,
}

impl State {
    /// Opens the file of `month`, or of the latest month if that is later; a line that a full disk cut off is marked as such.
    fn open(&mut self, directory: &Path, month: &str) -> io::Result<()> {
        if self.file.is_some() && month <= self.month.as_str() {
            return Ok(());
        }
        let month = self.month.as_str().max(month).to_owned();
        let path = directory.join(format!("{month}.jsonl"));
        let mut file = OpenOptions::new().create(true).read(true).append(true).open(path)?;
        close_off(&mut file)?;
        self.file = Some(file);
        self.month = month;
        Ok(())
    }

    fn append(&mut self, entry: AuditEntry, sync: bool) -> io::Result<()> {
        let Some(file) = &mut self.file else { return Ok(()) };
        let chain = chained(&self.chain, &entry)?;
        let mut line = serde_json::to_string(&Line { entry, chain: chain.clone() })?;
        line.push('\n');
        // One write, so that a crash can cut off only the last line.
        file.write_all(line.as_bytes())?;
        self.chain = chain;
        if sync { file.sync_data() } else { Ok(()) }
    }
}

impl Audit {
    /// Opens the log in a data directory and continues its chain.
    ///
    /// A line that a crash cut off is marked as such.
    ///
    /// # Errors
    /// The file system's.
    pub fn open(data: &Path) -> io::Result<Self> {
        let directory = data.join("audit");
        create_private(&directory)?;
        let files = files(&directory)?;
        let state = State {
            month: files.iter().rev().find_map(|path| month_of(path)).unwrap_or_default(),
            chain: walk::end(&files)?,
            ..State::default()
        };
        if let Some(last) = files.last() {
            close_off(&mut OpenOptions::new().read(true).append(true).open(last)?)?;
        }
        Ok(Self { directory: Some(directory), state: Mutex::new(state) })
    }

    /// A log that discards every entry, for a store in memory.
    #[must_use]
    pub fn none() -> Self {
        Self { directory: None, state: Mutex::default() }
    }

    /// Appends an entry with the current time; with `sync`, waits until it is on disk.
    ///
    /// # Errors
    /// The file system's.
    pub fn record(&self, entry: AuditEntry, sync: bool) -> io::Result<()> {
        self.record_at(now_rfc3339, entry, sync)
    }

    /// Same as [`Audit::record`] with another clock.
    fn record_at(&self, now: impl FnOnce() -> String, entry: AuditEntry, sync: bool) -> io::Result<()> {
        let Some(directory) = &self.directory else { return Ok(()) };
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        // Read under the lock, so that the times of the entries ascend.
        let entry = AuditEntry { at: now(), ..entry };
        let recorded = record(&mut state, directory, entry, sync);
        if recorded.is_err() {
            // Opened again, so that the next entry does not continue half a line.
            state.file = None;
            state.lost += 1;
        }
        recorded
    }

    /// Syncs the log to disk and returns the chain at its end.
    ///
    /// `None` when the log is empty or discards its entries.
    ///
    /// # Errors
    /// The file system's.
    pub fn settle(&self) -> io::Result<Option<String>> {
        let (file, chain) = {
            let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
            (state.file.as_ref().map(File::try_clone).transpose()?, state.chain.clone())
        };
        // Outside the lock, so that requests do not wait for the disk.
        if let Some(file) = file {
            file.sync_data()?;
        }
        Ok(Some(chain).filter(|chain| !chain.is_empty()))
    }

    /// Whether an entry has this chain; used to check that the recorded end still exists.
    ///
    /// Always true for a log that discards its entries.
    ///
    /// # Errors
    /// The file system's.
    pub fn holds(&self, chain: &str) -> io::Result<bool> {
        let Some(directory) = &self.directory else { return Ok(true) };
        let end = format!("\"chain\":\"{chain}\"}}");
        for path in files(directory)?.iter().rev() {
            for line in BufReader::new(File::open(path)?).lines() {
                if line?.ends_with(&end) {
                    return Ok(true);
                }
            }
        }
        Ok(false)
    }

    /// Reads the whole log of a data directory and checks its chain.
    ///
    /// `anchor` is the recorded end: a chain that must occur, and when it was recorded (RFC 3339).
    ///
    /// # Errors
    /// [`AuditFault`].
    pub fn verify(data: &Path, anchor: Option<(String, String)>) -> Result<AuditReport, AuditFault> {
        let mut walk = Walk::open(&files(&data.join("audit"))?)?;
        let (mut entries, mut gaps, mut branches) = (0, 0, 0);
        let (mut anchored_after, mut time, mut set_back) = (None, String::new(), Vec::new());
        while let Some(reached) = walk.step()? {
            entries += 1;
            gaps += usize::from(reached.entry.what == AuditEntry::GAP);
            branches += usize::from(reached.is_branch);
            if anchor.as_ref().is_some_and(|(anchor, _)| *anchor == reached.chain) {
                anchored_after = Some(entries);
            }
            let ((file, line), to) = (reached.at, reached.entry.at);
            if later(&to, SMALL_STEP).is_some_and(|latest| latest < time) {
                set_back.push(SetBack { file, line, from: time, to: to.clone() });
            }
            time = to;
        }
        if let Some((file, line)) = walk.left() {
            return Err(AuditFault::Broken { file, line });
        }
        match (anchor, anchored_after) {
            (Some((_, at)), None) => Err(AuditFault::CutOff { entries, at }),
            (anchor, after) => Ok(AuditReport {
                entries,
                anchored_at: anchor.map(|(_, at)| at),
                later: entries - after.unwrap_or(0),
                gaps,
                set_back,
                branches,
            }),
        }
    }
}

/// Appends an entry, after one that says how many were lost before.
fn record(state: &mut State, directory: &Path, entry: AuditEntry, sync: bool) -> io::Result<()> {
    let month = entry.at.get(..7).unwrap_or("0000-00").to_owned();
    state.open(directory, &month)?;
    if state.lost > 0 {
        let what = format!("{} entries before this one could not be written", state.lost);
        state.append(AuditEntry { at: entry.at.clone(), what, ..AuditEntry::default() }, false)?;
        state.lost = 0;
    }
    state.append(entry, sync)
}

/// The month in the name of a file; `None` for a file that this log does not write.
fn month_of(path: &Path) -> Option<String> {
    let name = path.file_stem()?.to_str()?;
    let (year, month) = name.split_once('-')?;
    let are_digits = [year, month].iter().all(|part| part.bytes().all(|b| b.is_ascii_digit()));
    (are_digits && (year.len(), month.len()) == (4, 2)).then(|| name.to_owned())
}

/// The files of a log by name.
fn files(directory: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    match std::fs::read_dir(directory) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(found),
        Err(error) => return Err(error),
        Ok(entries) => {
            for entry in entries {
                let path = entry?.path();
                if path.extension().is_some_and(|e| e == "jsonl") {
                    found.push(path);
                }
            }
        }
    }
    found.sort();
    Ok(found)
}

fn close_off(file: &mut File) -> io::Result<()> {
    if file.seek(SeekFrom::End(0))? == 0 {
        return Ok(());
    }
    file.seek(SeekFrom::End(-1))?;
    let mut last = [0];
    file.read_exact(&mut last)?;
    if last == *b"\n" { Ok(()) } else { file.write_all(format!("{CUT_OFF}\n").as_bytes()) }
}

#[cfg(test)]
mod tests;
