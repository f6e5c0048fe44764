use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use futures::future::BoxFuture;
use serde::{Deserialize, Serialize};

use super::MetaStore;
use super::directory::{LOCAL_LOG, create_private, log_name};
use super::location::DatabaseUrl;
use super::postgres::PostgresMeta;
use super::records::{now_rfc3339, sha256_hex};
use super::sqlite::{DATABASE, SqliteMeta};

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

/// A line of the log.
///
/// `chain` is the SHA-256 of the previous chain and the entry, so changed or removed lines are found.
#[derive(Debug, Serialize, Deserialize)]
struct Line {
    entry: AuditEntry,
    chain: String,
}

/// Why an audit log cannot be verified.
#[derive(Debug, thiserror::Error)]
pub enum AuditFault {
    /// A line is not an entry, was changed, or follows a removed line.
    #[error("{file}, line {line}: this line was changed, or a line before it was removed")]
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
}

/// Verifies the audit log of a data directory up to the end that the store recorded.
///
/// The store is the directory's own database, or `database` when given.
///
/// A success proves that no entry up to the recorded end was changed or removed unless the store was changed too. It cannot
/// show that entries after that end (a few seconds at most) were removed, and it does not protect against someone who can write
/// both the log and the store. For that, ship the log to another machine.
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
#[derive(Debug)]
pub struct Audit {
    directory: Option<PathBuf>,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    month: String,
    file: Option<File>,
    chain: String,
    /// Entries that could not be written since the last one that was.
    lost: u64,
}

impl State {
    /// Opens the file of `month`; a line that a full disk cut off is marked as such.
    fn open(&mut self, directory: &Path, month: &str) -> io::Result<()> {
        if self.file.is_some() && self.month == month {
            return Ok(());
        }
        let path = directory.join(format!("{month}.jsonl"));
        let mut file = OpenOptions::new().create(true).read(true).append(true).open(path)?;
        close_off(&mut file)?;
        self.file = Some(file);
        month.clone_into(&mut self.month);
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
        let mut state = State::default();
        if let Some(last) = files(&directory)?.pop() {
            let mut file = OpenOptions::new().read(true).append(true).open(&last)?;
            close_off(&mut file)?;
            state.chain = last_chain(&last)?;
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
        let Some(directory) = &self.directory else { return Ok(()) };
        let entry = AuditEntry { at: now_rfc3339(), ..entry };
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
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
        let (mut chain, mut entries) = (String::new(), 0);
        let (mut anchored_after, mut gaps) = (None, 0);
        for path in files(&data.join("audit"))? {
            for (index, line) in BufReader::new(File::open(&path)?).lines().enumerate() {
                let line = line?;
                let broken = || AuditFault::Broken { file: path.display().to_string(), line: index + 1 };
                // A start marks a line that a crash cut off.
                if line.ends_with(CUT_OFF) {
                    continue;
                }
                let read: Line = serde_json::from_str(&line).map_err(|_| broken())?;
                if chained(&chain, &read.entry)? != read.chain {
                    return Err(broken());
                }
                chain = read.chain;
                entries += 1;
                gaps += usize::from(read.entry.what == AuditEntry::GAP);
                if anchor.as_ref().is_some_and(|(anchor, _)| *anchor == chain) {
                    anchored_after = Some(entries);
                }
            }
        }
        match (anchor, anchored_after) {
            (Some((_, at)), None) => Err(AuditFault::CutOff { entries, at }),
            (anchor, after) => Ok(AuditReport {
                entries,
                anchored_at: anchor.map(|(_, at)| at),
                later: entries - after.unwrap_or(0),
                gaps,
            }),
        }
    }
}

/// Marks the end of a line that a crash cut off.
const CUT_OFF: &str = "#cut-off";

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

fn chained(before: &str, entry: &AuditEntry) -> io::Result<String> {
    Ok(sha256_hex(format!("{before}\n{}", serde_json::to_string(entry)?).as_bytes()))
}

/// The files of a log, oldest month first.
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

/// The chain after the last whole line.
fn last_chain(path: &Path) -> io::Result<String> {
    let mut chain = String::new();
    for line in BufReader::new(File::open(path)?).lines() {
        if let Ok(line) = serde_json::from_str::<Line>(&line?) {
            chain = line.chain;
        }
    }
    Ok(chain)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(who: &str) -> AuditEntry {
        AuditEntry { who: who.to_owned(), what: "GET /v1/sessions".to_owned(), status: 200, ..AuditEntry::default() }
    }

    fn entries(data: &Path) -> usize {
        Audit::verify(data, None).unwrap().entries
    }

    fn only_file(data: &Path) -> PathBuf {
        files(&data.join("audit")).unwrap().pop().unwrap()
    }

    #[test]
    fn entries_are_chained_across_restarts_and_a_changed_or_removed_one_shows() {
        let data = tempfile::tempdir().unwrap();
        for who in ["a", "b"] {
            let audit = Audit::open(data.path()).unwrap();
            audit.record(entry(who), false).unwrap();
            audit.record(entry(who), true).unwrap();
        }
        assert_eq!(entries(data.path()), 4);
        let path = only_file(data.path());
        let whole = std::fs::read_to_string(&path).unwrap();
        assert!(whole.contains(r#""who":"a""#) && whole.lines().count() == 4);

        std::fs::write(&path, whole.replacen(r#""who":"b""#, r#""who":"x""#, 1)).unwrap();
        assert!(matches!(Audit::verify(data.path(), None), Err(AuditFault::Broken { line: 3, .. })));
        let without_second: Vec<&str> = whole.lines().enumerate().filter(|(i, _)| *i != 1).map(|(_, l)| l).collect();
        std::fs::write(&path, without_second.join("\n")).unwrap();
        assert!(matches!(Audit::verify(data.path(), None), Err(AuditFault::Broken { line: 2, .. })));
    }

    #[tokio::test]
    async fn a_tail_that_was_cut_off_shows_up_to_the_noted_end() {
        let data = tempfile::tempdir().unwrap();
        assert!(matches!(verify_audit(data.path(), None).await, Err(AuditFault::Missing { .. })));
        let store = super::super::Store::open(data.path()).await.unwrap();
        let audit = Audit::open(data.path()).unwrap();
        assert_eq!(audit.settle().unwrap(), None);
        for who in ["a", "b", "c"] {
            audit.record(entry(who), false).unwrap();
        }
        let end = audit.settle().unwrap().unwrap();
        store.set_audit_anchor(&end).await.unwrap();
        audit.record(entry("d"), false).unwrap();
        store.close().await;
        let report = verify_audit(data.path(), None).await.unwrap();
        assert_eq!((report.entries, report.later, report.anchored_at.is_some()), (4, 1, true));
        let path = only_file(data.path());
        let whole = std::fs::read_to_string(&path).unwrap();
        let first = |n: usize| whole.lines().take(n).map(|l| format!("{l}\n")).collect::<String>();
        std::fs::write(&path, first(3)).unwrap();
        assert_eq!(
            verify_audit(data.path(), None).await.unwrap().later,
            0,
            "removals after the recorded end are not found"
        );
        std::fs::write(&path, first(2)).unwrap();
        assert!(matches!(verify_audit(data.path(), None).await, Err(AuditFault::CutOff { entries: 2, .. })));
        std::fs::remove_dir_all(data.path().join("audit")).unwrap();
        assert!(matches!(verify_audit(data.path(), None).await, Err(AuditFault::CutOff { entries: 0, .. })));
    }

    /// A full disk leaves half a line; the log says so, and how many entries it lost.
    #[test]
    fn entries_that_a_full_disk_refused_are_counted() {
        let data = tempfile::tempdir().unwrap();
        let audit = Audit::open(data.path()).unwrap();
        audit.record(entry("a"), true).unwrap();
        let path = only_file(data.path());
        let whole = std::fs::metadata(&path).unwrap().len();
        OpenOptions::new().append(true).open(&path).unwrap().write_all(br#"{"entry":{"at":"20"#).unwrap();
        for _ in 0..2 {
            // Writes to a file that is open for reading fail.
            audit.state.lock().unwrap().file = Some(File::open(&path).unwrap());
            audit.record(entry("b"), false).unwrap_err();
        }
        audit.record(entry("c"), true).unwrap();
        audit.record(entry("d"), true).unwrap();
        // The first entry, the one on what was lost, and the last two.
        assert_eq!(entries(data.path()), 4);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text[whole as usize..].contains("2 entries before this one could not be written"), "{text}");
    }

    #[test]
    fn a_line_that_a_crash_cut_off_breaks_nothing() {
        let data = tempfile::tempdir().unwrap();
        Audit::open(data.path()).unwrap().record(entry("a"), false).unwrap();
        let path = only_file(data.path());
        let mut file = OpenOptions::new().append(true).open(&path).unwrap();
        file.write_all(br#"{"entry":{"at":"20"#).unwrap();
        drop(file);
        Audit::open(data.path()).unwrap().record(entry("b"), false).unwrap();
        assert_eq!(entries(data.path()), 2);
    }
}
