//! Parts that all writers of binary glTF share.

use std::collections::BTreeMap;

use gltf_json::accessor::{Accessor, ComponentType, GenericComponentType, Type};
use gltf_json::buffer::{Buffer, Target, View};
use gltf_json::extras::Extras;
use gltf_json::material::{Material, PbrMetallicRoughness, StrengthFactor};
use gltf_json::mesh::{Mesh, Mode, MorphTarget, Primitive, Semantic};
use gltf_json::validation::Checked::{self, Valid};
use gltf_json::validation::USize64;
use gltf_json::{Asset, Index, Node, Root, Scene, Value};

use prosopon_geometry::TriMesh;

/// Matrix from LPS mm (x left, y back, z up) to glTF metres (x left, y up, z front), column-major.
pub(super) const GLTF_FROM_LPS: [f32; 16] = [1e-3, 0., 0., 0., 0., 0., -1e-3, 0., 0., 1e-3, 0., 0., 0., 0., 0., 1.];

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
pub(super) struct Body {
    pub(super) root: Root,
    bytes: Vec<u8>,
}

impl Body {
    /// Appends vertex colours, given in sRGB.
    pub(super) fn colours(&mut self, colours: &[[u8; 3]]) -> Index<Accessor> {
        // 16 bits, since 8 bits of linear light are too coarse for dark colours; four values, to align each colour to 4 bytes.
        let linear = |c: u8| (linear_light(c) * 65535.0).round() as u16;
        let bytes = colours.iter().flat_map(|&[r, g, b]| [linear(r), linear(g), linear(b), u16::MAX]);
        let bytes: Vec<u8> = bytes.flat_map(u16::to_le_bytes).collect();
        let view = self.view(&bytes, Some(Target::ArrayBuffer));
        let mut accessor = accessor_of(Some(view), colours.len(), ComponentType::U16, Type::Vec4);
        accessor.normalized = true;
        self.root.push(accessor)
    }

    /// Appends the triangles of a mesh.
    fn triangles(&mut self, mesh: &TriMesh) -> Index<Accessor> {
        let bytes: Vec<u8> = mesh.triangles().as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(Target::ElementArrayBuffer));
        let indices = accessor_of(Some(view), 3 * mesh.triangles().len(), ComponentType::U32, Type::Scalar);
        self.root.push(indices)
    }

    /// Appends `bytes`, and zeros up to a multiple of 4, so that every view is aligned.
    pub(super) fn view(&mut self, bytes: &[u8], target: Option<Target>) -> Index<View> {
        let byte_offset = Some(USize64::from(self.bytes.len()));
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.root.push(View {
            buffer: Index::new(0),
            byte_length: USize64::from(bytes.len()),
            byte_offset,
            byte_stride: None,
            name: None,
            target: target.map(Valid),
            extensions: None,
            extras: None,
        })
    }

    /// Appends the mesh of a surface; `targets` are its morph targets, which begin without weight.
    pub(super) fn surface(
        &mut self,
        attributes: BTreeMap<Checked<Semantic>, Index<Accessor>>,
        triangles: &TriMesh,
        targets: Vec<MorphTarget>,
        extras: Extras,
    ) -> Index<Mesh> {
        let weights = (!targets.is_empty()).then(|| vec![0.0; targets.len()]);
        let primitive = Primitive {
            attributes,
            extensions: None,
            extras: None,
            indices: Some(self.triangles(triangles)),
            material: Some(self.root.push(matt())),
            mode: Valid(Mode::Triangles),
            targets: (!targets.is_empty()).then_some(targets),
        };
        self.root.push(Mesh { extensions: None, extras, name: None, primitives: vec![primitive], weights })
    }

    /// Appends an attribute; `bounded` also states the smallest and largest value of each component.
    pub(super) fn floats<const N: usize>(
        &mut self,
        values: &[[f32; N]],
        type_: Type,
        bounded: bool,
    ) -> Index<Accessor> {
        self.numbers(values, type_, bounded, Some(Target::ArrayBuffer))
    }

    /// Appends numbers of an animation.
    pub(super) fn values(&mut self, values: &[[f32; 1]], bounded: bool) -> Index<Accessor> {
        self.numbers(values, Type::Scalar, bounded, None)
    }

    fn numbers<const N: usize>(
        &mut self,
        values: &[[f32; N]],
        type_: Type,
        bounded: bool,
        target: Option<Target>,
    ) -> Index<Accessor> {
        let bytes: Vec<u8> = values.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes, target);
        let mut accessor = accessor_of(Some(view), values.len(), ComponentType::F32, type_);
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

    /// The file of a scene with one node: header, JSON chunk and binary chunk, each a multiple of 4 bytes long.
    pub(super) fn finish(mut self, node: Node, extras: Extras) -> Vec<u8> {
        let node = self.root.push(node);
        let scene = self.root.push(Scene { extensions: None, extras, name: None, nodes: vec![node] });
        self.root.scene = Some(scene);
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

pub(super) fn accessor_of(view: Option<Index<View>>, count: usize, component: ComponentType, type_: Type) -> Accessor {
    Accessor {
        buffer_view: view,
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
