use std::sync::Arc;

use tokio::sync::watch;

use super::Service;
use super::service::end_event;
use prosopon_session::{Fault, FaultKind};
use prosopon_store::{EventRecord, JobId, JobState};

/// Events of one job as they are stored, from a given number on. Where events after that number are not kept any more, the first
/// one is `resync`: the client reads the job's status and goes on from here.
#[derive(Debug)]
pub struct EventFeed {
    service: Arc<Service>,
    changes: watch::Receiver<u64>,
    job: JobId,
    last: u64,
    /// Told before anything else.
    resync: Option<EventRecord>,
    ended: bool,
}

impl EventFeed {
    /// Events after number `last`.
    ///
    /// # Errors
    /// As [`Service::job`].
    pub async fn open(service: Arc<Service>, job: JobId, last: u64) -> Result<Self, Fault> {
        let changes = service.watch_changes();
        let record = service.job(job).await?;
        let events = service.store().events(job, 0).await?;
        let newest = events.last().map_or(0, |e| e.seq);
        let resync = |seq| {
            let data = serde_json::json!({ "status": record.state.as_str(), "attempt": record.attempt });
            EventRecord { seq, kind: "resync".to_owned(), data: data.to_string() }
        };
        let begins_at = record.events_from.saturating_sub(1);
        let (last, resync) = if last > newest {
            // A number of another life of the job, as before a restored backup.
            (begins_at, Some(resync(begins_at)))
        } else if last < begins_at {
            (begins_at, Some(resync(begins_at)))
        } else {
            (last, None)
        };
        let ended = record.state.has_ended() && resync.is_none() && newest <= last;
        Ok(Self { service, changes, job, last, resync, ended })
    }

    /// Number after which it goes on.
    #[must_use]
    pub fn last(&self) -> u64 {
        self.last
    }

    /// Whether nothing will come: the job has ended and all was seen.
    #[must_use]
    pub fn is_spent(&self) -> bool {
        self.ended
    }

    /// The next events in order; none after `end`, or when the service stops. A job that is deleted with its session ends as
    /// cancelled, with a problem that says so.
    ///
    /// # Errors
    /// The store's.
    pub async fn next(&mut self) -> Result<Vec<EventRecord>, Fault> {
        if let Some(resync) = self.resync.take() {
            return Ok(vec![resync]);
        }
        let stopping = self.service.stopping().clone();
        while !self.ended {
            self.changes.borrow_and_update();
            // Before the events: a job that ends in between has its last ones among them or sends a change.
            let job = self.service.store().job(self.job).await?;
            let events = self.service.store().events(self.job, self.last).await?;
            if let Some(last) = events.last() {
                self.last = last.seq;
                self.ended = last.kind == "end";
                return Ok(events);
            }
            match job {
                // Its events went with its session: the last word is said here.
                None => {
                    self.ended = true;
                    self.last += 1;
                    return Ok(vec![EventRecord { seq: self.last, ..deleted(self.job) }]);
                }
                // It has said so, and the client has seen it.
                Some(job) if job.state.has_ended() => break,
                Some(_) => {}
            }
            tokio::select! {
                changed = self.changes.changed() => if changed.is_err() { break },
                () = stopping.cancelled() => break,
            }
        }
        self.ended = true;
        Ok(Vec::new())
    }
}

/// The end of a job that is not there any more.
fn deleted(job: JobId) -> EventRecord {
    let fault = Fault::new(FaultKind::Gone, format!("job {job} was deleted with its session"));
    let (kind, data) = end_event(JobState::Cancelled, Some(&fault));
    EventRecord { seq: 0, kind: kind.to_owned(), data }
}
