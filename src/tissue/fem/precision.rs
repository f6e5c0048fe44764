//! Floating-point types in which factors are stored.

use faer::traits::RealField;
use std::ops::{Add, Div, Mul, Sub};

/// Floating-point type of a factor.
pub(super) trait Precision:
    RealField + Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    fn of(value: f64) -> Self;
    fn to(self) -> f64;
}

impl Precision for f32 {
    fn of(value: f64) -> Self {
        value as Self
    }
    fn to(self) -> f64 {
        f64::from(self)
    }
}

impl Precision for f64 {
    fn of(value: f64) -> Self {
        value
    }
    fn to(self) -> f64 {
        self
    }
}
