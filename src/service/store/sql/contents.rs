//! Contents of many sessions, read in one snapshot with as many queries as for one session.

use std::collections::BTreeMap;

use sqlx::{AssertSqlSafe, Row};

use super::dialect::{LISTED, SNAPSHOT};
use super::sessions::BYTES;
use super::{Pool, Result, Transaction, jobs, parts};
use crate::records::{id_list, parse_id, to_u64};
use crate::{SessionContents, SessionId};

pub(super) async fn of(
    reader: &Pool,
    sessions: &[SessionId],
    most_jobs: u32,
) -> Result<BTreeMap<SessionId, SessionContents>> {
    let wanted = id_list(sessions);
    let mut snapshot = reader.begin_with(SNAPSHOT).await?;
    let rows = format!("SELECT id, {BYTES} FROM sessions s WHERE id IN {LISTED}");
    let bytes: Vec<(String, i64)> = sqlx::query_as(AssertSqlSafe(rows)).bind(&wanted).fetch_all(&mut *snapshot).await?;
    let mut found = BTreeMap::new();
    for (id, bytes) in bytes {
        found.insert(parse_id(&id)?, SessionContents { bytes: to_u64(bytes), ..SessionContents::default() });
    }
    let rows = format!(
        "SELECT session, kind, key, blob, bytes, wall_s, document, updated_at FROM parts
         WHERE session IN {LISTED} ORDER BY kind"
    );
    for row in sqlx::query(AssertSqlSafe(rows)).bind(&wanted).fetch_all(&mut *snapshot).await? {
        of_session(&mut found, row.try_get("session")?)?.parts.push(parts::record(&row)?);
    }
    for (session, id) in ids(&mut snapshot, "osteotomies", &wanted).await? {
        of_session(&mut found, &session)?.osteotomies.push(parse_id(&id)?);
    }
    for (session, id) in ids(&mut snapshot, "plans", &wanted).await? {
        of_session(&mut found, &session)?.plans.push(parse_id(&id)?);
    }
    // The window function sorts ids only, without the long columns.
    let rows = format!(
        "SELECT * FROM jobs WHERE id IN (SELECT id FROM (
             SELECT id, row_number() OVER (PARTITION BY session ORDER BY id DESC) AS place
             FROM jobs WHERE session IN {LISTED}) AS placed WHERE place <= $2)
         ORDER BY id DESC"
    );
    for row in
        sqlx::query(AssertSqlSafe(rows)).bind(&wanted).bind(i64::from(most_jobs)).fetch_all(&mut *snapshot).await?
    {
        of_session(&mut found, row.try_get("session")?)?.jobs.push(jobs::record(&row)?);
    }
    snapshot.rollback().await?;
    Ok(found)
}

/// Pairs of session and id from a table.
async fn ids(snapshot: &mut Transaction<'_>, table: &str, wanted: &str) -> Result<Vec<(String, String)>> {
    let rows = format!("SELECT session, id FROM {table} WHERE session IN {LISTED} ORDER BY id");
    Ok(sqlx::query_as(AssertSqlSafe(rows)).bind(wanted).fetch_all(&mut **snapshot).await?)
}

fn of_session<'a>(
    found: &'a mut BTreeMap<SessionId, SessionContents>,
    session: &str,
) -> Result<&'a mut SessionContents> {
    Ok(found.entry(parse_id(session)?).or_default())
}
