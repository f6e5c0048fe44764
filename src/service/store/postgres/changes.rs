use std::time::Duration;

use sqlx::PgPool;
use sqlx::postgres::PgListener;

use super::Result;
use crate::Changes;

/// Channel on which the schema's triggers notify of changed jobs and events.
const CHANNEL: &str = "prosopon";
/// Payload of the notification of a job that can begin.
const QUEUE: &str = "queue";

/// Notifications of the server; the listener reconnects by itself.
struct Notifications(PgListener);

pub(super) async fn changes(pool: &PgPool) -> Result<Changes> {
    let mut listener = PgListener::connect_with(pool).await?;
    listener.listen(CHANNEL).await?;
    Ok(Changes::of(Notifications(listener)))
}

#[async_trait::async_trait]
impl crate::changes::Source for Notifications {
    async fn next(&mut self, patience: Duration) -> bool {
        // A lost notification delays a job by `patience` at most.
        let mut queue = match tokio::time::timeout(patience, self.0.recv()).await {
            Ok(Ok(word)) => word.payload() == QUEUE,
            Ok(Err(_)) => {
                tokio::time::sleep(patience).await;
                true
            }
            Err(_) => true,
        };
        // Merges all notifications that have arrived into one.
        while let Ok(Ok(word)) = tokio::time::timeout(Duration::ZERO, self.0.recv()).await {
            queue |= word.payload() == QUEUE;
        }
        queue
    }
}
