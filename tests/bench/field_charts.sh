#!/usr/bin/env bash
# Makes every number and chart about distance fields in README: tests/bench/field_charts.sh SKULL SKIN LANDMARKS OUT
# It also measures OpenVDB's level set in the same run if Debian's libopenvdb-dev, libboost-dev and g++ are installed.
set -euo pipefail
[ $# = 4 ] || { echo "usage: $0 SKULL SKIN LANDMARKS OUT" >&2; exit 2; }
here=$(cd "$(dirname "$0")" && pwd)
skull=$1 skin=$2 landmarks=$3 out=$4
mkdir -p "$out"
cargo build --release --locked --manifest-path "$here/../../Cargo.toml"
prosopon=${CARGO_TARGET_DIR:-$here/../../target}/release/prosopon

beside=()
if command -v g++ >/dev/null && [ -e /usr/include/openvdb/openvdb.h ]; then
    g++ -std=c++17 -O3 -march=native -DNDEBUG -w "$here/openvdb.cpp" -o "$out/openvdb" -lopenvdb -ltbb -lImath
    beside=(--openvdb "$out/openvdb")
else
    echo "OpenVDB is not measured: install g++, libboost-dev and libopenvdb-dev" >&2
fi
"$prosopon" bench field --mesh "$skull" --csv "$out/field.csv" --full "${beside[@]}" | tee "$out/field.txt"
"$prosopon" bench growth --mesh "$skull" --csv "$out/field-growth.csv" | tee "$out/field-growth.txt"
"$prosopon" bench collision --mesh "$skull" --skin "$skin" --landmarks "$landmarks" --csv "$out/field-collision.csv" |
    tee "$out/field-collision.txt"
# Numbers without a chart: proven bounds on the error, and Newton's method on 20 000 contacts.
"$prosopon" bench bounds --mesh "$skull" --spacing-mm 0.8 | tee "$out/field-bounds.txt"
"$prosopon" bench contacts --mesh "$skull" --csv "$out/field-contacts.csv" | tee "$out/field-contacts.txt"
cp "$out"/field-{memory,time,time-rms,growth,collision}.svg "$here/../../api/pictures/"
