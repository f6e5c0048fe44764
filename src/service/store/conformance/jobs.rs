//! Jobs, their queue, steps and events.

use super::*;

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
    // A job that supersedes waiting ones fits into a full queue.
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
    // The tenant whose last turn is longest ago comes first, whatever the order of the requests.
    let (late_a, late_b) = (accept(&store, a, "6").await, accept(&store, b, "7").await);
    assert_eq!(store.queue(Lane::Heavy).await.unwrap(), [late_b, late_a]);
    assert_eq!(store.queue(Lane::Quick).await.unwrap(), []);
}

async fn a_job_waits_a_little_for_the_worker_that_knows_its_session(store: Store) {
    let (known, new) = (add_session(&store, "a").await.id, add_session(&store, "a").await.id);
    let (own, other) = (Some(WorkerId::new()), Some(WorkerId::new()));
    let by = async |worker| claim_by(&store, Lane::Heavy, worker).await.map(|job| job.id);
    let first = accept(&store, known, "1").await;
    assert_eq!(by(own).await, Some(first));
    let (second, elsewhere) = (accept(&store, known, "2").await, accept(&store, new, "3").await);
    assert_eq!(by(other).await, Some(elsewhere), "nobody knows that session");
    assert_eq!(by(other).await, None);
    assert_eq!(store.queue(Lane::Heavy).await.unwrap(), [second], "its place in the queue is the same");
    assert_eq!(by(own).await, Some(second));
    let third = accept(&store, known, "4").await;
    assert_eq!(by(other).await, None);
    tokio::time::sleep(Claim::HEAD_START + Duration::from_millis(20)).await;
    assert_eq!(by(other).await, Some(third), "the worker that knows it has something else to do");
    // From now on the other worker knows the session.
    let fourth = accept(&store, known, "5").await;
    assert_eq!(by(own).await, None);
    assert_eq!(by(other).await, Some(fourth));
    let fifth = accept(&store, known, "6").await;
    assert_eq!(by(None).await, Some(fifth), "who has no name takes what is first");
}

/// A claim looks at the first jobs of a tenant only, as long as it may take one of these.
async fn a_job_behind_many_that_are_left_to_another_worker_is_found(store: Store) {
    let (known, new) = (add_session(&store, "a").await.id, add_session(&store, "a").await.id);
    let (own, other) = (Some(WorkerId::new()), Some(WorkerId::new()));
    let by = async |worker| claim_by(&store, Lane::Heavy, worker).await.map(|job| job.id);
    let first = accept(&store, known, "0").await;
    assert_eq!(by(own).await, Some(first));
    let begun = Instant::now();
    for n in 1..=20 {
        accept(&store, known, &n.to_string()).await;
    }
    let last = accept(&store, new, "21").await;
    let claimed = by(other).await;
    // On a slow machine the head start of the first ones is over by now.
    assert!(claimed == Some(last) || begun.elapsed() >= Claim::HEAD_START, "{claimed:?} instead of {last}");
}

async fn a_worker_takes_first_what_it_knows_but_nobody_waits_for_ever(store: Store) {
    let known = add_session(&store, "a").await.id;
    let (own, other) = (Some(WorkerId::new()), Some(WorkerId::new()));
    let by = async |worker| claim_by(&store, Lane::Heavy, worker).await.map(|job| job.id);
    let first = accept(&store, known, "1").await;
    assert_eq!(by(own).await, Some(first));
    let mut others = Vec::new();
    for session in [add_session(&store, "a").await.id, add_session(&store, "b").await.id] {
        let begun = accept(&store, session, "2").await;
        assert_eq!(by(other).await, Some(begun));
        others.push(accept(&store, session, "3").await);
    }
    let mine = [accept(&store, known, "4").await, accept(&store, known, "5").await];
    tokio::time::sleep(Claim::HEAD_START + Duration::from_millis(20)).await;
    assert_eq!(by(own).await, Some(mine[0]), "the others came first, but another worker knows them");
    tokio::time::sleep(PATIENCE - Claim::HEAD_START).await;
    assert_eq!(by(own).await, Some(others[1]), "all have waited long enough, and tenants take turns");
    assert_eq!(by(own).await, Some(others[0]));
    assert_eq!(by(own).await, Some(mine[1]));
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
    assert_eq!(
        insert(&store, &newer, MANY, true).await,
        Insertion::Stored { superseded: vec![(waiting, None)], before: 1 }
    );
    let old = store.job(waiting).await.unwrap().unwrap();
    assert_eq!((old.state, old.superseded_by), (JobState::Cancelled, Some(newer.id)));
    assert!(old.finished_at.is_some());
    assert_eq!(store.events(waiting, 0).await.unwrap().last().unwrap().kind, "end");
    for (job, state) in [(running, JobState::Running), (elsewhere.id, JobState::Accepted)] {
        assert_eq!(store.job(job).await.unwrap().unwrap().state, state);
    }
    // Of the whole session: both that wait, whatever their plans, and not the running one.
    let last = job(id, "5");
    let superseded = vec![(elsewhere.id, None), (newer.id, None)];
    let scope = Some(SupersedeScope::Session);
    assert_eq!(insert_over(&store, &last, MANY, scope).await, Insertion::Stored { superseded, before: 0 });
    assert_eq!(store.job(running).await.unwrap().unwrap().state, JobState::Running);
}

async fn a_job_is_continued_by_another_in_the_change_that_ends_it(store: Store) {
    let id = add_session(&store, "a").await.id;
    accept(&store, id, "1").await;
    let first = claim(&store).await.unwrap();
    let next = JobRecord { continues: Some(first.id), ..job(id, "2") };
    let continuation = || Some(Box::new((next.clone(), "{}".to_owned())));
    let change = JobChange { continuation: continuation(), ..JobChange::default() };
    // A change that is refused stores no job.
    let stale = JobRecord { fence: first.fence + 1, ..first.clone() };
    assert!(!store.change_job(&stale, JobState::Succeeded, &change).await.unwrap());
    assert_eq!(store.job(next.id).await.unwrap(), None);
    assert!(store.change_job(&first, JobState::Succeeded, &change).await.unwrap());
    assert!(!store.change_job(&first, JobState::Succeeded, &change).await.unwrap(), "it is stored once");
    let [first, stored] = [first.id, next.id].map(|id| store.job(id));
    let (first, stored) = (first.await.unwrap().unwrap(), stored.await.unwrap().unwrap());
    assert_eq!((first.state, first.continued_by), (JobState::Succeeded, Some(next.id)));
    assert_eq!((stored.state, stored.continues, stored.tenant.as_str()), (JobState::Accepted, Some(first.id), "a"));
    assert_eq!(store.events(next.id, 0).await.unwrap().len(), 1);
    assert_eq!(claim(&store).await.unwrap().id, next.id);
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

async fn a_lease_is_renewed_by_its_worker_and_passes_without(store: Store) {
    let id = add_session(&store, "a").await.id;
    let waiting = accept(&store, id, "1").await;
    let running = claim(&store).await.unwrap();
    let passed = async |wait| {
        tokio::time::sleep(wait).await;
        store.meta().abandoned().await.unwrap().iter().map(|j| j.id).collect::<Vec<_>>()
    };
    assert_eq!(passed(Duration::ZERO).await, []);
    assert_eq!(store.renew(&running, Duration::from_millis(50)).await.unwrap(), Some(false));
    assert_eq!(passed(Duration::from_millis(100)).await, [waiting]);
    // A lease that was renewed and has expired again is not equal to the earlier one.
    let once = store.meta().abandoned().await.unwrap();
    assert_eq!(store.meta().abandoned().await.unwrap(), once);
    assert_eq!(store.renew(&running, Duration::from_millis(50)).await.unwrap(), Some(false));
    assert_eq!(passed(Duration::from_millis(100)).await, [waiting]);
    assert_ne!(store.meta().abandoned().await.unwrap(), once);
    assert_eq!(store.renew(&running, LEASE).await.unwrap(), Some(false), "nobody took it meanwhile");
    assert_eq!(passed(Duration::ZERO).await, []);
    assert!(store.request_cancel(running.id).await.unwrap());
    assert_eq!(store.renew(&running, LEASE).await.unwrap(), Some(true));
    assert!(store.change_job(&running, JobState::Interrupted, &JobChange::default()).await.unwrap());
    assert_eq!(store.renew(&running, LEASE).await.unwrap(), None, "it is not its worker's any more");
    assert_eq!(passed(Duration::ZERO).await, []);
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
    // A job with a cancellation request is no twin: a client that repeats the request wants a result.
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
    // A waiting job with a cancellation request is not claimed.
    assert!(store.request_cancel(second).await.unwrap());
    assert!(!store.queue(Lane::Heavy).await.unwrap().contains(&second));
    assert_ne!(claim(&store).await.unwrap().id, second);
    assert!(claim(&store).await.is_none());
}

async fn steps_are_kept_and_the_same_one_is_told_once(store: Store) {
    let id = add_session(&store, "a").await.id;
    accept(&store, id, "1").await;
    let running = claim(&store).await.unwrap();
    let reported = [("step", "{\"k\":1}".to_owned())];
    let frame = blob(&store, id, b"frame").await;
    assert_eq!(store.commit_step(&running, &step(1, &frame), &reported).await.unwrap(), StepWritten::New(None));
    let same = blob(&store, id, b"frame").await;
    // The regions of the face may have changed meanwhile.
    let again = StepRecord { error: Some("{}".to_owned()), ..step(1, &same) };
    assert_eq!(store.commit_step(&running, &again, &reported).await.unwrap(), StepWritten::Same);
    assert!(store.blobs().get(&same.key).await.is_err());
    let kept = store.step(running.id, 1).await.unwrap().unwrap();
    assert_eq!((kept.blob, kept.error), (frame.key.clone(), again.error));
    let other = blob(&store, id, b"other").await;
    let replaced = store.commit_step(&running, &step(1, &other), &reported).await.unwrap();
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

async fn a_checkpoint_is_there_for_who_takes_a_job_over_and_goes_with_its_end(store: Store) {
    let id = add_session(&store, "a").await.id;
    accept(&store, id, "1").await;
    let first = claim(&store).await.unwrap();
    let [one, two, three] = [blob(&store, id, b"1").await, blob(&store, id, b"2").await, blob(&store, id, b"3").await];
    store.set_checkpoint(&first, &one).await.unwrap();
    // A repeated call, as after a lost answer.
    store.set_checkpoint(&first, &one).await.unwrap();
    assert_eq!(store.blobs().get(&one.key).await.unwrap().as_ref(), b"1");
    store.set_checkpoint(&first, &two).await.unwrap();
    assert!(store.blobs().get(&one.key).await.is_err());
    assert!(store.change_job(&first, JobState::Interrupted, &JobChange::default()).await.unwrap());
    let interrupted = store.job(first.id).await.unwrap().unwrap();
    assert!(store.change_job(&interrupted, JobState::Accepted, &JobChange::default()).await.unwrap());
    let second = claim(&store).await.unwrap();
    assert_eq!(second.checkpoint_blob.as_ref(), Some(&two.key));
    assert!(matches!(store.set_checkpoint(&first, &three).await, Err(StoreError::SessionGone)));
    assert!(store.blobs().get(&three.key).await.is_err());
    assert_eq!((store.session_bytes(id).await.unwrap(), store.sweep_old().await.unwrap()), (0, 0));
    // The first worker repeats its call, because it did not learn that the key was stored.
    assert!(matches!(store.set_checkpoint(&first, &two).await, Err(StoreError::SessionGone)));
    assert_eq!(store.blobs().get(&two.key).await.unwrap().as_ref(), b"2");
    assert!(store.change_job(&second, JobState::Succeeded, &JobChange::default()).await.unwrap());
    assert_eq!(store.job(first.id).await.unwrap().unwrap().checkpoint_blob, None);
    assert!(store.blobs().get(&two.key).await.is_err());

    accept(&store, id, "2").await;
    let mut row = claim(&store).await.unwrap();
    let four = blob(&store, id, b"4").await;
    store.set_checkpoint(&row, &four).await.unwrap();
    for to in [JobState::Interrupted, JobState::Accepted] {
        assert!(store.change_job(&row, to, &JobChange::default()).await.unwrap());
        row = store.job(row.id).await.unwrap().unwrap();
    }
    let superseded = vec![(row.id, Some(four.key.clone()))];
    assert_eq!(insert(&store, &job(id, "3"), MANY, true).await, Insertion::Stored { superseded, before: 0 });
    assert!(store.blobs().get(&four.key).await.is_err());
}

async fn a_job_that_begins_again_has_no_steps_and_no_checkpoint(store: Store) {
    let id = add_session(&store, "a").await.id;
    let reported = [("step", "{}".to_owned())];
    let mut rows = Vec::new();
    for request in ["other", "again"] {
        accept(&store, id, request).await;
        let running = claim(&store).await.unwrap();
        for k in 1..=2 {
            let frame = blob(&store, id, format!("{request} {k}").as_bytes()).await;
            store.commit_step(&running, &step(k, &frame), &reported).await.unwrap();
        }
        store.set_checkpoint(&running, &blob(&store, id, b"checkpoint").await).await.unwrap();
        rows.push(running);
    }
    let [other, first] = rows.try_into().unwrap();
    for to in [JobState::Interrupted, JobState::Accepted] {
        let row = store.job(first.id).await.unwrap().unwrap();
        assert!(store.change_job(&row, to, &JobChange::default()).await.unwrap());
    }
    let second = claim(&store).await.unwrap();
    assert!(matches!(store.begin_again(&first).await, Err(StoreError::SessionGone)));
    let steps = store.steps(first.id).await.unwrap();
    assert_eq!(steps.len(), 2);
    for _ in 0..2 {
        store.begin_again(&second).await.unwrap();
        assert_eq!(store.job(second.id).await.unwrap().unwrap().checkpoint_blob, None);
        assert_eq!(store.steps(second.id).await.unwrap(), []);
    }
    for key in steps.iter().map(|step| &step.blob).chain(&second.checkpoint_blob) {
        assert!(store.blobs().get(key).await.is_err());
    }
    assert_eq!(store.session_bytes(id).await.unwrap(), 2 * "other 1".len() as u64);
    let frame = blob(&store, id, b"again 1").await;
    assert_eq!(store.commit_step(&second, &step(1, &frame), &reported).await.unwrap(), StepWritten::New(None));
    // Other jobs keep their steps and checkpoints.
    assert_eq!(store.steps(other.id).await.unwrap().len(), 2);
    let checkpoint = store.job(other.id).await.unwrap().unwrap().checkpoint_blob.unwrap();
    assert!(store.blobs().get(&checkpoint).await.is_ok());
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

    assert_eq!(
        store.prune_events(&store.look().await.unwrap(), Duration::ZERO).await.unwrap(),
        0,
        "a running job keeps its history"
    );
    let change = JobChange {
        warnings: vec!["w".to_owned(), "w".to_owned()],
        report: Some("{}".to_owned()),
        events: vec![("end", "{}".to_owned())],
        ..JobChange::default()
    };
    assert!(store.change_job(&running, JobState::Succeeded, &change).await.unwrap());
    assert_eq!(
        store.prune_events(&store.look().await.unwrap(), Duration::from_secs(600)).await.unwrap(),
        0,
        "it has just ended"
    );
    // Times have a resolution of milliseconds.
    tokio::time::sleep(Duration::from_millis(5)).await;
    assert_eq!(store.prune_events(&store.look().await.unwrap(), Duration::ZERO).await.unwrap(), 102);
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
        let running = claim_by(&store, lane, None).await.unwrap();
        let rest = blob(&store, id, b"123").await;
        store.set_rest(&running, &rest).await.unwrap();
        assert_eq!(store.drop_comparisons(&store.look().await.unwrap(), Duration::ZERO).await.unwrap(), 0, "it runs");
        let values = blob(&store, id, b"12345").await;
        let change = JobChange { tissue: Some(values.clone()), report: Some("{}".to_owned()), ..JobChange::default() };
        assert!(store.change_job(&running, JobState::Succeeded, &change).await.unwrap());
        kept.push((running.id, rest.key, values.key));
        if lane == Lane::Quick {
            assert_eq!(
                store.drop_comparisons(&store.look().await.unwrap(), Duration::from_secs(600)).await.unwrap(),
                0,
                "it has just ended"
            );
            tokio::time::sleep(Duration::from_millis(5)).await;
            assert_eq!(store.drop_comparisons(&store.look().await.unwrap(), Duration::ZERO).await.unwrap(), 2);
            assert_eq!(store.drop_comparisons(&store.look().await.unwrap(), Duration::ZERO).await.unwrap(), 0);
        }
    }
    let [(compared, rest, values), (solved, kept_rest, kept_values)] = kept.try_into().unwrap();
    for key in [rest, values] {
        assert!(matches!(store.blobs().get(&key).await, Err(StoreError::BlobGone { .. })));
    }
    let row = store.job(compared).await.unwrap().unwrap();
    assert_eq!((row.state, row.rest_blob, row.tissue_blob), (JobState::Succeeded, None, None));
    assert!(row.report.is_some());
    tokio::time::sleep(Duration::from_millis(5)).await;
    assert_eq!(
        store.drop_comparisons(&store.look().await.unwrap(), Duration::ZERO).await.unwrap(),
        0,
        "a solve keeps its results"
    );
    assert!(store.job(solved).await.unwrap().unwrap().rest_blob.is_some());
    assert!(store.blobs().get(&kept_rest).await.is_ok() && store.blobs().get(&kept_values).await.is_ok());
    assert_eq!(store.session_bytes(id).await.unwrap(), 8);
}

conforms! {
    a_job_that_is_asked_for_twice_is_stored_once,
    the_queue_is_bounded_in_all_and_by_tenant,
    tenants_take_turns,
    a_job_waits_a_little_for_the_worker_that_knows_its_session,
    a_job_behind_many_that_are_left_to_another_worker_is_found,
    a_worker_takes_first_what_it_knows_but_nobody_waits_for_ever,
    a_newer_job_takes_the_place_of_waiting_ones,
    a_job_is_continued_by_another_in_the_change_that_ends_it,
    what_comes_under_an_old_fence_is_refused,
    a_lease_is_renewed_by_its_worker_and_passes_without,
    a_job_that_was_asked_to_stop_can_only_be_cancelled,
    steps_are_kept_and_the_same_one_is_told_once,
    a_checkpoint_is_there_for_who_takes_a_job_over_and_goes_with_its_end,
    a_job_that_begins_again_has_no_steps_and_no_checkpoint,
    events_count_up_and_old_ones_go,
    results_of_old_comparisons_go,
}
