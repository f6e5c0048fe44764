use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;

use super::super::dicom::tests::archive;
use super::super::number::ByteOrder;
use super::super::{ImportError, Limits, VolumeCheck, VolumeSettings, volume, volume_with};
use prosopon_geometry::{Point, Severity, Vector, Volume, Warning};

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

    fn spacing(&mut self, steps: [f32; 3]) {
        for (axis, step) in steps.into_iter().enumerate() {
            self.f32(80 + 4 * axis, step);
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
    assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["no-unit", "no-orientation"]);

    let mut metres = File::new(ByteOrder::Little);
    metres.bytes[123] = 1;
    metres.spacing([0.01, 0.02, 0.03]);
    metres.sform([[0.01, 0.0, 0.0, 0.0], [0.0, 0.02, 0.0, 0.0], [0.0, 0.0, 0.03, 0.0]]);
    let (found, warnings) = read(&metres.plain()).unwrap();
    assert!((found.axes[2] - Vector::new(0.0, 0.0, 30.0)).norm() < 1e-5);
    assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["converted-unit"]);
    metres.bytes[123] = 2;
    metres.spacing([1e-3; 3]);
    metres.sform([[1e-3, 0.0, 0.0, 0.0], [0.0, 1e-3, 0.0, 0.0], [0.0, 0.0, 1e-3, 0.0]]);
    assert!(matches!(read(&metres.plain()), Err(ImportError::ImplausibleSize { .. })));
}

/// The file's lattice and the codes of its warnings.
fn lattice(file: &File) -> (Point, [Vector; 3], Vec<&'static str>) {
    let (found, warnings) = read(&file.plain()).unwrap();
    (found.origin, found.axes, warnings.iter().map(|w| w.code).collect())
}

#[test]
fn an_sform_of_another_size_than_pixdim_gets_the_steps_of_pixdim() {
    let (origin, axes, _) = lattice(&File::new(ByteOrder::Little));
    for (steps, codes) in [
        ([1.0f32, 1.0, 1.0], &["sform-scale-differs"][..]),
        ([10.0, 20.0, 30.002], &["sform-scale-differs"]),
        ([10.0, 20.0, 30.0005], &[]),
    ] {
        let mut file = File::new(ByteOrder::Little);
        let [x, y, z] = steps;
        file.sform([[x, 0.0, 0.0, 1.0], [0.0, y, 0.0, 2.0], [0.0, 0.0, z, 3.0]]);
        let found = lattice(&file);
        assert_eq!((found.0, &found.2[..]), (origin, codes), "{steps:?}");
        assert!(found.1.iter().zip(axes).all(|(a, b)| (a - b).norm() < 1e-3), "{steps:?}");
        // A negative `pixdim` is a length too.
        file.spacing([-10.0, 20.0, -30.0]);
        assert_eq!(lattice(&file).2, codes);
    }
    // A `pixdim` of zero says nothing.
    let mut file = File::new(ByteOrder::Little);
    file.sform([[11.0, 0.0, 0.0, 0.0], [0.0, 22.0, 0.0, 0.0], [0.0, 0.0, 33.0, 0.0]]);
    file.spacing([0.0, 20.0, 30.0]);
    assert_eq!((lattice(&file).1[2].z, lattice(&file).2), (33.0, vec![]));
    let mut file = File::new(ByteOrder::Little);
    file.sform([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]);
    let warning = &read(&file.plain()).unwrap().1[0];
    assert!(warning.message.contains("are 1 x 1 x 1 mm, but `pixdim` states 10 x 20 x 30 mm"), "{warning}");
}

#[test]
fn an_sform_and_a_qform_that_differ_anywhere_are_chosen_as_itk_does() {
    // Cubes, so that a swap of axes keeps the first and the last corner.
    let mut file = File::new(ByteOrder::Little);
    file.dims(&[4, 4, 4]);
    file.voxels((0..64i16).flat_map(|i| (i * 50 - 1000).to_le_bytes()), 2);
    file.spacing([20.0; 3]);
    file.qform(1.0, [0.0; 3], [0.0; 3]);
    let straight = [[20.0, 0.0, 0.0, 0.0], [0.0, 20.0, 0.0, 0.0], [0.0, 0.0, 20.0, 0.0]];
    let swapped = [straight[1], straight[0], straight[2]];
    for (code, sform, first_axis, codes) in [
        (1, straight, Vector::new(-20.0, 0.0, 0.0), &[][..]),
        (2, straight, Vector::new(-20.0, 0.0, 0.0), &[]),
        (1, swapped, Vector::new(0.0, -20.0, 0.0), &["sform-differs"]),
        (2, swapped, Vector::new(-20.0, 0.0, 0.0), &["sform-differs"]),
    ] {
        file.i16(254, code);
        file.sform(sform);
        let (_, axes, found) = lattice(&file);
        assert_eq!((axes[0], &found[..]), (first_axis, codes), "{code}");
    }
    let warning = &read(&file.plain()).unwrap().1[0];
    assert!(
        warning.message.contains("84.9 mm (4.2 voxels)") && warning.message.contains("the qform was used"),
        "{warning}"
    );
}

#[test]
fn an_unusable_sform_or_qform_leaves_the_other() {
    let turned = [Vector::new(0.0, -10.0, 0.0), Vector::new(20.0, 0.0, 0.0), Vector::new(0.0, 0.0, 30.0)];
    let quarter = [0.0, 0.0, 0.5f32.sqrt()];
    let with = |sform: Option<[[f32; 4]; 3]>, quaternion: [f32; 3]| {
        let mut file = File::new(ByteOrder::Little);
        file.qform(1.0, quaternion, [0.0; 3]);
        sform.into_iter().for_each(|rows| file.sform(rows));
        file
    };
    let flat = [[1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    for (sform, severity) in
        [([[0.0; 4]; 3], Severity::Info), (flat, Severity::Check), ([[f32::NAN; 4]; 3], Severity::Check)]
    {
        let (found, warnings) = read(&with(Some(sform), quarter).plain()).unwrap();
        assert!(found.axes.iter().zip(turned).all(|(a, b)| (a - b).norm() < 1e-5), "{:?}", found.axes);
        let codes: Vec<_> = warnings.iter().map(|w| (w.code, w.severity)).collect();
        assert_eq!(codes, [("one-form-not-usable", severity)]);
    }
    assert_eq!(lattice(&with(None, [1.0, 1.0, 0.0])).2, ["one-form-not-usable"]);
    // Neither is usable: the qform's fault; without a qform a zero sform is no orientation.
    let neither = read(&with(Some([[0.0; 4]; 3]), [1.0, 1.0, 0.0]).plain()).unwrap_err();
    assert!(neither.to_string().contains("quaternion"), "{neither}");
    let mut file = with(Some([[0.0; 4]; 3]), quarter);
    file.i16(252, 0);
    assert_eq!(lattice(&file).2, ["no-orientation"]);
}

#[test]
fn oblique_and_sheared_axes_stay_as_they_are() {
    let mut file = File::new(ByteOrder::Little);
    file.sform([[10.0, 1.0, 2.0, 1.0], [-3.0, 20.0, 4.0, 2.0], [5.0, 6.0, 30.0, 3.0]]);
    file.spacing([134f32.sqrt(), 437f32.sqrt(), 920f32.sqrt()]);
    let (found, warnings) = read(&file.plain()).unwrap();
    assert_eq!(warnings, []);
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
    check(&|f| f.bytes[344..348].copy_from_slice(b"ni1\0"), "in one zip archive");
    check(&|f| f.bytes[344..348].copy_from_slice(b"abcd"), "no NIfTI-1 header");
    check(&|f| f.kind(32, 64), "data type 32");
    check(&|f| f.kind(4, 32), "32 bits");
    check(&|f| f.dims(&[3, 4, 5, 1, 2]), "of 2 numbers (vectors or colours)");
    check(&|f| f.kind(128, 24), "data type 128 (colours)");
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

#[test]
fn one_of_several_time_points_is_chosen() {
    for order in [ByteOrder::Little, ByteOrder::Big] {
        let mut file = File::new(order);
        file.dims(&[3, 4, 5, 3]);
        file.voxels((0..180i16).flat_map(|i| (i * 10 - 1000).to_le_bytes()), 2);
        for bytes in [file.plain(), file.gzipped()] {
            let ask = |stack| volume_with(&bytes, &Limits::default(), &VolumeSettings { stack, ..Default::default() });
            assert!(ask(None).unwrap_err().to_string().contains("holds 3 volumes"));
            for stack in 1..4 {
                let found = ask(Some(stack)).unwrap();
                let first = 600 * (stack as i16 - 1) - 1000;
                assert_eq!(found.volume.hu, (0..60).map(|i| first + 10 * i).collect::<Vec<i16>>());
                assert!(found.warnings.iter().all(|w| w.code == "no-air"), "{:?}", found.warnings);
            }
            assert!(ask(Some(4)).unwrap_err().to_string().contains("stacks 1 to 3"));
            assert_eq!(scan(bytes.chunks(100)).0, Ok(()));
            assert!(volume(&bytes[..bytes.len() - 20], &Limits::default()).is_err());
        }
        let one = {
            file.dims(&[3, 4, 5, 1]);
            file.voxels((0..60i16).flat_map(|i| (i * 50 - 1000).to_le_bytes()), 2);
            file
        };
        assert_eq!(read(&one.plain()).unwrap(), read(&File::new(order).plain()).unwrap());
    }
}

#[test]
fn a_header_and_its_voxels_in_one_archive_are_one_volume() {
    let expected = read(&File::new(ByteOrder::Little).plain()).unwrap();
    let mut file = File::new(ByteOrder::Little);
    file.bytes[344..348].copy_from_slice(b"ni1\0");
    file.f32(108, 0.0);
    let (head, voxels) = (file.bytes[..348].to_vec(), file.bytes[352..].to_vec());
    for (name, head, voxels) in [
        ("a/v.img", head.clone(), voxels.clone()),
        ("a/V.IMG", head.clone(), voxels.clone()),
        ("a/v.img.gz", gzip(&head), gzip(&voxels)),
    ] {
        let zip = archive(&[("a/v.hdr".to_owned(), head), (name.to_owned(), voxels)]);
        assert_eq!(read(&zip).unwrap(), expected, "{name}");
    }
    let alone = read(&archive(&[("a/v.hdr".to_owned(), head)])).unwrap_err().to_string();
    assert!(alone.contains("ending .img"), "{alone}");
}

#[test]
fn a_file_alone_is_its_only_volume() {
    let ask = |volume| {
        let settings = VolumeSettings { volume: Some(volume), ..Default::default() };
        volume_with(&File::new(ByteOrder::Little).plain(), &Limits::default(), &settings)
    };
    assert!(ask(1).is_ok());
    assert!(ask(2).unwrap_err().to_string().contains("volume 2 was requested"));
}

#[test]
fn a_request_replaces_the_scale() {
    let mut file = File::new(ByteOrder::Little);
    file.f32(112, 2.0);
    file.f32(116, -24.0);
    let settings = VolumeSettings { rescale_intercept: Some(-10.0), ..Default::default() };
    let found = volume_with(&file.plain(), &Limits::default(), &settings).unwrap();
    assert_eq!(found.volume.hu, (0..60).map(|i| 2 * (i * 50 - 1000) - 10).collect::<Vec<i16>>());
    let codes: Vec<_> = found.warnings.iter().map(|w| (w.code, w.severity)).collect();
    assert_eq!(codes, [("rescale-given", Severity::Info)]);
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
