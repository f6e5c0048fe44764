use std::sync::Arc;

use super::SimulateError;
use super::tuning::{OUTSIDE_MM, REFUSED_SHARE};
use crate::evaluate::check_skin_and_bone;
use prosopon_field::{Envelope, EnvelopeSettings, FieldReport, MethodSettings, SignedField, envelope};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Motion, PlacedGrid, Point, TriMesh, Warning};

/// The surfaces of one patient, LPS mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Anatomy {
    /// Outer skin.
    pub skin: TriMesh,
    /// Bone with teeth; it may be open, cross itself or fall into parts.
    pub skull: TriMesh,
    /// Air inside the head, when it comes from a CT.
    pub air: Option<TriMesh>,
    /// Mean CT value of soft tissue around each grid node, HU, when there is a CT; NaN where there is no soft tissue.
    pub soft_tissue: Option<PlacedGrid>,
    /// Named landmarks; may be empty.
    pub landmarks: Vec<(String, Point)>,
    /// x of the midsagittal plane, mm; `None` when unknown.
    pub midline_x_mm: Option<f64>,
}

impl Anatomy {
    /// The anatomy in another frame, into which `motion` maps; the midsagittal plane is that of `midline_x_mm`, which the caller
    /// knows in it.
    #[must_use]
    pub fn moved(&self, motion: &Motion, midline_x_mm: Option<f64>) -> Self {
        Self {
            skin: self.skin.moved(motion),
            skull: self.skull.moved(motion),
            air: self.air.as_ref().map(|air| air.moved(motion)),
            soft_tissue: self.soft_tissue.as_ref().map(|grid| grid.moved(motion)),
            landmarks: self.landmarks.iter().map(|(name, p)| (name.clone(), motion * p)).collect(),
            midline_x_mm,
        }
    }
}

/// Fields of the anatomy at rest.
#[derive(Debug)]
pub struct Fields {
    /// Field of the skin.
    pub skin: SignedField,
    /// Report of the skin's field.
    pub skin_report: FieldReport,
    /// Outer envelope of bone.
    pub bone: Arc<Envelope>,
    /// Field of the envelope.
    pub bone_field: SignedField,
    /// Report of the envelope's field, with the doubtful regions of the skull's surface.
    pub bone_report: FieldReport,
    /// Field of the inner air.
    pub air: Option<SignedField>,
    /// What was repaired or should be checked.
    pub warnings: Vec<Warning>,
}

prosopon_geometry::flat!(Fields { skin, skin_report, bone, bone_field, bone_report, air, warnings });

/// Settings of [`build_fields`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FieldsSettings {
    /// Method and resolution of the fields.
    pub field: MethodSettings,
    /// Bone envelope.
    pub envelope: EnvelopeSettings,
}

/// Builds the fields of an anatomy, and checks that the skull lies inside the skin.
///
/// # Errors
/// [`SimulateError::Anatomy`] when skin and skull do not belong together; [`SimulateError::Field`] when a field cannot be built.
pub fn build_fields(anatomy: &Anatomy, settings: &FieldsSettings, control: &Control) -> Result<Fields, SimulateError> {
    build_fields_around(anatomy, None, settings, control)
}

/// As [`build_fields`], with the bone's envelope if it is already known.
///
/// `known` must be the [`envelope`] of the skull with the same settings.
///
/// # Errors
/// As [`build_fields`].
pub fn build_fields_around(
    anatomy: &Anatomy,
    known: Option<Arc<Envelope>>,
    settings: &FieldsSettings,
    control: &Control,
) -> Result<Fields, SimulateError> {
    // In parallel, because parts of each run on one thread; the bone is slower, so the progress is its own.
    let unseen = control.without_progress();
    let (soft, bone) = rayon::join(
        || {
            let skin = SignedField::build(&anatomy.skin, &settings.field, &unseen)?;
            let air = match &anatomy.air {
                Some(surface) => Some(SignedField::build(surface, &settings.field, &unseen)?.0),
                None => None,
            };
            Ok::<_, SimulateError>((skin, air))
        },
        || {
            let bone = match known {
                Some(bone) => bone,
                None => Arc::new(envelope(&anatomy.skull, &settings.envelope, &control.stage(0.0, 0.5))?),
            };
            let stage = control.stage(0.5, 1.0);
            let (field, mut report) = SignedField::build_of_isosurface(&bone.surface, &settings.field, &stage)?;
            // The doubtful regions are those of the skull's surface.
            report.regions.clone_from(&bone.regions);
            Ok::<_, SimulateError>((bone, (field, report)))
        },
    );
    let (((skin, skin_report), air), (bone, (bone_field, bone_report))) = (soft?, bone?);
    let mut warnings = bone.warnings.clone();
    warnings.extend(skin_report.warnings.iter().map(|w| w.clone().about("skin")));
    warnings.extend(bone_report.warnings.iter().map(|w| w.clone().about("bone envelope")));
    warnings.extend(check_nesting(anatomy, &skin, &bone, &bone_field)?);
    control.report(1.0);
    Ok(Fields { skin, skin_report, bone, bone_field, bone_report, air, warnings })
}

fn check_nesting(
    anatomy: &Anatomy,
    skin: &SignedField,
    bone: &Envelope,
    bone_field: &SignedField,
) -> Result<Option<Warning>, SimulateError> {
    let share = |points: &[Point], wrong: &dyn Fn(&Point) -> bool| {
        points.iter().filter(|p| wrong(p)).count() as f64 / points.len().max(1) as f64
    };
    // A likely cause says more than how much lies on the wrong side.
    let cause = check_skin_and_bone(&anatomy.skin, &anatomy.skull, ["skin", "skull"])
        .map_err(|e| SimulateError::Anatomy { detail: e.to_string() })?;
    let covered = share(anatomy.skin.positions(), &|p| bone_field.value(p) < -OUTSIDE_MM);
    if covered > REFUSED_SHARE {
        let detail =
            format!("{:.0} % of the skin's vertices lie inside the bone: are the two files swapped?", 100.0 * covered);
        return Err(SimulateError::Anatomy { detail });
    }
    let bare = share(bone.surface.positions(), &|p| skin.value(p) > OUTSIDE_MM);
    if bare > REFUSED_SHARE {
        let share = format!("{:.0} % of the bone's vertices lie outside the skin", 100.0 * bare);
        let detail = match cause.filter(|found| found.code == "surfaces-wrong-frame") {
            Some(found) => format!("{share}: {}", found.message),
            None => format!("{share}: do both have the same frame (LPS) and unit (mm)?"),
        };
        return Err(SimulateError::Anatomy { detail });
    }
    if cause.is_some() {
        return Ok(cause);
    }
    let worst = bare.max(covered);
    Ok((worst > 0.005).then(|| {
        let message = format!(
            "skin and bone cross: {:.1} % of the vertices lie more than {OUTSIDE_MM} mm on the wrong side",
            100.0 * worst
        );
        Warning::check("surfaces-cross", message).act("Check both surfaces.")
    }))
}
