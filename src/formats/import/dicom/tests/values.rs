//! Tests of numbers in the header and of the scale of the pixels.

use super::*;

fn near() -> Vec<Slice> {
    (0..5).map(|k| Slice::near(k, EXPLICIT)).collect()
}

fn codes(found: &VolumeRead) -> Vec<(&'static str, Severity)> {
    found.warnings.iter().filter(|w| w.code != "files-skipped").map(|w| (w.code, w.severity)).collect()
}

#[test]
fn decimal_commas_are_read_with_a_note_or_refused_by_name() {
    let with = |point: &'static str| {
        let mut slices = near();
        for (k, slice) in slices.iter_mut().enumerate() {
            (slice.point, slice.slope, slice.intercept) = (point, 1.5, -24.5);
            slice.position = [-50.25, -40.5, 4.5 * k as f64];
        }
        slices
    };
    let (expected, found) = (read(&with(".")).unwrap(), read(&with(",")).unwrap());
    assert_eq!(found.volume, expected.volume);
    assert_eq!((codes(&expected), codes(&found)), (vec![], vec![("decimal-commas", Severity::Info)]));
    let note = found.warnings.iter().find(|w| w.code == "decimal-commas").unwrap();
    assert!(note.message.ends_with("in the image position, the rescale intercept, the rescale slope"), "{note}");

    let mut doubtful = with(",");
    doubtful[2] = doubtful[2].clone().with((0x28, 0x1052), "");
    doubtful[2].rescaled = false;
    doubtful[2].extra[0].1 = "-1,024".to_owned();
    let refused = refused(&doubtful);
    assert!(refused.contains("the rescale intercept has commas") && refused.contains("file"), "{refused}");
    assert!(!refused.contains("1,024"), "{refused}");
}

#[test]
fn grey_values_are_reported_and_a_request_gives_their_scale() {
    let grey: Vec<Slice> = near()
        .into_iter()
        .map(|mut s| {
            (s.rescaled, s.signed) = (false, false);
            s.pixels.iter_mut().for_each(|p| *p += 1050);
            s
        })
        .collect();
    let found = read(&grey).unwrap();
    assert_eq!(found.volume.hu, grey.iter().flat_map(Slice::expected).collect::<Vec<_>>());
    assert_eq!(codes(&found), [("no-rescale", Severity::Check), ("no-air", Severity::Check)]);

    let ask = |slices: &[Slice], slope, intercept| {
        let settings =
            VolumeSettings { rescale_slope: slope, rescale_intercept: intercept, ..VolumeSettings::default() };
        volume_with(&series(slices), &Limits::default(), &settings).unwrap()
    };
    for (slope, intercept) in [(Some(2.0), Some(-1050.0)), (None, Some(-1050.0)), (Some(0.5), None)] {
        let found = ask(&grey, slope, intercept);
        let hu = |p: &i32| (slope.unwrap_or(1.0) * f64::from(*p) + intercept.unwrap_or(0.0)).round() as i16;
        assert_eq!(found.volume.hu, grey.iter().flat_map(|s| s.pixels.iter().map(hu)).collect::<Vec<_>>());
        assert!(codes(&found).contains(&("rescale-given", Severity::Info)), "{:?}", found.warnings);
        assert!(!codes(&found).iter().any(|(code, _)| *code == "no-rescale"), "{:?}", found.warnings);
    }
    // A scale that the header says is not that of HU.
    let other: Vec<Slice> = near().into_iter().map(|s| s.with((0x28, 0x1054), "US")).collect();
    assert_eq!(codes(&read(&other).unwrap()), [("no-rescale", Severity::Check)]);
    let hu: Vec<Slice> = near().into_iter().map(|s| s.with((0x28, 0x1054), "HU")).collect();
    assert_eq!(codes(&read(&hu).unwrap()), []);
}

#[test]
fn a_series_of_which_some_images_have_no_rescale_is_refused() {
    let mut slices = near();
    slices[1].rescaled = false;
    let refused = refused(&slices);
    assert!(refused.contains("1 of 5 images have no rescale slope or intercept, the others have one"), "{refused}");
}

#[test]
fn padding_beyond_the_stored_bits_becomes_air() {
    // -2000 in words of 16 bits, of which 12 are stored: cut to 12 bits it is 2096, which would be bone.
    let mut slices = near();
    for slice in &mut slices {
        (slice.signed, slice.bits, slice.padding, slice.intercept) = (false, (16, 11), Some(-2000), -1024.0);
        slice.pixels.iter_mut().for_each(|p| *p = (*p + 1000) % 4000);
        slice.pixels[..12].fill(-2000);
    }
    let found = read(&slices).unwrap();
    assert!(found.volume.hu.chunks(COLUMNS * ROWS).all(|plane| plane[..12].iter().all(|hu| *hu == -1024)));
    assert_eq!(codes(&found), [("padding-set-to-air", Severity::Info)]);
}
