# SPDX-License-Identifier: MIT
"""Compression of the numbers of a motion, for decompression by browsers (gzip).

Each channel is rounded to integer multiples of a step, which is 1e-7 of the visible size and thus far below a pixel. For smooth motions
the third differences of these integers are small. Their bytes are reordered, the lowest bytes of all numbers first, so that gzip
compresses them well."""

from __future__ import annotations

import base64
import gzip

import numpy as np

#: Largest integer of a channel, for which third differences fit into 32 bits.
MOST_STEPS = 2**26


def packed(channels: np.ndarray, steps: np.ndarray) -> str:
    """Compress channels (nc, nf) of finite numbers, rounded to multiples of their steps (nc), to text."""
    whole = np.rint(channels/steps[:, None]).astype(np.int64)
    if np.abs(whole).max(initial=0) > MOST_STEPS:
        raise ValueError("the steps are too small for the numbers")
    third = np.diff(whole, n=3, axis=1, prepend=np.zeros((len(whole), 3), dtype=np.int64))
    zigzag = ((third << 1) ^ (third >> 63)).astype(np.uint32)
    planes = zigzag.reshape(-1).view(np.uint8).reshape(-1, 4).T
    return base64.b64encode(gzip.compress(planes.tobytes(), 9, mtime=0)).decode()


def unpacked(text: str, steps: np.ndarray, nf: int) -> np.ndarray:
    """Invert `packed`, as the page does."""
    planes = np.frombuffer(gzip.decompress(base64.b64decode(text)), dtype=np.uint8).reshape(4, -1)
    zigzag = np.ascontiguousarray(planes.T).view(np.uint32).reshape(len(steps), nf).astype(np.int64)
    third = (zigzag >> 1) ^ -(zigzag & 1)
    return np.cumsum(np.cumsum(np.cumsum(third, axis=1), axis=1), axis=1)*steps[:, None]


def steps_of(channels: np.ndarray, least: float) -> np.ndarray:
    """Rounding step of each channel: 2^-23 of its largest value, but at least `least`."""
    size = np.abs(channels).max(axis=1, initial=0)
    return np.maximum(np.maximum(size/2**23, least), 1e-300)


def squeezed(data: bytes) -> str:
    """Compress bytes to text."""
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode()
