#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Measures the coverage of src/ by the tests, by gcovr. `make coverage` calls it.
#
# Builds the Fortran tests, and the library for the tests of the C and Fortran 77 interfaces (test/linking), without optimization
# and with counters, and runs both. A line counts that any of them has run. The table, with the lines that were not run, goes to
# standard output and to build/coverage/coverage.txt, the output of the tests to build/coverage/log.txt.
#
# Exit code 1: a test fails, or less than 90 % of all lines were run.
set -euo pipefail
cd "$(dirname "$0")/.."
export OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
out=build/coverage
library=build/library-coverage
flags="-O0 -g --coverage"
rm -rf "$out"
mkdir -p "$out"
# Counts of an earlier run.
find build -name '*.gcda' -delete

run() {
    "$@" >>"$out/log.txt" 2>&1 </dev/null || {
        echo "coverage: $* failed; the end of $out/log.txt:" >&2
        tail -n 15 "$out/log.txt" >&2
        exit 1
    }
}

run .venv/bin/fpm test tandem-test --flag "$flags"
run tools/library.py install --prefix "$PWD/$out/installed" --build "$PWD/$library" --flags "$flags" --parts library
cp -r test/linking "$out/linking"
run make -C "$out/linking" PREFIX="$PWD/$out/installed" interface_c interface_f77 mechanism_f77 threads
for program in interface_c interface_f77 mechanism_f77 threads; do run "$out/linking/$program"; done

# The line that ends a module stands for procedures of the compiler's own, which copy its types.
.venv/bin/gcovr --root . --filter src/ --exclude-lines-by-pattern '\s*end (sub)?module' --fail-under-line 90 \
    --txt "$out/coverage.txt" build/gfortran_*/tandem "$library" || status=$?
cat "$out/coverage.txt"
exit "${status:-0}"
