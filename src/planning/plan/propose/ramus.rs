//! Landmarks of the lower jaw's sides and of the chin, on a head whose occlusal plane is horizontal.

use super::voxels::{VOXEL_MM, Voxels, steps};
use prosopon_geometry::Point;

/// Where to look.
pub(super) struct Jaw<'a> {
    pub(super) bone: &'a Voxels,
    pub(super) midline: f64,
    /// y of the anterior nasal spine.
    pub(super) spine_y: f64,
    /// z of the occlusal plane.
    pub(super) occlusal: f64,
}

/// One side: lingula and the buccal face beside the second molar.
pub(super) struct SidePoints {
    pub(super) lingula: Point,
    pub(super) molar: Point,
}

/// The outermost run of bone along x, as distances from the midline.
#[derive(Debug, Clone, Copy)]
struct OuterRun {
    lateral: f64,
    medial: f64,
}

/// Heights above the occlusal plane between which the ramus is looked for, mm.
const RAMUS_HEIGHTS_MM: [f64; 2] = [4.0, 15.0];
/// Depths behind the spine, mm.
const RAMUS_DEPTHS_MM: [f64; 2] = [30.0, 130.0];
/// A ramus is no thicker than this, mm.
const THICKEST_MM: f64 = 17.0;
/// Shortest and longest ramus from front to back, mm.
const RAMUS_LENGTH_MM: [f64; 2] = [15.0, 60.0];
/// The lingula lies this share of the ramus's length behind its front, and this far above the occlusal plane, mm.
const LINGULA_SHARE: f64 = 0.6;
const LINGULA_ABOVE_MM: f64 = 3.0;
/// The medial face is that of the plate from there down to this far, mm.
const SPLIT_MM: f64 = 22.0;
/// The second molar lies this far in front of the ramus's front, mm.
const MOLAR_AHEAD_MM: f64 = 14.0;

impl Jaw<'_> {
    fn outermost(&self, side: f64, y: f64, z: f64) -> Option<OuterRun> {
        let at = |d: f64| self.bone.at(self.midline + side * d, y, z);
        let lateral = steps(20.0, 80.0).rev().find(|d| at(*d))?;
        let medial = steps(0.0, lateral).rev().take_while(|d| at(*d)).last().unwrap_or(lateral);
        Some(OuterRun { lateral: lateral + 0.5 * VOXEL_MM, medial: medial - 0.5 * VOXEL_MM })
    }

    /// Half width of the upper jaw at the first molars.
    fn arch_half_width(&self, side: f64) -> Option<f64> {
        let runs = steps(24.0, 34.0).flat_map(|d| steps(5.0, 10.0).map(move |h| (d, h)));
        let widths = runs.filter_map(|(d, h)| self.outermost(side, self.spine_y + d, self.occlusal + h));
        median(widths.map(|r| r.lateral).collect())
    }

    /// Depths y at which the ramus begins and ends, and its runs between them.
    fn ramus(&self, side: f64) -> Option<([f64; 2], Vec<OuterRun>)> {
        let beyond = self.arch_half_width(side)? + 3.0;
        let levels = || steps(self.occlusal + RAMUS_HEIGHTS_MM[0], self.occlusal + RAMUS_HEIGHTS_MM[1]);
        let of_depth = |y: f64| -> Option<OuterRun> {
            let is_plate = |r: &OuterRun| r.lateral > beyond && r.lateral - r.medial <= THICKEST_MM;
            let runs: Vec<OuterRun> = levels().filter_map(|z| self.outermost(side, y, z)).filter(is_plate).collect();
            // Most levels show it.
            (2 * runs.len() > levels().count()).then_some(())?;
            let lateral = median(runs.iter().map(|r| r.lateral).collect())?;
            Some(OuterRun { lateral, medial: median(runs.iter().map(|r| r.medial).collect())? })
        };
        let mut best: Option<(f64, Vec<OuterRun>)> = None;
        let mut run: Vec<OuterRun> = Vec::new();
        let depths = steps(self.spine_y + RAMUS_DEPTHS_MM[0], self.spine_y + RAMUS_DEPTHS_MM[1] + 1.0);
        for y in depths {
            let here = of_depth(y);
            let goes_on = match (here, run.last()) {
                (Some(h), Some(last)) => (h.lateral - last.lateral).abs() < 4.0,
                (here, None) => here.is_some(),
                (None, Some(_)) => false,
            };
            if !goes_on {
                let length = run.len() as f64 * VOXEL_MM;
                let fits = (RAMUS_LENGTH_MM[0]..=RAMUS_LENGTH_MM[1]).contains(&length);
                // The foremost that is long enough: behind it come mastoid and vertebrae.
                if fits && best.is_none() {
                    best = Some((y - 0.5 * VOXEL_MM - length, std::mem::take(&mut run)));
                }
                run.clear();
            }
            run.extend(here);
        }
        let (start, runs) = best?;
        Some(([start, start + runs.len() as f64 * VOXEL_MM], runs))
    }

    /// Landmarks of one side, +1 left, -1 right.
    pub(super) fn side(&self, side: f64) -> Option<SidePoints> {
        let ([front, back], runs) = self.ramus(side)?;
        let along = LINGULA_SHARE * (back - front);
        let nearby = (along / VOXEL_MM) as usize;
        let medial = runs.get(nearby.saturating_sub(3)..(nearby + 4).min(runs.len()))?;
        let plate = median(medial.iter().map(|r| r.medial).collect())?;
        let (y, z) = (front + along, self.occlusal + LINGULA_ABOVE_MM);
        // The plate leans, and the split goes straight down from here; there may be streaks of metal.
        let around = steps(y - 3.5, y + 3.5).flat_map(|y| steps(z - SPLIT_MM, z).map(move |z| (y, z)));
        let runs = around.filter_map(|(y, z)| self.outermost(side, y, z));
        let own = runs.filter(|r| r.lateral - r.medial <= THICKEST_MM && (r.medial - plate).abs() < 6.0);
        let medial = median(own.map(|r| r.medial).collect()).unwrap_or(plate);
        let lingula = Point::new(self.midline + side * medial, y, z);
        let y = front - MOLAR_AHEAD_MM;
        let below = steps(self.occlusal - 60.0, self.occlusal - 3.0);
        let filled: Vec<(f64, OuterRun)> = below.filter_map(|z| Some((z, self.outermost(side, y, z)?))).collect();
        let lowest = filled.first()?.0;
        let height = lowest + 0.45 * (self.occlusal - lowest);
        let at = filled.iter().min_by(|a, b| (a.0 - height).abs().total_cmp(&(b.0 - height).abs()))?;
        let molar = Point::new(self.midline + side * at.1.lateral, y, at.0);
        Some(SidePoints { lingula, molar })
    }

    /// Lower border of the cheek bone.
    pub(super) fn zygoma(&self, side: f64, spine_z: f64) -> Option<Point> {
        const BESIDE_MM: f64 = 37.0;
        /// Behind the spine: in front of the coronoid process, mm.
        const DEPTHS_MM: [f64; 2] = [8.0, 46.0];
        /// Bone this thick from below up is the cheek bone and no streak, mm.
        const THICK_MM: usize = 5;
        let x = self.midline + side * BESIDE_MM;
        let front = |z: f64| {
            let depths = steps(self.spine_y + DEPTHS_MM[0], self.spine_y + DEPTHS_MM[1]);
            depths.clone().find(|y| self.bone.at(x, *y, z))
        };
        let column: Vec<(f64, Option<f64>)> =
            steps(self.occlusal + 8.0, spine_z + 25.0).map(|z| (z, front(z))).collect();
        let lowest = column.windows(THICK_MM).find(|w| w.iter().all(|(_, y)| y.is_some()))?;
        let (z, y) = *lowest.first()?;
        Some(Point::new(x, y?, z - 0.5 * VOXEL_MM))
    }

    /// Pogonion and menton.
    pub(super) fn chin(&self) -> Option<[Point; 2]> {
        const STRIP_MM: f64 = 3.0;
        /// The chin's lower border is rounder than this over a millimetre, the hyoid bone farther behind, mm.
        const FALLS_BACK_MM: f64 = 14.0;
        let front = |z: f64| {
            let strip = steps(-STRIP_MM, STRIP_MM).filter_map(|d| self.bone.front(self.midline + d, z));
            strip.min_by(f64::total_cmp)
        };
        /// Teeth and streaks of metal higher up do not count.
        const NEARBY: usize = 12;
        let mut profile: Vec<[f64; 2]> = Vec::new();
        for z in steps(self.occlusal - 75.0, self.occlusal - 12.0).rev() {
            let Some(y) = front(z).filter(|y| *y < self.spine_y + 60.0) else { break };
            let foremost = profile.iter().rev().take(NEARBY).map(|p| p[0]).fold(f64::INFINITY, f64::min);
            if y > foremost + FALLS_BACK_MM {
                break;
            }
            profile.push([y, z]);
        }
        let [y, low] = *profile.last()?;
        let chin = profile.iter().filter(|p| (low + 2.0..low + 18.0).contains(&p[1]));
        let pogonion = chin.min_by(|a, b| a[0].total_cmp(&b[0]))?;
        let point = |y: f64, z: f64| Point::new(self.midline, y, z);
        Some([point(pogonion[0], pogonion[1]), point(y, low - 0.5 * VOXEL_MM)])
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
