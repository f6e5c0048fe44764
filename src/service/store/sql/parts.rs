use sqlx::Row;

use super::{DbRow, Pool, Result, sessions};
use crate::records::{to_i64, to_u64};
use crate::{PartKind, PartRecord, SessionId, StoreError};

pub(super) fn record(row: &DbRow) -> Result<PartRecord> {
    Ok(PartRecord {
        kind: row.try_get::<String, _>("kind")?.parse().map_err(StoreError::record)?,
        key: row.try_get("key")?,
        blob: row.try_get("blob")?,
        bytes: to_u64(row.try_get("bytes")?),
        wall_s: row.try_get("wall_s")?,
        document: row.try_get("document")?,
        updated_at: row.try_get("updated_at")?,
    })
}

pub(super) async fn put(writer: &Pool, session: SessionId, parts: &[PartRecord], quota: u64) -> Result<Vec<String>> {
    let mut transaction = writer.begin().await?;
    sessions::hold(&mut transaction, session).await?;
    let mut replaced = Vec::new();
    for part in parts {
        let old: Option<Option<String>> = sqlx::query_scalar("SELECT blob FROM parts WHERE session = $1 AND kind = $2")
            .bind(session.to_string())
            .bind(part.kind.as_str())
            .fetch_optional(&mut *transaction)
            .await?;
        replaced.extend(old.flatten().filter(|old| Some(old) != part.blob.as_ref()));
        sqlx::query(
            "INSERT INTO parts (session, kind, key, blob, bytes, wall_s, document, updated_at)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8)
             ON CONFLICT (session, kind) DO UPDATE SET key = excluded.key, blob = excluded.blob, bytes = excluded.bytes,
             wall_s = excluded.wall_s, document = excluded.document, updated_at = excluded.updated_at",
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
        .await?;
    }
    sessions::check_bytes(&mut transaction, session, quota).await?;
    transaction.commit().await?;
    Ok(replaced)
}

pub(super) async fn delete(writer: &Pool, session: SessionId, kind: PartKind) -> Result<Option<Option<String>>> {
    let blob = sqlx::query_scalar("DELETE FROM parts WHERE session = $1 AND kind = $2 RETURNING blob");
    Ok(blob.bind(session.to_string()).bind(kind.as_str()).fetch_optional(writer).await?)
}

pub(super) async fn all(reader: &Pool, session: SessionId) -> Result<Vec<PartRecord>> {
    let rows = sqlx::query(
        "SELECT kind, key, blob, bytes, wall_s, document, updated_at FROM parts WHERE session = $1 ORDER BY kind",
    );
    rows.bind(session.to_string()).fetch_all(reader).await?.iter().map(record).collect()
}
