#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Measures what doc/performance.md shows and makes its figures and tables anew. `make bench` calls it after its set-up. What it
# measures is left in build/bench; `tools/bench.sh figures` makes figures and tables of what is there.
#
# Environment: ARCH  flags for the machine at hand (-march=native)
#              CORE  the core that all runs share (0)
set -euo pipefail
cd "$(dirname "$0")/.."
export OPENBLAS_NUM_THREADS=1
out=build/bench python=.venv/bin/python

# --- 1. the measurements --------------------------------------------------------------------------------------------

build() { # leaves build/bench/bench
    mkdir -p "$out" bench/build/dependencies
    ln -sfn ../../../build/dependencies/toml-f bench/build/dependencies/toml-f
    (cd bench && ../.venv/bin/fpm run bench --profile release --flag "${ARCH:--march=native}" --runner install -- "../$out/bench") \
        >"$out/build.log" 2>&1 || { tail -n 20 "$out/build.log" >&2; exit 1; }
}

measure() {
    build
    taskset -c "${CORE:-0}" "$out/bench" "$out"
}

[ "${1:-}" = figures ] || measure

# --- 2. the figures and the tables of the document -------------------------------------------------------------------

$python tools/plot.py "$out/runs.h5" doc/figures/performance.png
$python tools/fill_tables.py doc/performance.md "$out"
