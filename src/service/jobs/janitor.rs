use std::sync::Arc;
use std::time::Duration;

use super::Service;
use prosopon_contract::Fault;
use prosopon_store::{AuditEntry, Look, SessionRecord, StoreError};

/// Retention of stored answers to repeated requests.
///
/// Tombstones of deleted ids are kept ten times as long.
const ANSWERS: Duration = Duration::from_secs(7 * 24 * 3600);

/// What the audit log has of a deletion: route and status.
const DELETED: (&str, u16) = ("DELETE /v1/sessions/{session}", 204);

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
        let look = self.store.look().await?;
        self.maintain(&look).await
    }

    /// Runs one maintenance round at a given time; see [`Service::run_maintenance`].
    ///
    /// Nothing is removed in a round before which the clock was set.
    ///
    /// # Errors
    /// The store's.
    pub async fn maintain(&self, look: &Look) -> Result<(), Fault> {
        if look.jumped_ms != 0 {
            metrics::counter!("prosopon_clock_set_total").increment(1);
            let by_s = look.jumped_ms / 1000;
            tracing::warn!(by_s, "the clock was set: this maintenance round removes nothing; check the clock");
            return Ok(());
        }
        let swept = self.store.sweep_old().await?;
        let events = self.store.prune_events(look, self.settings.event_retention).await?;
        let compared = self.store.drop_comparisons(look, self.settings.comparison_retention).await?;
        self.store.delete_old_answers(look, ANSWERS).await?;
        if let Some(retention) = self.settings.session_retention {
            self.return_unduly_expired(look, retention).await?;
        }
        let erased = self.erase_hidden(look).await?;
        let expired = match self.settings.session_retention {
            Some(retention) => self.expire_unused(look, retention).await?,
            None => 0,
        };
        metrics::gauge!("prosopon_sessions_restorable").set(self.store.count_hidden().await? as f64);
        if swept > 0 || events > 0 || compared > 0 || erased > 0 || expired > 0 {
            tracing::info!(files = swept + compared, events, erased, expired, "maintenance round done");
        }
        Ok(())
    }

    /// Deletes for good the sessions whose time to be restored is over; returns their number.
    async fn erase_hidden(&self, look: &Look) -> Result<usize, Fault> {
        let (restorable, retention) = (self.settings.deleted_retention, self.settings.session_retention);
        let over = self.store.hidden_sessions(look, restorable, retention).await?;
        for session in &over {
            self.delete_session(session.id).await?;
            self.note_change(session, "deleted before", DELETED);
            metrics::counter!("prosopon_sessions_erased_total").increment(1);
        }
        Ok(over.len())
    }

    /// Deletes the sessions that are unused for `retention`, as a user does: they can still be restored; returns their number.
    ///
    /// Reports those that will follow.
    async fn expire_unused(&self, look: &Look, retention: Duration) -> Result<usize, Fault> {
        let unused = self.store.idle_sessions(look, retention).await?;
        for session in &unused {
            self.expire_session(session.id).await?;
            self.note_change(session, "retention", DELETED);
            metrics::counter!("prosopon_sessions_expired_total").increment(1);
            let restorable_s = self.settings.deleted_retention.as_secs();
            tracing::info!(session = %session.id, restorable_s, "a session was unused for its retention and is deleted");
        }
        let next = self.store.seemingly_idle_sessions(look, retention).await?;
        metrics::gauge!("prosopon_sessions_overdue").set(next.len() as f64);
        if look.begins_day && !next.is_empty() {
            let sessions: Vec<String> = next.iter().map(|session| session.id.to_string()).collect();
            let n = sessions.len();
            tracing::warn!(
                n,
                ?sessions,
                "unused sessions will be deleted in one to two days; check the clock if it is too early"
            );
        }
        Ok(unused.len())
    }

    /// Restores sessions that a clock that was ahead, or a shorter retention, deleted, once that is put right.
    async fn return_unduly_expired(&self, look: &Look, retention: Duration) -> Result<(), Fault> {
        for session in self.store.wrongly_expired(look, retention).await? {
            if self.store.restore_session(session.id).await? {
                self.note_change(&session, "retention", ("POST /v1/sessions/{session}/restore", 200));
                tracing::warn!(session = %session.id, "a session was deleted before its retention ended, and is restored");
            }
        }
        Ok(())
    }

    fn note_change(&self, session: &SessionRecord, who: &str, (what, status): (&str, u16)) {
        let entry = AuditEntry {
            tenant: session.tenant.to_string(),
            who: who.to_owned(),
            what: what.to_owned(),
            id: Some(session.id.to_string()),
            status,
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
