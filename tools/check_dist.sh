#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Checks the archive of `make dist`: unpacked in a folder and moved to another one, the program runs, and programs in C, C++,
# Fortran 77 and Fortran are linked with it by pkg-config, CMake and options, without LAPACK, BLAS and HDF5.
cd "$(dirname "$0")/.." || exit 1
. tools/checks.sh
make --no-print-directory dist >&2 || { echo "not ok archive-is-made"; exit 1; }
mkdir "$tmp/first" "$tmp/second" "$tmp/empty"
python3 -m tarfile -e dist/tandem-*-linux-x86_64.tar.xz "$tmp/first" && mv "$tmp"/first/tandem-* "$tmp/second/tandem" || exit 1
prefix=$tmp/second/tandem

alone() ( # COMMAND...: in an empty folder and an environment that knows nothing but the archive
    cd "$tmp/empty" && env -i HOME="$tmp" PATH="$PATH" PREFIX="$prefix" PKG_CONFIG_PATH="$prefix/lib/pkgconfig" "$@"
)
example() { # NAME FOLDER LINES: what a user types in the folder of an example
    rm -rf "$tmp/empty/here" && cp -R "$prefix/example/$2" "$tmp/empty/here"
    check "$1" agrees 1e-8 alone bash -ec "cd here; $3"
}

check archive-needs-only-the-c-library alone bash -ec 'for file in $PREFIX/bin/tandem $PREFIX/lib/libtandem.so; do
    ldd $file | grep -vF "$PREFIX/" | grep -vE "linux-vdso|/(libc|libm|libmvec|libgcc_s|ld-linux-x86-64)\.so" && exit 1
done; ldd $PREFIX/lib/libtandem.so | grep -qF "$PREFIX/lib/tandem/libgfortran.so"'
check archive-names-no-folder-of-the-checkout alone bash -c '! grep -rlF "$1" "$PREFIX"' - "$PWD"
check program-finds-its-scenes alone bash -ec '$PREFIX/bin/tandem list | grep -q "^rolling_disk "'
check program-runs-and-its-file-is-verified alone bash -ec '$PREFIX/bin/tandem run motorcycle --set time.end=0.1 --output a.h5 && $PREFIX/bin/tandem verify a.h5'
check program-runs-through-a-link alone bash -ec 'ln -s $PREFIX/bin/tandem link && ./link run rolling_disk --set time.end=0.1 --output b.h5'
example fortran-77-links f77 'gfortran knife.f -o a -I$PREFIX/include -L$PREFIX/lib -Wl,-rpath,$PREFIX/lib -ltandem && ./a'
example c-links-by-pkg-config c 'cc pendulum.c -o a $(pkg-config --cflags --libs tandem) -lm && ./a'
example cpp-links-by-pkg-config cpp 'c++ skate.cpp -o a $(pkg-config --cflags --libs tandem) && ./a'
example fortran-links-by-pkg-config cmake 'gfortran main.f90 -o a $(pkg-config --cflags --libs tandem) && ./a'
example fortran-links-by-cmake cmake 'cmake -B build -DCMAKE_PREFIX_PATH=$PREFIX && cmake --build build && build/skate'
example python-loads-the-library python 'python3 skate.py $PREFIX/lib/libtandem.so.1'
example static-library-links c 'cc pendulum.c -o a $(pkg-config --cflags --libs tandem-static) && ./a'
[ "$failures" = 0 ]
