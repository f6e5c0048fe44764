//! Fuzzes every reader with crafted and damaged files in a child process with bounded memory.
//!
//! A reader that allocates for an unchecked count ends the child process. `FUZZ_SECONDS` sets the duration; `FUZZ_ROUND`
//! repeats one round.

mod mutate;
mod seeds;

use std::fs;
use std::process::Command;
use std::time::{Duration, Instant};

use self::mutate::{Dice, mutate};
use self::seeds::{Seed, Target, seeds};
use super::{
    Limits, SurfaceFormat, VolumeCheck, detect_surface, detect_volume, fiducials, landmark_name, legal_name,
    looks_like_fiducials, rigid_motion, surface, transform, volume, volume_mesh,
};

/// Memory limit of the child process, kB. Undamaged files and their enlarged copies need a tenth of it.
const MEMORY_KB: u64 = 1_500_000;
/// Longest file, bytes.
const LONGEST: usize = 64 << 10;
/// Least number of files that are tried, even on a slow machine.
const LEAST_ROUNDS: u64 = 500;
/// Longest overrun of the child process; a longer one means that a reader hangs.
const HANGS: Duration = Duration::from_secs(120);
const CHILD: &str = "import::test_fuzz::rounds_within_bounds";

fn seconds() -> u64 {
    std::env::var("FUZZ_SECONDS").ok().and_then(|s| s.parse().ok()).unwrap_or(4)
}

#[cfg(target_os = "linux")]
#[test]
fn no_file_makes_a_reader_panic_hang_or_take_memory_for_what_is_not_there() {
    let scratch = tempfile::tempdir().unwrap();
    let at = scratch.path().join("round");
    // `sh` fills the script's `$0`; the arguments that follow are the program and its arguments.
    let script = format!("ulimit -v {MEMORY_KB}; exec \"$@\"");
    let mut child = Command::new("sh")
        .args(["-c", &script, "sh"])
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", CHILD, "--nocapture", "--test-threads", "1"])
        .env("FUZZ_AT", &at)
        .env("RAYON_NUM_THREADS", "1")
        .spawn()
        .unwrap();
    let deadline = Instant::now() + Duration::from_secs(seconds()) + HANGS;
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break Some(status);
        }
        if Instant::now() > deadline {
            child.kill().ok();
            break None;
        }
        std::thread::park_timeout(Duration::from_millis(20));
    };
    let round = fs::read_to_string(&at).unwrap_or_default();
    let again = format!("again with FUZZ_ROUND={round} FUZZ_AT=/dev/null cargo test -p prosopon-formats --lib {CHILD}");
    let status = status.unwrap_or_else(|| panic!("a reader hangs: {again}"));
    assert!(status.success(), "{status}: {again}");
}

/// The rounds of the child process; does nothing when run on its own.
#[test]
fn rounds_within_bounds() {
    let Some(at) = std::env::var_os("FUZZ_AT") else { return };
    let seeds = seeds();
    for seed in &seeds {
        assert!(read(seed.target, &seed.whole()), "{} is sound", seed.name);
    }
    if let Some(round) = std::env::var("FUZZ_ROUND").ok().and_then(|r| r.trim().parse().ok()) {
        make(&seeds, round);
        return;
    }
    let end = Instant::now() + Duration::from_secs(seconds());
    let (mut round, mut taken) = (0u64, 0u64);
    while round < LEAST_ROUNDS || Instant::now() < end {
        fs::write(&at, round.to_string()).unwrap();
        taken += u64::from(make(&seeds, round));
        round += 1;
    }
    eprintln!("{round} files over {} seeds, {taken} of them read", seeds.len());
    // If every file were refused, the code after the first check would not be tested.
    assert!(taken > 0 && taken < round, "{taken} of {round}");
}

/// Tries one damaged file; returns whether it was read.
fn make(seeds: &[Seed], round: u64) -> bool {
    let mut dice = Dice::new(round);
    let seed = &seeds[dice.below(seeds.len())];
    let other = &seeds[dice.below(seeds.len())];
    let mut plain = seed.plain.clone();
    for _ in 0..=dice.below(4) {
        mutate(&mut plain, &other.plain, &mut dice);
    }
    plain.truncate(LONGEST);
    // Sometimes damages the envelope instead of its content.
    let mut file = seed.wrap(plain);
    if dice.below(4) == 0 {
        mutate(&mut file, &other.plain, &mut dice);
    }
    file.truncate(LONGEST);
    let read_by_own = read(seed.target, &file);
    // A wrongly stated format must not cause a panic either.
    let others =
        [Target::Surface(SurfaceFormat::Obj), Target::Volume, Target::Mesh, Target::Transform, Target::Landmarks];
    let another = others[dice.below(others.len())];
    read(another, &file);
    read_by_own
}

/// Reads as an upload does and checks the invariants of the result.
fn read(target: Target, file: &[u8]) -> bool {
    let limits = Limits::default();
    match target {
        Target::Surface(format) => {
            _ = detect_surface(file);
            let Ok((mesh, _)) = surface(file, format, &limits) else { return false };
            let n = mesh.positions().len();
            assert!(mesh.positions().iter().all(|p| p.iter().all(|c| c.is_finite())));
            assert!(mesh.triangles().iter().flatten().all(|v| (*v as usize) < n));
            true
        }
        Target::Volume => {
            _ = detect_volume(file);
            let mut scan = VolumeCheck::new(limits);
            let scanned = file.chunks(1000).try_for_each(|piece| scan.push(piece)).and_then(|()| scan.finish());
            let Ok((volume, _)) = volume(file, &limits) else { return false };
            // The scan also refuses a gzip stream that is damaged after the voxels, which the reader ignores.
            let is_packed = file.starts_with(&[0x1f, 0x8b]);
            assert!(scanned.is_ok() || is_packed, "the upload refuses what the reader takes: {scanned:?}");
            assert_eq!(volume.dims.iter().product::<usize>(), volume.hu.len());
            assert!(volume.axes.iter().flat_map(|a| a.iter()).chain(volume.origin.iter()).all(|x| x.is_finite()));
            true
        }
        Target::Transform => {
            let Ok((affine, _)) = transform(file) else { return false };
            assert!(affine.matrix.iter().chain(affine.offset_mm.iter()).all(|x| !x.is_nan()));
            rigid_motion(&affine).ok();
            true
        }
        Target::Landmarks => {
            _ = looks_like_fiducials(file);
            let Ok(read) = fiducials(file) else { return false };
            assert!(read.points.iter().flat_map(|(_, p)| p).all(|c| c.is_finite()));
            read.points.iter().for_each(|(label, _)| _ = (landmark_name(label), legal_name(label)));
            true
        }
        Target::Mesh => {
            let Ok((mesh, _)) = volume_mesh(file, &limits) else { return false };
            let n = mesh.points.len();
            assert!(mesh.points.iter().all(|p| p.iter().all(|c| c.is_finite())));
            assert!(mesh.cells.iter().flat_map(|c| c.corners()).all(|v| (*v as usize) < n));
            let sized = |a: &prosopon_geometry::DataArray, n: usize| a.values.len() == a.components * n;
            assert!(mesh.point_arrays.iter().all(|a| sized(a, n)));
            assert!(mesh.cell_arrays.iter().all(|a| sized(a, mesh.cells.len())));
            true
        }
    }
}
