//! ITK's text format of transforms (`.tfm`, `.txt`).

use super::super::ImportError;
use super::super::error::malformed;
use super::super::text::number;
use super::ItkTransform;

const FORMAT: &str = "ITK text";
const MAGIC: &[u8] = b"#Insight Transform File";
/// Most numbers of a line; an affine transform has twelve.
const MAX_NUMBERS: usize = 1000;

pub(super) fn looks_like(bytes: &[u8]) -> bool {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start().starts_with(MAGIC)
}

pub(super) fn read(bytes: &[u8]) -> Result<Vec<ItkTransform>, ImportError> {
    let mut transforms: Vec<ItkTransform> = Vec::new();
    for (line, text) in (1u64..).zip(bytes.split(|c| *c == b'\n')) {
        let text = text.trim_ascii();
        let Some(colon) = text.iter().position(|c| *c == b':').filter(|_| !text.starts_with(b"#")) else {
            continue;
        };
        let (name, value) = text.split_at(colon);
        let value = value.get(1..).unwrap_or_default();
        if name == b"Transform" {
            let kind = String::from_utf8_lossy(value).trim().to_owned();
            transforms.push(ItkTransform { kind, ..ItkTransform::default() });
            continue;
        }
        let Some(last) = transforms.last_mut() else {
            return Err(malformed(FORMAT, format!("line {line}: parameters come before `Transform:`")));
        };
        match name {
            b"Parameters" => last.parameters = numbers(value, line)?,
            b"FixedParameters" => last.fixed = numbers(value, line)?,
            _ => {}
        }
    }
    Ok(transforms)
}

fn numbers(text: &[u8], line: u64) -> Result<Vec<f64>, ImportError> {
    let words = text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    let numbers: Option<Vec<f64>> = words.take(MAX_NUMBERS + 1).map(number).collect();
    let numbers = numbers.ok_or_else(|| malformed(FORMAT, format!("line {line}: a parameter is no number")))?;
    if numbers.len() > MAX_NUMBERS {
        let detail =
            format!("line {line}: it has more than {MAX_NUMBERS} parameters: a deformation, not a rigid transform");
        return Err(malformed(FORMAT, detail));
    }
    Ok(numbers)
}
