//! Landmarks of the orbit's rim, on a head whose occlusal plane is horizontal.

use super::ramus::Jaw;
use super::tuning::{
    LATERAL_RIM_MM, MIN_ORBIT_MM, ORBIT_HEIGHTS_MM, ORBIT_MIDDLE_MM, ORBIT_RIM_MM, RIM_DEPTH_MM, SUTURE_SHARE, VOXEL_MM,
};
use super::voxels::steps;
use prosopon_geometry::Point;

/// The lowest point of the orbit's rim, and its lateral rim at the suture of cheek bone and forehead.
pub(super) struct OrbitPoints {
    pub(super) orbitale: Point,
    pub(super) frontomalare: Option<Point>,
}

impl Jaw<'_> {
    fn rim_at(&self, side: f64, d: f64, z: f64) -> Option<f64> {
        self.bone.front(self.midline + side * d, z).filter(|y| *y < self.spine_y + RIM_DEPTH_MM)
    }

    /// z of the lower and upper end of the orbit's opening at the distance `d` from the midline.
    fn opening(&self, side: f64, d: f64, spine_z: f64) -> Option<[f64; 2]> {
        let mut begin: Option<f64> = None;
        for z in steps(spine_z + ORBIT_HEIGHTS_MM[0], spine_z + ORBIT_HEIGHTS_MM[1]) {
            match (self.rim_at(side, d, z), begin) {
                (None, None) => begin = Some(z),
                (Some(_), Some(low)) if z - low >= MIN_ORBIT_MM => {
                    return Some([low - 0.5 * VOXEL_MM, z - 0.5 * VOXEL_MM]);
                }
                (Some(_), Some(_)) => begin = None,
                (None, Some(_)) | (Some(_), None) => {}
            }
        }
        None
    }

    /// Points of one orbit, +1 left, -1 right.
    pub(super) fn orbit(&self, side: f64, spine_z: f64) -> Option<OrbitPoints> {
        let rims =
            steps(ORBIT_RIM_MM[0], ORBIT_RIM_MM[1]).filter_map(|d| Some((d, self.opening(side, d, spine_z)?[0])));
        let (d, z) = rims.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let y = self.rim_at(side, d, z - VOXEL_MM)?;
        let orbitale = Point::new(self.midline + side * d, y, z);
        let frontomalare = self.opening(side, ORBIT_MIDDLE_MM, spine_z).and_then(|[low, high]| {
            let z = low + SUTURE_SHARE * (high - low);
            let lateral: Vec<(f64, f64)> = steps(LATERAL_RIM_MM[0], LATERAL_RIM_MM[1])
                .filter_map(|d| Some((d, self.rim_at(side, d, z).or_else(|| self.deeper(side, d, z))?)))
                .collect();
            let (d, y) = lateral.into_iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
            Some(Point::new(self.midline + side * d, y, z))
        });
        Some(OrbitPoints { orbitale, frontomalare })
    }

    /// Front of the lateral rim, which lies farther back than the lower one.
    fn deeper(&self, side: f64, d: f64, z: f64) -> Option<f64> {
        self.bone.front(self.midline + side * d, z).filter(|y| *y < self.spine_y + 1.5 * RIM_DEPTH_MM)
    }
}
