//! The OpenAPI document of all routes.

mod choices;
mod codes;
mod descriptions;
mod examples;
mod lengths;

use utoipa::OpenApi as _;
use utoipa::openapi::path::{Operation, ParameterBuilder, ParameterIn, PathItem};
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::openapi::{
    Content, ContentBuilder, HeaderBuilder, OpenApi, Ref, RefOr, Required, ResponseBuilder, Schema, schema,
};

use super::dto::SliceAxis;
use super::middleware::is_public;
use super::problem::PROBLEM_JSON;
use super::{ProblemDocument, routes};

#[derive(utoipa::OpenApi)]
#[openapi(
    info(
        title = "Prosopon",
        description = "Predicts a patient's face after jaw surgery. Coordinates are patient LPS in mm. Every error is a problem \
            document (RFC 9457); `api/problems.md` explains each type. Not a medical device."
    ),
    tags(
        (name = "sessions", description = "Sessions, one per patient"),
        (name = "inputs", description = "CT, surfaces, tissue meshes and landmarks"),
        (name = "field", description = "Signed distance fields of skin and bone"),
        (name = "mesh", description = "Tissue meshes"),
        (name = "bone", description = "Osteotomies, and plans for the movement of bone"),
        (name = "materials", description = "Material laws, presets and stability checks"),
        (name = "jobs", description = "Solves and other long jobs, and their events"),
        (name = "results", description = "Deformed skin, error maps, pictures, reports and comparisons"),
        (name = "health", description = "Health and metrics for operators")
    ),
    servers((url = "/", description = "The service that this document comes from")),
    security((), ("bearer" = [])),
    modifiers(&Bearer),
    components(schemas(ProblemDocument, SliceAxis))
)]
struct Description;

/// The security scheme of a service with `[auth]`.
struct Bearer;

impl utoipa::Modify for Bearer {
    fn modify(&self, api: &mut OpenApi) {
        let description = "An API key or a JWT, where the service has `[auth]`; none is needed where it has not.";
        let scheme = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some(description)).build();
        api.components.get_or_insert_default().add_security_scheme("bearer", SecurityScheme::Http(scheme));
    }
}

/// Builds the OpenAPI 3.1 description of all routes.
#[must_use]
pub fn openapi() -> OpenApi {
    let (plain, uploads) = routes::all();
    let mut api = Description::openapi();
    api.merge(plain.split_for_parts().1);
    api.merge(uploads.split_for_parts().1);
    if let Some(components) = &mut api.components {
        components.schemas.values_mut().for_each(drop_property_names);
        components.schemas.values_mut().for_each(descriptions::describe_variants);
        components.schemas.get_mut("ProblemDocument").into_iter().for_each(descriptions::describe_facts);
        components.schemas.iter_mut().for_each(|(name, schema)| lengths::fix_lengths(name, schema));
        components.schemas.iter_mut().for_each(|(name, schema)| choices::split(name, schema));
        codes::add(&mut components.schemas);
    }
    let schemas = api.components.clone().unwrap_or_default().schemas;
    for (path, item) in &mut api.paths.paths {
        for operation in operations(item) {
            let optional = body_name(operation).is_some_and(|name| schemas.get(name).is_some_and(needs_nothing));
            if let (true, Some(RefOr::T(body))) = (optional, &mut operation.request_body) {
                body.required = Some(Required::False);
            }
            if is_public(path) {
                operation.security = Some(Vec::new());
            }
            add_problem(operation);
            descriptions::describe_parameters(operation);
            say_binary(operation);
            add_headers(operation);
            examples::add_answer(operation);
        }
        for (method, operation) in [("PUT", &mut item.put), ("POST", &mut item.post)] {
            operation.iter_mut().for_each(|operation| examples::add_examples(method, path, operation));
        }
        if let Some(post) = &mut item.post
            && creates(path)
        {
            add_idempotency_key(post);
        }
    }
    api
}

/// The OpenAPI description as JSON, as checked in at `api/openapi.json`.
///
/// # Errors
/// Fails if the description cannot be serialised.
pub fn openapi_json() -> Result<String, serde_json::Error> {
    Ok(openapi().to_pretty_json()? + "\n")
}

fn operations(item: &mut PathItem) -> impl Iterator<Item = &mut Operation> {
    [&mut item.get, &mut item.put, &mut item.post, &mut item.delete].into_iter().flatten()
}

/// Gives bodies that are not text a binary schema, where utoipa gives a list of numbers.
fn say_binary(operation: &mut Operation) {
    let bytes = || {
        let format = schema::SchemaFormat::KnownFormat(schema::KnownFormat::Binary);
        Schema::Object(schema::ObjectBuilder::new().schema_type(schema::Type::String).format(Some(format)).build())
    };
    let say = |media_type: &str, content: &mut RefOr<Content>| {
        if let RefOr::T(content) = content
            && is_bytes(media_type)
        {
            content.schema = Some(bytes().into());
        }
    };
    if let Some(RefOr::T(body)) = &mut operation.request_body {
        body.content.iter_mut().for_each(|(media_type, content)| say(media_type, content));
    }
    for response in operation.responses.responses.values_mut() {
        if let RefOr::T(response) = response {
            response.content.iter_mut().for_each(|(media_type, content)| say(media_type, content));
        }
    }
}

fn is_bytes(media_type: &str) -> bool {
    !media_type.contains("json") && !["text/", "multipart/"].iter().any(|start| media_type.starts_with(start))
}

/// Adds the headers that every answer has, and those of every file.
fn add_headers(operation: &mut Operation) {
    let header = |about: &str| {
        let text = Schema::Object(schema::ObjectBuilder::new().schema_type(schema::Type::String).build());
        HeaderBuilder::new().schema(Some(text)).description(Some(about)).build()
    };
    for (status, response) in &mut operation.responses.responses {
        let RefOr::T(response) = response else { continue };
        response.headers.insert("X-Request-Id".to_owned(), header("Id of the request, as in the log.").into());
        if status == "200" && response.content.keys().any(|media_type| is_bytes(media_type)) {
            let tag = header("Tag of the content for `If-None-Match` and `If-Range`.");
            response.headers.insert("ETag".to_owned(), tag.into());
        }
    }
}

/// Removes schemas of member names, which are always strings, even if they are segment numbers.
fn drop_property_names(schema: &mut RefOr<Schema>) {
    match schema {
        RefOr::T(Schema::Object(object)) => {
            object.property_names = None;
            object.properties.values_mut().for_each(drop_property_names);
        }
        RefOr::T(Schema::AllOf(all)) => all.items.iter_mut().for_each(drop_property_names),
        RefOr::T(_) | RefOr::Ref(_) => {}
    }
}

/// Name of the schema of a JSON body.
fn body_name(operation: &Operation) -> Option<&str> {
    let Some(RefOr::T(body)) = &operation.request_body else { return None };
    let Some(RefOr::T(content)) = body.content.get("application/json") else { return None };
    let Some(RefOr::Ref(reference)) = &content.schema else { return None };
    reference.ref_location.rsplit('/').next()
}

/// Whether no member is required, so that a request without a body counts as `{}`.
fn needs_nothing(schema: &RefOr<Schema>) -> bool {
    matches!(schema, RefOr::T(Schema::Object(object)) if object.required.is_empty())
}

/// Adds the problem document as default response of an operation.
fn add_problem(operation: &mut Operation) {
    let content = ContentBuilder::new().schema(Some(Ref::from_schema_name("ProblemDocument"))).build();
    let problem = ResponseBuilder::new().description("A problem document.").content(PROBLEM_JSON, content).build();
    operation.responses.responses.insert("default".to_owned(), problem.into());
}

/// Whether a POST to the path creates something; the others query or cancel.
fn creates(path: &str) -> bool {
    ["/v1/sessions", "/v1/compare"].contains(&path)
        || ["/field", "/mesh", "/osteotomies", "/plans", "/jobs"].iter().any(|end| path.ends_with(end))
}

fn add_idempotency_key(operation: &mut Operation) {
    let text = schema::ObjectBuilder::new().schema_type(schema::Type::String).max_length(Some(200)).build();
    let header = ParameterBuilder::new()
        .name("Idempotency-Key")
        .parameter_in(ParameterIn::Header)
        .required(Required::False)
        .description(Some("A repeated key returns the first answer; with another payload, 422."))
        .schema(Some(Schema::Object(text)))
        .build();
    operation.parameters.get_or_insert_default().push(header.into());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checked_in_description_is_that_of_the_routes() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../api/openapi.json");
        let checked_in = std::fs::read_to_string(path).unwrap_or_default();
        assert!(
            checked_in == openapi_json().unwrap(),
            "run `cargo run -- openapi > api/openapi.json` and read the diff"
        );
    }

    /// utoipa does not collect schemas that only parameters reference.
    #[test]
    fn every_reference_leads_somewhere() {
        let api: serde_json::Value = serde_json::from_str(&openapi_json().unwrap()).unwrap();
        let (mut stack, mut followed) = (vec![&api], 0);
        while let Some(value) = stack.pop() {
            if let Some(reference) = value.get("$ref").and_then(serde_json::Value::as_str) {
                assert!(api.pointer(reference.strip_prefix('#').unwrap()).is_some(), "{reference}");
                followed += 1;
            }
            stack.extend(value.as_object().into_iter().flat_map(|o| o.values()));
            stack.extend(value.as_array().into_iter().flatten());
        }
        assert!(followed > 50);
        assert!(!openapi_json().unwrap().contains("propertyNames"), "names are texts");
    }

    #[test]
    fn generated_clients_know_states_phases_and_security() {
        let api = serde_json::to_value(openapi()).unwrap();
        let job = &api["components"]["schemas"]["JobView"];
        let members = job["allOf"].as_array().unwrap().iter().find_map(|part| part.get("properties")).unwrap();
        let names = |member: &str| members[member]["enum"].as_array().unwrap().len();
        assert_eq!((names("status"), names("kind")), (6, 5));
        assert!(members["phase"]["enum"].as_array().unwrap().contains(&"estimate".into()));
        assert_eq!(api["components"]["securitySchemes"]["bearer"]["scheme"], "bearer");
        assert_eq!(api["paths"]["/livez"]["get"]["security"], serde_json::json!([]));
        assert_eq!(api["paths"]["/v1/sessions"]["get"]["operationId"], "listSessions");
    }

    #[test]
    fn every_json_body_has_an_example_and_every_point_its_length() {
        let api = serde_json::to_value(openapi()).unwrap();
        for (path, item) in api["paths"].as_object().unwrap() {
            for (method, operation) in item.as_object().unwrap() {
                let content = &operation["requestBody"]["content"]["application/json"];
                assert!(content.is_null() || !content["examples"].as_object().unwrap().is_empty(), "{method} {path}");
                for (status, answer) in operation["responses"].as_object().unwrap() {
                    let content = &answer["content"]["application/json"];
                    let has = content.is_null() || content["example"].is_object();
                    assert!(has || (path == "/v1/compare" && status == "202"), "{method} {path} {status}");
                }
            }
        }
        let of = |schema: &str, member: &str| api["components"]["schemas"][schema]["properties"][member].clone();
        assert_eq!(of("PlaneDocument", "normal")["minItems"], 3);
        assert_eq!(of("PointQuery", "points_mm")["items"]["maxItems"], 3);
        assert_eq!(of("CutSurfaceDocument", "triangles")["items"]["maxItems"], 3);
        // A flat list of numbers of triangles has any length.
        assert_eq!(of("PointValues", "triangles").get("maxItems"), None);
    }

    #[test]
    fn every_operation_can_answer_with_a_problem() {
        let api = openapi();
        let mut ids = std::collections::BTreeSet::new();
        assert!(api.paths.paths.len() > 25);
        for (path, mut item) in api.paths.paths {
            for operation in operations(&mut item) {
                assert!(operation.summary.as_ref().is_some_and(|s| !s.is_empty()), "{path}");
                assert!(ids.insert(operation.operation_id.clone()), "{path}");
                assert!(operation.responses.responses.contains_key("default"), "{path}");
                assert!(operation.responses.responses.len() > 1, "{path}");
            }
        }
    }
}
