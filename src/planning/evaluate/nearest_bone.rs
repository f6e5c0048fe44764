//! The simplest prediction: skin that follows a share of the nearest bone.

use super::EvaluateError;
use super::distance::Surface;
use super::smoothing::Neighbourhoods;
use super::tuning::{BONE_SHARE, SMOOTHED_MM};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, TriMesh, Vector};

/// A segment of bone and its motion from rest; the skull has the identity.
#[derive(Debug, Clone, Copy)]
pub struct MovedBone<'a> {
    /// Closed surface at rest, LPS mm.
    pub surface: &'a TriMesh,
    /// Motion from rest.
    pub motion: Motion,
}

/// Displacement of each vertex of `skin` (at rest) at 0.7 of the nearest bone, mm; `None` without bone.
///
/// For each vertex `x`, let `c(x)` be the closest point at rest of all segments and `M` the motion of its segment. The vertex
/// moves by `0.7 (M c - c)`, averaged over a neighbourhood of the skin with a standard deviation of 5 mm, so that skin between
/// two segments does not tear. A segment that does not move, the skull among them, holds its skin.
///
/// # Errors
/// [`EvaluateError::Input`] when a surface is not usable; [`EvaluateError::Cancelled`].
pub fn nearest_bone_displacement(
    skin: &TriMesh,
    bones: &[MovedBone<'_>],
    control: &Control,
) -> Result<Option<Vec<Vector>>, EvaluateError> {
    let n = skin.positions().len();
    let mut nearest = vec![(f64::INFINITY, Vector::zeros()); n];
    for bone in bones {
        let hits = Surface::new(bone.surface)?.all_nearest(skin.positions(), control)?;
        for (best, hit) in nearest.iter_mut().zip(hits) {
            if hit.signed.abs() < best.0 {
                *best = (hit.signed.abs(), (bone.motion * hit.point - hit.point) * BONE_SHARE);
            }
        }
    }
    if bones.is_empty() {
        return Ok(None);
    }
    let around = Neighbourhoods::new(skin, SMOOTHED_MM);
    let [x, y, z] = [0, 1, 2].map(|axis| {
        let along: Vec<f32> = nearest.iter().map(|(_, u)| u[axis] as f32).collect();
        around.averaged(&along)
    });
    let vectors = x.into_iter().zip(y).zip(z).map(|((x, y), z)| Vector::new(x.into(), y.into(), z.into()));
    Ok(Some(vectors.collect()))
}

/// The bone that carries `p`: the one in which it lies deepest, or else the closest one.
pub(super) struct BoneAt<'a> {
    bones: Vec<(Surface, &'a MovedBone<'a>)>,
}

impl<'a> BoneAt<'a> {
    pub(super) fn new(bones: &'a [MovedBone<'a>]) -> Result<Self, EvaluateError> {
        let bones = bones.iter().map(|bone| Ok((Surface::new(bone.surface)?, bone)));
        Ok(Self { bones: bones.collect::<Result<_, EvaluateError>>()? })
    }

    /// Motion of that bone, and the distance of `p` from it, mm; negative inside. `None` without bone.
    pub(super) fn at(&self, p: &Point) -> Option<(Motion, f64)> {
        let depth = |(surface, bone): &(Surface, &MovedBone<'_>)| (bone.motion, surface.nearest(p).signed);
        self.bones.iter().map(depth).min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A closed box, triangles counter-clockwise seen from outside.
    pub(in crate::evaluate) fn block(min: [f64; 3], max: [f64; 3]) -> TriMesh {
        let end = |i: u32, a: usize| if i >> a & 1 == 1 { max[a] } else { min[a] };
        let corner = |i: u32| Point::new(end(i, 0), end(i, 1), end(i, 2));
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        TriMesh::new((0..8).map(corner).collect(), triangles).unwrap()
    }

    /// A square of skin of 60 mm in front of the blocks, facing -y, with vertices 2 mm apart.
    fn sheet() -> TriMesh {
        let side = 31usize;
        let node = |i: usize, j: usize| (i + side * j) as u32;
        let places = (0..side * side).map(|n| (n % side, n / side));
        let positions = places.map(|(i, j)| Point::new(2.0 * i as f64 - 30.0, -20.0, 2.0 * j as f64 - 30.0)).collect();
        let cells = (0..side - 1).flat_map(|j| (0..side - 1).map(move |i| (i, j)));
        let triangles = cells.flat_map(|(i, j)| {
            let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
            [[a, b, c], [a, c, d]]
        });
        TriMesh::new(positions, triangles.collect()).unwrap()
    }

    /// Single precision of values of 7 mm.
    const ROUNDING_MM: f64 = 1e-5;

    #[test]
    fn skin_follows_a_bone_that_moves_as_one_by_seven_tenths() {
        let (bone, skin) = (block([-40.0, -5.0, -40.0], [40.0, 30.0, 40.0]), sheet());
        let moved = [MovedBone { surface: &bone, motion: Motion::translation(0.0, -10.0, 0.0) }];
        let u = nearest_bone_displacement(&skin, &moved, &Control::new()).unwrap().unwrap();
        for u in u {
            assert!((u - Vector::new(0.0, -7.0, 0.0)).norm() < ROUNDING_MM, "{u}");
        }
        assert_eq!(nearest_bone_displacement(&skin, &[], &Control::new()).unwrap(), None);
    }

    #[test]
    fn each_side_follows_its_own_bone_and_the_step_between_is_smooth() {
        let upper = block([-40.0, -5.0, 0.0], [40.0, 30.0, 40.0]);
        let lower = block([-40.0, -5.0, -40.0], [40.0, 30.0, 0.0]);
        let skin = sheet();
        let bones = [
            MovedBone { surface: &upper, motion: Motion::translation(0.0, -10.0, 0.0) },
            MovedBone { surface: &lower, motion: Motion::identity() },
        ];
        let u = nearest_bone_displacement(&skin, &bones, &Control::new()).unwrap().unwrap();
        let at = |z: f64| {
            let near = skin.positions().iter().zip(&u).filter(|(p, _)| (p.z - z).abs() < 0.1 && p.x.abs() < 11.0);
            let forward: Vec<f64> = near.map(|(_, u)| -u.y).collect();
            forward.iter().sum::<f64>() / forward.len() as f64
        };
        // A step averaged by a Gaussian of 5 mm: 7 Φ(s / 5). Vertices at z = 0 are as near to both bones and follow the first,
        // so the step lies half a row below, at z = -1. The averaging is a walk on the mesh whose variance is exact on
        // equilateral triangles only, and the border of the sheet is 30 mm away: 5 % of the step.
        let normal = |s: f64| 0.5 * (1.0 + (0.797_884_6 * (s + 0.044_715 * s.powi(3))).tanh());
        for z in [-20.0, -10.0, -4.0, 4.0, 10.0, 20.0] {
            assert!((at(z) - 7.0 * normal((z + 1.0) / 5.0)).abs() < 0.35, "{z}: {}", at(z));
        }
        assert!(at(20.0) > 6.9 && at(-20.0) < 0.1);
    }

    #[test]
    fn a_turned_bone_gives_the_displacement_of_its_closest_point() {
        let bone = block([-40.0, -5.0, -40.0], [40.0, 30.0, 40.0]);
        let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vector::x_axis(), 0.1);
        let motion = Motion::rotation_wrt_point(turn, Point::origin());
        let skin = sheet();
        let u = nearest_bone_displacement(&skin, &[MovedBone { surface: &bone, motion }], &Control::new());
        let u = u.unwrap().unwrap();
        for (p, u) in skin.positions().iter().zip(&u).filter(|(p, _)| p.x.abs() < 11.0 && p.z.abs() < 11.0) {
            // The closest point lies straight behind, at y = -5; a linear field is its own average, away from the border by
            // nearly four standard deviations.
            let c = Point::new(p.x, -5.0, p.z);
            let exact = (motion * c - c) * 0.7;
            assert!((u - exact).norm() < 0.01, "{p}: {u} {exact}");
        }
    }

    #[test]
    fn a_point_is_carried_by_the_bone_that_holds_it() {
        let upper = block([-40.0, -5.0, 0.0], [40.0, 30.0, 40.0]);
        let lower = block([-40.0, -5.0, -40.0], [40.0, 30.0, -1.0]);
        let bones = [
            MovedBone { surface: &upper, motion: Motion::translation(0.0, -10.0, 0.0) },
            MovedBone { surface: &lower, motion: Motion::translation(0.0, 4.0, 0.0) },
        ];
        let at = BoneAt::new(&bones).unwrap();
        let forward = |z: f64| at.at(&Point::new(0.0, -5.5, z)).map(|(m, _)| -m.translation.vector.y);
        assert_eq!((forward(3.0), forward(-3.0)), (Some(10.0), Some(-4.0)));
        assert!(BoneAt::new(&[]).unwrap().at(&Point::origin()).is_none());
    }
}
