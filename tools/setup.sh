#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Installs missing requirements of the build. `make` calls it before each build: it takes a fraction of a second
# when nothing is missing, and a call after an interrupted one completes it.
#
# Usage: tools/setup.sh         requirements of `fpm build`
#        tools/setup.sh test    and of tools/verify.py
#        tools/setup.sh coverage  and of tools/coverage.sh
#        tools/setup.sh docs    and of `make docs`
#        tools/setup.sh plot    and of tools/plot.py
#        tools/setup.sh bench   and of bench/
#        tools/setup.sh mpi     and of mpi/
#        tools/setup.sh python  and of tools/python.sh
#        tools/setup.sh wheel   and of `make wheel` and `make dist`
#
# 1. packages of the system  gfortran, LAPACK and BLAS, the serial HDF5, git, Python's venv (for the tests also g++, CMake,
#                            pkg-config; for bench/ SUNDIALS, valgrind; for mpi/ OpenMPI; for wheels the OpenBLAS without
#                            threads): through apt-get
# 2. .venv/                  fpm and, for the tests, some Python packages: from PyPI
# 3. .deps/                  the sources of the git dependencies: by git, or else out of a source package on PyPI;
#    build/dependencies/     copies of them where fpm looks: it fetches nothing that is there already
# 4. io/include/hdf5         the link to the module files of the serial HDF5, where they are not in Debian's usual place;
#    mpi/include/mpi         a link to those of OpenMPI
# 5. .deps/site/             for the reference: the packages that hold its scripts and styles, from PyPI
#
# Exit codes: 0 all is there, 1 something could not be fetched or made, 2 something is for you to install or to change.
# shellcheck disable=SC2015  # A && B || fail: fail is meant for either
set -uo pipefail
cd "$(dirname "$0")/.." || exit 1
# A git hook exports these; the git calls here and in fpm would follow them into another repository.
unset GIT_DIR GIT_WORK_TREE GIT_INDEX_FILE GIT_PREFIX GIT_COMMON_DIR GIT_OBJECT_DIRECTORY
# A folder in .deps or build/dependencies that is no repository must not pass for ours.
export GIT_CEILING_DIRECTORIES=$PWD/.deps:$PWD/build/dependencies
export GIT_TERMINAL_PROMPT=0 PIP_USER=0 PIP_DISABLE_PIP_VERSION_CHECK=1 LC_ALL=C.UTF-8

purpose=${1:-build}
oldest_gfortran=12
fpm_version=0.12
log=.deps/setup.log

say() { printf 'setup: %s\n' "$*" >&2; }
fail() { # EXIT_CODE LINE...: what is wrong, then what to do about it
    local code=$1 line
    shift
    for line; do say "$line"; done
    exit "$code"
}
logged() { # COMMAND...: its output goes to the log
    printf '\n$ %s\n' "$*" >>"$log"
    "$@" >>"$log" 2>&1 </dev/null
}
show_log() {
    say "the last lines of $log:"
    grep -v 'WARNING: Retrying' "$log" | tail -n 8 | sed 's/^/    /' >&2
}

# --- 1. packages of the system ---------------------------------------------------------------------------------------

linker_finds() { [[ $(gfortran -print-file-name="$1" 2>/dev/null) == /* ]]; }

hdf5_modules() { dpkg -L libhdf5-dev 2>/dev/null | sed -n 's,/hdf5\.mod$,,p' | grep -m 1 serial; }

mpi_modules() { dpkg -L libopenmpi-dev libopenmpi3 2>/dev/null | sed -n 's,/mpi_f08\.mod$,,p' | grep -m 1 .; }

missing_packages() { # prints the Debian packages that bring what is not there
    command -v git >/dev/null || echo git
    command -v make >/dev/null || echo make
    command -v gfortran >/dev/null || echo gfortran
    linker_finds crt1.o || echo libc6-dev
    linker_finds liblapack.so && linker_finds libblas.so || echo libopenblas-dev
    linker_finds libhdf5_serial_fortran.so && linker_finds libhdf5_serial.so &&
        { [ -f io/include/hdf5/hdf5.mod ] || hdf5_modules >/dev/null; } || echo libhdf5-dev
    venv_holds build || python3 -c 'import venv, ensurepip' 2>/dev/null || echo python3-venv
    [ "$purpose" != bench ] || linker_finds libsundials_ida.so || echo libsundials-dev
    [ "$purpose" != bench ] || command -v valgrind >/dev/null || echo valgrind
    [ "$purpose" != mpi ] || { mpi_modules >/dev/null && linker_finds libmpi_usempif08.so; } || echo libopenmpi-dev
    [ "$purpose" != mpi ] || command -v mpirun >/dev/null || echo openmpi-bin
    [ "$purpose" != wheel ] || linker_finds openblas-serial/libopenblas.a || echo libopenblas-serial-dev
    [ "$purpose" = test ] || return 0
    # The examples are built as users of C, C++ and CMake would.
    command -v c++ >/dev/null || echo g++
    command -v pkg-config >/dev/null || echo pkg-config
    command -v cmake >/dev/null || echo cmake
}

install_packages() { # PACKAGE...
    local install="apt-get install -y --no-install-recommends" as_root=()
    command -v apt-get >/dev/null || fail 2 "missing: what these Debian packages contain: $*" \
        "There is no apt-get here; install their counterparts by hand, then try again."
    if [ "$(id -u)" != 0 ]; then
        if ! command -v sudo >/dev/null; then
            say "packages are missing, and only root can install them. Type this line, then try again:"
            printf "su -c 'apt-get update && %s'\n" "$install $*" >&2
            exit 2
        elif ! sudo -n true 2>/dev/null; then
            say "packages are missing, and only root can install them. Type this line, then try again:"
            printf 'sudo apt-get update && sudo %s\n' "$install $*" >&2
            exit 2
        fi
        as_root=(sudo -n)
    fi
    as_root+=(env DEBIAN_FRONTEND=noninteractive)
    say "installing $* (apt-get)"
    # Lists that are out of date may still do: what counts is the installation.
    logged "${as_root[@]}" apt-get update || say "apt-get update failed; trying with the lists as they are"
    # A machine that has just started may be updating itself: wait for it.
    # shellcheck disable=SC2086  # words
    logged "${as_root[@]}" $install -o DPkg::Lock::Timeout=120 "$@" && return
    show_log
    fail 2 "apt-get could not install: $*" "Mend what it says above, then try again."
}

bring_packages() {
    local missing version
    mapfile -t missing < <(missing_packages)
    if [ "${#missing[@]}" -gt 0 ]; then
        install_packages "${missing[@]}"
        mapfile -t missing < <(missing_packages)
        [ "${#missing[@]}" = 0 ] || fail 2 "still not found after the installation: what ${missing[*]} contain" \
            "Does a gfortran or python3 from elsewhere come first on the PATH? ($(command -v gfortran python3 | paste -sd ' '))"
    fi
    version=$(gfortran -dumpversion)
    [ "${version%%.*}" -ge "$oldest_gfortran" ] 2>/dev/null || fail 2 \
        "gfortran $version ($(command -v gfortran)) is too old: tandem needs $oldest_gfortran or newer." \
        "Install a newer one and put it first on the PATH under the name gfortran."
}

# --- 2. the virtual environment --------------------------------------------------------------------------------------

# A stamp is written last. It holds the place of the checkout, since a virtual environment does not survive a move, and
# the requirements that were installed.
stamp_text() { pwd -P && cat "config/requirements-$1.txt"; }

venv_holds() { # PURPOSE: are its packages in .venv?
    [ -x .venv/bin/python ] && [ -f ".venv/$1.stamp" ] && [ "$(stamp_text "$1")" = "$(<".venv/$1.stamp")" ] &&
        .venv/bin/fpm --version >/dev/null 2>&1
}

has_requirements() { [ "$purpose" != build ] && [ -f "config/requirements-$purpose.txt" ]; }

fill_venv() { # PURPOSE
    local file=config/requirements-$1.txt
    venv_holds "$1" && return
    if [ "$1" = build ]; then
        say "making the virtual environment .venv"
        rm -rf .venv
        if ! logged python3 -m venv .venv; then
            show_log
            fail 1 "python3 -m venv .venv failed." "Mend what it says above, then try again."
        fi
    fi
    say "installing $(sed -n 's/^\([a-z0-9-]*==[0-9.]*\).*/\1/p' "$file" | paste -sd ' ') (PyPI)"
    # --force-reinstall: an interrupted installation is repeated as a whole.
    if ! logged .venv/bin/python -m pip install --force-reinstall --only-binary :all: -r "$file"; then
        show_log
        [ "$1" = build ] && link_other_fpm || fail 1 "pip could not install the packages of $file." \
            "Is there a network? Behind a proxy, set HTTPS_PROXY. Then try again." \
            "Where PyPI has no fpm for the machine, an fpm $fpm_version from elsewhere will do: put it on the PATH."
    fi
    stamp_text "$1" >".venv/$1.stamp"
}

link_other_fpm() { # where PyPI has no fpm for this machine, one on the PATH will do
    local other
    other=$(command -v fpm) && "$other" --version 2>/dev/null | grep -q "^Version: *${fpm_version/./\\.}\." &&
        say "using $other instead" && ln -sf "$other" .venv/bin/fpm
}

# --- 3. the git dependencies -----------------------------------------------------------------------------------------

dependencies() { # prints "name address tag" for each git dependency in the manifests
    sed -n 's/^\([a-z-]*\) *= *{ *git *= *"\([^"]*\)", *tag *= *"\([^"]*\)" *}.*/\1 \2 \3/p' io/fpm.toml test/fpm.toml
}

is_source() { # FOLDER TAG: a repository with a commit (a clone that failed leaves one without), of this version
    [ -d "$1/src" ] && grep -q "^version *= *\"${2#v}\"" "$1/fpm.toml" 2>/dev/null &&
        git -C "$1" rev-parse -q --verify HEAD >/dev/null 2>&1
}

clone_source() { # ADDRESS TAG FOLDER
    logged timeout 20 git ls-remote --exit-code "$1" "refs/tags/$2" &&
        logged timeout 300 git -c advice.detachedHead=false clone -q --depth 1 --branch "$2" "$1" "$3" && is_source "$3" "$2"
}

unpack_source() { # NAME TAG FOLDER: out of the source package on PyPI
    local unpacked=$PWD/.deps/unpacked source
    if [ ! -d "$unpacked" ]; then
        mkdir -p "$unpacked"
        # The command ends in an error, since the package's own build system is not here: the sources are unpacked by then.
        TMPDIR=$unpacked logged .venv/bin/python -m pip download --no-clean --no-build-isolation --no-deps \
            --no-binary :all: --require-hashes -r config/requirements-sources.txt -d "$unpacked"
    fi
    source=$(find "$unpacked" -type d -path "*/subprojects/$1" | head -n 1)
    [ -n "$source" ] && cp -R "$source" "$3" && commit_source "$1 $2" "$3" >>"$log" 2>&1 && is_source "$3" "$2"
}

commit_source() ( # MESSAGE FOLDER; the fixed dates give the same sources the same commit everywhere
    export GIT_AUTHOR_DATE=2000-01-01T00:00:00Z GIT_COMMITTER_DATE=2000-01-01T00:00:00Z
    cd "$2" && git -c init.defaultBranch=main init -q --template= && git -c core.autocrlf=false add -A -f &&
        git -c user.name=tandem -c user.email=tandem@localhost -c commit.gpgsign=false commit -q -m "$1"
)

fetch_source() { # NAME ADDRESS TAG: into .deps, which survives `fpm clean --all`
    local kept=.deps/$1-$3 new=.deps/new
    is_source "$kept" "$3" && return
    rm -rf "$kept" "$new"
    say "fetching $1 $3"
    if ! clone_source "$2" "$3" "$new"; then
        say "$2 cannot be reached: taking $1 out of a source package on PyPI"
        rm -rf "$new"
        if ! unpack_source "$1" "$3" "$new"; then
            rm -rf "$new" .deps/unpacked
            show_log
            fail 1 "$1 $3 could be had neither from $2 nor from PyPI." \
                "Try again with a network, or put a git clone of that tag into $kept."
        fi
    fi
    mv "$new" "$kept"
}

seed_dependencies() {
    local name address tag here
    rm -rf .deps/unpacked
    while read -r name address tag; do
        here=build/dependencies/$name
        is_source "$here" "$tag" && continue
        fetch_source "$name" "$address" "$tag"
        mkdir -p build/dependencies
        rm -rf "$here" .deps/new build/cache.toml
        cp -R ".deps/$name-$tag" .deps/new && mv .deps/new "$here" || fail 1 "cannot write $here"
    done < <(dependencies)
    rm -rf .deps/unpacked
    # fpm names paths differently once it has its cache: without it, the second build would compile everything anew.
    if [ ! -f build/cache.toml ] && ! logged .venv/bin/fpm update --fetch-only; then
        show_log
        fail 1 "fpm does not accept the dependencies." "Mend what it says above, or remove build and .deps, then try again."
    fi
}

# --- 4. the module files of the serial HDF5 --------------------------------------------------------------------------

link_hdf5() {
    [ -f io/include/hdf5/hdf5.mod ] && return
    mkdir -p io/include && rm -rf io/include/hdf5 && ln -s "$(hdf5_modules)" io/include/hdf5 ||
        fail 1 "cannot make the link io/include/hdf5"
}

link_mpi() {
    [ "$purpose" != mpi ] || mpi_is_linked && return
    mkdir -p mpi/include mpi/build/dependencies && rm -rf mpi/include/mpi && ln -s "$(mpi_modules)" mpi/include/mpi &&
        ln -sfn ../../../build/dependencies/toml-f mpi/build/dependencies/toml-f ||
        fail 1 "cannot make the links in mpi/include and mpi/build"
}

mpi_is_linked() { [ "$purpose" != mpi ] || { [ -f mpi/include/mpi/mpi_f08.mod ] && [ -d mpi/build/dependencies/toml-f ]; }; }

# --- 5. scripts and styles of the reference ----------------------------------------------------------------------------

site=config/requirements-site.txt
site_is_there() { [ "$purpose" != docs ] || cmp -s "$site" .deps/site/stamp; }

fetch_site() {
    site_is_there && return
    say "fetching $(sed -n 's/^\([a-z0-9-]*==[0-9.]*\).*/\1/p' "$site" | paste -sd ' ') (PyPI)"
    rm -rf .deps/site
    if ! logged .venv/bin/python -m pip download --no-deps --only-binary :all: --require-hashes -r "$site" -d .deps/site; then
        show_log
        fail 1 "pip could not fetch the packages of $site." "Is there a network? Behind a proxy, set HTTPS_PROXY. Then try again."
    fi
    cp "$site" .deps/site/stamp
}

# ---------------------------------------------------------------------------------------------------------------------

check_owner() { # after a `sudo make`, folders may belong to root
    local folder
    for folder in . .deps .venv build build/dependencies io/include; do
        [ ! -e "$folder" ] || [ -w "$folder" ] || fail 2 "you may not write in $(realpath "$folder")" \
            "It belongs to $(stat -c %U "$folder"): change the owner (chown -R), or work in a clone of your own."
    done
}

all_is_there() {
    local name address tag
    [ -z "$(missing_packages)" ] && venv_holds build && { ! has_requirements || venv_holds "$purpose"; } || return 1
    [ -f io/include/hdf5/hdf5.mod ] && [ -f build/cache.toml ] && site_is_there && mpi_is_linked || return 1
    while read -r name address tag; do is_source "build/dependencies/$name" "$tag" || return 1; done < <(dependencies)
}

check_owner
all_is_there && exit 0
mkdir -p .deps
exec 9>.deps/lock
flock 9 # one at a time
: >"$log"
bring_packages
fill_venv build
! has_requirements || fill_venv "$purpose"
seed_dependencies
link_hdf5
link_mpi
fetch_site
say "all is there. To call fpm yourself: . .venv/bin/activate"
