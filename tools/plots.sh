#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Makes the measurements of README.md, doc/results.md, doc/precision.md and doc/stability.md with build/optimised/tandem, and
# updates their figures and tables. `make plots` calls it after its set-up; it takes about ten minutes. The results are in build/plots;
# `tools/plots.sh figures` makes figures and tables of the existing results.
set -euo pipefail
cd "$(dirname "$0")/.."
export OPENBLAS_NUM_THREADS=1
out=build/plots figures=doc/figures python=.venv/bin/python tandem=build/optimised/tandem
scenes=(rolling_disk articulated_vehicle motorcycle motorcycle_chopper)
all='output.fields=["q","position_error","velocity_error","acceleration_error","kinetic_energy","potential_energy","step","chart"]'

timed() { # COMMAND...: its output goes to a log, its duration to a list
    local start=$SECONDS
    echo "$*" >&2
    "$@" --output "$out/studies" --quiet >>"$out/log.txt"
    echo "$((SECONDS - start)) $*" >>"$out/durations.txt"
}
picture() { $python tools/plot.py "$@"; }

# --- 1. the measurements --------------------------------------------------------------------------------------------

measure() {
    rm -rf "$out"
    mkdir -p "$out/runs"
    timed $tandem study precision "${scenes[@]}"
    timed $tandem study tables
    timed $tandem study stability
    $tandem study precision rolling_disk --set time.end=10 --samples 20 --output "$out/own" --quick --quiet >>"$out/log.txt"
    $tandem study precision articulated_vehicle --output "$out/own" --quick --quiet >>"$out/log.txt"
    $tandem study precision rolling_disk --set time.end=10 --reference test/reference/disk.txt --output "$out/file" --quick --quiet >>"$out/log.txt"
    $tandem study precision articulated_vehicle --reference test/reference/vehicle.txt --output "$out/file" --quick --quiet >>"$out/log.txt"
    for scene in "${scenes[@]}"; do
        $tandem run "$scene" --force --output "$out/runs/$scene.h5" --quiet >>"$out/log.txt"
    done
    $tandem run rolling_disk --force --set solver.stepper=dop853 --set solver.rtol=1e-10 --set output.interval=0.02 --set "$all" \
        --output "$out/runs/overview.h5" --quiet >>"$out/log.txt"
}

[ "${1:-}" = figures ] || measure

# --- 2. the figures -------------------------------------------------------------------------------------------------

runs=$out/runs
$python tools/plots/elements.py $figures/elements.png
picture "$runs/rolling_disk.h5" $figures/disk.png
picture "$runs/overview.h5" $figures/overview.png --overview
picture "$out"/studies/precision_{rolling_disk,articulated_vehicle,motorcycle,motorcycle_chopper}.h5 $figures/precision.png
picture "$out/studies/precision_rolling_disk.h5" $figures/precision_rolling_disk.png
picture "$out/studies/precision_motorcycle_chopper.h5" $figures/precision_motorcycle_chopper.png
picture "$out/studies/stability.h5" $figures/stability.png
picture "$out/studies/stability.h5" $figures/stiffness.png --stiffness
picture "$runs/articulated_vehicle.h5" $figures/paper_2.png --paper 2
picture "$runs/rolling_disk.h5" $figures/paper_4.png --paper 4
picture "$runs/motorcycle.h5" "$runs/motorcycle_chopper.h5" $figures/paper_6.png --paper 6

# --- 3. the tables of the documents ---------------------------------------------------------------------------------

$python tools/fill_tables.py doc/precision.md "$out"
$python tools/fill_tables.py doc/stability.md "$out"
