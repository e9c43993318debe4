#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Checks the examples: quotations in documents match the files, each example runs with the required
# accuracy, and a project outside the checkout that depends on tandem builds without HDF5, TOML and a network.
#
# Usage: tools/check_examples.sh
#
# Prints "ok NAME" or "not ok NAME" for each check, and details after a failure; tools/verify.py counts them.
# Exit code 1 if anything failed.
set -uo pipefail
cd "$(dirname "$0")/.." || exit 1
unset GIT_DIR GIT_WORK_TREE GIT_INDEX_FILE GIT_PREFIX GIT_COMMON_DIR GIT_OBJECT_DIRECTORY
export LC_ALL=C.UTF-8 OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}

fpm=$PWD/.venv/bin/fpm
[ -x "$fpm" ] || fpm=$(command -v fpm) || { echo "no fpm: run \`make setup\`" >&2; exit 1; }
fast=(--flag "$(cat tools/flags/fast) ${ARCH--march=native}")
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

parts_of() { # DOCUMENT FILE...: is each of the document's Fortran blocks, word for word, a part of one of the files?
    local document=$1
    shift
    awk '
        FNR == 1 { text[++files] = "\n" }
        FILENAME != ARGV[ARGC - 1] { text[files] = text[files] $0 "\n"; next }
        /^```fortran$/ { inside = 1; block = "\n"; start = FNR; next }
        /^```$/ && inside {
            inside = 0
            blocks++
            found = 0
            for (i = 1; i < files; i++) if (index(text[i], block)) found = 1
            if (!found) { print "the Fortran block in line " start " of " FILENAME " is no part of an example"; failed = 1 }
            next
        }
        inside { block = block $0 "\n" }
        END { exit failed || !blocks }' "$@" "$document"
}

error_below() { # LIMIT LOG: the line "error: NUMBER" of a program's output
    awk -v limit="$1" '
        $1 == "error:" { found = 1; value = $2 }
        END { print found ? "error " value ", allowed " limit : "no line \"error: NUMBER\""; exit !(found && value + 0 == value && value < limit) }
        ' "$2"
}

# --- 1. quotations in documents -------------------------------------------------------------------------------------

is_short() { [ "$(wc -l <"$1")" -le "$2" ] || { echo "$1 has $(wc -l <"$1") lines, allowed $2"; return 1; }; }
check readme-is-short is_short README.md 150
check readme-quotes-the-skate parts_of README.md example/skate.f90
check scene-guide-quotes-the-examples parts_of doc/scene.md example/*.f90 example/dependent/*/*.f90 example/dependent/program/*/*.f90
check linking-guide-quotes-an-example parts_of doc/linking.md example/f77/knife.f example/f77/swing.f

# --- 2. the examples, each with a motion known in closed form ------------------------------------------------------

run_example() { "$fpm" run --example "$1" "${fast[@]}" >"$tmp/$1.log" 2>&1 || { cat "$tmp/$1.log"; return 1; }; }
finds_nothing_wrong() { grep -q ' right, ' "$1" && ! grep ' WRONG, ' "$1"; }

check skate-runs run_example skate
check skate-agrees-with-its-closed-form error_below 1e-9 "$tmp/skate.log"
check pendulum-runs run_example pendulum
check pendulum-agrees-with-its-closed-form error_below 1e-7 "$tmp/pendulum.log"
check steered-skate-runs run_example steered_skate
check steered-skate-agrees-with-its-closed-form error_below 1e-8 "$tmp/steered_skate.log"
check bounce-runs run_example bounce
check bounce-agrees-with-its-closed-form error_below 1e-9 "$tmp/bounce.log"
check own-stepper-runs run_example own_stepper
check own-stepper-agrees-with-its-closed-form error_below 1e-6 "$tmp/own_stepper.log"
check steered-skate-finds-its-procedures-right finds_nothing_wrong "$tmp/steered_skate.log"

# --- 3. a project that depends on tandem ---------------------------------------------------------------------------

copy_outside() { # the files of the checkout, without anything that set-up or a build made
    # Also if the checkout belongs to another user, as in a container.
    git -c safe.directory="$PWD" ls-files -z --cached --others --exclude-standard | tar --null --ignore-failed-read -T - -cf - |
        tar -C "$tmp/copy" -xf - && [ -f "$tmp/copy/example/dependent/fpm.toml" ]
}

build_dependent() { # without downloads by git and without pkg-config
    local strict="-std=f2018 -Wall -Wextra -pedantic -Wno-unused-dummy-argument"
    (
        cd "$tmp/copy/example/dependent" &&
            env -u PKG_CONFIG_PATH PKG_CONFIG_LIBDIR="$tmp/none" GIT_ALLOW_PROTOCOL=none GIT_TERMINAL_PROMPT=0 \
                "$fpm" build --verbose --flag "$strict"
    ) >"$tmp/build.log" 2>&1 || { cat "$tmp/build.log"; return 1; }
}

no_warning() { # from the project's own sources; those of tandem stand above it
    ! grep -nE '^(\./)*(app|src)/[^:]*:[0-9]+:[0-9]+:' "$tmp/build.log"
}

find_binary() { binary=$(find "$tmp/copy/example/dependent/build" -path '*/app/*' -type f -perm -u+x | head -n 1) && [ -n "$binary" ]; }

nothing_else_compiled() { # no file, library or folder of HDF5, toml-f or test-drive in the commands of the build
    ! grep -niE 'hdf5|toml-?f|test-?drive' "$tmp/build.log" && [ -z "$(ls "$tmp/copy/example/dependent/build/dependencies" 2>/dev/null)" ]
}

nothing_else_linked() { # nor in the binary
    find_binary || { echo "there is no binary"; return 1; }
    { ldd "$binary" && nm "$binary"; } >"$tmp/symbols" || return 1
    grep -q tandem "$tmp/symbols" || { echo "nm shows no symbol of tandem"; return 1; }
    ! grep -iE 'h5[a-z]+_f|hdf5|tomlf|testdrive' "$tmp/symbols"
}

run_dependent() { find_binary && "$binary" >"$tmp/dependent.log" 2>&1 || { cat "$tmp/dependent.log"; return 1; }; }

mkdir "$tmp/copy"
check dependent-is-copied copy_outside
check dependent-builds-without-network build_dependent
check dependent-compiles-without-warning no_warning
check dependent-compiles-neither-hdf5-nor-toml nothing_else_compiled
check dependent-links-neither-hdf5-nor-toml nothing_else_linked
check dependent-runs run_dependent
check dependent-agrees-with-its-closed-form error_below 1e-9 "$tmp/dependent.log"

# --- 4. its program on the command line --------------------------------------------------------------------------------

build_program() { # against the HDF5 and the toml-f of this checkout
    local program=$tmp/copy/example/dependent/program
    mkdir -p "$program/build/dependencies" && cp -r build/dependencies/toml-f "$program/build/dependencies/" &&
        (cd "$program" && GIT_ALLOW_PROTOCOL=none GIT_TERMINAL_PROMPT=0 "$fpm" build --flag "-O1") >"$tmp/build.log" 2>&1 ||
        { tail -n 20 "$tmp/build.log"; return 1; }
}

pendulum() { # ARGUMENT...: in a folder of its own, with the scenes of the project
    local binary
    binary=$(find "$tmp/copy/example/dependent/program/build" -path '*/app/*' -type f -perm -u+x | head -n 1)
    mkdir -p "$tmp/runs" && (cd "$tmp/runs" && TANDEM_SCENES=$tmp/copy/example/dependent/program/scenes "$binary" "$@")
}

is_json() { python3 -c 'import json, sys; json.load(sys.stdin)'; }

killed_and_resumed() { # as if nothing had happened
    pendulum run pendulum --quiet --no-error --output whole.h5 && {
        pendulum run pendulum --quiet --no-error --set solver.max_steps=40 --output part.h5
        [ $? = 1 ]
    } && pendulum resume part.h5 --set solver.max_steps=100000 --no-error --json >"$tmp/part.json" &&
        pendulum run pendulum --force --no-error --json --output again.h5 >"$tmp/whole.json" &&
        python3 - "$tmp/part.json" "$tmp/whole.json" <<'END'
import json, sys
part, whole = (json.load(open(path)) for path in sys.argv[1:])
sys.exit(any(part[key] != whole[key] for key in ("status", "t", "q", "qd", "rows")))
END
}

check program-builds build_program
check program-lists-its-scene grep -q '^pendulum  *pendulum ' <(pendulum list)
check program-shows-what-it-reads grep -q '^length = 2.0 .*of the rod' <(pendulum show pendulum)
check program-checks-its-model pendulum check pendulum
check program-runs pendulum run pendulum --set time.end=2 --output run.h5
check program-tells-json is_json < <(pendulum run pendulum --set time.end=2 --output json.h5 --json)
check program-resumes-bitwise killed_and_resumed
check program-studies pendulum study precision pendulum --set time.end=1 --quick --steppers rk4,dop853
check program-knows-the-shipped-models pendulum check "$PWD/scenes/rolling_disk.toml"

[ "$failures" = 0 ]
