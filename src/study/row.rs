use super::evaluate::Timing;
use prosopon_field::{Accuracy, Method};

/// A field builder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Builder {
    Ours(Method),
    /// OpenVDB's level set; its queries give only the value.
    OpenVdb,
}

impl Builder {
    /// All builders, in the order of the charts.
    pub(super) fn all() -> impl Iterator<Item = Self> {
        Method::ALL.into_iter().map(Self::Ours).chain([Self::OpenVdb])
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Ours(method) => method.name(),
            Self::OpenVdb => "openvdb",
        }
    }
}

/// A builder with its settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Case {
    pub(super) builder: Builder,
    pub(super) grid: Grid,
    /// Tolerance relative to the edge of the bounding cube; only the octrees have one.
    pub(super) tolerance: Option<f64>,
}

/// Resolution of a case.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Grid {
    /// Cells along the edge of the bounding cube.
    Cells(u32),
    /// Grid spacing, mm.
    Spacing(f64),
}

impl Case {
    pub(super) fn label(&self) -> String {
        let grid = match self.grid {
            Grid::Cells(n) => format!("{n}³"),
            Grid::Spacing(h) => format!("{h} mm"),
        };
        let tolerance = self.tolerance.map_or(String::new(), |t| format!(" {t:e}"));
        format!("{} {grid}{tolerance}", self.builder.name())
    }
}

/// All measurements of one case.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub(super) case: Case,
    pub(super) timing: Timing,
    pub(super) accuracy: Accuracy,
}

/// Names of the columns of [`Row::csv`].
pub(super) const COLUMNS: &str = "method,spacing_mm,resolution,tolerance,build_wall_s,build_cpu_s,memory_mb,peak_mb,max_error_mm,rms_error_mm,surface_max_error_mm,sign_errors,query_sorted_ns,query_random_ns,hessian_sorted_ns,hessian_random_ns,surface_bound_mm";

impl Row {
    /// One line of the CSV; values that do not apply are empty.
    pub(super) fn csv(&self) -> String {
        let (t, a) = (&self.timing, &self.accuracy);
        let optional = |value: Option<f64>, digits: usize| value.map_or(String::new(), |v| format!("{v:.digits$}"));
        let resolution = match self.case.grid {
            Grid::Cells(n) => n.to_string(),
            Grid::Spacing(_) => String::new(),
        };
        [
            self.case.builder.name().to_owned(),
            format!("{:.4}", t.spacing_mm),
            resolution,
            self.case.tolerance.map_or(String::new(), |t| format!("{t:e}")),
            format!("{:.4}", t.build_wall_s),
            optional(t.build_cpu_s, 4),
            format!("{:.3}", t.memory_mb),
            optional(t.peak_mb, 1),
            format!("{:.5}", a.max_error_mm),
            format!("{:.5}", a.rms_error_mm),
            format!("{:.5}", a.surface_max_error_mm),
            a.sign_errors.to_string(),
            format!("{:.1}", t.query_sorted_ns),
            format!("{:.1}", t.query_random_ns),
            optional(t.hessian_sorted_ns, 1),
            optional(t.hessian_random_ns, 1),
            optional(t.surface_bound_mm, 4),
        ]
        .join(",")
    }
}

/// Memory (MB) and time (s) of one method.
type Published = (f64, f64);

/// Table 3 of Wang 2009: grid, tolerance, then the methods of Fuhrmann, of Frisken and of the paper.
pub(super) const TABLE_3: [(u32, f64, [Published; 3]); 6] = [
    (128, 1e-3, [(8.4, 3.12), (3.2, 11.78), (2.9, 4.26)]),
    (128, 1e-5, [(8.4, 3.12), (7.5, 33.52), (6.6, 12.43)]),
    (256, 1e-3, [(67.1, 13.15), (12.9, 65.54), (11.5, 16.75)]),
    (256, 1e-5, [(67.1, 13.15), (19.7, 107.39), (16.1, 18.12)]),
    (256, 1e-6, [(67.1, 13.15), (46.8, 239.60), (42.7, 23.82)]),
    (512, 1e-6, [(536.9, 60.62), (99.5, 965.83), (95.1, 68.15)]),
];

/// Table 3 with the measured values beside the published ones.
pub(super) fn table_3(rows: &[Row]) -> String {
    let methods = [Method::Uniform, Method::Frisken, Method::Hybrid];
    let mut text = String::from(
        "Table 3 (Wang 2009) | memory, MB: paper, measured | build, s: paper (machine of 2009), measured, ratio\n",
    );
    let heads = ["uniform (Fuhrmann)", "frisken", "hybrid (paper)"];
    text += &format!("{:<6} {:<6}", "grid", "tol.");
    for head in heads {
        text += &format!(" | {head:^43}");
    }
    text.push('\n');
    for (grid, tolerance, published) in TABLE_3 {
        text += &format!("{:<6} {:<6}", format!("{grid}³"), format!("{tolerance:e}"));
        for (method, (memory, time)) in methods.into_iter().zip(published) {
            let found = rows.iter().find(|r| {
                r.case.builder == Builder::Ours(method)
                    && r.case.grid == Grid::Cells(grid)
                    && r.case.tolerance.is_none_or(|t| t == tolerance)
            });
            text += &match found.map(|r| &r.timing) {
                Some(t) => format!(
                    " | {memory:>6.1} {:>6.1}  {time:>7.2} {:>7.3} ({:>5.0} times)",
                    t.memory_mb,
                    t.build_wall_s,
                    time / t.build_wall_s
                ),
                None => format!(" | {memory:>6.1} {:>6}  {time:>7.2} {:>7} {:>13}", "-", "-", ""),
            };
        }
        text.push('\n');
    }
    text
}

/// Spacing (mm) and ratio of build times, OpenVDB to adaptive, for each spacing at which both were measured.
pub(super) fn against_openvdb(rows: &[Row]) -> Vec<(f64, f64)> {
    let of = |builder| rows.iter().filter(move |r| r.case.builder == builder);
    of(Builder::Ours(Method::Adaptive))
        .filter_map(|ours| {
            let theirs = of(Builder::OpenVdb).find(|r| r.case.grid == ours.case.grid)?;
            let Grid::Spacing(spacing) = ours.case.grid else { return None };
            Some((spacing, theirs.timing.build_wall_s / ours.timing.build_wall_s))
        })
        .collect()
}
