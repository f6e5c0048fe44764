use super::orient::turn_outwards;
use super::rims::join_rims;
use super::twins::drop_twins;
use crate::connectivity::Edges;
use crate::{GeometryError, Point, TriMesh};

/// What [`mend`] changed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Mending {
    /// Vertices at open edges that became one with another vertex within `tolerance_mm`.
    pub joined_vertices: usize,
    /// Distance within which vertices at open edges were joined, mm; 0 when there were none.
    pub tolerance_mm: f64,
    /// Triangles that were left out, since another one has the same corners in the same direction.
    pub repeated_triangles: usize,
    /// Triangles that were left out, since the surface is stored a second time for its other side.
    pub second_sides: usize,
    /// Triangles that stay, though another one has the same corners in the other direction.
    pub opposed_triangles: usize,
    /// Triangles whose corners were put in the other order, so that normals point outwards.
    pub turned_triangles: usize,
    /// Connected parts that have no two sides, such as a Möbius band.
    pub one_sided_parts: usize,
}

/// Removes what files add to a surface by their way of storing it.
///
/// - Triangles with the same corners as another one are left out; sheets without thickness on a surface stay.
/// - Vertices at open edges that lie within 0.001 % of the surface's diagonal of each other become one.
/// - Triangles are turned where they face against their neighbours, and parts where they face inwards. Walls of cavities stay.
///
/// A surface without such faults comes back with the same vertices and triangles. No vertices are added or left out: joined ones
/// are no longer used. Triangles must not have a repeated vertex, and vertices at the same position should be one
/// ([`Welder`](super::Welder)). Takes about 0.3 µs per triangle and 60 bytes.
///
/// ```
/// use prosopon_geometry::{Point, mend};
///
/// // A tetrahedron inside out, with one of its triangles twice.
/// let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Point::from).to_vec();
/// let (mesh, mending) = mend(corners, vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2], [3, 2, 1]])?;
/// assert!((mesh.volume() - 1.0 / 6.0).abs() < 1e-12);
/// assert_eq!((mending.repeated_triangles, mending.turned_triangles), (1, 4));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`GeometryError`] as [`TriMesh::new`].
pub fn mend(positions: Vec<Point>, triangles: Vec<[u32; 3]>) -> Result<(TriMesh, Mending), GeometryError> {
    let (mut positions, mut triangles) = TriMesh::new(positions, triangles)?.into_parts();
    let mut mending = Mending::default();
    let mut edges = Edges::of(positions.len(), &triangles);
    mending.drop_twins(&positions, &mut triangles, &mut edges);
    if let Some(joined) = join_rims(&mut positions, &mut triangles, &edges) {
        mending.joined_vertices = joined.vertices;
        mending.tolerance_mm = joined.tolerance_mm;
        edges = Edges::of(positions.len(), &triangles);
        mending.drop_twins(&positions, &mut triangles, &mut edges);
    }
    let turned = turn_outwards(&positions, &mut triangles, &edges);
    mending.turned_triangles = turned.triangles;
    mending.one_sided_parts = turned.one_sided_parts;
    Ok((TriMesh::new(positions, triangles)?, mending))
}

impl Mending {
    fn drop_twins(&mut self, positions: &[Point], triangles: &mut Vec<[u32; 3]>, edges: &mut Edges) {
        let twins = drop_twins(triangles, edges);
        if twins.repeated + twins.second_sides > 0 {
            *edges = Edges::of(positions.len(), triangles);
        }
        self.repeated_triangles += twins.repeated;
        self.second_sides += twins.second_sides;
        self.opposed_triangles = twins.opposed;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box from `low` to `high` of two triangles a side, each side split into `n` × `n` squares; normals point outwards.
    fn cuboid(low: f64, high: f64, n: u32) -> (Vec<Point>, Vec<[u32; 3]>) {
        let mut welder = crate::Welder::default();
        let mut triangles = Vec::new();
        let step = (high - low) / f64::from(n);
        for axis in 0..3 {
            for (end, flip) in [(low, true), (high, false)] {
                let mut corner = |i: u32, j: u32| {
                    let mut p = Point::origin();
                    p[axis] = end;
                    p[(axis + 1) % 3] = low + step * f64::from(i);
                    p[(axis + 2) % 3] = low + step * f64::from(j);
                    welder.number(p)
                };
                for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                    let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                    triangles.extend([[a, b, c], [a, c, d]].map(|[a, b, c]| if flip { [a, c, b] } else { [a, b, c] }));
                }
            }
        }
        (welder.into_positions(), triangles)
    }

    /// Two surfaces as one; the second is reversed if `inner`.
    fn both(
        one: (Vec<Point>, Vec<[u32; 3]>),
        two: (Vec<Point>, Vec<[u32; 3]>),
        inner: bool,
    ) -> (Vec<Point>, Vec<[u32; 3]>) {
        let n = one.0.len() as u32;
        let second = two.1.into_iter().map(|[a, b, c]| if inner { [a, c, b] } else { [a, b, c] }.map(|v| v + n));
        (one.0.into_iter().chain(two.0).collect(), one.1.into_iter().chain(second).collect())
    }

    fn reversed(triangles: &mut [[u32; 3]]) {
        triangles.iter_mut().for_each(|t| t.reverse());
    }

    #[test]
    fn a_sound_surface_stays_as_it_is() {
        for (positions, triangles) in [
            cuboid(0.0, 100.0, 5),
            both(cuboid(0.0, 100.0, 3), cuboid(20.0, 80.0, 3), true),
            both(cuboid(0.0, 100.0, 3), cuboid(200.0, 210.0, 3), false),
        ] {
            let (mesh, mending) = mend(positions.clone(), triangles.clone()).unwrap();
            assert_eq!(mending, Mending::default());
            assert_eq!((mesh.positions(), mesh.triangles()), (&positions[..], &triangles[..]));
        }
    }

    #[test]
    fn triangles_face_outwards_whatever_their_order_was() {
        let (positions, triangles) = cuboid(0.0, 100.0, 5);
        let n = triangles.len();
        // All, most, some, and all of a box without its lid.
        for (turned, left_out) in [(n, 0), (n - 20, 0), (20, 0), (1, 0), (n - 50, 50), (10, 50)] {
            let mut triangles = triangles[..n - left_out].to_vec();
            let expected = triangles.clone();
            reversed(&mut triangles[..turned]);
            let (mesh, mending) = mend(positions.clone(), triangles).unwrap();
            assert_eq!((mending.turned_triangles, mending.one_sided_parts), (turned, 0), "{turned} of {n}");
            let rotated = |t: &[u32; 3], of: &[u32; 3]| (0..3).any(|r| [of[r], of[(r + 1) % 3], of[(r + 2) % 3]] == *t);
            assert!(mesh.triangles().iter().zip(&expected).all(|(t, e)| rotated(t, e)));
        }
    }

    #[test]
    fn walls_of_cavities_face_inwards_and_other_parts_outwards() {
        let volume =
            |(positions, triangles): (Vec<Point>, Vec<[u32; 3]>)| mend(positions, triangles).unwrap().0.volume();
        let close = |found: f64, expected: f64| assert!((found - expected).abs() < 1.0, "{found} {expected}");
        let hollow = || both(cuboid(0.0, 100.0, 3), cuboid(20.0, 80.0, 3), true);
        close(volume(hollow()), 1e6 - 216e3);
        let mut inside_out = hollow();
        reversed(&mut inside_out.1);
        close(volume(inside_out), 1e6 - 216e3);
        // A part inside another that both face outwards: a file of parts, not of cavities.
        close(volume(both(cuboid(0.0, 100.0, 3), cuboid(20.0, 80.0, 3), false)), 1e6 + 216e3);
        // A part beside another, inside out.
        close(volume(both(cuboid(0.0, 100.0, 3), cuboid(200.0, 210.0, 3), true)), 1e6 + 1e3);
        // A solid in a cavity, inside out.
        close(volume(both(hollow(), cuboid(40.0, 60.0, 3), true)), 1e6 - 216e3 + 8e3);
    }

    #[test]
    fn a_band_with_one_side_is_reported() {
        let n = 12u32;
        let at = |i: u32, across: f64| {
            let a = f64::from(i) * std::f64::consts::TAU / f64::from(n);
            let r = 50.0 + across * (a / 2.0).cos();
            Point::new(r * a.cos(), r * a.sin(), across * (a / 2.0).sin())
        };
        let positions: Vec<Point> = (0..n).flat_map(|i| [at(i, -10.0), at(i, 10.0)]).collect();
        let triangles = (0..n).flat_map(|i| {
            let [a, b] = [2 * i, 2 * i + 1];
            let [c, d] = if i + 1 < n { [2 * i + 2, 2 * i + 3] } else { [1, 0] };
            [[a, c, b], [b, c, d]]
        });
        assert_eq!(mend(positions, triangles.collect()).unwrap().1.one_sided_parts, 1);
    }

    #[test]
    fn triangles_that_are_stored_twice_become_one() {
        let (positions, triangles) = cuboid(0.0, 100.0, 4);
        let n = triangles.len();
        let opposite =
            |from: usize, to: usize| triangles[from..to].iter().map(|&[a, b, c]| [c, b, a]).collect::<Vec<_>>();
        let same = |from: usize, to: usize| triangles[from..to].iter().map(|&[a, b, c]| [c, a, b]).collect::<Vec<_>>();
        for (added, repeated, second_sides) in [
            (same(0, n), n, 0),
            (same(3, 7), 4, 0),
            (opposite(0, n), 0, n),
            (opposite(5, 20), 0, 15),
            ([same(0, 9), opposite(30, 40)].concat(), 9, 10),
        ] {
            for front in [true, false] {
                let all = if front { [&added[..], &triangles].concat() } else { [&triangles[..], &added].concat() };
                let (mesh, mending) = mend(positions.clone(), all).unwrap();
                let found = (mending.repeated_triangles, mending.second_sides, mending.opposed_triangles);
                assert_eq!((found, mesh.triangles().len()), ((repeated, second_sides, 0), n));
                assert!((mesh.volume() - 1e6).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn a_sheet_without_thickness_on_a_surface_stays() {
        let (mut positions, mut triangles) = cuboid(0.0, 100.0, 1);
        let [a, b, _] = triangles[0];
        positions.push(Point::new(50.0, 50.0, -50.0));
        let tip = positions.len() as u32 - 1;
        triangles.extend([[a, b, tip], [b, a, tip]]);
        let n = triangles.len();
        let (mesh, mending) = mend(positions, triangles).unwrap();
        assert_eq!((mending.opposed_triangles, mending.second_sides, mesh.triangles().len()), (2, 0, n));
    }

    #[test]
    fn open_edges_that_lie_together_are_joined_and_fine_details_are_not() {
        let (positions, triangles) = cuboid(0.0, 100.0, 4);
        // Each triangle has its own corners, off by less than the tolerance of 0.0017 mm.
        let apart = |by: f64, period: u32| {
            let soup: Vec<Point> = triangles
                .iter()
                .flatten()
                .zip(0u32..)
                .map(|(v, n)| positions[*v as usize] + crate::Vector::repeat(by * f64::from(n % period)))
                .collect();
            let triangles = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            mend(soup, triangles).unwrap()
        };
        let (mesh, mending) = apart(2e-4, 3);
        assert_eq!(mending.joined_vertices, 3 * triangles.len() - positions.len());
        assert!((mending.tolerance_mm - 1e-3 * 3f64.sqrt()).abs() < 1e-4);
        assert!(crate::TopologyFaults::of(&mesh).is_closed_manifold());
        assert_eq!(apart(0.01, 1000).1.joined_vertices, 0);

        // A closed surface of 0.001 mm beside one of 100 mm: no open edges, nothing to join.
        let (positions, triangles) = both(cuboid(0.0, 100.0, 2), cuboid(200.0, 200.001, 2), false);
        assert_eq!(mend(positions, triangles).unwrap().1, Mending::default());
        // A triangle smaller than the tolerance with open edges stays.
        let tiny = [[0.0, 0.0, 0.0], [1e-4, 0.0, 0.0], [0.0, 1e-4, 0.0]].map(Point::from);
        let (mut positions, mut triangles) = cuboid(0.0, 100.0, 1);
        let n = positions.len() as u32;
        positions.extend(tiny.map(|p| p + crate::Vector::repeat(-50.0)));
        triangles.push([n, n + 1, n + 2]);
        assert_eq!(mend(positions, triangles).unwrap().1.joined_vertices, 0);
    }
}
