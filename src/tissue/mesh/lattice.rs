use prosopon_geometry::{Aabb, Point, ScalarGrid, Vector};

/// Body-centred cubic lattice: corners and centres of cubes, joined by long edges (cube edges and centre to centre)
/// and short edges (corner to centre).
///
/// A vertex has doubled coordinates `(i, j, k)`, all even (corner) or all odd (centre), in units of half an edge.
#[derive(Debug, Clone)]
pub(super) struct Lattice {
    origin: Point,
    edge: f64,
    cells: [usize; 3],
}

/// Steps to the 14 neighbours.
/// The first seven hold one of each pair of opposite steps, so that `i` and `i + 7` are opposite. The first three of each half
/// are long edges, the last four short ones.
pub(super) const STEPS: [[i32; 3]; 14] = [
    [2, 0, 0],
    [0, 2, 0],
    [0, 0, 2],
    [1, 1, 1],
    [-1, 1, 1],
    [1, -1, 1],
    [-1, -1, 1],
    [-2, 0, 0],
    [0, -2, 0],
    [0, 0, -2],
    [-1, -1, -1],
    [1, -1, -1],
    [-1, 1, -1],
    [1, 1, -1],
];

impl Lattice {
    /// Covers `bounds` with at least one extra cell on every side.
    pub(super) fn covering(bounds: &Aabb, edge: f64) -> Self {
        let extent = bounds.max - bounds.min;
        let cells = [0, 1, 2].map(|a| (extent[a].max(0.0) / edge).ceil() as usize + 3);
        // Centred, so that the lattice meets opposite faces of the box alike.
        let size = Vector::new(cells[0] as f64, cells[1] as f64, cells[2] as f64) * edge;
        Self { origin: bounds.center() - 0.5 * size, edge, cells }
    }

    fn corners(&self) -> usize {
        self.cells.iter().map(|c| c + 1).product()
    }

    pub(super) fn vertex_count(&self) -> usize {
        self.corners() + self.cells.iter().product::<usize>()
    }

    /// Doubled coordinates of vertex `index`.
    pub(super) fn coordinates(&self, index: usize) -> [i32; 3] {
        let corners = self.corners();
        let (rest, size, odd) =
            if index < corners { (index, self.cells.map(|c| c + 1), 0) } else { (index - corners, self.cells, 1) };
        let ijk = [rest % size[0], rest / size[0] % size[1], rest / (size[0] * size[1])];
        ijk.map(|c| 2 * c as i32 + odd)
    }

    /// Index of the vertex at doubled coordinates `c` (all of one parity); `None` outside.
    pub(super) fn index(&self, c: [i32; 3]) -> Option<usize> {
        let odd = c[0] & 1;
        if (0..3).any(|a| c[a] < 0 || c[a] > 2 * self.cells[a] as i32) {
            return None;
        }
        let size = self.cells.map(|n| if odd == 1 { n } else { n + 1 });
        let at = c.map(|x| (x / 2) as usize);
        let base = if odd == 1 { self.corners() } else { 0 };
        Some(base + at[0] + size[0] * (at[1] + size[1] * at[2]))
    }

    pub(super) fn position(&self, index: usize) -> Point {
        self.origin + Vector::from(self.coordinates(index).map(f64::from)) * (0.5 * self.edge)
    }

    /// The four tetrahedra around the long edge from corner `index` along `axis`, fewer at the border. Each tetrahedron of the
    /// lattice has exactly one such edge. The node order gives a positive volume.
    pub(super) fn tetrahedra(&self, index: usize, axis: usize) -> impl Iterator<Item = [u32; 4]> {
        let c = self.coordinates(index);
        let mut end = c;
        end[axis] += 2;
        let end = self.index(end);
        // Centres around the edge, counter-clockwise seen against the axis.
        const AROUND: [[i32; 2]; 4] = [[1, 1], [-1, 1], [-1, -1], [1, -1]];
        let centre = move |q: usize| {
            let mut m = c;
            m[axis] += 1;
            m[(axis + 1) % 3] += AROUND[q % 4][0];
            m[(axis + 2) % 3] += AROUND[q % 4][1];
            self.index(m)
        };
        (0..4).filter_map(move |q| {
            let (end, p, r) = (end?, centre(q)?, centre(q + 1)?);
            Some([index as u32, p as u32, r as u32, end as u32])
        })
    }

    pub(super) fn cube_count(&self) -> usize {
        self.cells.iter().product()
    }

    /// The cube whose lowest corner has the doubled coordinates `low`; cubes are numbered like their centres.
    pub(super) fn cube_at(&self, low: [i32; 3]) -> Option<usize> {
        let centre = self.index(low.map(|c| c + 1))?;
        self.cube_of_centre(centre)
    }

    /// The cube around the centre `index`; `None` for a corner.
    pub(super) fn cube_of_centre(&self, index: usize) -> Option<usize> {
        index.checked_sub(self.corners())
    }

    pub(super) fn centre_of_cube(&self, cube: usize) -> usize {
        self.corners() + cube
    }

    /// Doubled coordinates of a cube's lowest corner.
    pub(super) fn low_corner(&self, cube: usize) -> [i32; 3] {
        self.coordinates(self.centre_of_cube(cube)).map(|c| c - 1)
    }

    /// The cubes that a vertex belongs to: one for a centre, up to eight for a corner.
    pub(super) fn cubes_at(&self, index: usize) -> impl Iterator<Item = usize> {
        let own = self.cube_of_centre(index);
        let c = self.coordinates(index);
        let around = (0..8)
            .filter(move |_| own.is_none())
            .filter_map(move |o| self.cube_at([0, 1, 2].map(|a| c[a] - if o >> a & 1 == 1 { 2 } else { 0 })));
        own.into_iter().chain(around)
    }

    /// The cubes that an edge belongs to: those around both ends, and both cubes of an edge between centres.
    pub(super) fn cubes_at_edge(&self, v: usize, u: usize) -> Vec<usize> {
        match (self.cube_of_centre(v), self.cube_of_centre(u)) {
            (Some(a), Some(b)) => vec![a, b],
            (Some(cube), None) | (None, Some(cube)) => vec![cube],
            (None, None) => self.cubes_at(v).filter(|cube| self.cubes_at(u).any(|other| other == *cube)).collect(),
        }
    }

    /// Neighbours along the first of each pair of opposite [`STEPS`], so that each edge is visited once.
    pub(super) fn neighbours_above(&self, index: usize) -> impl Iterator<Item = usize> {
        let c = self.coordinates(index);
        STEPS.iter().take(7).filter_map(move |s| self.index([0, 1, 2].map(|a| c[a] + s[a])))
    }

    /// The corners of the cube around the centre `index`.
    pub(super) fn corners_of_centre(&self, index: usize) -> impl Iterator<Item = usize> {
        let c = self.coordinates(index);
        (0..8).filter_map(move |o| self.index([0, 1, 2].map(|a| c[a] + if o >> a & 1 == 1 { 1 } else { -1 })))
    }

    /// A grid of the corners, in their order, filled with `value`.
    pub(super) fn corner_grid(&self, value: f32) -> ScalarGrid {
        let dims = self.cells.map(|c| c + 1);
        ScalarGrid { dims, origin: self.origin, spacing: self.edge, values: vec![value; self.corners()] }
    }

    /// Position of quadrupled coordinates.
    pub(super) fn at_quarters(&self, c: [i32; 3]) -> Point {
        self.origin + Vector::from(c.map(f64::from)) * (0.25 * self.edge)
    }

    /// Corners, the vertices that [`Self::tetrahedra`] accepts.
    pub(super) fn corner_indices(&self) -> std::ops::Range<usize> {
        0..self.corners()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tetrahedra_fill_the_lattice_with_positive_equal_volumes() {
        let bounds = Aabb { min: Point::origin(), max: Point::new(3.0, 4.0, 5.0) };
        let lattice = Lattice::covering(&bounds, 2.0);
        let mut count = 0;
        for v in lattice.corner_indices() {
            for axis in 0..3 {
                for t in lattice.tetrahedra(v, axis) {
                    let [a, b, c, d] = t.map(|i| lattice.position(i as usize));
                    let volume = (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0;
                    // A cube of volume 8 holds 12.
                    assert!((volume - 8.0 / 12.0).abs() < 1e-12);
                    count += 1;
                }
            }
        }
        let [x, y, z] = lattice.cells;
        // Two for each inner face of two cubes times four, each cube face pair makes four tetrahedra.
        let inner = (x - 1) * y * z + x * (y - 1) * z + x * y * (z - 1);
        assert_eq!(count, 4 * inner);
        for v in 0..lattice.vertex_count() {
            assert_eq!(lattice.index(lattice.coordinates(v)), Some(v));
        }
    }
}
