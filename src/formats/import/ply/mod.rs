//! Reads PLY files, ASCII or binary of either byte order.

mod header;
mod payload;
#[cfg(test)]
mod tests;

use header::{Element, ElementKind, Header, Role};
use payload::Values;

use super::error::{at_most, malformed};
use super::polygon::MAX_CORNERS;
use super::raw_surface::{Faces, RawSurface};
use super::{ImportError, Limits};
use prosopon_geometry::{Point, Warning};

const FORMAT: &str = "PLY";

/// Whether these are the bytes of a PLY file.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r")
}

/// Reads the elements `vertex` (`x`, `y`, `z`) and `face` (`vertex_indices` or `vertex_index`); skips all others.
pub(super) fn read(bytes: &[u8], limits: &Limits) -> Result<RawSurface, ImportError> {
    let header = Header::read(bytes)?;
    let mut values = Values::new(header.values, header.encoding, header.values_line);
    let mut positions = Vec::new();
    let mut faces = Faces::new(FORMAT, limits);
    for element in &header.elements {
        match element.kind {
            ElementKind::Vertex => at_most("vertices", element.count, limits.max_triangles.saturating_mul(3))?,
            ElementKind::Face => at_most("faces", element.count, limits.max_triangles)?,
            ElementKind::Other => {}
        }
        values.check_length(element)?;
        match element.kind {
            ElementKind::Vertex => positions = vertices(element, &mut values)?,
            ElementKind::Face => read_faces(element, &mut values, &positions, &mut faces)?,
            ElementKind::Other => skip(element, &mut values)?,
        }
    }
    let mut surface = RawSurface { stated: header.stated, ..faces.finish(positions) };
    if values.left_over() > 0 {
        let found = format!("{} bytes after the last element were ignored", values.left_over());
        surface.warnings.push(Warning::check("bytes-after-elements", found).act("Check that the surface is complete."));
    }
    Ok(surface)
}

fn vertices(element: &Element, values: &mut Values<'_>) -> Result<Vec<Point>, ImportError> {
    let mut positions = Vec::with_capacity(usize::try_from(element.count).unwrap_or(0));
    for index in 0..element.count {
        positions.push(vertex(element, values).ok_or_else(|| unreadable("vertex", index, values))?);
    }
    Ok(positions)
}

fn vertex(element: &Element, values: &mut Values<'_>) -> Option<Point> {
    let mut point = Point::origin();
    for property in &element.properties {
        match property.role {
            Role::X => point.x = values.scalar(property.number_type)?,
            Role::Y => point.y = values.scalar(property.number_type)?,
            Role::Z => point.z = values.scalar(property.number_type)?,
            Role::Corners | Role::Other => values.skip(property)?,
        }
    }
    values.end_of_element().then_some(point)
}

fn read_faces(
    element: &Element,
    values: &mut Values<'_>,
    positions: &[Point],
    faces: &mut Faces,
) -> Result<(), ImportError> {
    let mut corners = Vec::new();
    for index in 0..element.count {
        face(element, values, &mut corners).ok_or_else(|| unreadable("face", index, values))?;
        faces.push(positions, &corners)?;
    }
    Ok(())
}

/// Reads one face. Keeps one corner more than a face may have, which marks the face as too large, and drops the rest.
fn face(element: &Element, values: &mut Values<'_>, corners: &mut Vec<u32>) -> Option<()> {
    corners.clear();
    for property in &element.properties {
        let (Role::Corners, Some(count_type)) = (property.role, property.count_type) else {
            values.skip(property)?;
            continue;
        };
        for _ in 0..values.index(count_type)? {
            let corner = values.index(property.number_type)?;
            if corners.len() <= MAX_CORNERS {
                corners.push(corner);
            }
        }
    }
    values.end_of_element().then_some(())
}

fn skip(element: &Element, values: &mut Values<'_>) -> Result<(), ImportError> {
    if element.properties.is_empty() {
        return Ok(()); // Its instances take no bytes, whatever their number.
    }
    for index in 0..element.count {
        let whole = element.properties.iter().try_for_each(|property| values.skip(property));
        if whole.is_none() || !values.end_of_element() {
            return Err(unreadable("element", index, values));
        }
    }
    Ok(())
}

fn unreadable(what: &str, index: u64, values: &Values<'_>) -> ImportError {
    let place = values.place();
    malformed(FORMAT, format!("{what} {index}{place}: a value is missing, is not a valid number, or is one too many"))
}
