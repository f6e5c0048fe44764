use sqlx::SqlitePool;

use super::Result;

pub(super) async fn set(writer: &SqlitePool, chain: &str, at: &str) -> Result<()> {
    sqlx::query(
        "INSERT INTO audit_anchor (one, chain, at) VALUES (1, ?, ?)
         ON CONFLICT (one) DO UPDATE SET chain = excluded.chain, at = excluded.at",
    )
    .bind(chain)
    .bind(at)
    .execute(writer)
    .await?;
    Ok(())
}

pub(super) async fn get(reader: &SqlitePool) -> Result<Option<(String, String)>> {
    Ok(sqlx::query_as("SELECT chain, at FROM audit_anchor").fetch_optional(reader).await?)
}

pub(super) async fn clear(writer: &SqlitePool) -> Result<()> {
    sqlx::query("DELETE FROM audit_anchor").execute(writer).await?;
    Ok(())
}
