//! Tests of enhanced images: all frames in one file, each with its own position.

use super::*;

impl Writer {
    fn nested(&self, fill: impl FnOnce(&mut Writer)) -> Vec<u8> {
        let mut inside = Writer { bytes: Vec::new(), explicit: self.explicit, little: self.little };
        fill(&mut inside);
        inside.bytes
    }

    /// A sequence with these items, both of undefined or both of explicit length.
    fn items(&mut self, tag: (u16, u16), items: &[Vec<u8>], open: bool) {
        self.tag(tag);
        if self.explicit {
            self.bytes.extend(b"SQ\0\0");
        }
        let length = |n: usize| if open { u32::MAX } else { n as u32 };
        self.u32(length(items.iter().map(|i| i.len() + 8).sum()));
        for item in items {
            self.tag((0xfffe, 0xe000));
            self.u32(length(item.len()));
            self.bytes.extend(item);
            if open {
                self.tag((0xfffe, 0xe00d));
                self.u32(0);
            }
        }
        if open {
            self.tag((0xfffe, 0xe0dd));
            self.u32(0);
        }
    }
}

/// The slices as frames of one file, each with `fragments` of encapsulated pixels.
pub(super) fn enhanced(slices: &[Slice], open: bool, fragments: usize, described: usize) -> Vec<u8> {
    let first = &slices[0];
    let mut set = Writer { bytes: Vec::new(), explicit: first.syntax != IMPLICIT, little: first.syntax != BIG };
    let text = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join("\\");
    set.text((8, 8), b"CS", first.kind);
    set.text((8, 0x60), b"CS", first.modality);
    set.text((0x20, 0x0e), b"UI", first.series);
    set.number((0x28, 2), 1);
    set.text((0x28, 8), b"IS", &slices.len().to_string());
    set.number((0x28, 0x10), ROWS as u16);
    set.number((0x28, 0x11), COLUMNS as u16);
    set.number((0x28, 0x100), first.bits.0);
    set.number((0x28, 0x101), first.bits.1 + 1);
    set.number((0x28, 0x102), first.bits.1);
    set.number((0x28, 0x103), u16::from(first.signed));
    let group = |set: &Writer, fill: &dyn Fn(&mut Writer)| vec![set.nested(|w| fill(w))];
    let shared = set.nested(|w| {
        w.items((0x20, 0x9116), &group(w, &|g| g.text((0x20, 0x37), b"DS", &text(&first.orientation))), open);
        w.items((0x28, 0x9110), &group(w, &|g| g.text((0x28, 0x30), b"DS", "8\\10")), !open);
    });
    set.items((0x5200, 0x9229), &[shared], open);
    let own: Vec<Vec<u8>> = slices[..described]
        .iter()
        .map(|s| {
            set.nested(|w| {
                w.items((0x20, 0x9113), &group(w, &|g| g.text((0x20, 0x32), b"DS", &text(&s.position))), open);
                let scale = |g: &mut Writer| {
                    g.text((0x28, 0x1052), b"DS", &s.intercept.to_string());
                    g.text((0x28, 0x1053), b"DS", &s.slope.to_string());
                };
                w.items((0x28, 0x9145), &group(w, &scale), !open);
                let content = |g: &mut Writer| {
                    s.extra.iter().for_each(|(tag, number)| {
                        let number: u32 = number.parse().unwrap();
                        let bytes = if g.little { number.to_le_bytes() } else { number.to_be_bytes() };
                        g.bytes(*tag, b"UL", &bytes);
                    })
                };
                w.items((0x20, 0x9111), &group(w, &content), open);
            })
        })
        .collect();
    set.items((0x5200, 0x9230), &own, open);
    let words = |s: &Slice| s.pixels.iter().map(|p| *p as u16).collect::<Vec<u16>>();
    if first.syntax == RLE {
        set.tag((0x7fe0, 0x10));
        set.bytes.extend(b"OB\0\0");
        set.u32(u32::MAX);
        let mut parts = vec![Vec::new()];
        for packed in slices.iter().map(|s| rle(&words(s))) {
            parts.extend(packed.chunks(packed.len().div_ceil(fragments)).map(<[u8]>::to_vec));
        }
        for part in &parts {
            set.tag((0xfffe, 0xe000));
            set.u32(part.len() as u32);
            set.bytes.extend(part);
        }
        set.tag((0xfffe, 0xe0dd));
        set.u32(0);
    } else {
        let bytes: Vec<u8> = slices
            .iter()
            .flat_map(words)
            .flat_map(|w| if first.syntax == BIG { w.to_be_bytes() } else { w.to_le_bytes() })
            .collect();
        set.bytes((0x7fe0, 0x10), b"OW", &bytes);
    }
    let mut meta = Writer { bytes: Vec::new(), explicit: true, little: true };
    meta.text((2, 0x10), b"UI", first.syntax);
    [vec![0; 128], b"DICM".to_vec(), meta.bytes, set.bytes].concat()
}

/// Frames out of order, each with its own scale.
fn frames(syntax: &'static str) -> Vec<Slice> {
    let scaled = |k: usize| Slice { slope: 1.0, intercept: k as f64, ..Slice::near(k, syntax) };
    [2, 0, 4, 1, 3].map(scaled).to_vec()
}

#[test]
fn frames_of_an_enhanced_image_make_the_volume_that_single_files_make() {
    for syntax in [IMPLICIT, EXPLICIT, BIG, RLE] {
        let frames = frames(syntax);
        let files: Vec<(String, Vec<u8>)> =
            frames.iter().enumerate().map(|(i, s)| (format!("{i}"), s.file())).collect();
        let (expected, _) = volume(&archive(&files), &Limits::default()).unwrap();
        for open in [false, true] {
            let whole = enhanced(&frames, open, 1, frames.len());
            let (found, _) = volume(&whole, &Limits::default()).unwrap();
            assert!(found == expected, "{syntax} {open}");
            let (zipped, _) = volume(&archive(&[("a".to_owned(), whole)]), &Limits::default()).unwrap();
            assert!(zipped == expected, "{syntax} {open} in an archive");
        }
    }
}

#[test]
fn frames_that_cannot_be_told_apart_are_refused() {
    let refused = |bytes: &[u8]| volume(bytes, &Limits::default()).unwrap_err().to_string();
    assert!(refused(&enhanced(&frames(RLE), true, 2, 5)).contains("5 frames are in 10 fragments"));
    assert!(refused(&enhanced(&frames(EXPLICIT), true, 1, 4)).contains("several frames without positions"));
    // Pixels that end early.
    let mut short = enhanced(&frames(EXPLICIT), false, 1, 5);
    short.truncate(short.len() - 100);
    assert!(!refused(&short).is_empty());
}
