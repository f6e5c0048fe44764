//! Reads STL files, binary or ASCII.

use super::error::{at_most, malformed};
use super::raw_surface::RawSurface;
use super::stated::Stated;
use super::text::Words;
use super::{ImportError, Limits};
use prosopon_geometry::{Point, Warning, Welder};

const FORMAT: &str = "STL";
/// Bytes of the comment at the beginning of a binary file.
const COMMENT: usize = 80;
/// Bytes of the header: a comment and the number of triangles.
const HEAD: usize = 84;
/// Bytes of a triangle: normal and three corners (12 `f32`) and two unused bytes.
const RECORD: usize = 50;
/// Bytes that writers may add to the end of a file as padding.
const MAX_PADDING: u64 = 4096;

/// Whether these are the bytes of an STL file.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    let spare = stated_count(bytes).filter(|n| *n > 0).and_then(|n| (bytes.len() as u64).checked_sub(binary_length(n)));
    spare.is_some_and(|spare| spare < MAX_PADDING)
        || is_whole_binary(bytes)
        || is_text(bytes)
        || stated_count(bytes).is_some_and(|n| n > 0 && follows_attributes(bytes, n))
        || whole_records(bytes).is_some_and(|n| stated_count(bytes).is_some_and(|count| count < n || count == u32::MAX))
            && are_plausible(records(bytes).iter().take(100))
}

/// Reads either kind. The length decides between them: the comment of a binary file may begin with "solid".
pub(super) fn read(bytes: &[u8], limits: &Limits) -> Result<RawSurface, ImportError> {
    if !is_whole_binary(bytes) && is_text(bytes) { read_text(bytes, limits) } else { read_binary(bytes, limits) }
}

fn stated_count(bytes: &[u8]) -> Option<u32> {
    bytes.get(COMMENT..HEAD)?.first_chunk::<4>().map(|b| u32::from_le_bytes(*b))
}

/// Number of triangles that the length of a binary file allows, if it holds whole ones only.
fn whole_records(bytes: &[u8]) -> Option<u32> {
    let (records, rest) = bytes.get(HEAD..)?.as_chunks::<RECORD>();
    u32::try_from(records.len()).ok().filter(|n| *n > 0 && rest.is_empty())
}

fn records(bytes: &[u8]) -> &[[u8; RECORD]] {
    bytes.get(HEAD..).unwrap_or_default().as_chunks::<RECORD>().0
}

/// Length of a binary file of `count` triangles, bytes.
fn binary_length(count: u32) -> u64 {
    u64::from(count).saturating_mul(RECORD as u64).saturating_add(HEAD as u64)
}

/// Whether a binary file is as long as its header states.
pub(super) fn is_whole_binary(bytes: &[u8]) -> bool {
    stated_count(bytes).is_some_and(|n| binary_length(n) == bytes.len() as u64)
}

fn is_text(bytes: &[u8]) -> bool {
    let text = bytes.trim_ascii_start();
    let solid = text.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    // Text holds no zero byte; a padded comment, small counts and floats do.
    solid && !text.iter().take(512).any(|&c| c == 0)
}

/// The coordinates of the three corners.
fn coordinates(record: &[u8; RECORD]) -> [f32; 9] {
    let mut coordinates = [0.0; 9];
    let (floats, _) = record.as_chunks::<4>();
    for (coordinate, float) in coordinates.iter_mut().zip(floats.iter().skip(3)) {
        *coordinate = f32::from_le_bytes(*float);
    }
    coordinates
}

/// Whether all coordinates may be those of a body; other bytes, read as floats, soon are not.
fn are_plausible<'a>(mut records: impl Iterator<Item = &'a [u8; RECORD]>) -> bool {
    records.all(|record| coordinates(record).iter().all(|c| c.abs() < 1e5))
}

fn read_binary(bytes: &[u8], limits: &Limits) -> Result<RawSurface, ImportError> {
    let mut warnings = Vec::new();
    let count = binary_count(bytes, limits, &mut warnings)?;
    let mut welder = Welder::with_capacity((count / 2) as usize);
    let mut triangles = Vec::with_capacity(count as usize);
    for (index, record) in records(bytes).iter().take(count as usize).enumerate() {
        let coordinates = coordinates(record);
        if !coordinates.iter().all(|c| c.is_finite()) {
            return Err(malformed(FORMAT, format!("triangle {index} has a coordinate that is not finite")));
        }
        let [ax, ay, az, bx, by, bz, cx, cy, cz] = coordinates.map(f64::from);
        triangles.push([[ax, ay, az], [bx, by, bz], [cx, cy, cz]].map(|p| welder.number(Point::from(p))));
    }
    let mut stated = Stated::default();
    stated.read(bytes.get(..COMMENT).unwrap_or_default());
    Ok(RawSurface { positions: welder.into_positions(), triangles, warnings, stated, is_welded: true })
}

/// Number of triangles to read from a binary file, from its header or its length.
fn binary_count(bytes: &[u8], limits: &Limits, warnings: &mut Vec<Warning>) -> Result<u32, ImportError> {
    let Some(count) = stated_count(bytes) else {
        return Err(malformed(FORMAT, format!("{} bytes, but the header alone has {HEAD}", bytes.len())));
    };
    // Writers that do not know the number beforehand leave 0 or the largest number.
    if let Some(whole) = whole_records(bytes)
        && matches!(count, 0 | u32::MAX)
    {
        at_most("triangles", u64::from(whole), limits.max_triangles)?;
        let found = format!("the header states {count} triangles; the length of the file shows that it holds {whole}");
        warnings.push(Warning::info("count-from-length", found));
        return Ok(whole);
    }
    at_most("triangles", u64::from(count), limits.max_triangles)?;
    let (found, expected) = (bytes.len() as u64, binary_length(count));
    if found < expected {
        let detail = format!("the header states {count} triangles ({expected} bytes), but the file has {found}");
        return Err(malformed(FORMAT, detail));
    }
    if found == expected {
        return Ok(count);
    }
    let spare = found.saturating_sub(expected);
    if follows_attributes(bytes, count) {
        let reason = "bytes of the writer's own follow triangles, as their attribute byte counts say: export it without attributes";
        return Err(too_long(count, expected, found, reason));
    }
    if let Some(whole) = whole_records(bytes)
        && are_plausible(records(bytes).iter())
    {
        at_most("triangles", u64::from(whole), limits.max_triangles)?;
        let found = format!("the header states {count} triangles, but the file is as long as {whole}, which were read");
        warnings.push(Warning::check("count-from-length", found).act("Check that the surface is complete."));
        return Ok(whole);
    }
    if spare >= MAX_PADDING || !are_plausible(records(bytes).iter().take(count as usize)) {
        let reason = "bytes of the writer's own stand between or after the triangles: export it as plain STL";
        return Err(too_long(count, expected, found, reason));
    }
    let ignored = format!("{spare} bytes after the last triangle were ignored");
    warnings.push(Warning::check("bytes-after-triangles", ignored).act("Check that the surface is complete."));
    Ok(count)
}

fn too_long(count: u32, expected: u64, found: u64, reason: &str) -> ImportError {
    let spare = found.saturating_sub(expected);
    let sizes =
        format!("the header states {count} triangles ({expected} bytes), but the file has {found}, {spare} too many");
    malformed(FORMAT, format!("{sizes}; {reason}"))
}

/// Whether the file ends where it does when each triangle is followed by as many bytes as its last two bytes say.
fn follows_attributes(bytes: &[u8], count: u32) -> bool {
    let mut rest = bytes.get(HEAD..).unwrap_or_default();
    for _ in 0..count {
        let Some((record, after)) = rest.split_first_chunk::<RECORD>() else { return false };
        let attribute = record.last_chunk::<2>().map_or(0, |b| u16::from_le_bytes(*b));
        let Some(after) = after.get(usize::from(attribute)..) else { return false };
        rest = after;
    }
    rest.is_empty()
}

/// Reads any number of `solid … { facet normal x y z; outer loop; 3 × vertex x y z; endloop; endfacet }* endsolid …`.
///
/// Without an end of the last solid the file was cut off.
fn read_text(bytes: &[u8], limits: &Limits) -> Result<RawSurface, ImportError> {
    let mut words = Words::new(bytes, 1);
    let mut surface = RawSurface { is_welded: true, ..RawSurface::default() };
    let mut welder = Welder::default();
    let mut open = false;
    while let Some(word) = words.next() {
        let is = |keyword: &str| word.eq_ignore_ascii_case(keyword.as_bytes());
        if is("solid") || is("endsolid") {
            open = is("solid");
            surface.stated.read(words.rest_of_line());
        } else if is("facet") && open {
            surface.triangles.push(facet(&mut words)?.map(|p| welder.number(p)));
            at_most("triangles", surface.triangles.len() as u64, limits.max_triangles)?;
        } else {
            return Err(expected("`facet` or `endsolid`", &words));
        }
    }
    if open {
        return Err(malformed(FORMAT, format!("cut off: ends on line {} without `endsolid`", words.line())));
    }
    surface.positions = welder.into_positions();
    Ok(surface)
}

/// Reads what follows the word `facet`.
fn facet(words: &mut Words<'_>) -> Result<[Point; 3], ImportError> {
    keywords(words, &["normal"])?;
    // The stored normal is not used, since it follows from the order of the corners. Programs write what is no number there:
    // `nan`, `-nan(ind)`, `-1.#IND`.
    for n in 0.. {
        let word = words.next();
        if word.is_some_and(|word| word.eq_ignore_ascii_case(b"outer")) {
            break;
        }
        if word.is_none() || n == 3 {
            return Err(expected("`outer`", words));
        }
    }
    keywords(words, &["loop"])?;
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

#[cfg(test)]
mod tests;
