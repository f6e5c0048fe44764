use std::time::Duration;

use sqlx::AssertSqlSafe;
use uuid::Uuid;

use super::dialect::{FOR_CHANGE, NOW_MS};
use super::queue::milliseconds;
use super::{Pool, Result};
use crate::look::Clocks;

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
    // A time that is still to come was written by a clock that was ahead; nobody may have to wait for it.
    let due = format!("house_kept + $1 <= {NOW_MS} OR house_kept > {NOW_MS}");
    let turn = format!("UPDATE store SET house_kept = {NOW_MS} WHERE {due}");
    let turn = sqlx::query(AssertSqlSafe(turn)).bind(milliseconds(every)).execute(writer).await?;
    Ok(turn.rows_affected() == 1)
}

pub(super) async fn look(writer: &Pool, now: i64, elapsed: i64, shared: bool) -> Result<(Clocks, i64)> {
    // A store on one machine may have no row until now.
    name(writer, &Uuid::now_v7().to_string()).await?;
    let mut transaction = writer.begin().await?;
    let stored = format!(
        "SELECT ran_ms, looked_at, settled_at, noted_at, noted_ran_ms, {NOW_MS} FROM store WHERE one = 1 {FOR_CHANGE}"
    );
    type Row = (i64, i64, i64, Option<i64>, i64, i64);
    let stored = sqlx::query_as::<_, Row>(AssertSqlSafe(stored)).fetch_one(&mut *transaction).await?;
    let (ran_ms, looked_at, settled_at, noted_at, noted_ran_ms, there) = stored;
    let (now, elapsed) = if shared { (now.min(there), elapsed.min(there - looked_at)) } else { (now, elapsed) };
    let before = Clocks { ran_ms, settled_at, noted: noted_at.map(|at| (at, noted_ran_ms)) };
    let clocks = before.look(now, elapsed);
    let (noted_at, noted_ran_ms) = clocks.noted.unzip();
    sqlx::query(
        "UPDATE store SET ran_ms = $1, looked_at = $2, settled_at = $3, noted_at = $4, noted_ran_ms = $5 WHERE one = 1",
    )
    .bind(clocks.ran_ms)
    .bind(there)
    .bind(clocks.settled_at)
    .bind(noted_at)
    .bind(noted_ran_ms.unwrap_or(0))
    .execute(&mut *transaction)
    .await?;
    transaction.commit().await?;
    Ok((clocks, now))
}
