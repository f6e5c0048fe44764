//! Objects that show with which keys values are encrypted: one for each key, empty and encrypted with it.

use futures::TryStreamExt;
use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt, PutPayload};

use super::records::hex;
use super::{Keyring, StoreError};

/// Folder of the marks.
pub(super) const MARKS: &str = "encrypted-with";

/// Checks that each key with which values are encrypted is among `keys`, and marks the first of them.
pub(super) async fn check_and_mark(objects: &dyn ObjectStore, keys: &Keyring) -> Result<(), StoreError> {
    let marks = all(objects).await?;
    for mark in &marks {
        keys.open(mark.as_ref(), &objects.get(mark).await?.bytes().await?).await?;
    }
    let Some(first) = first(keys).filter(|first| !marks.contains(first)) else { return Ok(()) };
    if let Some(encrypting) = keys.encrypt(first.as_ref())? {
        objects.put(&first, PutPayload::from(encrypting.end()?)).await?;
    }
    Ok(())
}

/// Removes the marks of all keys but the first, which no value has any more.
pub(super) async fn keep_first(objects: &dyn ObjectStore, keys: &Keyring) -> Result<(), StoreError> {
    let Some(first) = first(keys) else { return Ok(()) };
    for mark in all(objects).await?.into_iter().filter(|mark| *mark != first) {
        objects.delete(&mark).await?;
    }
    Ok(())
}

async fn all(objects: &dyn ObjectStore) -> Result<Vec<Path>, StoreError> {
    Ok(objects.list(Some(&Path::from(MARKS))).map_ok(|o| o.location).try_collect().await?)
}

fn first(keys: &Keyring) -> Option<Path> {
    keys.first_id().map(|id| Path::from(format!("{MARKS}/{}", hex(&id))))
}
