use std::io::Write;
use std::path::Path;
use std::time::Instant;

use super::error::BenchError;
use super::files::read_surface;
use prosopon_field::{Accuracy, BandBound, DistanceField, ExactDistance, FieldSettings, SampleKind, sample_points};
use prosopon_geometry::control::Control;

/// Sites of the points that try to break the bounds: about a million points.
const SITES: usize = 600_000;
/// Below this share of the spacing the sign of a value is settled by the winding number.
const DOUBT: f64 = 0.75;

/// Proves bounds on the adaptive field's error and tries to break them.
#[derive(Debug)]
pub struct BoundStudy<'a> {
    /// Surface file.
    pub mesh: &'a Path,
    /// Spacing and band.
    pub settings: FieldSettings,
    /// The bound in the band is proven for as many bricks as this time allows, s.
    pub most_s: f64,
}

impl BoundStudy<'_> {
    /// Runs the study; prints to `out`. Whether no point breaks a bound.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<bool, BenchError> {
        let control = Control::new();
        let surface = read_surface(self.mesh)?;
        let exact = ExactDistance::new(&surface);
        let (FieldSettings { spacing_mm, band_mm, .. }, settings) = (self.settings, &self.settings);
        let (field, warnings) = DistanceField::build_unmeasured(&exact, &surface, settings, &control)
            .map_err(|source| BenchError::Field { method: "adaptive", source })?;
        for warning in warnings {
            writeln!(out, "warning: {warning}")?;
        }
        let points = sample_points(&surface, &exact, band_mm, SITES, &control)?;
        let at = |places: &[SampleKind]| {
            let chosen: Vec<_> = points.iter().filter(|(place, _)| places.contains(place)).copied().collect();
            Accuracy::measure(&field, &exact, &chosen, &control)
        };
        let mut held = true;
        let mut compare = |what: &str, bound: Option<f64>, places: &[SampleKind]| -> Result<(), BenchError> {
            let found = at(places)?;
            let Some(bound) = bound else {
                writeln!(out, "{what}: no bound; largest of {} points {:.4} mm", found.points, found.max_error_mm)?;
                return Ok(());
            };
            held &= found.max_error_mm <= bound;
            writeln!(
                out,
                "{what}: proven {bound:.4} mm; largest of {} points {:.4} mm, wrong signs before they are settled {}",
                found.points, found.max_error_mm, found.sign_errors
            )?;
            Ok(())
        };
        let on_surface = field.surface_bound(&surface, &exact, &control)?;
        compare("on the surface", on_surface, &[SampleKind::Face, SampleKind::Edge])?;
        let start = Instant::now();
        let goes_on = || start.elapsed().as_secs_f64() < self.most_s;
        let in_band = match on_surface {
            Some(bound) => field.band_bound(&surface, &exact, band_mm, bound, &goes_on, &control)?,
            None => None,
        };
        let place = format!("within {band_mm} mm");
        let places = [SampleKind::Band, SampleKind::Face, SampleKind::Edge, SampleKind::MedialAxis];
        let whole = in_band.filter(|proof| proof.share == 1.0).map(|proof| proof.bound_mm);
        compare(&place, whole, &places)?;
        let limit = DOUBT * spacing_mm;
        match in_band {
            Some(BandBound { bound_mm, share: 1.0 }) => {
                let is = if bound_mm < limit { "" } else { "not " };
                writeln!(
                    out,
                    "settled signs are {is}proven right in the band: the bound would have to be below {limit} mm"
                )?;
            }
            Some(BandBound { bound_mm, share }) => writeln!(
                out,
                "{place}: stopped after {} s (--most-s): {bound_mm:.4} mm proven for {:.1} % of the domain, spread evenly; nothing is proven for the rest",
                self.most_s,
                100.0 * share
            )?,
            None => {}
        }
        Ok(held)
    }
}
