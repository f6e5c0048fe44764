use axum::body::{Body, Bytes};
use axum::extract::{FromRequest, Request};
use axum::http::HeaderMap;
use prosopon_contract::{Fault, FaultKind, Findings, LandmarksDocument, landmarks_of_file};

use super::json::{as_json, parse, read_bytes};
use crate::http::form::is_multipart;
use crate::http::upload_body::UploadBody;
use crate::http::{AppState, Problem};

/// Landmarks in the service's own form or as a file of 3D Slicer, in a plain body or a form.
#[derive(Debug)]
pub(in crate::http) struct LandmarksBody {
    pub(in crate::http) landmarks: LandmarksDocument,
    /// What was converted and renamed.
    pub(in crate::http) findings: Findings,
}

impl FromRequest<AppState> for LandmarksBody {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &AppState) -> Result<Self, Problem> {
        let headers = request.headers().clone();
        let is_form = is_multipart(&headers);
        let bytes = if is_form {
            read_form(&headers, request.into_body(), state).await?
        } else {
            read_bytes(request, state).await?
        };
        if let Some(read) = landmarks_of_file(&bytes) {
            let mut landmarks = read?;
            let findings = landmarks.take_findings();
            return Ok(Self { landmarks, findings });
        }
        let bytes = if is_form {
            bytes
        } else {
            as_json(&headers, bytes).map_err(|Problem(fault)| {
                let files = "; landmark files of 3D Slicer (.mrk.json, .fcsv) are read too, and these bytes are none";
                Problem(Fault { detail: format!("{}{files}", fault.detail), ..fault })
            })?
        };
        Ok(Self { landmarks: parse(&bytes)?, findings: Findings::default() })
    }
}

/// The one file of a form, as long as a JSON body may be.
async fn read_form(headers: &HeaderMap, body: Body, state: &AppState) -> Result<Bytes, Problem> {
    let max_bytes = state.limits.max_json_bytes;
    let whole = async {
        let mut file = UploadBody::new(headers, body)?;
        let mut bytes = Vec::new();
        while let Some(piece) = file.next().await {
            bytes.extend_from_slice(&piece?);
            if bytes.len() > max_bytes {
                let detail = format!("the file is longer than the allowed {max_bytes} bytes");
                return Err(Problem(Fault::new(FaultKind::TooLarge, detail).with("allowed_bytes", max_bytes)));
            }
        }
        Ok(Bytes::from(bytes))
    };
    let late = |_| {
        let detail = format!("the body did not arrive within {} s; send it again", state.limits.body.as_secs());
        Problem::new(FaultKind::Timeout, detail)
    };
    tokio::time::timeout(state.limits.body, whole).await.map_err(late)?
}
