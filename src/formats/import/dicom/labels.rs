//! What tells images at one position apart: acquisition, time, phase, reconstruction.

use super::elements::Tag;
use crate::import::number::ByteOrder;

/// A property in which scans, phases and reconstructions of one series differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Attribute {
    Acquisition,
    TemporalPosition,
    CardiacPhase,
    TriggerTime,
    TimeOffset,
    StackId,
    Series,
    Voltage,
    Kernel,
    Thickness,
    ImageType,
}

/// Encoding of an attribute's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Text,
    /// Unsigned 16 bits.
    Us,
    /// Unsigned 32 bits.
    Ul,
    /// Double precision.
    Fd,
}

/// Tags of the attributes, those of a frame of an enhanced image before those of a file.
const ATTRIBUTES: [(Attribute, Tag, Encoding); 16] = [
    (Attribute::Acquisition, (0x0020, 0x9156), Encoding::Us),
    (Attribute::Acquisition, (0x0020, 0x0012), Encoding::Text),
    (Attribute::TemporalPosition, (0x0020, 0x9128), Encoding::Ul),
    (Attribute::TemporalPosition, (0x0020, 0x0100), Encoding::Text),
    (Attribute::CardiacPhase, (0x0020, 0x9241), Encoding::Fd),
    (Attribute::TriggerTime, (0x0020, 0x9153), Encoding::Fd),
    (Attribute::TriggerTime, (0x0018, 0x1060), Encoding::Text),
    (Attribute::TimeOffset, (0x0020, 0x930d), Encoding::Fd),
    (Attribute::StackId, (0x0020, 0x9056), Encoding::Text),
    (Attribute::Series, (0x0020, 0x0011), Encoding::Text),
    (Attribute::Voltage, (0x0018, 0x0060), Encoding::Text),
    (Attribute::Kernel, (0x0018, 0x9315), Encoding::Text),
    (Attribute::Kernel, (0x0018, 0x1210), Encoding::Text),
    (Attribute::Thickness, (0x0018, 0x0050), Encoding::Text),
    (Attribute::ImageType, (0x0008, 0x9007), Encoding::Text),
    (Attribute::ImageType, (0x0008, 0x0008), Encoding::Text),
];
const INSTANCE: Tag = (0x0020, 0x0013);
const SOP_INSTANCE: Tag = (0x0008, 0x0018);
/// Dates with times: of a frame, of an acquisition.
const DATE_TIMES: [Tag; 2] = [(0x0018, 0x9074), (0x0008, 0x002a)];
/// Dates and times: of an acquisition, of an image.
const DATES_AND_TIMES: [[Tag; 2]; 2] = [[(0x0008, 0x0022), (0x0008, 0x0032)], [(0x0008, 0x0023), (0x0008, 0x0033)]];
/// Longest value that is compared, bytes.
const MAX_VALUE: usize = 256;

impl Attribute {
    pub(super) const ALL: [Self; 11] = [
        Self::Acquisition,
        Self::TemporalPosition,
        Self::CardiacPhase,
        Self::TriggerTime,
        Self::TimeOffset,
        Self::StackId,
        Self::Series,
        Self::Voltage,
        Self::Kernel,
        Self::Thickness,
        Self::ImageType,
    ];

    /// The attribute with its number; one that is text, and could name a patient, has only the number `rank` of its value.
    pub(super) fn describe(self, label: &Label, rank: usize) -> String {
        let number = label.number;
        match (self, number) {
            (Self::Acquisition, Some(n)) => format!("acquisition {n}"),
            (Self::TemporalPosition, Some(n)) => format!("temporal position {n}"),
            (Self::CardiacPhase, Some(n)) => format!("cardiac phase {n} %"),
            (Self::TriggerTime, Some(n)) => format!("trigger time {n} ms"),
            (Self::TimeOffset, Some(n)) => format!("time offset {n}"),
            (Self::Series, Some(n)) => format!("series number {n}"),
            (Self::Voltage, Some(n)) => format!("{n} kV"),
            (Self::Thickness, Some(n)) => format!("thickness {n} mm"),
            (Self::StackId, _) => format!("stack identifier no. {rank}"),
            (Self::Kernel, _) => format!("kernel no. {rank}"),
            (Self::ImageType, _) => format!("image type no. {rank}"),
            (_, None) => format!("another attribute, value no. {rank}"),
        }
    }
}

/// Value of an attribute; ordered by number, then by text. Kept only while files are read.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Label {
    pub(super) number: Option<f64>,
    text: Vec<u8>,
}

impl Eq for Label {}

impl PartialOrd for Label {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Label {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let number = |label: &Self| label.number.unwrap_or(f64::INFINITY);
        number(self).total_cmp(&number(other)).then_with(|| self.text.cmp(&other.text))
    }
}

/// Labels of one image.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Labels {
    values: Vec<(Attribute, Label)>,
    /// Time of the acquisition, s; only differences are used and shown.
    pub(super) time_s: Option<f64>,
    /// Number of the image in its series.
    pub(super) instance: Option<i64>,
    /// Identifier of the image.
    pub(super) identifier: Vec<u8>,
}

/// Whether [`Labels::read`] needs the tag.
pub(super) fn is_label(tag: Tag) -> bool {
    ATTRIBUTES.iter().any(|(_, t, _)| *t == tag)
        || [INSTANCE, SOP_INSTANCE].contains(&tag)
        || DATE_TIMES.contains(&tag)
        || DATES_AND_TIMES.as_flattened().contains(&tag)
}

impl Labels {
    /// The labels among the values that `bytes` returns by tag.
    pub(super) fn read<'a>(bytes: &dyn Fn(Tag) -> Option<&'a [u8]>, byte_order: ByteOrder) -> Self {
        let mut values: Vec<(Attribute, Label)> = Vec::new();
        for (attribute, tag, encoding) in ATTRIBUTES {
            let known = values.iter().any(|(a, _)| *a == attribute);
            if let Some(label) = bytes(tag).filter(|_| !known).and_then(|value| label(value, encoding, byte_order)) {
                values.push((attribute, label));
            }
        }
        let text = |tag| bytes(tag).and_then(trimmed);
        let joined = |[date, time]: [Tag; 2]| {
            let time = text(time)?;
            Some([text(date).unwrap_or("00000000"), time].concat())
        };
        let mut times = DATE_TIMES.into_iter().filter_map(|tag| text(tag).map(str::to_owned));
        let time = times.next().or_else(|| DATES_AND_TIMES.into_iter().find_map(joined));
        Self {
            values,
            time_s: time.as_deref().and_then(seconds),
            instance: text(INSTANCE).and_then(|t| t.parse().ok()),
            identifier: text(SOP_INSTANCE).unwrap_or_default().as_bytes().to_vec(),
        }
    }

    pub(super) fn get(&self, attribute: Attribute) -> Option<&Label> {
        self.values.iter().find(|(a, _)| *a == attribute).map(|(_, label)| label)
    }
}

fn trimmed(value: &[u8]) -> Option<&str> {
    let text = std::str::from_utf8(value.get(..value.len().min(MAX_VALUE))?).ok()?.trim_matches(['\0', ' ']);
    (!text.is_empty()).then_some(text)
}

fn label(value: &[u8], encoding: Encoding, order: ByteOrder) -> Option<Label> {
    let number = match encoding {
        Encoding::Text => {
            let value = value.get(..value.len().min(MAX_VALUE))?.trim_ascii();
            let number = trimmed(value).and_then(|t| t.parse().ok()).filter(|n: &f64| n.is_finite());
            return (!value.is_empty()).then(|| Label { number, text: value.to_vec() });
        }
        Encoding::Us => f64::from(order.u16(*value.first_chunk()?)),
        Encoding::Ul => f64::from(order.u32(*value.first_chunk()?)),
        Encoding::Fd => f64::from_bits(order.u64(*value.first_chunk()?)),
    };
    number.is_finite().then_some(Label { number: Some(number), text: Vec::new() })
}

/// Seconds since a fixed day of `YYYYMMDDHHMMSS.FFFFFF`, with at least the hour.
fn seconds(text: &str) -> Option<f64> {
    let part = |from: usize, to: usize| text.get(from..to)?.parse::<u32>().ok();
    let (year, month, day) = (part(0, 4)?, part(4, 6)?, part(6, 8)?);
    let clock = [part(8, 10)?, part(10, 12).unwrap_or(0)].map(f64::from);
    let end = text.bytes().skip(12).take_while(|c| c.is_ascii_digit() || *c == b'.').count().saturating_add(12);
    let second: f64 = text.get(12..end).and_then(|s| s.parse().ok()).unwrap_or(0.0);
    let time = clock[0] * 3600.0 + clock[1] * 60.0 + second;
    Some(days(year, month, day) * 86_400.0 + time)
}

/// Days since 1 March of the year 0 (Gregorian). Source: H. Hinnant, `days_from_civil`.
#[expect(clippy::arithmetic_side_effects, reason = "floating point, and small integers")]
fn days(year: u32, month: u32, day: u32) -> f64 {
    let month = month.clamp(1, 12);
    let y = if month <= 2 { f64::from(year) - 1.0 } else { f64::from(year) };
    let of_year = (153 * ((month + 9) % 12) + 2) / 5;
    (365.25 * y).floor() - (y / 100.0).floor() + (y / 400.0).floor() + f64::from(of_year) + f64::from(day)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_across_midnight_and_a_leap_day_have_their_difference() {
        let apart = |a: &str, b: &str| seconds(b).unwrap() - seconds(a).unwrap();
        assert!((apart("20240228235959.5", "20240229000001") - 1.5).abs() < 1e-6);
        assert!((apart("20240229235959", "20240301000000.25") - 1.25).abs() < 1e-6);
        assert_eq!(apart("00000000101500", "00000000101600"), 60.0);
        assert_eq!(seconds("2024"), None);
    }
}
