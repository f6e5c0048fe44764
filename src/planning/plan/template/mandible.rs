//! Cuts of the mandible, and its separation from the skull.

use super::super::PlanError;
use super::super::lattice::lattice;
use super::super::shape::{BoundedPlane, Cut, CutShape};
use super::tuning::{
    ABOVE_LINGULA_MM, BEHIND_LINGULA_MM, CORTEX_REACH_MM, HALF_BODY_MM, HALF_RAMUS_MM, MANDIBLE_OVERLAP_MM,
    RAMUS_SLANT, TEETH_FRONT_MM, TO_FRONT_MM, TO_LOWER_BORDER_MM,
};
use super::{Landmarks, Occlusal, meets, misplaced};
use prosopon_field::Envelope;
use prosopon_geometry::{Point, TriMesh, Vector};

/// One side of the mandible.
struct Side {
    /// +1 left, -1 right.
    side: f64,
    /// Middle of the ramus at the lingula, and of the body at the molar.
    ramus: Point,
    body: Point,
    /// Horizontal, from the molar to the ramus.
    back: Vector,
    /// Horizontal, to the side.
    out: Vector,
}

impl Side {
    fn new(side: f64, lingula: &Point, molar: &Point) -> Result<Self, PlanError> {
        let (ramus, body) = (lingula + Vector::x() * side * HALF_RAMUS_MM, molar - Vector::x() * side * HALF_BODY_MM);
        let offset = Vector::new(ramus.x - body.x, ramus.y - body.y, 0.0);
        if !(12.0..70.0).contains(&offset.norm()) || offset.y < 8.0 || side * offset.x < -10.0 || lingula.z < molar.z {
            let name = Landmarks::side_name(side);
            return Err(misplaced(&format!(
                "are out of place: lingula_{name} must lie 8 to 70 mm behind molar_{name}, not farther inside and not below"
            )));
        }
        let back = offset.normalize();
        Ok(Self { side, ramus, body, back, out: side * back.cross(&Vector::z()) })
    }

    /// An upright rectangle: from `from` along horizontal `along`, between two heights.
    fn upright(from: Point, along: Vector, [low, high]: [f64; 2]) -> BoundedPlane {
        let middle = from + along * 0.5;
        let point = Point::new(middle.x, middle.y, 0.5 * (low + high));
        let bounds = Some((along.normalize(), 0.5 * along.norm(), 0.5 * (high - low)));
        BoundedPlane { point, normal: Vector::z().cross(&along).normalize(), bounds }
    }

    fn cuts(&self, occlusal: &Occlusal) -> Vec<Cut> {
        let top = self.ramus.z + ABOVE_LINGULA_MM;
        let occlusal = occlusal.z(self.body.x, self.body.y);
        let bottom = self.body.z - TO_LOWER_BORDER_MM;
        let hind = self.ramus + self.back * BEHIND_LINGULA_MM;
        let inward = -self.out * (CORTEX_REACH_MM + MANDIBLE_OVERLAP_MM);
        let length = BEHIND_LINGULA_MM + TO_FRONT_MM;
        // From a little outside the split to inside the ramus's medial face.
        let middle = hind + self.out * MANDIBLE_OVERLAP_MM - self.back * (0.5 * length) + inward * 0.5;
        let bounds = Some((self.back, 0.5 * length + MANDIBLE_OVERLAP_MM, 0.5 * inward.norm()));
        let medial = BoundedPlane { point: Point::new(middle.x, middle.y, top), normal: Vector::z(), bounds };
        let hind_cut =
            Self::upright(hind + self.out * MANDIBLE_OVERLAP_MM, inward, [bottom, top + MANDIBLE_OVERLAP_MM]);
        let at = |p: Point, z: f64| Point::new(p.x, p.y, z);
        let line = vec![
            at(hind + self.back * MANDIBLE_OVERLAP_MM, top + MANDIBLE_OVERLAP_MM),
            at(
                self.ramus - self.back * (0.8 * TO_FRONT_MM).min(0.6 * (self.ramus - self.body).dot(&self.back)),
                top + MANDIBLE_OVERLAP_MM,
            ),
            at(self.body - self.back * MANDIBLE_OVERLAP_MM, occlusal + MANDIBLE_OVERLAP_MM),
        ];
        let depth_mm = top - bottom + MANDIBLE_OVERLAP_MM;
        let split = CutShape::Polyline { points: line, direction: -Vector::z(), depth_mm };
        let outward = self.out * (CORTEX_REACH_MM + MANDIBLE_OVERLAP_MM);
        let buccal = Self::upright(
            self.body - self.out * MANDIBLE_OVERLAP_MM,
            outward,
            [bottom, occlusal + MANDIBLE_OVERLAP_MM],
        );
        let name = Landmarks::side_name(self.side);
        let cut = |shape: CutShape, what: &str| Cut::from(shape).named(&format!("bsso_{name}_{what}"));
        vec![
            cut(split, "sagittal"),
            cut(CutShape::Plane(medial), "medial"),
            cut(CutShape::Plane(hind_cut), "hind"),
            cut(CutShape::Plane(buccal), "buccal"),
        ]
    }
}

/// Sagittal split of one ramus.
///
/// The medial cut lies 4 mm above `lingula_*` and ends 8 mm behind it; the split runs in the middle between the cortices, along
/// the oblique ridge to `molar_*`, a point on the buccal face of the body beside the second molar; there the buccal cut goes
/// down through the outer cortex and the lower border. Separations part the jaws where teeth touch or streaks of metal join
/// them to each other or to the ramus; with `condylion_*` another one parts the joint, so that the proximal segment can move.
pub(super) fn sagittal_split(side: f64, landmarks: &Landmarks, bone: &Envelope) -> Result<Vec<Cut>, PlanError> {
    let name = Landmarks::side_name(side);
    let occlusal = landmarks.occlusal()?;
    let one =
        Side::new(side, &landmarks.point(&format!("lingula_{name}"))?, &landmarks.point(&format!("molar_{name}"))?)?;
    let mut cuts = one.cuts(&occlusal);
    cuts.extend(jaws(landmarks, bone)?);
    if let Some(condylion) = landmarks.points.get(&format!("condylion_{name}")) {
        cuts.extend(Some(joint(side, condylion)?).filter(|c| meets(bone, c)));
    }
    Ok(cuts)
}

/// Separations of the lower jaw from the upper one: the occlusal plane in front, its continuation between the rami, and an
/// upright wall beside each ramus.
fn jaws(landmarks: &Landmarks, bone: &Envelope) -> Result<Vec<Cut>, PlanError> {
    let occlusal = landmarks.occlusal()?;
    // A side without landmarks is taken to be the other's mirror image.
    let of = |name: &str, side: f64| -> Option<Point> {
        let own = landmarks.points.get(&format!("{name}_{}", Landmarks::side_name(side)));
        let other = landmarks.points.get(&format!("{name}_{}", Landmarks::side_name(-side)));
        let mirrored = |p: &Point| landmarks.midline_x_mm.map(|m| Point::new(2.0 * m - p.x, p.y, p.z));
        own.copied().or_else(|| other.and_then(mirrored))
    };
    let (Some(left), Some(right)) = (of("lingula", 1.0), of("lingula", -1.0)) else { return Ok(Vec::new()) };
    let hind = left.y.max(right.y) + BEHIND_LINGULA_MM + MANDIBLE_OVERLAP_MM;
    let ramus_front = left.y.min(right.y) - TO_FRONT_MM + MANDIBLE_OVERLAP_MM;
    let walls = [right.x + 2.0, left.x - 2.0];
    if walls[1] - walls[0] < 20.0 {
        return Err(misplaced("have lingula_left less than 24 mm to the left (+x) of lingula_right; check both"));
    }
    let front = ramus_front - TEETH_FRONT_MM;
    let top = left.z.max(right.z) + ABOVE_LINGULA_MM + MANDIBLE_OVERLAP_MM;
    let mut cuts = vec![
        Cut::from(occlusal.part([walls[0] - 8.0, walls[1] + 8.0], [front, ramus_front])).named("occlusal"),
        Cut::from(occlusal.part(walls, [ramus_front - MANDIBLE_OVERLAP_MM, hind])).named("occlusal_hind"),
    ];
    let ends = [ramus_front, hind].map(|y| [walls[0], walls[1]].map(|x| occlusal.z(x, y)));
    let lowest = ends.as_flattened().iter().copied().fold(f64::INFINITY, f64::min);
    if top > lowest + MANDIBLE_OVERLAP_MM {
        let depth = ramus_front - hind - MANDIBLE_OVERLAP_MM;
        for (x, side, name) in [(walls[1], 1.0, "ramus_left"), (walls[0], -1.0, "ramus_right")] {
            // The rami converge towards the front.
            let offset = Vector::new(side * RAMUS_SLANT * depth, depth, 0.0);
            let wall = Side::upright(Point::new(x, hind, 0.0), offset, [lowest - MANDIBLE_OVERLAP_MM, top]);
            cuts.push(Cut::from(wall).named(name));
        }
    }
    Ok(cuts.into_iter().map(Cut::separating).filter(|c| meets(bone, c)).collect())
}

/// Separation of a joint: a cup over the condyle, whose top is `condylion`.
///
/// The cup is the upper part of an ellipsoid, with a skirt down behind the neck.
fn joint(side: f64, condylion: &Point) -> Result<Cut, PlanError> {
    const RADII_MM: [f64; 3] = [13.0, 9.5, 10.0];
    const LOWEST_POLAR: f64 = 2.0;
    const SKIRT_MM: f64 = 14.0;
    let centre = condylion - Vector::z() * (RADII_MM[2] - 1.0);
    let (rings, spokes) = (16u32, 32u32);
    let mut positions = vec![centre + Vector::z() * RADII_MM[2]];
    for r in 1..=rings {
        let polar = LOWEST_POLAR * f64::from(r) / f64::from(rings);
        for s in 0..spokes {
            let around = std::f64::consts::TAU * f64::from(s) / f64::from(spokes);
            let unit = Vector::new(polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos());
            positions.push(centre + unit.component_mul(&Vector::from(RADII_MM)));
        }
    }
    let at = |r: u32, s: u32| if r == 0 { 0 } else { 1 + (r - 1) * spokes + s % spokes };
    let mut triangles = Vec::new();
    for r in 0..rings {
        for s in 0..spokes {
            triangles.push([at(r, s), at(r + 1, s), at(r + 1, s + 1)]);
            if r > 0 {
                triangles.push([at(r, s), at(r + 1, s + 1), at(r, s + 1)]);
            }
        }
    }
    // Below the cup's rim the neck leans forward, and the wall of the ear canal may still touch it from behind.
    let first = positions.len() as u32;
    let behind: Vec<u32> = (0..=spokes / 2).map(|s| at(rings, s)).collect();
    positions.extend(behind.iter().map(|v| positions[*v as usize] - Vector::z() * SKIRT_MM).collect::<Vec<Point>>());
    for (i, pair) in behind.windows(2).enumerate() {
        let below = [first + i as u32, first + i as u32 + 1];
        triangles.push([pair[0], below[0], below[1]]);
        triangles.push([pair[0], below[1], pair[1]]);
    }
    let cup = TriMesh::new(positions, triangles).map_err(|e| misplaced(&e.to_string()))?;
    Ok(Cut::from(CutShape::Surface(cup)).named(&format!("joint_{}", Landmarks::side_name(side))).parting(centre))
}

/// Genioplasty below the mental foramina: from the front of the chin back and out through the lower border.
///
/// The cut begins 15 mm above `menton`, or at 40 % of the height from there to the occlusal plane where that is less, and leaves
/// through the lower border 40 mm behind `pogonion`, horizontally from side to side.
pub(super) fn genioplasty(landmarks: &Landmarks, bone: &Envelope) -> Result<Vec<Cut>, PlanError> {
    const HEIGHT_MM: f64 = 15.0;
    const LENGTH_MM: f64 = 40.0;
    const AHEAD_MM: f64 = 15.0;
    const HALF_WIDTH_MM: f64 = 45.0;
    let (pogonion, menton) = (landmarks.point("pogonion")?, landmarks.point("menton")?);
    let midline = landmarks.midline_x_mm.unwrap_or(pogonion.x);
    let most = landmarks.occlusal_z_mm.map_or(f64::INFINITY, |z| 0.4 * (z - menton.z));
    let height = HEIGHT_MM.min(most);
    if height < 5.0 || pogonion.z < menton.z - 5.0 || pogonion.y > menton.y + 20.0 {
        return Err(misplaced(
            "do not show a chin: pogonion must lie in front of menton and above it, both well below the occlusal plane",
        ));
    }
    let start = Point::new(midline, pogonion.y, menton.z + height);
    let lower = lower_border(bone, midline, pogonion.y + LENGTH_MM, [menton.z - 12.0, menton.z + 2.5 * height]);
    let end =
        Point::new(midline, pogonion.y + LENGTH_MM, lower.map_or(start.z, |z| z - 2.0).min(start.z + 0.3 * LENGTH_MM));
    let back = (end - start).normalize();
    let (from, to) = (start - back * AHEAD_MM, end);
    let bounds = Some((Vector::x(), HALF_WIDTH_MM, 0.5 * (to - from).norm()));
    let plane = BoundedPlane { point: nalgebra::center(&from, &to), normal: Vector::x().cross(&back) * -1.0, bounds };
    Ok(vec![Cut::from(plane).named("genioplasty")])
}

/// z of the lowest bone beside the midline at depth `y`, between two heights, mm.
fn lower_border(bone: &Envelope, midline: f64, y: f64, [low, high]: [f64; 2]) -> Option<f64> {
    let grid = &bone.grid;
    let near = |p: &Point| {
        (p.y - y).abs() < 2.0 && (10.0..45.0).contains(&(p.x - midline).abs()) && (low..high).contains(&p.z)
    };
    let inside = (0..grid.values.len()).filter(|n| grid.values[*n] < 0.0).map(|n| {
        let [i, j, k] = lattice(grid, n);
        grid.position(i, j, k)
    });
    inside.filter(near).map(|p| p.z).min_by(f64::total_cmp)
}

/// Separates the whole mandible from the skull.
///
/// Cups over `condylion_left` and `condylion_right`, separations as for the sagittal split (between the rami where `lingula_*`
/// are given), and the part of bone at `menton` as a segment.
pub(super) fn whole(landmarks: &Landmarks, bone: &Envelope) -> Result<Vec<Cut>, PlanError> {
    let mut cuts = Vec::new();
    for side in [1.0, -1.0] {
        let condylion = landmarks.point(&format!("condylion_{}", Landmarks::side_name(side)))?;
        cuts.extend(Some(joint(side, &condylion)?).filter(|c| meets(bone, c)));
    }
    let between = jaws(landmarks, bone)?;
    if between.is_empty() {
        let (occlusal, menton) = (landmarks.occlusal()?, landmarks.point("menton")?);
        let (x, y) = (landmarks.midline_x_mm.unwrap_or(menton.x), menton.y + 15.0);
        let plane = occlusal.part([x - 45.0, x + 45.0], [y - 45.0, y + 45.0]);
        cuts.extend(Some(Cut::from(plane).named("occlusal").separating()).filter(|c| meets(bone, c)));
    }
    cuts.extend(between);
    cuts.push(Cut::from(CutShape::FreePart(landmarks.point("menton")?)).named("mandible"));
    Ok(cuts)
}
