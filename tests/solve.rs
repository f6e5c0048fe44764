//! `prosopon solve`: reads a scene, writes a solved mesh and prints one line of JSON.

#![allow(clippy::unwrap_used, reason = "a test's own files")]

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use prosopon_formats::export::{stl, vtu};
use prosopon_formats::import::{Limits, volume_mesh};
use prosopon_geometry::{Point, TriMesh, VolumeMesh};
use serde_json::{Value, json};

const CELLS: [usize; 3] = [8, 8, 3];

/// A slab of 40 x 40 x 9 mm with a layer of wedges on top, whose orientation alternates.
///
/// Its sides are fixed; the middle of its bottom has the attachment `middle`.
fn slab(middle: f64) -> Vec<u8> {
    let [nx, ny, nz] = CELLS;
    let heights: Vec<f64> = (0..=nz).map(|k| 3.0 * k as f64).chain([10.5]).collect();
    let mut points = Vec::new();
    for i in 0..=nx {
        for j in 0..=ny {
            points.extend(heights.iter().map(|z| Point::new(5.0 * i as f64 - 20.0, 5.0 * j as f64 - 20.0, *z)));
        }
    }
    let node = |i: usize, j: usize, k: usize| ((i * (ny + 1) + j) * heights.len() + k) as u32;
    let (mut tetrahedra, mut wedges) = (Vec::new(), Vec::new());
    for i in 0..nx {
        for j in 0..ny {
            for k in 0..nz {
                for [a, b] in [[0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2]] {
                    let mut at = [i, j, k];
                    let mut corners = [node(i, j, k); 4];
                    for (step, axis) in [a, b, 3 - a - b].into_iter().enumerate() {
                        at[axis] += 1;
                        corners[step + 1] = node(at[0], at[1], at[2]);
                    }
                    // Odd permutations of the axes reverse the orientation of the tetrahedron.
                    if (3 + b - a) % 3 == 2 {
                        corners.swap(1, 2);
                    }
                    tetrahedra.push(corners);
                }
            }
            for (turn, corners) in [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]].into_iter().enumerate() {
                let at = |k: usize| corners.map(|(u, v)| node(i + u, j + v, k));
                let ([a, b, c], [d, e, f]) =
                    if (i + j + turn) % 2 == 0 { (at(nz + 1), at(nz)) } else { (at(nz), at(nz + 1)) };
                wedges.push([a, b, c, d, e, f]);
            }
        }
    }
    let attachment: Vec<f64> = points
        .iter()
        .map(|p| match p.x.abs().max(p.y.abs()) {
            r if r > 19.0 => 0.0,
            r if p.z == 0.0 && r < 11.0 => middle,
            _ => -1.0,
        })
        .collect();
    let tissue: Vec<f64> = vec![2.0; tetrahedra.len()].into_iter().chain(vec![0.0; wedges.len()]).collect();
    vtu(&points, &tetrahedra, &wedges, &[("attachment", 1, &attachment)], &[("tissue", 1, &tissue)])
}

/// A closed box.
fn block(min: [f64; 3], max: [f64; 3]) -> Vec<u8> {
    let corner = |i: usize| Point::from([0, 1, 2].map(|a| if i >> a & 1 == 1 { max[a] } else { min[a] }));
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    stl(&TriMesh::new((0..8).map(corner).collect(), triangles).unwrap())
}

fn solve(folder: &Path, scene: &Value) -> Output {
    command(folder, scene).output().unwrap()
}

fn command(folder: &Path, scene: &Value) -> Command {
    std::fs::write(folder.join("scene.json"), scene.to_string()).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_prosopon"));
    command.arg("solve").arg(folder.join("scene.json")).arg("--out").arg(folder.join("out.vtu"));
    command
}

/// The last line on stdout, parsed.
fn summary(output: &Output) -> Value {
    let text = String::from_utf8_lossy(&output.stdout);
    serde_json::from_str(text.lines().last().unwrap()).unwrap()
}

fn solved(folder: &Path, scene: &Value) -> (Value, VolumeMesh) {
    let output = solve(folder, scene);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let summary = summary(&output);
    let bytes = std::fs::read(folder.join("out.vtu")).unwrap();
    (summary, volume_mesh(&bytes, &Limits::default()).unwrap().0)
}

fn materials() -> Value {
    let law = |c10: f64, c01: f64| json!({"law": "mooney_rivlin", "c10_mpa": c10, "c01_mpa": c01, "poisson": 0.45});
    json!({"skin": law(0.014, 0.0035), "fat": law(0.0047, 0.0012)})
}

#[test]
fn a_tied_scene_is_solved_by_every_model() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("slab.vtu"), slab(1.0)).unwrap();
    let mut tops = Vec::new();
    for (model, skin_element, locking) in [
        ("linear", "wedge", "none"),
        ("mass_tensor", "wedge", "none"),
        ("nonlinear", "wedge", "none"),
        ("nonlinear", "tet", "smoothed"),
        ("mixed", "c1_prism", "smoothed"),
        ("linear", "wedge", "patched"),
        ("mass_tensor", "wedge", "patched"),
        ("nonlinear", "tet", "patched"),
        ("mixed", "c1_prism", "patched"),
    ] {
        let scene = json!({
            "mesh": "slab.vtu", "model": model, "skin_element": skin_element, "locking": locking,
            "materials": materials(), "segments": {"1": {"translation_mm": [1, 0, 2]}}, "steps": 2
        });
        let (summary, file) = solved(folder.path(), &scene);
        let mut keys: Vec<&String> = summary.as_object().unwrap().keys().collect();
        keys.sort_unstable();
        let expected = "converged max_penetration_mm min_det_f newton_iterations outcome peak_mb reactions_n solve_wall_s total_wall_s unknowns warnings";
        assert_eq!(keys, expected.split(' ').collect::<Vec<_>>());
        assert_eq!(summary["converged"], true, "{model}");
        let warnings = summary["warnings"].as_array().unwrap();
        match model {
            "linear" | "mass_tensor" => {
                let all = warnings.iter().all(|w| w["code"] == "neglected-strain");
                assert!(all && !warnings.is_empty(), "{warnings:?}");
            }
            _ => assert!(warnings.is_empty(), "{model}: {warnings:?}"),
        }
        let moved = &file.point_array("displacement_mm").unwrap().values;
        let stress = file.cell_array("stress_mpa").unwrap();
        let ratio = &file.cell_array("volume_ratio").unwrap().values;
        assert_eq!(stress.components, 6);
        assert!(stress.values.iter().chain(ratio).all(|v| v.is_finite()) && ratio.iter().all(|j| *j > 0.0));
        // Tied points follow their segment.
        let attachment = &file.point_array("attachment").unwrap().values;
        for (u, a) in moved.chunks(3).zip(attachment) {
            let expected = match *a {
                1.0 => [1.0, 0.0, 2.0],
                0.0 => [0.0; 3],
                _ => continue,
            };
            assert!(u.iter().zip(expected).all(|(u, e)| (u - e).abs() < 1e-12));
        }
        let top = file.points.iter().position(|p| *p == Point::new(0.0, 0.0, 10.5)).unwrap();
        tops.push(moved[3 * top + 2]);
    }
    // Every model lifts the middle of the skin by a similar amount.
    assert!(tops.iter().all(|z| (1.8..2.2).contains(z)), "{tops:?}");
    assert!((tops[0] - tops[1]).abs() < 1e-6, "{tops:?}");
}

#[test]
fn a_bone_pushes_points_that_slide_and_turns_about_its_pivot() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("slab.vtu"), slab(-2.0)).unwrap();
    std::fs::write(folder.path().join("block.stl"), block([-14.0, -14.0, -30.0], [14.0, 14.0, 0.0])).unwrap();
    let scene = json!({
        "mesh": "slab.vtu", "model": "nonlinear", "skin_element": "wedge", "materials": materials(),
        "segments": {"1": {"translation_mm": [0, 0, 2],
                           "rotation": {"axis_angle": {"axis": [0, 1, 0], "angle_deg": 3}, "pivot_mm": [0, 0, 0]}}},
        "bones": {"1": "block.stl"}
    });
    let (summary, file) = solved(folder.path(), &scene);
    // At the rim of the block, outside the sliding points, free points penetrate it: the summary reports the depth and a warning.
    let penetration = summary["max_penetration_mm"].as_f64().unwrap();
    assert!((0.05..=1.5).contains(&penetration), "{summary}");
    let reported = summary["notes"].as_array().unwrap().iter().any(|w| w["code"] == "free-tissue-in-bone");
    assert!(reported && summary["reactions_n"]["1"][2].as_f64().unwrap() > 0.0, "{summary}");
    let moved = &file.point_array("displacement_mm").unwrap().values;
    let at = |x: f64| 3 * file.points.iter().position(|p| *p == Point::new(x, 0.0, 0.0)).unwrap() + 2;
    // The bottom lies on the block, which is wider than the sliding points, at its height less the penetration. The rotation is
    // right-handed about y, so the side at +x goes down.
    for x in [-10.0, -5.0, 0.0, 5.0, 10.0] {
        let expected = 2.0 - x * 3f64.to_radians().tan();
        assert!((moved[at(x)] - expected).abs() < 0.15, "{x}: {} {expected}", moved[at(x)]);
    }
}

#[test]
fn bad_scenes_are_refused_with_the_place() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("slab.vtu"), slab(1.0)).unwrap();
    std::fs::write(folder.path().join("free.vtu"), slab(-1.0)).unwrap();
    std::fs::write(folder.path().join("not.vtu"), b"not a mesh").unwrap();
    let good = json!({"mesh": "slab.vtu", "materials": materials(), "segments": {"1": {"translation_mm": [0, 0, 1]}}});
    for (key, value, expected) in [
        ("mesh", json!("missing.vtu"), "missing.vtu"),
        ("mesh", json!("not.vtu"), "VTK XML"),
        ("mesh", json!("free.vtu"), "/segments/1: no point"),
        ("model", json!("quadratic"), "model"),
        ("skin_element", json!("hex"), "skin_element"),
        ("locking", json!("magic"), "locking"),
        ("steps", json!(0), "/steps is 0"),
        ("stepz", json!(1), "stepz"),
        (
            "materials",
            json!({"fat": {"law": "neo_hookean", "shear_modulus_mpa": 0.01, "poisson": 0.45}}),
            "/materials/skin: is missing",
        ),
        ("materials", json!({"bone": {}}), "/materials/bone: is not a tissue"),
        (
            "materials",
            json!({"skin": {"law": "neo_hookean", "shear_modulus_mpa": 0.01, "poisson": 0.5},
                   "fat": {"law": "neo_hookean", "shear_modulus_mpa": 0.01, "poisson": 0.45}}),
            "/materials/skin/poisson",
        ),
        ("segments", json!({"one": {}}), "/segments/one"),
        ("segments", json!({"1": {}, "01": {}}), "segment 1 is given twice"),
        ("segments", json!({"0": {}}), "segment 0 is the fixed skull"),
        ("segments", json!({"2": {"translation_mm": [0, 0, 1]}}), "/segments/2: no point"),
        ("segments", json!({"1": {"rotation": {}}}), "/segments/1/rotation"),
        ("segments", json!({"1": [[0, 0, 1]]}), "segments.1: invalid type: sequence"),
        ("materials", json!({"skin": ["neo_hookean", 0.45], "fat": {}}), "/materials/skin: invalid type: sequence"),
        ("segments", json!({"1": {"translation_mm": [0, 0, 1e9]}}), "/segments/1/translation_mm/2"),
        ("bones", json!({"1": "slab.vtu"}), "use STL, PLY, OBJ or VTP"),
        ("relative_residual", json!(0.5), "/relative_residual"),
    ] {
        let mut scene = good.clone();
        scene[key] = value.clone();
        let output = solve(folder.path(), &scene);
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{key}: {value}");
        assert!(error.contains(expected), "{key}: {value}: {error}");
        let last: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!(last["error"].as_str().unwrap().contains(expected) && last["converged"] == false, "{last}");
    }
    // Refused before the work starts; no file is left.
    std::fs::create_dir(folder.path().join("out.vtu")).unwrap();
    let output = solve(folder.path(), &good);
    assert!(String::from_utf8_lossy(&output.stderr).contains("it is a folder"));
    assert!(!folder.path().join("out.vtu.part").exists());
}

#[test]
fn held_points_inside_a_bone_are_told() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("slab.vtu"), slab(-2.0)).unwrap();
    // The block is wider than the slab, so it also pushes into the fixed sides.
    std::fs::write(folder.path().join("block.stl"), block([-40.0, -40.0, -30.0], [40.0, 40.0, 0.0])).unwrap();
    let scene = json!({
        "mesh": "slab.vtu", "model": "nonlinear", "skin_element": "wedge", "materials": materials(),
        "segments": {"1": {"translation_mm": [0, 0, 1]}}, "bones": {"1": "block.stl"}
    });
    let output = solve(folder.path(), &scene);
    let last: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(last["warnings"].to_string().contains("held points lie up to 1.00 mm inside bone 1"), "{last}");
}

/// A modulus in Pa instead of MPa, and a result that would overwrite the mesh.
#[test]
fn another_unit_is_told_and_no_input_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = slab(1.0);
    std::fs::write(folder.path().join("slab.vtu"), &mesh).unwrap();
    let law = json!({ "law": "neo_hookean", "shear_modulus_mpa": 10000.0, "poisson": 0.45 });
    let mut scene = json!({
        "mesh": "slab.vtu", "model": "linear", "materials": { "skin": law, "fat": law, "muscle": law },
        "segments": {"1": {"translation_mm": [0, 0, 0.1]}}, "steps": 1
    });
    let reported = summary(&solve(folder.path(), &scene));
    assert!(reported["warnings"].to_string().contains("has a shear modulus of 1.000e4 MPa"), "{reported}");

    std::fs::write(folder.path().join("out.vtu"), &mesh).unwrap();
    scene["mesh"] = json!("./out.vtu");
    let output = solve(folder.path(), &scene);
    assert!(!output.status.success());
    assert!(String::from_utf8_lossy(&output.stderr).contains("out.vtu is an input"), "{output:?}");
    assert_eq!(std::fs::read(folder.path().join("out.vtu")).unwrap(), mesh);
}

/// A movement that no mesh can follow: the summary reports it and the result has the last equilibrium.
#[test]
fn a_scene_without_equilibrium_says_so() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("slab.vtu"), slab(1.0)).unwrap();
    let scene = json!({
        "mesh": "slab.vtu", "model": "nonlinear", "skin_element": "wedge", "preset": "wang_2009",
        "segments": {"1": {"translation_mm": [0, 0, 8]}}, "steps": 4
    });
    let output = solve(folder.path(), &scene);
    assert!(!output.status.success());
    let summary = summary(&output);
    assert_eq!(summary["converged"], json!(false));
    assert!(summary["warnings"].to_string().contains("is not stable at"), "{summary}");
}

#[test]
#[cfg(unix)]
#[allow(clippy::disallowed_methods, reason = "the other process tells nothing until it ends")]
fn a_solve_that_is_asked_to_stop_writes_what_it_has() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("slab.vtu"), slab(1.0)).unwrap();
    let scene = json!({
        "mesh": "slab.vtu", "model": "nonlinear", "skin_element": "wedge", "materials": materials(),
        "segments": {"1": {"translation_mm": [0, 0, 4]}}, "steps": 200
    });
    let mut running = command(folder.path(), &scene).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    while !folder.path().join("out.vtu.part").exists() {
        assert!(running.try_wait().unwrap().is_none(), "the solve ended before it began to write");
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(Duration::from_millis(200));
    let asked = Command::new("kill").args(["-INT", &running.id().to_string()]).status().unwrap();
    assert!(asked.success());
    let output = running.wait_with_output().unwrap();
    assert!(!output.status.success() && output.status.code().is_some(), "{:?}", output.status);
    let summary = summary(&output);
    assert_eq!((&summary["converged"], &summary["outcome"]), (&json!(false), &json!("stopped")));
    assert!(summary.to_string().contains("cancelled"), "{summary}");
    assert!(!folder.path().join("out.vtu.part").exists());
}
