use super::super::CutBone;
use super::super::pressed_globes::{globe_warnings, pressed};
use super::*;
use crate::plan::{BoundedPlane, Cut, Path, Plan};
use crate::simulate::{
    Fields, FieldsSettings, LEAVE_OUT_BELOW_MM, RunSettings, TissueModel, TissueSettings, build_fields, build_tissue,
    cut_bone, solve,
};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, ScalarGrid, TriMesh, isosurface};
use prosopon_tissue::fem::{Model, Preset, SolveSettings};
use prosopon_tissue::mesh::MeshSettings;

/// A function of the point, mm; its gradient is a difference.
struct Function<F>(F);

impl<F: Fn(&Point) -> f64 + Sync> Implicit for Function<F> {
    fn value(&self, p: &Point) -> f64 {
        (self.0)(p)
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let along = |axis| self.value(&(p + Vector::ith(axis, 1e-4))) - self.value(&(p - Vector::ith(axis, 1e-4)));
        (self.value(p), Vector::from_fn(|axis, _| along(axis) / 2e-4))
    }
}

const ORBITALE: Point = Point::new(31.0, -25.0, 3.0);
const LATERAL: Point = Point::new(48.5, -25.0, 29.0);

/// Everything behind the plane y = `front`.
fn behind(front: f64) -> impl Implicit {
    Function(move |p: &Point| front - p.y)
}

fn nothing() -> impl Implicit {
    Function(|_: &Point| 50.0)
}

#[test]
fn a_globe_lies_in_the_middle_of_its_orbit_below_the_lid() {
    let globe = Globe::in_orbit(Side::Left, [ORBITALE, LATERAL], &behind(-60.0), &nothing()).unwrap();
    assert!((globe.center - Point::new(31.0, -25.0, 20.4)).norm() < 0.1, "{globe:?}");
    let mirrored = |p: Point| Point::new(-p.x, p.y, p.z);
    let right = Globe::in_orbit(Side::Right, [ORBITALE, LATERAL].map(mirrored), &behind(-60.0), &nothing()).unwrap();
    assert_eq!(right.center, mirrored(globe.center));
    let ends = [-1.0, 1.0].map(|end| globe.glides_at(&(globe.center + Vector::y() * end * globe.radius_mm)));
    assert_eq!(ends, [true, false]);
    // The skin at -35 mm leaves room for the lid only when the globe lies 5 mm farther back.
    let sunk = Globe::in_orbit(Side::Left, [ORBITALE, LATERAL], &behind(-35.0), &nothing()).unwrap();
    assert!((sunk.center.y + 20.0).abs() < 1e-9, "{sunk:?}");
}

#[test]
fn landmarks_that_cannot_be_those_of_an_orbit_place_nothing() {
    let skin = behind(-60.0);
    let at = |lateral: Point| Globe::in_orbit(Side::Left, [ORBITALE, lateral], &skin, &nothing()).unwrap_err();
    let aside = Point::new(ORBITALE.x - 17.5, -25.0, 29.0);
    for wrong in [ORBITALE, aside, Point::new(48.5, -25.0, 90.0), Point::new(140.0, -25.0, 29.0), LATERAL * f64::NAN] {
        assert!(at(wrong).contains("orbitale_left"), "{wrong}");
    }
    let outside = Globe::in_orbit(Side::Left, [ORBITALE, LATERAL], &behind(-20.0), &nothing()).unwrap_err();
    assert!(outside.contains("out of the skin"), "{outside}");
    let filled = Globe::in_orbit(Side::Left, [ORBITALE, LATERAL], &skin, &Function(|_: &Point| 3.0)).unwrap_err();
    assert!(filled.contains("bone lies 3 mm"), "{filled}");
}

#[test]
fn derivatives_of_a_solid_with_globes_are_those_of_the_nearer_one() {
    let solid = behind(0.0);
    let globe = Globe { center: Point::new(1.0, -8.0, 2.0), radius_mm: 5.0 };
    let both = WithGlobes { solid: &solid as &dyn Implicit, globes: vec![globe] };
    for (p, at_globe) in [(Point::new(4.0, -13.0, 5.0), true), (Point::new(40.0, -2.0, 0.0), false)] {
        assert_eq!(both.globe_before_solid(&p).is_some(), at_globe);
        let (value, gradient) = both.value_gradient(&p);
        assert_eq!(value, both.value(&p));
        let numbers = Function(|q: &Point| both.value(q));
        assert!((numbers.value_gradient(&p).1 - gradient).norm() < 1e-7, "{gradient}");
        let step = 1e-4;
        for axis in 0..3 {
            let at = |sign: f64| both.value_gradient(&(p + Vector::ith(axis, sign * step))).1;
            let column = (at(1.0) - at(-1.0)) / (2.0 * step);
            assert!((both.hessian(&p).column(axis) - column).norm() < 1e-6);
        }
    }
    assert!(both.value_gradient(&globe.center).1.norm() <= 1.0 && both.hessian(&globe.center)[(0, 0)].is_finite());
}

#[test]
fn faults_are_told_where_bone_may_reach_an_orbit() {
    let skin = behind(-60.0);
    let landmark = |name: &str, p: Point| (name.to_owned(), p);
    let triangle = TriMesh::new(vec![Point::origin(), ORBITALE, LATERAL], vec![[0, 1, 2]]).unwrap();
    let with = |points: &[(String, Point)], reach: &Reach| {
        let anatomy = Anatomy {
            skin: triangle.clone(),
            skull: triangle.clone(),
            air: None,
            soft_tissue: None,
            landmarks: points.to_vec(),
            midline_x_mm: None,
        };
        place_globes(&anatomy, &Proposal::default(), reach, &skin, &nothing())
    };
    let all = Aabb { min: Point::new(-80.0, -60.0, -60.0), max: Point::new(80.0, 60.0, 80.0) };
    let reach = |known| Reach { parts: vec![all], region: all, known };
    let codes = |warnings: &[Warning]| warnings.iter().map(|w| (w.code, w.severity)).collect::<Vec<_>>();
    let left = [landmark("orbitale_left", ORBITALE), landmark("frontomalare_left", LATERAL)];
    // The right globe is missing.
    let (globes, warnings) = with(&left, &reach(Known::NearOrbits));
    assert_eq!(globes.len(), 1);
    assert_eq!(codes(&warnings), [("globes-placed", Severity::Info), ("globes-not-placed", Severity::Check)]);
    // It is not known whether it is needed.
    assert_eq!(codes(&with(&left, &reach(Known::Segments)).1), [("globes-placed", Severity::Info)]);
    let high = [left.to_vec(), vec![landmark("ans", Point::new(0.0, -20.0, -30.0))]].concat();
    let (_, warnings) = with(&high, &reach(Known::Nothing));
    assert_eq!(codes(&warnings)[1], ("globes-not-placed", Severity::Info));
    // Both in one orbit.
    let crowded = [ORBITALE, LATERAL].map(|p| Point::new(-p.x + 50.0, p.y, p.z));
    let right = [landmark("orbitale_right", crowded[0]), landmark("frontomalare_right", crowded[1])];
    let (globes, warnings) = with(&[left, right].concat(), &reach(Known::NearOrbits));
    assert!(globes.is_empty() && warnings[0].message.contains("12 mm apart"), "{warnings:?}");
    // A region without eyes.
    let low = Reach { region: Aabb { max: Point::new(80.0, 60.0, 0.0), ..all }, ..reach(Known::NearOrbits) };
    assert!(with(&[], &low).0.is_empty());
}

/// Surface of the solid where `value` is negative, mm.
fn surface(value: impl Fn(&Point) -> f64, [low, high]: [Point; 2]) -> TriMesh {
    let mut grid = ScalarGrid::covering(&Aabb { min: low, max: high }.grown(4.3), 2.0, 0.0);
    let [nx, ny, _] = grid.dims;
    for n in 0..grid.values.len() {
        let p = grid.position(n % nx, n / nx % ny, n / (nx * ny));
        grid.values[n] = value(&p) as f32;
    }
    isosurface(&grid, 0.0).unwrap()
}

/// A plate of bone with one orbit below 3 to 15 mm of skin.
fn plate() -> (Anatomy, Fields) {
    let in_box = |p: &Point, [low, high]: [Point; 2]| (low - p).sup(&(p - high)).max();
    let skin = [Point::new(-10.0, -40.0, -30.0), Point::new(72.0, 30.0, 170.0)];
    let bone = [Point::new(-2.0, -25.0, -22.0), Point::new(64.0, 22.0, 160.0)];
    let hole = |p: &Point| 17.0 - (p.x - 31.0).hypot(p.z - 20.4);
    let anatomy = Anatomy {
        skin: surface(|p| in_box(p, skin), skin),
        skull: surface(|p| in_box(p, bone).max(hole(p)), bone),
        air: None,
        soft_tissue: None,
        landmarks: vec![("orbitale_left".to_owned(), ORBITALE), ("frontomalare_left".to_owned(), LATERAL)],
        midline_x_mm: None,
    };
    let mut settings = FieldsSettings::default();
    settings.field.field.spacing_mm = 2.0;
    let fields = build_fields(&anatomy, &settings, &Control::new()).unwrap();
    (anatomy, fields)
}

/// The plate cut above its orbit, and the segment with the orbit.
fn rim_of(fields: &Fields) -> (CutBone, u32) {
    let above = BoundedPlane { point: Point::new(0.0, 0.0, 60.0), normal: Vector::z(), bounds: None };
    let mut settings = FieldsSettings::default();
    settings.field.field.spacing_mm = 2.0;
    let bone = cut_bone(&fields.bone, &[Cut::from(above)], &settings.field, &Control::new()).unwrap();
    let rim = bone.osteotomy.segments.iter().find(|s| s.surface.bounds().min.z < 0.0).unwrap().id;
    (bone, rim)
}

fn moved(segment: u32, x: f64, y: f64) -> Plan {
    Plan { paths: vec![Path::new(segment, vec![(1.0, Motion::translation(x, y, 0.0))]).unwrap()] }
}

/// The orbit's wall lies 5 mm from the globe, which a movement to the side uses up.
#[test]
fn bone_that_is_pressed_into_a_globe_is_reported() {
    let (_, fields) = plate();
    let (bone, rim) = rim_of(&fields);
    let globe = Globe::in_orbit(Side::Left, [ORBITALE, LATERAL], &behind(-40.0), &nothing()).unwrap();
    let found = |plan: &Plan| pressed(&[globe], &bone, plan);
    for harmless in [moved(rim, 0.0, -15.0), moved(rim, 5.5, 0.0), Plan { paths: Vec::new() }] {
        assert_eq!(found(&harmless), []);
    }
    let warnings = found(&moved(rim, 9.0, 0.0));
    assert!(warnings.len() == 1 && warnings[0].code == "globe-pressed", "{warnings:?}");
    let depth = warnings[0].message.split(" mm deep").next().and_then(|s| s.rsplit(' ').next()).unwrap();
    // The bone is cut on a lattice of 2 mm.
    assert!((depth.parse::<f64>().unwrap() - 4.0).abs() < 0.3, "{}", warnings[0].message);
}

/// A way round, with both ends at harmless places.
#[test]
fn bone_that_passes_through_a_globe_on_its_way_is_reported() {
    let (_, fields) = plate();
    let (bone, rim) = rim_of(&fields);
    let globe = Globe { center: Point::new(31.0, -25.0, 20.4), radius_mm: 12.0 };
    let waypoints = vec![(0.33, Motion::translation(0.0, 0.0, 10.0)), (1.0, Motion::translation(0.0, -1.0, 0.0))];
    let plan = Plan { paths: vec![Path::new(rim, waypoints).unwrap()] };
    let warnings = pressed(&[globe], &bone, &plan);
    assert!(warnings[0].message.contains("at 0.33 of its path"), "{warnings:?}");
}

#[test]
fn globes_at_different_heights_are_reported() {
    let at = |x: f64, z: f64| Globe { center: Point::new(x, -25.0, z), radius_mm: 12.0 };
    assert!(uneven(&[at(31.0, 20.0), at(-31.0, 24.0)]).is_none() && uneven(&[at(31.0, 20.0)]).is_none());
    let found = uneven(&[at(31.0, 20.0), at(-31.0, 9.0)]).unwrap();
    assert!(found.code == "globes-uneven" && found.message.contains("11 mm higher"), "{found:?}");
}

/// A mesh that was built before the cuts were known has no globes; a plan that moves the orbit makes that a matter to check.
#[test]
fn globes_that_a_plan_turns_out_to_need_are_reported() {
    let (mut anatomy, fields) = plate();
    anatomy.landmarks.clear();
    let (bone, rim) = rim_of(&fields);
    let mesh = MeshSettings { edge_mm: 8.0, depth_mm: 70.0, ..MeshSettings::default() };
    let settings = TissueSettings { mesh, ..TissueSettings::default() };
    let mut tissue = build_tissue(&anatomy, &fields, None, &settings, &Control::new()).unwrap();
    let note = Warning { severity: Severity::Info, ..not_placed("`orbitale_left` was not found") };
    tissue.report.warnings = vec![note];
    let found = globe_warnings(&tissue, &bone, &moved(rim, 0.0, -5.0));
    assert!(found.len() == 1 && found[0].severity == Severity::Check, "{found:?}");
    assert_eq!(globe_warnings(&tissue, &bone, &Plan { paths: Vec::new() }), []);
}

/// The rim of an orbit moves forward, as in a Le Fort III: the lid stays with the globe.
#[test]
fn lids_glide_over_a_globe_that_stays() {
    let (anatomy, fields) = plate();
    let (bone, rim) = rim_of(&fields);
    let plan = moved(rim, 0.0, -5.0);
    let lid = Point::new(31.0, -40.0, 20.4);
    let off = |p: &Point| (p - lid).norm();
    let positions = anatomy.skin.positions();
    let vertex = (0..positions.len()).min_by(|a, b| off(&positions[*a]).total_cmp(&off(&positions[*b]))).unwrap();
    let forward = |globes: bool| {
        let mesh = MeshSettings { edge_mm: 5.0, depth_mm: 70.0, ..MeshSettings::default() };
        let settings = TissueSettings { mesh, globes, ..TissueSettings::default() };
        let tissue: TissueModel = build_tissue(&anatomy, &fields, Some(&bone), &settings, &Control::new()).unwrap();
        assert_eq!(tissue.globes.len(), usize::from(globes), "{rim} {:?}", tissue.report.warnings);
        let solver = SolveSettings::new(Model::Linear, Preset::Wang2009Stable.materials());
        let run = RunSettings { solver, steps: 1, attachment: None, leave_out_below_mm: LEAVE_OUT_BELOW_MM };
        let mut skin: Option<TriMesh> = None;
        let outcome =
            solve(&anatomy, &tissue, &bone, &plan, &run, &Control::new(), &mut |frame| skin = Some(frame.skin))
                .unwrap();
        let names: Vec<&str> = outcome.warnings.iter().map(|w| w.code).collect();
        assert_eq!(names.contains(&"globe-nodes"), globes, "{names:?}");
        // The mesh ends at the globe.
        let inside = tissue.globes.iter().flat_map(|g| tissue.mesh.positions.iter().map(|p| g.distance(p)));
        assert!(inside.fold(0.0, f64::min) > -0.5);
        positions[vertex].y - skin.unwrap().positions()[vertex].y
    };
    let (with, without) = (forward(true), forward(false));
    assert!(with < 0.25 * 5.0 && without > 0.5 * 5.0, "{with} {without}");
}
