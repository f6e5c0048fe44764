use std::io::Write;
use std::path::Path;

use nalgebra::{Matrix3, Rotation3, SymmetricEigen};
use rayon::prelude::*;

use super::error::{BenchError, write};
use super::files::{read_surface, refuse_unwritable};
use prosopon_field::{ExactDistance, FieldSettings, Method, MethodSettings, SignedField};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Point, TriMesh, Vector};

/// Number of contacts.
const CONTACTS: usize = 20_000;
/// Largest depth of the anchors in bone, mm.
const DEEPEST_MM: f64 = 3.0;
/// Stiffness of the spring along its three axes, whose orientation is random.
const SPRING: [f64; 3] = [0.05, 0.3, 1.0];
/// Stiffness of the penalty.
const PENALTY: f64 = 100.0;
/// Largest number of Newton steps.
const MOST_STEPS: usize = 50;
/// Largest number of halvings of a step.
const MOST_HALVINGS: usize = 40;
/// A contact has converged when its force is below this share of the penalty force at 1 mm.
const SMALL_FORCE: f64 = 1e-8;
/// Below this depth, mm, the tangent omits the curvature term, so that a step leads to the surface (Gauss-Newton).
const CURVED_MM: f64 = 0.2;
/// Lower bound on the eigenvalues of the tangent.
const LEAST_EIGENVALUE: f64 = 1e-3;
/// A step must lower the energy by this share of the decrease that its slope predicts (Armijo).
const ARMIJO: f64 = 1e-4;
/// Samples along the edge of the bounding cube for the trilinear grid.
const RESOLUTION: u32 = 256;

/// Tests whether the value, gradient and Hessian of a distance field suit Newton's method.
///
/// A spring holds each point inside bone and a penalty pushes it out. The study minimises the energy
/// `(x - a)ᵀ K (x - a) / 2 + κ min(d(x), 0)² / 2` from x = a, for one distance field after another. The spring K is anisotropic like tissue; with an
/// isotropic spring the path would simply be the straight line to the closest point. The tangent is the Hessian of the
/// energy, with the signs of negative eigenvalues reversed and without the curvature term at large depth. Steps are halved
/// until the energy decreases.
#[derive(Debug)]
pub struct ContactStudy<'a> {
    /// Surface of bone.
    pub mesh: &'a Path,
    /// Where the rows go.
    pub csv: &'a Path,
}

/// Rest position of a point and the stiffness of its spring.
#[derive(Debug, Clone, Copy)]
struct Anchor {
    point: Point,
    spring: Matrix3<f64>,
}

/// Convergence of a set of contacts.
#[derive(Debug, Clone, Copy, Default)]
struct Ended {
    converged: usize,
    /// Total steps of the converged contacts.
    steps: usize,
    most_steps: usize,
}

impl ContactStudy<'_> {
    /// Runs the study; prints to `out`.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        refuse_unwritable(self.csv)?;
        let bone = read_surface(self.mesh)?;
        let exact = ExactDistance::new(&bone);
        let anchors = anchors(&bone, &exact);
        writeln!(out, "{} anchors up to {DEEPEST_MM} mm deep, penalty {PENALTY}, spring {SPRING:?}", anchors.len())?;
        let mut rows = vec![("closest point".to_owned(), solve_all(&anchors, &ByClosestPoint(&exact)))];
        for (method, resolution) in [(Method::Uniform, Some(RESOLUTION)), (Method::Adaptive, None)] {
            let settings = MethodSettings { method, resolution, ..MethodSettings::default() };
            let field = SignedField::build_only(&bone, &settings, &Control::new())
                .map_err(|source| BenchError::Field { method: method.name(), source })?
                .0;
            rows.push((method.name().to_owned(), solve_all(&anchors, &field)));
        }
        // The spacing of the fields that the solver uses for contact.
        let settings = FieldSettings { spacing_mm: 1.6, ..FieldSettings::default() };
        let settings = MethodSettings { field: settings, ..MethodSettings::default() };
        let field = SignedField::build_only(&bone, &settings, &Control::new())
            .map_err(|source| BenchError::Field { method: "adaptive", source })?
            .0;
        rows.push(("adaptive at 1.6 mm".to_owned(), solve_all(&anchors, &field)));
        let mut csv = String::from("field,contacts,converged_percent,mean_steps,most_steps\n");
        for (name, ended) in rows {
            let percent = 100.0 * ended.converged as f64 / anchors.len().max(1) as f64;
            let mean = ended.steps as f64 / ended.converged.max(1) as f64;
            csv += &format!("{name},{},{percent:.3},{mean:.2},{}\n", anchors.len(), ended.most_steps);
        }
        write!(out, "{csv}")?;
        write(self.csv, csv.as_bytes())?;
        writeln!(out, "wrote {}", self.csv.display())?;
        Ok(())
    }
}

/// Points inside the bone, below random points of its surface.
fn anchors(bone: &TriMesh, exact: &ExactDistance) -> Vec<Anchor> {
    let mut sums = Vec::with_capacity(bone.triangles().len());
    let mut area = 0.0;
    for t in 0..bone.triangles().len() {
        area += 0.5 * bone.scaled_normal(t).norm();
        sums.push(area);
    }
    let mut state = 1u64;
    let mut unit = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut anchors = Vec::with_capacity(CONTACTS);
    // A point below a thin wall may be outside again; a surface that encloses nothing gives no points at all.
    for _ in 0..20 * CONTACTS {
        let wanted = unit() * area;
        let t = sums.partition_point(|s| *s < wanted).min(sums.len().saturating_sub(1));
        let [a, b, c] = bone.corners(t);
        let (u, v) = (unit(), unit());
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let depth = DEEPEST_MM * unit();
        let Some(normal) = bone.scaled_normal(t).try_normalize(0.0) else { continue };
        let p = a + (b - a) * u + (c - a) * v - normal * depth;
        if exact.signed(&p) < 0.0 {
            let axis = Vector::new(unit() - 0.5, unit() - 0.5, unit() - 0.5);
            let turn =
                Rotation3::new(axis.try_normalize(0.0).unwrap_or_else(Vector::x) * (std::f64::consts::TAU * unit()));
            let spring = turn * Matrix3::from_diagonal(&SPRING.into()) * turn.transpose();
            anchors.push(Anchor { point: p, spring });
            if anchors.len() == CONTACTS {
                break;
            }
        }
    }
    anchors
}

fn solve_all(anchors: &[Anchor], field: &dyn Implicit) -> Ended {
    let steps: Vec<Option<usize>> = anchors.par_iter().map(|a| solve(a, field)).collect();
    steps.into_iter().flatten().fold(Ended::default(), |ended, steps| Ended {
        converged: ended.converged + 1,
        steps: ended.steps + steps,
        most_steps: ended.most_steps.max(steps),
    })
}

/// Number of Newton steps to convergence; `None` when the contact does not converge.
fn solve(anchor: &Anchor, field: &dyn Implicit) -> Option<usize> {
    let energy = |x: &Point| {
        let (value, gradient) = field.value_gradient(x);
        let gap = value.min(0.0);
        let offset = x - anchor.point;
        let pull = anchor.spring * offset;
        let force = if gap < 0.0 { pull + PENALTY * gap * gradient } else { pull };
        (0.5 * offset.dot(&pull) + 0.5 * PENALTY * gap * gap, force, gap, gradient)
    };
    let mut x = anchor.point;
    let mut now = energy(&x);
    for step in 0..=MOST_STEPS {
        let (value, force, gap, gradient) = now;
        if force.norm() < SMALL_FORCE * PENALTY {
            return Some(step);
        }
        let mut tangent = anchor.spring;
        if gap < 0.0 {
            tangent += PENALTY * gradient * gradient.transpose();
        }
        if (-CURVED_MM..0.0).contains(&gap) {
            tangent += PENALTY * gap * field.hessian(&x);
        }
        let direction = descent(tangent, &force);
        let slope = direction.dot(&force);
        let mut share = 1.0;
        let mut next = energy(&(x + direction));
        for _ in 0..MOST_HALVINGS {
            // The tolerance accepts round-off of the energy as a decrease.
            if next.0 <= value + ARMIJO * share * slope + 1e-15 * (1.0 + value) {
                break;
            }
            share *= 0.5;
            next = energy(&(x + direction * share));
        }
        x += direction * share;
        now = next;
    }
    None
}

/// Newton direction with the absolute eigenvalues of the tangent, raised to the lower bound where they are too small.
fn descent(tangent: Matrix3<f64>, force: &Vector) -> Vector {
    let eigen = SymmetricEigen::new(tangent);
    let mut direction = Vector::zeros();
    for n in 0..3 {
        let axis = eigen.eigenvectors.column(n);
        direction -= axis * (axis.dot(force) / eigen.eigenvalues[n].abs().max(LEAST_EIGENVALUE));
    }
    direction
}

/// The exact distance; its gradient jumps across the medial axis, and its Hessian is set to zero, that of a plane.
struct ByClosestPoint<'a>(&'a ExactDistance);

impl Implicit for ByClosestPoint<'_> {
    fn value(&self, p: &Point) -> f64 {
        self.0.signed(p)
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let (closest, ..) = self.0.closest(p);
        let value = self.0.signed(p);
        let gradient = (p - closest).try_normalize(1e-12).unwrap_or_else(Vector::zeros);
        (value, if value < 0.0 { -gradient } else { gradient })
    }

    fn hessian(&self, _: &Point) -> Matrix3<f64> {
        Matrix3::zeros()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A half-space of bone below z = 0.
    struct HalfSpace;

    impl Implicit for HalfSpace {
        fn value(&self, p: &Point) -> f64 {
            p.z
        }

        fn value_gradient(&self, p: &Point) -> (f64, Vector) {
            (p.z, Vector::z())
        }
    }

    #[test]
    fn a_plane_is_solved_in_one_step_and_nowhere_where_the_gradient_lies() {
        let at = |x, y, z| Anchor { point: Point::new(x, y, z), spring: Matrix3::from_diagonal(&SPRING.into()) };
        assert_eq!(solve(&at(1.0, 2.0, -3.0), &HalfSpace), Some(1));
        assert_eq!(solve(&at(1.0, 2.0, 3.0), &HalfSpace), Some(0));
        struct Wrong;
        impl Implicit for Wrong {
            fn value(&self, p: &Point) -> f64 {
                p.z
            }
            fn value_gradient(&self, p: &Point) -> (f64, Vector) {
                (p.z, -Vector::z())
            }
        }
        assert_eq!(solve(&at(0.0, 0.0, -1.0), &Wrong), None);
    }
}
