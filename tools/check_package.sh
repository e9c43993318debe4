#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Tests the package for Python as it is installed: by tools/python.sh, into build/python. The program is build/tandem, which `make build`
# leaves there.
#
# Usage: tools/check_package.sh [page]    with `page`, the tests that need large packages instead: pages in a browser, numba, glTF
set -euo pipefail
cd "$(dirname "$0")/.."
unset PYTHONPATH PYTHONHOME TANDEM_PROGRAM TANDEM_LIBRARY TANDEM_PYTHON TANDEM_SCENES
export PIP_USER=0 PIP_DISABLE_PIP_VERSION_CHECK=1
tests=test/package
[ "${1:-}" != page ] || tests=test/page
tools/python.sh
wanted=$(cat $tests/requirements.txt)
stamp=build/python/$(basename $tests).stamp
if [ "$wanted" != "$(cat "$stamp" 2>/dev/null)" ]; then
    build/python/bin/python -m pip install --quiet -r $tests/requirements.txt
    printf '%s\n' "$wanted" >"$stamp"
fi
exec build/python/bin/python -m unittest discover -v -s $tests
