#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Checks the installed library and its interfaces: the examples are built outside the checkout from nothing but installed
# files, each must be as exact as it should be; every misuse must end in a status; nothing but LAPACK and BLAS is linked; no
# object asks for an executable stack; and the interfaces are those of their version.
#
# Usage: tools/check_install.sh
#
# Prints "ok NAME" or "not ok NAME" for each check, and after a failure what was wrong; tools/verify.py counts them.
# Exit code 1 if anything failed.
set -uo pipefail
cd "$(dirname "$0")/.." || exit 1
export LC_ALL=C.UTF-8 OPENBLAS_NUM_THREADS=1
unset LD_LIBRARY_PATH PKG_CONFIG_PATH CMAKE_PREFIX_PATH MAKEFLAGS MFLAGS MAKELEVEL FFLAGS CFLAGS CXXFLAGS LDFLAGS

root=$PWD
tmp=$(mktemp -d) || exit 1
trap 'rm -rf "$tmp"' EXIT
prefix=$tmp/installed
failures=0

check() { # NAME COMMAND...: passes if the command succeeds; what it prints tells why it did not
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

error_below() { # LIMIT LOG: the line "error: NUMBER" of a program's output
    awk -v limit="$1" '
        $1 == "error:" { found = 1; value = $2 }
        END { print found ? "error " value ", allowed " limit : "no line \"error: NUMBER\""; exit !(found && value + 0 == value && value < limit) }
        ' "$2"
}

tests_of() { # PROGRAM: it prints its own "ok" and "not ok" lines; one more for how it ended
    local code=0
    "$@" >"$tmp/tests" 2>"$tmp/told" || code=$?
    sed -n '/^ok \|^not ok \|^    /p' "$tmp/tests"
    failures=$((failures + $(grep -c '^not ok' "$tmp/tests")))
    check "$(basename "$1")-ends-well" test "$code" = 0
}

warns_not() { # COMMAND...: succeeds without a word on standard error
    "$@" 2>"$tmp/warnings" || { cat "$tmp/warnings"; return 1; }
    [ ! -s "$tmp/warnings" ] || { cat "$tmp/warnings"; return 1; }
}

# --- 1. build and install ------------------------------------------------------------------------------------------

check library-installs tools/library.py install --prefix "$prefix"

nothing_else_linked() { # no symbol or library of HDF5 or TOML
    { ldd "$1" && nm -D "$1"; } >"$tmp/symbols" || return 1
    grep -q tandem "$tmp/symbols" || { echo "no symbol of tandem"; return 1; }
    ! grep -iE 'h5[a-z]+_f|hdf5|toml' "$tmp/symbols"
}
check library-links-neither-hdf5-nor-toml nothing_else_linked "$prefix/lib/libtandem.so.1"

needs_only_lapack_and_blas() {
    objdump -p "$1" | awk '
        $1 == "NEEDED" { print; if ($2 !~ /^(liblapack|libblas|libopenblas|libgfortran|libm|libc|libgcc_s|libquadmath)\.so/) bad = 1 }
        END { exit bad }'
}
check library-needs-only-lapack-and-blas needs_only_lapack_and_blas "$prefix/lib/libtandem.so.1"

no_common_state() { # the only variables are what the compiler never changes: tables of types, constant arrays, and one text of ours
    nm "$prefix/lib/libtandem.a" | awk '
        $2 ~ /^[bBdDC]$/ && $3 !~ /__vtab_|__def_init_|_c_MOD_no_problem$|^jumptable\./ && !($2 == "d" && $3 ~ /^A\./) { print; bad = 1 }
        END { exit bad }'
}
check library-has-no-global-state no_common_state

# --- 2. the interfaces: every misuse, threads, cost ----------------------------------------------------------------

cp -R test/linking "$tmp/linking" && cp -R example "$tmp/example"
check tests-compile-without-warning warns_not make -s -C "$tmp/linking" PREFIX="$prefix"
for program in interface_c interface_f77 threads overhead; do tests_of "$tmp/linking/$program"; done

[ "$failures" = 0 ]
