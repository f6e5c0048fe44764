use super::Compared;
use crate::{Service, SkinFrame};
use prosopon_geometry::TriMesh;
use prosopon_session::{Fault, FaultKind};
use prosopon_store::{JobKind, JobRecord, JobState, StepRecord, decode_mesh};

/// The skin at rest that a job deforms.
///
/// # Errors
/// [`FaultKind::NotFound`] for a job without skin, [`FaultKind::NotReady`] before it has begun, or the store's.
pub async fn rest_of(service: &Service, job: &JobRecord) -> Result<TriMesh, Fault> {
    if job.kind != JobKind::Solve {
        return Err(Fault::new(FaultKind::NotFound, format!("a job of kind {} has no skin", job.kind.as_str())));
    }
    let Some(blob) = &job.rest_blob else {
        let detail = format!("the job is {} and has not read its inputs yet", job.state);
        return Err(Fault::new(FaultKind::NotReady, detail).with("job_status", job.state.as_str()));
    };
    Ok(decode_mesh(&service.store.blobs().get(blob).await?)?)
}

/// The frame of a step.
///
/// # Errors
/// The store's.
pub async fn read_frame(service: &Service, step: &StepRecord, rest: &TriMesh) -> Result<SkinFrame, Fault> {
    SkinFrame::decode(&service.store.blobs().get(&step.blob).await?, rest.positions().len())
}

/// Values of a comparison as stored: the signed error of every vertex, then where there is one the distance from its counterpart;
/// little-endian f32, mm.
#[derive(Debug, Clone, Copy)]
pub struct StoredComparison;

impl StoredComparison {
    /// The stored form.
    #[must_use]
    pub fn encode(compared: &Compared) -> Vec<u8> {
        let values = compared.error_mm.iter().chain(compared.correspondence_mm.iter().flatten());
        values.flat_map(|v| v.to_le_bytes()).collect()
    }

    fn decode(bytes: &[u8], n_vertices: usize) -> Result<(Vec<f32>, Option<Vec<f32>>), Fault> {
        let values: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        if !bytes.len().is_multiple_of(4) || (values.len() != n_vertices && values.len() != 2 * n_vertices) {
            return Err(Fault::new(FaultKind::Internal, "stored values do not fit their surface"));
        }
        let (error, correspondence) = values.split_at(n_vertices);
        Ok((error.to_vec(), (!correspondence.is_empty()).then(|| correspondence.to_vec())))
    }
}

/// What a comparison that has succeeded found.
///
/// # Errors
/// [`FaultKind::NotFound`] for another kind of job, [`FaultKind::NotReady`] before its end, [`FaultKind::Gone`] when it was kept long
/// enough, or the store's.
pub async fn read_comparison(service: &Service, job: &JobRecord) -> Result<Compared, Fault> {
    if job.kind != JobKind::Compare {
        return Err(Fault::new(FaultKind::NotFound, format!("a job of kind {} compares nothing", job.kind.as_str())));
    }
    if job.state == JobState::Succeeded && job.rest_blob.is_none() {
        let days = service.settings.comparison_retention.as_secs() / 86_400;
        let detail = format!("results of comparisons are kept for {days} days; compare again");
        return Err(Fault::new(FaultKind::Gone, detail));
    }
    let (Some(report), Some(rest), Some(values)) = (&job.report, &job.rest_blob, &job.tissue_blob) else {
        let detail = format!("the comparison is {}", job.state);
        return Err(Fault::new(FaultKind::NotReady, detail).with("job_status", job.state.as_str()));
    };
    let document = serde_json::from_str(report).map_err(|error| {
        tracing::error!(%error, "a stored comparison cannot be read");
        Fault::new(FaultKind::Internal, "a stored document cannot be read; the log says more")
    })?;
    let mesh = decode_mesh(&service.store.blobs().get(rest).await?)?;
    let values = service.store.blobs().get(values).await?;
    let (error_mm, correspondence_mm) = StoredComparison::decode(&values, mesh.positions().len())?;
    Ok(Compared { document, mesh, error_mm, correspondence_mm })
}

#[cfg(test)]
mod tests {
    use super::StoredComparison;

    #[test]
    fn values_must_fit_the_surface() {
        let bytes: Vec<u8> = [1.0f32, -2.0, 3.0, 4.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        let both = (vec![1.0, -2.0], Some(vec![3.0, 4.0]));
        assert_eq!(StoredComparison::decode(&bytes, 2).unwrap(), both);
        assert_eq!(StoredComparison::decode(&bytes, 4).unwrap(), (vec![1.0, -2.0, 3.0, 4.0], None));
        assert!(StoredComparison::decode(&bytes, 3).is_err() && StoredComparison::decode(&bytes[..15], 2).is_err());
    }
}
