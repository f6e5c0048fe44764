use std::collections::BTreeSet;
use std::fmt;
use std::ops::Range;
use std::path::Path as FsPath;
use std::sync::Arc;

use axum::body::Bytes;
use futures::TryStreamExt;
use futures::stream::BoxStream;
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt, PutPayload, WriteMultipart};
use sha2::{Digest, Sha256};
use uuid::Uuid;

use super::records::hex;
use super::{SessionId, StoreError, sha256_hex};

/// What is known of a stored value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlobInfo {
    /// Where it is: `<session>/<uuid>`.
    pub key: String,
    /// Length.
    pub bytes: u64,
    /// SHA-256 of the content, hexadecimal.
    pub sha256: String,
}

/// Immutable values under keys that are never used twice. A value is there whole and synced, or not at all.
#[derive(Clone)]
pub struct Blobs {
    objects: Arc<dyn ObjectStore>,
    root: Arc<FsPath>,
}

impl fmt::Debug for Blobs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Blobs").field("root", &self.root).finish()
    }
}

impl Blobs {
    pub(super) fn open(root: &FsPath) -> Result<Self, StoreError> {
        std::fs::create_dir_all(root)?;
        let local = LocalFileSystem::new_with_prefix(root)?.with_fsync(true).with_automatic_cleanup(true);
        Ok(Self { objects: Arc::new(local), root: Arc::from(root) })
    }

    /// Stores `bytes` for a session.
    ///
    /// # Errors
    /// [`StoreError::Blob`].
    pub async fn put(&self, session: SessionId, bytes: Vec<u8>) -> Result<BlobInfo, StoreError> {
        let key = fresh_key(session);
        let info = BlobInfo { key: key.to_string(), bytes: bytes.len() as u64, sha256: sha256_hex(&bytes) };
        self.objects.put(&key, PutPayload::from(bytes)).await?;
        Ok(info)
    }

    /// Begins a value that arrives in pieces and may grow to `max_bytes`. Dropping it unfinished leaves nothing behind.
    ///
    /// # Errors
    /// [`StoreError::Blob`].
    pub async fn upload(&self, session: SessionId, max_bytes: u64) -> Result<Upload, StoreError> {
        let key = fresh_key(session);
        let writer = WriteMultipart::new(self.objects.put_multipart(&key).await?);
        Ok(Upload { key, writer, hash: Sha256::new(), bytes: 0, max_bytes })
    }

    /// The whole value.
    ///
    /// # Errors
    /// [`StoreError::Blob`].
    pub async fn get(&self, key: &str) -> Result<Bytes, StoreError> {
        Ok(self.objects.get(&Path::from(key)).await?.bytes().await?)
    }

    /// Bytes `range` of the value.
    ///
    /// # Errors
    /// [`StoreError::Blob`].
    pub async fn get_range(&self, key: &str, range: Range<u64>) -> Result<Bytes, StoreError> {
        Ok(self.objects.get_range(&Path::from(key), range).await?)
    }

    /// The value in pieces.
    ///
    /// # Errors
    /// [`StoreError::Blob`].
    pub async fn stream(&self, key: &str) -> Result<BoxStream<'static, object_store::Result<Bytes>>, StoreError> {
        Ok(self.objects.get(&Path::from(key)).await?.into_stream())
    }

    /// Removes a value; one that is not there is no error.
    pub async fn delete(&self, key: &str) {
        match self.objects.delete(&Path::from(key)).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => {}
            // Rows no longer name it, so the next start sweeps it.
            Err(error) => tracing::warn!(%error, "a blob could not be removed"),
        }
    }

    /// Removes every value of a session.
    ///
    /// # Errors
    /// [`StoreError::Blob`].
    pub async fn delete_session(&self, session: SessionId) -> Result<(), StoreError> {
        let keys = self.objects.list(Some(&Path::from(session.to_string()))).map_ok(|o| o.location);
        let keys: Vec<Path> = keys.try_collect().await?;
        for key in keys {
            self.delete(key.as_ref()).await;
        }
        Ok(())
    }

    /// Removes files whose key is not in `named`, unfinished uploads among them. Only at start, when nothing is written.
    pub(super) async fn sweep(&self, named: &BTreeSet<String>) -> Result<usize, StoreError> {
        let mut removed = 0;
        let mut sessions = tokio::fs::read_dir(&*self.root).await?;
        while let Some(session) = sessions.next_entry().await? {
            if !session.file_type().await?.is_dir() {
                continue;
            }
            let mut files = tokio::fs::read_dir(session.path()).await?;
            while let Some(file) = files.next_entry().await? {
                let key = format!("{}/{}", session.file_name().to_string_lossy(), file.file_name().to_string_lossy());
                if !named.contains(&key) {
                    tokio::fs::remove_file(file.path()).await?;
                    removed += 1;
                }
            }
            // Fails, as it should, while the directory holds something.
            tokio::fs::remove_dir(session.path()).await.ok();
        }
        Ok(removed)
    }
}

fn fresh_key(session: SessionId) -> Path {
    Path::from(format!("{session}/{}", Uuid::now_v7()))
}

/// A value on its way to disk.
pub struct Upload {
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
    /// Appends a piece; waits when the disk is slower than the sender.
    ///
    /// # Errors
    /// [`StoreError::TooLarge`] when the limit is passed, else [`StoreError::Blob`].
    pub async fn write(&mut self, piece: Bytes) -> Result<(), StoreError> {
        self.bytes += piece.len() as u64;
        if self.bytes > self.max_bytes {
            return Err(StoreError::TooLarge { allowed: self.max_bytes });
        }
        self.hash.update(&piece);
        self.writer.wait_for_capacity(4).await?;
        self.writer.put(piece);
        Ok(())
    }

    /// Completes the value and makes it visible.
    ///
    /// # Errors
    /// [`StoreError::Blob`].
    pub async fn finish(self) -> Result<BlobInfo, StoreError> {
        self.writer.finish().await?;
        Ok(BlobInfo { key: self.key.to_string(), bytes: self.bytes, sha256: hex(&self.hash.finalize()) })
    }

    /// Gives up and removes what was written.
    pub async fn abort(self) {
        if let Err(error) = self.writer.abort().await {
            tracing::warn!(%error, "an unfinished upload could not be removed");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let blobs = Blobs::open(directory.path()).unwrap();
        let session = SessionId::new();
        let mut upload = blobs.upload(session, 10).await.unwrap();
        upload.write(Bytes::from_static(b"hello ")).await.unwrap();
        upload.write(Bytes::from_static(b"you")).await.unwrap();
        let info = upload.finish().await.unwrap();
        assert_eq!((info.bytes, info.sha256.clone()), (9, sha256_hex(b"hello you")));
        assert_eq!(blobs.get(&info.key).await.unwrap().as_ref(), b"hello you");
        assert_eq!(blobs.get_range(&info.key, 6..9).await.unwrap().as_ref(), b"you");

        let mut upload = blobs.upload(session, 10).await.unwrap();
        upload.write(Bytes::from_static(b"12345678")).await.unwrap();
        let refused = upload.write(Bytes::from_static(b"901")).await;
        assert!(matches!(refused, Err(StoreError::TooLarge { allowed: 10 })));
        upload.abort().await;
        assert_eq!(files_below(directory.path()), 1);

        blobs.delete_session(session).await.unwrap();
        assert_eq!(files_below(directory.path()), 0);
    }

    #[tokio::test]
    async fn the_sweep_removes_what_no_row_names() {
        let directory = tempfile::tempdir().unwrap();
        let blobs = Blobs::open(directory.path()).unwrap();
        let session = SessionId::new();
        let kept = blobs.put(session, b"kept".to_vec()).await.unwrap();
        blobs.put(session, b"orphan".to_vec()).await.unwrap();
        // What a killed process leaves of an upload.
        std::fs::write(directory.path().join(session.to_string()).join("x#1"), b"part").unwrap();
        let named = BTreeSet::from([kept.key.clone()]);
        assert_eq!(blobs.sweep(&named).await.unwrap(), 2);
        assert_eq!(blobs.get(&kept.key).await.unwrap().as_ref(), b"kept");
    }
}
