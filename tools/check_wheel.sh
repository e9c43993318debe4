#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Tests the wheel as its users have it: `make wheel`, then the suites of the package and of the command line with what pip installs
# into a new environment, in a copy of the sources outside the checkout, where nothing was built.
set -euo pipefail
cd "$(dirname "$0")/.."
unset PYTHONPATH PYTHONHOME TANDEM_PROGRAM TANDEM_LIBRARY TANDEM_PYTHON TANDEM_SCENES
export PIP_USER=0 PIP_DISABLE_PIP_VERSION_CHECK=1
make --no-print-directory wheel
tmp=$(mktemp -d)
trap 'rm -rf "$tmp"' EXIT
mkdir "$tmp/copy"
git ls-files -z | tar --null --files-from - -c | tar -x -C "$tmp/copy"
# These test the checkout.
rm "$tmp"/copy/test/python/test_{map,mpi,setup,verify}.py
python3 -m venv "$tmp/env"
export TANDEM_WHEEL=$PWD/dist/$(cd dist && ls tandem_multibody-*.whl) TANDEM_CHECKOUT=$PWD
"$tmp/env/bin/python" -m pip install --quiet "$TANDEM_WHEEL" -r python/requirements.txt -r test/package/requirements.txt
cd "$tmp/copy"
TANDEM=$("$tmp/env/bin/python" -c 'import tandem; print(tandem.program_path())')
export TANDEM
failed=0
for suite in package python; do
    "$tmp/env/bin/python" -m unittest discover -v -s test/$suite || failed=1
done
exit $failed
