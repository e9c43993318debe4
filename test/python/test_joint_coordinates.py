# SPDX-License-Identifier: MIT
"""Coordinates of joints: their zero, their turns, the branch of an imposed angle, the sign of forces along them, and their names; against
closed forms of rotors and sliders."""

import unittest

import numpy as np
from test_mechanisms import Mechanism, rotation

SPACE = '[scene]\nmodel = "mechanism"\n'
PLANE = SPACE + "planar = true\n"
TIGHT = '[solver]\nstepper = "dop853"\nrtol = 1e-11\n'
END = "[time]\nend = 1\n"


def rotor(hinge, more="", time=END, axis=(0, 0, 1), body=""):
    """A body of moment of inertia 0.5 about an axis through its centre of mass."""
    return f"{SPACE}[body.rotor]\nmass = 1\ninertia = [0.5, 0.5, 0.5]\nposition = [0, 0, 0]\n{body}[joint.hinge]\n{hinge}\n" \
        f'bodies = ["ground", "rotor"]\nat = [0, 0, 0]\naxis = {list(axis)}\n{more}[results]\njoints = "all"\nforces = "all"\n' \
        f"bodies = \"all\"\nbalance = true\n{time}{TIGHT}"


REVOLUTE = 'type = "revolute"'


class Start(Mechanism):
    """Start of a mechanism with an imposed coordinate. The bounds are those of the assembly."""

    BOUND = 1e-11

    def turned(self, file, axis=(0, 0, 1)):
        """By how much the rotor is turned about the axis from the axes of the world, without whole turns."""
        p = file["bodies/rotor/orientation"][0]
        return 2*np.arctan2(p[1:] @ np.array(axis)/np.linalg.norm(axis), p[0])

    def agrees(self, angle, expected):
        self.near(np.exp(1j*angle), np.exp(1j*expected), self.BOUND)

    def test_an_imposed_angle(self):
        """Any angle at the start, at any time, about any axis: orientation and counted angle; beside half a turn too."""
        for start, motion, expected in ((0, "3 + t^2", 3), (0, "-3.1 - t", -3.1), (0, "pi", np.pi), (0.3, "2*pi*t", 0.6*np.pi),
                                        (-2, "1.7*t", -3.4), (2, "10*t - 3.3", 16.7), (0, "-9.1 + sin(t)", -9.1), (0, "1.6", 1.6)):
            for axis in ((0, 0, 1), (1, -2, 0.5)):
                with self.subTest(motion=motion, axis=axis):
                    scene = self.scene(rotor(f'{REVOLUTE}\nmotion = "{motion}"', "[initial]\nassemble = true\n",
                                             f"[time]\nstart = {start}\nend = {start + 1}\n", axis))
                    with self.went(scene) as file:
                        self.agrees(self.turned(file, axis), expected)
                        self.near(file["joints/hinge/angle"][0], expected, self.BOUND)

    def test_half_a_turn_is_not_taken_for_none(self):
        """The drawing is half a turn off: it is refused as a start, and not accepted in silence."""
        self.refused("run", self.scene(rotor(f'{REVOLUTE}\nmotion = "pi + t"')), "--output", "out.h5", says="hinge motion")

    def test_every_turn_of_a_primitive(self):
        """drive = 4, 5, 6 with the other two turns held or free."""
        for drive in (4, 5, 6):
            for others in (0, 1):
                with self.subTest(drive=drive, others=others):
                    hold = [1, 1, 1] + [others]*3
                    hold[drive - 1] = 1
                    scene = self.scene(rotor(f'type = "primitive"\nhold = {hold}\ndrive = {drive}\nmotion = "2.8 + 0.1*t"',
                                             "[initial]\nassemble = true\n"))
                    with self.went(scene) as file:
                        # The axis of the joint is z, and its frame then is that of the world.
                        a = rotation(file["bodies/rotor/orientation"][0])
                        k = drive - 4
                        l, m = (k + 1) % 3, (k + 2) % 3
                        self.agrees(np.arctan2(a[m, l], a[l, l]), 2.8)

    def test_a_crank_of_a_slider(self):
        """A loop: the slider is where the crank of 0.3 and the rod of 1 put it, on the branch of the drawing."""
        for angle in (2.5, -2.5, 3.1, 7.0):
            with self.subTest(angle):
                scene = self.scene(f'''{SPACE}[body.crank]
mass = 1
inertia = [0.1, 0.1, 0.1]
position = [0.3, 0, 0]
[body.slider]
mass = 1
inertia = [0.1, 0.1, 0.1]
position = [1.3, 0, 0]
[joint.motor]
type = "revolute"
bodies = ["ground", "crank"]
at = [0, 0, 0]
axis = [0, 0, 1]
motion = "{angle} + t"
[joint.guide]
type = "prismatic"
bodies = ["ground", "slider"]
at = [1.3, 0, 0]
axis = [1, 0, 0]
[constraint.rod]
type = "distance"
between = ["crank", "slider"]
[results]
joints = "all"
bodies = "all"
[initial]
assemble = true
{END}{TIGHT}''')
                with self.went(scene) as file:
                    t = file["trajectory/time"][:]
                    x = 0.3*np.cos(angle + t) + np.sqrt(1 - (0.3*np.sin(angle + t))**2)
                    self.near(file["bodies/slider/position"][:, 0], x, 1e-9)
                    self.near(file["joints/guide/displacement"][:], x - 1.3, 1e-9)
                    self.near(file["joints/motor/angle"][:], angle + t, 1e-10)

    def test_sides_that_are_apart_along_the_axis(self):
        """Two named points: sensors and springs measure displacement and motion from the reference configuration, as documented."""
        text = f'''{PLANE}[body.b]
mass = 1
inertia = 1
position = [0.7, 0]
[joint.rail]
type = "prismatic"
bodies = ["ground:[0, 0]", "b:[0.1, 0]"]
axis = [1, 0]
MOTION
[force.k]
type = "torsion"
joint = "rail"
stiffness = 2
[results]
joints = "all"
forces = "all"
bodies = "all"
{END}{TIGHT}'''
        with self.went(self.scene(text.replace("MOTION", 'motion = "0.25*t^2"'))) as file:
            t = file["trajectory/time"][:]
            self.near(file["bodies/b/position"][:, 0], 0.7 + 0.25*t**2, self.BOUND)
            self.near(file["joints/rail/displacement"][:], 0.25*t**2, self.BOUND)
            self.near(file["forces/k/force"][:], -0.5*t**2, self.BOUND)
        with self.went(self.scene(text.replace("MOTION", ""))) as file:
            self.near(file["joints/rail/displacement"][:], 0, self.BOUND)

    def test_a_distance_at_the_start_of_the_run(self):
        """Driven by a function of time that is a length only from t = 4 s on."""
        text = f'''{PLANE}[body.m]
mass = 1
position = [1, 0]
[constraint.rope]
type = "distance"
between = ["ground", "m"]
motion = "0.5*(t - 4)"
[results]
bodies = "all"
[initial]
assemble = true
[time]
start = START
end = 7
{TIGHT}'''
        with self.went(self.scene(text.replace("START", "6"))) as file:
            t = file["trajectory/time"][:]
            self.near(np.linalg.norm(file["bodies/m/position"][:], axis=1), 0.5*(t - 4), self.BOUND)
        self.refused("run", self.scene(text.replace("START", "3")), "--output", "out.h5", says="length -0.5")

    def test_wheels_on_a_plane_that_has_risen_at_the_start(self):
        """The plane is taken at the start of the run, not at t = 0; a steered wheel without mass leans as it is steered there."""
        ball = f'{SPACE}[body.ball]\nmass = 1\ninertia = [0.4, 0.4, 0.4]\nposition = [0, 0, 2]\n[wheel.w]\ntype = "sphere"\nat = "ball"\n' \
            f'radius = 1\nrise = "0.5*t"\n[time]\nstart = START\nend = 3\n{TIGHT}'
        self.refused("run", self.scene(ball.replace("START", "0")), "--output", "out.h5", says="above its plane")
        self.refused("run", self.scene(ball.replace("START", "2")), "--output", "out.h5", says="velocity")
        lean, steered = 0.5, 0.7
        axle = np.array([np.cos(steered), np.sin(steered)*np.cos(lean), np.sin(steered)*np.sin(lean)])
        height = 0.3*np.sqrt(1 - axle[2]**2)
        cart = f'''{SPACE}[body.cart]
mass = 10
inertia = [1, 1, 1]
position = [0, 0, {float(height)!r}]
[joint.left]
type = "point_on_plane"
bodies = ["ground", "cart:[-0.6, -0.7, 0]"]
axis = [0, 0, 1]
[joint.right]
type = "point_on_plane"
bodies = ["ground", "cart:[0.6, -0.7, 0]"]
axis = [0, 0, 1]
[wheel.front]
type = "massless"
at = "cart"
radius = 0.3
axis = [1, 0, 0]
about = [0, {-np.sin(lean)}, {np.cos(lean)}]
steer = "{steered}*(2*t - t^2)"
[time]
start = START
end = 1.01
{TIGHT}'''
        self.tandem("check", self.scene(cart.replace("START", "1")))
        self.refused("check", self.scene(cart.replace("START", "0")), says="above its plane")


class Turns(Mechanism):
    def test_an_equilibrium_many_turns_away(self):
        """A torque of 8 N m on a spring of 1 N m/rad: sensors and events count the turns that springs count. So do those of a shaft
        that two cranks and a rod, or a gear, connect to it."""
        for torque in (8, -23.5):
            with self.subTest(torque):
                text = rotor(REVOLUTE, f'''[body.other]
mass = 1
inertia = [0.2, 0.2, 0.2]
position = [2, 0, 0]
[joint.second]
type = "revolute"
bodies = ["ground", "other"]
at = [2, 0, 0]
axis = [0, 0, 1]
[constraint.gear]
type = "coupling"
joints = ["hinge", "second"]
factors = [1, 0.5]
[force.k]
type = "torsion"
joint = "hinge"
stiffness = 1
damping = 0.5
[force.t]
type = "load"
on = "rotor"
torque = [0, 0, {torque}]
[sensor.zeroed]
joint = "second"
zero = 100
[initial]
equilibrium = true
[[event]]
name = "beyond"
watch = "/joints/hinge/angle"
value = {torque/2}
action = "record"
''')
                with self.went(self.scene(text)) as file:
                    self.near(file["forces/k/angle"][:], torque, 1e-8)
                    self.near(file["joints/hinge/angle"][:], torque, 1e-8)
                    self.near(file["joints/second/angle"][:], -2*torque, 1e-8)
                    self.near(file["sensors/zeroed/angle"][:], 100 - 2*torque, 1e-8)

    def test_an_imposed_angle_and_what_follows_it(self):
        """A gear, a spring and a load on a shaft that a motor has turned many times at the start."""
        text = rotor(f'{REVOLUTE}\nmotion = "20.3 + 5*t"', '''[body.other]
mass = 1
inertia = [0.2, 0.2, 0.2]
position = [2, 0, 0]
[joint.second]
type = "revolute"
bodies = ["ground", "other"]
at = [2, 0, 0]
axis = [0, 0, 1]
[force.k]
type = "torsion"
joint = "hinge"
stiffness = 3
[force.l]
type = "load"
on = "other"
torque = [0, 0, "0.1*hinge.angle"]
[initial]
assemble = true
''')
        with self.went(self.scene(text)) as file:
            t = file["trajectory/time"][:]
            self.near(file["joints/hinge/angle"][:], 20.3 + 5*t, 1e-10)
            self.near(file["forces/k/torque"][:], -3*(20.3 + 5*t), 1e-9)
            self.near(file["forces/l/torque"][:, 2], 0.1*(20.3 + 5*t), 1e-10)
            self.near(file["joints/second/angle"][:], 0.1*(20.3*t**2/2 + 5*t**3/6)/0.2, 1e-9)


class Signs(Mechanism):
    """A positive force or torque accelerates the coordinate; force times rate is power."""

    BOUND = 1e-9

    def test_torques(self):
        """A constant torque, a law, and a law with the torque's speed limit: phi = t^2 at 1 N m, 0.5 kg m^2."""
        for force in ('torque = 1', 'torque = "1"', 'law = "1"', 'law = "1 + 0*angle"'):
            for axis in ((0, 0, 1), (2, -1, 0.5)):
                with self.subTest(force=force, axis=axis):
                    text = rotor(REVOLUTE, f'[force.motor]\ntype = "torsion"\njoint = "hinge"\n{force}\n', axis=axis)
                    with self.went(self.scene(text)) as file:
                        t, motor = file["trajectory/time"][:], file["forces/motor"]
                        self.near(file["joints/hinge/angle"][:], t**2, self.BOUND)
                        self.near(motor["torque"][:], 1, self.BOUND)
                        self.near(motor["power"][:], 2*t, self.BOUND)
                        self.near(file["balance/work_of_forces"][:], t**2, self.BOUND)
                        self.near(file["balance/residual"][:], 0, self.BOUND)

    def test_a_motor_with_a_speed_limit(self):
        """J w' = 2 (1 - w/10): the law that a data sheet states."""
        text = rotor(REVOLUTE, '[force.motor]\ntype = "torsion"\njoint = "hinge"\nlaw = "2*(1 - rate/10)"\n')
        with self.went(self.scene(text)) as file:
            t = file["trajectory/time"][:]
            w = 10*(1 - np.exp(-0.4*t))
            self.near(file["joints/hinge/rate"][:], w, self.BOUND)
            self.near(file["forces/motor/power"][:], 2*(1 - w/10)*w, self.BOUND)

    def test_forces_along_a_displacement(self):
        """In the plane and in space, on the first and on the second body: m x'' = f - k x - c x', the force reported is that sum."""
        for head, zero, axis in ((PLANE, "[0, 0]", "[0.6, 0.8]"), (SPACE, "[0, 0, 0]", "[0.6, 0, 0.8]")):
            for bodies in ('["ground", "b"]', '["b", "ground"]'):
                with self.subTest(head=head, bodies=bodies):
                    inertia = "1" if head == PLANE else "[1, 1, 1]"
                    text = f'{head}[body.b]\nmass = 2\ninertia = {inertia}\nposition = {zero}\n[joint.rail]\ntype = "prismatic"\n' \
                        f'bodies = {bodies}\nat = {zero}\naxis = {axis}\n[force.f]\ntype = "torsion"\njoint = "rail"\nstiffness = 8\n' \
                        f'damping = 4\ntorque = 6\n[results]\njoints = "all"\nforces = "all"\nbalance = true\n{END}{TIGHT}'
                    with self.went(self.scene(text)) as file:
                        t = file["trajectory/time"][:]
                        w = np.sqrt(3)
                        x = 0.75*(1 - np.exp(-t)*(np.cos(w*t) + np.sin(w*t)/w))
                        v = 0.75*np.exp(-t)*4/w*np.sin(w*t)
                        self.near(file["joints/rail/displacement"][:], x, self.BOUND)
                        self.near(file["forces/f/force"][:], 6 - 8*x - 4*v, self.BOUND)
                        self.near(file["forces/f/power"][:], (6 - 4*v)*v, self.BOUND)
                        self.near(file["forces/f/energy"][:], 4*x**2, self.BOUND)
                        self.near(file["balance/residual"][:], 0, self.BOUND)

    def test_friction(self):
        """Against the rate, with a negative power."""
        text = rotor(REVOLUTE, '[force.rub]\ntype = "friction"\njoint = "hinge"\ndynamic = 0.5\nspeed = 1e-3\nnormal = 2\n',
                     body="omega = [0, 0, 3]\n")
        with self.went(self.scene(text)) as file:
            t = file["trajectory/time"][:]
            self.near(file["joints/hinge/rate"][:], 3 - 2*t, 1e-6)
            self.near(file["forces/rub/torque"][:], -1, 1e-6)
            self.near(file["forces/rub/power"][:], -(3 - 2*t), 1e-5)

    def test_a_motor_and_an_imposed_motion_agree(self):
        """The torque of a motion about the axis, and that of a coupling with a motion, have the sign of the torque of a motor that makes
        the same motion; of a row at velocity level the force."""
        with self.went(self.scene(rotor(f'{REVOLUTE}\nmotion = "t^2"', "[initial]\nassemble = true\n"))) as file:
            t = file["trajectory/time"][:]
            self.near(file["joints/hinge/torque"][:, 2], 1, self.BOUND)
            self.near(file["joints/hinge/power"][:], 2*t, self.BOUND)
        drive = '[constraint.drive]\ntype = "coupling"\njoints = ["hinge"]\nfactors = [FACTOR]\nmotion = "FACTOR*t^2"\n' \
            '[initial]\nassemble = true\n'
        for factor in (1, -3):
            text = rotor(REVOLUTE, drive.replace("FACTOR", str(factor))).replace("[results]", '[results]\nconstraints = "all"')
            with self.subTest(factor), self.went(self.scene(text)) as file:
                t = file["trajectory/time"][:]
                self.near(file["joints/hinge/angle"][:], t**2, self.BOUND)
                self.near(file["constraints/drive/torque"][:], 1/factor, self.BOUND)
                self.near(file["constraints/drive/power"][:], 2*t, self.BOUND)
        text = PLANE + '[body.b]\nmass = 2\nposition = [0, 0]\n[constraint.row]\ntype = "velocity"\nvelocities = ["b.vx"]\n' \
            f'coefficients = [1]\nvalue = "3*t"\n[results]\nconstraints = "all"\n{END}{TIGHT}'
        with self.went(self.scene(text)) as file:
            t = file["trajectory/time"][:]
            self.near(file["constraints/row/force"][:], 6, self.BOUND)
            self.near(file["constraints/row/power"][:], 18*t, self.BOUND)


class PlanarLine(Mechanism):
    """A bead on the line of an inclined bar: its displacement is 0 in the reference configuration, for every use of it."""

    def test_displacement_and_angle(self):
        for kind in ('type = "point_on_line"', 'type = "primitive"\nhold = [0, 1, 0]'):
            for reverse in (False, True):
                with self.subTest(kind=kind, reverse=reverse):
                    bodies = '["bead", "bar"]' if reverse else '["bar", "bead"]'
                    text = f'''{PLANE}[body.bar]
mass = 1
inertia = 1
position = [0, 0]
angle = 0.5
[body.bead]
mass = 1
inertia = 2
position = [0.3, 0]
velocity = [1, 0]
omega = 0.2
[joint.hold]
type = "fixed"
bodies = ["ground", "bar"]
at = [0, 0]
[joint.wire]
{kind}
bodies = {bodies}
at = [0.3, 0]
axis = [1, 0]
[force.spring]
type = "torsion"
joint = "wire.displacement"
stiffness = 4
[force.turner]
type = "torsion"
joint = "wire.angle"
torque = 0.5
[sensor.zeroed]
joint = "wire"
zero = 7
[results]
joints = "all"
forces = "all"
[[event]]
name = "half"
watch = "/joints/wire/displacement"
value = 0.25
[time]
end = 0.5
{TIGHT}'''
                    if reverse:
                        # The line turns with the bead: only the start is compared.
                        with self.went(self.scene(text)) as file:
                            self.near(file["joints/wire/displacement"][0], 0, 1e-12)
                            self.near(file["joints/wire/angle"][0], 0, 1e-12)
                            self.near(file["joints/wire/rate"][0], -0.2, 1e-12)
                            self.near(file["forces/spring/displacement"][:], file["joints/wire/displacement"][:], 1e-12)
                            self.near(file["forces/turner/angle"][:], file["joints/wire/angle"][:], 1e-12)
                        continue
                    with self.went(self.scene(text)) as file:
                        t = file["trajectory/time"][:]
                        way, angle = np.sin(2*t)/2, 0.2*t + t**2/8
                        self.near(file["joints/wire/displacement"][:], way, 1e-9)
                        self.near(file["joints/wire/angle"][:], angle, 1e-9)
                        self.near(file["sensors/zeroed/displacement"][:], 7 + way, 1e-9)
                        self.near(file["sensors/zeroed/angle"][:], 7 + angle, 1e-9)
                        self.near(file["forces/spring/force"][:], -4*way, 1e-9)
                        self.near(file["events/time"][:], [np.arcsin(0.5)/2], 1e-9)


class Names(Mechanism):
    def test_parameters_named_like_variables(self):
        for name in ("t", "length", "angle", "rate"):
            with self.subTest(name):
                self.refused("check", self.scene(PLANE + f"[parameters]\n{name} = 3\n[body.a]\nmass = 1\nposition = [0, 0]\n" + END),
                             says=[f'"{name}" is reserved in expressions', "choose another name"])
                text = PLANE + "[body.a]\nmass = 1\nposition = [0, 0]\n" + END
                self.refused("check", self.scene(text), "--set", f"parameters.{name}=3", says=f'"{name}" is reserved in expressions')
                self.refused("check", self.scene(f"{text}[function.{name}]\nat = [0, 1]\nvalues = [0, 1]\n"), says=f'"{name}"')
                self.refused("check", self.scene(f'{text}[repeat.r]\ncount = 2\nindex = "{name}"\n[repeat.r.body."b{{{name}}}"]\nmass = 1\n'
                                                 f'position = ["{name}", 0]\n'), says=f'"{name}" is reserved in expressions')

    def test_a_sweep_over_such_a_name(self):
        text = PLANE + "[body.a]\nmass = 1\nposition = [0, 0]\n" + END
        self.scene(text)
        self.scene('[sweep]\nscene = "scene.toml"\n[[vary]]\nkey = "parameters.rate"\nvalues = [1, 2]\n[[keep]]\nquantity = "a.x"\n',
                   "sweep.toml")
        done = self.tandem("sweep", "sweep.toml", code=2)
        self.assertIn("rate", done.stderr)

    def test_an_index_named_like_a_parameter(self):
        self.refused("check", self.scene(PLANE + '[parameters]\ni = 3\n[repeat.r]\ncount = 2\n[repeat.r.body."b{i}"]\nmass = 1\n'
                                         'position = ["i", 0]\n' + END), says=['"i" is the name of a parameter', "take another one"])

    def test_a_function_named_like_a_parameter(self):
        self.refused("check", self.scene(PLANE + "[parameters]\npush = 3\n[function.push]\nat = [0, 1]\nvalues = [0, 1]\n[body.a]\nmass = 1\n"
                                         "position = [0, 0]\n" + END), says='"push" has another meaning')

    def test_a_joint_that_slides_and_turns(self):
        """Its bare name says neither; each kind of element that takes a coordinate names the alternatives."""
        text = rotor('type = "cylindrical"')
        for element in ('[force.f]\ntype = "torsion"\njoint = "hinge"\n', '[force.f]\ntype = "friction"\njoint = "hinge"\ndynamic = 0.1\n'
                        'speed = 0.1\nnormal = 1\n', '[constraint.c]\ntype = "coupling"\njoints = ["hinge"]\nfactors = [1]\n'):
            with self.subTest(element):
                self.refused("check", self.scene(text + element), says=["rotates and slides", "hinge.angle", "hinge.displacement"])
                for part in ("angle", "displacement"):
                    self.tandem("check", self.scene(text + element.replace('"hinge"', f'"hinge.{part}"')))


if __name__ == "__main__":
    unittest.main()
