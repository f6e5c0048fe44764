use super::cell::{continued, sampled};
use super::far::{FarLattice, NONE, far_value, within_far};
use super::report::{SampledReport, defects};
use super::settings::{Cube, EDGE, SampledSettings};
use super::tile::{Sampler, Scratch};
use crate::error::FieldError;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Aabb, Implicit, Point, TriMesh, Vector};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Signed distances on a dense grid with trilinear interpolation.
///
/// The field is continuous; its gradient jumps between cells. Samples lie in the middle of the cells of the bounding cube. Within
/// the band they are exact; beyond it the field is interpolated between every eighth sample, so it keeps growing. Outside the
/// cube the value is that at the closest point of the cube plus the distance from there.
///
/// # Source
/// A. Fuhrmann, G. Sobottka, C. Groß, Distance fields for rapid collision detection in physically based modeling, 2003; signs
/// by pseudonormals (Wang 2009, eq. 0.8).
#[derive(Debug, Clone)]
pub struct UniformField {
    cube: Cube,
    /// Half-width of the band, mm.
    band: f64,
    /// Samples, x fastest, mm.
    values: Vec<f32>,
}

impl UniformField {
    /// Builds the field of `surface`; ignores the tolerance.
    ///
    /// # Errors
    /// [`FieldError`] for settings out of range, too much memory, or cancellation.
    pub fn build(
        surface: &TriMesh,
        settings: &SampledSettings,
        control: &Control,
    ) -> Result<(Self, SampledReport), FieldError> {
        let cube = Cube::around(surface, settings)?;
        let n = cube.cells;
        cube.allow((n as u64).pow(3))?;
        let (built, defects) = rayon::join(|| Self::sample(surface, settings, cube, control), || defects(surface));
        let field = built?;
        let report = SampledReport {
            spacing_mm: cube.spacing,
            resolution: n,
            tolerance_mm: None,
            cells: n * n * n,
            bricks: cube.bricks().pow(3),
            samples: n * n * n,
            bytes: field.bytes(),
            warnings: defects,
        };
        control.report(1.0);
        Ok((field, report))
    }

    fn sample(surface: &TriMesh, settings: &SampledSettings, cube: Cube, control: &Control) -> Result<Self, Cancelled> {
        let (n, tiles) = (cube.cells, cube.bricks());
        let field = Self { cube, band: settings.band_mm, values: Vec::new() };
        let origin = field.first_node();
        let reach = settings.band_mm + 2.0 * cube.spacing;
        let sampler = Sampler::new(surface, origin, cube.spacing, reach);
        control.check()?;
        let mut values = vec![0.0f32; n * n * n];
        let mut nearest = vec![NONE; tiles * tiles * tiles];
        let done = AtomicUsize::new(0);
        values.par_chunks_mut(n * n * EDGE).zip(nearest.par_chunks_mut(tiles * tiles)).enumerate().try_for_each(
            |(k, (values, nearest))| {
                let slab = sampler.slab(k);
                let mut scratch = Scratch::default();
                for j in 0..tiles {
                    control.check()?;
                    sampler.row(&slab, j, &mut scratch);
                    for i in 0..tiles {
                        let Some(tile) = sampler.tile([i, j, k], &mut scratch) else { continue };
                        nearest[i + tiles * j] = tile.nearest_to_first;
                        for (row, of_tile) in tile.values.chunks_exact(EDGE).enumerate() {
                            let to = EDGE * i + n * (EDGE * j + row % EDGE + n * (row / EDGE));
                            values[to..to + EDGE].copy_from_slice(of_tile);
                        }
                    }
                }
                let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                control.report(0.9 * done as f64 / tiles as f64);
                Ok(())
            },
        )?;
        control.check()?;
        let far = FarLattice::new(&sampler, &origin, cube.spacing, tiles, &nearest);
        values.par_chunks_mut(n * n * EDGE).zip(nearest.par_chunks(tiles * tiles)).enumerate().for_each(
            |(k, (values, nearest))| {
                for (tile, &triangle) in nearest.iter().enumerate() {
                    let (i, j) = (tile % tiles, tile / tiles);
                    let corners = far.around([i, j, k]);
                    for local in 0..EDGE * EDGE * EDGE {
                        let at = [local % EDGE, local / EDGE % EDGE, local / (EDGE * EDGE)];
                        let to = EDGE * i + at[0] + n * (EDGE * j + at[1] + n * at[2]);
                        let t = at.map(|a| a as f32 / EDGE as f32);
                        values[to] = match triangle {
                            NONE => far_value(&corners, t),
                            _ => within_far(values[to], reach as f32, &corners, t),
                        };
                    }
                }
            },
        );
        Ok(Self { values, ..field })
    }

    /// Memory of the field, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(&self.values[..])
    }

    /// Edge of the finest cell, mm.
    #[must_use]
    pub fn spacing_mm(&self) -> f64 {
        self.cube.spacing
    }

    /// The bounding cube, LPS mm.
    #[must_use]
    pub fn domain(&self) -> Aabb {
        self.cube.domain()
    }

    fn first_node(&self) -> Point {
        self.cube.origin + Vector::repeat(0.5 * self.cube.spacing)
    }

    fn inside(&self, p: &Point) -> (f64, Vector) {
        let n = self.cube.cells;
        let from_first = (p - self.first_node()) / self.cube.spacing;
        let mut base = [0usize; 3];
        let mut t = [0.0; 3];
        for a in 0..3 {
            // In the outer half of the outermost cells the nearest two samples are extrapolated.
            base[a] = (from_first[a].max(0.0) as usize).min(n - 2);
            t[a] = from_first[a] - base[a] as f64;
        }
        let first = base[0] + n * (base[1] + n * base[2]);
        let mut corners = [0.0; 8];
        for (c, corner) in corners.iter_mut().enumerate() {
            *corner = f64::from(self.values[first + (c & 1) + n * ((c >> 1 & 1) + n * (c >> 2))]);
        }
        let (value, gradient) = sampled(&corners, t, self.band);
        (value, gradient / self.cube.spacing)
    }
}

impl Implicit for UniformField {
    fn value(&self, p: &Point) -> f64 {
        self.value_gradient(p).0
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        continued(&self.cube.domain(), p, |p| self.inside(p))
    }
}
