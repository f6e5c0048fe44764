//! Tests of the behaviour that all engines share.
//!
//! They run on SQLite with files and on Postgres with a bucket.

use std::time::{Duration, Instant};

use super::*;

/// Runs each test on every engine.
macro_rules! conforms {
    ($($name:ident,)*) => {
        mod embedded {
            $(#[tokio::test]
            async fn $name() {
                let directory = tempfile::tempdir().unwrap();
                super::$name(super::Store::open(directory.path()).await.unwrap()).await;
            })*
        }

        mod shared {
            $(#[tokio::test]
            async fn $name() {
                let (store, _kept) = super::shared_store().await;
                super::$name(store).await;
            })*
        }
    };
}

#[path = "../../../../tests/engines/mod.rs"]
mod engines;
mod jobs;
mod sessions;
mod shared;

/// A store with an empty database and an empty bucket, and the guards that keep these alive.
async fn shared_store() -> (Store, impl Sized) {
    let (directory, bucket) = (tempfile::tempdir().unwrap(), engines::Bucket::start().await);
    let store = open_shared(directory.path(), &engines::fresh_database().await, &bucket).await;
    (store, (directory, bucket))
}

async fn open_shared(directory: &std::path::Path, database: &str, bucket: &engines::Bucket) -> Store {
    try_open_shared(directory, database, bucket, &bucket.url()).await.unwrap()
}

/// Opens a store with another bucket of the same server.
async fn try_open_shared(
    directory: &std::path::Path,
    database: &str,
    server: &engines::Bucket,
    bucket: &str,
) -> Result<Store, StoreError> {
    let bucket: BucketUrl = bucket.parse().unwrap();
    let objects = bucket.open_with(server.client()).unwrap();
    let places =
        StoreLocation { database: Some(database.parse().unwrap()), blobs: Some(bucket), ..StoreLocation::default() };
    Store::open_over(directory, &places, Some(objects)).await
}

pub(super) fn session(tenant: &str) -> SessionRecord {
    SessionRecord {
        id: SessionId::new(),
        tenant: tenant.parse().unwrap(),
        label: Some("tag".to_owned()),
        settings: "{}".to_owned(),
        created_at: now_rfc3339(),
    }
}

pub(super) fn part_with(kind: PartKind, blob: &BlobInfo) -> PartRecord {
    PartRecord {
        kind,
        key: blob.sha256.clone(),
        blob: Some(blob.key.clone()),
        bytes: blob.bytes,
        wall_s: 0.5,
        document: "{}".to_owned(),
        updated_at: now_rfc3339(),
    }
}

fn job(session: SessionId, request: &str) -> JobRecord {
    JobRecord {
        steps: 2,
        subject: Some("plan".to_owned()),
        max_wall_s: Some(60.0),
        traceparent: Some("00-1-2-01".to_owned()),
        ..JobRecord::accepted(JobKind::Solve, session, request.to_owned())
    }
}

fn answer(tenant: &str, key: &str, session: SessionId) -> AnswerRecord {
    AnswerRecord {
        tenant: tenant.parse().unwrap(),
        key: key.to_owned(),
        request_sha256: "abc".to_owned(),
        status: 201,
        location: Some("/v1/x".to_owned()),
        retry_after: None,
        body: "{}".to_owned(),
        session: Some(session),
    }
}

const LEASE: Duration = Duration::from_secs(60);
const PATIENCE: Duration = Duration::from_secs(4);

const MANY: QueueLimits = QueueLimits { all: 100, tenant: 100 };

async fn insert(store: &Store, job: &JobRecord, limits: QueueLimits, supersede: bool) -> Insertion {
    insert_over(store, job, limits, supersede.then_some(SupersedeScope::Subject)).await
}

async fn insert_over(store: &Store, job: &JobRecord, limits: QueueLimits, scope: Option<SupersedeScope>) -> Insertion {
    let supersede = scope.map(|scope| Supersede {
        scope,
        from: JobState::Accepted,
        to: JobState::Cancelled,
        event: ("end", "{}".to_owned()),
    });
    let new = NewJob { job, limits, event: "{}", supersede, answer: &|_, _| None };
    store.insert_job(&new).await.unwrap()
}

async fn accept(store: &Store, session: SessionId, request: &str) -> JobId {
    let job = job(session, request);
    let stored = insert(store, &job, MANY, false).await;
    assert!(matches!(stored, Insertion::Stored { superseded, .. } if superseded.is_empty()));
    job.id
}

async fn claim(store: &Store) -> Option<JobRecord> {
    claim_by(store, Lane::Heavy, None).await
}

async fn claim_by(store: &Store, lane: Lane, worker: Option<WorkerId>) -> Option<JobRecord> {
    let started = |job: &JobRecord| JobChange {
        phase: Some("reading"),
        attempt_change: 1,
        events: vec![("status", format!("{{\"attempt\":{}}}", job.attempt + 1))],
        ..JobChange::default()
    };
    let claim = Claim { lane, worker, patience: PATIENCE, to: JobState::Running, lease: LEASE };
    store.claim_job(&claim, &started).await.unwrap()
}

async fn add_session(store: &Store, tenant: &str) -> SessionRecord {
    let record = session(tenant);
    store.insert_session(&record, None).await.unwrap();
    record
}

async fn blob(store: &Store, session: SessionId, bytes: &[u8]) -> BlobInfo {
    store.blobs().put(session, bytes.to_vec()).await.unwrap()
}

fn step(k: u32, frame: &BlobInfo) -> StepRecord {
    StepRecord {
        k,
        t: 0.5,
        document: "{}".to_owned(),
        error: None,
        blob: frame.key.clone(),
        sha256: frame.sha256.clone(),
        bytes: frame.bytes,
    }
}
