//! Names that the service gives its findings and problems, as enums.

use std::collections::BTreeMap;

use prosopon_contract::FaultKind;
use utoipa::openapi::schema::{ObjectBuilder, Type};
use utoipa::openapi::{Ref, RefOr, Schema};

/// The page lists every code; the tests compare it with the source.
static WARNINGS: &str = include_str!("../../../../api/warnings.md");

/// Adds the enums, and sets them as types of the members that hold a name of theirs.
pub(super) fn add(schemas: &mut BTreeMap<String, RefOr<Schema>>) {
    let codes = WARNINGS.lines().filter_map(|line| line.strip_prefix("| `")?.split('`').next()).map(str::to_owned);
    let types = FaultKind::ALL.iter().map(|kind| format!("/problems/{}", kind.slug()));
    let enums = [
        ("WarningCode", "WarningDocument", "code", codes.collect::<Vec<_>>(), "Kind of a finding (`api/warnings.md`)."),
        ("ProblemType", "ProblemDocument", "type", types.collect(), "Type of a problem (`api/problems.md`)."),
    ];
    for (name, owner, member, values, about) in enums {
        let text = ObjectBuilder::new().schema_type(Type::String).description(Some(about)).enum_values(Some(values));
        schemas.insert(name.to_owned(), Schema::Object(text.build()).into());
        if let Some(RefOr::T(Schema::Object(object))) = schemas.get_mut(owner) {
            object.properties.insert(member.to_owned(), Ref::from_schema_name(name).into());
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn findings_and_problems_have_enums_of_names() {
        let api = serde_json::to_value(super::super::openapi()).unwrap();
        let schemas = &api["components"]["schemas"];
        let count = |name: &str| schemas[name]["enum"].as_array().unwrap().len();
        assert!(count("WarningCode") > 100, "{}", count("WarningCode"));
        assert!(schemas["WarningCode"]["enum"].as_array().unwrap().contains(&"wide-gap".into()));
        assert!(count("ProblemType") > 20, "{}", count("ProblemType"));
        assert_eq!(schemas["WarningDocument"]["properties"]["code"]["$ref"], "#/components/schemas/WarningCode");
        assert_eq!(schemas["ProblemDocument"]["properties"]["type"]["$ref"], "#/components/schemas/ProblemType");
    }
}
