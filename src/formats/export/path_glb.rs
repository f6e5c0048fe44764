use std::collections::BTreeMap;

use gltf_json::accessor::sparse::{Indices, Sparse, Values};
use gltf_json::accessor::{Accessor, ComponentType, IndexComponentType, Type};
use gltf_json::animation::{Animation, Channel, Interpolation, Property, Sampler, Target as Animated};
use gltf_json::buffer::{Stride, Target, View};
use gltf_json::extras::RawValue;
use gltf_json::mesh::{MorphTarget, Semantic};
use gltf_json::validation::Checked::Valid;
use gltf_json::validation::USize64;
use gltf_json::{Index, Node, Value};

use super::glb_body::{Body, GLTF_FROM_LPS, accessor_of};
use prosopon_geometry::{Aabb, Point, TriMesh};

/// Largest whole number of a quantised coordinate.
const LARGEST: f64 = 32767.0;
/// Largest whole number of a quantised component of a normal.
const UNIT: f64 = 127.0;
/// Extension by which positions and normals are whole numbers.
const QUANTISED: &str = "KHR_mesh_quantization";

/// A surface that moves along a path, for [`path_glb`].
#[derive(Debug, Clone, Copy)]
pub struct PathView<'a> {
    /// The surface at rest, at time 0.
    pub rest: &'a TriMesh,
    /// The steps, in the order of their times.
    pub steps: &'a [PathStep],
    /// sRGB colour per vertex, the same along the whole path.
    pub colours: Option<&'a [[u8; 3]]>,
    /// A JSON object of facts about the path, for the scene's `extras`.
    pub extras: &'a str,
}

/// A step of a path.
#[derive(Debug, Clone)]
pub struct PathStep {
    /// Name of its morph target.
    pub name: String,
    /// When it is reached, s; after that of the step before.
    pub time_s: f64,
    /// The moved surface, with the vertices and triangles of that at rest.
    pub moved: TriMesh,
}

/// Binary glTF 2.0 of a surface that moves along a path: one morph target a step, and an animation that plays them.
///
/// Positions are whole numbers of 16 bits (`KHR_mesh_quantization`), a step of which is the largest extent divided by 65 534:
/// 4 µm for a head. Morph targets hold only the vertices that move. Other conventions are those of [`glb`](super::glb()).
///
/// # Panics
/// When a step or the colours do not have exactly one value per vertex.
#[must_use]
pub fn path_glb(path: &PathView<'_>) -> Vec<u8> {
    let count = path.rest.positions().len();
    assert!(path.steps.iter().all(|s| s.moved.positions().len() == count), "vertices of each step, of those at rest");
    assert_eq!(path.colours.map_or(count, <[_]>::len), count, "colours, of vertices");
    let grid = Grid::around(path);
    let mut body = Body::default();
    let mut attributes = BTreeMap::new();
    let rest = Quantised::of(path.rest, &grid);
    attributes.insert(Valid(Semantic::Positions), positions(&mut body, &rest));
    attributes.insert(Valid(Semantic::Normals), normals(&mut body, &rest));
    if let Some(colours) = path.colours {
        attributes.insert(Valid(Semantic::Colors(0)), body.colours(colours));
    }
    let targets: Vec<MorphTarget> =
        path.steps.iter().map(|step| target(&mut body, &rest, &Quantised::of(&step.moved, &grid))).collect();
    let names: Vec<&str> = path.steps.iter().map(|s| s.name.as_str()).collect();
    // glTF has no names of morph targets; all programs read them here.
    let names = raw(&Value::from_iter([("targetNames", Value::from(names))]).to_string());
    let mesh = Some(body.surface(attributes, path.rest, targets, names));
    if !path.steps.is_empty() {
        animate(&mut body, path.steps);
    }
    let quantised = || vec![QUANTISED.to_owned()];
    (body.root.extensions_used, body.root.extensions_required) = (quantised(), quantised());
    let node = Node { matrix: Some(grid.matrix()), mesh, name: Some("LPS mm".to_owned()), ..Node::default() };
    body.finish(node, raw(path.extras))
}

/// `json` as `extras`; none when it is no JSON.
fn raw(json: &str) -> Option<Box<RawValue>> {
    RawValue::from_string(json.to_owned()).ok()
}

/// Whole numbers for coordinates.
struct Grid {
    centre: Point,
    /// Distance of two neighbouring numbers, mm.
    step_mm: f64,
}

impl Grid {
    /// The finest grid on which all surfaces and all displacements lie.
    fn around(path: &PathView<'_>) -> Self {
        let surfaces = || std::iter::once(path.rest).chain(path.steps.iter().map(|s| &s.moved));
        let bounds = Aabb::of(surfaces().flat_map(TriMesh::positions));
        let (centre, half) = bounds.map_or((Point::origin(), 1.0), |b| (b.center(), 0.5 * (b.max - b.min).amax()));
        let moved = path.steps.iter().flat_map(|s| path.rest.positions().iter().zip(s.moved.positions()));
        let farthest = moved.map(|(from, to)| (to - from).amax()).fold(half, f64::max);
        Self { centre, step_mm: (farthest / (LARGEST - 1.0)).max(f64::MIN_POSITIVE) }
    }

    fn whole(&self, p: &Point) -> [i16; 3] {
        ((p - self.centre) / self.step_mm).map(|x| x.round().clamp(-LARGEST, LARGEST) as i16).into()
    }

    /// Matrix from the grid to glTF's metres, column-major.
    fn matrix(&self) -> [f32; 16] {
        let mut matrix = GLTF_FROM_LPS;
        let (columns, _) = GLTF_FROM_LPS.as_chunks::<4>();
        let origin = |row: usize| {
            columns.iter().zip(self.centre.iter()).map(|(column, x)| f64::from(column[row]) * x).sum::<f64>() as f32
        };
        for (at, value) in matrix.iter_mut().enumerate() {
            match at {
                12..=14 => *value = origin(at - 12),
                0..12 => *value = (f64::from(*value) * self.step_mm) as f32,
                _ => {}
            }
        }
        matrix
    }
}

/// Positions and normals of a surface as whole numbers.
struct Quantised {
    positions: Vec<[i16; 3]>,
    normals: Vec<[i8; 3]>,
}

impl Quantised {
    fn of(surface: &TriMesh, grid: &Grid) -> Self {
        let normal = |n: &prosopon_geometry::Vector| {
            let n = if n.norm_squared() > 0.0 { n.normalize() } else { prosopon_geometry::Vector::z() };
            n.map(|x| (UNIT * x).round() as i8).into()
        };
        Self {
            positions: surface.positions().iter().map(|p| grid.whole(p)).collect(),
            normals: surface.vertex_normals().iter().map(normal).collect(),
        }
    }
}

/// Appends positions, each padded to 8 bytes.
fn positions(body: &mut Body, surface: &Quantised) -> Index<Accessor> {
    let bytes: Vec<u8> =
        surface.positions.iter().flat_map(|&[x, y, z]| [x, y, z, 0]).flat_map(i16::to_le_bytes).collect();
    let view = strided(body, &bytes, 8);
    let mut accessor = accessor_of(Some(view), surface.positions.len(), ComponentType::I16, Type::Vec3);
    bound(&mut accessor, &surface.positions);
    body.root.push(accessor)
}

/// Appends normals, each padded to 4 bytes.
fn normals(body: &mut Body, surface: &Quantised) -> Index<Accessor> {
    let bytes: Vec<u8> = surface.normals.iter().flat_map(|&[x, y, z]| [x, y, z, 0]).flat_map(i8::to_le_bytes).collect();
    let view = strided(body, &bytes, 4);
    let mut accessor = accessor_of(Some(view), surface.normals.len(), ComponentType::I8, Type::Vec3);
    accessor.normalized = true;
    body.root.push(accessor)
}

fn strided(body: &mut Body, bytes: &[u8], stride: usize) -> Index<View> {
    let view = body.view(bytes, Some(Target::ArrayBuffer));
    if let Some(view) = body.root.buffer_views.get_mut(view.value()) {
        view.byte_stride = Some(Stride(stride));
    }
    view
}

/// States the smallest and largest value of each component.
fn bound(accessor: &mut Accessor, values: &[[i16; 3]]) {
    let over = |pick: fn(i16, i16) -> i16| {
        let first = values.first().copied().unwrap_or_default();
        let bound = values.iter().fold(first, |b, v| [0, 1, 2].map(|i: usize| pick(b[i], v[i])));
        Some(Value::from(bound.to_vec()))
    };
    (accessor.min, accessor.max) = (over(i16::min), over(i16::max));
}

/// Appends the differences between `moved` and `rest`, of the vertices that differ.
fn target(body: &mut Body, rest: &Quantised, moved: &Quantised) -> MorphTarget {
    let count = rest.positions.len();
    // The difference of the rounded values is exact, so rounding does not add up; the grid is wide enough for it.
    let by = |from: [i16; 3], to: [i16; 3]| [0, 1, 2].map(|i: usize| to[i].saturating_sub(from[i]));
    let turned = |from: [i8; 3], to: [i8; 3]| [0, 1, 2].map(|i: usize| to[i].saturating_sub(from[i]).max(-127));
    let pairs = rest.positions.iter().zip(&moved.positions).zip(rest.normals.iter().zip(&moved.normals));
    let differences = pairs.map(|((p, q), (m, n))| (by(*p, *q), turned(*m, *n)));
    // Vertex 0 is always among them, since readers refuse an accessor without any value.
    let moving: Vec<(usize, ([i16; 3], [i8; 3]))> =
        differences.enumerate().filter(|(v, d)| *v == 0 || *d != ([0; 3], [0; 3])).collect();
    // 2 bytes a vertex where that is enough.
    let is_small = count <= usize::from(u16::MAX);
    let numbers: Vec<u8> = match is_small {
        true => moving.iter().flat_map(|(v, _)| (*v as u16).to_le_bytes()).collect(),
        false => moving.iter().flat_map(|(v, _)| (*v as u32).to_le_bytes()).collect(),
    };
    let width = if is_small { IndexComponentType(ComponentType::U16) } else { IndexComponentType(ComponentType::U32) };
    let (mut position, mut normal) = (
        accessor_of(None, count, ComponentType::I16, Type::Vec3),
        accessor_of(None, count, ComponentType::I8, Type::Vec3),
    );
    normal.normalized = true;
    let by: Vec<[i16; 3]> = moving.iter().map(|(_, (by, _))| *by).chain(std::iter::once([0; 3])).collect();
    bound(&mut position, &by);
    let numbers = body.view(&numbers, None);
    let sparse = |values| Sparse {
        count: USize64::from(moving.len()),
        indices: Indices {
            buffer_view: numbers,
            byte_offset: USize64(0),
            component_type: Valid(width),
            extensions: None,
            extras: None,
        },
        values: Values { buffer_view: values, byte_offset: USize64(0), extensions: None, extras: None },
        extensions: None,
        extras: None,
    };
    let bytes: Vec<u8> = moving.iter().flat_map(|(_, (by, _))| *by).flat_map(i16::to_le_bytes).collect();
    position.sparse = Some(sparse(body.view(&bytes, None)));
    let bytes: Vec<u8> = moving.iter().flat_map(|(_, (_, by))| *by).flat_map(i8::to_le_bytes).collect();
    normal.sparse = Some(sparse(body.view(&bytes, None)));
    let (positions, normals) = (Some(body.root.push(position)), Some(body.root.push(normal)));
    MorphTarget { positions, normals, tangents: None }
}

/// Adds an animation that goes from rest through all steps, with straight lines between them.
fn animate(body: &mut Body, steps: &[PathStep]) {
    let times: Vec<[f32; 1]> = std::iter::once(0.0).chain(steps.iter().map(|s| s.time_s as f32)).map(|t| [t]).collect();
    // At its time a step's target counts alone; at time 0 none does.
    let weights: Vec<[f32; 1]> = (0..=steps.len())
        .flat_map(|at| (1..=steps.len()).map(move |step| [if step == at { 1.0 } else { 0.0 }]))
        .collect();
    let (input, output) = (body.values(&times, true), body.values(&weights, false));
    let sampler =
        Sampler { input, output, interpolation: Valid(Interpolation::Linear), extensions: None, extras: None };
    let target =
        Animated { node: Index::new(0), path: Valid(Property::MorphTargetWeights), extensions: None, extras: None };
    body.root.push(Animation {
        channels: vec![Channel { sampler: Index::new(0), target, extensions: None, extras: None }],
        samplers: vec![sampler],
        name: Some("path".to_owned()),
        extensions: None,
        extras: None,
    });
}
