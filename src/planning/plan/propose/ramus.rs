//! Landmarks of the lower jaw's sides and of the chin, on a head whose occlusal plane is horizontal.

use super::tuning::{
    BESIDE_PLATE_MM, LINGULA_ABOVE_MM, LINGULA_SHARE, MAX_ANGLE_DEPTH_MM, MAX_CONDYLE_MM2, MAX_RAMUS_MM,
    MAX_RAMUS_THICKNESS_MM, MIN_JOINT_MM, MOLAR_AHEAD_MM, NECK_HALF_MM, RAMUS_DEPTHS_MM, RAMUS_HEIGHTS_MM,
    RAMUS_LENGTH_MM, SPLIT_MM, VOXEL_MM,
};
use super::voxels::{Voxels, steps};
use prosopon_geometry::Point;

/// Bone and reference positions for the search, mm.
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

/// Top of the condyle and angle of the jaw, where they are found.
pub(super) struct RamusEnds {
    pub(super) condylion: Option<Point>,
    pub(super) gonion: Option<Point>,
}

/// The outermost run of bone along x, as distances from the midline.
#[derive(Debug, Clone, Copy)]
struct OuterRun {
    lateral: f64,
    medial: f64,
}

/// The plate of the ramus.
struct Ramus {
    /// Depths y at which it begins and ends.
    front: f64,
    back: f64,
    /// Its runs from front to back.
    runs: Vec<OuterRun>,
}

/// Connected bone in one level.
struct Patch {
    /// Distance from the midline, and y.
    middle: [f64; 2],
    area_mm2: f64,
}

impl Jaw<'_> {
    fn outermost(&self, side: f64, y: f64, z: f64) -> Option<OuterRun> {
        let at = |d: f64| self.bone.at(self.midline + side * d, y, z);
        let lateral = steps(20.0, 80.0).rev().find(|d| at(*d))?;
        let medial = steps(0.0, lateral).rev().take_while(|d| at(*d)).last().unwrap_or(lateral);
        Some(OuterRun { lateral: lateral + 0.5 * VOXEL_MM, medial: medial - 0.5 * VOXEL_MM })
    }

    /// Half width of the upper jaw at the first molars, mm.
    fn arch_half_width(&self, side: f64) -> Option<f64> {
        let runs = steps(24.0, 34.0).flat_map(|d| steps(5.0, 10.0).map(move |h| (d, h)));
        let widths = runs.filter_map(|(d, h)| self.outermost(side, self.spine_y + d, self.occlusal + h));
        median(widths.map(|r| r.lateral).collect())
    }

    fn ramus(&self, side: f64) -> Option<Ramus> {
        let beyond = self.arch_half_width(side)? + 3.0;
        let levels = || steps(self.occlusal + RAMUS_HEIGHTS_MM[0], self.occlusal + RAMUS_HEIGHTS_MM[1]);
        let of_depth = |y: f64| -> Option<OuterRun> {
            let is_plate = |r: &OuterRun| r.lateral > beyond && r.lateral - r.medial <= MAX_RAMUS_THICKNESS_MM;
            let runs: Vec<OuterRun> = levels().filter_map(|z| self.outermost(side, y, z)).filter(is_plate).collect();
            // Most levels must show the plate.
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
                // The foremost run that fits is the ramus: behind it come mastoid and vertebrae.
                if fits && best.is_none() {
                    best = Some((y - 0.5 * VOXEL_MM - length, std::mem::take(&mut run)));
                }
                run.clear();
            }
            run.extend(here);
        }
        let (start, runs) = best?;
        Some(Ramus { front: start, back: start + runs.len() as f64 * VOXEL_MM, runs })
    }

    /// Landmarks of one side, +1 left, -1 right.
    pub(super) fn side(&self, side: f64) -> Option<SidePoints> {
        let Ramus { front, back, runs } = self.ramus(side)?;
        let along = LINGULA_SHARE * (back - front);
        let nearby = (along / VOXEL_MM) as usize;
        let medial = runs.get(nearby.saturating_sub(3)..(nearby + 4).min(runs.len()))?;
        let plate = median(medial.iter().map(|r| r.medial).collect())?;
        let (y, z) = (front + along, self.occlusal + LINGULA_ABOVE_MM);
        // The plate leans, and the split goes straight down from here; there may be streaks of metal.
        let around = steps(y - 3.5, y + 3.5).flat_map(|y| steps(z - SPLIT_MM, z).map(move |z| (y, z)));
        let runs = around.filter_map(|(y, z)| self.outermost(side, y, z));
        let own = runs.filter(|r| r.lateral - r.medial <= MAX_RAMUS_THICKNESS_MM && (r.medial - plate).abs() < 6.0);
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

    /// Top of the condyle and angle of the jaw on one side.
    ///
    /// The hind border of the ramus is followed up to where the condyle ends or joins the skull, and down to where it is farthest
    /// back and down.
    pub(super) fn ends(&self, side: f64) -> Option<RamusEnds> {
        let Ramus { front, back, runs } = self.ramus(side)?;
        let hindmost = runs.get(runs.len().saturating_sub(6)..)?;
        let plate = median(hindmost.iter().map(|r| 0.5 * (r.lateral + r.medial)).collect())?;
        let start = self.occlusal + 0.5 * (RAMUS_HEIGHTS_MM[0] + RAMUS_HEIGHTS_MM[1]);
        let condylion = self.condylion(side, [plate, back - NECK_HALF_MM], start);
        let gonion = self.gonion(side, plate, [front, back], start);
        Some(RamusEnds { condylion, gonion })
    }

    /// The connected bone nearest to a place (distance from the midline, y) in one level.
    ///
    /// Only bone in the window of half width `half` around the place counts.
    fn patch(&self, side: f64, [d, y]: [f64; 2], z: f64, half: f64) -> Option<Patch> {
        let n = (2.0 * half / VOXEL_MM) as i32;
        let at =
            |i: i32, j: i32| [d - half + (f64::from(i) + 0.5) * VOXEL_MM, y - half + (f64::from(j) + 0.5) * VOXEL_MM];
        let is_bone = |i: i32, j: i32| {
            let [d, y] = at(i, j);
            self.bone.at(self.midline + side * d, y, z)
        };
        let inside = |i: i32, j: i32| (0..n).contains(&i) && (0..n).contains(&j);
        let off = |i: i32, j: i32| (at(i, j)[0] - d).hypot(at(i, j)[1] - y);
        let cells = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
        let (i, j) = cells.filter(|(i, j)| is_bone(*i, *j)).min_by(|a, b| off(a.0, a.1).total_cmp(&off(b.0, b.1)))?;
        if off(i, j) > NECK_HALF_MM {
            return None;
        }
        let mut seen = vec![false; (n * n) as usize];
        let mut open = vec![(i, j)];
        let (mut sum, mut count) = ([0.0; 2], 0.0);
        while let Some((i, j)) = open.pop() {
            if !inside(i, j) || !is_bone(i, j) || std::mem::replace(&mut seen[(i * n + j) as usize], true) {
                continue;
            }
            let p = at(i, j);
            (sum, count) = ([sum[0] + p[0], sum[1] + p[1]], count + 1.0);
            open.extend([(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]);
        }
        Some(Patch { middle: sum.map(|s| s / count), area_mm2: count * VOXEL_MM * VOXEL_MM })
    }

    /// The top of the condyle above `place` (distance from the midline, y) at height `start`.
    fn condylion(&self, side: f64, mut place: [f64; 2], start: f64) -> Option<Point> {
        let (plate, mut top) = (place[0], None);
        // The root of the zygomatic arch lies beside the head of the condyle.
        let above_plate = |d: f64| d.clamp(plate - BESIDE_PLATE_MM, plate + BESIDE_PLATE_MM);
        for z in steps(start, start + MAX_RAMUS_MM) {
            let high_enough = z > self.occlusal + MIN_JOINT_MM;
            // Below the notch the plate goes on to the coronoid process: only its hind part is looked at.
            let Some(Patch { middle, area_mm2 }) = self.patch(side, place, z, NECK_HALF_MM) else { break };
            if high_enough && area_mm2 > MAX_CONDYLE_MM2 {
                break;
            }
            // The border leans back and the head is wider than its neck: follow it, but not into the coronoid process.
            let forward = middle[1].max(place[1] - 0.5 * VOXEL_MM);
            let aside = (middle[0] - place[0]).clamp(-VOXEL_MM, VOXEL_MM);
            place = [above_plate(place[0] + aside), place[1] + (forward - place[1]).min(VOXEL_MM)];
            if high_enough {
                top = Some(([above_plate(middle[0]), middle[1]], z));
            }
        }
        let ([d, y], z) = top?;
        Some(Point::new(self.midline + side * d, y, z + 0.5 * VOXEL_MM))
    }

    /// The angle of the jaw: the point of the ramus and body that is farthest back and down.
    fn gonion(&self, side: f64, plate: f64, [front, back]: [f64; 2], start: f64) -> Option<Point> {
        let mut best: Option<(f64, Point)> = None;
        let mut hind = back;
        for z in steps(self.occlusal - MAX_ANGLE_DEPTH_MM, start).rev() {
            // The hind border near where it was one level above.
            let near = steps(plate - NECK_HALF_MM, plate + NECK_HALF_MM);
            let depths = steps(front.min(hind - 30.0), hind + 4.0).rev();
            let found = depths.flat_map(|y| near.clone().map(move |d| (d, y)));
            let Some((d, y)) = found.into_iter().find(|(d, y)| self.bone.at(self.midline + side * d, *y, z)) else {
                break;
            };
            if hind - y > 12.0 {
                break;
            }
            hind = y;
            let score = y - z;
            if best.is_none_or(|b| score > b.0) {
                best = Some((score, Point::new(self.midline + side * d, y + 0.5 * VOXEL_MM, z)));
            }
        }
        best.map(|b| b.1)
    }

    /// Lower border of the cheek bone.
    pub(super) fn zygoma(&self, side: f64, spine_z: f64) -> Option<Point> {
        const BESIDE_MM: f64 = 37.0;
        /// Behind the spine: in front of the coronoid process, mm.
        const DEPTHS_MM: [f64; 2] = [8.0, 46.0];
        /// Bone of at least this height is the cheek bone and not a streak of metal, mm.
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
        /// The chin's front recedes by less than this at its lower border, mm; the hyoid bone lies farther behind.
        const FALLS_BACK_MM: f64 = 14.0;
        let front = |z: f64| {
            let strip = steps(-STRIP_MM, STRIP_MM).filter_map(|d| self.bone.front(self.midline + d, z));
            strip.min_by(f64::total_cmp)
        };
        /// Levels above that are compared, so that teeth and streaks of metal higher up do not count.
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
