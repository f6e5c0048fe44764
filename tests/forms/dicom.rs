//! DICOM series as other devices write them.

use std::io::{Cursor, Write};

use prosopon_geometry::Volume;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// Byte order and naming of value types.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Syntax {
    Explicit,
    Implicit,
    Big,
}

impl Syntax {
    fn uid(self) -> &'static str {
        match self {
            Self::Implicit => "1.2.840.10008.1.2\0",
            Self::Explicit => "1.2.840.10008.1.2.1\0",
            Self::Big => "1.2.840.10008.1.2.2\0",
        }
    }
}

/// A series to write.
#[derive(Clone, Copy)]
pub(crate) struct Series {
    pub(crate) syntax: Syntax,
    /// Rescale slope of slice `k` is 1 or, where true, differs from slice to slice.
    pub(crate) slope_by_slice: bool,
    /// Decimal mark of numbers.
    pub(crate) comma: bool,
    pub(crate) reversed_files: bool,
}

pub(crate) const PLAIN: Series =
    Series { syntax: Syntax::Explicit, slope_by_slice: false, comma: false, reversed_files: false };

struct File {
    bytes: Vec<u8>,
    syntax: Syntax,
}

impl File {
    fn new(syntax: Syntax) -> Self {
        let mut file = Self { bytes: vec![0; 128], syntax: Syntax::Explicit };
        file.bytes.extend(b"DICM");
        let uid = syntax.uid();
        file.element([2, 0x10], b"UI", uid.as_bytes());
        file.syntax = syntax;
        file
    }

    fn u16(&mut self, value: u16) {
        self.bytes.extend(if self.syntax == Syntax::Big { value.to_be_bytes() } else { value.to_le_bytes() });
    }

    fn u32(&mut self, value: u32) {
        self.bytes.extend(if self.syntax == Syntax::Big { value.to_be_bytes() } else { value.to_le_bytes() });
    }

    fn element(&mut self, tag: [u16; 2], vr: &[u8; 2], value: &[u8]) {
        tag.iter().for_each(|t| self.u16(*t));
        let length = value.len() as u32;
        if self.syntax == Syntax::Implicit {
            self.u32(length);
        } else {
            self.bytes.extend(vr);
            if vr == b"OW" {
                self.bytes.extend([0; 2]);
                self.u32(length);
            } else {
                self.u16(length as u16);
            }
        }
        self.bytes.extend(value);
    }

    fn text(&mut self, tag: [u16; 2], vr: &[u8; 2], value: &str) {
        let padded = if value.len().is_multiple_of(2) { value.to_owned() } else { format!("{value} ") };
        self.element(tag, vr, padded.as_bytes());
    }

    fn short(&mut self, tag: [u16; 2], value: u16) {
        let bytes = if self.syntax == Syntax::Big { value.to_be_bytes() } else { value.to_le_bytes() };
        self.element(tag, b"US", &bytes);
    }
}

/// The files of a series with the volume's slices along its third axis.
fn files(volume: &Volume, series: Series) -> Vec<Vec<u8>> {
    let [columns, rows, slices] = volume.dims;
    let steps = volume.axes.map(|a| a.norm());
    let numbers = |values: &[f64]| {
        let text: Vec<String> = values.iter().map(|v| format!("{v:.6}")).collect();
        let text = text.join("\\");
        if series.comma { text.replace('.', ",") } else { text }
    };
    let along = |axis: usize| volume.axes[axis] / steps[axis];
    let orientation: Vec<f64> = along(0).iter().chain(along(1).iter()).copied().collect();
    let mut files: Vec<Vec<u8>> = (0..slices)
        .map(|k| {
            let mut file = File::new(series.syntax);
            let slope = if series.slope_by_slice { 1 + (k % 3) as i16 } else { 1 };
            let at = volume.origin + volume.axes[2] * k as f64;
            file.text([8, 0x60], b"CS", "CT");
            file.text([0x20, 0x0e], b"UI", "1.2.3.4");
            file.text([0x20, 0x13], b"IS", &(k + 1).to_string());
            file.text([0x20, 0x32], b"DS", &numbers(&[at.x, at.y, at.z]));
            file.text([0x20, 0x37], b"DS", &numbers(&orientation));
            file.short([0x28, 0x10], rows as u16);
            file.short([0x28, 0x11], columns as u16);
            file.text([0x28, 0x30], b"DS", &numbers(&[steps[1], steps[0]]));
            for (tag, value) in [(0x100, 16), (0x101, 16), (0x102, 15), (0x103, 1)] {
                file.short([0x28, tag], value);
            }
            file.text([0x28, 0x1052], b"DS", "0");
            file.text([0x28, 0x1053], b"DS", &slope.to_string());
            let slice = &volume.hu[k * rows * columns..(k + 1) * rows * columns];
            let big = series.syntax == Syntax::Big;
            let stored = slice.iter().map(|v| v / slope);
            let pixels: Vec<u8> = stored.flat_map(|v| if big { v.to_be_bytes() } else { v.to_le_bytes() }).collect();
            file.element([0x7fe0, 0x10], b"OW", &pixels);
            file.bytes
        })
        .collect();
    if series.reversed_files {
        files.reverse();
    }
    files
}

/// A zip archive of named files.
pub(crate) fn archive(files: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, file) in files {
        archive.start_file(name, SimpleFileOptions::default()).unwrap();
        archive.write_all(file).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

/// A zip archive of a series.
pub(crate) fn zipped(volume: &Volume, series: Series) -> Vec<u8> {
    let files = files(volume, series);
    archive(&files.into_iter().enumerate().map(|(k, file)| (format!("IM{k:04}"), file)).collect::<Vec<_>>())
}
