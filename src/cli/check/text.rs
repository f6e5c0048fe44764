//! The reports as text for a technician.

use std::io::{Result, Write};

use super::report::{Checked, FileReport};
use prosopon_contract::{Findings, SurfaceDocument, VolumeDocument};

/// Writes the report of one file: its kind, then size, place and findings, a line each.
pub(super) fn write(out: &mut impl Write, report: &FileReport) -> Result<()> {
    let FileReport { file, checked, .. } = report;
    match checked {
        Checked::Surface(surface) => {
            writeln!(out, "{file}: surface ({})", surface.origin.format)?;
            write_surface(out, surface)?;
            findings(out, &surface.findings)
        }
        Checked::Ct(ct) => {
            writeln!(out, "{file}: CT ({})", ct.format)?;
            ct.volume.iter().try_for_each(|volume| write_volume(out, volume))?;
            findings(out, &ct.findings)
        }
        Checked::Landmarks(landmarks) => {
            writeln!(out, "{file}: {} landmarks", landmarks.points.len())?;
            for (name, [x, y, z]) in &landmarks.points {
                writeln!(out, "  {name:<24} {}", place([*x, *y, *z]))?;
            }
            findings(out, &landmarks.clone().take_findings())
        }
        Checked::Transform { format, matrix } => {
            writeln!(out, "{file}: rigid transform ({format})")?;
            for [a, b, c, d] in matrix {
                writeln!(out, "  {a:>10.6} {b:>10.6} {c:>10.6} {d:>12.4}")?;
            }
            writeln!(
                out,
                "  In ITK's direction it maps the planned place to the present one: a bone moves by its inverse."
            )
        }
        Checked::TissueMesh { nodes, tetrahedra, wedges, findings: found } => {
            writeln!(out, "{file}: tissue mesh of {nodes} nodes, {tetrahedra} tetrahedra and {wedges} wedges")?;
            findings(out, found)
        }
        Checked::Refused { problem, detail } => {
            writeln!(out, "{file}: CANNOT BE USED ({})\n  {detail}", problem.trim_start_matches("/problems/"))
        }
    }
}

fn write_surface(out: &mut impl Write, s: &SurfaceDocument) -> Result<()> {
    let holes = match (s.closed, s.holes) {
        (true, _) => "closed".to_owned(),
        (false, 0) => "not closed".to_owned(),
        (false, holes) => format!("{holes} holes"),
    };
    let parts = if s.components == 1 { "one part".to_owned() } else { format!("{} parts", s.components) };
    writeln!(out, "  {} triangles, {} vertices, {parts}, {holes}", s.triangles, s.vertices)?;
    write_box(out, s.min_mm, s.max_mm)
}

fn write_volume(out: &mut impl Write, v: &VolumeDocument) -> Result<()> {
    let ([i, j, k], [a, b, c]) = (v.dims, v.spacing_mm);
    writeln!(out, "  {i} x {j} x {k} voxels of {a:.3} x {b:.3} x {c:.3} mm")?;
    writeln!(out, "  axes {}, oblique by {:.1} degrees", v.axes, v.oblique_deg)?;
    write_box(out, v.min_mm, v.max_mm)?;
    let [least, most] = v.values;
    match v.levels {
        Some(l) if l.in_hu => writeln!(out, "  values {least} to {most}: Hounsfield units"),
        Some(l) => writeln!(
            out,
            "  values {least} to {most}: not Hounsfield units; air is {:.0} and soft tissue {:.0}",
            l.air, l.soft_tissue
        ),
        None => writeln!(out, "  values {least} to {most}: air and soft tissue were not found"),
    }
}

fn write_box(out: &mut impl Write, min: [f64; 3], max: [f64; 3]) -> Result<()> {
    let size = [0, 1, 2].map(|axis| max[axis] - min[axis]);
    writeln!(out, "  from {} to {}", place(min), place(max))?;
    writeln!(out, "  {:.1} mm wide (right to left), {:.1} mm deep, {:.1} mm high", size[0], size[1], size[2])
}

/// A place in words, so that a wrong frame shows: "12.0 left, 80.1 front, 4.0 up".
fn place([x, y, z]: [f64; 3]) -> String {
    let word = |value: f64, [below, above]: [&str; 2]| {
        format!("{:.1} {}", value.abs(), if value < 0.0 { below } else { above })
    };
    format!("({}, {}, {})", word(x, ["R", "L"]), word(y, ["A", "P"]), word(z, ["I", "S"]))
}

/// Writes warnings, then notes.
pub(super) fn findings(out: &mut impl Write, found: &Findings) -> Result<()> {
    for warning in &found.warnings {
        writeln!(out, "  CHECK {}: {warning}", warning.code)?;
    }
    found.notes.iter().try_for_each(|note| writeln!(out, "  note {}: {note}", note.code))
}
