//! The work of each kind of job: read, compute on the pool, write.

mod compare;
mod comparison;
mod continuation;
mod estimate;
mod field;
mod import;
mod mesh;
mod report;
mod scene;
mod solve;
mod solve_watch;
mod steps;

use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use serde::de::DeserializeOwned;

use super::Service;
use super::events::panicked;
use super::kept::{case_of, recall};
use super::running::Running;
use prosopon_contract::{Fault, FaultKind, Halt, WarningDocument, from_json};
use prosopon_geometry::control::Control;
use prosopon_session::{Case, Engine, Kept, SessionParts};
use prosopon_store::{BlobInfo, JobKind, JobRecord, Lane, OsteotomyId, PartRecord, StepRecord};

/// Share of a job's progress that the computation takes; the rest is writing the results.
const COMPUTING: f64 = 0.99;

/// Interval of checks for a stop while a job waits for the store.
const STOP_SEEN: Duration = Duration::from_millis(250);

/// A job that goes on, and the JSON of its first event.
type Continuation = Box<(JobRecord, String)>;

/// Result of a job for its row.
#[derive(Debug, Default)]
pub(super) struct Done {
    pub(super) report: Option<String>,
    pub(super) tissue: Option<BlobInfo>,
    pub(super) warnings: Vec<WarningDocument>,
    /// A job that goes on.
    pub(super) continuation: Option<Continuation>,
}

/// Inputs of a job's work.
#[derive(Debug, Clone)]
struct Context {
    service: Arc<Service>,
    job: Arc<JobRecord>,
    running: Arc<Running>,
}

pub(super) async fn perform(service: Arc<Service>, job: JobRecord, running: Arc<Running>) -> Result<Done, Halt> {
    let context = Context { service, job: Arc::new(job), running };
    match context.job.kind {
        JobKind::Import => import::perform(&context).await,
        JobKind::Field => field::perform(&context).await,
        JobKind::Mesh => mesh::perform(&context).await,
        JobKind::Solve => Box::pin(solve::perform(&context)).await,
        JobKind::Compare => comparison::perform(&context).await,
    }
}

impl Context {
    fn request<T: DeserializeOwned>(&self) -> Result<T, Fault> {
        from_json("the request of the job", &self.job.request).map_err(|_| {
            let detail = "an earlier version of the service accepted this job, and this one cannot read its request; send it again";
            Fault::new(FaultKind::Stale, detail).with("stale", "job")
        })
    }

    async fn parts(&self) -> Result<SessionParts, Halt> {
        match SessionParts::load(&self.service.store, self.job.session).await {
            Err(fault) if fault.kind == FaultKind::Gone => Err(Halt::Cancelled),
            other => Ok(other?),
        }
    }

    /// Runs numerics on the pool under the job's control.
    async fn compute<T: Send + 'static>(
        &self,
        work: impl FnOnce(&dyn Engine, &Control) -> Result<T, Halt> + Send + 'static,
    ) -> Result<T, Halt> {
        let (engine, control) = (Arc::clone(&self.service.engine), self.running.control.stage(0.0, COMPUTING));
        let work = move || work(engine.as_ref(), &control);
        let done = match self.running.worker.lane {
            Lane::Heavy => self.service.cpu.run_job(self.running.worker.number, work).await,
            Lane::Quick => self.service.cpu.run_request(work).await,
        };
        done.map_err(|_| panicked())?
    }

    /// Waits for the store, unless the job should stop.
    ///
    /// Requests to an unreachable bucket are retried for a minute; a stopped job does not wait for them.
    async fn unless_stopped<T, E>(&self, work: impl Future<Output = Result<T, E>>) -> Result<T, Halt>
    where
        Halt: From<E>,
    {
        let mut work = pin!(work);
        loop {
            match tokio::time::timeout(STOP_SEEN, &mut work).await {
                Ok(done) => return Ok(done?),
                Err(_) if self.running.control.is_cancelled() => return Err(Halt::Cancelled),
                Err(_) => {}
            }
        }
    }

    /// Stores a blob for the job's session.
    async fn put(&self, bytes: Vec<u8>) -> Result<BlobInfo, Halt> {
        self.unless_stopped(self.service.store.blobs().put(self.job.session, bytes)).await
    }

    /// The patient case for the numerics; a damaged part that comes from the session's CT is made again.
    async fn case(&self, parts: &SessionParts) -> Result<Case, Halt> {
        let damaged = match self.unless_stopped(case_of(&self.service, parts)).await {
            Err(Halt::Fault(fault)) if fault.kind == FaultKind::DamagedValue => fault,
            read => return read,
        };
        match import::again(self, parts, &damaged).await? {
            Some(parts) => self.unless_stopped(case_of(&self.service, &parts)).await,
            None => Err(Halt::Fault(damaged)),
        }
    }

    /// All steps of the job.
    async fn all_steps(&self) -> Result<Vec<StepRecord>, Halt> {
        let steps = self.service.store.steps(self.job.id).await?;
        if !steps.iter().map(|step| step.k).eq(1..=self.job.steps) {
            tracing::error!(found = steps.len(), of = self.job.steps, "steps are missing");
            return Err(
                Fault::new(FaultKind::Internal, "steps of the job are missing; see the log of the service").into()
            );
        }
        Ok(steps)
    }

    /// Points faults of the cuts to the osteotomy, which the request names at `pointer`.
    fn cuts_of(&self, osteotomy: Option<OsteotomyId>, pointer: &str, halt: Halt) -> Halt {
        match (halt, osteotomy) {
            (Halt::Fault(fault), Some(id))
                if matches!(fault.kind, FaultKind::CutMissesBone | FaultKind::BoneNotParted) =>
            {
                let path = format!("/v1/sessions/{}/osteotomies/{id}", self.job.session);
                fault.with_cuts_at(pointer).with("osteotomy", path).into()
            }
            (other, _) => other,
        }
    }

    /// Reads a stored result into memory, unless the job should stop.
    async fn recall(&self, parts: &SessionParts, kept: Kept, key: &str) -> Result<(), Halt> {
        let read = async {
            recall(&self.service, parts, kept, key).await;
            Ok::<_, Fault>(())
        };
        self.unless_stopped(read).await
    }

    /// Stores the report of a derived part, and the part itself, so that it need not be built again.
    ///
    /// The part does not count in quotas. Where room is low it is left out.
    async fn put_derived(&self, report: PartRecord, kept: Option<Vec<u8>>) -> Result<(), Halt> {
        let free = self.service.store.free_room().unwrap_or_default();
        let blob = match kept.filter(|bytes| free.is_none_or(|free| !free.is_low_after(bytes.len() as u64))) {
            Some(bytes) => match self.put(bytes).await {
                Ok(blob) => Some(blob.key),
                Err(Halt::Cancelled) => return Err(Halt::Cancelled),
                Err(Halt::Fault(fault)) => {
                    tracing::warn!(
                        part = report.kind.as_str(),
                        detail = fault.detail,
                        "not stored; after a restart it is built again"
                    );
                    None
                }
            },
            None => None,
        };
        let part = PartRecord { blob, ..report };
        Ok(self.service.persist(|| self.service.store.put_parts(self.job.session, std::slice::from_ref(&part))).await?)
    }
}

/// The fault of a job whose inputs changed after it was accepted.
fn changed_meanwhile() -> Fault {
    Fault::new(FaultKind::Stale, "inputs or settings were changed after the job was accepted; send the request again")
}
