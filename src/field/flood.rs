//! Connected parts of a grid; neighbours lie along the axes.

/// Marks the nodes that `passes` accepts and that connect to the grid's border over such nodes.
pub(super) fn from_border(dims: [usize; 3], passes: impl Fn(usize) -> bool) -> Vec<bool> {
    let mut reached = vec![false; dims.iter().product()];
    let mut stack = Vec::new();
    for_border(dims, |n| {
        if !reached[n] && passes(n) {
            reached[n] = true;
            stack.push(n);
        }
    });
    while let Some(n) = stack.pop() {
        for_neighbours(dims, n, |to| {
            if !reached[to] && passes(to) {
                reached[to] = true;
                stack.push(to);
            }
        });
    }
    reached
}

/// Connected parts of the nodes that `belongs` accepts; a part lists its nodes in search order.
pub(super) fn parts(dims: [usize; 3], belongs: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
    let total = dims.iter().product();
    let mut visited = vec![false; total];
    let mut parts = Vec::new();
    for seed in 0..total {
        if visited[seed] || !belongs(seed) {
            continue;
        }
        visited[seed] = true;
        let mut part = vec![seed];
        let mut next = 0;
        while let Some(&n) = part.get(next) {
            next += 1;
            for_neighbours(dims, n, |to| {
                if !visited[to] && belongs(to) {
                    visited[to] = true;
                    part.push(to);
                }
            });
        }
        parts.push(part);
    }
    parts
}

fn for_neighbours([nx, ny, nz]: [usize; 3], n: usize, mut visit: impl FnMut(usize)) {
    let (i, j, k) = (n % nx, n / nx % ny, n / (nx * ny));
    if i > 0 {
        visit(n - 1);
    }
    if i + 1 < nx {
        visit(n + 1);
    }
    if j > 0 {
        visit(n - nx);
    }
    if j + 1 < ny {
        visit(n + nx);
    }
    if k > 0 {
        visit(n - nx * ny);
    }
    if k + 1 < nz {
        visit(n + nx * ny);
    }
}

/// Visits the up to 26 nodes around `n`.
pub(super) fn for_box([nx, ny, nz]: [usize; 3], n: usize, mut visit: impl FnMut(usize)) {
    let (i, j, k) = (n % nx, n / nx % ny, n / (nx * ny));
    for z in k.saturating_sub(1)..=(k + 1).min(nz - 1) {
        for y in j.saturating_sub(1)..=(j + 1).min(ny - 1) {
            for x in i.saturating_sub(1)..=(i + 1).min(nx - 1) {
                let to = x + nx * (y + ny * z);
                if to != n {
                    visit(to);
                }
            }
        }
    }
}

fn for_border([nx, ny, nz]: [usize; 3], mut visit: impl FnMut(usize)) {
    for k in 0..nz {
        for j in 0..ny {
            let row = nx * (j + ny * k);
            if k == 0 || k + 1 == nz || j == 0 || j + 1 == ny {
                (row..row + nx).for_each(&mut visit);
            } else {
                visit(row);
                visit(row + nx - 1);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_closed_shell_keeps_the_flood_out_and_parts_are_counted() {
        let dims = [9, 8, 7];
        let at = |n: usize| [n % 9, n / 9 % 8, n / 72];
        let depth = |n: usize| {
            let [i, j, k] = at(n);
            i.min(8 - i).min(j).min(7 - j).min(k).min(6 - k)
        };
        let reached = from_border(dims, |n| depth(n) != 1);
        assert!((0..reached.len()).all(|n| reached[n] == (depth(n) == 0)));
        let parts = parts(dims, |n| depth(n) != 1);
        assert_eq!(parts.len(), 2);
        assert_eq!(parts[1].len(), 5 * 4 * 3);
    }
}
