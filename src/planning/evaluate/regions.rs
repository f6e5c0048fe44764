//! Named regions of a face.

use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::Triangle;

use super::MaskRegion;
use prosopon_geometry::{Aabb, Motion, Point, TriMesh};

/// A named region of the face: a box.
#[derive(Debug, Clone, PartialEq)]
pub struct FaceRegion {
    /// Name of the region.
    /// One of `nose`, `paranasal_left`, `paranasal_right`, `upper_lip`, `lower_lip`, `chin`, `cheek_left`, `cheek_right`,
    /// `submental` and `forehead`.
    pub name: &'static str,
    /// The box, along the axes of its frame, mm.
    pub bounds: Aabb,
    /// Maps LPS into that frame.
    pub into: Motion,
}

impl FaceRegion {
    /// A region along the axes of LPS.
    #[must_use]
    pub fn new(name: &'static str, bounds: Aabb) -> Self {
        Self { name, bounds, into: Motion::identity() }
    }

    /// Whether `p` lies in the region.
    #[must_use]
    pub fn contains(&self, p: &Point) -> bool {
        self.bounds.contains(&(self.into * p))
    }

    /// The region moved in space.
    #[must_use]
    pub fn moved(&self, motion: &Motion) -> Self {
        Self { into: self.into * motion.inverse(), ..self.clone() }
    }
}

/// Reference positions from which the boxes are placed, LPS mm.
struct Face {
    midline: f64,
    /// Tip of the nose.
    nose: Point,
    /// z of the anterior nasal spine, of the line between the lips, of the chin's foremost point and of its lower border.
    spine: f64,
    lips: f64,
    chin: f64,
    menton: f64,
    /// y of the chin's foremost skin.
    chin_front: f64,
    /// Scale: height from chin to nose tip relative to that of an average adult, 87 mm.
    scale: f64,
}

/// The regions of one face.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FaceRegions {
    /// The regions; their boxes do not overlap.
    pub regions: Vec<FaceRegion>,
    /// Whether landmarks placed them, and not proportions of the skin.
    pub from_landmarks: bool,
}

/// Places the regions by landmarks or, without them, by proportions of the skin.
///
/// The landmarks are `pronasale`, `ans`, `soft_pogonion`, `menton` and `occlusal_plane`. They are used when `pronasale` and one
/// of `menton` and `soft_pogonion` are present and the soft points lie at the front of the skin; the others are then derived
/// from the height between these two. Without them the
/// tip of the nose is the skin's foremost vertex within 15 mm of the midline (the middle of the skin's box when `midline_x_mm`
/// is `None`), and the scale follows from the height of the skin above it. That requires an upright head with its forehead and
/// a nose in front of everything else. The boxes do not overlap.
#[must_use]
pub fn face_regions(skin: &TriMesh, landmarks: &[(String, Point)], midline_x_mm: Option<f64>) -> FaceRegions {
    match Face::from_landmarks(skin, landmarks, midline_x_mm) {
        Some(face) => FaceRegions { regions: face.regions(), from_landmarks: true },
        None => FaceRegions { regions: Face::from_proportions(skin, midline_x_mm).regions(), from_landmarks: false },
    }
}

/// Balls over the eyes, placed like the boxes of [`face_regions`].
/// Masks exclude them because lids move between two scans of an unchanged face.
#[must_use]
pub fn eyes(skin: &TriMesh, landmarks: &[(String, Point)], midline_x_mm: Option<f64>) -> [MaskRegion; 2] {
    // Position of an adult's eye relative to the tip of the nose: lateral, backward and upward, mm.
    const CENTRE: [f64; 3] = [32.0, 44.0, 35.0];
    const RADIUS: f64 = 17.0;
    let known = Face::from_landmarks(skin, landmarks, midline_x_mm);
    let face = known.unwrap_or_else(|| Face::from_proportions(skin, midline_x_mm));
    [-1.0, 1.0].map(|side| {
        let [x, y, z] = CENTRE.map(|c| c * face.scale);
        MaskRegion::Ball {
            centre: Point::new(face.midline + side * x, face.nose.y + y, face.nose.z + z),
            radius_mm: RADIUS * face.scale,
        }
    })
}

/// Largest distance of a soft point from the skin, mm: the boxes reach 10 mm in front of the tip of the nose.
const NEAR_SKIN_MM: f64 = 20.0;

fn is_near(skin: &TriMesh, p: &Point) -> bool {
    let vector = |p: &Point| ParryVector::new(p.x, p.y, p.z);
    let distance = |t: usize| {
        let [a, b, c] = skin.corners(t);
        Triangle::new(vector(&a), vector(&b), vector(&c)).distance_to_local_point(vector(p), true)
    };
    (0..skin.triangles().len()).any(|t| distance(t) < NEAR_SKIN_MM)
}

impl Face {
    fn from_landmarks(skin: &TriMesh, landmarks: &[(String, Point)], midline: Option<f64>) -> Option<Self> {
        let named =
            |name: &str| landmarks.iter().find(|l| l.0 == name && l.1.iter().all(|c| c.is_finite())).map(|l| l.1);
        let nose = named("pronasale")?;
        let (chin, menton) = (named("soft_pogonion"), named("menton"));
        // Points elsewhere place boxes that hold no skin.
        let is_front = |p: &Point| p.y < skin.bounds().center().y && is_near(skin, p);
        if ![Some(nose), chin].iter().flatten().all(is_front) {
            return None;
        }
        let menton_z = menton.map(|p| p.z).or_else(|| chin.map(|p| nose.z - (nose.z - p.z) * 87.0 / 74.0))?;
        let scale = (nose.z - menton_z) / 87.0;
        if !(0.3..3.0).contains(&scale) {
            return None;
        }
        let z = |name: &str, below: f64| named(name).map_or(nose.z - below * scale, |p| p.z);
        Some(Self {
            midline: midline.unwrap_or(nose.x),
            nose,
            spine: z("ans", 9.0),
            lips: z("occlusal_plane", 37.0),
            chin: chin.map_or(nose.z - 74.0 * scale, |p| p.z),
            menton: menton_z,
            chin_front: chin.map_or(nose.y + 28.0 * scale, |p| p.y),
            scale,
        })
    }

    fn from_proportions(skin: &TriMesh, midline: Option<f64>) -> Self {
        let bounds = skin.bounds();
        let midline = midline.unwrap_or(bounds.center().x);
        let near = skin.positions().iter().filter(|p| (p.x - midline).abs() < 15.0);
        let foremost = near.min_by(|a, b| a.y.total_cmp(&b.y)).copied();
        let nose = foremost.unwrap_or(Point::new(midline, bounds.min.y, bounds.center().z));
        // Height from the tip of the nose to the top of an adult's head: 133 mm.
        let scale = ((bounds.max.z - nose.z) / 133.0).clamp(0.7, 1.3);
        Self {
            midline,
            nose,
            spine: nose.z - 9.0 * scale,
            lips: nose.z - 37.0 * scale,
            chin: nose.z - 74.0 * scale,
            menton: nose.z - 87.0 * scale,
            chin_front: nose.y + 28.0 * scale,
            scale,
        }
    }

    fn regions(&self) -> Vec<FaceRegion> {
        let s = self.scale;
        // Half widths of the nose's wings, the upper lip, the mouth and the paranasal region; then the lateral limit of the
        // cheek.
        let (wing, lip, mouth, paranasal, cheek) = (18.0 * s, 22.0 * s, 28.0 * s, 42.0 * s, 75.0 * s);
        let subnasal = self.spine - 3.0 * s;
        let fold = self.lips - 0.5 * (self.lips - self.chin);
        let (front, nose_top) = (self.nose.y - 10.0 * s, self.nose.z + 35.0 * s);
        let region = |name, x: [f64; 2], y: [f64; 2], z: [f64; 2]| {
            let min = Point::new(self.midline + x[0], y[0], z[0]);
            let max = Point::new(self.midline + x[1], y[1], z[1]);
            FaceRegion::new(name, Aabb { min, max })
        };
        let middle = |half: f64| [-half, half];
        let depth = |mm: f64| [front, self.nose.y + mm * s];
        let chin_depth = [self.chin_front - 12.0 * s, self.chin_front + 30.0 * s];
        // The paranasal regions lie beside the bases of the wings, the cheeks lateral to the corners of the mouth.
        let side_z = [subnasal - 14.0 * s, subnasal + 6.0 * s];
        let cheek_z = [self.lips - 15.0 * s, self.nose.z + 25.0 * s];
        vec![
            region("nose", middle(wing), depth(40.0), [subnasal, nose_top]),
            region("paranasal_left", [lip, paranasal], depth(60.0), side_z),
            region("paranasal_right", [-paranasal, -lip], depth(60.0), side_z),
            region("upper_lip", middle(lip), depth(50.0), [self.lips, subnasal]),
            region("lower_lip", middle(mouth), depth(50.0), [fold, self.lips]),
            region("chin", middle(mouth), chin_depth, [self.menton - 3.0 * s, fold]),
            region("cheek_left", [paranasal, cheek], depth(90.0), cheek_z),
            region("cheek_right", [-cheek, -paranasal], depth(90.0), cheek_z),
            region(
                "submental",
                middle(mouth),
                [self.chin_front, self.chin_front + 60.0 * s],
                [self.menton - 35.0 * s, self.menton - 3.0 * s],
            ),
            region("forehead", middle(60.0 * s), depth(70.0), [self.nose.z + 48.0 * s, self.nose.z + 110.0 * s]),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::Mask;
    use prosopon_geometry::Vector;

    fn ball() -> TriMesh {
        // A diamond with its foremost point at (2, -100, 50), from which a face runs down and back.
        let p = [
            [2.0, -100.0, 50.0],
            [-70.0, 0.0, 50.0],
            [2.0, 80.0, 50.0],
            [74.0, 0.0, 50.0],
            [2.0, 0.0, 183.0],
            [2.0, -60.0, -60.0],
        ];
        let t = vec![[0, 3, 4], [3, 2, 4], [2, 1, 4], [1, 0, 4], [3, 0, 5], [2, 3, 5], [1, 2, 5], [0, 1, 5]];
        TriMesh::new(p.into_iter().map(Point::from).collect(), t).unwrap()
    }

    fn landmarks() -> Vec<(String, Point)> {
        [
            ("pronasale", [6.0, -111.0, 54.0]),
            ("ans", [6.0, -84.0, 45.0]),
            ("soft_pogonion", [6.0, -83.0, -20.0]),
            ("menton", [6.0, -67.0, -33.0]),
        ]
        .map(|(name, p)| (name.to_string(), Point::from(p)))
        .to_vec()
    }

    #[test]
    fn balls_cover_the_lids_and_neither_nose_nor_temples() {
        for face in [eyes(&ball(), &landmarks(), Some(6.0)), eyes(&ball(), &[], Some(2.0))] {
            let [right, left] = face.map(|part| match part {
                MaskRegion::Ball { centre, radius_mm } => (centre, radius_mm),
                MaskRegion::Box(_) | MaskRegion::Turned { .. } => panic!("not a ball"),
            });
            assert!((left.0 - right.0 - Vector::new(64.0, 0.0, 0.0)).norm() < 0.5, "{left:?} {right:?}");
        }
        // On a real head with these landmarks, the lids' foremost points, the wings of the nose and the temples lie here.
        let [right, left] = eyes(&ball(), &landmarks(), Some(6.0)).map(|e| Mask { only: vec![e], ..Mask::default() });
        let at = |x: f64, y: f64, z: f64| {
            let p = Point::new(x, y, z);
            let one = TriMesh::new(vec![p; 3], vec![[0, 1, 2]]).unwrap();
            [&right, &left].map(|mask| mask.of(&one)[0])
        };
        assert_eq!((at(38.0, -70.0, 88.0), at(-26.0, -70.0, 88.0)), ([false, true], [true, false]));
        for away in [at(24.0, -90.0, 56.0), at(70.0, -50.0, 88.0), at(6.0, -77.0, 99.0)] {
            assert_eq!(away, [false, false]);
        }
    }

    #[test]
    fn landmarks_fall_into_their_regions_and_boxes_do_not_overlap() {
        let FaceRegions { regions, from_landmarks: used } = face_regions(&ball(), &landmarks(), Some(6.0));
        assert!(used);
        assert_eq!(regions.len(), 10);
        let of = |p: [f64; 3]| -> Vec<&str> {
            regions.iter().filter(|r| r.contains(&Point::from(p))).map(|r| r.name).collect()
        };
        assert_eq!(of([6.0, -111.0, 54.0]), ["nose"]);
        assert_eq!(of([6.0, -83.0, -20.0]), ["chin"]);
        assert_eq!(of([6.0, -93.0, 30.0]), ["upper_lip"]);
        assert_eq!(of([6.0, -91.0, 8.0]), ["lower_lip"]);
        assert_eq!(of([32.0, -85.0, 45.0]), ["paranasal_left"]);
        assert_eq!(of([-20.0, -85.0, 45.0]), ["paranasal_right"]);
        assert_eq!(of([56.0, -60.0, 40.0]), ["cheek_left"]);
        assert_eq!(of([6.0, -50.0, -45.0]), ["submental"]);
        assert_eq!(of([6.0, -90.0, 120.0]), ["forehead"]);
        for (i, a) in regions.iter().enumerate() {
            for b in &regions[..i] {
                let apart = (0..3).any(|c| a.bounds.min[c] >= b.bounds.max[c] || b.bounds.min[c] >= a.bounds.max[c]);
                assert!(apart, "{} and {} overlap", a.name, b.name);
            }
        }
    }

    #[test]
    fn without_landmarks_the_foremost_point_is_the_nose() {
        let FaceRegions { regions, from_landmarks: used } = face_regions(&ball(), &[], None);
        assert!(!used);
        let nose = regions.iter().find(|r| r.name == "nose").unwrap();
        assert!(nose.contains(&Point::new(2.0, -100.0, 50.0)));
        assert!((nose.bounds.center().x - 2.0).abs() < 1e-9);
    }

    #[test]
    fn impossible_landmarks_are_not_used() {
        let mut upside_down = landmarks();
        upside_down[3].1.z = 90.0;
        assert!(!face_regions(&ball(), &upside_down, None).from_landmarks);
        assert!(!face_regions(&ball(), &landmarks()[..2], None).from_landmarks);
        // In RAS, and 40 mm too high.
        for elsewhere in [|p: Point| Point::new(-p.x, -p.y, p.z), |p: Point| Point::new(p.x, p.y, p.z + 40.0)] {
            let moved: Vec<_> = landmarks().into_iter().map(|(name, p)| (name, elsewhere(p))).collect();
            assert!(!face_regions(&ball(), &moved, None).from_landmarks);
        }
    }
}
