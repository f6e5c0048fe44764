use std::collections::BTreeMap;

use gltf_json::accessor::{Accessor, ComponentType, GenericComponentType, Type};
use gltf_json::buffer::{Buffer, Target, View};
use gltf_json::material::{Material, PbrMetallicRoughness, StrengthFactor};
use gltf_json::mesh::{Mesh, Mode, Primitive, Semantic};
use gltf_json::validation::Checked::Valid;
use gltf_json::validation::USize64;
use gltf_json::{Asset, Index, Node, Root, Scene, Value};

use super::SurfaceView;
use super::view::identifier;

/// Matrix from LPS mm (x left, y back, z up) to glTF metres (x left, y up, z front), column-major.
const GLTF_FROM_LPS: [f32; 16] = [1e-3, 0., 0., 0., 0., 0., -1e-3, 0., 0., 1e-3, 0., 0., 0., 0., 0., 1.];

/// Binary glTF 2.0 with normals, vertex colours and each scalar as a `_NAME` attribute.
///
/// Coordinates in the buffer are LPS mm as `f32`. glTF is y-up and in metres: the matrix of the root node maps to that.
/// Colours are converted from sRGB to linear light, which glTF demands. An undefined normal points along z. A NaN scalar
/// stays NaN, although glTF allows only finite numbers, because any substitute would look like a value.
///
/// # Panics
/// When scalars or colours do not have exactly one value per vertex.
#[must_use]
pub fn glb(surface: &SurfaceView<'_>) -> Vec<u8> {
    surface.assert_lengths();
    let mesh = surface.mesh;
    let mut body = Body::default();
    let mut attributes = BTreeMap::new();

    let positions: Vec<[f32; 3]> = mesh.positions().iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
    let accessor = body.floats(&positions, Type::Vec3, true);
    attributes.insert(Valid(Semantic::Positions), accessor);

    let normal = |n: &prosopon_geometry::Vector| {
        if n.norm_squared() > 0.0 { [n.x as f32, n.y as f32, n.z as f32] } else { [0.0, 0.0, 1.0] }
    };
    let normals: Vec<[f32; 3]> = mesh.vertex_normals().iter().map(normal).collect();
    attributes.insert(Valid(Semantic::Normals), body.floats(&normals, Type::Vec3, false));

    if let Some(colours) = surface.colours {
        // 16 bits, since 8 bits of linear light are too coarse for dark colours; four values, to align each colour to 4 bytes.
        let linear = |c: u8| (linear_light(c) * 65535.0).round() as u16;
        let bytes = colours.iter().flat_map(|&[r, g, b]| [linear(r), linear(g), linear(b), u16::MAX]);
        let bytes: Vec<u8> = bytes.flat_map(u16::to_le_bytes).collect();
        let view = body.view(&bytes, Target::ArrayBuffer);
        let mut accessor = accessor_of(view, colours.len(), ComponentType::U16, Type::Vec4);
        accessor.normalized = true;
        attributes.insert(Valid(Semantic::Colors(0)), body.root.push(accessor));
    }
    for (name, values) in surface.scalars {
        let (values, _) = values.as_chunks::<1>();
        let accessor = body.floats(values, Type::Scalar, true);
        attributes.insert(Valid(Semantic::Extras(identifier(name).to_ascii_uppercase())), accessor);
    }

    let bytes: Vec<u8> = mesh.triangles().as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    let view = body.view(&bytes, Target::ElementArrayBuffer);
    let indices = accessor_of(view, 3 * mesh.triangles().len(), ComponentType::U32, Type::Scalar);
    let indices = Some(body.root.push(indices));

    let material = Some(body.root.push(matt()));
    let primitive = Primitive {
        attributes,
        extensions: None,
        extras: None,
        indices,
        material,
        mode: Valid(Mode::Triangles),
        targets: None,
    };
    let mesh = Mesh { extensions: None, extras: None, name: None, primitives: vec![primitive], weights: None };
    let mesh = Some(body.root.push(mesh));
    let node = Node { matrix: Some(GLTF_FROM_LPS), mesh, name: Some("LPS mm".to_owned()), ..Node::default() };
    let node = body.root.push(node);
    let scene = body.root.push(Scene { extensions: None, extras: None, name: None, nodes: vec![node] });
    body.root.scene = Some(scene);
    body.finish()
}

/// A matt, double-sided material: open surfaces show their inside, and glTF's default material is metal.
fn matt() -> Material {
    let pbr_metallic_roughness = PbrMetallicRoughness {
        metallic_factor: StrengthFactor(0.0),
        roughness_factor: StrengthFactor(0.8),
        ..PbrMetallicRoughness::default()
    };
    Material { double_sided: true, pbr_metallic_roughness, ..Material::default() }
}

/// Linear light of an sRGB value, 0 to 1 (IEC 61966-2-1).
fn linear_light(c: u8) -> f64 {
    let c = f64::from(c) / 255.0;
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// The single buffer and the JSON that describes it.
#[derive(Default)]
struct Body {
    root: Root,
    bytes: Vec<u8>,
}

impl Body {
    /// Appends `bytes`, whose length is a multiple of 4, so that every view is aligned.
    fn view(&mut self, bytes: &[u8], target: Target) -> Index<View> {
        let byte_offset = Some(USize64::from(self.bytes.len()));
        self.bytes.extend(bytes);
        self.root.push(View {
            buffer: Index::new(0),
            byte_length: USize64::from(bytes.len()),
            byte_offset,
            byte_stride: None,
            name: None,
            target: Some(Valid(target)),
            extensions: None,
            extras: None,
        })
    }

    /// Appends an attribute; `bounded` also states the smallest and largest value of each component.
    fn floats<const N: usize>(&mut self, values: &[[f32; N]], type_: Type, bounded: bool) -> Index<Accessor> {
        let bytes: Vec<u8> = values.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes, Target::ArrayBuffer);
        let mut accessor = accessor_of(view, values.len(), ComponentType::F32, type_);
        // `f32::min` ignores NaN. An attribute without a finite bound gets none.
        let bound = |start: f32, pick: fn(f32, f32) -> f32| {
            let bound = values.iter().fold([start; N], |b, v| std::array::from_fn(|i| pick(b[i], v[i])));
            bound.iter().all(|x| x.is_finite()).then(|| Value::from(bound.to_vec()))
        };
        if bounded {
            accessor.min = bound(f32::INFINITY, f32::min);
            accessor.max = bound(f32::NEG_INFINITY, f32::max);
        }
        self.root.push(accessor)
    }

    /// Header, JSON chunk and binary chunk, each a multiple of 4 bytes long.
    fn finish(mut self) -> Vec<u8> {
        self.root.asset = Asset { generator: Some("Prosopon".to_owned()), ..Asset::default() };
        self.root.push(Buffer {
            byte_length: USize64::from(self.bytes.len()),
            name: None,
            uri: None,
            extensions: None,
            extras: None,
        });
        // Serialisation cannot fail: the numbers and names above always have a JSON form.
        let mut json = gltf_json::serialize::to_vec(&self.root).unwrap_or_default();
        json.resize(json.len().next_multiple_of(4), b' ');
        let length = 12 + 8 + json.len() + 8 + self.bytes.len();
        let mut glb = Vec::with_capacity(length);
        let word = |n: usize| (n as u32).to_le_bytes();
        glb.extend(b"glTF");
        glb.extend([word(2), word(length)].as_flattened());
        glb.extend(word(json.len()));
        glb.extend(b"JSON");
        glb.extend(json);
        glb.extend(word(self.bytes.len()));
        glb.extend(b"BIN\0");
        glb.extend(self.bytes);
        glb
    }
}

fn accessor_of(view: Index<View>, count: usize, component: ComponentType, type_: Type) -> Accessor {
    Accessor {
        buffer_view: Some(view),
        byte_offset: None,
        count: USize64::from(count),
        component_type: Valid(GenericComponentType(component)),
        extensions: None,
        extras: None,
        type_: Valid(type_),
        min: None,
        max: None,
        name: None,
        normalized: false,
        sparse: None,
    }
}
