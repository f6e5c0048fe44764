use std::collections::BTreeMap;
use std::path::Path;

use futures::future::BoxFuture;

use super::directory::BLOBS;
use super::seal::Encryption;
use super::sqlite::{DATABASE, SqliteMeta};
use super::{Blobs, MetaStore, Store, StoreError, seal};

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
    /// Keys of blobs that do not match their seal.
    pub damaged: Vec<String>,
    /// Keys of blobs that a row names and that do not exist.
    pub missing: Vec<String>,
}

/// Reads and checks every blob of the local store in `data`, also while a service uses it.
///
/// # Errors
/// [`StoreError::Missing`] when the directory has no local store, else the database's or the disk's.
pub fn scrub(data: &Path) -> BoxFuture<'_, Result<ScrubReport, StoreError>> {
    Box::pin(async move {
        if !data.join(DATABASE).is_file() || !data.join(BLOBS).is_dir() {
            return Err(StoreError::Missing { directory: data.display().to_string() });
        }
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
        Ok(report)
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
            if let Some(encryption) = read_through(self.blobs(), &key, &mut report).await? {
                report.renewed += usize::from(self.encrypt_again(&key, &encryption).await?);
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

    async fn encrypt_again(&self, key: &str, encryption: &Encryption) -> Result<bool, StoreError> {
        match self.blobs().renew(key, encryption).await {
            // Deleted meanwhile, or no room now: the next round sees it again.
            Err(StoreError::BlobGone { .. } | StoreError::NoRoom { .. }) => Ok(false),
            done => done,
        }
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
