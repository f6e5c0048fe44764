//! Lengths of points, directions and ranges, which utoipa gives as arrays of any length.

use utoipa::openapi::schema::{AdditionalProperties, Array, ArrayItems};
use utoipa::openapi::{RefOr, Schema};

/// Members that are two numbers, or lists of these.
const PAIRS: [&str; 10] = [
    "after_yz_mm",
    "before_yz_mm",
    "equibiaxial",
    "expected_shear",
    "expected_stretch",
    "looked_at",
    "lost",
    "planar",
    "shear",
    "uniaxial",
];
/// Members that are three numbers, or lists or maps of these.
const TRIPLES: [&str; 22] = [
    "axis",
    "centre_mm",
    "centroid_displacement_mm",
    "centroid_mm",
    "closest_points_mm",
    "curve",
    "direction",
    "force_n",
    "gradients",
    "landmarks",
    "max_mm",
    "min_mm",
    "normal",
    "part_mm",
    "pivot_mm",
    "place_mm",
    "point_mm",
    "points",
    "points_mm",
    "position_mm",
    "translation_mm",
    "triangles",
];
const QUATERNION: &str = "quaternion_xyzw";

fn length_of(name: &str) -> Option<usize> {
    match name {
        QUATERNION => Some(4),
        name if PAIRS.contains(&name) => Some(2),
        name if TRIPLES.contains(&name) => Some(3),
        _ => None,
    }
}

/// Fixes the lengths of all arrays of numbers below `schema`, which is that of the member `name`.
pub(super) fn fix_lengths(name: &str, schema: &mut RefOr<Schema>) {
    match schema {
        RefOr::T(Schema::Object(object)) => {
            object.properties.iter_mut().for_each(|(name, property)| fix_lengths(name, property));
            if let Some(AdditionalProperties::RefOr(values)) = object.additional_properties.as_deref_mut() {
                fix_lengths(name, values);
            }
        }
        RefOr::T(Schema::Array(array)) => fix_array(name, array),
        RefOr::T(Schema::AllOf(all)) => all.items.iter_mut().for_each(|part| fix_lengths(name, part)),
        RefOr::T(Schema::OneOf(one)) => one.items.iter_mut().for_each(|part| fix_lengths(name, part)),
        RefOr::T(Schema::AnyOf(any)) => any.items.iter_mut().for_each(|part| fix_lengths(name, part)),
        RefOr::T(_) | RefOr::Ref(_) => {}
    }
}

fn fix_array(name: &str, array: &mut Array) {
    let ArrayItems::RefOrSchema(items) = &mut array.items else { return };
    match items.as_mut() {
        RefOr::T(Schema::Object(object)) if object.properties.is_empty() => {
            if let Some(length) = length_of(name) {
                (array.min_items, array.max_items) = (Some(length), Some(length));
            }
        }
        items => fix_lengths(name, items),
    }
}
