#!/usr/bin/env bash
# Measures status reads with a load tool that does not pause, while solves run, skins are uploaded and event streams are followed.
#   tests/bench/service_wrk.sh [PROGRAM]      default: target/release/prosopon; needs wrk (Debian: wrk) and python3
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
program=${1:-${CARGO_TARGET_DIR:-$here/../../target}/release/prosopon}
scratch=$(mktemp -d)
server= load=
trap 'kill $load $server 2>/dev/null || true; wait 2>/dev/null || true; rm -rf "$scratch"' EXIT

PROSOPON_PARALLEL_JOBS=2 PROSOPON_LOG__LEVEL=warn "$program" serve --listen 127.0.0.1:0 --data "$scratch/data" >"$scratch/out" &
server=$!
url=
until [ -n "$url" ]; do sleep 0.1; url=$(sed -n 's/^listening on //p' "$scratch/out"); done

# 200 sessions, two solves, ten followers, two uploaders; no pollers, because the load tool sends the status reads.
"$program" bench service --url "$url" --pollers 0 --jobs 0 --seconds 75 --csv "$scratch/load.csv" >"$scratch/load" 2>&1 &
load=$!
running() { python3 -c '
import json, sys, urllib.request as r
jobs = json.load(r.urlopen(sys.argv[1] + "/v1/jobs?status=running"))["jobs"]
print(jobs[0]["links"]["self"] if jobs else "")' "$url"; }
job=
until [ -n "$job" ]; do sleep 0.5; job=$(running); done
sleep 3
for path in "$(running)" "$(running)" "/v1/sessions?limit=20"; do
    echo "== GET $path, 50 connections, 15 s"
    wrk --threads 2 --connections 50 --duration 15s --latency "$url$path"
done
