# SPDX-License-Identifier: MIT
"""Drawings of the elements of mechanisms, for doc/mechanism_reference.md: meaning of its symbols, and signs.

Usage: .venv/bin/python tools/plots/elements.py PICTURE
"""

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from matplotlib.patches import Arc, Circle, Ellipse, Polygon, Rectangle

from plots.style import BLUE, GREEN, GREY, ORANGE, RED, plt, save

INK, LIGHT = "#222222", "#dde6ee"


def arrow(axes, start, end, text="", colour=INK, at=0.5, shift=(0.0, 0.08), width=1.3):
    axes.annotate("", xy=end, xytext=start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": width, "shrinkA": 0, "shrinkB": 0})
    if text:
        place = np.asarray(start) + at * (np.asarray(end) - np.asarray(start)) + shift
        axes.text(*place, text, color=colour, ha="center", va="center", fontsize=9)


def turn(axes, centre, radius, begin, end, text="", colour=RED, shift=1.25):
    """An angle, with its arrow at the end."""
    axes.add_patch(Arc(centre, 2 * radius, 2 * radius, theta1=begin, theta2=end, color=colour, lw=1.3))
    tip, before = np.radians(end), np.radians(end - 14)
    axes.annotate("", xy=centre + radius * np.array([np.cos(tip), np.sin(tip)]), xytext=centre + radius * np.array([np.cos(before), np.sin(before)]),
                  arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.3, "shrinkA": 0, "shrinkB": 0})
    middle = np.radians((begin + end) / 2)
    axes.text(*(centre + shift * radius * np.array([np.cos(middle), np.sin(middle)])), text, color=colour, ha="center", va="center", fontsize=9)


def body(axes, centre, angle, width=1.0, height=0.42, name=""):
    axes.add_patch(Ellipse(centre, 2 * width, 2 * height, angle=angle, facecolor=LIGHT, edgecolor=GREY, lw=1.0, zorder=0))
    axes.plot(*centre, marker="o", color=INK, ms=3)
    if name:
        direction = np.radians(angle)
        place = np.asarray(centre) + 0.55 * width * np.array([np.cos(direction), np.sin(direction)])
        axes.text(*place, name, ha="center", va="center", fontsize=8, color=GREY)


def point(axes, place, text, shift):
    axes.plot(*place, marker="o", color=BLUE, ms=4.5, zorder=5)
    axes.text(*(np.asarray(place) + shift), text, color=BLUE, ha="center", va="center", fontsize=9)


def joint(axes):
    """Points and displacements of a joint whose two sides are apart, so that both can be seen."""
    first, second = np.array([1.0, 1.2]), np.array([3.5, 1.9])
    p1, p2 = np.array([1.9, 1.45]), np.array([2.55, 1.95])
    body(axes, first, 12, 1.05, 0.45, "")
    body(axes, second, -5, 1.05, 0.45, "")
    axes.text(0.35, 1.55, "body 1", fontsize=8, color=GREY)
    axes.text(3.7, 2.5, "body 2", fontsize=8, color=GREY)
    arrow(axes, (0, 0), first, "$r_1$", shift=(-0.2, 0.05))
    arrow(axes, first, p1, "$A_1s_1'$", shift=(0.05, -0.28))
    arrow(axes, (0, 0), second, "$r_2$", at=0.72, shift=(0.12, -0.22))
    arrow(axes, second, p2, "$A_2s_2'$", shift=(0.15, 0.28))
    arrow(axes, first, p2, "$d$", colour=GREEN, at=0.45, shift=(-0.12, 0.18))
    point(axes, p1, "$P_1$", (0.22, -0.1))
    point(axes, p2, "$P_2$", (-0.1, 0.22))
    axes.text(-0.1, -0.2, "world", fontsize=8, color=GREY)
    axes.set(xlim=(-0.4, 4.8), ylim=(-0.4, 2.9), title="points of a joint; $d$ for ways")


def angle(axes):
    """The angle of a hinge and the torque on the second body."""
    origin = np.array([0.0, 0.0])
    for degrees, number, colour in (0, 1, INK), (35, 2, BLUE):
        x = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        y = np.array([-x[1], x[0]])
        arrow(axes, origin, 1.7 * x, f"$l_{number}$", colour, at=1.0, shift=0.16 * x)
        arrow(axes, origin, 1.7 * y, f"$m_{number}$", colour, at=1.0, shift=0.16 * y)
    axes.add_patch(Circle(origin, 0.11, facecolor="white", edgecolor=INK, lw=1.3, zorder=4))
    axes.plot(0, 0, ".", color=INK, ms=4, zorder=5)
    axes.text(-0.22, -0.22, "$k$", fontsize=9)
    turn(axes, origin, 1.15, 0, 35, r"$\varphi$", shift=1.16)
    turn(axes, origin, 0.62, 150, 330, "", GREEN)
    axes.text(0.0, -0.85, "positive torque on body 2,\nmotor or reaction", color=GREEN, ha="center", va="center", fontsize=8)
    axes.set(xlim=(-1.5, 2.1), ylim=(-1.15, 2.05), title=r"angle of a hinge about $k$ ($k$ to the viewer)")


def spring(axes):
    """Tension along the line of two points."""
    p1, p2 = np.array([0.9, 0.8]), np.array([3.5, 1.6])
    body(axes, (0.2, 0.6), 20, 0.95, 0.45)
    body(axes, (4.2, 1.8), 15, 0.95, 0.45)
    along = (p2 - p1) / np.linalg.norm(p2 - p1)
    across = np.array([-along[1], along[0]])
    length = np.linalg.norm(p2 - p1)
    at = np.concatenate(([0, 0.28], np.linspace(0.31, 0.69, 12), [0.72, 1.0]))
    side = np.concatenate(([0, 0], 0.14 * (-1.0) ** np.arange(12), [0, 0]))
    line = p1 + np.outer(at * length, along) + np.outer(side, across)
    axes.plot(*line.T, color=INK, lw=1.2)
    arrow(axes, p1, p1 + 0.62 * along, "", RED, width=2.0)
    arrow(axes, p2, p2 - 0.62 * along, "", RED, width=2.0)
    axes.text(*(p1 + 0.45 * along + 0.3 * across), "$f$", color=RED, fontsize=9, ha="center")
    axes.text(*(p2 - 0.45 * along + 0.25 * across), "$f$", color=RED, fontsize=9, ha="center")
    low1, low2 = p1 - 0.5 * across, p2 - 0.5 * across
    axes.annotate("", xy=low2, xytext=low1, arrowprops={"arrowstyle": "<|-|>", "color": GREY, "lw": 1.0, "shrinkA": 0, "shrinkB": 0})
    axes.text(*((low1 + low2) / 2 - 0.22 * across), r"$l$, growing at $\dot l$", color=GREY, ha="center", va="center", fontsize=9,
              rotation=np.degrees(np.arctan2(along[1], along[0])))
    point(axes, p1, "$P_1$", (-0.1, 0.42))
    point(axes, p2, "$P_2$", (0.12, -0.42))
    axes.set(xlim=(-1.0, 5.4), ylim=(-0.5, 2.9), title="spring, damper, distance: tension $f > 0$ pulls")


def disk(axes):
    """A disk that leans, seen along its track."""
    lean, radius = np.radians(25), 1.6
    up = np.array([-np.sin(lean), np.cos(lean)])
    axis = np.array([np.cos(lean), np.sin(lean)])
    centre = radius * up
    axes.plot([-2.4, 1.9], [0, 0], color=INK, lw=1.3)
    axes.add_patch(Rectangle((-2.4, -0.14), 4.3, 0.14, facecolor="#eeeeee", edgecolor="none", zorder=0))
    ends = np.array([centre - radius * up, centre + radius * up])
    axes.plot(*ends.T, color=BLUE, lw=5, solid_capstyle="round", alpha=0.45)
    axes.plot(*centre, "o", color=INK, ms=3)
    arrow(axes, centre, centre + 0.95 * axis, "$a$", BLUE, at=1.0, shift=(0.16, 0.08))
    arrow(axes, centre, (0, 0), "$y$", GREEN, at=0.5, shift=(0.22, 0.08))
    arrow(axes, (-1.9, 0), (-1.9, 0.95), "$n$", INK, at=1.0, shift=(0, 0.15))
    arrow(axes, (-1.9, 0), (-1.15, 0), "$t_1$", INK, at=1.0, shift=(0.18, 0.13))
    arrow(axes, (0, 0), (0, 0.8), "force of\nthe plane", RED, at=1.0, shift=(0.55, -0.05), width=2.0)
    axes.text(*(centre + 0.55 * radius * up + (-0.2, 0.0)), "$R$", fontsize=9, color=BLUE, ha="center")
    turn(axes, np.array([0.0, 0.0]), 1.05, 90, 115, "", GREY)
    axes.text(-0.28, 1.2, "lean", fontsize=8, color=GREY, ha="center")
    axes.set(xlim=(-2.5, 2.0), ylim=(-0.5, 3.35), title=r"a disk on a plane: $\sigma = a\cdot n$")


def knife(axes):
    """From above: a knife edge, steered or not."""
    heading = np.radians(20)
    forward = np.array([np.cos(heading), np.sin(heading)])
    left = np.array([-forward[1], forward[0]])
    tail, nose = np.array([0.4, 0.6]), np.array([0.4, 0.6]) + 2.6 * forward
    outline = np.array([tail + 0.28 * left, nose + 0.28 * left, nose - 0.28 * left, tail - 0.28 * left])
    axes.add_patch(Polygon(outline, facecolor=LIGHT, edgecolor=GREY, lw=1.0, zorder=0))
    steer = heading + np.radians(30)
    along = np.array([np.cos(steer), np.sin(steer)])
    across = np.array([-along[1], along[0]])
    for place, direction, colour in (tail, forward, INK), (nose, along, INK):
        axes.plot(*np.array([place - 0.42 * direction, place + 0.42 * direction]).T, color=colour, lw=3.5, solid_capstyle="round")
    arrow(axes, tail, tail + 1.0 * left, "$a$", BLUE, at=1.0, shift=(-0.12, 0.12))
    arrow(axes, nose, nose + 1.0 * across, "$a'$", BLUE, at=1.0, shift=(-0.14, 0.12))
    axes.plot(*np.array([nose, nose + 1.15 * forward]).T, color=GREY, lw=0.8, ls="--")
    turn(axes, nose, 0.85, np.degrees(heading), np.degrees(steer), "$f$", shift=1.25)
    arrow(axes, nose, nose + 0.95 * along, "", GREEN, width=1.8)
    axes.text(*(nose + 1.12 * along), r"$\dot P$", color=GREEN, fontsize=9, ha="center", va="center")
    point(axes, tail, "$P$", (0.3, -0.18))
    point(axes, nose, "$P$", (0.32, -0.12))
    axes.set(xlim=(-0.5, 4.7), ylim=(-0.1, 3.3), title=r"knife edges from above ($b$ to the viewer): $a\cdot\dot P = 0$")


def reactions(axes):
    """Side of a joint on which a reaction acts."""
    body(axes, (0.9, 1.3), 10, 1.0, 0.42)
    body(axes, (3.7, 1.3), -10, 1.0, 0.42)
    axes.text(0.5, 1.95, "body 1", fontsize=8, color=GREY)
    axes.text(3.6, 1.95, "body 2", fontsize=8, color=GREY)
    p1, p2 = np.array([1.85, 1.45]), np.array([2.75, 1.45])
    arrow(axes, p2, p2 + (0.75, 0.75), r"$F$ in the file", RED, at=1.0, shift=(0.35, 0.16), width=2.0)
    arrow(axes, p1, p1 - (0.75, 0.75), "$-F$", GREY, at=1.0, shift=(-0.15, -0.18), width=2.0)
    turn(axes, p2, 0.42, -150, 60, "$T$", shift=1.45)
    turn(axes, p1, 0.42, 30, 240, "$-T$", GREY, shift=1.55)
    point(axes, p1, "$P_1$", (0.3, -0.42))
    point(axes, p2, "$P_2$", (-0.2, -0.62))
    axes.set(xlim=(-0.4, 5.2), ylim=(0.1, 2.9), title="reaction of a joint: what body 1 does to body 2")


def draw(path):
    figure, panels = plt.subplots(2, 3, figsize=(11.0, 6.2), layout="constrained")
    for axes, panel in zip(panels.flat, (joint, angle, reactions, spring, disk, knife)):
        panel(axes)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.title.set_fontsize(9)
    save(figure, path)


if __name__ == "__main__":
    draw(sys.argv[1])
