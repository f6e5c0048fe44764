use std::fmt;
use std::sync::Arc;

use bytes::Bytes;
use object_store::WriteMultipart;
use object_store::path::Path;
use sha2::{Digest, Sha256};

use super::StoreError;
use super::directory::Watched;
use super::encryption::Encrypting;
use super::records::hex;
use super::room::Room;
use super::seal::{self, Form};

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

/// The directory of the files and the room on its disk; other object stores have neither.
#[derive(Debug, Clone, Default)]
pub(super) struct Place {
    pub(super) watched: Option<Arc<Watched>>,
    pub(super) room: Arc<Room>,
}

impl Place {
    /// Checks that the directory is still the one that was opened.
    pub(super) fn check_directory(&self) -> Result<(), StoreError> {
        self.watched.as_ref().map_or(Ok(()), |watched| watched.check())
    }

    /// Checks that a blob may be written.
    pub(super) fn check(&self) -> Result<(), StoreError> {
        self.check_directory()?;
        self.room.check()
    }
}

/// A blob that is being uploaded in pieces.
pub struct Upload {
    pub(super) place: Place,
    pub(super) key: Path,
    pub(super) writer: WriteMultipart,
    /// Of the content.
    pub(super) hash: Sha256,
    /// With a key: what encrypts, and the hash of what it returned.
    pub(super) encrypting: Option<(Encrypting, Sha256)>,
    pub(super) bytes: u64,
    pub(super) max_bytes: u64,
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
        self.place.room.check()?;
        self.hash.update(&piece);
        self.writer.wait_for_capacity(4).await?;
        match &mut self.encrypting {
            None => self.writer.put(piece),
            Some((encrypting, hash)) => {
                let encrypted = encrypting.add(&piece)?;
                hash.update(&encrypted);
                self.writer.put(encrypted.into());
            }
        }
        Ok(())
    }

    /// Completes the blob and makes it visible.
    ///
    /// # Errors
    /// [`StoreError::Blob`].
    pub async fn finish(mut self) -> Result<BlobInfo, StoreError> {
        let (key, hash) = (self.key.to_string(), self.hash.finalize());
        let seal = match self.encrypting {
            None => seal::seal(&key, &hash, Form::Plain),
            Some((encrypting, mut stored)) => {
                let end = encrypting.end()?;
                stored.update(&end);
                self.writer.put(end.into());
                seal::seal(&key, &stored.finalize(), Form::Encrypted)
            }
        };
        self.writer.put(Bytes::from_owner(seal));
        self.place.check_directory()?;
        self.writer.finish().await?;
        self.place.check_directory()?;
        Ok(BlobInfo { key, bytes: self.bytes, sha256: hex(&hash) })
    }

    /// Aborts the upload and removes what was written.
    pub async fn abort(self) {
        if let Err(error) = self.writer.abort().await {
            tracing::warn!(%error, "an unfinished upload could not be removed");
        }
    }
}
