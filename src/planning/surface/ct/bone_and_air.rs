//! Extracts bone and inner air below the skin.

use super::components::Components;
use super::depth::Depth;
use super::metal::Metal;
use super::tuning::{AIR_DEPTH_MM, BONE_DEPTH_MM, BONE_DEPTH_NEAR_METAL_MM, HU_PER_MM, MIN_AIR_MM3};
use prosopon_geometry::ScalarGrid;

/// Bone field, negative inside.
pub(super) struct Bone {
    pub(super) field: ScalarGrid,
    /// Volume as dense as bone that was excluded because it lies too near the skin or in a streak, mm³.
    pub(super) cut_mm3: f64,
}

pub(super) fn bone(hu: &ScalarGrid, depth: &Depth, metal: Option<&Metal>, bone_hu: f64) -> Bone {
    let streaks = metal.map(|m| m.streaks(hu, |v| v > bone_hu));
    let mut field = hu.clone();
    let mut cut = 0usize;
    for (at, value) in field.values.iter_mut().enumerate() {
        let dense = bone_hu - f64::from(*value);
        let near_metal = metal.is_some_and(|m| m.is_near(at));
        let needed = if near_metal { BONE_DEPTH_NEAR_METAL_MM } else { BONE_DEPTH_MM };
        let shallow = HU_PER_MM * (needed - depth.at(at));
        let streak = streaks.as_ref().is_some_and(|s| s[at]);
        let limit = if streak { shallow.max(HU_PER_MM * hu.spacing) } else { shallow };
        cut += usize::from(dense < 0.0 && limit >= 0.0 && depth.is_inside(at));
        *value = dense.max(limit) as f32;
    }
    Bone { field, cut_mm3: cut as f64 * hu.spacing.powi(3) }
}

/// Air field inside the head, negative inside air; `None` when no airspace reaches [`MIN_AIR_MM3`].
pub(super) fn air(hu: &ScalarGrid, depth: &Depth, metal: Option<&Metal>, air_below_hu: f64) -> Option<ScalarGrid> {
    let streaks = metal.map(|m| m.streaks(hu, |v| v < air_below_hu));
    let outside = (HU_PER_MM * hu.spacing) as f32;
    let mut field = hu.clone();
    for (at, value) in field.values.iter_mut().enumerate() {
        let empty = f64::from(*value) - air_below_hu;
        *value = empty.max(HU_PER_MM * (AIR_DEPTH_MM - depth.at(at))) as f32;
        if streaks.as_ref().is_some_and(|s| s[at]) {
            *value = value.max(outside);
        }
    }
    let mask: Vec<bool> = field.values.iter().map(|v| *v < 0.0).collect();
    let components = Components::of(&mask, hu.dims);
    let large = |c: usize| components.sizes[c] as f64 * hu.spacing.powi(3) >= MIN_AIR_MM3;
    if !(0..components.sizes.len()).any(large) {
        return None;
    }
    let kept = components.mask(large);
    for (value, kept) in field.values.iter_mut().zip(&kept) {
        if *value < 0.0 && !kept {
            *value = outside;
        }
    }
    Some(field)
}
