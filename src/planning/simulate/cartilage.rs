//! Cartilage of the nose, placed by landmarks.
//!
//! A CT hardly tells cartilage from the tissue around it, so its place is taken from the landmarks of the nose. The septum is a
//! plate in the plane of these landmarks; the alar cartilages are a shell below the skin of tip and alae.

use super::Anatomy;
use super::tuning::{
    ABOVE_SPINE_MM, ALAR_BACK, ALAR_DEPTH_MM, ALAR_HALF_WIDTH, ALAR_UP, APERTURE_MM, BEHIND_APERTURE_MM, BEHIND_TIP_MM,
    MIDPLANE_COSINE, NOSE_PROJECTION_MM, SEPTUM_EDGE_SHARE, SEPTUM_MM,
};
use crate::plan::Proposal;
use prosopon_geometry::{Implicit, Point, Vector, Warning};
use prosopon_tissue::mesh::{MeshSettings, MixedMesh, Tissue};

/// What was placed in a mesh.
#[derive(Debug)]
pub(super) struct Placed {
    /// Number of tetrahedra of cartilage.
    pub(super) tetrahedra: usize,
    /// Why there is none, when the nose was not found.
    pub(super) warning: Option<Warning>,
}

/// Makes the tetrahedra whose centroid lies in nasal cartilage [`Tissue::Cartilage`].
///
/// Landmarks of the anatomy go before proposed ones. Prisms keep their tissue. `skin` is the field of the skin, mm.
pub(super) fn place_cartilage(
    mesh: &mut MixedMesh,
    anatomy: &Anatomy,
    proposal: &Proposal,
    skin: &dyn Implicit,
    settings: &MeshSettings,
) -> Placed {
    let found = NoseLandmarks::of(anatomy, proposal).and_then(|marks| Atlas::new(&marks, settings));
    match found {
        Ok(atlas) => Placed { tetrahedra: atlas.mark(mesh, skin), warning: None },
        Err(why) => {
            let message = format!("the nose has no cartilage: {why}");
            let action =
                "Set the landmarks `pronasale`, `subnasale`, `ans` and `nasal_bone_tip`, or leave `cartilage` out.";
            Placed { tetrahedra: 0, warning: Some(Warning::check("cartilage-not-placed", message).act(action)) }
        }
    }
}

/// Landmarks of the nose in its midplane, LPS mm.
#[derive(Debug, Clone, Copy)]
struct NoseLandmarks {
    pronasale: Point,
    subnasale: Point,
    ans: Point,
    nasal_bone_tip: Point,
}

impl NoseLandmarks {
    fn of(anatomy: &Anatomy, proposal: &Proposal) -> Result<Self, String> {
        let at = |name: &str| {
            let given = anatomy.landmarks.iter().find(|(n, _)| n == name).map(|(_, p)| *p);
            given.or_else(|| proposal.points.get(name).copied()).ok_or_else(|| format!("`{name}` was not found"))
        };
        Ok(Self {
            pronasale: at("pronasale")?,
            subnasale: at("subnasale")?,
            ans: at("ans")?,
            nasal_bone_tip: at("nasal_bone_tip")?,
        })
    }
}

/// Where cartilage lies in one nose.
#[derive(Debug, Clone)]
struct Atlas {
    /// The anterior nasal spine, in the midplane.
    origin: Point,
    /// Unit vectors to the left, forward and up; up leads from the spine to the tip of the nasal bones.
    axes: [Vector; 3],
    /// Corners of the septum forward and up from the origin, convex and counter-clockwise, mm.
    septum: [[f64; 2]; 5],
    /// Half of the septum's thickness, mm.
    half_thickness: f64,
    /// Half of the alae's width, mm.
    alar_half_width: f64,
    /// Least distance of the alae forward from the origin, mm.
    alar_back: f64,
    /// Lowest and highest distance of the alae up from the origin, mm.
    alar_heights: [f64; 2],
    /// Greatest depth of alar cartilage below the skin, mm.
    alar_depth: f64,
}

impl Atlas {
    /// The atlas of a nose; an error says which landmarks cannot be right.
    fn new(marks: &NoseLandmarks, settings: &MeshSettings) -> Result<Self, String> {
        let aperture = marks.nasal_bone_tip - marks.ans;
        let height = aperture.norm();
        if !(height >= APERTURE_MM && height.is_finite()) {
            return Err(format!("`nasal_bone_tip` is {height:.0} mm from `ans`, expected is {APERTURE_MM} mm or more"));
        }
        if aperture.z < 0.5 * height {
            return Err("`nasal_bone_tip` must lie above `ans`".to_owned());
        }
        let up = aperture / height;
        let left = up.cross(&(marks.pronasale - marks.ans)).try_normalize(1e-6);
        let left = left.filter(|n| n.x.abs() >= MIDPLANE_COSINE).map(|n| n * n.x.signum());
        let left = left.ok_or_else(|| "`ans`, `nasal_bone_tip` and `pronasale` span no midplane".to_owned())?;
        // The face looks along -y.
        let forward = left.cross(&up) * -left.cross(&up).y.signum();
        let flat = |p: Point| [forward.dot(&(p - marks.ans)), up.dot(&(p - marks.ans))];
        let (tip, sub) = (flat(marks.pronasale), flat(marks.subnasale));
        let projection = (marks.pronasale - marks.subnasale).norm();
        let [least, most] = NOSE_PROJECTION_MM;
        if !(least..=most).contains(&projection) || tip[0] <= BEHIND_TIP_MM || sub[1] >= tip[1] {
            return Err(format!(
                "`pronasale` lies {:.0} mm in front of `ans` and {projection:.0} mm from `subnasale`, expected are more than \
                 {BEHIND_TIP_MM} mm and {least} to {most} mm",
                tip[0]
            ));
        }
        // From the front of the septum the tip lies straight away from the middle of the aperture.
        let (dx, dy) = (tip[0], tip[1] - 0.5 * height);
        let shrink = 1.0 - BEHIND_TIP_MM / dx.hypot(dy);
        let front = [shrink * dx, 0.5 * height + shrink * dy];
        let septum = [
            [-BEHIND_APERTURE_MM, ABOVE_SPINE_MM],
            [0.0, ABOVE_SPINE_MM],
            front,
            [0.0, height],
            [-BEHIND_APERTURE_MM, height],
        ];
        Ok(Self {
            origin: marks.ans,
            axes: [left, forward, up],
            septum,
            half_thickness: 0.5 * SEPTUM_MM + SEPTUM_EDGE_SHARE * settings.edge_mm,
            alar_half_width: ALAR_HALF_WIDTH * projection,
            alar_back: sub[0] - ALAR_BACK * projection,
            alar_heights: [sub[1], tip[1] + ALAR_UP * projection],
            // A tetrahedron's centroid lies a good quarter of its height below the layer of prisms.
            alar_depth: settings.skin_thickness_mm + ALAR_DEPTH_MM.max(SEPTUM_EDGE_SHARE * 2.0 * settings.edge_mm),
        })
    }

    /// Whether cartilage is at `p`, LPS mm.
    fn contains(&self, p: &Point, skin: &dyn Implicit) -> bool {
        let [side, front, height] = self.axes.map(|axis| axis.dot(&(p - self.origin)));
        let in_septum = side.abs() <= self.half_thickness && self.is_in_profile([front, height]);
        let near_alae = side.abs() <= self.alar_half_width
            && front >= self.alar_back
            && (self.alar_heights[0]..=self.alar_heights[1]).contains(&height);
        in_septum || (near_alae && skin.value(p) >= -self.alar_depth)
    }

    /// Whether a point of the midplane, forward and up from the origin, lies in the septum.
    fn is_in_profile(&self, [x, y]: [f64; 2]) -> bool {
        let next = self.septum.iter().cycle().skip(1);
        self.septum.iter().zip(next).all(|(a, b)| (b[0] - a[0]) * (y - a[1]) >= (b[1] - a[1]) * (x - a[0]))
    }

    /// Gives tetrahedra their tissue; returns the number of those of cartilage.
    fn mark(&self, mesh: &mut MixedMesh, skin: &dyn Implicit) -> usize {
        let positions = &mesh.positions;
        let mut count = 0;
        for (corners, tissue) in mesh.tetrahedra.iter().zip(&mut mesh.tetrahedron_tissue) {
            let centroid = corners.iter().map(|n| positions[*n as usize].coords * 0.25).sum::<Vector>();
            if self.contains(&Point::from(centroid), skin) {
                *tissue = Tissue::Cartilage;
                count += 1;
            }
        }
        count
    }
}

#[cfg(test)]
mod tests;
