//! Tests of NRRD headers whose voxels are elsewhere, and of fields that place and select them.

use crate::import::dicom::tests::archive;
use crate::import::nifti1::tests::gzip;
use crate::import::{Limits, VolumeFormat, VolumeRead, VolumeSettings, volume_with};
use prosopon_geometry::{Point, Vector};

const LATTICE: &str = "space: LPS\nspace directions: (10,0,0) (0,20,0) (0,0,30)\nspace origin: (1,2,3)\n";

fn hu() -> Vec<i16> {
    (0..60).map(|i| i * 50 - 1000).collect()
}

fn raw(hu: &[i16]) -> Vec<u8> {
    hu.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A header of 3 × 4 × 5 voxels with further lines, without its end.
fn head(lines: &str) -> String {
    let given = |name: &str, line: &str| if lines.contains(name) { String::new() } else { line.to_owned() };
    [
        "NRRD0005\n".to_owned(),
        given("type:", "type: short\n"),
        given("dimension:", "dimension: 3\n"),
        given("sizes:", "sizes: 3 4 5\n"),
        "endian: little\n".to_owned(),
        given("encoding:", "encoding: raw\n"),
        lines.to_owned(),
    ]
    .concat()
}

fn read(bytes: &[u8], settings: &VolumeSettings) -> Result<VolumeRead, String> {
    volume_with(bytes, &Limits::default(), settings).map_err(|e| e.to_string())
}

/// The volume of a header with files beside it, in one archive.
fn zipped(head: &str, files: &[(&str, Vec<u8>)]) -> Result<VolumeRead, String> {
    let mut all = vec![("a/head.nhdr".to_owned(), head.as_bytes().to_vec())];
    all.extend(files.iter().map(|(name, bytes)| ((*name).to_owned(), bytes.clone())));
    read(&archive(&all), &VolumeSettings::default())
}

fn attached(lines: &str, data: &[u8]) -> Result<VolumeRead, String> {
    read(&[head(lines).as_bytes(), b"\n", data].concat(), &VolumeSettings::default())
}

#[test]
fn detached_voxels_are_read_like_attached_ones() {
    let expected = attached(LATTICE, &raw(&hu())).unwrap();
    assert_eq!((expected.volume.hu.clone(), expected.warnings.len()), (hu(), 0));
    let slices: Vec<Vec<u8>> = hu().chunks(12).map(raw).collect();
    let several = |name: fn(usize) -> String, pack: fn(&[u8]) -> Vec<u8>| -> Vec<(String, Vec<u8>)> {
        slices.iter().enumerate().map(|(k, slice)| (name(k), pack(slice))).collect()
    };
    let one = |name: &str, bytes: Vec<u8>| vec![(name.to_owned(), bytes)];
    let text: String = hu().iter().map(|v| format!("{v}, ")).collect();
    let hex: String = raw(&hu()).iter().map(|b| format!("{b:02X}\n")).collect();
    let numbered: fn(usize) -> String = |k| format!("a/s{:03}.raw", k + 8);
    let listed: fn(usize) -> String = |k| format!("a/{}.raw", ["e", "d", "c", "b", "a"][k]);
    for (lines, files) in [
        ("data file: v.raw\n", one("a/v.raw", raw(&hu()))),
        ("datafile: ./V.RAW\n\n", one("a/v.raw", raw(&hu()))),
        ("encoding: gzip\ndata file: v.raw.gz\n", one("a/v.raw.gz", gzip(&raw(&hu())))),
        (
            "encoding: gz\nbyte skip: 5\ndata file: v.gz\n",
            one("b/v.gz", gzip(&[b"12345".to_vec(), raw(&hu())].concat())),
        ),
        ("byte skip: -1\ndata file: v.img\n", one("a/v.img", [b"any length".to_vec(), raw(&hu())].concat())),
        (
            "line skip: 2\nbyte skip: 3\ndata file: v.raw\n",
            one("a/v.raw", [b"one\ntwo\nxyz".to_vec(), raw(&hu())].concat()),
        ),
        ("encoding: ascii\ndata file: v.txt\n", one("a/v.txt", text.into_bytes())),
        ("encoding: hex\ndata file: v.hex\n", one("a/v.hex", hex.into_bytes())),
        ("data file: s%03d.raw 8 12 1\n", several(numbered, <[u8]>::to_vec)),
        ("data file: LIST\ne.raw\nd.raw\nc.raw\nb.raw\na.raw\n", several(listed, <[u8]>::to_vec)),
        ("encoding: gzip\ndata file: LIST 2\ne.raw\nd.raw\nc.raw\nb.raw\na.raw\n", several(listed, gzip)),
    ] {
        let files: Vec<(&str, Vec<u8>)> = files.iter().map(|(name, bytes)| (name.as_str(), bytes.clone())).collect();
        // The fields of the lattice come before `data file: LIST`, after which only names follow.
        let found = zipped(&head(&[LATTICE, lines].concat()), &files).unwrap_or_else(|e| panic!("{lines}: {e}"));
        assert_eq!((found.format, &found.volume), (VolumeFormat::Nrrd, &expected.volume), "{lines}");
        assert!(found.warnings.is_empty(), "{lines}: {:?}", found.warnings);
        let alone = read(head(&[LATTICE, lines].concat()).as_bytes(), &VolumeSettings::default()).unwrap_err();
        assert!(alone.contains("in one zip archive"), "{lines}: {alone}");
    }
}

#[test]
fn each_header_gets_the_file_beside_it_and_a_missing_one_is_named() {
    let header = head(&[LATTICE, "data file: v.raw\n"].concat());
    let other: Vec<i16> = hu().iter().map(|v| v + 1).collect();
    let zip = archive(&[
        ("b/v.raw".to_owned(), raw(&other)),
        ("a/v.raw".to_owned(), raw(&hu())),
        ("a/h.nhdr".to_owned(), header.clone().into_bytes()),
        ("b/h.nhdr".to_owned(), header.clone().into_bytes()),
    ]);
    let choose = |volume| read(&zip, &VolumeSettings { volume, ..VolumeSettings::default() });
    assert_eq!(choose(Some(1)).unwrap().volume.hu, hu());
    assert_eq!(choose(Some(2)).unwrap().volume.hu, other);
    let refused = choose(None).unwrap_err();
    let list = "volume 1: file 3, nrrd, 3 x 4 x 5 voxels; volume 2: file 4, nrrd, 3 x 4 x 5 voxels";
    assert!(refused.contains("choose one with `volume`") && refused.ends_with(list), "{refused}");
    assert!(choose(Some(3)).unwrap_err().contains("volume 3 was requested"));
    assert!(zipped(&header, &[("a/w.raw", raw(&hu()))]).unwrap_err().contains("not in the archive"));
    // Two of another folder: which one is meant is not known.
    let refused = zipped(&header, &[("b/v.raw", raw(&hu())), ("c/v.raw", raw(&other))]).unwrap_err();
    assert!(refused.contains("not in the archive"), "{refused}");
}

#[test]
fn fields_that_place_the_voxels_are_honoured_or_refused_by_name() {
    let steps = |x: f64, y: f64, z: f64| [Vector::x() * x, Vector::y() * y, Vector::z() * z];
    for (lines, origin, axes, codes) in [
        (
            "space: RAS\nspace directions: (10,0,0) (0,20,0) (0,0,30)\nspace origin: (1,2,3)\n",
            [-1.0, -2.0, 3.0],
            steps(-10.0, -20.0, 30.0),
            &[][..],
        ),
        (
            "space: LPS\nspace units: \"cm\" \"cm\" \"cm\"\nspace directions: (1,0,0) (0,2,0) (0,0,3)\nspace origin: (0.1,0.2,0.3)\n",
            [1.0, 2.0, 3.0],
            steps(10.0, 20.0, 30.0),
            &["converted-unit"],
        ),
        (
            "space: LPS\nspace directions: (10,0,0) (0,20,0) (0,0,30)\nspace origin: (1,2,3)\ncenterings: cell cell cell\n",
            [1.0, 2.0, 3.0],
            steps(10.0, 20.0, 30.0),
            &[],
        ),
        ("spacings: 10 20 30\n", [0.0; 3], steps(10.0, 20.0, 30.0), &["no-orientation"]),
        (
            "spacings: 10 20 30\naxis mins: 1 2 3\ncenterings: node node node\n",
            [1.0, 2.0, 3.0],
            steps(10.0, 20.0, 30.0),
            &["no-orientation"],
        ),
        (
            "spacings: 10 20 30\naxis mins: 1 2 3\ncenterings: cell cell cell\n",
            [6.0, 12.0, 18.0],
            steps(10.0, 20.0, 30.0),
            &["no-orientation"],
        ),
        (
            "axis mins: 0 0 0\naxis maxs: 30 80 150\ncenterings: cell cell cell\n",
            [5.0, 10.0, 15.0],
            steps(10.0, 20.0, 30.0),
            &["no-orientation"],
        ),
        (
            "axis mins: 0 0 0\naxis maxs: 20 60 120\ncenterings: node node node\n",
            [0.0; 3],
            steps(10.0, 20.0, 30.0),
            &["no-orientation"],
        ),
    ] {
        let found = attached(lines, &raw(&hu())).unwrap_or_else(|e| panic!("{lines}: {e}"));
        let (off, expected) = (found.volume.origin - Point::from(origin), found.volume.axes.iter().zip(axes));
        assert!(
            off.norm() < 1e-9 && expected.clone().all(|(a, b)| (a - b).norm() < 1e-9),
            "{lines}: {:?}",
            found.volume.axes
        );
        assert_eq!(found.warnings.iter().map(|w| w.code).collect::<Vec<_>>(), codes, "{lines}");
    }
    for (lines, part) in [
        ("space: scanner-xyz\nspacings: 1 1 1\n", "scanner-xyz"),
        ("space: 3D-left-handed\nspacings: 1 1 1\n", "3D-left-handed"),
        ("space: LPS\nspace units: \"mm\" \"mm\" \"cm\"\nspacings: 1 1 1\n", "`space units`"),
        ("encoding: bzip2\n", "bzip2"),
        ("kinds: vector domain domain\n", "vectors or colours"),
        ("dimension: 4\nsizes: 3 3 4 5\nkinds: RGB-color domain domain domain\n", "colours of 3 numbers"),
        (
            "dimension: 4\nsizes: 3 2 4 5\nkinds: domain list domain domain\nspacings: 1 nan 1 1\n",
            "the first or the last",
        ),
        ("byte skip: -2\n", "`byte skip`"),
        ("encoding: gzip\nbyte skip: -1\n", "`byte skip`"),
    ] {
        let lines = if lines.contains("spac") { lines.to_owned() } else { [lines, "spacings: 10 20 30\n"].concat() };
        let refused = attached(&lines, &raw(&hu())).unwrap_err();
        assert!(refused.contains(part), "{lines}: {refused}");
    }
}

#[test]
fn time_points_along_the_first_or_last_axis_are_chosen() {
    let other: Vec<i16> = hu().iter().map(|v| v + 7).collect();
    let interleaved: Vec<i16> = hu().iter().zip(&other).flat_map(|(a, b)| [*a, *b]).collect();
    let in_turn = [hu(), other.clone()].concat();
    for (lines, data) in [
        (
            "sizes: 2 3 4 5\nkinds: list domain domain domain\nspace directions: none (10,0,0) (0,20,0) (0,0,30)\n",
            interleaved,
        ),
        (
            "sizes: 3 4 5 2\nkinds: domain domain domain time\nspace directions: (10,0,0) (0,20,0) (0,0,30) none\n",
            in_turn,
        ),
    ] {
        let bytes = [head(&["dimension: 4\nspace: LPS\n", lines].concat()).as_bytes(), b"\n", &raw(&data)].concat();
        let ask = |stack| read(&bytes, &VolumeSettings { stack, ..VolumeSettings::default() });
        assert!(ask(None).unwrap_err().contains("holds 2 volumes"), "{lines}");
        assert_eq!(ask(Some(1)).unwrap().volume.hu, hu(), "{lines}");
        let found = ask(Some(2)).unwrap();
        assert_eq!(
            (found.volume.hu, found.warnings.len(), found.volume.dims),
            (other.clone(), 0, [3, 4, 5]),
            "{lines}"
        );
        assert!(ask(Some(3)).unwrap_err().contains("stacks 1 to 2"), "{lines}");
    }
}
