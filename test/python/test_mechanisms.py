# SPDX-License-Identifier: MIT
"""Mechanisms as scene files: the shipped ones against their references, sensors in files, repeated elements, and wrong files."""

import json
import math
import re
import resource
import sys
import tomllib
import unittest

import h5py
import numpy as np
from test_output import ROOT, Case

sys.path.insert(0, str(ROOT / "python" / "src"))
import tandem  # noqa: E402

MECHANISMS = sorted(path.stem for path in (ROOT / "scenes").glob("*.toml") if 'model = "mechanism"' in path.read_text())


PLANE_OF_MASSES = '[scene]\nmodel = "mechanism"\nplanar = true\n[time]\nend = 0.001\n[solver]\nstepper = "dop853"\nrtol = 1e-6\n'


class Mechanism(Case):
    def went(self, scene, *settings, output="out.h5"):
        """The file of a run, without the estimate of its error."""
        words = [word for setting in settings for word in ("--set", setting)]
        self.tandem("run", scene, *words, "--output", output, "--force", "--quiet", "--no-error")
        return h5py.File(self.folder / output)

    def sensed(self, scene, *settings):
        """Sensors at the end: {"name/what": value}."""
        with self.went(scene, *settings) as file:
            return {f"{name}/{what}": data[-1] for name, group in file["sensors"].items() for what, data in group.items()}

    def near(self, found, expected, bound):
        self.assertLess(np.max(np.abs(np.asarray(found) - np.asarray(expected))), bound)


def rotation(p):
    e0, e1, e2, e3 = p
    return np.array([[e0**2 + e1**2 - e2**2 - e3**2, 2*(e1*e2 - e0*e3), 2*(e1*e3 + e0*e2)],
                     [2*(e1*e2 + e0*e3), e0**2 - e1**2 + e2**2 - e3**2, 2*(e2*e3 - e0*e1)],
                     [2*(e1*e3 - e0*e2), 2*(e2*e3 + e0*e1), e0**2 - e1**2 - e2**2 + e3**2]])


def spin(p, pd):
    """The angular velocity in the body's axes."""
    e0, e1, e2, e3 = p
    return 2*np.array([[-e1, e0, e3, -e2], [-e2, -e3, e0, e1], [-e3, e2, -e1, e0]]) @ pd


class References(Mechanism):
    """Shipped scenes against solutions in closed form or those of others. The bounds are those of the digits given, or a hundred
    times what runs with a tolerance of 1e-11 a step differ by."""

    def test_pendulum(self):
        self.near(self.sensed("a01_pendulum")["mass/position"][:2], [-0.27508746257611686, -0.96141920509912506], 1e-9)

    def test_four_bars(self):
        self.near(self.sensed("a02_four_bars", "time.end=0.6")["b0/position"][:2], [0.884327595936854902, 0.466866900802083729], 1e-9)

    def test_singular_positions(self):
        """Ten times in 10 s all bars align. The uprights stay parallel, as a single pendulum of the same equation. Local errors of the
        steps add up to 1e-8."""
        for kind in ("dense", "sparse"):
            with self.subTest(kind):
                found = self.sensed("a02_four_bars", f"solver.chart_kind={kind}")["b0/position"][:2]
                self.near(found, [0.328458111540517, 0.944518538178705], 1e-8)

    def test_singular_positions_are_listed(self):
        """In the file, with and without events, in a file that is resumed, and by the reader."""
        for more, names in (("", []), ('[[event]]\nname = "up"\nwatch = "coupler1.y"\nvalue = 0.5\n', ["up"])):
            scene = self.scene((ROOT / "scenes" / "a02_four_bars.toml").read_text() + more)
            with self.subTest(names):
                self.tandem("run", scene, "--no-error", "--quiet", "--force", "--output", "a.h5", "--set", "solver.max_steps=60", code=1)
                first = tandem.read(self.folder / "a.h5").singular["time"]
                self.tandem("resume", "a.h5", "--no-error", "--quiet", "--set", "solver.max_steps=10000")
                self.tandem("verify", "a.h5")
                found = tandem.read(self.folder / "a.h5")
                self.assertEqual((len(found.singular["time"]), len(found.singular["error"])), (10, 10))
                self.assertEqual(found.singular["time"][:len(first)].tolist(), first.tolist())
                self.near(found.singular["time"][:2], [0.714355529, 1.22815939], 1e-7)
                self.assertTrue((found.singular["error"] > 0).all() and (found.singular["error"] < 1e-6).all())
                self.assertEqual(sorted(set(found.events.get("name", []))), names)

    def test_a_start_in_a_singular_position(self):
        """A flat parallelogram of hinges in space, some rows of which are redundant besides, moves like a pendulum."""
        bodies = "".join(f"[body.{name}]\nmass = 1\ninertia = [0.1, 0.1, 0.1]\nposition = [{x}, 0, 0]\nvelocity = [0, 0, {speed}]\n"
                         f"omega = [0, {rate}, 0]\n" for name, x, speed, rate in (("a", 0.5, -2.5, 5), ("c", 2, -5, 0), ("b", 2.5, -2.5, 5)))
        joints = "".join(f'[joint.{name}]\ntype = "revolute"\nbodies = ["{one}", "{two}"]\nat = [{x}, 0, 0]\naxis = [0, 1, 0]\n'
                         for name, one, two, x in (("p", "ground", "a", 0), ("q", "a", "c", 1), ("r", "c", "b", 3), ("s", "ground", "b", 2)))
        scene = self.scene(f'[scene]\nmodel = "mechanism"\n[gravity]\nvector = [0, 0, -9.81]\n{bodies}{joints}[time]\nend = 2\n'
                           '[solver]\nstepper = "dop853"\nrtol = 1e-10\n')
        for kind in ("dense", "sparse"):
            with self.subTest(kind):
                self.went(scene, f"solver.chart_kind={kind}").close()
                found = tandem.read(self.folder / "out.h5")
                x, z = (found.q[:, found.names.index("a." + i)] for i in "xz")
                speed = found.qd[:, [found.names.index("a." + i) for i in "xz"]]
                self.near(4*(speed**2).sum(axis=1), 25 - 4*9.81*2/1.7*z, 1e-7)
                self.near(found.q[:, found.names.index("b.x")], x + 2, 1e-9)
                self.near(found.q[:, found.names.index("b.z")], z, 1e-9)
                self.assertEqual(found.singular["time"][0], 0)
                self.assertEqual(len(found.singular["time"]), 3)

    def test_andrews(self):
        found = self.sensed("a03_andrews")
        for name, expected in {"beta": 15.810771195153707, "Theta": -15.756371058411840, "gamma": 0.040822240119645805,
                               "Phi": -0.53473011634207960, "delta": 0.52440996587995407, "Omega": 0.53473011634207960,
                               "epsilon": 1.0480807410419379}.items():
            with self.subTest(name):
                self.near(found[name + "/angle"], expected, 1e-9)

    def test_bricard(self):
        found = self.sensed("a04_bricard")["p/position"]
        self.near(found, [-0.77813537303329089, -0.98035268344325656, -0.19725267061717062], 1e-9)
        checked = json.loads(self.tandem("check", "a04_bricard", "--json").stdout)
        self.assertEqual([checked["position_freedom"], checked["velocity_freedom"]], [1, 1])
        self.assertEqual(sum(element["redundant_rows"] for element in checked["elements"]), 1)

    def test_governor(self):
        self.near(self.sensed("a05_governor", "time.end=1", "solver.rtol=1e-8")["s/displacement"], 0.5014209223796, 1e-6)

    def test_rattleback(self):
        with self.went("rattleback") as file:
            q, qd = file["trajectory/q"][-1], file["trajectory/qd"][-1]
            self.near(-rotation(q[3:7])[2], [-0.02316491661, -0.00600434243, 0.99971362625], 1e-8)
            self.near(spin(q[3:7], qd[3:7]), [5.0410423064, 1.7614231695, -3.1175435374], 1e-8)
            self.assertLess(np.ptp(file["sensors/energy/total"][:]), 1e-10)

    def test_chaplygin(self):
        with self.went("chaplygin_sphere") as file:
            q, qd = file["trajectory/q"][-1], file["trajectory/qd"][-1]
            self.near(spin(q[3:7], qd[3:7]), [0.642245648620, 1.068456168290, -0.326474171625], 1e-8)

    def test_turntable(self):
        alpha = 3.0*0.4/1.4
        z = 0.5 - 0.3j + (0.4 + 0.7j)*(np.exp(10j*alpha) - 1)/(1j*alpha)
        self.near(self.sensed("turntable")["centre/position"], [z.real, z.imag, 0.2], 1e-8)

    def test_vehicle(self):
        """Equal steps of the mechanism and of the model that was derived by hand."""
        with self.went("mechanism_vehicle") as drawn, self.went("articulated_vehicle", output="hand.h5") as derived:
            self.near(drawn["trajectory/q"][:], derived["trajectory/q"][:], 1e-10)

    def test_disk(self):
        """Other coordinates round and truncate otherwise: with steps of order 8 it is rounding alone, which the motion amplifies."""
        steps = "solver.stepper=dop853", "time.end=10"
        with self.went("mechanism_disk", *steps) as drawn, self.went("rolling_disk", *steps, output="hand.h5") as derived:
            self.near(drawn["trajectory/q"][:, :3], derived["trajectory/q"][:, :3], 1e-8)

    def test_motorcycles(self):
        """The same with a massless wheel on a strut; the models that were derived by hand have two coordinates for the contact."""
        for drawn_name, derived_name in ("mechanism_motorcycle", "motorcycle"), ("mechanism_chopper", "motorcycle_chopper"):
            steps = "solver.stepper=dop853", "solver.step=2e-3", "output.every=10", "time.end=10"
            with self.subTest(drawn_name), self.went(drawn_name, *steps) as drawn, \
                    self.went(derived_name, *steps, output="hand.h5") as derived:
                self.near(drawn["trajectory/q"][:, :7], derived["trajectory/q"][:, :7], 1e-10)

    def test_slider_crank(self):
        """The crank turns as prescribed, and the stroke is known."""
        with self.went("slider_crank") as file:
            t = file["trajectory/time"][:]
            angle = 2*math.pi*t
            expected = 0.08*np.cos(angle) + np.sqrt(0.3**2 - (0.08*np.sin(angle))**2) - 0.38
            self.near(file["sensors/stroke/displacement"][:], expected, 1e-10)

    def test_all_of_them(self):
        """Every shipped mechanism has at most 60 lines, stands in a group, and its procedures are right."""
        listed = {scene["name"]: scene for scene in json.loads(self.tandem("list", "--json").stdout)["scenes"]}
        self.assertGreaterEqual(len(MECHANISMS), 14)
        for name in MECHANISMS:
            with self.subTest(name):
                self.assertLessEqual(len((ROOT / "scenes" / f"{name}.toml").read_text().splitlines()), 60)
                self.assertNotIn("error", listed[name])
                self.assertNotEqual(listed[name]["group"], "scenes")
                checked = json.loads(self.tandem("check", name, "--json").stdout)
                self.assertTrue(all(procedure["passed"] for procedure in checked["procedures"]))
                # Error of differences with steps adapted to the model's curvature: 4e-10 for the stone's ellipsoid.
                self.assertLessEqual(max(procedure["error"] for procedure in checked["procedures"]), 1e-9)
                shown = self.tandem("show", name).stdout
                again = self.tandem("show", self.scene(shown, "again.toml")).stdout
                self.assertEqual(again.splitlines()[2:], shown.splitlines()[2:])


ROD = """\
[scene]
model = "mechanism"
{planar}

[parameters]
l = 0.5

[gravity]
vector = [0, {z}-9.81]

[body.rod]
mass = 2.0
inertia = {inertia}
position = ["l", 0{zero}]
points = {{ tip = ["l", 0{zero}] }}

[joint.pivot]
type = "revolute"
bodies = ["ground", "rod"]
at = [0, 0{zero}]
{axis}

[sensor.turn]
joint = "pivot"

[sensor.tip]
point = "rod.tip"

[sensor.all]
energy = true

[sensor.far]
distance = ["rod.tip", "ground:[0, 1{zero}]"]

[time]
end = 2.0

[solver]
stepper = "dop853"
rtol = 1e-10
"""
PLANAR = ROD.format(planar="planar = true", z="", inertia="0.2", zero="", axis="")
SPATIAL = ROD.format(planar="", z="0, ", inertia="[0.01, 0.2, 0.2]", zero=", 0", axis="axis = [0, 1, 0]")


class Tutorial(Mechanism):
    def test_files_of_the_document(self):
        """Every file of README.md and doc/mechanism.md is right and runs."""
        files = [block for name in ("README.md", "doc/mechanism.md")
                 for block in re.findall(r"```toml\n(.*?)```", (ROOT / name).read_text(), re.S) if "[scene]" in block]
        self.assertIn(files[0], (ROOT / "scenes" / "mechanism_disk.toml").read_text())
        self.assertGreaterEqual(len(files), 7)
        for text in files:
            with self.subTest(text):
                checked = json.loads(self.tandem("check", self.scene(text), "--json").stdout)
                self.assertTrue(checked["start"]["passed"])
                with self.went("scene.toml") as file:
                    self.assertEqual(file.attrs["status"], "complete")


    def test_every_key_is_in_the_document(self):
        """Every key of the shipped scenes and of the document's own files."""
        text = (ROOT / "doc" / "mechanism.md").read_text()
        known = set(re.findall(r"`(\w+)(?: = [^`]*)?`", text[text.index("## Elements, key by key"):]))
        common = {"scene", "initial", "time", "solver", "output", "parameters", "event"}
        for name in MECHANISMS:
            scene = tomllib.loads(self.tandem("show", name).stdout)
            tables = [({"repeat": scene["repeat"][key]}, key) for key in scene.get("repeat", {})]
            for kind, content in scene.items():
                if kind in common | {"repeat"}:
                    continue
                for element in [content] if kind in ("gravity", "ground") else content.values():
                    for key in element:
                        self.assertIn(key, known, f"{name}: {kind}")
            for table, key in tables:
                for kind in table["repeat"]:
                    self.assertTrue(kind in known or f"[{kind}." in text, kind)


class Sensors(Mechanism):
    def test_plane_and_space(self):
        """A pendulum defined in the plane and in space has equal results."""
        flat = self.sensed(self.scene(PLANAR))
        deep = self.sensed(self.scene(SPATIAL))
        for what in "tip/position", "tip/velocity", "tip/acceleration":
            self.near(flat[what][[0, 1]], deep[what][[0, 2]], 1e-7)
        # Turned about y, x goes to -z.
        self.near(flat["turn/angle"], -deep["turn/angle"], 1e-8)
        self.near(flat["turn/rate"], -deep["turn/rate"], 1e-7)
        for what in "all/total", "all/kinetic":
            self.near(flat[what], deep[what], 1e-7)
        self.assertLess(abs(flat["all/total"]), 1e-9)

    def test_values(self):
        """Against what the coordinates say, with names and units."""
        with self.went(self.scene(PLANAR)) as file:
            q, qd, qdd = (file["trajectory"][name][:] for name in ("q", "qd", "qdd"))
            c, s = np.cos(q[:, 2]), np.sin(q[:, 2])
            zero = 0*c
            self.near(file["sensors/tip/position"][:], np.transpose([q[:, 0] + c/2, q[:, 1] + s/2, zero]), 1e-14)
            self.near(file["sensors/tip/velocity"][:], np.transpose([qd[:, 0] - s/2*qd[:, 2], qd[:, 1] + c/2*qd[:, 2], zero]), 1e-13)
            self.near(file["sensors/tip/acceleration"][:], np.transpose(
                [qdd[:, 0] - s/2*qdd[:, 2] - c/2*qd[:, 2]**2, qdd[:, 1] + c/2*qdd[:, 2] - s/2*qd[:, 2]**2, zero]), 1e-12)
            self.near(file["sensors/turn/angle"][:], q[:, 2], 1e-14)
            self.near(file["sensors/far/distance"][:], np.hypot(q[:, 0] + c/2, q[:, 1] + s/2 - 1), 1e-14)
            attributes = file["sensors/tip/velocity"].attrs
            self.assertEqual(attributes["unit"], "m/s")
            self.assertEqual(list(attributes["names"]), ["x", "y", "z"])
            self.assertEqual(file["sensors/turn/angle"].attrs["unit"], "rad")
            self.assertEqual(file["sensors/turn/time"], file["trajectory/time"])
            self.assertEqual(list(file["trajectory/q"].attrs["names"]), ["rod.x", "rod.y", "rod.angle"])


    def test_massless_wheel(self):
        """The displacement of a strut is a coordinate; along it, the plane's force balances the suspension's, without any mass."""
        asked = 'sensor.travel.joint="front"', 'results.wheels=["front"]', 'results.forces="all"', "time.end=1", "output.every=50"
        with self.went("mechanism_motorcycle", *asked, 'force.push={ type = "load", on = "chassis", force = ["20*front.speed", 0, 0] }') as file:
            names = list(file["trajectory/q"].attrs["names"])
            q, qd = file["trajectory/q"][:, names.index("front.displacement")], file["trajectory/qd"][:, names.index("front.displacement")]
            for group in "sensors/travel", "wheels/front":
                np.testing.assert_array_equal(file[group]["displacement"][:], q)
                np.testing.assert_array_equal(file[group]["speed"][:], qd)
            along = np.array([0, math.sin(0.2), -math.cos(0.2)])
            self.near(file["wheels/front/force_body"][:] @ along, -file["forces/suspension/force"][:], 1e-9)
            self.assertGreater(np.ptp(file["forces/suspension/force"][:]), 0.01)
            self.assertEqual(list(file["forces/suspension/force"].attrs["between"]), ["chassis", "front"])
            self.near(file["wheels/front/position"][:, 2], 0, 1e-13)
            self.near(file["forces/push/force"][:, 0], 20*qd, 1e-15)

    def test_turns_are_counted(self):
        """In space too, also for rows far apart, and in a resumed run."""
        fast = ("gravity.vector=[0,0,0]", "body.rod.omega=[0,20,0]", "body.rod.velocity=[0,0,-10]", "time.end=10", "output.every=100000",
                "solver.rtol=3e-11")
        name = self.scene(SPATIAL)
        self.near(self.sensed(name, *fast)["turn/angle"], 200, 1e-7)
        words = [word for setting in fast for word in ("--set", setting)]
        self.tandem("run", name, *words, "--set", "solver.max_steps=300", "--output", "part.h5", "--quiet", "--no-error", code=1)
        self.tandem("resume", "part.h5", "--set", "solver.max_steps=100000", "--quiet")
        with h5py.File(self.folder / "part.h5") as file:
            self.assertEqual(file.attrs["status"], "complete")
            self.near(file["sensors/turn/angle"][-1], 200, 1e-7)

    def test_none(self):
        """Without sensors there is no group."""
        text = re.sub(r"\[sensor\.\w+\]\n(.+\n)+\n", "", PLANAR)
        with self.went(self.scene(text)) as file:
            self.assertNotIn("sensors", file)


class Keys(Mechanism):
    def test_settings(self):
        """Any key, parameters, and new elements."""
        shown = self.tandem("show", self.scene(PLANAR), "--set", "body.rod.mass=3", "--set", "parameters.l=0.25", "--set",
                            "joint.pivot.motion=sin(t)*l", "--set", "force.push.type=load", "--set", "force.push.on=rod.tip",
                            "--set", 'force.push.force=["2*l","-rod.vy"]').stdout
        scene = tomllib.loads(shown)
        self.assertEqual(scene["body"]["rod"]["mass"], 3)
        self.assertEqual(scene["body"]["rod"]["position"], ["l", 0])
        self.assertEqual(scene["parameters"]["l"], 0.25)
        self.assertEqual(scene["joint"]["pivot"]["motion"], "sin(t)*l")
        self.assertEqual(scene["force"]["push"]["force"], ["2*l", "-rod.vy"])
        with self.went("scene.toml", "parameters.l=0.25", "time.end=0.01") as file:
            self.assertEqual(file["trajectory/q"][0][0], 0.25)

    def test_repetition(self):
        """Copies have names and places by their number, and the complete scene keeps the one text."""
        for n in 1, 3:
            with self.went("a02_four_bars", f"parameters.n={n}", "time.end=0.01") as file:
                names = list(file["trajectory/q"].attrs["names"])
                self.assertEqual(len(names), 3*(2*n + 1))
                self.assertIn(f"coupler{n}.angle", names)
        shown = self.tandem("show", "a02_four_bars").stdout
        self.assertIn('[repeat.bay.body."coupler{i}"]', shown)
        self.assertIn('position = ["i - 0.5", 1.0]', shown)
        self.assertEqual(len(json.loads(self.tandem("check", "trailers", "--set", "parameters.n=0", "--json").stdout)["elements"]), 2)
        # The complete scene of a thousand coordinates is accepted, since its lines are bounded.
        self.assertIn("1203 numbers each", self.tandem("show", "a02_four_bars", "--set", "parameters.n=200").stdout)

    GRID = '[scene]\nmodel = "mechanism"\nplanar = true\n\n[parameters]\nm = 2\n\n[repeat.row]\ncount = 3\n\n[repeat.row.body."left{i}"]\nmass = "i"\n' \
        'position = [-1, "i"]\n\n[repeat.row.repeat.column]\nindex = "j"\ncount = "i - 1"\n\n' \
        '[repeat.row.repeat.column.body."m{i}_{j}"]\nmass = "m"\nposition = ["j", "10*i + j"]\n\n' \
        '[repeat.row.repeat.column.force."f{10*i + j}"]\ntype = "load"\non = "m{i}_{j}"\nforce = ["i", "j"]\n\n' \
        '[time]\nend = 0.01\n'

    def test_default_weights_of_huge_mechanisms_can_be_read_again(self):
        """The weights are 1/scale^2, which underflows."""
        shown = self.tandem("show", self.scene("""\
[scene]
model = "mechanism"
planar = true
[body.rod]
mass = 1.0
inertia = 0.1
position = [0.5, 0]
points = { far = [1e200, 0] }
[joint.pivot]
type = "revolute"
bodies = ["ground", "rod.far"]
[initial]
assemble = true
[time]
end = 1.0
""")).stdout
        self.assertEqual(self.tandem("show", self.scene(shown)).stdout, shown)

    def test_many_bodies_written_out(self):
        """A scene of 400 bodies runs, and with every default it is a scene too, longer than 131072 bytes."""
        text = PLANE_OF_MASSES + "".join(
            f'[body.m{i}]\nmass = 0.1\nposition = [{0.1*i:.1f}, 0]\n[constraint.r{i}]\ntype = "distance"\n'
            f'between = ["{"ground" if i == 1 else f"m{i-1}"}", "m{i}"]\n' for i in range(1, 401))
        shown = self.tandem("show", self.scene(text)).stdout
        self.assertGreater(len(shown), 131072)
        self.assertEqual(self.tandem("show", self.scene(shown, "shown.toml")).stdout.replace("shown", "scene"), shown)
        with self.went("shown.toml") as file:
            self.assertEqual(len(file["trajectory/q"][-1]), 800)

    def test_nested_repetition(self):
        """A triangle of masses: each has its row and its column."""
        with self.went(self.scene(self.GRID)) as file:
            q = dict(zip(file["trajectory/q"].attrs["names"], file["trajectory/q"][0]))
            self.assertEqual(len(q), 12)
            for name, place in (("left3", (-1, 3)), ("m2_1", (1, 21)), ("m3_1", (1, 31)), ("m3_2", (2, 32))):
                self.assertEqual((q[name + ".x"], q[name + ".y"]), place)
        shown = self.tandem("show", "scene.toml").stdout
        self.assertIn('[repeat.row.repeat.column.body."m{i}_{j}"]', shown)
        self.assertIn('position = ["j", "10*i + j"]', shown)
        # The complete scene is the same scene, also where the first copies have none of the inner ones, or none at all.
        for settings in [], ["--set", "repeat.row.count=1"], ["--set", "repeat.row.count=0"]:
            shown = self.tandem("show", "scene.toml", *settings).stdout if "=0" not in "".join(settings) else shown
            self.assertEqual(self.tandem("show", self.scene(shown, "shown.toml")).stdout.split("\n", 3)[3], shown.split("\n", 3)[3])

    def test_wrong_nested_repetition(self):
        for old, new, says in (('index = "j"', 'index = "i"', ["repeat.row.repeat.column.index", "outer index"]),
                               ('index = "j"\n', "", ["repeat.row.repeat.column.index", "outer index"]),
                               ('"i - 1"', '"k - 1"', ["repeat.row.repeat.column.count"]),
                               ('"i - 1"', "60000", ["more than 100000 copies"]),
                               ('"m{i}_{j}"]\nmass', '"m{j}"]\nmass', ["m1"]),
                               ('count = "i - 1"\n', "", ["repeat.row.repeat.column", "count"])):
            with self.subTest(new):
                self.refused("check", self.scene(self.GRID.replace(old, new, 1)), says=says)

    def test_assembly(self):
        """A loop that is open in the reference configuration: an error states the gap, and assembly closes it."""
        text = PLANAR.replace("at = [0, 0]", 'at = "rod:[-0.4, 0]"').replace('["ground", "rod"]', '["ground:[0, 0]", "rod"]')
        self.refused("check", self.scene(text), says=["0.1000000 m apart in the reference configuration", "pivot", "assemble the start"])
        self.tandem("check", "scene.toml", "--set", "initial.assemble=true")

    def test_place_of_a_joint(self):
        """At a point that stands in `bodies` already: the same place. Another point of that body is refused."""
        text = PLANAR.replace("at = [0, 0]", 'at = "ground:[0, 0]"').replace('["ground", "rod"]', '["ground:[0, 0]", "rod:[-0.5, 0]"]')
        done = self.tandem("check", self.scene(text))
        self.assertIn("degrees of freedom: 1 at position level", done.stdout)
        self.refused("check", self.scene(text.replace('at = "ground:[0, 0]"', 'at = "rod:[-0.4, 0]"')),
                     says=["joint.pivot.at", "differs from the point of that body in bodies", "remove one"])

    def test_study(self):
        self.tandem("study", "precision", self.scene(PLANAR), "--set", "time.end=0.05", "--quiet", "--output", "study.csv")


BASE = """\
[scene]
model = "mechanism"
planar = true

[parameters]
l = 1.0
m = "2*l"

[body.rod]
mass = "m"
inertia = 0.1
position = ["l/2", 0]
points = { tip = ["l/2", 0] }

[body.bob]
mass = 1
position = ["l", 1]

[joint.pivot]
type = "revolute"
bodies = ["ground", "rod"]
at = [0, 0]

[force.coil]
type = "spring"
between = ["rod.tip", "bob"]
stiffness = 10

[sensor.tip]
point = "rod.tip"

[time]
end = 1.0
"""
SPACE = """\
[scene]
model = "mechanism"

[body.a]
mass = 1
inertia = [1, 1, 1]
position = [0, 0, 1]

[body.b]
mass = 1
inertia = [1, 1, 1]
position = [0, 0, 2]

[joint.j]
type = "universal"
bodies = ["a", "b"]
at = [0, 0, 1.5]
axis = [1, 0, 0]
across = [0, 1, 0]

[wheel.w]
type = "disk"
at = "a"
radius = 1
axis = [1, 0, 0]

[time]
end = 1.0
"""
# Replaced text and its replacement; words of the message; and the line of the message, given by its text.
WRONG = [
    ("bodies = [\"ground\", \"rod\"]", 'bodies = ["ground", "rood"]', ["there is no body rood", "define it first, or correct the name"]),
    ("bodies = [\"ground\", \"rod\"]", 'bodies = ["rod", "rod"]', ["pivot connects a body to itself", "two different bodies"]),
    ("bodies = [\"ground\", \"rod\"]", 'bodies = ["ground"]', ["joint.pivot.bodies", "has 1 element", "must have 2"]),
    ("bodies = [\"ground\", \"rod\"]", 'bodies = "rod"', ["joint.pivot.bodies: must be an array of strings in quotes"]),
    ("bodies = [\"ground\", \"rod\"]", 'bodies = ["ground", 3]', ["joint.pivot.bodies", "element 2 must be a string in quotes"]),
    ("bodies = [\"ground\", \"rod\"]", 'bodies = ["ground.post", "rod"]', ["ground has no point post"]),
    ("bodies = [\"ground\", \"rod\"]\n", "", ["joint.pivot", "the key bodies is missing"]),
    ("type = \"revolute\"", 'type = "revolut"', ["joint pivot", "revolut", "revolute, prismatic"]),
    ("type = \"revolute\"", "type = 3", ["joint.pivot.type", "must be a string in quotes, not an integer"]),
    ("type = \"revolute\"\n", "", ["joint.pivot", "the key type is missing"]),
    ("type = \"revolute\"", 'type = "prismatic"', ["pivot has no axis", "axis"]),
    ("type = \"revolute\"", 'type = "prismatic"\naxis = [0, 0]', ["axis is zero", "direction"]),
    ("type = \"revolute\"", 'type = "revolute"\naxi = [1, 0]', ['unknown key "axi" of joint.pivot', 'did you mean "axis"?', "its keys are"]),
    ("type = \"revolute\"", 'type = "fixed"\nmotion = "t"', ["pivot cannot be driven", "revolute or a prismatic"]),
    ("type = \"revolute\"", 'type = "revolute"\nmotion = "2*T"', ['joint.pivot.motion: column 3 of "2*T"', 'there is no "T"']),
    ("type = \"revolute\"", 'type = "revolute"\nmotion = [1, 2]', ["joint.pivot.motion", "not a function of time"]),
    ("type = \"revolute\"", 'type = "revolute"\nmotion = "step(t - 0.5)"', ["motion of pivot is discontinuous", "continuous"]),
    ("type = \"revolute\"", 'type = "primitive"', ["hold has 0 entries", "give 3"]),
    ("type = \"revolute\"", 'type = "primitive"\nhold = [1, 1]', ["joint.pivot.hold", "has 2 elements", "must have 3"]),
    ("at = [0, 0]", "at = [0, 0, 0]", ["joint.pivot.at", "has 3 elements", "must have 2"]),
    ("at = [0, 0]\n", "", ["pivot has no position", "at = ..."]),
    ("at = [0, 0]", 'at = "bob"', ['"bob" is not a point of one of its bodies']),
    ("at = [0, 0]", 'at = "rod:[1, 2, 3]"', ["is not a valid point", "body:[x, y]"]),
    ("at = [0, 0]", 'at = "rod:[1, k]"', ["joint.pivot.at", 'there is no "k"']),
    ("at = [0, 0]", "at = [true, 0]", ["joint.pivot.at", "must be a number, or an expression in quotes, not true or false"]),
    ("at = [0, 0]", "at = [[0, 0]]", ["joint.pivot.at", "is a list of lists", "give one list"]),
    ("at = [0, 0]", "at = [[0], [0, 1]]", ["joint.pivot.at"]),
    ("at = [0, 0]", "at = []", ["joint.pivot.at", "empty list"]),
    ("mass = 1\n", "mass = -1\n", ["body.bob.mass: must not be negative, but is -1"]),
    ("mass = 1\n", "", ["body.bob", "the key mass is missing"]),
    ("mass = 1\n", "mass = true\n", ["body.bob.mass", "must be a number, or an expression in quotes, not true or false"]),
    ("mass = 1\n", "mass = [1, 2]\n", ["body.bob.mass", "must be a number, not an array"]),
    ("mass = 1\n", 'mass = "1 kg"\n', ["body.bob.mass: column 3", "expression"]),
    ("mass = 1\n", "density = 7800\n", ["body.bob.density", "without a shape"]),
    ("mass = 1\n", "mass = 1\ndensity = 7800\nshape = { bar = [1, 0.1] }\n", ["together with mass"]),
    ("mass = 1\n", "mass = 1\nshape = { ball = 1 }\n", ["body.bob.shape.ball", "not a shape", "sphere"]),
    ("mass = 1\n", "mass = 1\nshape = { box = [1, 1, 1] }\n", ["no inertia in the plane"]),
    ("mass = 1\n", "mass = 1\nshape = { bar = [1, -1] }\n", ["body.bob.shape.bar", "must be positive"]),
    ("mass = 1\n", "mass = 1e400\n", ["finite"]),
    ("mass = 1\n", 'mass = "1/0"\n', ["body.bob.mass", "finite"]),
    ("inertia = 0.1", "inertia = -0.1", ["body.rod.inertia", "must not be negative"]),
    ("inertia = 0.1", "inertia = [1, 1, 1]", ["body.rod.inertia", "has 3 elements", "must have 1"]),
    ("position = [\"l\", 1]\n", "", ["body.bob", "the key position is missing"]),
    ("position = [\"l\", 1]", 'position = ["l", 1, 0]', ["body.bob.position", "has 3 elements", "must have 2"]),
    ("position = [\"l\", 1]", 'position = ["L", 1]', ["body.bob.position: column 1", 'did you mean "l"?']),
    ("stiffness = 10", "stiffness = 10\npull = 3", ['unknown key "pull" of force.coil (did you mean "tension"?)']),
    ("position = [\"l\", 1]", 'position = ["l", 0]', ["coil", "length zero in the reference configuration", "move one of its ends"]),
    ("[body.bob]", "[body.ground]", ["there is another \"ground\" already", "another name"]),
    ("[body.bob]", "[body.pivot]", ["pivot"]),
    ("[body.bob]", '[body."b o b"]', ["is not a valid name", "without dots and blanks"]),
    ("[body.bob]", '[body."b.b"]', ['"b.b" is not a valid name']),
    ("[body.bob]", f"[body.{'n'*65}]", ["is longer than 64 characters", "shorten it"]),
    ("[body.bob]", f"[body.{'n'*300}]", ["is longer than 64 characters", "shorten it"]),
    ("type = \"spring\"", f'type = "{"n"*300}"', ["force.coil.type"]),
    ("points = { tip = [\"l/2\", 0] }", f"points = {{ {'n'*65} = [0, 0] }}", ["is longer than 64 characters"]),
    ("[sensor.tip]", f"[sensor.{'n'*65}]", ["is longer than 64 characters"]),
    ("[body.bob]", "[bdy.bob]", ["bdy"]),
    ("[body.bob]", "[body]", ["body.mass is a table, not a value", "body.NAME.KEY"]),
    ("points = { tip", "points = { top", ["the body rod has no point tip"]),
    ("points = { tip = [\"l/2\", 0] }", "points = [1, 2]", ["points"]),
    ("points = { tip = [\"l/2\", 0] }", "points = { tip = [1] }", ["body.rod.points.tip", "has 1 element", "must have 2"]),
    ("m = \"2*l\"", 'm = "2*n"', ["parameters.m: column 3", 'there is no "n"']),
    ("m = \"2*l\"", 'm = "2*m"', ["cyclically: m -> m", "give one of them as a number"]),
    ("l = 1.0", 'l = "m/2"', ["cyclically"]),
    ("m = \"2*l\"", "m = [1]", ["parameters.m is not a number"]),
    ("m = \"2*l\"", 'm = "2*l"\npi = 3', ["pi", "is reserved in expressions"]),
    ("m = \"2*l\"", 'm = "log(-l)"', ["parameters.m", "does not yield a finite number"]),
    ("type = \"spring\"", 'type = "sprung"', ["force.coil.type", 'did you mean "spring"?', "torsion"]),
    ("between = [\"rod.tip\", \"bob\"]\n", "", ["force.coil", "the key between is missing"]),
    ("between = [\"rod.tip\", \"bob\"]", 'between = ["bob", "bob"]', ["coil connects a body to itself"]),
    ("stiffness = 10", 'stiffness = 10\nlaw = "k*length"', ["force.coil.law", 'there is no "k"']),
    ("stiffness = 10", "stiffness = 10\nstiffness = 20", ["stiffness", "already exists"]),
    ("stiffness = 10", "stiffness = 10\n[force.coil]", ["coil"]),
    ("stiffness = 10", "stiffness = 10\n[force]\n[force]", ["duplicate table"]),
    ("stiffness = 10", "stiffness = 10\n[force.none]", ["force.none is empty"]),
    ("bodies = [\"ground\", \"rod\"]\nat = [0, 0]", 'bodies = ["ground", true]\nat = "rod"', ["joint.pivot.bodies", "element 2 must be a string in quotes"]),
    ("stiffness = 10", "stiffness = 10\n[force.coil.stiffness.x]", ["the name before the dot is a value"]),
    ("stiffness = 10", 'stiffness = 10\n[force.t]\ntype = "torsion"\njoint = "pivo"', ["there is no joint pivo"]),
    ("stiffness = 10", 'stiffness = 10\n[force.push]\ntype = "load"\non = "rod"', ["has neither force nor torque"]),
    ("stiffness = 10", 'stiffness = 10\n[force.push]\ntype = "load"\non = "ground"\nforce = [1, 0]', ["push acts on the ground"]),
    ("stiffness = 10", 'stiffness = 10\n[force.push]\ntype = "load"\non = "rod"\nforce = ["rod.vz", 0]', ["force.push.force", "rod.vz"]),
    ("stiffness = 10", 'stiffness = 10\n[force.push]\ntype = "load"\non = "bob"\ntorque = 1', ["point mass bob", "inertia"]),
    ("point = \"rod.tip\"", 'point = "rod.tpi"', ["has no point tpi"]),
    ("point = \"rod.tip\"", 'points = "rod.tip"', ["sensor.tip", "measure one thing", "point, joint, distance, energy"]),
    ("point = \"rod.tip\"", 'point = "rod"\nenergy = true', ["sensor.tip", "measure one thing"]),
    ("point = \"rod.tip\"", 'joint = "coil"', ["there is no joint coil"]),
    ("point = \"rod.tip\"", 'point.x = "rod.tip"', ["sensor.tip"]),
    ("mass = 1\n", "density.x = 1\n", ["body.bob", "the key mass is missing"]),
    ("[sensor.tip]", '[sensor."a/b"]', ["is not a valid name", "slashes"]),
    ("[sensor.tip]", '[repeat.x]\ncount = 2.5\n[repeat.x.sensor."s{i}"]', ["repeat.x.count gives 2.5", "integer"]),
    ("[sensor.tip]", '[repeat.x]\ncount = "n"\n[repeat.x.sensor."s{i}"]', ["repeat.x.count", 'there is no "n"']),
    ("[sensor.tip]", '[repeat.x]\n[repeat.x.sensor."s{i}"]', ["repeat.x", "the key count is missing"]),
    ("[sensor.tip]", "[repeat.x]\ncount = 2\n[repeat.x.sensor.s]", ["sensor.s.point is given twice"]),
    ("[sensor.tip]", '[repeat.x]\ncount = 2\n[repeat.x.sensor."s{i"]', ["unclosed brace"]),
    ("[sensor.tip]", '[repeat.x]\ncount = 2\nindex = "l"\n[repeat.x.sensor."s{l}"]', ["is the name of a parameter"]),
    ("[sensor.tip]", '[repeat.x]\ncount = -2\n[repeat.x.sensor."s{i}"]', ["count is -2", "from 0"]),
    ("[sensor.tip]", '[constraint.c]\ntype = "distance"\nbetween = ["rod", "bob"]\nlength = 0\n[sensor.tip]', ["constraint.c.length", "must be positive"]),
    ("[sensor.tip]", '[constraint.c]\ntype = "coupling"\njoints = ["pivot"]\nfactors = [1, 2]\n[sensor.tip]', ["constraint.c.factors", "must have 1"]),
    ("[sensor.tip]", '[wheel.w]\ntype = "knife_edge"\nat = "bob"\nacross = [0, 1]\n[sensor.tip]', ["w is on the ground or on a point mass"]),
    ("[sensor.tip]", '[wheel.w]\ntype = "sphere"\nat = "rod"\nradius = 1\n[sensor.tip]', ["in the plane"]),
    ("[time]", "[gravity]\nvector = [0, 0, -9.81]\n[time]", ["gravity.vector", "has 3 elements", "must have 2"]),
    ("[time]", "[gravity]\nvektor = [0, -9.81]\n[time]", ['unknown key "vektor" of gravity', 'did you mean "vector"?']),
    ("[time]", "[model]\nmass = 1\n[time]", ['unknown key "mass" in [model]']),
    ("planar = true", 'planar = "yes"', ["planar", "true or false"]),
    ("planar = true\n", "", ["body.rod.inertia", "must be an array of numbers, not a number with a fraction; it must have 3 or 6"]),
]
WRONG_IN_SPACE = [
    ("across = [0, 1, 0]", "across = [2, 0, 0]", ["across is parallel to the axis"]),
    ("across = [0, 1, 0]", "across = [1, 1, 0]", ["axes that are not perpendicular", "90 degrees"]),
    ("across = [0, 1, 0]\n", "", ["across is missing"]),
    ("inertia = [1, 1, 1]\nposition = [0, 0, 1]", "inertia = [1, 1, 1, 1.1, 0, 0]\nposition = [0, 0, 1]", ["negative about one of its principal"]),
    ("inertia = [1, 1, 1]\nposition = [0, 0, 1]", "inertia = [1, 1, 1, 0.6, 0.6, -0.6]\nposition = [0, 0, 1]", ["negative about one of its principal"]),
    ("inertia = [1, 1, 1]\nposition = [0, 0, 1]", "inertia = [1, 1]\nposition = [0, 0, 1]", ["body.a.inertia", "must have 3 or 6"]),
    ("position = [0, 0, 2]", "position = [0, 0, 2]\neuler_parameters = [0, 0, 0, 0]", ["Euler parameters", "zero"]),
    ("position = [0, 0, 2]", "position = [0, 0, 2]\nrotation = [0, 0, 1]\neuler_parameters = [1, 0, 0, 0]", ["body.b.rotation", "together with"]),
    ("position = [0, 0, 1]", "position = [0, 0, 1.1]", ["w is 0.1000000 m above its plane", "assemble the start"]),
    ("type = \"disk\"", 'type = "disc"', ["wheel.w.type", 'did you mean "disk"?']),
    ("radius = 1\naxis = [1, 0, 0]", "radius = 1\naxis = [0, 0, 1]", ["w lies flat on its plane", "tilt it"]),
    ("radius = 1", "radius = -1", ["wheel.w.radius", "must be positive"]),
    ("type = \"universal\"", 'type = "screw"', ["pitch"]),
    ("type = \"universal\"", 'type = "primitive"\nhold = [1, 1, 1, 0, 0, 0]\npitch = 0.1', ["pitch"]),
    ("type = \"disk\"", 'type = "massless"\nsteer = "t"', ["w has only one of steer and its axis", "about or along"]),
    ("type = \"disk\"", 'type = "massless"\nabout = [0, 0, 1]', ["w has only one of steer and its axis"]),
    ("type = \"disk\"", 'type = "massless"\nalong = [0, 1, 0]', ["w slides along its plane"]),
    ("type = \"disk\"", 'type = "massless"\nturn = "t"', ["unknown key", "wheel.w"]),
    ("radius = 1\naxis = [1, 0, 0]", 'radius = 1\naxis = [1, 0, 0]\n[force.f]\ntype = "torsion"\njoint = "w"', ["no joint w"]),
]


class Wrong(Case):
    """Each is refused with exit code 2 by a message that names the file, the line, what is wrong and what to do."""

    def judge(self, base, cases):
        for old, new, says in cases:
            with self.subTest(new):
                self.assertIn(old, base)
                text = base.replace(old, new, 1)
                done = self.refused("check", self.scene(text), says=says)
                self.assertRegex(done.stderr, r"--> scene\.toml(:\d+:\d+)?")
                line = re.search(r"--> scene\.toml:(\d+)", done.stderr)
                if line:
                    # The line is one of those that were changed, or of the element whose key is missing or that stands on it.
                    self.assertLessEqual(int(line[1]), len(text.splitlines()) + 1)

    def test_base(self):
        self.tandem("check", self.scene(BASE))
        self.tandem("check", self.scene(SPACE))

    def test_wrong_files(self):
        self.assertGreaterEqual(len(WRONG) + len(WRONG_IN_SPACE), 60)
        self.judge(BASE, WRONG)

    def test_wrong_files_in_space(self):
        self.judge(SPACE, WRONG_IN_SPACE)

    def test_missing_keys(self):
        """Laws, motions and other functions that name a table, in elements of which each key in turn is missing."""
        table = '[function.table]\nat = [0, 1, 2, 3]\nvalues = [0, 0, 0, 0]\n\n'
        elements = {
            "force.f": ['type = "spring"', 'between = ["rod.tip", "bob"]', 'law = "table"', 'tension = "table"'],
            "force.g": ['type = "torsion"', 'joint = "pivot"', 'law = "table"', 'torque = "table"'],
            "force.h": ['type = "load"', 'on = "rod"', "force = [1, 0]", 'factor = "table"'],
            "force.r": ['type = "friction"', 'joint = "pivot"', "normal = 1", "dynamic = 0.1", "speed = 0.1"],
            "force.b": ['type = "bushing"', 'between = ["ground", "rod"]', "stiffness = [1, 1, 1]", "at = [0, 0]"],
            "constraint.d": ['type = "distance"', 'between = ["ground", "bob"]', "length = 1.4142135623730951"],
            "constraint.s": ['type = "coupling"', 'joints = ["pivot"]', "factors = [1]", 'motion = "table"'],
            "constraint.v": ['type = "velocity"', 'velocities = ["bob.vx"]', "coefficients = [1]", 'value = "table"'],
            "wheel.w": ['type = "knife_edge"', 'at = "rod"', "across = [0, 1]", 'steer = "table"'],
        }
        required = {"type", "between", "joint", "on", "dynamic", "speed", "joints", "factors", "velocities", "coefficients", "at",
                    "across"}
        # Keys without which another one would be needed.
        special = {("force.h", "force"): "force.h: has neither force nor torque", ("force.b", "at"): "bushing b has no position; add at",
                   ("force.r", "normal"): "friction r rotates and has no radius; a rotation requires the radius"}
        for head, keys in elements.items():
            for k, line in enumerate(keys):
                key = line.split(" ")[0]
                text = BASE + table + f"[{head}]\n" + "\n".join(keys[:k] + keys[k + 1:]) + "\n"
                with self.subTest(head=head, key=key):
                    if (head, key) in special:
                        self.refused("check", self.scene(text), says=special[head, key])
                    elif key in required:
                        self.refused("check", self.scene(text), says=f"{head}: the key {key} is missing; add it")
                    else:
                        self.tandem("check", self.scene(text))
        for key in ("at = [0, 1, 2, 3]\n", "values = [0, 0, 0, 0]\n"):
            self.refused("check", self.scene(BASE + table.replace(key, "")), says=f"the key {key.split()[0]} is missing")

    def test_lines(self):
        """The line is that of the key."""
        for old, new, line in (("mass = 1\n", "mass = -1\n", "mass = -1"), ("at = [0, 0]", "at = [0, 0, 0]", "at = [0, 0, 0]"),
                               ("stiffness = 10", 'stiffness = "k"', 'stiffness = "k"'), ("m = \"2*l\"", 'm = "2*n"', 'm = "2*n"'),
                               ('bodies = ["ground", "rod"]', 'bodies = ["ground", "rood"]', 'bodies = ["ground", "rood"]')):
            with self.subTest(new):
                text = BASE.replace(old, new, 1)
                number = text.splitlines().index(line) + 1
                self.refused("check", self.scene(text), says=f"scene.toml:{number}:")

    def test_settings(self):
        self.refused("check", self.scene(BASE), "--set", "body.rod.mass=-1", says=["--set:1", "body.rod.mass: must not be negative, but is -1"])
        self.refused("check", self.scene(BASE), "--set", "body.rod.mas=1", says=["--set", 'did you mean "mass"?'])
        self.refused("check", "rolling_disk", "--set", "body.rod.mass=1", says=["unknown table", "mechanism"])
        self.refused("check", self.scene(BASE), "--set", "parameters.l.down=1", says=["--set:1", "parameters.l.down has a dot in its name"])
        # The mark is under the value, a list or an inline table too.
        for setting, places in (("body.rod.position=[1,2,3]", "19-25"), ('body.rod.points={ end = "x" }', "25-27"),
                                ("parameters.l=[1, 2]", "14-19")):
            with self.subTest(setting):
                self.refused("check", self.scene(BASE), "--set", setting, says=f"--set:1:{places}")


class Unmoved(Case):
    def test_without_a_freedom_nothing_is_printed(self):
        """No stepper calls LAPACK for systems without unknowns, which it reports on stdout."""
        scene = self.scene("""
[scene]
model = "mechanism"
planar = true
[gravity]
vector = [0, -9.81]
[body.rod]
mass = 1.0
inertia = 0.1
position = [1, 0]
[joint.clamp]
type = "fixed"
bodies = ["ground", "rod"]
at = [0, 0]
[time]
end = 1.0
""")
        for stepper in "rk4", "trapezoid", "sdirk54", "radau5":
            with self.subTest(stepper):
                done = self.tandem("run", scene, "--set", f"solver.stepper={stepper}", "--set", "solver.step=0.5", "--quiet", "--force",
                                   "--no-error", "--output", "out.h5")
                self.assertEqual(done.stdout, "")


class ManyReactions(Case):
    def judge(self, numbers, *command):
        """Four times as many joints take four times the processor time; more where each looks through the rows of all."""
        scene = self.scene("""
[scene]
model = "mechanism"
[repeat.copy]
count = "n"
[repeat.copy.body."arm{i}"]
mass = 1.0
inertia = [0.1, 0.1, 0.1]
position = ["i", 0, 0]
[repeat.copy.joint."hinge{i}"]
type = "revolute"
bodies = ["ground", "arm{i}"]
at = ["i - 0.5", 0, 0]
axis = [0, 0, 1]
[results]
joints = "all"
[parameters]
n = 1
[time]
end = 0.002
""")
        seconds = []
        for n in numbers:
            before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
            self.tandem(*command, scene, "--set", f"parameters.n={n}")
            seconds.append(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before)
        self.assertLess(seconds[1], 7 * seconds[0])

    def test_reactions_of_all_joints_are_read_in_proportion_to_their_number(self):
        self.judge((4000, 16000), "show")

    def test_and_written(self):
        """Work grows faster if each dataset is compared with all earlier ones, or the time lists its users anew with each. With 400 and
        more HDF5 had no room for the metadata of the datasets, and none of them could be written."""
        self.judge((150, 600), "run", "--no-error", "--quiet", "--force", "--output", "many.h5")
        with h5py.File(self.folder / "many.h5") as file:
            self.assertEqual(len(file["joints"]), 600)
            time, fields = file["trajectory/time"], [*file["trajectory"].values(), *file["diagnostics"].values()]
            users = time.attrs["REFERENCE_LIST"]
            self.assertEqual(len(users), 6 * 600 + sum("DIMENSION_LIST" in field.attrs for field in fields))
            self.assertIn(file[users[-1][0]], [file[f"joints/hinge600/{what}"] for what in ("angle", "rate", "torque_body")])
            self.assertEqual(file["joints/hinge577/force"].dims[0][0], time)
        self.tandem("verify", "many.h5")


if __name__ == "__main__":
    unittest.main()
