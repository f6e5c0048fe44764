use std::fmt;
use std::time::Duration;

use async_trait::async_trait;

/// Notifications that another process may have changed jobs or events.
pub struct Changes(Box<dyn Source>);

/// Source of the notifications.
#[async_trait]
pub(super) trait Source: Send {
    /// Waits at most `patience` for a notification; true when a job may be ready to begin.
    async fn next(&mut self, patience: Duration) -> bool;
}

impl Changes {
    pub(super) fn of(source: impl Source + 'static) -> Self {
        Self(Box::new(source))
    }

    /// Waits at most `patience` for a notification; returns whether a job may be ready to begin.
    ///
    /// A notification may be lost, so it also returns true when none came.
    pub async fn next(&mut self, patience: Duration) -> bool {
        self.0.next(patience).await
    }
}

impl fmt::Debug for Changes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Changes").finish_non_exhaustive()
    }
}
