use super::build::MOST_SAMPLES;
use super::closing::{close, far_outside};
use super::distance_field::DistanceField;
use super::error::{FieldError, within};
use super::exact::ExactDistance;
use super::regions::{DoubtfulRegions, doubtful_regions};
use super::{FieldReport, FieldSettings, banded, flood};
use prosopon_geometry::control::Control;
use prosopon_geometry::{ScalarGrid, TriMesh, isosurface};

/// Separate parts below this volume are dropped, mm³.
const CRUMB_MM3: f64 = 1000.0;
/// Values are distances up to this many spacings beyond the closing radius.
const BAND: f64 = 4.0;
/// Settings of [`envelope`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnvelopeSettings {
    /// Grid spacing, mm.
    pub spacing_mm: f64,
    /// Openings narrower than twice this are closed, mm.
    pub closing_mm: f64,
    /// Share of all directions in which a place must see out to be outside; 0 asks for none. Fills what narrow openings do
    /// not enclose: sinuses open to the nose or behind walls so thin that they have holes, the nose's back, the cranial cavity.
    pub least_sky: f64,
}

impl Default for EnvelopeSettings {
    fn default() -> Self {
        Self { spacing_mm: 1.0, closing_mm: 2.0, least_sky: 0.05 }
    }
}

/// The outer shell of bone: cavities and sinuses filled, narrow openings closed, crumbs dropped.
#[derive(Debug, Clone)]
pub struct Envelope {
    /// Signed values, mm, negative inside; a distance near the surface, at least right in sign elsewhere. The border of the grid is positive.
    pub grid: ScalarGrid,
    /// Isosurface of the grid: closed, two-manifold.
    pub surface: TriMesh,
    /// What was closed, filled or dropped.
    pub warnings: Vec<String>,
    /// Where the surface that it was made of leaves it open what is inside.
    pub regions: Vec<DoubtfulRegions>,
}

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

/// Outer envelope of a dirty bone surface (notes 11 of the reading notes).
///
/// Far outside is what a flood from the grid's border reaches over places that are farther than `closing_mm` from bone and
/// see at least `least_sky` of the sky; outside is what lies within `closing_mm` of that, everything else is inside. Without a
/// sky this is the morphological closing with a ball, its enclosed cavities filled. A closing alone cannot mend a thin wall:
/// the ball bulges through a hole from both sides when both are outside. The value is the smaller of bone's own signed
/// distance and the closing's: where bone faces the outside openly it is bone's own.
///
/// # Accuracy
/// The closing surface lies up to a quarter of the spacing below its place, so may walls thinner than that. Bone thinner than the
/// spacing with the outside on both sides gets holes or vanishes. Values are cut off four spacings inside, four and `closing_mm`
/// outside; they are too small (but positive) around dropped crumbs.
///
/// # Errors
/// [`FieldError`] when nothing is enclosed, for settings out of range, or cancellation.
pub fn envelope(skull: &TriMesh, settings: &EnvelopeSettings, control: &Control) -> Result<Envelope, FieldError> {
    let (spacing, closing) = (settings.spacing_mm, settings.closing_mm);
    within("spacing_mm", spacing, 0.05..=10.0, "0.05 to 10 mm")?;
    // Below that the closing surface would be too rough to leave bone's own alone.
    within("closing_mm", closing, 2.0 * spacing..=50.0, "twice spacing_mm to 50 mm")?;
    within("least_sky", settings.least_sky, 0.0..=0.4, "0 to 0.4")?;
    let reach = closing + BAND * spacing;
    let bounds = skull.bounds().grown(reach);
    let samples = (0..3).map(|a| (bounds.max[a] - bounds.min[a]) / spacing + 2.0).product::<f64>();
    if samples > MOST_SAMPLES as f64 {
        return Err(FieldError::TooLarge { spacing_mm: spacing, samples: samples as u64, allowed: MOST_SAMPLES });
    }

    let exact = ExactDistance::new(skull);
    let mut grid = ScalarGrid::covering(&bounds, spacing, 0.0);
    let tally = banded::signed(&exact, skull, &mut grid, reach, &control.part(0.0, 0.5))?;
    let mut warnings = exact.defects().warnings();
    warnings.extend(tally.warnings());
    let outside = far_outside(&grid, closing, settings.least_sky, &control.part(0.5, 0.8))?;
    close(&mut grid, &outside, closing, BAND * spacing, &control.part(0.8, 0.9))?;

    fill_pockets(&mut grid);
    warnings.extend(drop_crumbs(&mut grid));
    control.check()?;
    let surface = isosurface(&grid, 0.0).ok_or(FieldError::NothingInside)?;
    if exact.defects().rim.is_empty() {
        let (bone, shell) = (skull.volume().abs() / 1000.0, surface.volume() / 1000.0);
        warnings.push(format!(
            "the envelope holds {shell:.1} cm³, the surface itself {bone:.1} cm³: cavities and openings narrower than {:.1} mm were filled{}",
            2.0 * closing,
            if settings.least_sky > 0.0 { ", and places that see too little of the outside" } else { "" }
        ));
    }
    let regions = doubtful_regions(skull, &exact, control)?;
    control.report(1.0);
    Ok(Envelope { grid, surface, warnings, regions })
}

/// Turns places that are positive but cannot be reached from the border to the inside.
fn fill_pockets(grid: &mut ScalarGrid) {
    let outside = flood::from_border(grid.dims, |n| grid.values[n] >= 0.0);
    let least = (0.1 * grid.spacing) as f32;
    for (value, outside) in grid.values.iter_mut().zip(outside) {
        if !outside && *value >= 0.0 {
            *value = -value.max(least);
        }
    }
}

/// Turns parts of the inside that are smaller than [`CRUMB_MM3`] to the outside; the largest part stays in any case.
fn drop_crumbs(grid: &mut ScalarGrid) -> Option<String> {
    let parts = flood::parts(grid.dims, |n| grid.values[n] < 0.0);
    let node_mm3 = grid.spacing.powi(3);
    let largest = parts.iter().map(Vec::len).max()?;
    let least = (0.1 * grid.spacing) as f32;
    let (mut dropped, mut nodes) = (0, 0);
    for part in parts.iter().filter(|p| p.len() < largest && (p.len() as f64) * node_mm3 < CRUMB_MM3) {
        dropped += 1;
        nodes += part.len();
        for &n in part {
            grid.values[n] = (-grid.values[n]).max(least);
        }
    }
    (dropped > 0).then(|| {
        let volume = nodes as f64 * node_mm3;
        let parts = if dropped == 1 { "part" } else { "parts" };
        format!("{dropped} separate {parts} smaller than {CRUMB_MM3:.0} mm³, together {volume:.0} mm³: dropped")
    })
}
