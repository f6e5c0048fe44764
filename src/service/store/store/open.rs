//! Opening stores in a data directory, a database or a bucket.

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use futures::future::LocalBoxFuture;
use object_store::ObjectStore;
use uuid::Uuid;

use super::{Result, Store};
use crate::backup::remove_old_snapshot;
use crate::directory::{BLOBS, LOCAL_LOG, Watched, create_private, given_log_name, is_unfinished, lock, mark_finished};
use crate::location::{BucketUrl, StoreLocation};
use crate::look::Seen;
use crate::postgres::PostgresMeta;
use crate::room::Room;
use crate::sqlite::{self, SqliteMeta};
use crate::{Blobs, MetaStore, StoreError};

impl Store {
    /// Opens or creates the store in `directory`.
    ///
    /// Removes blobs that no row names, which a crash may leave.
    ///
    /// # Errors
    /// [`StoreError::InUse`] when another process has the directory open; [`StoreError::Unfinished`] when a copy into it was
    /// interrupted; [`StoreError::Newer`] and [`StoreError::Foreign`] when
    /// another version or program wrote it; else the disk's or the database's.
    pub fn open(directory: &Path) -> LocalBoxFuture<'_, Result<Self>> {
        Box::pin(async move { Self::open_at(directory, &StoreLocation::default()).await })
    }

    /// Opens or creates a store with its rows in a database or its blobs in a bucket.
    ///
    /// The directory belongs to this process alone: it holds the audit log, and everything that `places` does not name.
    ///
    /// # Errors
    /// As [`Store::open`]; [`StoreError::Unreachable`], [`StoreError::ForeignTables`], [`StoreError::Bucket`],
    /// [`StoreError::BucketUnreachable`], [`StoreError::ForeignBlobs`], [`StoreError::KeyUnknown`].
    pub fn open_at<'a>(directory: &'a Path, places: &'a StoreLocation) -> LocalBoxFuture<'a, Result<Self>> {
        Box::pin(async move {
            let objects = places.blobs.as_ref().map(BucketUrl::open).transpose()?;
            Self::open_over(directory, places, objects).await
        })
    }

    /// Same as [`Store::open_at`] with an open bucket.
    pub(crate) async fn open_over(
        directory: &Path,
        places: &StoreLocation,
        objects: Option<Arc<dyn ObjectStore>>,
    ) -> Result<Self> {
        create_private(directory)?;
        let held = lock(directory)?;
        if is_unfinished(directory)? {
            return Err(StoreError::Unfinished);
        }
        let blobs = match objects {
            Some(objects) => Blobs::over(objects),
            None => Blobs::in_directory(&directory.join(BLOBS))?,
        };
        let (meta, log): (Arc<dyn MetaStore>, _) = match &places.database {
            Some(database) => (Arc::new(PostgresMeta::open(database.options()).await?), given_log_name(directory)?),
            None => (Arc::new(SqliteMeta::open(directory).await?), LOCAL_LOG.to_owned()),
        };
        let shared = places.database.is_some();
        let mut watched = vec![held];
        if !shared {
            // A handle of its own would release SQLite's locks when it is closed.
            watched.push(Watched::new(&directory.join(sqlite::DATABASE), None)?);
        }
        let rows = (!shared).then(|| directory.to_owned());
        let directories = rows.into_iter().chain(blobs.root().map(Path::to_owned)).collect();
        let room = Arc::new(Room { directories, ..Room::default() });
        let blobs = blobs.with_room(Arc::clone(&room));
        let mut store = Self {
            meta,
            blobs,
            quota: u64::MAX,
            shared,
            log: log.into(),
            watched: watched.into(),
            room,
            seen: Arc::new(Mutex::new(Seen::now())),
        };
        store.check_belonging(directory, places).await?;
        if !shared {
            remove_old_snapshot(directory)?;
        }
        store.blobs = store.blobs.with_keys(places.keys.clone()).await?;
        // In a shared store another process may be about to name a blob that it has stored, so only a local store is swept.
        if places.is_local() {
            let swept = store.sweep(Duration::ZERO).await?;
            if swept > 0 {
                tracing::info!(files = swept, "removed blobs that no row names");
            }
        }
        Ok(store)
    }

    /// Refuses rows and blobs that do not belong together.
    ///
    /// Otherwise a sweep would remove the blobs that the rows do not name.
    ///
    /// At the first start the database and the bucket get one common name. A store entirely in its directory needs none.
    async fn check_belonging(&self, directory: &Path, places: &StoreLocation) -> Result<()> {
        let at =
            || places.blobs.as_ref().map_or_else(|| directory.join(BLOBS).display().to_string(), ToString::to_string);
        let refused = |detail| Err(StoreError::ForeignBlobs { place: at(), detail });
        let mut found = self.blobs.name().await?;
        if found.is_none() && places.is_local() {
            return Ok(());
        }
        let name = self.meta.name(&Uuid::now_v7().to_string()).await?;
        if found.is_none() {
            // A bucket that does not exist fails here.
            let stored = self.blobs.older_than(Duration::ZERO).await?;
            let known = self.meta.named_blobs().await?;
            match (stored.is_empty(), known.is_empty()) {
                (true, true) => {}
                (false, true) => return refused("it holds results that the database does not know"),
                (false, false) if stored.iter().any(|key| known.contains(key)) => {}
                (_, false) => return refused("the database has results that it does not hold"),
            }
            self.blobs.set_name(&name).await?;
            found = self.blobs.name().await?;
        }
        if found == Some(name) { Ok(()) } else { refused("it holds the results of another database") }
    }

    /// Removes the store in `directory`, whatever version wrote it; other files stay.
    ///
    /// # Errors
    /// [`StoreError::InUse`] when a process has the directory open, [`StoreError::Io`].
    pub fn erase(directory: &Path) -> Result<()> {
        create_private(directory)?;
        let _held = lock(directory)?;
        // The blobs come last: blobs without rows are swept at the next start, rows without blobs would be missing results.
        sqlite::remove(directory)?;
        match std::fs::remove_dir_all(directory.join(BLOBS)) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.into()),
            _ => {}
        }
        if is_unfinished(directory)? {
            mark_finished(directory)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sqlite::DATABASE;

    async fn change_database(directory: &Path, script: &'static str) {
        let meta = SqliteMeta::open(directory).await.unwrap();
        sqlx::raw_sql(script).execute(meta.writer()).await.unwrap();
        meta.close().await;
    }

    #[tokio::test]
    async fn a_directory_belongs_to_one_process_and_opens_again() {
        let directory = tempfile::tempdir().unwrap();
        let first = Store::open(directory.path()).await.unwrap();
        assert!(matches!(Store::open(directory.path()).await, Err(StoreError::InUse)));
        first.check().await.unwrap();
        first.close().await;
        drop(first);
        Store::open(directory.path()).await.unwrap().check().await.unwrap();
    }

    #[tokio::test]
    async fn a_later_format_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        change_database(directory.path(), "PRAGMA user_version = 99").await;
        assert!(matches!(Store::open(directory.path()).await, Err(StoreError::Newer { found: 99, .. })));
    }

    /// Tries tables of an unreleased version, another program's database, and a file that is no database.
    #[tokio::test]
    async fn what_is_no_database_of_this_version_is_refused_and_can_be_erased() {
        let other_columns = "ALTER TABLE jobs RENAME COLUMN state TO status";
        let other_program = "PRAGMA user_version = 0";
        for change in [Some(other_columns), Some(other_program), None] {
            let directory = tempfile::tempdir().unwrap();
            match change {
                Some(change) => change_database(directory.path(), change).await,
                None => std::fs::write(directory.path().join(DATABASE), [b'x'; 5000]).unwrap(),
            }
            let refused = Store::open(directory.path()).await;
            assert!(matches!(refused, Err(StoreError::Foreign)), "{change:?}: {refused:?}");
            std::fs::write(directory.path().join("notes.txt"), "mine").unwrap();
            Store::erase(directory.path()).unwrap();
            let store = Store::open(directory.path()).await.unwrap();
            assert!(matches!(Store::erase(directory.path()), Err(StoreError::InUse)));
            store.close().await;
            assert_eq!(std::fs::read_to_string(directory.path().join("notes.txt")).unwrap(), "mine");
        }
    }
}
