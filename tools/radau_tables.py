#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Prints the coefficients of Radau IIA with 5 and 7 stages as they stand in src/tandem/stepper/radau_tableau.f90, from the definition:
collocation at the zeros of P_s - P_(s-1), shifted to [0, 1] (Hairer, Wanner, Solving ODEs II, section IV.5).

Usage: tools/radau_tables.py    with an environment that has mpmath
"""

import mpmath as mp

mp.mp.dps = 80


def nodes(s):
    polynomial = mp.taylor(lambda x: mp.legendre(s, 2*x - 1) - mp.legendre(s - 1, 2*x - 1), 0, s)
    c = sorted(mp.re(root) for root in mp.polyroots(polynomial[::-1], maxsteps=1000, extraprec=600))
    c[-1] = mp.mpf(1)
    return c


def method(s):
    """Nodes, A, its real eigenvalue and one of each complex pair, the columns of T, the weights of the estimate for rates."""
    c = nodes(s)
    powers = mp.matrix([[x**j for j in range(s)] for x in c])
    a = mp.matrix([[x**(j + 1)/(j + 1) for j in range(s)] for x in c])*powers**-1
    values, vectors = mp.eig(a)
    real = next(k for k in range(s) if abs(mp.im(values[k])) < mp.mpf(10)**-40)
    pairs = sorted((k for k in range(s) if mp.im(values[k]) < -mp.mpf(10)**-40), key=lambda k: -mp.re(values[k]))
    columns = [[mp.re(vectors[i, real]/vectors[s - 1, real]) for i in range(s)]]
    for k in pairs:
        # The last stage has the component 1; then the eigenvector of a + i b is that of the second column less i times the third.
        vector = [vectors[i, k]/vectors[s - 1, k] for i in range(s)]
        columns += [[mp.re(x) for x in vector], [-mp.im(x) for x in vector]]
    diagonal = mp.re(values[real])
    moments = mp.matrix([mp.mpf(1)/(q + 1) - (diagonal if q == 0 else 0) for q in range(s)])
    weights = mp.lu_solve(powers.T, moments) - a[s - 1, :].T
    return c, a, diagonal, [values[k] for k in pairs], columns, weights/diagonal


def lay_out(numbers):
    """Numbers as lines of Fortran, as many in each as fit."""
    lines, line = [], " "*8
    for text in (mp.nstr(x, 20, min_fixed=-4, max_fixed=4) + "_wp" for x in numbers):
        if len(line) + len(text) > 120:
            lines.append(line.rstrip() + " &")
            line = " "*8
        line += text + ", "
    return "\n".join([*lines, line.rstrip(", ")])


def parameter(name, s, shape, numbers):
    size = ", ".join([str(s)]*shape)
    opening, closing = ("reshape([", f"], [{size}])") if shape == 2 else ("[", "]")
    return f"    real(wp), parameter :: {name}{s}({size}) = {opening} &\n{lay_out(numbers)}{closing}"


if __name__ == "__main__":
    for s in (5, 7):
        c, a, diagonal, pairs, columns, weights = method(s)
        t = mp.matrix(columns).T
        inverse = t**-1
        everything = range(s)
        print(f"    real(wp), parameter :: diagonal{s} = {mp.nstr(diagonal, 20)}_wp")
        print(f"    complex(wp), parameter :: pairs{s}({len(pairs)}) = [ &")
        print(", &\n".join(f"        ({mp.nstr(mp.re(x), 20)}_wp, {mp.nstr(mp.im(x), 20)}_wp)" for x in pairs) + "]")
        print(parameter("c", s, 1, c))
        print(parameter("a", s, 2, [a[i, j] for i in everything for j in everything]))
        print(parameter("t", s, 2, [t[i, j] for i in everything for j in everything]))
        print(parameter("t_inverse", s, 2, [inverse[i, j] for i in everything for j in everything]))
        print(parameter("weight", s, 1, list(weights)))
