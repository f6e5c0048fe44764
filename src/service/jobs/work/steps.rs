//! Finished steps and checkpoints: written as they arrive, read when a job continues.

use tokio::sync::mpsc;

use super::Context;
use super::report::step_documents;
use super::solve_watch::FinishedStep;
use crate::events::warning_event;
use crate::running::step_warning;
use prosopon_contract::{Halt, from_json, to_json};
use prosopon_session::StoredCheckpoint;
use prosopon_store::{StepRecord, StoreError};

/// The checkpoint of an earlier attempt.
///
/// An unusable checkpoint is deleted with the steps before it, because these may come from other inputs than later steps.
pub(super) async fn checkpoint(context: &Context, compared: &str) -> Result<Option<StoredCheckpoint>, Halt> {
    let Some(key) = &context.job.checkpoint_blob else { return Ok(None) };
    let before = usable(context, key, compared).await?;
    if before.is_none() {
        let store = &context.service.store;
        context.service.persist(|| store.begin_again(&context.job)).await?;
    }
    Ok(before)
}

async fn usable(context: &Context, key: &str, compared: &str) -> Result<Option<StoredCheckpoint>, Halt> {
    let store = &context.service.store;
    let read = async {
        match store.blobs().get(key).await {
            Err(StoreError::BlobGone { .. } | StoreError::BucketDenied(_) | StoreError::Damaged { .. }) => Ok(None),
            read => read.map(Some),
        }
    };
    let bytes = context.unless_stopped(read).await?;
    let Some(before) = bytes.and_then(|bytes| StoredCheckpoint::decode(&bytes)) else {
        tracing::warn!(
            key,
            "the job's checkpoint is missing, damaged or of another version; all steps are solved again"
        );
        return Ok(None);
    };
    if before.compared != compared {
        tracing::info!("the target or the landmarks were replaced; all steps are solved again");
        return Ok(None);
    }
    let steps = step_documents(&store.steps(context.job.id).await?)?;
    let k = before.checkpoint.k as u32;
    if !(1..context.job.steps).contains(&k) || !steps.iter().map(|step| step.k).take_while(|n| *n <= k).eq(1..=k) {
        tracing::warn!(
            step = k,
            found = steps.len(),
            "steps before the checkpoint are missing; all steps are solved again"
        );
        return Ok(None);
    }
    // Later steps are solved again and report their warnings then.
    for step in steps.iter().take_while(|step| step.k <= k) {
        step.findings.iter().for_each(|warning| context.running.warn_of_step(step.k, warning));
    }
    metrics::counter!("prosopon_jobs_resumed_total").increment(1);
    tracing::info!(step = before.checkpoint.k, steps = context.job.steps, "the job continues from its checkpoint");
    Ok(Some(before))
}

/// Stores steps as they arrive: the frame first, then the row that makes it visible.
pub(super) async fn write_steps(context: &Context, mut steps: mpsc::Receiver<FinishedStep>) -> Result<(), Halt> {
    let mut first_failure = Ok(());
    while let Some(step) = steps.recv().await {
        if first_failure.is_err() {
            continue;
        }
        first_failure = write_step(context, step).await;
        if first_failure.is_err() {
            context.running.control.cancel();
        }
    }
    first_failure
}

async fn write_step(context: &Context, step: FinishedStep) -> Result<(), Halt> {
    let FinishedStep { document, error, frame, checkpoint } = step;
    let store = &context.service.store;
    let frame = context.put(frame).await?;
    let text = to_json("the document of the step", &document)?;
    let mut event: serde_json::Value = from_json("the document of the step", &text)?;
    if let Some(members) = event.as_object_mut() {
        members.insert("steps".to_owned(), context.job.steps.into());
        members.insert("has_error".to_owned(), error.is_some().into());
    }
    let record = StepRecord {
        k: document.k,
        t: document.t,
        document: text,
        error: error.as_ref().map(|e| to_json("the error map", e)).transpose()?,
        blob: frame.key.clone(),
        sha256: frame.sha256.clone(),
        bytes: frame.bytes,
    };
    let mut events: Vec<_> =
        document.findings.iter().filter_map(|w| warning_event(&step_warning(document.k, w))).collect();
    events.push(("step", event.to_string()));
    context.service.persist(|| store.commit_step(&context.job, &record, &events)).await?;
    tracing::info!(step = document.k, steps = context.job.steps, duration_s = document.wall_s, "step stored");
    for warning in document.findings.iter() {
        context.running.warn_of_step(document.k, warning);
    }
    context.service.announce();
    // The job does not need the checkpoint, and a failure of the store shows at the next step.
    if let Some(checkpoint) = checkpoint
        && let Err(halt) = keep_checkpoint(context, checkpoint).await
    {
        tracing::warn!(?halt, "a checkpoint could not be stored");
    }
    Ok(())
}

async fn keep_checkpoint(context: &Context, checkpoint: Vec<u8>) -> Result<(), Halt> {
    let checkpoint = context.put(checkpoint).await?;
    let store = &context.service.store;
    Ok(context.service.persist(|| store.set_checkpoint(&context.job, &checkpoint)).await?)
}
