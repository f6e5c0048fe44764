use axum::Json;
use axum::extract::State;

use crate::http::dto::{CheckMaterial, MaterialCheck, MaterialsList, MaterialsQuery};
use crate::http::extract::{Body, Params};
use crate::http::{AppState, Problem};

/// Materials
///
/// Laws with the units of their constants; presets with their sources, moduli at small strain and the stretches between which they are stable.
#[utoipa::path(get, path = "/v1/materials", tag = "materials", params(MaterialsQuery),
    responses((status = 200, description = "laws and presets", body = MaterialsList)))]
pub(in crate::http) async fn list(
    State(state): State<AppState>,
    Params(query): Params<MaterialsQuery>,
) -> Result<Json<MaterialsList>, Problem> {
    Ok(Json(state.service.compute(move |_, _| Ok(MaterialsList::new(query.d1_reading))).await?))
}

/// Check a material
///
/// Sign and rise of the stress, Drucker stability and strong ellipticity in uniaxial, equibiaxial and planar stretch and in simple shear at
/// constant volume; what is lost, in which mode and at which stretch. Stores nothing.
#[utoipa::path(post, path = "/v1/materials/check", tag = "materials", request_body = CheckMaterial,
    responses((status = 200, description = "what it is like", body = MaterialCheck)))]
pub(in crate::http) async fn check(
    State(state): State<AppState>,
    Body(request): Body<CheckMaterial>,
) -> Result<Json<MaterialCheck>, Problem> {
    let material = request.check()?;
    Ok(Json(state.service.compute(move |_, _| Ok(MaterialCheck::new(&material))).await?))
}
