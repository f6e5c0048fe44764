use axum::Json;
use axum::extract::State;

use crate::http::dto::{CheckMaterial, MaterialCheck, MaterialsList, MaterialsQuery};
use crate::http::extract::{Body, Params};
use crate::http::{AppState, Problem};

/// List material laws and presets
///
/// Returns the laws with the units of their constants, and the presets with their sources, moduli at small strain and stable
/// ranges of stretch.
#[utoipa::path(get, path = "/v1/materials", operation_id = "listMaterials", tag = "materials", params(MaterialsQuery),
    responses((status = 200, description = "Laws and presets.", body = MaterialsList)))]
pub(in crate::http) async fn list(
    State(state): State<AppState>,
    Params(query): Params<MaterialsQuery>,
) -> Result<Json<MaterialsList>, Problem> {
    Ok(Json(state.service.compute(move |_, _| Ok(MaterialsList::new(query.d1_reading))).await?))
}

/// Check a material
///
/// Checks sign and increase of the stress, Drucker stability and strong ellipticity in uniaxial, equibiaxial and planar stretch
/// and in simple shear at constant volume. The answer gives each violated criterion with its test and stretch. The service
/// stores nothing.
#[utoipa::path(post, path = "/v1/materials/check", operation_id = "checkMaterial", tag = "materials", request_body = CheckMaterial,
    responses((status = 200, description = "Result of the check.", body = MaterialCheck)))]
pub(in crate::http) async fn check(
    State(state): State<AppState>,
    Body(request): Body<CheckMaterial>,
) -> Result<Json<MaterialCheck>, Problem> {
    let material = request.check()?;
    Ok(Json(state.service.compute(move |_, _| Ok(MaterialCheck::new(&material))).await?))
}
