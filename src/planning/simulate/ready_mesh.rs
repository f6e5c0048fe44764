//! A volume mesh that somebody else made, as the solver takes it.

use prosopon_geometry::{Cell, DataArray, Point, Vector, VolumeMesh};
use prosopon_tissue::fem::{Boundary, Locking, SolveError, check_support};
use prosopon_tissue::mesh::{Attachment, MixedMesh, Tissue, boundary_of};

/// Why a volume mesh cannot be solved on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReadyMeshError {
    /// No cells.
    #[error("the mesh has no tetrahedra and no wedges")]
    Empty,
    /// An array does not hold what its name promises.
    #[error("the {on} array `{name}` is not usable: {detail}")]
    Array {
        /// `point` or `cell`.
        on: &'static str,
        /// Its name.
        name: &'static str,
        /// What was found where, and what is allowed.
        detail: String,
    },
    /// A cell that is flat or names a node twice.
    #[error("cell {cell} has no volume")]
    Flat {
        /// Index in the file.
        cell: usize,
    },
    /// A wedge whose triangles do not lie over each other corner by corner.
    #[error("the wedge of cell {cell} is twisted: point {} of its second triangle does not lie over point {} of the first, another one does; number both triangles from corners that lie over each other", corners[0], corners[1])]
    Twisted {
        /// Index in the file.
        cell: usize,
        /// First points of the second and of the first triangle.
        corners: [u32; 2],
    },
    /// Two cells on the same side of their common triangle.
    #[error("the two cells at the triangle of the points {triangle:?} lie on the same side of it: they overlap")]
    Overlap {
        /// Points, ascending.
        triangle: [u32; 3],
    },
    /// More than two cells at one triangle.
    #[error("the triangle of the points {triangle:?} belongs to {cells} cells, at most 2 are possible")]
    NotConforming {
        /// Points, ascending.
        triangle: [u32; 3],
        /// How many cells.
        cells: usize,
    },
}

/// Where a cell of the file went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellPlace {
    /// A tetrahedron of the mesh.
    Tetrahedron(u32),
    /// A prism of the mesh.
    Prism(u32),
}

/// How a ready mesh is solved where nobody says otherwise, at every door: such meshes are made for any material, and plain linear elements are a
/// quarter too stiff near incompressibility. Meshes that are built for a head have their default in [`prosopon_tissue::fem::SolveSettings::new`].
pub const READY_MESH_LOCKING: Locking = Locking::Smoothed;

/// A volume mesh with what holds and loads it.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadyMesh {
    /// The mesh; nodes are the file's points.
    pub mesh: MixedMesh,
    /// Planes of symmetry and dead loads.
    pub boundary: Boundary,
    /// Place of each cell of the file.
    pub places: Vec<CellPlace>,
    /// What was changed or looks doubtful.
    pub warnings: Vec<String>,
}

impl ReadyMesh {
    /// Checks a volume mesh and brings it into order: cells that are inside out are turned round, of each wedge the triangle on
    /// the boundary becomes the outer one.
    ///
    /// Point arrays, all optional: `attachment` (-1 free, 0 skull, k segment k, -2 sliding), `fixed_mask` (axes along which the
    /// point is held, bits x = 1, y = 2, z = 4), `prescribed_mm` (where it goes along these axes; three components), `force_n` (three
    /// components). Cell array `tissue` (0 skin, 1 muscle, 2 fat, 3 mucosa);
    /// without it wedges are skin and tetrahedra fat.
    ///
    /// # Errors
    /// [`ReadyMeshError`].
    pub fn new(volume: &VolumeMesh) -> Result<Self, ReadyMeshError> {
        if volume.cells.is_empty() {
            return Err(ReadyMeshError::Empty);
        }
        let mut warnings = Vec::new();
        let tissue = tissues(volume, &mut warnings)?;
        let attachment = attachments(volume, &mut warnings)?;
        let boundary = Boundary {
            held_axes: held_axes(volume)?,
            prescribed_mm: vectors(volume, "prescribed_mm")?,
            loads_n: vectors(volume, "force_n")?,
        };
        check_prescribed(&boundary)?;
        check_loaded(volume, &boundary.loads_n)?;
        let x = &volume.points;
        let (mut tetrahedra, mut tetrahedron_tissue) = (Vec::new(), Vec::new());
        let (mut prisms, mut prism_tissue) = (Vec::new(), Vec::new());
        let mut places = Vec::with_capacity(volume.cells.len());
        let mut turned = 0usize;
        for (cell, (corners, tissue)) in volume.cells.iter().zip(tissue).enumerate() {
            match *corners {
                Cell::Tetrahedron(corners) => {
                    let (corners, flipped) = turn_tetrahedron(corners, x).ok_or(ReadyMeshError::Flat { cell })?;
                    turned += usize::from(flipped);
                    places.push(CellPlace::Tetrahedron(tetrahedra.len() as u32));
                    tetrahedra.push(corners);
                    tetrahedron_tissue.push(tissue);
                }
                Cell::Wedge(corners) => {
                    let corners = turn_wedge(corners, x).ok_or(ReadyMeshError::Flat { cell })?;
                    if is_twisted(corners, x) {
                        return Err(ReadyMeshError::Twisted { cell, corners: [corners[3], corners[0]] });
                    }
                    places.push(CellPlace::Prism(prisms.len() as u32));
                    prisms.push(corners);
                    prism_tissue.push(tissue);
                }
            }
        }
        if turned > 0 {
            warnings.push(format!("{turned} tetrahedra were inside out and have been turned round"));
        }
        let boundary_faces = BoundaryFaces::of(&tetrahedra, &prisms)?;
        boundary_faces.outer_first(&mut prisms, &attachment);
        let bone_faces = bone_faces(&tetrahedra, &prisms, &attachment);
        warnings.extend(doubled(x, &tetrahedra, &prisms));
        let mesh = MixedMesh {
            positions: x.clone(),
            tetrahedra,
            tetrahedron_tissue,
            prisms,
            prism_tissue,
            bone_faces,
            attachment,
            depth_cut_nodes: Vec::new(),
        };
        Ok(Self { mesh, boundary, places, warnings })
    }

    /// Checks that each connected part is held against all six rigid motions.
    ///
    /// # Errors
    /// [`SolveError::Problem`] with the place of one that is not.
    pub fn check_support(&self) -> Result<(), SolveError> {
        check_support(&self.mesh, &self.boundary.held_axes)
    }

    /// Outer triangles of the prisms that lie on the boundary; without prisms the triangles on the boundary that are not at bone. Counter-clockwise
    /// from outside.
    #[must_use]
    pub fn outer_faces(&self) -> Vec<[u32; 3]> {
        let mesh = &self.mesh;
        // The mesh was found conforming when it was made.
        let Ok(boundary) = BoundaryFaces::of(&mesh.tetrahedra, &mesh.prisms) else { return Vec::new() };
        if !mesh.prisms.is_empty() {
            let outer = mesh.prisms.iter().map(|p| triangles_of(p)[0]);
            return outer.filter(|t| boundary.contains(*t)).collect();
        }
        let is_held = |t: &&[u32; 3]| t.iter().all(|n| mesh.attachment[*n as usize] != Attachment::Free);
        let mut at_bone: Vec<[u32; 3]> = mesh.bone_faces.iter().filter(is_held).copied().map(sorted).collect();
        at_bone.sort_unstable();
        let free = |t: &[u32; 3]| boundary.contains(*t) && at_bone.binary_search(&sorted(*t)).is_err();
        mesh.tetrahedra.iter().flat_map(faces_of).filter(free).collect()
    }

    /// Prisms whose outer triangle is another prism's inner one, or lies inside: they cannot be C1 prisms.
    #[must_use]
    pub fn buried_prisms(&self) -> usize {
        let n = self.mesh.positions.len();
        let mut inner = vec![false; n];
        for &node in self.mesh.prisms.iter().flat_map(|p| &p[3..]) {
            inner[node as usize] = true;
        }
        self.mesh.prisms.iter().filter(|p| p[..3].iter().any(|&node| inner[node as usize])).count()
    }
}

fn turn_tetrahedron(corners: [u32; 4], x: &[Point]) -> Option<([u32; 4], bool)> {
    let [a, b, c, d] = corners.map(|n| x[n as usize]);
    let (p, q, r) = (b - a, c - a, d - a);
    let volume = p.cross(&q).dot(&r);
    let [i, j, k, l] = corners;
    let size = p.norm() * q.norm() * r.norm();
    if volume.abs() <= 1e-12 * size || size == 0.0 {
        None
    } else if volume > 0.0 {
        Some((corners, false))
    } else {
        Some(([i, k, j, l], true))
    }
}

/// The wedge with the normal of its first triangle pointing away from the second, as VTK's file format guide has it. Both kinds are
/// common, so this is no fault.
fn turn_wedge(corners: [u32; 6], x: &[Point]) -> Option<[u32; 6]> {
    let [a, b, c, d, e, f] = corners.map(|n| x[n as usize].coords);
    let (u, v) = (0.5 * ((b - a) + (e - d)), 0.5 * ((c - a) + (f - d)));
    let up = (a + b + c - d - e - f) / 3.0;
    let volume = u.cross(&v).dot(&up);
    let size = u.norm() * v.norm() * up.norm();
    let [i, j, k, l, m, n] = corners;
    if volume.abs() <= 1e-12 * size || size == 0.0 {
        None
    } else if volume > 0.0 {
        Some(corners)
    } else {
        Some([i, k, j, l, n, m])
    }
}

/// Whether the second triangle fits the first better when its corners are taken one or two on: then the wedge is turned in itself by more than
/// 60°, though its volume may be positive everywhere.
fn is_twisted(corners: [u32; 6], x: &[Point]) -> bool {
    let p = corners.map(|n| x[n as usize].coords);
    let middles = [p[0] + p[1] + p[2], p[3] + p[4] + p[5]].map(|sum| sum / 3.0);
    let fit =
        |shift: usize| -> f64 { (0..3).map(|i| (p[i] - middles[0]).dot(&(p[3 + (i + shift) % 3] - middles[1]))).sum() };
    fit(0) < fit(1).max(fit(2))
}

/// Points of different cells at one place on the boundary: tissue is not joined there. What to tell of them.
fn doubled(x: &[Point], tetrahedra: &[[u32; 4]], prisms: &[[u32; 6]]) -> Option<String> {
    let (faces, _) = boundary_of(tetrahedra, prisms);
    let mut nodes: Vec<u32> = faces.into_iter().flatten().collect();
    nodes.sort_unstable();
    nodes.dedup();
    // Minus zero is zero.
    let key = |n: &u32| x[*n as usize].coords.map(|c| (c + 0.0).to_bits());
    nodes.sort_by_key(|n| (<[u64; 3]>::from(key(n)), *n));
    let same: Vec<&[u32]> = nodes.chunk_by(|a, b| key(a) == key(b)).filter(|same| same.len() > 1).collect();
    let first = same.iter().min_by_key(|same| same[0])?;
    let p = x[first[0] as usize];
    Some(format!(
        "at {} places points of different cells lie in the same place, the first are {} and {} at ({:.2}, {:.2}, {:.2}) mm: tissue is not joined there and \
         opens as a slit; merge them if that is not meant",
        same.len(),
        first[0],
        first[1],
        p.x,
        p.y,
        p.z
    ))
}

/// Triangles of one cell only, by their sorted corners.
struct BoundaryFaces {
    sorted: Vec<[u32; 3]>,
}

fn sorted(mut triangle: [u32; 3]) -> [u32; 3] {
    triangle.sort_unstable();
    triangle
}

/// Whether the corners run round the triangle as the ascending ones do.
fn is_even([a, b, c]: [u32; 3]) -> bool {
    [a < b, b < c, c < a].iter().filter(|ascends| **ascends).count() == 2
}

/// Triangles of a tetrahedron, counter-clockwise from outside.
fn faces_of(&[a, b, c, d]: &[u32; 4]) -> [[u32; 3]; 4] {
    [[a, c, b], [a, b, d], [a, d, c], [b, c, d]]
}

/// Outer and inner triangle of a prism, counter-clockwise from outside.
fn triangles_of(&[a, b, c, d, e, f]: &[u32; 6]) -> [[u32; 3]; 2] {
    [[a, b, c], [d, f, e]]
}

impl BoundaryFaces {
    fn of(tetrahedra: &[[u32; 4]], prisms: &[[u32; 6]]) -> Result<Self, ReadyMeshError> {
        // All are counter-clockwise from outside, so the two sides of one run round it in opposite ways.
        let faces = tetrahedra.iter().flat_map(faces_of).chain(prisms.iter().flat_map(triangles_of));
        let mut all: Vec<([u32; 3], bool)> = faces.map(|t| (sorted(t), is_even(t))).collect();
        all.sort_unstable();
        let mut single = Vec::new();
        for same in all.chunk_by(|a, b| a.0 == b.0) {
            let triangle = same[0].0;
            match *same {
                [_] => single.push(triangle),
                [a, b] if a.1 == b.1 => return Err(ReadyMeshError::Overlap { triangle }),
                [_, _] => {}
                _ => return Err(ReadyMeshError::NotConforming { triangle, cells: same.len() }),
            }
        }
        Ok(Self { sorted: single })
    }

    fn contains(&self, triangle: [u32; 3]) -> bool {
        self.sorted.binary_search(&sorted(triangle)).is_ok()
    }

    /// Exchanges the triangles of prisms where only the second lies on the boundary, or both do and the second is less held.
    fn outer_first(&self, prisms: &mut [[u32; 6]], attachment: &[Attachment]) {
        let held = |t: &[u32]| t.iter().filter(|&&n| attachment[n as usize] != Attachment::Free).count();
        for prism in prisms {
            let [first, second] = triangles_of(prism);
            let exchange = match (self.contains(first), self.contains(second)) {
                (true, true) => held(&second) < held(&first),
                (outer_is_first, outer_is_second) => outer_is_second && !outer_is_first,
            };
            if exchange {
                // The other way round about, so that the handedness stays.
                let [a, b, c, d, e, f] = *prism;
                *prism = [d, f, e, a, c, b];
            }
        }
    }
}

/// Boundary triangles at bone: those with only held and sliding corners, but outer triangles of prisms only with a sliding one, and those round
/// a sliding point that no such triangle has.
fn bone_faces(tetrahedra: &[[u32; 4]], prisms: &[[u32; 6]], attachment: &[Attachment]) -> Vec<[u32; 3]> {
    let (faces, n_outer) = boundary_of(tetrahedra, prisms);
    let slides = |n: &u32| attachment[*n as usize] == Attachment::Sliding;
    let is_whole = |i: usize, t: &[u32; 3]| {
        t.iter().all(|&n| attachment[n as usize] != Attachment::Free) && (i >= n_outer || t.iter().any(slides))
    };
    let mut met = vec![false; attachment.len()];
    let whole: Vec<bool> = faces.iter().enumerate().map(|(i, t)| is_whole(i, t)).collect();
    for (t, _) in faces.iter().zip(&whole).filter(|(_, whole)| **whole) {
        t.iter().for_each(|n| met[*n as usize] = true);
    }
    let alone = |t: &[u32; 3]| t.iter().any(|n| slides(n) && !met[*n as usize]);
    faces.iter().zip(&whole).filter(|(t, whole)| **whole || alone(t)).map(|(t, _)| *t).collect()
}

fn array_fault(on: &'static str, name: &'static str, detail: String) -> ReadyMeshError {
    ReadyMeshError::Array { on, name, detail }
}

/// Whole numbers from `min` to `max`, one a point or cell.
fn whole_numbers(
    array: &DataArray,
    on: &'static str,
    name: &'static str,
    min: i64,
    max: i64,
) -> Result<Vec<i64>, ReadyMeshError> {
    if array.components != 1 {
        return Err(array_fault(on, name, format!("it has {} components, expected 1", array.components)));
    }
    let number = |(index, &value): (usize, &f64)| {
        let whole = value as i64;
        if whole as f64 == value && (min..=max).contains(&whole) {
            Ok(whole)
        } else {
            let detail = format!("{on} {index} has {value}, allowed are whole numbers from {min} to {max}");
            Err(array_fault(on, name, detail))
        }
    };
    array.values.iter().enumerate().map(number).collect()
}

fn tissues(volume: &VolumeMesh, warnings: &mut Vec<String>) -> Result<Vec<Tissue>, ReadyMeshError> {
    let Some(array) = volume.cell_array("tissue") else {
        warnings.push("there is no cell array `tissue`: wedges are taken as skin, tetrahedra as fat".to_owned());
        let guess = |cell: &Cell| match cell {
            Cell::Tetrahedron(_) => Tissue::Fat,
            Cell::Wedge(_) => Tissue::Skin,
        };
        return Ok(volume.cells.iter().map(guess).collect());
    };
    let numbers = whole_numbers(array, "cell", "tissue", 0, 3)?;
    let tissue = |number: i64| match number {
        0 => Tissue::Skin,
        1 => Tissue::Muscle,
        2 => Tissue::Fat,
        _ => Tissue::Mucosa,
    };
    Ok(numbers.into_iter().map(tissue).collect())
}

fn attachments(volume: &VolumeMesh, warnings: &mut Vec<String>) -> Result<Vec<Attachment>, ReadyMeshError> {
    let Some(array) = volume.point_array("attachment") else {
        warnings.push("there is no point array `attachment`: no point is tied to bone or slides on it".to_owned());
        return Ok(vec![Attachment::Free; volume.points.len()]);
    };
    let numbers = whole_numbers(array, "point", "attachment", -2, i64::from(u32::MAX))?;
    let attachment = |number: i64| match u32::try_from(number) {
        Ok(segment) => Attachment::Tied(segment),
        Err(_) if number == -1 => Attachment::Free,
        Err(_) => Attachment::Sliding,
    };
    Ok(numbers.into_iter().map(attachment).collect())
}

fn held_axes(volume: &VolumeMesh) -> Result<Vec<u8>, ReadyMeshError> {
    let Some(array) = volume.point_array("fixed_mask") else { return Ok(Vec::new()) };
    Ok(whole_numbers(array, "point", "fixed_mask", 0, 7)?.into_iter().map(|bits| bits as u8).collect())
}

/// Three numbers a point; empty when there is no such array.
fn vectors(volume: &VolumeMesh, name: &'static str) -> Result<Vec<Vector>, ReadyMeshError> {
    let Some(array) = volume.point_array(name) else { return Ok(Vec::new()) };
    let fault = |detail| array_fault("point", name, detail);
    if array.components != 3 {
        return Err(fault(format!("it has {} components, expected 3", array.components)));
    }
    let (vectors, _) = array.values.as_chunks::<3>();
    match vectors.iter().position(|v| !v.iter().all(|c| c.is_finite())) {
        Some(point) => Err(fault(format!("point {point} has a value that is not finite"))),
        None => Ok(vectors.iter().map(|&v| Vector::from(v)).collect()),
    }
}

/// A displacement along an axis that is not held would be lost.
fn check_prescribed(boundary: &Boundary) -> Result<(), ReadyMeshError> {
    for (point, u) in boundary.prescribed_mm.iter().enumerate() {
        let held = boundary.held_axes.get(point).copied().unwrap_or(0);
        if let Some(axis) = (0..3).find(|axis| u[*axis] != 0.0 && held >> axis & 1 == 0) {
            let detail = format!(
                "point {point} has {} along {}, but `fixed_mask` does not hold it along that axis",
                u[axis],
                ["x", "y", "z"][axis]
            );
            return Err(array_fault("point", "prescribed_mm", detail));
        }
    }
    Ok(())
}

/// A load on a point of no cell would be lost.
fn check_loaded(volume: &VolumeMesh, loads: &[Vector]) -> Result<(), ReadyMeshError> {
    let mut used = vec![false; volume.points.len()];
    for &corner in volume.cells.iter().flat_map(|cell| cell.corners()) {
        used[corner as usize] = true;
    }
    match (0..loads.len()).find(|&point| loads[point] != Vector::zeros() && !used[point]) {
        Some(point) => Err(array_fault("point", "force_n", format!("point {point} has a load but belongs to no cell"))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wedge from z = 10 (skin) to z = 5 over a tetrahedron whose tip is at the origin.
    fn volume(wedge: [u32; 6], tetrahedron: [u32; 4]) -> VolumeMesh {
        let points =
            [[0., 0., 10.], [20., 0., 10.], [0., 20., 10.], [0., 0., 5.], [20., 0., 5.], [0., 20., 5.], [0., 0., 0.]];
        VolumeMesh {
            points: points.map(Point::from).to_vec(),
            cells: vec![Cell::Wedge(wedge), Cell::Tetrahedron(tetrahedron)],
            ..VolumeMesh::default()
        }
    }

    fn with_array(name: &str, components: usize, values: &[f64]) -> VolumeMesh {
        let mut volume = volume([0, 1, 2, 3, 4, 5], [3, 4, 5, 6]);
        let array = DataArray { name: name.to_owned(), components, values: values.to_vec() };
        if name == "tissue" {
            volume.cell_arrays.push(array)
        } else {
            volume.point_arrays.push(array)
        }
        volume
    }

    /// Its second triangle numbered from the next corner on: the volume is positive, and yet no wedge is meant.
    #[test]
    fn a_twisted_wedge_is_refused() {
        for wedge in [[0, 1, 2, 4, 5, 3], [0, 1, 2, 5, 3, 4]] {
            match ReadyMesh::new(&volume(wedge, [3, 4, 5, 6])) {
                Err(ReadyMeshError::Twisted { cell: 0, .. }) => {}
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn points_at_one_place_are_told_of() {
        let mut torn = volume([0, 1, 2, 3, 4, 5], [7, 8, 9, 6]);
        torn.points.extend_from_within(3..6);
        let ready = ReadyMesh::new(&torn).unwrap();
        let told = ready.warnings.iter().find(|w| w.contains("in the same place")).unwrap();
        assert!(told.starts_with("at 3 places") && told.contains("the first are 3 and 7"), "{told}");
        let whole = ReadyMesh::new(&volume([0, 1, 2, 3, 4, 5], [3, 4, 5, 6])).unwrap();
        assert!(!whole.warnings.iter().any(|w| w.contains("in the same place")));
    }

    #[test]
    fn sliding_points_touch_bone_wherever_they_lie() {
        let faces = |sliding: &[u32]| {
            let values: Vec<f64> = (0..7).map(|n| if sliding.contains(&n) { -2.0 } else { -1.0 }).collect();
            ReadyMesh::new(&with_array("attachment", 1, &values)).unwrap().mesh.bone_faces
        };
        // The two halves of a wedge's side, its outer triangle, and a point alone with all triangles round it.
        let side = faces(&[0, 1, 3, 4]);
        assert!(side.len() == 2 && side.iter().flatten().all(|n| [0, 1, 3, 4].contains(n)), "{side:?}");
        assert_eq!(faces(&[0, 1, 2]), [[0, 1, 2]]);
        let alone = faces(&[6]);
        assert!(alone.len() == 3 && alone.iter().all(|t| t.contains(&6)), "{alone:?}");
    }

    #[test]
    fn a_displacement_along_an_axis_that_is_free_is_refused() {
        let mut volume = with_array("fixed_mask", 1, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let mut values = vec![0.0; 21];
        values[0] = 2.0;
        volume.point_arrays.push(DataArray { name: "prescribed_mm".to_owned(), components: 3, values: values.clone() });
        assert_eq!(ReadyMesh::new(&volume).unwrap().boundary.prescribed_mm[0].x, 2.0);
        volume.point_arrays[1].values[4] = 1.0;
        assert!(ReadyMesh::new(&volume).unwrap_err().to_string().contains("point 1 has 1 along y"));
    }

    #[test]
    fn wedges_of_either_orientation_and_either_triangle_first_become_the_same_prism() {
        for wedge in [[0, 1, 2, 3, 4, 5], [0, 2, 1, 3, 5, 4], [3, 4, 5, 0, 1, 2], [3, 5, 4, 0, 2, 1]] {
            for (tetrahedron, turned) in [([3, 4, 5, 6], true), ([3, 5, 4, 6], false)] {
                let ready = ReadyMesh::new(&volume(wedge, tetrahedron)).unwrap();
                let [a, b, c, d, e, f] = ready.mesh.prisms[0];
                // Outer triangle first, counter-clockwise seen from above; inner corners below.
                let rotation = [a, b, c].map(|n| (n + 3 - a) % 3);
                assert!(a < 3 && rotation == [0, 1, 2], "{wedge:?}: {:?}", ready.mesh.prisms);
                assert_eq!([d, e, f], [a + 3, b + 3, c + 3]);
                assert_eq!(ready.mesh.tetrahedra, [[3, 5, 4, 6]]);
                assert_eq!(ready.warnings.iter().any(|w| w.contains("1 tetrahedra were inside out")), turned);
                assert_eq!(ready.mesh.tissue_of_prism(0), Tissue::Skin);
                assert_eq!(ready.buried_prisms(), 0);
                assert_eq!(ready.places, [CellPlace::Prism(0), CellPlace::Tetrahedron(0)]);
            }
        }
    }

    #[test]
    fn bone_faces_are_held_or_sliding_and_face_outward() {
        let ready = ReadyMesh::new(&with_array("attachment", 1, &[-1., -1., -1., -2., -2., 4., 0.])).unwrap();
        assert_eq!(
            ready.mesh.attachment[3..],
            [Attachment::Sliding, Attachment::Sliding, Attachment::Tied(4), Attachment::Tied(0)]
        );
        let faces = &ready.mesh.bone_faces;
        assert_eq!(faces.len(), 3);
        let x = |n: u32| ready.mesh.positions[n as usize];
        let middle = Point::new(5.0, 5.0, 3.5);
        for [a, b, c] in faces {
            assert!((x(*b) - x(*a)).cross(&(x(*c) - x(*a))).dot(&(x(*a) - middle)) > 0.0);
        }
    }

    #[test]
    fn arrays_that_are_not_usable_are_refused_with_the_place() {
        for (name, components, values, expected) in [
            ("attachment", 1, vec![-1., -1., -3., 0., 0., 0., 0.], "point 2 has -3"),
            ("attachment", 1, vec![-1., 0.5, 0., 0., 0., 0., 0.], "point 1 has 0.5"),
            ("attachment", 1, vec![f64::NAN, 0., 0., 0., 0., 0., 0.], "point 0 has NaN"),
            ("fixed_mask", 1, vec![0., 0., 0., 0., 8., 0., 0.], "point 4 has 8"),
            ("fixed_mask", 3, vec![0.; 21], "3 components, expected 1"),
            ("force_n", 1, vec![0.; 7], "1 components, expected 3"),
            ("force_n", 3, [vec![0.; 20], vec![f64::INFINITY]].concat(), "point 6 has a value that is not finite"),
            ("tissue", 1, vec![0., 4.], "cell 1 has 4"),
        ] {
            let error = ReadyMesh::new(&with_array(name, components, &values)).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains(name), "{error}");
        }
        assert_eq!(ReadyMesh::new(&volume([0, 1, 2, 3, 4, 5], [3, 4, 5, 4])), Err(ReadyMeshError::Flat { cell: 1 }));
        assert_eq!(ReadyMesh::new(&volume([0, 1, 2, 0, 1, 2], [3, 4, 5, 6])), Err(ReadyMeshError::Flat { cell: 0 }));
        let mut thrice = volume([0, 1, 2, 3, 4, 5], [3, 4, 5, 6]);
        thrice.cells.push(Cell::Tetrahedron([3, 4, 5, 0]));
        assert!(matches!(
            ReadyMesh::new(&thrice),
            Err(ReadyMeshError::NotConforming { triangle: [3, 4, 5], cells: 3 })
        ));
        assert_eq!(ReadyMesh::new(&VolumeMesh::default()), Err(ReadyMeshError::Empty));
        // The tetrahedron's tip inside the wedge above it.
        let mut folded = volume([0, 1, 2, 3, 4, 5], [3, 4, 5, 6]);
        folded.points[6] = Point::new(5.0, 5.0, 8.0);
        assert_eq!(ReadyMesh::new(&folded), Err(ReadyMeshError::Overlap { triangle: [3, 4, 5] }));
        let mut lone = with_array("force_n", 3, &[vec![0.0; 21], vec![0.0, 0.0, 1.0]].concat());
        lone.points.push(Point::new(0.0, 0.0, -9.0));
        let error = ReadyMesh::new(&lone).unwrap_err().to_string();
        assert!(error.contains("point 7 has a load but belongs to no cell"), "{error}");
    }
}
