use std::sync::Arc;
use std::time::Duration;

use super::Service;
use prosopon_contract::Fault;
use prosopon_store::{AuditEntry, SessionRecord, StoreError};

/// Retention of stored answers to repeated requests.
///
/// Tombstones of deleted ids are kept ten times as long.
const ANSWERS: Duration = Duration::from_secs(7 * 24 * 3600);

/// Bytes of blobs that one maintenance round checks: with a round every ten minutes 37 GB a day.
const SCRUBBED: u64 = 256 << 20;

/// Runs the maintenance rounds until the service stops.
pub(super) async fn run_maintenance(service: Arc<Service>) {
    let mut scrubbed = Scrubbed::default();
    loop {
        let kept = async {
            if service.store.claims_maintenance(service.settings.janitor_every).await? {
                service.run_maintenance().await?;
                service.scrub(&mut scrubbed).await?;
            }
            Ok::<_, Fault>(())
        };
        if let Err(fault) = kept.await {
            tracing::error!(detail = fault.detail, "the maintenance round failed");
        }
        tokio::select! {
            () = tokio::time::sleep(service.settings.janitor_every) => {}
            () = service.stop.cancelled() => return,
        }
    }
}

/// How far all blobs are checked.
#[derive(Debug, Default)]
pub struct Scrubbed {
    /// Key of the last one.
    last: String,
    /// Number of those so far that are not encrypted with the first key.
    left: usize,
}

/// Time between two updates of the stored end of the audit log.
const ANCHOR_EVERY: Duration = Duration::from_secs(5);

/// Stores the end of the audit log at intervals, until the service stops.
pub(super) async fn anchor_audit(service: Arc<Service>) {
    let mut noted = None;
    loop {
        let stops = tokio::select! {
            () = tokio::time::sleep(ANCHOR_EVERY) => false,
            () = service.stop.cancelled() => true,
        };
        if let Err(fault) = service.anchor_audit(&mut noted).await {
            tracing::error!(detail = fault.detail, "the end of the audit log cannot be stored");
        }
        if stops {
            return;
        }
    }
}

impl Service {
    /// Checks at the start that the audit log has its stored end.
    ///
    /// If not, adds a gap entry, because the next update of the stored end hides the gap.
    pub(super) async fn check_audit_end(&self) -> Result<(), Fault> {
        let Some((chain, at)) = self.store.audit_anchor().await? else { return Ok(()) };
        if self.audit.holds(&chain).map_err(StoreError::from)? {
            return Ok(());
        }
        tracing::error!(noted_at = at, "entries of the audit log were removed");
        let entry = AuditEntry {
            tenant: "local".to_owned(),
            who: "service".to_owned(),
            what: AuditEntry::GAP.to_owned(),
            ..AuditEntry::default()
        };
        self.note(entry, true);
        Ok(())
    }

    /// Stores the end of the audit log unless it equals `noted`.
    async fn anchor_audit(&self, noted: &mut Option<String>) -> Result<(), Fault> {
        let end = self.audit.settle().map_err(StoreError::from)?;
        if let Some(chain) = end.as_ref().filter(|end| noted.as_ref() != Some(end)) {
            self.store.set_audit_anchor(chain).await?;
            noted.clone_from(&end);
        }
        Ok(())
    }

    /// Runs one maintenance round, which removes leftovers and what has expired.
    ///
    /// These are blobs that no row names, old answers and events, results of old comparisons, deleted sessions after the time to
    /// restore them, and unused sessions after their retention.
    ///
    /// # Errors
    /// The store's.
    pub async fn run_maintenance(&self) -> Result<(), Fault> {
        let swept = self.store.sweep_old().await?;
        let events = self.store.prune_events(self.settings.event_retention).await?;
        let compared = self.store.drop_comparisons(self.settings.comparison_retention).await?;
        self.store.delete_old_answers(ANSWERS).await?;
        let mut expired = 0;
        for session in self.store.hidden_sessions(self.settings.deleted_retention).await? {
            self.delete_session(session.id).await?;
            self.note_removal(&session, "deleted before");
            expired += 1;
        }
        if let Some(retention) = self.settings.session_retention {
            for session in self.store.idle_sessions(retention).await? {
                self.delete_session(session.id).await?;
                self.note_removal(&session, "retention");
                expired += 1;
            }
        }
        if swept > 0 || events > 0 || compared > 0 || expired > 0 {
            tracing::info!(files = swept + compared, events, sessions = expired, "maintenance round done");
        }
        Ok(())
    }

    fn note_removal(&self, session: &SessionRecord, who: &str) {
        let entry = AuditEntry {
            tenant: session.tenant.to_string(),
            who: who.to_owned(),
            what: "DELETE /v1/sessions/{session}".to_owned(),
            id: Some(session.id.to_string()),
            status: 204,
            ..AuditEntry::default()
        };
        self.note(entry, true);
    }

    /// Reads and checks up to 256 MiB of the next blobs, from the first one again after the last.
    ///
    /// Those that are not encrypted with the first key are stored again. Reports damaged and missing blobs in the log, the audit
    /// log and the metrics.
    ///
    /// # Errors
    /// The store's.
    pub async fn scrub(&self, so_far: &mut Scrubbed) -> Result<(), Fault> {
        let (found, next) = self.store.scrub(&so_far.last, SCRUBBED).await?;
        so_far.left += found.left;
        match next {
            Some(last) => so_far.last = last,
            None => {
                if so_far.left == 0 {
                    self.store.forget_other_keys().await?;
                }
                *so_far = Scrubbed::default();
            }
        }
        metrics::gauge!("prosopon_values_with_other_keys").set(so_far.left as f64);
        metrics::counter!("prosopon_values_checked_total").increment(found.values as u64);
        if found.renewed > 0 {
            tracing::info!(values = found.renewed, "values were encrypted with the first key");
        }
        metrics::counter!("prosopon_values_damaged_total")
            .increment((found.damaged.len() + found.missing.len()) as u64);
        for (keys, what) in [(found.damaged, AuditEntry::DAMAGED), (found.missing, AuditEntry::MISSING)] {
            for key in keys {
                tracing::error!(key, "{what}");
                let entry = AuditEntry {
                    tenant: "local".to_owned(),
                    who: "service".to_owned(),
                    what: what.to_owned(),
                    id: Some(key),
                    ..AuditEntry::default()
                };
                self.note(entry, true);
            }
        }
        Ok(())
    }

    /// Appends an entry to the audit log; a failure is reported in the service's log and metrics.
    pub fn note(&self, entry: AuditEntry, sync: bool) {
        if let Err(error) = self.audit.record(entry, sync) {
            metrics::counter!("prosopon_audit_failures_total").increment(1);
            tracing::error!(%error, "the audit log cannot be written");
        }
    }
}
