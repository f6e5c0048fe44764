use std::time::Duration;

use sqlx::PgPool;
use sqlx::postgres::PgListener;

use super::Result;
use crate::store::Changes;

/// Channel on which the triggers of the schema tell that jobs or events have changed.
const CHANNEL: &str = "prosopon";

/// What the server tells; it connects again by itself.
struct Told(PgListener);

pub(super) async fn changes(pool: &PgPool) -> Result<Changes> {
    let mut listener = PgListener::connect_with(pool).await?;
    listener.listen(CHANNEL).await?;
    Ok(Changes::of(Told(listener)))
}

#[async_trait::async_trait]
impl crate::store::changes::Source for Told {
    async fn next(&mut self, patience: Duration) {
        // A word that was lost costs no more than the patience.
        let heard = tokio::time::timeout(patience, self.0.recv()).await;
        if matches!(heard, Ok(Err(_))) {
            tokio::time::sleep(patience).await;
        }
    }
}
