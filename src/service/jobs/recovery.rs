use super::Service;
use super::transition::{apply, recovery};
use prosopon_contract::Fault;
use prosopon_store::{JobFilter, JobRecord, JobState};

/// Recovers unfinished jobs. `abandoned` are those that an earlier or another process left running.
///
/// - Any of the jobs below with a cancellation request: becomes cancelled.
/// - Running, in `abandoned`: becomes interrupted, then as below.
/// - Interrupted: becomes accepted, or failed after the last attempt.
/// - Accepted: keeps waiting.
pub(super) async fn recover(service: &Service, abandoned: Vec<JobRecord>) -> Result<(), Fault> {
    let all = |state| JobFilter { state: Some(state), limit: u32::MAX, ..JobFilter::default() };
    for job in service.store.jobs(&all(JobState::Accepted)).await?.iter().chain(&abandoned) {
        recover_one(service, job).await?;
    }
    for job in service.store.jobs(&all(JobState::Interrupted)).await? {
        recover_one(service, &job).await?;
    }
    Ok(())
}

async fn recover_one(service: &Service, job: &JobRecord) -> Result<(), Fault> {
    if let Some((event, change)) = recovery(job, service.settings.max_attempts) {
        tracing::info!(job.id = %job.id, attempt = job.attempt, ?event, "found a job that no worker computes");
        apply(service, job, event, change).await?;
    }
    Ok(())
}
