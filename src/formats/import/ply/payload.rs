//! Values after the header of a PLY file.

use super::super::ImportError;
use super::super::error::malformed;
use super::super::number::{ByteOrder, NumberType};
use super::super::text::Words;
use super::FORMAT;
use super::header::{Element, Encoding, Property};

/// Reads the values in order.
#[derive(Debug)]
pub(super) enum Values<'a> {
    Ascii(Words<'a>),
    Binary { rest: &'a [u8], order: ByteOrder },
}

impl<'a> Values<'a> {
    /// Values in `bytes`, which begin on line `line` of the file.
    pub(super) fn new(bytes: &'a [u8], encoding: Encoding, line: u64) -> Self {
        match encoding {
            Encoding::Ascii => Self::Ascii(Words::new(bytes, line)),
            Encoding::LittleEndian => Self::Binary { rest: bytes, order: ByteOrder::Little },
            Encoding::BigEndian => Self::Binary { rest: bytes, order: ByteOrder::Big },
        }
    }

    /// Refuses more instances of `element` than the remaining bytes can hold.
    pub(super) fn check_length(&self, element: &Element) -> Result<(), ImportError> {
        let smallest = match self {
            // A digit and a space for each number.
            Self::Ascii(_) => (element.properties.len() as u64).saturating_mul(2),
            Self::Binary { .. } => element
                .properties
                .iter()
                .map(|p| p.count_type.unwrap_or(p.number_type).size() as u64)
                .fold(0, u64::saturating_add),
        };
        let left = match self {
            Self::Ascii(words) => (words.bytes_left() as u64).saturating_add(1),
            Self::Binary { rest, .. } => rest.len() as u64,
        };
        let needed = element.count.saturating_mul(smallest);
        if needed > left {
            let count = element.count;
            let detail =
                format!("the header states {count} instances, which take at least {needed} bytes, but {left} are left");
            return Err(malformed(FORMAT, detail));
        }
        Ok(())
    }

    /// The next number.
    pub(super) fn scalar(&mut self, number_type: NumberType) -> Option<f64> {
        let (rest, order) = match self {
            Self::Ascii(words) => return words.next_number(),
            Self::Binary { rest, order } => (rest, *order),
        };
        let (number, tail) = number_type.first(rest, order)?;
        *rest = tail;
        Some(number)
    }

    /// The next number as a count or index; `None` unless it is whole and not negative.
    pub(super) fn index(&mut self, number_type: NumberType) -> Option<u32> {
        let number = self.scalar(number_type)?;
        let index = number as u32;
        (f64::from(index) == number).then_some(index)
    }

    /// Skips the next value or list.
    pub(super) fn skip(&mut self, property: &Property) -> Option<()> {
        let count = match property.count_type {
            Some(count_type) => self.index(count_type)?,
            None => 1,
        };
        match self {
            Self::Ascii(words) => (0..count).try_for_each(|_| words.next().map(|_| ())),
            Self::Binary { rest, .. } => {
                let bytes =
                    usize::try_from((property.number_type.size() as u64).checked_mul(u64::from(count))?).ok()?;
                *rest = rest.get(bytes..)?;
                Some(())
            }
        }
    }

    /// Whether the instance ends here: in a text file each instance has its own line.
    pub(super) fn end_of_element(&self) -> bool {
        match self {
            Self::Ascii(words) => words.line_is_done(),
            Self::Binary { .. } => true,
        }
    }

    /// Number of bytes that were not read.
    pub(super) fn left_over(&self) -> usize {
        match self {
            Self::Ascii(words) => words.bytes_left(),
            Self::Binary { rest, .. } => rest.len(),
        }
    }

    /// The position in a text file, for errors.
    pub(super) fn place(&self) -> String {
        match self {
            Self::Ascii(words) => format!(" (line {})", words.line()),
            Self::Binary { .. } => String::new(),
        }
    }
}
