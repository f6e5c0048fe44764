use super::tree::Tree;
use super::triangle::solid_angle;
use prosopon_geometry::{Point, Vector};

/// A tree node replaces its triangles when the query is farther than this many of its radii away.
const ACCURACY: f64 = 2.3;

/// Far field of the triangles below a node: a dipole and its first moment about `center`.
#[derive(Debug, Clone)]
struct Dipole {
    center: Point,
    /// Square of the distance beyond which the expansion is used, mm².
    reach_sq: f64,
    /// Sum of areas times normals, mm².
    normal: Vector,
    /// Symmetric part of the sum of area (c - center) nᵀ: xx, yy, zz, xy, xz, yz, mm³.
    moment: [f64; 6],
}

/// Generalised winding number of a triangle soup by a tree of dipoles.
///
/// w(q) = 1/4π Σ ∫ (x - q)·n / |x - q|³ dA. Near triangles contribute their exact solid angles, far ones the first-order Taylor
/// expansion about the centre of their area: N·r/|r|³ + tr M/|r|³ - 3 rᵀ M r/|r|⁵ with r = center - q.
///
/// # Source
/// G. Barill, N. Dickson, R. Schmidt, D. Levin, A. Jacobson, Fast winding numbers for soups and clouds, SIGGRAPH 2018.
#[derive(Debug, Clone)]
pub(super) struct Winding {
    dipoles: Vec<Dipole>,
    /// Whether each triangle (tree order) counts.
    counts: Vec<bool>,
}

impl Winding {
    /// Builds the expansions; `counts` holds for each triangle of the mesh whether it counts.
    pub(super) fn new(tree: &Tree, counts: &[bool]) -> Self {
        let counts: Vec<bool> = tree.original.iter().map(|&t| counts[t as usize]).collect();
        let parts: Vec<(Point, Vector)> = tree
            .corners
            .iter()
            .zip(&counts)
            .map(|([a, b, c], counts)| {
                let normal = if *counts { (b - a).cross(&(c - a)) * 0.5 } else { Vector::zeros() };
                (a + ((b - a) + (c - a)) / 3.0, normal)
            })
            .collect();
        let dipoles = tree
            .nodes
            .iter()
            .map(|node| {
                let range = node.first as usize..node.last as usize;
                dipole(&parts[range.clone()], &tree.corners[range])
            })
            .collect();
        Self { dipoles, counts }
    }

    /// Winding number at `q`; `tree` is the one that the expansions were built from.
    pub(super) fn at(&self, tree: &Tree, q: &Point) -> f64 {
        let mut sum = 0.0;
        let mut stack = [0u32; 64];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let index = stack[top] as usize;
            let dipole = &self.dipoles[index];
            let r = dipole.center - q;
            let r_sq = r.norm_squared();
            if r_sq > dipole.reach_sq {
                sum += dipole.far_field(&r, r_sq);
                continue;
            }
            let node = &tree.nodes[index];
            if node.second == 0 {
                for slot in node.first as usize..node.last as usize {
                    if self.counts[slot] {
                        sum += solid_angle(q, &tree.corners[slot]);
                    }
                }
            } else {
                stack[top] = node.second;
                stack[top + 1] = index as u32 + 1;
                top += 2;
            }
        }
        sum / (4.0 * std::f64::consts::PI)
    }
}

impl Dipole {
    fn far_field(&self, r: &Vector, r_sq: f64) -> f64 {
        let inverse_cube = 1.0 / (r_sq * r_sq.sqrt());
        let [xx, yy, zz, xy, xz, yz] = self.moment;
        let quadratic =
            xx * r.x * r.x + yy * r.y * r.y + zz * r.z * r.z + 2.0 * (xy * r.x * r.y + xz * r.x * r.z + yz * r.y * r.z);
        inverse_cube * (self.normal.dot(r) + (xx + yy + zz) - 3.0 * quadratic / r_sq)
    }
}

fn dipole(parts: &[(Point, Vector)], corners: &[[Point; 3]]) -> Dipole {
    let first = parts[0].0;
    let mut area = 0.0;
    let mut offset = Vector::zeros();
    let mut normal = Vector::zeros();
    for (center, n) in parts {
        let a = n.norm();
        area += a;
        offset += (center - first) * a;
        normal += n;
    }
    let center = if area > 0.0 { first + offset / area } else { first };
    let mut m = [0.0; 6];
    for (c, n) in parts {
        let e = c - center;
        m[0] += e.x * n.x;
        m[1] += e.y * n.y;
        m[2] += e.z * n.z;
        m[3] += 0.5 * (e.x * n.y + e.y * n.x);
        m[4] += 0.5 * (e.x * n.z + e.z * n.x);
        m[5] += 0.5 * (e.y * n.z + e.z * n.y);
    }
    let radius_sq = corners.iter().flatten().map(|c| (c - center).norm_squared()).fold(0.0, f64::max);
    Dipole { center, reach_sq: ACCURACY * ACCURACY * radius_sq, normal, moment: m }
}
