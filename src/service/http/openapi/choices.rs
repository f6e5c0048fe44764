//! Members of which a request has exactly one, as the variants of a `oneOf`.
//!
//! In Rust these are optional members that exclude each other. Described like that, clients would compile an empty object.

use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, SchemaType, Type};
use utoipa::openapi::{RefOr, Schema};

/// A variant of a schema.
struct Variant {
    title: &'static str,
    /// Members that tell the variant from the others; none where the other variants have some.
    needs: &'static [&'static str],
    /// Members that it cannot have.
    without: &'static [&'static str],
}

const fn variant(title: &'static str, needs: &'static [&'static str], without: &'static [&'static str]) -> Variant {
    Variant { title, needs, without }
}

/// The variants of each schema.
const CHOICES: [(&str, &[Variant]); 6] = [
    (
        "CutDocument",
        &[
            variant("PlaneCut", &["plane"], &["polyline", "surface", "free_part"]),
            variant("PolylineCut", &["polyline"], &["plane", "surface", "free_part"]),
            variant("SurfaceCut", &["surface"], &["plane", "polyline", "free_part"]),
            variant("FreePart", &["free_part"], &["plane", "polyline", "surface"]),
        ],
    ),
    (
        "CreateOsteotomy",
        &[
            variant("OsteotomyByTemplate", &["template"], &["templates"]),
            variant("OsteotomyByTemplates", &["templates"], &["template"]),
            variant("OsteotomyByCuts", &["cuts"], &["template", "templates"]),
        ],
    ),
    (
        "RotationRequest",
        &[
            variant("RotationByQuaternion", &["quaternion_xyzw"], &["axis_angle", "pitch_roll_yaw"]),
            variant("RotationByAxis", &["axis_angle"], &["quaternion_xyzw", "pitch_roll_yaw"]),
            variant("RotationByAngles", &["pitch_roll_yaw"], &["quaternion_xyzw", "axis_angle"]),
        ],
    ),
    (
        "WaypointRequest",
        &[
            variant("HingeWaypoint", &["hinge"], &["translation_mm", "rotation", "matrix", "transform_file"]),
            variant("MatrixWaypoint", &["matrix"], &["translation_mm", "rotation", "hinge", "transform_file"]),
            variant("TransformFileWaypoint", &["transform_file"], &["translation_mm", "rotation", "hinge", "matrix"]),
            variant("FreeWaypoint", &[], &["hinge", "matrix", "transform_file"]),
        ],
    ),
    (
        "PathRequest",
        &[
            variant("PathByWaypoints", &["waypoints"], &["autorotate", "matrix", "transform_file"]),
            variant("PathByAutorotation", &["autorotate"], &["waypoints", "matrix", "transform_file"]),
            variant("PathByMatrix", &["matrix"], &["waypoints", "autorotate", "transform_file"]),
            variant("PathByTransformFile", &["transform_file"], &["waypoints", "autorotate", "matrix"]),
        ],
    ),
    (
        "SurfaceRef",
        &[
            variant("SurfaceOfSession", &["session", "part"], &["job", "step"]),
            variant("SurfaceOfSolve", &["job", "step"], &["session", "part"]),
        ],
    ),
];

/// Splits the schema `name` into its variants, if it has any.
pub(super) fn split(name: &str, schema: &mut RefOr<Schema>) {
    let Some((_, variants)) = CHOICES.iter().find(|(of, _)| *of == name) else { return };
    let RefOr::T(Schema::Object(whole)) = schema else { return };
    let mut one_of = OneOfBuilder::new().description(whole.description.take());
    for variant in *variants {
        let mut object = whole.clone();
        object.title = Some(variant.title.to_owned());
        for member in variant.without {
            if !object.properties.get_mut(*member).is_some_and(set_null) {
                object.properties.remove(*member);
            }
        }
        for member in variant.needs {
            object.properties.get_mut(*member).into_iter().for_each(drop_null);
            object.required.push((*member).to_owned());
        }
        one_of = one_of.item(object);
    }
    *schema = one_of.into();
}

fn is_null(schema: &RefOr<Schema>) -> bool {
    matches!(schema, RefOr::T(Schema::Object(object)) if object.schema_type == SchemaType::Type(Type::Null))
}

/// Lets a member that may be null be nothing else. Returns whether it may.
fn set_null(member: &mut RefOr<Schema>) -> bool {
    let may_be_null = match member {
        RefOr::T(Schema::OneOf(one)) => one.items.iter().any(is_null),
        RefOr::T(Schema::Array(array)) => holds_null(&array.schema_type),
        RefOr::T(Schema::Object(object)) => holds_null(&object.schema_type),
        RefOr::T(_) | RefOr::Ref(_) => false,
    };
    if may_be_null {
        let null = ObjectBuilder::new().schema_type(Type::Null).description(Some("Excluded in this variant."));
        *member = Schema::Object(null.build()).into();
    }
    may_be_null
}

fn holds_null(types: &SchemaType) -> bool {
    matches!(types, SchemaType::Array(types) if types.contains(&Type::Null))
}

fn without_null(types: &mut SchemaType) {
    let SchemaType::Array(all) = types else { return };
    all.retain(|one| *one != Type::Null);
    if let [only] = all.as_slice() {
        *types = SchemaType::Type(only.clone());
    }
}

/// Takes null from the values of a member.
fn drop_null(member: &mut RefOr<Schema>) {
    match member {
        RefOr::T(Schema::OneOf(one)) => {
            one.items.retain(|item| !is_null(item));
            if let [only] = one.items.as_slice() {
                *member = only.clone();
            }
        }
        RefOr::T(Schema::Array(array)) => without_null(&mut array.schema_type),
        RefOr::T(Schema::Object(object)) => without_null(&mut object.schema_type),
        RefOr::T(_) | RefOr::Ref(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::super::openapi;

    /// A renamed schema or member must not lose its variants in silence.
    #[test]
    fn every_choice_has_its_variants() {
        let api = serde_json::to_value(openapi()).unwrap();
        for (name, variants) in super::CHOICES {
            let found = api["components"]["schemas"][name]["oneOf"].as_array().unwrap_or_else(|| panic!("{name}"));
            assert_eq!(found.len(), variants.len(), "{name}");
            for (found, wanted) in found.iter().zip(variants) {
                assert_eq!(found["title"], wanted.title);
                assert_eq!(found["additionalProperties"], false, "{name}");
                for member in wanted.needs {
                    assert!(found["required"].as_array().unwrap().contains(&Value::from(*member)), "{name} {member}");
                    let schema = found["properties"][member].to_string();
                    assert!(schema != "null" && !schema.contains("\"null\""), "{name} {member}: {schema}");
                }
                for member in wanted.without {
                    let schema = &found["properties"][member];
                    assert!(schema.is_null() || schema["type"] == "null", "{name} {member}: {schema}");
                    assert!(variants.iter().any(|v| v.needs.contains(member) || v.needs.is_empty()), "{name} {member}");
                }
            }
        }
        let cut: &Value = &api["components"]["schemas"]["CutDocument"]["oneOf"][0]["properties"]["plane"];
        assert_eq!(cut["$ref"], "#/components/schemas/PlaneDocument");
    }
}
