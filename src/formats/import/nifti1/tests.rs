use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;

use super::super::number::ByteOrder;
use super::super::{ImportError, Limits, VolumeCheck, volume};
use prosopon_geometry::{Point, Vector, Volume, Warning};

fn read(bytes: &[u8]) -> Result<(Volume, Vec<Warning>), ImportError> {
    volume(bytes, &Limits::default())
}

pub(in crate::import) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Builder of a file; fields are set by their offset in `nifti1.h`.
#[derive(Clone)]
pub(in super::super) struct File {
    bytes: Vec<u8>,
    order: ByteOrder,
}

impl File {
    /// 3 × 4 × 5 voxels of `i16`, spaced 10, 20, 30 mm, in RAS, with air and bone.
    pub(in super::super) fn new(order: ByteOrder) -> Self {
        let mut file = Self { bytes: vec![0; 352], order };
        file.i32(0, 348);
        file.dims(&[3, 4, 5]);
        file.kind(4, 16);
        for (at, value) in [(80, 10.0), (84, 20.0), (88, 30.0), (108, 352.0)] {
            file.f32(at, value);
        }
        file.bytes[123] = 2; // mm
        file.i16(254, 1);
        file.sform([[10.0, 0.0, 0.0, 1.0], [0.0, 20.0, 0.0, 2.0], [0.0, 0.0, 30.0, 3.0]]);
        file.bytes[344..348].copy_from_slice(b"n+1\0");
        file.voxels((0..60i16).flat_map(|i| (i * 50 - 1000).to_le_bytes()), 2);
        file
    }

    pub(in super::super) fn plain(&self) -> Vec<u8> {
        self.bytes.clone()
    }

    pub(in super::super) fn gzipped(&self) -> Vec<u8> {
        gzip(&self.bytes)
    }

    fn put(&mut self, at: usize, mut little: Vec<u8>) {
        if self.order == ByteOrder::Big {
            little.reverse();
        }
        self.bytes[at..at + little.len()].copy_from_slice(&little);
    }

    fn i16(&mut self, at: usize, value: i16) {
        self.put(at, value.to_le_bytes().to_vec());
    }

    fn i32(&mut self, at: usize, value: i32) {
        self.put(at, value.to_le_bytes().to_vec());
    }

    fn f32(&mut self, at: usize, value: f32) {
        self.put(at, value.to_le_bytes().to_vec());
    }

    fn dims(&mut self, dims: &[i16]) {
        self.i16(40, dims.len() as i16);
        for (a, d) in dims.iter().enumerate() {
            self.i16(42 + 2 * a, *d);
        }
    }

    fn kind(&mut self, code: i16, bits: i16) {
        self.i16(70, code);
        self.i16(72, bits);
    }

    fn sform(&mut self, rows: [[f32; 4]; 3]) {
        for (index, value) in rows.as_flattened().iter().enumerate() {
            self.f32(280 + 4 * index, *value);
        }
    }

    fn qform(&mut self, qfac: f32, quaternion: [f32; 3], offset: [f32; 3]) {
        self.i16(252, 1);
        self.f32(76, qfac);
        for (index, value) in quaternion.iter().chain(&offset).enumerate() {
            self.f32(256 + 4 * index, *value);
        }
    }

    fn voxels(&mut self, little: impl Iterator<Item = u8>, size: usize) {
        let mut bytes: Vec<u8> = little.collect();
        if self.order == ByteOrder::Big {
            bytes.chunks_mut(size).for_each(<[u8]>::reverse);
        }
        self.bytes.truncate(352);
        self.bytes.extend(bytes);
    }
}

#[test]
fn plain_gzipped_and_either_byte_order_give_the_same_volume_in_lps() {
    for order in [ByteOrder::Little, ByteOrder::Big] {
        let file = File::new(order);
        let (found, warnings) = read(&file.plain()).unwrap();
        assert_eq!(warnings, []);
        assert_eq!((found.dims, found.origin), ([3, 4, 5], Point::new(-1.0, -2.0, 3.0)));
        assert_eq!(
            found.axes,
            [Vector::new(-10.0, 0.0, 0.0), Vector::new(0.0, -20.0, 0.0), Vector::new(0.0, 0.0, 30.0)]
        );
        assert_eq!(found.hu, (0..60).map(|i| i * 50 - 1000).collect::<Vec<i16>>());
        assert_eq!(read(&file.gzipped()).unwrap().0, found);
        // Several gzip members, as bgzip writes them.
        let (a, b) = file.bytes.split_at(400);
        assert_eq!(read(&[gzip(a), gzip(b)].concat()).unwrap().0, found);
    }
}

#[test]
fn every_kind_of_number_is_scaled_rounded_and_clamped() {
    let stored = [-100.0, 0.0, 100.0];
    macro_rules! check {
        ($number:ty, $code:expr, $values:expr) => {
            for order in [ByteOrder::Little, ByteOrder::Big] {
                let mut file = File::new(order);
                let size = size_of::<$number>();
                file.kind($code, 8 * size as i16);
                file.f32(112, 2.0);
                file.f32(116, -500.0);
                file.voxels((0..60).flat_map(|i| ($values[i % 3] as $number).to_le_bytes()), size);
                let (found, _) = read(&file.plain()).unwrap();
                let expected: Vec<i16> = (0..60).map(|i| ($values[i % 3] * 2.0 - 500.0) as i16).collect();
                assert_eq!(found.hu, expected, "{}", stringify!($number));
            }
        };
    }
    check!(i8, 256, stored);
    check!(i16, 4, stored);
    check!(i32, 8, stored);
    check!(f32, 16, stored);
    check!(f64, 64, stored);
    check!(u8, 2, [0.0, 100.0, 200.0]);
    check!(u16, 512, [0.0, 100.0, 200.0]);

    let mut file = File::new(ByteOrder::Little);
    file.kind(16, 32);
    file.f32(112, f32::NAN);
    let values = [f32::NAN, f32::INFINITY, -1e9, -1000.4, 99.5];
    file.voxels((0..60).flat_map(|i| values[i % 5].to_le_bytes()), 4);
    let (found, warnings) = read(&file.plain()).unwrap();
    assert_eq!(found.hu[..5], [-1024, 32767, -32768, -1000, 100]);
    assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["voxels-without-value", "clamped-voxels"]);
    assert!(warnings[0].message.starts_with("12 voxels") && warnings[1].message.starts_with("24 voxels"));
}

#[test]
fn the_qform_turns_and_mirrors() {
    let mut file = File::new(ByteOrder::Little);
    file.i16(254, 0);
    // A quarter turn about z, mirrored along k: i runs to +y, j to -x, k to -z (RAS).
    file.qform(-1.0, [0.0, 0.0, 0.5f32.sqrt()], [7.0, 8.0, 9.0]);
    let (found, warnings) = read(&file.plain()).unwrap();
    assert_eq!(warnings, []);
    let expected = [Vector::new(0.0, -10.0, 0.0), Vector::new(20.0, 0.0, 0.0), Vector::new(0.0, 0.0, -30.0)];
    for (axis, expected) in found.axes.iter().zip(expected) {
        assert!((axis - expected).norm() < 1e-5, "{axis}");
    }
    assert_eq!(found.origin, Point::new(-7.0, -8.0, 9.0));

    // A sform that differs is used, with a warning.
    file.i16(254, 1);
    let (found, warnings) = read(&file.plain()).unwrap();
    assert_eq!(found.origin, Point::new(-1.0, -2.0, 3.0));
    assert!(warnings[0].code == "sform-differs", "{warnings:?}");
}

#[test]
fn missing_orientation_and_other_units_give_warnings() {
    let mut file = File::new(ByteOrder::Little);
    file.i16(254, 0);
    file.bytes[123] = 0;
    let (found, warnings) = read(&file.plain()).unwrap();
    assert_eq!(found.axes[1], Vector::new(0.0, -20.0, 0.0));
    assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["no-orientation", "no-unit"]);

    let mut metres = File::new(ByteOrder::Little);
    metres.bytes[123] = 1;
    metres.sform([[0.01, 0.0, 0.0, 0.0], [0.0, 0.02, 0.0, 0.0], [0.0, 0.0, 0.03, 0.0]]);
    let (found, warnings) = read(&metres.plain()).unwrap();
    assert!((found.axes[2] - Vector::new(0.0, 0.0, 30.0)).norm() < 1e-5);
    assert_eq!(warnings[0].code, "converted-unit");
    metres.bytes[123] = 2;
    metres.sform([[1e-3, 0.0, 0.0, 0.0], [0.0, 1e-3, 0.0, 0.0], [0.0, 0.0, 1e-3, 0.0]]);
    assert!(matches!(read(&metres.plain()), Err(ImportError::ImplausibleSize { .. })));
}

#[test]
fn oblique_and_sheared_axes_stay_as_they_are() {
    let mut file = File::new(ByteOrder::Little);
    file.sform([[10.0, 1.0, 2.0, 1.0], [-3.0, 20.0, 4.0, 2.0], [5.0, 6.0, 30.0, 3.0]]);
    let (found, _) = read(&file.plain()).unwrap();
    let expected = [Vector::new(-10.0, 3.0, 5.0), Vector::new(-1.0, -20.0, 6.0), Vector::new(-2.0, -4.0, 30.0)];
    assert_eq!(found.axes, expected);
}

#[test]
fn faults_are_named() {
    let check = |change: &dyn Fn(&mut File), part: &str| {
        let mut file = File::new(ByteOrder::Little);
        change(&mut file);
        let error = read(&file.plain()).unwrap_err().to_string();
        assert!(error.contains(part), "expected {part}, found {error}");
    };
    check(&|f| f.i32(0, 540), "NIfTI-2");
    check(&|f| f.bytes[344..348].copy_from_slice(b"ni1\0"), "two files");
    check(&|f| f.bytes[344..348].copy_from_slice(b"abcd"), "no NIfTI-1 header");
    check(&|f| f.kind(32, 64), "data type 32");
    check(&|f| f.kind(4, 32), "32 bits");
    check(&|f| f.dims(&[3, 4, 5, 2]), "three dimensions");
    check(&|f| f.dims(&[3, 4]), "three dimensions");
    check(&|f| f.dims(&[3, 4, 1]), "three dimensions");
    check(&|f| f.dims(&[3, 4, -1]), "three dimensions");
    check(&|f| f.dims(&[3, 4, 0]), "out of range");
    check(&|f| f.f32(108, 1e30), "start at byte");
    check(&|f| f.f32(108, f32::NAN), "start at byte");
    check(&|f| f.f32(112, f32::INFINITY), "slope");
    check(&|f| f.f32(280, f32::NAN), "not finite");
    check(&|f| f.sform([[1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]), "in one plane");
    check(&|f| (f.i16(254, 0), f.qform(1.0, [1.0, 1.0, 0.0], [0.0; 3])).1, "quaternion");
    check(&|f| (f.i16(254, 0), f.qform(1.0, [0.0; 3], [0.0; 3]), f.f32(84, -1.0)).2, "expected positive");
    check(&|f| f.bytes[123] = 4, "unit of length");
    check(&|f| f.bytes.truncate(360), "has at most 360 bytes");
}

#[test]
fn counts_beyond_the_file_or_the_limit_are_refused_before_reading() {
    let mut file = File::new(ByteOrder::Little);
    file.dims(&[32767, 32767, 32767]);
    assert!(matches!(read(&file.plain()), Err(ImportError::TooLarge { found: 35_181_150_961_663, .. })));
    file.dims(&[800, 800, 800]);
    assert!(matches!(read(&file.plain()), Err(ImportError::Malformed { .. })));
    assert!(matches!(read(&file.gzipped()), Err(ImportError::Malformed { .. })));
    let few = Limits { max_voxels: 59, ..Limits::default() };
    assert!(matches!(volume(&File::new(ByteOrder::Little).plain(), &few), Err(ImportError::TooLarge { .. })));
}

#[test]
fn a_damaged_or_bloated_gzip_file_is_refused() {
    let mut zipped = File::new(ByteOrder::Little).gzipped();
    let end = zipped.len();
    zipped[end - 6] ^= 1; // the check sum
    assert!(read(&zipped).unwrap_err().to_string().contains("damaged"));

    // 64 MB of zeros after a header that needs 120 bytes: only the header and the voxels are unpacked.
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(&File::new(ByteOrder::Little).bytes).unwrap();
    for _ in 0..64 {
        encoder.write_all(&[0; 1 << 20]).unwrap();
    }
    let (found, warnings) = read(&encoder.finish().unwrap()).unwrap();
    assert_eq!(found.hu.len(), 60);
    assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["bytes-after-voxels"]);
}

/// Result of a scan of the pieces, and the number of pieces it took before it refused.
fn scan<'a>(pieces: impl Iterator<Item = &'a [u8]>) -> (Result<(), String>, usize) {
    let mut scan = VolumeCheck::new(Limits::default());
    let mut taken = 0;
    for piece in pieces {
        if let Err(error) = scan.push(piece) {
            return (Err(error.to_string()), taken);
        }
        taken += 1;
    }
    (scan.finish().map_err(|e| e.to_string()), taken)
}

#[test]
fn a_scan_takes_what_the_reader_takes_in_pieces_of_any_size() {
    for file in [File::new(ByteOrder::Little), File::new(ByteOrder::Big)] {
        for bytes in [file.plain(), file.gzipped(), [gzip(&file.bytes[..370]), gzip(&file.bytes[370..])].concat()] {
            for size in [1, 3, 100, 1000] {
                assert_eq!(scan(bytes.chunks(size)).0, Ok(()));
            }
            for length in 0..bytes.len() {
                let refused = scan(bytes[..length].chunks(50)).0;
                assert!(refused.is_err(), "took {length} of {} bytes", bytes.len());
            }
        }
    }
}

#[test]
fn a_scan_refuses_a_header_that_cannot_be_before_the_voxels_come() {
    let mut flat = File::new(ByteOrder::Little);
    flat.dims(&[3, 4]);
    // Stored without compression, so that many bytes follow.
    let mut long = GzEncoder::new(Vec::new(), Compression::none());
    long.write_all(&flat.bytes).unwrap();
    long.write_all(&[0; 100_000]).unwrap();
    for bytes in [[flat.plain(), vec![0; 100_000]].concat(), long.finish().unwrap()] {
        let (refused, taken) = scan(bytes.chunks(1000));
        assert!(refused.is_err_and(|e| e.contains("three dimensions")));
        // Bytes that the unpacker buffers appear with the next piece.
        assert!(taken <= 40, "{taken} pieces");
    }
    assert!(scan([b"hello".as_slice()].into_iter()).0.is_err_and(|e| e.contains("not recognised")));
    assert!(scan([].into_iter()).0.is_err_and(|e| e.contains("empty")));
}

#[test]
fn a_scan_tells_where_the_file_ends_and_unpacks_no_more_than_the_voxels() {
    let file = File::new(ByteOrder::Little);
    let scanned = |bytes: &[u8]| scan([bytes].into_iter()).0;
    assert!(scanned(&file.plain()[..471]).is_err_and(|e| e.contains("ends at byte 472, but there are 471")));
    let zipped = file.gzipped();
    assert!(scanned(&zipped[..zipped.len() - 1]).is_err_and(|e| e.contains("gzip")));
    let mut wrong_sum = zipped;
    let end = wrong_sum.len();
    wrong_sum[end - 6] ^= 1;
    assert!(scanned(&wrong_sum).is_err_and(|e| e.contains("damaged")));
    // Bytes after the voxels are not checked, not even whether they are gzip.
    let bloated = [file.gzipped(), gzip(&vec![0; 1 << 20]), vec![7; 1 << 20]].concat();
    assert_eq!(scanned(&bloated), Ok(()));
}
