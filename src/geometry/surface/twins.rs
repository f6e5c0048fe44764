//! Triangles with the same three corners.

use crate::connectivity::{Edges, Sets};

/// Triangles that were left out or found because others have the same corners.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Twins {
    /// Left out: another one has the same corners in the same direction.
    pub(super) repeated: usize,
    /// Left out: another one has the same corners in the other direction, in a part that is stored for both of its sides.
    pub(super) second_sides: usize,
    /// Kept, though another one has the same corners in the other direction: sheets without thickness in a surface.
    pub(super) opposed: usize,
}

/// Leaves out triangles that repeat others, and says whether the edges have changed.
///
/// Of triangles with the same corners in the same direction the first stays. Pairs in opposite directions form patches, which
/// are connected through edges. A patch along whose border the rest of the surface has an odd number of triangles, or that has
/// no rest, is a surface that is stored twice: the first of each pair stays. Any other patch is a sheet without thickness on
/// the surface, and stays.
pub(super) fn drop_twins(triangles: &mut Vec<[u32; 3]>, edges: &Edges) -> Twins {
    let mut found = Twins::default();
    let mut dropped: Vec<u32> = Vec::new();
    let pairs = pairs(triangles, edges, &mut dropped);
    found.repeated = dropped.len();
    if !pairs.is_empty() {
        let second_sides = second_sides(triangles.len(), edges, &pairs, &dropped);
        found.second_sides = second_sides.len();
        found.opposed = 2 * (pairs.len() - second_sides.len());
        dropped.extend(second_sides);
    }
    if !dropped.is_empty() {
        dropped.sort_unstable();
        let mut next = dropped.into_iter().peekable();
        let mut at = 0u32;
        triangles.retain(|_| {
            at += 1;
            next.next_if_eq(&(at - 1)).is_none()
        });
    }
    found
}

/// Pairs of triangles with the same corners in opposite directions; adds repeated ones to `dropped`.
fn pairs(triangles: &[[u32; 3]], edges: &Edges, dropped: &mut Vec<u32>) -> Vec<[u32; 2]> {
    let mut pairs = Vec::new();
    let mut thirds: Vec<(u32, u32, bool)> = Vec::new();
    for ([a, b], sides) in edges.iter().filter(|(_, sides)| sides.len() > 1) {
        // Each triangle is looked at along the edge of its two smallest corners.
        let third = |t: u32| triangles[t as usize].iter().copied().find(|v| *v != a && *v != b);
        thirds.clear();
        thirds.extend(
            sides.iter().filter_map(|s| third(s.triangle()).filter(|v| *v > b).map(|v| (v, s.triangle(), s.forward()))),
        );
        if thirds.len() < 2 {
            continue;
        }
        thirds.sort_unstable();
        for same in thirds.chunk_by(|x, y| x.0 == y.0).filter(|same| same.len() > 1) {
            let first = |forward: bool| same.iter().find(|s| s.2 == forward).map(|s| s.1);
            let kept = [first(true), first(false)];
            dropped.extend(same.iter().map(|s| s.1).filter(|t| !kept.contains(&Some(*t))));
            if let [Some(one), Some(other)] = kept {
                pairs.push([one.min(other), one.max(other)]);
            }
        }
    }
    pairs
}

/// The second triangle of each pair in a patch that is stored for both of its sides.
fn second_sides(n_triangles: usize, edges: &Edges, pairs: &[[u32; 2]], dropped: &[u32]) -> Vec<u32> {
    const NONE: u32 = u32::MAX;
    const GONE: u32 = u32::MAX - 1;
    let mut pair_of = vec![NONE; n_triangles];
    for &t in dropped {
        pair_of[t as usize] = GONE;
    }
    for (n, pair) in pairs.iter().enumerate() {
        for &t in pair {
            pair_of[t as usize] = n as u32;
        }
    }
    let mut patches = Sets::new(pairs.len());
    // Per edge with a pair: one of its pairs, and how many triangles of the rest it has.
    let mut borders: Vec<(u32, usize)> = Vec::new();
    for (_, sides) in edges.iter() {
        let mut first = None;
        let mut rest = 0;
        for side in sides {
            match (pair_of[side.triangle() as usize], first) {
                (GONE, _) => {}
                (NONE, _) => rest += 1,
                (pair, None) => first = Some(pair),
                (pair, Some(first)) => patches.join(pair, first),
            }
        }
        if let Some(pair) = first
            && rest > 0
        {
            borders.push((pair, rest));
        }
    }
    let mut odd = vec![0i64; pairs.len()];
    let mut attached = vec![false; pairs.len()];
    for (pair, rest) in borders {
        let patch = patches.find(pair) as usize;
        attached[patch] = true;
        odd[patch] += if rest % 2 == 1 { 1 } else { -1 };
    }
    let mut is_stored_twice = |n: usize| {
        let patch = patches.find(n as u32) as usize;
        !attached[patch] || odd[patch] > 0
    };
    pairs.iter().enumerate().filter(|(n, _)| is_stored_twice(*n)).map(|(_, pair)| pair[1]).collect()
}
