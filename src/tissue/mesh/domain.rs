use super::MeshError;
use super::slit::OpenedSkin;
use super::tuning::CARVE_EDGES;
use prosopon_geometry::{Aabb, Implicit, PlacedGrid, Point, ScalarGrid, Vector};

/// Target shape of the mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshSettings {
    /// Thickness of the skin layer, mm (Wang 2009: 1.5). The layer is thinner where the tissue is thinner.
    pub skin_thickness_mm: f64,
    /// Edge length of the lattice, mm.
    pub edge_mm: f64,
    /// Tissue deeper than this below the skin is omitted, mm.
    pub depth_mm: f64,
}

impl Default for MeshSettings {
    fn default() -> Self {
        Self { skin_thickness_mm: 1.5, edge_mm: 4.0, depth_mm: 30.0 }
    }
}

impl MeshSettings {
    pub(super) fn check(&self) -> Result<(), MeshError> {
        let setting = |name, found, allowed: &str| Err(MeshError::Setting { name, found, allowed: allowed.to_owned() });
        if !(0.1..=10.0).contains(&self.skin_thickness_mm) {
            return setting("skin_thickness_mm", self.skin_thickness_mm, "0.1 to 10");
        }
        if !(0.25..=20.0).contains(&self.edge_mm) {
            return setting("edge_mm", self.edge_mm, "0.25 to 20");
        }
        if !(self.least_depth_mm()..=1000.0).contains(&self.depth_mm) {
            // Rounded up to micrometres, so that the number given is allowed.
            let least = (1e3 * self.least_depth_mm()).ceil() / 1e3;
            let allowed = format!("{least} (skin_thickness_mm plus two edge_mm) to 1000");
            return setting("depth_mm", self.depth_mm, &allowed);
        }
        Ok(())
    }

    /// Smallest `depth_mm` allowed with the other two settings, mm.
    /// The carved layer under the skin must lie above the cut.
    #[must_use]
    pub fn least_depth_mm(&self) -> f64 {
        self.skin_thickness_mm + 2.0 * self.edge_mm
    }
}

/// Region of the face to be meshed: inside the box and on the positive side of each half-space's plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// Box, LPS mm.
    pub bounds: Aabb,
    /// Half-spaces as `(point, unit normal)`; points with `(x - point) · normal > 0` are kept.
    pub half_spaces: Vec<(Point, Vector)>,
}

impl Region {
    /// Signed distance (mm, negative inside) to the nearest bounding plane, and its outward unit normal.
    pub(super) fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let mut best = (f64::NEG_INFINITY, Vector::zeros());
        for a in 0..3 {
            for (value, sign) in [(p[a] - self.bounds.max[a], 1.0), (self.bounds.min[a] - p[a], -1.0)] {
                if value > best.0 {
                    best = (value, Vector::ith(a, sign));
                }
            }
        }
        for (point, normal) in &self.half_spaces {
            let value = -(p - point).dot(normal);
            if value > best.0 {
                best = (value, -normal);
            }
        }
        best
    }
}

/// Solids that bound the tissue at rest; each is negative inside.
#[derive(Clone, Copy)]
pub struct Domain<'a> {
    /// Inside of the skin.
    pub skin: &'a dyn Implicit,
    /// Outer envelope of bone.
    pub bone: &'a dyn Implicit,
    /// Air inside the head, if known.
    pub air: Option<&'a dyn Implicit>,
    /// Local mean of soft tissue, HU, NaN where unknown. It distinguishes fat from muscle.
    pub soft_tissue: Option<&'a PlacedGrid>,
    /// Region to be meshed.
    pub region: &'a Region,
}

impl std::fmt::Debug for Domain<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Domain").field("air", &self.air.is_some()).field("region", self.region).finish_non_exhaustive()
    }
}

/// Surface on which a boundary node or face lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Side {
    /// The level set `skin = -thickness`, below the prisms.
    Skin,
    Bone,
    Air,
    /// Cut by the boundary of the region.
    Region,
    /// Cut at the depth limit.
    Depth,
    /// Cut through tissue where a pocket was left out; it lies on no surface.
    Neck,
}

/// Closest point of the skin to a point inside it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Foot {
    pub(super) point: Point,
    /// Outward unit normal of the skin.
    pub(super) normal: Vector,
}

/// Implicit function of the INNER tissue (below the prisms), and queries that prisms need.
///
/// Bone and air are carved out only deeper than `thickness + carve` below the skin. A layer that the lattice resolves therefore
/// always lies below the skin, and the level set under the prisms never meets bone. Where the tissue is thinner, `press` moves
/// the nodes of that layer back to the bone.
#[derive(Debug, Clone, Copy)]
pub(super) struct InnerTissue<'a> {
    pub(super) domain: Domain<'a>,
    /// Thickness of the skin layer outside thin walls, mm.
    pub(super) thickness: f64,
    /// Thickness of the skin layer where it varies, mm.
    /// It varies slowly, so the level set's gradient is that of the skin alone.
    varying: Option<&'a ScalarGrid>,
    pub(super) edge: f64,
    depth: f64,
    /// Thickness of the layer that is always meshed below the skin layer, mm.
    pub(super) carve: f64,
    /// The skin, when it is opened along a slit: there is no such layer below the walls of the slit, which end at teeth.
    opened: Option<&'a OpenedSkin<'a>>,
}

impl<'a> InnerTissue<'a> {
    pub(super) fn new(domain: &Domain<'a>, settings: &MeshSettings) -> Self {
        Self {
            domain: *domain,
            thickness: settings.skin_thickness_mm,
            varying: None,
            edge: settings.edge_mm,
            depth: settings.depth_mm,
            carve: CARVE_EDGES * settings.edge_mm,
            opened: None,
        }
    }

    /// The same tissue, opened along a slit.
    pub(super) fn with_slit(self, opened: Option<&'a OpenedSkin<'a>>) -> Self {
        Self { opened, ..self }
    }

    /// Value of the skin that has the layer which is always meshed, mm; `skin` is the value of the whole skin at `p`.
    pub(super) fn layer_value(&self, p: &Point, skin: f64) -> f64 {
        self.opened.map_or(skin, |opened| opened.outer_value(p))
    }

    /// The same domain with a skin layer of varying thickness.
    pub(super) fn with_thickness(self, varying: Option<&'a ScalarGrid>) -> Self {
        Self { varying, ..self }
    }

    /// Thickness of the skin layer at `p`, mm.
    pub(super) fn thickness_at(&self, p: &Point) -> f64 {
        self.varying.map_or(self.thickness, |grid| grid.sample(p))
    }

    /// Value (mm, negative in the inner tissue) and the surface whose function determines it.
    pub(super) fn value_side(&self, p: &Point) -> (f64, Side) {
        let region = self.domain.region.value_gradient(p).0;
        if region > 2.0 * self.edge {
            return (region, Side::Region);
        }
        let skin = self.domain.skin.value(p);
        let thickness = self.thickness_at(p);
        let mut best = (skin + thickness, Side::Skin);
        let mut take = |value: f64, side: Side| {
            if value > best.0 {
                best = (value, side);
            }
        };
        take(region, Side::Region);
        take(-(skin + self.depth), Side::Depth);
        let layer = -(self.layer_value(p, skin) + thickness + self.carve);
        if layer > best.0 {
            let (obstacle, side) = self.obstacle(p);
            best = max_by_value(best, (layer.min(-obstacle), side));
        }
        best
    }

    /// Signed distance to the nearer of bone and air, mm (negative inside).
    pub(super) fn obstacle(&self, p: &Point) -> (f64, Side) {
        let bone = self.domain.bone.value(p);
        match self.domain.air.map(|air| air.value(p)) {
            Some(air) if air < bone => (air, Side::Air),
            _ => (bone, Side::Bone),
        }
    }

    /// Value and gradient of the function that constrains a node on `side`.
    pub(super) fn side_value_gradient(&self, side: Side, p: &Point) -> (f64, Vector) {
        let shifted = |offset: f64| {
            let (value, gradient) = self.domain.skin.value_gradient(p);
            (value + offset, gradient)
        };
        match side {
            Side::Skin => shifted(self.thickness_at(p)),
            Side::Depth => shifted(self.depth),
            Side::Bone => self.domain.bone.value_gradient(p),
            Side::Air => self.domain.air.map_or((0.0, Vector::zeros()), |air| air.value_gradient(p)),
            Side::Region => self.domain.region.value_gradient(p),
            Side::Neck => (0.0, Vector::zeros()),
        }
    }

    /// Projects a point by Newton steps onto the surface of `side`.
    /// `None` when there is no convergence within `reach` mm.
    pub(super) fn project(&self, side: Side, start: &Point, reach: f64) -> Option<Point> {
        let mut p = *start;
        for _ in 0..12 {
            let (value, gradient) = self.side_value_gradient(side, &p);
            if value.abs() < 1e-4 * self.edge {
                return Some(p);
            }
            let slope_sq = gradient.norm_squared();
            if slope_sq < 1e-6 {
                return None;
            }
            p -= gradient * (value / slope_sq);
            if (p - start).norm() > reach {
                return None;
            }
        }
        // Newton steps can oscillate at the kinks of interpolated samples; a hundredth of an edge is accurate enough.
        (self.side_value_gradient(side, &p).0.abs() < 0.01 * self.edge).then_some(p)
    }

    /// Foot on the skin of a point near it; `None` when the Newton steps do not converge within `reach` mm.
    pub(super) fn foot(&self, start: &Point, reach: f64) -> Option<Foot> {
        let mut p = *start;
        for _ in 0..12 {
            let (value, gradient) = self.domain.skin.value_gradient(&p);
            let norm = gradient.norm();
            if norm < 1e-3 {
                return None;
            }
            if value.abs() < 1e-3 {
                return Some(Foot { point: p, normal: gradient / norm });
            }
            p -= gradient * (value / (norm * norm));
            if (p - start).norm() > reach {
                return None;
            }
        }
        let (value, gradient) = self.domain.skin.value_gradient(&p);
        (value.abs() < 0.02).then_some(())?;
        Some(Foot { point: p, normal: gradient.try_normalize(1e-3)? })
    }

    /// Intersection of the skin with the line from `start` along `normal`, within `reach` mm.
    /// The search runs outwards from inside the skin and inwards from outside.
    pub(super) fn foot_along(&self, start: &Point, normal: &Vector, reach: f64) -> Option<Foot> {
        let skin = self.domain.skin;
        let first = skin.value(start);
        let along = normal * if first < 0.0 { 1.0 } else { -1.0 };
        let (mut before, mut value_before) = (0.0, first);
        while before < reach {
            let after = before + value_before.abs().max(0.01 * self.edge);
            let value = skin.value(&(start + along * after));
            if value * first <= 0.0 {
                let s = crossing(before, after, value_before, value, 1e-3, |s| skin.value(&(start + along * s)));
                let point = start + along * s;
                let normal = skin.value_gradient(&point).1.try_normalize(1e-3)?;
                return Some(Foot { point, normal });
            }
            (before, value_before) = (after, value);
        }
        None
    }

    /// Largest distance between a node and its foot on the skin that is searched, mm.
    pub(super) fn foot_reach(&self) -> f64 {
        3.0 * (self.thickness + self.edge)
    }

    /// Distance from a foot to the first bone or air along the inward normal, mm; `None` beyond `reach`.
    pub(super) fn thickness_below(&self, foot: &Foot, reach: f64) -> Option<(f64, Side)> {
        let at = |s: f64| self.obstacle(&(foot.point - foot.normal * s));
        let step = 0.25f64.min(0.1 * self.edge);
        let (first, side) = at(0.0);
        if first <= 0.0 {
            return Some((first, side));
        }
        let (mut before, mut value_before) = (0.0, first);
        while before < reach {
            let after = before + step.max(0.8 * value_before);
            let (value, side) = at(after);
            if value <= 0.0 {
                let root = crossing(before, after, value_before, value, 1e-3, |s| at(s).0);
                return (root <= reach).then_some((root, side));
            }
            (before, value_before) = (after, value);
        }
        None
    }
}

fn max_by_value(a: (f64, Side), b: (f64, Side)) -> (f64, Side) {
    if b.0 > a.0 { b } else { a }
}

/// Root of `f` between `a` and `b`, where its values differ in sign.
/// Uses false position with the Illinois weight and a bisection at every third step. Stops when the bracket or the value is
/// below `tolerance`.
pub(super) fn crossing(a: f64, b: f64, fa: f64, fb: f64, tolerance: f64, f: impl Fn(f64) -> f64) -> f64 {
    let (mut a, mut b, mut fa, mut fb) = (a, b, fa, fb);
    let mut kept = 0;
    for step in 0..60 {
        let chord = (a * fb - b * fa) / (fb - fa);
        let x = if step % 3 == 2 || !chord.is_finite() { 0.5 * (a + b) } else { chord };
        let fx = f(x);
        if fx.abs() < tolerance {
            return x;
        }
        if (fx > 0.0) == (fb > 0.0) {
            (b, fb) = (x, fx);
            fa *= if kept == 1 { 0.5 } else { 1.0 };
            kept = 1;
        } else {
            (a, fa) = (x, fx);
            fb *= if kept == 2 { 0.5 } else { 1.0 };
            kept = 2;
        }
        if (b - a).abs() < tolerance {
            break;
        }
    }
    0.5 * (a + b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_of_a_small_depth_gives_the_smallest_one_allowed() {
        let settings = MeshSettings { skin_thickness_mm: 1.5, edge_mm: 4.0, depth_mm: 9.0 };
        let error = settings.check().unwrap_err().to_string();
        assert_eq!(error, "depth_mm is 9, allowed is 9.5 (skin_thickness_mm plus two edge_mm) to 1000");
        assert!(MeshSettings { depth_mm: 9.5, ..settings }.check().is_ok());
    }
}
