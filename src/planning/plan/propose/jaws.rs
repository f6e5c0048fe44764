//! Nasal aperture, occlusal plane and edges of the incisors.

use rayon::prelude::*;

use super::tuning::{
    APERTURE_ABOVE_MM, APERTURE_BELOW_MM, APERTURE_BESIDE_MM, APERTURE_DEPTH_MM, APERTURE_HEIGHT_MM, VOXEL_MM,
};
use super::voxels::{Voxels, steps};

/// z of the nasal aperture's lower and upper end, mm.
pub(super) fn nasal_aperture(bone: &Voxels, midline: f64) -> Option<[f64; 2]> {
    let [low, high] = bone.range(2);
    let offsets: Vec<f64> = steps(APERTURE_BESIDE_MM[0], APERTURE_BESIDE_MM[1]).flat_map(|d| [d, -d]).collect();
    let far = bone.range(1)[1];
    let front: Vec<(f64, f64)> = steps(low, high)
        .map(|z| {
            let mut all: Vec<f64> = offsets.iter().map(|d| bone.front(midline + d, z).unwrap_or(far)).collect();
            all.sort_by(f64::total_cmp);
            (z, all[all.len() / 2])
        })
        .collect();
    let foremost = |from: f64, to: f64| {
        let within = front.iter().filter(|(z, _)| from <= *z && *z <= to);
        within.map(|(_, y)| *y).fold(f64::INFINITY, f64::min)
    };
    let middle = 0.5 * (bone.range(1)[0] + far);
    let is_gap = |(z, y): &(f64, f64)| {
        let (below, above) = (foremost(z - APERTURE_BELOW_MM, *z), foremost(*z, z + APERTURE_ABOVE_MM));
        // Both walls belong to the face.
        below.max(above) < middle && y - below.max(above) > APERTURE_DEPTH_MM
    };
    let gaps: Vec<bool> = front.iter().map(is_gap).collect();
    // The highest gap counts: below it there may be an open mouth.
    let mut found = None;
    let mut start = None;
    for (i, gap) in gaps.iter().chain([&false]).enumerate() {
        match (start, gap) {
            (None, true) => start = Some(i),
            (Some(s), false) => {
                let (bottom, top) = (low + s as f64 * VOXEL_MM, low + i as f64 * VOXEL_MM);
                if top - bottom >= APERTURE_HEIGHT_MM {
                    found = Some([bottom, top]);
                }
                start = None;
            }
            _ => {}
        }
    }
    found
}

/// The occlusal plane seen from the side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Occlusion {
    /// Height below the spine, measured straight down from it, mm (negative).
    pub(super) height: f64,
    /// Rise towards the back, radian.
    pub(super) pitch: f64,
}

/// Finds the plane below the palate that cuts least bone of the dental arches; in an open mouth, the one at the upper teeth.
///
/// - `spine`: y and z of the anterior nasal spine
pub(super) fn occlusion(bone: &Voxels, midline: f64, spine: [f64; 2]) -> Option<Occlusion> {
    const HALF_WIDTH_MM: f64 = 34.0;
    const DEPTHS_MM: [f64; 2] = [-12.0, 46.0];
    const HEIGHTS_MM: [f64; 2] = [-42.0, -12.0];
    const PITCHES_DEG: std::ops::RangeInclusive<i32> = -12..=25;
    /// Distance from the plane up to the roots and alveolar bone of the upper jaw, mm, and the share of their area that is
    /// subtracted from the plane's.
    const ROOTS_MM: usize = 8;
    const ROOTS_SHARE: f64 = 0.4;
    /// Bonus for each mm of height and penalty for each squared degree of pitch, in units of the median area.
    const HIGHER: f64 = 0.012;
    const STEEPER: f64 = 2e-4;
    /// An adult's usual height of the plane relative to the spine, mm, and the penalty for each squared mm from it: bone between
    /// streaks of metal is thin too.
    const USUAL_MM: f64 = -27.0;
    const UNUSUAL: f64 = 2.5e-3;
    let area = |height: f64, slope: f64| {
        let mut count = 0usize;
        for depth in steps(DEPTHS_MM[0], DEPTHS_MM[1]) {
            let z = spine[1] + height + slope * depth;
            count += steps(-HALF_WIDTH_MM, HALF_WIDTH_MM).filter(|x| bone.at(midline + x, spine[0] + depth, z)).count();
        }
        count as f64
    };
    let heights: Vec<f64> = steps(HEIGHTS_MM[0], HEIGHTS_MM[1] + ROOTS_MM as f64).collect();
    let degrees: Vec<i32> = PITCHES_DEG.collect();
    let areas: Vec<Vec<f64>> = degrees
        .par_iter()
        .map(|d| heights.iter().map(|h| area(*h, f64::from(*d).to_radians().tan())).collect())
        .collect();
    let mut all = areas.concat();
    all.sort_by(f64::total_cmp);
    let median = all.get(all.len() / 2).copied().filter(|m| *m > 0.0)?;
    let mut best: Option<(f64, Occlusion)> = None;
    for (d, areas) in degrees.iter().zip(&areas) {
        let pitch = f64::from(*d).to_radians();
        for (i, height) in heights.iter().enumerate().take(heights.len() - ROOTS_MM) {
            let at_middle = height + pitch.tan() * 0.5 * (DEPTHS_MM[0] + DEPTHS_MM[1]);
            // Streaks of metal do not count as roots.
            let roots = areas[i + ROOTS_MM].min(median);
            let bone = (areas[i] - ROOTS_SHARE * roots) / median;
            let prior = STEEPER * f64::from(d * d) + UNUSUAL * (height - USUAL_MM).powi(2);
            let score = bone - HIGHER * at_middle + prior;
            if best.is_none_or(|b| score < b.0) {
                best = Some((score, Occlusion { height: *height, pitch }));
            }
        }
    }
    best.map(|b| b.1)
}

/// Edge of the upper incisors as (y, z): where the bone's front, going down, recedes to the lower incisors or ends.
pub(super) fn incisal_edge(bone: &Voxels, midline: f64, spine: [f64; 2]) -> Option<[f64; 2]> {
    const HEIGHTS_MM: [f64; 2] = [-40.0, -12.0];
    const FALLS_BACK_MM: f64 = 1.5;
    const STRIP_MM: f64 = 4.0;
    let front = |z: f64| {
        let strip = steps(-STRIP_MM, STRIP_MM).filter_map(|d| bone.front(midline + d, z));
        strip.min_by(f64::total_cmp)
    };
    let profile: Vec<(f64, f64)> = steps(spine[1] + HEIGHTS_MM[0], spine[1] + HEIGHTS_MM[1])
        .rev()
        .map(|z| (z, front(z).unwrap_or(f64::INFINITY)))
        .collect();
    let first = profile.iter().enumerate().min_by(|a, b| a.1.1.total_cmp(&b.1.1))?.0;
    let foremost = profile.get(first)?.1;
    let below = profile.iter().skip(first).find(|(_, y)| *y > foremost + FALLS_BACK_MM)?;
    Some([foremost, below.0 + 0.5 * VOXEL_MM])
}

/// Edge of the lower incisors as (y, z), below the upper one `edge`; `None` where the upper teeth cover it.
pub(super) fn lower_incisal_edge(bone: &Voxels, midline: f64, edge: [f64; 2]) -> Option<[f64; 2]> {
    /// Widest opening of the mouth, and distance behind the upper edge beyond which teeth are molars, mm.
    const MAX_OPENING_MM: f64 = 30.0;
    const BEHIND_MM: f64 = 15.0;
    const STRIP_MM: f64 = 4.0;
    let front = |z: f64| {
        let strip = steps(-STRIP_MM, STRIP_MM).filter_map(|d| bone.front(midline + d, z));
        strip.filter(|y| (y - edge[0]).abs() < BEHIND_MM).min_by(f64::total_cmp)
    };
    let mut levels =
        steps(edge[1] - MAX_OPENING_MM, edge[1] + VOXEL_MM).rev().skip_while(|z| front(*z).is_some()).skip(1);
    let z = levels.find(|z| front(*z).is_some())?;
    Some([front(z)?, z + 0.5 * VOXEL_MM])
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::Point;

    fn teeth(lower_front: f64, gap_mm: f64) -> Voxels {
        let is_bone = move |p: &Point| {
            let upper = p.z > 40.0 && p.y > 10.0;
            upper || (p.z < 40.0 - gap_mm && p.y > lower_front)
        };
        Voxels::filled_where(Point::new(-20.0, 0.0, 0.0), [40, 40, 70], is_bone)
    }

    #[test]
    fn the_lower_incisors_are_found_below_a_gap_and_not_where_they_touch() {
        let bone = teeth(12.0, 6.0);
        let upper = incisal_edge(&bone, 0.0, [10.0, 65.0]).unwrap();
        assert!((upper[0] - 10.5).abs() < 1e-9 && (upper[1] - 40.0).abs() <= 1.0, "{upper:?}");
        let lower = lower_incisal_edge(&bone, 0.0, upper).unwrap();
        assert!((lower[0] - 12.5).abs() < 1e-9 && (lower[1] - 34.0).abs() <= 1.0, "{lower:?}");
        assert!(lower_incisal_edge(&teeth(12.0, 0.0), 0.0, upper).is_none());
    }
}
