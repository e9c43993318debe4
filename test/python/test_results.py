# SPDX-License-Identifier: MIT
"""Results of mechanisms: bodies, reactions, forces and the balance of energies, against statics, closed forms and Newton's law."""

import json
import tomllib
import unittest

import h5py
import numpy as np
from test_mechanisms import MECHANISMS, Mechanism, rotation
from test_output import ROOT

KINDS = ["bodies", "joints", "wheels", "constraints", "forces"]
EVERYTHING = [f'results.{kind}="all"' for kind in KINDS] + ["results.balance=true"]
TIGHT = '[solver]\nstepper = "dop853"\nrtol = 1e-11\n'
SPACE = '[scene]\nmodel = "mechanism"\n\n[gravity]\nvector = [0, 0, -9.81]\n\n'
PLANE = '[scene]\nmodel = "mechanism"\nplanar = true\n\n[gravity]\nvector = [0, -9.81]\n\n'


def between(data):
    return [name.decode().strip() if isinstance(name, bytes) else name.strip() for name in data.attrs["between"]]


def energies(file):
    """The largest residual of the balance, and what it is small against."""
    balance = {name: data[:] for name, data in file["balance"].items()}
    scale = np.max(balance["kinetic"]) + np.ptp(balance["potential"]) + np.max(np.abs(balance["work_of_motions"])) + \
        np.max(np.abs(balance["work_of_forces"]))
    # Between steps the motion is as accurate as the dense output.
    ends = file["diagnostics/step"][:] > 0
    return np.max(np.abs(balance["residual"][ends])), scale


class Drawing(Mechanism):
    """The geometry in files, which viewers use: parameters, expressions and repetitions are resolved."""

    def elements(self, file):
        """Kind, name, body, position, axis and sizes of each entry."""
        drawing = file["drawing"]
        return [(kind.decode(), name.decode(), int(row[0]), row[1:4], row[4:7], row[7:])
                for kind, name, row in zip(drawing["kind"], drawing["name"], drawing["elements"], strict=True)]

    def test_sides_of_joints_meet(self):
        """In the reference configuration both sides of each joint and each axis agree, if the start is not assembled."""
        count = 0
        for name in MECHANISMS:
            if "assemble" in (ROOT / "scenes" / f"{name}.toml").read_text():
                continue
            with self.subTest(name):
                self.tandem("show", name, "--drawing", f"{name}.h5")
                with h5py.File(self.folder / f"{name}.h5") as file:
                    bodies, joints = file["drawing/bodies"][:], [one for one in self.elements(file) if one[0].startswith("joint ")]
                for one, other in zip(joints[::2], joints[1::2], strict=True):
                    self.assertEqual(one[:2], other[:2])
                    ends = []
                    for _, _, body, position, axis, _ in (one, other):
                        turn, place = (rotation(bodies[body - 1, 10:]), bodies[body - 1, 7:10]) if body else (np.eye(3), np.zeros(3))
                        ends.append((place + turn @ position, turn @ axis))
                    self.near(ends[0][1], ends[1][1], 1e-14)
                    # Lengths are of order 1 m.
                    if one[0] == "joint revolute":
                        self.near(ends[0][0], ends[1][0], 1e-9)
                        count += 1
        self.assertGreater(count, 20)

    def test_numbers_of_every_kind(self):
        text = SPACE + '[parameters]\nl = 0.4\n[body.post]\nmass = "5*l"\ninertia = [1, 2, 2, 0.1, 0.2, 0.3]\nposition = ["2*l", 0, 1]\n' \
            'rotation = [0, 0, "pi/2"]\npoints = { tip = ["l/2", 0, 0.1] }\n[joint.axle]\ntype = "revolute"\nbodies = ["ground", "post"]\n' \
            'at = [0, 0, 1]\naxis = [1, 0, 0]\n[force.coil]\ntype = "spring"\nbetween = ["ground", "post.tip"]\nstiffness = 1\n' \
            '[force.motor]\ntype = "torsion"\njoint = "axle"\nstiffness = 1\n[force.push]\ntype = "load"\non = "post:[0, l, 0]"\n' \
            'force = [1, 0, 0]\n[sensor.pull]\nforce = "coil"\n[sensor.tip]\npoint = "post.tip"\n[repeat.row]\ncount = 2\n' \
            '[repeat.row.body."ball{i}"]\nshape = { sphere = "i*l" }\ndensity = 1\nposition = ["i", 0, 0]\n[time]\nend = 0.01\n'
        with self.went(self.scene(text)) as file:
            found, bodies = self.elements(file), file["drawing/bodies"][:]
            self.assertEqual([name.decode() for name in file["drawing/body"]], ["post", "ball1", "ball2"])
            self.near(file["drawing/gravity"][:], [0, 0, -9.81], 1e-15)
        self.near(bodies[0], [2, 1, 2, 2, 0.1, 0.2, 0.3, 0.8, 0, 1, np.sqrt(0.5), 0, 0, np.sqrt(0.5)], 1e-15)
        nothing = [0.0]*3
        wanted = [("shape sphere", "ball1", 2, nothing, nothing, [0.4, 0, 0]), ("shape sphere", "ball2", 3, nothing, nothing, [0.8, 0, 0]),
                  ("joint revolute", "axle", 0, [0, 0, 1], [1, 0, 0], nothing),
                  ("joint revolute", "axle", 1, [0, 0.8, 0], [0, -1, 0], nothing),
                  ("force spring", "coil", 0, nothing, nothing, nothing), ("force spring", "coil", 1, [0.2, 0, 0.1], nothing, nothing),
                  ("force torsion", "motor", 0, [0, 0, 1], [1, 0, 0], nothing),
                  ("force torsion", "motor", 1, [0, 0.8, 0], [0, -1, 0], nothing),
                  ("force load", "push", 1, [0, 0.4, 0], nothing, nothing), ("point", "tip", 1, [0.2, 0, 0.1], nothing, nothing),
                  ("sensor force coil", "pull", 0, nothing, nothing, nothing),
                  ("sensor point", "tip", 1, [0.2, 0, 0.1], nothing, nothing)]
        self.assertEqual([one[:3] for one in found], [one[:3] for one in wanted])
        for one, other in zip(found, wanted, strict=True):
            with self.subTest(one[:2]):
                self.near(np.array(one[3:]), np.array(other[3:]), 1e-15)

    def test_a_plane_that_turns(self):
        """Values and rates of its angle, also after a later end."""
        with self.went("turntable", "time.end=0.1") as file:
            self.assertEqual([name.decode() for name in file["drawing/function"]], ["contact rotation"])
            first = file["drawing/functions"][:]
        self.tandem("resume", "out.h5", "--set", "time.end=0.2", "--quiet", "--no-error")
        with h5py.File(self.folder / "out.h5") as file:
            second = file["drawing/functions"][:]
        for samples, end in ((first, 0.1), (second, 0.2)):
            self.near(samples[[0, -1], 0], [0, end], 1e-15)
            self.near(samples[:, 1:], np.stack([3*samples[:, 0], np.full(len(samples), 3.0)], axis=1), 1e-14)
        self.tandem("verify", "out.h5")

    def test_other_models_have_none(self):
        with self.went("rolling_disk", "time.end=0.1") as file:
            self.assertNotIn("drawing", file)


class Statics(Mechanism):
    """Mechanisms at rest: rounding of numbers of about 100, a hundred times."""

    BOUND = 1e-12

    def test_cantilever(self):
        text = SPACE + '[body.arm]\nmass = 2\ninertia = [0.1, 0.2, 0.3]\nposition = [0.5, 0.2, 0]\nrotation = [0, 0, 1]\n\n' \
            '[joint.wall]\ntype = "fixed"\nbodies = ["ground", "arm"]\nat = [0, 0, 0]\n\n[results]\njoints = ["wall"]\n' \
            '\n[time]\nend = 0.1\n'
        with self.went(self.scene(text)) as file:
            wall = file["joints/wall"]
            force, torque = np.array([0, 0, 2*9.81]), np.cross([0.5, 0.2, 0], [0, 0, 2*9.81])
            self.near(wall["force"][:], force, 20*self.BOUND)
            # About the joint's point, the origin: it holds the weight at the centre of mass.
            self.near(wall["torque"][:], torque, 20*self.BOUND)
            turn = np.array([[np.cos(1), np.sin(1), 0], [-np.sin(1), np.cos(1), 0], [0, 0, 1]])
            self.near(wall["force_body"][:], turn @ force, 20*self.BOUND)
            self.near(wall["torque_body"][:], turn @ torque, 20*self.BOUND)
            self.assertEqual(between(wall["force"]), ["ground", "arm"])
            self.assertEqual([wall["force"].attrs["unit"], wall["torque"].attrs["unit"]], ["N", "N m"])
            self.assertEqual(list(wall["force"].attrs["names"]), ["x", "y", "z"])
            self.assertNotIn("undetermined", wall["force"].attrs)

    def test_reversed_sides(self):
        """The ground as second body: the opposite force, the opposite torque."""
        text = SPACE + '[body.arm]\nmass = 2\ninertia = [0.1, 0.2, 0.3]\nposition = [0.5, 0.2, 0]\n\n' \
            '[joint.wall]\ntype = "fixed"\nbodies = ["arm", "ground"]\nat = [0, 0, 0]\n\n[results]\njoints = "all"\n\n[time]\nend = 0.1\n'
        with self.went(self.scene(text)) as file:
            self.near(file["joints/wall/force"][:], [0, 0, -2*9.81], 20*self.BOUND)
            self.near(file["joints/wall/torque"][:], -np.cross([0.5, 0.2, 0], [0, 0, 2*9.81]), 20*self.BOUND)

    def test_beam(self):
        """A beam on a hinge and a roller in the plane, with a load: the supports carry by the lever."""
        text = PLANE + '[body.beam]\nmass = 3\ninertia = 1\nposition = [1, 0]\n\n' \
            '[joint.hinge]\ntype = "revolute"\nbodies = ["ground", "beam"]\nat = [0, 0]\n\n' \
            '[joint.roller]\ntype = "point_on_line"\nbodies = ["ground", "beam"]\nat = [2, 0]\naxis = [1, 0]\n\n' \
            '[force.push]\ntype = "load"\non = "beam:[0.5, 0]"\nforce = [5, -40]\n\n[results]\njoints = "all"\nforces = "all"\n\n' \
            '[time]\nend = 0.1\n'
        with self.went(self.scene(text)) as file:
            self.near(file["joints/hinge/force"][:], [-5, 3*9.81/2 + 10, 0], 100*self.BOUND)
            self.near(file["joints/roller/force"][:], [0, 3*9.81/2 + 30, 0], 100*self.BOUND)
            self.near(file["forces/push/force"][:], [5, -40, 0], self.BOUND)

    def test_door(self):
        """A hinge and a point that is held along its axis too: what they share is undetermined, and named; the rest is not."""
        text = SPACE + '[body.door]\nmass = 10\ninertia = [1, 1, 2]\nposition = [0.5, 0, 0]\n\n' \
            '[joint.upper]\ntype = "revolute"\nbodies = ["ground", "door"]\nat = [0, 0, 1]\naxis = [0, 0, 1]\n\n' \
            '[joint.lower]\ntype = "point_on_plane"\nbodies = ["ground", "door"]\nat = [0, 0, -1]\naxis = [0, 0, 1]\n\n' \
            '[results]\njoints = "all"\n\n[time]\nend = 0.1\n'
        with self.went(self.scene(text)) as file:
            upper, lower = file["joints/upper"], file["joints/lower"]
            self.near(upper["force"][:] + lower["force"][:], [0, 0, 98.1], 1e-10)
            self.near(upper["torque"][:], np.cross([0.5, 0, -1], [0, 0, 98.1]), 1e-10)
            self.assertEqual(upper["force"].attrs["undetermined"], "z")
            self.assertEqual(lower["force_body"].attrs["undetermined"], "z")
            self.assertNotIn("undetermined", upper["torque"].attrs)
        text = text.replace('type = "revolute"', 'type = "spherical"').replace("axis = [0, 0, 1]\n", "", 1)
        with self.went(self.scene(text.replace("point_on_plane", "point_on_line"))) as file:
            self.assertNotIn("undetermined", file["joints/upper/force"].attrs)
            self.near(file["joints/upper/force"][:], [-24.525, 0, 98.1], 1e-10)
            self.near(file["joints/lower/force"][:], [24.525, 0, 0], 1e-10)


class Motions(Mechanism):
    def test_pendulum(self):
        """From horizontal at rest the rod pulls with 3 m g cos(theta). Bounds: 1e-10 of the force."""
        with self.went("a01_pendulum", 'results.constraints="all"', 'results.bodies="all"') as file:
            rod, bob = file["constraints/rod"], file["bodies/bob"]
            place = bob["position"][:]
            self.near(rod["tension"][:], -3*9.81*place[:, 1], 3e-9)
            self.near(rod["force"][:], -rod["tension"][:][:, None]*place, 1e-10)
            self.assertNotIn("orientation", bob)
            self.near(bob["kinetic_energy"][:] + bob["potential_energy"][:], 0, 1e-9)

    def test_pendulum_of_a_body(self):
        """A rod of length 1 on a hinge, from horizontal at rest: along the rod 5/2 m g cos(theta), across it m g sin(theta)/4."""
        text = PLANE + '[body.rod]\nmass = 2\ninertia = "1/6"\nposition = [0.5, 0]\n\n[joint.pivot]\ntype = "revolute"\n' \
            'bodies = ["ground", "rod"]\nat = [0, 0]\n\n[results]\njoints = "all"\nbodies = "all"\n\n[time]\nend = 3\n\n' + TIGHT
        with self.went(self.scene(text)) as file:
            force = file["joints/pivot/force_body"][:]
            angle = file["bodies/rod/orientation"][:]
            # The rod's x axis points away from the pivot, at theta = angle + 90 degrees from the vertical down.
            self.near(force[:, 0], 2.5*2*9.81*np.sin(angle), 3e-9)
            self.near(force[:, 1], 2*9.81*np.cos(angle)/4, 3e-9)
            self.near(file["joints/pivot/torque"][:], 0, 1e-11)
            self.near(file["joints/pivot/angle"][:], angle, 1e-15)

    def test_governor(self):
        """A rod on a shaft that turns steadily, at 60 degrees from the vertical: omega^2 = 3 g/(2 l cos). The hinge carries its
        weight and the centripetal force, and no torque; the shaft needs none."""
        text = SPACE + '[parameters]\nw = "sqrt(3*9.81)"\n\n[body.shaft]\nmass = 1\ninertia = [0.1, 0.1, 0.1]\nposition = [0, 0, 0]\n' \
            'omega = [0, 0, "w"]\n\n[body.rod]\nmass = 0.8\ninertia = [1e-9, "0.8/12", "0.8/12"]\n' \
            'position = ["sin(pi/3)/2", 0, "-cos(pi/3)/2"]\nrotation = [0, "pi/6", 0]\nomega = [0, 0, "w"]\n' \
            'velocity = [0, "w*sin(pi/3)/2", 0]\n\n[joint.axle]\ntype = "revolute"\nbodies = ["ground", "shaft"]\nat = [0, 0, 0]\n' \
            'axis = [0, 0, 1]\nmotion = "w*t"\n\n[joint.hinge]\ntype = "revolute"\nbodies = ["shaft", "rod"]\nat = [0, 0, 0]\n' \
            'axis = [0, 1, 0]\n\n[results]\njoints = "all"\nbodies = "all"\n\n[time]\nend = 3\n\n' + TIGHT + 'chart_kind = "dense"\n'
        # A rod with the moment 1e-9 about itself leans by as much less. On sparse charts its reactions have an error of 1e-8 of the
        # force, since moments of inertia of one body differ by 1e8.
        with self.went(self.scene(text)) as file:
            w, force = np.sqrt(3*9.81), file["joints/hinge/force"][:]
            place = file["bodies/rod/position"][:]
            self.near(place[:, 2], -0.25, 1e-8)
            self.near(force[:, 2], 0.8*9.81, 1e-6)
            self.near(force[:, :2], -0.8*w**2*place[:, :2], 1e-6)
            self.near(file["joints/hinge/torque"][:], 0, 1e-7)
            self.near(file["joints/axle/power"][:], 0, 1e-6)
            self.near(file["joints/axle/angle"][:], w*file["joints/axle/time"][:], 1e-11)

    def test_motor(self):
        """A flywheel driven by angle = t^2: torque J phi'', power J phi'' phi', work J phi'^2/2."""
        text = SPACE + '[body.wheel]\nmass = 1\ninertia = [1, 1, 1.5]\nposition = [0, 0, 0]\n\n[joint.motor]\ntype = "revolute"\n' \
            'bodies = ["ground", "wheel"]\nat = [0, 0, 0]\naxis = [0, 0, 1]\nmotion = "t^2"\n\n[sensor.drive]\nreaction = "motor"\n\n' \
            '[sensor.energies]\nbalance = true\n\n[initial]\nassemble = true\n\n[time]\nend = 2\n\n' + TIGHT
        with self.went(self.scene(text)) as file:
            t, drive, balance = file["trajectory/time"][:], file["sensors/drive"], file["sensors/energies"]
            self.near(drive["torque"][:, 2], 3, 1e-11)
            self.near(drive["power"][:], 6*t, 1e-11)
            self.near(balance["work_of_motions"][:], 3*t**2, 1e-10)
            self.near(balance["residual"][:], 0, 1e-10)
            self.assertEqual(drive["power"].attrs["unit"], "W")

    def test_oscillator(self):
        """A mass on a spring and a damper along a line: its motion is known, and with it force, length, energy, power, work."""
        text = PLANE.replace("-9.81", "0") + '[body.mass]\nmass = 1\nposition = [3, 0]\n\n[joint.line]\ntype = "point_on_line"\n' \
            'bodies = ["ground", "mass"]\nat = [3, 0]\naxis = [1, 0]\n\n[force.coil]\ntype = "spring"\nbetween = ["ground", "mass"]\n' \
            'stiffness = 25\ndamping = 6\nlength = 2\n\n[results]\nforces = "all"\njoints = "all"\nbalance = true\n\n[time]\nend = 3\n\n' + TIGHT
        with self.went(self.scene(text)) as file:
            t, coil = file["trajectory/time"][:], file["forces/coil"]
            x = np.exp(-3*t)*(np.cos(4*t) + 0.75*np.sin(4*t))
            v = -np.exp(-3*t)*6.25*np.sin(4*t)
            for name, value in {"length": 2 + x, "rate": v, "tension": 25*x + 6*v, "energy": 12.5*x**2, "power": -6*v**2}.items():
                with self.subTest(name):
                    self.near(coil[name][:], value, 3e-9)
            self.near(file["balance/work_of_forces"][:], v**2/2 + 12.5*x**2 - 12.5, 3e-9)
            self.near(file["joints/line/displacement"][:], x - 1, 3e-10)
            self.near(coil["force"][:, 0], -(25*x + 6*v), 3e-9)


class Tables(Mechanism):
    """Functions that are tables of points."""

    TEXT = PLANE.replace("-9.81", "0") + """[function.stroke]
at = [0, 0.2, 0.5, 1.0]
values = [0, "2*a", 0.05, 0.02]

[function.buffer]
at = [0.10, 0.20, 0.30]
values = [-80, 0, 5]
type = "linear"

[parameters]
a = 0.005

[body.table]
mass = 2.0
inertia = 0.01
position = [0, 0]

[body.bumper]
mass = 0.1
position = [0.2, 0]

[joint.actuator]
type = "prismatic"
bodies = ["ground", "table"]
at = [0, 0]
axis = [1, 0]
motion = "stroke"

[joint.rail]
type = "point_on_line"
bodies = ["ground", "bumper"]
at = [0.2, 0]
axis = [1, 0]

[force.buffer_spring]
type = "spring"
between = ["table", "bumper"]
law = "buffer"

[results]
joints = ["actuator"]
forces = "all"

[initial]
assemble = true

[output]
interval = 0.1

[time]
end = 1.0
"""

    def test_motion_and_law(self):
        """The path goes through the points, and the tension is that of the table at the length of the spring."""
        with self.went(self.scene(self.TEXT)) as file:
            t, way = file["trajectory/time"][:], file["joints/actuator/displacement"][:]
            self.near([way[np.argmin(np.abs(t - x))] for x in (0, 0.2, 0.5, 1.0)], [0, 0.01, 0.05, 0.02], 1e-13)
            coil = file["forces/buffer_spring"]
            self.assertGreater(np.ptp(coil["length"][:]), 1e-3)
            self.near(coil["tension"][:], np.interp(coil["length"][:], [0.1, 0.2, 0.3], [-80, 0, 5]), 1e-11)
        checked = json.loads(self.tandem("check", "scene.toml", "--json").stdout)
        self.assertTrue(all(procedure["passed"] for procedure in checked["procedures"]))
        shown = self.tandem("show", "scene.toml").stdout
        self.assertEqual(self.tandem("show", self.scene(shown)).stdout.splitlines()[2:], shown.splitlines()[2:])

    def test_wrong_tables(self):
        for old, new, says in (("0.2, 0.5", "0.5, 0.2", ["stroke", "0.2"]), ('[0, "2*a", 0.05, 0.02]', "[0, 1]", ["values", "4"]),
                               ('"linear"', '"square"', ["linear"]), ("[0, 0.2, 0.5, 1.0]", "[0]", ["function.stroke.at"]),
                               ('motion = "stroke"', 'motion = "stroke(t)"', ["stroke"]),
                               ('law = "buffer"', 'law = "bufer"', ["bufer"])):
            with self.subTest(new):
                self.refused("check", self.scene(self.TEXT.replace(old, new, 1)), says=says)


class Friction(Mechanism):
    """Friction along a joint under a given normal force (Brown and McPhee)."""

    def block(self, more, rest="", velocity=0.0):
        return PLANE.replace("-9.81", "0") + f'[body.block]\nmass = 2\nposition = [1, 0]\nvelocity = [{velocity}, 0]\n\n' \
            '[joint.line]\ntype = "point_on_line"\nbodies = ["ground", "block"]\nat = [1, 0]\naxis = [1, 0]\n\n' \
            f'[force.rub]\ntype = "friction"\njoint = "line"\nnormal = 20\n{more}\n\n[results]\njoints = ["line"]\nforces = "all"\n' \
            f'balance = true\n\n[time]\nend = 1\n\n{rest}' + TIGHT

    def test_slides_and_stops(self):
        """With one coefficient m v' = -mu N tanh(4 v/v_t): sinh(4 v/v_t) falls by exp(-4 mu N t/(m v_t))."""
        with self.went(self.scene(self.block("dynamic = 0.3\nspeed = 0.1", velocity=2.0))) as file:
            t, v = file["trajectory/time"][:], file["joints/line/speed"][:]
            expected = 0.1/4*np.arcsinh(np.sinh(80)*np.exp(-4*0.3*20/(2*0.1)*t))
            self.near(v, expected, 1e-9)
            self.assertLess(v[-1], 1e-6)
            self.near(file["forces/rub/power"][:], file["forces/rub/force"][:]*v, 1e-12)
            residual, scale = energies(file)
            # A hundred tolerances of a step, of the energy at the start.
            self.assertLess(residual, 1e-9*scale)

    def test_stick_slip(self):
        """A block on a belt of 0.1 m/s, held by a spring: sticks, slips, sticks. Against RK4 with 1e-5 s of the same law."""
        belt = '[body.belt]\nmass = 1\ninertia = 1\nposition = [0, 0]\nvelocity = [0.1, 0]\n\n[joint.drive]\ntype = "prismatic"\n' \
            'bodies = ["ground", "belt"]\nat = [0, 0]\naxis = [1, 0]\nmotion = "0.1*t"\n\n[force.coil]\ntype = "spring"\n' \
            'between = ["ground", "block"]\nstiffness = 200\n\n'
        text = self.block("dynamic = 0.2\nstatic = 0.5\nspeed = 0.01", belt)
        text = text.replace('bodies = ["ground", "block"]', 'bodies = ["belt", "block"]').replace('["line"]', '"all"')

        def rate(y):
            u = (y[1] - 0.1)/0.01
            return np.array([y[1], (-200*y[0] - 20*(0.2*np.tanh(4*u) + 0.3*u/(u*u/4 + 0.75)**2))/2])

        # The block begins at rest on the moving belt: it slips at once, and sticks later.
        y, h, found = np.array([0.0, 0.0]), 1e-5, {}
        for step in range(1, 100001):
            a = rate(y)
            b = rate(y + h/2*a)
            c = rate(y + h/2*b)
            y = y + h/6*(a + 2*b + 2*c + rate(y + h*c))
            if step % 10000 == 0:
                found[step//10000] = y
        for stepper in ("dop853", "radau5"):
            with self.subTest(stepper), self.went(self.scene(text), f'solver.stepper="{stepper}"', "solver.rtol=1e-9",
                                                  "output.interval=0.1") as file:
                length, speed = file["forces/coil/length"][:] - 1, file["forces/coil/rate"][:]
                self.assertTrue(np.any(np.abs(speed - 0.1) < 2e-3) and np.any(speed < 0))
                for k, (x, v) in found.items():
                    self.near([length[k], speed[k]], [x, v], 1e-6)
        checked = json.loads(self.tandem("check", "scene.toml", "--json").stdout)
        # Far above the transition speed next to nothing is left of the derivative, beside differences of 20 N.
        self.assertLessEqual(max(procedure["error"] for procedure in checked["procedures"]), 1e-8)

    def test_a_pendulum_that_sticks(self):
        """A rod on a hinge with friction swings, and sticks beside the vertical. Against RK4 with 1e-5 s of the same law; it rests where
        the moment of its weight is below that of sticking."""
        text = PLANE + '[body.rod]\nmass = 2\ninertia = "1/6"\nposition = [0.5, 0]\n\n[joint.pivot]\ntype = "revolute"\n' \
            'bodies = ["ground", "rod"]\nat = [0, 0]\n\n[force.rub]\ntype = "friction"\njoint = "pivot"\nnormal = 10\ndynamic = 0.2\n' \
            'static = 0.4\nspeed = 0.05\n\n[results]\njoints = "all"\nforces = "all"\nbalance = true\n\n[time]\nend = 2\n\n' + TIGHT

        def rate(y):
            u = y[1]/0.05
            return np.array([y[1], (-9.81*np.cos(y[0]) - 10*(0.2*np.tanh(4*u) + 0.2*u/(u*u/4 + 0.75)**2))/(2/3)])

        y, h, found = np.array([0.0, 0.0]), 2e-5, {}
        for step in range(1, 100001):
            a = rate(y)
            b = rate(y + h/2*a)
            c = rate(y + h/2*b)
            y = y + h/6*(a + 2*b + 2*c + rate(y + h*c))
            if step % 12500 == 0:
                found[step//12500] = y
        with self.went(self.scene(text), "output.interval=0.25") as file:
            angle, speed = file["joints/pivot/angle"][:], file["joints/pivot/rate"][:]
            for k, (x, v) in found.items():
                self.near([angle[k], speed[k]], [x, v], 1e-7)
            residual, scale = energies(file)
            self.assertLess(residual, 1e-9*scale)
        with self.went(self.scene(text), 'solver.stepper="radau5"', "solver.rtol=1e-8", "time.end=12") as file:
            angle, speed = file["joints/pivot/angle"][-1], file["joints/pivot/rate"][-1]
            self.assertLess(abs(speed), 0.05)
            self.assertLess(abs(9.81*np.cos(angle)), 4)

    def test_wrong_friction(self):
        for more, says in (("dynamic = 0.3", "speed"), ("dynamic = 0.3\nstatic = 0.2\nspeed = 1", "static"),
                           ("dynamic = -0.3\nspeed = 1", "dynamic"), ("speed = 0\ndynamic = 1", "speed")):
            with self.subTest(more):
                self.refused("check", self.scene(self.block(more)), says=says)


class EveryScene(Mechanism):
    """Newton's law for each body from what the file says, to 1e-10 of the largest force, and the balance of energies."""

    def test_forces_and_energies(self):
        for name in MECHANISMS:
            with self.subTest(name):
                scene = tomllib.loads((ROOT / "scenes" / f"{name}.toml").read_text())
                rtol = scene.get("solver", {}).get("rtol", 0)
                settings = ["time.end=0.5"] if scene["time"]["end"] > 0.5 else []
                # Masses are read from the potential energy.
                if "gravity" not in scene:
                    scene["gravity"] = {"vector": [0.3, 0.2] if scene["scene"].get("planar") else [0.3, 0.2, 0.1]}
                    settings.append(f"gravity.vector={scene['gravity']['vector']}")
                if not rtol:
                    # Fixed steps have no tolerance to compare with.
                    rtol = 1e-9
                    settings += ['solver.stepper="dop853"', "solver.rtol=1e-9", "solver.atol=0"]
                with self.went(name, *EVERYTHING, *settings) as file:
                    residual, scale = energies(file)
                    self.assertLess(residual, 10*rtol*scale)
                    gravity = np.append(np.array(scene["gravity"]["vector"], float), 0)[:3]
                    for body, data in file["bodies"].items():
                        self.check_body(body, data, gravity, file)

    def check_body(self, body, data, gravity, file):
        height = -data["position"][:] @ gravity
        row = np.argmax(np.abs(height))
        mass = data["potential_energy"][row]/height[row] if height[row] else 0
        force = np.zeros((len(height), 3))
        largest = mass*max(np.max(np.abs(gravity)), np.max(np.abs(data["acceleration"][:])))
        for kind in set(KINDS[1:]) & set(file):
            for element in file[kind].values():
                if "force" not in element or element["force"].ndim < 2:
                    continue
                first, second = between(element["force"])
                sign = (second == body) - (first == body)
                force += sign*element["force"][:]
                largest = max(largest, np.max(np.abs(sign*element["force"][:])))
        self.near(mass*data["acceleration"][:] - mass*gravity - force, 0, 1e-10*max(largest, 1e-300))


class Contract(Mechanism):
    def test_nothing_asked_for(self):
        """Without results no group, no multiplier; with them, bitwise the same steps."""
        with self.went("a04_bricard", "time.end=0.3") as file:
            self.assertFalse(set(KINDS + ["balance"]) & set(file))
            plain, report = file["trajectory/q"][:], dict(file["report"].attrs)
        self.assertEqual(report.get("multipliers", 0), 0)
        with self.went("a04_bricard", "time.end=0.3", *EVERYTHING) as file:
            np.testing.assert_array_equal(file["trajectory/q"][:], plain)
            self.assertEqual(file["report"].attrs["steps"], report["steps"])

    def test_resumed(self):
        """The work of a resumed run equals that of an uninterrupted run, bit by bit."""
        settings = [word for setting in EVERYTHING + ["time.end=0.3"] for word in ("--set", setting)]
        self.tandem("run", "mechanism_motorcycle", *settings, "--output", "whole.h5", "--quiet", "--no-error")
        settings += ["--set", "solver.max_steps=100"]
        self.tandem("run", "mechanism_motorcycle", *settings, "--output", "part.h5", "--quiet", "--no-error", code=1)
        self.tandem("resume", "part.h5", "--set", "solver.max_steps=1000000", "--quiet")
        with h5py.File(self.folder / "whole.h5") as whole, h5py.File(self.folder / "part.h5") as part:
            self.assertGreater(np.max(np.abs(whole["balance/work_of_motions"][:])), 0)
            for group in KINDS + ["balance"]:
                def same(path, data, group=group):
                    if isinstance(data, h5py.Dataset):
                        np.testing.assert_array_equal(data[:], part[f"{group}/{path}"][:], err_msg=f"{group}/{path}")
                if group in whole:
                    whole[group].visititems(same)

    def test_interval(self):
        """Rows between the steps have the work up to there."""
        with self.went("mechanism_motorcycle", "time.end=0.5", "output.interval=0.00317", "results.balance=true") as file:
            residual, scale = energies(file)
            self.assertLess(residual, 1e-9*scale)

    def test_wrong_results(self):
        wrong = {
            'results.joints=["a"]': ["joints", "a"], 'results.joints="some"': ["all"], "results.bodies=1": ["results.bodies"],
            'results.joint="all"': ["joints"], 'results.bodies=["crank", "rud"]': ["rud", "did you mean", "rod"],
            'results.bodies=["crank", "crank"]': ["crank"], 'sensor.s.reaction="crank"': ["crank", "not a joint"],
            'sensor.s.force="motor"': ["motor", "not a force"], 'sensor.s.body="motor"': ["motor", "no body"],
            "results.balance=3": ["balance"],
        }
        for setting, says in wrong.items():
            with self.subTest(setting):
                self.refused("check", "slider_crank", "--set", setting, says=says)

    def test_shown(self):
        """`show` prints the requested results, as a scene that can be run; sensors may have the names of elements."""
        shown = self.tandem("show", "slider_crank", *[word for setting in EVERYTHING for word in ("--set", setting)]).stdout
        self.assertIn('joints = "all"', shown)
        self.assertTrue(json.loads(self.tandem("check", self.scene(shown), "--json").stdout))


if __name__ == "__main__":
    unittest.main()
