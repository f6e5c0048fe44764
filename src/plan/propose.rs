//! Landmarks proposed from the midsagittal profiles of skin and bone.

use std::collections::BTreeMap;

use crate::geometry::{Point, TriMesh};

/// Half width of the strip whose foremost points make a profile, mm.
const STRIP_MM: f64 = 3.0;
/// Step of a profile along z, mm.
const STEP_MM: f64 = 1.0;

/// Proposals to be checked by a person.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Proposal {
    /// Points by name, in the midsagittal plane, LPS mm.
    pub points: BTreeMap<String, Point>,
    /// x of the midsagittal plane.
    pub midline_x_mm: f64,
}

/// Extremal points of the midsagittal profiles of a head that faces -y with z up.
///
/// The midline is where the front of the skin is most alike on both sides. Skin: `pronasale`, the foremost point of all;
/// `subnasale`, the deepest place between it and the upper lip; `soft_pogonion`, the foremost point of the chin, below the fold under
/// the lower lip; `soft_menton`, the lowest. Bone: `menton`, the lowest point of the chin; `pogonion`, its foremost; `ans`, the foremost
/// below the nose; `a_point`, the deepest between it and the teeth; `nasal_bone_tip`, the lowest of the nasal bones, and
/// `nasion`, the deepest above it. What cannot be found is left out.
///
/// # Accuracy
/// On a CT with slices of 2.5 mm some 3 mm; streaks of dental metal, masks and beards spoil it.
#[must_use]
pub fn propose(skin: &TriMesh, skull: &TriMesh) -> Proposal {
    let midline = midline(skin);
    let (soft, hard) = (Profile::new(skin, midline), Profile::new(skull, midline));
    let mut found = Proposal { points: BTreeMap::new(), midline_x_mm: midline };
    let Some(nose) = soft.foremost(f64::NEG_INFINITY, f64::INFINITY) else { return found };
    let mut put = |name: &str, p: Option<[f64; 2]>| -> Option<[f64; 2]> {
        let [y, z] = p?;
        found.points.insert(name.to_owned(), Point::new(midline, y, z));
        p
    };
    put("pronasale", Some(nose));
    let z = nose[1];
    // The lip's foremost point is looked for below the nose's underside.
    let lip = soft.foremost(z - 38.0, z - 16.0);
    put("subnasale", lip.and_then(|lip| soft.deepest(lip, nose)));
    // The fold between lower lip and chin is the hindmost point there.
    let fold = soft.hindmost(z - 68.0, z - 42.0);
    let chin = fold.and_then(|fold| soft.foremost(fold[1] - 32.0, fold[1]));
    put("soft_pogonion", chin);
    put("soft_menton", chin.and_then(|c| soft.lowest_within(c, 18.0)));
    let ans = put("ans", hard.foremost(z - 22.0, z + 1.0));
    if let Some(chin) = chin {
        let pogonion = put("pogonion", hard.foremost(chin[1] - 14.0, chin[1] + 6.0));
        put("menton", pogonion.and_then(|p| hard.lowest_within(p, 16.0)));
    }
    if let Some(ans) = ans {
        let alveolar = hard.foremost(ans[1] - 24.0, ans[1] - 10.0);
        put("a_point", alveolar.and_then(|a| hard.deepest(a, ans)));
    }
    // The edge of the nasal bones: going down, the profile falls back into the nose.
    let tip = hard.last_before_drop(z + 55.0, z + 8.0, 8.0);
    put("nasal_bone_tip", tip);
    put("nasion", tip.and_then(|t| hard.hindmost(t[1] + 6.0, t[1] + 32.0)));
    found
}

/// x about which the skin's front is most alike left and right.
fn midline(skin: &TriMesh) -> f64 {
    const CELL_MM: f64 = 2.0;
    let bounds = skin.bounds();
    let size = [0, 2].map(|a| ((bounds.max[a] - bounds.min[a]) / CELL_MM).ceil() as usize + 1);
    let mut front = vec![f64::INFINITY; size[0] * size[1]];
    for p in samples(skin, CELL_MM) {
        let i = ((p.x - bounds.min.x) / CELL_MM) as usize;
        let k = ((p.z - bounds.min.z) / CELL_MM) as usize;
        if let Some(cell) = front.get_mut(i + size[0] * k) {
            *cell = cell.min(p.y);
        }
    }
    let middle = bounds.center();
    let unlike = |x: f64| {
        let (mut sum, mut count) = (0.0, 0usize);
        for k in 0..size[1] {
            for d in 1..25 {
                let at = |side: f64| {
                    let i = (x + side * f64::from(d) * CELL_MM - bounds.min.x) / CELL_MM;
                    (i >= 0.0).then(|| front[..].get(i as usize + size[0] * k)).flatten().copied()
                };
                let (Some(l), Some(r)) = (at(1.0), at(-1.0)) else { continue };
                // The face only: the front half.
                if l.is_finite() && r.is_finite() && l.max(r) < middle.y {
                    sum += (l - r).abs().min(10.0);
                    count += 1;
                }
            }
        }
        if count == 0 { f64::INFINITY } else { sum / count as f64 }
    };
    let tried = (-60..=60).map(|i| middle.x + 0.5 * f64::from(i));
    tried.map(|x| (unlike(x), x)).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(middle.x, |b| b.1)
}

/// Points of the surface no farther than about `spacing` apart.
fn samples(mesh: &TriMesh, spacing: f64) -> impl Iterator<Item = Point> {
    (0..mesh.triangles().len()).flat_map(move |t| {
        let [a, b, c] = mesh.corners(t);
        let longest = (b - a).norm().max((c - a).norm()).max((c - b).norm());
        let n = ((longest / spacing).ceil() as usize).clamp(1, 64);
        (0..=n).flat_map(move |i| {
            (0..=n - i).map(move |j| {
                let (u, v) = (i as f64 / n as f64, j as f64 / n as f64);
                a + (b - a) * u + (c - a) * v
            })
        })
    })
}

/// Foremost y of a surface for each step of z in a strip about the midline.
struct Profile {
    low: f64,
    front: Vec<f64>,
    /// All points of the strip, as (y, z).
    strip: Vec<[f64; 2]>,
}

impl Profile {
    fn new(mesh: &TriMesh, midline: f64) -> Self {
        let bounds = mesh.bounds();
        let n = ((bounds.max.z - bounds.min.z) / STEP_MM) as usize + 1;
        let mut profile = Self { low: bounds.min.z, front: vec![f64::INFINITY; n], strip: Vec::new() };
        for p in samples(mesh, 1.0).filter(|p| (p.x - midline).abs() < STRIP_MM) {
            if let Some(y) = profile.front.get_mut(((p.z - bounds.min.z) / STEP_MM) as usize) {
                *y = y.min(p.y);
            }
            profile.strip.push([p.y, p.z]);
        }
        profile
    }

    /// (y, z) of the profile within heights, from below.
    fn within(&self, low: f64, high: f64) -> impl DoubleEndedIterator<Item = [f64; 2]> {
        let all = self.front.iter().enumerate().map(|(k, y)| [*y, self.low + (k as f64 + 0.5) * STEP_MM]);
        all.filter(move |p| p[0].is_finite() && low <= p[1] && p[1] <= high)
    }

    fn foremost(&self, low: f64, high: f64) -> Option<[f64; 2]> {
        self.within(low, high).min_by(|a, b| a[0].total_cmp(&b[0]))
    }

    fn hindmost(&self, low: f64, high: f64) -> Option<[f64; 2]> {
        self.within(low, high).max_by(|a, b| a[0].total_cmp(&b[0]))
    }

    /// Farthest behind the line from `a` up to `b`.
    fn deepest(&self, a: [f64; 2], b: [f64; 2]) -> Option<[f64; 2]> {
        let behind = |p: &[f64; 2]| {
            let share = (p[1] - a[1]) / (b[1] - a[1]);
            let along = [b[0] - a[0], b[1] - a[1]];
            let length = along[0].hypot(along[1]);
            (p[0] - (a[0] + share * along[0])) * along[1].abs() / length
        };
        self.within(a[1], b[1]).max_by(|p, q| behind(p).total_cmp(&behind(q)))
    }

    /// Lowest point of the strip no farther behind `from` than `depth`.
    fn lowest_within(&self, from: [f64; 2], depth: f64) -> Option<[f64; 2]> {
        let near = |p: &&[f64; 2]| (from[0]..from[0] + depth).contains(&p[0]) && (p[1] - from[1]).abs() < 25.0;
        self.strip.iter().filter(near).min_by(|a, b| a[1].total_cmp(&b[1])).copied()
    }

    /// Going down from `high` to `low`, the last point before the profile falls back by `drop` within three steps.
    fn last_before_drop(&self, high: f64, low: f64, drop: f64) -> Option<[f64; 2]> {
        let down: Vec<[f64; 2]> = self.within(low - 4.0, high).rev().collect();
        let falls = |w: &&[[f64; 2]]| w[0][1] - w[1][1] > 3.5 || w[1..].iter().any(|p| p[0] - w[0][0] > drop);
        down.windows(4).find(falls).map(|w| w[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::{head, surface_of};

    #[test]
    fn proposals_on_the_phantom_lie_at_its_landmarks() {
        let head = head();
        let sampled = |solid| surface_of(solid, &head.bounds(), 1.5).unwrap();
        let found = propose(&sampled(head.skin.as_ref()), &sampled(head.skull.as_ref()));
        assert!(found.midline_x_mm.abs() < 1.5, "{}", found.midline_x_mm);
        for name in ["pronasale", "ans", "pogonion", "menton", "soft_pogonion", "nasal_bone_tip"] {
            let (p, q) = (found.points.get(name), head.landmarks.point(name).unwrap());
            // Steps of 1 mm, a grid of 1.5 mm, and flat extrema.
            let off = p.map_or(f64::INFINITY, |p| (p.y - q.y).hypot(p.z - q.z));
            assert!(off < 3.0, "{name}: {p:?} and {q}, {off:.1} mm apart");
        }
    }
}
