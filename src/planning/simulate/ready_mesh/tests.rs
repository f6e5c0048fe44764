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

/// The second triangle is numbered from another corner: the volume is positive, but the wedge is twisted.
#[test]
fn a_twisted_wedge_is_refused() {
    for wedge in [[0, 1, 2, 4, 5, 3], [0, 1, 2, 5, 3, 4]] {
        match ReadyMesh::new(&volume(wedge, [3, 4, 5, 6])) {
            Err(ReadyMeshError::Twisted { cell: 0, .. }) => {}
            other => panic!("{other:?}"),
        }
    }
}

/// A fan of three wedges round an edge; the inner triangle of the first is turned in its plane, but its points are those of the
/// neighbours.
#[test]
fn a_thin_wedge_may_be_twisted() {
    let turned = |degrees: f64, inner: [u32; 3]| {
        let round = |z: f64, angle: f64| Point::new(10.0 * angle.cos(), 10.0 * angle.sin(), z);
        let mut points = vec![Point::new(0.0, 0.0, 2.0), Point::new(0.0, 0.0, 0.0)];
        for k in 0..3 {
            let angle = f64::from(k) * std::f64::consts::TAU / 3.0;
            points.push(round(2.0, angle));
            points.push(round(0.0, angle + degrees.to_radians()));
        }
        let cells = vec![
            Cell::Wedge([0, 2, 4, inner[0], inner[1], inner[2]]),
            Cell::Wedge([0, 4, 6, 1, 5, 7]),
            Cell::Wedge([0, 6, 2, 1, 7, 3]),
        ];
        ReadyMesh::new(&VolumeMesh { points, cells, ..VolumeMesh::default() })
    };
    let codes = |ready: ReadyMesh| ready.warnings.iter().map(|w| w.code).collect::<Vec<_>>();
    assert!(!codes(turned(20.0, [1, 3, 5]).unwrap()).contains(&"twisted-wedges"));
    assert!(codes(turned(75.0, [1, 3, 5]).unwrap()).contains(&"twisted-wedges"));
    match turned(0.0, [3, 5, 1]) {
        Err(ReadyMeshError::Twisted { cell: 0, .. }) => {}
        other => panic!("{other:?}"),
    }
}

#[test]
fn points_in_one_place_are_reported() {
    let mut torn = volume([0, 1, 2, 3, 4, 5], [7, 8, 9, 6]);
    torn.points.extend_from_within(3..6);
    let ready = ReadyMesh::new(&torn).unwrap();
    let found = ready.warnings.iter().find(|w| w.code == "coincident-points").unwrap();
    assert!(found.message.starts_with("at 3 places") && found.message.contains("the first are 3 and 7"), "{found}");
    let whole = ReadyMesh::new(&volume([0, 1, 2, 3, 4, 5], [3, 4, 5, 6])).unwrap();
    assert!(!whole.warnings.iter().any(|w| w.code == "coincident-points"));
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
            assert_eq!(ready.warnings.iter().any(|w| w.code == "tetrahedra-turned"), turned);
            assert_eq!(ready.mesh.tissue_of_prism(0), Tissue::Skin);
            assert_eq!(ready.buried_prisms(), 0);
            assert_eq!(ready.cell_indices, [CellIndex::Prism(0), CellIndex::Tetrahedron(0)]);
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
        ("attachment", 1, vec![-1., -1., -5e9, 0., 0., 0., 0.], "point 2 has -5000000000"),
        ("attachment", 1, vec![-1., 0.5, 0., 0., 0., 0., 0.], "point 1 has 0.5"),
        ("attachment", 1, vec![f64::NAN, 0., 0., 0., 0., 0., 0.], "point 0 has NaN"),
        ("fixed_mask", 1, vec![0., 0., 0., 0., 8., 0., 0.], "point 4 has 8"),
        ("fixed_mask", 3, vec![0.; 21], "3 components, expected 1"),
        ("force_n", 1, vec![0.; 7], "1 components, expected 3"),
        ("force_n", 3, [vec![0.; 20], vec![f64::INFINITY]].concat(), "point 6 has a value that is not finite"),
        ("tissue", 1, vec![0., 5.], "cell 1 has 5"),
    ] {
        let error = ReadyMesh::new(&with_array(name, components, &values)).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains(name), "{error}");
    }
    assert_eq!(ReadyMesh::new(&volume([0, 1, 2, 3, 4, 5], [3, 4, 5, 4])), Err(ReadyMeshError::Flat { cell: 1 }));
    assert_eq!(ReadyMesh::new(&volume([0, 1, 2, 0, 1, 2], [3, 4, 5, 6])), Err(ReadyMeshError::Flat { cell: 0 }));
    let mut thrice = volume([0, 1, 2, 3, 4, 5], [3, 4, 5, 6]);
    thrice.cells.push(Cell::Tetrahedron([3, 4, 5, 0]));
    assert!(matches!(ReadyMesh::new(&thrice), Err(ReadyMeshError::NotConforming { triangle: [3, 4, 5], cells: 3 })));
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
