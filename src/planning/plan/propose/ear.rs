//! The bony ear canal, on a head whose occlusal plane is horizontal.

use super::ramus::Jaw;
use super::tuning::{
    CANAL_ABOVE_MM, CANAL_AREA_MM2, CANAL_BEHIND_MM, CANAL_OUTSIDE_MM, MAX_CANAL_OFF_MM, USUAL_CANAL_MM, VOXEL_MM,
};
use super::voxels::steps;
use prosopon_geometry::Point;

impl Jaw<'_> {
    /// The highest point of the canal's outer opening behind a condyle.
    ///
    /// The canal is a hole in a sagittal section that bone encloses.
    pub(super) fn porion(&self, side: f64, condylion: &Point) -> Option<Point> {
        let from_midline = side * (condylion.x - self.midline);
        let sections = steps(from_midline + CANAL_OUTSIDE_MM[0], from_midline + CANAL_OUTSIDE_MM[1]).rev();
        // The outermost section that shows the canal's bony ring.
        let (d, [y, z]) = sections.filter_map(|d| Some((d, self.canal(side, d, condylion)?))).next()?;
        Some(Point::new(self.midline + side * d, y, z))
    }

    /// The top (y, z) of the closed hole in one sagittal section that lies nearest to the canal's usual position.
    fn canal(&self, side: f64, d: f64, condylion: &Point) -> Option<[f64; 2]> {
        let n = [CANAL_BEHIND_MM, CANAL_ABOVE_MM].map(|[low, high]| ((high - low) / VOXEL_MM) as i32);
        let at = |i: i32, j: i32| {
            let along = |from: f64, n: i32| from + (f64::from(n) + 0.5) * VOXEL_MM;
            [condylion.y + along(CANAL_BEHIND_MM[0], i), condylion.z + along(CANAL_ABOVE_MM[0], j)]
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
            if !is_closed || !(CANAL_AREA_MM2[0]..CANAL_AREA_MM2[1]).contains(&(count * VOXEL_MM * VOXEL_MM)) {
                continue;
            }
            let middle = [0, 1].map(|a| hole.iter().map(|p| p[a]).sum::<f64>() / count);
            let off = (middle[0] - condylion.y - USUAL_CANAL_MM[0]).hypot(middle[1] - condylion.z - USUAL_CANAL_MM[1]);
            let top = hole.iter().map(|p| p[1]).fold(f64::NEG_INFINITY, f64::max);
            if off < MAX_CANAL_OFF_MM && best.is_none_or(|b| off < b.0) {
                best = Some((off, [middle[0], top + 0.5 * VOXEL_MM]));
            }
        }
        best.map(|b| b.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::propose::voxels::Voxels;

    /// A block beside the head with a canal of 8 mm along x, and a wider cave 20 mm above it.
    #[test]
    fn porion_is_the_top_of_the_canal_behind_the_condyle() {
        let condylion = Point::new(50.0, 0.0, 60.0);
        let is_bone = |p: &Point| {
            let canal = (p.y - 14.0).hypot(p.z - 56.0) < 4.0;
            let cave = (p.y - 14.0).hypot(p.z - 78.0) < 8.0;
            p.x < 58.0 && p.y > -10.0 && !canal && !cave
        };
        let bone = Voxels::filled_where(Point::new(30.0, -20.0, 20.0), [40, 70, 80], is_bone);
        let jaw = Jaw { bone: &bone, midline: 0.0, spine_y: -80.0, occlusal: 20.0 };
        let found = jaw.porion(1.0, &condylion).unwrap();
        // To a voxel; the block ends at x = 58.
        assert!((found - Point::new(57.5, 14.0, 60.0)).norm() < 1.0, "{found}");
        // Without a canal nothing is proposed.
        let solid = Voxels::filled_where(Point::new(30.0, -20.0, 20.0), [40, 70, 80], |p| p.x < 58.0 && p.y > -10.0);
        assert!(Jaw { bone: &solid, ..jaw }.porion(1.0, &condylion).is_none());
    }
}
