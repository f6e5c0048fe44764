//! Regions of space from which vertex masks are built.

use prosopon_geometry::{Aabb, Motion, Point, TriMesh};

/// A closed region of space, LPS mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MaskRegion {
    /// Axis-aligned box.
    Box(Aabb),
    /// Ball.
    Ball {
        /// Centre, LPS mm.
        centre: Point,
        /// Radius, mm.
        radius_mm: f64,
    },
    /// Axis-aligned box of another frame.
    Turned {
        /// The box in that frame.
        bounds: Aabb,
        /// Maps LPS into that frame.
        into: Motion,
    },
}

impl MaskRegion {
    /// Whether `p` lies in the region or on its boundary.
    #[must_use]
    pub fn contains(&self, p: &Point) -> bool {
        match self {
            Self::Box(bounds) => bounds.contains(p),
            Self::Ball { centre, radius_mm } => (p - centre).norm_squared() <= radius_mm * radius_mm,
            Self::Turned { bounds, into } => bounds.contains(&(into * p)),
        }
    }

    /// The region moved in space.
    #[must_use]
    pub fn moved(&self, motion: &Motion) -> Self {
        match self {
            Self::Box(bounds) => Self::Turned { bounds: *bounds, into: motion.inverse() },
            Self::Ball { centre, radius_mm } => Self::Ball { centre: motion * centre, radius_mm: *radius_mm },
            Self::Turned { bounds, into } => Self::Turned { bounds: *bounds, into: into * motion.inverse() },
        }
    }
}

/// Selection of vertices by regions of space and by index.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mask {
    /// A vertex must lie in one of these parts; an empty list admits all vertices.
    pub only: Vec<MaskRegion>,
    /// A vertex must lie in none of these parts.
    pub except: Vec<MaskRegion>,
    /// A vertex must be `true` here; one entry per vertex.
    pub vertices: Option<Vec<bool>>,
}

impl Mask {
    /// Whether the mask admits every vertex.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.only.is_empty() && self.except.is_empty() && self.vertices.is_none()
    }

    /// The mask's value at each vertex of `mesh`.
    /// Vertices beyond the end of [`Mask::vertices`] are not selected.
    #[must_use]
    pub fn of(&self, mesh: &TriMesh) -> Vec<bool> {
        let within = |parts: &[MaskRegion], p: &Point| parts.iter().any(|part| part.contains(p));
        let chosen = |v: usize| self.vertices.as_ref().is_none_or(|m| m.get(v) == Some(&true));
        let passes = |(v, p)| (self.only.is_empty() || within(&self.only, p)) && !within(&self.except, p) && chosen(v);
        mesh.positions().iter().enumerate().map(passes).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_and_numbers_choose_together() {
        let p: Vec<Point> = (0..5).map(|i| Point::new(f64::from(i), 0.0, 0.0)).collect();
        let mesh = TriMesh::new(p, vec![[0, 1, 2]]).unwrap();
        assert!(Mask::default().is_empty() && Mask::default().of(&mesh).iter().all(|m| *m));
        let bounds = Aabb { min: Point::new(0.5, -1.0, -1.0), max: Point::new(4.0, 1.0, 1.0) };
        let ball = MaskRegion::Ball { centre: Point::new(2.0, 0.0, 0.0), radius_mm: 0.5 };
        let vertices = Some(vec![true, true, true, false]);
        let mask = Mask { only: vec![MaskRegion::Box(bounds)], except: vec![ball], vertices };
        assert_eq!(mask.of(&mesh), [false, true, false, false, false]);
    }
}
