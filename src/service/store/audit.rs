use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use futures::future::BoxFuture;
use serde::{Deserialize, Serialize};

use super::MetaStore;
use super::directory::{LOCAL_LOG, create_private, log_name};
use super::place::DatabaseUrl;
use super::postgres::PostgresMeta;
use super::records::{now_rfc3339, sha256_hex};
use super::sqlite::{DATABASE, SqliteMeta};

/// Who did what to which session or job, and with what outcome; never what it held.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AuditEntry {
    /// When, RFC 3339; filled in by [`Audit::record`].
    pub at: String,
    /// Whose data.
    pub tenant: String,
    /// Key or subject of the token; `local` without authentication, `retention` for the service itself.
    pub who: String,
    /// Method and route, `DELETE /v1/sessions/{session}`.
    pub what: String,
    /// Id in the path, or of what the request made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// HTTP status.
    pub status: u16,
    /// Finds the request in the log.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub request_id: Option<String>,
}

impl AuditEntry {
    /// What an entry is about that names a stored value which is not what was written.
    pub const DAMAGED: &str = "a stored value is damaged";
    /// The same of a value that is not there.
    pub const MISSING: &str = "a stored value is missing";
    /// What an entry is about by which a start tells that entries before it are missing.
    pub const GAP: &str = "entries before this one were removed";
}

/// A line as written: `chain` is the SHA-256 of the chain before and the entry, so that a line that was changed or removed shows.
#[derive(Debug, Serialize, Deserialize)]
struct Line {
    entry: AuditEntry,
    chain: String,
}

/// Why an audit log is not as it was written.
#[derive(Debug, thiserror::Error)]
pub enum AuditFault {
    /// A line that is no entry, was changed, or follows one that was removed.
    #[error("{file}, line {line}: was changed, or a line before it was removed")]
    Broken {
        /// Which file.
        file: String,
        /// Which line, from 1.
        line: usize,
    },
    /// The chain ends before the end that the store notes.
    #[error("the entries after number {entries} were removed: the end that the store noted at {at} is not there")]
    CutOff {
        /// Entries that are there.
        entries: usize,
        /// When the end was noted.
        at: String,
    },
    /// There is no log.
    #[error("there is no audit log in {directory}")]
    Missing {
        /// Where one was looked for.
        directory: String,
    },
    /// The store beside it cannot be read.
    #[error("the store beside the audit log cannot be read")]
    Store(#[from] super::StoreError),
    /// The files cannot be read.
    #[error("the audit log cannot be read")]
    Io(#[from] io::Error),
}

/// An audit log in which nothing was changed or removed up to its noted end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AuditReport {
    /// Entries.
    pub entries: usize,
    /// When the store last noted the end.
    pub anchored_at: Option<String>,
    /// Entries after that end: were some of them cut off, that would not show.
    pub later: usize,
    /// Entries by which a start of the service tells that it found the end cut off.
    pub gaps: usize,
}

/// Follows the audit log of a data directory up to the end that the store beside it notes, or `database` where the rows are there.
///
/// What this proves: no entry up to that end was changed, removed or cut off without the store being changed too. What it cannot: that
/// nothing was removed after that end (some seconds at most), and anything against someone who writes both the log and the store. For that
/// ship the log to another machine.
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
}

impl Audit {
    /// Opens the log below a data directory and goes on where it ends. What a crash left of a line is closed off.
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

    /// A log that keeps nothing, for a store in memory.
    #[must_use]
    pub fn none() -> Self {
        Self { directory: None, state: Mutex::default() }
    }

    /// Appends an entry with the present time. `sync` waits until it is on disk.
    ///
    /// # Errors
    /// The file system's.
    pub fn record(&self, entry: AuditEntry, sync: bool) -> io::Result<()> {
        let Some(directory) = &self.directory else { return Ok(()) };
        let entry = AuditEntry { at: now_rfc3339(), ..entry };
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let month = entry.at.get(..7).unwrap_or("0000-00");
        if state.file.is_none() || state.month != month {
            let path = directory.join(format!("{month}.jsonl"));
            state.file = Some(OpenOptions::new().create(true).append(true).open(path)?);
            month.clone_into(&mut state.month);
        }
        let chain = chained(&state.chain, &entry)?;
        let mut line = serde_json::to_string(&Line { entry, chain: chain.clone() })?;
        line.push('\n');
        if let Some(file) = &mut state.file {
            // One write, so that lines of a crash are whole or the last one.
            file.write_all(line.as_bytes())?;
            if sync {
                file.sync_data()?;
            }
        }
        state.chain = chain;
        Ok(())
    }

    /// The chain at the end, on disk from now on; nothing of a log that keeps nothing or is empty.
    ///
    /// # Errors
    /// The file system's.
    pub fn settle(&self) -> io::Result<Option<String>> {
        let (file, chain) = {
            let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
            (state.file.as_ref().map(File::try_clone).transpose()?, state.chain.clone())
        };
        // Outside the lock: requests do not wait for the disk.
        if let Some(file) = file {
            file.sync_data()?;
        }
        Ok(Some(chain).filter(|chain| !chain.is_empty()))
    }

    /// Whether an entry has this chain: the end that the store noted must be there. A log that keeps nothing has every one.
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

    /// Reads all files below a data directory and follows the chain, which must come by the `anchor`: a chain and when it was the end.
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
                // What a crash left of a line is marked by the next start.
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

/// Ends a line that a crash cut off.
const CUT_OFF: &str = "#cut-off";

fn chained(before: &str, entry: &AuditEntry) -> io::Result<String> {
    Ok(sha256_hex(format!("{before}\n{}", serde_json::to_string(entry)?).as_bytes()))
}

/// The files of a log, by month.
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
        assert_eq!(verify_audit(data.path(), None).await.unwrap().later, 0, "what came after it does not show");
        std::fs::write(&path, first(2)).unwrap();
        assert!(matches!(verify_audit(data.path(), None).await, Err(AuditFault::CutOff { entries: 2, .. })));
        std::fs::remove_dir_all(data.path().join("audit")).unwrap();
        assert!(matches!(verify_audit(data.path(), None).await, Err(AuditFault::CutOff { entries: 0, .. })));
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
