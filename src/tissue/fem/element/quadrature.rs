/// Quadrature rule of the outer triangle of a C1 prism.
///
/// Through the thickness there are always two Gauss points.
///
/// The blended rules are made for the C1 functions. They are symmetric, positive and inside the triangle, and they are exact for
/// polynomials and for the rational blends and their derivatives times linear functions, which a patch test on flat prisms
/// integrates. Polynomial rules need many more points: 16, 25 and 33 points of degree 8, 10 and 12 leave patch-test errors of
/// 4e-4, 7e-5 and 5e-5.
///
/// The table was measured in `tests/numerics`. *Patch*: nodal error of patch tests on distorted prisms, relative to the largest
/// displacement. *Stiffness*: eigenvalues of a curved prism's stiffness, relative to the exact ones. *Push*: change of the skin's
/// displacement caused by the rule when the layered slab is pushed, relative to that displacement. Stiffness and push are at
/// Poisson ratio 0.49 (0.3).
///
/// | rule | points a prism | patch, flat | patch, curved | stiffness | push |
/// |---|---|---|---|---|---|
/// | `Blended12` | 24 | 2e-8 | 4.6e-6 | 0.60 to 1.04 (0.83 to 1.01) | 3.1e-3 (8e-4) |
/// | `Blended16` | 32 | 2e-8 | 4.9e-6 | 0.85 to 1.04 (0.95 to 1.01) | 5.9e-4 (1.6e-4) |
/// | `Blended19` | 38 | 2e-8 | 3.9e-7 | 0.983 to 1.005 (0.995 to 1.002) | 6.9e-5 (1.8e-5) |
/// | `Collapsed(6)` | 72 | 6.5e-5 | 7.0e-5 | 0.961 to 1.012 (0.983 to 1.005) | 1.8e-4 (7e-5) |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TriangleRule {
    /// 12 points, degree 5.
    Blended12,
    /// 16 points, degree 6.
    Blended16,
    /// 19 points, degree 6.
    Blended19,
    /// `n` x `n` Gauss-Legendre points of a square collapsed onto the triangle, degree `2 n - 2`; for reference.
    Collapsed(usize),
}

impl TriangleRule {
    /// The cheapest rule with patch-test errors below 1e-5 and changes of displacements below 1e-3.
    pub const DEFAULT: Self = Self::Blended16;
}

/// Orbits of the triangle's symmetry group: weight (for a triangle of area 1/2) and generating coordinates.
struct Orbits {
    centre: Option<f64>,
    /// Weight and the coordinate that occurs twice.
    three: &'static [[f64; 2]],
    /// Weight and two of the three different coordinates.
    six: &'static [[f64; 3]],
}

// The tables solve the moment equations for the symmetric polynomials up to the degree and the symmetrised rational functions, by
// Gauss-Newton from random starts. Of the solutions with inside points, each has the smallest error on all products of functions
// and slopes.
const BLENDED_12: Orbits = Orbits {
    centre: None,
    three: &[[0.045594806263812654, 0.4763378062709432], [0.07397460801463662, 0.22922435875616134]],
    six: &[[0.023548626194108663, 0.03334700783178424, 0.14136404125685778]],
};
const BLENDED_16: Orbits = Orbits {
    centre: Some(0.01370928543610606),
    three: &[[0.06630295487509687, 0.22862351318721358]],
    six: &[
        [0.016212225708117006, 0.032847023734335096, 0.1108810435596964],
        [0.031684749281650194, 0.04723390882285862, 0.3435446139467565],
    ],
};
const BLENDED_19: Orbits = Orbits {
    centre: Some(0.002021977937057575),
    three: &[[0.03934401568411876, 0.1613098305331736], [0.05350310147626528, 0.40816952304966714]],
    six: &[
        [0.026045172641034835, 0.03509249670544029, 0.3312886980378158],
        [0.010527605789263516, 0.022295684371118344, 0.09271237420849476],
    ],
};

/// A point in barycentric coordinates and its weight; the weights add up to 1/2.
pub(super) type TrianglePoint = ([f64; 3], f64);

impl TriangleRule {
    /// Barycentric points and weights that add up to 1/2.
    pub(super) fn points(self) -> Vec<TrianglePoint> {
        match self {
            Self::Blended12 => BLENDED_12.points(),
            Self::Blended16 => BLENDED_16.points(),
            Self::Blended19 => BLENDED_19.points(),
            Self::Collapsed(n) => collapsed(n),
        }
    }
}

impl Orbits {
    fn points(&self) -> Vec<TrianglePoint> {
        let mut points = Vec::new();
        points.extend(self.centre.map(|w| ([1.0 / 3.0; 3], w)));
        for &[w, a] in self.three {
            let b = 1.0 - 2.0 * a;
            points.extend([[b, a, a], [a, b, a], [a, a, b]].map(|l| (l, w)));
        }
        for &[w, a, b] in self.six {
            let c = 1.0 - a - b;
            points.extend([[a, b, c], [b, c, a], [c, a, b], [b, a, c], [a, c, b], [c, b, a]].map(|l| (l, w)));
        }
        points
    }
}

/// The two Gauss points of [0, 1].
pub(super) const THROUGH_THICKNESS: [f64; 2] = [0.21132486540518713, 0.7886751345948129];
/// Weight of each of [`THROUGH_THICKNESS`].
pub(super) const THROUGH_THICKNESS_WEIGHT: f64 = 0.5;

/// `n` Gauss-Legendre points and weights of [0, 1], by Newton's method on the Legendre recurrence.
fn gauss_legendre(n: usize) -> Vec<[f64; 2]> {
    let value_and_slope = |x: f64| {
        let (mut before, mut now) = (1.0, x);
        for k in 2..=n {
            let k = k as f64;
            (before, now) = (now, ((2.0 * k - 1.0) * x * now - (k - 1.0) * before) / k);
        }
        (now, n as f64 * (x * now - before) / (x * x - 1.0))
    };
    (0..n)
        .map(|i| {
            let mut x = -(std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
            for _ in 0..20 {
                let (value, slope) = value_and_slope(x);
                x -= value / slope;
            }
            let (_, slope) = value_and_slope(x);
            [0.5 * (1.0 + x), 1.0 / ((1.0 - x * x) * slope * slope)]
        })
        .collect()
}

fn collapsed(n: usize) -> Vec<TrianglePoint> {
    let line = gauss_legendre(n.max(2));
    let mut points = Vec::new();
    for &[x, wx] in &line {
        for &[y, wy] in &line {
            let l = [x, (1.0 - x) * y, (1.0 - x) * (1.0 - y)];
            points.push((l, wx * wy * (1.0 - x)));
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_exact_up_to_their_degree() {
        let factorial = |n: i32| (1..=n).map(f64::from).product::<f64>();
        let rules = [
            (TriangleRule::Blended12, 12, 5),
            (TriangleRule::Blended16, 16, 6),
            (TriangleRule::Blended19, 19, 6),
            (TriangleRule::Collapsed(6), 36, 10),
        ];
        for (rule, count, degree) in rules {
            let points = rule.points();
            assert_eq!(points.len(), count);
            assert!(points.iter().all(|(l, w)| *w > 0.0 && l.iter().all(|c| *c > 0.0)));
            for i in 0..=degree {
                for j in 0..=degree - i {
                    let found: f64 = points.iter().map(|(l, w)| w * l[1].powi(i) * l[2].powi(j)).sum();
                    let exact = factorial(i) * factorial(j) / factorial(i + j + 2);
                    assert!((found - exact).abs() < 3e-15, "{rule:?}, monomial {i} {j}");
                }
            }
        }
    }
}
