use super::*;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, MatMut, Par, Side};

/// Dense diagonal blocks coupled through common last columns: an elimination tree with branches.
fn arrow(blocks: usize, width: usize, common: usize) -> SparseColMat<usize, f64> {
    let n = blocks * width + common;
    let mut triplets = Vec::new();
    let mut seed = 1u64;
    for row in 0..n {
        for column in 0..=row {
            let coupled = row >= blocks * width || row / width == column / width;
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let value = (seed >> 40) as f64 / f64::from(1 << 24) - 0.5;
            if row == column {
                triplets.push(Triplet::new(row, column, n as f64));
            } else if coupled {
                triplets.push(Triplet::new(column, row, value));
            }
        }
    }
    SparseColMat::try_new_from_triplets(n, n, &triplets).unwrap()
}

/// Supernodal factor of a matrix in its own order.
fn factor(matrix: &SparseColMat<usize, f64>) -> (SymbolicCholesky<usize>, Vec<f64>) {
    let params = CholeskySymbolicParams {
        supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
        ..CholeskySymbolicParams::default()
    };
    let symbolic =
        factorize_symbolic_cholesky(matrix.symbolic(), Side::Upper, SymmetricOrdering::Identity, params).unwrap();
    let mut values = vec![0.0; symbolic.len_val()];
    let mut memory = MemBuffer::new(symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default()));
    symbolic
        .factorize_numeric_llt(
            &mut values,
            matrix.as_ref(),
            Side::Upper,
            Default::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        )
        .unwrap();
    (symbolic, values)
}

#[test]
fn solves_agree_with_faer_and_do_not_depend_on_threads() {
    let matrix = arrow(9, 37, 1500);
    let n = matrix.ncols();
    let (symbolic, values) = factor(&matrix);
    let SymbolicCholeskyRaw::Supernodal(supernodal) = symbolic.raw() else { panic!("simplicial") };
    let l = SupernodalLltRef::new(supernodal, &values);
    let schedule = Schedule::new(supernodal);
    assert!(schedule.subtrees.len() >= 8 && !schedule.top.is_empty(), "{schedule:?}");

    let b: Vec<f64> = (0..n).map(|i| (i as f64).sin()).collect();
    let mut expected = b.clone();
    let mut memory = MemBuffer::new(supernodal.solve_in_place_scratch::<f64>(1, Par::Seq));
    let column = MatMut::from_column_major_slice_mut(&mut expected, n, 1);
    l.solve_in_place_with_conj(Conj::No, column, Par::Seq, MemStack::new(&mut memory));
    let solve = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut x = b.clone();
            forward(&l, &schedule, &mut x);
            backward(&l, &schedule, &mut x);
            x
        })
    };
    let x = solve(1);
    let scale = expected.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    assert!(x.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-13 * scale));
    assert_eq!(x, solve(2));
    assert_eq!(x, solve(3));
}

/// Laplacian on a cubic lattice with three coupled unknowns a node, ordered by nested planes.
fn lattice(side: usize) -> SparseColMat<usize, f64> {
    fn bisect(range: [std::ops::Range<usize>; 3], order: &mut Vec<[usize; 3]>) {
        let axis = (0..3).max_by_key(|a| range[*a].len()).unwrap_or(0);
        if range[axis].len() < 4 {
            for i in range[0].clone() {
                for j in range[1].clone() {
                    order.extend(range[2].clone().map(|k| [i, j, k]));
                }
            }
            return;
        }
        let middle = (range[axis].start + range[axis].end) / 2;
        for part in [range[axis].start..middle, middle + 1..range[axis].end, middle..middle + 1] {
            let mut below = range.clone();
            below[axis] = part.clone();
            if part.len() > 1 {
                bisect(below, order);
            } else {
                for i in below[0].clone() {
                    for j in below[1].clone() {
                        order.extend(below[2].clone().map(|k| [i, j, k]));
                    }
                }
            }
        }
    }
    let mut order = Vec::new();
    bisect([0..side, 0..side, 0..side], &mut order);
    let index = |p: [usize; 3]| (p[0] * side + p[1]) * side + p[2];
    let mut place = vec![0; order.len()];
    order.iter().enumerate().for_each(|(n, p)| place[index(*p)] = n);
    let mut triplets = Vec::new();
    for (n, p) in order.iter().enumerate() {
        let mut couple = |m: usize, weight: f64| {
            for a in 0..3 {
                for b in 0..3 {
                    let (row, column) = (3 * n.min(m) + a, 3 * n.max(m) + b);
                    if row <= column {
                        triplets.push(Triplet::new(row, column, if a == b { weight } else { 0.1 * weight }));
                    }
                }
            }
        };
        couple(n, 6.5);
        for axis in 0..3 {
            if p[axis] + 1 < side {
                let mut q = *p;
                q[axis] += 1;
                couple(place[index(q)], -1.0);
            }
        }
    }
    SparseColMat::try_new_from_triplets(3 * order.len(), 3 * order.len(), &triplets).unwrap()
}

/// Times of our solve and of faer's; run with `SLOW_TESTS=1 … -- --nocapture`. No time decides the test.
#[test]
fn times_of_both_solves() {
    if std::env::var_os("SLOW_TESTS").is_none() {
        return;
    }
    let matrix = lattice(26);
    let n = matrix.ncols();
    let (symbolic, values) = factor(&matrix);
    let SymbolicCholeskyRaw::Supernodal(supernodal) = symbolic.raw() else { panic!("simplicial") };
    let l = SupernodalLltRef::new(supernodal, &values);
    let schedule = Schedule::new(supernodal);
    let b: Vec<f64> = (0..n).map(|i| (i as f64).sin()).collect();
    let best_ms = |solve: &mut dyn FnMut(&mut Vec<f64>)| {
        let round = || {
            let mut x = b.clone();
            let begin = std::time::Instant::now();
            solve(&mut x);
            begin.elapsed().as_secs_f64() * 1e3
        };
        std::iter::repeat_with(round).take(9).fold(f64::INFINITY, f64::min)
    };
    for (threads, par) in [(1, Par::Seq), (2, Par::rayon(2))] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut memory = MemBuffer::new(supernodal.solve_in_place_scratch::<f64>(1, par));
        let faer = best_ms(&mut |x| {
            let column = MatMut::from_column_major_slice_mut(x, n, 1);
            l.solve_in_place_with_conj(Conj::No, column, par, MemStack::new(&mut memory));
        });
        let ours = best_ms(&mut |x| {
            pool.install(|| {
                forward(&l, &schedule, x);
                backward(&l, &schedule, x);
            });
        });
        println!("{n} unknowns, {} entries, {threads} threads: faer {faer:.1} ms, ours {ours:.1} ms", values.len());
    }
}
