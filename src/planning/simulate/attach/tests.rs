use std::sync::Arc;

use super::*;
use crate::plan::{BoundedPlane, Cut, Osteotomy, Segment};
use crate::simulate::Globe;
use prosopon_field::{MethodSettings, SignedField};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, ScalarGrid, TriMesh, Vector, isosurface};
use prosopon_tissue::mesh::Tissue;

/// A block with vertices every 2 mm.
fn block(low: [f64; 3], high: [f64; 3]) -> TriMesh {
    let bounds = Aabb { min: Point::from(low), max: Point::from(high) };
    let mut grid = ScalarGrid::covering(&bounds.grown(4.3), 2.0, 0.0);
    let [nx, ny, _] = grid.dims;
    for n in 0..grid.values.len() {
        let p = grid.position(n % nx, n / nx % ny, n / (nx * ny));
        grid.values[n] = (bounds.min - p).sup(&(p - bounds.max)).max() as f32;
    }
    isosurface(&grid, 0.0).unwrap()
}

/// A fixed upper block and a moving lower one, 0.8 mm apart at z = 0, parted by this cut.
fn jaws(cut: Cut, arch: Option<DentalArch>) -> CutBone {
    let segment = |id: u32, surface: TriMesh| Segment {
        id,
        name: None,
        volume_mm3: surface.volume(),
        area_mm2: surface.area(),
        centroid: surface.bounds().center(),
        surface,
        bounded_by: vec![0],
    };
    let segments = vec![
        segment(0, block([-20.0, -20.0, 0.4], [20.0, 20.0, 40.0])),
        segment(1, block([-20.0, -20.0, -40.0], [20.0, 20.0, -0.4])),
    ];
    let settings = MethodSettings::default().coarser(2.0);
    let field = |s: &Segment| Arc::new(SignedField::build_only(&s.surface, &settings, &Control::new()).unwrap().0);
    let fields = segments.iter().map(field).collect();
    let osteotomy =
        Osteotomy { cuts: vec![cut], segments, bone_mm3: 0.0, dropped_mm3: 0.0, warnings: Vec::new(), arch };
    CutBone::new(Arc::new(osteotomy), fields)
}

fn plane() -> Cut {
    Cut::from(BoundedPlane { point: Point::origin(), normal: Vector::z(), bounds: None })
}

fn arch() -> DentalArch {
    DentalArch { front: Point::new(0.0, -20.0, 0.0), up: Vector::z() }
}

/// Nodes on the front of the blocks at these heights, all at bone.
fn front(heights: &[f64]) -> MixedMesh {
    let positions: Vec<Point> = heights.iter().map(|z| Point::new(0.0, -20.0, *z)).collect();
    let n = positions.len() as u32;
    MixedMesh {
        tetrahedra: Vec::new(),
        tetrahedron_tissue: Vec::<Tissue>::new(),
        prisms: Vec::new(),
        prism_tissue: Vec::new(),
        bone_faces: (0..n).map(|i| [i, (i + 1) % n, (i + 2) % n]).collect(),
        attachment: vec![Attachment::Sliding; positions.len()],
        positions,
        depth_cut_nodes: Vec::new(),
        facing: Vec::new(),
    }
}

fn attached(heights: &[f64], bone: &CutBone, rules: &AttachmentRules) -> (Vec<Attachment>, AttachResult) {
    let mut mesh = front(heights);
    let found = attach(&mut mesh, bone, &[1], None, rules);
    (mesh.attachment, found)
}

#[test]
fn stripped_bone_beside_a_saw_line_glides_and_blends_into_tied_bone() {
    use Attachment::{Free, Gliding, Tied};
    let heights = [-38.0, -17.0, -12.4, -9.0, -1.5, 1.5, 9.0, 12.4, 17.0];
    // Teeth are far away, and what a cut is called makes no difference.
    let far = DentalArch { front: Point::new(0.0, -20.0, 200.0), ..arch() };
    for name in ["genioplasty", "occlusal", "le_fort_1", "bsso_left_medial"] {
        let bone = jaws(plane().named(name), Some(far));
        let (found, AttachResult { attached, tied_share, .. }) =
            self::attached(&heights, &bone, &AttachmentRules::default());
        let (above, below) = (Gliding(0), Gliding(1));
        assert_eq!(found, [Tied(1), Tied(1), below, below, Free, Free, above, above, Tied(0)], "{name}");
        assert_eq!((attached.gliding[&0], attached.gliding[&1], attached.free_at_bone), (2, 2, 2));
        // At 12 mm from the line half of the way from gliding to tied is done; the line lies up to 1 mm off the block's edge.
        assert!((0.3..0.9).contains(&tied_share[2]) && tied_share[3] == 0.0, "{tied_share:?}");
    }
    // A separation of bones that touch in the image strips nothing.
    let (found, _) = attached(&heights, &jaws(plane().separating(), Some(far)), &AttachmentRules::default());
    assert!(found.iter().all(|a| matches!(a, Tied(_))), "{found:?}");
    let none = AttachmentRules { stripped_mm: Some(0.0), ..AttachmentRules::default() };
    let (found, _) = attached(&heights, &jaws(plane(), Some(far)), &none);
    assert!(found.iter().all(|a| matches!(a, Tied(_))), "{found:?}");
}

#[test]
fn mucosa_glides_on_the_teeth_of_both_jaws() {
    use Attachment::{Gliding, Sliding, Tied};
    let heights = [-25.0, -15.0, -9.0, -1.5, 1.5, 9.0, 15.0, 25.0];
    let bone = jaws(plane().separating(), Some(arch()));
    let (found, AttachResult { tied_share, .. }) = attached(&heights, &bone, &AttachmentRules::default());
    let (above, below) = (Gliding(0), Gliding(1));
    assert_eq!(found, [Tied(1), below, below, below, above, above, above, Tied(0)]);
    assert!((0.4..0.6).contains(&tied_share[1]) && tied_share[2] == 0.0, "{tied_share:?}");
    let pushed = AttachmentRules { mucosa: NodeClass::Sliding, ..AttachmentRules::default() };
    let (found, AttachResult { tied_share, .. }) = attached(&heights, &bone, &pushed);
    assert_eq!(found[2..6], [Sliding; 4]);
    assert_eq!(found[0], Tied(1));
    assert!(tied_share.iter().all(|share| *share == 0.0));
    // Boxes of the caller replace the zone.
    let low = Aabb { min: Point::new(-30.0, -30.0, -30.0), max: Point::new(30.0, 30.0, -20.0) };
    let boxes = AttachmentRules { sliding: Some(vec![MaskRegion::Box(low)]), ..AttachmentRules::default() };
    let (found, _) = attached(&heights, &bone, &boxes);
    assert_eq!(found[..3], [Gliding(1), Tied(1), Tied(1)]);
}

#[test]
fn unknown_teeth_are_reported() {
    let (_, found) = attached(&[-20.0, 20.0], &jaws(plane(), None), &AttachmentRules::default());
    assert!(found.warnings.iter().any(|w| w.code == "teeth-not-found"), "{:?}", found.warnings);
}

#[test]
fn what_is_painted_goes_over_the_rules_and_the_last_one_wins() {
    use Attachment::{Free, Gliding, Sliding, Tied};
    let ball =
        |class, z, radius_mm| Paint { class, part: MaskRegion::Ball { centre: Point::new(0.0, -20.0, z), radius_mm } };
    let paint = vec![
        ball(NodeClass::Free, -38.0, 30.0),
        ball(NodeClass::Sliding, -20.0, 5.0),
        ball(NodeClass::Tied, 1.0, 2.0),
        ball(NodeClass::Gliding, 25.0, 2.0),
    ];
    let rules = AttachmentRules { paint, ..AttachmentRules::default() };
    let heights = [-38.0, -20.0, 1.0, 25.0];
    let (found, AttachResult { attached, .. }) = attached(&heights, &jaws(plane(), Some(arch())), &rules);
    assert_eq!(found, [Free, Sliding, Tied(0), Gliding(0)]);
    assert_eq!(attached.painted, 4);
}

#[test]
fn tissue_is_moved_only_by_what_is_attached_to_a_moving_segment() {
    let bone = jaws(plane(), Some(arch()));
    let painted = |class| {
        let part = MaskRegion::Ball { centre: Point::new(0.0, -20.0, -20.0), radius_mm: 20.0 };
        let rules = AttachmentRules { paint: vec![Paint { class, part }], ..AttachmentRules::default() };
        // Two nodes at the moving lower block and one at the upper, which stays.
        let mut mesh = front(&[-20.0, -30.0, 30.0]);
        attach(&mut mesh, &bone, &[1], None, &rules);
        mesh
    };
    for (class, expected) in
        [(NodeClass::Tied, true), (NodeClass::Gliding, true), (NodeClass::Sliding, true), (NodeClass::Free, false)]
    {
        let mesh = painted(class);
        assert_eq!(is_moved(&mesh, &bone, &[1]), expected, "{class:?} {:?}", mesh.attachment);
    }
}

#[test]
fn nodes_take_the_class_of_the_nearest_painted_vertex_of_the_skull() {
    use Attachment::{Free, Tied};
    let positions = [-38.5, -20.0, 30.0, 60.0].map(|z| Point::new(0.0, -21.0, z)).to_vec();
    let classes = vec![Some(NodeClass::Free), None, Some(NodeClass::Free), Some(NodeClass::Free)];
    let rules = AttachmentRules { skull: Some(SkullPaint { positions, classes }), ..AttachmentRules::default() };
    let (found, AttachResult { attached, .. }) =
        attached(&[-38.0, -20.0, 30.0, 38.0], &jaws(plane(), Some(arch())), &rules);
    assert_eq!(found, [Free, Tied(1), Free, Tied(0)]);
    assert_eq!(attached.painted, 2);
}

/// Bone that moves is tied where a globe lies nearer to it than the skull that stays.
#[test]
fn only_nodes_at_a_globe_glide_on_it() {
    use Attachment::{Gliding, Tied};
    let far = DentalArch { front: Point::new(0.0, -20.0, 200.0), ..arch() };
    // A globe in front of the moving block touches the line of nodes at z = -32 only, and the skull begins at z = 0.4.
    let globe = Globe { center: Point::new(0.0, -26.5, -32.0), radius_mm: 6.0 };
    let bone = jaws(plane(), Some(far));
    let heights = [-39.0, -25.0];
    let expected = [Tied(1), Tied(1)];
    assert_eq!(attached(&heights, &bone, &AttachmentRules::default()).0, expected);
    assert_eq!(attached(&heights, &bone.with_globes(&[globe]), &AttachmentRules::default()).0, expected);
    let mut mesh = front(&heights);
    mesh.positions[0] = Point::new(0.0, -32.5, -32.0);
    attach(&mut mesh, &bone.with_globes(&[globe]), &[1], None, &AttachmentRules::default());
    assert_eq!(mesh.attachment, [Gliding(0), Tied(1)]);
    // Behind its equator tissue is tied to the globe.
    let behind = Globe { center: globe.center - 12.0 * Vector::y(), ..globe };
    let mut mesh = front(&heights);
    mesh.positions[0] = Point::new(0.0, -32.5, -32.0);
    attach(&mut mesh, &bone.with_globes(&[behind]), &[1], None, &AttachmentRules::default());
    assert_eq!(mesh.attachment, [Tied(0), Tied(1)]);
}
