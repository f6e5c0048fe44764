mod doubtful;
mod enhanced;
mod phases;
mod values;

use std::io::{Cursor, Write};

use flate2::Compression;
use flate2::write::DeflateEncoder;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use crate::import::{ImportError, Limits, SeriesChoice, VolumeFormat, VolumeRead, VolumeSettings, volume, volume_with};
use prosopon_geometry::{Point, Severity, Vector, Warning};

const COLUMNS: usize = 12;
const ROWS: usize = 10;
const IMPLICIT: &str = "1.2.840.10008.1.2";
const EXPLICIT: &str = "1.2.840.10008.1.2.1";
const DEFLATED: &str = "1.2.840.10008.1.2.1.99";
const BIG: &str = "1.2.840.10008.1.2.2";
const RLE: &str = "1.2.840.10008.1.2.5";
const JPEG_LS: &str = "1.2.840.10008.1.2.4.80";
const JPEG_2000: &str = "1.2.840.10008.1.2.4.90";
const READ: [&str; 7] = [IMPLICIT, EXPLICIT, DEFLATED, BIG, RLE, JPEG_LS, JPEG_2000];

/// Builder of one image.
#[derive(Clone)]
pub(in crate::import) struct Slice {
    syntax: &'static str,
    series: &'static str,
    modality: &'static str,
    kind: &'static str,
    position: [f64; 3],
    orientation: [f64; 6],
    signed: bool,
    bits: (u16, u16),
    slope: f64,
    intercept: f64,
    padding: Option<i16>,
    frames: u16,
    /// Stored numbers.
    pixels: Vec<i32>,
    /// Without the 128 bytes, `DICM` and meta information.
    bare: bool,
    /// Further elements that hold text.
    extra: Vec<((u16, u16), String)>,
    /// Whether slope and intercept are written.
    rescaled: bool,
    /// What stands for the point of decimals.
    point: &'static str,
}

impl Slice {
    /// Slice `k` of a stack with steps of 20 mm, with air, tissue and bone.
    pub(in crate::import) fn new(k: usize, syntax: &'static str) -> Self {
        let hu = |i: usize| ((i * 37 + k * 101) % 2800) as i32 - 1000;
        Self {
            syntax,
            series: "1.2.3",
            modality: "CT",
            kind: "ORIGINAL\\PRIMARY\\AXIAL",
            position: [-50.0, -40.0, 20.0 * k as f64],
            orientation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            signed: true,
            bits: (16, 15),
            slope: 1.0,
            intercept: 0.0,
            padding: None,
            frames: 1,
            pixels: (0..COLUMNS * ROWS).map(hu).collect(),
            bare: false,
            extra: Vec::new(),
            rescaled: true,
            point: ".",
        }
    }

    /// The same with another element that holds text.
    fn with(mut self, tag: (u16, u16), text: impl ToString) -> Self {
        self.extra.push((tag, text.to_string()));
        self
    }

    /// As [`Slice::new`], with steps of 4 mm.
    pub(in crate::import) fn near(k: usize, syntax: &'static str) -> Self {
        Self { position: [-50.0, -40.0, 4.0 * k as f64], ..Self::new(k, syntax) }
    }

    fn expected(&self) -> Vec<i16> {
        self.pixels.iter().map(|p| (self.slope * f64::from(*p) + self.intercept).round() as i16).collect()
    }

    pub(in crate::import) fn file(&self) -> Vec<u8> {
        let explicit = self.syntax != IMPLICIT;
        let mut set = Writer { bytes: Vec::new(), explicit, little: self.syntax != BIG };
        let text = |values: &[f64]| {
            let words: Vec<String> = values.iter().map(|v| v.to_string().replace('.', self.point)).collect();
            words.join("\\")
        };
        set.text((8, 8), b"CS", self.kind);
        set.text((8, 0x60), b"CS", self.modality);
        set.text((0x10, 0x10), b"PN", "NAME^OF PATIENT");
        set.sequence();
        set.text((0x20, 0x0e), b"UI", self.series);
        set.text((0x20, 0x32), b"DS", &text(&self.position));
        set.text((0x20, 0x37), b"DS", &text(&self.orientation));
        set.number((0x28, 2), 1);
        set.text((0x28, 8), b"IS", &self.frames.to_string());
        set.number((0x28, 0x10), ROWS as u16);
        set.number((0x28, 0x11), COLUMNS as u16);
        set.text((0x28, 0x30), b"DS", "8\\10");
        set.number((0x28, 0x100), self.bits.0);
        set.number((0x28, 0x101), self.bits.1 + 1);
        set.number((0x28, 0x102), self.bits.1);
        set.number((0x28, 0x103), u16::from(self.signed));
        if let Some(padding) = self.padding {
            set.number((0x28, 0x120), padding as u16);
        }
        if self.rescaled {
            set.text((0x28, 0x1052), b"DS", &text(&[self.intercept]));
            set.text((0x28, 0x1053), b"DS", &text(&[self.slope]));
        }
        for (tag, text) in &self.extra {
            set.text(*tag, b"LO", text);
        }
        self.put_pixels(&mut set);
        let set = set.bytes;
        if self.bare {
            return set;
        }
        let mut meta = Writer { bytes: Vec::new(), explicit: true, little: true };
        meta.text((2, 0x10), b"UI", self.syntax);
        let mut file = vec![0; 128];
        file.extend(b"DICM");
        file.extend(meta.bytes);
        if self.syntax == DEFLATED {
            let mut packer = DeflateEncoder::new(file, Compression::fast());
            packer.write_all(&set).unwrap();
            packer.finish().unwrap()
        } else {
            [file, set].concat()
        }
    }

    fn put_pixels(&self, set: &mut Writer) {
        let words: Vec<u16> = self.pixels.iter().map(|p| *p as u16).collect();
        let little: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        let packed = match self.syntax {
            RLE => rle(&words),
            JPEG_LS => jpegls_encode(&words),
            JPEG_2000 => {
                let options =
                    dicom_toolkit_jpeg2000::EncodeOptions { num_decomposition_levels: 1, ..Default::default() };
                let (w, h) = (COLUMNS as u32, ROWS as u32);
                dicom_toolkit_jpeg2000::encode(&little, w, h, 1, 16, self.signed, &options).unwrap()
            }
            BIG => {
                return set.bytes(
                    (0x7fe0, 0x10),
                    b"OW",
                    &words.iter().flat_map(|w| w.to_be_bytes()).collect::<Vec<u8>>(),
                );
            }
            _ => return set.bytes((0x7fe0, 0x10), b"OW", &little),
        };
        set.tag((0x7fe0, 0x10));
        set.bytes.extend(b"OB\0\0");
        set.bytes.extend(u32::MAX.to_le_bytes());
        // An offset table, two fragments and the end.
        let half = packed.len() / 2;
        for item in [&[][..], &packed[..half], &packed[half..]] {
            set.tag((0xfffe, 0xe000));
            set.bytes.extend((item.len() as u32).to_le_bytes());
            set.bytes.extend(item);
        }
        set.tag((0xfffe, 0xe0dd));
        set.bytes.extend([0; 4]);
    }
}

fn jpegls_encode(words: &[u16]) -> Vec<u8> {
    let mut options = jpegls::EncodeOptions::default();
    options.precision = Some(16);
    let mut packed = Vec::new();
    jpegls::encode_with_options(words, COLUMNS as u32, ROWS as u32, &options, &mut packed).unwrap();
    packed
}

/// Two planes of literal and repeated runs.
fn rle(words: &[u16]) -> Vec<u8> {
    let plane = |shift: u16| {
        let bytes: Vec<u8> = words.iter().map(|w| (w >> shift) as u8).collect();
        let mut packed = Vec::new();
        let mut rest = bytes.as_slice();
        while let Some(first) = rest.first() {
            let run = rest.iter().take(128).take_while(|b| *b == first).count();
            if run > 2 {
                packed.extend([(257 - run) as u8, *first]);
                rest = &rest[run..];
            } else {
                packed.extend([0, *first]);
                rest = &rest[1..];
            }
        }
        packed
    };
    let (high, low) = (plane(8), plane(0));
    let mut file: Vec<u8> = [2, 64, 64 + high.len() as u32].iter().flat_map(|n| n.to_le_bytes()).collect();
    file.resize(64, 0);
    [file, high, low].concat()
}

struct Writer {
    bytes: Vec<u8>,
    explicit: bool,
    little: bool,
}

impl Writer {
    fn u16(&mut self, value: u16) {
        self.bytes.extend(if self.little { value.to_le_bytes() } else { value.to_be_bytes() });
    }

    fn u32(&mut self, value: u32) {
        self.bytes.extend(if self.little { value.to_le_bytes() } else { value.to_be_bytes() });
    }

    fn tag(&mut self, tag: (u16, u16)) {
        self.u16(tag.0);
        self.u16(tag.1);
    }

    fn bytes(&mut self, tag: (u16, u16), vr: &[u8; 2], value: &[u8]) {
        self.tag(tag);
        let length = value.len().next_multiple_of(2);
        match (self.explicit, vr) {
            (false, _) => self.u32(length as u32),
            (true, b"OW") => {
                self.bytes.extend(vr);
                self.u16(0);
                self.u32(length as u32);
            }
            (true, _) => {
                self.bytes.extend(vr);
                self.u16(length as u16);
            }
        }
        self.bytes.extend(value);
        self.bytes.resize(self.bytes.len() + length - value.len(), if vr == b"UI" { 0 } else { b' ' });
    }

    fn text(&mut self, tag: (u16, u16), vr: &[u8; 2], value: &str) {
        self.bytes(tag, vr, value.as_bytes());
    }

    fn number(&mut self, tag: (u16, u16), value: u16) {
        let bytes = if self.little { value.to_le_bytes() } else { value.to_be_bytes() };
        self.bytes(tag, b"US", &bytes);
    }

    /// A sequence of undefined length with an item of undefined length that holds the rows and pixels of an icon.
    fn sequence(&mut self) {
        self.tag((0x88, 0x200));
        if self.explicit {
            self.bytes.extend(b"SQ\0\0");
        }
        self.u32(u32::MAX);
        self.tag((0xfffe, 0xe000));
        self.u32(u32::MAX);
        self.number((0x28, 0x10), 99);
        self.bytes((0x7fe0, 0x10), b"OW", &[1, 2, 3, 4]);
        self.tag((0xfffe, 0xe00d));
        self.u32(0);
        self.tag((0xfffe, 0xe0dd));
        self.u32(0);
    }
}

/// A zip archive of files.
pub(in crate::import) fn archive(files: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (at, (name, bytes)) in files.iter().enumerate() {
        let method = if at % 2 == 0 { CompressionMethod::Stored } else { CompressionMethod::Deflated };
        archive.start_file(name.as_str(), SimpleFileOptions::default().compression_method(method)).unwrap();
        archive.write_all(bytes).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

/// The slices in an archive, in a shuffled order, with other files that are not images.
pub(in crate::import) fn series(slices: &[Slice]) -> Vec<u8> {
    let mut files = vec![("disc/README.txt".to_owned(), b"NAME^OF PATIENT".to_vec())];
    for at in 0..slices.len() {
        let scrambled = (at * 97 + 2) % slices.len();
        files.push((format!("disc/{scrambled}"), slices[scrambled].file()));
    }
    archive(&files)
}

fn stack(syntax: &'static str) -> Vec<Slice> {
    (0..7).map(|k| Slice::new(k, syntax)).collect()
}

fn read(slices: &[Slice]) -> Result<VolumeRead, ImportError> {
    volume_with(&series(slices), &Limits::default(), &VolumeSettings { max_step_mm: 50.0, ..Default::default() })
}

fn refused(slices: &[Slice]) -> String {
    read(slices).unwrap_err().to_string()
}

#[test]
fn every_encoding_gives_the_same_volume() {
    let expected: Vec<i16> = stack(IMPLICIT).iter().flat_map(Slice::expected).collect();
    let mixed: Vec<Slice> = (0..7).map(|k| Slice::new(k, READ[k])).collect();
    for slices in READ.map(stack).into_iter().chain([mixed]) {
        let VolumeRead { volume, format, series, warnings } = read(&slices).unwrap();
        assert_eq!((format, series), (VolumeFormat::Dicom, None));
        assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["files-skipped"]);
        assert_eq!((volume.dims, volume.origin), ([COLUMNS, ROWS, 7], Point::new(-50.0, -40.0, 0.0)));
        assert_eq!(volume.axes, [Vector::x() * 10.0, Vector::y() * 8.0, Vector::z() * 20.0]);
        assert!(volume.hu == expected, "{}", slices[0].syntax);
    }
    // Without preamble and meta information, and as one file alone.
    for syntax in [IMPLICIT, EXPLICIT] {
        let bare: Vec<Slice> = stack(syntax).into_iter().map(|s| Slice { bare: true, ..s }).collect();
        assert_eq!(read(&bare).unwrap().volume.hu, expected);
        assert_eq!(volume(&bare[0].file(), &Limits::default()).unwrap().0.hu, expected[..COLUMNS * ROWS]);
    }
}

#[test]
fn unsigned_scaled_padded_and_shifted_numbers_become_hu() {
    for syntax in [EXPLICIT, BIG, RLE, JPEG_LS, JPEG_2000] {
        // Each slice with its own scale: 12 bits, unsigned, air at 24, padding at 0.
        let slices: Vec<Slice> = (0..5)
            .map(|k| {
                let mut slice = Slice { signed: false, bits: (16, 11), padding: Some(0), ..Slice::new(k, syntax) };
                slice.slope = 0.5 + k as f64;
                slice.intercept = -1024.0;
                slice.pixels.iter_mut().for_each(|p| *p = (*p + 1000) % 4096);
                slice
            })
            .collect();
        let found = read(&slices).unwrap();
        let expected: Vec<i16> = slices.iter().flat_map(Slice::expected).collect();
        assert!(found.volume.hu == expected, "{syntax}");
        let n = slices.iter().flat_map(|s| &s.pixels).filter(|p| **p == 0).count();
        let padding = found.warnings.iter().find(|w| w.code == "padding-set-to-air").unwrap();
        assert!(padding.severity == Severity::Info && padding.message.starts_with(&format!("{n} pixels")), "{padding}");
    }
    // The sign is in bit 11; the bits above it are not part of the number.
    let mut slices = stack(EXPLICIT);
    let expected: Vec<i16> = slices.iter().flat_map(Slice::expected).map(|v| v.clamp(-2048, 2047)).collect();
    for slice in &mut slices {
        slice.bits = (16, 11);
        slice.pixels.iter_mut().for_each(|p| *p = (*p).clamp(-2048, 2047) & 0xfff | 0x5000);
    }
    assert_eq!(read(&slices).unwrap().volume.hu, expected);
    // A padding value that tissue has too is not used.
    let doubtful: Vec<Slice> =
        stack(EXPLICIT).into_iter().map(|s| Slice { padding: Some(s.pixels[40] as i16), ..s }).collect();
    let tissue: Vec<Slice> = doubtful.into_iter().filter(|s| s.pixels[40] > -400).collect();
    let found = read(&tissue[..2]).unwrap();
    assert_eq!(found.volume.hu, tissue[..2].iter().flat_map(Slice::expected).collect::<Vec<_>>());
    assert!(found.warnings.iter().any(|w| w.code == "padding-in-tissue"), "{:?}", found.warnings);
}

#[test]
fn oblique_and_tilted_stacks_stay_where_they_lie() {
    let turn = nalgebra::Rotation3::from_euler_angles(0.35, -0.2, 0.6);
    let [a, b, n] = [Vector::x(), Vector::y(), Vector::z()].map(|v| turn * v);
    for (step, tilt) in [(n * 20.0, None), (n * 20.0 + b * 6.0, Some("tilted by 16.7°"))] {
        let mut slices = stack(EXPLICIT);
        for (k, slice) in slices.iter_mut().enumerate() {
            slice.orientation = [a.x, a.y, a.z, b.x, b.y, b.z];
            let origin = Point::new(3.0, -5.0, 8.0) + step * k as f64;
            slice.position = [origin.x, origin.y, origin.z];
        }
        // From the last to the first: the volume begins where the normal does.
        slices.reverse();
        let found = read(&slices).unwrap();
        assert!((found.volume.origin - Point::new(3.0, -5.0, 8.0)).norm() < 1e-9);
        for (axis, expected) in found.volume.axes.iter().zip([a * 10.0, b * 8.0, step]) {
            assert!((axis - expected).norm() < 1e-9, "{axis}");
        }
        assert_eq!(found.volume.hu, (0..7).flat_map(|k| Slice::new(k, EXPLICIT).expected()).collect::<Vec<_>>());
        let tilted = found.warnings.iter().find(|w| w.code == "tilted-slices");
        assert_eq!(tilted.is_some(), tilt.is_some(), "{:?}", found.warnings);
        assert!(tilted.zip(tilt).is_none_or(|(found, tilt)| found.message.contains(tilt)), "{tilted:?}");
    }
}

#[test]
fn missing_uneven_and_duplicate_slices_are_mended_with_a_warning_or_refused() {
    let planes = |slices: &[Slice]| slices.iter().map(Slice::expected).collect::<Vec<_>>();
    // One slice is missing: the mean of its neighbours.
    let mut slices = stack(EXPLICIT);
    let whole = planes(&slices);
    slices.remove(3);
    let found = read(&slices).unwrap();
    assert_eq!(found.volume.dims[2], 7);
    for (k, plane) in found.volume.hu.chunks(COLUMNS * ROWS).enumerate() {
        let mean = |at: usize| (f64::from(whole[2][at]) * 0.5 + f64::from(whole[4][at]) * 0.5).round() as i16;
        let expected: Vec<i16> = if k == 3 { (0..plane.len()).map(mean).collect() } else { whole[k].clone() };
        assert_eq!(plane, expected, "slice {k}");
    }
    assert!(
        found.warnings.iter().any(|w| w.code == "uneven-slices" && w.message.contains("1 slices are missing")),
        "{:?}",
        found.warnings
    );

    // Steps of 20 and 30 mm: a lattice of 20, exact for what is linear along the steps.
    let mut uneven = stack(EXPLICIT);
    for (slice, z) in uneven.iter_mut().zip([0.0, 20.0, 50.0, 80.0, 100.0, 130.0, 160.0]) {
        slice.position[2] = z;
        slice.pixels = vec![(z * 10.0) as i32 - 1000; COLUMNS * ROWS];
    }
    let found = read(&uneven).unwrap();
    assert_eq!((found.volume.dims[2], found.volume.axes[2]), (9, Vector::z() * 20.0));
    for (k, plane) in found.volume.hu.chunks(COLUMNS * ROWS).enumerate() {
        assert!(plane.iter().all(|v| *v == 200 * k as i16 - 1000), "slice {k}: {}", plane[0]);
    }
    assert!(
        found.warnings.iter().any(|w| w.code == "uneven-slices" && w.message.contains("20.00 to 30.00 mm")),
        "{:?}",
        found.warnings
    );
    // Too far apart to interpolate: refused with a list of all steps.
    let far = volume_with(&series(&uneven), &Limits::default(), &VolumeSettings::default()).unwrap_err().to_string();
    assert!(far.contains("Steps in mm: 20.00, 30.00, 30.00, 20.00, 30.00, 30.00"), "{far}");

    // A duplicate of an image is dropped; another image at the same position is an error.
    let mut twice = stack(EXPLICIT);
    twice.push(Slice { syntax: RLE, ..twice[4].clone() });
    let found = read(&twice).unwrap();
    assert_eq!(planes(&stack(EXPLICIT)).concat(), found.volume.hu);
    assert!(found.warnings.iter().any(|w| w.code == "duplicate-images" && w.severity == Severity::Info));
    twice[7].pixels[5] += 1;
    assert!(refused(&twice).contains("two different images lie at one position"));
    // Slices that are displaced sideways do not form a stack.
    let mut sideways = stack(EXPLICIT);
    sideways[3].position[0] += 9.0;
    assert!(refused(&sideways).contains("off a straight line"));
}

#[test]
fn the_right_series_is_taken() {
    let named = |series: &'static str, modality: &'static str, n: usize| {
        (0..n).map(move |k| Slice { series, modality, ..Slice::new(k, EXPLICIT) })
    };
    let mut slices: Vec<Slice> =
        named("1.9", "CT", 4).chain(named("1.2", "MR", 9)).chain(named("1.5", "CT", 6)).collect();
    // A localizer and an image of another size in the chosen series.
    slices.push(Slice { kind: "ORIGINAL\\PRIMARY\\LOCALIZER", series: "1.5", ..Slice::new(20, EXPLICIT) });
    let found = read(&slices).unwrap();
    assert_eq!((found.volume.dims[2], found.series), (6, Some(2)));
    let list =
        "series 1: MR, 9 images of 12 x 10; series 2: CT, 7 images of 12 x 10; series 3: CT, 4 images of 12 x 10";
    let several = found.warnings.iter().find(|w| w.code == "several-series").unwrap();
    assert!(several.message.contains("series 2 was taken") && several.message.ends_with(list), "{several}");
    assert!(found.warnings.iter().any(|w| w.code == "localizers-left-out" && w.message.starts_with("1 images")));
    let zip = series(&slices);
    let ask = |name: &str| {
        let chosen = Some(SeriesChoice::of(name));
        let settings = VolumeSettings { series: chosen, max_step_mm: 50.0, ..VolumeSettings::default() };
        volume_with(&zip, &Limits::default(), &settings)
    };
    for (name, depth) in [("1.9", 4), ("3", 4), ("1.5", 6)] {
        assert_eq!(ask(name).unwrap().volume.dims[2], depth, "{name}");
    }
    assert!(ask("1.2").unwrap_err().to_string().contains("not a CT"));
    assert!(ask("7").unwrap_err().to_string().contains("not found; there are series 1: MR"));
    assert!(refused(&named("1.2", "MR", 3).collect::<Vec<_>>()).contains("no CT series"));
}

#[test]
fn what_cannot_be_read_is_named_and_nothing_of_the_patient_is() {
    let with = |change: &dyn Fn(&mut Slice)| {
        let mut slices = stack(EXPLICIT);
        slices.iter_mut().for_each(change);
        let text = refused(&slices);
        assert!(!text.contains("PATIENT") && !text.contains("disc"), "{text}");
        text
    };
    assert!(with(&|s| s.syntax = "1.2.840.10008.1.2.4.201").contains("transfer syntax 1.2.840.10008.1.2.4.201"));
    assert!(with(&|s| s.syntax = "1.2.276.0.7230010").contains("a private transfer syntax"));
    assert!(with(&|s| s.frames = 3).contains("several frames"));
    assert!(with(&|s| s.bits = (32, 31)).contains("32 bits a pixel"));
    assert!(with(&|s| s.slope = 0.0).contains("slope is 0"));
    assert!(with(&|s| s.orientation[0] = 0.5).contains("not unit vectors"));
    assert!(with(&|s| s.position[1] = f64::NAN).contains("image position is not made of finite numbers"));
    assert!(with(&|s| s.pixels.truncate(119)).contains("the pixels are 238 bytes, expected 240"));
    let few = Limits { max_voxels: 800, ..Limits::default() };
    let large = volume(&series(&stack(EXPLICIT)), &few).unwrap_err();
    assert!(matches!(large, ImportError::TooLarge { what: "voxels", found: 840, allowed: 800 }), "{large}");
    // Warnings do not repeat it either.
    assert!(read(&stack(EXPLICIT)).unwrap().warnings.iter().all(|w| !w.to_string().contains("PATIENT")));
}

#[test]
fn archives_that_swell_overlap_or_are_locked_are_refused() {
    let few = Limits { max_voxels: 100_000, ..Limits::default() };
    let bomb = archive(&[("a".to_owned(), vec![]), ("b".to_owned(), vec![0; 2 << 20])]);
    assert!(bomb.len() < 10_000);
    assert!(matches!(volume(&bomb, &few), Err(ImportError::TooLarge { what: "unpacked bytes", .. })));
    // The archive states too small a length: the file is unpacked no further than that.
    let slices = stack(EXPLICIT);
    let mut lies = archive(&[("a".to_owned(), vec![]), ("b".to_owned(), slices[0].file())]);
    let central = lies.windows(4).rposition(|w| w == b"PK\x01\x02").unwrap();
    lies[central + 24..central + 28].copy_from_slice(&300u32.to_le_bytes());
    assert!(volume(&lies, &Limits::default()).is_err());
    let empty = volume(&archive(&[("a".to_owned(), b"hello".to_vec())]), &Limits::default()).unwrap_err().to_string();
    assert!(empty.contains("no DICOM images and no volume"), "{empty}");
}
