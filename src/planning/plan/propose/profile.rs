//! Foremost points of a surface along the midline.

use super::samples;
use super::tuning::{BLUNT_MM, PROFILE_STEP_MM, PROFILE_STRIP_MM};
use prosopon_geometry::TriMesh;

/// Foremost y of a surface for each step of z in a strip about the midline.
pub(super) struct Profile {
    low: f64,
    front: Vec<f64>,
    /// All points of the strip, as (y, z).
    strip: Vec<[f64; 2]>,
}

impl Profile {
    pub(super) fn new(mesh: &TriMesh, midline: f64) -> Self {
        let bounds = mesh.bounds();
        let n = ((bounds.max.z - bounds.min.z) / PROFILE_STEP_MM) as usize + 1;
        let mut profile = Self { low: bounds.min.z, front: vec![f64::INFINITY; n], strip: Vec::new() };
        for p in samples(mesh, 1.0).filter(|p| (p.x - midline).abs() < PROFILE_STRIP_MM) {
            if let Some(y) = profile.front.get_mut(((p.z - bounds.min.z) / PROFILE_STEP_MM) as usize) {
                *y = y.min(p.y);
            }
            profile.strip.push([p.y, p.z]);
        }
        profile
    }

    /// (y, z) of the profile within heights, from below.
    fn within(&self, low: f64, high: f64) -> impl DoubleEndedIterator<Item = [f64; 2]> {
        let all = self.front.iter().enumerate().map(|(k, y)| [*y, self.low + (k as f64 + 0.5) * PROFILE_STEP_MM]);
        all.filter(move |p| p[0].is_finite() && low <= p[1] && p[1] <= high)
    }

    pub(super) fn foremost(&self, low: f64, high: f64) -> Option<[f64; 2]> {
        self.within(low, high).min_by(|a, b| a[0].total_cmp(&b[0]))
    }

    /// The middle of the flat top around the foremost point, within heights.
    ///
    /// On a blunt profile the foremost point may lie anywhere on the flat top.
    pub(super) fn summit(&self, low: f64, high: f64) -> Option<[f64; 2]> {
        let [y, at] = self.foremost(low, high)?;
        let is_top = |p: &[f64; 2]| p[0] < y + BLUNT_MM;
        let up = self.within(at, high).take_while(is_top).last().map_or(at, |p| p[1]);
        let down = self.within(low, at).rev().take_while(is_top).last().map_or(at, |p| p[1]);
        Some([y, 0.5 * (up + down)])
    }

    /// The middle of the flat bottom around the lowest point of the strip between two depths, as (y, z).
    pub(super) fn bottom(&self, [front, back]: [f64; 2], above: f64) -> Option<[f64; 2]> {
        let inside = || self.strip.iter().filter(|p| (front..back).contains(&p[0]) && p[1] > above);
        let lowest = inside().map(|p| p[1]).min_by(f64::total_cmp)?;
        let flat: Vec<f64> = inside().filter(|p| p[1] < lowest + BLUNT_MM).map(|p| p[0]).collect();
        let ends = flat.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), y| (a.min(*y), b.max(*y)));
        Some([0.5 * (ends.0 + ends.1), lowest])
    }

    /// Going up, the hindmost point before the profile comes forward again.
    pub(super) fn first_hollow(&self, low: f64, high: f64) -> Option<[f64; 2]> {
        const FORWARD_MM: f64 = 1.0;
        let mut hollow: Option<[f64; 2]> = None;
        for p in self.within(low, high) {
            match hollow {
                Some(h) if p[0] < h[0] - FORWARD_MM => break,
                Some(h) if p[0] <= h[0] => {}
                _ => hollow = Some(p),
            }
        }
        hollow
    }

    /// The point farthest forwards and upwards together, within heights.
    pub(super) fn corner(&self, low: f64, high: f64) -> Option<[f64; 2]> {
        self.within(low, high).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))
    }

    /// The point farthest behind the line from `a` up to `b`.
    pub(super) fn deepest(&self, a: [f64; 2], b: [f64; 2]) -> Option<[f64; 2]> {
        let behind = |p: &[f64; 2]| {
            let share = (p[1] - a[1]) / (b[1] - a[1]);
            let along = [b[0] - a[0], b[1] - a[1]];
            let length = along[0].hypot(along[1]);
            (p[0] - (a[0] + share * along[0])) * along[1].abs() / length
        };
        self.within(a[1], b[1]).max_by(|p, q| behind(p).total_cmp(&behind(q)))
    }

    /// Lowest point of the strip no farther behind `from` than `depth`, and no more than `height` from it.
    pub(super) fn lowest_within(&self, from: [f64; 2], depth: f64, height: f64) -> Option<[f64; 2]> {
        let near = |p: &&[f64; 2]| (from[0]..from[0] + depth).contains(&p[0]) && (p[1] - from[1]).abs() < height;
        self.strip.iter().filter(near).min_by(|a, b| a[1].total_cmp(&b[1])).copied()
    }

    /// Going down from `high` to `low`, the last point before the profile falls back by `drop` within three steps.
    pub(super) fn last_before_drop(&self, high: f64, low: f64, drop: f64) -> Option<[f64; 2]> {
        let down: Vec<[f64; 2]> = self.within(low - 4.0, high).rev().collect();
        let falls = |w: &&[[f64; 2]]| w[0][1] - w[1][1] > 3.5 || w[1..].iter().any(|p| p[0] - w[0][0] > drop);
        down.windows(4).find(falls).map(|w| w[0])
    }
}
