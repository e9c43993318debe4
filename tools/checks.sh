# SPDX-License-Identifier: MIT
# Common part of the scripts that print "ok NAME" or "not ok NAME" for each check, and details after a failure; tools/verify.py counts
# them. A script ends with `[ "$failures" = 0 ]`, so that its exit code is 1 if anything failed.
# shellcheck shell=bash
set -uo pipefail
export LC_ALL=C.UTF-8 OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
tmp=$(mktemp -d) || exit 1
trap 'rm -rf "$tmp"' EXIT
failures=0

check() { # NAME COMMAND...: passes if the command succeeds; its output explains a failure
    local name=$1
    shift
    if "$@" >"$tmp/told" 2>&1; then
        echo "ok $name"
    else
        echo "not ok $name"
        tail -n 20 "$tmp/told"
        failures=$((failures + 1))
    fi
}

agrees() { # LIMIT COMMAND...: succeeds, and prints a line "error: NUMBER" with a number below the limit
    "${@:2}" >"$tmp/log" 2>&1 || { cat "$tmp/log"; return 1; }
    awk -v limit="$1" '
        $1 == "error:" { found = 1; value = $2 }
        END { print found ? "error " value ", allowed " limit : "no line \"error: NUMBER\""; exit !(found && value + 0 == value && value < limit) }
        ' "$tmp/log"
}

nothing_else_linked() { # FILE: no symbol or library of HDF5, TOML or test-drive
    { ldd "$1" && nm "$1" && nm -D "$1"; } >"$tmp/symbols" || return 1
    grep -q tandem "$tmp/symbols" || { echo "no symbol of tandem"; return 1; }
    ! grep -iE 'h5[a-z]+_f|hdf5|toml-?f|testdrive' "$tmp/symbols"
}
