//! What many sessions hold, read at one moment with as many queries as for one.

use std::collections::BTreeMap;

use sqlx::{Row, SqlitePool};

use super::sessions::BYTES;
use super::{Result, jobs, parts};
use crate::store::records::{id_list, parse_id, to_u64};
use crate::store::{SessionContents, SessionId};

pub(super) async fn of(
    reader: &SqlitePool,
    sessions: &[SessionId],
    most_jobs: u32,
) -> Result<BTreeMap<SessionId, SessionContents>> {
    let wanted = id_list(sessions);
    let mut snapshot = reader.begin().await?;
    let bytes = format!("SELECT id, {BYTES} FROM sessions s WHERE id IN (SELECT value FROM json_each(?))");
    let bytes: Vec<(String, i64)> =
        sqlx::query_as(sqlx::AssertSqlSafe(bytes)).bind(&wanted).fetch_all(&mut *snapshot).await?;
    let mut found = BTreeMap::new();
    for (id, bytes) in bytes {
        found.insert(parse_id(&id)?, SessionContents { bytes: to_u64(bytes), ..SessionContents::default() });
    }
    let rows = sqlx::query(
        "SELECT session, kind, key, blob, bytes, wall_s, document, updated_at FROM parts
         WHERE session IN (SELECT value FROM json_each(?)) ORDER BY kind",
    );
    for row in rows.bind(&wanted).fetch_all(&mut *snapshot).await? {
        of_session(&mut found, row.try_get("session")?)?.parts.push(parts::record(&row)?);
    }
    let rows = sqlx::query_as::<_, (String, String)>(
        "SELECT session, id FROM osteotomies WHERE session IN (SELECT value FROM json_each(?)) ORDER BY id",
    );
    for (session, id) in rows.bind(&wanted).fetch_all(&mut *snapshot).await? {
        of_session(&mut found, &session)?.osteotomies.push(parse_id(&id)?);
    }
    let rows = sqlx::query_as::<_, (String, String)>(
        "SELECT session, id FROM plans WHERE session IN (SELECT value FROM json_each(?)) ORDER BY id",
    );
    for (session, id) in rows.bind(&wanted).fetch_all(&mut *snapshot).await? {
        of_session(&mut found, &session)?.plans.push(parse_id(&id)?);
    }
    // Numbered without the long columns.
    let rows = sqlx::query(
        "SELECT * FROM jobs WHERE id IN (SELECT id FROM (
             SELECT id, row_number() OVER (PARTITION BY session ORDER BY id DESC) AS place
             FROM jobs WHERE session IN (SELECT value FROM json_each(?1))) WHERE place <= ?2)
         ORDER BY id DESC",
    );
    for row in rows.bind(&wanted).bind(i64::from(most_jobs)).fetch_all(&mut *snapshot).await? {
        of_session(&mut found, row.try_get("session")?)?.jobs.push(jobs::record(&row)?);
    }
    snapshot.rollback().await?;
    Ok(found)
}

fn of_session<'a>(
    found: &'a mut BTreeMap<SessionId, SessionContents>,
    session: &str,
) -> Result<&'a mut SessionContents> {
    Ok(found.entry(parse_id(session)?).or_default())
}
