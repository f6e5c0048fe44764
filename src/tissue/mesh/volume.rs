//! Volume of the implicit tissue by regular sampling.

use rayon::prelude::*;

use super::domain::{Domain, MeshSettings};
use super::tuning::{MAX_SAMPLE_CELLS, SAMPLE_CELL_MM};
use prosopon_geometry::Point;

/// Volume in mm³ of the tissue that `settings` request and that is connected with the skin layer. That tissue lies inside skin
/// and region, outside bone and air, and above the depth limit. A cell that the boundary crosses counts by its centre's signed
/// value (partial volume), which is exact for a flat boundary along the axes.
pub(super) fn of_tissue(domain: &Domain<'_>, settings: &MeshSettings) -> f64 {
    let bounds = domain.region.bounds;
    let extent = bounds.max - bounds.min;
    if !(0..3).all(|a| extent[a] > 0.0) {
        return 0.0;
    }
    let step = SAMPLE_CELL_MM.max((extent.product() / MAX_SAMPLE_CELLS).cbrt());
    // Cells across the boundary are included, so that a cut by the box is seen from both sides.
    let size = [0, 1, 2].map(|a| (extent[a] / step).ceil() as usize + 2);
    let start = bounds.center() - 0.5 * step * nalgebra::Vector3::from(size.map(|n| n as f64 - 1.0));
    let total = size[0] * size[1] * size[2];
    let position = |c: usize| {
        let at = [c % size[0], c / size[0] % size[1], c / (size[0] * size[1])];
        Point::from([0, 1, 2].map(|a| start[a] + step * at[a] as f64))
    };
    // Value at each cell's centre, and whether the cell lies in the skin layer.
    let cells: Vec<(f32, bool)> = (0..total)
        .into_par_iter()
        .map(|c| {
            let p = position(c);
            let region = domain.region.value_gradient(&p).0;
            if region > step {
                return (f32::MAX, false);
            }
            let skin = domain.skin.value(&p);
            let mut value = region.max(skin).max(-(skin + settings.depth_mm));
            if value < step {
                value = value.max(-domain.bone.value(&p));
                if let Some(air) = domain.air {
                    value = value.max(-air.value(&p));
                }
            }
            (value as f32, skin > -settings.skin_thickness_mm.max(step))
        })
        .collect();
    let share = |c: usize| (0.5 - f64::from(cells[c].0) / step).clamp(0.0, 1.0);
    // Flood from the skin layer through cells whose centre is inside; the adjoining border cells count too.
    let mut reached = vec![false; total];
    let mut stack: Vec<usize> = (0..total).filter(|&c| cells[c].0 < 0.0 && cells[c].1).collect();
    stack.iter().for_each(|&c| reached[c] = true);
    let strides = [1, size[0], size[0] * size[1]];
    while let Some(c) = stack.pop() {
        for axis in 0..3 {
            let at = c / strides[axis] % size[axis];
            for (possible, other) in [(at > 0, c.wrapping_sub(strides[axis])), (at + 1 < size[axis], c + strides[axis])]
            {
                if possible && !reached[other] && share(other) > 0.0 {
                    reached[other] = true;
                    if cells[other].0 < 0.0 {
                        stack.push(other);
                    }
                }
            }
        }
    }
    (0..total).filter(|&c| reached[c]).map(share).sum::<f64>() * step.powi(3)
}

#[cfg(test)]
mod tests {
    use super::super::domain::Region;
    use super::super::test_domain::{Nothing, Shape};
    use super::*;
    use prosopon_geometry::{Aabb, Vector};

    #[test]
    fn shell_of_a_ball() {
        let (skin, bone) = (Shape::ball(Point::origin(), 20.0), Shape::ball(Point::origin(), 12.0));
        let region = Region {
            bounds: Aabb { min: Point::new(-25.0, -25.0, -25.0), max: Point::new(25.0, 25.0, 0.0) },
            half_spaces: vec![(Point::origin(), Vector::x())],
        };
        let settings = MeshSettings::default();
        let domain = Domain { skin: &skin, bone: &bone, air: None, soft_tissue: None, region: &region };
        let shell = std::f64::consts::PI / 3.0 * (20f64.powi(3) - 12f64.powi(3));
        let volume = of_tissue(&domain, &settings);
        assert!((volume / shell - 1.0).abs() < 5e-3, "{volume} against {shell}");
        // Tissue inside a closed bone shell is not reached.
        let depth = MeshSettings { depth_mm: 5.0, ..settings };
        let shallow = of_tissue(&Domain { bone: &Nothing, ..domain }, &depth);
        let expected = std::f64::consts::PI / 3.0 * (20f64.powi(3) - 15f64.powi(3));
        assert!((shallow / expected - 1.0).abs() < 5e-3, "{shallow} against {expected}");
    }
}
