//! Format of the Postgres database and its migrations, run by [`sqlx::migrate`].

use sqlx::migrate::{MigrateError, Migration, MigrationType, Migrator};
use sqlx::postgres::PgConnectOptions;
use sqlx::{ConnectOptions, Connection, PgConnection, SqlStr};

use super::Result;
use crate::StoreError;

/// Migration scripts with their names, one for each version of the format, in order.
const MIGRATIONS: &[(&str, &str)] = &[
    ("schema", include_str!("1_schema.sql")),
    ("several processes", include_str!("2_several_processes.sql")),
    ("place of blobs", include_str!("3_place_of_blobs.sql")),
    ("milestones", include_str!("4_milestones.sql")),
    ("sealed values", include_str!("5_sealed_values.sql")),
    ("continued jobs", include_str!("6_continued_jobs.sql")),
    ("signed links", include_str!("7_signed_links.sql")),
    ("line", include_str!("8_line.sql")),
    ("looks", include_str!("9_looks.sql")),
];

/// Postgres error code: a table that a script creates exists already.
const TABLE_IS_THERE: &str = "42P07";

/// Refuses every format but the current one.
pub(super) async fn check_version(options: &PgConnectOptions) -> Result<()> {
    let mut connection = options.connect().await?;
    let found = version(&mut connection, &migrator()).await;
    connection.close().await.ok();
    let (found, known) = (found?, MIGRATIONS.len() as i64);
    if found < known { Err(StoreError::Older { found, known }) } else { Ok(()) }
}

/// Migrates the database, one process at a time; returns the format found and the current one.
pub(crate) async fn migrate(options: &PgConnectOptions) -> Result<(i64, i64)> {
    // A separate connection: closing it releases the lock in every case.
    let mut connection = options.connect().await?;
    let done = bring_up(&mut connection).await;
    connection.close().await.ok();
    done
}

async fn bring_up(connection: &mut PgConnection) -> Result<(i64, i64)> {
    let (migrator, known) = (migrator(), MIGRATIONS.len() as i64);
    let found = version(connection, &migrator).await?;
    // Without a migration to run, a user without the right to create tables suffices.
    if found < known {
        migrator.run(&mut *connection).await.map_err(fault)?;
    }
    Ok((found, known))
}

fn migrator() -> Migrator {
    let script = |(version, (name, script)): (i64, &(&'static str, &'static str))| {
        Migration::new(version, (*name).into(), MigrationType::Simple, SqlStr::from_static(script), false)
    };
    Migrator::with_migrations((1..).zip(MIGRATIONS).map(script).collect())
}

/// Format of the database, 0 when it is empty.
///
/// Refuses a later format and the tables of another program.
async fn version(connection: &mut PgConnection, migrator: &Migrator) -> Result<i64> {
    let applied = applied(connection).await?;
    let (found, known) = (applied.len() as i64, MIGRATIONS.len() as i64);
    let is_ours = |((version, checksum), own): (&(i64, Vec<u8>), &Migration)| {
        *version == own.version && checksum[..] == *own.checksum
    };
    if !applied.iter().zip(migrator.iter()).all(is_ours) {
        return Err(StoreError::ForeignTables);
    }
    if found > known { Err(StoreError::Newer { found, known }) } else { Ok(found) }
}

/// Versions and checksums of the scripts that were run on this database.
async fn applied(connection: &mut PgConnection) -> Result<Vec<(i64, Vec<u8>)>> {
    let table = sqlx::query_scalar("SELECT to_regclass('_sqlx_migrations') IS NOT NULL");
    if !table.fetch_one(&mut *connection).await? {
        return Ok(Vec::new());
    }
    let applied = sqlx::query_as("SELECT version, checksum FROM _sqlx_migrations ORDER BY version");
    Ok(applied.fetch_all(connection).await?)
}

fn fault(error: MigrateError) -> StoreError {
    let (MigrateError::Execute(error) | MigrateError::ExecuteMigration(error, _)) = error else {
        // Other scripts were run on the database after its version was read.
        return StoreError::ForeignTables;
    };
    let code = error.as_database_error().and_then(sqlx::error::DatabaseError::code);
    let is_there = code.is_some_and(|code| code == TABLE_IS_THERE);
    if is_there { StoreError::ForeignTables } else { error.into() }
}
