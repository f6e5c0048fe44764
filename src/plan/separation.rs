//! Where the cuts run between nodes of different segments.

use std::collections::BTreeMap;

use super::cut::Blade;
use super::parting::{Crossing, lattice, neighbours, strides};
use crate::geometry::{Point, ScalarGrid};

/// What the cuts do at the nodes beside them.
pub(super) struct Separation {
    /// Distance of an inside node to the nearest plane that separates it from a neighbour in another segment, mm; infinite
    /// elsewhere.
    pub(super) distance: Vec<f32>,
    /// Distance of an air node to a plane that lies between it and a segment's node beside it, by node and segment.
    pub(super) beyond: BTreeMap<(usize, u32), f32>,
    /// Cuts that bound each segment.
    pub(super) bounded_by: Vec<Vec<usize>>,
}

impl Separation {
    /// `segment`: segment of every node, anything else for air and crumbs.
    pub(super) fn new(
        grid: &ScalarGrid,
        segment: &[u32],
        n_segments: u32,
        crossings: &[Crossing],
        blades: &[Blade],
    ) -> Self {
        let mut distance = vec![f32::INFINITY; segment.len()];
        let mut bounded_by = vec![Vec::new(); n_segments as usize];
        let steps = strides(grid);
        let position = |node: usize| -> Point {
            let [i, j, k] = lattice(grid, node);
            grid.position(i, j, k)
        };
        // A node in a plane keeps a little depth, else it would be outside both segments.
        let least = 1e-3 * grid.spacing;
        let to_plane = |cut: usize, node: usize| blades[cut].side(&position(node)).abs().max(least) as f32;
        let mut beside = Vec::new();
        for c in crossings {
            let ends = [c.node, c.node + steps[c.axis]];
            if segment[ends[0]] == segment[ends[1]] {
                continue;
            }
            for node in ends {
                distance[node] = distance[node].min(to_plane(c.cut, node));
                if let Some(list) = bounded_by.get_mut(segment[node] as usize) {
                    beside.push(node);
                    if let Err(place) = list.binary_search(&c.cut) {
                        list.insert(place, c.cut);
                    }
                }
            }
        }
        // At the rim the planes also run between bone and air: without this, bone would jut out over the cut.
        let around = |node: &usize| -> Vec<usize> {
            let own = segment[*node];
            neighbours(grid, *node).filter(|other| segment[*other] == own).chain([*node]).collect()
        };
        let mut rim: Vec<usize> = beside.iter().flat_map(around).collect();
        rim.sort_unstable();
        rim.dedup();
        let mut beyond: BTreeMap<(usize, u32), f32> = BTreeMap::new();
        for node in rim {
            let own = segment[node];
            for air in neighbours(grid, node).filter(|other| grid.values[*other] >= 0.0) {
                for cut in bounded_by[own as usize].iter().copied() {
                    if blades[cut].crosses(&position(node), &position(air), false) {
                        distance[node] = distance[node].min(to_plane(cut, node));
                        let far = beyond.entry((air, own)).or_insert(0.0);
                        *far = far.max(to_plane(cut, air));
                    }
                }
            }
        }
        Self { distance, beyond, bounded_by }
    }
}
