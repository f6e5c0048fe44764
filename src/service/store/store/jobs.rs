//! The job queue, and the steps and events of jobs.

use std::collections::BTreeMap;
use std::time::Duration;

use super::{Result, Store};
use crate::look::Look;
use crate::{
    BlobInfo, Claim, EventRecord, Insertion, JobChange, JobFilter, JobId, JobKind, JobRecord, JobState, Lane, NewJob,
    StepRecord, StepWritten, StoreError,
};

impl Store {
    /// Stores an accepted job and removes the checkpoints of the jobs that it supersedes.
    ///
    /// See [`MetaStore::insert_job`](crate::MetaStore::insert_job).
    ///
    /// # Errors
    /// [`StoreError::SessionGone`](crate::StoreError::SessionGone), [`StoreError::KeyTaken`](crate::StoreError::KeyTaken).
    pub async fn insert_job(&self, new: &NewJob<'_>) -> Result<Insertion> {
        let insertion = self.meta.insert_job(new).await?;
        if let Insertion::Stored { superseded, .. } = &insertion {
            self.blobs.remove(superseded.iter().filter_map(|(_, checkpoint)| checkpoint.clone()).collect()).await;
        }
        Ok(insertion)
    }

    /// The job `id`; `None` when there is none.
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

    /// Accepted jobs of a lane in the order in which workers claim them.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn queue(&self, lane: Lane) -> Result<Vec<JobId>> {
        self.meta.queue(lane).await
    }

    /// Claims the first job of a lane, as [`MetaStore::claim_job`](crate::MetaStore::claim_job).
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

    /// Renews the lease of a running job; returns whether its cancellation was requested.
    ///
    /// `None` when another worker has claimed the job, or when the job does not exist.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn renew(&self, job: &JobRecord, lease: Duration) -> Result<Option<bool>> {
        self.meta.renew(job.id, job.fence, lease).await
    }

    /// Running jobs that no worker computes any more.
    ///
    /// In a shared store these are the jobs with an expired lease. In a store of one process these are all running jobs, so call
    /// this when the store is opened.
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

    /// Changes the state of a job from that of the row `job` to `to`, and appends events.
    ///
    /// Returns false when the job is not in that state any more; then removes the blob that the change names. When a solve ends,
    /// removes its checkpoint.
    ///
    /// # Errors
    /// [`StoreError::QuotaFull`](crate::StoreError::QuotaFull).
    pub async fn change_job(&self, job: &JobRecord, to: JobState, change: &JobChange) -> Result<bool> {
        let ends = to.has_ended() && job.kind == JobKind::Solve;
        let before = if ends { self.job(job.id).await? } else { None };
        let changed = self.meta.change_job(job.id, job.fence, job.state, to, change, self.quota).await;
        if matches!(changed, Ok(true)) {
            self.blobs.remove(before.and_then(|row| row.checkpoint_blob).into_iter().collect()).await;
        }
        let Some(tissue) = &change.tissue else { return changed };
        match changed {
            // An earlier call wrote this change, and its answer was lost.
            Ok(false) if self.job(job.id).await?.is_some_and(|row| row.tissue_blob.as_ref() == Some(&tissue.key)) => {
                return Ok(true);
            }
            // After a database error the caller may try again, so the blob stays.
            Ok(false) | Err(StoreError::QuotaFull { .. }) => self.blobs.delete(&tissue.key).await,
            Ok(true) | Err(_) => {}
        }
        changed
    }

    /// Records a cancellation request, as [`MetaStore::request_cancel`](crate::MetaStore::request_cancel).
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn request_cancel(&self, id: JobId) -> Result<bool> {
        self.meta.request_cancel(id).await
    }

    /// Stores the progress of a running job with an event; false when the job does not run any more.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn record_progress(&self, job: &JobRecord, phase: &str, progress: f64, event: &str) -> Result<bool> {
        self.meta.record_progress(job.id, job.fence, phase, progress, event).await
    }

    /// Stores the key of a running job's first large result.
    ///
    /// Removes the replaced blob, on failure the new one.
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

    /// Stores the key of a running job's last checkpoint.
    ///
    /// Removes the replaced blob, on failure the new one.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`](crate::StoreError::SessionGone) when the job does not exist or does not run any more.
    pub async fn set_checkpoint(&self, job: &JobRecord, blob: &BlobInfo) -> Result<()> {
        match self.meta.set_checkpoint(job.id, job.fence, &blob.key).await {
            Ok(old) => {
                // A repeated call finds its own key; that blob stays.
                self.blobs.remove(old.into_iter().filter(|old| *old != blob.key).collect()).await;
                Ok(())
            }
            Err(error) => {
                // An earlier call, whose answer was lost, may have stored this key.
                let named =
                    |row: Option<JobRecord>| row.and_then(|row| row.checkpoint_blob).as_ref() == Some(&blob.key);
                if self.job(job.id).await.is_ok_and(|row| !named(row)) {
                    self.remove_refused(&error, vec![blob.key.clone()]).await;
                }
                Err(error)
            }
        }
    }

    /// Deletes the steps and the checkpoint of a running job, which starts from rest.
    ///
    /// All stored steps of a job therefore come from one attempt.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`](crate::StoreError::SessionGone) when the job does not exist or does not run any more.
    pub async fn begin_again(&self, job: &JobRecord) -> Result<()> {
        let forgotten = self.meta.begin_again(job.id, job.fence).await?;
        self.blobs.remove(forgotten).await;
        Ok(())
    }

    // ---- steps and events ----

    /// Stores a step: its row and its events in one transaction, after its frame is stored.
    ///
    /// If an earlier attempt stored an identical frame, that frame stays and gets the new error statistics; a different frame is
    /// replaced.
    ///
    /// # Errors
    /// [`StoreError::SessionGone`](crate::StoreError::SessionGone) when the job does not exist or does not run any more,
    /// [`StoreError::QuotaFull`](crate::StoreError::QuotaFull).
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

    /// Finished steps of jobs, in order; jobs without steps are omitted.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn steps_of(&self, jobs: &[JobId]) -> Result<BTreeMap<JobId, Vec<StepRecord>>> {
        self.meta.steps(jobs).await
    }

    /// Finished step `k` of a job; `None` when there is none.
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

    /// Deletes all but the last event of jobs that ended longer than `age` ago; returns the number deleted.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn prune_events(&self, look: &Look, age: Duration) -> Result<u64> {
        self.meta.prune_events(&look.before(age)).await
    }

    /// Removes the large results of comparisons that ended longer than `age` ago.
    ///
    /// Returns the number of blobs.
    ///
    /// # Errors
    /// [`StoreError`](crate::StoreError).
    pub async fn drop_comparisons(&self, look: &Look, age: Duration) -> Result<usize> {
        let blobs = self.meta.drop_comparisons(&look.before(age)).await?;
        let dropped = blobs.len();
        self.blobs.remove(blobs).await;
        Ok(dropped)
    }
}
