use std::collections::BTreeMap;
use std::time::{Duration, Instant, SystemTime};

use super::{Job, Result, Rows};
use crate::event::KEPT_PROGRESS;
use crate::job::{joined_warnings, progress_after};
use crate::records::now_rfc3339;
use crate::{
    BlobInfo, Claim, EventRecord, Insertion, JobChange, JobId, JobKind, JobRecord, JobState, Lane, NewJob, StepRecord,
    StepWritten, StoreError, TenantId,
};

fn ms_after(time: Duration) -> i64 {
    let at = SystemTime::UNIX_EPOCH.elapsed().unwrap_or_default().saturating_add(time);
    i64::try_from(at.as_millis()).unwrap_or(i64::MAX)
}

impl Rows {
    fn last_seq(&self, job: JobId) -> u64 {
        self.events.range((job, 0)..=(job, u64::MAX)).next_back().map_or(0, |((_, seq), _)| *seq)
    }

    fn append(&mut self, job: JobId, kind: &str, data: &str) {
        let seq = self.last_seq(job) + 1;
        self.events.insert((job, seq), EventRecord { seq, kind: kind.to_owned(), data: data.to_owned() });
    }

    fn append_all(&mut self, job: JobId, events: &[(&'static str, String)]) {
        for (kind, data) in events {
            self.append(job, kind, data);
        }
    }

    pub(super) fn insert_job(&mut self, new: &NewJob<'_>) -> Result<Insertion> {
        let job = new.job;
        let twin = self.in_order_of_number().into_iter().find(|j| {
            j.session == job.session
                && j.kind == job.kind
                && j.request == job.request
                && !j.state.has_ended()
                && j.cancel_requested_at.is_none()
        });
        if let Some(twin) = twin {
            let before = self.before(&twin);
            self.remember((new.answer)(&twin, before).as_ref())?;
            return Ok(Insertion::Twin(Box::new(twin), before));
        }
        let superseded = self.supersede(new);
        let tenant = self.sessions.get(&job.session).map(|s| s.tenant.clone()).ok_or(StoreError::SessionGone)?;
        if job.other_session.is_some_and(|other| !self.sessions.contains_key(&other)) {
            return Err(StoreError::SessionGone);
        }
        let waiting = self.jobs.values().filter(|j| j.record.state == JobState::Accepted);
        let (all, own) = waiting.fold((0, 0), |(all, own), j| (all + 1, own + u32::from(j.record.tenant == tenant)));
        if all >= new.limits.all {
            return Ok(Insertion::Full);
        }
        if own >= new.limits.tenant {
            return Ok(Insertion::TenantFull);
        }
        self.last_number += 1;
        let record = JobRecord { number: self.last_number, tenant, ..job.clone() };
        self.jobs.insert(job.id, Job { record, bytes: 0, accepted_at: Instant::now(), worker: None });
        self.append(job.id, "status", new.event);
        let before = self.before(job);
        self.remember((new.answer)(job, before).as_ref())?;
        Ok(Insertion::Stored { superseded, before: before.unwrap_or(0) })
    }

    fn before(&self, job: &JobRecord) -> Option<u32> {
        self.queue(job.kind.lane()).iter().position(|id| *id == job.id).and_then(|n| u32::try_from(n).ok())
    }

    pub(super) fn request_cancel(&mut self, id: JobId) -> bool {
        let Some(job) = self.jobs.get_mut(&id).filter(|j| !j.record.state.has_ended()) else { return false };
        job.record.cancel_requested_at.get_or_insert_with(now_rfc3339);
        true
    }

    fn in_order_of_number(&self) -> Vec<JobRecord> {
        let mut jobs: Vec<JobRecord> = self.jobs.values().map(|j| j.record.clone()).collect();
        jobs.sort_by_key(|j| j.number);
        jobs
    }

    fn supersede(&mut self, new: &NewJob<'_>) -> Vec<(JobId, Option<String>)> {
        let (Some(supersede), Some(_)) = (&new.supersede, &new.job.subject) else { return Vec::new() };
        let replaced = |j: &JobRecord| {
            j.session == new.job.session
                && j.kind == new.job.kind
                && j.subject == new.job.subject
                && j.state == supersede.from
        };
        let old = self.in_order_of_number().into_iter().filter(replaced);
        let old: Vec<(JobId, Option<String>)> = old.map(|j| (j.id, j.milestone_blob)).collect();
        for (id, _) in &old {
            let change = JobChange { events: vec![supersede.event.clone()], ..JobChange::default() };
            self.write_change(*id, supersede.to, &change);
            if let Some(job) = self.jobs.get_mut(id) {
                job.record.superseded_by = Some(new.job.id);
            }
        }
        old
    }

    pub(super) fn queue(&self, lane: Lane) -> Vec<JobId> {
        self.places(lane, |_| 0).into_iter().map(|(_, id)| id).collect()
    }

    /// Waiting jobs of a lane with their ranks, in claiming order.
    fn places(&self, lane: Lane, rank: impl Fn(&Job) -> u8) -> Vec<(u8, JobId)> {
        let waiting = self.jobs.values().filter(|j| {
            let j = &j.record;
            j.state == JobState::Accepted && j.kind.lane() == lane && j.cancel_requested_at.is_none()
        });
        let mut waiting: Vec<_> = waiting.map(|j| (rank(j), j.record.number, &j.record)).collect();
        waiting.sort_unstable_by_key(|&(rank, number, _)| (rank, number));
        let mut rounds: BTreeMap<&TenantId, u64> = BTreeMap::new();
        let mut places: Vec<_> = waiting
            .into_iter()
            .map(|(rank, number, j)| {
                let round = rounds.entry(&j.tenant).and_modify(|r| *r += 1).or_insert(1);
                let last = self.turns.get(&(j.tenant.clone(), lane)).copied().unwrap_or(0);
                (*round, rank, last, number, j.id)
            })
            .collect();
        places.sort_unstable();
        places.into_iter().map(|(_, rank, _, _, id)| (rank, id)).collect()
    }

    pub(super) fn claim(
        &mut self,
        claim: &Claim,
        change: &(dyn for<'a> Fn(&'a JobRecord) -> JobChange + Send + Sync),
    ) -> Option<JobRecord> {
        let (_, id) = self.places(claim.lane, |job| self.rank(job, claim)).into_iter().find(|(rank, _)| *rank < 2)?;
        let change = change(&self.jobs.get(&id)?.record);
        self.write_change(id, claim.to, &change);
        let last = self.turns.values().max().copied().unwrap_or(0) + 1;
        let job = self.jobs.get_mut(&id)?;
        job.record.fence += 1;
        job.record.lease_until = Some(ms_after(claim.lease));
        job.worker = claim.worker;
        self.turns.insert((job.record.tenant.clone(), claim.lane), last);
        Some(job.record.clone())
    }

    /// Rank of a job: 0 to claim first; 1 if another worker knows its session.
    ///
    /// 2 if it is still left to that worker.
    fn rank(&self, job: &Job, claim: &Claim) -> u8 {
        let of_session = self.jobs.values().rev().filter(|j| j.record.session == job.record.session);
        let last = of_session.filter_map(|j| j.worker).next();
        let waited = job.accepted_at.elapsed();
        match (last, claim.worker) {
            (Some(last), Some(worker)) if last != worker && waited <= claim.patience => {
                if waited > Claim::HEAD_START {
                    1
                } else {
                    2
                }
            }
            _ => 0,
        }
    }

    pub(super) fn renew(&mut self, id: JobId, fence: u64, lease: Duration) -> Option<bool> {
        let job = self.running(id, fence)?;
        job.record.lease_until = Some(ms_after(lease));
        Some(job.record.cancel_requested_at.is_some())
    }

    pub(super) fn abandoned(&self) -> Vec<JobRecord> {
        let passed = |j: &&JobRecord| j.lease_until.is_none_or(|until| until < ms_after(Duration::ZERO));
        let running = self.jobs.values().map(|j| &j.record).filter(|j| j.state == JobState::Running);
        running.filter(passed).cloned().collect()
    }

    fn write_change(&mut self, id: JobId, to: JobState, change: &JobChange) {
        let Some(job) = self.jobs.get_mut(&id) else { return };
        let (now, record) = (now_rfc3339(), &mut job.record);
        record.progress = progress_after(to, change.progress, record.progress);
        record.state = to;
        if let Some(phase) = change.phase {
            phase.clone_into(&mut record.phase);
        }
        let attempts = i64::from(record.attempt) + change.attempt_change;
        record.attempt = u32::try_from(attempts).unwrap_or(0);
        for (kept, new) in [(&mut record.report, &change.report), (&mut record.fault, &change.fault)] {
            if new.is_some() {
                kept.clone_from(new);
            }
        }
        record.warnings = joined_warnings(std::mem::take(&mut record.warnings), &change.warnings);
        if to == JobState::Running {
            record.started_at = Some(now.clone());
        }
        if to.has_ended() {
            record.finished_at = Some(now);
            record.milestone_blob = None;
        }
        if let Some(tissue) = &change.tissue {
            record.tissue_blob = Some(tissue.key.clone());
            job.bytes += tissue.bytes;
        }
        self.append_all(id, &change.events);
    }

    fn running(&mut self, id: JobId, fence: u64) -> Option<&mut Job> {
        self.jobs.get_mut(&id).filter(|j| j.record.state == JobState::Running && j.record.fence == fence)
    }

    pub(super) fn change_job(
        &mut self,
        id: JobId,
        fence: u64,
        from: JobState,
        to: JobState,
        change: &JobChange,
        quota: u64,
    ) -> Result<bool> {
        let Some(job) = self.jobs.get(&id).filter(|j| j.record.may_change(from, fence, to)) else {
            return Ok(false);
        };
        let session = job.record.session;
        self.write_change(id, to, change);
        if change.tissue.is_some() {
            self.check_bytes(session, quota)?;
        }
        Ok(true)
    }

    pub(super) fn record_progress(&mut self, id: JobId, fence: u64, phase: &str, progress: f64, event: &str) -> bool {
        let Some(job) = self.running(id, fence) else { return false };
        phase.clone_into(&mut job.record.phase);
        job.record.progress = progress;
        self.append(id, "progress", event);
        let outdated = self.last_seq(id).saturating_sub(KEPT_PROGRESS);
        self.events.retain(|(job, seq), event| *job != id || *seq > outdated || event.kind != "progress");
        true
    }

    pub(super) fn set_rest(&mut self, id: JobId, fence: u64, rest: &BlobInfo, quota: u64) -> Result<Option<String>> {
        let job = self.running(id, fence).ok_or(StoreError::SessionGone)?;
        let old = job.record.rest_blob.replace(rest.key.clone());
        job.bytes = rest.bytes;
        let session = job.record.session;
        self.check_bytes(session, quota)?;
        Ok(old)
    }

    pub(super) fn set_milestone(&mut self, id: JobId, fence: u64, blob: &str) -> Result<Option<String>> {
        let job = self.running(id, fence).ok_or(StoreError::SessionGone)?;
        Ok(job.record.milestone_blob.replace(blob.to_owned()))
    }

    pub(super) fn begin_again(&mut self, id: JobId, fence: u64) -> Result<Vec<String>> {
        let milestone = self.running(id, fence).ok_or(StoreError::SessionGone)?.record.milestone_blob.take();
        let forgotten = self.steps.extract_if((id, 0)..=(id, u32::MAX), |_, _| true).map(|(_, step)| step.blob);
        Ok(forgotten.chain(milestone).collect())
    }

    pub(super) fn commit_step(
        &mut self,
        job: JobId,
        fence: u64,
        step: &StepRecord,
        events: &[(&'static str, String)],
        quota: u64,
    ) -> Result<StepWritten> {
        let session = self.running(job, fence).ok_or(StoreError::SessionGone)?.record.session;
        if let Some(old) = self.steps.get_mut(&(job, step.k)).filter(|old| old.sha256 == step.sha256) {
            old.error.clone_from(&step.error);
            return Ok(StepWritten::Same);
        }
        let old = self.steps.insert((job, step.k), step.clone());
        self.append_all(job, events);
        self.check_bytes(session, quota)?;
        Ok(StepWritten::New(old.map(|old| old.blob)))
    }

    pub(super) fn drop_comparisons(&mut self, ended_before: &str) -> Vec<String> {
        let mut blobs = Vec::new();
        for job in self.jobs.values_mut().filter(|j| j.record.kind == JobKind::Compare) {
            if job.record.finished_at.as_deref().is_some_and(|t| t < ended_before) {
                blobs.extend([job.record.rest_blob.take(), job.record.tissue_blob.take()].into_iter().flatten());
                job.bytes = 0;
            }
        }
        blobs
    }

    pub(super) fn prune_events(&mut self, ended_before: &str) -> u64 {
        let ended = |j: &&mut Job| {
            j.record.state.has_ended() && j.record.finished_at.as_deref().is_some_and(|t| t < ended_before)
        };
        let last: BTreeMap<JobId, u64> = self
            .jobs
            .values()
            .filter(|j| j.record.state.has_ended())
            .map(|j| (j.record.id, self.last_seq(j.record.id)))
            .collect();
        let mut dropped = 0;
        for job in self.jobs.values_mut().filter(ended) {
            let Some(seq) = last.get(&job.record.id).copied().filter(|seq| *seq > 0) else { continue };
            job.record.events_from = seq;
            let before = self.events.len();
            self.events.retain(|(id, s), _| *id != job.record.id || *s >= seq);
            dropped += (before - self.events.len()) as u64;
        }
        dropped
    }
}
