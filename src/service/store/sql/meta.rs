use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use async_trait::async_trait;

use super::{Meta, Result, anchor, answers, contents, events, jobs, maintenance, parts, plans, queue, sessions, steps};
use crate::{
    AnswerRecord, BlobInfo, Changes, Claim, Clocks, EventRecord, Insertion, JobChange, JobFilter, JobId, JobRecord,
    JobState, Lane, MetaStore, NewJob, OsteotomyId, OsteotomyRecord, Owner, PartKind, PartRecord, PlanId, PlanRecord,
    SessionContents, SessionId, SessionRecord, StepRecord, StepWritten, StoredAnswer, TenantId,
};

use crate::meta::Over;

#[async_trait]
impl MetaStore for Meta {
    async fn insert_session(&self, session: &SessionRecord, answer: Option<&AnswerRecord>) -> Result<()> {
        sessions::insert(self.writer(), session, answer).await
    }

    async fn session(&self, id: SessionId) -> Result<Option<SessionRecord>> {
        sessions::one(self.reader(), id).await
    }

    async fn sessions(
        &self,
        tenant: Option<&TenantId>,
        before: Option<SessionId>,
        limit: u32,
    ) -> Result<Vec<SessionRecord>> {
        sessions::page(self.reader(), tenant, before, limit).await
    }

    async fn delete_session(&self, id: SessionId) -> Result<Option<Vec<String>>> {
        sessions::delete(self.writer(), id).await
    }

    async fn hide_session(&self, id: SessionId, expired: bool) -> Result<bool> {
        sessions::hide(self.writer(), id, expired).await
    }

    async fn restore_session(&self, id: SessionId) -> Result<bool> {
        sessions::restore(self.writer(), id).await
    }

    async fn hidden_sessions(&self, over: &Over) -> Result<Vec<SessionRecord>> {
        sessions::hidden(self.reader(), over).await
    }

    async fn wrongly_expired(&self, since: &str) -> Result<Vec<SessionRecord>> {
        sessions::wrongly_expired(self.reader(), since).await
    }

    async fn count_hidden(&self) -> Result<u64> {
        sessions::count_hidden(self.reader()).await
    }

    async fn idle_sessions(&self, since: &str) -> Result<Vec<SessionRecord>> {
        sessions::idle(self.reader(), since).await
    }

    async fn last_used(&self, id: SessionId) -> Result<Option<String>> {
        sessions::last_used(self.reader(), id).await
    }

    async fn session_bytes(&self, id: SessionId) -> Result<u64> {
        let mut connection = self.reader().acquire().await?;
        sessions::bytes(&mut connection, id).await
    }

    async fn contents(&self, sessions: &[SessionId], jobs: u32) -> Result<BTreeMap<SessionId, SessionContents>> {
        contents::of(self.reader(), sessions, jobs).await
    }

    async fn owner(&self, id: &str) -> Result<Option<Owner>> {
        sessions::owner(self.reader(), id).await
    }

    async fn is_deleted(&self, id: &str) -> Result<bool> {
        sessions::is_deleted(self.reader(), id).await
    }

    async fn remembered(&self, tenant: &TenantId, key: &str, request_sha256: &str) -> Result<StoredAnswer> {
        answers::remembered(self.reader(), tenant, key, request_sha256).await
    }

    async fn forget(&self, answers: &str, tombstones: &str) -> Result<()> {
        answers::forget(self.writer(), answers, tombstones).await
    }

    async fn put_parts(&self, session: SessionId, parts: &[PartRecord], quota: u64) -> Result<Vec<String>> {
        parts::put(self.writer(), session, parts, quota).await
    }

    async fn delete_part(&self, session: SessionId, kind: PartKind) -> Result<Option<Option<String>>> {
        parts::delete(self.writer(), session, kind).await
    }

    async fn parts(&self, session: SessionId) -> Result<Vec<PartRecord>> {
        parts::all(self.reader(), session).await
    }

    async fn insert_osteotomy(
        &self,
        record: &OsteotomyRecord,
        answer: Option<&AnswerRecord>,
        quota: u64,
    ) -> Result<()> {
        plans::insert_osteotomy(self.writer(), record, answer, quota).await
    }

    async fn osteotomies(&self, session: SessionId) -> Result<Vec<OsteotomyRecord>> {
        plans::osteotomies(self.reader(), session).await
    }

    async fn delete_osteotomy(&self, session: SessionId, id: OsteotomyId) -> Result<Option<Vec<String>>> {
        plans::delete_osteotomy(self.writer(), session, id).await
    }

    async fn insert_plan(&self, record: &PlanRecord, answer: Option<&AnswerRecord>) -> Result<()> {
        plans::insert_plan(self.writer(), record, answer).await
    }

    async fn plans(&self, session: SessionId) -> Result<Vec<PlanRecord>> {
        plans::plans(self.reader(), session).await
    }

    async fn set_plan(&self, session: SessionId, id: PlanId, document: &str) -> Result<()> {
        plans::set_plan(self.writer(), session, id, document).await
    }

    async fn delete_plan(&self, session: SessionId, id: PlanId) -> Result<bool> {
        plans::delete_plan(self.writer(), session, id).await
    }

    async fn insert_job(&self, new: &NewJob<'_>) -> Result<Insertion> {
        queue::insert(self.writer(), new).await
    }

    async fn job(&self, id: JobId) -> Result<Option<JobRecord>> {
        jobs::one(self.reader(), id).await
    }

    async fn jobs(&self, filter: &JobFilter) -> Result<Vec<JobRecord>> {
        jobs::page(self.reader(), filter).await
    }

    async fn queue(&self, lane: Lane) -> Result<Vec<JobId>> {
        queue::in_order(self.reader(), lane).await
    }

    async fn claim_job(
        &self,
        claim: &Claim,
        change: &(dyn for<'a> Fn(&'a JobRecord) -> JobChange + Send + Sync),
    ) -> Result<Option<JobRecord>> {
        queue::claim(self.writer(), claim, change).await
    }

    async fn renew(&self, id: JobId, fence: u64, lease: Duration) -> Result<Option<bool>> {
        queue::renew(self.writer(), id, fence, lease).await
    }

    async fn abandoned(&self) -> Result<Vec<JobRecord>> {
        queue::abandoned(self.reader()).await
    }

    async fn change_job(
        &self,
        id: JobId,
        fence: u64,
        from: JobState,
        to: JobState,
        change: &JobChange,
        quota: u64,
    ) -> Result<bool> {
        jobs::change(self.writer(), id, fence, from, to, change, quota).await
    }

    async fn request_cancel(&self, id: JobId) -> Result<bool> {
        jobs::request_cancel(self.writer(), id).await
    }

    async fn record_progress(&self, id: JobId, fence: u64, phase: &str, progress: f64, event: &str) -> Result<bool> {
        jobs::record_progress(self.writer(), id, fence, phase, progress, event).await
    }

    async fn set_rest(&self, id: JobId, fence: u64, rest: &BlobInfo, quota: u64) -> Result<Option<String>> {
        jobs::set_rest(self.writer(), id, fence, rest, quota).await
    }

    async fn set_checkpoint(&self, id: JobId, fence: u64, blob: &str) -> Result<Option<String>> {
        jobs::set_checkpoint(self.writer(), id, fence, blob).await
    }

    async fn begin_again(&self, id: JobId, fence: u64) -> Result<Vec<String>> {
        steps::forget(self.writer(), id, fence).await
    }

    async fn commit_step(
        &self,
        job: JobId,
        fence: u64,
        step: &StepRecord,
        events: &[(&'static str, String)],
        quota: u64,
    ) -> Result<StepWritten> {
        steps::commit(self.writer(), job, fence, step, events, quota).await
    }

    async fn steps(&self, jobs: &[JobId]) -> Result<BTreeMap<JobId, Vec<StepRecord>>> {
        steps::of(self.reader(), jobs).await
    }

    async fn events(&self, job: JobId, after: u64) -> Result<Vec<EventRecord>> {
        events::after(self.reader(), job, after).await
    }

    async fn prune_events(&self, ended_before: &str) -> Result<u64> {
        events::prune(self.writer(), ended_before).await
    }

    async fn drop_comparisons(&self, ended_before: &str) -> Result<Vec<String>> {
        jobs::drop_comparisons(self.writer(), ended_before).await
    }

    async fn set_audit_anchor(&self, log: &str, chain: &str, at: &str) -> Result<()> {
        anchor::set(self.writer(), log, chain, at).await
    }

    async fn audit_anchor(&self, log: &str) -> Result<Option<(String, String)>> {
        anchor::get(self.reader(), log).await
    }

    async fn name(&self, fresh: &str) -> Result<String> {
        maintenance::name(self.writer(), fresh).await
    }

    async fn link_key(&self, fresh: &str) -> Result<String> {
        maintenance::link_key(self.writer(), fresh).await
    }

    async fn claim_maintenance(&self, every: Duration) -> Result<bool> {
        maintenance::claim_maintenance(self.writer(), every).await
    }

    async fn look(&self, now_ms: i64, elapsed_ms: i64, shared: bool) -> Result<(Clocks, i64)> {
        maintenance::look(self.writer(), now_ms, elapsed_ms, shared).await
    }

    async fn named_blobs(&self) -> Result<BTreeSet<String>> {
        sessions::named_blobs(self.reader()).await
    }

    async fn changes(&self) -> Result<Option<Changes>> {
        self.listen().await
    }

    async fn check(&self) -> Result<()> {
        self.probe().await
    }

    async fn close(&self) {
        self.close_all().await;
    }
}
