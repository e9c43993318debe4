#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Evaluations of Radau IIA with 3, 5 and 7 stages, with the estimate and the controller of Hairer and Wanner's code (Solving
ODEs II, section IV.8): a stiff pendulum in polar coordinates and a rolling disk in minimal ones, against 7 stages with 1e-13.

Usage: bench/radau_orders.py    with an environment that has NumPy and mpmath
"""

import mpmath as mp
import numpy as np

G, EPSILON = 9.81, 2.2e-16


def tableau(s):
    """Nodes, A^-1, the real eigenvalue of A, and the weights of the estimate for the stages' increments."""
    mp.mp.dps = 60
    coefficients = mp.taylor(lambda x: mp.legendre(s, 2*x - 1) - mp.legendre(s - 1, 2*x - 1), 0, s)
    c = sorted(mp.re(r) for r in mp.polyroots(coefficients[::-1], maxsteps=500, extraprec=400))
    c[-1] = mp.mpf(1)
    powers = mp.matrix([[c[i]**j for j in range(s)] for i in range(s)])
    a = mp.matrix([[c[i]**(j + 1)/(j + 1) for j in range(s)] for i in range(s)])*powers**-1
    inverse = a**-1
    diagonal = 1/next(mp.re(e) for e in mp.eig(inverse)[0] if abs(mp.im(e)) < 1e-20)
    sums = mp.matrix([mp.mpf(1)/(q + 1) - (diagonal if q == 0 else 0) for q in range(s)])
    error = (mp.lu_solve(powers.T, sums).T - a[s - 1, :])*inverse
    return (*(np.array(x.tolist() if hasattr(x, "tolist") else x, dtype=float).squeeze() for x in (c, inverse)), float(diagonal),
            np.array(error.tolist(), dtype=float).ravel())


def derivative(f, t, y):
    """By complex steps."""
    return np.array([f(t, y + 1e-30j*unit).imag/1e-30 for unit in np.eye(len(y))]).T


class Radau:
    """One run: `y` at its end, `evaluations`, `steps`."""

    def __init__(self, f, y, t_end, rtol, s):
        self.c, self.inverse, self.diagonal, self.weights = tableau(s)
        self.f, self.s, self.rtol, self.n = f, s, rtol, len(y)
        self.most = 7 + (s - 3)*5//2
        self.enough = max(10*EPSILON/rtol, min(0.03, np.sqrt(rtol)))
        self.evaluations = self.steps = 0
        self.remainder = 1.0
        self.y = self.integrate(y, t_end)

    def rate(self, t, y):
        self.evaluations += 1
        return self.f(t, y)

    def solve(self, t, y, h, z, matrix, scale):
        """Simplified Newton iteration: the increments, or the factor for the step size."""
        self.remainder = max(self.remainder, EPSILON)**0.8
        self.theta, last_size, last_ratio = 1e-3, None, None
        for self.iterations in range(1, self.most + 1):
            residual = np.array([self.rate(t + self.c[i]*h, y + z[i]) for i in range(self.s)]) - self.inverse/h @ z
            change = (matrix @ residual.ravel()).reshape(z.shape)
            size = np.sqrt(np.mean((change/scale)**2))
            if not np.isfinite(size):
                return None, 0.5
            if 1 < self.iterations < self.most:
                ratio = size/last_size
                self.theta = ratio if last_ratio is None else np.sqrt(ratio*last_ratio)
                last_ratio = ratio
                if self.theta >= 0.99:
                    return None, 0.5
                self.remainder = self.theta/(1 - self.theta)
                left = self.most - 1 - self.iterations
                excess = self.remainder*size*self.theta**left/self.enough
                if excess >= 1:
                    return None, 0.8*max(1e-4, min(20, excess))**(-1/(4 + left))
            last_size = max(size, EPSILON)
            z = z + change
            if self.remainder*size <= self.enough:
                return z, 1.0
        return None, 0.5

    def go_on(self, ratio, past):
        """The last step's polynomial at the stages of one that is `ratio` times as long."""
        nodes, x = np.concatenate([[0], self.c]), 1 + self.c*ratio
        weights = np.array([[np.prod([(at - nodes[k])/(nodes[j] - nodes[k]) for k in range(self.s + 1) if k != j])
                             for j in range(self.s + 1)] for at in x])
        return weights @ past - past[-1]

    def integrate(self, y, t_end):
        t, h, order = 0.0, 1e-6, self.s + 1
        start, gradient, is_new = self.rate(t, y), derivative(self.f, t, y), True
        past, matrix, is_first, is_retry = None, None, True, False
        last_h, last_error = h, 1e-2
        while True:
            is_last = t + 1.0001*h >= t_end
            if is_last:
                h, matrix = t_end - t, None
            if matrix is None:
                matrix = np.linalg.inv(np.kron(self.inverse/h, np.eye(self.n)) - np.kron(np.eye(self.s), gradient))
                real = np.linalg.inv(np.eye(self.n)/(self.diagonal*h) - gradient)
            scale = self.rtol*(1 + np.abs(y))
            z = np.zeros((self.s, self.n)) if past is None else self.go_on(h/last_h, past)
            z, factor = self.solve(t, y, h, z, matrix, scale)
            error = 1.0
            if z is not None:
                sums = self.weights @ z/(self.diagonal*h)
                estimate = real @ (sums + start)
                error = max(np.sqrt(np.mean((estimate/scale)**2)), 1e-10)
                if error >= 1 and (is_first or is_retry):
                    estimate = real @ (sums + self.rate(t, y + estimate))
                    error = max(np.sqrt(np.mean((estimate/scale)**2)), 1e-10)
                safety = min(0.9, 0.9*(1 + 2*self.most)/(self.iterations + 2*self.most))
                quotient = max(1/8, min(5, error**(1/order)/safety))
                factor = 0.1 if is_first else 1/quotient
            if z is None or error >= 1:
                h, matrix, is_retry = factor*h, None, True
                if not is_new:
                    gradient, is_new = derivative(self.f, t, y), True
                continue
            self.steps += 1
            if not is_first:
                quotient = max(quotient, max(1/8, min(5, last_h/h*(error*error/last_error)**(1/order)/0.9)))
            last_h, last_error = h, max(1e-2, error)
            past = np.vstack([np.zeros(self.n), z])
            t, y, is_new = t + h, y + z[-1], False
            if is_last:
                return y
            start = self.rate(t, y)
            new = h/quotient if not is_retry else min(h, h/quotient)
            is_first = is_retry = False
            if self.theta > 1e-3:
                gradient, is_new, matrix = derivative(self.f, t, y), True, None
            if matrix is None or not 1 <= new/h <= 1.2:
                h, matrix = new, None


def pendulum(ratio):
    """Stretch of the spring, angle, their rates; half critically damped, slow start from 1 rad."""
    k = ratio**2*G

    def f(t, y):
        s, angle, sd, w = y
        return np.array([sd, w, (1 + s)*w**2 + G*np.cos(angle) - k*s - np.sqrt(k)*sd, -(2*sd*w + G*np.sin(angle))/(1 + s)])

    return f, np.array([G*np.cos(1)/k, 1, 0, 0]), 2.0


def disk():
    """Tilt, heading, centre, the rates of tilt and heading, the spin of a thin disk of 1 m and 1 kg."""

    def f(t, y):
        tilt, heading, _, _, tilting, turning, spin = y
        sine, cosine = np.sin(tilt), np.cos(tilt)
        return np.array([tilting, turning, -spin*np.cos(heading), -spin*np.sin(heading),
                         (turning**2*sine*cosine/4 - 1.5*spin*turning*sine - G*cosine)/1.25,
                         (2*spin*tilting - 2*turning*tilting*cosine)/sine, 2/3*tilting*turning*sine])

    return f, np.array([1.2, 0, 0, 0, 0, 0.3, 4]), 10.0


if __name__ == "__main__":
    for name, (f, start, end) in {"pendulum 1e2": pendulum(1e2), "pendulum 1e4": pendulum(1e4), "disk": disk()}.items():
        exact = Radau(f, start, end, 1e-13, 7).y
        for exponent in (4, 6, 8, 10):
            runs = [Radau(f, start, end, 10.0**-exponent, s) for s in (3, 5, 7)]
            print(f"| {name} | 1e-{exponent} |", *(f"{run.evaluations} | {np.abs(run.y - exact).max():.0e} |" for run in runs), flush=True)
