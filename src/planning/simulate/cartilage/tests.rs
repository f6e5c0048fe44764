use super::*;
use crate::phantom::{self, Phantom};
use crate::plan::{Path, Plan, le_fort_1, propose};
use crate::simulate::{
    AttachmentRules, Fields, FieldsSettings, LEAVE_OUT_BELOW_MM, RunSettings, TissueModel, TissueSettings,
    build_fields, build_tissue, cut_bone, solve,
};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Motion, TriMesh};
use prosopon_tissue::fem::{Model, Preset, SolveSettings};
use prosopon_tissue::mesh::{Domain, Region, build};

fn anatomy(head: &Phantom) -> Anatomy {
    let sampled = |solid: &dyn Implicit| phantom::surface_of(solid, &head.bounds(), 2.5).unwrap();
    let landmarks = head.landmarks.points.clone();
    let [skin, skull, air] = [&head.skin, &head.skull, &head.air].map(|solid| sampled(solid.as_ref()));
    Anatomy { skin, skull, air: Some(air), soft_tissue: None, landmarks, midline_x_mm: None }
}

fn fields(anatomy: &Anatomy) -> Fields {
    let mut settings = FieldsSettings::default();
    settings.field.field.spacing_mm = 2.0;
    build_fields(anatomy, &settings, &Control::new()).unwrap()
}

/// Volume of the cartilage on the patient's right and left of x = 0, mm³.
fn sides(mesh: &MixedMesh) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for (corners, _) in cartilage(mesh) {
        let [a, b, c, d] = corners;
        let x = (a.x + b.x + c.x + d.x) / 4.0;
        sums[usize::from(x > 0.0)] += (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0;
    }
    sums
}

/// Corners and centroid of each tetrahedron of cartilage.
fn cartilage(mesh: &MixedMesh) -> impl Iterator<Item = ([Point; 4], Point)> {
    let cells = mesh.tetrahedra.iter().zip(&mesh.tetrahedron_tissue).filter(|(_, t)| **t == Tissue::Cartilage);
    cells.map(|(corners, _)| {
        let p = corners.map(|n| mesh.positions[n as usize]);
        (p, Point::from(p.iter().map(|p| p.coords * 0.25).sum::<Vector>()))
    })
}

/// The phantom is symmetric but the lattice of the mesh is not, which moves single tetrahedra in or out at the border of the
/// cartilage: 1 to 5 % of its volume with the lattice in four places 1 mm apart.
#[test]
fn cartilage_lies_in_the_nose_alike_on_both_sides_and_off_leaves_the_mesh_alone() {
    let head = phantom::head();
    let anatomy = anatomy(&head);
    let fields = fields(&anatomy);
    let bounds = Aabb { min: Point::new(-45.0, -130.0, 0.0), max: Point::new(45.0, -45.0, 90.0) };
    let made = |cartilage: bool| {
        let settings = TissueSettings { region: Some(bounds), cartilage, ..TissueSettings::default() };
        build_tissue(&anatomy, &fields, None, &settings, &Control::new()).unwrap()
    };
    let (on, off) = (made(true), made(false));
    let n = cartilage(&on.mesh).count();
    assert!(n > 100 && on.report.cartilage == n, "{n} of {:?}", on.report);
    let [right, left] = sides(&on.mesh);
    assert!((right - left).abs() < 0.08 * (right + left), "{right} {left} mm³");
    let subnasale = propose(&anatomy.skin, &anatomy.skull).points["subnasale"];
    let bone_tip = head.landmarks.point("nasal_bone_tip").unwrap();
    for (_, p) in cartilage(&on.mesh) {
        let in_nose = p.x.abs() < 18.0 && p.y < -70.0 && p.z > subnasale.z - 2.0 && p.z < bone_tip.z + 2.0;
        assert!(in_nose && head.skin.value(&p) < 0.0, "{p} {subnasale} {bone_tip}");
    }
    // Tip and both alae have some, and so has the midplane.
    let tip = head.landmarks.point("pronasale").unwrap();
    for [x, y, z] in [[0.0, tip.y + 4.0, tip.z], [12.0, -94.0, 35.0], [-12.0, -94.0, 35.0], [0.0, -92.0, 46.0]] {
        let nearest = cartilage(&on.mesh).map(|(_, p)| (p - Point::new(x, y, z)).norm()).fold(f64::MAX, f64::min);
        assert!(nearest < 4.0, "{x} {y} {z}: {nearest} mm");
    }
    let region = Region { bounds, half_spaces: Vec::new() };
    let domain = Domain {
        skin: &fields.skin,
        bone: &fields.bone_field,
        air: fields.air.as_ref().map(|a| a as &dyn Implicit),
        soft_tissue: None,
        region: &region,
    };
    let (plain, _) = build(&domain, &MeshSettings::default(), &Control::new()).unwrap();
    assert!(off.mesh == plain && off.report.cartilage == 0);
    let mut reset = on.mesh.clone();
    reset.tetrahedron_tissue.clone_from(&plain.tetrahedron_tissue);
    assert!(reset == plain, "only the tissue of tetrahedra changes");
}

/// The phantom's upper jaw 6 mm forward, on a coarse mesh: the septum, which hangs from the nasal bones, holds the tip down a
/// little; the alae, which the jaw carries, turn it up more than soft tissue does. That is why cartilage is off by default.
#[test]
fn the_septum_holds_the_tip_down_and_the_alae_turn_it_up() {
    let head = phantom::head();
    let anatomy = anatomy(&head);
    let fields = fields(&anatomy);
    let marks = &head.landmarks;
    let cuts = le_fort_1(marks.le_fort_1_plane, marks.midline_x_mm, marks.occlusal_plane_z_mm, [None; 2], &fields.bone);
    let mut settings = FieldsSettings::default();
    settings.field.field.spacing_mm = 2.0;
    let bone = cut_bone(&fields.bone, &cuts, &settings.field, &Control::new()).unwrap();
    let jaw = bone.osteotomy.segments.iter().find(|s| s.id != 0 && s.bounded_by.contains(&0)).unwrap().id;
    let path = Path::new(jaw, vec![(1.0, Motion::translation(0.0, -6.0, 0.0))]).unwrap();
    let plan = Plan { paths: vec![path] };
    let tip = marks.point("pronasale").unwrap();
    let distance = |i: &usize| (anatomy.skin.positions()[*i] - tip).norm();
    let vertex = (0..anatomy.skin.positions().len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
    let moved = |tissue: &TissueModel| {
        let solver = SolveSettings::new(Model::Linear, Preset::Wang2009Stable.materials());
        let attachment = Some(AttachmentRules::default());
        let run = RunSettings { solver, steps: 1, attachment, leave_out_below_mm: LEAVE_OUT_BELOW_MM };
        let mut skin: Option<TriMesh> = None;
        solve(&anatomy, tissue, &bone, &plan, &run, &Control::new(), &mut |frame| skin = Some(frame.skin)).unwrap();
        skin.unwrap().positions()[vertex] - anatomy.skin.positions()[vertex]
    };
    let mesh = MeshSettings { edge_mm: 6.0, ..MeshSettings::default() };
    let off = TissueSettings { mesh, cartilage: false, ..TissueSettings::default() };
    let mut tissue = build_tissue(&anatomy, &fields, Some(&bone), &off, &Control::new()).unwrap();
    let without = moved(&tissue);
    let plain = tissue.mesh.tetrahedron_tissue.clone();
    let proposal = propose(&anatomy.skin, &anatomy.skull);
    let nose = NoseLandmarks::of(&anatomy, &proposal).unwrap();
    let atlas = Atlas::new(&nose, &mesh).unwrap();
    let mut with = |atlas: Atlas| {
        tissue.mesh.tetrahedron_tissue.clone_from(&plain);
        assert!(atlas.mark(&mut tissue.mesh, &fields.skin) > 50);
        moved(&tissue)
    };
    // Up is +z. Measured: 2.46 mm without cartilage, 2.40 with the septum, 3.08 with the alae, 2.81 with both.
    let septum = with(Atlas { alar_half_width: -1.0, ..atlas.clone() });
    assert!(septum.z < without.z && septum.z > 0.5 * without.z, "{septum} {without}");
    let alae = with(Atlas { half_thickness: -1.0, ..atlas.clone() });
    assert!(alae.z > without.z, "if alae no longer turn the tip up, place cartilage by default: {alae} {without}");
    let both = with(atlas);
    assert!(both.z < alae.z && both.x.abs() < 0.1, "{both} {alae}");
}

fn marks() -> NoseLandmarks {
    NoseLandmarks {
        pronasale: Point::new(0.0, -112.0, 42.0),
        subnasale: Point::new(0.0, -96.0, 28.0),
        ans: Point::new(0.0, -84.0, 28.0),
        nasal_bone_tip: Point::new(0.0, -96.0, 60.0),
    }
}

#[test]
fn landmarks_that_contradict_each_other_place_nothing() {
    let settings = MeshSettings::default();
    assert!(Atlas::new(&marks(), &settings).is_ok());
    let far = Point::new(0.0, -112.0, 150.0);
    let aside = Point::new(30.0, -90.0, 42.0);
    for (wrong, expected) in [
        (NoseLandmarks { nasal_bone_tip: marks().ans, ..marks() }, "nasal_bone_tip"),
        (NoseLandmarks { nasal_bone_tip: Point::new(0.0, -96.0, -4.0), ..marks() }, "must lie above `ans`"),
        (NoseLandmarks { pronasale: far, ..marks() }, "pronasale"),
        (NoseLandmarks { pronasale: aside, ..marks() }, "midplane"),
        (NoseLandmarks { subnasale: Point::new(0.0, -96.0, 70.0), ..marks() }, "subnasale"),
        (NoseLandmarks { pronasale: Point::new(f64::NAN, 0.0, 0.0), ..marks() }, "midplane"),
    ] {
        let why = Atlas::new(&wrong, &settings).unwrap_err();
        assert!(why.contains(expected), "{why}");
    }
}

#[test]
fn a_head_without_a_nose_gets_a_warning_and_no_cartilage() {
    let triangle =
        TriMesh::new(vec![Point::origin(), Point::new(1.0, 0.0, 0.0), Point::new(0.0, 1.0, 0.0)], vec![[0, 1, 2]]);
    let surface = triangle.unwrap();
    let anatomy = Anatomy {
        skin: surface.clone(),
        skull: surface,
        air: None,
        soft_tissue: None,
        landmarks: Vec::new(),
        midline_x_mm: None,
    };
    let head = phantom::head();
    let mut mesh = MixedMesh {
        positions: vec![
            Point::origin(),
            Point::new(1.0, 0.0, 0.0),
            Point::new(0.0, 1.0, 0.0),
            Point::new(0.0, 0.0, 1.0),
        ],
        tetrahedra: vec![[0, 1, 2, 3]],
        tetrahedron_tissue: vec![Tissue::Fat],
        prisms: Vec::new(),
        prism_tissue: Vec::new(),
        bone_faces: Vec::new(),
        attachment: Vec::new(),
        depth_cut_nodes: Vec::new(),
        facing: Vec::new(),
    };
    let skin = head.skin.as_ref();
    let placed = place_cartilage(&mut mesh, &anatomy, &Proposal::default(), skin, &MeshSettings::default());
    assert_eq!((placed.tetrahedra, mesh.tetrahedron_tissue[0]), (0, Tissue::Fat));
    let warning = placed.warning.unwrap();
    assert!(warning.code == "cartilage-not-placed" && warning.message.contains("pronasale"), "{warning:?}");
}
