# SPDX-License-Identifier: MIT
"""Short animations of the shipped scenes, as GIF."""

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.transforms import Bbox

from .files import read_result
from .style import BLUE, GREY, ORANGE, plt

FRAMES, PER_SECOND = 90, 12


def rotation(p):
    """A(p) of Euler parameters (e0, e)."""
    e0, e = p[0], p[1:]
    tilde = np.array([[0, -e[2], e[1]], [e[2], 0, -e[0]], [-e[1], e[0], 0]])
    return (e0**2 - e @ e) * np.eye(3) + 2 * np.outer(e, e) + 2 * e0 * tilde


def at_frames(result, t_end=None):
    """Indices of the rows that are shown, evenly spread in time."""
    times = np.linspace(result.time[0], t_end or result.time[-1], FRAMES)
    return np.searchsorted(result.time, times - 1e-9).clip(0, len(result.time) - 1)


def space(figure, limits):
    axes = figure.add_subplot(projection="3d", proj_type="persp")
    axes.set(xlim=limits[0], ylim=limits[1], zlim=limits[2], xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.set_box_aspect([np.ptp(limit) for limit in limits])
    for axis in axes.xaxis, axes.yaxis, axes.zaxis:
        axis.pane.set_visible(False)
    axes.tick_params(labelsize=7)
    axes.zaxis.labelpad = -6
    return axes


def fit(figure, show, rows):
    """Axes in space as large as they can be with all their labels in the picture, at the first, a middle and the last frame."""
    axes, = figure.axes
    aspect = np.array([np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()), np.ptp(axes.get_zlim())])
    for zoom in np.arange(1.25, 0.4, -0.05):
        axes.set_box_aspect(aspect, zoom=zoom)
        boxes = []
        for row in rows[[0, len(rows) // 2, -1]]:
            show(row)
            figure.canvas.draw()
            boxes.append(axes.get_tightbbox())
        box = Bbox.union(boxes).transformed(figure.transFigure.inverted())
        if max(box.width, box.height) <= 0.98:
            break
    place = axes.get_position(original=True)
    axes.set_position([place.x0 + 0.5 - (box.x0 + box.x1) / 2, place.y0 + 0.5 - (box.y0 + box.y1) / 2, place.width, place.height])


def circle(n=41):
    angle = np.linspace(0, 2 * np.pi, n)
    return np.stack([np.zeros(n), np.cos(angle), np.sin(angle)])


def draw_disk(result, picture):
    radius = result.scene["model"]["radius"]
    r, p, a = result.columns("rx", "ry", "rz"), result.columns("e0", "e1", "e2", "e3"), result.columns("a1", "a2")
    rows = at_frames(result, min(result.time[-1], 12.0))
    contact = np.array([r[i] + rotation(p[i]) @ [0, *a[i]] for i in range(rows[-1] + 1)])
    low, high = r[: rows[-1]].min(axis=0), r[: rows[-1]].max(axis=0)
    limits = [(low[0] - 1.2, high[0] + 1.2), (low[1] - 1.2, high[1] + 1.2), (0, 2.1)]
    figure = plt.figure(figsize=(4.8, 3.0))
    axes = space(figure, limits)
    axes.view_init(elev=28, azim=-20)
    axes.set_zticks([0, 1, 2])
    axes.tick_params(axis="z", labelsize=7)
    track, = axes.plot([], [], [], color=ORANGE, linewidth=1)
    rim, = axes.plot([], [], [], color=BLUE, linewidth=2)
    spokes = [axes.plot([], [], [], color=BLUE, linewidth=0.8)[0] for _ in range(2)]
    clock = figure.text(0.03, 0.93, "", fontsize=9)

    def show(row):
        turn = radius * rotation(p[row])
        rim.set_data_3d(*(r[row][:, None] + turn @ circle()))
        for spoke, direction in zip(spokes, ([0, 1, 0], [0, 0, 1]), strict=True):
            ends = np.outer(turn @ direction, [-1, 1])
            spoke.set_data_3d(*(r[row][:, None] + ends))
        track.set_data_3d(*contact[: row + 1].T)
        clock.set_text(f"t = {result.time[row]:4.1f} s")

    fit(figure, show, rows)
    animate(figure, show, rows, picture)


def draw_vehicle(result, picture):
    half = result.scene["model"]["half_length"]
    rows = at_frames(result)
    figure, axes = plt.subplots(figsize=(4.8, 2.4), layout="constrained")
    axes.plot(result["x1"], result["y1"], color=GREY, linewidth=0.7)
    bodies = [axes.plot([], [], color=colour, linewidth=2)[0] for colour in (BLUE, ORANGE)]
    wheels, = axes.plot([], [], "o", color="black", markersize=3)
    axes.set(xlabel="x [m]", ylabel="y [m]")
    # Across, a metre is longer than along: the lane change is 4 m on 150 m.
    axes.set_ylim(-1.5, 5.5)
    clock = axes.text(0.02, 0.9, "", transform=axes.transAxes)
    outline = np.array([[-1, -0.3], [1, -0.3], [1, 0.3], [-1, 0.3], [-1, -0.3]]) * [half * 0.92, 2.0]

    def show(row):
        ends = []
        for body, number in zip(bodies, "12", strict=True):
            x, y, phi = (result[name + number][row] for name in ("x", "y", "phi"))
            turn = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])
            body.set_data(*(turn @ outline.T + [[x], [y]]))
            ends += [np.array([x, y]) + half * turn[:, 0], np.array([x, y]) - half * turn[:, 0]]
        wheels.set_data(*np.array(ends).T)
        middle = result["x1"][row]
        axes.set_xlim(middle - 26, middle + 14)
        clock.set_text(f"t = {result.time[row]:4.1f} s")

    animate(figure, show, rows, picture)


def draw_motorcycle(result, picture):
    model = result.scene["model"]
    phi = model["fork_angle"]
    wheel, back, half = (model.get(name, default) for name, default in
                         (("wheel_radius", 0.3), ("rear_length", 0.6), ("half_track", 0.5)))
    top = np.array([0.0, model.get("fork_forward", 0.6), model.get("fork_height", 0.6)])
    along = np.array([0.0, -np.sin(phi), np.cos(phi)])
    r, p, s = result.columns("rx", "ry", "rz"), result.columns("e0", "e1", "e2", "e3"), result["s"]
    rows = at_frames(result)
    figure = plt.figure(figsize=(4.8, 3.2))
    # Along the road the picture follows; across it stands still, so that the lane change shows.
    axes = space(figure, [(min(0, r[:, 0].min()) - 1, max(0, r[:, 0].max()) + 1), (-1.6, 1.6), (0, 1.3)])
    axes.view_init(elev=24, azim=-62)
    axes.set_zticks([0, 1])
    frame, = axes.plot([], [], [], color=BLUE, linewidth=2)
    fork, = axes.plot([], [], [], color=ORANGE, linewidth=2)
    wheels = [axes.plot([], [], [], color="black", linewidth=1.5)[0] for _ in range(3)]
    track, = axes.plot([], [], [], color=GREY, linewidth=1)
    clock = figure.text(0.03, 0.93, "", fontsize=9)

    def show(row):
        turn, centre = rotation(p[row]), r[row]

        def place(*points):
            return (centre[:, None] + turn @ np.array(points).T)

        left, right, axle = [-half, -back, 0], [half, -back, 0], [0, -back, 0]
        hub = top - s[row] * along
        frame.set_data_3d(*place(left, right, axle, [0, 0, 0], top))
        fork.set_data_3d(*place(top, hub))
        for line, middle in zip(wheels, (left, right, hub), strict=True):
            line.set_data_3d(*(place(middle) + turn @ (wheel * circle())))
        past = r[: row + 1]
        past = past[past[:, 1] > centre[1] - 1.6]
        track.set_data_3d(past[:, 0], past[:, 1], np.zeros(len(past)))
        axes.set(ylim=(centre[1] - 1.6, centre[1] + 1.6))
        clock.set_text(f"t = {result.time[row]:4.1f} s")

    fit(figure, show, rows)
    animate(figure, show, rows, picture)


def animate(figure, show, rows, picture):
    """Write a GIF, its colours reduced so that it stays small."""
    FuncAnimation(figure, show, frames=rows, init_func=lambda: None).save(picture, SmallWriter(fps=PER_SECOND), dpi=80)
    plt.close(figure)


class SmallWriter(PillowWriter):
    """One palette for all frames, so that static parts cost nothing."""

    def finish(self):
        frames = [frame.convert("RGB") for frame in self._frames]
        palette = frames[len(frames) // 2].quantize(128, dither=0)
        frames = [frame.quantize(palette=palette, dither=0) for frame in frames]
        frames[0].save(self.outfile, save_all=True, append_images=frames[1:], duration=int(1000 / self.fps), loop=0, optimize=True)


DRAW = {"rolling_disk": draw_disk, "articulated_vehicle": draw_vehicle, "motorcycle": draw_motorcycle}


def draw(path, picture):
    """Animate a result; returns the problem if this is impossible."""
    result = read_result(path)
    model = result.scene.get("scene", {}).get("model")
    if model not in DRAW:
        return f"there is no animation of the model {model}; there are {', '.join(DRAW)}"
    return DRAW[model](result, picture)
