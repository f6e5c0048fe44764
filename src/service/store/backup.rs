use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{self, Read as _, Write};
use std::path::{Component, Path, PathBuf};

use futures::future::BoxFuture;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::directory::{BLOBS, create_private, lock};
use super::records::{hex, to_json};
use super::sqlite::{self, DATABASE, SqliteMeta};
use super::{MetaStore, StoreError, seal};

/// Lists every file of a backup with its hash; written last, so that a backup without it is not whole.
const MANIFEST: &str = "manifest.json";

/// Snapshots that are tried when sessions are deleted while their files are copied.
const TRIES: usize = 5;

/// What a backup holds.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BackupReport {
    /// Files, the database among them.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// Values among them that are not what was stored: they were damaged before.
    #[serde(default)]
    pub damaged: Vec<String>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    /// Version of the program that wrote it.
    version: String,
    /// SHA-256 and length by path.
    files: BTreeMap<String, (String, u64)>,
}

/// Copies the store of a data directory to the new directory `out`, also while the service runs: the database as it is at one
/// moment, and every file that it names.
///
/// # Errors
/// [`StoreError::Backup`] when `out` is there, or when files vanish faster than they are copied; else the store's.
pub fn back_up<'a>(data: &'a Path, out: &'a Path) -> BoxFuture<'a, Result<BackupReport, StoreError>> {
    Box::pin(copy_out(data, out))
}

async fn copy_out(data: &Path, out: &Path) -> Result<BackupReport, StoreError> {
    if out.exists() {
        return Err(fault(format!("{} is there already", out.display())));
    }
    if !data.join(DATABASE).is_file() {
        let detail =
            format!("there is no store in {}; rows in Postgres are backed up with its own tools", data.display());
        return Err(fault(detail));
    }
    if !data.join(BLOBS).is_dir() {
        let detail =
            format!("there are no files in {}; what is in a bucket is backed up with its own tools", data.display());
        return Err(fault(detail));
    }
    if lies_below(out, data)? {
        let inside = "is inside the data directory, where it would be lost with it";
        return Err(fault(format!("{} {inside}; name one elsewhere", out.display())));
    }
    let done = copy_store(data, out).await;
    if done.is_err() {
        // A part of a backup is of no use and would stand in the way of the next one.
        std::fs::remove_dir_all(out).ok();
    }
    done
}

async fn copy_store(data: &Path, out: &Path) -> Result<BackupReport, StoreError> {
    let meta = SqliteMeta::open_beside(data).await?;
    create_private(&out.join(BLOBS))?;
    let mut copied = Copied::new();
    for _ in 0..TRIES {
        copy_present(data, out, &mut copied)?;
        let snapshot = out.join(DATABASE);
        match std::fs::remove_file(&snapshot) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error.into()),
            _ => {}
        }
        meta.copy_to(&snapshot).await?;
        let copy = SqliteMeta::open_beside(out).await?;
        let named = copy.named_blobs().await?;
        copy.close().await;
        // The copy is one file: its log is empty once closed.
        if copy_named(data, out, &named, &mut copied)? {
            meta.close().await;
            return finish(out, &named, copied);
        }
    }
    Err(fault("files were removed while they were copied; try again"))
}

/// Whether a path that may not be there yet is, or will be, in a directory.
fn lies_below(path: &Path, directory: &Path) -> io::Result<bool> {
    let directory = directory.canonicalize()?;
    let path = std::path::absolute(path)?;
    let there = path.ancestors().find_map(|a| a.canonicalize().ok());
    Ok(there.is_some_and(|there| there.starts_with(&directory)))
}

/// Files by path.
type Copied = BTreeMap<String, Read>;

/// What reading a file through gave.
#[derive(Debug, PartialEq)]
struct Read {
    sha256: String,
    bytes: u64,
    /// Whether it is what was stored.
    is_whole: bool,
}

/// Copies what is there and not copied yet, before a snapshot is taken: what is removed after that is here already.
fn copy_present(data: &Path, out: &Path, copied: &mut Copied) -> Result<(), StoreError> {
    for session in std::fs::read_dir(data.join(BLOBS))? {
        let session = session?;
        let files = match std::fs::read_dir(session.path()) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            files => files?,
        };
        for file in files {
            let (session, file) = (session.file_name(), file?.file_name());
            let key = format!("{}/{}", session.to_string_lossy(), file.to_string_lossy());
            // Unfinished uploads have a `#` in their name.
            if !key.contains('#') {
                copy_one(data, out, &key, copied)?;
            }
        }
    }
    Ok(())
}

/// Copies what is named and not copied yet. False when one has gone meanwhile: then the snapshot is outdated.
fn copy_named(data: &Path, out: &Path, named: &BTreeSet<String>, copied: &mut Copied) -> Result<bool, StoreError> {
    for key in named {
        if !copy_one(data, out, key, copied)? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Copies a file unless it is copied. False when it is not there.
fn copy_one(data: &Path, out: &Path, key: &str, copied: &mut Copied) -> Result<bool, StoreError> {
    let name = format!("{BLOBS}/{key}");
    if copied.contains_key(&name) {
        return Ok(true);
    }
    let target = out.join(&name);
    if let Some(parent) = target.parent() {
        create_private(parent)?;
    }
    match copy(&data.join(&name), &target, key) {
        Ok(found) => _ = copied.insert(name, found),
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(error.into()),
    }
    Ok(true)
}

fn finish(out: &Path, named: &BTreeSet<String>, mut files: Copied) -> Result<BackupReport, StoreError> {
    // Files of an outdated snapshot are of deleted sessions.
    let outdated = |name: &String| name.strip_prefix("blobs/").is_some_and(|key| !named.contains(key));
    for name in files.keys().filter(|name| outdated(name)).cloned().collect::<Vec<_>>() {
        std::fs::remove_file(out.join(&name))?;
        files.remove(&name);
    }
    files.insert(DATABASE.to_owned(), read(&out.join(DATABASE), DATABASE)?);
    let report = report_of(&files);
    let files = files.into_iter().map(|(name, file)| (name, (file.sha256, file.bytes))).collect();
    let manifest = to_json("manifest", &Manifest { version: env!("CARGO_PKG_VERSION").to_owned(), files })?;
    let mut file = File::create(out.join(MANIFEST))?;
    file.write_all(manifest.as_bytes())?;
    file.sync_all()?;
    Ok(report)
}

fn report_of(files: &Copied) -> BackupReport {
    let damaged = files.iter().filter(|(_, file)| !file.is_whole).map(|(name, _)| key_of(name).to_owned());
    BackupReport { files: files.len(), bytes: files.values().map(|file| file.bytes).sum(), damaged: damaged.collect() }
}

/// Key of the value in a file of a backup.
fn key_of(name: &str) -> &str {
    name.strip_prefix("blobs/").unwrap_or(name)
}

/// Puts a backup into a data directory that holds no store yet; every file is checked first.
///
/// # Errors
/// [`StoreError::Backup`] when the backup is not whole or the directory has a store, [`StoreError::InUse`].
pub fn restore<'a>(from: &'a Path, data: &'a Path) -> BoxFuture<'a, Result<BackupReport, StoreError>> {
    Box::pin(copy_back(from, data))
}

async fn copy_back(from: &Path, data: &Path) -> Result<BackupReport, StoreError> {
    let text = std::fs::read_to_string(from.join(MANIFEST))
        .map_err(|e| fault(format!("{} cannot be read: {e}", from.join(MANIFEST).display())))?;
    let manifest: Manifest = serde_json::from_str(&text).map_err(|e| fault(format!("the manifest: {e}")))?;
    let mut files = Copied::new();
    for (name, (sha256, bytes)) in &manifest.files {
        let path = from.join(safe(name)?);
        let found = read(&path, key_of(name)).map_err(|e| fault(format!("{name} cannot be read: {e}")))?;
        if (&found.sha256, &found.bytes) != (sha256, bytes) {
            return Err(fault(format!("{name} is not what was written")));
        }
        files.insert(name.clone(), found);
    }
    if !manifest.files.contains_key(DATABASE) {
        return Err(fault("there is no database in it"));
    }
    create_private(data)?;
    let _held = lock(data)?;
    if data.join(DATABASE).exists() || data.join(BLOBS).exists() {
        return Err(fault(format!("{} holds a store already; name an empty directory", data.display())));
    }
    let done = put_back(from, data, &manifest).await.map(|()| report_of(&files));
    if done.is_err() {
        // All of it is of the backup: the directory was empty.
        sqlite::remove(data)?;
        std::fs::remove_dir_all(data.join(BLOBS)).ok();
    }
    done
}

async fn put_back(from: &Path, data: &Path, manifest: &Manifest) -> Result<(), StoreError> {
    // The database last: without it there is no store.
    let mut files: Vec<&String> = manifest.files.keys().collect();
    files.sort_by_key(|name| name.as_str() == DATABASE);
    for name in files {
        let target = data.join(safe(name)?);
        if let Some(parent) = target.parent() {
            create_private(parent)?;
        }
        copy(&from.join(name), &target, key_of(name))?;
    }
    let check = SqliteMeta::open_beside(data).await?;
    check.check().await?;
    // The audit log of the directory it came from is not here.
    check.clear_audit_anchor().await?;
    check.close().await;
    Ok(())
}

/// A path below the directory and nowhere else.
fn safe(name: &str) -> Result<PathBuf, StoreError> {
    let path = PathBuf::from(name);
    let plain = path.components().all(|c| matches!(c, Component::Normal(_)));
    if plain && !name.is_empty() { Ok(path) } else { Err(fault(format!("`{name}` is no name of a file in it"))) }
}

fn copy(from: &Path, to: &Path, key: &str) -> io::Result<Read> {
    let (mut from, mut to) = (File::open(from)?, File::create(to)?);
    let found = each_piece(&mut from, key, |piece| to.write_all(piece))?;
    to.sync_all()?;
    Ok(found)
}

fn read(path: &Path, key: &str) -> io::Result<Read> {
    each_piece(&mut File::open(path)?, key, |_| Ok(()))
}

fn each_piece(file: &mut File, key: &str, mut take: impl FnMut(&[u8]) -> io::Result<()>) -> io::Result<Read> {
    let (mut hash, mut check, mut bytes, mut piece) = (Sha256::new(), seal::Check::new(), 0, vec![0; 1 << 20]);
    loop {
        let n = file.read(&mut piece)?;
        if n == 0 {
            return Ok(Read { sha256: hex(&hash.finalize()), bytes, is_whole: check.finds_whole(key) });
        }
        let piece = piece.get(..n).unwrap_or_default();
        hash.update(piece);
        check.read(piece);
        bytes += n as u64;
        take(piece)?;
    }
}

fn fault(detail: impl Into<String>) -> StoreError {
    StoreError::Backup { detail: detail.into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance::{part_with, session};
    use crate::{PartKind, SessionId, SessionRecord, Store, scrub};

    async fn put(store: &Store, id: SessionId, bytes: &[u8]) {
        let blob = store.blobs().put(id, bytes.to_vec()).await.unwrap();
        store.put_parts(id, &[part_with(PartKind::Skin, &blob)]).await.unwrap();
    }

    /// A store in a directory of its own, with a session that has a skin.
    async fn filled() -> (tempfile::TempDir, PathBuf, Store, SessionRecord) {
        let directory = tempfile::tempdir().unwrap();
        let data = directory.path().join("data");
        let store = Store::open(&data).await.unwrap();
        let kept = session("local");
        store.insert_session(&kept, None).await.unwrap();
        put(&store, kept.id, b"kept").await;
        (directory, data, store, kept)
    }

    #[tokio::test]
    async fn a_backup_taken_under_load_is_whole_and_comes_back() {
        let (directory, data, store, kept) = filled().await;
        let [out, back] = ["out", "back"].map(|n| directory.path().join(n));
        let going = tokio::spawn({
            let store = store.clone();
            async move {
                for round in 0..200u32 {
                    let other = session("local");
                    store.insert_session(&other, None).await.unwrap();
                    put(&store, other.id, &round.to_le_bytes()).await;
                    store.delete_session(other.id).await.unwrap();
                    put(&store, kept.id, b"kept").await;
                }
            }
        });
        let report = back_up(&data, &out).await;
        going.await.unwrap();
        // Under this load a file may come and go each time between two looks: that is said, and a quiet moment helps.
        let report = match report {
            Ok(report) => report,
            Err(StoreError::Backup { .. }) => back_up(&data, &out).await.unwrap(),
            Err(other) => panic!("{other:?}"),
        };
        assert!(report.files >= 2);
        assert!(matches!(back_up(&data, &out).await, Err(StoreError::Backup { .. })), "never over another one");

        assert_eq!(restore(&out, &back).await.unwrap(), report);
        let restored = Store::open(&back).await.unwrap();
        let part = restored.part(kept.id, PartKind::Skin).await.unwrap().unwrap();
        assert_eq!(restored.blobs().get(&part.blob.unwrap()).await.unwrap().as_ref(), b"kept");
        assert!(matches!(restore(&out, &back).await, Err(StoreError::InUse)));
        restored.close().await;
        drop(restored);
        assert!(matches!(restore(&out, &back).await, Err(StoreError::Backup { .. })), "never over a store");
    }

    #[tokio::test]
    async fn what_fails_half_way_leaves_nothing_in_the_way() {
        let (directory, data, store, kept) = filled().await;
        let [out, back] = ["out", "back"].map(|n| directory.path().join(n));
        let blob = store.part(kept.id, PartKind::Skin).await.unwrap().unwrap().blob.unwrap();
        let (file, aside) = (data.join(BLOBS).join(blob), directory.path().join("aside"));
        std::fs::rename(&file, &aside).unwrap();
        let refused = back_up(&data, &out).await;
        assert!(matches!(refused, Err(StoreError::Backup { .. })) && !out.exists());
        std::fs::rename(&aside, &file).unwrap();
        back_up(&data, &out).await.unwrap();

        // A database that is whole but no database.
        let manifest = std::fs::read(out.join(MANIFEST)).unwrap();
        let database = std::fs::read(out.join(DATABASE)).unwrap();
        std::fs::write(out.join(DATABASE), [b'x'; 5000]).unwrap();
        let mut changed: Manifest = serde_json::from_slice(&manifest).unwrap();
        let database_file = read(&out.join(DATABASE), DATABASE).unwrap();
        changed.files.insert(DATABASE.to_owned(), (database_file.sha256, database_file.bytes));
        std::fs::write(out.join(MANIFEST), to_json("manifest", &changed).unwrap()).unwrap();
        assert!(matches!(restore(&out, &back).await, Err(StoreError::Foreign)));
        std::fs::write(out.join(MANIFEST), manifest).unwrap();
        std::fs::write(out.join(DATABASE), database).unwrap();
        restore(&out, &back).await.unwrap();
    }

    #[tokio::test]
    async fn a_damaged_backup_is_refused() {
        let (directory, data, store, kept) = filled().await;
        let out = directory.path().join("out");
        back_up(&data, &out).await.unwrap();
        let blob = store.part(kept.id, PartKind::Skin).await.unwrap().unwrap().blob.unwrap();
        std::fs::write(out.join(BLOBS).join(&blob), b"kopt").unwrap();
        let refused = restore(&out, &directory.path().join("not")).await;
        assert!(matches!(refused, Err(StoreError::Backup { .. })));
        // What was damaged before is in the backup as it is, and said.
        let mut file = std::fs::read(data.join(BLOBS).join(&blob)).unwrap();
        file[1] ^= 1;
        std::fs::write(data.join(BLOBS).join(&blob), file).unwrap();
        let [out, back] = ["again", "back"].map(|n| directory.path().join(n));
        assert_eq!(back_up(&data, &out).await.unwrap().damaged, std::slice::from_ref(&blob));
        assert_eq!(restore(&out, &back).await.unwrap().damaged, std::slice::from_ref(&blob));
        let found = scrub(&back).await.unwrap();
        assert_eq!((found.values, &found.damaged, found.unsealed), (1, &vec![blob.clone()], 0));
        assert!(matches!(store.blobs().get(&blob).await, Err(StoreError::Damaged { key }) if key == blob));
        std::fs::remove_file(back.join(BLOBS).join(&blob)).unwrap();
        assert_eq!(scrub(&back).await.unwrap().missing, [blob]);

        let manifest = r#"{"version": "x", "files": {"../escape": ["", 0]}}"#;
        std::fs::write(out.join(MANIFEST), manifest).unwrap();
        let refused = restore(&out, &directory.path().join("not")).await;
        assert!(matches!(refused, Err(StoreError::Backup { detail }) if detail.contains("escape")));
    }
}
