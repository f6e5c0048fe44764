use std::fmt;
use std::fs::File;
use std::path::Path as FsPath;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use bytes::Bytes;
use futures::{StreamExt, TryStreamExt};
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt, PutPayload, WriteMultipart};
use sha2::{Digest, Sha256};
use uuid::Uuid;

use super::directory::Watched;
use super::records::hex;
use super::room::Room;
use super::{SessionId, StoreError, seal};

/// Key, size and hash of a stored blob.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlobInfo {
    /// Key: `<session>/<uuid>.sealed`.
    pub key: String,
    /// Length of the content, bytes.
    pub bytes: u64,
    /// SHA-256 of the content, hexadecimal.
    pub sha256: String,
}

/// Key of the object that holds the name of the database that owns the bucket or directory.
const NAME: &str = "belongs-to";

/// Longest wait of a caller for a removal, which continues in the background.
const REMOVED: Duration = Duration::from_secs(2);

/// Immutable values under keys that are never used twice.
///
/// A blob exists complete and synced, or not at all. Behind it is an [`ObjectStore`]: files, memory or an S3-compatible bucket.
#[derive(Clone)]
pub struct Blobs {
    objects: Arc<dyn ObjectStore>,
    /// Directory of the files, where unfinished uploads are found; `None` for other object stores.
    root: Option<Arc<FsPath>>,
    watched: Option<Arc<Watched>>,
    room: Arc<Room>,
}

impl fmt::Debug for Blobs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Blobs").field("root", &self.root).finish()
    }
}

impl Blobs {
    pub(super) fn in_directory(root: &FsPath) -> Result<Self, StoreError> {
        std::fs::create_dir_all(root)?;
        let local = LocalFileSystem::new_with_prefix(root)?.with_fsync(true).with_automatic_cleanup(true);
        let watched = Watched::new(root, File::open(root).ok())?;
        Ok(Self {
            objects: Arc::new(local),
            root: Some(Arc::from(root)),
            watched: Some(Arc::new(watched)),
            room: Arc::default(),
        })
    }

    pub(super) fn over(objects: Arc<dyn ObjectStore>) -> Self {
        Self { objects, root: None, watched: None, room: Arc::default() }
    }

    /// The same blobs with `room` on the disk of their directory; others keep no room.
    pub(super) fn with_room(self, room: Arc<Room>) -> Self {
        if self.root.is_some() { Self { room, ..self } } else { self }
    }

    pub(super) fn root(&self) -> Option<&FsPath> {
        self.root.as_deref()
    }

    /// Checks that the directory of the files is still the one that was opened; a write would make it anew.
    pub(super) fn check_directory(&self) -> Result<(), StoreError> {
        self.watched.as_ref().map_or(Ok(()), |watched| watched.check())
    }

    /// The name of the database that owns this bucket or directory, if it is recorded.
    pub(super) async fn name(&self) -> Result<Option<String>, StoreError> {
        match self.objects.get(&Path::from(NAME)).await {
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            found => Ok(Some(String::from_utf8_lossy(&found?.bytes().await?).into_owned())),
        }
    }

    pub(super) async fn set_name(&self, name: &str) -> Result<(), StoreError> {
        self.objects.put(&Path::from(NAME), PutPayload::from(name.to_owned())).await?;
        Ok(())
    }

    /// Checks that this process may write and read blobs, with a small blob under the id of no session.
    pub(super) async fn check_writing(&self) -> Result<(), StoreError> {
        let key = fresh_key(SessionId::new());
        self.objects.put(&key, PutPayload::from_static(b"try")).await?;
        self.objects.get(&key).await?.bytes().await?;
        // The result of the removal is not part of the check.
        let blobs = self.clone();
        tokio::spawn(async move { blobs.remove_now(vec![key]).await });
        Ok(())
    }

    /// Stores `bytes` for a session.
    ///
    /// # Errors
    /// [`StoreError::Blob`].
    pub async fn put(&self, session: SessionId, bytes: Vec<u8>) -> Result<BlobInfo, StoreError> {
        let key = fresh_key(session);
        let hash = Sha256::digest(&bytes);
        let info = BlobInfo { key: key.to_string(), bytes: bytes.len() as u64, sha256: hex(&hash) };
        let seal = Bytes::from_owner(seal::seal(&info.key, &hash));
        self.check_directory()?;
        self.room.check()?;
        self.objects.put(&key, PutPayload::from_iter([Bytes::from(bytes), seal])).await?;
        self.check_directory()?;
        Ok(info)
    }

    /// Begins a blob that arrives in pieces and may grow to `max_bytes`.
    ///
    /// An upload that is dropped unfinished leaves nothing behind.
    ///
    /// # Errors
    /// [`StoreError::Blob`].
    pub async fn upload(&self, session: SessionId, max_bytes: u64) -> Result<Upload, StoreError> {
        let key = fresh_key(session);
        self.check_directory()?;
        self.room.check()?;
        let writer = WriteMultipart::new(self.objects.put_multipart(&key).await?);
        Ok(Upload { blobs: self.clone(), key, writer, hash: Sha256::new(), bytes: 0, max_bytes })
    }

    /// The whole content of a blob, checked against its seal.
    ///
    /// A part of a blob cannot be read, because it could not be checked.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::Blob`].
    pub async fn get(&self, key: &str) -> Result<Bytes, StoreError> {
        seal::open(key, self.objects.get(&Path::from(key)).await?.bytes().await?).await
    }

    /// Reads a blob in pieces and checks its seal; returns its stored length, bytes.
    ///
    /// # Errors
    /// As [`Blobs::get`].
    pub(super) async fn check(&self, key: &str) -> Result<u64, StoreError> {
        let mut pieces = self.objects.get(&Path::from(key)).await?.into_stream();
        let (mut check, mut bytes) = (seal::Check::new(), 0);
        while let Some(piece) = pieces.try_next().await? {
            bytes += piece.len() as u64;
            check.read(&piece);
        }
        if check.finds_whole(key) { Ok(bytes) } else { Err(StoreError::Damaged { key: key.to_owned() }) }
    }

    /// Removes a blob that no row names any more.
    ///
    /// A missing blob is not an error. The caller waits 2 s at most; the removal continues in the background, and a sweep removes
    /// what it leaves.
    pub async fn delete(&self, key: &str) {
        self.remove(vec![key.to_owned()]).await;
    }

    /// Removes blobs that no row names any more, as [`Blobs::delete`].
    pub(super) async fn remove(&self, keys: Vec<String>) {
        if keys.is_empty() {
            return;
        }
        let blobs = self.clone();
        aside(async move { blobs.remove_now(keys.into_iter().map(Path::from).collect()).await }).await;
    }

    /// Removes every blob of a deleted session, as [`Blobs::delete`].
    pub async fn delete_session(&self, session: SessionId) {
        let blobs = self.clone();
        aside(async move {
            let listed = blobs.objects.list(Some(&Path::from(session.to_string()))).map_ok(|o| o.location);
            match listed.try_collect().await {
                Ok(keys) => blobs.remove_now(keys).await,
                Err(error) => tracing::warn!(%error, "the blobs of a session cannot be listed"),
            }
        })
        .await;
    }

    async fn remove_now(&self, keys: Vec<Path>) {
        if let Err(error) = self.check_directory() {
            tracing::warn!(%error, "blobs are not removed; a sweep finds them");
            return;
        }
        let mut removed = self.objects.delete_stream(futures::stream::iter(keys.into_iter().map(Ok)).boxed());
        while let Some(removed) = removed.next().await {
            match removed {
                Ok(_) | Err(object_store::Error::NotFound { .. }) => {}
                Err(error) => tracing::warn!(%error, "a blob could not be removed"),
            }
        }
    }

    /// Keys of all blobs, and names of unfinished uploads, that have not changed for `age`.
    pub(super) async fn older_than(&self, age: Duration) -> Result<Vec<String>, StoreError> {
        let Some(root) = &self.root else {
            let listed: Vec<_> = self.objects.list(None).try_collect().await?;
            let old = |o: &object_store::ObjectMeta| is_older(SystemTime::from(o.last_modified), age);
            let keys = listed.into_iter().filter(old).map(|o| o.location.to_string());
            // Other objects in the bucket are not ours and stay.
            return Ok(keys.filter(|key| is_key(key)).collect());
        };
        let mut found = Vec::new();
        let mut sessions = tokio::fs::read_dir(root).await?;
        while let Some(session) = sessions.next_entry().await? {
            if !session.file_type().await?.is_dir() {
                continue;
            }
            let mut files = tokio::fs::read_dir(session.path()).await?;
            while let Some(file) = files.next_entry().await? {
                // A file that was removed meanwhile needs no removal.
                let Ok(changed) = file.metadata().await.and_then(|m| m.modified()) else { continue };
                if is_older(changed, age) {
                    let (session, file) = (session.file_name(), file.file_name());
                    found.push(format!("{}/{}", session.to_string_lossy(), file.to_string_lossy()));
                }
            }
        }
        Ok(found)
    }

    /// Removes blobs and unfinished uploads by the names from [`Blobs::older_than`]; returns their number.
    pub(super) async fn remove_files(&self, names: &[String]) -> Result<usize, StoreError> {
        for name in names {
            let Some(root) = &self.root else {
                self.remove_now(vec![Path::from(name.as_str())]).await;
                continue;
            };
            match tokio::fs::remove_file(root.join(name)).await {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.into()),
                _ => {}
            }
            if let Some(session) = root.join(name).parent() {
                // Fails, as intended, while the directory is not empty.
                tokio::fs::remove_dir(session).await.ok();
            }
        }
        Ok(names.len())
    }
}

/// Runs `work` in the background and waits at most [`REMOVED`] for its end.
async fn aside(work: impl Future<Output = ()> + Send + 'static) {
    if tokio::time::timeout(REMOVED, tokio::spawn(work)).await.is_err() {
        tracing::warn!("the removal of blobs takes longer than 2 s and continues in the background");
    }
}

fn is_older(changed: SystemTime, age: Duration) -> bool {
    // If the clock was set back, nothing counts as old.
    changed.elapsed().is_ok_and(|elapsed| elapsed >= age)
}

/// Whether a string has the form of a blob's key.
fn is_key(key: &str) -> bool {
    let key = key.strip_suffix(seal::SEALED).unwrap_or(key);
    key.split_once('/').is_some_and(|(session, value)| [session, value].iter().all(|id| Uuid::try_parse(id).is_ok()))
}

fn fresh_key(session: SessionId) -> Path {
    Path::from(format!("{session}/{}{}", Uuid::now_v7(), seal::SEALED))
}

/// A blob that is being uploaded in pieces.
pub struct Upload {
    blobs: Blobs,
    key: Path,
    writer: WriteMultipart,
    hash: Sha256,
    bytes: u64,
    max_bytes: u64,
}

impl fmt::Debug for Upload {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Upload").field("key", &self.key).field("bytes", &self.bytes).finish_non_exhaustive()
    }
}

impl Upload {
    /// Appends a piece; waits while the object store is slower than the sender.
    ///
    /// # Errors
    /// [`StoreError::TooLarge`] when the upload exceeds its limit, else [`StoreError::Blob`].
    pub async fn write(&mut self, piece: Bytes) -> Result<(), StoreError> {
        self.bytes += piece.len() as u64;
        if self.bytes > self.max_bytes {
            return Err(StoreError::TooLarge { allowed: self.max_bytes });
        }
        self.blobs.room.check()?;
        self.hash.update(&piece);
        self.writer.wait_for_capacity(4).await?;
        self.writer.put(piece);
        Ok(())
    }

    /// Completes the blob and makes it visible.
    ///
    /// # Errors
    /// [`StoreError::Blob`].
    pub async fn finish(mut self) -> Result<BlobInfo, StoreError> {
        let (key, hash) = (self.key.to_string(), self.hash.finalize());
        self.writer.put(Bytes::from_owner(seal::seal(&key, &hash)));
        self.blobs.check_directory()?;
        self.writer.finish().await?;
        self.blobs.check_directory()?;
        Ok(BlobInfo { key, bytes: self.bytes, sha256: hex(&hash) })
    }

    /// Aborts the upload and removes what was written.
    pub async fn abort(self) {
        if let Err(error) = self.writer.abort().await {
            tracing::warn!(%error, "an unfinished upload could not be removed");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sha256_hex;

    fn files_below(root: &FsPath) -> usize {
        std::fs::read_dir(root)
            .unwrap()
            .map(|e| e.unwrap().path())
            .map(|p| if p.is_dir() { files_below(&p) } else { 1 })
            .sum()
    }

    #[tokio::test]
    async fn an_upload_arrives_whole_or_leaves_nothing() {
        let directory = tempfile::tempdir().unwrap();
        let blobs = Blobs::in_directory(directory.path()).unwrap();
        let session = SessionId::new();
        let mut upload = blobs.upload(session, 10).await.unwrap();
        upload.write(Bytes::from_static(b"hello ")).await.unwrap();
        upload.write(Bytes::from_static(b"you")).await.unwrap();
        let info = upload.finish().await.unwrap();
        assert_eq!((info.bytes, info.sha256.clone()), (9, sha256_hex(b"hello you")));
        assert_eq!(blobs.get(&info.key).await.unwrap().as_ref(), b"hello you");

        let mut upload = blobs.upload(session, 10).await.unwrap();
        upload.write(Bytes::from_static(b"12345678")).await.unwrap();
        let refused = upload.write(Bytes::from_static(b"901")).await;
        assert!(matches!(refused, Err(StoreError::TooLarge { allowed: 10 })));
        upload.abort().await;
        assert_eq!(files_below(directory.path()), 1);

        blobs.delete_session(session).await;
        assert_eq!(files_below(directory.path()), 0);
    }

    #[tokio::test]
    async fn unfinished_uploads_are_found_by_their_age() {
        let directory = tempfile::tempdir().unwrap();
        let blobs = Blobs::in_directory(directory.path()).unwrap();
        let session = SessionId::new();
        let kept = blobs.put(session, b"kept".to_vec()).await.unwrap();
        // The file that a killed process leaves of an upload.
        std::fs::write(directory.path().join(session.to_string()).join("x#1"), b"part").unwrap();
        assert_eq!(blobs.older_than(Duration::from_secs(600)).await.unwrap(), Vec::<String>::new());
        let all = blobs.older_than(Duration::ZERO).await.unwrap();
        assert_eq!(all.len(), 2);
        let half: Vec<String> = all.into_iter().filter(|name| *name != kept.key).collect();
        assert_eq!(blobs.remove_files(&half).await.unwrap(), 1);
        assert_eq!(blobs.get(&kept.key).await.unwrap().as_ref(), b"kept");
        assert_eq!(files_below(directory.path()), 1);
    }
}
