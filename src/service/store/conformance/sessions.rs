//! Sessions and their contents, stored answers, and the anchor of the audit log.

use super::*;

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

async fn a_hidden_session_answers_as_deleted_until_it_is_restored(store: Store) {
    let [kept, hidden] = [add_session(&store, "a").await, add_session(&store, "a").await];
    let a: TenantId = "a".parse().unwrap();
    let job = accept(&store, hidden.id, "1").await;
    let reading = JobRecord { other_session: Some(hidden.id), ..super::job(kept.id, "2") };
    insert(&store, &reading, MANY, false).await;
    assert!(store.hide_session(hidden.id).await.unwrap());
    assert!(!store.hide_session(hidden.id).await.unwrap());
    assert_eq!(store.sessions(Some(&a), None, 10).await.unwrap(), std::slice::from_ref(&kept));
    let all = JobFilter { tenant: Some(a.clone()), limit: 10, ..JobFilter::default() };
    assert!(store.jobs(&all).await.unwrap().is_empty());
    for id in [hidden.id.to_string(), job.to_string(), reading.id.to_string()] {
        assert!(store.is_deleted(&id).await.unwrap());
        assert!(store.owner(&id).await.unwrap().is_some_and(|o| o.deleted && o.tenant == a));
    }
    let look = store.look().await.unwrap();
    assert!(store.idle_sessions(&look, Duration::ZERO).await.unwrap().iter().all(|s| s.id != hidden.id));
    assert!(store.hidden_sessions(&look, Duration::from_secs(3600), None).await.unwrap().is_empty());
    tokio::time::sleep(Duration::from_millis(5)).await;
    let look = store.look().await.unwrap();
    assert_eq!(store.hidden_sessions(&look, Duration::ZERO, None).await.unwrap(), std::slice::from_ref(&hidden));
    // Maintenance that ran late must not make it visible.
    store.delete_old_answers(&look, Duration::ZERO).await.unwrap();
    assert_eq!(store.hidden_sessions(&look, Duration::ZERO, None).await.unwrap(), std::slice::from_ref(&hidden));
    assert_eq!(store.count_hidden().await.unwrap(), 1);
    assert!(store.is_deleted(&job.to_string()).await.unwrap());
    assert!(store.restore_session(hidden.id).await.unwrap());
    assert!(!store.restore_session(hidden.id).await.unwrap());
    assert_eq!(store.sessions(Some(&a), None, 10).await.unwrap(), [hidden.clone(), kept.clone()]);
    assert_eq!(store.jobs(&all).await.unwrap().len(), 2);
    assert!(!store.is_deleted(&job.to_string()).await.unwrap());
    // A comparison of two sessions is visible only while both are.
    store.hide_session(kept.id).await.unwrap();
    store.hide_session(hidden.id).await.unwrap();
    store.restore_session(kept.id).await.unwrap();
    assert!(store.is_deleted(&reading.id.to_string()).await.unwrap());
    // A hidden session can be deleted for good, and then cannot be restored.
    assert!(store.delete_session(hidden.id).await.unwrap());
    assert!(!store.restore_session(hidden.id).await.unwrap());
    assert!(store.is_deleted(&hidden.id.to_string()).await.unwrap());
}

async fn answers_are_remembered_by_tenant_and_key(store: Store) {
    let record = session("a");
    store.insert_session(&record, Some(&answer("a", "k", record.id))).await.unwrap();
    let (a, b): (TenantId, TenantId) = ("a".parse().unwrap(), "b".parse().unwrap());
    assert!(matches!(store.remembered(&a, "k", "abc").await.unwrap(), StoredAnswer::Answer(a) if a.status == 201));
    assert_eq!(store.remembered(&a, "k", "other").await.unwrap(), StoredAnswer::OtherRequest);
    assert_eq!(store.remembered(&b, "k", "abc").await.unwrap(), StoredAnswer::Nothing);
    let second = session("a");
    let taken = store.insert_session(&second, Some(&answer("a", "k", second.id))).await;
    assert!(matches!(taken, Err(StoreError::KeyTaken)));
    assert_eq!(store.session(second.id).await.unwrap(), None, "both or none");
    store.delete_session(record.id).await.unwrap();
    assert_eq!(store.remembered(&a, "k", "abc").await.unwrap(), StoredAnswer::Nothing);
}

async fn parts_replace_each_other_within_the_quota(store: Store) {
    let store = store.with_quota(10);
    let id = add_session(&store, "a").await.id;
    let (first, second) = (blob(&store, id, b"12345").await, blob(&store, id, b"123456").await);
    store.put_parts(id, &[part_with(PartKind::Skin, &first)]).await.unwrap();
    store.put_parts(id, &[part_with(PartKind::Skin, &second)]).await.unwrap();
    assert!(matches!(store.blobs().get(&first.key).await, Err(StoreError::BlobGone { .. })));
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
    let own = PlanRecord { document: r#"{"measured": true}"#.to_owned(), ..own };
    store.set_plan(full, own.id, &own.document).await.unwrap();
    // A plan of another session, or of none, stays as it is.
    store.set_plan(full, others.id, "lost").await.unwrap();
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

async fn idle_sessions_are_found(store: Store) {
    let (idle, busy) = (add_session(&store, "a").await, add_session(&store, "a").await);
    accept(&store, busy.id, "1").await;
    let look = store.look().await.unwrap();
    assert_eq!(store.idle_sessions(&look, Duration::from_secs(600)).await.unwrap(), []);
    tokio::time::sleep(Duration::from_millis(5)).await;
    let look = store.look().await.unwrap();
    assert_eq!(store.idle_sessions(&look, Duration::ZERO).await.unwrap(), std::slice::from_ref(&idle));
    // No day has passed, so nothing is old by the settled clock.
    assert_eq!(look.settled_ms, 0);
    assert_eq!(store.idle_sessions(&look, Duration::from_secs(86_400)).await.unwrap(), []);
    assert_eq!(store.last_used(idle.id).await.unwrap(), Some(idle.created_at.clone()));
    assert_eq!(store.last_used(SessionId::new()).await.unwrap(), None);
    assert!(store.hide_session(idle.id).await.unwrap() && store.restore_session(idle.id).await.unwrap());
    assert!(store.last_used(idle.id).await.unwrap() > Some(idle.created_at.clone()), "its retention begins anew");
    store.delete_old_answers(&look, Duration::ZERO).await.unwrap();
}

async fn sessions_are_hidden_for_good_only_by_clock_and_running_time(store: Store) {
    const DAY: Duration = Duration::from_secs(86_400);
    let [hidden, expired] = [add_session(&store, "a").await, add_session(&store, "a").await];
    assert!(store.hide_session(hidden.id).await.unwrap() && store.expire_session(expired.id).await.unwrap());
    let look = store.look().await.unwrap();
    let days = |days: i64, ran: i64| Look {
        now_ms: look.now_ms + days * 86_400_000,
        settled_ms: look.now_ms + days * 86_400_000 - 1,
        ran_ms: look.ran_ms + ran * 86_400_000,
        ..look
    };
    let over = async |look: Look, retention| {
        let over = store.hidden_sessions(&look, DAY, retention).await.unwrap();
        over.into_iter().map(|session| session.id).collect::<Vec<_>>()
    };
    let both = [hidden.id, expired.id];
    assert!(over(days(400, 0), None).await.is_empty(), "a day has not passed, whatever the clock shows");
    assert!(over(days(0, 2), None).await.is_empty());
    assert_eq!(over(days(2, 2), None).await, both);
    // The clock was ahead at the deletion.
    assert_eq!(over(days(-9, 2), None).await, both);
    assert_eq!(over(days(2, 2), Some(9 * DAY)).await, [hidden.id], "the other one was not unused for so long");
    assert_eq!(over(days(20, 2), Some(9 * DAY)).await, both);
    let wrongly = async |look: Look| store.wrongly_expired(&look, 9 * DAY).await.unwrap();
    assert_eq!(wrongly(days(2, 0)).await, std::slice::from_ref(&expired));
    assert!(wrongly(days(20, 0)).await.is_empty());
}

async fn the_running_time_is_counted_and_the_clock_settles(store: Store) {
    let first = store.look().await.unwrap();
    assert!(first.begins_day && first.settled_ms == 0 && first.jumped_ms == 0);
    let second = store.look().await.unwrap();
    assert!(!second.begins_day && second.ran_ms >= first.ran_ms && second.now_ms >= first.now_ms);
    let jumped = store.look_at(first.now_ms + 400 * 86_400_000, Duration::from_secs(86_400)).await.unwrap();
    if store.is_shared() {
        // Neither the clock nor the running time of a process counts for more than those of the database.
        assert!(jumped.ran_ms < first.ran_ms + 60_000 && jumped.now_ms < first.now_ms + 60_000, "{jumped:?}");
        assert_eq!(jumped.settled_ms, 0);
    } else {
        assert_eq!((jumped.ran_ms - second.ran_ms, jumped.settled_ms), (86_400_000, first.now_ms));
    }
}

async fn the_end_of_the_audit_log_is_noted(store: Store) {
    assert_eq!(store.audit_anchor().await.unwrap(), None);
    for chain in ["a", "b"] {
        store.set_audit_anchor(chain).await.unwrap();
        let (noted, at) = store.audit_anchor().await.unwrap().unwrap();
        assert!(noted == chain && at <= now_rfc3339());
    }
}

conforms! {
    sessions_belong_to_tenants_and_are_listed_newest_first,
    a_hidden_session_answers_as_deleted_until_it_is_restored,
    answers_are_remembered_by_tenant_and_key,
    parts_replace_each_other_within_the_quota,
    plans_go_with_their_osteotomy,
    many_sessions_are_looked_into_at_once,
    a_deleted_session_leaves_nothing,
    idle_sessions_are_found,
    sessions_are_hidden_for_good_only_by_clock_and_running_time,
    the_running_time_is_counted_and_the_clock_settles,
    the_end_of_the_audit_log_is_noted,
}
