//! A ready mesh: a volume mesh that the client brings, in the form that the solver takes.

use prosopon_geometry::{Cell, DataArray, Point, Vector, VolumeMesh, Warning};
use prosopon_tissue::fem::{Boundary, Locking, SolveError, check_support};
use prosopon_tissue::mesh::{Attachment, MixedMesh, Tissue, boundary_of};

/// Why a volume mesh cannot be solved on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReadyMeshError {
    /// The mesh has no cells.
    #[error("the mesh has no tetrahedra and no wedges")]
    Empty,
    /// An array has values that its name does not allow.
    #[error("the {on} array `{name}` is not usable: {detail}")]
    Array {
        /// `point` or `cell`.
        on: &'static str,
        /// Name of the array.
        name: &'static str,
        /// What was found where, and what is allowed.
        detail: String,
    },
    /// A cell that is flat or names a node twice.
    #[error("cell {cell} has no volume; its corners coincide or lie in one plane")]
    Flat {
        /// Index in the file.
        cell: usize,
    },
    /// A wedge whose triangles are not opposite each other corner by corner.
    #[error(
        "the wedge of cell {cell} is twisted: point {} of its second triangle is not opposite point {} of the first; number both \
         triangles from opposite corners",
        corners[0],
        corners[1]
    )]
    Twisted {
        /// Index in the file.
        cell: usize,
        /// First points of the second and of the first triangle.
        corners: [u32; 2],
    },
    /// Two cells on the same side of their common triangle.
    #[error("the two cells at the triangle of points {triangle:?} overlap: both lie on the same side of it")]
    Overlap {
        /// Points, ascending.
        triangle: [u32; 3],
    },
    /// More than two cells at one triangle.
    #[error("the triangle of points {triangle:?} belongs to {cells} cells, at most 2 are allowed")]
    NotConforming {
        /// Points, ascending.
        triangle: [u32; 3],
        /// Number of cells at the triangle.
        cells: usize,
    },
}

/// Index of a file's cell in the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellIndex {
    /// A tetrahedron of the mesh.
    Tetrahedron(u32),
    /// A prism of the mesh.
    Prism(u32),
}

/// Default treatment of locking on ready meshes, for the command line and the service.
///
/// Ready meshes may have any material, and plain linear elements are a quarter too stiff near incompressibility.
pub const READY_MESH_LOCKING: Locking = Locking::Patched;

/// A volume mesh with its boundary conditions and loads.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadyMesh {
    /// The mesh; nodes are the file's points.
    pub mesh: MixedMesh,
    /// Held axes, prescribed displacements and dead loads.
    pub boundary: Boundary,
    /// Index in `mesh` of each cell of the file.
    pub cell_indices: Vec<CellIndex>,
    /// What was changed or should be checked.
    pub warnings: Vec<Warning>,
}

impl ReadyMesh {
    /// Checks a volume mesh and orients its cells.
    ///
    /// Cells that are inside out are reoriented; in each wedge the triangle on the boundary becomes the outer one.
    ///
    /// Point arrays, all optional: `attachment` (-1 free, 0 tied to the skull, k tied to segment k, -2 sliding, -3 - k gliding on
    /// segment k), `fixed_mask`
    /// (axes along which the point is held, bits x = 1, y = 2, z = 4), `prescribed_mm` (displacement along these axes, mm;
    /// three components), `force_n` (dead load, N; three components). Cell array, optional: `tissue` (0 skin, 1 muscle, 2 fat,
    /// 3 mucosa, 4 cartilage); without it wedges are skin and tetrahedra fat.
    ///
    /// # Errors
    /// [`ReadyMeshError`] for a mesh without cells, an array with values that are not allowed, or flat, twisted, overlapping or
    /// non-conforming cells.
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
            ..Boundary::default()
        };
        check_prescribed(&boundary)?;
        check_loaded(volume, &boundary.loads_n)?;
        let x = &volume.points;
        let (mut tetrahedra, mut tetrahedron_tissue) = (Vec::new(), Vec::new());
        let (mut prisms, mut prism_tissue) = (Vec::new(), Vec::new());
        let mut cell_indices = Vec::with_capacity(volume.cells.len());
        let mut turned = 0usize;
        for (cell, (corners, tissue)) in volume.cells.iter().zip(tissue).enumerate() {
            match *corners {
                Cell::Tetrahedron(corners) => {
                    let oriented = turn_tetrahedron(corners, x).ok_or(ReadyMeshError::Flat { cell })?;
                    turned += usize::from(oriented.was_inside_out);
                    cell_indices.push(CellIndex::Tetrahedron(tetrahedra.len() as u32));
                    tetrahedra.push(oriented.corners);
                    tetrahedron_tissue.push(tissue);
                }
                Cell::Wedge(corners) => {
                    let corners = turn_wedge(corners, x).ok_or(ReadyMeshError::Flat { cell })?;
                    cell_indices.push(CellIndex::Prism(prisms.len() as u32));
                    prisms.push(corners);
                    prism_tissue.push(tissue);
                }
            }
        }
        if turned > 0 {
            let message = format!("{turned} tetrahedra were inside out and were reoriented");
            warnings.push(Warning::info("tetrahedra-turned", message));
        }
        warnings.extend(twisted_wedges(&prisms, &cell_indices, x)?);
        let boundary_faces = BoundaryFaces::of(&tetrahedra, &prisms)?;
        boundary_faces.outer_first(&mut prisms, &attachment);
        let bone_faces = bone_faces(&tetrahedra, &prisms, &attachment);
        warnings.extend(coincident_points(x, &tetrahedra, &prisms));
        let mesh = MixedMesh {
            positions: x.clone(),
            tetrahedra,
            tetrahedron_tissue,
            prisms,
            prism_tissue,
            bone_faces,
            attachment,
            depth_cut_nodes: Vec::new(),
            facing: Vec::new(),
        };
        Ok(Self { mesh, boundary, cell_indices, warnings })
    }

    /// Checks that each connected part is held against all six rigid motions.
    ///
    /// # Errors
    /// [`SolveError::Problem`] with the place of a part that is not.
    pub fn check_support(&self) -> Result<(), SolveError> {
        check_support(&self.mesh, &self.boundary)
    }

    /// Triangles of the outer surface as node indices, counter-clockwise from outside.
    ///
    /// These are the prisms' outer triangles on the boundary; without prisms, the boundary triangles that are not at bone.
    #[must_use]
    pub fn outer_faces(&self) -> Vec<[u32; 3]> {
        let mesh = &self.mesh;
        // `new` has checked that the mesh is conforming.
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

    /// Number of prisms with an outer corner that is an inner corner of another prism.
    ///
    /// They cannot be C1 prisms.
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

/// A tetrahedron of positive volume.
struct Turned {
    corners: [u32; 4],
    was_inside_out: bool,
}

/// Orients a tetrahedron; `None` when it is flat.
fn turn_tetrahedron(corners: [u32; 4], x: &[Point]) -> Option<Turned> {
    let [a, b, c, d] = corners.map(|n| x[n as usize]);
    let (p, q, r) = (b - a, c - a, d - a);
    let volume = p.cross(&q).dot(&r);
    let [i, j, k, l] = corners;
    let size = p.norm() * q.norm() * r.norm();
    if volume.abs() <= 1e-12 * size || size == 0.0 {
        None
    } else if volume > 0.0 {
        Some(Turned { corners, was_inside_out: false })
    } else {
        Some(Turned { corners: [i, k, j, l], was_inside_out: true })
    }
}

/// Orients the wedge so that the normal of its first triangle points away from the second, as in VTK's file format guide;
/// `None` for a flat wedge. Files commonly use either orientation, so the other one is not an error.
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

/// Checks that the triangles of the wedges are numbered from opposite corners.
///
/// The triangles of a thin wedge may be turned against each other by more than 60° all the same. Its sides then are those of
/// its neighbours; the sides of a wedge with the wrong numbers are not.
///
/// # Errors
/// [`ReadyMeshError::Twisted`] for a twisted wedge that shares no side with another.
fn twisted_wedges(prisms: &[[u32; 6]], cells: &[CellIndex], x: &[Point]) -> Result<Option<Warning>, ReadyMeshError> {
    let of_cell = |(cell, index): (usize, &CellIndex)| match index {
        CellIndex::Prism(prism) => Some((cell, prisms[*prism as usize])),
        CellIndex::Tetrahedron(_) => None,
    };
    let wedges = cells.iter().enumerate().filter_map(of_cell);
    let twisted: Vec<(usize, [u32; 6])> = wedges.filter(|(_, corners)| is_twisted(*corners, x)).collect();
    let Some((first, _)) = twisted.first() else { return Ok(None) };
    let mut sides: Vec<[u32; 4]> = prisms.iter().flat_map(sides_of).collect();
    sides.sort_unstable();
    let is_shared = |side: &[u32; 4]| {
        let at = sides.partition_point(|s| s < side);
        sides.get(at + 1) == Some(side)
    };
    match twisted.iter().find(|(_, corners)| !sides_of(corners).iter().any(is_shared)) {
        Some(&(cell, corners)) => Err(ReadyMeshError::Twisted { cell, corners: [corners[3], corners[0]] }),
        None => {
            let n = twisted.len();
            let message = format!("{n} wedges are twisted by more than 60°, the first is cell {first}");
            Ok(Some(Warning::info("twisted-wedges", message)))
        }
    }
}

/// The corners of the sides of a wedge, ascending.
fn sides_of(corners: &[u32; 6]) -> [[u32; 4]; 3] {
    [(0, 1), (1, 2), (2, 0)].map(|(i, j)| {
        let mut side = [corners[i], corners[j], corners[3 + i], corners[3 + j]];
        side.sort_unstable();
        side
    })
}

/// Whether the second triangle matches the first better with its corners rotated by one or two: the wedge is then twisted by more
/// than 60°, though its volume may be positive everywhere.
fn is_twisted(corners: [u32; 6], x: &[Point]) -> bool {
    let p = corners.map(|n| x[n as usize].coords);
    let middles = [p[0] + p[1] + p[2], p[3] + p[4] + p[5]].map(|sum| sum / 3.0);
    let fit =
        |shift: usize| -> f64 { (0..3).map(|i| (p[i] - middles[0]).dot(&(p[3 + (i + shift) % 3] - middles[1]))).sum() };
    fit(0) < fit(1).max(fit(2))
}

/// Warning about boundary points of different cells in the same place, where tissue is not joined.
fn coincident_points(x: &[Point], tetrahedra: &[[u32; 4]], prisms: &[[u32; 6]]) -> Option<Warning> {
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
    let message = format!(
        "at {} places points of different cells lie in the same place, the first are {} and {} at ({:.2}, {:.2}, {:.2}) mm: \
         tissue is not joined there and opens as a slit",
        same.len(),
        first[0],
        first[1],
        p.x,
        p.y,
        p.z
    );
    Some(Warning::check("coincident-points", message).act("Merge the points unless a slit is intended."))
}

/// Triangles that belong to one cell only, by their sorted corners.
struct BoundaryFaces {
    sorted: Vec<[u32; 3]>,
}

fn sorted(mut triangle: [u32; 3]) -> [u32; 3] {
    triangle.sort_unstable();
    triangle
}

/// Whether the corners are an even permutation of their ascending order.
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
        // All are counter-clockwise from outside, so two cells on either side of a triangle list it in opposite orientations.
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

    /// Exchanges the triangles of prisms where only the second lies on the boundary, or both do and the second has fewer held
    /// corners.
    fn outer_first(&self, prisms: &mut [[u32; 6]], attachment: &[Attachment]) {
        let held = |t: &[u32]| t.iter().filter(|&&n| attachment[n as usize] != Attachment::Free).count();
        for prism in prisms {
            let [first, second] = triangles_of(prism);
            let exchange = match (self.contains(first), self.contains(second)) {
                (true, true) => held(&second) < held(&first),
                (outer_is_first, outer_is_second) => outer_is_second && !outer_is_first,
            };
            if exchange {
                // The corners are reversed too, which keeps the handedness.
                let [a, b, c, d, e, f] = *prism;
                *prism = [d, f, e, a, c, b];
            }
        }
    }
}

/// Boundary triangles at bone: those without a free corner, and those around a sliding point that belongs to none of these.
///
/// An outer triangle of a prism counts only if it has a sliding corner.
fn bone_faces(tetrahedra: &[[u32; 4]], prisms: &[[u32; 6]], attachment: &[Attachment]) -> Vec<[u32; 3]> {
    let (faces, n_outer) = boundary_of(tetrahedra, prisms);
    let slides = |n: &u32| matches!(attachment[*n as usize], Attachment::Sliding | Attachment::Gliding(_));
    let is_whole = |i: usize, t: &[u32; 3]| {
        t.iter().all(|&n| attachment[n as usize] != Attachment::Free) && (i >= n_outer || t.iter().any(slides))
    };
    let mut covered = vec![false; attachment.len()];
    let whole: Vec<bool> = faces.iter().enumerate().map(|(i, t)| is_whole(i, t)).collect();
    for (t, _) in faces.iter().zip(&whole).filter(|(_, whole)| **whole) {
        t.iter().for_each(|n| covered[*n as usize] = true);
    }
    let alone = |t: &[u32; 3]| t.iter().any(|n| slides(n) && !covered[*n as usize]);
    faces.iter().zip(&whole).filter(|(t, whole)| **whole || alone(t)).map(|(t, _)| *t).collect()
}

fn array_fault(on: &'static str, name: &'static str, detail: String) -> ReadyMeshError {
    ReadyMeshError::Array { on, name, detail }
}

/// Whole numbers from `min` to `max`, one for each point or cell.
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

fn tissues(volume: &VolumeMesh, warnings: &mut Vec<Warning>) -> Result<Vec<Tissue>, ReadyMeshError> {
    let Some(array) = volume.cell_array("tissue") else {
        let message = "there is no cell array `tissue`: wedges are taken as skin, tetrahedra as fat";
        warnings.push(Warning::check("no-tissue-array", message).act("Add the array, or check its spelling."));
        let guess = |cell: &Cell| match cell {
            Cell::Tetrahedron(_) => Tissue::Fat,
            Cell::Wedge(_) => Tissue::Skin,
        };
        return Ok(volume.cells.iter().map(guess).collect());
    };
    let numbers = whole_numbers(array, "cell", "tissue", 0, 4)?;
    let tissue = |number: i64| match number {
        0 => Tissue::Skin,
        1 => Tissue::Muscle,
        2 => Tissue::Fat,
        3 => Tissue::Mucosa,
        _ => Tissue::Cartilage,
    };
    Ok(numbers.into_iter().map(tissue).collect())
}

fn attachments(volume: &VolumeMesh, warnings: &mut Vec<Warning>) -> Result<Vec<Attachment>, ReadyMeshError> {
    let Some(array) = volume.point_array("attachment") else {
        let message = "there is no point array `attachment`: no point is tied to bone or slides on it";
        warnings.push(Warning::check("no-attachment-array", message).act("Add the array, or check its spelling."));
        return Ok(vec![Attachment::Free; volume.points.len()]);
    };
    let most = i64::from(u32::MAX);
    let numbers = whole_numbers(array, "point", "attachment", -3 - most, most)?;
    let attachment = |number: i64| match u32::try_from(number) {
        Ok(segment) => Attachment::Tied(segment),
        Err(_) if number == -1 => Attachment::Free,
        Err(_) => u32::try_from(-3 - number).map_or(Attachment::Sliding, Attachment::Gliding),
    };
    Ok(numbers.into_iter().map(attachment).collect())
}

fn held_axes(volume: &VolumeMesh) -> Result<Vec<u8>, ReadyMeshError> {
    let Some(array) = volume.point_array("fixed_mask") else { return Ok(Vec::new()) };
    Ok(whole_numbers(array, "point", "fixed_mask", 0, 7)?.into_iter().map(|bits| bits as u8).collect())
}

/// Three numbers for each point; empty when there is no such array.
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

/// Refuses a displacement along an axis that is not held, which would have no effect.
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

/// Refuses a load on a point that belongs to no cell, which would have no effect.
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
mod tests;
