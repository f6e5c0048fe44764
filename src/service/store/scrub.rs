use std::collections::BTreeMap;
use std::path::Path;

use futures::future::BoxFuture;

use super::backup::check_keys;
use super::directory::BLOBS;
use super::seal::Encryption;
use super::sqlite::{DATABASE, SqliteMeta};
use super::{Blobs, Keyring, MetaStore, Store, StoreError, seal};

/// Result of reading and checking blobs.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ScrubReport {
    /// Number of blobs read.
    pub values: usize,
    /// Total size of the blobs, bytes.
    pub bytes: u64,
    /// Number of blobs without a seal, from versions that wrote none; damage in them cannot be found.
    pub unsealed: usize,
    /// Number of encrypted blobs by the id of their key.
    pub encrypted: BTreeMap<String, usize>,
    /// Number of blobs that were stored again because they were not encrypted with the first key.
    pub renewed: usize,
    /// Number of blobs for which that was not possible.
    pub left: usize,
    /// Keys of blobs that do not match their seal.
    pub damaged: Vec<String>,
    /// Keys of blobs that a row names and that do not exist.
    pub missing: Vec<String>,
}

/// Reads and checks every blob of the local store in `data`, also while a service uses it.
///
/// # Errors
/// [`StoreError::Missing`] when the directory has no local store, [`StoreError::KeyUnknown`] when blobs are encrypted with a key
/// that is not among `keys`, else the database's or the disk's.
pub fn scrub<'a>(data: &'a Path, keys: &'a Keyring) -> BoxFuture<'a, Result<ScrubReport, StoreError>> {
    Box::pin(async move {
        if !data.join(DATABASE).is_file() || !data.join(BLOBS).is_dir() {
            return Err(StoreError::Missing { directory: data.display().to_string() });
        }
        check_keys(&data.join(BLOBS), keys).await?;
        let meta = SqliteMeta::open_beside(data).await?;
        let blobs = Blobs::in_directory(&data.join(BLOBS))?;
        let mut report = ScrubReport::default();
        for key in meta.named_blobs().await? {
            read_through(&blobs, &key, &mut report).await?;
        }
        // A blob that no row names any more was deleted meanwhile, not lost.
        let named = meta.named_blobs().await?;
        report.missing.retain(|key| named.contains(key));
        meta.close().await;
        // The marks that were checked first may be lost.
        match report.encrypted.keys().find(|id| keys.ids().all(|key| key != **id)) {
            Some(id) => Err(StoreError::KeyUnknown { id: id.clone() }),
            None => Ok(report),
        }
    })
}

impl Store {
    /// Reads and checks the blobs with keys after `after`, until `most_bytes` bytes are read.
    ///
    /// Those that are not encrypted with the first key of the store are stored again.
    ///
    /// Returns the findings and the last key; `None` instead of the key after the last blob.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn scrub(&self, after: &str, most_bytes: u64) -> Result<(ScrubReport, Option<String>), StoreError> {
        let mut report = ScrubReport::default();
        let (mut last, mut is_end) = (None, true);
        for key in self.meta().named_blobs().await?.into_iter().filter(|key| key.as_str() > after) {
            if report.bytes >= most_bytes {
                is_end = false;
                break;
            }
            if let Some(encryption) = read_through(self.blobs(), &key, &mut report).await?
                && self.blobs().is_outdated(&key, &encryption)
            {
                match self.encrypt_again(&key).await? {
                    true => report.renewed += 1,
                    false => report.left += 1,
                }
            }
            last = Some(key);
        }
        if !report.missing.is_empty() {
            // A blob that no row names any more was deleted meanwhile, not lost.
            let named = self.meta().named_blobs().await?;
            report.missing.retain(|key| named.contains(key));
        }
        Ok((report, last.filter(|_| !is_end)))
    }

    /// Stores a blob again with the first key; false when that is not possible now.
    async fn encrypt_again(&self, key: &str) -> Result<bool, StoreError> {
        match self.blobs().renew(key).await {
            Ok(()) => {}
            Err(StoreError::BlobGone { .. }) => return Ok(true),
            Err(error @ (StoreError::NoRoom { .. } | StoreError::KeyUnknown { .. } | StoreError::Damaged { .. })) => {
                tracing::warn!(key, %error, "a value is not encrypted with the first key");
                return Ok(false);
            }
            Err(error) => return Err(error),
        }
        // A blob that was deleted meanwhile was stored once more.
        if !self.meta().named_blobs().await?.contains(key) {
            self.blobs().delete(key).await;
        }
        Ok(true)
    }

    /// Notes, after a round through all blobs that left none, that the first key alone is in use.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn forget_other_keys(&self) -> Result<(), StoreError> {
        self.blobs().forget_other_keys().await
    }
}

/// Adds a blob to the report; returns its encryption if it is whole.
async fn read_through(blobs: &Blobs, key: &str, report: &mut ScrubReport) -> Result<Option<Encryption>, StoreError> {
    report.values += 1;
    report.unsealed += usize::from(!seal::is_sealed(key));
    match blobs.check(key).await {
        Ok((bytes, encryption)) => {
            report.bytes += bytes;
            if let Some(id) = &encryption {
                *report.encrypted.entry(id.clone()).or_default() += 1;
            }
            return Ok(Some(encryption));
        }
        Err(StoreError::Damaged { .. }) => report.damaged.push(key.to_owned()),
        Err(StoreError::BlobGone { .. }) => report.missing.push(key.to_owned()),
        Err(error) => return Err(error),
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance::{part_with, session};
    use crate::{PartKind, StoreLocation};

    #[tokio::test]
    async fn values_are_encrypted_again_until_none_has_the_old_key() {
        let directory = tempfile::tempdir().unwrap();
        let [old, new] = [1, 2].map(|byte| format!("{byte:02x}").repeat(32));
        let open = async |keys: &[&String]| {
            let keys = Keyring::new(keys.iter().map(|key| key.as_str())).unwrap();
            Store::open_at(directory.path(), &StoreLocation { keys, ..StoreLocation::default() }).await
        };
        let store = open(&[]).await.unwrap();
        let kept = session("local");
        store.insert_session(&kept, None).await.unwrap();
        let skin = store.blobs().put(kept.id, b"skin".to_vec()).await.unwrap();
        store.put_parts(kept.id, &[part_with(PartKind::Skin, &skin)]).await.unwrap();
        store.close().await;
        drop(store);

        let store = open(&[&old]).await.unwrap();
        let skull = store.blobs().put(kept.id, b"skull".to_vec()).await.unwrap();
        store.put_parts(kept.id, &[part_with(PartKind::Skull, &skull)]).await.unwrap();
        store.close().await;
        drop(store);
        assert!(matches!(open(&[]).await, Err(StoreError::KeyUnknown { .. })));

        let store = open(&[&new, &old]).await.unwrap();
        let (found, next) = store.scrub("", u64::MAX).await.unwrap();
        assert_eq!((found.values, found.renewed, found.left, next), (2, 2, 0, None));
        // A value that nothing names any more, as after a deletion in between, is not brought back.
        store.delete_part(kept.id, PartKind::Skull).await.unwrap();
        assert!(matches!(store.encrypt_again(&skull.key).await, Ok(true)));
        let gone = store.blobs().put(kept.id, b"gone".to_vec()).await.unwrap();
        assert!(store.encrypt_again(&gone.key).await.unwrap());
        for key in [&skull.key, &gone.key] {
            assert!(matches!(store.blobs().get(key).await, Err(StoreError::BlobGone { .. })));
        }
        store.close().await;
        drop(store);
        assert!(
            matches!(open(&[&new]).await, Err(StoreError::KeyUnknown { .. })),
            "it is not known yet that none is left"
        );
        let store = open(&[&new, &old]).await.unwrap();
        store.forget_other_keys().await.unwrap();
        store.close().await;
        drop(store);
        let store = open(&[&new]).await.unwrap();
        assert_eq!(store.blobs().get(&skin.key).await.unwrap().as_ref(), b"skin");
    }
}
