# SPDX-License-Identifier: MIT
"""Models of MuJoCo from MJCF files: what the scene says, how it moves, and accelerations beside MuJoCo. tools/compare_imports.py compares
the models of public packages."""

import importlib.util
import subprocess
import sys
import tomllib
import unittest

import numpy as np
from test_mechanisms import Mechanism
from test_output import ROOT, TANDEM

ENVIRONMENT = {"PYTHONPATH": str(ROOT / "python" / "src"), "TANDEM_PROGRAM": TANDEM, "PATH": "/usr/bin:/bin"}
IMPORT = [sys.executable, "-m", "tandem", "import"]
HAS_MUJOCO = importlib.util.find_spec("mujoco") is not None
G = 9.81

# A door on a hinge with a spring, a damper, a rotor and a motor; a slider on it; a body without joints on the door; a ball, and a free body.
MODEL = """<mujoco model="a small model">
  <compiler angle="radian"/>
  <default><geom density="500"/><default class="light"><geom density="50"/></default></default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="door" pos="0 0 1">
      <joint name="hinge" axis="0 1 0" stiffness="3" springref="0.2" damping="0.5" range="-1 2" armature="2"/>
      <geom type="box" size="0.5 0.1 0.2" pos="0.5 0 0"/>
      <body name="knob" pos="1 0 0"><geom type="sphere" size="0.1" mass="2"/></body>
      <body name="bolt" pos="0 0 -0.5" euler="0 1.5707963267948966 0">
        <joint name="bolt" type="slide" axis="1 0 0"/>
        <inertial pos="0 0 0.1" mass="4" diaginertia="1 1 1"/>
      </body>
    </body>
    <body name="bob" pos="2 0 2"><joint name="ball" type="ball"/><geom class="light" type="capsule" fromto="0 0 0 0 0 -1" size="0.1"/></body>
    <body name="stone" pos="3 0 3"><freejoint/><geom type="ellipsoid" size="0.1 0.2 0.3"/></body>
  </worldbody>
  <actuator><motor name="push" joint="hinge" gear="5"/><position name="servo" joint="bolt" kp="1"/><adhesion body="bob" ctrlrange="0 1"/></actuator>
  <keyframe><key name="open" qpos="0.5 0.1 1 0 0 0 3 0 3 1 0 0 0" ctrl="2 0 0"/></keyframe>
</mujoco>
"""
BAR = '<body name="{0}" pos="{1}"><joint name="{0}" axis="0 0 1"/><inertial pos="{2}" mass="1" diaginertia="0.1 0.1 0.08333333333333333"/>{3}</body>'
# The parallelogram of A02, one bay, whose last hinge is a connection.
LOOP = '<mujoco><option gravity="0 -9.81 0"/><worldbody>' + BAR.format("left", "0 0 0", "0 0.5 0", BAR.format("top", "0 1 0", "0.5 0 0", "")) \
    + BAR.format("right", "1 0 0", "0 0.5 0", "") + '</worldbody><equality><connect body1="top" body2="right" anchor="1 0 0"/>{}</equality></mujoco>'
# Everything that accelerations depend on: three hinges and a slide on one body, rotors, friction, tendons, actuators with gear and bias, a site.
ARM = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="upper" pos="0 0 1">
    <joint name="x" axis="1 0 0" armature="0.1" damping="0.3" stiffness="2" springref="0.4"/>
    <joint name="y" axis="0 1 0" armature="0.2" frictionloss="0.3"/><joint name="z" axis="0 0 1" pos="0 0 0.1"/>
    <joint name="s" type="slide" axis="1 1 0" damping="1"/><geom type="box" size="0.3 0.1 0.05" pos="0.3 0 0"/>
    <body name="lower" pos="0.6 0 0" euler="0.1 0.2 0.3" gravcomp="0.5"><joint name="elbow" axis="0 1 0.2" ref="0.1" armature="0.05"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.05"/><site name="tip" pos="0.4 0 0" euler="0.3 0 0"/>
      <body name="hand" pos="0.4 0 0"><joint name="u" axis="1 0 0"/><joint name="v" axis="0 1 0"/><geom size="0.08" pos="0.05 0.02 0"/></body></body>
  </body>
  <body name="bob" pos="1 1 1"><joint name="ball" type="ball" damping="0.2"/><geom type="cylinder" size="0.05 0.2" pos="0 0 -0.2"/>
    <site name="end" pos="0 0 -0.4"/></body></worldbody>
  <tendon><fixed name="sum" stiffness="4" damping="0.5" armature="0.1" frictionloss="0.1"><joint joint="x" coef="1"/><joint joint="elbow" coef="-2"/></fixed>
    <spatial name="cord" stiffness="20" damping="1" springlength="0.3"><site site="tip"/><site site="end"/></spatial></tendon>
  <actuator><motor joint="y" gear="3"/><position joint="elbow" kp="2" kv="0.3" gear="1.5"/><motor tendon="sum" gear="2"/>
    <general joint="s" gainprm="2 0.5 0.1" gaintype="affine" biastype="affine" biasprm="0.3 -1 -0.2" forcerange="-1 1"/>
    <motor site="tip" gear="1 2 3 0.1 0.2 0.3"/><motor tendon="cord" gear="1.5"/></actuator>
</mujoco>"""


@unittest.skipUnless(HAS_MUJOCO, "this Python has no package mujoco")
class Models(Mechanism):
    def imported(self, text, *words, code=0):
        (self.folder / "model.xml").write_text(text)
        done = subprocess.run([*IMPORT, "model.xml", "--force", *words], cwd=self.folder, capture_output=True, text=True, check=False, env=ENVIRONMENT)
        self.assertEqual(done.returncode, code, done.stderr)
        self.said = done.stderr
        return done.stderr if code else done.stdout if "--verify" in words else (self.folder / "model.toml").read_text()

    def test_what_is_in_it(self):
        text = self.imported(MODEL)
        scene = tomllib.loads(text)
        self.assertEqual(set(scene["body"]), {"door", "bolt", "bob", "stone"})
        # A box of 40 kg and the knob of 2 kg, about their common centre.
        door, x = scene["body"]["door"], (40*0.5 + 2)/42
        self.assertAlmostEqual(door["mass"], 42, places=12)
        self.near(door["position"], [x, 0, 1], 1e-14)
        self.assertAlmostEqual(door["inertia"][1], 40/12*(1 + 0.16) + 40*(x - 0.5)**2 + 2*(0.4*0.01 + (1 - x)**2), places=12)
        # A capsule of length 1: a cylinder and a sphere's two halves.
        r, cylinder, ball = 0.1, 50*np.pi*0.01, 50*4/3*np.pi*1e-3
        bob = scene["body"]["bob"]
        self.assertAlmostEqual(bob["mass"], cylinder + ball, places=12)
        half = 3/8*r
        across = cylinder*(3*r**2 + 1)/12 + ball*(0.4*r**2 - half**2 + (0.5 + half)**2)
        self.near(sorted(bob["inertia"][:3]), sorted([across, across, cylinder*r**2/2 + 0.4*ball*r**2]), 1e-12)
        self.assertEqual({name: joint["type"] for name, joint in scene["joint"].items()},
                         {"hinge": "revolute", "bolt_2": "prismatic", "ball": "spherical"})
        self.assertEqual(scene["joint"]["hinge"]["rotor_inertia"], 2)
        self.assertIn("ramp", scene["force"]["hinge_stop"]["law"])
        for said in ("not imported: 5 x geoms that make contact", "not imported: 1 x actuators of contacts"):
            self.assertIn(said, self.said)
            self.assertIn(f"# {said[0].upper()}{said[1:]}", text)
        self.tandem("check", "model.toml")
        self.assertIn("not imported completely", self.imported(MODEL, "--strict", code=2))

    def test_limits(self):
        """As events, as stops that a falling door leaves within a few degrees, or not at all."""
        scene = tomllib.loads(self.imported(MODEL, "--limits", "events"))
        self.assertEqual({event["name"]: event["value"] for event in scene["event"]}, {"hinge_lower": -1, "hinge_upper": 2})
        self.assertNotIn("hinge_stop", scene["force"])
        scene = tomllib.loads(self.imported(MODEL, "--limits", "none"))
        self.assertFalse("event" in scene or "hinge_stop" in scene["force"])
        self.imported(MODEL)
        with self.went("model.toml", 'results.joints=["hinge"]', "time.end=4", "parameters.ctrl_push=100") as file:
            angle = file["joints/hinge/angle"][:]
            self.assertGreater(angle.max(), 2)
            self.assertLess(angle.max(), 2.1)

    def test_how_it_starts(self):
        """The door with its bolt held in mind: by the equations of two degrees of freedom; motor and spring turn it, the stone falls."""
        self.imported(MODEL)
        with self.went("model.toml", 'results.bodies="all"', "time.end=0.001", "parameters.ctrl_push=2") as file:
            self.near(file["bodies/stone/acceleration"][0], [0, 0, -G], 1e-12)
            # The bolt's axis is down: it slides along z, its centre 0.1 beside the hinge's line, 0.5 below.
            x, turn = 22/42, 40/12*1.16 + 40*(22/42 - 0.5)**2 + 2*(0.004 + (1 - 22/42)**2)
            mass = np.array([[turn + 2 + 42*x**2 + 1 + 4*(0.1**2 + 0.5**2), 4*0.1], [4*0.1, 4]])
            # A turn about y by +1 moves x to -z; the bolt's centre is at x = 0.1, z = -0.5, and slides by -z.
            force = np.array([42*G*x + 4*G*0.1 + 3*0.2 + 5*2, 4*G])
            alpha, slide = np.linalg.solve(mass, force)
            self.near(file["bodies/bolt/acceleration"][0], [-0.5*alpha, 0, -0.1*alpha - slide], 1e-12)

    def test_accelerations_beside_mujoco(self):
        """At random states, with springs, rotors, friction, tendons and actuators; as a table and by the function."""
        for text in (MODEL, ARM, LOOP.format("")):
            last = self.imported(text, "--verify").splitlines()[-1]
            self.assertLess(float(last.split(":")[-1]), 1e-11, last)
        scene = tomllib.loads(self.imported(ARM))
        self.assertEqual(scene["joint"]["u"]["type"], "universal")
        self.tandem("check", "model.toml")

    def test_a_keyframe(self):
        scene = tomllib.loads(self.imported(MODEL, "--key", "open"))
        self.near(scene["body"]["door"]["euler_parameters"], [np.cos(0.25), 0, np.sin(0.25), 0], 1e-15)
        self.assertEqual(scene["parameters"]["ctrl_push"], 2)
        self.assertIn("use one of open", self.imported(MODEL, "--key", "shut", code=2))

    def test_a_loop(self):
        """A parallelogram whose last hinge is a connection falls as one does: theta'' = c sin(theta)."""
        text = self.imported(LOOP.format(""), "--at", "left=-0.3,top=0.3,right=-0.3")
        self.assertIn("assemble = true", text)
        with self.went("model.toml", 'results.bodies="all"', "time.end=0.001") as file:
            alpha = G*(1 + 1)/(2/3 + 1)*np.sin(0.3)
            self.near(file["bodies/right/acceleration"][0], [0.5*alpha*np.cos(0.3), -0.5*alpha*np.sin(0.3), 0], 1e-11)

    def test_a_weld(self):
        """A bar on a hinge with another one that is free, welded to its end, turns as one of both; by sites, a connection likewise."""
        text = '<mujoco><option gravity="0 -9.81 0"/><worldbody>' + BAR.format("a", "0 0 0", "0.5 0 0", '<site name="one" pos="1 0 0"/>') \
            + '<body name="b" pos="1 0 0"><freejoint/><inertial pos="0.5 0 0" mass="1" diaginertia="0.1 0.1 0.08333333333333333"/>' \
            '<site name="two"/></body></worldbody><equality>{}</equality></mujoco>'
        self.imported(text.format('<weld body1="a" body2="b"/>'))
        with self.went("model.toml", 'results.bodies="all"', "time.end=0.001") as file:
            # A bar of 2 m and 2 kg: alpha = (3/2) g/l.
            self.near(file["bodies/b/acceleration"][0], [0, -1.5*1.5*G/2, 0], 1e-11)
        self.imported(text.format('<connect site1="one" site2="two"/>'))
        with self.went("model.toml", 'results.bodies="all"', "time.end=0.001") as file:
            # Two bars from the horizontal: alpha = (9/7, -3/7) g/l.
            self.near(file["bodies/a/acceleration"][0], [0, -0.5*9/7*G, 0], 1e-11)
            self.near(file["bodies/b/acceleration"][0], [0, -(9/7 - 0.5*3/7)*G, 0], 1e-11)

    def test_a_weld_to_a_body_that_the_user_moves(self):
        """A free bar sinks by its weight on a spring with critical damping, of frequency 1/(0.02 s * 0.95); it may start away from its
        place."""
        text = '<mujoco><option gravity="0 0 -9.81"/><worldbody><body name="guide" mocap="true"/><body name="b"><freejoint/>' \
            '<inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/></body></worldbody><equality><{} body1="guide" body2="b"{}/></equality>' \
            '<keyframe><key name="up" qpos="0 0 0.01 1 0 0 0"/></keyframe></mujoco>'
        w = 1/(0.02*0.95)
        for kind, more in (("weld", ""), ("connect", ' anchor="0 0 0"')):
            for z, words in ((0, []), (0.01, ["--key", "up"])):
                self.imported(text.format(kind, more), *words)
                with self.went("model.toml", 'results.bodies="all"', "time.end=0.05", "solver.rtol=1e-10") as file:
                    self.near(file["bodies/b/position"][-1], [0, 0, (z + G/w**2)*(1 + 0.05*w)*np.exp(-0.05*w) - G/w**2], 1e-10)

    def test_a_coupling(self):
        """Two bars one of which turns twice as far, backwards."""
        two = '<mujoco><option gravity="0 -9.81 0"/><worldbody>' + BAR.format("a", "0 0 0", "0.5 0 0", "") + BAR.format("b", "3 0 0", "0.5 0 0", "") \
            + '</worldbody><equality><joint joint1="a" joint2="b" polycoef="0 -2 0 0 0"/>{}</equality></mujoco>'
        self.imported(two.format(""))
        with self.went("model.toml", 'results.joints="all"', "time.end=0.5", "solver.rtol=1e-8") as file:
            self.near(file["joints/a_2/angle"][:], -2*file["joints/b_2/angle"][:], 1e-10)
        self.imported(two.format('<joint joint1="a" joint2="b" polycoef="0 1 1 0 0"/>'))
        self.assertIn("nonlinear equalities", self.said)

    def test_a_limit_of_actuator_forces(self):
        """Reported for joints and tendons, whose actuators act without it."""
        text = '<mujoco><worldbody>' + BAR.format("a", "0 0 0", "0.5 0 0", "") + '</worldbody><tendon><fixed name="cord"{}><joint joint="a" ' \
            'coef="2"/></fixed></tendon><actuator><motor tendon="cord"/></actuator></mujoco>'
        self.imported(text.format(""))
        self.assertNotIn("limits of the sum", self.said)
        self.imported(text.format(' actuatorfrcrange="-1 1"').replace("<mujoco>", '<mujoco><compiler autolimits="true"/>'))
        self.assertIn("1 x limits of the sum of actuator forces on a joint or a tendon (cord)", self.said)

    def test_joints_in_one(self):
        """Several joints of a body, on which nothing acts, are one that leaves the same motions; others follow each other."""
        def made(*joints):
            body = "".join(f'<joint name="j{k}" {words}/>' for k, words in enumerate(joints))
            scene = tomllib.loads(self.imported(f'<mujoco><worldbody><body name="b">{body}<geom size="0.1"/></body></worldbody></mujoco>'))
            self.tandem("check", "model.toml")
            return [joint["type"] for joint in scene.get("joint", {}).values()]

        x, y, z = ('axis="1 0 0"', 'axis="0 1 0"', 'axis="0 0 1"')
        slide = [f'type="slide" {axis}' for axis in (x, y, z)]
        self.assertEqual(made(slide[0], slide[2], y), ["planar"])
        self.assertEqual(made(slide[2], z), ["cylindrical"])
        self.assertEqual(made(x, y), ["universal"])
        self.assertEqual(made(x, y, z), ["spherical"])
        self.assertEqual(made(slide[0], slide[1]), ["prismatic"]*2)
        self.assertEqual(made(x, 'axis="1 1 0"'), ["revolute"]*2)
        self.assertEqual(made(x, 'axis="0 1 0" pos="0 0 1"', z), ["revolute"]*3)
        self.assertEqual(made(y, slide[0]), ["revolute", "prismatic"])

    def test_the_program(self):
        """`tandem import` hands over to the package for Python, options, messages and exit code; the word mjcf is not needed."""
        environment = {"TANDEM_PYTHON": sys.executable, "PYTHONPATH": str(ROOT / "python" / "src")}
        expected = self.imported(MODEL, "--at", "hinge=0.5")
        for words in (["mjcf", "model.xml"], ["model.xml"]):
            done = self.tandem("import", *words, "--at", "hinge=0.5", "--output", "again.toml", "--force", env=environment)
            self.assertEqual(done.stdout.strip(), "again.toml")
            self.assertIn("geoms that make contact", done.stderr)
            self.assertEqual((self.folder / "again.toml").read_text(), expected)
        self.assertIn("--force", self.tandem("import", "model.xml", "--output", "again.toml", env=environment, code=2).stderr)
        self.assertIn("not URDF", self.tandem("import", "urdf", "model.xml", env=environment, code=2).stderr)

    def test_wrong_files(self):
        def body(text):
            return f"<mujoco><worldbody>{text}</worldbody></mujoco>"

        for text, message in {
            "<sdf/>": "neither URDF nor MJCF", "<mujoco": "not XML", body("<geom size='1'/>"): "nothing moves",
            body('<body name="b"><joint/></body>'): "MuJoCo refuses it", body('<body><joint axis="0 0 0"/><geom size="1"/></body>'): "MuJoCo refuses it",
            body('<body><freejoint/><geom type="mesh" mesh="m"/></body>'): "MuJoCo refuses it", body("<bodies/>"): "MuJoCo refuses it",
        }.items():
            with self.subTest(message):
                self.assertIn(message, self.imported(text, code=2))
        self.assertIn("no joint elbow", self.imported(MODEL, "--at", "elbow=1", code=2))

    def test_hostile_names(self):
        """Line breaks in names cannot inject text into the scene."""
        scene = tomllib.loads(self.imported(MODEL.replace('"a small model"', '"a&#10;[body.evil]&#10;mass = 1"').replace('"stone"', '"s&#10;[x]"')))
        self.assertEqual(len(scene["body"]), 4)
        self.assertNotIn("x", scene)


class Without(Mechanism):
    def test_without_mujoco(self):
        """The message says how to install it."""
        (self.folder / "mujoco.py").write_text("raise ImportError")
        (self.folder / "model.xml").write_text(MODEL)
        done = subprocess.run([*IMPORT, "model.xml"], cwd=self.folder, capture_output=True, text=True, check=False,
                              env=ENVIRONMENT | {"PYTHONPATH": f"{self.folder}:{ENVIRONMENT['PYTHONPATH']}"})
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn("-m pip install mujoco", done.stderr)
        self.assertNotIn("Traceback", done.stderr)


if __name__ == "__main__":
    unittest.main()
