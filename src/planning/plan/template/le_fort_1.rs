//! The horizontal osteotomy of the upper jaw.

use super::super::lattice::lattice;
use super::super::shape::{BoundedPlane, Cut};
use super::tuning::{
    ARCH_DEPTH_MM, BELOW_ZYGOMA_MM, HALF_WIDTH_ABOVE_MM, HALF_WIDTH_MM, HALF_WIDTH_TEETH_MM, MAX_STEP_SHARE,
    OVERLAP_MM, STEP_BESIDE_MM,
};
use super::{Occlusal, meets};
use prosopon_field::Envelope;
use prosopon_geometry::{Point, Vector};

/// Cuts of a Le Fort I osteotomy: above the apices, behind the tuberosities and between the teeth.
///
/// - `plane`: a point of the Le Fort I plane and its normal, LPS
/// - `midline_x_mm`, `occlusal_z_mm`: the midsagittal plane and the occlusal plane
/// - `zygomas`: lower borders of the left and right cheek bones, where known. A plane that would run through one steps down
///   beside the nose (Bennett & Wolford 1985), by at most 45 % of the height above the occlusal plane
/// - returns: one to seven rectangles, the Le Fort I plane first. The planes behind and between the teeth are left out where
///   they meet no bone: teeth that do not touch need no cut. Empty when the plane is not within 45° of horizontal or not more
///   than 5 mm above the occlusal plane, or a value is not finite
///
/// The plane behind the tuberosities lies where the cross-section of the alveolar bone, seen from the front, has fallen to a
/// quarter of its size at the molars, 35 to 55 mm behind the foremost bone, or else 48 mm behind it. It passes between the
/// tuberosities and the pterygoid plates, but it does not follow the bone: a part of either may lie on the wrong side. The
/// rectangles overlap by 2 mm.
#[must_use]
pub fn le_fort_1(
    plane: (Point, Vector),
    midline_x_mm: f64,
    occlusal_z_mm: f64,
    zygomas: [Option<Point>; 2],
    bone: &Envelope,
) -> Vec<Cut> {
    let Some(axes) = LeFort1Axes::new(plane, midline_x_mm, occlusal_z_mm) else { return Vec::new() };
    let ArchDepths { front, back } = axes.arch(bone);
    let front = front - 15.0;
    let middle = 0.5 * (front + back + OVERLAP_MM);
    let half_depth = 0.5 * (back + OVERLAP_MM - front);
    let level = |height: f64, half_width: f64| BoundedPlane {
        point: axes.at(middle, height),
        normal: axes.up,
        bounds: Some((axes.left, half_width, half_depth)),
    };
    let behind = BoundedPlane {
        point: axes.at(back, 0.5 * axes.occlusal),
        normal: axes.back,
        bounds: Some((axes.left, HALF_WIDTH_MM, 0.5 * -axes.occlusal + OVERLAP_MM)),
    };
    let mut cuts = axes.upper(zygomas, [front, back + OVERLAP_MM]);
    let behind = Cut::from(behind).named("pterygomaxillary");
    let teeth = Cut::from(level(axes.occlusal, HALF_WIDTH_TEETH_MM)).named("occlusal").separating();
    cuts.extend([behind, teeth].into_iter().filter(|c| meets(bone, c)));
    cuts
}

/// Midsagittal cut that halves a Le Fort I segment, from the Le Fort I plane to the occlusal plane.
pub(super) fn midsagittal(
    plane: (Point, Vector),
    midline_x_mm: f64,
    occlusal_z_mm: f64,
    bone: &Envelope,
) -> Option<Cut> {
    let axes = LeFort1Axes::new(plane, midline_x_mm, occlusal_z_mm)?;
    let ArchDepths { front, back } = axes.arch(bone);
    let (front, back) = (front - 15.0, back + OVERLAP_MM);
    let half_height = 0.5 * -axes.occlusal + OVERLAP_MM;
    let point = axes.at(0.5 * (front + back), 0.5 * axes.occlusal);
    let plane = BoundedPlane { point, normal: axes.left, bounds: Some((axes.back, 0.5 * (back - front), half_height)) };
    Some(Cut::from(plane).named("midsagittal"))
}

/// y of the foremost alveolar bone and of the end of the tuberosities, at the height of the occlusal plane, mm.
pub(super) fn tuberosity_y(
    plane: (Point, Vector),
    midline_x_mm: f64,
    occlusal_z_mm: f64,
    bone: &Envelope,
) -> Option<[f64; 2]> {
    let axes = LeFort1Axes::new(plane, midline_x_mm, occlusal_z_mm)?;
    let ArchDepths { front, back } = axes.arch(bone);
    Some([front, back].map(|depth| axes.at(depth, axes.occlusal).y))
}

/// Depths of the foremost alveolar bone and of the end of the tuberosities, behind the origin, mm.
struct ArchDepths {
    front: f64,
    back: f64,
}

/// Axes of the Le Fort I plane with the origin in the midline.
pub(super) struct LeFort1Axes {
    origin: Point,
    left: Vector,
    back: Vector,
    up: Vector,
    /// Height of the occlusal plane along `up`, negative, mm.
    occlusal: f64,
}

impl LeFort1Axes {
    pub(super) fn new((point, normal): (Point, Vector), midline: f64, occlusal_z: f64) -> Option<Self> {
        let up = normal.try_normalize(1e-9)? * normal.z.signum();
        if up.z.is_nan() || up.z < 0.7 || !point.iter().chain([&midline, &occlusal_z]).all(|c| c.is_finite()) {
            return None;
        }
        let left = (Vector::x() - up * up.x).normalize();
        let back = up.cross(&left);
        // `point`, shifted within the plane along `left` to the midline.
        let origin = point + left * ((midline - point.x) / left.x);
        let occlusal = (occlusal_z - origin.z) * up.z;
        (occlusal < -5.0).then_some(Self { origin, left, back, up, occlusal })
    }

    pub(super) fn occlusal_plane(&self, occlusal_z: f64) -> Occlusal {
        let point = Point::new(self.origin.x, self.origin.y, occlusal_z);
        Occlusal { point, left: self.left, up: self.up }
    }

    /// Cuts of the plane above the apices, with its steps, between two depths; the middle part comes first.
    fn upper(&self, zygomas: [Option<Point>; 2], [front, back]: [f64; 2]) -> Vec<Cut> {
        let (middle, half_depth) = (0.5 * (front + back), 0.5 * (back - front));
        let level = |height: f64, [from, to]: [f64; 2]| BoundedPlane {
            point: self.at(middle, height) + self.left * (0.5 * (from + to)),
            normal: self.up,
            bounds: Some((self.left, 0.5 * (to - from), half_depth)),
        };
        let step = |zygoma: Option<Point>| {
            let below = zygoma.map(|p| self.up.dot(&(p - self.origin)) - BELOW_ZYGOMA_MM);
            below.filter(|h| *h < -OVERLAP_MM).map(|h| h.max(MAX_STEP_SHARE * self.occlusal))
        };
        let steps =
            [(zygomas[0], 1.0, "left"), (zygomas[1], -1.0, "right")].map(|(z, side, name)| (step(z), side, name));
        let end = |step: Option<f64>| if step.is_some() { STEP_BESIDE_MM } else { HALF_WIDTH_ABOVE_MM };
        let mut cuts = vec![Cut::from(level(0.0, [-end(steps[1].0), end(steps[0].0)])).named("le_fort_1")];
        for (height, side, name) in steps {
            let Some(height) = height else { continue };
            let ends = [STEP_BESIDE_MM - OVERLAP_MM, HALF_WIDTH_ABOVE_MM].map(|d| side * d);
            let low = level(height, [ends[0].min(ends[1]), ends[0].max(ends[1])]);
            let wall = BoundedPlane {
                point: self.at(middle, 0.5 * height) + self.left * (side * (STEP_BESIDE_MM - 0.5 * OVERLAP_MM)),
                normal: self.left,
                bounds: Some((self.back, half_depth, 0.5 * -height + OVERLAP_MM)),
            };
            cuts.push(Cut::from(low).named(&format!("le_fort_1_{name}")));
            cuts.push(Cut::from(wall).named(&format!("le_fort_1_step_{name}")).separating());
        }
        cuts
    }

    /// The point of the midline at `depth` behind and `height` above the origin.
    fn at(&self, depth: f64, height: f64) -> Point {
        self.origin + self.back * depth + self.up * height
    }

    /// Depths of the foremost alveolar bone and of the end of the tuberosities, behind the origin, mm.
    fn arch(&self, bone: &Envelope) -> ArchDepths {
        let grid = &bone.grid;
        // The band leaves out the teeth and their streaks below and the floor of the nose above.
        let band = 0.7 * self.occlusal..0.1 * self.occlusal;
        let reach = (grid.dims.iter().sum::<usize>() as f64 * grid.spacing).ceil();
        let mut area = vec![0.0f64; 2 * reach as usize + 1];
        for (node, _) in grid.values.iter().enumerate().filter(|(_, v)| **v < 0.0) {
            let [i, j, k] = lattice(grid, node);
            let d = grid.position(i, j, k) - self.origin;
            let depth = self.back.dot(&d);
            if band.contains(&self.up.dot(&d)) && self.left.dot(&d).abs() < HALF_WIDTH_MM && depth.abs() < 80.0 {
                area[(depth + reach).round() as usize] += grid.spacing.powi(3);
            }
        }
        // Bins are 1 mm deep: mm³ in a bin are mm² of section. A running mean evens out grids of other spacings.
        let n = area.len();
        let mean = |i: usize| area[i.saturating_sub(1)..(i + 2).min(n)].iter().sum::<f64>() / 3.0;
        let section: Vec<f64> = (0..n).map(mean).collect();
        let Some(first) = section.iter().position(|a| *a > 20.0) else {
            return ArchDepths { front: -25.0, back: ARCH_DEPTH_MM - 25.0 };
        };
        let front = first as f64 - reach;
        let window = |from: usize, to: usize| (first + from).min(n)..(first + to).min(n);
        let molars = section[window(25, 40)].iter().copied().fold(0.0, f64::max);
        // A filled mouth or stout pterygoid plates hide the end of the tuberosities.
        let end = window(35, 56).find(|i| section[*i] < 0.25 * molars);
        ArchDepths { front, back: end.map_or(front + ARCH_DEPTH_MM, |i| i as f64 - reach) }
    }
}
