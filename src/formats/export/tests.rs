use std::collections::BTreeMap;

use gltf_json::Root;
use gltf_json::mesh::Semantic;
use gltf_json::validation::{Checked, Validate};

use super::*;
use crate::import::{Limits, SurfaceFormat, detect_surface, surface};
use prosopon_geometry::{Point, TriMesh};

/// A closed, slightly uneven hexagonal bipyramid of 100 mm around (30, -40, 50), with `f32` coordinates.
fn ball() -> TriMesh {
    let mut positions = vec![[0.0, 0.0, 50.0f32], [0.0, 0.0, -50.0]];
    for i in 0..6u8 {
        let a = f64::from(i) * std::f64::consts::FRAC_PI_3;
        positions.push([(50.0 * a.cos()) as f32, (50.0 * a.sin()) as f32, f32::from(i)]);
    }
    let ring = |i: u32| 2 + i % 6;
    let triangles = (0..6).flat_map(|i| [[0, ring(i), ring(i + 1)], [1, ring(i + 1), ring(i)]]).collect();
    let moved = |[x, y, z]: [f32; 3]| Point::new(f64::from(x + 30.0), f64::from(y - 40.0), f64::from(z + 50.0));
    TriMesh::new(positions.into_iter().map(moved).collect(), triangles).unwrap()
}

#[test]
fn stl_and_ply_come_back_as_they_were() {
    let mesh = ball();
    let limits = Limits::default();
    let bytes = stl(&mesh);
    assert_eq!(detect_surface(&bytes), Some(SurfaceFormat::Stl));
    let (back, warnings) = surface(&bytes, SurfaceFormat::Stl, &limits).unwrap();
    assert_eq!(warnings, []);
    let corners = |m: &TriMesh| (0..m.triangles().len()).map(|t| m.corners(t)).collect::<Vec<_>>();
    assert_eq!((back.positions().len(), corners(&back)), (8, corners(&mesh)));

    let thirds = mesh.with_positions(mesh.positions().iter().map(|p| p / 3.0).collect()).unwrap();
    let values: Vec<f32> = (0..8u8).map(f32::from).collect();
    let colours = [[1, 2, 3]; 8];
    for colours in [None, Some(&colours[..])] {
        let view = SurfaceView { mesh: &thirds, scalars: &[("displacement mm", &values)], colours };
        let bytes = ply(&view);
        assert_eq!(detect_surface(&bytes), Some(SurfaceFormat::Ply));
        let (back, warnings) = surface(&bytes, SurfaceFormat::Ply, &limits).unwrap();
        assert_eq!(warnings, []);
        assert_eq!(back, thirds);
        let bytes = vtp(&view);
        assert_eq!(detect_surface(&bytes), Some(SurfaceFormat::Vtp));
        let (back, warnings) = surface(&bytes, SurfaceFormat::Vtp, &limits).unwrap();
        assert_eq!(warnings, []);
        assert_eq!(back, thirds);
        // The values are the only run of eight rising floats.
        let run: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(bytes.windows(run.len()).filter(|w| **w == run[..]).count(), 1);
    }
}

/// Chunks of a GLB file.
fn glb_parts(bytes: &[u8]) -> (Root, &[u8]) {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
    let n = word(12);
    assert_eq!((n % 4, &bytes[16..20]), (0, &b"JSON"[..]));
    let root: Root = gltf_json::deserialize::from_slice(&bytes[20..20 + n]).unwrap();
    let body = &bytes[28 + n..];
    assert_eq!((word(20 + n), &bytes[24 + n..28 + n]), (body.len(), &b"BIN\0"[..]));
    (root, body)
}

#[test]
fn glb_holds_positions_normals_colours_scalars_and_the_way_to_gltf_axes() {
    let mesh = ball();
    let values = [-1.5, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.25f32];
    let colours = [[0, 128, 255]; 8];
    let view = SurfaceView { mesh: &mesh, scalars: &[("displacement_mm", &values)], colours: Some(&colours) };
    let bytes = glb(&view);
    let (root, body) = glb_parts(&bytes);
    let mut faults = Vec::new();
    root.validate(&root, gltf_json::Path::new, &mut |path, error| faults.push(format!("{} {error:?}", path())));
    assert_eq!(faults, [""; 0]);

    // Every view is aligned, in the buffer, and as long as its accessor states.
    let mut ends = 0;
    for (view, accessor) in root.buffer_views.iter().zip(&root.accessors) {
        let start = view.byte_offset.unwrap().0;
        assert_eq!((start % 4, start), (0, ends));
        ends = start + view.byte_length.0;
        assert_eq!(view.byte_length.0 % accessor.count.0, 0);
    }
    assert_eq!((ends, root.buffers[0].byte_length.0), (body.len() as u64, body.len() as u64));

    let primitive = &root.meshes[0].primitives[0];
    let read = |accessor: usize| {
        let view = &root.buffer_views[root.accessors[accessor].buffer_view.unwrap().value()];
        let start = view.byte_offset.unwrap().0 as usize;
        &body[start..start + view.byte_length.0 as usize]
    };
    let floats = |accessor: usize| -> Vec<f32> {
        read(accessor).chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    };
    let attributes: BTreeMap<String, usize> = primitive
        .attributes
        .iter()
        .map(|(semantic, index)| match semantic {
            Checked::Valid(semantic) => (semantic.to_string(), index.value()),
            Checked::Invalid => panic!("invalid attribute"),
        })
        .collect();
    assert_eq!(attributes.keys().collect::<Vec<_>>(), ["COLOR_0", "NORMAL", "POSITION", "_DISPLACEMENT_MM"]);

    let positions = floats(attributes["POSITION"]);
    let expected: Vec<f32> = mesh.positions().iter().flat_map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
    assert_eq!(positions, expected);
    let accessor = &root.accessors[attributes["POSITION"]];
    let bounds = mesh.bounds();
    let [low, high] =
        [bounds.min, bounds.max].map(|p| gltf_json::Value::from(vec![p.x as f32, p.y as f32, p.z as f32]));
    assert_eq!((accessor.min.as_ref(), accessor.max.as_ref()), (Some(&low), Some(&high)));
    assert_eq!(floats(attributes["_DISPLACEMENT_MM"]), values);
    for n in floats(attributes["NORMAL"]).chunks(3) {
        assert!((n.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-6);
    }
    // 128/255 in sRGB is 0.21586 in linear light.
    let colour: Vec<u16> =
        read(attributes["COLOR_0"])[..8].chunks(2).map(|b| u16::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!(colour, [0, 14146, 65535, 65535]);
    let indices: Vec<u32> =
        read(primitive.indices.unwrap().value()).chunks(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!(indices, mesh.triangles().as_flattened());

    // A point 100 mm left, 200 mm back and 300 mm up is at x 0.1, y 0.3, z -0.2 m.
    let matrix = nalgebra::Matrix4::from_column_slice(&root.nodes[0].matrix.unwrap());
    let seen = matrix.transform_point(&nalgebra::Point3::new(100.0f32, 200.0, 300.0));
    assert!((seen - nalgebra::Point3::new(0.1, 0.3, -0.2)).norm() < 1e-6);
    assert!(matrix.determinant() > 0.0, "mirrored");
}

#[test]
fn glb_keeps_a_missing_value_and_gives_an_undefined_normal_a_direction() {
    let points = vec![Point::origin(), Point::new(1.0, 0.0, 0.0), Point::new(2.0, 0.0, 0.0)];
    let mesh = TriMesh::new(points, vec![[0, 1, 2]]).unwrap();
    let values = [f32::NAN, 1.0, 3.0];
    let bytes = glb(&SurfaceView { mesh: &mesh, scalars: &[("error_mm", &values)], colours: None });
    let (root, body) = glb_parts(&bytes);
    let at = root.meshes[0].primitives[0].attributes[&Checked::Valid(Semantic::Extras("ERROR_MM".into()))].value();
    assert_eq!(root.accessors[at].min, Some(gltf_json::Value::from(vec![1.0f32])));
    // Positions and normals take 36 bytes each.
    assert!(f32::from_le_bytes(body[72..76].try_into().unwrap()).is_nan());
    assert_eq!(body[36..48], [0.0f32, 0.0, 1.0].map(f32::to_le_bytes).concat());
}

#[test]
fn vtu_describes_its_arrays_where_they_are() {
    let points: Vec<Point> = (0..7u8).map(|i| Point::new(f64::from(i), 0.5, -1.0)).collect();
    let values: Vec<f64> = (0..21u8).map(f64::from).collect();
    let bytes = vtu(
        &points,
        &[[0, 2, 1, 6]],
        &[[0, 2, 1, 3, 5, 4]],
        &[("a < \"b\" & c", 3, &values)],
        &[("tissue", 1, &[1.0, 2.0])],
    );
    let marker = b"<AppendedData encoding=\"raw\">\n_";
    let start = bytes.windows(marker.len()).position(|w| w == marker).unwrap();
    let xml = std::str::from_utf8(&bytes[..start]).unwrap();
    let body = &bytes[start + marker.len()..];
    assert!(body.ends_with(b"\n</AppendedData>\n</VTKFile>\n"));

    let field = |line: &str, name: &str| {
        let (_, rest) = line.split_once(&format!(" {name}=\"")).unwrap();
        rest.split_once('"').unwrap().0.to_owned()
    };
    let mut next = 0;
    let mut arrays = BTreeMap::new();
    for line in xml.lines().filter(|l| l.starts_with("<DataArray")) {
        let offset: usize = field(line, "offset").parse().unwrap();
        assert_eq!(offset, next);
        let length = u64::from_le_bytes(body[offset..offset + 8].try_into().unwrap()) as usize;
        next = offset + 8 + length;
        let described = (field(line, "type"), field(line, "NumberOfComponents"));
        arrays.insert(field(line, "Name"), (described, &body[offset + 8..next]));
    }
    assert_eq!(&body[next..], b"\n</AppendedData>\n</VTKFile>\n");
    let check = |name: &str, kind: &str, components: &str, expected: Vec<u8>| {
        let ((found_kind, found_components), found) = &arrays[name];
        assert_eq!(
            (found_kind.as_str(), found_components.as_str(), *found),
            (kind, components, &expected[..]),
            "{name}"
        );
    };
    let int64 = |values: &[i64]| values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let float64 = |values: &[f64]| values.iter().flat_map(|v| v.to_le_bytes()).collect();
    check("Points", "Float64", "3", float64(&points.iter().flat_map(|p| [p.x, p.y, p.z]).collect::<Vec<_>>()));
    check("connectivity", "Int64", "1", int64(&[0, 2, 1, 6, 0, 2, 1, 3, 5, 4]));
    check("offsets", "Int64", "1", int64(&[4, 10]));
    check("types", "UInt8", "1", vec![10, 13]);
    check("a &lt; &quot;b&quot; &amp; c", "Float64", "3", float64(&values));
    check("tissue", "Float64", "1", float64(&[1.0, 2.0]));
}

/// Every step of the path, read back through the quantised positions and the node's matrix, is the surface that was given.
#[test]
fn the_morph_targets_of_a_path_lead_to_its_steps() {
    let rest = ball();
    let moved = |by: f64| {
        let mut positions = rest.positions().to_vec();
        positions[0] += prosopon_geometry::Vector::new(by, -0.5 * by, 0.1);
        rest.with_positions(positions).unwrap()
    };
    let step = |time_s: f64, by: f64| PathStep { name: format!("to {by}"), time_s, moved: moved(by) };
    // At the last step nothing differs from rest, as a target without vertices.
    let steps =
        [step(1.0, 3.0), step(2.0, 6.0), PathStep { name: "back".to_owned(), time_s: 4.0, moved: rest.clone() }];
    let colours = [[10, 20, 30]; 8];
    let path = PathView { rest: &rest, steps: &steps, colours: Some(&colours), extras: r#"{"length_unit": "mm"}"# };
    let bytes = path_glb(&path);
    let (root, body) = glb_parts(&bytes);
    let mut faults = Vec::new();
    root.validate(&root, gltf_json::Path::new, &mut |path, error| faults.push(format!("{} {error:?}", path())));
    // The crate knows no quantised positions.
    assert!(faults.iter().all(|f| f.contains("extensionsRequired")), "{faults:?}");

    let shorts = |view: usize, stride: usize| -> Vec<[f64; 3]> {
        let view = &root.buffer_views[view];
        let start = view.byte_offset.unwrap().0 as usize;
        let bytes = &body[start..start + view.byte_length.0 as usize];
        let short = |at: &[u8], i: usize| f64::from(i16::from_le_bytes([at[2 * i], at[2 * i + 1]]));
        bytes.chunks(stride).filter(|c| c.len() >= 6).map(|c| [short(c, 0), short(c, 1), short(c, 2)]).collect()
    };
    let primitive = &root.meshes[0].primitives[0];
    let base = root.accessors[primitive.attributes[&Checked::Valid(Semantic::Positions)].value()].clone();
    let base = shorts(base.buffer_view.unwrap().value(), 8);
    let matrix = root.nodes[0].matrix.unwrap().map(f64::from);
    let metres =
        |p: &[f64; 3]| [0, 1, 2].map(|r: usize| (0..3).map(|c| matrix[4 * c + r] * p[c]).sum::<f64>() + matrix[12 + r]);
    let near = |found: [f64; 3], p: &Point| {
        let expected = [1e-3 * p.x, 1e-3 * p.z, -1e-3 * p.y];
        // Half of a step along each axis, which is 53 mm / 32 766, and the rounding of the matrix.
        (0..3).all(|i| (found[i] - expected[i]).abs() < 0.9e-6)
    };
    assert!(base.iter().zip(rest.positions()).all(|(whole, p)| near(metres(whole), p)));
    let targets = primitive.targets.as_ref().unwrap();
    for (target, step) in targets.iter().zip(&steps).take(2) {
        let sparse = root.accessors[target.positions.unwrap().value()].sparse.as_ref().unwrap();
        let numbers = &root.buffer_views[sparse.indices.buffer_view.value()];
        let start = numbers.byte_offset.unwrap().0 as usize;
        let by = shorts(sparse.values.buffer_view.value(), 6);
        // Vertex 0 moves; the others of its triangles at most turn their normals.
        assert!((2..=7).contains(&sparse.count.0) && body[start..start + 2] == [0, 0], "{}", sparse.count.0);
        let whole = [0, 1, 2].map(|i: usize| base[0][i] + by[0][i]);
        assert!(near(metres(&whole), &step.moved.positions()[0]));
        assert!(by[1..].iter().all(|d| *d == [0.0; 3]));
    }
    let still = root.accessors[targets[2].positions.unwrap().value()].sparse.as_ref().unwrap();
    assert_eq!((still.count.0, shorts(still.values.buffer_view.value(), 6)), (1, vec![[0.0; 3]]));
    assert_eq!(root.animations[0].channels.len(), 1);
    assert_eq!(root.meshes[0].weights, Some(vec![0.0; 3]));
}
