//! Conversion of the errors of the store and the numerics to faults.
//!
//! Every `match` is exhaustive, so a new variant must choose its kind.

use serde_json::{Value, json};

use super::fault::{Fault, FaultKind, FieldFault, Halt};
use prosopon_field::FieldError;
use prosopon_formats::import::ImportError;
use prosopon_planning::evaluate::{EvaluateError, RegistrationFault};
use prosopon_planning::plan::{Bridge, Miss, PlanError};
use prosopon_planning::simulate::SimulateError;
use prosopon_planning::surface::SurfaceError;
use prosopon_store::StoreError;
use prosopon_tissue::fem::SolveError;
use prosopon_tissue::mesh::MeshError;

impl From<StoreError> for Fault {
    fn from(error: StoreError) -> Self {
        if error.is_disk_full() {
            return Self::new(
                FaultKind::StorageFull,
                "the disk of the service is full; delete sessions, or make room outside of the service where that is refused too",
            );
        }
        match error {
            StoreError::SessionGone => Self::new(FaultKind::Gone, "the session was deleted meanwhile"),
            StoreError::TooLarge { allowed } => {
                Self::new(FaultKind::TooLarge, format!("the upload is longer than the {allowed} bytes allowed"))
                    .with("allowed_bytes", allowed)
            }
            StoreError::QuotaFull { allowed } => Self::new(
                FaultKind::QuotaFull,
                format!("this exceeds the quota of {allowed} bytes; delete something first"),
            )
            .with("allowed_bytes", allowed),
            StoreError::KeyTaken => Self::new(
                FaultKind::WrongState,
                "another request with this idempotency key is running; try again later",
            ),
            StoreError::BlobGone { key } => {
                tracing::warn!(key, "a blob was removed before it was read");
                let detail =
                    "the value was replaced or deleted while it was read; try again; if this repeats, its file is lost";
                Self::new(FaultKind::WrongState, detail)
            }
            StoreError::Damaged { key } => {
                tracing::error!(key, "a stored value is damaged");
                metrics::counter!("prosopon_values_damaged_total").increment(1);
                let detail = format!("the stored value {key} is damaged: its file was changed or cut off");
                Self::new(FaultKind::DamagedValue, detail).with("value", key)
            }
            StoreError::KeyUnknown { id } => {
                tracing::error!(id, "a stored value is encrypted with a key that was not given");
                let detail = format!("a stored value is encrypted with the key {id}, which the service does not have");
                Self::new(FaultKind::Internal, detail)
            }
            StoreError::Unreachable(_) | StoreError::BucketUnreachable(_) => {
                tracing::error!(error = chain(&error), "the store cannot be reached");
                Self::new(FaultKind::StoreUnavailable, format!("{error} now; try again later"))
            }
            StoreError::BucketDenied(_) => {
                tracing::error!(error = chain(&error), "the bucket refuses a request");
                Self::new(
                    FaultKind::StoreRefuses,
                    format!("{error}, or refuses this value; see the log of the service"),
                )
            }
            StoreError::NoRoom { .. } => {
                tracing::error!(error = chain(&error), "only reads and deletions are accepted");
                let detail = format!("{error}; delete sessions with at_once=true, or enlarge the disk");
                Self::new(FaultKind::StorageFull, detail)
            }
            StoreError::DirectoryGone { .. } => {
                tracing::error!(error = chain(&error), "what is written now is lost");
                let detail = "the data directory of the service is gone, so nothing is accepted; tell its operator";
                Self::new(FaultKind::StoreUnavailable, detail)
            }
            StoreError::Database(_)
            | StoreError::Bucket(_)
            | StoreError::ForeignBlobs { .. }
            | StoreError::Blob(_)
            | StoreError::Io(_)
            | StoreError::Record { .. }
            | StoreError::Newer { .. }
            | StoreError::Older { .. }
            | StoreError::Backup { .. }
            | StoreError::Missing { .. }
            | StoreError::Foreign
            | StoreError::ForeignTables
            | StoreError::Unfinished
            | StoreError::InUse => {
                tracing::error!(error = chain(&error), "the store failed");
                Self::new(FaultKind::Internal, "the store failed; see the log of the service")
            }
        }
    }
}

impl From<StoreError> for Halt {
    fn from(error: StoreError) -> Self {
        if matches!(error, StoreError::SessionGone) { Self::Cancelled } else { Fault::from(error).into() }
    }
}

/// An error and all its sources in one line.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        let cause = error.to_string();
        // The text of some errors contains their source already.
        if !text.ends_with(&cause) {
            text.push_str(": ");
            text.push_str(&cause);
        }
        source = error.source();
    }
    text
}

/// The fault of an unreadable surface or volume; `kind` distinguishes the two.
pub fn import_fault(error: &ImportError, kind: FaultKind) -> Fault {
    match error {
        ImportError::UnknownFormat { .. } => Fault::new(FaultKind::UnsupportedFormat, error.to_string()),
        ImportError::Empty | ImportError::Malformed { .. } | ImportError::ImplausibleSize { .. } => {
            Fault::new(kind, error.to_string())
        }
        ImportError::TooLarge { what, found, allowed } => {
            Fault::new(kind, error.to_string()).with("counted", *what).with("found", *found).with("allowed", *allowed)
        }
        ImportError::Geometry(_) => Fault::new(kind, chain(error)),
    }
}

impl From<SurfaceError> for Halt {
    fn from(error: SurfaceError) -> Self {
        match error {
            SurfaceError::Cancelled(_) => Self::Cancelled,
            SurfaceError::NothingFound { .. } | SurfaceError::Volume { .. } => {
                Fault::new(FaultKind::VolumeNotUsable, error.to_string()).into()
            }
            SurfaceError::Setting { name, .. } | SurfaceError::Level { name, .. } => {
                Fault::invalid(vec![FieldFault::new(format!("/{name}"), error.to_string())]).into()
            }
        }
    }
}

impl From<FieldError> for Halt {
    fn from(error: FieldError) -> Self {
        let fault = Fault::new(FaultKind::FieldNotUsable, error.to_string());
        match error {
            FieldError::Cancelled(_) => return Self::Cancelled,
            FieldError::Setting { name, .. } => fault.with("setting", name),
            FieldError::TooLarge { samples, allowed, .. } => fault.with("samples", samples).with("allowed", allowed),
            FieldError::NothingInside | FieldError::TooOpen { .. } | FieldError::BoxOutsideDomain => fault,
        }
        .into()
    }
}

impl From<MeshError> for Halt {
    fn from(error: MeshError) -> Self {
        let fault = Fault::new(FaultKind::MeshNotUsable, error.to_string());
        match error {
            MeshError::Cancelled(_) => return Self::Cancelled,
            MeshError::Setting { name, .. } => fault.with("setting", name),
            MeshError::NoTissue => Fault { kind: FaultKind::AnatomyNotUsable, ..fault },
            MeshError::RoughSkin { .. } => fault,
            MeshError::TooLarge { found, allowed, .. } => fault.with("tetrahedra", found).with("allowed", allowed),
            MeshError::Inverted { count, x, y, z } => fault.with("inverted", count).with("near_mm", vec![x, y, z]),
        }
        .into()
    }
}

impl From<PlanError> for Halt {
    fn from(error: PlanError) -> Self {
        let detail = error.to_string();
        match error {
            PlanError::Cancelled(_) => return Self::Cancelled,
            PlanError::MissesBone { missed_by } => {
                let first = missed_by.first();
                let mut fault = Fault::new(FaultKind::CutMissesBone, detail)
                    .with("cut", first.map(|m| m.cut))
                    .with("distance_mm", first.map(|m| m.distance_mm));
                let of = |m: &Miss| {
                    FieldFault::new(format!("/cuts/{}", m.cut), format!("misses the bone by {:.1} mm", m.distance_mm))
                };
                fault.errors = missed_by.iter().map(of).collect();
                fault
            }
            PlanError::NotParted { bridges } => {
                let of = |b: &Bridge| {
                    json!({ "cut": b.cut, "place_mm": [b.place.x, b.place.y, b.place.z], "width_mm": b.width_mm,
                        "length_mm": b.length_mm, "area_mm2": b.area_mm2 })
                };
                let all: Vec<Value> = bridges.iter().map(of).collect();
                let widest = bridges.first().map(|b| vec![b.place.x, b.place.y, b.place.z]);
                Fault::new(FaultKind::BoneNotParted, detail)
                    .with("bridges", all)
                    .with("widest_bridge_mm", widest)
                    .at("/cuts")
            }
            PlanError::MissingLandmarks { template, missing } => {
                let mut fault = Fault::new(FaultKind::PlanNotUsable, detail)
                    .with("template", template)
                    .with("missing", missing.clone());
                // Pointers into the request of a template.
                let pointer = |name: &&str| match *name {
                    "midline_x_mm" | "occlusal_plane_z_mm" => format!("/{name}"),
                    "le_fort_1_plane" => "/plane".to_owned(),
                    point => format!("/landmarks/{point}"),
                };
                fault.errors = missing.iter().map(|name| FieldFault::new(pointer(name), "is missing")).collect();
                fault
            }
            PlanError::Cut { cut, field, .. } => {
                let mut fault = Fault::new(FaultKind::PlanNotUsable, detail.clone());
                let place = if field.is_empty() { format!("cuts[{cut}]") } else { format!("cuts[{cut}].{field}") };
                fault.errors.push(FieldFault::new(pointer_of(&place), detail));
                fault
            }
            PlanError::Value { what, .. } => {
                let mut fault = Fault::new(FaultKind::PlanNotUsable, detail.clone());
                fault.errors.push(FieldFault::new(pointer_of(&what), detail));
                fault
            }
        }
        .into()
    }
}

/// JSON pointer to a place: `waypoints[2].t` becomes `/waypoints/2/t`.
fn pointer_of(place: &str) -> String {
    let mut pointer = String::from("/");
    for character in place.chars() {
        match character {
            '[' | '.' => pointer.push('/'),
            ']' => {}
            other => pointer.push(other),
        }
    }
    pointer
}

impl From<SolveError> for Halt {
    fn from(error: SolveError) -> Self {
        let detail = error.to_string();
        match error {
            SolveError::Cancelled(_) => return Self::Cancelled,
            SolveError::Element(_)
            | SolveError::Problem { .. }
            | SolveError::Factorisation { .. }
            | SolveError::Checkpoint { .. } => Fault::new(FaultKind::SceneNotUsable, detail),
            SolveError::Memory { needed_mb, allowed_mb, .. } => {
                // The memory of the factor grows with about the 7/2 power of the number of cells along an edge.
                let coarser = (needed_mb / allowed_mb.max(1.0)).powf(2.0 / 7.0);
                let detail = format!("{detail}; edges {coarser:.2} times as long, or a smaller region, would fit");
                Fault::new(FaultKind::NotEnoughMemory, detail)
                    .with("needed_mb", needed_mb.round())
                    .with("allowed_mb", allowed_mb.round())
            }
            SolveError::NotConverged { path_share, iterations, residual_n, tolerance_n } => {
                Fault::new(FaultKind::SolverNotConverged, detail)
                    .with("stage", "solve")
                    .with("path_share", path_share)
                    .with("iterations", iterations)
                    .with("residual_n", residual_n)
                    .with("tolerance_n", tolerance_n)
            }
            SolveError::Unstable { path_share, tissue, kind, element, stretch, x, y, z } => {
                Fault::new(FaultKind::SolverUnstable, detail)
                    .with("stage", "solve")
                    .with("path_share", path_share)
                    .with("tissue", tissue)
                    .with("element_kind", kind)
                    .with("element", element)
                    .with("stretch", stretch)
                    .with("near_mm", vec![x, y, z])
            }
            SolveError::Inverted { path_share, kind, element, x, y, z } => {
                Fault::new(FaultKind::SolverInverted, detail)
                    .with("stage", "solve")
                    .with("path_share", path_share)
                    .with("element_kind", kind)
                    .with("element", element)
                    .with("near_mm", vec![x, y, z])
            }
            SolveError::PassedThrough { path_share, segment, x, y, z } => {
                Fault::new(FaultKind::SolverPenetration, detail)
                    .with("stage", "solve")
                    .with("path_share", path_share)
                    .with("segment", segment)
                    .with("near_mm", vec![x, y, z])
            }
            SolveError::Penetration { path_share, found_mm, allowed_mm } => {
                Fault::new(FaultKind::SolverPenetration, detail)
                    .with("stage", "solve")
                    .with("path_share", path_share)
                    .with("found_mm", found_mm)
                    .with("allowed_mm", allowed_mm)
            }
        }
        .into()
    }
}

impl From<EvaluateError> for Halt {
    fn from(error: EvaluateError) -> Self {
        match error {
            EvaluateError::Cancelled(_) => Self::Cancelled,
            EvaluateError::Registration(fault) => registration_fault(fault).into(),
            EvaluateError::Input { .. } => Fault::new(FaultKind::ComparisonNotUsable, error.to_string()).into(),
        }
    }
}

fn registration_fault(error: RegistrationFault) -> Fault {
    use RegistrationFault as R;
    let fault = Fault::new(FaultKind::RegistrationFailed, error.to_string()).with("reason", error.reason());
    match error {
        R::RegionTooSmall { vertices, area_mm2, .. } => fault.with("vertices", vertices).with("area_mm2", area_mm2),
        R::ShapeUndetermined { stiffness, .. } => fault.with("stiffness", stiffness),
        R::TooFewPairs { found, .. } => fault.with("vertices", found),
        R::NotConverged { iterations, movement_mm, mirrored } => {
            fault.with("iterations", iterations).with("movement_mm", movement_mm).with("mirrored", mirrored)
        }
        R::NoMatch { median_mm, overlap, mirrored, .. } => {
            fault.with("median_mm", median_mm).with("overlap", overlap).with("mirrored", mirrored)
        }
    }
}

impl From<SimulateError> for Halt {
    fn from(error: SimulateError) -> Self {
        match error {
            SimulateError::Anatomy { .. } => Fault::new(FaultKind::AnatomyNotUsable, error.to_string()).into(),
            SimulateError::Field(e) => e.into(),
            SimulateError::Mesh(e) => e.into(),
            SimulateError::Plan(e) => e.into(),
            SimulateError::Solve(e) => e.into(),
            SimulateError::Evaluate(e) => e.into(),
            SimulateError::Cancelled(e) => e.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::control::Cancelled;

    #[test]
    fn a_nested_cancellation_is_a_cancellation() {
        let error = SimulateError::Solve(SolveError::Cancelled(Cancelled));
        assert_eq!(Halt::from(error), Halt::Cancelled);
    }

    #[test]
    fn a_full_disk_has_a_problem_of_its_own() {
        let full = std::io::Error::from(std::io::ErrorKind::StorageFull);
        assert_eq!(Fault::from(StoreError::Io(full)).kind, FaultKind::StorageFull);
    }

    #[test]
    fn places_become_json_pointers() {
        assert_eq!(pointer_of("paths[1].waypoints[2].t"), "/paths/1/waypoints/2/t");
    }

    #[test]
    fn a_bad_setting_of_surfaces_is_the_fault_of_the_request() {
        let (found, rule) = (String::new(), "it must lie within them");
        for error in [
            SurfaceError::Setting { name: "bone_hu", value: -5.0, min: 0.0, max: 5.0 },
            SurfaceError::Level { name: "bone_hu", value: -5.0, min: 50.0, max: 2050.0, found, rule },
        ] {
            let Halt::Fault(fault) = error.into() else { unreachable!() };
            assert_eq!((fault.kind, fault.errors[0].pointer.as_str()), (FaultKind::InvalidRequest, "/bone_hu"));
        }
    }

    #[test]
    fn a_fault_of_a_cut_has_its_place_in_the_request_and_its_name_in_the_text() {
        let (label, detail) = ("cut `chin`".to_owned(), "a kerf of 6 mm would leave 83 mm³".to_owned());
        let Halt::Fault(fault) = PlanError::Cut { cut: 2, label, field: "kerf_mm", detail }.into() else {
            unreachable!()
        };
        assert_eq!(fault.errors[0].pointer, "/cuts/2/kerf_mm");
        assert_eq!(fault.detail, "cut `chin`: a kerf of 6 mm would leave 83 mm³");
    }

    #[test]
    fn bone_in_one_piece_is_the_fault_of_the_cuts() {
        let error = PlanError::NotParted { bridges: Vec::new() };
        let Halt::Fault(fault) = error.into() else { unreachable!() };
        assert_eq!((fault.kind, fault.errors[0].pointer.as_str()), (FaultKind::BoneNotParted, "/cuts"));
    }

    #[test]
    fn a_missing_cut_says_which_and_how_far() {
        let Halt::Fault(fault) =
            PlanError::MissesBone { missed_by: vec![Miss { cut: 1, label: "cut 1".to_owned(), distance_mm: 4.0 }] }
                .into()
        else {
            unreachable!()
        };
        assert_eq!(fault.errors[0].pointer, "/cuts/1");
        assert_eq!(fault.facts["distance_mm"], 4.0);
    }
}
