//! Axes of an NRRD file: which of them are spatial, their steps, and the first voxel's position.

use super::FORMAT;
use super::header::Header;
use crate::import::ImportError;
use crate::import::error::malformed;
use crate::import::lattice::{self, VoxelLattice};
use prosopon_geometry::{Point, Vector, Warning};

/// Kinds of an axis whose numbers belong to one voxel together.
const OF_ONE_VOXEL: [&str; 24] = [
    "complex",
    "2-vector",
    "3-color",
    "rgb-color",
    "hsv-color",
    "xyz-color",
    "4-color",
    "rgba-color",
    "3-vector",
    "3-gradient",
    "3-normal",
    "4-vector",
    "quaternion",
    "2d-symmetric-matrix",
    "2d-masked-symmetric-matrix",
    "2d-matrix",
    "2d-masked-matrix",
    "3d-symmetric-matrix",
    "3d-masked-symmetric-matrix",
    "3d-matrix",
    "3d-masked-matrix",
    "vector",
    "covariant-vector",
    "normal",
];

/// Numbers along the spatial axes, and along the other one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Axes {
    pub(super) dims: [usize; 3],
    /// Index of the axis that is not spatial: the fastest (0), the slowest (3), or `None`.
    pub(super) other: Option<usize>,
    /// Numbers along it, else 1.
    pub(super) n: usize,
}

impl Axes {
    /// Reads `dimension`, `sizes` and `kinds`.
    pub(super) fn read(header: &Header<'_>) -> Result<Self, ImportError> {
        let fault = |detail: &str| malformed(FORMAT, detail);
        let missing = |name: &str| malformed(FORMAT, format!("there is no `{name}`"));
        let dimension = header.field(&["dimension"]).ok_or_else(|| missing("dimension"))?;
        let sizes = header.field(&["sizes"]).ok_or_else(|| missing("sizes"))?;
        let directions = header.field(&["space directions"]).map(directions);
        let kinds: Vec<String> =
            header.field(&["kinds"]).unwrap_or_default().split_whitespace().map(str::to_ascii_lowercase).collect();
        let is_of_voxel = |axis: usize| kinds.get(axis).is_some_and(|kind| OF_ONE_VOXEL.contains(&kind.as_str()));
        let has_no_direction = |axis: usize| directions.as_ref().is_some_and(|d| d.get(axis) == Some(&None));
        match dimension {
            "3" => {
                let dims = lattice::counts::<3>(sizes).ok_or_else(|| fault("`sizes` are not three counts"))?;
                if (0..3).any(is_of_voxel) {
                    return Err(fault(
                        "the voxels are vectors or colours in a plane, expected three dimensions of numbers",
                    ));
                }
                Ok(Self { dims, other: None, n: 1 })
            }
            "4" => {
                let [a, b, c, d] = lattice::counts::<4>(sizes).ok_or_else(|| fault("`sizes` are not four counts"))?;
                let other = (0..4)
                    .find(|axis| has_no_direction(*axis))
                    .or_else(|| (0..4).find(|axis| is_of_voxel(*axis)))
                    .or_else(|| {
                        (0..4).find(|axis| kinds.get(*axis).is_some_and(|kind| kind == "time" || kind == "list"))
                    })
                    .unwrap_or(3);
                let (dims, n) = match other {
                    0 => ([b, c, d], a),
                    3 => ([a, b, c], d),
                    _ => return Err(fault("expected three dimensions, and the fourth axis as the first or the last")),
                };
                if n > 1 && is_of_voxel(other) {
                    let detail = format!("the voxels are vectors or colours of {n} numbers, expected one number");
                    return Err(malformed(FORMAT, detail));
                }
                if n == 0 {
                    return Err(fault("`sizes` are not four counts above 0"));
                }
                Ok(Self { dims, other: Some(other), n })
            }
            _ => Err(fault("expected three dimensions, or four with time points")),
        }
    }

    /// The values of the three spatial axes among those of all.
    fn spatial<T: Clone>(&self, all: &[T]) -> Option<[T; 3]> {
        let spatial = all.iter().enumerate().filter(|(axis, _)| self.other != Some(*axis)).map(|(_, v)| v.clone());
        spatial.collect::<Vec<T>>().try_into().ok()
    }
}

/// One entry for each axis: `none`, or the text of a vector.
fn directions(text: &str) -> Vec<Option<&str>> {
    let mut rest = text.trim();
    let mut found = Vec::new();
    while !rest.is_empty() && found.len() < 8 {
        let (entry, after) = match rest.strip_prefix("none") {
            Some(after) => (None, after),
            None => {
                let end = rest.find(')').map_or(rest.len(), |at| at.saturating_add(1));
                let (vector, after) = rest.split_at(end);
                (Some(vector), after)
            }
        };
        found.push(entry);
        rest = after.trim_start();
    }
    found
}

fn vector(text: &str) -> Option<[f64; 3]> {
    lattice::numbers::<3>(&text.trim().strip_prefix('(')?.strip_suffix(')')?.replace(',', " "))
}

/// Signs of x and y of the header's space in LPS.
fn signs(header: &Header<'_>, warnings: &mut Vec<Warning>) -> Result<[f64; 2], ImportError> {
    let space = header.field(&["space"]).map(str::to_ascii_lowercase);
    Ok(match space.as_deref().map(|name| name.strip_suffix("-time").unwrap_or(name)) {
        Some("left-posterior-superior" | "lps" | "lpst") => [1.0, 1.0],
        Some("right-anterior-superior" | "ras" | "rast") => [-1.0, -1.0],
        Some("left-anterior-superior" | "las" | "last") => [1.0, -1.0],
        Some("scanner-xyz" | "3d-right-handed" | "3d-left-handed") => {
            let detail = "the `space` is that of a scanner or of no patient (scanner-xyz, 3D-right-handed, 3D-left-handed), which \
                 leaves left and right open; save the volume in LPS, RAS or LAS";
            return Err(malformed(FORMAT, detail));
        }
        Some(_) => return Err(malformed(FORMAT, "`space` is not LPS, RAS or LAS")),
        None => {
            let found = "the header has no `space`; LPS was assumed, so left and right may be swapped";
            warnings.push(Warning::check("no-orientation", found).act("Check left and right."));
            [1.0, 1.0]
        }
    })
}

/// Millimetres in the header's unit of length.
fn unit(header: &Header<'_>, warnings: &mut Vec<Warning>) -> Result<f64, ImportError> {
    let Some(text) = header.field(&["space units"]) else { return Ok(1.0) };
    let units: Vec<&str> = text.split('"').map(str::trim).filter(|unit| !unit.is_empty()).collect();
    let units = if text.contains('"') { units } else { text.split_whitespace().collect() };
    let mm = |unit: &&str| match *unit {
        "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" => Some((1.0, "mm")),
        "cm" | "centimeter" | "centimeters" => Some((10.0, "centimetres")),
        "m" | "meter" | "meters" => Some((1e3, "metres")),
        "um" | "µm" | "micron" | "microns" | "micrometer" => Some((1e-3, "micrometres")),
        _ => None,
    };
    let found: Option<Vec<(f64, &str)>> = units.iter().map(mm).collect();
    match found.as_deref() {
        Some([]) => Ok(1.0),
        Some([(factor, name), rest @ ..]) if rest.iter().all(|(other, _)| other == factor) => {
            if *factor != 1.0 {
                let warning = Warning::check("converted-unit", format!("{name} were converted to mm"));
                warnings.push(warning.act("Check the size of the head."));
            }
            Ok(*factor)
        }
        _ => Err(malformed(FORMAT, "`space units` are not mm, cm, m or um along all axes")),
    }
}

/// The lattice in LPS mm. The origin is the centre of the first voxel, whatever `centerings` says.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
pub(super) fn read(header: &Header<'_>, axes: Axes, warnings: &mut Vec<Warning>) -> Result<VoxelLattice, ImportError> {
    let fault = |detail: &str| malformed(FORMAT, detail);
    let signs = signs(header, warnings)?;
    let mm = unit(header, warnings)?;
    let lps = |[x, y, z]: [f64; 3]| (Vector::new(x * signs[0], y * signs[1], z) * mm).add_scalar(0.0);
    let along = |steps: [f64; 3]| {
        let [x, y, z] = steps;
        [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]].map(lps)
    };
    let (steps, first) = match header.field(&["space directions"]) {
        Some(text) => {
            let found = axes.spatial(&directions(text)).map(|v| v.map(|text| text.and_then(vector).map(lps)));
            let Some([Some(a), Some(b), Some(c)]) = found else {
                return Err(fault("`space directions` are not three vectors"));
            };
            ([a, b, c], None)
        }
        None => {
            let (steps, first) = spacings(header, axes)?;
            (along(steps), first)
        }
    };
    let origin = match (header.field(&["space origin"]), first) {
        (Some(text), _) => lps(vector(text).ok_or_else(|| fault("`space origin` is not a vector"))?),
        (None, Some(first)) => lps(first),
        (None, None) => Vector::zeros(),
    };
    Ok(VoxelLattice { origin: Point::from(origin), axes: steps })
}

/// Steps along the axes, from `spacings` or the ends of the axes, and the centre of the first voxel if the header has it.
///
/// `axis mins` and `axis maxs` are positions of the first and last voxel where the axis is centred on nodes; else they are
/// those of the outer faces of these voxels, as in Teem.
fn spacings(header: &Header<'_>, axes: Axes) -> Result<([f64; 3], Option<[f64; 3]>), ImportError> {
    let values = |names: &[&str]| -> Option<[Option<f64>; 3]> {
        let all = header.field(names)?.split_whitespace().take(8).map(|w| w.parse::<f64>().ok());
        axes.spatial(&all.collect::<Vec<_>>()).map(|v| v.map(|v| v.filter(|v| v.is_finite())))
    };
    let centerings: Vec<&str> = match header.field(&["centerings", "centers"]) {
        Some(text) => text.split_whitespace().collect(),
        None => Vec::new(),
    };
    let is_node = axes.spatial(&(0..4).map(|axis| centerings.get(axis) == Some(&"node")).collect::<Vec<_>>());
    let is_node = is_node.or_else(|| {
        let three: Vec<bool> = (0..3).map(|axis| centerings.get(axis) == Some(&"node")).collect();
        three.try_into().ok()
    });
    let is_node = is_node.unwrap_or([false; 3]);
    let (mins, maxs) = (values(&["axis mins", "axismins"]), values(&["axis maxs", "axismaxs"]));
    let steps = match (values(&["spacings"]), mins, maxs) {
        (Some([Some(x), Some(y), Some(z)]), ..) => [x, y, z],
        (Some(_), ..) => return Err(malformed(FORMAT, "`spacings` are not three numbers")),
        (None, Some([Some(x0), Some(y0), Some(z0)]), Some([Some(x1), Some(y1), Some(z1)])) => {
            let step = |range: f64, n: usize, node: bool| range / (n as f64 - if node { 1.0 } else { 0.0 });
            let [i, j, k] = axes.dims;
            [step(x1 - x0, i, is_node[0]), step(y1 - y0, j, is_node[1]), step(z1 - z0, k, is_node[2])]
        }
        _ => return Err(malformed(FORMAT, "there are neither `space directions` nor `spacings`")),
    };
    let first = match mins {
        Some([Some(x), Some(y), Some(z)]) => {
            let half = |step: f64, node: bool| if node { 0.0 } else { 0.5 * step };
            Some([x + half(steps[0], is_node[0]), y + half(steps[1], is_node[1]), z + half(steps[2], is_node[2])])
        }
        _ => None,
    };
    Ok((steps, first))
}
