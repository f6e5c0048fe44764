use std::time::Duration;

use sqlx::PgPool;
use sqlx::postgres::PgListener;

use super::Result;
use crate::Changes;

/// Channel on which the triggers of the schema tell that jobs or events have changed.
const CHANNEL: &str = "prosopon";
/// What they say of a job that can be begun.
const QUEUE: &str = "queue";

/// What the server tells; it connects again by itself.
struct Told(PgListener);

pub(super) async fn changes(pool: &PgPool) -> Result<Changes> {
    let mut listener = PgListener::connect_with(pool).await?;
    listener.listen(CHANNEL).await?;
    Ok(Changes::of(Told(listener)))
}

#[async_trait::async_trait]
impl crate::changes::Source for Told {
    async fn next(&mut self, patience: Duration) -> bool {
        // A word that was lost costs no more than the patience.
        let mut queue = match tokio::time::timeout(patience, self.0.recv()).await {
            Ok(Ok(word)) => word.payload() == QUEUE,
            Ok(Err(_)) => {
                tokio::time::sleep(patience).await;
                true
            }
            Err(_) => true,
        };
        // What was said meanwhile is the same word.
        while let Ok(Ok(word)) = tokio::time::timeout(Duration::ZERO, self.0.recv()).await {
            queue |= word.payload() == QUEUE;
        }
        queue
    }
}
