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
