//! DICOM files to upload.

use std::io::{Cursor, Write};

use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// The patient's name in every file.
pub(crate) const NAME: &str = "NAME^OF PATIENT";

fn text(file: &mut Vec<u8>, tag: [u16; 2], vr: &[u8; 2], value: &str) {
    let value = if value.len().is_multiple_of(2) { value.to_owned() } else { format!("{value} ") };
    element(file, tag, vr, value.as_bytes());
}

fn element(file: &mut Vec<u8>, tag: [u16; 2], vr: &[u8; 2], value: &[u8]) {
    tag.iter().for_each(|t| file.extend(t.to_le_bytes()));
    file.extend(vr);
    if vr == b"OW" {
        file.extend([0; 2]);
        file.extend((value.len() as u32).to_le_bytes());
    } else {
        file.extend((value.len() as u16).to_le_bytes());
    }
    file.extend(value);
}

/// A slice of 8 x 8 pixels, explicit little endian, with a patient's name.
pub(crate) fn slice(series: &str, k: usize, height_mm: f64) -> Vec<u8> {
    let mut file = vec![0; 128];
    file.extend(b"DICM");
    text(&mut file, [2, 0x10], b"UI", "1.2.840.10008.1.2.1\0");
    text(&mut file, [8, 0x60], b"CS", "CT");
    text(&mut file, [0x10, 0x10], b"PN", NAME);
    text(&mut file, [0x20, 0x0e], b"UI", series);
    text(&mut file, [0x20, 0x32], b"DS", &format!("0\\0\\{height_mm}"));
    text(&mut file, [0x20, 0x37], b"DS", "1\\0\\0\\0\\1\\0");
    for (at, value) in [(0x10, 8u16), (0x11, 8), (0x100, 16), (0x101, 16), (0x102, 15), (0x103, 1)] {
        if at == 0x100 {
            text(&mut file, [0x28, 0x30], b"DS", "10\\10");
        }
        element(&mut file, [0x28, at], b"US", &value.to_le_bytes());
    }
    text(&mut file, [0x28, 0x1052], b"DS", "0");
    text(&mut file, [0x28, 0x1053], b"DS", "1");
    let pixels: Vec<u8> = (0..64i16).flat_map(|i| (i * 20 + k as i16 - 1000).to_le_bytes()).collect();
    element(&mut file, [0x7fe0, 0x10], b"OW", &pixels);
    file
}

/// A ZIP archive of these files, in a folder named after the patient.
pub(crate) fn archive(files: &[Vec<u8>]) -> Vec<u8> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (number, file) in files.iter().enumerate() {
        archive.start_file(format!("{NAME}/{number}"), SimpleFileOptions::default()).unwrap();
        archive.write_all(file).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

/// A series with slices at these heights, mm.
pub(crate) fn stack(heights: &[f64]) -> Vec<Vec<u8>> {
    heights.iter().enumerate().map(|(k, z)| slice("1.2.3.4", k, *z)).collect()
}
