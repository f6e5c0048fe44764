use std::collections::BTreeMap;

use gltf_json::Node;
use gltf_json::accessor::Type;
use gltf_json::mesh::Semantic;
use gltf_json::validation::Checked::Valid;

use super::SurfaceView;
use super::glb_body::{Body, GLTF_FROM_LPS};
use super::view::identifier;

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
        attributes.insert(Valid(Semantic::Colors(0)), body.colours(colours));
    }
    for (name, values) in surface.scalars {
        let (values, _) = values.as_chunks::<1>();
        let accessor = body.floats(values, Type::Scalar, true);
        attributes.insert(Valid(Semantic::Extras(identifier(name).to_ascii_uppercase())), accessor);
    }

    let mesh = Some(body.surface(attributes, mesh, Vec::new(), None));
    let node = Node { matrix: Some(GLTF_FROM_LPS), mesh, name: Some("LPS mm".to_owned()), ..Node::default() };
    body.finish(node, None)
}
