//! Rigid registration of two surfaces.

use nalgebra::{Translation3, UnitQuaternion};

use super::distance::Surface;
use super::plausible::plausible;
use super::point_to_plane::{Pair, Row, solve, stiffness};
use super::smoothing::Neighbourhoods;
use super::statistics::vertex_areas;
use super::tuning::{
    ALIGNED_MM, ALIGNED_SHARE, COARSE_ITERATIONS, COARSE_POINTS, FINE_POINTS, GOOD_MM, ITERATIONS, MATCH_MM,
    MIN_AREA_MM2, MIN_OVERLAP, MIN_STIFFNESS, MIN_VERTICES, NEARLY_STILL_MM, NEARLY_STILL_SHARE, SHAPE_MM, SHAPE_SHARE,
    START_APART_MM, START_CAP_MM, START_TURN, STILL_MM, TRIM, TRIM_FLOOR_MM, WARN_MOVEMENT_MM, WARN_OVERLAP,
};
use super::{EvaluateError, RegistrationFault};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, TriMesh, Vector, Warning};

/// A rigid motion that aligns one surface with another, with measures of its quality.
#[derive(Debug, Clone, PartialEq)]
pub struct Registration {
    /// Motion `target_from_source`, mm.
    pub motion: Motion,
    /// Number of iterations of the fine run.
    pub iterations: usize,
    /// Number of source vertices in the region used for the registration.
    pub vertices: usize,
    /// Root mean square distance of the kept pairs along the normals, weighted by area, mm.
    pub residual_mm: f64,
    /// Median distance of all pairs of the region, mm.
    pub median_mm: f64,
    /// Share of the region's area whose pairs are kept, 0 to 1.
    pub overlap: f64,
    /// How well the region's shape determines the motion, 0 to 1.
    /// This is the stiffness of the softest rigid motion over that of the stiffest. 0 means that the
    /// region slides along itself, like a plane or a ball. Rotations are measured at the region's radius.
    pub stiffness: f64,
    /// Doubts about the registration.
    pub warnings: Vec<Warning>,
}

/// Registers `source` to `target` by trimmed point-to-plane ICP over the `unaltered` vertices.
///
/// `unaltered` has one entry per source vertex; `None` selects all.
///
/// Coarse runs choose the start among the present position, rotations of 8° about each axis in both senses and, where the
/// centroids are far apart, the aligned centroids. Each run first aligns the nearest 60 % of the pairs, so that a third of the
/// region may have changed. It then keeps all pairs nearer than 2.5 robust standard deviations (1.4826 times the median
/// distance). Pairs on the target's open border are never kept. All pairs are weighted by the source's area.
///
/// # Errors
/// [`EvaluateError::Registration`] when the region is too small, its shape does not determine the motion, too few pairs are
/// left, the iteration does not converge, or the surfaces do not match. [`EvaluateError::Input`] for a mask of the wrong length
/// and for surfaces in different units. [`EvaluateError::Cancelled`] on cancellation.
///
/// # Examples
/// A skin sampled from the phantom and moved by 3 mm is brought back.
/// ```
/// use prosopon_geometry::control::Control;
/// use prosopon_geometry::{Motion, Vector};
/// use prosopon_planning::{evaluate::register, phantom};
///
/// let head = phantom::head();
/// let skin = phantom::surface_of(head.skin.as_ref(), &head.bounds(), 8.0).ok_or("the box holds no skin")?;
/// let shift = Vector::new(2.0, -2.0, 1.0);
/// let found = register(&skin.moved(&Motion::translation(2.0, -2.0, 1.0)), &skin, None, &Control::new())?;
/// assert!((found.motion.translation.vector + shift).norm() < 0.1);
/// assert!(found.motion.rotation.angle() < 1e-3 && found.overlap > 0.5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Source
/// Chen & Medioni, Object modelling by registration of multiple range images, 1992; Chetverikov, Stepanov & Krsek, Robust
/// Euclidean alignment of 3D point sets: the trimmed iterative closest point algorithm, 2005. The stiffness is that of Gelfand,
/// Ikemoto, Rusinkiewicz & Levoy, Geometrically stable sampling for the ICP algorithm, 2003.
pub fn register(
    source: &TriMesh,
    target: &TriMesh,
    unaltered: Option<&[bool]>,
    control: &Control,
) -> Result<Registration, EvaluateError> {
    let mut warnings = plausible(source, target)?;
    let region = Region::of(source, unaltered)?;
    let stiffness = region.stiffness();
    if stiffness < MIN_STIFFNESS {
        return Err(RegistrationFault::ShapeUndetermined { stiffness, allowed: MIN_STIFFNESS }.into());
    }
    let surface = Surface::new(target)?;
    let coarse = region.thinned(COARSE_POINTS);
    let start = best_start(&coarse, &surface, &starts(&region, target), control)?;
    let fine = region.thinned(FINE_POINTS);
    let found = fitted(&fine, &surface, start, ITERATIONS, &control.stage(0.5, 1.0))?;
    let mirrored = || mirror_fits(&coarse, &surface, found.motion, control);
    refuse(&found, &mirrored)?;
    warnings.extend(doubts(&found, &mirrored)?);
    control.report(1.0);
    Ok(Registration {
        motion: found.motion,
        iterations: found.iterations,
        vertices: region.vertices.len(),
        residual_mm: found.residual_mm,
        median_mm: found.median_mm,
        overlap: found.overlap,
        stiffness,
        warnings,
    })
}

/// Refuses a fine run whose surfaces do not match or that did not converge.
fn refuse(found: &Fitted, mirrored: &dyn Fn() -> Result<bool, EvaluateError>) -> Result<(), EvaluateError> {
    if found.median_mm > MATCH_MM || found.overlap < MIN_OVERLAP {
        let (median_mm, overlap) = (found.median_mm, found.overlap);
        return Err(
            RegistrationFault::NoMatch { median_mm, allowed_mm: MATCH_MM, overlap, mirrored: mirrored()? }.into()
        );
    }
    if !found.converged {
        let (iterations, movement_mm) = (found.iterations, found.movement_mm);
        return Err(RegistrationFault::NotConverged { iterations, movement_mm, mirrored: mirrored()? }.into());
    }
    Ok(())
}

/// Warnings about a fine run that was not refused.
fn doubts(found: &Fitted, mirrored: &dyn Fn() -> Result<bool, EvaluateError>) -> Result<Vec<Warning>, EvaluateError> {
    let action = "Check the region and the registered surfaces.";
    let mut warnings = Vec::new();
    if found.movement_mm > WARN_MOVEMENT_MM {
        let message = format!(
            "the registration did not converge fully: after {} iterations points still oscillate by {:.3} mm",
            found.iterations, found.movement_mm
        );
        warnings.push(Warning::check("registration-oscillates", message).act(action));
    }
    if found.median_mm > GOOD_MM {
        let message = format!("after registration half of the region is still over {:.1} mm off", found.median_mm);
        warnings.push(Warning::check("registration-far", message).act(action));
    }
    if found.overlap < WARN_OVERLAP {
        let message = format!("only {:.0} % of the region's area matches the other surface", 100.0 * found.overlap);
        warnings.push(Warning::check("registration-overlap", message).act(action));
    }
    if (found.median_mm > GOOD_MM || found.overlap < WARN_OVERLAP) && mirrored()? {
        let message = "the mirror image of the surface fits better";
        let action = "Check whether one surface is mirrored.";
        warnings.push(Warning::unreliable("registration-mirrored", message).act(action));
    }
    Ok(warnings)
}

/// Sample points of the source.
struct Points(Vec<Sample>);

/// A source point with the area it represents and the surface normal there, averaged over the neighbourhood of the stiffness.
/// The normals of single triangles of a scan are noisy, and the noise would make a round head appear to resist rotation.
#[derive(Clone, Copy)]
struct Sample {
    point: Point,
    weight: f64,
    normal: Vector,
}

/// The part of the source used for the registration.
struct Region {
    vertices: Vec<usize>,
    points: Points,
}

impl Region {
    fn of(source: &TriMesh, unaltered: Option<&[bool]>) -> Result<Self, EvaluateError> {
        let n = source.positions().len();
        if let Some(mask) = unaltered
            && mask.len() != n
        {
            let detail = format!("the mask has {} entries but the surface has {n} vertices", mask.len());
            return Err(EvaluateError::Input { detail });
        }
        let areas = vertex_areas(source);
        // Vertices without triangles carry no area.
        let chosen = |v: &usize| unaltered.is_none_or(|m| m[*v]) && areas[*v] > 0.0;
        let vertices: Vec<usize> = (0..n).filter(chosen).collect();
        let radius_mm = SHAPE_MM.min(SHAPE_SHARE * source.bounds().diagonal());
        let normals = Neighbourhoods::new(source, radius_mm).normals(source);
        let sample = |v: &usize| Sample { point: source.positions()[*v], weight: areas[*v], normal: normals[*v] };
        let points: Vec<Sample> = vertices.iter().map(sample).collect();
        let area_mm2 = points.iter().map(|p| p.weight).sum::<f64>() + 0.0;
        if vertices.len() < MIN_VERTICES || area_mm2 < MIN_AREA_MM2 {
            let vertices = vertices.len();
            let (min_vertices, min_area_mm2) = (MIN_VERTICES, MIN_AREA_MM2);
            return Err(RegistrationFault::RegionTooSmall { vertices, area_mm2, min_vertices, min_area_mm2 }.into());
        }
        Ok(Self { vertices, points: Points(points) })
    }

    /// About `count` of the points, picked evenly by index.
    fn thinned(&self, count: usize) -> Points {
        Points(self.points.0.iter().copied().step_by(self.points.0.len().div_ceil(count)).collect())
    }

    fn stiffness(&self) -> f64 {
        let row = |s: &Sample| Row { point: s.point, normal: s.normal, weight: s.weight };
        stiffness(&self.points.0.iter().map(row).collect::<Vec<_>>())
    }
}

/// Start positions of the coarse runs.
fn starts(region: &Region, target: &TriMesh) -> Vec<Motion> {
    let middle = |points: &mut dyn Iterator<Item = (Point, f64)>| {
        let (sum, total) = points.fold((Vector::zeros(), 0.0), |(s, t), (p, w)| (s + p.coords * w, t + w));
        Point::from(sum / f64::max(total, f64::MIN_POSITIVE))
    };
    let own = middle(&mut region.points.0.iter().map(|s| (s.point, s.weight)));
    let other = middle(&mut target.positions().iter().copied().zip(vertex_areas(target)));
    let mut starts = vec![Motion::identity()];
    if (other - own).norm() > START_APART_MM {
        starts.push(Motion::from_parts(Translation3::from(other - own), UnitQuaternion::identity()));
    }
    for axis in [Vector::x(), Vector::y(), Vector::z()] {
        for turn in [START_TURN, -START_TURN] {
            let rotation = UnitQuaternion::from_scaled_axis(axis * turn);
            let shift = own.coords - rotation * own.coords;
            starts.push(Motion::from_parts(Translation3::from(shift), rotation));
        }
    }
    starts
}

/// The start whose coarse run ends with the smallest distance; the first one of equals.
fn best_start(
    points: &Points,
    surface: &Surface,
    starts: &[Motion],
    control: &Control,
) -> Result<Motion, EvaluateError> {
    let mut best: Option<(f64, Motion)> = None;
    for (i, start) in starts.iter().enumerate() {
        control.report(0.5 * i as f64 / starts.len() as f64);
        let found = match fitted(points, surface, *start, COARSE_ITERATIONS, &control.stage(0.0, 0.0)) {
            Ok(found) => found,
            // This start has no usable pairs; another may have.
            Err(EvaluateError::Registration(_)) => continue,
            Err(other) => return Err(other),
        };
        let score = distance(points, surface, &found.motion, control)?;
        if best.is_none_or(|(least, _)| score < least) {
            best = Some((score, found.motion));
        }
    }
    // If every start failed, the fine run reports the reason.
    Ok(best.map_or_else(Motion::identity, |b| b.1))
}

/// Mean distance of the moved points to the surface; distances are capped, and points beyond the border count as far.
fn distance(points: &Points, surface: &Surface, motion: &Motion, control: &Control) -> Result<f64, EvaluateError> {
    let moved: Vec<Point> = points.0.iter().map(|s| motion * s.point).collect();
    let hits = surface.all_nearest(&moved, control)?;
    let size =
        |hit: &super::distance::Nearest| if hit.on_border { START_CAP_MM } else { hit.signed.abs().min(START_CAP_MM) };
    let (sum, total) =
        hits.iter().zip(&points.0).fold((0.0, 0.0), |(s, t), (hit, p)| (s + p.weight * size(hit), t + p.weight));
    Ok(sum / total)
}

/// Whether the source's mirror image fits at least twice as well.
fn mirror_fits(points: &Points, surface: &Surface, motion: Motion, control: &Control) -> Result<bool, EvaluateError> {
    let as_is = distance(points, surface, &motion, control)?;
    let middle = points.0.iter().map(|s| s.point.x).sum::<f64>() / points.0.len() as f64;
    let turn = |s: &Sample| Sample {
        point: Point::new(2.0 * middle - s.point.x, s.point.y, s.point.z),
        normal: Vector::new(-s.normal.x, s.normal.y, s.normal.z),
        ..*s
    };
    let turned = Points(points.0.iter().map(turn).collect());
    match fitted(&turned, surface, motion, COARSE_ITERATIONS, &control.stage(0.0, 0.0)) {
        Ok(found) => Ok(distance(&turned, surface, &found.motion, control)? < 0.5 * as_is),
        Err(EvaluateError::Registration(_)) => Ok(false),
        Err(other) => Err(other),
    }
}

/// State of a registration run.
struct Fitted {
    motion: Motion,
    iterations: usize,
    /// Whether the iteration converged, and the largest movement of a point in the last iteration.
    converged: bool,
    movement_mm: f64,
    residual_mm: f64,
    median_mm: f64,
    overlap: f64,
}

fn fitted(
    points: &Points,
    surface: &Surface,
    start: Motion,
    iterations: usize,
    control: &Control,
) -> Result<Fitted, EvaluateError> {
    let all: f64 = points.0.iter().map(|s| s.weight).sum();
    let mut found = Fitted {
        motion: start,
        iterations: 0,
        converged: false,
        movement_mm: f64::INFINITY,
        residual_mm: f64::INFINITY,
        median_mm: f64::INFINITY,
        overlap: 0.0,
    };
    let mut aligned = false;
    for iteration in 0..iterations {
        control.check()?;
        control.report(iteration as f64 / iterations as f64);
        let pairs = pairs(points, surface, &found.motion, control)?;
        let mut sizes: Vec<f64> = pairs.iter().map(|p| p.gap.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        found.median_mm = sizes.get(sizes.len() / 2).copied().unwrap_or(f64::INFINITY);
        let nearest = sizes.get((ALIGNED_SHARE * sizes.len() as f64) as usize).copied().unwrap_or(f64::INFINITY);
        let limit = if aligned { TRIM * 1.4826 * found.median_mm } else { nearest }.max(TRIM_FLOOR_MM);
        let kept: Vec<Pair> = pairs.into_iter().filter(|p| p.gap.abs() <= limit).collect();
        let weight: f64 = kept.iter().map(|p| p.row.weight).sum();
        found.overlap = weight / all;
        found.residual_mm =
            (kept.iter().map(|p| p.row.weight * p.gap * p.gap).sum::<f64>() / weight.max(f64::MIN_POSITIVE)).sqrt();
        let step = solve(&kept)?;
        found.motion = step.motion * found.motion;
        (found.movement_mm, found.iterations) = (step.movement_mm, iteration + 1);
        if aligned && step.movement_mm < STILL_MM {
            break;
        }
        aligned |= step.movement_mm < ALIGNED_MM;
    }
    found.converged = aligned && found.movement_mm <= NEARLY_STILL_MM.max(NEARLY_STILL_SHARE * found.residual_mm);
    Ok(found)
}

/// Moved points with their closest points, without those on the border.
fn pairs(points: &Points, surface: &Surface, motion: &Motion, control: &Control) -> Result<Vec<Pair>, EvaluateError> {
    let moved: Vec<Point> = points.0.iter().map(|s| motion * s.point).collect();
    let hits = surface.all_nearest(&moved, control)?;
    let pair = |((point, hit), sample): ((&Point, &super::distance::Nearest), &Sample)| {
        let normal = motion * sample.normal;
        let row = Row { point: *point, normal, weight: sample.weight };
        (!hit.on_border).then(|| Pair { row, gap: normal.dot(&(point - hit.point)) })
    };
    Ok(moved.iter().zip(&hits).zip(&points.0).filter_map(pair).collect())
}
