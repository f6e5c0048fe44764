//! Members that take one of two forms.

use std::fmt;

use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::plan_request::CreatePlan;

/// A plan: the id of one that is stored, or a new one.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[serde(untagged)]
pub enum PlanChoice {
    /// Id of a plan of the session.
    Stored(Uuid),
    /// A plan to create, as by `createPlan`; the job's `plan` names it.
    New(Box<CreatePlan>),
}

impl PlanChoice {
    /// Id of a stored plan; `None` for a new one.
    #[must_use]
    pub fn id(&self) -> Option<Uuid> {
        match self {
            Self::Stored(id) => Some(*id),
            Self::New(_) => None,
        }
    }
}

impl<'de> Deserialize<'de> for PlanChoice {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Forms;
        impl<'de> Visitor<'de> for Forms {
            type Value = PlanChoice;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the id of a plan, or a plan with `osteotomy` and `paths`")
            }

            fn visit_str<E: Error>(self, id: &str) -> Result<PlanChoice, E> {
                id.parse().map(PlanChoice::Stored).map_err(|_| E::custom("expected a UUID, or a plan"))
            }

            fn visit_map<A: MapAccess<'de>>(self, plan: A) -> Result<PlanChoice, A::Error> {
                CreatePlan::deserialize(MapAccessDeserializer::new(plan)).map(|plan| PlanChoice::New(Box::new(plan)))
            }
        }
        deserializer.deserialize_any(Forms)
    }
}

/// Which waiting solves a new one replaces: `true` and `plan` those of the same plan, `session` all of the session.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum SupersedeChoice {
    /// None.
    #[default]
    Nothing,
    /// Those of the same plan.
    Plan,
    /// All of the session.
    Session,
}

impl Serialize for SupersedeChoice {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Nothing => serializer.serialize_bool(false),
            Self::Plan => serializer.serialize_bool(true),
            Self::Session => serializer.serialize_str("session"),
        }
    }
}

impl<'de> Deserialize<'de> for SupersedeChoice {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Forms;
        impl Visitor<'_> for Forms {
            type Value = SupersedeChoice;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("`true`, `false`, `plan` or `session`")
            }

            fn visit_bool<E: Error>(self, is_plan: bool) -> Result<SupersedeChoice, E> {
                Ok(if is_plan { SupersedeChoice::Plan } else { SupersedeChoice::Nothing })
            }

            fn visit_str<E: Error>(self, name: &str) -> Result<SupersedeChoice, E> {
                match name {
                    "plan" => Ok(SupersedeChoice::Plan),
                    "session" => Ok(SupersedeChoice::Session),
                    _ => Err(E::unknown_variant(name, &["plan", "session"])),
                }
            }
        }
        deserializer.deserialize_any(Forms)
    }
}

/// Forms of [`SupersedeChoice`] in the OpenAPI document.
#[derive(Debug, ToSchema)]
#[serde(untagged)]
#[allow(dead_code, reason = "only its schema is used")]
pub enum SupersedeForms {
    /// Whether waiting solves of the same plan are replaced.
    IsReplaced(bool),
    /// Whose waiting solves are replaced.
    Scope(SupersedeScopeName),
}

/// Whose waiting solves a new one replaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SupersedeScopeName {
    /// Those of the same plan.
    Plan,
    /// All of the session.
    Session,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_forms_are_read_and_others_refused() {
        let id = "0192f0c4-0000-7000-8000-000000000000";
        let plan = |text: &str| serde_json::from_str::<PlanChoice>(text);
        assert_eq!(plan(&format!("\"{id}\"")).unwrap(), PlanChoice::Stored(id.parse().unwrap()));
        assert!(matches!(plan(r#"{"paths": []}"#).unwrap(), PlanChoice::New(_)));
        assert!(plan("\"x\"").is_err() && plan("7").is_err() && plan(r#"{"pathes": []}"#).is_err());
        for (text, choice) in [
            ("true", SupersedeChoice::Plan),
            ("false", SupersedeChoice::Nothing),
            ("\"plan\"", SupersedeChoice::Plan),
            ("\"session\"", SupersedeChoice::Session),
        ] {
            assert_eq!(serde_json::from_str::<SupersedeChoice>(text).unwrap(), choice);
        }
        assert!(serde_json::from_str::<SupersedeChoice>("\"all\"").is_err());
        assert_eq!(serde_json::to_string(&SupersedeChoice::Session).unwrap(), "\"session\"");
    }
}
