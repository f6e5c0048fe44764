use prosopon_geometry::Vector;

/// The nine functions N9* of a triangle (Wang 2009, eq. 0.16 and Appendix A), in values and edge derivatives.
///
/// Function `3 i` belongs to the value at corner `i`, functions `3 i + 1` and `3 i + 2` to the derivatives along the edges from
/// `i` to the next corner and to the one after.
///
/// The cubics N9 alone have a cross-boundary derivative that varies quadratically along an edge. A rational blend for each edge
/// removes the difference from the linear variation at the midpoint, and so along the whole edge. Second derivatives of the
/// blends are singular at the corners; they are set to 0 there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BlendedCubic {
    /// Share of each edge's blend in each function; edge `i` is opposite corner `i`.
    blend: [[f64; 9]; 3],
}

const fn next(i: usize) -> usize {
    (i + 1) % 3
}

/// Index of the function of the derivative along the edge from `from` to `to`.
const fn along(from: usize, to: usize) -> usize {
    3 * from + if to == next(from) { 1 } else { 2 }
}

impl BlendedCubic {
    /// For a flat triangle with these corners: its angles define the direction normal to each edge.
    pub(super) fn new(corners: &[Vector; 3]) -> Self {
        let mut blend = [[0.0; 9]; 3];
        for i in 0..3 {
            let (j, k) = (next(i), next(next(i)));
            // Direction from the foot of the height on edge jk to corner i, in barycentric coordinates: dL_i = 1.
            let edge = corners[k] - corners[j];
            let foot = (corners[i] - corners[j]).dot(&edge) / edge.norm_squared();
            let mut direction = [0.0; 3];
            direction[i] = 1.0;
            direction[j] = foot - 1.0;
            direction[k] = -foot;
            let mut middle = [0.5; 3];
            middle[i] = 0.0;

            // Z of eq. 0.16, then Y: half the derivative in that direction at each end.
            let gradients = cubic_gradients(middle);
            for (share, g) in blend[i].iter_mut().zip(&gradients) {
                *share = -(0..3).map(|c| g[c] * direction[c]).sum::<f64>();
            }
            blend[i][along(j, i)] += 0.5;
            blend[i][along(j, k)] -= 0.5 * foot;
            blend[i][along(k, i)] += 0.5;
            blend[i][along(k, j)] -= 0.5 * (1.0 - foot);
            // The blend's own derivative at the midpoint is 1/4.
            blend[i].iter_mut().for_each(|share| *share *= 4.0);
        }
        Self { blend }
    }

    /// Values at barycentric coordinates `l`.
    pub(super) fn values(&self, l: [f64; 3]) -> [f64; 9] {
        let mut values = [0.0; 9];
        let bubble = 0.5 * l[0] * l[1] * l[2];
        for i in 0..3 {
            let (j, k) = (next(i), next(next(i)));
            values[3 * i] = l[i] + l[i] * l[i] * (l[j] + l[k]) - l[i] * (l[j] * l[j] + l[k] * l[k]);
            values[3 * i + 1] = l[i] * l[i] * l[j] + bubble;
            values[3 * i + 2] = l[i] * l[i] * l[k] + bubble;
        }
        for i in 0..3 {
            let (edge, _) = blend(l, i);
            for a in 0..9 {
                values[a] += self.blend[i][a] * edge;
            }
        }
        values
    }

    /// Derivatives by (L2, L3), with L1 = 1 - L2 - L3, at `l`.
    pub(super) fn derivatives(&self, l: [f64; 3]) -> [[f64; 2]; 9] {
        let mut gradients = cubic_gradients(l);
        for i in 0..3 {
            let (_, edge) = blend(l, i);
            for a in 0..9 {
                for c in 0..3 {
                    gradients[a][c] += self.blend[i][a] * edge[c];
                }
            }
        }
        gradients.map(|[d1, d2, d3]| [d2 - d1, d3 - d1])
    }
}

/// Derivatives of the cubics N9 by L1, L2, L3, taken as independent.
fn cubic_gradients(l: [f64; 3]) -> [[f64; 3]; 9] {
    let mut g = [[0.0; 3]; 9];
    for i in 0..3 {
        let (j, k) = (next(i), next(next(i)));
        g[3 * i][i] = 1.0 + 2.0 * l[i] * (l[j] + l[k]) - l[j] * l[j] - l[k] * l[k];
        g[3 * i][j] = l[i] * (l[i] - 2.0 * l[j]);
        g[3 * i][k] = l[i] * (l[i] - 2.0 * l[k]);
        for (function, to, other) in [(3 * i + 1, j, k), (3 * i + 2, k, j)] {
            g[function][i] = 2.0 * l[i] * l[to] + 0.5 * l[j] * l[k];
            g[function][to] = l[i] * l[i] + 0.5 * l[i] * l[other];
            g[function][other] = 0.5 * l[i] * l[to];
        }
    }
    g
}

/// Zienkiewicz's rational blend of the edge opposite corner `i`, L_i L_j² L_k² (1 + L_i) / ((L_i + L_j)(L_i + L_k)), and its
/// derivatives by L1, L2, L3. It vanishes on all edges, and so does its slope, except on its own edge, where the slope is L_j
/// L_k.
fn blend(l: [f64; 3], i: usize) -> (f64, [f64; 3]) {
    let (j, k) = (next(i), next(next(i)));
    let (a, b, c) = (l[i], l[j], l[k]);
    let (ab, ac) = (a + b, a + c);
    let mut gradient = [0.0; 3];
    // At corners j and k the quotient is 0/0; value and slope tend to 0.
    if ab <= f64::MIN_POSITIVE || ac <= f64::MIN_POSITIVE {
        return (0.0, gradient);
    }
    // Each factor divided by its denominator stays bounded.
    let (p, q) = (b / ab, c / ac);
    let depth = a * (1.0 + a);
    gradient[i] = (1.0 + 2.0 * a) * b * p * c * q - depth * p * q * (p * c + b * q);
    gradient[j] = depth * c * q * (2.0 * p - p * p);
    gradient[k] = depth * b * p * (2.0 * q - q * q);
    (depth * b * p * c * q, gradient)
}
