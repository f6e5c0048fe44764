//! The queue, steps and events of jobs.

use std::collections::BTreeMap;
use std::time::Duration;

use super::{Result, Store};
use crate::records::rfc3339_before;
use crate::{
    BlobInfo, Claim, EventRecord, Insertion, JobChange, JobFilter, JobId, JobKind, JobRecord, JobState, Lane, NewJob,
    StepRecord, StepWritten, StoreError,
};

impl Store {
    /// Stores an accepted job, as [`MetaStore::insert_job`](crate::MetaStore::insert_job).
    ///
    /// # Errors
    /// [`StoreError::SessionGone`](crate::StoreError::SessionGone), [`StoreError::KeyTaken`](crate::StoreError::KeyTaken).
    pub async fn insert_job(&self, new: &NewJob<'_>) -> Result<Insertion> {
        let insertion = self.meta.insert_job(new).await?;
        if let Insertion::Stored { superseded, .. } = &insertion {
            self.blobs.remove(superseded.iter().filter_map(|(_, milestone)| milestone.clone()).collect()).await;
        }
        Ok(insertion)
    }

    /// A job, if it is there.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn job(&self, id: JobId) -> Result<Option<JobRecord>> {
        self.meta.job(id).await
    }

    /// Jobs, newest first.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn jobs(&self, filter: &JobFilter) -> Result<Vec<JobRecord>> {
        self.meta.jobs(filter).await
    }

    /// Accepted jobs of a lane in the order in which they will run.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn queue(&self, lane: Lane) -> Result<Vec<JobId>> {
        self.meta.queue(lane).await
    }

    /// Takes the first job of a lane, as [`MetaStore::claim_job`](crate::MetaStore::claim_job).
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn claim_job(
        &self,
        claim: &Claim,
        change: &(dyn for<'a> Fn(&'a JobRecord) -> JobChange + Send + Sync),
    ) -> Result<Option<JobRecord>> {
        self.meta.claim_job(claim, change).await
    }

    /// Leases a running job anew: whether it was asked to stop. `None` when it was given to another worker, or is not there.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn renew(&self, job: &JobRecord, lease: Duration) -> Result<Option<bool>> {
        self.meta.renew(job.id, job.fence, lease).await
    }

    /// Running jobs of which no worker is heard any more: those whose lease has passed, and, where no other process has the store,
    /// all that run when it is opened.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn abandoned(&self) -> Result<Vec<JobRecord>> {
        if self.is_shared() {
            return self.meta.abandoned().await;
        }
        let running = JobFilter { state: Some(JobState::Running), limit: u32::MAX, ..JobFilter::default() };
        self.meta.jobs(&running).await
    }

    /// Moves a job from the state that its row says to another, with events. False when it is not in that state any more; then
    /// the blob that the change names is removed. At its end its milestone is removed.
    ///
    /// # Errors
    /// [`StoreError::QuotaFull`](crate::StoreError::QuotaFull).
    pub async fn change_job(&self, job: &JobRecord, to: JobState, change: &JobChange) -> Result<bool> {
        let ends = to.has_ended() && job.kind == JobKind::Solve;
        let before = if ends { self.job(job.id).await? } else { None };
        let changed = self.meta.change_job(job.id, job.fence, job.state, to, change, self.quota).await;
        if matches!(changed, Ok(true)) {
            self.blobs.remove(before.and_then(|row| row.milestone_blob).into_iter().collect()).await;
        }
        let Some(tissue) = &change.tissue else { return changed };
        match changed {
            // Written before, by a call whose answer was lost.
            Ok(false) if self.job(job.id).await?.is_some_and(|row| row.tissue_blob.as_ref() == Some(&tissue.key)) => {
                return Ok(true);
            }
            // After a fault of the database the change may be tried again.
            Ok(false) | Err(StoreError::QuotaFull { .. }) => self.blobs.delete(&tissue.key).await,
            Ok(true) | Err(_) => {}
        }
        changed
    }

    /// Records that a job was asked to stop, as [`MetaStore::request_cancel`](crate::MetaStore::request_cancel).
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn request_cancel(&self, id: JobId) -> Result<bool> {
        self.meta.request_cancel(id).await
    }

    /// Records how far a running job is, with an event. False when it is not running any more.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn record_progress(&self, job: &JobRecord, phase: &str, progress: f64, event: &str) -> Result<bool> {
        self.meta.record_progress(job.id, job.fence, phase, progress, event).await
    }

    /// Names the first large result of a running job; the blob that it replaces is removed, on failure the new one.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`](crate::StoreError::SessionGone), [`StoreError::QuotaFull`](crate::StoreError::QuotaFull).
    pub async fn set_rest(&self, job: &JobRecord, rest: &BlobInfo) -> Result<()> {
        match self.meta.set_rest(job.id, job.fence, rest, self.quota).await {
            Ok(old) => {
                self.blobs.remove(old.into_iter().collect()).await;
                Ok(())
            }
            Err(error) => {
                self.remove_refused(&error, vec![rest.key.clone()]).await;
                Err(error)
            }
        }
    }

    /// Names the last milestone of a running job; the blob that it replaces is removed, on failure the new one.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`](crate::StoreError::SessionGone) when the job is not there or not running any more.
    pub async fn set_milestone(&self, job: &JobRecord, blob: &BlobInfo) -> Result<()> {
        match self.meta.set_milestone(job.id, job.fence, &blob.key).await {
            Ok(old) => {
                // The same one when what was written is written again.
                self.blobs.remove(old.into_iter().filter(|old| *old != blob.key).collect()).await;
                Ok(())
            }
            Err(error) => {
                // An earlier call, whose answer was lost, may have named it.
                let named = |row: Option<JobRecord>| row.and_then(|row| row.milestone_blob).as_ref() == Some(&blob.key);
                if self.job(job.id).await.is_ok_and(|row| !named(row)) {
                    self.remove_refused(&error, vec![blob.key.clone()]).await;
                }
                Err(error)
            }
        }
    }

    /// Forgets the steps and the milestone of a running job, which begins at rest: what is stored of it is of one attempt.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`](crate::StoreError::SessionGone) when the job is not there or not running any more.
    pub async fn begin_again(&self, job: &JobRecord) -> Result<()> {
        let forgotten = self.meta.begin_again(job.id, job.fence).await?;
        self.blobs.remove(forgotten).await;
        Ok(())
    }

    // ---- steps and events ----

    /// Makes a step visible: its row and its events in one transaction, after the frame is on disk. A frame that an earlier
    /// attempt left the same is kept with what this one says of its errors, another one replaced.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`](crate::StoreError::SessionGone) when the job is not there or not running any more, [`StoreError::QuotaFull`](crate::StoreError::QuotaFull).
    pub async fn commit_step(
        &self,
        job: &JobRecord,
        step: &StepRecord,
        events: &[(&'static str, String)],
    ) -> Result<StepWritten> {
        let written = self.meta.commit_step(job.id, job.fence, step, events, self.quota).await;
        match &written {
            Ok(StepWritten::New(old)) => self.blobs.remove(old.iter().cloned().collect()).await,
            Ok(StepWritten::Same) => self.blobs.delete(&step.blob).await,
            Err(error) => self.remove_refused(error, vec![step.blob.clone()]).await,
        }
        written
    }

    /// Finished steps of a job, in order.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn steps(&self, job: JobId) -> Result<Vec<StepRecord>> {
        Ok(self.meta.steps(&[job]).await?.remove(&job).unwrap_or_default())
    }

    /// Finished steps of jobs, in order; nothing for those that have none.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn steps_of(&self, jobs: &[JobId]) -> Result<BTreeMap<JobId, Vec<StepRecord>>> {
        self.meta.steps(jobs).await
    }

    /// One finished step, if it is there.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn step(&self, job: JobId, k: u32) -> Result<Option<StepRecord>> {
        Ok(self.steps(job).await?.into_iter().find(|s| s.k == k))
    }

    /// Events of a job after number `after`, in order.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn events(&self, job: JobId, after: u64) -> Result<Vec<EventRecord>> {
        self.meta.events(job, after).await
    }

    /// Drops all but the last event of jobs that ended longer than `age` ago: the number dropped.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn prune_events(&self, age: Duration) -> Result<u64> {
        self.meta.prune_events(&rfc3339_before(age)).await
    }

    /// Drops the large results of comparisons that ended longer than `age` ago; the number of their files.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn drop_comparisons(&self, age: Duration) -> Result<usize> {
        let blobs = self.meta.drop_comparisons(&rfc3339_before(age)).await?;
        let dropped = blobs.len();
        self.blobs.remove(blobs).await;
        Ok(dropped)
    }

    // ---- keeping house ----
}
