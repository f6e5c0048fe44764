//! Descriptions that utoipa cannot take from the code: of ids in paths, and of members that tell variants apart.

use utoipa::openapi::extensions::Extensions;
use utoipa::openapi::path::Operation;
use utoipa::openapi::schema::{AdditionalProperties, ObjectBuilder, SchemaType, Type};
use utoipa::openapi::{RefOr, Schema};

/// What each parameter of a path is.
const IN_PATHS: [(&str, &str); 7] = [
    ("session", "Id of the session."),
    ("job", "Id of the job."),
    ("k", "Number of the step, from 1; 0 is the skin at rest, where that is allowed."),
    ("osteotomy", "Id of the osteotomy."),
    ("plan", "Id of the plan."),
    ("segment", "Number of the segment."),
    ("kind", "Kind of the problem, as in its `type`."),
];
/// What other parameters are whose description utoipa does not take.
const OTHERS: [(&str, &str); 3] = [
    ("status", "Status: lists only jobs with this status."),
    ("Prefer", "`wait=s`: longest wait for the result, s; after it the answer is a job."),
    ("Last-Event-ID", "Number of the last event that the client has; the stream goes on after it."),
];
const VARIANT: &str = "Name of this variant.";

/// Describes parameters that have no description.
pub(super) fn describe_parameters(operation: &mut Operation) {
    for parameter in operation.parameters.iter_mut().flatten() {
        let RefOr::T(parameter) = parameter else { continue };
        let known = IN_PATHS.iter().chain(&OTHERS).find(|(name, _)| *name == parameter.name);
        // A parameter that is absent is not sent: only bodies have `null`.
        if let Some(RefOr::T(Schema::Object(schema))) = &mut parameter.schema
            && let SchemaType::Array(types) = &schema.schema_type
            && let [only] = types.iter().filter(|t| **t != Type::Null).collect::<Vec<_>>().as_slice()
        {
            schema.schema_type = SchemaType::Type((*only).clone());
        }
        if let (None, Some((_, text))) = (&parameter.description, known) {
            parameter.description = Some((*text).to_owned());
        }
    }
}

/// Describes the further members of a problem, which may hold any JSON.
pub(super) fn describe_facts(problem: &mut RefOr<Schema>) {
    let RefOr::T(Schema::Object(object)) = problem else { return };
    let facts = ObjectBuilder::new()
        .schema_type(SchemaType::AnyValue)
        .description(Some("Facts about the problem, by its type."))
        .extensions(Some(Extensions::builder().add("x-any", true).build()))
        .build();
    object.additional_properties = Some(Box::new(AdditionalProperties::RefOr(RefOr::T(Schema::Object(facts)))));
}

/// Describes the members with a single possible value, which tell the variants of a `oneOf` apart.
pub(super) fn describe_variants(schema: &mut RefOr<Schema>) {
    match schema {
        RefOr::T(Schema::Object(object)) => {
            for property in object.properties.values_mut() {
                if let RefOr::T(Schema::Object(property)) = property
                    && property.enum_values.as_ref().is_some_and(|values| values.len() == 1)
                {
                    property.description.get_or_insert_with(|| VARIANT.to_owned());
                }
            }
        }
        RefOr::T(Schema::OneOf(one)) => one.items.iter_mut().for_each(describe_variants),
        RefOr::T(Schema::AllOf(all)) => all.items.iter_mut().for_each(describe_variants),
        RefOr::T(_) | RefOr::Ref(_) => {}
    }
}
