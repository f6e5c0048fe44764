//! Transforms in JSON: a 4 × 4 matrix, or the parameters of ITK.

use prosopon_formats::import::ItkTransform;
use serde_json::{Map, Value};

/// Most transforms and parameters; a composite of rigid ones has a few.
const MOST: usize = 1000;

/// What a JSON file holds.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum JsonTransform {
    /// `matrix[row][column]`, mm.
    Matrix([[f64; 4]; 4]),
    /// Transforms as ITK's own JSON lists them.
    Itk(Vec<ItkTransform>),
}

/// Reads a JSON file; `None` when the bytes begin like no JSON.
///
/// # Errors
/// A text that says what is wrong, for a message after the value's name.
pub(super) fn json_transform(bytes: &[u8]) -> Option<Result<JsonTransform, String>> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
    if !text.starts_with(b"{") && !text.starts_with(b"[") {
        return None;
    }
    let value: Result<Value, _> = serde_json::from_slice(text);
    Some(value.map_err(|error| format!("begins like JSON, but is not JSON: {error}")).and_then(|value| read(&value)))
}

fn read(value: &Value) -> Result<JsonTransform, String> {
    if let Value::Object(members) = value {
        if let Some(matrix) = member(members, "matrix") {
            return rows(matrix);
        }
        return Ok(JsonTransform::Itk(vec![itk(members)?]));
    }
    let items = value.as_array().map(Vec::as_slice).unwrap_or_default();
    if !items.iter().any(Value::is_object) {
        return rows(value);
    }
    if items.len() > MOST {
        return Err(format!("has {} transforms, at most {MOST} are allowed", items.len()));
    }
    let one = |item: &Value| item.as_object().ok_or_else(|| NEITHER.to_owned()).and_then(itk);
    Ok(JsonTransform::Itk(items.iter().map(one).collect::<Result<_, _>>()?))
}

const NEITHER: &str = "has no `matrix` and no `parameters` of a transform of ITK";

/// A member by its name without regard to case and `_`: `fixedParameters`, `FixedParameters`, `fixed_parameters`.
fn member<'a>(members: &'a Map<String, Value>, name: &str) -> Option<&'a Value> {
    let plain = |key: &str| key.replace('_', "").to_ascii_lowercase();
    members.iter().find(|(key, _)| plain(key) == name).map(|(_, value)| value)
}

fn itk(members: &Map<String, Value>) -> Result<ItkTransform, String> {
    let kind =
        member(members, "transformtype").or_else(|| member(members, "transform")).or_else(|| member(members, "type"));
    let kind = match kind {
        Some(Value::String(kind)) => kind.clone(),
        // The form of ITK-Wasm.
        Some(Value::Object(kind)) => {
            let class = member(kind, "transformparameterization").and_then(Value::as_str).unwrap_or_default();
            let in_space = |name: &str| member(kind, name).is_none_or(|n| n.as_u64() == Some(3));
            if !in_space("inputdimension") || !in_space("outputdimension") {
                return Err("is a transform that is not one of three dimensions".to_owned());
            }
            format!("{class}Transform")
        }
        _ => return Err(NEITHER.to_owned()),
    };
    let numbers = |name: &str| match member(members, name) {
        None | Some(Value::Null) => Ok(Vec::new()),
        Some(value) => numbers(value).ok_or_else(|| format!("has `{name}` that are no list of at most {MOST} numbers")),
    };
    Ok(ItkTransform { kind, parameters: numbers("parameters")?, fixed: numbers("fixedparameters")? })
}

fn numbers(value: &Value) -> Option<Vec<f64>> {
    value.as_array().filter(|list| list.len() <= MOST)?.iter().map(Value::as_f64).collect()
}

fn rows(value: &Value) -> Result<JsonTransform, String> {
    let read = || -> Option<[[f64; 4]; 4]> {
        let list = value.as_array()?;
        let flat: Vec<f64> = match list.len() {
            4 => list.iter().map(|row| numbers(row).filter(|r| r.len() == 4)).collect::<Option<Vec<_>>>()?.concat(),
            _ => numbers(value)?,
        };
        let (rows, rest) = flat.as_chunks::<4>();
        rest.is_empty().then(|| rows.try_into().ok()).flatten()
    };
    read().map(JsonTransform::Matrix).ok_or_else(|| "has a matrix that is not 4 lists of 4 numbers".to_owned())
}
