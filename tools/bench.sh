#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Makes the measurements of doc/performance.md and updates its figures and tables. `make bench` calls it after its set-up. The
# results are in build/bench.
#
# Usage: tools/bench.sh            all of it
#        tools/bench.sh figures    figures and tables of the existing results
#        tools/bench.sh count      compare instructions with bench/counts.txt (`make bench-count`)
#        tools/bench.sh record     write bench/counts.txt
#        tools/bench.sh profiles   measure only the profiles of two runs
#        tools/bench.sh sweep [CASES [ROUNDS]]    a sweep on threads 0 and 1 compared with bare loops (doc/sweep.md)
#        tools/bench.sh large [SCENE [STEPPER [KIND [NUMBER...]]]]    cost of a step of many bodies (doc/sparse.md)
#        tools/bench.sh mechanisms [NAME...]    mechanisms compared with Exudyn, MuJoCo and Pinocchio, from PyPI
#        tools/bench.sh output SCENE [SETTING...]    additional time for the result file
#
# Environment: ARCH  flags for the machine at hand (-march=native)
#              CORE  core of all runs (0)
set -euo pipefail
cd "$(dirname "$0")/.."
export OPENBLAS_NUM_THREADS=1
out=build/bench python=.venv/bin/python
optimised="$(cat tools/flags/optimised) ${ARCH:--march=native}"

# --- 1. the measurements --------------------------------------------------------------------------------------------

build() { # PROGRAM FLAGS: leaves build/bench/PROGRAM
    local flags=$2
    mkdir -p "$out" bench/build/dependencies
    ln -sfn ../../../build/dependencies/toml-f bench/build/dependencies/toml-f
    (cd bench && ../.venv/bin/fpm run "$1" --flag "$flags" --runner install -- "../$out/$1") \
        >"$out/build.log" 2>&1 || { tail -n 20 "$out/build.log" >&2; exit 1; }
}

measure() {
    local program
    for program in bench chain; do
        build $program "$optimised"
        taskset -c "${CORE:-0}" "$out/$program" "$out"
    done
    profiles
    tools/bench.sh mechanisms
}

profile() { # NAME SCENE [SETTING...]: leaves build/bench/profile_NAME.h5
    local name=$1
    shift
    taskset -c "${CORE:-0}" build/optimised/tandem run "$@" --profile --no-error --quiet --force --output "$out/profile_$name.h5"
}

profiles() {
    mkdir -p "$out"
    profile disk rolling_disk --set output.every=10
    profile vehicle articulated_vehicle --set output.every=10 --set solver.stepper=dop853 --set time.end=100
}

sweep() { # CASES ROUNDS: the runs take turns, so that other load of the machine disturbs all of them alike
    local program=$PWD/$out/disks tandem=$PWD/build/optimised/tandem folder TIMEFORMAT=%R
    folder=$(mktemp -d)
    sed "s/draws = [0-9]*/draws = $1/" bench/disks.toml >"$folder/disks.toml"
    cd "$folder"
    bare() { taskset -c "$1" "$program" disks.csv; }
    both() { bare 0 & bare 1; wait $!; }
    swept() { taskset -c "$1" "$tandem" sweep disks.toml --jobs "$2" --quiet --force; }
    seconds() { { time "$@" >/dev/null; } 2>&1; }
    swept 0,1 2 # writes the table of the bare loops, which find its heights: `1000 disks in ..., 1000 with the height of the table`
    bare 0
    echo 'seconds: bare loop, two at once, one job, two jobs; ratios: job over bare, two bare over one, two jobs over one, over two bare'
    for ((round = 0; round < $2; round++)); do
        echo "$(seconds bare 0) $(seconds both) $(seconds swept 0 1) $(seconds swept 0,1 2)"
    done | awk '{ print $1, $2, $3, $4 ";", $1/$3, 2*$1/$2, $3/$4, $2/2/$4; fflush() }'
    rm -r "$folder"
}

case ${1:-} in
figures) ;;
large)
    build large "$optimised"
    taskset -c "${CORE:-0}" "$out/large" "${@:2}"
    exit
    ;;
profiles)
    profiles
    exit
    ;;
count | record)
    # Without AVX-512, which valgrind does not know, and file by file, since the counts begin at a procedure that must be found;
    # a base line is for one set of flags.
    build count "-O3 -funroll-loops -fno-loop-unroll-and-jam -fPIC -fno-semantic-interposition -march=x86-64-v3"
    [ "$1" = count ] && exec python3 tools/bench_count.py "$out/count"
    exec python3 tools/bench_count.py "$out/count" record
    ;;
mechanisms)
    build motion "$optimised"
    shift
    taskset -c "${CORE:-0}" bench/mechanisms.py "$@" | tee "$out/mechanisms.txt"
    [ $# -gt 0 ] || bench/mechanisms.py --from "$out/mechanisms.txt" --figure doc/figures/mechanisms.png --table "$out/mechanisms.md"
    exit
    ;;
output)
    build output "$optimised"
    shift
    exec taskset -c "${CORE:-0}" "$out/output" "$@"
    ;;
sweep)
    build disks "$optimised"
    sweep "${2:-1000}" "${3:-8}"
    exit
    ;;
*) measure ;;
esac

# --- 2. the figures and the tables of the document -------------------------------------------------------------------

$python tools/plot.py "$out/runs.h5" doc/figures/performance.png
$python tools/plot.py "$out/chain.h5" doc/figures/chain.png
$python tools/fill_tables.py doc/performance.md "$out"
