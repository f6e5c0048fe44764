use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::time::Duration;

use super::Service;
use super::running::step_warning;
use prosopon_contract::{Fault, Findings, StepDocument, WarningDocument, from_json};
use prosopon_store::{JobId, JobRecord, JobState, StepRecord};

/// Current status of a job.
#[derive(Debug, Clone, PartialEq)]
pub struct JobStatus {
    /// Warnings and notes so far.
    pub findings: Findings,
    /// Its row; phase, progress and warnings are live while it runs in this process.
    pub record: JobRecord,
    /// Number of finished steps.
    pub steps_done: u32,
    /// Estimate of the remaining time, s; `None` while there is no estimate.
    pub eta_s: Option<f64>,
    /// Number of jobs that end before it begins, the running ones included; `None` unless it waits.
    pub queue_position: Option<u32>,
    /// Relative residual of each finished step.
    pub residuals: Vec<f64>,
}

impl JobStatus {
    /// Status of a job that this process does not run.
    ///
    /// `before` jobs wait before it (`None` unless it waits), and `running` jobs run.
    pub(super) fn waiting(record: JobRecord, before: Option<u32>, running: usize) -> Self {
        let queue_position = before.map(|before| place(before as usize, running));
        Self {
            findings: Findings::default(),
            record,
            steps_done: 0,
            eta_s: None,
            queue_position,
            residuals: Vec::new(),
        }
    }
}

/// Position in a lane behind `before` waiting and `running` running jobs.
fn place(before: usize, running: usize) -> u32 {
    u32::try_from(before.saturating_add(running)).unwrap_or(u32::MAX)
}

impl Service {
    /// Current status of a job.
    ///
    /// # Errors
    /// As [`Service::job`].
    pub async fn status(&self, id: JobId) -> Result<JobStatus, Fault> {
        let record = self.job(id).await?;
        let steps = self.store.steps(id).await?;
        let waits = record.state == JobState::Accepted;
        let queue = if waits { Some(self.store.queue(record.kind.lane()).await?) } else { None };
        self.status_with(record, &steps, queue.as_ref())
    }

    /// Current status of the jobs of rows, in their order.
    ///
    /// # Errors
    /// The store's.
    pub async fn statuses_of(&self, records: Vec<JobRecord>) -> Result<Vec<JobStatus>, Fault> {
        let ids: Vec<JobId> = records.iter().map(|record| record.id).collect();
        let mut steps = self.store.steps_of(&ids).await?;
        let mut queues = BTreeMap::new();
        for record in records.iter().filter(|record| record.state == JobState::Accepted) {
            if let Entry::Vacant(queue) = queues.entry(record.kind.lane()) {
                queue.insert(self.store.queue(record.kind.lane()).await?);
            }
        }
        let status = |record: JobRecord| {
            let queue = queues.get(&record.kind.lane()).filter(|_| record.state == JobState::Accepted);
            let steps = steps.remove(&record.id).unwrap_or_default();
            self.status_with(record, &steps, queue)
        };
        records.into_iter().map(status).collect()
    }

    fn status_with(
        &self,
        mut record: JobRecord,
        steps: &[StepRecord],
        queue: Option<&Vec<JobId>>,
    ) -> Result<JobStatus, Fault> {
        let running = self.running(record.id).filter(|_| record.state == JobState::Running);
        if let Some(running) = &running {
            running.phase().as_str().clone_into(&mut record.phase);
            record.progress = running.control.progress();
        }
        let mut findings: Findings = record.warnings.iter().map(|text| WarningDocument::from_row(text)).collect();
        findings.extend(running.iter().flat_map(|running| running.warnings()));
        let read = |step: &StepRecord| from_json::<StepDocument>("the document of the step", &step.document);
        let steps: Vec<StepDocument> = steps.iter().map(read).collect::<Result<_, _>>()?;
        // Steps outlive a process that was killed; its other warnings come back when the job continues.
        let known: Vec<WarningDocument> = findings.iter().cloned().collect();
        let of_steps = steps.iter().flat_map(|step| step.findings.iter().map(move |warning| (step.k, warning)));
        findings.extend(of_steps.filter(|(_, w)| !known.contains(w)).map(|(k, w)| step_warning(k, w)));
        let queue_position = queue.map(|queue| {
            let before = queue.iter().position(|id| *id == record.id).unwrap_or(0);
            place(before, self.running_in(record.kind.lane()))
        });
        Ok(JobStatus {
            steps_done: u32::try_from(steps.len()).unwrap_or(u32::MAX),
            residuals: steps.iter().map(|step| step.relative_residual).collect(),
            eta_s: running.and_then(|r| r.eta_s()),
            queue_position,
            findings,
            record,
        })
    }

    /// Waits at most `patience` for the end of a job and returns its status.
    ///
    /// # Errors
    /// As [`Service::job`].
    pub async fn wait(&self, id: JobId, patience: Duration) -> Result<JobStatus, Fault> {
        let mut changes = self.watch_changes();
        let ended = async {
            loop {
                changes.borrow_and_update();
                if self.job(id).await?.state.has_ended() {
                    return Ok::<(), Fault>(());
                }
                tokio::select! {
                    changed = changes.changed() => if changed.is_err() { return Ok(()) },
                    () = self.stop.cancelled() => return Ok(()),
                }
            }
        };
        if let Ok(result) = tokio::time::timeout(patience, ended).await {
            result?;
        }
        self.status(id).await
    }
}
