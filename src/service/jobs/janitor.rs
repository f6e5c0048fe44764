use std::sync::Arc;
use std::time::Duration;

use super::Service;
use prosopon_session::Fault;
use prosopon_store::{AuditEntry, SessionRecord, StoreError};

/// Answers to repeated requests are kept for so long, and ten times as long the ids of what was deleted.
const ANSWERS: Duration = Duration::from_secs(7 * 24 * 3600);

/// Bytes of stored values that a round of the janitor reads through: at a round each ten minutes 37 GB a day.
const SCRUBBED: u64 = 256 << 20;

/// Keeps house now and then until the service stops.
pub(super) async fn keep_house(service: Arc<Service>) {
    let mut scrubbed = String::new();
    loop {
        let kept = async {
            if service.store.takes_turn(service.settings.janitor_every).await? {
                service.keep_house().await?;
                service.scrub(&mut scrubbed).await?;
            }
            Ok::<_, Fault>(())
        };
        if let Err(fault) = kept.await {
            tracing::error!(detail = fault.detail, "the janitor failed");
        }
        tokio::select! {
            () = tokio::time::sleep(service.settings.janitor_every) => {}
            () = service.stop.cancelled() => return,
        }
    }
}

/// Time between two notes of where the audit log ends.
const ANCHOR_EVERY: Duration = Duration::from_secs(5);

/// Notes now and then where the audit log ends, until the service stops.
pub(super) async fn anchor_audit(service: Arc<Service>) {
    let mut noted = None;
    loop {
        let stops = tokio::select! {
            () = tokio::time::sleep(ANCHOR_EVERY) => false,
            () = service.stop.cancelled() => true,
        };
        if let Err(fault) = service.anchor_audit(&mut noted).await {
            tracing::error!(detail = fault.detail, "the end of the audit log cannot be noted");
        }
        if stops {
            return;
        }
    }
}

impl Service {
    /// Says in the audit log where its end is not what was noted: the next note would hide it.
    pub(super) async fn check_audit_end(&self) -> Result<(), Fault> {
        let Some((chain, at)) = self.store.audit_anchor().await? else { return Ok(()) };
        if self.audit.holds(&chain).map_err(StoreError::from)? {
            return Ok(());
        }
        tracing::error!(noted_at = at, "the audit log lacks entries that were there");
        let entry = AuditEntry {
            tenant: "local".to_owned(),
            who: "service".to_owned(),
            what: AuditEntry::GAP.to_owned(),
            ..AuditEntry::default()
        };
        self.note(entry, true);
        Ok(())
    }

    /// Notes where the audit log ends, unless that is what is `noted`.
    async fn anchor_audit(&self, noted: &mut Option<String>) -> Result<(), Fault> {
        let end = self.audit.settle().map_err(StoreError::from)?;
        if let Some(chain) = end.as_ref().filter(|end| noted.as_ref() != Some(end)) {
            self.store.set_audit_anchor(chain).await?;
            noted.clone_from(&end);
        }
        Ok(())
    }

    /// Removes what is left over or has expired: files that no row names, old answers and events, sessions that nobody used
    /// for the time of retention.
    ///
    /// # Errors
    /// The store's.
    pub async fn keep_house(&self) -> Result<(), Fault> {
        let swept = self.store.sweep_old().await?;
        let events = self.store.prune_events(self.settings.event_retention).await?;
        let compared = self.store.drop_comparisons(self.settings.comparison_retention).await?;
        self.store.forget_old_answers(ANSWERS).await?;
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
            tracing::info!(files = swept + compared, events, sessions = expired, "kept house");
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

    /// Reads the stored values whose keys come after `last`, up to 256 MiB, and sets `last` to the last of them (or to nothing at the end of
    /// all). Damaged and missing ones go into the log, the audit log and the metrics.
    ///
    /// # Errors
    /// The store's.
    pub async fn scrub(&self, last: &mut String) -> Result<(), Fault> {
        let (found, next) = self.store.scrub(last, SCRUBBED).await?;
        *last = next.unwrap_or_default();
        metrics::counter!("prosopon_values_checked_total").increment(found.values as u64);
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

    /// Appends to the audit log; a log that cannot be written is told in the log of the service.
    pub fn note(&self, entry: AuditEntry, sync: bool) {
        if let Err(error) = self.audit.record(entry, sync) {
            metrics::counter!("prosopon_audit_failures_total").increment(1);
            tracing::error!(%error, "the audit log cannot be written");
        }
    }
}
