//! Small domains with one difficulty each.

use super::domain::Region;
use super::test_domain::{Nothing, Shape, ellipsoid, smooth_union};
use super::{Domain, MeshSettings};
use prosopon_field::{DistanceField, EnvelopeSettings, FieldSettings, envelope};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Implicit, Point, TriMesh, Vector};

type Solid = Box<dyn Implicit>;

/// A domain to mesh, with what is known about its mesh.
pub(super) struct Case {
    pub(super) name: String,
    skin: Solid,
    bone: Solid,
    air: Option<Solid>,
    region: Region,
    pub(super) settings: MeshSettings,
    /// Volume of the tissue, mm³, where there is a formula.
    pub(super) volume_mm3: Option<f64>,
    pub(super) components: usize,
    /// Largest error of the volume, relative.
    pub(super) volume_error: f64,
    /// Largest share of nodes that lie inside cells of which they are no corner; no node hangs where it is 0.
    ///
    /// Cells overlap where tissue is thinner than the skin layer and half an edge: the layer below the skin is dropped to one
    /// surface, and tetrahedra that still have one of its lower nodes reach under the prisms. They also overlap in thin walls.
    pub(super) overlapping: f64,
}

impl Case {
    pub(super) fn domain(&self) -> Domain<'_> {
        Domain {
            skin: self.skin.as_ref(),
            bone: self.bone.as_ref(),
            air: self.air.as_deref(),
            soft_tissue: None,
            region: &self.region,
        }
    }

    fn new(name: impl Into<String>, skin: Solid, bone: Solid, half_size: [f64; 3]) -> Self {
        let half = Vector::from(half_size);
        let bounds = Aabb { min: Point::from(-half), max: Point::from(half) };
        Self {
            name: name.into(),
            skin,
            bone,
            air: None,
            region: Region { bounds, half_spaces: Vec::new() },
            settings: MeshSettings { depth_mm: 100.0, ..MeshSettings::default() },
            volume_mm3: None,
            components: 1,
            volume_error: 0.07,
            overlapping: 0.0,
        }
    }

    /// A block 44 mm wide, meshed from 4 mm above z = 0 down to z = -20.
    fn block(name: &str, skin: Solid, bone: Solid) -> Self {
        let mut case = Self::new(name, skin, bone, [22.0, 22.0, 20.0]);
        case.region.bounds.max.z = 4.0;
        case
    }

    fn with_edge(self, edge_mm: f64) -> Self {
        Self { settings: MeshSettings { edge_mm, ..self.settings }, ..self }
    }

    fn with_overlaps(self) -> Self {
        Self { overlapping: 0.025, ..self }
    }

    fn with_volume_error(self, volume_error: f64) -> Self {
        Self { volume_error, ..self }
    }
}

fn shape(value: impl Fn(&Point) -> f64 + Sync + 'static) -> Solid {
    Box::new(Shape(Box::new(value)))
}

/// The solid below `height(x, y)`; values are distances to first order.
fn below(height: impl Fn(f64, f64) -> f64 + Sync + 'static) -> Solid {
    shape(move |p| {
        let h = 1e-4;
        let slope_x = (height(p.x + h, p.y) - height(p.x - h, p.y)) / (2.0 * h);
        let slope_y = (height(p.x, p.y + h) - height(p.x, p.y - h)) / (2.0 * h);
        (p.z - height(p.x, p.y)) / (1.0 + slope_x * slope_x + slope_y * slope_y).sqrt()
    })
}

fn capsule(p: &Point, from: [f64; 3], to: [f64; 3], radius: f64) -> f64 {
    let (from, to) = (Point::from(from), Point::from(to));
    let along = to - from;
    let share = ((p - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    (p - (from + along * share)).norm() - radius
}

fn ball_volume(radius: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * radius.powi(3)
}

/// All cases whose solids are formulas.
pub(super) fn analytic() -> Vec<Case> {
    let mut cases = vec![
        bone_ball(),
        Case::block("folds", below(|x, y| 1.5 * (0.4 * x).cos() + 0.8 * (0.3 * y).sin()), below(|_, _| -15.0)),
        nostril(),
        // From bone that protrudes from the skin by half a millimetre to 6 mm of tissue.
        Case::block("wedge", below(|_, _| 0.0), below(|x, _| -0.148 * (x + 22.0) + 0.5))
            .with_overlaps()
            .with_volume_error(0.15),
        nearly_touching(),
        wing(),
        Case::block(
            "plate of bone with holes",
            below(|_, _| 0.0),
            shape(|p| {
                let holes = (p.x.hypot(p.y) - 6.0).min((p.x - 15.0).hypot(p.y) - 1.2);
                ((p.z + 9.0).abs() - 2.5).max(-holes)
            }),
        ),
        thin_bone(),
        hollow_bone(),
        airways(),
        islands(),
        oblique_cut(),
    ];
    let mut shallow = bone_ball();
    shallow.name = "cut at the depth limit".into();
    shallow.settings.depth_mm = 10.0;
    shallow.settings.edge_mm = 4.0;
    shallow.volume_mm3 = None;
    cases.push(shallow);
    cases
}

fn bone_ball() -> Case {
    let skin = shape(|p| ellipsoid(p, [0.0; 3], [30.0, 34.0, 38.0]));
    let bone = Shape::ball(Point::new(1.0, 2.0, 4.0), 21.0);
    let mut case = Case::new("ellipsoid with a ball of bone", skin, Box::new(bone), [33.0, 37.0, 41.0]).with_edge(5.0);
    case.volume_mm3 = Some(ball_volume(1.0) * 30.0 * 34.0 * 38.0 - ball_volume(21.0));
    case
}

/// A nose with a tube of 3 mm radius.
fn nostril() -> Case {
    let skin = shape(|p| {
        let nose = smooth_union(p.z, ellipsoid(p, [0.0; 3], [13.0, 13.0, 16.0]), 6.0);
        let tube = capsule(p, [0.0, -16.0, 6.0], [0.0, -2.0, 8.0], 3.0);
        -smooth_union(-nose, tube, 2.0)
    });
    let mut case = Case::block("nostril", skin, below(|_, _| -12.0));
    case.region.bounds.max.z = 22.0;
    case
}

/// Two lips with a gap of 0.8 mm, 8 mm deep.
fn nearly_touching() -> Case {
    let skin = shape(|p| {
        let gap = capsule(&Point::new(p.x, 0.0, p.z), [0.0, 0.0, -8.0], [0.0, 0.0, 12.0], 0.4);
        -smooth_union(-p.z, gap, 1.5)
    });
    Case::block("lips that nearly touch", skin, below(|_, _| -16.0))
}

/// A wing of skin 3.5 mm thick.
fn wing() -> Case {
    let skin = shape(|p| {
        let q = (p - Point::new(0.0, 0.0, 5.0)).abs() - Vector::new(0.05, 10.0, 6.0);
        let wing = q.sup(&Vector::zeros()).norm() + q.max().min(0.0) - 1.7;
        smooth_union(wing, p.z, 3.0)
    });
    let mut case = Case::block("wing", skin, below(|_, _| -12.0));
    case.region.bounds.max.z = 16.0;
    case.with_overlaps()
}

/// Bone 1 mm thick, 7 mm below the skin.
fn thin_bone() -> Case {
    let bone = shape(|p| (p.z + 7.5 - 0.1 * p.x).abs() / 1.01f64.sqrt() - 0.5);
    Case::block("thin bone", below(|_, _| 0.0), bone)
}

/// A bone with a hollow of 9 mm radius behind a hole of 1.5 mm, and tissue around it.
fn hollow_bone() -> Case {
    let bone = shape(|p| {
        let hole = if p.z > 0.0 { p.x.hypot(p.y) - 1.5 } else { p.coords.norm() - 1.5 };
        ((p.coords.norm() - 11.5).abs() - 2.5).max(-hole)
    });
    Case::new("hollow bone", Box::new(Shape::ball(Point::origin(), 26.0)), bone, [29.0; 3])
}

/// Two balls of air: 1 mm of tissue above one, none above the other.
fn airways() -> Case {
    let mut case = Case::block("air under the skin", below(|_, _| 0.0), below(|_, _| -16.0)).with_overlaps();
    case.air = Some(shape(|p| {
        let one = (p - Point::new(-11.0, 0.0, -8.0)).norm() - 7.0;
        one.min((p - Point::new(11.0, 0.0, -6.9)).norm() - 7.0)
    }));
    case
}

/// A large and a small ball of tissue.
fn islands() -> Case {
    let skin = shape(|p| {
        let large = (p - Point::new(-10.0, 0.0, 0.0)).norm() - 14.0;
        large.min((p - Point::new(16.0, 0.0, 0.0)).norm() - 8.0)
    });
    let mut case = Case::new("islands", skin, Box::new(Nothing), [27.0, 18.0, 18.0]);
    case.components = 2;
    case.volume_mm3 = Some(ball_volume(14.0) + ball_volume(8.0));
    case
}

/// A ball cut by two oblique planes.
fn oblique_cut() -> Case {
    let skin = Box::new(Shape::ball(Point::origin(), 26.0));
    let bone = Box::new(Shape::ball(Point::origin(), 14.0));
    let mut case = Case::new("oblique cuts", skin, bone, [29.0; 3]);
    let normals = [Vector::new(1.0, 0.4, 0.3), Vector::new(-0.2, 1.0, 0.6)];
    case.region.half_spaces = normals.map(|n| (Point::origin(), n.normalize())).to_vec();
    case
}

/// Heads of random size over random bone, with random settings.
pub(super) fn random(count: u64) -> Vec<Case> {
    let mut state = 42u64;
    let mut uniform = move |from: f64, to: f64| {
        // Knuth's constants of a linear congruential generator (MMIX).
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        from + (to - from) * (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut case = |number: u64| {
        let radii = [uniform(24.0, 34.0), uniform(24.0, 34.0), uniform(24.0, 34.0)];
        let share = uniform(0.5, 0.9);
        let centre = [uniform(-3.0, 3.0), uniform(-3.0, 3.0), uniform(-3.0, 3.0)];
        let bump = [uniform(-20.0, 20.0), -radii[1] + 2.0, uniform(-20.0, 20.0)];
        let size = uniform(5.0, 9.0);
        let skin = shape(move |p| {
            smooth_union(ellipsoid(p, [0.0; 3], radii), ellipsoid(p, bump, [size, 1.2 * size, size]), 5.0)
        });
        let bone = shape(move |p| ellipsoid(p, centre, radii.map(|r| share * r)));
        let mut case = Case::new(format!("random head {number}"), skin, bone, [40.0, 46.0, 40.0]);
        case.region.bounds.max.y = uniform(0.0, 10.0);
        case.settings.edge_mm = uniform(4.0, 7.0);
        case.settings.skin_thickness_mm = uniform(0.8, 2.5);
        case.settings.depth_mm = uniform(18.0, 40.0).max(case.settings.least_depth_mm());
        let thinnest = (0..3).map(|a| (1.0 - share) * radii[a] - f64::abs(centre[a])).fold(f64::INFINITY, f64::min);
        if thinnest < case.settings.skin_thickness_mm + 0.6 * case.settings.edge_mm {
            case.with_overlaps()
        } else {
            case
        }
    };
    (0..count).map(&mut case).collect()
}

/// Defects of a skull's triangles, 48 a row.
const DIRT: [(&str, fn(usize) -> Dirt); 3] = [
    ("doubled and inverted", |t| match t % 9 {
        0 | 4 => Dirt::Double,
        7 => Dirt::Invert,
        _ => Dirt::Keep,
    }),
    // The larger hole is 20 mm wide and 14 mm high.
    ("with holes", |t| {
        let hole = (5..8).contains(&(t / 48)) && (24..34).contains(&(t % 48));
        if hole || t % 29 == 0 { Dirt::Drop } else { Dirt::Keep }
    }),
    ("doubled, inverted and with holes", |t| match t % 13 {
        0 | 1 => Dirt::Double,
        4 => Dirt::Invert,
        7 => Dirt::Drop,
        _ => Dirt::Keep,
    }),
];

#[derive(Clone, Copy)]
enum Dirt {
    Keep,
    Double,
    Invert,
    Drop,
}

/// Tissue over a skull of triangles with defects, seen by its own field and by that of its envelope.
pub(super) fn dirty() -> Vec<Case> {
    let field = FieldSettings { spacing_mm: 1.5, band_mm: 4.0, margin_mm: 6.0 };
    let mut cases = Vec::new();
    for (name, dirt) in DIRT {
        let skull = dirty_skull(dirt);
        let control = Control::new();
        let own = DistanceField::build(&skull, &field, &control).unwrap().0;
        let enveloped = envelope(&skull, &EnvelopeSettings::default(), &control).unwrap();
        let closed = DistanceField::build(&enveloped.surface, &field, &control).unwrap().0;
        for (field, kind) in [(own, "own field"), (closed, "field of the envelope")] {
            let skin = shape(|p| ellipsoid(p, [0.0, -1.0, 0.0], [24.0, 27.0, 30.0]));
            let name = format!("bone {name}, {kind}");
            let mut case = Case::new(name, skin, Box::new(field), [27.0, 31.0, 33.0]);
            case.region.bounds.max.y = 8.0;
            cases.push(case.with_edge(5.0));
        }
    }
    cases
}

/// Ellipsoid of 18, 20 and 24 mm, in 24 by 16 quadrilaterals.
fn dirty_skull(dirt: fn(usize) -> Dirt) -> TriMesh {
    const AROUND: u32 = 24;
    const ALONG: u32 = 16;
    let at = |i: u32, j: u32| {
        let (longitude, latitude) =
            (15f64.to_radians() * f64::from(i), (f64::from(j) / f64::from(ALONG)) * std::f64::consts::PI);
        Point::new(
            18.0 * latitude.sin() * longitude.cos(),
            20.0 * latitude.sin() * longitude.sin(),
            24.0 * latitude.cos(),
        )
    };
    let positions: Vec<Point> = (0..=ALONG).flat_map(|j| (0..AROUND).map(move |i| at(i, j))).collect();
    let node = |i: u32, j: u32| (i % AROUND) + AROUND * j;
    let mut clean: Vec<[u32; 3]> = Vec::new();
    for j in 0..ALONG {
        for i in 0..AROUND {
            let [a, b, c, d] = [node(i, j), node(i, j + 1), node(i + 1, j + 1), node(i + 1, j)];
            clean.extend([[a, b, c], [a, c, d]]);
        }
    }
    // At the poles one triangle of each quadrilateral has no area.
    let triangles = clean.iter().enumerate().flat_map(|(t, &[a, b, c])| match dirt(t) {
        Dirt::Keep => vec![[a, b, c]],
        Dirt::Double => vec![[a, b, c], [a, b, c]],
        Dirt::Invert => vec![[a, c, b]],
        Dirt::Drop => Vec::new(),
    });
    TriMesh::new(positions.clone(), triangles.collect()).unwrap()
}
