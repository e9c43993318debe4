#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Installs the package for Python, with the library, the program and three.js, into a separate environment: build/python, where
# `tandem plot` and `tandem view` look for it. `make python` calls it after the build of the program. Missing parts are installed:
# packages of the system by tools/setup.sh, others from PyPI.
set -euo pipefail
cd "$(dirname "$0")/.."
export PIP_USER=0 PIP_DISABLE_PIP_VERSION_CHECK=1 LC_ALL=C.UTF-8
unset PYTHONPATH PYTHONHOME
env=build/python log=build/python.log
say() { printf 'python: %s\n' "$*" >&2; }
logged() { # COMMAND...: its output goes to the log, and is shown if it fails
    "$@" >"$log" 2>&1 </dev/null || { tail -n 15 "$log" >&2; say "failed: $*"; exit 1; }
}

tools/setup.sh python
wanted=$(pwd -P; cat python/requirements.txt)
if ! [ -x $env/bin/python ] || [ "$wanted" != "$(cat $env/stamp 2>/dev/null)" ]; then
    say "making the environment $env"
    rm -rf $env
    logged python3 -m venv $env
    say "installing $(sed -n 's/^\([a-z0-9-]*==[0-9.]*\).*/\1/p' python/requirements.txt | paste -sd ' ') (PyPI)"
    logged $env/bin/python -m pip install --only-binary :all: -r python/requirements.txt
    printf '%s\n' "$wanted" >$env/stamp
fi
say "installing the package"
logged $env/bin/python -m pip install --no-deps --no-build-isolation --force-reinstall ./python
say "it is in $env: $env/bin/python, and tandem plot, tandem view"
