#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Checks the installed library and its interfaces: the examples are built outside the checkout from nothing but installed
# files, each must be as exact as it should be; every misuse must end in a status; nothing but LAPACK and BLAS is linked; no
# object asks for an executable stack; and the interfaces are those of their version. Then the installed program, and the library
# of the command line: they work outside the checkout, and each part comes and goes alone.
#
# The program is build/tandem, which `make build` leaves there.
cd "$(dirname "$0")/.." || exit 1
. tools/checks.sh
unset LD_LIBRARY_PATH PKG_CONFIG_PATH CMAKE_PREFIX_PATH MAKEFLAGS MFLAGS MAKELEVEL FFLAGS CFLAGS CXXFLAGS LDFLAGS OMP_DYNAMIC OMP_THREAD_LIMIT

root=$PWD
prefix=$tmp/installed

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

check library-installs tools/library.py install --prefix "$prefix" --parts library

check library-links-neither-hdf5-nor-toml nothing_else_linked "$prefix/lib/libtandem.so.1"

needs_only_lapack_and_blas() {
    objdump -p "$1" | awk '
        $1 == "NEEDED" { print; if ($2 !~ /^(liblapack|libblas|libopenblas|libgfortran|libm|libmvec|libc|libgcc_s|libquadmath)\.so/) bad = 1 }
        END { exit bad }'
}
check library-needs-only-lapack-and-blas needs_only_lapack_and_blas "$prefix/lib/libtandem.so.1"

no_common_state() { # the only variables are constant data: tables of types, constant arrays, and one text of ours
    nm "$prefix/lib/libtandem.a" | awk '
        $2 ~ /^[bBdDC]$/ && $3 !~ /__vtab_|__def_init_|_c_MOD_no_problem$|^jumptable\./ && !($2 == "d" && $3 ~ /^A\./) { print; bad = 1 }
        END { exit bad }'
}
check library-has-no-global-state no_common_state

# --- 2. the interfaces: every misuse, threads, cost ----------------------------------------------------------------

cp -R test/linking "$tmp/linking" && cp -R example "$tmp/example"
check tests-compile-without-warning warns_not make -s -C "$tmp/linking" PREFIX="$prefix"
for program in interface_c interface_f77 mechanism_f77 orders_c orders_f77 skates threads overhead; do tests_of "$tmp/linking/$program"; done

# --- 3. the version of the interfaces ------------------------------------------------------------------------------

check interfaces-are-those-of-their-version tools/interface.py check \
    --library "$prefix/lib/libtandem.so.1" --modules "$prefix/include/tandem"

notices() { # FILE SED_COMMAND WORD: would the change be noticed, and how?
    rm -rf "$tmp/changed" && mkdir -p "$tmp/changed/src/tandem" && cp -R include "$tmp/changed" &&
        cp -R src/tandem/{legacy,options.f90,status.f90,model,simulate,chart} "$tmp/changed/src/tandem" || return 1
    sed -i "$2" "$tmp/changed/$1"
    ! cmp -s "$1" "$tmp/changed/$1" || { echo "nothing to change in $1"; return 1; }
    ! tools/interface.py check --root "$tmp/changed" "${@:4}" 2>"$tmp/noticed" && grep -q -- "$3" "$tmp/noticed" ||
        { cat "$tmp/noticed"; echo "(not noticed: $2)"; return 1; }
}
check a-changed-argument-is-noticed notices include/tandem.h 's/double t_limit/float t_limit/' 'its version has not'
check a-lost-function-is-noticed notices include/tandem.h '/^int tandem_step(/d' 'no longer there: c int tandem_step'
check a-function-without-source-is-noticed notices include/tandem.h 's/double t_limit/float t_limit/' 'only c.f90 has' \
    --modules "$prefix/include/tandem"
check a-symbol-that-is-not-there-is-noticed notices include/tandem.h 's/tandem_step(/tandem_steps(/' 'lacks tandem_steps' \
    --library "$prefix/lib/libtandem.so.1"
check a-changed-subroutine-is-noticed notices src/tandem/legacy/f77.f90 's/real(wp), intent(in) :: tlim/real, intent(in) :: tlim/' \
    'no longer there: f77 tdstep'
check a-lost-option-is-noticed notices src/tandem/options.f90 "s/('secant_limit'/('secant_bound'/" 'real option secant_limit'
check a-statistic-that-c-does-not-know-is-noticed notices src/tandem/simulate/statistics.f90 \
    's/local_error_steps = 0/local_error_steps = 0, resets = 0/' 'lacks the statistic resets'
check a-lost-statistic-is-noticed notices src/tandem/simulate/figures.f90 "s/'dense_error'/'error_between'/" 'statistic dense_error'
check a-changed-constant-is-noticed notices include/tandem.h 's/TANDEM_MASS = 16/TANDEM_MASS = 17/' 'TANDEM_MASS'
check a-status-that-c-does-not-know-is-noticed notices src/tandem/status.f90 's/status_newton_failed = -15/status_newton_failed = -99/' 'NEWTON_FAILED'
check a-version-that-is-not-recorded-is-noticed notices src/tandem/legacy/version.f90 's/= 1/= 2/' 'not recorded'

# --- 4. the examples, from installed files alone -------------------------------------------------------------------

export PKG_CONFIG_PATH=$prefix/lib/pkgconfig CMAKE_PREFIX_PATH=$prefix
mkdir "$tmp/empty" # nothing of the checkout is at hand
build_example() ( cd "$tmp/example/$1" && shift && "$@" )
run_example() ( cd "$tmp/empty" && agrees "$@" )

check f77-example-compiles-without-warning build_example f77 warns_not make -s PREFIX="$prefix"
check f77-example-agrees-with-its-closed-form run_example 1e-8 "$tmp/example/f77/knife" # rtol = 1e-10
check f77-mechanism-agrees-with-its-closed-form run_example 1e-8 "$tmp/example/f77/swing" # rtol = 1e-10
check f77-example-links-neither-hdf5-nor-toml nothing_else_linked "$tmp/example/f77/knife"
links_by_three_names() { grep -q -- ' -ltandem -llapack -lblas$' "$tmp/example/f77/Makefile"; }
check f77-example-names-three-libraries links_by_three_names
check c-example-compiles-without-warning build_example c warns_not make -s
check c-example-agrees-with-its-closed-form run_example 1e-9 "$tmp/example/c/pendulum" # sdirk54, h = 1 ms
check cpp-example-compiles-without-warning build_example cpp warns_not make -s
check cpp-example-agrees-with-its-closed-form run_example 1e-8 "$tmp/example/cpp/skate" # rtol = 1e-10
check python-example-agrees-with-its-closed-form run_example 1e-8 python3 "$tmp/example/python/skate.py" "$prefix/lib/libtandem.so.1" # rtol = 1e-10
by_cmake() { cmake -S . -B build "$@" && cmake --build build; }
check cmake-example-builds build_example cmake by_cmake
check cmake-example-agrees-with-its-closed-form run_example 1e-9 "$tmp/example/cmake/build/skate" # rk4, h = 1 ms
by_cmake_static() { sed -i 's/PRIVATE tandem::tandem\b[^)]*/PRIVATE tandem::tandem_static/' CMakeLists.txt && rm -rf build && by_cmake; }
check cmake-example-links-statically build_example cmake by_cmake_static
check cmake-example-needs-no-shared-library bash -c '! ldd "$1" | grep tandem' - "$tmp/example/cmake/build/skate"
check static-example-agrees-with-its-closed-form run_example 1e-9 "$tmp/example/cmake/build/skate"
statically() { # shellcheck disable=SC2046  # words
    cc pendulum.c -o static $(pkg-config --cflags --libs tandem-static)
}
check c-example-links-statically build_example c statically
check static-c-example-needs-no-shared-library bash -c '! ldd "$1" | grep tandem' - "$tmp/example/c/static"
wholly() { # shellcheck disable=SC2046  # words
    cc -static pendulum.c -o whole $(pkg-config --static --cflags --libs tandem) && ! ldd ./whole
}
check c-example-links-as-a-whole build_example c wholly
check static-c-example-agrees-with-its-closed-form run_example 1e-9 "$tmp/example/c/static"
as_documented() ( # LINE: one of the lines of doc/linking.md as it stands there, in the folder of its example
    local folder source
    source=$(grep -oE '(knife\.f|pendulum\.c|skate\.cpp|main\.f90|cmake|skate\.py)\b' <<<"$1" | head -n 1)
    case $source in
    knife.f) folder=f77 ;; pendulum.c) folder=c ;; skate.cpp) folder=cpp ;; main.f90 | cmake) folder=cmake ;; skate.py) folder=python ;;
    *) echo "no example in: $1"; return 1 ;;
    esac
    rm -rf "$tmp/documented" && cp -R example/$folder "$tmp/documented" && cd "$tmp/documented" || return 1
    agrees 1e-8 env -i HOME="$tmp/home" PATH="$PATH" OPENBLAS_NUM_THREADS=1 sh -ec "$setting"$'\n'"$1"
)
mkdir "$tmp/home" && ln -s "$prefix" "$tmp/home/tandem" # where the page installs it
mapfile -t lines < <(sed -n '/^export PREFIX/,/^```/{/^```/d;p}' doc/linking.md)
setting=${lines[0]}
check linking-guide-has-its-lines test "${#lines[@]}" = 9
for k in "${!lines[@]}"; do [ "$k" = 0 ] || check "linking-guide-line-$k-runs" as_documented "${lines[$k]}"; done
python_raises() { # an exception in a function of the model ends the program as that exception, not as a singular mass
    sed 's/    fill(value, \[1.0, 0.0, 0.0, 0.0, 1.0.*/    raise KeyError("density")/' "$tmp/example/python/skate.py" >"$tmp/raises.py"
    ! python3 "$tmp/raises.py" "$prefix/lib/libtandem.so.1" >"$tmp/raised" 2>&1 || { echo "no failure"; return 1; }
    grep -q "^KeyError: 'density'" "$tmp/raised" || { cat "$tmp/raised"; return 1; }
}
check python-example-raises-the-exception-of-a-function python_raises
python_does_not_guard() { # an unguarded exception makes ctypes return a random status: the term is named
    sed 's/^            raised.append(exception)$//; s/^            return -1$/            raise/' "$tmp/raises.py" >"$tmp/unguarded.py"
    ! python3 "$tmp/unguarded.py" "$prefix/lib/libtandem.so.1" >"$tmp/raised" 2>&1 || { echo "no failure"; return 1; }
    grep -Eq '(did not set its complete value|could not be evaluated) .*term mass' "$tmp/raised" || { cat "$tmp/raised"; return 1; }
}
check an-exception-that-is-not-caught-is-named python_does_not_guard

# --- 5. no code on the stack ---------------------------------------------------------------------------------------

stack_is_data() { # no segment of a program, no section of an object asks for an executable stack
    local file told bad=0 seen=0
    while read -r file; do
        seen=$((seen + 1))
        # All of it is read: whoever stops early may end readelf, and so fail the pipe.
        told=$(readelf -hSlW "$file")
        if grep -q 'REL (Relocatable' <<<"$told"; then
            # Nothing between the size of an entry and the link: no flag, X above all.
            grep -q '\.note\.GNU-stack *PROGBITS *[0-9a-f]* *[0-9a-f]* *[0-9a-f]* *[0-9a-f]* *0 *0 *[0-9]*$' <<<"$told" ||
                { echo "$file: an executable stack"; bad=1; }
        else
            grep -q 'GNU_STACK.* RW  *0x' <<<"$told" || { echo "$file: an executable stack"; bad=1; }
        fi
    done
    echo "$seen files"
    [ "$seen" -gt 0 ] && [ "$bad" = 0 ]
}
objects() { find build/library build/gfortran_* -name '*.o' 2>/dev/null; }
programs() {
    echo "$prefix/lib/libtandem.so.1"
    find "$tmp/linking" "$tmp/example" -type f -perm -u+x ! -name '*.py' ! -path '*CMakeFiles*' -exec sh -c 'readelf -h "$1" >/dev/null 2>&1' - {} \; -print
    find build/gfortran_* \( -path '*/app/*' -o -path '*/test/*' -o -path '*/example/*' \) -type f -perm -u+x 2>/dev/null
}
check objects-ask-for-no-executable-stack stack_is_data < <(objects)
check programs-have-no-executable-stack stack_is_data < <(programs)

internal_callback() { # a caller who passes an internal procedure is told by his compiler, with -Wtrampolines
    cat >"$tmp/trampoline.f90" <<'END'
subroutine caller(h, x)
    implicit none
    integer :: h(4), ierr
    double precision :: x
    external :: tdpos
    call tdpos(h, 'mass_matrix', mass, ierr)
contains
    subroutine mass(n, m, t, q, val, rpar, ipar, istat)
        integer :: n, m, ipar(*), istat
        double precision :: t, q(n), val(m, n), rpar(*)
        val = x
    end subroutine mass
end subroutine caller
END
    ! gfortran -Werror=trampolines -c "$tmp/trampoline.f90" -o "$tmp/trampoline.o"
}
check an-internal-procedure-as-callback-is-refused-by-the-flag internal_callback
executable_stack() {
    gfortran -w -c "$tmp/trampoline.f90" -o "$tmp/trampoline.o" && ! stack_is_data <<<"$tmp/trampoline.o"
}
check an-executable-stack-is-noticed executable_stack

# --- 6. sanitizers: addresses, undefined behaviour, leaks ----------------------------------------------------------

sanitize="-fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer -g"
checked=$tmp/checked
check sanitized-library-installs tools/library.py install --prefix "$checked" --parts library --build build/library-checked --flags "-O1 $sanitize"
sanitized() { # FOLDER PROGRAM: compile anew with the sanitizers, run, and let nothing be reported
    make -s -B -C "$tmp/$1" PREFIX="$checked" CC="cc $sanitize" FC="gfortran $sanitize" CXX="c++ $sanitize" "$2" || return 1
    (cd "$tmp/empty" && "$tmp/$1/$2") >"$tmp/sanitized" 2>&1 || { grep -v '^ok' "$tmp/sanitized"; return 1; }
    ! grep -E 'AddressSanitizer|LeakSanitizer|runtime error' "$tmp/sanitized"
}
export PKG_CONFIG_PATH=$checked/lib/pkgconfig
for program in linking/interface_c linking/interface_f77 linking/threads linking/mechanism_f77 linking/orders_c linking/orders_f77 example/f77/knife example/f77/swing example/c/pendulum example/cpp/skate; do
    check "sanitizers-find-nothing-in-${program##*/}" sanitized "${program%/*}" "${program##*/}"
done
sanitized_cmake() (
    cp example/cmake/* "$tmp/example/cmake" && cd "$tmp/example/cmake" && rm -rf build &&
        by_cmake -DCMAKE_PREFIX_PATH="$checked" -DCMAKE_Fortran_FLAGS="$sanitize" && ./build/skate
)
check sanitizers-find-nothing-in-the-cmake-example sanitized_cmake
sanitized_python() { # Python itself leaks what it keeps to its end
    ASAN_OPTIONS=detect_leaks=0 LD_PRELOAD="$(cc -print-file-name=libasan.so) $(cc -print-file-name=libubsan.so)" \
        python3 example/python/skate.py "$checked/lib/libtandem.so.1"
}
check sanitizers-find-nothing-in-the-python-example sanitized_python

# --- 7. the program and the library of the command line ----------------------------------------------------------------

unset TANDEM_SCENES
export PKG_CONFIG_PATH=$prefix/lib/pkgconfig
check program-installs-beside-the-library tools/library.py install --prefix "$prefix" --parts program command-line --program build/tandem
in_empty() ( cd "$tmp/empty" && "$@" )
same_scenes() { # those of the checkout, from the place where they are installed, also through a link
    ln -sf "$prefix/bin/tandem" "$tmp/link" && in_empty "$tmp/link" list >"$tmp/list" || return 1
    for scene in scenes/*.toml; do
        grep -q "^$(basename "$scene" .toml) " "$tmp/list" || { echo "no $scene"; cat "$tmp/list"; return 1; }
        cmp "$scene" "$prefix/share/tandem/scenes/$(basename "$scene")" || return 1
    done
}
check installed-program-finds-its-scenes same_scenes
check installed-program-runs in_empty "$prefix/bin/tandem" run motorcycle --set time.end=0.1 --output motorcycle.h5
driver_of_ones_own() ( # the program of ten lines, by the installed files alone
    # shellcheck disable=SC2046  # words
    cd "$tmp/example/dependent" && gfortran src/pendulum.f90 program/src/pendulum_scene.f90 program/app/main.f90 -o driver \
        $(pkg-config --cflags --libs tandem-command-line)
)
check driver-of-ones-own-builds driver_of_ones_own
driver() ( cd "$tmp/empty" && TANDEM_SCENES=$tmp/example/dependent/program/scenes "$tmp/example/dependent/driver" "$@" )
check driver-of-ones-own-checks-its-model driver check pendulum
check driver-of-ones-own-runs-and-resumes eval 'driver run pendulum --set time.end=0.5 --output driver.h5 &&
    driver resume driver.h5 --set time.end=1'
parts_left() { # PART...: nothing but these are listed as installed, and a file of each is there or gone
    local part file
    for part in library:lib/libtandem.so program:bin/tandem command-line:lib/libtandem-command-line.a; do
        file=$prefix/${part#*:}
        if [[ " $* " == *" ${part%%:*} "* ]]; then
            [ -e "$file" ] || { echo "no $file"; return 1; }
        else
            [ ! -e "$file" ] || { echo "$file is still there"; return 1; }
        fi
    done
}
check parts-stand-side-by-side parts_left library program command-line
check program-uninstalls-alone eval 'tools/library.py uninstall --prefix "$prefix" --parts program && parts_left library command-line &&
    [ ! -e "$prefix/share/tandem/scenes" ]'
needs_no_fpm() { ! make -n install PARTS=library PREFIX="$tmp" | grep -E 'setup|fpm'; }
check library-alone-needs-no-fpm needs_no_fpm
builds_first() { env -u MAKEFLAGS -u PARTS make -n install PREFIX="$tmp" | grep -- '--runner install -- -D build/optimised/tandem' >/dev/null; }
check everything-is-built-before-it-is-installed builds_first

# --- 8. and away ---------------------------------------------------------------------------------------------------

: >"$prefix/lib/a-file-of-somebody-else"
check library-uninstalls tools/library.py uninstall --prefix "$prefix"
only_theirs() { find "$prefix" -type f -o -type l | tee "$tmp/left"; [ "$(wc -l <"$tmp/left")" = 1 ]; }
check uninstall-leaves-what-is-not-its-own only_theirs
check library-installs-below-destdir tools/library.py install --prefix /opt/tandem --parts library --destdir "$tmp/stage"
check destdir-is-not-in-the-files bash -c 'grep -qx "prefix=/opt/tandem" "$1/opt/tandem/lib/pkgconfig/tandem.pc"' - "$tmp/stage"

[ "$failures" = 0 ]
