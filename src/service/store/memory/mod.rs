//! Rows in memory, for tests and trials; lost when the process ends.
//!
//! This is the simplest form of what every engine must do.

mod jobs;
mod sessions;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use async_trait::async_trait;

use super::{
    AnswerRecord, BlobInfo, Changes, Claim, EventRecord, Insertion, JobChange, JobFilter, JobId, JobRecord, JobState,
    Lane, MetaStore, NewJob, OsteotomyId, OsteotomyRecord, Owner, PartKind, PartRecord, PlanId, PlanRecord, Remembered,
    SessionContents, SessionId, SessionRecord, StepRecord, StepWritten, StoreError, TenantId, WorkerId,
};

type Result<T> = std::result::Result<T, StoreError>;

/// The rows of one process.
#[derive(Debug, Default)]
pub(super) struct MemoryMeta {
    rows: Mutex<Rows>,
}

#[derive(Debug, Clone, Default)]
struct Rows {
    sessions: BTreeMap<SessionId, SessionRecord>,
    parts: BTreeMap<(SessionId, PartKind), PartRecord>,
    osteotomies: BTreeMap<OsteotomyId, OsteotomyRecord>,
    plans: BTreeMap<PlanId, PlanRecord>,
    jobs: BTreeMap<JobId, Job>,
    steps: BTreeMap<(JobId, u32), StepRecord>,
    events: BTreeMap<(JobId, u64), EventRecord>,
    answers: BTreeMap<(TenantId, String), (AnswerRecord, String)>,
    /// Tenant and time of deletion, by id.
    tombstones: BTreeMap<String, (TenantId, String)>,
    turns: BTreeMap<(TenantId, Lane), u64>,
    last_number: u64,
    audit_anchors: BTreeMap<String, (String, String)>,
}

#[derive(Debug, Clone)]
struct Job {
    record: JobRecord,
    bytes: u64,
    accepted_at: Instant,
    /// Worker that claimed it last.
    worker: Option<WorkerId>,
}

impl MemoryMeta {
    fn read<T>(&self, look: impl FnOnce(&Rows) -> T) -> T {
        look(&self.rows.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Changes a copy of the rows, which replaces them only when the change succeeds.
    fn write<T>(&self, change: impl FnOnce(&mut Rows) -> Result<T>) -> Result<T> {
        let mut rows = self.rows.lock().unwrap_or_else(PoisonError::into_inner);
        let mut next = rows.clone();
        let done = change(&mut next)?;
        *rows = next;
        Ok(done)
    }
}

#[async_trait]
impl MetaStore for MemoryMeta {
    async fn insert_session(&self, session: &SessionRecord, answer: Option<&AnswerRecord>) -> Result<()> {
        self.write(|rows| {
            rows.sessions.insert(session.id, session.clone());
            rows.remember(answer)
        })
    }

    async fn session(&self, id: SessionId) -> Result<Option<SessionRecord>> {
        Ok(self.read(|rows| rows.sessions.get(&id).cloned()))
    }

    async fn sessions(
        &self,
        tenant: Option<&TenantId>,
        before: Option<SessionId>,
        limit: u32,
    ) -> Result<Vec<SessionRecord>> {
        let wanted =
            |s: &&SessionRecord| before.is_none_or(|b| s.id < b) && tenant.is_none_or(|tenant| s.tenant == *tenant);
        Ok(self.read(|rows| {
            let shown = |s: &&SessionRecord| wanted(s) && rows.hidden_at(&s.id.to_string()).is_none();
            rows.sessions.values().rev().filter(shown).take(limit as usize).cloned().collect()
        }))
    }

    async fn delete_session(&self, id: SessionId) -> Result<Option<Vec<String>>> {
        self.write(|rows| Ok(rows.delete_session(id)))
    }

    async fn hide_session(&self, id: SessionId) -> Result<bool> {
        self.write(|rows| Ok(rows.hide_session(id)))
    }

    async fn restore_session(&self, id: SessionId) -> Result<bool> {
        self.write(|rows| Ok(rows.restore_session(id)))
    }

    async fn hidden_sessions(&self, before: &str) -> Result<Vec<SessionRecord>> {
        Ok(self.read(|rows| {
            let is_old = |s: &&SessionRecord| rows.hidden_at(&s.id.to_string()).is_some_and(|at| at < before);
            rows.sessions.values().filter(is_old).cloned().collect()
        }))
    }

    async fn idle_sessions(&self, since: &str) -> Result<Vec<SessionRecord>> {
        Ok(self.read(|rows| {
            let busy = |id| rows.jobs.values().any(|j| j.record.session == id && !j.record.state.has_ended());
            let idle = |s: &&SessionRecord| {
                let hidden = rows.hidden_at(&s.id.to_string()).is_some();
                !hidden && rows.last_used(s.id).is_some_and(|t| t.as_str() < since) && !busy(s.id)
            };
            rows.sessions.values().filter(idle).cloned().collect()
        }))
    }

    async fn last_used(&self, id: SessionId) -> Result<Option<String>> {
        Ok(self.read(|rows| rows.last_used(id)))
    }

    async fn session_bytes(&self, id: SessionId) -> Result<u64> {
        Ok(self.read(|rows| rows.bytes(id)))
    }

    async fn contents(&self, sessions: &[SessionId], jobs: u32) -> Result<BTreeMap<SessionId, SessionContents>> {
        Ok(self.read(|rows| {
            let here = sessions.iter().filter(|id| rows.sessions.contains_key(id));
            here.map(|id| (*id, rows.contents(*id, jobs))).collect()
        }))
    }

    async fn owner(&self, id: &str) -> Result<Option<Owner>> {
        Ok(self.read(|rows| rows.owner(id)))
    }

    async fn is_deleted(&self, id: &str) -> Result<bool> {
        Ok(self.read(|rows| rows.tombstones.contains_key(id)))
    }

    async fn remembered(&self, tenant: &TenantId, key: &str, request_sha256: &str) -> Result<Remembered> {
        Ok(self.read(|rows| match rows.answers.get(&(tenant.clone(), key.to_owned())) {
            None => Remembered::Nothing,
            Some((answer, _)) if answer.request_sha256 != request_sha256 => Remembered::OtherRequest,
            Some((answer, _)) => Remembered::Answer(AnswerRecord { session: None, ..answer.clone() }),
        }))
    }

    async fn forget(&self, answers: &str, tombstones: &str) -> Result<()> {
        self.write(|rows| {
            rows.answers.retain(|_, (_, made)| made.as_str() >= answers);
            rows.tombstones.retain(|_, (_, deleted)| deleted.as_str() >= tombstones);
            Ok(())
        })
    }

    async fn put_parts(&self, session: SessionId, parts: &[PartRecord], quota: u64) -> Result<Vec<String>> {
        self.write(|rows| {
            rows.require(session)?;
            let put = |part: &PartRecord| {
                let old = rows.parts.insert((session, part.kind), part.clone());
                old.and_then(|old| old.blob).filter(|old| Some(old) != part.blob.as_ref())
            };
            let replaced = parts.iter().filter_map(put).collect();
            rows.check_bytes(session, quota)?;
            Ok(replaced)
        })
    }

    async fn delete_part(&self, session: SessionId, kind: PartKind) -> Result<Option<Option<String>>> {
        self.write(|rows| Ok(rows.parts.remove(&(session, kind)).map(|part| part.blob)))
    }

    async fn parts(&self, session: SessionId) -> Result<Vec<PartRecord>> {
        Ok(self.read(|rows| rows.parts(session)))
    }

    async fn insert_osteotomy(
        &self,
        record: &OsteotomyRecord,
        answer: Option<&AnswerRecord>,
        quota: u64,
    ) -> Result<()> {
        self.write(|rows| {
            rows.require(record.session)?;
            rows.osteotomies.insert(record.id, record.clone());
            rows.check_bytes(record.session, quota)?;
            rows.remember(answer)
        })
    }

    async fn osteotomies(&self, session: SessionId) -> Result<Vec<OsteotomyRecord>> {
        Ok(self.read(|rows| rows.osteotomies.values().filter(|o| o.session == session).cloned().collect()))
    }

    async fn delete_osteotomy(&self, session: SessionId, id: OsteotomyId) -> Result<Option<Vec<String>>> {
        self.write(|rows| Ok(rows.delete_osteotomy(session, id)))
    }

    async fn insert_plan(&self, record: &PlanRecord, answer: Option<&AnswerRecord>) -> Result<()> {
        self.write(|rows| {
            rows.require(record.session)?;
            if record.osteotomy.is_some_and(|o| !rows.osteotomies.contains_key(&o)) {
                return Err(StoreError::SessionGone);
            }
            rows.plans.insert(record.id, record.clone());
            rows.remember(answer)
        })
    }

    async fn plans(&self, session: SessionId) -> Result<Vec<PlanRecord>> {
        Ok(self.read(|rows| rows.plans.values().filter(|p| p.session == session).cloned().collect()))
    }

    async fn delete_plan(&self, session: SessionId, id: PlanId) -> Result<bool> {
        self.write(|rows| Ok(rows.delete_plan(session, id)))
    }

    async fn insert_job(&self, new: &NewJob<'_>) -> Result<Insertion> {
        // A refused job must leave no trace, so the copy is dropped.
        let refused = std::cell::Cell::new(None);
        let inserted = self.write(|rows| {
            let outcome = rows.insert_job(new)?;
            if matches!(outcome, Insertion::Full | Insertion::TenantFull) {
                refused.set(Some(outcome));
                return Err(StoreError::SessionGone);
            }
            Ok(outcome)
        });
        refused.take().map_or(inserted, Ok)
    }

    async fn job(&self, id: JobId) -> Result<Option<JobRecord>> {
        Ok(self.read(|rows| rows.jobs.get(&id).map(|j| j.record.clone())))
    }

    async fn jobs(&self, filter: &JobFilter) -> Result<Vec<JobRecord>> {
        let wanted = |j: &&JobRecord| {
            filter.session.is_none_or(|s| j.session == s)
                && filter.kind.is_none_or(|k| j.kind == k)
                && filter.state.is_none_or(|s| j.state == s)
                && filter.before.is_none_or(|b| j.id < b)
                && filter.tenant.as_ref().is_none_or(|t| j.tenant == *t)
        };
        Ok(self.read(|rows| {
            let newest_first = rows.jobs.values().rev().map(|j| &j.record);
            let shown = |j: &&JobRecord| wanted(j) && rows.hidden_at(&j.id.to_string()).is_none();
            newest_first.filter(shown).take(filter.limit as usize).cloned().collect()
        }))
    }

    async fn queue(&self, lane: Lane) -> Result<Vec<JobId>> {
        Ok(self.read(|rows| rows.queue(lane)))
    }

    async fn claim_job(
        &self,
        claim: &Claim,
        change: &(dyn for<'a> Fn(&'a JobRecord) -> JobChange + Send + Sync),
    ) -> Result<Option<JobRecord>> {
        self.write(|rows| Ok(rows.claim(claim, change)))
    }

    async fn renew(&self, id: JobId, fence: u64, lease: Duration) -> Result<Option<bool>> {
        self.write(|rows| Ok(rows.renew(id, fence, lease)))
    }

    async fn abandoned(&self) -> Result<Vec<JobRecord>> {
        Ok(self.read(Rows::abandoned))
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
        self.write(|rows| rows.change_job(id, fence, from, to, change, quota))
    }

    async fn request_cancel(&self, id: JobId) -> Result<bool> {
        self.write(|rows| Ok(rows.request_cancel(id)))
    }

    async fn record_progress(&self, id: JobId, fence: u64, phase: &str, progress: f64, event: &str) -> Result<bool> {
        self.write(|rows| Ok(rows.record_progress(id, fence, phase, progress, event)))
    }

    async fn set_rest(&self, id: JobId, fence: u64, rest: &BlobInfo, quota: u64) -> Result<Option<String>> {
        self.write(|rows| rows.set_rest(id, fence, rest, quota))
    }

    async fn set_milestone(&self, id: JobId, fence: u64, blob: &str) -> Result<Option<String>> {
        self.write(|rows| rows.set_milestone(id, fence, blob))
    }

    async fn begin_again(&self, id: JobId, fence: u64) -> Result<Vec<String>> {
        self.write(|rows| rows.begin_again(id, fence))
    }

    async fn commit_step(
        &self,
        job: JobId,
        fence: u64,
        step: &StepRecord,
        events: &[(&'static str, String)],
        quota: u64,
    ) -> Result<StepWritten> {
        self.write(|rows| rows.commit_step(job, fence, step, events, quota))
    }

    async fn steps(&self, jobs: &[JobId]) -> Result<BTreeMap<JobId, Vec<StepRecord>>> {
        let of = |rows: &Rows, job| rows.steps.range((job, 0)..=(job, u32::MAX)).map(|(_, s)| s.clone()).collect();
        let found = self.read(|rows| jobs.iter().map(|job| (*job, of(rows, *job))).collect::<BTreeMap<_, Vec<_>>>());
        Ok(found.into_iter().filter(|(_, steps)| !steps.is_empty()).collect())
    }

    async fn events(&self, job: JobId, after: u64) -> Result<Vec<EventRecord>> {
        let from = (job, after.saturating_add(1));
        Ok(self.read(|rows| rows.events.range(from..=(job, u64::MAX)).map(|(_, e)| e.clone()).collect()))
    }

    async fn prune_events(&self, ended_before: &str) -> Result<u64> {
        self.write(|rows| Ok(rows.prune_events(ended_before)))
    }

    async fn drop_comparisons(&self, ended_before: &str) -> Result<Vec<String>> {
        self.write(|rows| Ok(rows.drop_comparisons(ended_before)))
    }

    async fn set_audit_anchor(&self, log: &str, chain: &str, at: &str) -> Result<()> {
        self.write(|rows| {
            rows.audit_anchors.insert(log.to_owned(), (chain.to_owned(), at.to_owned()));
            Ok(())
        })
    }

    async fn audit_anchor(&self, log: &str) -> Result<Option<(String, String)>> {
        Ok(self.read(|rows| rows.audit_anchors.get(log).cloned()))
    }

    async fn name(&self, fresh: &str) -> Result<String> {
        Ok(fresh.to_owned())
    }

    async fn take_turn(&self, _every: Duration) -> Result<bool> {
        Ok(true)
    }

    async fn named_blobs(&self) -> Result<BTreeSet<String>> {
        Ok(self.read(Rows::named_blobs))
    }

    async fn changes(&self) -> Result<Option<Changes>> {
        Ok(None)
    }

    async fn check(&self) -> Result<()> {
        Ok(())
    }

    async fn close(&self) {}
}
