use super::packed::Codec;

/// Condition under which a cell need not be divided.
#[derive(Debug, Clone, Copy)]
pub(super) struct Predicate {
    pub(super) codec: Codec,
    /// Largest difference allowed at the corners of the children, mm.
    pub(super) tolerance: f32,
    /// Half-width of the band, mm; cells beyond it are not divided.
    pub(super) band: f32,
}

impl Predicate {
    /// Whether one of the 27 corners of a cell's children is within the band.
    pub(super) fn touches_band(&self, corners: &[f32; 27]) -> bool {
        corners.iter().any(|v| v.abs() <= self.band)
    }

    /// Whether the trilinear interpolant of a cell's stored corners fits its children.
    ///
    /// It fits when it is within the tolerance at all 27 `corners` of the children (x fastest; Wang 2009, adaptive sampling).
    pub(super) fn fits(&self, corners: &[f32; 27]) -> bool {
        let mut interpolated = *corners;
        for c in [0, 2, 6, 8, 18, 20, 24, 26] {
            interpolated[c] = self.codec.rounded(corners[c]);
        }
        // Middles of edges along x, then along y from those rows, then along z from those layers.
        for (stride, lines) in
            [(1, [0, 6, 18, 24].as_slice()), (3, &[0, 1, 2, 18, 19, 20]), (9, &[0, 1, 2, 3, 4, 5, 6, 7, 8])]
        {
            for &line in lines {
                interpolated[line + stride] = 0.5 * (interpolated[line] + interpolated[line + 2 * stride]);
            }
        }
        corners.iter().zip(&interpolated).all(|(v, i)| (v - i).abs() <= self.tolerance)
    }
}

/// The 27 corners of the children of a cell at `first` of the given even `size`, x fastest.
pub(super) fn corners(first: [usize; 3], size: usize, mut value: impl FnMut([usize; 3]) -> f32) -> [f32; 27] {
    let mut found = [0.0; 27];
    for (n, corner) in found.iter_mut().enumerate() {
        let step = [n % 3, n / 3 % 3, n / 9];
        *corner = value([0, 1, 2].map(|a| first[a] + step[a] * size / 2));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trilinear_function_fits_and_a_bump_does_not() {
        let predicate = Predicate { codec: Codec::new(100.0, 100.0), tolerance: 0.01, band: 3.0 };
        let mut sampled = corners([2, 4, 6], 2, |[x, y, z]| (x * y) as f32 - 0.5 * z as f32 + 0.1 * (x * y * z) as f32);
        assert!(predicate.fits(&sampled));
        for n in (0..27).filter(|n| ![0, 2, 6, 8, 18, 20, 24, 26].contains(n)) {
            sampled[n] += 0.02;
            assert!(!predicate.fits(&sampled), "{n}");
            sampled[n] -= 0.02;
        }
        assert!(!predicate.touches_band(&[3.5; 27]));
        assert!(predicate.touches_band(&[-2.0; 27]));
    }
}
