#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Builds what takes OpenMPI, and tests it. tools/verify.py runs this where part mpi is asked for.
set -euo pipefail
cd "$(dirname "$0")/.."
make --no-print-directory mpi
exec .venv/bin/python test/python/test_mpi.py -v
