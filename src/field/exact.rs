use super::crossings;
use super::defects::Defects;
use super::tree::{Nearest, Tree};
use prosopon_geometry::{Point, TriMesh};

/// Exact distances to a triangle soup through a bounding volume hierarchy, signed by the generalised winding number.
#[derive(Debug, Clone)]
pub struct ExactDistance {
    tree: Tree,
    defects: Defects,
}

impl ExactDistance {
    /// Prepares queries on `surface`.
    #[must_use]
    pub fn new(surface: &TriMesh) -> Self {
        let (tree, defects) = rayon::join(|| Tree::new(surface), || Defects::of(surface));
        Self { tree, defects }
    }

    /// Closest point on the surface (LPS mm), its triangle, and the unsigned distance in mm.
    #[must_use]
    pub fn closest(&self, p: &Point) -> (Point, usize, f64) {
        let found = self.nearest(p, 0);
        (found.point, self.tree.original[found.slot as usize] as usize, found.distance_sq.sqrt())
    }

    /// Generalised winding number: 1 inside a closed surface, 0 outside, -1 inside a closed surface that is inside out.
    ///
    /// Of triangles at the same place that look the same way only one counts; pairs that look opposite ways do not count.
    /// Exact up to rounding: how often a ray along -x leaves the surface closed by caps over its holes, less the caps' solid
    /// angle over 4π.
    ///
    /// # Source
    /// A. Jacobson, L. Kavan, O. Sorkine-Hornung, Robust inside-outside segmentation using generalized winding numbers, 2013.
    #[must_use]
    pub fn winding_number(&self, p: &Point) -> f64 {
        let mut count = 0;
        self.tree.for_each_before(p, |slot, corners| {
            if self.defects.counts[self.tree.original[slot] as usize] {
                count += crossings::before(p, corners);
            }
        });
        let rim = &self.defects.rim;
        if rim.is_empty() {
            return f64::from(count);
        }
        f64::from(count + rim.before(p)) - rim.share(p)
    }

    /// Signed distance, mm; negative where the winding number's magnitude is above one half, so that a surface (or a
    /// part of one) that is inside out encloses the same solid.
    #[must_use]
    pub fn signed(&self, p: &Point) -> f64 {
        let distance = self.nearest(p, 0).distance_sq.sqrt();
        if is_inside(self.winding_number(p)) { -distance } else { distance }
    }

    /// Like [`ExactDistance::closest`], started from a triangle that is probably close.
    pub(super) fn nearest(&self, p: &Point, hint: u32) -> Nearest {
        self.tree.nearest(p, hint)
    }

    pub(super) fn tree(&self) -> &Tree {
        &self.tree
    }

    pub(super) fn defects(&self) -> &Defects {
        &self.defects
    }

    /// Memory of the hierarchy, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.tree.bytes()
    }
}

/// Whether a winding number means inside.
pub(super) fn is_inside(winding: f64) -> bool {
    winding.abs() > 0.5
}
