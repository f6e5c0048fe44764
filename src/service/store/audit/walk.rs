//! Follows the chain of an audit log through its files.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::AuditEntry;
use crate::records::sha256_hex;

/// Marks the end of a line that a crash cut off.
pub(super) const CUT_OFF: &str = "#cut-off";

/// Bytes at the end of a file in which its last line is looked for first; a line has some hundred.
const TAIL: u64 = 64 << 10;

/// A line of the log.
///
/// `chain` is the SHA-256 of the previous chain and the entry, so changed or removed lines are found.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Line {
    pub(super) entry: AuditEntry,
    pub(super) chain: String,
}

impl Line {
    fn follows(&self, before: &str) -> io::Result<bool> {
        Ok(chained(before, &self.entry)? == self.chain)
    }
}

pub(super) fn chained(before: &str, entry: &AuditEntry) -> io::Result<String> {
    Ok(sha256_hex(format!("{before}\n{}", serde_json::to_string(entry)?).as_bytes()))
}

/// An entry that the walk has reached.
#[derive(Debug)]
pub(super) struct Reached {
    pub(super) entry: AuditEntry,
    pub(super) chain: String,
    /// Path of the file, and number of the line, from 1.
    pub(super) at: (String, usize),
    /// Whether the entry does not follow the one before, but the end of the file of the latest month.
    pub(super) is_branch: bool,
}

/// A walk along the chain, from the first entry of a log.
///
/// The entries of a file stand in their order, but the chain may leave a file and come back to it: earlier versions chose the
/// file by the clock alone, which may be set back.
#[derive(Debug)]
pub(super) struct Walk {
    /// By name.
    files: Vec<Reader>,
    current: usize,
    chain: String,
    /// Chains of the entries that continue the end of the latest month's file: a repeated line is no branch.
    continued: Vec<String>,
}

impl Walk {
    pub(super) fn open(files: &[PathBuf]) -> io::Result<Self> {
        let files = files.iter().map(|path| Reader::open(path)).collect::<io::Result<_>>()?;
        Ok(Self { files, current: 0, chain: String::new(), continued: Vec::new() })
    }

    /// The next entry; `None` when no line follows.
    pub(super) fn step(&mut self) -> io::Result<Option<Reached>> {
        let latest = self.latest();
        let mut next = self.follower(&self.chain)?.map(|file| (file, false));
        // Earlier versions continued, at a start, the file of the latest month; with a clock that was set back that is not the end.
        if next.is_none()
            && let Some(latest) = &latest
        {
            next = self.follower(latest)?.filter(|file| self.is_new(*file)).map(|file| (file, true));
        }
        let Some((file, is_branch)) = next else { return Ok(None) };
        let continues = is_branch || latest.as_ref() == Some(&self.chain);
        let reached = self.take(file, is_branch)?;
        if self.latest() != latest {
            self.continued.clear();
        } else if continues {
            self.continued.push(self.chain.clone());
        }
        Ok(reached)
    }

    /// Chain of the last entry reached in the file of the latest month.
    fn latest(&self) -> Option<String> {
        self.files.iter().rev().find_map(|file| file.taken.clone())
    }

    /// Whether the next line of a file does not repeat one that was reached.
    fn is_new(&self, file: usize) -> bool {
        let next = self.files.get(file).and_then(|file| file.next.as_ref());
        matches!(next, Some(Next::Line(line)) if !self.continued.contains(&line.chain))
    }

    /// The first line that was not reached: its path and its number, from 1.
    pub(super) fn left(&self) -> Option<(String, usize)> {
        let current = self.files.get(self.current).filter(|file| file.next.is_some());
        current.or_else(|| self.files.iter().find(|file| file.next.is_some())).map(Reader::place)
    }

    /// The file whose next line follows `chain`.
    fn follower(&self, chain: &str) -> io::Result<Option<usize>> {
        let others = (0..self.files.len()).filter(|file| *file != self.current);
        for index in std::iter::once(self.current).chain(others) {
            if let Some(Next::Line(line)) = self.files.get(index).and_then(|file| file.next.as_ref())
                && line.follows(chain)?
            {
                return Ok(Some(index));
            }
        }
        Ok(None)
    }

    fn take(&mut self, index: usize, is_branch: bool) -> io::Result<Option<Reached>> {
        let Some(file) = self.files.get_mut(index) else { return Ok(None) };
        let at = file.place();
        let Some(Line { entry, chain }) = file.take()? else { return Ok(None) };
        self.current = index;
        self.chain.clone_from(&chain);
        Ok(Some(Reached { entry, chain, at, is_branch }))
    }
}

/// A file of which each line is looked at before it is taken.
#[derive(Debug)]
struct Reader {
    path: PathBuf,
    from: BufReader<File>,
    number: usize,
    next: Option<Next>,
    /// Chain of the last line that was taken.
    taken: Option<String>,
}

#[derive(Debug)]
enum Next {
    Line(Line),
    /// A line that is not an entry.
    Other,
}

impl Reader {
    fn open(path: &Path) -> io::Result<Self> {
        let from = BufReader::new(File::open(path)?);
        let mut reader = Self { path: path.to_owned(), from, number: 0, next: None, taken: None };
        reader.advance()?;
        Ok(reader)
    }

    fn place(&self) -> (String, usize) {
        (self.path.display().to_string(), self.number)
    }

    fn take(&mut self) -> io::Result<Option<Line>> {
        let taken = self.next.take();
        self.advance()?;
        let Some(Next::Line(line)) = taken else { return Ok(None) };
        self.taken = Some(line.chain.clone());
        Ok(Some(line))
    }

    /// Reads the next line, after those that a crash cut off.
    fn advance(&mut self) -> io::Result<()> {
        let mut text = Vec::new();
        loop {
            text.clear();
            self.number += 1;
            if self.from.read_until(b'\n', &mut text)? == 0 {
                self.next = None;
                return Ok(());
            }
            let is_ended = text.pop_if(|last| *last == b'\n').is_some();
            match serde_json::from_slice(&text) {
                Ok(line) => self.next = Some(Next::Line(line)),
                // The next start marks the line at the end of a file as cut off.
                Err(_) if !is_ended || text.ends_with(CUT_OFF.as_bytes()) => continue,
                Err(_) => self.next = Some(Next::Other),
            }
            return Ok(());
        }
    }
}

/// The chain at the end of a log, whose files are sorted by name; empty for an empty log.
///
/// When each file continues the one before, the end is that of the last one. If not, the chain is followed through all entries.
pub(super) fn end(files: &[PathBuf]) -> io::Result<String> {
    let mut before = String::new();
    let mut is_sorted = true;
    for path in files {
        let (first, last) = (first_line(path)?, last_chain(path)?);
        is_sorted &= match first {
            Some(line) => line.follows(&before)?,
            None => last.is_none(),
        };
        before = last.unwrap_or(before);
    }
    if is_sorted {
        return Ok(before);
    }
    let mut walk = Walk::open(files)?;
    while walk.step()?.is_some() {}
    // What comes after a changed or removed line continues the last file; a verification reports the line.
    Ok(if walk.left().is_some() { before } else { walk.chain })
}

/// The first line of a file, if it is an entry.
fn first_line(path: &Path) -> io::Result<Option<Line>> {
    match Reader::open(path)?.next {
        Some(Next::Line(line)) => Ok(Some(line)),
        _ => Ok(None),
    }
}

/// The chain of the last line that is an entry.
fn last_chain(path: &Path) -> io::Result<Option<String>> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    for begin in [length.saturating_sub(TAIL), 0] {
        file.seek(SeekFrom::Start(begin))?;
        let mut tail = Vec::new();
        file.by_ref().read_to_end(&mut tail)?;
        let mut lines = tail.split(|byte| *byte == b'\n').rev();
        if let Some(line) = lines.find_map(|line| serde_json::from_slice::<Line>(line).ok()) {
            return Ok(Some(line.chain));
        }
    }
    Ok(None)
}
