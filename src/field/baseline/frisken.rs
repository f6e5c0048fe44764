use super::octree::{Bricks, Octree};
use super::packed::{NODES, Packed, SIDE, Splits, node};
use super::pseudonormal::Pseudonormals;
use super::report::{SampledReport, warnings};
use super::settings::{Cube, EDGE, SampledSettings};
use super::tolerance::{Predicate, corners};
use crate::error::FieldError;
use crate::exact::ExactDistance;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, TriMesh, Vector};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering};

impl Octree {
    /// Builds the field of `surface` top down, from the bounding cube to the finest cells.
    ///
    /// A cell is divided while it overlaps the band and its interpolant differs from the exact distance at a corner of its
    /// children by more than the tolerance.
    ///
    /// # Errors
    /// [`FieldError`] for settings out of range, too much memory, or cancellation.
    ///
    /// # Source
    /// S. F. Frisken, R. N. Perry, A. P. Rockwood, T. R. Jones, Adaptively sampled distance fields, 2000.
    pub fn frisken(
        surface: &TriMesh,
        settings: &SampledSettings,
        control: &Control,
    ) -> Result<(Self, SampledReport), FieldError> {
        let cube = Cube::around(surface, settings)?;
        let (exact, normals) = rayon::join(|| ExactDistance::new(surface), || Pseudonormals::new(surface));
        let defects = warnings(exact.defects());
        let oracle = Oracle { surface, exact, normals };
        let lattice = oracle.lattice(&cube, &control.stage(0.0, 0.2))?;
        let predicate = cube.predicate(settings, &lattice);
        let mut division =
            Division { cube: &cube, lattice: &lattice, predicate, levels: Vec::new(), reached: Vec::new() };
        division.run();
        let Division { mut levels, reached, .. } = division;
        let done = AtomicUsize::new(0);
        let stored = AtomicUsize::new(0);
        let b = cube.bricks();
        let layers: Vec<&[usize]> = reached.chunk_by(|p, q| p / (b * b) == q / (b * b)).collect();
        let layers = layers
            .into_par_iter()
            .map(|places| {
                let bricks = oracle.layer(&cube, places, &predicate, control)?;
                let done = done.fetch_add(places.len(), Ordering::Relaxed) + places.len();
                control.report(0.2 + 0.8 * done as f64 / reached.len() as f64);
                cube.allow((stored.fetch_add(bricks.codes.len(), Ordering::Relaxed) + bricks.codes.len()) as u64)?;
                Ok(bricks)
            })
            .collect::<Result<Vec<_>, FieldError>>()?;
        let mut bricks = Bricks::default();
        for layer in layers {
            bricks.append(layer);
        }
        for &place in &reached {
            levels[place] = 0;
        }
        let octree = Self::new(cube, &predicate, &lattice, &levels, bricks);
        let report = SampledReport::of(&octree, predicate.tolerance, defects);
        control.report(1.0);
        Ok((octree, report))
    }
}

/// Exact distances signed by pseudonormals.
struct Oracle<'a> {
    surface: &'a TriMesh,
    exact: ExactDistance,
    normals: Pseudonormals,
}

impl Oracle<'_> {
    /// Signed distance at `p`, mm; `hint` is a triangle that is probably close, and becomes the nearest.
    fn signed(&self, p: &Point, hint: &mut u32) -> f32 {
        let nearest = self.exact.nearest(p, *hint);
        *hint = nearest.slot;
        let triangle = self.exact.tree().original[nearest.slot as usize] as usize;
        self.normals.signed(p, &self.surface.corners(triangle), triangle) as f32
    }

    /// Values at the corners of all bricks.
    fn lattice(&self, cube: &Cube, control: &Control) -> Result<Vec<f32>, Cancelled> {
        let n = cube.bricks() + 1;
        let pitch = cube.spacing * EDGE as f64;
        let rows = (0..n * n)
            .into_par_iter()
            .map(|row| {
                control.check()?;
                let mut hint = 0;
                let at = |i: usize| cube.origin + Vector::new(i as f64, (row % n) as f64, (row / n) as f64) * pitch;
                Ok((0..n).map(|i| self.signed(&at(i), &mut hint)).collect::<Vec<_>>())
            })
            .collect::<Result<Vec<_>, Cancelled>>()?;
        control.report(1.0);
        Ok(rows.concat())
    }

    /// Divides the bricks at `places`, which lie in one layer in increasing order.
    fn layer(
        &self,
        cube: &Cube,
        places: &[usize],
        predicate: &Predicate,
        control: &Control,
    ) -> Result<Bricks, Cancelled> {
        let b = cube.bricks();
        let mut bricks = Bricks::default();
        let mut hint = 0;
        let mut known: VecDeque<(usize, Box<[f32; NODES]>)> = VecDeque::new();
        for &place in places {
            control.check()?;
            let mut values = Box::new([f32::NAN; NODES]);
            // Faces shared with the previous brick and with the brick in the previous row.
            while known.front().is_some_and(|(p, _)| p + b < place) {
                known.pop_front();
            }
            let back = known.back().filter(|(p, _)| p + 1 == place && place % b > 0);
            let row = known.front().filter(|(p, _)| p + b == place);
            for (axis, neighbour) in [(0, back), (1, row)] {
                let Some((_, neighbour)) = neighbour else { continue };
                for n in 0..SIDE * SIDE {
                    let mut to = [n % SIDE, n % SIDE, n / SIDE];
                    to[axis] = 0;
                    let mut from = to;
                    from[axis] = EDGE;
                    values[node(to)] = neighbour[node(from)];
                }
            }
            if let Some(splits) = self.divided(cube, place, predicate, &mut values, &mut hint) {
                let (packed, leaves) = Packed::new(splits, &values, &predicate.codec, &mut bricks.codes);
                bricks.places.push(place as u32);
                bricks.packed.push(packed);
                bricks.leaves += leaves;
            }
            known.push_back((place, values));
        }
        Ok(bricks)
    }

    /// The division of brick `place`; `None` when it stays whole.
    ///
    /// `values` are those at its nodes, NaN where unknown; the values that the division needs are computed.
    fn divided(
        &self,
        cube: &Cube,
        place: usize,
        predicate: &Predicate,
        values: &mut [f32; NODES],
        hint: &mut u32,
    ) -> Option<Splits> {
        let b = cube.bricks();
        let at = [place % b, place / b % b, place / (b * b)];
        let origin = cube.origin + Vector::from(at.map(|i| (i * EDGE) as f64)) * cube.spacing;
        let mut sample = |at: [usize; 3]| {
            let value = &mut values[node(at)];
            if value.is_nan() {
                *value = self.signed(&(origin + Vector::from(at.map(|i| i as f64)) * cube.spacing), hint);
            }
            *value
        };
        let mut divides = |first: [usize; 3], size: usize| {
            // A cell can overlap the band only when its middle is within half its diagonal of it.
            let middle = sample(first.map(|f| f + size / 2));
            let reach = predicate.band + 0.5 * 3f32.sqrt() * size as f32 * cube.spacing as f32;
            middle.abs() <= reach && !predicate.fits(&corners(first, size, &mut sample))
        };
        if !divides([0; 3], EDGE) {
            return None;
        }
        let mut splits = Splits::default();
        for n in 0..8 {
            let four = [n % 2 * 4, n / 2 % 2 * 4, n / 4 * 4];
            if !divides(four, 4) {
                continue;
            }
            splits.fours |= 1 << n;
            for m in 0..8 {
                let two = [four[0] + m % 2 * 2, four[1] + m / 2 % 2 * 2, four[2] + m / 4 * 2];
                splits.twos |= u64::from(divides(two, 2)) << Splits::two(two);
            }
        }
        // Computes the corners of leaves that no test has needed.
        for n in 0..8 {
            let four = [n % 2 * 4, n / 2 % 2 * 4, n / 4 * 4];
            let size = if splits.fours >> n & 1 == 1 { 2 } else { 4 };
            for z in (0..=4).step_by(size) {
                for y in (0..=4).step_by(size) {
                    for x in (0..=4).step_by(size) {
                        sample([four[0] + x, four[1] + y, four[2] + z]);
                    }
                }
            }
        }
        Some(splits)
    }
}

/// The division of the cube down to bricks.
struct Division<'a> {
    cube: &'a Cube,
    lattice: &'a [f32],
    predicate: Predicate,
    /// Level of the leaf that each brick belongs to.
    levels: Vec<u8>,
    /// Bricks that may have to be divided further, in increasing order.
    reached: Vec<usize>,
}

impl Division<'_> {
    fn run(&mut self) {
        let b = self.cube.bricks();
        self.levels = vec![0; b * b * b];
        let level = b.next_power_of_two().trailing_zeros() as u8;
        self.divide([0; 3], level);
        self.reached.sort_unstable();
    }

    /// Divides the cell of 2^`level` bricks at brick `first` as far as necessary.
    fn divide(&mut self, first: [usize; 3], level: u8) {
        let b = self.cube.bricks();
        let size = 1usize << level;
        if first.iter().any(|f| *f >= b) {
            return;
        }
        if level == 0 {
            self.reached.push(first[0] + b * (first[1] + b * first[2]));
            return;
        }
        // A cell that extends beyond the cube is always divided.
        if first.iter().all(|f| f + size <= b) && !self.needs_division(first, size) {
            for n in 0..size * size * size {
                let at = [first[0] + n % size, first[1] + n / size % size, first[2] + n / (size * size)];
                self.levels[at[0] + b * (at[1] + b * at[2])] = level;
            }
            return;
        }
        for child in 0..8 {
            self.divide([0, 1, 2].map(|a| first[a] + (child >> a & 1) * size / 2), level - 1);
        }
    }

    fn needs_division(&self, first: [usize; 3], size: usize) -> bool {
        let n = self.cube.bricks() + 1;
        let value = |at: [usize; 3]| self.lattice[at[0] + n * (at[1] + n * at[2])];
        let half_diagonal = 0.5 * 3f64.sqrt() * self.cube.spacing * (size * EDGE) as f64;
        f64::from(value(first.map(|f| f + size / 2)).abs()) <= f64::from(self.predicate.band) + half_diagonal
            && !self.predicate.fits(&corners(first, size, value))
    }
}
