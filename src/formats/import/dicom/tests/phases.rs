//! Tests of several acquisitions, phases and reconstructions in one series.

use super::enhanced::enhanced;
use super::*;

const ACQUISITION: (u16, u16) = (0x20, 0x12);
const TEMPORAL: (u16, u16) = (0x20, 0x100);
const TIME: (u16, u16) = (8, 0x32);
const KERNEL: (u16, u16) = (0x18, 0x1210);
const VOLTAGE: (u16, u16) = (0x18, 0x60);
const NUMBER: (u16, u16) = (0x20, 0x13);
const TEMPORAL_INDEX: (u16, u16) = (0x20, 0x9128);

/// Slice `k` of a stack whose values are shifted by 10 HU a stack.
fn slice(k: usize, stack: usize) -> Slice {
    let mut slice = Slice::near(k, EXPLICIT);
    slice.pixels.iter_mut().for_each(|p| *p += 10 * stack as i32);
    slice
}

fn stack_of(stack: usize) -> Vec<i16> {
    (0..5).flat_map(|k| slice(k, stack).expected()).collect()
}

fn ask(zip: &[u8], stack: Option<usize>) -> Result<VolumeRead, String> {
    let settings = VolumeSettings { stack, ..VolumeSettings::default() };
    volume_with(zip, &Limits::default(), &settings).map_err(|e| e.to_string())
}

#[test]
fn stacks_at_the_same_positions_are_listed_and_chosen() {
    // One attribute, two together, the order by time, and that by number.
    type Label = fn(Slice, usize, usize) -> Slice;
    let cases: [(&str, usize, Label, &[&str]); 6] = [
        ("acquisition", 2, |s, _, stack| s.with(ACQUISITION, stack + 3), &["acquisition 3", "acquisition 4"]),
        ("temporal position", 3, |s, _, stack| s.with(TEMPORAL, stack + 1), &["temporal position 3"]),
        (
            "kernel",
            2,
            |s, _, stack| s.with(KERNEL, ["B30f NAME", "H60s NAME"][stack]),
            &["kernel no. 1", "kernel no. 2"],
        ),
        (
            "two attributes",
            4,
            |s, _, stack| s.with(ACQUISITION, 1 + stack / 2).with(VOLTAGE, [80, 140][stack % 2]),
            &["acquisition 1, 80 kV", "acquisition 2, 140 kV"],
        ),
        (
            "time",
            2,
            |s, k, stack| s.with(TIME, format!("1015{:02}.5", 4 * k + 2 * stack)),
            &["0.0 s after the first", "2.0 s after the first"],
        ),
        ("number", 2, |s, k, stack| s.with(NUMBER, 1 + 2 * k + stack), &["stack 1", "stack 2"]),
    ];
    for (what, n, label, parts) in cases {
        let slices: Vec<Slice> =
            (0..n).flat_map(|stack| (0..5).map(move |k| label(slice(k, stack), k, stack))).collect();
        let zip = series(&slices);
        let refused = ask(&zip, None).unwrap_err();
        assert!(refused.contains("two different images") && refused.contains("choose one with `stack`"), "{refused}");
        assert!(refused.contains("5 of 12 x 10 pixels") && refused.contains("to (-50.0, -40.0, 16.0) mm"), "{refused}");
        assert!(!refused.contains("NAME") && !refused.contains("B30"), "{refused}");
        for part in parts {
            assert!(refused.contains(part), "{what}: {refused}");
        }
        for stack in 0..n {
            let found = ask(&zip, Some(stack + 1)).unwrap();
            assert!(found.volume.hu == stack_of(stack), "{what}: {stack}");
            assert_eq!(found.warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["files-skipped"], "{what}");
        }
        for outside in [0, n + 1] {
            let refused = ask(&zip, Some(outside)).unwrap_err();
            assert!(refused.contains(&format!("the series has {n}: stack 1")), "{refused}");
        }
    }
}

#[test]
fn the_time_points_of_an_enhanced_image_are_listed_and_chosen() {
    for syntax in [IMPLICIT, EXPLICIT, BIG] {
        let frames: Vec<Slice> =
            (0..10).map(|at| Slice { syntax, ..slice(at / 2, at % 2) }.with(TEMPORAL_INDEX, 1 + at % 2)).collect();
        let file = enhanced(&frames, true, 1, 10);
        assert!(ask(&file, None).unwrap_err().contains("temporal position 2"), "{syntax}");
        for stack in 0..2 {
            assert!(ask(&file, Some(stack + 1)).unwrap().volume.hu == stack_of(stack), "{syntax}");
        }
    }
}

#[test]
fn what_nothing_tells_apart_is_refused_and_equal_images_are_one() {
    let mixed: Vec<Slice> = (0..10).map(|at| slice(at % 5, at / 5)).collect();
    let refused = ask(&series(&mixed), None).unwrap_err();
    assert!(refused.ends_with("mixes scans, phases or reconstructions"), "{refused}");
    assert!(ask(&series(&mixed), Some(2)).unwrap_err().contains("the series has 1: stack 1"));
    // A series that was exported twice: the copies differ only in their acquisition.
    let twice: Vec<Slice> = (0..10).map(|at| slice(at % 5, 0).with(ACQUISITION, at / 5)).collect();
    let found = ask(&series(&twice), None).unwrap();
    assert!(found.volume.hu == stack_of(0));
    assert_eq!(found.warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["files-skipped", "duplicate-images"]);
}

#[test]
fn directions_are_stacks_too() {
    let mut slices: Vec<Slice> = (0..5).map(|k| slice(k, 0)).collect();
    slices.extend((0..4).map(|k| Slice {
        orientation: [0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        position: [4.0 * k as f64, 0.0, 0.0],
        ..slice(k, 1)
    }));
    let zip = series(&slices);
    let refused = ask(&zip, None).unwrap_err();
    assert!(refused.contains("stack 1: 5 of") && refused.contains("stack 2: 4 of"), "{refused}");
    assert_eq!(ask(&zip, Some(1)).unwrap().volume.dims[2], 5);
    let found = ask(&zip, Some(2)).unwrap().volume;
    assert_eq!((found.dims[2], found.axes[2]), (4, Vector::x() * 4.0));
}

#[test]
fn acquisitions_between_each_other_give_a_warning_and_in_turn_none() {
    let with = |acquisition: fn(usize) -> usize| {
        let slices: Vec<Slice> = (0..8).map(|k| slice(k, 0).with(ACQUISITION, acquisition(k))).collect();
        series(&slices)
    };
    let odd = with(|k| k % 2);
    let found = ask(&odd, None).unwrap();
    assert_eq!(found.volume.dims[2], 8);
    let warning = found.warnings.iter().find(|w| w.code == "interleaved-stacks").unwrap();
    assert!(warning.message.contains("stack 2: 4 of"), "{warning}");
    let one = ask(&odd, Some(2)).unwrap().volume;
    assert_eq!((one.dims[2], one.origin.z, one.axes[2].z), (4, 4.0, 8.0));
    // Step and shoot: four slices a turn.
    let found = ask(&with(|k| k / 4), None).unwrap();
    assert_eq!(found.warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["files-skipped"]);
}
