//! The bony ear canal, on a head whose occlusal plane is horizontal.

use super::ramus::Jaw;
use super::voxels::{VOXEL_MM, steps};
use prosopon_geometry::Point;

/// The canal opens within these distances outside the condyle's top, behind it and above it, mm.
const OUTSIDE_MM: [f64; 2] = [-6.0, 16.0];
const BEHIND_MM: [f64; 2] = [4.0, 32.0];
const ABOVE_MM: [f64; 2] = [-22.0, 14.0];
/// Where its middle usually lies behind and above the condyle's top, mm.
const USUAL_MM: [f64; 2] = [14.0, -4.0];
/// Holes farther from there are cells of the mastoid, mm.
const FARTHEST_MM: f64 = 9.0;
/// Cross-sections of a canal, mm².
const AREA_MM2: [f64; 2] = [12.0, 160.0];

impl Jaw<'_> {
    /// The highest point of the canal's outer opening behind a condyle: a hole in the bone's sagittal section that bone closes all round.
    pub(super) fn porion(&self, side: f64, condylion: &Point) -> Option<Point> {
        let from_midline = side * (condylion.x - self.midline);
        let sections = steps(from_midline + OUTSIDE_MM[0], from_midline + OUTSIDE_MM[1]).rev();
        // The outermost section that shows the canal's bony ring.
        let (d, [y, z]) = sections.filter_map(|d| Some((d, self.canal(side, d, condylion)?))).next()?;
        Some(Point::new(self.midline + side * d, y, z))
    }

    /// The top (y, z) of the closed hole in one sagittal section that lies nearest to where a canal usually does.
    fn canal(&self, side: f64, d: f64, condylion: &Point) -> Option<[f64; 2]> {
        let n = [BEHIND_MM, ABOVE_MM].map(|[low, high]| ((high - low) / VOXEL_MM) as i32);
        let at = |i: i32, j: i32| {
            let along = |from: f64, n: i32| from + (f64::from(n) + 0.5) * VOXEL_MM;
            [condylion.y + along(BEHIND_MM[0], i), condylion.z + along(ABOVE_MM[0], j)]
        };
        let is_air = |i: i32, j: i32| {
            let [y, z] = at(i, j);
            !self.bone.at(self.midline + side * d, y, z)
        };
        let mut seen = vec![false; (n[0] * n[1]) as usize];
        let mut best: Option<(f64, [f64; 2])> = None;
        for start in (0..n[0]).flat_map(|i| (0..n[1]).map(move |j| (i, j))) {
            let (mut open, mut hole, mut is_closed) = (vec![start], Vec::new(), true);
            while let Some((i, j)) = open.pop() {
                if !(0..n[0]).contains(&i) || !(0..n[1]).contains(&j) {
                    is_closed = false;
                    continue;
                }
                if !is_air(i, j) || std::mem::replace(&mut seen[(i * n[1] + j) as usize], true) {
                    continue;
                }
                hole.push(at(i, j));
                open.extend([(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]);
            }
            let count = hole.len() as f64;
            if !is_closed || !(AREA_MM2[0]..AREA_MM2[1]).contains(&(count * VOXEL_MM * VOXEL_MM)) {
                continue;
            }
            let middle = [0, 1].map(|a| hole.iter().map(|p| p[a]).sum::<f64>() / count);
            let off = (middle[0] - condylion.y - USUAL_MM[0]).hypot(middle[1] - condylion.z - USUAL_MM[1]);
            let top = hole.iter().map(|p| p[1]).fold(f64::NEG_INFINITY, f64::max);
            if off < FARTHEST_MM && best.is_none_or(|b| off < b.0) {
                best = Some((off, [middle[0], top + 0.5 * VOXEL_MM]));
            }
        }
        best.map(|b| b.1)
    }
}
