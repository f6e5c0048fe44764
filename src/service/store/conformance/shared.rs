//! Tests of stores that several processes share.

use std::collections::BTreeSet;

use futures::future::join_all;

use super::engines::{Bucket, Cluster, Mood, fresh_database};
use super::*;

#[tokio::test]
async fn stores_that_open_one_database_at_once_bring_it_up_once_and_share_it() {
    let (database, bucket) = (fresh_database().await, Bucket::start().await);
    let directories: Vec<_> = (0..4).map(|_| tempfile::tempdir().unwrap()).collect();
    let stores = join_all(directories.iter().map(|d| open_shared(d.path(), &database, &bucket))).await;
    let record = add_session(&stores[0], "a").await;
    let skin = blob(&stores[1], record.id, b"skin").await;
    stores[1].put_parts(record.id, &[part_with(PartKind::Skin, &skin)]).await.unwrap();
    assert_eq!(stores[2].session(record.id).await.unwrap(), Some(record));
    assert_eq!(stores[3].blobs().get(&skin.key).await.unwrap().as_ref(), b"skin");
    // Each process has its own audit log with its own end.
    stores[0].set_audit_anchor("end").await.unwrap();
    assert_eq!(stores[0].audit_anchor().await.unwrap().unwrap().0, "end");
    assert_eq!(stores[1].audit_anchor().await.unwrap(), None);
}

#[tokio::test]
async fn a_bucket_of_other_rows_is_refused_before_anything_in_it_is_removed() {
    let server = Bucket::start().await;
    let (bucket, empty) = (server.url(), format!("{}/empty", server.url()));
    let opened = async |database: &str, bucket: &str| {
        let directory = tempfile::tempdir().unwrap();
        try_open_shared(directory.path(), database, &server, bucket).await.map(|store| (store, directory))
    };
    let [own, other] = [fresh_database().await, fresh_database().await];
    let (store, _kept) = opened(&own, &bucket).await.unwrap();
    let session = add_session(&store, "a").await.id;
    let skin = blob(&store, session, b"skin").await;
    store.put_parts(session, &[part_with(PartKind::Skin, &skin)]).await.unwrap();
    opened(&own, &bucket).await.unwrap();
    let refused = async |database: &str, bucket: &str, words: &str| {
        let reported = opened(database, bucket).await.unwrap_err().to_string();
        assert!(reported.contains(words) && reported.contains(bucket), "{reported}");
    };
    refused(&other, &bucket, "the results of another database").await;
    refused(&own, &empty, "has results that it does not hold").await;
    // A store from before the first start of a version that records the name.
    store.blobs().delete("belongs-to").await;
    refused(&other, &bucket, "holds results that the database does not know").await;
    opened(&own, &bucket).await.unwrap();
    let (theirs, _kept) = opened(&other, &empty).await.unwrap();
    let session = add_session(&theirs, "b").await.id;
    let skin_there = blob(&theirs, session, b"skin").await;
    theirs.put_parts(session, &[part_with(PartKind::Skin, &skin_there)]).await.unwrap();
    theirs.blobs().delete("belongs-to").await;
    refused(&own, &empty, "has results that it does not hold").await;
    assert_eq!(store.blobs().get(&skin.key).await.unwrap().as_ref(), b"skin");
    let nowhere = opened(&fresh_database().await, "s3://elsewhere").await.unwrap_err();
    assert!(format!("{nowhere:?}").contains("NoSuchBucket"), "{nowhere:?}");
}

#[tokio::test]
async fn files_of_a_directory_stay_when_its_rows_are_named_elsewhere_or_no_more() {
    let database = fresh_database().await;
    let elsewhere =
        StoreLocation { database: Some(database.parse().unwrap()), blobs: None, ..StoreLocation::default() };
    for (first, then) in [(StoreLocation::default(), elsewhere.clone()), (elsewhere, StoreLocation::default())] {
        let directory = tempfile::tempdir().unwrap();
        let store = Store::open_at(directory.path(), &first).await.unwrap();
        let session = add_session(&store, "a").await.id;
        let skin = blob(&store, session, b"skin").await;
        store.put_parts(session, &[part_with(PartKind::Skin, &skin)]).await.unwrap();
        store.close().await;
        drop(store);
        let refused = Store::open_at(directory.path(), &then).await;
        assert!(matches!(refused, Err(StoreError::ForeignBlobs { .. })), "{refused:?}");
        let again = Store::open_at(directory.path(), &first).await.unwrap();
        assert_eq!(again.blobs().get(&skin.key).await.unwrap().as_ref(), b"skin");
    }
}

#[tokio::test]
async fn of_those_that_share_rows_one_keeps_house() {
    let (database, bucket) = (fresh_database().await, Bucket::start().await);
    let directories = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let [first, second] = directories.each_ref().map(|d| open_shared(d.path(), &database, &bucket));
    let (first, second) = (first.await, second.await);
    let every = Duration::from_millis(500);
    assert!(first.claims_maintenance(every).await.unwrap());
    assert!(!second.claims_maintenance(every).await.unwrap() && !first.claims_maintenance(every).await.unwrap());
    tokio::time::sleep(every).await;
    let both = tokio::join!(first.claims_maintenance(every), second.claims_maintenance(every));
    assert_ne!(both.0.unwrap(), both.1.unwrap());
}

#[tokio::test]
async fn a_job_is_claimed_once_by_many_and_tenants_take_turns() {
    let (store, _kept) = shared_store().await;
    let (a, b) = (add_session(&store, "a").await.id, add_session(&store, "b").await.id);
    let mut jobs = BTreeSet::new();
    for n in 0..20 {
        for session in [a, b] {
            jobs.insert(accept(&store, session, &n.to_string()).await);
        }
    }
    let claimers = (0..8).map(|_| {
        let store = store.clone();
        tokio::spawn(async move {
            let mut claimed = Vec::new();
            while let Some(job) = claim(&store).await {
                claimed.push(job);
            }
            claimed
        })
    });
    let claimed: Vec<JobRecord> = join_all(claimers).await.into_iter().flat_map(Result::unwrap).collect();
    assert_eq!(claimed.len(), jobs.len(), "none twice");
    assert_eq!(claimed.iter().map(|j| j.id).collect::<BTreeSet<_>>(), jobs, "all");
    // Each tenant has its share of the first half of the claims.
    let mut by_start = claimed;
    by_start.sort_by(|x, y| x.started_at.cmp(&y.started_at));
    let of_a = by_start.iter().take(20).filter(|job| job.session == a).count();
    assert!((6..=14).contains(&of_a), "{of_a} of 20");
}

#[tokio::test]
async fn limits_hold_for_jobs_that_are_stored_at_once() {
    let (store, _kept) = shared_store().await;
    let sessions = [add_session(&store, "a").await.id, add_session(&store, "b").await.id];
    let limits = QueueLimits { all: 7, tenant: 5 };
    let new: Vec<JobRecord> = (0..20).map(|n| job(sessions[n % 2], &n.to_string())).collect();
    let insertions = join_all(new.iter().map(|job| insert(&store, job, limits, false))).await;
    let stored = insertions.iter().filter(|i| matches!(i, Insertion::Stored { .. })).count();
    assert_eq!((stored, store.queue(Lane::Heavy).await.unwrap().len()), (7, 7));
    // Many concurrent requests for the same job store it once.
    let (id, twins) = (add_session(&store, "c").await.id, 10);
    let same: Vec<JobRecord> = (0..twins).map(|_| job(id, "same")).collect();
    let insertions = join_all(same.iter().map(|job| insert(&store, job, MANY, false))).await;
    assert_eq!(insertions.iter().filter(|i| matches!(i, Insertion::Stored { .. })).count(), 1);
    assert_eq!(insertions.iter().filter(|i| matches!(i, Insertion::Twin(..))).count(), twins - 1);
}

#[tokio::test]
async fn a_quota_holds_for_parts_that_are_stored_at_once_and_no_blob_is_left() {
    let (store, _kept) = shared_store().await;
    let store = store.with_quota(100);
    let id = add_session(&store, "a").await.id;
    let put = async |kind, length: usize| {
        let value = blob(&store, id, &vec![1; length]).await;
        (value.key.clone(), store.put_parts(id, &[part_with(kind, &value)]).await)
    };
    let kinds = [PartKind::Skin, PartKind::Skull, PartKind::Target, PartKind::Skin, PartKind::Skin, PartKind::Skull];
    let written = join_all(kinds.map(|kind| put(kind, 45))).await;
    assert!(written.iter().all(|(_, put)| matches!(put, Ok(()) | Err(StoreError::QuotaFull { .. }))), "{written:?}");
    assert_eq!(store.session_bytes(id).await.unwrap(), 90);
    let named: BTreeSet<_> = store.parts(id).await.unwrap().into_iter().filter_map(|p| p.blob).collect();
    for (key, _) in written {
        assert_eq!(store.blobs().get(&key).await.is_ok(), named.contains(&key));
    }
}

#[tokio::test]
async fn sessions_can_be_deleted_while_they_are_written_to() {
    let (store, _kept) = shared_store().await;
    for round in 0..10 {
        let (a, b) = (add_session(&store, "a").await.id, add_session(&store, "b").await.id);
        for (session, other) in [(a, b), (b, a)] {
            let mut compare = job(session, "compare");
            compare.other_session = Some(other);
            insert(&store, &compare, MANY, false).await;
        }
        let running = claim(&store).await.unwrap();
        let work = async {
            for k in 1..5 {
                let frame = blob(&store, running.session, format!("{round} {k}").as_bytes()).await;
                let written = store.commit_step(&running, &step(k, &frame), &[("step", "{}".to_owned())]).await;
                assert!(matches!(written, Ok(_) | Err(StoreError::SessionGone)), "{written:?}");
                store.record_progress(&running, "solve", 0.5, "{}").await.unwrap();
            }
            store.change_job(&running, JobState::Succeeded, &JobChange::default()).await.unwrap();
        };
        let (deleted_a, deleted_b, ()) = tokio::join!(store.delete_session(a), store.delete_session(b), work);
        assert!(deleted_a.unwrap() && deleted_b.unwrap());
        assert_eq!(store.job(running.id).await.unwrap(), None);
        assert!(claim(&store).await.is_none());
    }
}

#[tokio::test]
async fn what_is_written_again_after_a_lost_answer_stays() {
    let (store, _kept) = shared_store().await;
    let id = add_session(&store, "a").await.id;
    accept(&store, id, "1").await;
    let running = claim(&store).await.unwrap();
    let (rest, frame, tissue) =
        (blob(&store, id, b"rest").await, blob(&store, id, b"frame").await, blob(&store, id, b"tissue").await);
    let change = JobChange { tissue: Some(tissue.clone()), ..JobChange::default() };
    for _ in 0..2 {
        store.set_rest(&running, &rest).await.unwrap();
        let written = store.commit_step(&running, &step(1, &frame), &[("step", "{}".to_owned())]).await.unwrap();
        assert_eq!(written, StepWritten::New(None));
    }
    for _ in 0..2 {
        assert!(store.change_job(&running, JobState::Succeeded, &change).await.unwrap());
    }
    for blob in [rest, frame, tissue] {
        assert!(store.blobs().get(&blob.key).await.is_ok());
    }
    assert_eq!(store.events(running.id, 0).await.unwrap().len(), 3, "reported once");
}

/// Cancels calls at every await in turn, as when clients leave.
///
/// Later writes must be visible to all, and no call may wait for locks of a cancelled one.
#[tokio::test]
async fn calls_that_are_broken_off_leave_no_transaction_behind() {
    let database = fresh_database().await;
    let directories = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let places = StoreLocation { database: Some(database.parse().unwrap()), blobs: None, ..StoreLocation::default() };
    let store = Store::open_at(directories[0].path(), &places).await.unwrap();
    let other = Store::open_at(directories[1].path(), &places).await.unwrap();
    let id = add_session(&store, "a").await.id;
    accept(&store, id, "1").await;
    let running = claim(&store).await.unwrap();
    for polls in 1..60 {
        let mut write = Box::pin(store.record_progress(&running, "solve", 0.5, "{}"));
        for _ in 0..polls {
            if futures::poll!(&mut write).is_ready() {
                break;
            }
            tokio::time::sleep(Duration::from_micros(300)).await;
        }
        drop(write);
        // Uses the same connection, which must not be inside a transaction.
        assert_eq!(store.renew(&running, LEASE).await.unwrap(), Some(false));
        let written = other.record_progress(&running, "solve", 0.5, "{}");
        let written = tokio::time::timeout(Duration::from_secs(10), written).await;
        assert!(written.expect("nothing is locked").unwrap(), "{polls}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_was_away_is_told_so_and_used_again() {
    let mut cluster = Cluster::start();
    let (directory, bucket) = (tempfile::tempdir().unwrap(), Bucket::start().await);
    let store = open_shared(directory.path(), &cluster.fresh_database().await, &bucket).await;
    let kept = add_session(&store, "a").await;
    let reading = tokio::spawn({
        let (store, id) = (store.clone(), kept.id);
        async move {
            let mut away = 0;
            for _ in 0..400 {
                match store.session(id).await {
                    Ok(found) => assert!(found.is_some()),
                    Err(StoreError::Unreachable(_)) => away += 1,
                    Err(other) => panic!("{other:?}"),
                }
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
            away
        }
    });
    tokio::time::sleep(Duration::from_millis(200)).await;
    tokio::task::block_in_place(|| cluster.restart());
    reading.await.unwrap();
    store.check().await.unwrap();
    assert_eq!(store.session(kept.id).await.unwrap(), Some(kept.clone()));
    drop(cluster);
    let gone = loop {
        match store.session(kept.id).await {
            Ok(_) => tokio::time::sleep(Duration::from_millis(20)).await,
            Err(error) => break error,
        }
    };
    assert!(matches!(gone, StoreError::Unreachable(_)), "{gone:?}");
}

#[tokio::test]
async fn a_bucket_that_says_nothing_holds_up_no_change_of_rows() {
    let (database, bucket) = (fresh_database().await, Bucket::start().await);
    let directory = tempfile::tempdir().unwrap();
    let store = open_shared(directory.path(), &database, &bucket).await;
    let id = add_session(&store, "a").await.id;
    accept(&store, id, "1").await;
    let running = claim(&store).await.unwrap();
    let checkpoint = blob(&store, id, b"1").await;
    store.set_checkpoint(&running, &checkpoint).await.unwrap();
    bucket.set(Mood::Silent);
    let change = JobChange::default();
    let end = store.change_job(&running, JobState::Succeeded, &change);
    // The retries of the bucket last a minute.
    assert!(tokio::time::timeout(Duration::from_secs(20), end).await.expect("it waits for the bucket").unwrap());
    let deletion = tokio::time::timeout(Duration::from_secs(20), store.delete_session(id));
    assert!(deletion.await.expect("it waits for the bucket").unwrap());
    bucket.set(Mood::Serving);
    // The blob is removed in the background or by a sweep.
    store.sweep(Duration::ZERO).await.unwrap();
    assert!(matches!(store.blobs().get(&checkpoint.key).await, Err(StoreError::BlobGone { .. })));
}

#[tokio::test]
async fn a_server_that_lets_nobody_in_is_one_that_is_away() {
    let database = fresh_database().await;
    let mut own = <sqlx::PgConnection as sqlx::Connection>::connect(&database).await.unwrap();
    let mut reported = async |order: &'static str| sqlx::raw_sql(order).execute(&mut own).await.unwrap();
    reported("CREATE ROLE ward LOGIN SUPERUSER PASSWORD 'key'").await;
    let (_, server) = database.split_once('@').unwrap();
    let (directory, bucket) = (tempfile::tempdir().unwrap(), Bucket::start().await);
    let store = open_shared(directory.path(), &format!("postgres://ward:key@{server}"), &bucket).await;
    let kept = add_session(&store, "a").await;
    reported("ALTER ROLE ward NOLOGIN; SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE usename = 'ward'")
        .await;
    let refused = store.session(kept.id).await;
    assert!(matches!(refused, Err(StoreError::Unreachable(_))), "{refused:?}");
    reported("ALTER ROLE ward LOGIN").await;
    assert_eq!(store.session(kept.id).await.unwrap(), Some(kept));
}

#[tokio::test]
async fn databases_of_other_formats_are_refused() {
    let database = fresh_database().await;
    let url: DatabaseUrl = database.parse().unwrap();
    assert_eq!(url.migrate().await.unwrap(), (0, 9));
    assert_eq!(url.migrate().await.unwrap(), (9, 9));
    let mut connection = <sqlx::PgConnection as sqlx::Connection>::connect(&database).await.unwrap();
    let later = "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
                 VALUES (10, 'later', true, 'x', 0)";
    let encrypted = sqlx::query_scalar::<_, bool>("SELECT ssl FROM pg_stat_ssl WHERE pid = pg_backend_pid()");
    assert!(encrypted.fetch_one(&mut connection).await.unwrap(), "TLS is used where the server has it");
    sqlx::query(later).execute(&mut connection).await.unwrap();
    let refused = url.migrate().await;
    assert!(matches!(refused, Err(StoreError::Newer { found: 10, known: 9 })), "{refused:?}");
    sqlx::query("UPDATE _sqlx_migrations SET checksum = 'y' WHERE version = 1").execute(&mut connection).await.unwrap();
    assert!(matches!(url.migrate().await, Err(StoreError::ForeignTables)));

    let database = fresh_database().await;
    let mut connection = <sqlx::PgConnection as sqlx::Connection>::connect(&database).await.unwrap();
    sqlx::query("CREATE TABLE sessions (sid TEXT)").execute(&mut connection).await.unwrap();
    let refused = database.parse::<DatabaseUrl>().unwrap().migrate().await;
    assert!(matches!(refused, Err(StoreError::ForeignTables)), "{refused:?}");
    let data = tempfile::tempdir().unwrap();
    let away = StoreLocation {
        database: Some("postgres://127.0.0.1:1/none".parse().unwrap()),
        blobs: None,
        ..StoreLocation::default()
    };
    let refused = Store::open_at(data.path(), &away).await;
    assert!(matches!(refused, Err(StoreError::Unreachable(_))), "{refused:?}");
}
