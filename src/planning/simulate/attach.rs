//! Which inner nodes are tied to bone, slide on it or are free: by rule, then by painting.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::CutBone;
use super::tuning::{CROWN_MM, FREE_CUT_MM, PAINT_REACH_MM, SEAM_MM, STRIPPED_ABOVE_MM, STRIPPED_MM, TIE_GAP_MM};
use crate::evaluate::MaskRegion;
use crate::plan::{ASIDE_MM, CutShape, Segment};
use prosopon_geometry::{Aabb, Implicit, Point, Warning};
use prosopon_tissue::mesh::{Attachment, MixedMesh, tie};

/// Attachment of a node at bone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NodeClass {
    /// Moves with the nearest bone.
    Tied,
    /// Slides on bone.
    Sliding,
    /// Neither tied nor in contact.
    Free,
}

/// A class for all nodes at bone in a part of space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paint {
    /// The class.
    pub class: NodeClass,
    /// The part of space, LPS mm.
    pub part: MaskRegion,
}

/// Classes painted on the skull's vertices; a node at bone takes that of the nearest within 5 mm.
#[derive(Debug, Clone, PartialEq)]
pub struct SkullPaint {
    /// The vertices, LPS mm.
    pub positions: Vec<Point>,
    /// Class of each; `None` leaves the rule's.
    pub classes: Vec<Option<NodeClass>>,
}

/// Rules for which inner nodes are tied to bone and which slide.
///
/// Absent values follow the default rule: tissue is tied to bone wherever it touches bone, but slides on the teeth of moving
/// jaws, around the lower border of an upper jaw and around the occlusal plane of a lower jaw.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AttachmentRules {
    /// Boundary nodes nearer to bone than this at rest are tied, mm; 1.5 when absent.
    pub tie_gap_mm: Option<f64>,
    /// Boxes (LPS mm) in which nodes slide instead: teeth, inside of the lips.
    pub sliding: Option<Vec<Aabb>>,
    /// Classes painted on the skull; they override the rules.
    pub skull: Option<SkullPaint>,
    /// Classes for parts of space; they override all the above, and the last part that holds a node wins.
    pub paint: Vec<Paint>,
}

/// Numbers of nodes by attachment at the start of a solve.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Attached {
    /// Nodes tied to each segment.
    pub tied: BTreeMap<u32, usize>,
    /// Nodes that slide on bone.
    pub sliding: usize,
    /// Nodes that glide on each segment.
    pub gliding: BTreeMap<u32, usize>,
    /// Nodes at bone that are free.
    pub free_at_bone: usize,
    /// Nodes fixed where the mesh ends inside the tissue.
    pub fixed: usize,
    /// Of all these, nodes that were painted.
    pub painted: usize,
}

/// Type of jaw of a segment, from the names of its cuts.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Jaw {
    /// Teeth at its lower border; also for segments whose cuts have no names.
    Upper,
    /// Teeth at this z, mm.
    Lower(f64),
    /// A chin or a ramus: no teeth.
    Toothless,
}

fn jaw(bone: &CutBone, segment: &Segment) -> Jaw {
    let cuts = segment.bounded_by.iter().filter_map(|c| bone.osteotomy.cuts.get(*c));
    let named = |start: &str| cuts.clone().any(|c| c.name.as_deref().is_some_and(|n| n.starts_with(start)));
    let occlusal = cuts.clone().find_map(|c| match &c.shape {
        CutShape::Plane(plane) if c.name.as_deref() == Some("occlusal") => Some(plane.point.z),
        CutShape::Plane(_) | CutShape::Polyline { .. } | CutShape::Surface(_) | CutShape::FreePart(_) => None,
    });
    let is_below = occlusal.is_some_and(|z| segment.centroid.z < z);
    let middle = bone.osteotomy.segments.first().map_or(0.0, |s| s.surface.bounds().center().x);
    if named("bsso_") && (segment.centroid.x - middle).abs() > ASIDE_MM {
        Jaw::Toothless
    } else if named("bsso_") || named("joint_") || (is_below && !named("le_fort_")) {
        Jaw::Lower(occlusal.unwrap_or(segment.surface.bounds().max.z))
    } else if named("genioplasty") {
        Jaw::Toothless
    } else {
        Jaw::Upper
    }
}

/// The box around the teeth of a moving segment.
fn teeth(bone: &CutBone, segment: &Segment) -> Option<Aabb> {
    let b = segment.surface.bounds();
    let border = match jaw(bone, segment) {
        Jaw::Upper => b.min.z,
        Jaw::Lower(occlusal) => occlusal,
        Jaw::Toothless => return None,
    };
    let box_at =
        |p: Point, side: f64, z: f64| Point::new(p.x + side * CROWN_MM, p.y + side * CROWN_MM, z + side * CROWN_MM);
    Some(Aabb { min: box_at(b.min, -1.0, border), max: box_at(b.max, 1.0, border) })
}

/// Sets the attachment of the mesh's nodes for one osteotomy; `moving` are the segments that the plan moves.
///
/// Returns what was changed, and the numbers of nodes by attachment.
pub(super) fn attach(
    mesh: &mut MixedMesh,
    bone: &CutBone,
    moving: &[u32],
    rules: &AttachmentRules,
) -> (Vec<Warning>, Attached) {
    let segments = || bone.osteotomy.segments.iter().filter(|s| moving.contains(&s.id));
    let sliding = rules.sliding.clone().unwrap_or_else(|| segments().filter_map(|s| teeth(bone, s)).collect());
    let uppers: Vec<u32> = segments().filter(|s| jaw(bone, s) == Jaw::Upper).map(|s| s.id).collect();
    let near = Nearness { solids: bone.solids(), moving };
    tie(mesh, &near.solids, rules.tie_gap_mm.unwrap_or(TIE_GAP_MM), &sliding);
    let stripped = strip(mesh, &near, &sliding, &uppers);
    let seam = free_seams(mesh, &near);
    let inner = free_inner_cut(mesh, &near);
    let painted = painted(mesh, rules);
    let mut warnings = Vec::new();
    if stripped > 0 {
        let above = if uppers.is_empty() {
            String::new()
        } else {
            format!(", and within {STRIPPED_ABOVE_MM} mm of a moving upper jaw on the fixed bone above it")
        };
        let message = format!(
            "{stripped} nodes slide instead of being tied where periosteum is stripped: within {STRIPPED_MM} mm of a saw \
             line{above}"
        );
        warnings.push(Warning::info("stripped-nodes", message));
    }
    if seam > 0 {
        let message = format!(
            "{seam} nodes within {SEAM_MM} mm of a saw line are free: contact with the rims of the cuts is not modelled"
        );
        warnings.push(Warning::info("saw-line-nodes", message));
    }
    if inner > 0 {
        let message = format!("{inner} nodes of the inner cut within {FREE_CUT_MM} mm of moving bone are free");
        warnings.push(Warning::info("inner-cut-nodes", message));
    }
    if painted.is_empty() && (rules.skull.is_some() || !rules.paint.is_empty()) {
        let message = "the painted classes apply to no node: no node at bone lies where they were painted";
        warnings.push(Warning::check("paint-without-nodes", message).act("Paint where the tissue touches bone."));
    }
    for (node, class) in &painted {
        mesh.attachment[*node] = match class {
            NodeClass::Tied => nearest_segment(&near.solids, &mesh.positions[*node]),
            NodeClass::Sliding => Attachment::Sliding,
            NodeClass::Free => Attachment::Free,
        };
    }
    let attached = count(mesh, painted.len());
    (warnings, attached)
}

/// Distances to segments.
struct Nearness<'a> {
    solids: Vec<(u32, &'a dyn Implicit)>,
    moving: &'a [u32],
}

impl Nearness<'_> {
    fn moves(&self, segment: u32) -> bool {
        self.moving.contains(&segment)
    }

    /// Distance from `p` to the nearest segment that counts, mm; infinite when none counts.
    fn distance(&self, p: &Point, counts: impl Fn(u32) -> bool) -> f64 {
        let chosen = self.solids.iter().filter(|(id, _)| counts(*id));
        chosen.map(|(_, solid)| solid.value(p)).fold(f64::INFINITY, f64::min)
    }

    /// Whether `p` lies at two bones of which at least one moves.
    fn is_at_seam(&self, p: &Point) -> bool {
        let near: Vec<u32> =
            self.solids.iter().filter(|(_, solid)| solid.value(p) < SEAM_MM).map(|(id, _)| *id).collect();
        near.len() > 1 && near.iter().any(|id| self.moves(*id))
    }
}

/// Lets tied nodes slide where periosteum is stripped; returns their number.
fn strip(mesh: &mut MixedMesh, near: &Nearness<'_>, sliding: &[Aabb], uppers: &[u32]) -> usize {
    let mut stripped = 0;
    for (node, p) in mesh.positions.iter().enumerate() {
        let reach = match mesh.attachment[node] {
            Attachment::Tied(own) => {
                let is_above = !sliding.iter().any(|teeth| p.z < teeth.max.z);
                near.distance(p, |id| id != own && (near.moves(own) || near.moves(id))) < STRIPPED_MM
                    || (!near.moves(own) && is_above && near.distance(p, |id| uppers.contains(&id)) < STRIPPED_ABOVE_MM)
            }
            Attachment::Free | Attachment::Sliding | Attachment::Gliding(_) | Attachment::Fixed => false,
        };
        if reach {
            mesh.attachment[node] = Attachment::Sliding;
            stripped += 1;
        }
    }
    stripped
}

/// Frees sliding nodes at seams between two bones of which at least one moves; returns their number.
fn free_seams(mesh: &mut MixedMesh, near: &Nearness<'_>) -> usize {
    let mut seam = 0;
    for (node, p) in mesh.positions.iter().enumerate() {
        if mesh.attachment[node] == Attachment::Sliding && near.is_at_seam(p) {
            mesh.attachment[node] = Attachment::Free;
            seam += 1;
        }
    }
    seam
}

/// Frees fixed nodes where the mesh ends in depth near moving bone; returns their number.
fn free_inner_cut(mesh: &mut MixedMesh, near: &Nearness<'_>) -> usize {
    let mut freed = 0;
    for &node in &mesh.depth_cut_nodes {
        let node = node as usize;
        let is_near = || near.distance(&mesh.positions[node], |id| near.moves(id)) < FREE_CUT_MM;
        if mesh.attachment[node] == Attachment::Fixed && is_near() {
            mesh.attachment[node] = Attachment::Free;
            freed += 1;
        }
    }
    freed
}

/// Nodes of faces on bone that are not fixed, ascending.
fn at_bone(mesh: &MixedMesh) -> Vec<usize> {
    let mut nodes: Vec<usize> = mesh.bone_faces.iter().flatten().map(|n| *n as usize).collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes.retain(|n| mesh.attachment[*n] != Attachment::Fixed);
    nodes
}

/// Painted nodes with their class, ascending.
fn painted(mesh: &MixedMesh, rules: &AttachmentRules) -> Vec<(usize, NodeClass)> {
    if rules.skull.is_none() && rules.paint.is_empty() {
        return Vec::new();
    }
    let of_skull = |p: &Point| {
        let skull = rules.skull.as_ref()?;
        let off = skull.positions.iter().map(|q| (q - p).norm_squared()).enumerate();
        let (vertex, squared) = off.min_by(|a, b| a.1.total_cmp(&b.1))?;
        if squared > PAINT_REACH_MM * PAINT_REACH_MM { None } else { *skull.classes.get(vertex)? }
    };
    let of = |node: usize| {
        let p = &mesh.positions[node];
        let part = rules.paint.iter().rev().find(|paint| paint.part.contains(p)).map(|paint| paint.class);
        Some((node, part.or_else(|| of_skull(p))?))
    };
    at_bone(mesh).into_par_iter().filter_map(of).collect()
}

fn nearest_segment(solids: &[(u32, &dyn Implicit)], p: &Point) -> Attachment {
    let nearest = solids.iter().map(|(id, solid)| (solid.value(p), *id)).min_by(|a, b| a.0.total_cmp(&b.0));
    nearest.map_or(Attachment::Free, |(_, id)| Attachment::Tied(id))
}

fn count(mesh: &MixedMesh, painted: usize) -> Attached {
    let mut out = Attached { painted, ..Attached::default() };
    for attachment in &mesh.attachment {
        match attachment {
            Attachment::Tied(segment) => *out.tied.entry(*segment).or_insert(0) += 1,
            Attachment::Sliding => out.sliding += 1,
            Attachment::Gliding(segment) => *out.gliding.entry(*segment).or_insert(0) += 1,
            Attachment::Fixed => out.fixed += 1,
            Attachment::Free => {}
        }
    }
    out.free_at_bone = at_bone(mesh).into_iter().filter(|n| mesh.attachment[*n] == Attachment::Free).count();
    out
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::plan::{BoundedPlane, Cut, Osteotomy};
    use prosopon_field::{MethodSettings, SignedField};
    use prosopon_geometry::control::Control;
    use prosopon_geometry::{TriMesh, Vector};
    use prosopon_tissue::mesh::Tissue;

    fn block(low: [f64; 3], high: [f64; 3]) -> TriMesh {
        let corner = |i: usize| Point::from([0, 1, 2].map(|a| if i >> a & 1 == 1 { high[a] } else { low[a] }));
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        TriMesh::new((0..8).map(corner).collect(), triangles).unwrap()
    }

    /// A fixed upper block and a moving lower one, 1 mm apart at z = 0, parted by a cut of this name.
    fn jaws(cut: &str) -> CutBone {
        let plane = BoundedPlane { point: Point::origin(), normal: Vector::z(), bounds: None };
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
            segment(0, block([-20.0, -20.0, 0.5], [20.0, 20.0, 40.0])),
            segment(1, block([-20.0, -20.0, -40.0], [20.0, 20.0, -0.5])),
        ];
        let settings = MethodSettings::default().coarser(2.0);
        let field = |s: &Segment| Arc::new(SignedField::build_only(&s.surface, &settings, &Control::new()).unwrap().0);
        let fields = segments.iter().map(field).collect();
        let (cuts, warnings) = (vec![Cut::from(plane).named(cut)], Vec::new());
        let osteotomy = Osteotomy { cuts, segments, bone_mm3: 0.0, dropped_mm3: 0.0, warnings };
        CutBone { osteotomy: Arc::new(osteotomy), fields }
    }

    /// Nodes on the front of the blocks at these heights, all sliding at first.
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

    const HEIGHTS: [f64; 6] = [-38.0, -20.0, -7.5, 1.0, 11.0, 25.0];

    fn classes(cut: &str, rules: &AttachmentRules) -> (Vec<Attachment>, Attached) {
        let mut mesh = front(&HEIGHTS);
        let (_, attached) = attach(&mut mesh, &jaws(cut), &[1], rules);
        (mesh.attachment, attached)
    }

    #[test]
    fn a_lower_jaw_slides_at_its_teeth_and_holds_the_chin() {
        use Attachment::{Free, Sliding, Tied};
        let (found, attached) = classes("occlusal", &AttachmentRules::default());
        // Within 9 mm of the occlusal plane tissue slides, at the saw line it is free; the lower border is tied, so that it is
        // pulled back.
        assert_eq!(found, [Tied(1), Tied(1), Sliding, Free, Tied(0), Tied(0)]);
        assert_eq!((attached.tied[&1], attached.tied[&0], attached.sliding, attached.free_at_bone), (2, 2, 1, 1));
        // A chin has no teeth; what is left of its cut is stripped.
        let (found, _) = classes("genioplasty", &AttachmentRules::default());
        assert_eq!(found[..2], [Tied(1), Tied(1)]);
        // Of an upper jaw the teeth are at the lower border.
        let (found, _) = classes("le_fort_1", &AttachmentRules::default());
        assert_eq!(found[..2], [Sliding, Tied(1)]);
    }

    #[test]
    fn what_is_painted_goes_over_the_rules_and_the_last_one_wins() {
        use Attachment::{Free, Sliding, Tied};
        let ball = |class, z, radius_mm| Paint {
            class,
            part: MaskRegion::Ball { centre: Point::new(0.0, -20.0, z), radius_mm },
        };
        let paint = vec![
            ball(NodeClass::Free, -38.0, 30.0),
            ball(NodeClass::Sliding, -20.0, 5.0),
            ball(NodeClass::Tied, 1.0, 2.0),
        ];
        let rules = AttachmentRules { paint, ..AttachmentRules::default() };
        let (found, attached) = classes("occlusal", &rules);
        assert_eq!(found, [Free, Sliding, Sliding, Tied(0), Tied(0), Tied(0)]);
        assert_eq!(attached.painted, 3);
    }

    #[test]
    fn nodes_take_the_class_of_the_nearest_painted_vertex_of_the_skull() {
        use Attachment::{Free, Tied};
        let positions = [-38.5, -20.0, 11.0, 60.0].map(|z| Point::new(0.0, -21.0, z)).to_vec();
        let classes_of = vec![Some(NodeClass::Free), None, Some(NodeClass::Free), Some(NodeClass::Free)];
        let skull = Some(SkullPaint { positions, classes: classes_of });
        let (found, attached) = classes("occlusal", &AttachmentRules { skull, ..AttachmentRules::default() });
        assert_eq!([found[0], found[1], found[4], found[5]], [Free, Tied(1), Free, Tied(0)]);
        assert_eq!(attached.painted, 2);
    }
}
