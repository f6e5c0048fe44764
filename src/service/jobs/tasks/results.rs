use super::compare::Compared;
use crate::{Service, SkinFrame};
use prosopon_contract::{Fault, FaultKind, from_json};
use prosopon_geometry::TriMesh;
use prosopon_store::{JobKind, JobRecord, JobState, StepRecord, decode_mesh};

/// The skin at rest of a solve.
///
/// # Errors
/// [`FaultKind::NotFound`] for another kind of job, [`FaultKind::NotReady`] before it has stored its skin, or the store's.
pub async fn rest_of(service: &Service, job: &JobRecord) -> Result<TriMesh, Fault> {
    if job.kind != JobKind::Solve {
        return Err(Fault::new(
            FaultKind::NotFound,
            format!("a job of kind {} has no skin; name a solve", job.kind.as_str()),
        ));
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

/// Stored form of the values of a comparison, little-endian f32, mm.
///
/// First the signed error of every vertex, then, if the triangles are the same, the distance of each vertex to its counterpart.
#[derive(Debug, Clone, Copy)]
pub struct StoredComparison;

impl StoredComparison {
    /// Encodes the values.
    #[must_use]
    pub fn encode(compared: &Compared) -> Vec<u8> {
        let values = compared.error_mm.iter().chain(compared.correspondence_mm.iter().flatten());
        values.flat_map(|v| v.to_le_bytes()).collect()
    }

    fn decode(bytes: &[u8], n_vertices: usize) -> Result<(Vec<f32>, Option<Vec<f32>>), Fault> {
        let values: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        if !bytes.len().is_multiple_of(4) || (values.len() != n_vertices && values.len() != 2 * n_vertices) {
            return Err(Fault::new(FaultKind::Internal, "the stored values do not match their surface"));
        }
        let (error, correspondence) = values.split_at(n_vertices);
        Ok((error.to_vec(), (!correspondence.is_empty()).then(|| correspondence.to_vec())))
    }
}

/// The result of a comparison.
///
/// # Errors
/// [`FaultKind::NotFound`] for another kind of job, [`FaultKind::NotReady`] before its end, [`FaultKind::Gone`] after its
/// retention, or the store's.
pub async fn read_comparison(service: &Service, job: &JobRecord) -> Result<Compared, Fault> {
    if job.kind != JobKind::Compare {
        return Err(Fault::new(
            FaultKind::NotFound,
            format!("a job of kind {} is not a comparison", job.kind.as_str()),
        ));
    }
    if job.state == JobState::Succeeded && job.rest_blob.is_none() {
        let days = service.settings.comparison_retention.as_secs() / 86_400;
        let detail = format!("the result was removed: results of comparisons are kept for {days} days; compare again");
        return Err(Fault::new(FaultKind::Gone, detail));
    }
    let (Some(report), Some(rest), Some(values)) = (&job.report, &job.rest_blob, &job.tissue_blob) else {
        let detail = format!("the comparison is {}", job.state);
        return Err(Fault::new(FaultKind::NotReady, detail).with("job_status", job.state.as_str()));
    };
    let document = from_json("the comparison", report)?;
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
