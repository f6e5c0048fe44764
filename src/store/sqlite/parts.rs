use sqlx::SqlitePool;

use super::{Result, gone_if_orphan, sessions};
use crate::store::records::{to_i64, to_u64};
use crate::store::{PartKind, PartRecord, SessionId, StoreError};

type Row = (String, String, Option<String>, i64, f64, String, String);

fn record((kind, key, blob, bytes, wall_s, document, updated_at): Row) -> Result<PartRecord> {
    Ok(PartRecord {
        kind: kind.parse().map_err(StoreError::record)?,
        key,
        blob,
        bytes: to_u64(bytes),
        wall_s,
        document,
        updated_at,
    })
}

pub(super) async fn put(
    writer: &SqlitePool,
    session: SessionId,
    parts: &[PartRecord],
    quota: u64,
) -> Result<Vec<String>> {
    let mut transaction = writer.begin().await?;
    let mut replaced = Vec::new();
    for part in parts {
        let old: Option<Option<String>> = sqlx::query_scalar("SELECT blob FROM parts WHERE session = ? AND kind = ?")
            .bind(session.to_string())
            .bind(part.kind.as_str())
            .fetch_optional(&mut *transaction)
            .await?;
        replaced.extend(old.flatten().filter(|old| Some(old) != part.blob.as_ref()));
        sqlx::query(
            "INSERT OR REPLACE INTO parts (session, kind, key, blob, bytes, wall_s, document, updated_at)
             VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
        )
        .bind(session.to_string())
        .bind(part.kind.as_str())
        .bind(&part.key)
        .bind(&part.blob)
        .bind(to_i64(part.bytes))
        .bind(part.wall_s)
        .bind(&part.document)
        .bind(&part.updated_at)
        .execute(&mut *transaction)
        .await
        .map_err(gone_if_orphan)?;
    }
    sessions::check_bytes(&mut transaction, session, quota).await?;
    transaction.commit().await?;
    Ok(replaced)
}

pub(super) async fn delete(writer: &SqlitePool, session: SessionId, kind: PartKind) -> Result<Option<Option<String>>> {
    let blob = sqlx::query_scalar("DELETE FROM parts WHERE session = ? AND kind = ? RETURNING blob");
    Ok(blob.bind(session.to_string()).bind(kind.as_str()).fetch_optional(writer).await?)
}

pub(super) async fn all(reader: &SqlitePool, session: SessionId) -> Result<Vec<PartRecord>> {
    let rows = sqlx::query_as::<_, Row>(
        "SELECT kind, key, blob, bytes, wall_s, document, updated_at FROM parts WHERE session = ? ORDER BY kind",
    );
    rows.bind(session.to_string()).fetch_all(reader).await?.into_iter().map(record).collect()
}
