use super::build::MOST_SAMPLES;
use super::closing::{close, far_outside};
use super::distance_field::DistanceField;
use super::error::{FieldError, within};
use super::exact::ExactDistance;
use super::region::RegionsOfKind;
use super::regions::unclear_regions;
use super::{FieldReport, FieldSettings, banded, flood};
use prosopon_geometry::control::Control;
use prosopon_geometry::{ScalarGrid, TriMesh, Warning, isosurface};

/// Separate parts below this volume are dropped, mm³.
const MIN_PART_MM3: f64 = 1000.0;
/// Dropped parts of together less than this volume (mm³), or this share of the bone, need no check.
const NEGLIGIBLE_MM3: f64 = 2000.0;
const NEGLIGIBLE_SHARE: f64 = 0.01;
/// Values are distances up to this many spacings beyond the closing radius.
const BAND: f64 = 4.0;
/// Settings of [`envelope`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnvelopeSettings {
    /// Grid spacing, mm.
    pub spacing_mm: f64,
    /// Closing radius, mm: openings narrower than twice this are closed.
    pub closing_mm: f64,
    /// Share of all directions in which a point must see out of the grid to count as outside.
    ///
    /// 0 turns this off. A larger value fills cavities that narrow openings do not enclose: sinuses open to the nose or
    /// behind walls so thin that they have holes, the back of the nose, the cranial cavity.
    pub min_visibility: f64,
}

impl Default for EnvelopeSettings {
    fn default() -> Self {
        Self { spacing_mm: 1.0, closing_mm: 2.0, min_visibility: 0.05 }
    }
}

/// The outer shell of bone: cavities and sinuses filled, narrow openings closed, small separate parts dropped.
#[derive(Debug, Clone)]
pub struct Envelope {
    /// Signed values, mm, negative inside; positive on the border of the grid.
    ///
    /// Values are distances near the surface; elsewhere at least their sign is right.
    pub grid: ScalarGrid,
    /// Isosurface of the grid: closed, two-manifold.
    pub surface: TriMesh,
    /// What was closed, filled or dropped.
    pub warnings: Vec<Warning>,
    /// Parts of the input surface where inside and outside are not clear.
    pub regions: Vec<RegionsOfKind>,
}

prosopon_geometry::flat!(Envelope { grid, surface, warnings, regions });

impl Envelope {
    /// Distance field of the envelope's surface.
    ///
    /// # Errors
    /// As [`DistanceField::build`].
    pub fn field(
        &self,
        settings: &FieldSettings,
        control: &Control,
    ) -> Result<(DistanceField, FieldReport), FieldError> {
        DistanceField::build(&self.surface, settings, control)
    }
}

/// Outer envelope of a bone surface with holes and other defects (`src/paper.md`, 11).
///
/// The far outside is the set of points that are farther than `closing_mm` from bone, see at least `min_visibility` of all
/// directions, and connect to the grid's border over such points. The outside is everything within `closing_mm` of the far
/// outside; the rest is inside. With `min_visibility` 0 this is the morphological closing with a ball, its enclosed cavities
/// filled. A closing alone cannot mend a thin wall: when both sides are outside, the ball bulges through a hole from both.
/// The value is the smaller of bone's own signed distance and that of the closing; where bone faces the outside openly it is
/// bone's own.
///
/// ```
/// use prosopon_field::{EnvelopeSettings, envelope};
/// use prosopon_geometry::control::Control;
/// use prosopon_geometry::{Point, TriMesh};
///
/// // A cube of 20 mm around the origin with a cavity of 10 mm.
/// let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
/// let (mut positions, mut triangles) = (Vec::new(), Vec::new());
/// for n in 0..16 {
///     let half = if n < 8 { 10.0 } else { 5.0 };
///     let side = |axis: usize| if n >> axis & 1 == 1 { half } else { -half };
///     positions.push(Point::new(side(0), side(1), side(2)));
/// }
/// for [a, b, c, d] in quads {
///     triangles.extend([[a, b, c], [a, c, d]]);
///     triangles.extend([[a + 8, c + 8, b + 8], [a + 8, d + 8, c + 8]]);
/// }
/// let bone = TriMesh::new(positions, triangles)?;
/// let filled = envelope(&bone, &EnvelopeSettings::default(), &Control::new())?;
/// assert!(filled.grid.sample(&Point::origin()) < 0.0);
/// assert!(filled.surface.volume() > 7500.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Accuracy
/// The closing surface lies up to a quarter of the spacing too deep, and so may walls thinner than that. Bone thinner than the
/// spacing with the outside on both sides gets holes or vanishes. Values are cut off four spacings inside, and four spacings plus
/// `closing_mm` outside; around dropped parts they are too small, but positive.
///
/// # Errors
/// [`FieldError`] when nothing is enclosed, a setting is out of range, the grid would be too large, or on cancellation.
pub fn envelope(skull: &TriMesh, settings: &EnvelopeSettings, control: &Control) -> Result<Envelope, FieldError> {
    let (spacing, closing) = (settings.spacing_mm, settings.closing_mm);
    within("spacing_mm", spacing, 0.05..=10.0, "0.05 to 10 mm")?;
    // With a smaller radius the closing surface would be too rough to keep bone's own surface where that is open.
    within("closing_mm", closing, 2.0 * spacing..=50.0, "twice spacing_mm to 50 mm")?;
    within("min_visibility", settings.min_visibility, 0.0..=0.4, "0 to 0.4")?;
    let reach = closing + BAND * spacing;
    let bounds = skull.bounds().grown(reach);
    let samples = (0..3).map(|a| (bounds.max[a] - bounds.min[a]) / spacing + 2.0).product::<f64>();
    if samples > MOST_SAMPLES as f64 {
        return Err(FieldError::TooLarge { spacing_mm: spacing, samples: samples as u64, allowed: MOST_SAMPLES });
    }

    let exact = ExactDistance::new(skull);
    let mut grid = ScalarGrid::covering(&bounds, spacing, 0.0);
    let tally = banded::signed(&exact, skull, &mut grid, reach, &control.stage(0.0, 0.5))?;
    let mut warnings = exact.defects().warnings();
    warnings.extend(tally.warning());
    let outside = far_outside(&grid, closing, settings.min_visibility, &control.stage(0.5, 0.8))?;
    close(&mut grid, &outside, closing, BAND * spacing, &control.stage(0.8, 0.9))?;

    fill_pockets(&mut grid);
    warnings.extend(drop_small_parts(&mut grid));
    control.check()?;
    let surface = isosurface(&grid, 0.0).ok_or(FieldError::NothingInside)?;
    if exact.defects().rim.is_empty() {
        let (bone, shell) = (skull.volume().abs() / 1000.0, surface.volume() / 1000.0);
        let found = format!(
            "cavities and openings narrower than {:.1} mm were filled{}: envelope {shell:.1} cm³, surface {bone:.1} cm³",
            2.0 * closing,
            if settings.min_visibility > 0.0 { ", and so were regions that see too little of the outside" } else { "" }
        );
        warnings.push(Warning::info("cavities-filled", found));
    }
    let regions = unclear_regions(skull, &exact, control)?;
    control.report(1.0);
    Ok(Envelope { grid, surface, warnings, regions })
}

/// Makes positive regions negative that do not connect to the border.
fn fill_pockets(grid: &mut ScalarGrid) {
    let outside = flood::from_border(grid.dims, |n| grid.values[n] >= 0.0);
    let least = (0.1 * grid.spacing) as f32;
    for (value, outside) in grid.values.iter_mut().zip(outside) {
        if !outside && *value >= 0.0 {
            *value = -value.max(least);
        }
    }
}

/// Makes negative parts positive that are smaller than [`MIN_PART_MM3`]; the largest part always stays.
fn drop_small_parts(grid: &mut ScalarGrid) -> Option<Warning> {
    let parts = flood::parts(grid.dims, |n| grid.values[n] < 0.0);
    let node_mm3 = grid.spacing.powi(3);
    let largest = parts.iter().map(Vec::len).max()?;
    let least = (0.1 * grid.spacing) as f32;
    let (mut dropped, mut nodes) = (0, 0);
    for part in parts.iter().filter(|p| p.len() < largest && (p.len() as f64) * node_mm3 < MIN_PART_MM3) {
        dropped += 1;
        nodes += part.len();
        for &n in part {
            grid.values[n] = (-grid.values[n]).max(least);
        }
    }
    (dropped > 0).then(|| {
        let volume = nodes as f64 * node_mm3;
        let bone_mm3 = parts.iter().map(Vec::len).sum::<usize>() as f64 * node_mm3;
        let noun = if dropped == 1 { "part" } else { "parts" };
        let found =
            format!("{dropped} separate {noun} smaller than {MIN_PART_MM3:.0} mm³ dropped ({volume:.0} mm³ in all)");
        if volume < NEGLIGIBLE_MM3.max(NEGLIGIBLE_SHARE * bone_mm3) {
            Warning::info("envelope-parts-dropped", found)
        } else {
            Warning::check("envelope-parts-dropped", found).act("Check that these parts do not belong to the bone.")
        }
    })
}
