#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Checks the examples: quotations in documents match the files, each example runs with the required
# accuracy, and a project outside the checkout that depends on tandem builds without HDF5, TOML and a network.
cd "$(dirname "$0")/.." || exit 1
. tools/checks.sh
unset GIT_DIR GIT_WORK_TREE GIT_INDEX_FILE GIT_PREFIX GIT_COMMON_DIR GIT_OBJECT_DIRECTORY

fpm=$PWD/.venv/bin/fpm
[ -x "$fpm" ] || fpm=$(command -v fpm) || { echo "no fpm: run \`make setup\`" >&2; exit 1; }
fast=(--flag "$(cat tools/flags/fast) ${ARCH--march=native}")

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

# --- 1. quotations in documents -------------------------------------------------------------------------------------

is_short() { [ "$(wc -l <"$1")" -le "$2" ] || { echo "$1 has $(wc -l <"$1") lines, allowed $2"; return 1; }; }
check readme-is-short is_short README.md 150
check readme-quotes-the-skate parts_of README.md example/skate.f90
check scene-guide-quotes-the-examples parts_of doc/scene.md example/*.f90 example/dependent/*/*.f90 example/dependent/program/*/*.f90
check linking-guide-quotes-an-example parts_of doc/linking.md example/f77/knife.f example/f77/swing.f

# --- 2. the examples, each with a motion known in closed form ------------------------------------------------------

finds_nothing_wrong() { grep -q ' right, ' "$1" && ! grep ' WRONG, ' "$1"; }

for example in bounce:1e-9 own_stepper:1e-6 pendulum:1e-7 skate:1e-9 steered_skate:1e-8; do
    name=${example%:*}
    check "${name//_/-}-agrees-with-its-closed-form" agrees "${example#*:}" "$fpm" run --example "$name" "${fast[@]}"
done
check steered-skate-finds-its-procedures-right finds_nothing_wrong "$tmp/log"

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

binary() { find "$tmp/copy/example/dependent/$1build" -path '*/app/*' -type f -perm -u+x | head -n 1; }

nothing_else_compiled() { # no file, library or folder of HDF5, toml-f or test-drive in the commands of the build
    ! grep -niE 'hdf5|toml-?f|test-?drive' "$tmp/build.log" && [ -z "$(ls "$tmp/copy/example/dependent/build/dependencies" 2>/dev/null)" ]
}


mkdir "$tmp/copy"
check dependent-is-copied copy_outside
check dependent-builds-without-network build_dependent
check dependent-compiles-without-warning no_warning
check dependent-compiles-neither-hdf5-nor-toml nothing_else_compiled
check dependent-links-neither-hdf5-nor-toml nothing_else_linked "$(binary '')"
check dependent-agrees-with-its-closed-form agrees 1e-9 "$(binary '')"

# --- 4. its program on the command line --------------------------------------------------------------------------------

build_program() { # against the HDF5 and the toml-f of this checkout
    local program=$tmp/copy/example/dependent/program
    mkdir -p "$program/build/dependencies" && cp -r build/dependencies/toml-f "$program/build/dependencies/" &&
        (cd "$program" && GIT_ALLOW_PROTOCOL=none GIT_TERMINAL_PROMPT=0 "$fpm" build --flag "-O1") >"$tmp/build.log" 2>&1 ||
        { tail -n 20 "$tmp/build.log"; return 1; }
}

pendulum() { # ARGUMENT...: in a folder of its own, with the scenes of the project
    mkdir -p "$tmp/runs" && (cd "$tmp/runs" && TANDEM_SCENES=$tmp/copy/example/dependent/program/scenes "$(binary program/)" "$@")
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
