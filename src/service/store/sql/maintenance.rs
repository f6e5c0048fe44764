use std::time::Duration;

use sqlx::AssertSqlSafe;
use uuid::Uuid;

use super::dialect::NOW_MS;
use super::queue::milliseconds;
use super::{Pool, Result};

pub(super) async fn name(writer: &Pool, fresh: &str) -> Result<String> {
    let given = sqlx::query("INSERT INTO store (one, name, house_kept) VALUES (1, $1, 0) ON CONFLICT (one) DO NOTHING");
    given.bind(fresh).execute(writer).await?;
    Ok(sqlx::query_scalar("SELECT name FROM store").fetch_one(writer).await?)
}

pub(super) async fn link_key(writer: &Pool, fresh: &str) -> Result<String> {
    // A store on one machine has no row until now, as its blobs need no name.
    name(writer, &Uuid::now_v7().to_string()).await?;
    let given = sqlx::query("UPDATE store SET link_key = $1 WHERE link_key IS NULL");
    given.bind(fresh).execute(writer).await?;
    Ok(sqlx::query_scalar("SELECT link_key FROM store").fetch_one(writer).await?)
}

pub(super) async fn claim_maintenance(writer: &Pool, every: Duration) -> Result<bool> {
    let turn = format!("UPDATE store SET house_kept = {NOW_MS} WHERE house_kept + $1 <= {NOW_MS}");
    let turn = sqlx::query(AssertSqlSafe(turn)).bind(milliseconds(every)).execute(writer).await?;
    Ok(turn.rows_affected() == 1)
}
