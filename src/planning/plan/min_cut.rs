//! Minimum cut: the cheapest set of grid edges that separates two sets of nodes.

use super::lattice::{OUTSIDE, lattice};
use super::pieces::for_each_neighbour;
use super::tuning::{COARSE_BLOCK, EXTRA_COST, FALL_OFF_MM, FINE_STEPS, MAX_FLOW};
use prosopon_geometry::ScalarGrid;
use prosopon_geometry::control::{Cancelled, Control};

/// For each node, whether it is connected to the sources once the cheapest set of open edges is cut.
///
/// `None` when sources and sinks are already separate, and when the flow exceeds [`MAX_FLOW`].
///
/// Maximum flow by level graphs (Dinic 1970). Away from sources and sinks, connected nodes of one block are merged.
pub(super) fn reached(
    grid: &ScalarGrid,
    blocked: &[u8],
    sources: &[usize],
    sinks: &[usize],
    control: &Control,
) -> Result<Option<Vec<bool>>, Cancelled> {
    let steps = steps_from(grid, blocked, sources.iter().chain(sinks), control)?;
    let (group, n) = groups(grid, blocked, &steps);
    control.check()?;
    let groups_of = |nodes: &[usize]| nodes.iter().map(|n| group[*n] as usize).collect();
    let mut flow = Flow::new(arcs(grid, blocked, &steps, &group), n, groups_of(sources), groups_of(sinks));
    let mut total = 0;
    while flow.levels(control)? {
        total += flow.block(control)?;
        if total > MAX_FLOW {
            return Ok(None);
        }
    }
    if total == 0 {
        return Ok(None);
    }
    let reached = flow.reached();
    Ok(Some(group.iter().map(|g| *g != OUTSIDE && reached[*g as usize]).collect()))
}

/// Number of grid steps through bone from the nearest of `seeds`; [`OUTSIDE`] where no path leads.
fn steps_from<'a>(
    grid: &ScalarGrid,
    blocked: &[u8],
    seeds: impl Iterator<Item = &'a usize>,
    control: &Control,
) -> Result<Vec<u32>, Cancelled> {
    let mut steps = vec![OUTSIDE; grid.values.len()];
    let mut queue: Vec<usize> = seeds.copied().collect();
    queue.iter().for_each(|n| steps[*n] = 0);
    let mut at = 0;
    while at < queue.len() {
        if at.is_multiple_of(65_536) {
            control.check()?;
        }
        let node = queue[at];
        at += 1;
        for_each_neighbour(grid, blocked, node, |other| {
            if steps[other] == OUTSIDE {
                steps[other] = steps[node] + 1;
                queue.push(other);
            }
        });
    }
    Ok(steps)
}

/// Group of each node that `steps` reaches, else [`OUTSIDE`], and the number of groups.
fn groups(grid: &ScalarGrid, blocked: &[u8], steps: &[u32]) -> (Vec<u32>, usize) {
    let block_of = |node: usize| lattice(grid, node).map(|c| c / COARSE_BLOCK);
    let mut group = vec![OUTSIDE; steps.len()];
    let mut n = 0u32;
    let mut stack = Vec::new();
    for seed in 0..steps.len() {
        if steps[seed] == OUTSIDE || group[seed] != OUTSIDE {
            continue;
        }
        group[seed] = n;
        if steps[seed] > FINE_STEPS {
            let block = block_of(seed);
            stack.push(seed);
            while let Some(node) = stack.pop() {
                for_each_neighbour(grid, blocked, node, |other| {
                    if group[other] == OUTSIDE && steps[other] > FINE_STEPS && block_of(other) == block {
                        group[other] = n;
                        stack.push(other);
                    }
                });
            }
        }
        n += 1;
    }
    (group, n as usize)
}

/// The cost of separating two groups; the smaller group comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Arc {
    ends: [u32; 2],
    cost: u32,
}

/// Arcs between neighbouring groups, sorted.
fn arcs(grid: &ScalarGrid, blocked: &[u8], steps: &[u32], group: &[u32]) -> Vec<Arc> {
    let cost = |steps: u32| {
        let mm = f64::from(steps) * grid.spacing;
        1 + (EXTRA_COST * (-mm / FALL_OFF_MM).exp()).round() as u32
    };
    let mut arcs = Vec::new();
    for node in 0..group.len() {
        if group[node] == OUTSIDE {
            continue;
        }
        for_each_neighbour(grid, blocked, node, |other| {
            if group[node] < group[other] {
                let cost = cost(steps[node].min(steps[other]));
                arcs.push(Arc { ends: [group[node], group[other]], cost });
            }
        });
    }
    arcs.sort_unstable();
    arcs.dedup_by(|b, a| {
        let same = a.ends == b.ends;
        if same {
            a.cost += b.cost;
        }
        same
    });
    arcs
}

/// A flow network whose arcs have the same capacity in both directions.
struct Flow {
    /// Arcs of node `i` are those from `first[i]` to `first[i + 1]`.
    first: Vec<u32>,
    to: Vec<u32>,
    /// Index of the reverse arc.
    back: Vec<u32>,
    /// Capacity left.
    left: Vec<u32>,
    /// Steps to the nearest sink, or [`OUTSIDE`].
    level: Vec<u32>,
    sources: Vec<usize>,
    sinks: Vec<usize>,
    is_source: Vec<bool>,
}

impl Flow {
    fn new(arcs: Vec<Arc>, n: usize, sources: Vec<usize>, sinks: Vec<usize>) -> Self {
        let mut first = vec![0u32; n + 1];
        for Arc { ends: [a, b], .. } in &arcs {
            first[*a as usize + 1] += 1;
            first[*b as usize + 1] += 1;
        }
        for i in 0..n {
            first[i + 1] += first[i];
        }
        let mut next = first.clone();
        let (mut to, mut back, mut left) = (vec![0; 2 * arcs.len()], vec![0; 2 * arcs.len()], vec![0; 2 * arcs.len()]);
        for Arc { ends: [a, b], cost } in arcs {
            let (i, j) = (next[a as usize], next[b as usize]);
            next[a as usize] += 1;
            next[b as usize] += 1;
            for (arc, other, target) in [(i, j, b), (j, i, a)] {
                to[arc as usize] = target;
                back[arc as usize] = other;
                left[arc as usize] = cost;
            }
        }
        let mut is_source = vec![false; n];
        sources.iter().for_each(|s| is_source[*s] = true);
        Self { first, to, back, left, level: vec![OUTSIDE; n], sources, sinks, is_source }
    }

    /// For each node, whether it is reached from the sources over arcs with capacity left.
    fn reached(&self) -> Vec<bool> {
        let mut reached = self.is_source.clone();
        let mut queue = self.sources.clone();
        let mut at = 0;
        while at < queue.len() {
            for arc in self.arcs(queue[at]) {
                let other = self.to[arc] as usize;
                if self.left[arc] > 0 && !std::mem::replace(&mut reached[other], true) {
                    queue.push(other);
                }
            }
            at += 1;
        }
        reached
    }

    fn arcs(&self, node: usize) -> std::ops::Range<usize> {
        self.first[node] as usize..self.first[node + 1] as usize
    }

    /// Sets the levels, the steps to the nearest sink over arcs with capacity left; returns whether a source reaches a sink.
    ///
    /// Levels count from the sinks, so that no path of falling levels is a dead end until arcs are filled.
    fn levels(&mut self, control: &Control) -> Result<bool, Cancelled> {
        control.check()?;
        self.level.fill(OUTSIDE);
        let mut queue = self.sinks.clone();
        queue.iter().for_each(|s| self.level[*s] = 0);
        let (mut at, mut found) = (0, false);
        while at < queue.len() {
            let node = queue[at];
            at += 1;
            for arc in self.arcs(node) {
                let other = self.to[arc] as usize;
                if self.level[other] == OUTSIDE && self.left[self.back[arc] as usize] > 0 {
                    self.level[other] = self.level[node] + 1;
                    found |= self.is_source[other];
                    queue.push(other);
                }
            }
        }
        Ok(found)
    }

    /// Sends flow along falling levels until no path is left; returns the flow sent.
    fn block(&mut self, control: &Control) -> Result<u64, Cancelled> {
        let mut next_arc = self.first.clone();
        let mut path: Vec<usize> = Vec::new();
        let mut sent = 0;
        for index in 0..self.sources.len() {
            control.check()?;
            let source = self.sources[index];
            if self.level[source] == OUTSIDE {
                continue;
            }
            let mut node = source;
            loop {
                if self.level[node] == 0 {
                    let amount = path.iter().map(|arc| self.left[*arc]).min().unwrap_or(0);
                    // A node that is both source and sink would send without end.
                    if amount == 0 {
                        break;
                    }
                    let mut full = path.len();
                    for (place, arc) in path.iter().enumerate().rev() {
                        self.left[*arc] -= amount;
                        self.left[self.back[*arc] as usize] += amount;
                        if self.left[*arc] == 0 {
                            full = place;
                        }
                    }
                    sent += u64::from(amount);
                    // The path before the first full arc can still send.
                    node = self.start(path[full]);
                    path.truncate(full);
                    continue;
                }
                let open = (next_arc[node] as usize..self.first[node + 1] as usize)
                    .find(|arc| self.left[*arc] > 0 && self.level[self.to[*arc] as usize] < self.level[node]);
                if let Some(arc) = open {
                    next_arc[node] = arc as u32;
                    path.push(arc);
                    node = self.to[arc] as usize;
                } else {
                    next_arc[node] = self.first[node + 1];
                    let Some(arc) = path.pop() else { break };
                    node = self.start(arc);
                    next_arc[node] += 1;
                }
            }
        }
        Ok(sent)
    }

    /// The node that an arc leaves.
    fn start(&self, arc: usize) -> usize {
        self.to[self.back[arc] as usize] as usize
    }
}
