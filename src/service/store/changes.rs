use std::fmt;
use std::time::Duration;

use async_trait::async_trait;

/// Tells that another process may have changed jobs or events.
pub struct Changes(Box<dyn Source>);

/// What waits for word of others.
#[async_trait]
pub(super) trait Source: Send {
    /// Waits for word, at most `patience`: whether a job may be begun.
    async fn next(&mut self, patience: Duration) -> bool;
}

impl Changes {
    pub(super) fn of(source: impl Source + 'static) -> Self {
        Self(Box::new(source))
    }

    /// Waits for word, at most `patience`: whether there may be a job to begin. Without word there may be changes too.
    pub async fn next(&mut self, patience: Duration) -> bool {
        self.0.next(patience).await
    }
}

impl fmt::Debug for Changes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Changes").finish_non_exhaustive()
    }
}
