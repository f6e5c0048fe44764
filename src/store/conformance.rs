//! What every engine does alike, run on memory and on SQLite with files.

use std::time::Duration;

use super::*;

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
        number: 0,
        id: JobId::new(),
        session,
        tenant: TenantId::local(),
        kind: JobKind::Solve,
        state: JobState::Accepted,
        phase: "waiting".to_owned(),
        progress: 0.0,
        steps: 2,
        attempt: 0,
        fence: 0,
        request: request.to_owned(),
        subject: Some("plan".to_owned()),
        other_session: None,
        max_wall_s: Some(60.0),
        traceparent: Some("00-1-2-01".to_owned()),
        cancel_requested_at: None,
        superseded_by: None,
        events_from: 1,
        report: None,
        fault: None,
        warnings: Vec::new(),
        rest_blob: None,
        tissue_blob: None,
        created_at: now_rfc3339(),
        started_at: None,
        finished_at: None,
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

const MANY: QueueLimits = QueueLimits { all: 100, tenant: 100 };

async fn insert(store: &Store, job: &JobRecord, limits: QueueLimits, supersede: bool) -> Insertion {
    let supersede = supersede.then(|| Supersede {
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
    let started = |job: &JobRecord| JobChange {
        phase: Some("reading"),
        attempt_change: 1,
        events: vec![("status", format!("{{\"attempt\":{}}}", job.attempt + 1))],
        ..JobChange::default()
    };
    store.claim_job(Lane::Heavy, JobState::Running, &started).await.unwrap()
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

async fn sessions_belong_to_tenants_and_are_listed_newest_first(store: Store) {
    let [a1, a2, b1] = [add_session(&store, "a").await, add_session(&store, "a").await, add_session(&store, "b").await];
    let a: TenantId = "a".parse().unwrap();
    assert_eq!(store.sessions(Some(&a), None, 10).await.unwrap(), [a2.clone(), a1.clone()]);
    assert_eq!(store.sessions(Some(&a), Some(a2.id), 10).await.unwrap(), std::slice::from_ref(&a1));
    assert_eq!(store.sessions(None, None, 2).await.unwrap(), [b1.clone(), a2]);
    let owner = |deleted| Some(Owner { tenant: a.clone(), deleted });
    assert_eq!(store.owner(&a1.id.to_string()).await.unwrap(), owner(false));
    assert!(store.delete_session(a1.id).await.unwrap());
    assert!(!store.delete_session(a1.id).await.unwrap());
    assert_eq!(store.owner(&a1.id.to_string()).await.unwrap(), owner(true));
    assert!(store.is_deleted(&a1.id.to_string()).await.unwrap());
    assert_eq!(store.owner("nothing").await.unwrap(), None);
    assert_eq!(store.session(b1.id).await.unwrap(), Some(b1));
}

async fn answers_are_remembered_by_tenant_and_key(store: Store) {
    let record = session("a");
    store.insert_session(&record, Some(&answer("a", "k", record.id))).await.unwrap();
    let (a, b): (TenantId, TenantId) = ("a".parse().unwrap(), "b".parse().unwrap());
    assert!(matches!(store.remembered(&a, "k", "abc").await.unwrap(), Remembered::Answer(a) if a.status == 201));
    assert_eq!(store.remembered(&a, "k", "other").await.unwrap(), Remembered::OtherRequest);
    assert_eq!(store.remembered(&b, "k", "abc").await.unwrap(), Remembered::Nothing);
    let second = session("a");
    let taken = store.insert_session(&second, Some(&answer("a", "k", second.id))).await;
    assert!(matches!(taken, Err(StoreError::KeyTaken)));
    assert_eq!(store.session(second.id).await.unwrap(), None, "both or none");
    store.delete_session(record.id).await.unwrap();
    assert_eq!(store.remembered(&a, "k", "abc").await.unwrap(), Remembered::Nothing);
}

async fn parts_replace_each_other_within_the_quota(store: Store) {
    let store = store.with_quota(10);
    let id = add_session(&store, "a").await.id;
    let (first, second) = (blob(&store, id, b"12345").await, blob(&store, id, b"123456").await);
    store.put_parts(id, &[part_with(PartKind::Skin, &first)]).await.unwrap();
    store.put_parts(id, &[part_with(PartKind::Skin, &second)]).await.unwrap();
    assert!(matches!(store.blobs().get(&first.key).await, Err(StoreError::BlobGone)));
    assert_eq!((store.session_bytes(id).await.unwrap(), store.room(id).await.unwrap()), (6, 4));
    let third = blob(&store, id, b"12345").await;
    let full = store.put_parts(id, &[part_with(PartKind::Skull, &third)]).await;
    assert!(matches!(full, Err(StoreError::QuotaFull { allowed: 10 })));
    assert!(store.blobs().get(&third.key).await.is_err(), "a refused file does not stay");
    assert_eq!(store.parts(id).await.unwrap().len(), 1);
    let orphan = blob(&store, id, b"1").await;
    let gone = store.put_parts(SessionId::new(), &[part_with(PartKind::Skin, &orphan)]).await;
    assert!(matches!(gone, Err(StoreError::SessionGone)));
    assert!(store.delete_part(id, PartKind::Skin).await.unwrap());
    assert!(!store.delete_part(id, PartKind::Skin).await.unwrap());
    assert!(store.blobs().get(&second.key).await.is_err());
}

async fn plans_go_with_their_osteotomy(store: Store) {
    let id = add_session(&store, "a").await.id;
    let surface = blob(&store, id, b"segment").await;
    let osteotomy = OsteotomyRecord {
        id: OsteotomyId::new(),
        session: id,
        field_key: "f".to_owned(),
        wall_s: 0.1,
        bytes: surface.bytes,
        document: "{}".to_owned(),
        blobs: vec![surface.key.clone()],
        created_at: now_rfc3339(),
    };
    store.insert_osteotomy(&osteotomy, None).await.unwrap();
    let plan = |osteotomy| PlanRecord {
        id: PlanId::new(),
        session: id,
        osteotomy,
        document: "{}".to_owned(),
        created_at: now_rfc3339(),
    };
    let (bound, free) = (plan(Some(osteotomy.id)), plan(None));
    store.insert_plan(&bound, None).await.unwrap();
    store.insert_plan(&free, None).await.unwrap();
    assert!(matches!(store.insert_plan(&plan(Some(OsteotomyId::new())), None).await, Err(StoreError::SessionGone)));
    assert_eq!(store.osteotomy(id, osteotomy.id).await.unwrap(), Some(osteotomy.clone()));
    assert!(!store.delete_osteotomy(SessionId::new(), osteotomy.id).await.unwrap(), "not another session's");
    assert!(store.delete_osteotomy(id, osteotomy.id).await.unwrap());
    assert_eq!(store.plans(id).await.unwrap(), std::slice::from_ref(&free));
    assert!(store.is_deleted(&bound.id.to_string()).await.unwrap());
    assert!(store.blobs().get(&surface.key).await.is_err());
    assert!(store.delete_plan(id, free.id).await.unwrap() && !store.delete_plan(id, free.id).await.unwrap());
}

async fn a_job_that_is_asked_for_twice_is_stored_once(store: Store) {
    let id = add_session(&store, "a").await.id;
    let first = accept(&store, id, "same").await;
    let again = insert(&store, &job(id, "same"), MANY, false).await;
    assert!(matches!(again, Insertion::Twin(twin, Some(0)) if twin.id == first));
    assert!(matches!(insert(&store, &job(id, "other"), MANY, false).await, Insertion::Stored { .. }));
    let stored = store.job(first).await.unwrap().unwrap();
    assert_eq!((stored.tenant.as_str(), stored.max_wall_s, stored.events_from), ("a", Some(60.0), 1));
    let orphan =
        NewJob { job: &job(SessionId::new(), "x"), limits: MANY, event: "{}", supersede: None, answer: &|_, _| None };
    assert!(matches!(store.insert_job(&orphan).await, Err(StoreError::SessionGone)));
}

async fn the_queue_is_bounded_in_all_and_by_tenant(store: Store) {
    let (a, b) = (add_session(&store, "a").await.id, add_session(&store, "b").await.id);
    let limits = QueueLimits { all: 3, tenant: 2 };
    for n in 0..2 {
        assert!(matches!(insert(&store, &job(a, &n.to_string()), limits, false).await, Insertion::Stored { .. }));
    }
    assert_eq!(insert(&store, &job(a, "2"), limits, false).await, Insertion::TenantFull);
    assert!(matches!(insert(&store, &job(b, "0"), limits, false).await, Insertion::Stored { .. }));
    let refused = job(b, "1");
    assert_eq!(insert(&store, &refused, limits, false).await, Insertion::Full);
    assert_eq!(store.job(refused.id).await.unwrap(), None);
    assert_eq!(store.queue(Lane::Heavy).await.unwrap().len(), 3);
    // One that makes room for itself fits.
    assert!(
        matches!(insert(&store, &job(a, "3"), limits, true).await, Insertion::Stored { superseded, before: 1 } if superseded.len() == 2)
    );
}

async fn tenants_take_turns(store: Store) {
    let (a, b) = (add_session(&store, "a").await.id, add_session(&store, "b").await.id);
    let mut jobs = Vec::new();
    for (session, request) in [(a, "1"), (a, "2"), (a, "3"), (b, "4"), (b, "5")] {
        jobs.push(accept(&store, session, request).await);
    }
    let [a1, a2, a3, b1, b2] = jobs.try_into().unwrap();
    assert_eq!(store.queue(Lane::Heavy).await.unwrap(), [a1, b1, a2, b2, a3]);
    let mut claimed = Vec::new();
    while let Some(job) = claim(&store).await {
        assert_eq!((job.state, job.attempt, job.fence), (JobState::Running, 1, 1));
        claimed.push(job.id);
        assert!(store.change_job(&job, JobState::Succeeded, &JobChange::default()).await.unwrap());
    }
    assert_eq!(claimed, [a1, b1, a2, b2, a3]);
    // Who was served longest ago is first, whoever asked first.
    let (late_a, late_b) = (accept(&store, a, "6").await, accept(&store, b, "7").await);
    assert_eq!(store.queue(Lane::Heavy).await.unwrap(), [late_b, late_a]);
    assert_eq!(store.queue(Lane::Quick).await.unwrap(), []);
}

async fn a_newer_job_takes_the_place_of_waiting_ones(store: Store) {
    let id = add_session(&store, "a").await.id;
    let running = accept(&store, id, "1").await;
    assert_eq!(claim(&store).await.unwrap().id, running);
    let waiting = accept(&store, id, "2").await;
    let mut elsewhere = job(id, "3");
    elsewhere.subject = Some("another plan".to_owned());
    insert(&store, &elsewhere, MANY, false).await;
    let newer = job(id, "4");
    assert_eq!(insert(&store, &newer, MANY, true).await, Insertion::Stored { superseded: vec![waiting], before: 1 });
    let old = store.job(waiting).await.unwrap().unwrap();
    assert_eq!((old.state, old.superseded_by), (JobState::Cancelled, Some(newer.id)));
    assert!(old.finished_at.is_some());
    assert_eq!(store.events(waiting, 0).await.unwrap().last().unwrap().kind, "end");
    for (job, state) in [(running, JobState::Running), (elsewhere.id, JobState::Accepted)] {
        assert_eq!(store.job(job).await.unwrap().unwrap().state, state);
    }
}

async fn what_comes_under_an_old_fence_is_refused(store: Store) {
    let id = add_session(&store, "a").await.id;
    accept(&store, id, "1").await;
    let first = claim(&store).await.unwrap();
    assert!(store.change_job(&first, JobState::Interrupted, &JobChange::default()).await.unwrap());
    assert!(!store.change_job(&first, JobState::Succeeded, &JobChange::default()).await.unwrap());
    let interrupted = store.job(first.id).await.unwrap().unwrap();
    assert!(store.change_job(&interrupted, JobState::Accepted, &JobChange::default()).await.unwrap());
    let second = claim(&store).await.unwrap();
    assert_eq!((second.id, second.fence, second.attempt), (first.id, 2, 2));
    let frame = blob(&store, id, b"late").await;
    assert!(matches!(store.commit_step(&first, &step(1, &frame), &[]).await, Err(StoreError::SessionGone)));
    assert!(store.blobs().get(&frame.key).await.is_err());
    assert!(!store.record_progress(&first, "solve", 0.5, "{}").await.unwrap());
    let rest = blob(&store, id, b"rest").await;
    assert!(matches!(store.set_rest(&first, &rest).await, Err(StoreError::SessionGone)));
    assert!(store.record_progress(&second, "solve", 0.5, "{}").await.unwrap());
    let late = JobChange { tissue: Some(blob(&store, id, b"tissue").await), ..JobChange::default() };
    assert!(!store.change_job(&first, JobState::Succeeded, &late).await.unwrap());
    assert!(store.blobs().get(&late.tissue.unwrap().key).await.is_err());
}

async fn a_job_that_was_asked_to_stop_can_only_be_cancelled(store: Store) {
    let id = add_session(&store, "a").await.id;
    let (first, second) = (accept(&store, id, "1").await, accept(&store, id, "2").await);
    let running = claim(&store).await.unwrap();
    assert_eq!((running.id, running.cancel_requested_at.clone()), (first, None));
    assert!(store.request_cancel(first).await.unwrap());
    let asked = store.job(first).await.unwrap().unwrap();
    assert!(asked.cancel_requested_at.is_some() && asked.state == JobState::Running);
    assert!(store.request_cancel(first).await.unwrap(), "asking again changes nothing");
    assert_eq!(store.job(first).await.unwrap().unwrap(), asked);
    // It is no twin any more: who asks for the same wants it done.
    assert!(matches!(insert(&store, &job(id, "1"), MANY, false).await, Insertion::Stored { before: 1, .. }));
    for to in [JobState::Succeeded, JobState::Failed] {
        assert!(!store.change_job(&running, to, &JobChange::default()).await.unwrap(), "{to}");
    }
    assert!(store.change_job(&running, JobState::Interrupted, &JobChange::default()).await.unwrap());
    let interrupted = store.job(first).await.unwrap().unwrap();
    assert!(!store.change_job(&interrupted, JobState::Accepted, &JobChange::default()).await.unwrap());
    assert!(store.change_job(&interrupted, JobState::Cancelled, &JobChange::default()).await.unwrap());
    assert!(!store.request_cancel(first).await.unwrap(), "it has ended");
    assert!(!store.request_cancel(JobId::new()).await.unwrap());
    // One that waits is not begun.
    assert!(store.request_cancel(second).await.unwrap());
    assert!(!store.queue(Lane::Heavy).await.unwrap().contains(&second));
    assert_ne!(claim(&store).await.unwrap().id, second);
    assert!(claim(&store).await.is_none());
}

async fn many_sessions_are_looked_into_at_once(store: Store) {
    let (full, empty) = (add_session(&store, "a").await.id, add_session(&store, "a").await.id);
    let other = add_session(&store, "b").await.id;
    for (session, bytes) in [(full, b"1234"), (other, b"5678")] {
        let skin = blob(&store, session, bytes).await;
        store.put_parts(session, &[part_with(PartKind::Skin, &skin)]).await.unwrap();
    }
    let osteotomy = OsteotomyRecord {
        id: OsteotomyId::new(),
        session: full,
        field_key: "f".to_owned(),
        wall_s: 0.1,
        bytes: 10,
        document: "{}".to_owned(),
        blobs: Vec::new(),
        created_at: now_rfc3339(),
    };
    store.insert_osteotomy(&osteotomy, None).await.unwrap();
    let plan = |session| PlanRecord {
        id: PlanId::new(),
        session,
        osteotomy: None,
        document: "{}".to_owned(),
        created_at: now_rfc3339(),
    };
    let (own, others) = (plan(full), plan(other));
    store.insert_plan(&own, None).await.unwrap();
    store.insert_plan(&others, None).await.unwrap();
    let first = accept(&store, full, "1").await;
    let running = claim(&store).await.unwrap();
    for k in [2, 1] {
        let frame = blob(&store, full, b"frame").await;
        store.commit_step(&running, &step(k, &frame), &[]).await.unwrap();
    }
    let (second, third) = (accept(&store, full, "2").await, accept(&store, full, "3").await);
    let foreign = accept(&store, other, "4").await;

    let found = store.contents(&[full, empty, SessionId::new()], 2).await.unwrap();
    assert_eq!(
        found.keys().copied().collect::<Vec<_>>(),
        [full, empty],
        "only those that were asked for and are there"
    );
    assert_eq!(found[&empty], SessionContents::default());
    let held = &found[&full];
    assert_eq!(held.parts, store.parts(full).await.unwrap());
    assert_eq!((held.osteotomies.as_slice(), held.plans.as_slice()), (&[osteotomy.id][..], &[own.id][..]));
    assert_eq!(held.jobs.iter().map(|j| j.id).collect::<Vec<_>>(), [third, second], "the newest");
    assert_eq!(held.bytes, 4 + 10 + 5 + 5);
    assert_eq!(held.bytes, store.session_bytes(full).await.unwrap());
    assert_eq!(store.session_bytes(SessionId::new()).await.unwrap(), 0);
    assert_eq!(store.contents(&[], 2).await.unwrap().len(), 0);

    let steps = store.steps_of(&[second, first, foreign]).await.unwrap();
    assert_eq!(steps.keys().copied().collect::<Vec<_>>(), [first], "only jobs that have some");
    assert_eq!(steps[&first].iter().map(|s| s.k).collect::<Vec<_>>(), [1, 2]);
    assert_eq!(steps[&first], store.steps(first).await.unwrap());
}

async fn steps_are_kept_and_the_same_one_is_told_once(store: Store) {
    let id = add_session(&store, "a").await.id;
    accept(&store, id, "1").await;
    let running = claim(&store).await.unwrap();
    let told = [("step", "{\"k\":1}".to_owned())];
    let frame = blob(&store, id, b"frame").await;
    assert_eq!(store.commit_step(&running, &step(1, &frame), &told).await.unwrap(), StepWritten::New(None));
    let same = blob(&store, id, b"frame").await;
    assert_eq!(store.commit_step(&running, &step(1, &same), &told).await.unwrap(), StepWritten::Same);
    assert!(store.blobs().get(&same.key).await.is_err());
    assert_eq!(store.step(running.id, 1).await.unwrap().unwrap().blob, frame.key);
    let other = blob(&store, id, b"other").await;
    let replaced = store.commit_step(&running, &step(1, &other), &told).await.unwrap();
    assert_eq!(replaced, StepWritten::New(Some(frame.key.clone())));
    assert!(store.blobs().get(&frame.key).await.is_err());
    let kinds: Vec<String> = store.events(running.id, 0).await.unwrap().into_iter().map(|e| e.kind).collect();
    assert_eq!(kinds, ["status", "status", "step", "step"]);
    let rest = blob(&store, id, b"123").await;
    store.set_rest(&running, &rest).await.unwrap();
    assert_eq!(store.session_bytes(id).await.unwrap(), 5 + 3);
    let full = store.clone().with_quota(9);
    let tissue = JobChange { tissue: Some(blob(&store, id, b"12").await), ..JobChange::default() };
    assert!(matches!(
        full.change_job(&running, JobState::Succeeded, &tissue).await,
        Err(StoreError::QuotaFull { allowed: 9 })
    ));
    assert_eq!(store.job(running.id).await.unwrap().unwrap().state, JobState::Running);
    let large = blob(&store, id, b"123456").await;
    assert!(matches!(full.commit_step(&running, &step(2, &large), &[]).await, Err(StoreError::QuotaFull { .. })));
    assert_eq!(store.steps(running.id).await.unwrap().len(), 1);
}

async fn events_count_up_and_old_ones_go(store: Store) {
    let id = add_session(&store, "a").await.id;
    accept(&store, id, "1").await;
    let running = claim(&store).await.unwrap();
    for n in 0..150 {
        assert!(store.record_progress(&running, "solve", f64::from(n) / 150.0, "{}").await.unwrap());
    }
    let events = store.events(running.id, 0).await.unwrap();
    let numbers: Vec<u64> = events.iter().map(|e| e.seq).collect();
    assert!(numbers.is_sorted() && numbers.last() == Some(&152), "{numbers:?}");
    assert_eq!(events.iter().filter(|e| e.kind == "progress").count(), 100);
    assert_eq!(events.iter().filter(|e| e.kind == "status").count(), 2, "only progress is dropped");
    assert_eq!(store.events(running.id, 150).await.unwrap().len(), 2);

    assert_eq!(store.prune_events(Duration::ZERO).await.unwrap(), 0, "a running job keeps its history");
    let change = JobChange {
        warnings: vec!["w".to_owned(), "w".to_owned()],
        report: Some("{}".to_owned()),
        events: vec![("end", "{}".to_owned())],
        ..JobChange::default()
    };
    assert!(store.change_job(&running, JobState::Succeeded, &change).await.unwrap());
    assert_eq!(store.prune_events(Duration::from_secs(600)).await.unwrap(), 0, "it has just ended");
    // Times have milliseconds.
    tokio::time::sleep(Duration::from_millis(5)).await;
    assert_eq!(store.prune_events(Duration::ZERO).await.unwrap(), 102);
    let left = store.events(running.id, 0).await.unwrap();
    assert_eq!((left.len(), left[0].seq, left[0].kind.as_str()), (1, 153, "end"));
    let ended = store.job(running.id).await.unwrap().unwrap();
    assert_eq!((ended.events_from, ended.progress, ended.warnings.as_slice()), (153, 1.0, &["w".to_owned()][..]));
}

async fn results_of_old_comparisons_go(store: Store) {
    let id = add_session(&store, "a").await.id;
    let compare = JobRecord { kind: JobKind::Compare, ..job(id, "compare") };
    for new in [&compare, &job(id, "solve")] {
        insert(&store, new, MANY, false).await;
    }
    let mut kept = Vec::new();
    for lane in [Lane::Quick, Lane::Heavy] {
        let change = |_: &JobRecord| JobChange::default();
        let running = store.claim_job(lane, JobState::Running, &change).await.unwrap().unwrap();
        let rest = blob(&store, id, b"123").await;
        store.set_rest(&running, &rest).await.unwrap();
        assert_eq!(store.drop_comparisons(Duration::ZERO).await.unwrap(), 0, "it runs");
        let values = blob(&store, id, b"12345").await;
        let change = JobChange { tissue: Some(values.clone()), report: Some("{}".to_owned()), ..JobChange::default() };
        assert!(store.change_job(&running, JobState::Succeeded, &change).await.unwrap());
        kept.push((running.id, rest.key, values.key));
        if lane == Lane::Quick {
            assert_eq!(store.drop_comparisons(Duration::from_secs(600)).await.unwrap(), 0, "it has just ended");
            tokio::time::sleep(Duration::from_millis(5)).await;
            assert_eq!(store.drop_comparisons(Duration::ZERO).await.unwrap(), 2);
            assert_eq!(store.drop_comparisons(Duration::ZERO).await.unwrap(), 0);
        }
    }
    let [(compared, rest, values), (solved, kept_rest, kept_values)] = kept.try_into().unwrap();
    for key in [rest, values] {
        assert!(matches!(store.blobs().get(&key).await, Err(StoreError::BlobGone)));
    }
    let row = store.job(compared).await.unwrap().unwrap();
    assert_eq!((row.state, row.rest_blob, row.tissue_blob), (JobState::Succeeded, None, None));
    assert!(row.report.is_some());
    tokio::time::sleep(Duration::from_millis(5)).await;
    assert_eq!(store.drop_comparisons(Duration::ZERO).await.unwrap(), 0, "a solve keeps its results");
    assert!(store.job(solved).await.unwrap().unwrap().rest_blob.is_some());
    assert!(store.blobs().get(&kept_rest).await.is_ok() && store.blobs().get(&kept_values).await.is_ok());
    assert_eq!(store.session_bytes(id).await.unwrap(), 8);
}

async fn a_deleted_session_leaves_nothing(store: Store) {
    let (gone, other) = (add_session(&store, "a").await.id, add_session(&store, "a").await.id);
    let skin = blob(&store, gone, b"skin").await;
    store.put_parts(gone, &[part_with(PartKind::Skin, &skin)]).await.unwrap();
    // A comparison of the other session with this one.
    let mut compare = job(other, "compare");
    compare.other_session = Some(gone);
    insert(&store, &compare, MANY, false).await;
    let running = claim(&store).await.unwrap();
    let rest = blob(&store, other, b"rest").await;
    store.set_rest(&running, &rest).await.unwrap();
    assert!(store.delete_session(gone).await.unwrap());
    assert_eq!(store.job(running.id).await.unwrap(), None);
    assert!(store.is_deleted(&running.id.to_string()).await.unwrap());
    for key in [&skin.key, &rest.key] {
        assert!(store.blobs().get(key).await.is_err());
    }
    assert_eq!(store.session_bytes(other).await.unwrap(), 0);
    assert!(!store.change_job(&running, JobState::Succeeded, &JobChange::default()).await.unwrap());
}

async fn the_end_of_the_audit_log_is_noted(store: Store) {
    assert_eq!(store.audit_anchor().await.unwrap(), None);
    for chain in ["a", "b"] {
        store.set_audit_anchor(chain).await.unwrap();
        let (noted, at) = store.audit_anchor().await.unwrap().unwrap();
        assert!(noted == chain && at <= now_rfc3339());
    }
}

async fn idle_sessions_are_found(store: Store) {
    let (idle, busy) = (add_session(&store, "a").await, add_session(&store, "a").await);
    accept(&store, busy.id, "1").await;
    assert_eq!(store.idle_sessions(Duration::from_secs(600)).await.unwrap(), []);
    tokio::time::sleep(Duration::from_millis(5)).await;
    assert_eq!(store.idle_sessions(Duration::ZERO).await.unwrap(), std::slice::from_ref(&idle));
    assert_eq!(store.last_used(idle.id).await.unwrap(), Some(idle.created_at.clone()));
    assert_eq!(store.last_used(SessionId::new()).await.unwrap(), None);
    store.forget_old_answers(Duration::ZERO).await.unwrap();
}

macro_rules! conforms {
    ($($name:ident,)*) => {
        mod memory {
            $(#[tokio::test]
            async fn $name() {
                super::$name(super::Store::in_memory()).await;
            })*
        }

        mod embedded {
            $(#[tokio::test]
            async fn $name() {
                let directory = tempfile::tempdir().unwrap();
                super::$name(super::Store::open(directory.path()).await.unwrap()).await;
            })*
        }
    };
}

conforms! {
    sessions_belong_to_tenants_and_are_listed_newest_first,
    answers_are_remembered_by_tenant_and_key,
    parts_replace_each_other_within_the_quota,
    plans_go_with_their_osteotomy,
    a_job_that_is_asked_for_twice_is_stored_once,
    the_queue_is_bounded_in_all_and_by_tenant,
    tenants_take_turns,
    a_newer_job_takes_the_place_of_waiting_ones,
    what_comes_under_an_old_fence_is_refused,
    a_job_that_was_asked_to_stop_can_only_be_cancelled,
    many_sessions_are_looked_into_at_once,
    steps_are_kept_and_the_same_one_is_told_once,
    events_count_up_and_old_ones_go,
    results_of_old_comparisons_go,
    a_deleted_session_leaves_nothing,
    idle_sessions_are_found,
    the_end_of_the_audit_log_is_noted,
}
