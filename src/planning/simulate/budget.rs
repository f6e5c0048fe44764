//! Choice of edge length and elements within limits of error and time, by laws that `prosopon bench budget` fits.

use prosopon_tissue::fem::Locking;

/// Edge of the coarser mesh by which an error is estimated, in units of that of the solve.
pub const COARSER: f64 = 1.25;

/// Limits for a choice; one that is absent does not bound it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// 95th percentile over the moving face of the distance to the converged solution, mm.
    pub error_mm: Option<f64>,
    /// Time of mesh and path, s.
    pub wall_s: Option<f64>,
}

/// What is known before the choice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Demand {
    /// Farthest movement of bone at the end of the path, mm.
    pub displacement_mm: f64,
    /// Steps of the path.
    pub steps: u32,
    /// A mesh of this scene; it tells how large the region and how fast the machine is.
    pub mesh: Option<KnownMesh>,
    /// Longest edge that the depth of the mesh allows, mm.
    pub max_edge_mm: f64,
    /// Edge that is given, mm; chosen when `None`.
    pub edge_mm: Option<f64>,
    /// Formulation that is given; chosen when `None`.
    pub locking: Option<Locking>,
}

/// A mesh that was built before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownMesh {
    /// Edge, mm.
    pub edge_mm: f64,
    /// Number of nodes.
    pub nodes: usize,
    /// Time that it took, s.
    pub wall_s: f64,
    /// Whether it need not be built again.
    pub is_kept: bool,
}

/// A setting with what it is expected to cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// Edge, mm.
    pub edge_mm: f64,
    /// Formulation.
    pub locking: Locking,
    /// Expected error, mm: the middle of the study's scenes.
    pub error_mm: f64,
    /// Error that 95 % of the study's scenes did not exceed, mm.
    pub error_at_most_mm: f64,
    /// Expected time of mesh and path, s.
    pub wall_s: f64,
    /// Time that 95 % of the study's scenes did not exceed, s.
    pub wall_at_most_s: f64,
}

/// How a choice keeps its limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grounds {
    /// The fastest setting that is expected to keep all limits.
    Fastest,
    /// There is no limit of the error: the most accurate setting within the time.
    MostAccurateInTime,
    /// No setting within the time is expected to be this accurate: the most accurate one within the time.
    ErrorOutOfReach,
    /// No setting is expected to be this fast: the fastest one.
    TimeOutOfReach,
}

/// The chosen setting, and the others in order of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// What is chosen.
    pub chosen: Setting,
    /// Why.
    pub grounds: Grounds,
    /// Settings that are no choice: each is faster or more accurate than the chosen one, and none is worse in both.
    pub alternatives: Vec<Setting>,
}

/// A solve whose error was estimated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tried {
    /// Edge, mm.
    pub edge_mm: f64,
    /// Formulation.
    pub locking: Locking,
    /// Its estimated error, mm.
    pub error_mm: f64,
    /// Time of its path, s.
    pub path_s: f64,
}

/// Factor and exponent of a power law, and the factor on it that holds for 95 % of the points it was fitted to.
struct Law {
    factor: f64,
    exponent: f64,
    spread: f64,
}

impl Law {
    fn at(&self, x: f64) -> f64 {
        self.factor * x.powf(self.exponent)
    }
}

/// Laws of one formulation.
struct Elements {
    locking: Locking,
    /// Error per mm of displacement by edge / [`EDGE_MM`].
    error: Law,
    /// Time of six steps, s, by nodes / [`NODES`].
    path: Law,
    /// Error in units of the distance to the skin on a mesh with [`COARSER`] edges, in the middle of the scenes.
    error_by_distance: f64,
}

const EDGE_MM: f64 = 4.0;
const NODES: f64 = 10_000.0;
const STEPS: f64 = 6.0;
// Fitted by `prosopon bench budget --heads phantom,ct_head,phantom-narrow`; the times were measured beside other work.

/// Nodes of a mesh by edge / [`EDGE_MM`].
const NODES_BY_EDGE: Law = Law { factor: 29_000.0, exponent: -1.7, spread: 2.1 };
/// Time of cut and mesh, s, by nodes / [`NODES`].
const MESH: Law = Law { factor: 5.6, exponent: 0.68, spread: 4.0 };
const ELEMENTS: [Elements; 2] = [
    Elements {
        locking: Locking::None,
        error: Law { factor: 0.052, exponent: 0.8, spread: 1.6 },
        path: Law { factor: 4.9, exponent: 1.0, spread: 1.9 },
        error_by_distance: 1.35,
    },
    Elements {
        locking: Locking::Patched,
        error: Law { factor: 0.025, exponent: 1.95, spread: 1.9 },
        path: Law { factor: 8.1, exponent: 1.3, spread: 2.3 },
        error_by_distance: 0.8,
    },
];
/// Edges to choose from, mm: those that were studied.
const EDGES_MM: [f64; 4] = [7.0, 5.5, 4.5, 3.7];
/// A further solve is worth its time when its error is at most this share of the one before.
const WORTHWHILE: f64 = 0.8;
/// Margin on the expected error once a solve of the scene was estimated.
///
/// In 19 scenes that are not in the fit, 95 % of 532 pairs of settings stay below it (`prosopon bench budget`).
const SPREAD_ONCE_ESTIMATED: f64 = 1.8;
/// How far the time of a known mesh may change what is expected of this machine.
const MACHINE: [f64; 2] = [0.5, 2.0];
/// Below this share of the usual time a mesh came from a cache and tells nothing of the machine.
const CACHED: f64 = 0.25;

/// Estimated error of a solve, mm, whose skin lies at `distance_mm` from that on a mesh with [`COARSER`] edges.
#[must_use]
pub fn error_from_distance(distance_mm: f64, locking: Locking) -> f64 {
    let found = ELEMENTS.iter().find(|e| e.locking == locking);
    distance_mm * found.map_or(1.0, |e| e.error_by_distance)
}

/// Settings to choose from, in order of time.
#[must_use]
pub fn settings(demand: &Demand) -> Vec<Setting> {
    let allowed = || EDGES_MM.into_iter().filter(|edge| *edge <= demand.max_edge_mm).collect();
    let edges: Vec<f64> = demand.edge_mm.map_or_else(allowed, |edge| vec![edge]);
    let elements = || ELEMENTS.iter().filter(|e| demand.locking.is_none_or(|l| l == e.locking));
    let mut all: Vec<Setting> = edges.iter().flat_map(|edge| elements().map(|e| e.setting(*edge, demand))).collect();
    all.sort_by(|a, b| a.wall_s.total_cmp(&b.wall_s));
    all
}

/// The choice within the limits; `None` when the given formulation was not studied.
#[must_use]
pub fn choose(demand: &Demand, limits: Limits) -> Option<Choice> {
    choose_of(&settings(demand), limits)
}

/// The choice after a solve that missed the limit of the error; `None` when nothing clearly better is expected to end in time.
///
/// `demand.mesh` must be the mesh of that solve. Its error and its time correct what the laws say of this scene and machine.
#[must_use]
pub fn choose_after(tried: &Tried, demand: &Demand, limits: Limits) -> Option<Choice> {
    let same = Demand { edge_mm: Some(tried.edge_mm), locking: Some(tried.locking), ..*demand };
    let by_law = *settings(&same).first()?;
    let (error, time) = (tried.error_mm / by_law.error_mm, tried.path_s / by_law.wall_s);
    if !(error.is_finite() && time.is_finite()) {
        return None;
    }
    let corrected = |s: &Setting| Setting {
        error_mm: error * s.error_mm,
        error_at_most_mm: SPREAD_ONCE_ESTIMATED * error * s.error_mm,
        wall_s: time * s.wall_s,
        wall_at_most_s: time * s.wall_at_most_s,
        ..*s
    };
    let is_better = |s: &Setting| s.error_mm <= WORTHWHILE * tried.error_mm;
    let better: Vec<Setting> = settings(demand).iter().map(corrected).filter(is_better).collect();
    choose_of(&better, limits).filter(|choice| choice.grounds != Grounds::TimeOutOfReach)
}

/// The choice among settings in order of time; `None` when there are none.
fn choose_of(all: &[Setting], limits: Limits) -> Option<Choice> {
    let in_time = |s: &&Setting| limits.wall_s.is_none_or(|most| s.wall_at_most_s <= most);
    let accurate = |s: &&Setting| limits.error_mm.is_some_and(|most| s.error_at_most_mm <= most);
    let best_in_time = || all.iter().filter(in_time).min_by(|a, b| a.error_mm.total_cmp(&b.error_mm));
    let (chosen, grounds) = match (all.iter().filter(in_time).find(accurate), best_in_time(), limits.error_mm) {
        (Some(fastest), _, _) => (fastest, Grounds::Fastest),
        (None, Some(best), None) => (best, Grounds::MostAccurateInTime),
        (None, Some(best), Some(_)) => (best, Grounds::ErrorOutOfReach),
        (None, None, _) => (all.first()?, Grounds::TimeOutOfReach),
    };
    let is_no_worse = |s: &Setting, than: &Setting| s.wall_s <= than.wall_s && s.error_mm <= than.error_mm;
    let is_front = |s: &&Setting| !all.iter().any(|other| other != *s && is_no_worse(other, s));
    let alternatives = all.iter().filter(|s| *s != chosen).filter(is_front).copied().collect();
    Some(Choice { chosen: *chosen, grounds, alternatives })
}

impl Elements {
    fn setting(&self, edge_mm: f64, demand: &Demand) -> Setting {
        let edge = edge_mm / EDGE_MM;
        let nodes_of = |edge_mm: f64| NODES_BY_EDGE.at(edge_mm / EDGE_MM);
        let of_region = demand.mesh.map_or(1.0, |known| known.nodes as f64 / nodes_of(known.edge_mm));
        let nodes = of_region * nodes_of(edge_mm) / NODES;
        let machine = demand.mesh.map_or(1.0, |known| {
            let ([least, most], times) = (MACHINE, known.wall_s / MESH.at(known.nodes as f64 / NODES));
            if times < CACHED { 1.0 } else { times.clamp(least, most) }
        });
        let is_built = demand.mesh.is_some_and(|known| known.is_kept && known.edge_mm == edge_mm);
        let mesh_s = if is_built { 0.0 } else { machine * MESH.at(nodes) };
        let path_s = machine * self.path.at(nodes) * f64::from(demand.steps) / STEPS;
        let error_mm = demand.displacement_mm * self.error.at(edge);
        // A known mesh tells the size of the region.
        let unsure = if demand.mesh.is_some() { 1.0 } else { NODES_BY_EDGE.spread };
        Setting {
            edge_mm,
            locking: self.locking,
            error_mm,
            error_at_most_mm: self.error.spread * error_mm,
            wall_s: mesh_s + path_s,
            wall_at_most_s: unsure * (MESH.spread * mesh_s + self.path.spread * path_s),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn demand() -> Demand {
        Demand { displacement_mm: 6.0, steps: 6, mesh: None, max_edge_mm: 20.0, edge_mm: None, locking: None }
    }

    fn chosen(error_mm: Option<f64>, wall_s: Option<f64>) -> Choice {
        choose(&demand(), Limits { error_mm, wall_s }).unwrap()
    }

    #[test]
    fn the_fastest_setting_within_the_limits_is_chosen() {
        let all = settings(&demand());
        assert_eq!(all.len(), EDGES_MM.len() * ELEMENTS.len());
        for limit in &all {
            let choice = chosen(Some(limit.error_at_most_mm), None);
            assert_eq!(choice.grounds, Grounds::Fastest);
            assert!(choice.chosen.error_at_most_mm <= limit.error_at_most_mm && choice.chosen.wall_s <= limit.wall_s);
            let faster = all.iter().filter(|s| s.wall_s < choice.chosen.wall_s);
            assert!(faster.into_iter().all(|s| s.error_at_most_mm > limit.error_at_most_mm));
        }
    }

    #[test]
    fn what_cannot_be_kept_is_said_and_the_rest_is_kept() {
        let all = settings(&demand());
        let [fastest, slowest] = [all[0], all[all.len() - 1]];
        let best = all.iter().map(|s| s.error_mm).fold(f64::INFINITY, f64::min);
        let choice = chosen(Some(1e-9), None);
        assert_eq!((choice.grounds, choice.chosen.error_mm), (Grounds::ErrorOutOfReach, best));
        let choice = chosen(None, Some(slowest.wall_at_most_s * 10.0));
        assert_eq!((choice.grounds, choice.chosen.error_mm), (Grounds::MostAccurateInTime, best));
        let choice = chosen(Some(1e-9), Some(fastest.wall_at_most_s));
        assert!(choice.grounds == Grounds::ErrorOutOfReach && choice.chosen.wall_at_most_s <= fastest.wall_at_most_s);
        let choice = chosen(Some(10.0), Some(1e-3));
        assert_eq!((choice.grounds, choice.chosen), (Grounds::TimeOutOfReach, fastest));
    }

    #[test]
    fn a_missed_error_leads_to_better_settings_until_none_is_left() {
        let known = |edge_mm| {
            let nodes = NODES_BY_EDGE.at(edge_mm / EDGE_MM) as usize;
            KnownMesh { edge_mm, nodes, wall_s: 0.0, is_kept: true }
        };
        let limits = Limits { error_mm: Some(0.1), wall_s: None };
        let mut tried = Tried { edge_mm: 7.0, locking: Locking::None, error_mm: 0.6, path_s: 4.0 };
        let mut tries = 0;
        let after = |tried: &Tried, limits| {
            choose_after(tried, &Demand { mesh: Some(known(tried.edge_mm)), ..demand() }, limits)
        };
        while let Some(choice) = after(&tried, limits) {
            let Setting { edge_mm, locking, error_mm, wall_s, .. } = choice.chosen;
            assert!(error_mm <= WORTHWHILE * tried.error_mm, "{choice:?}");
            tried = Tried { edge_mm, locking, error_mm, path_s: wall_s };
            tries += 1;
        }
        assert!((1..=6).contains(&tries), "{tries}");
        // A scene twice as hard as usual on a machine of half the speed.
        let hard = |scale: f64| Tried {
            edge_mm: 5.5,
            locking: Locking::None,
            error_mm: scale * 6.0 * ELEMENTS[0].error.at(5.5 / EDGE_MM),
            path_s: scale * ELEMENTS[0].path.at(known(5.5).nodes as f64 / NODES),
        };
        let [usual, twice] = [1.0, 2.0].map(|scale| after(&hard(scale), limits).unwrap().chosen);
        assert!(
            (twice.error_mm / usual.error_mm - 2.0).abs() < 1e-9 && (twice.wall_s / usual.wall_s - 2.0).abs() < 1e-9
        );
        // No time is left, or nothing is left to choose.
        assert_eq!(after(&hard(1.0), Limits { wall_s: Some(0.1), ..limits }), None);
        let fixed = Demand { edge_mm: Some(5.5), locking: Some(Locking::None), mesh: Some(known(5.5)), ..demand() };
        assert_eq!(choose_after(&hard(1.0), &fixed, limits), None);
    }

    #[test]
    fn alternatives_are_a_pareto_front() {
        let choice = chosen(Some(1e-9), None);
        assert!(choice.alternatives.is_sorted_by(|a, b| a.wall_s < b.wall_s && a.error_mm > b.error_mm));
        assert!(!choice.alternatives.contains(&choice.chosen));
    }

    #[test]
    fn given_values_stay_and_a_known_mesh_scales_the_times() {
        let given = Demand { edge_mm: Some(9.3), locking: Some(Locking::Patched), ..demand() };
        let all = settings(&given);
        assert!(all.len() == 1 && all[0].edge_mm == 9.3 && all[0].locking == Locking::Patched);
        assert!(
            choose(&Demand { locking: Some(Locking::Smoothed), ..demand() }, Limits { error_mm: None, wall_s: None })
                .is_none()
        );
        assert!(settings(&Demand { max_edge_mm: 4.2, ..demand() }).iter().all(|s| s.edge_mm <= 3.7));
        // Twice the nodes in the time that they usually take, and the same nodes in twice the time.
        let usual = Demand { edge_mm: Some(4.0), locking: Some(Locking::None), ..demand() };
        let at = |nodes: f64, slower: f64| {
            let wall_s = slower * MESH.at(nodes / NODES);
            let mesh = Some(KnownMesh { edge_mm: 5.0, nodes: nodes as usize, wall_s, is_kept: true });
            settings(&Demand { mesh, ..usual })[0].wall_s
        };
        let nodes = NODES_BY_EDGE.at(5.0 / EDGE_MM).round();
        assert!((at(nodes, 1.0) / settings(&usual)[0].wall_s - 1.0).abs() < 1e-3);
        assert!((at(nodes, 2.0) / at(nodes, 1.0) - 2.0).abs() < 1e-9);
        // From a cache, and after attempts that failed.
        assert_eq!(at(nodes, 0.001), at(nodes, 1.0));
        assert_eq!(at(nodes, 9.0), at(nodes, 2.0));
        assert!(at(2.0 * nodes, 1.0) > 1.5 * at(nodes, 1.0));
        // The very mesh costs nothing while it is kept, and its time again once it is not.
        let [kept, gone] = [true, false].map(|is_kept| {
            let mesh = Some(KnownMesh { edge_mm: 4.0, nodes: NODES as usize, wall_s: MESH.factor, is_kept });
            settings(&Demand { mesh, ..usual })[0].wall_s
        });
        assert!((gone - kept - MESH.factor).abs() < 1e-9);
    }
}
