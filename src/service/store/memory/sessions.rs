use std::collections::BTreeSet;

use super::{Result, Rows};
use crate::job::check_quota;
use crate::records::now_rfc3339;
use crate::{
    AnswerRecord, JobId, JobRecord, OsteotomyId, Owner, PartKind, PartRecord, PlanId, SessionContents, SessionId,
    StoreError, TenantId,
};

impl Rows {
    pub(super) fn require(&self, session: SessionId) -> Result<()> {
        if self.sessions.contains_key(&session) { Ok(()) } else { Err(StoreError::SessionGone) }
    }

    pub(super) fn remember(&mut self, answer: Option<&AnswerRecord>) -> Result<()> {
        let Some(answer) = answer else { return Ok(()) };
        let key = (answer.tenant.clone(), answer.key.clone());
        if self.answers.contains_key(&key) {
            return Err(StoreError::KeyTaken);
        }
        self.answers.insert(key, (answer.clone(), now_rfc3339()));
        Ok(())
    }

    pub(super) fn parts(&self, session: SessionId) -> Vec<PartRecord> {
        let of = |((s, _), part): (&(SessionId, PartKind), &PartRecord)| (*s == session).then(|| part.clone());
        let mut parts: Vec<PartRecord> = self.parts.iter().filter_map(of).collect();
        parts.sort_by_key(|part| part.kind.as_str());
        parts
    }

    pub(super) fn contents(&self, id: SessionId, jobs: u32) -> SessionContents {
        let newest_first = self.jobs.values().rev().map(|j| &j.record).filter(|j| j.session == id);
        SessionContents {
            parts: self.parts(id),
            osteotomies: self.osteotomies.values().filter(|o| o.session == id).map(|o| o.id).collect(),
            plans: self.plans.values().filter(|p| p.session == id).map(|p| p.id).collect(),
            jobs: newest_first.take(jobs as usize).cloned().collect(),
            bytes: self.bytes(id),
        }
    }

    pub(super) fn bytes(&self, id: SessionId) -> u64 {
        let jobs = self.jobs.values().filter(|j| j.record.session == id);
        let steps = |job: JobId| self.steps.range((job, 0)..=(job, u32::MAX)).map(|(_, s)| s.bytes).sum::<u64>();
        self.parts.iter().filter(|((s, _), _)| *s == id).map(|(_, p)| p.bytes).sum::<u64>()
            + self.osteotomies.values().filter(|o| o.session == id).map(|o| o.bytes).sum::<u64>()
            + jobs.map(|j| j.bytes + steps(j.record.id)).sum::<u64>()
    }

    pub(super) fn check_bytes(&self, id: SessionId, quota: u64) -> Result<()> {
        check_quota(self.bytes(id), quota)
    }

    pub(super) fn last_used(&self, id: SessionId) -> Option<String> {
        let made = self.sessions.get(&id)?.created_at.clone();
        let parts = self.parts.iter().filter(|((s, _), _)| *s == id).map(|(_, p)| p.updated_at.clone());
        let osteotomies = self.osteotomies.values().filter(|o| o.session == id).map(|o| o.created_at.clone());
        let plans = self.plans.values().filter(|p| p.session == id).map(|p| p.created_at.clone());
        let jobs = self.jobs.values().map(|j| &j.record).filter(|j| j.session == id);
        let jobs = jobs.flat_map(|j| [Some(j.created_at.clone()), j.finished_at.clone()].into_iter().flatten());
        parts.chain(osteotomies).chain(plans).chain(jobs).chain([made]).max()
    }

    pub(super) fn owner(&self, id: &str) -> Option<Owner> {
        let session = id.parse().ok().and_then(|id: SessionId| self.sessions.get(&id)).map(|s| &s.tenant);
        let job = id.parse().ok().and_then(|id: JobId| self.jobs.get(&id)).map(|j| &j.record.tenant);
        let here = session.or(job).map(|tenant| Owner { tenant: tenant.clone(), deleted: false });
        let gone = || self.tombstones.get(id).map(|(tenant, _)| Owner { tenant: tenant.clone(), deleted: true });
        gone().or(here)
    }

    /// When a stored session or job was hidden, RFC 3339.
    pub(super) fn hidden_at(&self, id: &str) -> Option<&str> {
        self.tombstones.get(id).map(|(_, at)| at.as_str())
    }

    /// Ids of a session and of everything that is hidden with it.
    fn with_contents(&self, id: SessionId) -> Vec<String> {
        let reads = |j: &&super::Job| j.record.session == id || j.record.other_session == Some(id);
        let jobs = self.jobs.values().filter(reads).map(|j| j.record.id.to_string());
        let osteotomies = self.osteotomies.values().filter(|o| o.session == id).map(|o| o.id.to_string());
        let plans = self.plans.values().filter(|p| p.session == id).map(|p| p.id.to_string());
        jobs.chain(osteotomies).chain(plans).chain([id.to_string()]).collect()
    }

    pub(super) fn hide_session(&mut self, id: SessionId) -> bool {
        let Some(tenant) = self.sessions.get(&id).map(|s| s.tenant.clone()) else { return false };
        if self.hidden_at(&id.to_string()).is_some() {
            return false;
        }
        self.with_contents(id).into_iter().for_each(|id| self.bury(id, &tenant));
        self.answers.retain(|_, (answer, _)| answer.session != Some(id));
        true
    }

    pub(super) fn restore_session(&mut self, id: SessionId) -> bool {
        if !self.sessions.contains_key(&id) || self.tombstones.remove(&id.to_string()).is_none() {
            return false;
        }
        // A comparison of two sessions stays hidden while either session is hidden.
        let hidden: BTreeSet<SessionId> =
            self.sessions.keys().copied().filter(|s| self.hidden_at(&s.to_string()).is_some()).collect();
        let of_hidden = |j: &&super::Job| {
            hidden.contains(&j.record.session) || j.record.other_session.is_some_and(|other| hidden.contains(&other))
        };
        let stays: BTreeSet<String> = self.jobs.values().filter(of_hidden).map(|j| j.record.id.to_string()).collect();
        for id in self.with_contents(id).into_iter().filter(|id| !stays.contains(id)) {
            self.tombstones.remove(&id);
        }
        true
    }

    fn bury(&mut self, id: String, tenant: &TenantId) {
        self.tombstones.entry(id).or_insert_with(|| (tenant.clone(), now_rfc3339()));
    }

    pub(super) fn delete_session(&mut self, id: SessionId) -> Option<Vec<String>> {
        let session = self.sessions.remove(&id)?;
        let mut elsewhere = Vec::new();
        let reads = |j: &super::Job| j.record.session == id || j.record.other_session == Some(id);
        let jobs: Vec<super::Job> = self.jobs.values().filter(|j| reads(j)).cloned().collect();
        for job in jobs {
            let (job, tenant) = (job.record, session.tenant.clone());
            if job.session != id {
                elsewhere.extend([job.rest_blob, job.tissue_blob].into_iter().flatten());
                elsewhere.extend(self.steps.range((job.id, 0)..=(job.id, u32::MAX)).map(|(_, step)| step.blob.clone()));
            }
            self.bury(job.id.to_string(), &tenant);
            self.jobs.remove(&job.id);
            self.steps.retain(|(j, _), _| *j != job.id);
            self.events.retain(|(j, _), _| *j != job.id);
        }
        for osteotomy in self.osteotomies.values().filter(|o| o.session == id).map(|o| o.id).collect::<Vec<_>>() {
            self.bury(osteotomy.to_string(), &session.tenant);
        }
        for plan in self.plans.values().filter(|p| p.session == id).map(|p| p.id).collect::<Vec<_>>() {
            self.bury(plan.to_string(), &session.tenant);
        }
        self.bury(id.to_string(), &session.tenant);
        self.osteotomies.retain(|_, o| o.session != id);
        self.plans.retain(|_, p| p.session != id);
        self.parts.retain(|(s, _), _| *s != id);
        self.answers.retain(|_, (answer, _)| answer.session != Some(id));
        Some(elsewhere)
    }

    pub(super) fn delete_osteotomy(&mut self, session: SessionId, id: OsteotomyId) -> Option<Vec<String>> {
        let record = self.osteotomies.get(&id).filter(|o| o.session == session)?.clone();
        let tenant = self.sessions.get(&session)?.tenant.clone();
        for plan in self.plans.values().filter(|p| p.osteotomy == Some(id)).map(|p| p.id).collect::<Vec<_>>() {
            self.bury(plan.to_string(), &tenant);
            self.plans.remove(&plan);
        }
        self.bury(id.to_string(), &tenant);
        self.osteotomies.remove(&id);
        Some(record.blobs)
    }

    pub(super) fn delete_plan(&mut self, session: SessionId, id: PlanId) -> bool {
        let Some(tenant) = self.sessions.get(&session).map(|s| s.tenant.clone()) else { return false };
        if self.plans.get(&id).is_none_or(|p| p.session != session) {
            return false;
        }
        self.plans.remove(&id);
        self.bury(id.to_string(), &tenant);
        true
    }

    pub(super) fn named_blobs(&self) -> BTreeSet<String> {
        let parts = self.parts.values().filter_map(|p| p.blob.clone());
        let of = |j: &JobRecord| [&j.rest_blob, &j.tissue_blob, &j.milestone_blob].map(Clone::clone);
        let jobs = self.jobs.values().flat_map(|j| of(&j.record));
        let steps = self.steps.values().map(|s| s.blob.clone());
        let osteotomies = self.osteotomies.values().flat_map(|o| o.blobs.iter().cloned());
        parts.chain(jobs.flatten()).chain(steps).chain(osteotomies).collect()
    }
}
