#!/usr/bin/env bash
# Makes every number and chart about the solver in README: tests/bench/model_charts.sh HEAD OUT
# HEAD is a folder with landmarks.json and a CT, or with skin.* and skull.*. Takes an hour on two cores.
# It also measures CalculiX in the same run if Debian's calculix-ccx is installed.
set -euo pipefail
[ $# = 2 ] || { echo "usage: $0 HEAD OUT" >&2; exit 2; }
here=$(cd "$(dirname "$0")" && pwd)
head=$1 out=$2
mkdir -p "$out"
cargo build --release --locked --manifest-path "$here/../../Cargo.toml"
prosopon=${CARGO_TARGET_DIR:-$here/../../target}/release/prosopon

# CalculiX takes 9 and 35 minutes for its lines (calculix_head.py): quadratic elements on the meshes of 5.5 mm, no contact.
"$prosopon" bench models --scene "phantom,$head" --csv "$out/models.csv" --line "paper (2009), 129 856 tetrahedra=1230" \
    --line "phantom: CalculiX, quadratic, 5.5 mm=535" --line "ct_head: CalculiX, quadratic, 5.5 mm=2091" | tee "$out/models.txt"
# A wrong result in the map makes this script fail at the end, after the other charts are drawn.
red=0
"$prosopon" bench stability --csv "$out/stability.csv" | tee "$out/stability.txt" || red=$?
"$prosopon" bench solver-growth --csv "$out/solver-growth.csv" | tee "$out/solver-growth.txt"
cp "$out"/{models,stability,solver-growth,solver-growth-phases}.svg "$here/../../api/pictures/"
if command -v ccx >/dev/null; then
    "$here/calculix.py" "$prosopon" "$out/calculix" --rounds 3 | tee "$out/calculix.txt"
else
    echo "CalculiX is not measured: install calculix-ccx" >&2
fi
exit "$red"
