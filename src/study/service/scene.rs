use serde_json::{Value, json};

use super::client::Client;
use super::latencies::Kind;
use crate::error::BenchError;
use crate::slab::Slab;
use prosopon_formats::export::{stl, vtu};
use prosopon_planning::phantom;

/// A slab of fat under skin; the plan lifts its middle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scene {
    /// Cells along x, y, z.
    pub(super) cells: [usize; 3],
    pub(super) model: &'static str,
    pub(super) steps: u32,
}

impl Scene {
    /// Takes seconds on two threads.
    pub(super) const LARGE: Self = Self { cells: [40, 40, 6], model: "nonlinear", steps: 12 };
    /// Takes a fraction of a second.
    pub(super) const SMALL: Self = Self { cells: [6, 6, 2], model: "linear", steps: 1 };

    fn file(&self) -> Vec<u8> {
        let [x, y, z] = self.cells.map(|n| n as f64);
        let size_mm = [60.0, 60.0 * y / x, (60.0 * z / x).min(12.0)];
        let mesh = Slab { cells: self.cells, size_mm, skin_mm: 1.5 }.over_a_patch(15.5, 29.0);
        let attachment: Vec<f64> = mesh.attachment.iter().map(|a| a.number()).collect();
        let fat = std::iter::repeat_n(2.0, mesh.tetrahedra.len());
        let tissue: Vec<f64> = fat.chain(std::iter::repeat_n(0.0, mesh.prisms.len())).collect();
        vtu(
            &mesh.positions,
            &mesh.tetrahedra,
            &mesh.prisms,
            &[("attachment", 1, &attachment)],
            &[("tissue", 1, &tissue)],
        )
    }

    /// Creates a session with this tissue and a plan; returns the session's path and the plan's id.
    pub(super) fn prepare(&self, client: &mut Client) -> Result<(String, String), BenchError> {
        let session = client.session()?;
        client.upload(Kind::Other, &format!("{session}/tissue"), &self.file())?;
        let waypoints = json!([{ "t": 1, "translation_mm": [0.5, 0, 2] }]);
        let plan = json!({ "paths": [{ "segment": 1, "waypoints": waypoints }] });
        let plan = client.post(Kind::Other, &format!("{session}/plans"), &plan)?;
        Ok((session, plan["id"].as_str().unwrap_or_default().to_owned()))
    }

    /// Body of a solve.
    ///
    /// Each `number` gives a different body, so that the service computes the job instead of reusing the result of an equal one.
    pub(super) fn solve(&self, plan: &str, number: usize) -> Value {
        json!({
            "plan": plan,
            "model": self.model,
            "steps": self.steps,
            // The scene has no contact, so this tolerance does not change the result.
            "penetration_tolerance_mm": 0.05 + 1e-6 * number as f64,
        })
    }
}

/// Skin of the phantom, STL.
pub(super) fn skin() -> Result<Vec<u8>, BenchError> {
    let head = phantom::head();
    let surface = phantom::surface_of(head.skin.as_ref(), &head.bounds(), 4.0);
    let surface = surface.ok_or_else(|| BenchError::Head { detail: "the phantom has no skin".to_owned() })?;
    Ok(stl(&surface))
}
