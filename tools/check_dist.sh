#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Checks the archive of `make dist`: unpacked in a folder and moved to another one, the program runs, and programs in C, C++,
# Fortran 77 and Fortran are linked with it by pkg-config, CMake and options, without LAPACK, BLAS and HDF5.
#
# Prints "ok NAME" or "not ok NAME" for each check; tools/verify.py counts them. Exit code 1 if anything failed.
set -uo pipefail
cd "$(dirname "$0")/.." || exit 1
export LC_ALL=C.UTF-8
make --no-print-directory dist >&2 || { echo "not ok archive-is-made"; exit 1; }
tmp=$(mktemp -d) || exit 1
trap 'rm -rf "$tmp"' EXIT
mkdir "$tmp/first" "$tmp/second" "$tmp/empty"
python3 -m tarfile -e dist/tandem-*-linux-x86_64.tar.xz "$tmp/first" && mv "$tmp"/first/tandem-* "$tmp/second/tandem" || exit 1
prefix=$tmp/second/tandem
failures=0

check() { # NAME COMMAND...: passes if the command succeeds, in an empty folder and an environment that knows nothing but the archive
    local name=$1
    shift
    if (cd "$tmp/empty" && env -i HOME="$tmp" PATH="$PATH" PREFIX="$prefix" PKG_CONFIG_PATH="$prefix/lib/pkgconfig" "$@") >"$tmp/told" 2>&1; then
        echo "ok $name"
    else
        echo "not ok $name"
        tail -n 20 "$tmp/told"
        failures=$((failures + 1))
    fi
}
example() { # NAME FOLDER LINES: what a user types in the folder of an example; the error that it prints at its end is below 1e-8
    check "$1" bash -ec "cp -R '$prefix/example/$2' here && cd here && trap 'rm -rf ../here' EXIT
        { $3; } >told 2>&1 || { cat told; exit 1; }; cat told; awk '\$1 == \"error:\" && \$2 < 1e-8 { found = 1 } END { exit !found }' told"
}

check archive-needs-only-the-c-library bash -ec 'for file in $PREFIX/bin/tandem $PREFIX/lib/libtandem.so; do
    ldd $file | grep -vF "$PREFIX/" | grep -vE "linux-vdso|/(libc|libm|libmvec|libgcc_s|ld-linux-x86-64)\.so" && exit 1
done; ldd $PREFIX/lib/libtandem.so | grep -qF "$PREFIX/lib/tandem/libgfortran.so"'
check archive-names-no-folder-of-the-checkout bash -c '! grep -rlF "$1" "$PREFIX"' - "$PWD"
check program-finds-its-scenes bash -ec '$PREFIX/bin/tandem list | grep -q "^rolling_disk "'
check program-runs-and-its-file-is-verified bash -ec '$PREFIX/bin/tandem run motorcycle --set time.end=0.1 --output a.h5 && $PREFIX/bin/tandem verify a.h5'
check program-runs-through-a-link bash -ec 'ln -s $PREFIX/bin/tandem link && ./link run rolling_disk --set time.end=0.1 --output b.h5'
example fortran-77-links f77 'gfortran knife.f -o a -I$PREFIX/include -L$PREFIX/lib -Wl,-rpath,$PREFIX/lib -ltandem && ./a'
example c-links-by-pkg-config c 'cc pendulum.c -o a $(pkg-config --cflags --libs tandem) -lm && ./a'
example cpp-links-by-pkg-config cpp 'c++ skate.cpp -o a $(pkg-config --cflags --libs tandem) && ./a'
example fortran-links-by-pkg-config cmake 'gfortran main.f90 -o a $(pkg-config --cflags --libs tandem) && ./a'
example fortran-links-by-cmake cmake 'cmake -B build -DCMAKE_PREFIX_PATH=$PREFIX && cmake --build build && build/skate'
example python-loads-the-library python 'python3 skate.py $PREFIX/lib/libtandem.so.1'
example static-library-links c 'cc pendulum.c -o a $(pkg-config --cflags --libs tandem-static) && ./a'
[ "$failures" = 0 ]
