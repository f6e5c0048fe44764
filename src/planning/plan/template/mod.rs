//! Ready-made sets of cuts, placed by landmarks.
//!
//! All templates use LPS mm with the head upright; left is +x, back +y, up +z.
//!
//! # Adding a template
//! 1. Write the function that places its cuts, in a module here.
//! 2. Add a variant to [`Template`], its list `ALL` and its methods: `name`, `needs` (landmarks) and `cuts`.
//! 3. Add its name and its landmarks to `TemplateName` in `src/service/contract/osteotomy.rs`; regenerate `api/openapi.json`.
//! 4. Where `propose` does not find a landmark, each request must give it.
//!
//! Names of cuts are read by `plan/names.rs` (names of segments) and `template/merge.rs` (steps of a Le Fort I). Choose a name
//! whose beginning is known there, or add it there.

mod le_fort_1;
mod mandible;
mod merge;
mod midface;
mod tuning;

use std::collections::BTreeMap;

use le_fort_1::LeFort1Axes;
pub use le_fort_1::le_fort_1;
pub use merge::{TemplateCall, TemplateCuts, TemplateError};

use super::PlanError;
use super::checked_cut::CheckedCut;
use super::pieces::crossings;
use super::shape::{BoundedPlane, Cut};
use prosopon_field::Envelope;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Vector};

/// Points and planes by which templates place their cuts, LPS mm.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Landmarks {
    /// Points by name.
    pub points: BTreeMap<String, Point>,
    /// x of the midsagittal plane.
    pub midline_x_mm: Option<f64>,
    /// z of the occlusal plane.
    pub occlusal_z_mm: Option<f64>,
    /// Point and normal of the Le Fort I plane.
    pub le_fort_1_plane: Option<(Point, Vector)>,
}

impl Landmarks {
    /// The landmarks in another frame, into which `motion` maps.
    ///
    /// The midline and the occlusal plane, which lie across an axis of their own frame, pass through `near` there (LPS mm) and lie across
    /// the same axis of the other frame.
    #[must_use]
    pub fn seen_from(&self, motion: &Motion, near: &Point) -> Self {
        Self {
            points: self.points.iter().map(|(name, p)| (name.clone(), motion * p)).collect(),
            midline_x_mm: self.midline_x_mm.map(|x| (motion * Point::new(x, near.y, near.z)).x),
            occlusal_z_mm: self.occlusal_z_mm.map(|z| (motion * Point::new(near.x, near.y, z)).z),
            le_fort_1_plane: self.le_fort_1_plane.map(|(p, normal)| (motion * p, motion * normal)),
        }
    }
}

/// Ready-made sets of cuts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Template {
    /// Upper jaw above the apices (Bell 1975): horizontal plane, plane behind the tuberosities, occlusal separation.
    LeFort1,
    /// Upper jaw with the nasal pyramid: nasofrontal, medial orbit and infraorbital rim, below the zygoma, pterygomaxillary.
    LeFort2,
    /// Midface with the zygomas (Tessier 1971): frontozygomatic and nasofrontal sutures, zygomatic arches, pterygomaxillary.
    LeFort3,
    /// Sagittal split of the left ramus (Trauner & Obwegeser 1957, Dal Pont 1961, Hunsuck 1968).
    BssoLeft,
    /// Sagittal split of the right ramus.
    BssoRight,
    /// Sliding osteotomy of the chin below the mental foramina (Trauner & Obwegeser 1957).
    Genioplasty,
    /// Le Fort I with a midsagittal split of the palate.
    TwoPieceMaxilla,
    /// No osteotomy: separates the whole mandible from the skull at both joints and the teeth, for autorotation.
    Mandible,
}

impl Template {
    /// Every template.
    pub const ALL: [Self; 8] = [
        Self::LeFort1,
        Self::LeFort2,
        Self::LeFort3,
        Self::BssoLeft,
        Self::BssoRight,
        Self::Genioplasty,
        Self::TwoPieceMaxilla,
        Self::Mandible,
    ];

    /// Name in the API, for example `le_fort_1`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::LeFort1 => "le_fort_1",
            Self::LeFort2 => "le_fort_2",
            Self::LeFort3 => "le_fort_3",
            Self::BssoLeft => "bsso_left",
            Self::BssoRight => "bsso_right",
            Self::Genioplasty => "genioplasty",
            Self::TwoPieceMaxilla => "two_piece_maxilla",
            Self::Mandible => "mandible",
        }
    }

    /// Landmarks that the template needs.
    ///
    /// Names of points, `midline_x_mm`, `occlusal_plane_z_mm` or `le_fort_1_plane`.
    #[must_use]
    pub fn needs(self) -> &'static [&'static str] {
        match self {
            Self::LeFort1 | Self::TwoPieceMaxilla => &["le_fort_1_plane", "midline_x_mm", "occlusal_plane_z_mm"],
            Self::LeFort2 => &[
                "nasion",
                "orbitale_left",
                "orbitale_right",
                "zygomaxillare_left",
                "zygomaxillare_right",
                "occlusal_plane_z_mm",
            ],
            Self::LeFort3 => &["nasion", "frontomalare_left", "frontomalare_right", "occlusal_plane_z_mm"],
            Self::BssoLeft => &["lingula_left", "molar_left", "midline_x_mm", "occlusal_plane_z_mm"],
            Self::BssoRight => &["lingula_right", "molar_right", "midline_x_mm", "occlusal_plane_z_mm"],
            Self::Genioplasty => &["pogonion", "menton"],
            Self::Mandible => &["condylion_left", "condylion_right", "menton", "occlusal_plane_z_mm"],
        }
    }

    /// Landmarks that improve the template's cuts where they are there.
    #[must_use]
    pub fn improved_by(self) -> &'static [&'static str] {
        match self {
            Self::LeFort1 | Self::TwoPieceMaxilla => &["zygomaxillare_left", "zygomaxillare_right"],
            Self::LeFort2 | Self::LeFort3 | Self::Genioplasty => &[],
            Self::BssoLeft => &["condylion_left"],
            Self::BssoRight => &["condylion_right"],
            Self::Mandible => &["lingula_left", "lingula_right"],
        }
    }

    /// Places the template's cuts on `bone`; separations that meet no bone are left out.
    ///
    /// # Errors
    /// [`PlanError::MissingLandmarks`]; [`PlanError::Value`] when the landmarks are not arranged as in a head.
    pub fn cuts(self, landmarks: &Landmarks, bone: &Envelope) -> Result<Vec<Cut>, PlanError> {
        let missing = landmarks.missing(self);
        if !missing.is_empty() {
            return Err(PlanError::MissingLandmarks { template: self.name(), missing });
        }
        landmarks.check()?;
        match self {
            Self::LeFort1 | Self::TwoPieceMaxilla => upper_jaw(self, landmarks, bone),
            Self::LeFort2 => midface::le_fort_2(landmarks, bone),
            Self::LeFort3 => midface::le_fort_3(landmarks, bone),
            Self::BssoLeft => mandible::sagittal_split(1.0, landmarks, bone),
            Self::BssoRight => mandible::sagittal_split(-1.0, landmarks, bone),
            Self::Genioplasty => mandible::genioplasty(landmarks, bone),
            Self::Mandible => mandible::whole(landmarks, bone),
        }
    }
}

impl Landmarks {
    /// Landmarks that `template` needs and that are missing here.
    #[must_use]
    pub fn missing(&self, template: Template) -> Vec<&'static str> {
        template.needs().iter().copied().filter(|n| !self.has(n)).collect()
    }

    fn has(&self, name: &str) -> bool {
        match name {
            "midline_x_mm" => self.midline_x_mm.is_some(),
            "occlusal_plane_z_mm" => self.occlusal_z_mm.is_some(),
            "le_fort_1_plane" => self.le_fort_1_plane.is_some(),
            point => self.points.contains_key(point),
        }
    }

    fn check(&self) -> Result<(), PlanError> {
        let values = [self.midline_x_mm, self.occlusal_z_mm].into_iter().flatten();
        let plane = self.le_fort_1_plane.iter().flat_map(|(p, n)| [p.coords, *n]);
        let mut all = self.points.values().map(|p| p.coords).chain(plane);
        if all.all(|v| v.iter().all(|c| c.is_finite())) && { values }.all(f64::is_finite) {
            return Ok(());
        }
        Err(misplaced("have a coordinate that is not finite"))
    }

    /// The point `name`, one of those that [`Template::needs`] lists.
    fn point(&self, name: &str) -> Result<Point, PlanError> {
        self.points.get(name).copied().ok_or_else(|| misplaced(&format!("lack {name}")))
    }

    /// The occlusal plane: parallel to the Le Fort I plane where that plane and the midline are given, else horizontal.
    fn occlusal(&self) -> Result<Occlusal, PlanError> {
        let z = self.occlusal_z_mm.ok_or_else(|| misplaced("lack occlusal_plane_z_mm"))?;
        let tilted = self.le_fort_1_plane.zip(self.midline_x_mm).and_then(|(plane, x)| LeFort1Axes::new(plane, x, z));
        let level = Occlusal { point: Point::new(0.0, 0.0, z), left: Vector::x(), up: Vector::z() };
        Ok(tilted.map_or(level, |axes| axes.occlusal_plane(z)))
    }

    /// Ending of a landmark's name for a side: +1 left, -1 right.
    pub(in crate::plan) fn side_name(side: f64) -> &'static str {
        if side > 0.0 { "left" } else { "right" }
    }
}

/// The occlusal plane, between the rows of teeth.
struct Occlusal {
    point: Point,
    /// Unit vector in the plane, to the patient's left.
    left: Vector,
    up: Vector,
}

impl Occlusal {
    /// z of the plane at x and y.
    fn z(&self, x: f64, y: f64) -> f64 {
        self.point.z - (self.up.x * (x - self.point.x) + self.up.y * (y - self.point.y)) / self.up.z
    }

    /// The part of the plane over a range of x and of y.
    fn part(&self, [x0, x1]: [f64; 2], [y0, y1]: [f64; 2]) -> BoundedPlane {
        let (x, y) = (0.5 * (x0 + x1), 0.5 * (y0 + y1));
        let half = [0.5 * (x1 - x0) / self.left.x, 0.5 * (y1 - y0) / self.up.cross(&self.left).y];
        BoundedPlane {
            point: Point::new(x, y, self.z(x, y)),
            normal: self.up,
            bounds: Some((self.left, half[0], half[1])),
        }
    }
}

fn misplaced(detail: &str) -> PlanError {
    PlanError::Value { what: "landmarks".into(), detail: detail.to_owned() }
}

fn upper_jaw(template: Template, landmarks: &Landmarks, bone: &Envelope) -> Result<Vec<Cut>, PlanError> {
    let (Some(plane), Some(midline), Some(occlusal)) =
        (landmarks.le_fort_1_plane, landmarks.midline_x_mm, landmarks.occlusal_z_mm)
    else {
        return Err(misplaced("lack the Le Fort I plane, the midline or the occlusal plane"));
    };
    let zygomas = ["zygomaxillare_left", "zygomaxillare_right"].map(|n| landmarks.points.get(n).copied());
    let mut cuts = le_fort_1(plane, midline, occlusal, zygomas, bone);
    if cuts.is_empty() {
        let detail =
            "must lie within 45° of horizontal and more than 5 mm above the occlusal plane for a Le Fort I cut";
        return Err(PlanError::Value { what: "plane".into(), detail: detail.to_owned() });
    }
    if template == Template::TwoPieceMaxilla {
        cuts.extend(le_fort_1::midsagittal(plane, midline, occlusal, bone));
    }
    Ok(cuts)
}

/// Whether a cut meets bone.
fn meets(bone: &Envelope, cut: &Cut) -> bool {
    let Ok(checked_cut) = CheckedCut::new(0, cut) else { return false };
    crossings(&bone.grid, &[checked_cut], &Control::new()).is_ok_and(|c| c.iter().any(|c| c.in_bone))
}
