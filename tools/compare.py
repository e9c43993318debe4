#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Compares a result file of tandem with a reference solution: the largest difference of a coordinate at each common time.

Usage: tools/compare.py RESULT.h5 test/reference/NAME.txt

Needs h5py. The times of the reference must be among those that were written.
"""

import signal
import sys

import h5py
import numpy as np


def main(result, reference):
    with open(reference, encoding="utf-8") as file:
        numbers = [line.split() for line in file if not line.startswith("#")]
    n = int(numbers[0][1])
    expected = np.array(numbers[1:], dtype=float)
    with h5py.File(result) as file:
        time, q = file["trajectory/time"][:], file["trajectory/q"][:]
    common = 0
    for t, row in zip(expected[:, 0], expected[:, 1 : n + 1]):
        i = np.abs(time - t).argmin()
        if abs(time[i] - t) <= 1e-12 * max(1.0, abs(t)):
            common += 1
            print(f"t = {t:<10g} max |q - reference| = {np.abs(q[i] - row).max():.2e}")
    if common == 0:
        sys.exit(f"no time of {reference} is in {result}: write more often (output.every)")


if __name__ == "__main__":
    # Piped to head, end as other filters do.
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
