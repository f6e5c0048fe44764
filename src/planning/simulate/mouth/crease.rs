use super::Reason;
use super::front::Front;
use super::place::Place;
use super::tuning::{
    DEEP_MM, END_SHARE, END_WINDOW_MM, FROM_STOMION_MM, HALF_WIDTH_MM, LIP_MM, MAX_BREAK_MM, MAX_UNEVEN, MIN_CREASE_MM,
    NOTCH_MM, NOTCH_WEIGHT, PIXEL_MM, SHARP_MM, SMOOTH_HALF_MM, STEP_COST, USUAL_HALF_WIDTH_MM, VIEW_HALF_MM,
};
use prosopon_geometry::{Point, TriMesh};

/// The crease between the lips.
pub(super) struct Crease {
    /// From the right commissure to the left one, on the skin.
    pub(super) curve: Vec<Point>,
    /// Mean depth in its middle half, mm.
    pub(super) depth_mm: f64,
    /// Whether a corner could not be told from folds beside the mouth and lies where it usually does.
    pub(super) usual_corner: bool,
}

/// Follows the crease through `place`: the path across the face, rising or falling by at most 45°, with the deepest and
/// sharpest crease in total.
pub(super) fn trace(skin: &TriMesh, place: &Place) -> Result<Crease, Reason> {
    let corner = |x: f64, z: f64| Point::new(place.midline + x, 0.0, z);
    // Away from the midline the crease may leave the range of heights there.
    let slack = 0.5 * LIP_MM;
    let view = [
        corner(-VIEW_HALF_MM, place.heights[0] - slack - LIP_MM),
        corner(VIEW_HALF_MM, place.heights[1] + slack + LIP_MM),
    ];
    let front = Front::of(skin, &view, 0.0).ok_or("the view is empty")?;
    let scores = Scores::of(&front);
    let path = best_path(&front, &scores, place);
    let middle = column(&front, place.midline);
    let ([first, last], usual_corner) = ends(&front, &scores, &path, place, middle)?;
    let quarter = (last - first) / 4;
    let inner = first + quarter..last - quarter;
    let depth_mm = inner.clone().map(|i| scores.depth(i, path[i])).sum::<f64>() / inner.len().max(1) as f64;
    if depth_mm < MIN_CREASE_MM {
        return Err(format!(
            "the skin's crease between the lips is {depth_mm:.2} mm deep, at least {MIN_CREASE_MM} mm are needed"
        ));
    }
    let half = (SMOOTH_HALF_MM / PIXEL_MM) as usize;
    let curve: Vec<Point> = (first..=last)
        .filter_map(|i| {
            let around = i.saturating_sub(half).max(first)..=(i + half).min(last);
            let n = around.clone().count() as f64;
            let mean = |of: &dyn Fn(usize) -> f64| around.clone().map(of).sum::<f64>() / n;
            let (x, z) = (mean(&|j| front.place(j, 0)[0]), mean(&|j| front.place(j, path[j])[1]));
            Some(Point::new(x, front.at(x, z)?, z))
        })
        .collect();
    Ok(Crease { curve: ends_added(&front, curve, [first, last], &path), depth_mm, usual_corner })
}

/// The curve with its ends where the crease ends: averages of places there lie farther in.
fn ends_added(front: &Front, mut curve: Vec<Point>, ends: [usize; 2], path: &[usize]) -> Vec<Point> {
    let at = |i: usize| {
        let [x, z] = front.place(i, path[i]);
        front.at(x, z).map(|y| Point::new(x, y, z))
    };
    let [right, left] = ends.map(at);
    curve.retain(|p| right.is_none_or(|r| p.x > r.x + PIXEL_MM) && left.is_none_or(|l| p.x < l.x - PIXEL_MM));
    // One place every 4 mm is enough for a curve that is averaged over twice that length.
    let inner: Vec<Point> = curve.iter().copied().skip(7).step_by(8).collect();
    right.into_iter().chain(inner).chain(left).collect()
}

fn column(front: &Front, x: f64) -> usize {
    (((x - front.place(0, 0)[0]) / PIXEL_MM).round().max(0.0) as usize).min(front.size()[0] - 1)
}

/// Depth and sharpness of the crease at each pixel.
struct Scores {
    columns: usize,
    /// Depth below the lower of the two lips beside it, mm.
    depth: Vec<f64>,
    /// Distance of the skin behind the mean of that a little above and below, mm.
    notch: Vec<f64>,
}

impl Scores {
    fn of(front: &Front) -> Self {
        let [columns, rows] = front.size();
        let (mut depth, mut notch) = (vec![0.0; columns * rows], vec![0.0; columns * rows]);
        let (lip, near) = ((LIP_MM / PIXEL_MM) as usize, (NOTCH_MM / PIXEL_MM) as usize);
        for i in 0..columns {
            for k in lip..rows.saturating_sub(lip) {
                let y = |k: usize| front.pixel(i, k);
                let foremost = |range: std::ops::Range<usize>| range.map(y).fold(f64::INFINITY, f64::min);
                let (below, above) = (foremost(k - lip..k), foremost(k + 1..k + lip + 1));
                let at = i + columns * k;
                let is_known = (k - lip..k + lip + 1).all(|k| y(k).is_finite());
                if is_known {
                    depth[at] = (y(k) - below).min(y(k) - above);
                    notch[at] = y(k) - 0.5 * (y(k - near) + y(k + near));
                }
            }
        }
        Self { columns, depth, notch }
    }

    fn depth(&self, i: usize, k: usize) -> f64 {
        self.depth[i + self.columns * k]
    }

    /// What a path earns at a pixel, mm.
    fn total(&self, i: usize, k: usize) -> f64 {
        self.depth(i, k).clamp(0.0, DEEP_MM) + NOTCH_WEIGHT * self.notch[i + self.columns * k].clamp(0.0, SHARP_MM)
    }
}

/// Row of the best path in each column (Viterbi's algorithm).
fn best_path(front: &Front, scores: &Scores, place: &Place) -> Vec<usize> {
    let [columns, rows] = front.size();
    let middle = column(front, place.midline);
    let earned = |i: usize, k: usize| {
        let z = front.place(i, k)[1];
        let is_outside = i == middle && !(place.heights[0]..=place.heights[1]).contains(&z);
        let off_commissure =
            place.commissures.iter().flatten().any(|c| column(front, c.x) == i && (z - c.z).abs() > FROM_STOMION_MM);
        if is_outside || off_commissure { f64::NEG_INFINITY } else { scores.total(i, k) }
    };
    let mut best: Vec<f64> = (0..rows).map(|k| earned(0, k)).collect();
    let mut from: Vec<Vec<usize>> = Vec::with_capacity(columns);
    for i in 1..columns {
        let (mut next, mut came) = (vec![f64::NEG_INFINITY; rows], vec![0; rows]);
        for k in 0..rows {
            for before in k.saturating_sub(1)..(k + 2).min(rows) {
                let value = best[before] - if before == k { 0.0 } else { STEP_COST };
                if value > next[k] {
                    (next[k], came[k]) = (value, before);
                }
            }
            next[k] += earned(i, k);
        }
        best = next;
        from.push(came);
    }
    let mut row = (0..rows).fold(0, |at, k| if best[k] > best[at] { k } else { at });
    let mut path = vec![row; columns];
    for i in (1..columns).rev() {
        row = from[i - 1][row];
        path[i - 1] = row;
    }
    path
}

/// First and last column of the crease, and whether an end was placed at the usual distance.
fn ends(
    front: &Front,
    scores: &Scores,
    path: &[usize],
    place: &Place,
    middle: usize,
) -> Result<([usize; 2], bool), Reason> {
    let half = (HALF_WIDTH_MM[0] / PIXEL_MM) as usize;
    let window = (END_WINDOW_MM / PIXEL_MM) as usize;
    let mean = |range: std::ops::Range<usize>| {
        let n = range.len().max(1) as f64;
        range.map(|i| scores.total(i, path[i])).sum::<f64>() / n
    };
    let last = path.len() - 1;
    let threshold = END_SHARE * mean(middle.saturating_sub(half / 2)..(middle + half / 2).min(last));
    let gap = (MAX_BREAK_MM / PIXEL_MM) as usize;
    // A streak of metal or a marker on the skin may hide the crease for a few millimetres.
    let reach = |left: bool| {
        let step = |n: usize| if left { (middle + n).min(last) } else { middle.saturating_sub(n) };
        let (mut end, mut n) = (0, 0);
        while n <= end + gap && (1..last).contains(&step(n)) {
            let (a, b) = (step(n), step(n + window));
            if mean(a.min(b)..a.max(b)) >= threshold {
                end = n;
            }
            n += 1;
        }
        step(end + 1)
    };
    let side =
        |left: bool, known: Option<Point>| -> usize { known.map_or_else(|| reach(left), |c| column(front, c.x)) };
    let mut ends = [side(false, place.commissures[0]), side(true, place.commissures[1])];
    let mut usual = false;
    for (index, end) in ends.iter_mut().enumerate() {
        let is_known = place.commissures[index].is_some();
        if !is_known && (front.place(*end, 0)[0] - place.midline).abs() > HALF_WIDTH_MM[1] {
            let at = if index == 0 { -USUAL_HALF_WIDTH_MM } else { USUAL_HALF_WIDTH_MM };
            *end = column(front, place.midline + at);
            usual = true;
        }
    }
    let widths = ends.map(|i| (front.place(i, 0)[0] - place.midline).abs());
    for (width, name) in widths.iter().zip(["right", "left"]) {
        if !(HALF_WIDTH_MM[0]..=HALF_WIDTH_MM[1]).contains(width) {
            return Err(format!("its {name} corner would lie {width:.0} mm from the midline"));
        }
    }
    if !(ends[0] < middle && middle < ends[1]) {
        let fault =
            "`cheilion_right` and `cheilion_left` lie on the wrong side of the midline: x grows to the patient's left";
        return Err(fault.to_owned());
    }
    let [narrow, wide] = [widths[0].min(widths[1]), widths[0].max(widths[1])];
    if wide > MAX_UNEVEN * narrow {
        return Err(format!("one half of the mouth would be {narrow:.0} mm wide and the other {wide:.0} mm"));
    }
    Ok((ends, usual))
}
