//! Lengths of points, directions and ranges, which utoipa gives as arrays of any length.

use utoipa::openapi::schema::{AdditionalProperties, Array, ArrayItems};
use utoipa::openapi::{RefOr, Schema};

/// Members that are two numbers.
const PAIRS: [&str; 7] =
    ["equibiaxial", "expected_shear", "expected_stretch", "looked_at", "planar", "shear", "uniaxial"];
/// Members that are lists of two numbers each.
const LISTS_OF_PAIRS: [&str; 3] = ["after_yz_mm", "before_yz_mm", "lost"];
/// Members that are three numbers, or maps of these.
const TRIPLES: [&str; 17] = [
    "axis",
    "centre_mm",
    "centroid_displacement_mm",
    "centroid_mm",
    "direction",
    "force_n",
    "landmarks",
    "max_mm",
    "min_mm",
    "normal",
    "part_mm",
    "pivot_mm",
    "place_mm",
    "point_mm",
    "points",
    "position_mm",
    "translation_mm",
];
/// Members that are lists of three numbers each.
const LISTS_OF_TRIPLES: [&str; 5] = ["closest_points_mm", "curve", "gradients", "points_mm", "triangles"];
const QUATERNION: &str = "quaternion_xyzw";
/// Member that is four lists of four numbers each.
const MATRIX: &str = "matrix";

/// Length of an array of numbers that is the member `name`, or an item of it.
fn length_of(name: &str, is_item: bool) -> Option<usize> {
    let (pairs, triples) =
        if is_item { (&LISTS_OF_PAIRS[..], &LISTS_OF_TRIPLES[..]) } else { (&PAIRS[..], &TRIPLES[..]) };
    match name {
        QUATERNION if !is_item => Some(4),
        MATRIX if is_item => Some(4),
        name if pairs.contains(&name) => Some(2),
        name if triples.contains(&name) => Some(3),
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
        RefOr::T(Schema::Array(array)) => fix_array(name, array, false),
        RefOr::T(Schema::AllOf(all)) => all.items.iter_mut().for_each(|part| fix_lengths(name, part)),
        RefOr::T(Schema::OneOf(one)) => one.items.iter_mut().for_each(|part| fix_lengths(name, part)),
        RefOr::T(Schema::AnyOf(any)) => any.items.iter_mut().for_each(|part| fix_lengths(name, part)),
        RefOr::T(_) | RefOr::Ref(_) => {}
    }
}

fn fix_array(name: &str, array: &mut Array, is_item: bool) {
    let ArrayItems::RefOrSchema(items) = &mut array.items else { return };
    match items.as_mut() {
        RefOr::T(Schema::Object(object)) if object.properties.is_empty() => {
            if let Some(length) = length_of(name, is_item) {
                (array.min_items, array.max_items) = (Some(length), Some(length));
            }
        }
        RefOr::T(Schema::Array(items)) => {
            fix_array(name, items, true);
            if name == MATRIX {
                (array.min_items, array.max_items) = (Some(4), Some(4));
            }
        }
        items @ (RefOr::T(_) | RefOr::Ref(_)) => fix_lengths(name, items),
    }
}
