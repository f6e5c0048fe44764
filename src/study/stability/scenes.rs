//! The hard scenes: blocks of fat under skin, meshed as coarsely as the tissue of a head.

use std::f64::consts::PI;
use std::sync::Arc;

use super::bodies::{Floor, Plate, Table, ball, together};
use super::lips::lips;
use crate::error::BenchError;
use crate::slab::{Slab, attach};
use prosopon_field::{MethodSettings, SignedField};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Motion, Point, Vector};
use prosopon_tissue::fem::material::{D1Reading, Material, Materials};
use prosopon_tissue::fem::{Boundary, UnstableMaterial};
use prosopon_tissue::mesh::{Attachment, MixedMesh};

/// Edge length of the cells, mm, as in the mesh of a head.
const EDGE_MM: f64 = 4.0;
/// The block of most scenes.
const BLOCK: Slab = Slab { cells: [12, 12, 3], size_mm: [48.0, 48.0, 12.0], skin_mm: 1.5 };
/// The block of the homogeneous states.
const CUBE: Slab = Slab { cells: [4, 4, 3], size_mm: [16.0, 16.0, 12.0], skin_mm: 1.5 };
const CUBE_HEIGHT_MM: f64 = 13.5;
/// Shortening in the homogeneous states, as a share of the height.
const SHORTENED: f64 = 0.3;

/// Motions of the segments at a path parameter.
pub(super) type BonePath = Arc<dyn Fn(f64) -> Vec<(u32, Motion)> + Send + Sync>;

/// Everything that a solve needs except the method.
#[derive(Clone)]
pub(super) struct Setup {
    pub(super) mesh: MixedMesh,
    pub(super) boundary: Boundary,
    pub(super) bodies: Vec<(u32, Arc<dyn Implicit + Send>)>,
    pub(super) materials: Materials,
    pub(super) path: BonePath,
    pub(super) steps: usize,
    pub(super) contact_stiffness_factor: f64,
    pub(super) penetration_mm: f64,
    pub(super) unstable_material: UnstableMaterial,
}

/// Reference for the results of a scene.
pub(super) enum Check {
    /// A closed form of the displacement.
    Exact(Box<dyn Fn(&Point) -> Vector + Send + Sync>),
    /// A modified copy of the scene with the same solution, solved in finer steps and to a tighter tolerance.
    Other(Box<dyn Fn(&mut Setup) + Send + Sync>),
    /// This scene with the locking-free formulation on the given slab, whose edges are half as long.
    Refined(Slab),
}

/// A hard scene.
pub(super) struct HardScene {
    pub(super) name: String,
    /// Length of the bone's path, mm; errors give their position on it.
    pub(super) length_mm: f64,
    pub(super) setup: Setup,
    pub(super) check: Check,
    /// Largest difference from the check on the skin at which a result counts as converged, mm.
    pub(super) within_mm: f64,
}

/// Allowed difference without contact, mm.
///
/// The solver limits a node's last Newton step to 2.5e-4 of the edge length, 1e-3 mm here; this leaves a factor of ten.
const SOLVER_MM: f64 = 0.01;
/// Allowed difference with contact, mm: twice the largest remaining penetration.
const CONTACT_MM: f64 = 0.1;

fn up(mm: f64) -> BonePath {
    Arc::new(move |t| vec![(1, Motion::translation(0.0, 0.0, mm * t))])
}

fn setup(mesh: MixedMesh, path: BonePath) -> Setup {
    Setup {
        mesh,
        boundary: Boundary::default(),
        bodies: Vec::new(),
        materials: Materials::wang2009_stable(),
        path,
        steps: 1,
        contact_stiffness_factor: 1.0,
        penetration_mm: 0.05,
        unstable_material: UnstableMaterial::Report,
    }
}

/// The block, with the patch in the middle of its bottom moved along `path`.
fn pulled(path: BonePath) -> Setup {
    setup(BLOCK.over_a_patch(10.0, 16.0), path)
}

/// The block, sliding on `body`, which moves up.
fn pushed(body: Arc<dyn Implicit + Send>, mm: f64) -> Setup {
    let mut mesh = BLOCK.over_a_patch(-1.0, 16.0);
    for (p, a) in mesh.positions.iter().zip(&mut mesh.attachment) {
        if p.z == 0.0 && *a == Attachment::Free {
            *a = Attachment::Sliding;
        }
    }
    Setup { bodies: vec![(1, body)], ..setup(mesh, up(mm)) }
}

fn in_finer_steps(setup: &mut Setup) {
    setup.steps = 10;
    setup.penetration_mm = setup.penetration_mm.min(0.005);
}

fn scene(name: impl Into<String>, length_mm: f64, setup: Setup, check: Check, within_mm: f64) -> HardScene {
    HardScene { name: name.into(), length_mm, setup, check, within_mm }
}

fn other(change: impl Fn(&mut Setup) + Send + Sync + 'static) -> Check {
    Check::Other(Box::new(move |setup| {
        in_finer_steps(setup);
        change(setup);
    }))
}

/// All hard scenes.
pub(super) fn all() -> Result<Vec<HardScene>, BenchError> {
    let mut scenes = vec![
        scene("push of 12 mm in one step", 12.0, pulled(up(12.0)), other(|_| {}), SOLVER_MM),
        twisted(),
        turned(),
        confined("30 % shorter, confined", 1.0),
        confined("30 % shorter, slivers of 1 : 200", 0.005),
        between_plates(),
    ];
    scenes.extend([0.49, 0.499, 0.4999].map(nearly_incompressible));
    scenes.extend([1e-3, 1e3, 1e6].into_iter().map(stiff_contact).collect::<Result<Vec<_>, _>>()?);
    scenes.push(thin_bone());
    scenes.extend(dirty_bones()?);
    scenes.extend(moved_lips());
    scenes.push(glided());
    for (name, reading) in [
        ("Poisson ratio", D1Reading::PoissonRatio),
        ("2/K in 1/MPa", D1Reading::PerMpa),
        ("2/K in mm²/gf", D1Reading::Mm2PerGf),
    ] {
        scenes.push(published(name, reading, UnstableMaterial::Report));
    }
    scenes.push(published("Poisson ratio, stabilised", D1Reading::PoissonRatio, UnstableMaterial::Stabilise));
    Ok(scenes)
}

/// Tissue glides on a plate that is drawn 10 mm aside under it, so that the plate's edge passes below tissue that it holds.
fn glided() -> HardScene {
    let plate = Plate { half_width_mm: 14.0, thickness_mm: 12.0, edge_radius_mm: 3.0 };
    let mut mesh = BLOCK.over_a_patch(-1.0, 16.0);
    for (p, a) in mesh.positions.iter().zip(&mut mesh.attachment) {
        if p.z == 0.0 && p.x.abs().max(p.y.abs()) < 10.0 {
            *a = Attachment::Gliding(1);
        }
    }
    let path: BonePath = Arc::new(|t| vec![(1, Motion::translation(10.0 * t, 0.0, 1.0 * t))]);
    let setup = Setup { bodies: vec![(1, Arc::new(plate))], ..setup(mesh, path) };
    scene("gliding over an edge, 10 mm", 10.0, setup, other(|_| {}), CONTACT_MM)
}

/// The patch turns about the vertical axis.
fn twisted() -> HardScene {
    let path: BonePath = Arc::new(|t| vec![(1, Motion::rotation(Vector::z() * (t * PI / 3.0)))]);
    scene("patch turned by 60° in one step", 10.5, pulled(path), other(|_| {}), SOLVER_MM)
}

/// A free block that is tied to a turning bone: it turns with the bone, without stress.
fn turned() -> HardScene {
    let at = |t: f64| Motion::rotation(Vector::x() * (t * PI / 3.0));
    let mut mesh = BLOCK.mesh();
    attach(&mut mesh, |p| if p.z == 0.0 { Attachment::Tied(1) } else { Attachment::Free });
    let exact = move |p: &Point| at(1.0) * p - p;
    let setup = setup(mesh, Arc::new(move |t| vec![(1, at(t))]));
    scene("whole turned by 60° in one step", 25.0, setup, Check::Exact(Box::new(exact)), SOLVER_MM)
}

/// A homogeneous block between walls is shortened; the height of its lowest layer of cells is scaled by `flat`.
fn confined(name: &str, flat: f64) -> HardScene {
    let mut mesh = CUBE.mesh();
    for p in &mut mesh.positions {
        if p.z == EDGE_MM {
            p.z *= flat;
        }
    }
    attach(&mut mesh, |p| match p.z {
        0.0 => Attachment::Fixed,
        z if z > CUBE_HEIGHT_MM - 1e-6 => Attachment::Tied(1),
        _ => Attachment::Free,
    });
    let side = |c: f64| c.abs() > 8.0 - 1e-6;
    let walls = mesh.positions.iter().map(|p| u8::from(side(p.x)) + 2 * u8::from(side(p.y))).collect();
    let setup = Setup {
        boundary: Boundary { held_axes: walls, ..Boundary::default() },
        materials: Materials::homogeneous(Materials::wang2009_stable().fat),
        ..setup(mesh, up(-SHORTENED * CUBE_HEIGHT_MM))
    };
    let exact = |p: &Point| Vector::new(0.0, 0.0, -SHORTENED * p.z);
    scene(name, SHORTENED * CUBE_HEIGHT_MM, setup, Check::Exact(Box::new(exact)), SOLVER_MM)
}

/// A homogeneous block is shortened between a smooth floor, which rises, and a smooth ceiling.
fn between_plates() -> HardScene {
    let mut mesh = CUBE.mesh();
    attach(&mut mesh, |p| if p.z == 0.0 { Attachment::Sliding } else { Attachment::Free });
    let held = |p: &Point| {
        u8::from(p.x < -8.0 + 1e-6) + 2 * u8::from(p.y < -8.0 + 1e-6) + 4 * u8::from(p.z > CUBE_HEIGHT_MM - 1e-6)
    };
    let held_axes = mesh.positions.iter().map(held).collect();
    let material = Materials::wang2009_stable().fat;
    let wider = lateral_stretch(&material, 1.0 - SHORTENED) - 1.0;
    let setup = Setup {
        boundary: Boundary { held_axes, ..Boundary::default() },
        bodies: vec![(1, Arc::new(Floor))],
        materials: Materials::homogeneous(material),
        penetration_mm: 0.005,
        ..setup(mesh, up(SHORTENED * CUBE_HEIGHT_MM))
    };
    let exact =
        move |p: &Point| Vector::new(wider * (p.x + 8.0), wider * (p.y + 8.0), SHORTENED * (CUBE_HEIGHT_MM - p.z));
    let check = Check::Exact(Box::new(exact));
    scene("30 % shorter between plates, contact", SHORTENED * CUBE_HEIGHT_MM, setup, check, 2.0 * SOLVER_MM)
}

/// Lateral stretch of a bar of `material` under uniaxial stress with the axial stretch `along`, by bisection.
fn lateral_stretch(material: &Material, along: f64) -> f64 {
    let stress = |across: f64| {
        let f = nalgebra::Matrix3::from_diagonal(&Vector::new(across, across, along));
        material.first_piola(&f).map_or(f64::NAN, |p| p[(0, 0)])
    };
    let (mut low, mut high) = (0.5, 2.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if stress(middle) > 0.0 { high = middle } else { low = middle }
    }
    0.5 * (low + high)
}

fn nearly_incompressible(poisson: f64) -> HardScene {
    let with = |m: Material| Material::neo_hookean(m.shear_modulus(), poisson);
    let own = Materials::wang2009_stable();
    let (skin, fat) = (with(own.skin), with(own.fat));
    let setup =
        Setup { materials: Materials { skin, fat, muscle: fat, mucosa: fat, cartilage: fat }, ..pulled(up(4.0)) };
    let finer = Slab { cells: BLOCK.cells.map(|n| 2 * n), ..BLOCK };
    // Allows for the discretisation error of 4 mm cells over a patch of 16 mm: an eighth of the movement.
    scene(format!("Poisson ratio {poisson}"), 4.0, setup, Check::Refined(finer), 0.5)
}

const BALL_RADIUS_MM: f64 = 14.0;

/// The distance field of the surfaces that `change` returns.
fn ball_field(change: impl Fn() -> Vec<(Vec<Point>, Vec<[u32; 3]>)>) -> Result<Arc<SignedField>, BenchError> {
    let surface = together(change()).ok_or_else(|| BenchError::Head { detail: "invalid ball".to_owned() })?;
    let (field, ..) = SignedField::build_only(&surface, &MethodSettings::default(), &Control::new())
        .map_err(|source| BenchError::Field { method: "adaptive", source })?;
    Ok(Arc::new(field))
}

fn clean_ball() -> Result<Arc<SignedField>, BenchError> {
    ball_field(|| vec![ball(Point::origin(), BALL_RADIUS_MM, PI)])
}

fn stiff_contact(factor: f64) -> Result<HardScene, BenchError> {
    let setup = Setup { contact_stiffness_factor: factor, ..pushed(clean_ball()?, 5.0) };
    let check = other(|s| s.contact_stiffness_factor = 1.0);
    Ok(scene(format!("contact stiffness times {factor:e}"), 5.0, setup, check, CONTACT_MM))
}

/// A plate of 1 mm; its check is the same plate on a stem, through which tissue cannot pass.
///
/// The stem is narrower than the plate, so that tissue can still bulge below the rim.
fn thin_bone() -> HardScene {
    let plate = |half_width_mm: f64, thickness_mm: f64| Plate { half_width_mm, thickness_mm, edge_radius_mm: 0.5 };
    let thin = || plate(12.0, 1.0);
    let held = Arc::new(Table { top: thin(), stem: plate(10.0, 20.0) });
    let check = other(move |s| s.bodies = vec![(1, held.clone())]);
    scene("bone of 1 mm, 8 mm in one step", 8.0, pushed(Arc::new(thin()), 8.0), check, CONTACT_MM)
}

fn dirty_bones() -> Result<Vec<HardScene>, BenchError> {
    let clean = clean_ball()?;
    let open = ball_field(|| vec![ball(Point::origin(), BALL_RADIUS_MM, 0.75 * PI)])?;
    // Smaller balls cross its wall below the top, and its cap is duplicated.
    let crossed = ball_field(|| {
        let side = |x: f64| ball(Point::new(x, 0.0, -4.0), 8.0, PI);
        vec![
            ball(Point::origin(), BALL_RADIUS_MM, PI),
            side(5.0),
            side(-5.0),
            ball(Point::origin(), BALL_RADIUS_MM, 0.2 * PI),
        ]
    })?;
    let of = |name: &str, field: Arc<SignedField>| {
        let clean = clean.clone();
        let check = other(move |s: &mut Setup| s.bodies = vec![(1, clean.clone())]);
        scene(name, 5.0, pushed(field, 5.0), check, CONTACT_MM)
    };
    Ok(vec![of("open bone", open), of("self-intersecting bone", crossed)])
}

/// Lips that are pressed together by 30 % of their height, opened by 10 mm, and sheared by 10 mm under half of that pressure.
fn moved_lips() -> Vec<HardScene> {
    let lower = Slab { cells: [8, 8, 3], size_mm: [32.0, 32.0, 12.0], skin_mm: 1.5 };
    let pressed = -2.0 * SHORTENED * (lower.size_mm[2] + lower.skin_mm);
    let scene_of = |name: &str, length_mm: f64, path: BonePath| {
        scene(name, length_mm, setup(lips(&lower), path), other(|_| {}), CONTACT_MM)
    };
    let sheared: BonePath = Arc::new(move |t| {
        let down = 0.5 * pressed * (2.0 * t).min(1.0);
        vec![(1, Motion::translation(10.0 * (2.0 * t - 1.0).max(0.0), 0.0, down))]
    });
    vec![
        scene_of("lips pressed together by 30 %", -pressed, up(pressed)),
        scene_of("lips opened by 10 mm", 10.0, up(10.0)),
        scene_of("lips sheared by 10 mm under pressure", 10.0 - 0.5 * pressed, sheared),
    ]
}

fn published(name: &str, reading: D1Reading, unstable_material: UnstableMaterial) -> HardScene {
    let setup =
        Setup { materials: Materials::wang2009_reading(reading), steps: 10, unstable_material, ..pulled(up(5.0)) };
    let check = other(move |s| {
        if s.unstable_material == UnstableMaterial::Stabilise {
            s.materials = Materials::wang2009_stable();
            s.unstable_material = UnstableMaterial::Report;
        }
    });
    scene(format!("published constants, D1 as {name}"), 5.0, setup, check, SOLVER_MM)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At small strain the lateral strain is -nu times the axial strain.
    #[test]
    fn a_bar_grows_wider_as_its_poisson_ratio_says() {
        let material = Material::neo_hookean(0.01, 0.45);
        assert!(((lateral_stretch(&material, 1.0 - 1e-5) - 1.0) / 1e-5 - 0.45).abs() < 1e-3);
    }
}
