# SPDX-License-Identifier: MIT
"""Rotations as unit quaternions (w, x, y, z), that is, Euler parameters, along the last axis of an array."""

from __future__ import annotations

import numpy as np

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def normalised(p):
    p = np.asarray(p, dtype=float)
    size = np.linalg.norm(p, axis=-1, keepdims=True)
    return np.where(size > 0, p / np.where(size > 0, size, 1), IDENTITY)


def product(a, b):
    """Product of rotations: first b, then a."""
    a0, a1, a2, a3 = np.moveaxis(np.asarray(a, dtype=float), -1, 0)
    b0, b1, b2, b3 = np.moveaxis(np.asarray(b, dtype=float), -1, 0)
    return np.stack([a0*b0 - a1*b1 - a2*b2 - a3*b3, a0*b1 + a1*b0 + a2*b3 - a3*b2,
                     a0*b2 - a1*b3 + a2*b0 + a3*b1, a0*b3 + a1*b2 - a2*b1 + a3*b0], axis=-1)


def conjugate(p):
    return np.asarray(p, dtype=float) * np.array([1.0, -1.0, -1.0, -1.0])


def rotated(p, x):
    """Vectors x (..., 3) rotated by p (..., 4)."""
    p, x = np.asarray(p, dtype=float), np.asarray(x, dtype=float)
    w, v = p[..., :1], p[..., 1:]
    return x + 2*np.cross(v, np.cross(v, x) + w*x)


def from_vector(vector):
    """Rotation about a vector by an angle equal to its length."""
    vector = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(vector)
    if angle == 0:
        return IDENTITY.copy()
    return np.concatenate([[np.cos(angle/2)], np.sin(angle/2)*vector/angle])


def from_vectors(vectors):
    """Rotations about vectors (n, 3) by angles equal to their lengths."""
    half = np.asarray(vectors, dtype=float)/2
    angle = np.linalg.norm(half, axis=-1, keepdims=True)
    # numpy.sinc(x) is sin(pi x)/(pi x), and 1 for x = 0.
    return np.concatenate([np.cos(angle), np.sinc(angle/np.pi)*half], axis=-1)


def from_angle(angle):
    """Rotations about z, continuous for a continuous angle."""
    angle = np.asarray(angle, dtype=float)
    zero = np.zeros_like(angle)
    return np.stack([np.cos(angle/2), zero, zero, np.sin(angle/2)], axis=-1)


def rotation_onto(direction, onto=(0.0, 0.0, 1.0)):
    """Rotation that maps the vector `onto` (default z) to a direction."""
    d, z = np.asarray(direction, dtype=float), np.asarray(onto, dtype=float)
    size = np.linalg.norm(d)
    if size == 0:
        return IDENTITY.copy()
    d = d / size
    if d @ z < -1 + 1e-12:
        across = np.array([1.0, 0, 0]) if abs(z[0]) < 0.9 else np.array([0, 1.0, 0])
        axis = np.cross(z, across)
        return np.concatenate([[0.0], axis / np.linalg.norm(axis)])
    return normalised(np.concatenate([[1 + d @ z], np.cross(z, d)]))


def from_matrix(matrix):
    """Rotation of a matrix whose columns are the rotated axes."""
    m = np.asarray(matrix, dtype=float)
    k = np.array([[m[0, 0] + m[1, 1] + m[2, 2], 0, 0, 0],
                  [m[2, 1] - m[1, 2], m[0, 0] - m[1, 1] - m[2, 2], 0, 0],
                  [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], 0],
                  [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1]]]) / 3
    return np.linalg.eigh(k)[1][:, -1]


def continuous(p):
    """Rotations (nt, 4) with signs chosen such that they are continuous."""
    signs = np.where(np.sum(p[1:]*p[:-1], axis=1) < 0, -1.0, 1.0)
    return p * np.concatenate([[1.0], np.cumprod(signs)])[:, None]
