//! Reads STL files, binary or ASCII.

use super::error::{at_most, malformed};
use super::raw_surface::RawSurface;
use super::text::{Words, number};
use super::{ImportError, Limits};
use prosopon_geometry::{Point, Warning};

const FORMAT: &str = "STL";
/// Bytes of the header: a comment of 80 bytes and the number of triangles.
const HEAD: usize = 84;
/// Bytes of a triangle: normal and three corners (12 `f32`) and two unused bytes.
const RECORD: usize = 50;

/// Whether these are the bytes of an STL file.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    // Some writers pad the end of the file.
    let spare = stated_count(bytes).filter(|n| *n > 0).and_then(|n| (bytes.len() as u64).checked_sub(binary_length(n)));
    spare.is_some_and(|spare| spare < 4096) || is_whole_binary(bytes) || is_text(bytes)
}

/// Reads either kind. The length decides between them: the comment of a binary file may begin with "solid".
pub(super) fn read(bytes: &[u8], limits: &Limits) -> Result<RawSurface, ImportError> {
    let mut warnings = Vec::new();
    let corners = if !is_whole_binary(bytes) && is_text(bytes) {
        read_text(bytes, limits)?
    } else {
        read_binary(bytes, limits, &mut warnings)?
    };
    let (positions, triangles) = merge(&corners);
    Ok(RawSurface { positions, triangles, warnings })
}

fn stated_count(bytes: &[u8]) -> Option<u32> {
    bytes.get(80..HEAD)?.first_chunk::<4>().map(|b| u32::from_le_bytes(*b))
}

/// Length of a binary file of `count` triangles, bytes.
fn binary_length(count: u32) -> u64 {
    u64::from(count).saturating_mul(RECORD as u64).saturating_add(HEAD as u64)
}

fn is_whole_binary(bytes: &[u8]) -> bool {
    stated_count(bytes).is_some_and(|n| binary_length(n) == bytes.len() as u64)
}

fn is_text(bytes: &[u8]) -> bool {
    let text = bytes.trim_ascii_start();
    let solid = text.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    // Text holds no zero byte; a padded comment, small counts and floats do.
    solid && !text.iter().take(512).any(|&c| c == 0)
}

fn read_binary(bytes: &[u8], limits: &Limits, warnings: &mut Vec<Warning>) -> Result<Vec<[Point; 3]>, ImportError> {
    let Some(count) = stated_count(bytes) else {
        return Err(malformed(FORMAT, format!("{} bytes, but the header alone has {HEAD}", bytes.len())));
    };
    at_most("triangles", u64::from(count), limits.max_triangles)?;
    let (found, expected) = (bytes.len() as u64, binary_length(count));
    if found < expected {
        let detail = format!("the header states {count} triangles ({expected} bytes), but the file has {found}");
        return Err(malformed(FORMAT, detail));
    }
    if found > expected {
        let spare = format!("{} bytes after the last triangle were ignored", found.saturating_sub(expected));
        warnings.push(Warning::check("bytes-after-triangles", spare).act("Check that the surface is complete."));
    }
    let (records, _) = bytes.get(HEAD..).unwrap_or_default().as_chunks::<RECORD>();
    let mut triangles = Vec::with_capacity(count as usize);
    for (index, record) in records.iter().take(count as usize).enumerate() {
        let mut coordinates = [0.0; 9];
        let (floats, _) = record.as_chunks::<4>();
        for (coordinate, float) in coordinates.iter_mut().zip(floats.iter().skip(3)) {
            *coordinate = f64::from(f32::from_le_bytes(*float));
        }
        let [ax, ay, az, bx, by, bz, cx, cy, cz] = coordinates;
        if !coordinates.iter().all(|c| c.is_finite()) {
            return Err(malformed(FORMAT, format!("triangle {index} has a coordinate that is not finite")));
        }
        triangles.push([Point::new(ax, ay, az), Point::new(bx, by, bz), Point::new(cx, cy, cz)]);
    }
    Ok(triangles)
}

/// Reads any number of `solid … { facet normal x y z; outer loop; 3 × vertex x y z; endloop; endfacet }* endsolid …`.
///
/// Without an end of the last solid the file was cut off.
fn read_text(bytes: &[u8], limits: &Limits) -> Result<Vec<[Point; 3]>, ImportError> {
    let mut words = Words::new(bytes, 1);
    let mut triangles: Vec<[Point; 3]> = Vec::new();
    let mut open = false;
    while let Some(word) = words.next() {
        let is = |keyword: &str| word.eq_ignore_ascii_case(keyword.as_bytes());
        if is("solid") || is("endsolid") {
            open = is("solid");
            words.skip_line();
        } else if is("facet") && open {
            triangles.push(facet(&mut words)?);
            at_most("triangles", triangles.len() as u64, limits.max_triangles)?;
        } else {
            return Err(expected("`facet` or `endsolid`", &words));
        }
    }
    if open {
        return Err(malformed(FORMAT, format!("cut off: ends on line {} without `endsolid`", words.line())));
    }
    Ok(triangles)
}

/// Reads what follows the word `facet`.
fn facet(words: &mut Words<'_>) -> Result<[Point; 3], ImportError> {
    keywords(words, &["normal"])?;
    // The stored normal is ignored: it follows from the order of the corners, and some writers store NaN.
    for _ in 0..3 {
        words.next().and_then(number).ok_or_else(|| expected("a number", words))?;
    }
    keywords(words, &["outer", "loop"])?;
    let mut corners = [Point::origin(); 3];
    for corner in &mut corners {
        keywords(words, &["vertex"])?;
        for coordinate in corner.iter_mut() {
            *coordinate =
                words.next_number().filter(|x| x.is_finite()).ok_or_else(|| expected("a finite number", words))?;
        }
    }
    keywords(words, &["endloop", "endfacet"])?;
    Ok(corners)
}

fn keywords(words: &mut Words<'_>, sequence: &[&str]) -> Result<(), ImportError> {
    for keyword in sequence {
        let found = words.next().is_some_and(|word| word.eq_ignore_ascii_case(keyword.as_bytes()));
        if !found {
            return Err(expected(&format!("`{keyword}`"), words));
        }
    }
    Ok(())
}

fn expected(what: &str, words: &Words<'_>) -> ImportError {
    malformed(FORMAT, format!("line {}: expected {what}", words.line()))
}

/// Merges corners at the same coordinates into one vertex; vertices have the order of their first corner.
///
/// Sorts the corners, because crafted coordinates could slow down a hash table.
#[expect(clippy::indexing_slicing, reason = "indices run over the corners")]
fn merge(triangles: &[[Point; 3]]) -> (Vec<Point>, Vec<[u32; 3]>) {
    let corners = triangles.as_flattened();
    // -0 and 0 are the same coordinate.
    let key = |corner: u32| corners[corner as usize].coords.map(|x| x + 0.0);
    let order = |a: &u32, b: &u32| {
        let (p, q) = (key(*a), key(*b));
        p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)).then(p.z.total_cmp(&q.z)).then(a.cmp(b))
    };
    let mut sorted: Vec<u32> = (0..corners.len() as u32).collect();
    sorted.sort_unstable_by(order);
    // For each corner, the first corner at the same coordinates.
    let mut first = vec![0u32; corners.len()];
    let mut group = 0;
    for (rank, &corner) in sorted.iter().enumerate() {
        if key(sorted[group]) != key(corner) {
            group = rank;
        }
        first[corner as usize] = sorted[group];
    }
    let mut vertex = vec![0u32; corners.len()];
    let mut positions = Vec::new();
    for corner in 0..corners.len() {
        let leader = first[corner] as usize;
        if leader == corner {
            vertex[corner] = positions.len() as u32;
            positions.push(corners[corner]);
        }
        vertex[corner] = vertex[leader];
    }
    let (triangles, _) = vertex.as_chunks::<3>();
    (positions, triangles.to_vec())
}
