use std::fs::File;
use std::io;
use std::path::{Component, Path, PathBuf};

use futures::future::BoxFuture;

use super::backup::{
    BackupReport, Copied, ENCRYPTED_DATABASE, MANIFEST, Manifest, check_keys, fault, key_of, remove_directory,
    report_of,
};
use super::directory::{BLOBS, create_private, is_unfinished, lock, mark_finished, mark_unfinished};
use super::measured::{copy, read};
use super::sqlite::{self, DATABASE, SqliteMeta};
use super::{Keyring, MetaStore, StoreError};

/// Restores a backup into a data directory without a store; checks every file first.
///
/// A directory in which an earlier restore was interrupted counts as one without a store.
///
/// # Errors
/// [`StoreError::Backup`] when the backup is incomplete or changed, or when the directory has a store;
/// [`StoreError::InUse`] when another process has the directory open; [`StoreError::KeyUnknown`] when the backup's key is not among
/// `keys`.
pub fn restore<'a>(
    from: &'a Path,
    data: &'a Path,
    keys: &'a Keyring,
) -> BoxFuture<'a, Result<BackupReport, StoreError>> {
    Box::pin(copy_back(from, data, keys))
}

async fn copy_back(from: &Path, data: &Path, keys: &Keyring) -> Result<BackupReport, StoreError> {
    let text = std::fs::read_to_string(from.join(MANIFEST))
        .map_err(|e| fault(format!("{} cannot be read: {e}", from.join(MANIFEST).display())))?;
    let manifest: Manifest =
        serde_json::from_str(&text).map_err(|e| fault(format!("{MANIFEST} cannot be read: {e}")))?;
    let mut files = Copied::new();
    for (name, (sha256, bytes)) in &manifest.files {
        let path = from.join(safe(name)?);
        let found = read(&path, key_of(name)).map_err(|e| fault(format!("{name} cannot be read: {e}")))?;
        if (&found.sha256, &found.bytes) != (sha256, bytes) {
            return Err(fault(format!("{name} does not match its hash in the manifest: it was changed or cut off")));
        }
        files.insert(name.clone(), found);
    }
    if ![DATABASE, ENCRYPTED_DATABASE].iter().any(|name| manifest.files.contains_key(*name)) {
        return Err(fault("the manifest lists no database; the backup is incomplete"));
    }
    check_keys(&from.join(BLOBS), keys).await?;
    if manifest.files.contains_key(ENCRYPTED_DATABASE) {
        // Before anything is written; the content is dropped.
        keys.decrypt_file(ENCRYPTED_DATABASE, &mut File::open(from.join(ENCRYPTED_DATABASE))?, &mut io::sink())?;
    }
    create_private(data)?;
    let _held = lock(data)?;
    if is_unfinished(data)? {
        remove_store(data)?;
    }
    if data.join(DATABASE).exists() || data.join(BLOBS).exists() {
        return Err(fault(format!("{} has a store already; name an empty directory", data.display())));
    }
    mark_unfinished(data)?;
    let done = put_back(from, data, &manifest, keys).await.map(|()| report_of(&files));
    if done.is_err() {
        // The directory was empty, so everything removed here came from the backup.
        remove_store(data)?;
    }
    mark_finished(data)?;
    done
}

fn remove_store(data: &Path) -> Result<(), StoreError> {
    sqlite::remove(data)?;
    Ok(remove_directory(&data.join(BLOBS))?)
}

async fn put_back(from: &Path, data: &Path, manifest: &Manifest, keys: &Keyring) -> Result<(), StoreError> {
    // The database comes last: without it the directory counts as empty.
    let mut files: Vec<&String> = manifest.files.keys().collect();
    files.sort_by_key(|name| [DATABASE, ENCRYPTED_DATABASE].contains(&name.as_str()));
    for name in files {
        if name == ENCRYPTED_DATABASE {
            let mut to = File::create(data.join(DATABASE))?;
            keys.decrypt_file(name, &mut File::open(from.join(name))?, &mut to)?;
            to.sync_all()?;
            continue;
        }
        let target = data.join(safe(name)?);
        if let Some(parent) = target.parent() {
            create_private(parent)?;
        }
        copy(&from.join(name), &target, key_of(name))?;
    }
    let check = SqliteMeta::open_beside(data).await?;
    check.check().await?;
    // The anchor belongs to the audit log of the original directory, which a backup does not hold.
    check.clear_audit_anchor().await?;
    check.close().await;
    Ok(())
}

/// The path of a file in the backup; absolute paths and `..` are refused.
fn safe(name: &str) -> Result<PathBuf, StoreError> {
    let path = PathBuf::from(name);
    let plain = path.components().all(|c| matches!(c, Component::Normal(_)));
    if plain && !name.is_empty() { Ok(path) } else { Err(fault(format!("`{name}` is not a path inside the backup"))) }
}
