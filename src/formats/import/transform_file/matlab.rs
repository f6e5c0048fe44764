//! MATLAB files of version 4, as ITK and ANTs write transforms: a column of parameters under the name of the transform's class,
//! then a column `fixed`.

use super::super::ImportError;
use super::super::error::malformed;
use super::super::number::{ByteOrder, NumberType};
use super::ItkTransform;

const FORMAT: &str = "ITK MATLAB";
const MAX_NUMBERS: usize = 1000;
const LONGEST_NAME: usize = 64;

/// Header of a variable.
struct Variable<'a> {
    name: String,
    numbers: Vec<f64>,
    rest: &'a [u8],
}

/// Whether the first variable has a name of ITK.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    variable(bytes).is_some_and(|first| first.name.contains("Transform"))
}

/// MATLAB 5 and later begin with a text.
pub(super) fn is_later_version(bytes: &[u8]) -> bool {
    bytes.starts_with(b"MATLAB ")
}

pub(super) fn read(bytes: &[u8]) -> Result<Vec<ItkTransform>, ImportError> {
    let mut transforms: Vec<ItkTransform> = Vec::new();
    let mut rest = bytes;
    while !rest.is_empty() {
        let found =
            variable(rest).ok_or_else(|| malformed(FORMAT, "a variable is cut off or is no column of numbers"))?;
        rest = found.rest;
        match transforms.last_mut() {
            Some(last) if found.name == "fixed" => last.fixed = found.numbers,
            _ => transforms.push(ItkTransform { kind: found.name, parameters: found.numbers, fixed: Vec::new() }),
        }
    }
    Ok(transforms)
}

fn variable(bytes: &[u8]) -> Option<Variable<'_>> {
    let (head, rest) = bytes.split_first_chunk::<20>()?;
    let words = head.as_chunks::<4>().0;
    let little = words.first().is_some_and(|w| u32::from_le_bytes(*w) <= 100);
    let order = if little { ByteOrder::Little } else { ByteOrder::Big };
    let word = |at: usize| words.get(at).map(|w| order.u32(*w));
    let number_type = match (word(0)?, order) {
        (0, ByteOrder::Little) | (1000, ByteOrder::Big) => NumberType::F64,
        (10, ByteOrder::Little) | (1010, ByteOrder::Big) => NumberType::F32,
        _ => return None,
    };
    let count = usize::try_from(word(1)?.checked_mul(word(2)?)?).ok().filter(|count| *count <= MAX_NUMBERS)?;
    let name_length = usize::try_from(word(4)?).ok().filter(|length| *length <= LONGEST_NAME)?;
    if word(3)? != 0 {
        return None;
    }
    let (name, rest) = rest.split_at_checked(name_length)?;
    let (numbers, rest) = rest.split_at_checked(count.checked_mul(number_type.size())?)?;
    let name = name.strip_suffix(b"\0").unwrap_or(name);
    let name = String::from_utf8(name.to_vec()).ok().filter(|n| n.chars().all(|c| c.is_ascii_graphic()))?;
    Some(Variable { name, numbers: number_type.all(numbers, order), rest })
}
