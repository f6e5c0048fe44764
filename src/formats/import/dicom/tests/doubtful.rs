//! Tests of series that a careless reader would read wrongly.

use super::*;

/// The stack's files; `from` is replaced by `to` in those that `which` selects.
fn patched(from: &[u8], to: &[u8], which: impl Fn(usize) -> bool) -> Vec<u8> {
    let patch = |(k, slice): (usize, &Slice)| {
        let mut file = slice.file();
        if which(k) {
            let at = file.windows(from.len()).position(|w| w == from).unwrap();
            file[at..at + to.len()].copy_from_slice(to);
        }
        (k.to_string(), file)
    };
    archive(&stack(EXPLICIT).iter().enumerate().map(patch).collect::<Vec<_>>())
}

fn warnings(archive: &[u8]) -> Result<Vec<Warning>, String> {
    let settings = VolumeSettings { max_step_mm: 50.0, ..VolumeSettings::default() };
    volume_with(archive, &Limits::default(), &settings).map(|read| read.warnings).map_err(|e| e.to_string())
}

#[test]
fn more_pixels_than_rows_and_columns_hold_are_refused() {
    let number = |tag: u8, value: usize| [&[0x28, 0, tag, 0][..], b"US", &[2, 0, value as u8, 0]].concat();
    for (tag, value) in [(0x10, ROWS), (0x11, COLUMNS)] {
        let refused = warnings(&patched(&number(tag, value), &number(tag, value - 1), |_| true)).unwrap_err();
        assert!(refused.contains("the pixels are 240 bytes, expected 2"), "{refused}");
    }
}

#[test]
fn a_series_of_two_spacings_is_refused_and_an_odd_one_out_gives_a_warning() {
    let other = |which: &dyn Fn(usize) -> bool| warnings(&patched(b"8\\10", b"8\\12", which));
    let refused = other(&|k| k % 2 == 1).unwrap_err();
    assert!(refused.contains("of 12 x 10 pixels of 10 x 8 mm") && refused.contains("of 12 x 8 mm"), "{refused}");
    let found = other(&|k| k == 0).unwrap();
    assert!(found.iter().any(|w| w.code == "slices-left-out" && w.severity == Severity::Check), "{found:?}");
}

#[test]
fn slices_farther_apart_than_thick_and_strides_of_image_numbers_are_reported() {
    const THICKNESS: (u16, u16) = (0x18, 0x50);
    const NUMBER: (u16, u16) = (0x20, 0x13);
    let found = |thickness: Option<&str>, stride: usize| -> Option<String> {
        let labelled = |k: usize| {
            let slice = Slice::near(k, EXPLICIT).with(NUMBER, 7 + stride * k);
            thickness.iter().fold(slice, |slice, mm| slice.with(THICKNESS, mm))
        };
        let slices: Vec<Slice> = (0..5).map(labelled).collect();
        let warnings = read(&slices).unwrap().warnings;
        warnings.iter().find(|w| w.code == "gaps-between-slices").map(ToString::to_string)
    };
    // The slices lie 4 mm apart.
    assert_eq!((found(Some("4"), 1), found(Some("5"), 2), found(None, 1)), (None, None, None));
    let half = found(Some("2"), 2).unwrap();
    assert!(half.contains("2.00 mm lie 4.00 mm apart, and the numbers of the images run in steps of 2"), "{half}");
    let thin = found(Some("2.0"), 1).unwrap();
    assert!(thin.contains("lie 4.00 mm apart: slices may be missing"), "{thin}");
    let stride = found(None, 3).unwrap();
    assert!(stride.starts_with("the numbers of the images run in steps of 3"), "{stride}");
}
