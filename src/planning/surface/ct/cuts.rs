//! Finds where the field of view cuts the head.

use super::metal::nearest_sample;
use super::tuning::{
    ALL_CUT_SHARE, CHIN_BEHIND_NOSE_MM, CHIN_DEPTH_MM, MIN_CHIN_MM2, MIN_CUT_MM2, MIN_CUT_SHARE, WHOLE_TISSUE_HU,
};
use prosopon_geometry::{Point, ScalarGrid, Vector, Volume, Warning};

/// Names of the sides of a head in the order +x, -x, +y, -y, +z, -z (LPS).
const SIDES: [&str; 6] = ["on the left", "on the right", "behind", "in front", "above", "below"];
const FRONT: usize = 3;
const BELOW: usize = 5;

/// What the cuts are found from.
pub(super) struct View<'a> {
    /// The volume in HU.
    pub(super) volume: &'a Volume,
    /// The volume as given, and the value that fills its corners.
    pub(super) given: &'a Volume,
    pub(super) filling: Option<i16>,
    pub(super) skin_hu: f64,
    pub(super) bone_hu: f64,
    /// Field of the skin, negative inside.
    pub(super) skin: &'a ScalarGrid,
}

/// Areas of one side, mm².
#[derive(Debug, Clone, Copy, Default)]
struct Area {
    /// Tissue on the border of the volume.
    at_border: f64,
    /// Whole tissue beside voxels that fill the corners: the border of a scanned circle.
    at_filling: f64,
    /// All other surface of the head.
    free: f64,
}

impl Area {
    fn cut(&self) -> f64 {
        let at_circle = self.at_filling >= MIN_CUT_SHARE * (self.free + self.at_filling);
        self.at_border + if at_circle { self.at_filling } else { 0.0 }
    }

    fn all(&self) -> f64 {
        self.at_border + self.at_filling + self.free
    }
}

/// Where the field of view cuts the head.
pub(super) struct Cuts {
    areas: [Area; 6],
    /// Bone in front on the lowest face, when this face lies near the height of the chin, mm².
    chin_mm2: f64,
}

impl Cuts {
    pub(super) fn of(view: &View<'_>) -> Self {
        let volume = view.volume;
        let strides = [1, volume.dims[0], volume.dims[0] * volume.dims[1]];
        let [x, y, z] = volume.axes;
        let faces = [y.cross(&z).norm(), z.cross(&x).norm(), x.cross(&y).norm()];
        let mut found = Self { areas: [Area::default(); 6], chin_mm2: 0.0 };
        let mut front = f64::MAX;
        let mut below: Vec<(Point, bool)> = Vec::new();
        for (at, value) in volume.hu.iter().enumerate().filter(|(_, v)| f64::from(**v) > view.skin_hu) {
            let place = [0, 1, 2].map(|a| at / strides[a] % volume.dims[a]);
            for axis in 0..3 {
                for (at_end, outward, beside) in [
                    (place[axis] == 0, -volume.axes[axis], at.wrapping_sub(strides[axis])),
                    (place[axis] + 1 == volume.dims[axis], volume.axes[axis], at + strides[axis]),
                ] {
                    let is_tissue = !at_end && f64::from(volume.hu[beside]) > view.skin_hu;
                    let p = position(volume, place);
                    if is_tissue || !view.is_inside(&p) {
                        continue;
                    }
                    let side = side_of(&outward);
                    let area = &mut found.areas[side];
                    if at_end {
                        area.at_border += faces[axis];
                        if side == BELOW {
                            below.push((p, f64::from(*value) > view.bone_hu));
                        }
                    } else if !view.is_inside(&(p + outward)) {
                        let is_filling = view.filling == Some(view.given.hu[beside]);
                        let is_whole = f64::from(*value) > WHOLE_TISSUE_HU;
                        *(if is_filling && is_whole { &mut area.at_filling } else { &mut area.free }) += faces[axis];
                    } else {
                        continue;
                    }
                    front = front.min(p.y);
                }
            }
        }
        found.chin_mm2 = chin(&below, front) * faces[lowest_axis(volume)];
        found
    }

    /// Whether the surface of the head is mostly the border of the field of view, so that the skin is not in it.
    pub(super) fn are_everywhere(&self) -> bool {
        let around = &self.areas[..4];
        let cut: f64 = around.iter().map(Area::cut).sum();
        let all: f64 = around.iter().map(Area::all).sum();
        cut > ALL_CUT_SHARE * all
    }

    /// The sides that are cut, and a chin that is.
    pub(super) fn warnings(&self) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let cut: Vec<usize> = (0..SIDES.len()).filter(|side| self.areas[*side].cut() >= MIN_CUT_MM2).collect();
        let names: Vec<String> =
            cut.iter().map(|s| format!("{} ({:.0} cm²)", SIDES[*s], self.areas[*s].cut() / 100.0)).collect();
        let message =
            format!("the field of view cuts the head {}; skin and bone are closed there by a cap", names.join(", "));
        if cut.contains(&FRONT) {
            warnings.push(
                Warning::unreliable("head-cut", message)
                    .act("Use a volume that shows the whole face with air in front of it."),
            );
        } else if cut.iter().any(|side| *side != BELOW) {
            warnings.push(
                Warning::check("head-cut", message)
                    .act("Check that the parts of the face that move lie well inside the volume."),
            );
        } else if !cut.is_empty() {
            warnings.push(Warning::info("head-cut", message));
        }
        if self.chin_mm2 >= MIN_CHIN_MM2 {
            let cm2 = self.chin_mm2 / 100.0;
            let message = format!(
                "the lower border of the volume cuts {cm2:.1} cm² of bone in front: the chin is probably cut off"
            );
            warnings.push(
                Warning::check("chin-cut", message)
                    .act("Check that the volume reaches below the chin before it is moved."),
            );
        }
        warnings
    }
}

impl View<'_> {
    fn is_inside(&self, p: &Point) -> bool {
        nearest_sample(self.skin, p).is_some_and(|[i, j, k]| self.skin.values[self.skin.index(i, j, k)] < 0.0)
    }
}

/// Number of bone voxels on the lowest face that lie in front, when this face reaches about as far forward as the chin.
fn chin(below: &[(Point, bool)], front_mm: f64) -> f64 {
    let front_below = below.iter().map(|(p, _)| p.y).fold(f64::MAX, f64::min);
    if front_below - front_mm > CHIN_BEHIND_NOSE_MM {
        return 0.0;
    }
    below.iter().filter(|(p, is_bone)| *is_bone && p.y < front_below + CHIN_DEPTH_MM).count() as f64
}

fn position(volume: &Volume, place: [usize; 3]) -> Point {
    let [i, j, k] = place.map(|c| c as f64);
    volume.origin + volume.axes[0] * i + volume.axes[1] * j + volume.axes[2] * k
}

/// Index in [`SIDES`] of an outward direction.
fn side_of(outward: &Vector) -> usize {
    let axis = outward.iamax();
    2 * axis + usize::from(outward[axis] < 0.0)
}

/// The volume's axis that runs most along S.
fn lowest_axis(volume: &Volume) -> usize {
    (0..3)
        .max_by(|a, b| volume.axes[*a].normalize().z.abs().total_cmp(&volume.axes[*b].normalize().z.abs()))
        .unwrap_or(2)
}

/// Why no air lies around the body, with the share of tissue on the faces of the volume.
pub(super) fn why_no_air(volume: &Volume, skin_hu: f64) -> String {
    let [nx, ny, nz] = volume.dims;
    let at_face = |at: usize| {
        let place = [at % nx, at / nx % ny, at / nx / ny];
        (0..3).any(|a| place[a] == 0 || place[a] + 1 == volume.dims[a])
    };
    let faces = (0..nx * ny * nz).filter(|at| at_face(*at));
    let (mut all, mut tissue) = (0usize, 0usize);
    for at in faces {
        all += 1;
        tissue += usize::from(f64::from(volume.hu[at]) > skin_hu);
    }
    let share = 100.0 * tissue as f64 / all.max(1) as f64;
    format!(
        "there is no air around the body: {share:.0} % of the voxels on the faces of the volume are denser, so that the field of view \
         lies inside the head. Use a volume that shows the whole face with air in front of it"
    )
}
