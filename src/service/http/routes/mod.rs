//! Handlers of the routes: each extracts, converts, calls one domain function and converts back.
//!
//! # Adding a route
//! 1. Write the handler in a module here, and list it in [`all`].
//! 2. Name the id of a session or job in the path `{session}` or `{job}`: the guard finds the owner by these names.
//! 3. Put documents that are stored or shared with jobs in `prosopon_contract`, other views in `dto`, and work in `tasks` of
//!    `prosopon_jobs`.
//! 4. A POST that only reads is listed in `READ_ONLY_POSTS` (`middleware/guard.rs`). A POST that creates something takes a
//!    `CreateBody` or `RepeatableBody`, and `creates` (`openapi.rs`) lists it.
//! 5. Run `cargo run -- openapi > api/openapi.json`, and add a line to `api/CHANGELOG.md`.

mod accepted;
mod budget;
mod compare;
mod events;
mod field;
mod frame;
mod health;
mod inputs;
mod jobs;
mod landmarks;
mod links;
mod materials;
mod mesh;
mod mesh_choice;
mod on_demand;
mod osteotomies;
mod page;
mod path;
mod plans;
mod problem_page;
mod profile;
mod report;
mod report_appendix;
mod report_clinical;
mod report_errors;
mod report_page;
mod report_pictures;
mod report_plan;
mod report_table;
mod results;
mod sessions;
mod step_surface;
mod tissue;
mod warm_start;

use axum::routing::get;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::AppState;

/// Routes for monitoring a process.
pub(super) fn health() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(health::livez)).routes(routes!(health::readyz)).routes(routes!(health::metrics))
}

/// Files of the viewer, which the OpenAPI document does not list.
pub(super) fn viewer_files() -> axum::Router<AppState> {
    axum::Router::new().route("/assets/{name}", get(page::viewer_file)).route("/icon.svg", get(page::viewer_icon))
}

/// All routes with their descriptions: first those with the JSON body limit, then the uploads.
///
/// Uploads check their length themselves.
pub(super) fn all() -> (OpenApiRouter<AppState>, OpenApiRouter<AppState>) {
    let plain = OpenApiRouter::new()
        .routes(routes!(sessions::list, sessions::create))
        .routes(routes!(sessions::get, sessions::delete))
        .routes(routes!(sessions::restore))
        .routes(routes!(landmarks::get, landmarks::put))
        .routes(routes!(frame::get, frame::put, frame::delete))
        .routes(routes!(field::put_settings))
        .routes(routes!(field::get, field::build))
        .routes(routes!(field::slice))
        .routes(routes!(field::query))
        .routes(routes!(mesh::get, mesh::build))
        .routes(routes!(osteotomies::list, osteotomies::create))
        .routes(routes!(osteotomies::preview))
        .routes(routes!(osteotomies::templates))
        .routes(routes!(osteotomies::get, osteotomies::delete))
        .routes(routes!(osteotomies::segment))
        .routes(routes!(plans::list, plans::create))
        .routes(routes!(plans::get, plans::delete))
        .routes(routes!(materials::list))
        .routes(routes!(materials::check))
        .routes(routes!(links::create))
        .routes(routes!(jobs::create))
        .routes(routes!(jobs::list))
        .routes(routes!(jobs::get))
        .routes(routes!(jobs::cancel))
        .routes(routes!(events::events))
        .routes(routes!(results::topology))
        .routes(routes!(results::skin))
        .routes(routes!(results::frame))
        .routes(routes!(path::path))
        .routes(routes!(results::error))
        .routes(routes!(results::error_picture))
        .routes(routes!(results::picture))
        .routes(routes!(results::tissue))
        .routes(routes!(report::report))
        .routes(routes!(profile::profile))
        .routes(routes!(compare::compare))
        .routes(routes!(compare::comparison))
        .merge(health())
        .routes(routes!(problem_page::problem_page))
        .routes(routes!(page::page));
    let uploads = OpenApiRouter::new()
        .routes(routes!(inputs::put_ct))
        .routes(routes!(inputs::get_skin, inputs::put_skin))
        .routes(routes!(inputs::get_skull, inputs::put_skull))
        .routes(routes!(inputs::get_target, inputs::put_target))
        .routes(routes!(tissue::get_tissue, tissue::put_tissue, tissue::delete_tissue))
        .routes(routes!(tissue::get_bone, tissue::put_bone, tissue::delete_bone));
    (plain, uploads)
}
