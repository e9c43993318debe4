# SPDX-License-Identifier: MIT
"""Pictures and pages: that they are made of what is in the files, and what is refused. The page in a browser is in test/page."""

import json
import os
import re
import struct
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
import tandem
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.lines import Line2D
from models import ROOT, START, Pendulum
from tandem import motion, viewer
from tandem.study import read_study
from tandem.plot import style
from tandem.plot.data import motion_of
from tandem.viewer import packing, rotations
from tandem.viewer.draw import draw
from tandem.viewer.gltf import glb
from tandem.viewer.html import channels_of, page

SCENES = sorted(path.stem for path in (ROOT / "scenes").glob("*.toml"))
FIELDS = ["q", "qd", "qdd", "position_error", "velocity_error", "acceleration_error", "kinetic_energy", "potential_energy", "step", "chart"]
RESULTS = {}


def result(scene, **settings):
    """A run of a shipped scene, once for all tests; half a second of it is enough to be looked at."""
    key = scene, str(settings)
    if key not in RESULTS:
        RESULTS[key] = tandem.run_scene(scene, {"time.end": 0.03 if "andrews" in scene else 0.5, **settings}, error=False)
    return RESULTS[key]


class Folder(unittest.TestCase):
    def setUp(self):
        place = tempfile.TemporaryDirectory()
        self.addCleanup(place.cleanup)
        self.folder = Path(place.name)

    def tandem(self, *words, code=0):
        done = subprocess.run([sys.executable, "-m", "tandem", *map(str, words)], cwd=self.folder, capture_output=True, text=True)
        self.assertEqual(done.returncode, code, done.stderr)
        return done.stderr if code else done.stdout


class Plots(Folder):
    def test_every_kind(self):
        full = result("motorcycle", **{"output.fields": FIELDS})
        for kind in ("overview", "tracks", "coordinates", "errors", "energies", "phase"):
            with self.subTest(kind):
                tandem.plot.save(getattr(tandem.plot, kind)(full), self.folder / f"{kind}.png")
                self.assertGreater((self.folder / f"{kind}.png").stat().st_size, 10000)
        tandem.plot.sensors(result("slider_crank"))

    def test_every_scene(self):
        for scene in SCENES:
            with self.subTest(scene):
                tandem.plot.save(tandem.plot.overview(result(scene)), self.folder / "picture.svg")

    def test_what_a_picture_shows(self):
        one = result("slider_crank")
        figure = tandem.plot.coordinates(one, ["rod.x", "d(rod.x)", "stroke displacement"])
        panels = figure.axes
        self.assertEqual([axes.get_ylabel() for axes in panels], ["[m]", "d(rod.x) [m/s]"])
        for line, values in ((panels[0].lines[0], one["rod.x"]), (panels[0].lines[1], one.sensors["stroke"]["displacement"].values),
                             (panels[1].lines[0], one.qd[:, one.names.index("rod.x")])):
            self.assertGreaterEqual(len(line.get_xdata()), motion.LEAST_POINTS)
            self.assertTrue(np.array_equal(line.get_ydata()[np.isin(line.get_xdata(), one.time)], values))
        self.assertEqual(panels[-1].get_xlabel(), "time [s]")
        self.assertEqual(panels[0].lines[0].get_color(), style.BLUE)

    def test_a_track(self):
        one = result("a04_bricard")
        lines = tandem.plot.tracks(one, plane="yz").axes[0].lines
        rows = np.isin(motion.with_rows_between(one).time, one.time)
        for drawn, values in zip(lines[0].get_data(), one.sensors["p"]["position"].values[:, 1:].T, strict=True):
            self.assertTrue(np.array_equal(drawn[rows], values))
        for plane in ("xx1", "ab", "x"):
            with self.assertRaises(ValueError):
                tandem.plot.tracks(one, plane=plane)

    def test_tracks_that_move(self):
        """Of many bodies those that extend farthest, in their order; the others are counted."""
        time = np.linspace(0, 1, 20)
        names = [f"b{k}.{axis}" for k in range(12) for axis in "xy"]
        q = np.stack([(0.0 if k < 6 else k)*time for k in range(12) for _ in "xy"], axis=1)
        axes = tandem.plot.tracks(tandem.Result(time, names, ["m"]*24, q)).axes[0]
        words = [text.get_text() for text in axes.get_legend().get_texts()]
        self.assertEqual(sorted(words), sorted(["start", *(f"b{k}" for k in range(7, 12)), "and 7 more"]))

    def test_several_are_compared(self):
        pair = [result("motorcycle"), result("motorcycle_chopper")]
        lines = tandem.plot.coordinates(pair, ["s"]).axes[0].lines
        self.assertEqual([line.get_linestyle() for line in lines], ["-", "--"])
        words = [text.get_text() for text in tandem.plot.coordinates(pair, ["s"]).axes[0].get_legend().get_texts()]
        self.assertEqual(words, ["motorcycle", "motorcycle_chopper"])

    def test_of_a_solution(self):
        solution = tandem.solve(Pendulum(), (0, 2), *START)
        drawn = solution.plot().axes[0].lines[0].get_ydata()
        self.assertTrue(np.array_equal(drawn[np.isin(motion.with_rows_between(motion_of(solution)).time, solution.t)], solution["y"]))

    def test_files(self):
        tandem.run_scene("slider_crank", {"time.end": 0.2}, self.folder / "a.h5", error=False)
        self.assertEqual(self.tandem("plot", "a.h5").strip(), "a.png")
        self.tandem("plot", "a.h5", "--output", "a.svg", "--kind", "coordinates", "--names", "rod.x,rod.angle")
        text = (self.folder / "a.svg").read_text()
        self.assertIn("rod.angle [rad]", text)
        self.tandem("plot", "a.h5", "--output", "b.svg", "--kind", "coordinates", "--names", "rod.x,rod.angle")
        self.assertEqual(text, (self.folder / "b.svg").read_text())
        self.tandem("plot", "a.h5", "a.h5", "--output", "a.pdf")
        self.assertEqual((self.folder / "a.pdf").read_bytes()[:5], b"%PDF-")

    def test_energies(self):
        """Of the diagnostics, of a sensor, of the balance, or of bodies: the first that are in the file; their sum less the work."""
        free = {"output.fields": ["q", "qd"]}
        of_balance = result("slider_crank", **free, **{"results.balance": True})
        first, second = tandem.plot.energies(of_balance).axes
        held = of_balance.groups["balance"]["balance"]
        for line, name in zip(first.lines, ("kinetic", "potential"), strict=False):
            self.assertTrue(np.array_equal(line.get_ydata(), held[name].values), name)
        self.assertEqual(len(first.lines), 3)
        scale = np.abs(held["kinetic"].values).max()
        self.assertLess(np.abs(second.lines[1].get_ydata() - held["residual"].values).max(), 1e-12*scale)
        of_bodies = result("slider_crank", **free, **{"results.bodies": "all"})
        drawn = tandem.plot.energies(of_bodies).axes[0].lines[0].get_ydata()
        self.assertLess(np.abs(drawn - held["kinetic"].values).max(), 1e-12*scale)
        self.assertNotIn("change of the energy", " ".join(axes.get_title() for axes in tandem.plot.overview(of_bodies).axes))
        self.assertIn("change of the energy", " ".join(axes.get_title() for axes in tandem.plot.overview(of_balance).axes))

    def test_studies(self):
        """Error against run time of the rows of a study, of its .h5 and of its .csv; several studies have a panel each."""
        subprocess.run([tandem.program_path(), "study", "precision", "articulated_vehicle", "--set", "time.end=0.5", "--steppers",
                        "rk4,dop853", "--samples", "2", "--repeats", "1", "--budget", "0.05"], cwd=self.folder, check=True, capture_output=True)
        name = "study/precision_articulated_vehicle"
        study = read_study(self.folder / f"{name}.h5")
        for ending in (".h5", ".csv"):
            figure = tandem.plot.precision(self.folder / f"{name}{ending}")
            lines = [line for line in figure.axes[0].lines if len(line.get_xdata()) > 1]
            rows = (study.columns["stepper"] == "rk4") & (study.columns["error_q"] > 0)
            self.assertTrue(np.array_equal(lines[0].get_xdata(), study.columns["cpu_seconds"][rows]))
            self.assertTrue(np.array_equal(lines[0].get_ydata(), study.columns["error_q"][rows]))
        self.assertEqual(self.tandem("plot", f"{name}.h5").strip(), "precision_articulated_vehicle.png")
        self.tandem("plot", f"{name}.h5", f"{name}.csv", "--output", "two.svg", "--title", "a $title")
        self.assertEqual((self.folder / "two.svg").read_text().count(">articulated vehicle"), 2)
        tandem.run_scene("slider_crank", {"time.end": 0.2}, self.folder / "a.h5", error=False)
        (self.folder / "empty.csv").write_text((self.folder / f"{name}.csv").read_text().partition("\n")[0] + "\n")
        (self.folder / "cut.csv").write_text((self.folder / f"{name}.csv").read_text()[:300])
        for words, told in (([f"{name}.h5", "a.h5"], "not a study"), ([f"{name}.h5", "--names", "x"], "neither"), (["empty.csv"], "not a precision study"),
                            (["cut.csv"], "cut.csv "), ([f"{name}.h5", "--kind", "tracks"], "one kind")):
            with self.subTest(words):
                self.assertIn(told, self.tandem("plot", *words, code=2))

    def test_what_is_refused(self):
        tandem.run_scene("slider_crank", {"time.end": 0.2}, self.folder / "a.h5", error=False)
        for words, told in ((["nothing.h5"], "nothing.h5"), (["a.h5", "--kind", "pie"], "no kind 'pie'"),
                            (["a.h5", "--kind", "coordinates", "--names", "rod.z"], "rod.x"), (["a.h5", "--output", "a.gif"], ".svg"),
                            (["a.h5", "--kind", "energies"], "kinetic_energy"), (["a.h5", "--kind", "reactions"], "no reactions"),
                            (["a.h5", "--kind", "errors", "--names", "x"], "not for the kind")):
            with self.subTest(words):
                self.assertIn(told, self.tandem("plot", *words, code=2))

    def test_the_program_calls_it(self):
        tandem.run_scene("slider_crank", {"time.end": 0.2}, self.folder / "a.h5", error=False)
        environment = {**os.environ, "TANDEM_PYTHON": sys.executable}
        done = subprocess.run([tandem.program_path(), "plot", "a.h5", "--output", "with blank.png"], cwd=self.folder, env=environment,
                              capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stdout), (0, "with blank.png\n"), done.stderr)
        for python, told in (("/nowhere/python3", "Python cannot be started"), (None, "needs the package tandem")):
            if python is None:
                # An interpreter of its own, which has no packages.
                bare = self.folder / "bare"
                subprocess.run([sys.executable, "-m", "venv", "--without-pip", bare], check=True)
                python = bare / "bin" / "python3"
            alone = {name: value for name, value in environment.items() if name != "PYTHONPATH"} | {"TANDEM_PYTHON": str(python)}
            done = subprocess.run([tandem.program_path(), "view", "a.h5"], cwd=self.folder, env=alone, capture_output=True, text=True)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(told, done.stderr)
            self.assertIn("make python", done.stderr)


class Legends(unittest.TestCase):
    """Six entries at most, outside of the axes; what is left is counted, and no name takes the room of a picture."""

    def robot(self, bodies=30):
        """A chain that falls, of bodies with long names."""
        mechanism = tandem.Mechanism({"gravity.vector": [0, 0, -9.81], "time.end": 0.2, "solver.stepper": "dop853", "solver.rtol": 1e-6})
        names = [f"left_front_leg_{k}_lower_actuator_housing_link" for k in range(bodies)]
        for k, name in enumerate(names):
            mechanism.add(f"body.{name}", mass=1.0, inertia=[0.1, 0.1, 0.1], position=[0.3*k, 0, 0], velocity=[0, 0, 0.1*k])
            mechanism.add(f"sensor.{name}_origin", joint=f"{name}_joint") if k else None
            if k:
                mechanism.add(f"joint.{name}_joint", type="revolute", bodies=[names[k - 1], name], at=[0.3*k - 0.15, 0, 0], axis=[0, 1, 0])
        return mechanism.run({"initial.assemble": True, "results.joints": "all"}, error=False)

    def layout(self, figure):
        """The rendered figure, and its axes that show something."""
        FigureCanvasAgg(figure).draw()
        return [axes for axes in figure.axes if axes.axison]

    def check(self, figure, most=6):
        panels = self.layout(figure)
        renderer = figure.canvas.get_renderer()
        for axes in panels:
            box = axes.get_window_extent(renderer)
            if (legend := axes.get_legend()) is None:
                continue
            words = [text.get_text() for text in legend.get_texts()]
            counted = [word for word in words if word.startswith("and ")]
            self.assertLessEqual(len(words), most + len(counted), words)
            place = legend.get_window_extent(renderer)
            self.assertGreaterEqual(place.y0, box.y1 - 1, words)
            self.assertLessEqual(place.x1, figure.bbox.x1, words)
            for other in panels:
                if other is not axes:
                    self.assertFalse(place.overlaps(other.get_window_extent(renderer)), words)
            offset = axes.yaxis.get_offset_text()
            self.assertFalse(offset.get_text() and place.overlaps(offset.get_window_extent(renderer)), words)
            title = axes.title.get_window_extent(renderer)
            self.assertFalse(axes.get_title() and place.overlaps(title), words)
        return panels

    def test_a_robot_of_many_bodies(self):
        one = self.robot()
        figure = tandem.plot.overview(one)
        panels = self.check(figure)
        columns = 3
        for axes in panels:
            self.assertGreater(axes.get_position().width, 0.6/columns)
            self.assertGreater(axes.get_position().height, 0.2)
        words = [text.get_text() for text in panels[0].get_legend().get_texts()]
        self.assertIn("and 25 more", words)
        for kind in (tandem.plot.sensors, tandem.plot.reactions):
            with self.subTest(kind.__name__):
                self.check(kind(one))
        names = [name for name in one.names if name.endswith(".z")]
        figure = tandem.plot.coordinates(one, names)
        self.check(figure)
        self.assertIn("and 24 more", [text.get_text() for text in figure.axes[0].get_legend().get_texts()])

    def test_every_scene(self):
        for scene in SCENES:
            with self.subTest(scene):
                self.check(tandem.plot.overview(result(scene)))

    def test_long_names_are_shortened(self):
        self.assertEqual(style.shortened("rod.x", 1.0), "rod.x")
        name = "left_front_leg_lower_actuator_housing_link.z"
        short = style.shortened(name, 1.5)
        self.assertLessEqual(style.width_of(short), 1.5)
        begin, _, end = short.partition("\u2026")
        self.assertTrue(name.startswith(begin) and name.endswith(end) and len(begin) > 5 and len(end) > 5, short)

    def test_what_is_left_is_counted(self):
        figure, axes = style.new_figure()
        style.legend(axes[0, 0], [(Line2D([], []), f"line {k}") for k in range(9)], more=2)
        words = [text.get_text() for text in axes[0, 0].get_legend().get_texts()]
        self.assertEqual(sorted(words), sorted([f"line {k}" for k in range(6)] + ["and 5 more"]))


class Motions(unittest.TestCase):
    def test_lines_between_rows(self):
        """A picture of a few steps shows the motion, and not the polygon of its rows: against a run of small steps."""
        rough = motion_of(tandem.solve(Pendulum(), (0, 10), *START, rtol=1e-10, stepper="dop853"))
        drawn = motion.with_rows_between(rough)
        self.assertLess(len(rough.time), motion.LEAST_POINTS/3)
        self.assertLess(np.diff(drawn.time).max(), 10/motion.LEAST_POINTS*(1 + 1e-9))
        self.assertTrue(np.array_equal(drawn.q[np.isin(drawn.time, rough.time)], rough.q))
        fine = tandem.solve(Pendulum(), (0, 10), *START, rtol=1e-12, max_step=1/120, t_eval=drawn.time)
        half = np.diff(rough.time).max()/2
        # As below; of velocities the third degree is of accelerations, whose fourth derivative is of the order of the fifth.
        self.assertLess(np.abs(drawn.q - fine.q).max(), 3e4*half**6/720)
        self.assertLess(np.abs(drawn.qd - fine.qd).max(), 1e4*half**4/24)
        line = tandem.plot.coordinates(rough, ["x"]).axes[0].lines[0]
        self.assertTrue(np.array_equal(line.get_ydata(), drawn["x"]))
        # Rows that are near enough stay as they are.
        self.assertIs(motion.with_rows_between(drawn), drawn)

    def test_a_jump_is_drawn_as_one(self):
        """A velocity that an event has changed: the line goes to the state before, on both sides without overshoot."""
        time = np.array([0.0, 1.0, 2.0])
        one = tandem.Result(time, ["x"], ["m"], q=np.array([[0.0], [3.0], [1.0]]), qd=np.array([[3.0], [-2.0], [-2.0]]),
                            qdd=np.zeros((3, 1)), sensors={"p": {"displacement": tandem.result.Series(np.array([0.0, 3, 1])),
                                                                 "speed": tandem.result.Series(np.array([3.0, -2, -2]))}},
                            events={"time": np.array([0.5, 1.0]), "q": np.array([[1.5], [3.0]]), "qd": np.array([[3.0], [3.0]])})
        drawn = motion.with_rows_between(one)
        expected = np.where(drawn.time <= 1, 3*drawn.time, 5 - 2*drawn.time)
        self.assertLess(np.abs(drawn["x"] - expected).max(), 1e-12)
        self.assertLess(np.abs(drawn.sensors["p"]["displacement"].values - expected).max(), 1e-12)
        at = np.flatnonzero(drawn.time == 1.0)
        self.assertEqual(drawn.qd[at, 0].tolist(), [3.0, -2.0])
        frames = np.linspace(0, 2, 33)
        found = motion.resampled(one, frames)["x"]
        self.assertLess(np.abs(found - np.where(frames <= 1, 3*frames, 5 - 2*frames)).max(), 1e-12)

    def test_between_rows(self):
        """A polynomial of degree 5 between rows, against a run of small steps."""
        rough = motion_of(tandem.solve(Pendulum(), (0, 10), *START, rtol=1e-10))
        times = np.linspace(0, 10, 601)
        fine = tandem.solve(Pendulum(), (0, 10), *START, rtol=1e-12, max_step=1/120, t_eval=times)
        fifth = motion.interpolated(rough.time, rough.q, rough.qd, rough.qdd, times)
        third = motion.interpolated(rough.time, rough.q, rough.qd, None, times)
        # Hermite's error: the sixth derivative of the motion, 3e4 at most, times (h/2)^6/720; the fourth, 1e3, times (h/2)^4/24.
        half = np.diff(rough.time).max()/2
        self.assertLess(np.abs(fifth - fine.q).max(), 3e4*half**6/720)
        self.assertLess(np.abs(third - fine.q).max(), 1e3*half**4/24)
        self.assertTrue(np.allclose(motion.interpolated(rough.time, rough.q, rough.qd, rough.qdd, rough.time), rough.q, atol=1e-14, rtol=0))

    def test_polynomials_are_met_exactly(self):
        time = np.array([0.0, 0.7, 2.0])
        for degree, given in ((5, True), (3, False)):
            p = np.polynomial.Polynomial(np.arange(1, degree + 2) - 2.5)
            wanted = np.linspace(0, 2, 50)
            found = motion.interpolated(time, p(time)[:, None], p.deriv()(time)[:, None], p.deriv(2)(time)[:, None] if given else None, wanted)
            self.assertLess(np.abs(found[:, 0] - p(wanted)).max(), 1e-12)

    def test_frames(self):
        self.assertEqual(motion.frame_times(0, 2).size, 121)
        self.assertEqual(motion.frame_times(1, 1).tolist(), [1, 1])
        self.assertEqual(motion.frame_times(0, 1e9).size, motion.MOST_FRAMES + 1)

    def test_packing(self):
        random = np.random.default_rng(1)
        channels = np.stack([np.sin(np.linspace(0, 20, 500)), random.normal(size=500), np.zeros(500), 1e6 + np.arange(500.0)])
        steps = packing.steps_of(channels, 1e-7)
        found = packing.unpacked(packing.packed(channels, steps), steps, 500)
        self.assertTrue((np.abs(found - channels).max(axis=1) <= 0.5001*steps).all())
        with self.assertRaises(ValueError):
            packing.packed(channels, steps/1000)

    def test_rotations(self):
        random = np.random.default_rng(2)
        p, q, x = rotations.normalised(random.normal(size=4)), rotations.normalised(random.normal(size=4)), random.normal(size=3)
        self.assertTrue(np.allclose(rotations.rotated(rotations.product(p, q), x), rotations.rotated(p, rotations.rotated(q, x))))
        matrix = np.stack([rotations.rotated(p, axis) for axis in np.eye(3)], axis=1)
        self.assertTrue(np.allclose(abs(rotations.from_matrix(matrix) @ p), 1))
        for direction in (x, [0, 0, 1], [0, 0, -1], [1, 0, 0]):
            direction = np.array(direction)/np.linalg.norm(direction)
            self.assertTrue(np.allclose(rotations.rotated(rotations.rotation_onto(direction), [0, 0, 1]), direction))
        self.assertTrue(np.allclose(rotations.rotated(rotations.from_vector([0, 0, np.pi/2]), [1, 0, 0]), [0, 1, 0]))


class Drawings(unittest.TestCase):
    def test_poses_are_those_of_the_file(self):
        one = result("a04_bricard")
        drawing = draw(one)
        for part in (0, 0.3, 1):
            f = round(part*(drawing.times.size - 1))
            row = np.argmin(np.abs(one.time - drawing.times[f]))
            body = drawing.body("b3")
            # Rows are steps of an accurate run: the frame is at most half a step from one.
            near = np.abs(one.time[row] - drawing.times[f])*np.abs(one.qd[row]).max()*1.5 + 1e-9
            self.assertLess(np.abs(body.position[f] - one.columns("b3.x", "b3.y", "b3.z")[row]).max(), near)
            p = one.columns("b3.e0", "b3.e1", "b3.e2", "b3.e3")[row]
            self.assertLess(min(np.abs(body.rotation[f] - p).max(), np.abs(body.rotation[f] + p).max()), near)

    def test_joints_hold_in_the_drawing(self):
        """The point of the drawing is the same on both bodies at every frame."""
        for scene, first, second, at in (("a04_bricard", "b2", "b3", [1, -1, 0]), ("slider_crank", "crank", "rod", None)):
            one = result(scene, **{"solver.rtol": 1e-10})
            drawing = draw(one)
            if at is None:
                at = [one["crank.x"][0]*2, one["crank.y"][0]*2, 0]
            ends = []
            for name in (first, second):
                body = drawing.body(name)
                local = rotations.rotated(rotations.conjugate(body.rotation[0]), np.array(at) - body.position[0])
                ends.append(body.point(local))
            # Interpolation between steps, on 1 m.
            self.assertLess(np.abs(ends[0] - ends[1]).max(), 1e-6)

    def test_joints_between_points_that_are_assembled(self):
        """Two rods whose drawing is apart: each side of the joint is at its own point, where the other one is, once they are assembled."""
        scene = """[scene]
model = "mechanism"
planar = true
[gravity]
vector = [0, -9.81]
[body.left]
mass = 1.0
inertia = 0.1
position = [0.5, 0]
points = { end = [0.5, 0] }
[body.right]
mass = 1.0
inertia = 0.1
position = [2.0, 0.4]
angle = 0.3
points = { end = [-0.5, 0], other = [0.5, 0] }
[joint.pivot]
type = "revolute"
bodies = ["ground", "left"]
at = [0, 0]
[joint.middle]
type = "revolute"
bodies = ["left.end", "right.end"]
[joint.last]
type = "point_on_line"
bodies = ["ground:[1.5, 0]", "right.other"]
axis = [1, 0]
[initial]
assemble = true
largest_move = 2
[results]
joints = "all"
[time]
end = 0.2
[solver]
stepper = "rk4"
step = 1e-3
"""
        drawing = draw(tandem.Mechanism.from_toml(scene).run(error=False))
        left, right = drawing.body("left"), drawing.body("right")
        apart = np.linalg.norm(left.point([0.5, 0, 0]) - right.point([-0.5, 0, 0]), axis=1)
        self.assertLess(apart.max(), 1e-6)
        markers = [piece for piece in right.pieces if piece.shape == "cylinder" and piece.size[2] < 3*piece.size[0]]
        for name in ("middle force", "last force"):
            arrow = next(arrow for arrow in drawing.arrows if arrow.name == name)
            local = [-0.5, 0, 0] if name.startswith("middle") else [0.5, 0, 0]
            self.assertLess(np.abs(arrow.positions - right.point(local)).max(), 1e-12, name)
        self.assertTrue(any(np.allclose(piece.at, [-0.5, 0, 0]) for piece in markers))
        # No piece of the body reaches beyond its points.
        for body in (left, right):
            self.assertLess(max(np.linalg.norm(piece.at) for piece in body.pieces), 0.51)

    def test_contact_points(self):
        """The disk by hand, whose contact is among its coordinates, and as a mechanism, where a formula gives it."""
        hand, built = draw(result("rolling_disk")), draw(result("mechanism_disk"))
        contacts = [next(track.positions for track in drawing.tracks if track.is_contact) for drawing in (hand, built)]
        self.assertLess(np.abs(contacts[0] - contacts[1]).max(), 1e-6)
        self.assertLess(np.abs(contacts[0][:, 2]).max(), 1e-6)
        for scene in ("turntable", "chaplygin_sphere", "rattleback", "bicycle"):
            for track in draw(result(scene)).tracks:
                if track.is_contact:
                    self.assertLess(np.abs(track.positions[:, 2]).max(), 1e-6, scene)

    def test_the_motorcycle_stands_on_its_wheels(self):
        for scene in ("motorcycle", "motorcycle_chopper"):
            drawing = draw(result(scene))
            contact = next(track.positions for track in drawing.tracks if track.is_contact)
            self.assertLess(np.abs(contact[:, 2]).max(), 1e-6)
            for name in ("rear wheel, left", "rear wheel, right"):
                self.assertLess(np.abs(drawing.body(name).position[:, 2] - 0.3).max(), 1e-6)

    def test_inertia_gives_a_box(self):
        one = tandem.Mechanism({"gravity.vector": [0, 0, -9.81], "time.end": 0.1})
        m, a, b, c = 2.0, 0.3, 0.2, 0.1
        one.add("body.brick", mass=m, inertia=[m*(b*b + c*c)/12, m*(a*a + c*c)/12, m*(a*a + b*b)/12], position=[0, 0, 1])
        body = draw(one.run(error=False)).body("brick")
        turn = body.pieces[0].rotation
        edges = np.abs(rotations.rotated(turn, np.array(body.pieces[0].size)))
        self.assertTrue(np.allclose(edges, [a, b, c]), edges)

    def test_forces_within_rounding(self):
        """Three hanging pendulums, of which one weighs less than 1e-9 of all: its force is not drawn, and the largest comes first."""
        def made(joints):
            masses = {"light": 1e-11, "middle": 1.0, "heavy": 5.0}
            text = {"scene.model": "mechanism", "gravity.vector": [0, 0, -9.81], "time.end": 0.1, "results.joints": joints,
                    **{f"body.{name}": {"mass": mass, "inertia": [mass, mass, mass], "position": [k, 0, -1]}
                       for k, (name, mass) in enumerate(masses.items())},
                    **{f"joint.{name}_pin": {"type": "revolute", "bodies": ["ground", name], "at": [k, 0, 0], "axis": [0, 1, 0]}
                       for k, name in enumerate(masses)}}
            return tandem.Mechanism(text).run(error=False)

        every = made("all")
        self.assertEqual([arrow.name for arrow in draw(every).arrows], ["heavy_pin force", "middle_pin force"])
        self.assertEqual(draw(made(["light_pin"])).arrows, [])
        panel = next(axes for axes in tandem.plot.reactions(every).axes if axes.get_title().startswith("force"))
        self.assertEqual([text.get_text() for text in panel.get_legend().get_texts()][:2], ["heavy_pin", "middle_pin"])

    def test_what_cannot_be_shown(self):
        solution = tandem.solve(tandem.Model(n=1, mass_matrix=[[1.0]]), (0, 1), [0.0], [1.0])
        with self.assertRaisesRegex(ValueError, "look="):
            tandem.view(solution)

        def look(given, times, values):
            place = np.zeros((len(times), 3))
            place[:, 0] = values["q0"]
            body = viewer.Body("cart", place, np.tile([1.0, 0, 0, 0], (len(times), 1)), [viewer.Piece("box", (1, 1, 1), "#0072B2")])
            return viewer.Drawing("cart", times, [body])

        self.assertIn("cart", tandem.view(solution, look=look).text)


class Pages(Folder):
    def test_every_scene(self):
        for scene in SCENES:
            with self.subTest(scene):
                drawing = draw(result(scene))
                text = page(drawing)
                channels, _ = channels_of(drawing, 1e-6)
                self.assertTrue(np.isfinite(channels).all())
                self.assertTrue(all(body.pieces for body in drawing.bodies))
                # Nothing is fetched: no address but within texts of three.js, which are compressed.
                plain = re.sub(r"<script type=\"text/plain\".*?</script>", "", text, flags=re.S)
                self.assertNotIn("http", plain)
                self.assertEqual(re.findall(r"(?:src|href)=\"(?!data:)", plain), [])

    def test_what_is_in_it(self):
        one = result("a04_bricard")
        text = tandem.view(one, self.folder / "a.html", glb=self.folder / "a.glb", names=["b2.x"]).text
        self.assertEqual(text, (self.folder / "a.html").read_text())
        content = json.loads(re.search(r'id="drawing">(.*?)</script>', text, re.S)[1])
        numbers = re.search(r'id="numbers">(.*?)</script>', text, re.S)[1]
        channels = packing.unpacked(numbers, np.array(content["steps"]), content["times"]["count"])
        self.assertEqual([body["name"] for body in content["bodies"]], ["b1", "b2", "b3", "b4", "b5"])
        # A step is 1e-7 of the size, which is 3 m.
        self.assertLess(np.abs(channels[7:10].T - draw(one).body("b2").position).max(), 5e-7)
        self.assertEqual([curve["name"] for curve in content["curves"]], ["b2.x"])
        self.assertLess(np.abs(channels[-1] - draw(one).body("b2").position[:, 0]).max(), 1e-6)
        self.assertEqual((self.folder / "a.glb").read_bytes()[:4], b"glTF")

    def test_buttons_need_no_font(self):
        """Signs that not every font has are drawn: what the page writes itself is ASCII."""
        for file in sorted((ROOT / "python/src/tandem/viewer/page").glob("page.*")):
            text = file.read_text(encoding="utf-8")
            self.assertTrue(text.isascii(), file.name)
            self.assertNotRegex(text, r"&#|\\u[0-9a-f]{4}", file.name)
        self.assertRegex((ROOT / "python/src/tandem/viewer/page/page.html").read_text(), r'id="play"[^>]*><svg[^>]*><path')

    def test_names_cannot_break_the_page(self):
        one = tandem.Mechanism({"scene.planar": True, "scene.name": "a", "scene.description": "</script><b>&", "time.end": 0.1})
        one.add("body.rod", mass=1.0, inertia=1.0, position=[0, 0])
        text = tandem.view(one.run(error=False)).text
        self.assertNotIn("</script><b>", text)
        self.assertEqual(text.count("</script>"), 7)

    def test_sizes(self):
        """Ten bodies for a minute at 60 frames a second take less than a megabyte besides three.js."""
        one = tandem.run_scene("trailers", {"parameters.n": 9, "time.end": 60}, error=False)
        drawing = draw(one)
        self.assertEqual((len(drawing.bodies), drawing.times.size), (10, 3601))
        library = sum(len(packing.squeezed((Path(viewer.__file__).parent / "three" / name).read_bytes()))
                      for name in ("three.core.min.js", "three.module.min.js", "OrbitControls.js"))
        self.assertLess(len(page(drawing)) - library, 1_000_000)
        self.assertLess(len(glb(drawing)), 1_000_000)

    def test_command(self):
        tandem.run_scene("slider_crank", {"time.end": 0.2}, self.folder / "a.h5", error=False)
        self.assertEqual(self.tandem("view", "a.h5").split(), ["a.html", "a.glb"])
        self.assertEqual(self.tandem("view", "a.h5", "--output", "b.glb", "--frames", "10").split(), ["b.glb"])
        for words, told in ((["none.h5"], "none.h5"), (["a.h5", "--output", "a.png"], ".html"), (["a.h5", "--names", "x"], "no series"),
                            (["a.h5", "--frames", "0"], "--frames")):
            with self.subTest(words):
                self.assertIn(told, self.tandem("view", *words, code=2))

    def test_in_a_notebook(self):
        self.assertIn("<iframe srcdoc=", tandem.view(result("slider_crank"))._repr_html_())


class Glb(unittest.TestCase):
    def read(self, data):
        magic, version, length = struct.unpack("<4sII", data[:12])
        self.assertEqual((magic, version, length), (b"glTF", 2, len(data)))
        size, kind = struct.unpack("<I4s", data[12:20])
        self.assertEqual(kind, b"JSON")
        content = json.loads(data[20:20 + size])
        self.assertEqual(struct.unpack("<I4s", data[20 + size:28 + size]), (len(data) - 28 - size, b"BIN\0"))
        return content, data[28 + size:]

    def values(self, content, binary, number):
        accessor = content["accessors"][number]
        view = content["bufferViews"][accessor["bufferView"]]
        kind = {5126: np.float32, 5122: np.int16, 5123: np.uint16}[accessor["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        found = np.frombuffer(binary, kind, accessor["count"]*width, view["byteOffset"]).reshape(-1, width).astype(float)
        return found/32767 if accessor.get("normalized") else found

    def test_the_animation_is_the_motion(self):
        drawing = draw(result("a05_governor"))
        content, binary = self.read(glb(drawing))
        animation = content["animations"][0]
        seen = 0
        for channel in animation["channels"]:
            name, path = content["nodes"][channel["target"]["node"]]["name"], channel["target"]["path"]
            sampler = animation["samplers"][channel["sampler"]]
            self.assertLess(np.abs(self.values(content, binary, sampler["input"])[:, 0] - drawing.times).max(), 1e-6)
            values, body = self.values(content, binary, sampler["output"]), drawing.body(name)
            if path == "translation":
                self.assertLess(np.abs(values - body.position).max(), 1e-6)
            else:
                # 16 bits.
                self.assertLess(np.abs(values[:, [3, 0, 1, 2]] - body.rotation).max(), 2e-5)
            seen += 1
        self.assertGreater(seen, 8)

    def test_up_is_up(self):
        content, _ = self.read(glb(draw(result("a05_governor"))))
        x, y, z, w = content["nodes"][0]["rotation"]
        self.assertTrue(np.allclose(rotations.rotated([w, x, y, z], [0, 0, 1]), [0, 1, 0]))


if __name__ == "__main__":
    unittest.main()
