//! Distances on a dense grid: exact within a band around a surface, clamped beyond.

use super::crossings::Rows;
use super::exact::ExactDistance;
use super::features::Features;
use super::tiles::{Source, TILE, Tally, Tile, Tiles};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{ScalarGrid, TriMesh};

/// Fills `grid` with signed distances (mm) to `surface`, from which `exact` was made.
///
/// They are exact up to a magnitude of `reach` (mm) and ±`reach` beyond.
pub(super) fn signed(
    exact: &ExactDistance,
    surface: &TriMesh,
    grid: &mut ScalarGrid,
    reach: f64,
    control: &Control,
) -> Result<Tally, Cancelled> {
    let features = Features::new(surface, &exact.defects().triangles);
    let source = Source { mesh: surface, defects: exact.defects(), features: &features };
    let rows = Rows { origin: grid.origin, spacing: grid.spacing, dims: grid.dims };
    let tiles = Tiles::new(source, rows, 0, reach, |_, _| true);
    let filled = tiles.map_all(control, |tile| Filled::new(tile, reach as f32))?;
    let mut tally = Tally::default();
    for Filled { first, dims, values, signs } in filled {
        tally.add(&signs);
        for (row, values) in values.chunks_exact(dims[0]).enumerate() {
            let start = grid.index(first[0], first[1] + row % dims[1], first[2] + row / dims[1]);
            grid.values[start..start + dims[0]].copy_from_slice(values);
        }
    }
    control.report(1.0);
    Ok(tally)
}

/// Edge of the boxes whose signs are computed together, in nodes.
const BOX: usize = 8;

/// Signed distances at the nodes of a tile, x fastest, mm.
struct Filled {
    /// First node of the tile.
    first: [usize; 3],
    dims: [usize; 3],
    values: Vec<f32>,
    signs: Tally,
}

impl Filled {
    fn new(tile: &Tile, reach: f32) -> Self {
        let dims = tile.dims();
        let mut values = vec![0.0; dims.iter().product()];
        let mut tally = Tally::default();
        for n in 0..(TILE / BOX).pow(3) {
            let first = [n % (TILE / BOX), n / (TILE / BOX) % (TILE / BOX), n / (TILE / BOX).pow(2)].map(|b| b * BOX);
            let size = [0, 1, 2].map(|a| dims[a].saturating_sub(first[a]).min(BOX));
            if size.contains(&0) {
                continue;
            }
            let (inside, inverted) = tile.inside(first, size);
            tally.add(&Tally::count(&inside, inverted));
            let mut next = 0;
            super::tiles::for_box(first, size, |at| {
                let d = tile.squared(at).sqrt().min(reach);
                values[at[0] + dims[0] * (at[1] + dims[1] * at[2])] = if inside[next] { -d } else { d };
                next += 1;
            });
        }
        Self { first: tile.first, dims, values, signs: tally }
    }
}
