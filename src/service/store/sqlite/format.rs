//! Format of the SQLite database in a data directory, and its migrations.

use sqlx::SqlitePool;
use sqlx::sqlite::{SqliteConnectOptions, SqlitePoolOptions};

use crate::StoreError;

/// Migration scripts, one for each version of the format, in order.
const MIGRATIONS: &[&str] = &[
    include_str!("1_schema.sql"),
    include_str!("2_plans_without_osteotomy.sql"),
    include_str!("3_tenants_and_queue.sql"),
    include_str!("4_cancel_requests.sql"),
    include_str!("5_audit_anchor.sql"),
    include_str!("6_trace.sql"),
    include_str!("7_audit_anchors.sql"),
    include_str!("8_several_processes.sql"),
    include_str!("9_place_of_blobs.sql"),
    include_str!("10_milestones.sql"),
    include_str!("11_sealed_values.sql"),
    include_str!("12_continued_jobs.sql"),
    include_str!("13_signed_links.sql"),
    include_str!("14_looks.sql"),
];

/// File name of the database in its directory.
pub(crate) const DATABASE: &str = "prosopon.sqlite";
/// Pairs of table and column, sorted: migrations may add columns in another order.
type Columns = Vec<(String, String)>;

/// Migrates the database to the current format and checks its columns.
pub(super) async fn prepare(writer: &SqlitePool) -> Result<(), StoreError> {
    let found: i64 = sqlx::query_scalar("PRAGMA user_version").fetch_one(writer).await.map_err(no_database)?;
    let known = MIGRATIONS.len() as i64;
    if found > known {
        return Err(StoreError::Newer { found, known });
    }
    if found <= 0 && !columns(writer).await?.is_empty() {
        return Err(StoreError::Foreign);
    }
    migrate(writer, found).await?;
    if columns(writer).await? == expected_columns().await? { Ok(()) } else { Err(StoreError::Foreign) }
}

/// Refuses every format but the current one.
pub(super) async fn check_version(database: &SqlitePool) -> Result<(), StoreError> {
    let found: i64 = sqlx::query_scalar("PRAGMA user_version").fetch_one(database).await.map_err(no_database)?;
    match (found, MIGRATIONS.len() as i64) {
        (found, known) if found > known => Err(StoreError::Newer { found, known }),
        (found, known) if found < known => Err(StoreError::Older { found, known }),
        _ => Ok(()),
    }
}

async fn migrate(writer: &SqlitePool, found: i64) -> Result<(), StoreError> {
    for (index, script) in MIGRATIONS.iter().enumerate().skip(usize::try_from(found).unwrap_or(0)) {
        let mut transaction = writer.begin().await?;
        sqlx::raw_sql(*script).execute(&mut *transaction).await?;
        // PRAGMA takes no bound parameter; the number is a constant of this program.
        let set_version = format!("PRAGMA user_version = {}", index + 1);
        sqlx::raw_sql(sqlx::AssertSqlSafe(set_version)).execute(&mut *transaction).await?;
        transaction.commit().await?;
    }
    Ok(())
}

async fn columns(database: &SqlitePool) -> Result<Columns, StoreError> {
    let found = sqlx::query_as(
        "SELECT t.name, c.name FROM sqlite_schema t, pragma_table_info(t.name) c
         WHERE t.type = 'table' AND t.name NOT LIKE 'sqlite_%' ORDER BY t.name, c.name",
    );
    Ok(found.fetch_all(database).await?)
}

async fn expected_columns() -> Result<Columns, StoreError> {
    let options = SqliteConnectOptions::new().in_memory(true);
    let pool = SqlitePoolOptions::new().max_connections(1).connect_with(options).await?;
    migrate(&pool, 0).await?;
    let columns = columns(&pool).await;
    pool.close().await;
    columns
}

/// Recognises a file that is no SQLite database; SQLite reports that only at the first read.
pub(super) fn no_database(error: sqlx::Error) -> StoreError {
    const NOT_A_DATABASE: &str = "26";
    let code = error.as_database_error().and_then(sqlx::error::DatabaseError::code);
    if code.is_some_and(|code| code == NOT_A_DATABASE) { StoreError::Foreign } else { error.into() }
}
