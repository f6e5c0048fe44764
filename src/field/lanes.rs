//! Vectors of four numbers with identical results on every processor: sums and products are never fused.

/// Runs `work` compiled for this processor's vectors; it and its callees must be `#[inline(always)]`.
#[inline(always)]
pub(super) fn with_vectors<T>(work: impl FnOnce() -> T) -> T {
    pulp::Arch::new().dispatch(work)
}

/// Vectors of four numbers.
pub(super) trait Lanes: Copy {
    type Four: Copy;

    fn splat(self, x: f64) -> Self::Four;

    /// Four signed codes of 16 bits, the first in the lowest bits.
    fn codes(self, word: u64) -> Self::Four;

    fn from(self, x: [f64; 4]) -> Self::Four;

    fn array(self, a: Self::Four) -> [f64; 4];

    fn add(self, a: Self::Four, b: Self::Four) -> Self::Four;

    fn sub(self, a: Self::Four, b: Self::Four) -> Self::Four;

    fn mul(self, a: Self::Four, b: Self::Four) -> Self::Four;

    /// The first three columns of four rows.
    fn columns(self, rows: [Self::Four; 4]) -> [Self::Four; 3];
}

/// Implementation for any processor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plain;

impl Lanes for Plain {
    type Four = [f64; 4];

    #[inline(always)]
    fn splat(self, x: f64) -> [f64; 4] {
        [x; 4]
    }

    #[inline(always)]
    fn codes(self, word: u64) -> [f64; 4] {
        let code = |shift: u32| f64::from((word >> shift) as i16);
        [code(0), code(16), code(32), code(48)]
    }

    #[inline(always)]
    fn from(self, x: [f64; 4]) -> [f64; 4] {
        x
    }

    #[inline(always)]
    fn array(self, a: [f64; 4]) -> [f64; 4] {
        a
    }

    #[inline(always)]
    fn add(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]]
    }

    #[inline(always)]
    fn sub(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]]
    }

    #[inline(always)]
    fn mul(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]]
    }

    #[inline(always)]
    fn columns(self, rows: [[f64; 4]; 4]) -> [[f64; 4]; 3] {
        std::array::from_fn(|n| rows.map(|row| row[n]))
    }
}

#[cfg(target_arch = "x86_64")]
impl Lanes for pulp::x86::V3 {
    type Four = pulp::f64x4;

    #[inline(always)]
    fn splat(self, x: f64) -> Self::Four {
        self.splat_f64x4(x)
    }

    #[inline(always)]
    fn codes(self, word: u64) -> Self::Four {
        let wide = self.sse4_1._mm_cvtepi16_epi32(pulp::cast([word, 0]));
        pulp::cast(self.avx._mm256_cvtepi32_pd(wide))
    }

    #[inline(always)]
    fn from(self, x: [f64; 4]) -> Self::Four {
        pulp::cast(x)
    }

    #[inline(always)]
    fn array(self, a: Self::Four) -> [f64; 4] {
        pulp::cast(a)
    }

    #[inline(always)]
    fn add(self, a: Self::Four, b: Self::Four) -> Self::Four {
        self.add_f64x4(a, b)
    }

    #[inline(always)]
    fn sub(self, a: Self::Four, b: Self::Four) -> Self::Four {
        self.sub_f64x4(a, b)
    }

    #[inline(always)]
    fn mul(self, a: Self::Four, b: Self::Four) -> Self::Four {
        self.mul_f64x4(a, b)
    }

    #[inline(always)]
    fn columns(self, rows: [Self::Four; 4]) -> [Self::Four; 3] {
        let [a, b, c, d] = rows;
        let (a, b, c, d) = (pulp::cast(a), pulp::cast(b), pulp::cast(c), pulp::cast(d));
        let avx = self.avx;
        let (ab, cd) = (avx._mm256_unpacklo_pd(a, b), avx._mm256_unpacklo_pd(c, d));
        let (ab_odd, cd_odd) = (avx._mm256_unpackhi_pd(a, b), avx._mm256_unpackhi_pd(c, d));
        [
            pulp::cast(avx._mm256_permute2f128_pd::<0x20>(ab, cd)),
            pulp::cast(avx._mm256_permute2f128_pd::<0x20>(ab_odd, cd_odd)),
            pulp::cast(avx._mm256_permute2f128_pd::<0x31>(ab, cd)),
        ]
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;

    #[test]
    fn vectors_of_the_processor_do_what_plain_ones_do() {
        let Some(v3) = pulp::x86::V3::try_new() else { return };
        let word = 0x7fff_8000_0001_fffe;
        assert_eq!(Plain.codes(word), [-2.0, 1.0, -32768.0, 32767.0]);
        assert_eq!(v3.array(v3.codes(word)), Plain.codes(word));
        let rows: [[f64; 4]; 4] = std::array::from_fn(|j| std::array::from_fn(|i| (4 * j + i) as f64));
        let columns = v3.columns(rows.map(|row| Lanes::from(v3, row))).map(|c| v3.array(c));
        assert_eq!(columns, Plain.columns(rows));
        assert_eq!(columns[1], [1.0, 5.0, 9.0, 13.0]);
    }
}
