//! Parts of space that masks are made of.

use prosopon_geometry::{Aabb, Point, TriMesh};

/// A part of space, LPS mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Part {
    /// A closed box.
    Box(Aabb),
    /// A closed ball.
    Ball {
        /// Its centre.
        centre: Point,
        /// Its radius, mm.
        radius_mm: f64,
    },
}

impl Part {
    /// Whether `p` lies in it.
    #[must_use]
    pub fn contains(&self, p: &Point) -> bool {
        match self {
            Self::Box(bounds) => bounds.contains(p),
            Self::Ball { centre, radius_mm } => (p - centre).norm_squared() <= radius_mm * radius_mm,
        }
    }
}

/// Vertices chosen by parts and by number.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mask {
    /// Only vertices in one of these; all when empty.
    pub only: Vec<Part>,
    /// And in none of these.
    pub except: Vec<Part>,
    /// And only those that are `true` here, one per vertex.
    pub vertices: Option<Vec<bool>>,
}

impl Mask {
    /// Whether it lets every vertex pass.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.only.is_empty() && self.except.is_empty() && self.vertices.is_none()
    }

    /// One entry per vertex of `mesh`; vertices beyond the end of [`Mask::vertices`] are not chosen.
    #[must_use]
    pub fn of(&self, mesh: &TriMesh) -> Vec<bool> {
        let within = |parts: &[Part], p: &Point| parts.iter().any(|part| part.contains(p));
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
        let ball = Part::Ball { centre: Point::new(2.0, 0.0, 0.0), radius_mm: 0.5 };
        let vertices = Some(vec![true, true, true, false]);
        let mask = Mask { only: vec![Part::Box(bounds)], except: vec![ball], vertices };
        assert_eq!(mask.of(&mesh), [false, true, false, false, false]);
    }
}
