//! Visibility: the share of all directions in which a node of a grid sees out.

use prosopon_geometry::control::{Cancelled, Control};
use rayon::prelude::*;

/// Number of directions swept at the same time; fixed, so that memory does not grow with threads.
const CHUNK: usize = 7;

/// Share of directions in which a ray over `free` nodes leaves the grid, by node; 0 at other nodes.
///
/// The directions are the primitive lattice directions of at most `most_steps` node spacings, and at most 3: 98 at most.
pub(super) fn visibility(
    dims: [usize; 3],
    free: &[bool],
    most_steps: f64,
    control: &Control,
) -> Result<Vec<f32>, Cancelled> {
    let directions = directions(most_steps);
    let mut counts = vec![0u8; free.len()];
    for (n, chunk) in directions.chunks(CHUNK).enumerate() {
        control.check()?;
        control.report((n * CHUNK) as f64 / directions.len() as f64);
        let rays: Vec<Vec<bool>> = chunk.par_iter().map(|&direction| unblocked(dims, free, direction)).collect();
        for ray in &rays {
            for (count, open) in counts.iter_mut().zip(ray) {
                *count += u8::from(*open);
            }
        }
    }
    let share = 1.0 / directions.len() as f32;
    Ok(counts.into_iter().map(|count| f32::from(count) * share).collect())
}

fn directions(most_steps: f64) -> Vec<[i32; 3]> {
    let mut directions = Vec::new();
    for z in -2i32..=2 {
        for y in -2i32..=2 {
            for x in -2i32..=2 {
                let length_sq = x * x + y * y + z * z;
                let is_primitive = x % 2 != 0 || y % 2 != 0 || z % 2 != 0;
                if is_primitive && length_sq <= 9 && f64::from(length_sq).sqrt() <= most_steps.max(1.0) {
                    directions.push([x, y, z]);
                }
            }
        }
    }
    directions
}

/// Whether the ray from each node towards `direction` leaves the grid over free nodes.
fn unblocked([nx, ny, nz]: [usize; 3], free: &[bool], [dx, dy, dz]: [i32; 3]) -> Vec<bool> {
    let mut open = vec![false; free.len()];
    let stride = dx as isize + nx as isize * (dy as isize + ny as isize * dz as isize);
    // A node takes the result of the next node on its ray, so that one comes first.
    let order = |n: usize, d: i32| (0..n).map(move |i| if d > 0 { n - 1 - i } else { i });
    let leaves = |i: usize, d: i32, n: usize| i.checked_add_signed(d as isize).is_none_or(|to| to >= n);
    for k in order(nz, dz) {
        for j in order(ny, dy) {
            let row_leaves = leaves(k, dz, nz) || leaves(j, dy, ny);
            for i in order(nx, dx) {
                let n = i + nx * (j + ny * k);
                open[n] = free[n] && (row_leaves || leaves(i, dx, nx) || open[n.wrapping_add_signed(stride)]);
            }
        }
    }
    open
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_over_a_wall_sees_half_of_all_directions_and_one_in_a_closed_room_none() {
        let dims = [41, 41, 41];
        let at = |n: usize| [n % 41, n / 41 % 41, n / 1681];
        let floor: Vec<bool> = (0..41 * 41 * 41).map(|n| at(n)[2] > 3).collect();
        let over_floor = visibility(dims, &floor, 3.0, &Control::new()).unwrap();
        let n = 20 + 41 * (20 + 41 * 4);
        // Of the 98 directions 41 point upwards and 16 lie in the plane of the floor.
        assert!((over_floor[n] - 57.0 / 98.0).abs() < 1e-6, "{}", over_floor[n]);
        // The wall is two nodes thick, as the longest step requires.
        let room: Vec<bool> = (0..41 * 41 * 41)
            .map(|n| {
                let d = at(n).map(|i| i.abs_diff(20)).into_iter().max().unwrap_or(0);
                !(8..11).contains(&d)
            })
            .collect();
        let in_room = visibility(dims, &room, 3.0, &Control::new()).unwrap();
        assert_eq!(in_room[20 + 41 * (20 + 41 * 20)], 0.0);
        assert!(in_room[0] > 0.8);
    }

    #[test]
    fn short_steps_leave_out_the_long_directions() {
        assert_eq!([1.0, 2.0, 2.5, 3.0].map(|most| directions(most).len()), [6, 26, 74, 98]);
    }
}
