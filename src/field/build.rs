use super::accuracy::{Accuracy, sample_points};
use super::band_certificate::{BandBound, band_bound};
use super::brick_values::{AROUND, HALO, coefficients, tensor};
use super::certificate::surface_bound;
use super::crossings::Rows;
use super::distance_field::{DistanceField, Level};
use super::error::{FieldError, within};
use super::exact::ExactDistance;
use super::features::Features;
use super::fit::{Layer, fit};
use super::lattice::{BRICK, EDGE, Lattice};
use super::region::RegionsOfKind;
use super::regions::unclear_regions;
use super::sites::{self, Spread};
use super::spline::weights;
use super::tiles::{Source, TILE, Tally, Tile, Tiles};
use super::{coarse, refine};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Aabb, Implicit, TriMesh, Vector, Warning};

/// Most samples (coarse and fine) of a field: half a gigabyte of single-precision values.
pub(super) const MOST_SAMPLES: u64 = 1 << 27;
/// Distances must be exact up to this many spacings beyond the band.
///
/// A point of the band needs coefficients up to 3/2 spacings away (where their weight vanishes), and each coefficient depends
/// on its neighbours' values with the weight 1/8.
const STENCIL_REACH: f64 = 2.3;
/// Exact distances start to blend into the coarse spline at this many spacings beyond the band.
const FADE: f64 = 1.5;
/// Brick coefficients exceed the reach by at most this many spacings.
///
/// This covers a brick's diagonal and its neighbours.
pub(super) const LARGEST: f64 = 18.0;
/// Number of surface sites from which the error is measured.
const SITES: usize = 2000;
/// Number of surface sites from which a bound searches for the largest error.
const MANY_SITES: usize = 50_000;

/// Resolution and extent of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldSettings {
    /// Finest spacing, mm.
    pub spacing_mm: f64,
    /// Half-width of the band around the surface in which the field has its full accuracy, mm.
    pub band_mm: f64,
    /// Distance that the grid reaches beyond the surface's box, mm; the field is extrapolated farther out.
    pub margin_mm: f64,
}

impl Default for FieldSettings {
    fn default() -> Self {
        Self { spacing_mm: 0.8, band_mm: 5.0, margin_mm: 10.0 }
    }
}

impl FieldSettings {
    fn check(&self) -> Result<(), FieldError> {
        within("spacing_mm", self.spacing_mm, 0.01..=50.0, "0.01 to 50 mm")?;
        self.check_extent()
    }

    /// Checks band and margin.
    pub(super) fn check_extent(&self) -> Result<(), FieldError> {
        within("band_mm", self.band_mm, 0.0..=200.0, "0 to 200 mm")?;
        within("margin_mm", self.margin_mm, 0.0..=1000.0, "0 to 1000 mm")
    }
}

/// Size, accuracy and warnings of a built field.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldReport {
    /// Number of bricks: of 8³ nodes in the band, plus detail bricks of 4³ nodes at half the spacing.
    pub bricks: usize,
    /// Memory that the field takes, bytes.
    pub bytes: usize,
    /// Largest difference from the exact distance at a fixed set of points within the band, mm.
    pub max_error_mm: f64,
    /// RMS difference at the same points, mm.
    pub rms_error_mm: f64,
    /// Number of those points.
    pub checked_points: usize,
    /// Defects of the surface and how the field treats them.
    pub warnings: Vec<Warning>,
    /// Parts of the surface where inside and outside are not clear; empty when they were not searched.
    pub regions: Vec<RegionsOfKind>,
}

prosopon_geometry::flat!(FieldReport { bricks, bytes, max_error_mm, rms_error_mm, checked_points, warnings, regions });

impl FieldReport {
    /// Errors of `field` at fixed points within `band` (mm) and on the surface; other entries stay empty.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn measured(
        field: &dyn Implicit,
        exact: &ExactDistance,
        surface: &TriMesh,
        band: f64,
        control: &Control,
    ) -> Result<Self, Cancelled> {
        let points = sample_points(surface, exact, band, SITES, control)?;
        let accuracy = Accuracy::measure(field, exact, &points, control)?;
        control.report(1.0);
        Ok(Self {
            bricks: 0,
            bytes: 0,
            max_error_mm: accuracy.max_error_mm,
            rms_error_mm: accuracy.rms_error_mm,
            checked_points: accuracy.points,
            warnings: Vec::new(),
            regions: Vec::new(),
        })
    }
}

fn too_large(settings: &FieldSettings, samples: u64) -> FieldError {
    FieldError::TooLarge { spacing_mm: settings.spacing_mm, samples, allowed: MOST_SAMPLES }
}

impl DistanceField {
    /// Builds the field of `surface` and measures its error at a fixed set of sample points.
    ///
    /// ```
    /// use prosopon_field::{DistanceField, FieldSettings};
    /// use prosopon_geometry::control::Control;
    /// use prosopon_geometry::{Implicit, Point, TriMesh};
    ///
    /// // A cube of 20 mm around the origin; the bits of a corner's number are its sides.
    /// let side = |n: usize, axis: usize| if n >> axis & 1 == 1 { 10.0 } else { -10.0 };
    /// let corners = (0..8).map(|n| Point::new(side(n, 0), side(n, 1), side(n, 2))).collect();
    /// let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    /// let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    /// let cube = TriMesh::new(corners, triangles)?;
    ///
    /// let settings = FieldSettings { spacing_mm: 1.0, band_mm: 3.0, margin_mm: 5.0 };
    /// let (field, _report) = DistanceField::build(&cube, &settings, &Control::new())?;
    /// let (value, gradient) = field.value_gradient(&Point::new(12.0, 0.0, 0.0));
    /// assert!((value - 2.0).abs() < 0.01 && (gradient.x - 1.0).abs() < 0.01);
    /// assert!(field.value(&Point::origin()) < 0.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`FieldError`] for settings out of range, too much memory, or cancellation.
    pub fn build(
        surface: &TriMesh,
        settings: &FieldSettings,
        control: &Control,
    ) -> Result<(Self, FieldReport), FieldError> {
        let exact = ExactDistance::new(surface);
        let (field, report) = Self::build_from(&exact, surface, settings, control)?;
        let regions = unclear_regions(surface, &exact, control)?;
        Ok((field, FieldReport { regions, ..report }))
    }

    /// Builds the field as [`DistanceField::build`] does, with `exact` already made from `surface`, and searches no regions.
    ///
    /// # Errors
    /// As [`DistanceField::build`].
    pub fn build_from(
        exact: &ExactDistance,
        surface: &TriMesh,
        settings: &FieldSettings,
        control: &Control,
    ) -> Result<(Self, FieldReport), FieldError> {
        let (field, warnings) = Self::build_unmeasured(exact, surface, settings, &control.stage(0.0, 0.7))?;
        let report = FieldReport::measured(&field, exact, surface, settings.band_mm, &control.stage(0.7, 1.0))?;
        let report = FieldReport { bricks: field.n_bricks(), bytes: field.bytes(), warnings, ..report };
        Ok((field, report))
    }

    /// Proven bound on the field's magnitude, which is its error, at every point of `surface`, mm.
    ///
    /// The field and `exact` were made from `surface`. The bound is proven, not sampled, and at most a twentieth above the
    /// largest value found. It takes some seconds. `None` when the surface is too large for the field's spacing to be examined.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn surface_bound(
        &self,
        surface: &TriMesh,
        exact: &ExactDistance,
        control: &Control,
    ) -> Result<Option<f64>, Cancelled> {
        surface_bound(self, surface, exact.defects(), control)
    }

    /// Proven bound on the field's error (mm) at every point of its domain within `band` (mm) of `surface`.
    ///
    /// The field and `exact` were made from `surface`. The bound is proven, not sampled, and is not refined below seven tenths of
    /// the spacing or a tenth above the largest error found. `on_surface` is the result of [`DistanceField::surface_bound`], mm.
    /// The proof takes some ten minutes of processor time on a skull at 0.8 mm; it stops when `keep_going` returns false, and the
    /// bound then holds for a share of the field. `None` when the surface is open or the field is too large to be examined.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn band_bound(
        &self,
        surface: &TriMesh,
        exact: &ExactDistance,
        band: f64,
        on_surface: f64,
        keep_going: &(dyn Fn() -> bool + Sync),
        control: &Control,
    ) -> Result<Option<BandBound>, Cancelled> {
        let points = sample_points(surface, exact, band, MANY_SITES, control)?;
        let largest_found = Accuracy::measure(self, exact, &points, control)?.max_error_mm;
        band_bound(self, exact, band, on_surface, largest_found, keep_going, control)
    }

    /// Builds the field as [`DistanceField::build_from`] does, without measuring its error.
    ///
    /// Also returns the warnings about defects of the surface.
    ///
    /// Coefficients are c = f - (sum of f's second differences along the axes) / 8, exact for quadratics, of the signed distance
    /// f: first on the coarse nodes, then on the nodes of the bricks within the band, then on nodes of half that spacing where
    /// the distance curves too much near the surface for the brick spacing.
    ///
    /// # Errors
    /// As [`DistanceField::build`].
    pub fn build_unmeasured(
        exact: &ExactDistance,
        surface: &TriMesh,
        settings: &FieldSettings,
        control: &Control,
    ) -> Result<(Self, Vec<Warning>), FieldError> {
        Self::build_within(exact, surface, None, settings, control)
    }

    /// As [`DistanceField::build_unmeasured`], with full accuracy only in the box `within` (LPS mm).
    ///
    /// Without a box the whole band has full accuracy. Bricks outside the box are not built, and a warning reports that. There,
    /// as beyond the band, the field is the coarse spline, on a lattice of eight spacings: its sign is right farther than about a
    /// coarse spacing from the surface, and its distance is some millimetres off. [`DistanceField::is_fine_at`] returns whether
    /// a point has full accuracy.
    ///
    /// # Errors
    /// As [`DistanceField::build`]; [`FieldError::BoxOutsideDomain`] for a box that misses the field's domain.
    pub fn build_within(
        exact: &ExactDistance,
        surface: &TriMesh,
        within: Option<&Aabb>,
        settings: &FieldSettings,
        control: &Control,
    ) -> Result<(Self, Vec<Warning>), FieldError> {
        settings.check()?;
        exact.defects().check()?;
        let bounds = surface.bounds().grown(settings.margin_mm);
        let lattice = Lattice::covering(&bounds, settings.spacing_mm, MOST_SAMPLES)
            .map_err(|samples| too_large(settings, samples))?;
        let chosen = match within {
            Some(within) => lattice.bricks_meeting(within).ok_or(FieldError::BoxOutsideDomain)?,
            None => [[0; 3], lattice.bricks],
        };
        control.check()?;

        let reach = settings.band_mm + STENCIL_REACH * settings.spacing_mm;
        let mut tally = Tally::default();
        // Each has sequential parts, so the two run in parallel.
        let (features, coarse) = rayon::join(
            || Features::new(surface, &exact.defects().triangles),
            || coarse::coefficients(&lattice, exact, surface, reach, &control.stage(0.0, 0.3)),
        );
        let (coarse, signs) = coarse?;
        let source = Source { mesh: surface, defects: exact.defects(), features: &features };

        tally.add(&signs);
        let h = settings.spacing_mm;
        let mut field = Self::coarse(lattice, coarse, [reach + LARGEST * h, 0.5 * LARGEST * h]);
        tally.add(&field.add_bricks(source, chosen, settings, &control.stage(0.3, 0.8))?);
        let (layer, spread) = rayon::join(
            || Layer::new(&field, Level::Brick),
            || Spread::new(&field, surface, &exact.defects().distinct),
        );

        let mut sites = sites::of_bricks(&spread, &layer.at);
        fit(&mut field, &layer, &mut sites, h);
        refine::add_details(&mut field, source, &layer, &spread, sites, &control.stage(0.8, 1.0))?;
        let mut warnings = exact.defects().warnings();
        warnings.extend(tally.warning());
        if within.is_some() && chosen != [[0; 3], field.lattice.bricks] {
            let found = format!(
                "the field has full accuracy only in {} of {} blocks of its domain; elsewhere its spacing is {:.1} mm",
                (0..3).map(|a| chosen[1][a] - chosen[0][a]).product::<usize>(),
                field.lattice.n_bricks(),
                field.lattice.coarse_spacing()
            );
            warnings.push(Warning::info("partial-field", found));
        }
        control.report(1.0);
        Ok((field, warnings))
    }

    /// Adds the bricks that the band reaches, at positions from `chosen[0]` up to before `chosen[1]`; returns the tally of signs.
    fn add_bricks(
        &mut self,
        source: Source<'_>,
        chosen: [[usize; 3]; 2],
        settings: &FieldSettings,
        control: &Control,
    ) -> Result<Tally, FieldError> {
        let h = settings.spacing_mm;
        let reach = settings.band_mm + STENCIL_REACH * h;
        let rows = Rows {
            origin: self.lattice.origin - Vector::repeat(HALO as f64 * h),
            spacing: h,
            dims: self.lattice.bricks.map(|n| n * EDGE + 2 * HALO),
        };
        let is_chosen = |first: [usize; 3], last: [usize; 3]| {
            (0..3).all(|a| last[a] >= EDGE * chosen[0][a] && first[a] < EDGE * chosen[1][a] + 2 * HALO)
        };
        let tiles = Tiles::new(source, rows, HALO, reach, is_chosen);
        let fade = [settings.band_mm + FADE * h, reach];
        let field = &*self;
        let built = tiles.map(
            control,
            #[inline(always)]
            |tile| field.tile_bricks(tile, chosen, fade),
        )?;
        drop(tiles);
        let n_bricks = built.iter().map(|b| b.at.len()).sum::<usize>();
        let samples = (self.lattice.n_bricks() + n_bricks * BRICK) as u64;
        if samples > MOST_SAMPLES {
            return Err(too_large(settings, samples));
        }
        let mut tally = Tally::default();
        self.bricks.reserve(n_bricks);
        for of_tile in built {
            let first = self.bricks.append(&of_tile.codes);
            for (n, at) in of_tile.at.iter().enumerate() {
                let place = self.lattice.index_of(*at);
                self.index[place] = first + n as u32;
            }
            tally.add(&of_tile.tally);
        }
        Ok(tally)
    }

    /// The bricks of a tile that the band reaches.
    ///
    /// Only brick positions from `chosen[0]` up to before `chosen[1]` count. Between the two distances `fade` (mm) the values
    /// blend into the coarse spline.
    #[inline(always)]
    fn tile_bricks(&self, tile: &Tile, chosen: [[usize; 3]; 2], fade: [f64; 2]) -> Built {
        let mut built = Built::default();
        let first = tile.first.map(|n| n / EDGE);
        let wanted = (fade[0] * fade[0]) as f32;
        for n in 0..(TILE / EDGE).pow(3) {
            let step = [n % (TILE / EDGE), n / (TILE / EDGE) % (TILE / EDGE), n / (TILE / EDGE).pow(2)];
            let at = [0, 1, 2].map(|a| first[a] + step[a]);
            if (0..3).any(|a| at[a] < chosen[0][a] || at[a] >= chosen[1][a]) {
                continue;
            }
            let node = step.map(|s| s * EDGE);
            if tile.least_squared(node.map(|n| n + HALO)) > wanted {
                continue;
            }
            let (inside, inverted) = tile.inside(node, [AROUND; 3]);
            let coarse = self.coarse_at(at);
            let mut values = [0.0f32; AROUND.pow(3)];
            tile.copy_squared(node, AROUND, &mut values);
            for ((value, inside), coarse) in values.iter_mut().zip(&inside).zip(&coarse) {
                let d = value.sqrt();
                let signed = if *inside { -d } else { d };
                let far = ((d - fade[0] as f32) / (fade[1] - fade[0]) as f32).clamp(0.0, 1.0);
                *value = if far == 0.0 { signed } else { blend(signed, *coarse, far) };
            }
            let mut c = [0.0; BRICK];
            coefficients(&values, EDGE, &mut c);
            self.bricks.pack(&c, &mut built.codes);
            built.at.push(at);
            built.tally.add(&Tally::count(&inside, inverted));
        }
        built.codes.shrink_to_fit();
        built
    }

    /// The coarse spline at the nodes of a brick and those next to it, continued from the brick's cell.
    #[inline(always)]
    fn coarse_at(&self, brick: [usize; 3]) -> [f32; AROUND.pow(3)] {
        let c = self.coarse_around(brick).map(|c| c as f32);
        let mut rows = [[0.0f32; 3]; AROUND];
        for (i, row) in rows.iter_mut().enumerate() {
            let t = (i as f64 - HALO as f64 - 0.5 * (EDGE as f64 - 1.0)) / EDGE as f64;
            *row = weights(t).map(|w| w as f32);
        }
        tensor(&c, &rows)
    }
}

/// The bricks of a tile.
#[derive(Default)]
struct Built {
    at: Vec<[usize; 3]>,
    codes: Vec<i16>,
    tally: Tally,
}

/// `far` may come with an infinite distance.
fn blend(near: f32, coarse: f32, far: f32) -> f32 {
    if far >= 1.0 { coarse } else { near + far * (coarse - near) }
}
