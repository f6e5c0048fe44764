//! Reads the header of one image: only the tags named here and in `labels`, which hold no patient data.

use super::FORMAT;
use super::decimals::{self, Unread};
use super::elements::{DataSet, Elements, PIXEL_DATA, Tag, Value};
use super::labels::{Labels, is_label};
use super::syntax::Syntax;
use crate::import::ImportError;
use crate::import::error::malformed;
use crate::import::number::ByteOrder;
use prosopon_geometry::{Point, Vector};

const IMAGE_TYPE: Tag = (0x0008, 0x0008);
const MODALITY: Tag = (0x0008, 0x0060);
const SERIES: Tag = (0x0020, 0x000e);
const POSITION: Tag = (0x0020, 0x0032);
const ORIENTATION: Tag = (0x0020, 0x0037);
const SAMPLES: Tag = (0x0028, 0x0002);
const FRAMES: Tag = (0x0028, 0x0008);
const ROWS: Tag = (0x0028, 0x0010);
const COLUMNS: Tag = (0x0028, 0x0011);
const SPACING: Tag = (0x0028, 0x0030);
const BITS_ALLOCATED: Tag = (0x0028, 0x0100);
const BITS_STORED: Tag = (0x0028, 0x0101);
const HIGH_BIT: Tag = (0x0028, 0x0102);
const REPRESENTATION: Tag = (0x0028, 0x0103);
const PADDING: Tag = (0x0028, 0x0120);
const PADDING_LIMIT: Tag = (0x0028, 0x0121);
const INTERCEPT: Tag = (0x0028, 0x1052);
const SLOPE: Tag = (0x0028, 0x1053);
const RESCALE_TYPE: Tag = (0x0028, 0x1054);
const LOSSY: Tag = (0x0028, 0x2110);
/// Sequences of an enhanced image: fields that all frames share, and fields of each frame.
const SHARED_GROUPS: Tag = (0x5200, 0x9229);
const FRAME_GROUPS: Tag = (0x5200, 0x9230);
/// Functional groups that are read: pixel measures, plane position, plane orientation, rescaling, and those with labels: content,
/// cardiac phase, temporal position, reconstruction, X-ray details, image type.
const GROUPS: [Tag; 10] = [
    (0x0028, 0x9110),
    (0x0020, 0x9113),
    (0x0020, 0x9116),
    (0x0028, 0x9145),
    (0x0020, 0x9111),
    (0x0018, 0x9118),
    (0x0020, 0x9310),
    (0x0018, 0x9314),
    (0x0018, 0x9325),
    (0x0018, 0x9329),
];
/// Most frames of one file.
const MAX_FRAMES: usize = 4096;

/// Position of the stored numbers in their words, and their scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PixelEncoding {
    pub(super) bits_allocated: u16,
    pub(super) bits_stored: u16,
    pub(super) high_bit: u16,
    pub(super) signed: bool,
    /// Stored numbers that mark pixels without a measurement.
    pub(super) padding: Option<StoredRange>,
    /// The whole word that marks such pixels, when it is one value; it may exceed the stored bits.
    pub(super) padding_word: Option<u16>,
    /// What the header says about the scale.
    pub(super) rescale: Rescale,
    /// HU per stored number.
    pub(super) slope: f64,
    /// HU of the stored number zero.
    pub(super) intercept: f64,
}

/// What the header says about the scale of the stored numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rescale {
    /// Slope and intercept, to HU as far as the header says.
    Hounsfield,
    /// Slope and intercept, to other values than HU.
    Other,
    /// No slope or no intercept.
    Missing,
}

/// Range of stored numbers, both ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct StoredRange {
    pub(super) min: i32,
    pub(super) max: i32,
}

/// Index of a frame in its file, from 0, and number of frames in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FrameIndex {
    pub(super) index: usize,
    pub(super) n_frames: usize,
}

/// Position and orientation of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ImagePlane {
    /// Centre of the first pixel, LPS mm.
    pub(super) origin: Point,
    /// Unit vector along a row, to the next column.
    pub(super) along_row: Vector,
    /// Unit vector down a column, to the next row.
    pub(super) along_column: Vector,
    /// Distance between columns, distance between rows, mm.
    pub(super) spacing: [f64; 2],
}

/// Header of one image, or of one frame of an enhanced image.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::import) struct Header {
    pub(super) syntax: Syntax,
    /// SeriesInstanceUID; kept only while files are read.
    pub(super) series: Vec<u8>,
    pub(super) modality: [u8; 2],
    /// Whether this is a localizer, a survey image for planning the scan.
    pub(super) localizer: bool,
    /// Number of frames without their own position; 1 for a plain image and for a frame of an enhanced image.
    pub(super) frames: u32,
    pub(super) frame: FrameIndex,
    pub(super) samples: u16,
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) plane: Option<ImagePlane>,
    pub(super) encoding: PixelEncoding,
    pub(super) lossy: bool,
    /// What tells the image from others at its position.
    pub(super) labels: Labels,
    /// Attributes whose numbers have commas for decimal points.
    pub(super) commas: Vec<&'static str>,
}

/// Headers and pixels of a data set.
#[derive(Debug)]
pub(super) struct Images<'a> {
    /// One header for each frame of an enhanced image, else one.
    pub(super) headers: Vec<Header>,
    pub(super) pixels: Value<'a>,
}

/// The images of a data set; `None` when it holds none.
pub(super) fn read<'a>(set: &'a DataSet<'_>) -> Result<Option<Images<'a>>, ImportError> {
    let mut found = Fields::default();
    let (mut shared, mut own) = (Fields::default(), Vec::new());
    let mut elements = set.elements();
    while let Some((tag, value)) = elements.next()? {
        if tag == PIXEL_DATA {
            return Ok(Some(Images { headers: frames(found, &shared, own, set.syntax)?, pixels: value }));
        }
        let sequence = |value: Value<'a>| match value {
            Value::Sequence(inside) => inside,
            Value::Bytes(bytes) => elements.over(bytes),
            Value::Fragments(_) => elements.over(&[]),
        };
        match (tag, value) {
            (SHARED_GROUPS, value) => {
                for item in sequence(value).items(1)? {
                    shared.keep_groups(item)?;
                }
            }
            (FRAME_GROUPS, value) => {
                for item in sequence(value).items(MAX_FRAMES)? {
                    let mut fields = Fields::default();
                    fields.keep_groups(item)?;
                    own.push(fields);
                }
            }
            (tag, Value::Bytes(bytes)) => found.keep(tag, bytes),
            _ => {}
        }
    }
    Ok(None)
}

/// One header for a plain image, or one for each frame with its own fields.
fn frames<'a>(
    top: Fields<'a>,
    shared: &Fields<'a>,
    own: Vec<Fields<'a>>,
    syntax: Syntax,
) -> Result<Vec<Header>, ImportError> {
    let n = own.len();
    let plain = top.header(syntax)?;
    if n == 0 || usize::try_from(plain.frames) != Ok(n) {
        return Ok(vec![plain]);
    }
    let of = |(index, fields): (usize, Fields<'a>)| {
        // The first value of a tag counts: fields of the frame come before those that all frames share.
        let mut all = fields.0;
        all.extend(shared.0.iter().chain(&top.0).copied());
        Ok(Header { frames: 1, frame: FrameIndex { index, n_frames: n }, ..Fields(all).header(syntax)? })
    };
    own.into_iter().enumerate().map(of).collect()
}

/// Values of the tags that are read.
#[derive(Default)]
struct Fields<'a>(Vec<(Tag, &'a [u8])>);

impl<'a> Fields<'a> {
    fn keep(&mut self, tag: Tag, bytes: &'a [u8]) {
        const KEPT: [Tag; 20] = [
            IMAGE_TYPE,
            MODALITY,
            SERIES,
            POSITION,
            ORIENTATION,
            SAMPLES,
            FRAMES,
            ROWS,
            COLUMNS,
            SPACING,
            BITS_ALLOCATED,
            BITS_STORED,
            HIGH_BIT,
            REPRESENTATION,
            PADDING,
            PADDING_LIMIT,
            INTERCEPT,
            SLOPE,
            RESCALE_TYPE,
            LOSSY,
        ];
        if KEPT.contains(&tag) || is_label(tag) {
            self.0.push((tag, bytes));
        }
    }

    /// Keeps the fields in the functional groups of an item.
    fn keep_groups(&mut self, mut item: Elements<'a>) -> Result<(), ImportError> {
        while let Some((tag, value)) = item.next()? {
            if !GROUPS.contains(&tag) {
                continue;
            }
            let inside = match value {
                Value::Sequence(inside) => inside,
                Value::Bytes(bytes) => item.over(bytes),
                Value::Fragments(_) => continue,
            };
            for mut group in inside.items(1)? {
                while let Some((tag, value)) = group.next()? {
                    if let Value::Bytes(bytes) = value {
                        self.keep(tag, bytes);
                    }
                }
            }
        }
        Ok(())
    }

    fn bytes(&self, tag: Tag) -> Option<&'a [u8]> {
        self.0.iter().find(|(t, _)| *t == tag).map(|(_, bytes)| *bytes)
    }

    fn number(&self, tag: Tag, byte_order: ByteOrder) -> Option<u16> {
        Some(byte_order.u16(*self.bytes(tag)?.first_chunk::<2>()?))
    }

    /// The decimals of an attribute, which has `expected`; `None` when the tag is absent or empty.
    fn decimals(
        &self,
        tag: Tag,
        (name, expected): (&'static str, usize),
        commas: &mut Vec<&'static str>,
    ) -> Result<Option<Vec<f64>>, ImportError> {
        let Some(bytes) = self.bytes(tag).map(|b| b.trim_ascii()).filter(|b| !b.is_empty() && *b != b"\0") else {
            return Ok(None);
        };
        let found = decimals::read(bytes, expected, tag == INTERCEPT).map_err(|unread| {
            let detail = match unread {
                Unread::NotNumbers => format!("{name} is not made of finite numbers"),
                Unread::Doubtful => format!(
                    "{name} has commas, and it is in doubt which of them are decimal points: export it with points"
                ),
            };
            malformed(FORMAT, detail)
        })?;
        if found.had_commas {
            commas.push(name);
        }
        Ok(Some(found.values))
    }

    fn one_decimal(
        &self,
        tag: Tag,
        name: &'static str,
        commas: &mut Vec<&'static str>,
    ) -> Result<Option<f64>, ImportError> {
        Ok(self.decimals(tag, (name, 1), commas)?.and_then(|v| v.first().copied()))
    }

    fn header(&self, syntax: Syntax) -> Result<Header, ImportError> {
        let byte_order = syntax.byte_order;
        let need = |tag, name: &str| {
            self.number(tag, byte_order).ok_or_else(|| malformed(FORMAT, format!("there is no {name}")))
        };
        let (columns, rows) = (need(COLUMNS, "number of columns")?, need(ROWS, "number of rows")?);
        if columns == 0 || rows == 0 {
            return Err(malformed(FORMAT, format!("{columns} x {rows} pixels, expected at least 1 x 1")));
        }
        let frames =
            self.bytes(FRAMES).and_then(|b| std::str::from_utf8(b).ok()?.trim_matches(['\0', ' ']).parse().ok());
        let modality = self.bytes(MODALITY).and_then(|b| b.first_chunk::<2>().copied()).unwrap_or(*b"??");
        let localizer =
            self.bytes(IMAGE_TYPE).is_some_and(|b| b.split(|c| *c == b'\\').any(|w| w.trim_ascii() == b"LOCALIZER"));
        let mut commas = Vec::new();
        let (plane, encoding) = (self.plane(&mut commas)?, self.encoding(byte_order, &mut commas)?);
        Ok(Header {
            syntax,
            series: self
                .bytes(SERIES)
                .unwrap_or_default()
                .trim_ascii_end()
                .iter()
                .copied()
                .filter(|b| *b != 0)
                .collect(),
            modality: if modality.iter().all(u8::is_ascii_uppercase) { modality } else { *b"??" },
            localizer,
            frames: frames.unwrap_or(1),
            frame: FrameIndex { index: 0, n_frames: 1 },
            samples: self.number(SAMPLES, byte_order).unwrap_or(1),
            columns: usize::from(columns),
            rows: usize::from(rows),
            plane,
            encoding,
            lossy: self.bytes(LOSSY).is_some_and(|b| b.starts_with(b"01")),
            labels: Labels::read(&|tag| self.bytes(tag), byte_order),
            commas,
        })
    }

    fn encoding(&self, byte_order: ByteOrder, commas: &mut Vec<&'static str>) -> Result<PixelEncoding, ImportError> {
        let bits_allocated = self.number(BITS_ALLOCATED, byte_order).unwrap_or(16);
        let bits_stored = self.number(BITS_STORED, byte_order).unwrap_or(bits_allocated);
        let high_bit = self.number(HIGH_BIT, byte_order).unwrap_or(bits_stored.saturating_sub(1));
        let signed = self.number(REPRESENTATION, byte_order).unwrap_or(0) == 1;
        let fits = matches!(bits_allocated, 8 | 16)
            && (1..=bits_allocated).contains(&bits_stored)
            && high_bit < bits_allocated
            && high_bit.saturating_add(1) >= bits_stored;
        if !fits {
            let detail = format!(
                "{bits_allocated} bits a pixel, {bits_stored} stored up to bit {high_bit}; expected 8 or 16 bits that hold them"
            );
            return Err(malformed(FORMAT, detail));
        }
        let slope = self.one_decimal(SLOPE, "the rescale slope", commas)?;
        let intercept = self.one_decimal(INTERCEPT, "the rescale intercept", commas)?;
        let unit = self.bytes(RESCALE_TYPE).map(|b| b.trim_ascii()).filter(|b| !b.is_empty() && *b != b"\0");
        let rescale = match (slope, intercept) {
            (Some(_), Some(_)) if unit.is_none_or(|unit| unit == b"HU") => Rescale::Hounsfield,
            (Some(_), Some(_)) => Rescale::Other,
            _ => Rescale::Missing,
        };
        let (slope, intercept) = (slope.unwrap_or(1.0), intercept.unwrap_or(0.0));
        if slope == 0.0 {
            return Err(malformed(FORMAT, "the rescale slope is 0"));
        }
        let stored =
            |tag| self.number(tag, byte_order).map(|v| if signed { i32::from(v as i16) } else { i32::from(v) });
        let padding = stored(PADDING).map(|value| {
            let limit = stored(PADDING_LIMIT).unwrap_or(value);
            StoredRange { min: value.min(limit), max: value.max(limit) }
        });
        let padding_word = self.number(PADDING, byte_order).filter(|_| padding.is_some_and(|p| p.min == p.max));
        Ok(PixelEncoding {
            bits_allocated,
            bits_stored,
            high_bit,
            signed,
            padding,
            padding_word,
            rescale,
            slope,
            intercept,
        })
    }

    fn plane(&self, commas: &mut Vec<&'static str>) -> Result<Option<ImagePlane>, ImportError> {
        let (position, orientation, spacing) = (
            self.decimals(POSITION, ("the image position", 3), commas)?,
            self.decimals(ORIENTATION, ("the image orientation", 6), commas)?,
            self.decimals(SPACING, ("the pixel spacing", 2), commas)?,
        );
        let (Some(position), Some(orientation), Some(spacing)) = (position, orientation, spacing) else {
            return Ok(None);
        };
        let (&[px, py, pz], &[ax, ay, az, bx, by, bz], &[between_rows, between_columns]) =
            (position.as_slice(), orientation.as_slice(), spacing.as_slice())
        else {
            let detail = "image position, orientation and pixel spacing need 3, 6 and 2 numbers";
            return Err(malformed(FORMAT, detail));
        };
        let (a, b) = (Vector::new(ax, ay, az), Vector::new(bx, by, bz));
        let unit = |v: &Vector| (v.norm() - 1.0).abs() < 1e-2;
        if !(unit(&a) && unit(&b) && a.dot(&b).abs() < 1e-2) {
            return Err(malformed(
                FORMAT,
                "rows and columns of the image orientation are not unit vectors at right angles",
            ));
        }
        if !(between_rows > 0.0 && between_columns > 0.0) {
            return Err(malformed(FORMAT, "the pixel spacing is not positive"));
        }
        Ok(Some(ImagePlane {
            origin: Point::new(px, py, pz),
            along_row: a.normalize(),
            along_column: b.normalize(),
            spacing: [between_columns, between_rows],
        }))
    }
}
