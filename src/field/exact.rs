use super::defects::Defects;
use super::ray::winding_before;
use super::tree::{Nearest, Tree};
use prosopon_geometry::{Point, TriMesh};

/// Exact distances to a triangle soup by a bounding volume hierarchy, signed by the winding number.
///
/// ```
/// use prosopon_field::ExactDistance;
/// use prosopon_geometry::{Point, TriMesh};
///
/// let corners = [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, 0.0, 9.0]];
/// let positions = corners.map(Point::from).to_vec();
/// let tetrahedron = TriMesh::new(positions, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])?;
/// let exact = ExactDistance::new(&tetrahedron);
/// assert!((exact.signed(&Point::new(1.0, 2.0, 2.0)) + 1.0).abs() < 1e-12);
/// assert!((exact.signed(&Point::new(-3.0, 2.0, 2.0)) - 3.0).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct ExactDistance {
    tree: Tree,
    defects: Defects,
}

impl ExactDistance {
    /// Builds the hierarchy over `surface`.
    #[must_use]
    pub fn new(surface: &TriMesh) -> Self {
        let (tree, defects) = rayon::join(|| Tree::new(surface), || Defects::of(surface));
        Self { tree, defects }
    }

    /// Closest point on the surface (LPS mm), index of its triangle, and unsigned distance, mm.
    #[must_use]
    pub fn closest(&self, p: &Point) -> (Point, usize, f64) {
        let found = self.nearest(p, 0);
        (found.point, self.tree.original[found.slot as usize] as usize, found.distance_sq.sqrt())
    }

    /// Generalised winding number: 1 inside a closed surface, 0 outside, -1 inside an inverted one.
    ///
    /// Of several triangles at the same position that face the same way one counts; pairs that face opposite ways do not count.
    /// Exact up to rounding: the number of times that a ray along -x leaves the surface closed by caps, minus the caps' solid
    /// angle over 4π.
    ///
    /// # Source
    /// A. Jacobson, L. Kavan, O. Sorkine-Hornung, Robust inside-outside segmentation using generalized winding numbers, 2013.
    #[must_use]
    pub fn winding_number(&self, p: &Point) -> f64 {
        let mut count = 0;
        self.tree.for_each_before(p, |slot, corners| {
            if self.defects.counts[self.tree.original[slot] as usize] {
                count += winding_before(p, corners);
            }
        });
        let rim = &self.defects.rim;
        if rim.is_empty() {
            return f64::from(count);
        }
        f64::from(count + rim.before(p)) - rim.share(p)
    }

    /// Signed distance, mm; negative where the winding number's magnitude is above one half.
    ///
    /// An inverted surface, or an inverted part of one, therefore encloses the same solid.
    #[must_use]
    pub fn signed(&self, p: &Point) -> f64 {
        let distance = self.nearest(p, 0).distance_sq.sqrt();
        if is_inside(self.winding_number(p)) { -distance } else { distance }
    }

    /// Like [`ExactDistance::closest`], started from a triangle (tree order) that is probably close.
    pub(super) fn nearest(&self, p: &Point, hint: u32) -> Nearest {
        self.tree.nearest(p, hint)
    }

    pub(super) fn tree(&self) -> &Tree {
        &self.tree
    }

    pub(super) fn defects(&self) -> &Defects {
        &self.defects
    }

    /// Memory that the hierarchy takes, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.tree.bytes()
    }
}

/// Whether a winding number counts as inside.
pub(super) fn is_inside(winding: f64) -> bool {
    winding.abs() > 0.5
}
