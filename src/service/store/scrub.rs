use std::path::Path;

use futures::future::BoxFuture;

use super::directory::BLOBS;
use super::sqlite::{DATABASE, SqliteMeta};
use super::{Blobs, MetaStore, Store, StoreError, seal};

/// What reading through stored values found.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ScrubReport {
    /// Values read.
    pub values: usize,
    /// Their bytes.
    pub bytes: u64,
    /// Those among them that a version without seals wrote: whether they are whole is not known.
    pub unsealed: usize,
    /// Keys of values that are not what was stored.
    pub damaged: Vec<String>,
    /// Keys of values that rows name and that are not there.
    pub missing: Vec<String>,
}

/// Reads every value of the store in `data`, also while a service runs on it.
///
/// # Errors
/// [`StoreError::Missing`] where there is no store, else what the database or the disk says.
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
        // What went meanwhile was deleted, not lost.
        let named = meta.named_blobs().await?;
        report.missing.retain(|key| named.contains(key));
        meta.close().await;
        Ok(report)
    })
}

impl Store {
    /// Reads the values whose keys come after `after`, until some `most_bytes` are read: what was found, and the last key, or `None` at the
    /// end of all.
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
            read_through(self.blobs(), &key, &mut report).await?;
            last = Some(key);
        }
        if !report.missing.is_empty() {
            // What went meanwhile was deleted, not lost.
            let named = self.meta().named_blobs().await?;
            report.missing.retain(|key| named.contains(key));
        }
        Ok((report, last.filter(|_| !is_end)))
    }
}

async fn read_through(blobs: &Blobs, key: &str, report: &mut ScrubReport) -> Result<(), StoreError> {
    report.values += 1;
    report.unsealed += usize::from(!seal::is_sealed(key));
    match blobs.check(key).await {
        Ok(bytes) => report.bytes += bytes,
        Err(StoreError::Damaged { .. }) => report.damaged.push(key.to_owned()),
        Err(StoreError::BlobGone { .. }) => report.missing.push(key.to_owned()),
        Err(error) => return Err(error),
    }
    Ok(())
}
