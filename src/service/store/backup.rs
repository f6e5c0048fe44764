use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, TryLockError};
use std::io::{self, Write as _};
use std::path::Path;

use futures::future::BoxFuture;
use serde::{Deserialize, Serialize};

use super::directory::{BLOBS, create_private, is_unfinished, mark_finished, mark_unfinished};
use super::key_marks::MARKS;
use super::measured::{Measured, copy, read};
use super::records::to_json;
use super::sqlite::{DATABASE, SqliteMeta};
use super::{Keyring, MetaStore, StoreError};

/// Lists every file of a backup with its hash.
///
/// It is written last, so a backup without it is incomplete.
pub(super) const MANIFEST: &str = "manifest.json";

/// Attempts at a snapshot while sessions are deleted during the copy.
const TRIES: usize = 5;

/// Summary of a backup.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BackupReport {
    /// Number of files, the database included.
    pub files: usize,
    /// Total size of the files, bytes.
    pub bytes: u64,
    /// Number of values that are not encrypted.
    #[serde(default)]
    pub plain: usize,
    /// Keys of blobs that do not match their seal: they were damaged before the backup.
    #[serde(default)]
    pub damaged: Vec<String>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    /// Version of the program that wrote the backup.
    version: String,
    /// SHA-256 and length by path.
    pub(super) files: BTreeMap<String, (String, u64)>,
}

/// Name of the database in a backup that is encrypted.
pub(super) const ENCRYPTED_DATABASE: &str = "prosopon.sqlite.encrypted";
/// Directory in the data directory for the database before it is encrypted.
const SNAPSHOT: &str = "snapshot";
/// File that a process locks while it uses that directory.
const SNAPSHOT_LOCK: &str = "snapshot.lock";

/// Copies the store of a data directory to the new directory `out`, also while the service runs.
///
/// The copy holds the database at one moment and every blob that it names. Blobs are copied as they are stored; with `keys` the
/// database is encrypted too.
///
/// # Errors
/// [`StoreError::Backup`] when `out` exists or lies in `data`, when `data` has no local store, or when blobs are removed faster
/// than they are copied; [`StoreError::KeyUnknown`] when the blobs' key is not among `keys`; else the store's.
pub fn back_up<'a>(
    data: &'a Path,
    out: &'a Path,
    keys: &'a Keyring,
) -> BoxFuture<'a, Result<BackupReport, StoreError>> {
    Box::pin(copy_out(data, out, keys))
}

async fn copy_out(data: &Path, out: &Path, keys: &Keyring) -> Result<BackupReport, StoreError> {
    if out.exists() {
        let why =
            if is_unfinished(out)? { "holds a backup that was interrupted; delete it or" } else { "exists already;" };
        return Err(fault(format!("{} {why} name a new directory", out.display())));
    }
    if is_unfinished(data)? {
        return Err(StoreError::Unfinished);
    }
    if !data.join(DATABASE).is_file() {
        let detail = format!("there is no store in {}; back up a Postgres database with its own tools", data.display());
        return Err(fault(detail));
    }
    if !data.join(BLOBS).is_dir() {
        let detail = format!("there are no blobs in {}; back up a bucket with its own tools", data.display());
        return Err(fault(detail));
    }
    if lies_below(out, data)? {
        let inside = "is inside the data directory and would be lost with it";
        return Err(fault(format!("{} {inside}; name a directory elsewhere", out.display())));
    }
    check_keys(&data.join(BLOBS), keys).await?;
    let held = (!keys.is_empty()).then(|| hold_snapshot(data)).transpose()?;
    let done = copy_store(data, out, keys).await;
    if held.is_some() {
        remove_directory(&data.join(SNAPSHOT))?;
    }
    if done.is_err() {
        // An incomplete backup is of no use, and its directory would make the next attempt fail.
        std::fs::remove_dir_all(out).ok();
    }
    done
}

/// Checks that the keys of a store's blobs are among `keys`.
pub(super) async fn check_keys(blobs: &Path, keys: &Keyring) -> Result<(), StoreError> {
    for mark in marks(blobs)? {
        keys.open(&mark, &std::fs::read(blobs.join(&mark))?).await?;
    }
    Ok(())
}

/// Names of the marks of the keys with which blobs are encrypted.
fn marks(blobs: &Path) -> io::Result<Vec<String>> {
    match std::fs::read_dir(blobs.join(MARKS)) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        marks => marks?.map(|mark| Ok(format!("{MARKS}/{}", mark?.file_name().to_string_lossy()))).collect(),
    }
}

/// Holds the directory of the snapshot for one backup.
fn hold_snapshot(data: &Path) -> Result<File, StoreError> {
    let held = File::create(data.join(SNAPSHOT_LOCK))?;
    match held.try_lock() {
        Ok(()) => Ok(held),
        Err(TryLockError::WouldBlock) => {
            Err(fault("another backup of the store is being made; try again when it has ended"))
        }
        Err(TryLockError::Error(error)) => Err(error.into()),
    }
}

/// Removes the snapshot that a killed backup left in the data directory.
pub(super) fn remove_old_snapshot(data: &Path) -> Result<(), StoreError> {
    if !data.join(SNAPSHOT).exists() {
        return Ok(());
    }
    match hold_snapshot(data) {
        Err(StoreError::Backup { .. }) => Ok(()),
        held => {
            let _held = held?;
            Ok(remove_directory(&data.join(SNAPSHOT))?)
        }
    }
}

pub(super) fn remove_directory(directory: &Path) -> io::Result<()> {
    match std::fs::remove_dir_all(directory) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

async fn copy_store(data: &Path, out: &Path, keys: &Keyring) -> Result<BackupReport, StoreError> {
    let meta = SqliteMeta::open_beside(data).await?;
    create_private(&out.join(BLOBS))?;
    mark_unfinished(out)?;
    // What is not encrypted yet stays with the store.
    let beside = if keys.is_empty() { out.to_owned() } else { data.join(SNAPSHOT) };
    if !keys.is_empty() {
        remove_directory(&beside)?;
    }
    create_private(&beside)?;
    let mut copied = Copied::new();
    for _ in 0..TRIES {
        copy_present(data, out, &mut copied)?;
        let snapshot = beside.join(DATABASE);
        match std::fs::remove_file(&snapshot) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error.into()),
            _ => {}
        }
        meta.copy_to(&snapshot).await?;
        let copy = SqliteMeta::open_beside(&beside).await?;
        let mut named = copy.named_blobs().await?;
        copy.close().await;
        // Closing the copy empties its write-ahead log, so one file holds the whole database.
        named.extend(marks(&data.join(BLOBS))?);
        if copy_named(data, out, &named, &mut copied)? {
            meta.close().await;
            let database = if keys.is_empty() {
                DATABASE
            } else {
                let (mut from, mut to) = (File::open(&snapshot)?, File::create(out.join(ENCRYPTED_DATABASE))?);
                keys.encrypt_file(ENCRYPTED_DATABASE, &mut from, &mut to)?;
                to.sync_all()?;
                ENCRYPTED_DATABASE
            };
            return finish(out, &named, copied, database);
        }
    }
    Err(fault("files were removed during the copy; try again when fewer sessions are deleted"))
}

/// Whether a path, which need not exist yet, lies in a directory.
fn lies_below(path: &Path, directory: &Path) -> io::Result<bool> {
    let directory = directory.canonicalize()?;
    let path = std::path::absolute(path)?;
    let there = path.ancestors().find_map(|a| a.canonicalize().ok());
    Ok(there.is_some_and(|there| there.starts_with(&directory)))
}

/// Copied files by their path in the backup.
pub(super) type Copied = BTreeMap<String, Measured>;

/// Copies all blobs that are not copied yet.
///
/// It runs before a snapshot, so that the copy has blobs that are removed later.
fn copy_present(data: &Path, out: &Path, copied: &mut Copied) -> Result<(), StoreError> {
    for session in std::fs::read_dir(data.join(BLOBS))? {
        let session = session?;
        if !session.file_type()?.is_dir() {
            continue;
        }
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

/// Copies all named blobs that are not copied yet.
///
/// False when one was removed meanwhile: the snapshot is then outdated.
fn copy_named(data: &Path, out: &Path, named: &BTreeSet<String>, copied: &mut Copied) -> Result<bool, StoreError> {
    for key in named {
        if !copy_one(data, out, key, copied)? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Copies a blob unless it is copied already. False when its file does not exist.
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

fn finish(out: &Path, named: &BTreeSet<String>, mut files: Copied, database: &str) -> Result<BackupReport, StoreError> {
    // Blobs that the snapshot does not name belong to deleted sessions or replaced parts.
    let outdated = |name: &String| name.strip_prefix("blobs/").is_some_and(|key| !named.contains(key));
    for name in files.keys().filter(|name| outdated(name)).cloned().collect::<Vec<_>>() {
        std::fs::remove_file(out.join(&name))?;
        files.remove(&name);
    }
    files.insert(database.to_owned(), read(&out.join(database), database)?);
    let report = report_of(&files);
    let files = files.into_iter().map(|(name, file)| (name, (file.sha256, file.bytes))).collect();
    let manifest = to_json("manifest", &Manifest { version: env!("CARGO_PKG_VERSION").to_owned(), files })?;
    let mut file = File::create(out.join(MANIFEST))?;
    file.write_all(manifest.as_bytes())?;
    file.sync_all()?;
    mark_finished(out)?;
    Ok(report)
}

pub(super) fn report_of(files: &Copied) -> BackupReport {
    let damaged = files.iter().filter(|(_, file)| !file.is_whole).map(|(name, _)| key_of(name).to_owned());
    let is_value = |name: &str| name.strip_prefix("blobs/").is_some_and(|key| !key.starts_with(MARKS));
    let plain = files.iter().filter(|(name, file)| file.is_plain && is_value(name)).count();
    BackupReport {
        files: files.len(),
        bytes: files.values().map(|file| file.bytes).sum(),
        plain,
        damaged: damaged.collect(),
    }
}

/// Key of the blob in a file of a backup.
pub(super) fn key_of(name: &str) -> &str {
    name.strip_prefix("blobs/").unwrap_or(name)
}

pub(super) fn fault(detail: impl Into<String>) -> StoreError {
    StoreError::Backup { detail: detail.into() }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::conformance::{part_with, session};
    use crate::{PartKind, SessionId, SessionRecord, Store, StoreLocation, scrub};

    async fn back_up(data: &Path, out: &Path) -> Result<BackupReport, StoreError> {
        super::back_up(data, out, &Keyring::default()).await
    }

    async fn restore(from: &Path, data: &Path) -> Result<BackupReport, StoreError> {
        crate::restore(from, data, &Keyring::default()).await
    }

    async fn put(store: &Store, id: SessionId, bytes: &[u8]) {
        let blob = store.blobs().put(id, bytes.to_vec()).await.unwrap();
        store.put_parts(id, &[part_with(PartKind::Skin, &blob)]).await.unwrap();
    }

    /// A store in a new directory, with one session that has a skin.
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
        // Under this load a blob may be removed during every attempt; then the backup fails, and a later one succeeds.
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

        // The hash of the database matches, but its content is not a database.
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
    async fn an_interrupted_copy_is_no_store() {
        let (directory, data, store, kept) = filled().await;
        let [out, back] = ["out", "back"].map(|n| directory.path().join(n));
        back_up(&data, &out).await.unwrap();
        restore(&out, &back).await.unwrap();
        // As after a kill before the last file of each.
        for copy in [&out, &back] {
            std::fs::remove_file(copy.join(DATABASE)).unwrap();
            mark_unfinished(copy).unwrap();
            assert!(matches!(Store::open(copy).await, Err(StoreError::Unfinished)));
            assert!(matches!(back_up(copy, &directory.path().join("of copy")).await, Err(StoreError::Unfinished)));
        }
        let refused = back_up(&data, &out).await;
        assert!(matches!(refused, Err(StoreError::Backup { detail }) if detail.contains("interrupted")));
        std::fs::remove_dir_all(&out).unwrap();
        back_up(&data, &out).await.unwrap();
        restore(&out, &back).await.unwrap();
        let restored = Store::open(&back).await.unwrap();
        assert_eq!(restored.session(kept.id).await.unwrap(), Some(kept));
        restored.close().await;
        store.close().await;
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
        // A blob that was damaged before is copied as it is, and reported.
        let mut file = std::fs::read(data.join(BLOBS).join(&blob)).unwrap();
        file[1] ^= 1;
        std::fs::write(data.join(BLOBS).join(&blob), file).unwrap();
        let [out, back] = ["again", "back"].map(|n| directory.path().join(n));
        assert_eq!(back_up(&data, &out).await.unwrap().damaged, std::slice::from_ref(&blob));
        assert_eq!(restore(&out, &back).await.unwrap().damaged, std::slice::from_ref(&blob));
        let found = scrub(&back, &Keyring::default()).await.unwrap();
        assert_eq!((found.values, &found.damaged, found.unsealed), (1, &vec![blob.clone()], 0));
        assert!(matches!(store.blobs().get(&blob).await, Err(StoreError::Damaged { key }) if key == blob));
        std::fs::remove_file(back.join(BLOBS).join(&blob)).unwrap();
        assert_eq!(scrub(&back, &Keyring::default()).await.unwrap().missing, [blob]);

        let manifest = r#"{"version": "x", "files": {"../escape": ["", 0]}}"#;
        std::fs::write(out.join(MANIFEST), manifest).unwrap();
        let refused = restore(&out, &directory.path().join("not")).await;
        assert!(matches!(refused, Err(StoreError::Backup { detail }) if detail.contains("escape")));
    }

    #[tokio::test]
    async fn a_backup_of_an_encrypted_store_shows_nothing_and_needs_its_key() {
        let directory = tempfile::tempdir().unwrap();
        let [data, out, back] = ["data", "out", "back"].map(|n| directory.path().join(n));
        let keys = Keyring::new([Keyring::new_key().unwrap().0.as_str()]).unwrap();
        let places = StoreLocation { keys: keys.clone(), ..StoreLocation::default() };
        let store = Store::open_at(&data, &places).await.unwrap();
        let kept = SessionRecord { label: Some("a patient's name".to_owned()), ..session("local") };
        store.insert_session(&kept, None).await.unwrap();
        put(&store, kept.id, b"a face").await;

        assert!(matches!(back_up(&data, &out).await, Err(StoreError::KeyUnknown { .. })) && !out.exists());
        // What a killed backup leaves goes with the next start, but not while a backup is being made.
        let held = hold_snapshot(&data).unwrap();
        std::fs::create_dir(data.join(SNAPSHOT)).unwrap();
        remove_old_snapshot(&data).unwrap();
        let second = crate::back_up(&data, &out, &keys).await;
        assert!(matches!(second, Err(StoreError::Backup { .. })) && data.join(SNAPSHOT).exists());
        drop(held);
        remove_old_snapshot(&data).unwrap();
        assert!(!data.join(SNAPSHOT).exists() && !out.exists());
        let report = super::back_up(&data, &out, &keys).await.unwrap();
        assert!(report.damaged.is_empty() && report.plain == 0 && !data.join(SNAPSHOT).exists());
        for name in std::fs::read_dir(&out).unwrap() {
            let name = name.unwrap();
            let holds_name = |bytes: &[u8]| bytes.windows(9).any(|w| w == b"a patient");
            assert!(name.path().is_dir() || !holds_name(&std::fs::read(name.path()).unwrap()), "{name:?}");
        }
        assert!(matches!(restore(&out, &back).await, Err(StoreError::KeyUnknown { .. })) && !back.exists());
        assert_eq!(crate::restore(&out, &back, &keys).await.unwrap(), report);
        assert!(matches!(Store::open(&back).await, Err(StoreError::KeyUnknown { .. })));
        let restored = Store::open_at(&back, &places).await.unwrap();
        assert_eq!(restored.session(kept.id).await.unwrap().unwrap().label, kept.label);
        let part = restored.part(kept.id, PartKind::Skin).await.unwrap().unwrap();
        assert_eq!(restored.blobs().get(&part.blob.unwrap()).await.unwrap().as_ref(), b"a face");
        for wrong in [Keyring::default(), Keyring::new([Keyring::new_key().unwrap().0.as_str()]).unwrap()] {
            assert!(matches!(scrub(&back, &wrong).await, Err(StoreError::KeyUnknown { .. })));
        }
        let found = scrub(&back, &keys).await.unwrap();
        assert_eq!(found.encrypted, BTreeMap::from([(keys.ids().next().unwrap(), 1)]));
        // The key is missed too where the marks of the keys are lost.
        restored.close().await;
        std::fs::remove_dir_all(back.join(BLOBS).join(MARKS)).unwrap();
        assert!(matches!(scrub(&back, &Keyring::default()).await, Err(StoreError::KeyUnknown { .. })));
    }
}
