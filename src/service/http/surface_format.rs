use axum::http::{HeaderMap, header};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::Problem;
use prosopon_contract::FaultKind;
use prosopon_formats::export::{SurfaceView, glb, ply, stl, vtp};

/// Format in which to send a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::http) enum SurfaceOutput {
    /// Binary glTF 2.0.
    Glb,
    /// Binary PLY.
    Ply,
    /// Binary STL, without scalars.
    Stl,
    /// VTK polygons, XML with raw appended data.
    Vtp,
}

impl SurfaceOutput {
    /// Chooses the format: from `?format=`, else from the Accept header, else GLB.
    pub(super) fn choose(asked: Option<Self>, headers: &HeaderMap) -> Result<Self, Problem> {
        if let Some(asked) = asked {
            return Ok(asked);
        }
        let accept = headers.get(header::ACCEPT).and_then(|a| a.to_str().ok()).unwrap_or("*/*");
        for range in accept.split(',') {
            match range.split(';').next().unwrap_or_default().trim() {
                "*/*" | "model/*" | "model/gltf-binary" => return Ok(Self::Glb),
                "application/ply" | "model/ply" | "application/x-ply" => return Ok(Self::Ply),
                "application/vnd.vtk.vtp" | "model/vtp" => return Ok(Self::Vtp),
                "model/stl" | "application/sla" | "model/x.stl-binary" => return Ok(Self::Stl),
                _ => {}
            }
        }
        let detail = "the Accept header allows none of model/gltf-binary, application/ply, model/stl and application/vnd.vtk.vtp";
        Err(Problem::new(FaultKind::NotAcceptable, detail))
    }

    pub(super) fn as_str(self) -> &'static str {
        match self {
            Self::Glb => "glb",
            Self::Ply => "ply",
            Self::Stl => "stl",
            Self::Vtp => "vtp",
        }
    }

    pub(super) fn media_type(self) -> &'static str {
        match self {
            Self::Glb => "model/gltf-binary",
            Self::Ply => "application/ply",
            Self::Stl => "model/stl",
            Self::Vtp => "application/vnd.vtk.vtp",
        }
    }

    /// Writes a surface in this format. It computes, so call it on the CPU pool.
    pub(super) fn write(self, surface: &SurfaceView<'_>) -> Vec<u8> {
        match self {
            Self::Glb => glb(surface),
            Self::Ply => ply(surface),
            Self::Stl => stl(surface.mesh),
            Self::Vtp => vtp(surface),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    fn accepting(value: &'static str) -> Result<SurfaceOutput, Problem> {
        let headers = HeaderMap::from_iter([(header::ACCEPT, HeaderValue::from_static(value))]);
        SurfaceOutput::choose(None, &headers)
    }

    #[test]
    fn accept_chooses_and_the_query_wins() {
        assert_eq!(accepting("model/stl;q=0.9, */*;q=0.1").unwrap(), SurfaceOutput::Stl);
        assert_eq!(accepting("text/html, */*").unwrap(), SurfaceOutput::Glb);
        assert!(accepting("text/html").is_err());
        assert_eq!(SurfaceOutput::choose(Some(SurfaceOutput::Ply), &HeaderMap::new()).unwrap(), SurfaceOutput::Ply);
    }
}
