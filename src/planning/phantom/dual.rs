//! Scalars in which the solids are written: plain or with their gradient (forward-mode differentiation).

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A scalar that depends on the position: [`f64`] or [`Dual`].
pub(super) trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
{
    fn constant(value: f64) -> Self;
    fn value(self) -> f64;
    fn sqrt(self) -> Self;
    fn cos(self) -> Self;
    /// Angle of the vector (`x`, `self`), as [`f64::atan2`].
    fn atan2(self, x: Self) -> Self;

    fn squared(self) -> Self {
        self * self
    }

    fn max(self, other: Self) -> Self {
        if self.value() >= other.value() { self } else { other }
    }

    fn min(self, other: Self) -> Self {
        if self.value() <= other.value() { self } else { other }
    }

    fn clamp(self, low: f64, high: f64) -> Self {
        self.max(Self::constant(low)).min(Self::constant(high))
    }

    fn abs(self) -> Self {
        if self.value() < 0.0 { -self } else { self }
    }
}

impl Real for f64 {
    fn constant(value: f64) -> Self {
        value
    }
    fn value(self) -> f64 {
        self
    }
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    fn cos(self) -> Self {
        self.cos()
    }
    fn atan2(self, x: Self) -> Self {
        self.atan2(x)
    }
}

/// A value and its gradient.
#[derive(Debug, Clone, Copy)]
pub(super) struct Dual {
    pub(super) value: f64,
    pub(super) gradient: [f64; 3],
}

impl Dual {
    /// Coordinate `axis` of a point.
    pub(super) fn variable(value: f64, axis: usize) -> Self {
        let mut gradient = [0.0; 3];
        gradient[axis] = 1.0;
        Self { value, gradient }
    }

    /// `value` with the gradient `s self' + t other'`.
    fn chain(self, other: Self, value: f64, s: f64, t: f64) -> Self {
        Self { value, gradient: [0, 1, 2].map(|a| s * self.gradient[a] + t * other.gradient[a]) }
    }

    fn scaled(self, value: f64, slope: f64) -> Self {
        Self { value, gradient: self.gradient.map(|g| slope * g) }
    }
}

impl Real for Dual {
    fn constant(value: f64) -> Self {
        Self { value, gradient: [0.0; 3] }
    }
    fn value(self) -> f64 {
        self.value
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        // Only sums of squares occur under the root; where they are 0 they have their minimum, so the gradient is 0.
        self.scaled(root, if root > 0.0 { 0.5 / root } else { 0.0 })
    }
    fn cos(self) -> Self {
        self.scaled(self.value.cos(), -self.value.sin())
    }
    fn atan2(self, x: Self) -> Self {
        let r_sq = self.value * self.value + x.value * x.value;
        let (s, t) = if r_sq > 0.0 { (x.value / r_sq, -self.value / r_sq) } else { (0.0, 0.0) };
        self.chain(x, self.value.atan2(x.value), s, t)
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        self.chain(o, self.value + o.value, 1.0, 1.0)
    }
}
impl Sub for Dual {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self.chain(o, self.value - o.value, 1.0, -1.0)
    }
}
impl Mul for Dual {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        self.chain(o, self.value * o.value, o.value, self.value)
    }
}
impl Div for Dual {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let value = self.value / o.value;
        self.chain(o, value, 1.0 / o.value, -value / o.value)
    }
}
impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        self.scaled(-self.value, -1.0)
    }
}
impl Add<f64> for Dual {
    type Output = Self;
    fn add(self, o: f64) -> Self {
        self.scaled(self.value + o, 1.0)
    }
}
impl Sub<f64> for Dual {
    type Output = Self;
    fn sub(self, o: f64) -> Self {
        self.scaled(self.value - o, 1.0)
    }
}
impl Mul<f64> for Dual {
    type Output = Self;
    fn mul(self, o: f64) -> Self {
        self.scaled(self.value * o, o)
    }
}
