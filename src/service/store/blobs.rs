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
use super::key_marks::MARKS;
use super::records::hex;
use super::room::Room;
use super::seal::{Encryption, Form};
use super::upload::Place;
use super::{BlobInfo, Keyring, SessionId, StoreError, Upload, key_marks, seal};

/// Key of the object that holds the name of the database that owns the bucket or directory.
const NAME: &str = "belongs-to";

/// Bytes that are encrypted before other tasks get a turn.
const TURN: usize = 1 << 20;

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
    place: Place,
    keys: Keyring,
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
            place: Place { watched: Some(Arc::new(watched)), room: Arc::default() },
            keys: Keyring::default(),
        })
    }

    pub(super) fn over(objects: Arc<dyn ObjectStore>) -> Self {
        Self { objects, root: None, place: Place::default(), keys: Keyring::default() }
    }

    /// The same blobs with `room` on the disk of their directory; others keep no room.
    pub(super) fn with_room(self, room: Arc<Room>) -> Self {
        if self.root.is_some() { Self { place: Place { room, ..self.place }, ..self } } else { self }
    }

    /// The same blobs, encrypted with the first of `keys`; the others decrypt older ones.
    ///
    /// # Errors
    /// [`StoreError::KeyUnknown`] when blobs are encrypted with a key that is not among them.
    pub(super) async fn with_keys(self, keys: Keyring) -> Result<Self, StoreError> {
        let blobs = Self { keys, ..self };
        blobs.check_directory()?;
        key_marks::check_and_mark(blobs.objects.as_ref(), &blobs.keys).await?;
        Ok(blobs)
    }

    /// Notes that no blob is encrypted with another key than the first.
    pub(super) async fn forget_other_keys(&self) -> Result<(), StoreError> {
        self.check_directory()?;
        key_marks::keep_first(self.objects.as_ref(), &self.keys).await
    }

    pub(super) fn root(&self) -> Option<&FsPath> {
        self.root.as_deref()
    }

    /// Checks that the directory of the files is still the one that was opened; a write would make it anew.
    pub(super) fn check_directory(&self) -> Result<(), StoreError> {
        self.place.check_directory()
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
        let length = bytes.len() as u64;
        let hash = self.store(&key, bytes.into()).await?;
        Ok(BlobInfo { key: key.to_string(), bytes: length, sha256: hex(&hash) })
    }

    /// Stores `content` under `key`, whatever was there; returns its SHA-256.
    async fn store(&self, key: &Path, content: Bytes) -> Result<[u8; 32], StoreError> {
        let hash = Sha256::digest(&content);
        let (stored, seal) = match self.keys.encrypt(key.as_ref())? {
            None => {
                let seal = seal::seal(key.as_ref(), &hash, Form::Plain);
                (content, seal)
            }
            Some(mut encrypting) => {
                let mut stored = Vec::with_capacity(content.len() + content.len() / 1000 + 1024);
                for part in content.chunks(TURN) {
                    stored.extend(encrypting.add(part)?);
                    // A large value takes long: other tasks get a turn.
                    tokio::task::yield_now().await;
                }
                stored.extend(encrypting.end()?);
                let seal = seal::seal(key.as_ref(), &Sha256::digest(&stored), Form::Encrypted);
                (stored.into(), seal)
            }
        };
        self.place.check()?;
        self.objects.put(key, PutPayload::from_iter([stored, Bytes::from_owner(seal)])).await?;
        self.check_directory()?;
        Ok(hash.into())
    }

    /// Whether a blob with this encryption is to be encrypted as new ones are.
    pub(super) fn is_outdated(&self, key: &str, found: &Encryption) -> bool {
        let first = self.keys.first_id().map(|id| hex(&id));
        first.is_some() && *found != first && seal::is_sealed(key)
    }

    /// Stores a blob again, encrypted as new ones are.
    pub(super) async fn renew(&self, key: &str) -> Result<(), StoreError> {
        self.store(&Path::from(key), self.get(key).await?).await?;
        Ok(())
    }

    /// Begins a blob that arrives in pieces and may grow to `max_bytes`.
    ///
    /// An upload that is dropped unfinished leaves nothing behind.
    ///
    /// # Errors
    /// [`StoreError::Blob`].
    pub async fn upload(&self, session: SessionId, max_bytes: u64) -> Result<Upload, StoreError> {
        let key = fresh_key(session);
        self.place.check()?;
        let writer = WriteMultipart::new(self.objects.put_multipart(&key).await?);
        let encrypting = self.keys.encrypt(key.as_ref())?.map(|encrypting| (encrypting, Sha256::new()));
        Ok(Upload { place: self.place.clone(), key, writer, hash: Sha256::new(), encrypting, bytes: 0, max_bytes })
    }

    /// The whole content of a blob, checked against its seal.
    ///
    /// A part of a blob cannot be read, because it could not be checked.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::KeyUnknown`], [`StoreError::Blob`].
    pub async fn get(&self, key: &str) -> Result<Bytes, StoreError> {
        let stored = self.objects.get(&Path::from(key)).await?.bytes().await?;
        match seal::open(key, stored).await? {
            (content, Form::Plain) => Ok(content),
            (encrypted, Form::Encrypted) => Ok(self.keys.open(key, &encrypted).await?.into()),
        }
    }

    /// Reads a blob in pieces and checks its seal; returns its stored length, bytes, and its encryption.
    ///
    /// # Errors
    /// As [`Blobs::get`].
    pub(super) async fn check(&self, key: &str) -> Result<(u64, Encryption), StoreError> {
        let mut pieces = self.objects.get(&Path::from(key)).await?.into_stream();
        let (mut check, mut bytes) = (seal::Check::new(), 0);
        while let Some(piece) = pieces.try_next().await? {
            bytes += piece.len() as u64;
            check.read(&piece);
        }
        let encryption = check.finds(key).ok_or_else(|| StoreError::Damaged { key: key.to_owned() })?;
        Ok((bytes, encryption))
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
            if !session.file_type().await?.is_dir() || session.file_name() == MARKS {
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

    fn ring(keys: &[u8]) -> Keyring {
        let texts: Vec<String> = keys.iter().map(|key| hex(&[*key; 32])).collect();
        Keyring::new(texts.iter().map(String::as_str)).unwrap()
    }

    /// Whether any file below `root` contains `text`.
    fn is_on_disk(root: &FsPath, text: &[u8]) -> bool {
        std::fs::read_dir(root).unwrap().map(|e| e.unwrap().path()).any(|p| {
            if p.is_dir() {
                is_on_disk(&p, text)
            } else {
                std::fs::read(p).unwrap().windows(text.len()).any(|w| w == text)
            }
        })
    }

    #[tokio::test]
    async fn values_are_encrypted_and_the_key_can_be_changed() {
        const FACE: &[u8] = b"a recognisable face";
        let directory = tempfile::tempdir().unwrap();
        let open = async |keys: &[u8]| Blobs::in_directory(directory.path()).unwrap().with_keys(ring(keys)).await;
        let session = SessionId::new();
        let plain = open(&[]).await.unwrap().put(session, FACE.to_vec()).await.unwrap();
        // Content that looks encrypted.
        let odd =
            open(&[]).await.unwrap().put(session, b"PROSENC1 and so on, longer than a header".to_vec()).await.unwrap();
        assert!(is_on_disk(directory.path(), FACE));

        let blobs = open(&[1]).await.unwrap();
        let put = blobs.put(session, FACE.to_vec()).await.unwrap();
        let mut upload = blobs.upload(session, 1000).await.unwrap();
        for piece in FACE.chunks(7) {
            upload.write(Bytes::copy_from_slice(piece)).await.unwrap();
        }
        let sent = upload.finish().await.unwrap();
        assert_eq!((&sent.sha256, sent.bytes), (&put.sha256, put.bytes));
        assert_eq!((put.sha256.as_str(), put.bytes), (sha256_hex(FACE).as_str(), FACE.len() as u64));
        for info in [&plain, &put, &sent] {
            assert_eq!(blobs.get(&info.key).await.unwrap().as_ref(), FACE);
        }
        assert!(blobs.get(&odd.key).await.unwrap().starts_with(b"PROSENC1"));

        for wrong in [&[][..], &[2]] {
            assert!(matches!(open(wrong).await, Err(StoreError::KeyUnknown { .. })));
        }
        let both = open(&[2, 1]).await.unwrap();
        for info in [&plain, &odd, &put, &sent] {
            let (_, encryption) = both.check(&info.key).await.unwrap();
            assert!(both.is_outdated(&info.key, &encryption));
            both.renew(&info.key).await.unwrap();
            let (_, encryption) = both.check(&info.key).await.unwrap();
            assert!(!both.is_outdated(&info.key, &encryption));
        }
        assert!(!is_on_disk(directory.path(), FACE));
        assert!(matches!(open(&[2]).await, Err(StoreError::KeyUnknown { .. })), "some may still have the old key");
        both.forget_other_keys().await.unwrap();
        assert_eq!(both.older_than(Duration::ZERO).await.unwrap().len(), 4);
        let renewed = open(&[2]).await.unwrap();
        for info in [&plain, &put, &sent] {
            assert_eq!(renewed.get(&info.key).await.unwrap().as_ref(), FACE);
        }
        let file = directory.path().join(&put.key);
        let mut damaged = std::fs::read(&file).unwrap();
        damaged[40] ^= 1;
        std::fs::write(file, damaged).unwrap();
        assert!(matches!(renewed.get(&put.key).await, Err(StoreError::Damaged { .. })));
        assert!(matches!(renewed.check(&put.key).await, Err(StoreError::Damaged { .. })));
    }
}
