//! Chooses the cubes of the lattice that are refined and the thickness of prisms in thin walls.
//! Cubes are refined where tissue between two sheets of skin is thin, as in the wings of the nose, and where thin bone lies near
//! the skin.

use rayon::prelude::*;

use super::domain::{Foot, InnerTissue};
use super::lattice::Lattice;
use super::tuning::{
    MIN_WALL_PRISM_MM, PIERCED_EDGES, RESOLVED_WALL_EDGES, THICKNESS_SLOPE, THIN_BONE_DEPTH_EDGES, WALL_MIDDLE_EDGES,
    WALL_PRISM_SHARE,
};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, ScalarGrid};

/// Vertices handled between two checks for cancellation.
const CHUNK: usize = 1024;

/// Refinement that thin walls require.
#[derive(Debug, Clone)]
pub(super) struct RefinementMarks {
    /// Thickness of the skin layer, mm; `None` where it is the same everywhere.
    pub(super) thickness: Option<ScalarGrid>,
    /// Whether each cube of the lattice is refined.
    pub(super) refined: Vec<bool>,
}

/// Measures walls at the lattice's vertices near the skin, and searches for thin bone along the lattice's edges.
pub(super) fn mark_refinement(
    inner: &InnerTissue<'_>,
    lattice: &Lattice,
    control: &Control,
) -> Result<RefinementMarks, Cancelled> {
    let n = lattice.vertex_count();
    let thin = 2.0 * inner.thickness + RESOLVED_WALL_EDGES * inner.edge;
    let mut walls = vec![f64::INFINITY; n];
    walls.par_chunks_mut(CHUNK).enumerate().try_for_each(|(chunk, out)| {
        control.check()?;
        for (i, wall) in out.iter_mut().enumerate() {
            *wall = wall_near(inner, &lattice.position(chunk * CHUNK + i), thin).unwrap_or(f64::INFINITY);
        }
        Ok(())
    })?;
    let mut refined = vec![false; lattice.cube_count()];
    let mut any = false;
    for (vertex, _) in walls.iter().enumerate().filter(|(_, w)| w.is_finite()) {
        for cube in lattice.cubes_at(vertex) {
            refined[cube] = true;
            any = true;
        }
    }
    for cube in pierced(inner, lattice, control)? {
        refined[cube] = true;
    }
    if !any {
        return Ok(RefinementMarks { thickness: None, refined });
    }
    let mut grid = lattice.corner_grid(inner.thickness as f32);
    let corners = grid.values.len();
    for (vertex, wall) in walls.iter().enumerate().filter(|(_, w)| w.is_finite()) {
        let allowed =
            (WALL_PRISM_SHARE * wall).min(0.5 * (wall - WALL_MIDDLE_EDGES * inner.edge)).max(MIN_WALL_PRISM_MM) as f32;
        let mut lower = |corner: usize| grid.values[corner] = grid.values[corner].min(allowed);
        if vertex < corners {
            lower(vertex);
        } else {
            lattice.corners_of_centre(vertex).for_each(lower);
        }
    }
    soften(&mut grid);
    Ok(RefinementMarks { thickness: Some(grid), refined })
}

/// Cubes around edges that pass through thin bone or air near the skin.
fn pierced(inner: &InnerTissue<'_>, lattice: &Lattice, control: &Control) -> Result<Vec<usize>, Cancelled> {
    let n = lattice.vertex_count();
    let mut inside = vec![false; n];
    inside.par_chunks_mut(CHUNK).enumerate().try_for_each(|(chunk, out)| {
        control.check()?;
        for (i, inside) in out.iter_mut().enumerate() {
            *inside = inner.value_side(&lattice.position(chunk * CHUNK + i)).0 < 0.0;
        }
        Ok(())
    })?;
    let through = |v: usize, u: usize| {
        let middle = nalgebra::center(&lattice.position(v), &lattice.position(u));
        inner.value_side(&middle).0 > PIERCED_EDGES * inner.edge
            && inner.domain.skin.value(&middle) > -THIN_BONE_DEPTH_EDGES * inner.edge
    };
    let found: Result<Vec<Vec<usize>>, Cancelled> = (0..n.div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            control.check()?;
            let mut cubes = Vec::new();
            for v in (chunk * CHUNK..((chunk + 1) * CHUNK).min(n)).filter(|v| inside[*v]) {
                for u in lattice.neighbours_above(v).filter(|u| inside[*u] && through(v, *u)) {
                    cubes.extend(lattice.cubes_at_edge(v, u));
                }
            }
            Ok(cubes)
        })
        .collect();
    Ok(found?.into_iter().flatten().collect())
}

/// Thickness of the wall under the skin nearest to `p`; `None` unless it is below `press` and `p` lies within an edge of the
/// skin.
fn wall_near(inner: &InnerTissue<'_>, p: &Point, thin: f64) -> Option<f64> {
    if inner.domain.region.value_gradient(p).0 > inner.edge || inner.domain.skin.value(p).abs() > inner.edge {
        return None;
    }
    let foot = inner.foot(p, 2.0 * inner.edge)?;
    wall_below(inner, &foot, thin)
}

/// Distance from a foot straight inwards to the next crossing of the skin, mm; `None` beyond `reach`.
fn wall_below(inner: &InnerTissue<'_>, foot: &Foot, reach: f64) -> Option<f64> {
    let at = |s: f64| inner.domain.skin.value(&(foot.point - foot.normal * s));
    // The start lies beyond the roughness of the skin.
    let mut s = 0.1 * inner.edge;
    while s < reach {
        let value = at(s);
        if value >= 0.0 {
            return Some(s);
        }
        s += (0.8 * -value).max(0.04 * inner.edge);
    }
    None
}

/// Lowers values until no two neighbours differ by more than [`THICKNESS_SLOPE`] times their distance.
fn soften(grid: &mut ScalarGrid) {
    let step = (THICKNESS_SLOPE * grid.spacing) as f32;
    let dims = grid.dims;
    let strides = [1, dims[0], dims[0] * dims[1]];
    // Each pair is adjusted in both directions, so one sweep carries changes far along the sweep's direction.
    loop {
        let mut changed = false;
        for index in 0..grid.values.len() {
            for axis in 0..3 {
                if index / strides[axis] % dims[axis] + 1 == dims[axis] {
                    continue;
                }
                let other = index + strides[axis];
                let (a, b) = (grid.values[index], grid.values[other]);
                if a > b + step {
                    grid.values[index] = b + step;
                    changed = true;
                } else if b > a + step {
                    grid.values[other] = a + step;
                    changed = true;
                }
            }
        }
        if !changed {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::domain::{Domain, MeshSettings, Region};
    use super::super::test_domain::{Nothing, Shape};
    use super::*;
    use prosopon_geometry::Aabb;

    /// A plate of skin `wall` mm thick on a thick block.
    fn marked(wall: f64) -> (RefinementMarks, Lattice) {
        let skin = Shape(Box::new(move |p| {
            let plate = (p.x.abs() - 0.5 * wall).max(p.z.abs() - 20.0).max(p.y.abs() - 20.0);
            plate.min((p.x.abs() - 25.0).max((p.z + 30.0).abs() - 15.0).max(p.y.abs() - 20.0))
        }));
        let bounds = Aabb { min: Point::new(-30.0, -15.0, -40.0), max: Point::new(30.0, 15.0, 30.0) };
        let region = Region { bounds, half_spaces: vec![] };
        let domain = Domain { skin: &skin, bone: &Nothing, air: None, soft_tissue: None, region: &region };
        let inner = InnerTissue::new(&domain, &MeshSettings::default());
        let lattice = Lattice::covering(&bounds, 4.0);
        (mark_refinement(&inner, &lattice, &Control::new()).unwrap(), lattice)
    }

    #[test]
    fn a_thin_wall_gets_thin_prisms_and_refined_cubes() {
        let (marks, lattice) = marked(4.0);
        let thickness = marks.thickness.unwrap();
        let at = |x: f64, z: f64| thickness.sample(&Point::new(x, 0.0, z));
        // Half of 4 mm less 0.65 edges, accurate to one step of the search.
        assert!((at(0.0, 0.0) - 0.7).abs() < 0.1, "{}", at(0.0, 0.0));
        assert!((at(20.0, -40.0) - 1.5).abs() < 1e-6);
        let near = |cube: usize| lattice.position(lattice.centre_of_cube(cube));
        for (cube, refined) in marks.refined.iter().enumerate() {
            let p = near(cube);
            if p.x.abs() < 3.0 && (-8.0..16.0).contains(&p.z) && p.y.abs() < 12.0 {
                assert!(refined, "{p}");
            }
            if p.z < -24.0 && p.x.abs() < 12.0 {
                assert!(!refined, "{p}");
            }
        }
    }

    /// A plate of bone 1.8 mm thick between the lattice's planes.
    /// At 8 mm below the skin its cubes are refined, at 30 mm they are not.
    #[test]
    fn thin_bone_near_the_skin_gets_refined_cubes() {
        let refined = |depth: f64| {
            let bounds = Aabb { min: Point::new(-20.0, -20.0, -20.0), max: Point::new(20.0, 20.0, 20.0) };
            let lattice = Lattice::covering(&bounds, 4.0);
            let level = lattice.position(0).z + 16.0 + 1.0;
            let skin = Shape(Box::new(move |p| p.z - level - depth));
            let bone = Shape(Box::new(move |p| (p.z - level).abs() - 0.9));
            let region = Region { bounds, half_spaces: vec![] };
            let domain = Domain { skin: &skin, bone: &bone, air: None, soft_tissue: None, region: &region };
            let settings = MeshSettings { depth_mm: 100.0, ..MeshSettings::default() };
            let found = pierced(&InnerTissue::new(&domain, &settings), &lattice, &Control::new()).unwrap();
            let around = |cube: &usize| (lattice.position(lattice.centre_of_cube(*cube)).z - level).abs() < 4.0;
            assert!(found.iter().all(around));
            found.len()
        };
        assert_eq!(refined(30.0), 0);
        assert!(refined(9.0) > 50, "{}", refined(9.0));
    }

    #[test]
    fn thick_tissue_stays_as_it_is() {
        let (marks, _) = marked(16.0);
        assert!(marks.thickness.is_none());
        assert!(!marks.refined.contains(&true));
    }
}
