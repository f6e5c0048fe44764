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
mod tests;
