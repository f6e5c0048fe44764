mod files;

use std::io::Read;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use prosopon_geometry::Point;

use super::*;

/// Images of the origin and of 10 mm along each axis, as SimpleITK's `TransformPoint` gives them.
type Images = [[f64; 3]; 4];

const EULER: Images = [
    [-2.215180528, -4.854846442, 1.438734606],
    [7.696975438, -3.800273769, 2.23688282],
    [-3.311591594, 5.072292674, 1.938526299],
    [-2.954806698, -5.437757617, 11.394294243],
];
const EULER_ZYX: Images = [
    [-2.455184608, -4.899352869, 1.428544487],
    [7.452586736, -3.805080893, 2.227691427],
    [-3.591294976, 5.023401626, 1.926737699],
    [-3.19364261, -5.483743224, 11.384104124],
];
const VERSOR: Images = [
    [26.529126471, 4.706452715, 13.314010634],
    [33.929126471, -0.457718382, 9.004563235],
    [32.493297568, 12.706452715, 13.968734333],
    [29.638573869, 1.651729016, 22.314010634],
];
const AFFINE: Images = [
    [0.284819472, 6.145153558, 8.688734606],
    [10.196975438, 7.199726231, 9.48688282],
    [-0.811591594, 16.072292674, 9.188526299],
    [-0.454806698, 5.562242383, 18.644294243],
];
const VERSOR_ALONE: Images = [
    [25.529126471, 2.706452715, 10.314010634],
    [32.929126471, -2.457718382, 6.004563235],
    [31.493297568, 10.706452715, 10.968734333],
    [28.638573869, -0.348270984, 19.314010634],
];
const COMPOSITE: Images = [
    [22.580143643, 1.838915267, 17.046219382],
    [30.800082499, -2.25604294, 13.088452021],
    [27.566369125, 10.371427171, 18.57389607],
    [25.331536135, -1.390257676, 26.101730491],
];
const IDENTITY: Images = [[0.0; 3], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]];

const EULER_TEXT: &str =
    "Transform: Euler3DTransform_double_3_3\nParameters: 0.05 -0.08 0.11 1.5 -6 -1.25\nFixedParameters: 6 -60 38 0\n";
const VERSOR_TEXT: &str =
    "Transform: VersorRigid3DTransform_double_3_3\nParameters: 0.1 0.2 -0.3 1 2 3\nFixedParameters: 6 -60 38\n";
const AFFINE_PARAMETERS: [f64; 12] = [
    0.9912155966530309,
    -0.1096411065468453,
    -0.07396261695586098,
    0.10545726734033582,
    0.9927139116554156,
    -0.05829111742720958,
    0.07981482141109528,
    0.04997916927067833,
    0.9955559637318878,
    4.0,
    5.0,
    6.0,
];

fn text(transforms: &[&str]) -> Vec<u8> {
    let numbered = transforms.iter().enumerate().map(|(index, t)| format!("#Transform {index}\n{t}"));
    format!("#Insight Transform File V1.0\n{}", numbered.collect::<String>()).into_bytes()
}

fn unpacked(base64: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    flate2::read::ZlibDecoder::new(STANDARD.decode(base64).unwrap().as_slice()).read_to_end(&mut bytes).unwrap();
    bytes
}

/// Files of every kind, for the fuzz test too.
pub(in super::super) fn files_of_every_kind() -> Vec<Vec<u8>> {
    let hdf5 = [files::ITK_5_4, files::ITK_5_4_COMPOSITE, files::OLD, files::OLD_COMPRESSED, files::CHUNKS_OF_4];
    let matlab = [("AffineTransform_double_3_3", &AFFINE_PARAMETERS[..]), ("fixed", &[6.0, -60.0, 38.0])];
    let plain = [text(&[EULER_TEXT]), matlab_file(&matlab, false), matlab_file(&matlab, true)];
    hdf5.map(unpacked).into_iter().chain(plain).collect()
}

/// A MATLAB 4 file of variables.
fn matlab_file(variables: &[(&str, &[f64])], big_endian: bool) -> Vec<u8> {
    let word = |n: u32| if big_endian { n.to_be_bytes() } else { n.to_le_bytes() };
    let one = |(name, numbers): &(&str, &[f64])| {
        let kind = if big_endian { 1000 } else { 0 };
        let head = [kind, numbers.len() as u32, 1, 0, name.len() as u32 + 1].map(word).concat();
        let number = |n: &f64| if big_endian { n.to_be_bytes() } else { n.to_le_bytes() };
        [head, name.as_bytes().to_vec(), vec![0], numbers.iter().flat_map(number).collect()].concat()
    };
    variables.iter().flat_map(one).collect()
}

#[track_caller]
fn check(name: &str, bytes: &[u8], images: &Images, within: f64) {
    let (read, _) = transform(bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
    let corners = [[0.0; 3], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]];
    for (corner, image) in corners.into_iter().zip(images) {
        let found = Point::from(read.matrix * Point::from(corner).coords + read.offset_mm);
        assert!((found - Point::from(*image)).norm() < within, "{name}: {found} is not {image:?}");
    }
    assert!(rigid_motion(&read).is_ok(), "{name}");
}

#[test]
fn every_kind_maps_points_as_itk_does() {
    let row = AFFINE_PARAMETERS.map(|p| p.to_string()).join(" ");
    let affine = |kind: &str| format!("Transform: {kind}\nParameters: {row}\nFixedParameters: 6 -60 38\n");
    let zyx = EULER_TEXT.replace("38 0", "38 1");
    let alone = "Transform: VersorTransform_double_3_3\nParameters: 0.1 0.2 -0.3\nFixedParameters: 6 -60 38\n";
    let w = (1.0f64 - 0.14).sqrt();
    let quaternion = format!(
        "Transform: QuaternionRigidTransform_double_3_3\nParameters: 0.1 0.2 -0.3 {w} 1 2 3\nFixedParameters: 6 -60 38\n"
    );
    let unscaled = VERSOR_TEXT.replace("VersorRigid3D", "Similarity3D").replace("1 2 3\n", "1 2 3 1\n");
    let composite = "Transform: CompositeTransform_double_3_3\n";
    let identity = "Transform: IdentityTransform_double_3_3\nParameters: \nFixedParameters: \n";
    for (name, transforms, images) in [
        ("Euler", vec![EULER_TEXT], EULER),
        ("Euler, z y x", vec![&zyx], EULER_ZYX),
        ("versor", vec![VERSOR_TEXT], VERSOR),
        ("versor alone", vec![alone], VERSOR_ALONE),
        ("quaternion", vec![&quaternion], VERSOR),
        ("similarity of scale 1", vec![&unscaled], VERSOR),
        ("affine", vec![&affine("AffineTransform_double_3_3")], AFFINE),
        ("affine, f32", vec![&affine("AffineTransform_float_3_3")], AFFINE),
        ("ANTs", vec![&affine("MatrixOffsetTransformBase_double_3_3")], AFFINE),
        ("composite", vec![composite, EULER_TEXT, VERSOR_TEXT], COMPOSITE),
        ("identity", vec![identity], IDENTITY),
    ] {
        let bytes = text(&transforms);
        check(name, &bytes, &images, 1e-8);
        let windows = String::from_utf8(bytes).unwrap().replace('\n', "\r\n");
        check(name, windows.as_bytes(), &images, 1e-8);
    }
    let fixed = [6.0, -60.0, 38.0];
    for big_endian in [false, true] {
        let ants = [("AffineTransform_double_3_3", &AFFINE_PARAMETERS[..]), ("fixed", &fixed)];
        check("ANTs .mat", &matlab_file(&ants, big_endian), &AFFINE, 1e-8);
    }
    for (name, file, images, within) in [
        ("ITK 5.4", files::ITK_5_4, EULER, 1e-8),
        ("ITK 5.4, composite", files::ITK_5_4_COMPOSITE, COMPOSITE, 1e-8),
        ("ITK 5.4, identity", files::ITK_5_4_IDENTITY, IDENTITY, 1e-12),
        ("symbol tables", files::OLD, EULER, 1e-8),
        ("compressed", files::OLD_COMPRESSED, EULER, 1e-8),
        ("two chunks, f32", files::CHUNKS_OF_4, EULER, 1e-4),
        ("latest", files::LATEST, EULER, 1e-8),
    ] {
        check(name, &unpacked(file), &images, within);
    }
}

#[test]
fn what_is_no_rigid_transform_is_refused_with_the_reason() {
    let with = |from: &str, to: &str| text(&[&EULER_TEXT.replace(from, to)]);
    for (bytes, part) in [
        (with("Euler3DTransform", "BSplineTransform"), "is a deformation"),
        (with("Euler3DTransform", "DisplacementFieldTransform"), "is a deformation"),
        (with("Euler3DTransform", "SomethingTransform"), "not supported"),
        (with("3_3", "2_2"), "not one of three dimensions"),
        (with("-1.25", ""), "its 5 parameters are not the 6 of its kind"),
        (with("1.5", "x"), "line 4: a parameter is no number"),
        (with("1.5", "nan"), "not finite"),
        (with("Transform: Euler3DTransform_double_3_3\n", ""), "come before"),
        (text(&[]), "has no transform"),
        (text(&[EULER_TEXT, VERSOR_TEXT]), "2 transforms and no order"),
        (text(&["Transform: CompositeTransform_double_3_3\n"]), "no parts"),
        (b"MATLAB 5.0 MAT-file".to_vec(), "version 5"),
        (matlab_file(&[("AffineTransform_double_3_3", &[1.0; 12])], false)[..60].to_vec(), "not recognised"),
        (b"{}".to_vec(), "not recognised"),
        (Vec::new(), "empty"),
        ([&text(&[EULER_TEXT])[..], &vec![b'#'; MAX_BYTES]].concat(), "is it a deformation field"),
    ] {
        let error = transform(&bytes).unwrap_err().to_string();
        assert!(error.contains(part), "{part}: {error}");
    }
    let scaled = text(&[&VERSOR_TEXT.replace("VersorRigid3D", "Similarity3D").replace("1 2 3\n", "1 2 3 1.02\n")]);
    let error = rigid_motion(&transform(&scaled).unwrap().0).unwrap_err().to_string();
    assert!(error.contains("scales by 1.0200"), "{error}");
}

/// A file that is cut off or has a changed byte gives an error or a transform, and no panic.
#[test]
fn damaged_files_are_refused() {
    let sound = files_of_every_kind();
    for file in &sound {
        for end in (0..file.len()).step_by(97) {
            transform(&file[..end]).ok();
        }
        for at in (0..file.len().min(3000)).step_by(2) {
            for value in [0, 0xff] {
                let mut damaged = file.clone();
                damaged[at] = value;
                transform(&damaged).ok();
            }
        }
    }
    assert!(transform(&sound[0][..200]).is_err());
}
