use super::{Pool, Result};

pub(super) async fn set(writer: &Pool, log: &str, chain: &str, at: &str) -> Result<()> {
    sqlx::query(
        "INSERT INTO audit_anchors (log, chain, at) VALUES ($1, $2, $3)
         ON CONFLICT (log) DO UPDATE SET chain = excluded.chain, at = excluded.at",
    )
    .bind(log)
    .bind(chain)
    .bind(at)
    .execute(writer)
    .await?;
    Ok(())
}

pub(super) async fn get(reader: &Pool, log: &str) -> Result<Option<(String, String)>> {
    let noted = sqlx::query_as("SELECT chain, at FROM audit_anchors WHERE log = $1");
    Ok(noted.bind(log).fetch_optional(reader).await?)
}
