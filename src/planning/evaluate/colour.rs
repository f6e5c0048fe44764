//! Colours of pictures.

/// Blue to white to red in equal steps, distinguishable with red-green colour blindness.
/// These are the nine classes of ColorBrewer's RdBu (Harrower & Brewer 2003), reversed, with pure white in the middle.
const DIVERGING: [[u8; 3]; 9] = [
    [33, 102, 172],
    [67, 147, 195],
    [146, 197, 222],
    [209, 229, 240],
    [255, 255, 255],
    [253, 219, 199],
    [244, 165, 130],
    [214, 96, 77],
    [178, 24, 43],
];
/// Colour of vertices without a value.
pub(super) const NO_VALUE: [u8; 3] = [150, 150, 150];
/// Colour of surfaces without values.
pub(super) const SKIN: [u8; 3] = [232, 196, 172];

/// Diverging sRGB colour (blue negative, white 0, red positive) of `value` on -limit to limit.
///
/// Values outside the range take the colour of its nearer end; NaN is grey. When the limit is not above 0, all values except 0
/// take the colours of the ends.
///
/// # Examples
/// ```
/// use prosopon_planning::evaluate::diverging;
///
/// assert_eq!(diverging(0.0, 3.0), [255, 255, 255]);
/// let [red, _, blue] = diverging(-3.0, 3.0);
/// assert!(blue > red);
/// assert_eq!(diverging(5.0, 3.0), diverging(3.0, 3.0));
/// ```
#[must_use]
pub fn diverging(value: f64, limit: f64) -> [u8; 3] {
    if value.is_nan() {
        return NO_VALUE;
    }
    let share = if value == 0.0 { 0.0 } else { value / limit.max(f64::MIN_POSITIVE) };
    let last = (DIVERGING.len() - 1) as f64;
    let x = (0.5 * (share.clamp(-1.0, 1.0) + 1.0) * last).clamp(0.0, last);
    let low = (x as usize).min(DIVERGING.len() - 2);
    let t = x - low as f64;
    std::array::from_fn(|c| {
        let (a, b) = (f64::from(DIVERGING[low][c]), f64::from(DIVERGING[low + 1][c]));
        (a + t * (b - a)).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_at_the_ends_and_in_the_middle() {
        assert_eq!(diverging(-3.0, 3.0), [33, 102, 172]);
        assert_eq!(diverging(0.0, 3.0), [255, 255, 255]);
        assert_eq!(diverging(3.0, 3.0), [178, 24, 43]);
        assert_eq!(diverging(-0.75, 3.0), [209, 229, 240]);
        assert_eq!(diverging(40.0, 3.0), diverging(3.0, 3.0));
        assert_eq!(diverging(f64::NAN, 3.0), NO_VALUE);
        assert_eq!(diverging(0.0, 0.0), [255, 255, 255]);
        assert_eq!(diverging(f64::NEG_INFINITY, 3.0), [33, 102, 172]);
    }
}
