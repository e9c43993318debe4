# SPDX-License-Identifier: MIT
"""Robots from URDF files: what the scene says, and how it moves. tools/compare_imports.py compares whole robots with Pinocchio."""

import subprocess
import sys
import tomllib
import unittest

import numpy as np
from test_mechanisms import Mechanism
from test_output import ROOT
from test_results import energies

sys.path.insert(0, str(ROOT / "python" / "src"))
from tandem import urdf  # noqa: E402

ENVIRONMENT = {"PYTHONPATH": str(ROOT / "python" / "src"), "PATH": "/usr/bin:/bin"}
IMPORT = [sys.executable, "-m", "tandem", "import"]
G = 9.81

# A rod on a hinge, with a bolt at its end that a fixed joint holds; a slider with a damper; a wheel that turns three times as fast
# as the hinge.
ROBOT = """<?xml version="1.0"?>
<robot name="a small robot">
  <link name="world"/>
  <link name="stand"><visual><origin xyz="0 0 0.5"/><geometry><cylinder radius="0.1" length="1"/></geometry></visual></link>
  <joint name="bolted" type="fixed"><parent link="world"/><child link="stand"/><origin xyz="0 0 1"/></joint>
  <link name="rod"><inertial><origin xyz="0.5 0 0"/><mass value="3"/>
    <inertia ixx="0" iyy="0.25" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://a/rod.dae"/></geometry></visual></link>
  <joint name="hinge" type="revolute"><parent link="stand"/><child link="rod"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
  <link name="end"><inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="tip" type="fixed"><parent link="rod"/><child link="end"/><origin xyz="1 0 0" rpy="0.3 0.2 0.1"/></joint>
  <link name="a_slider_whose_name_is_longer_than_the_names_of_mechanisms_are_and_is_cut">
    <inertial><mass value="4"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="a_slider_whose_name_is_longer_than_the_names_of_mechanisms_are_and_is_cut" type="prismatic">
    <parent link="world"/><child link="a_slider_whose_name_is_longer_than_the_names_of_mechanisms_are_and_is_cut"/>
    <origin rpy="0 1.5707963267948966 0"/><axis xyz="1 0 0"/><limit lower="0" upper="0"/><dynamics damping="8" friction="1"/></joint>
</robot>
"""


class Robots(Mechanism):
    def imported(self, text, *words, code=0, **settings):
        (self.folder / "robot.urdf").write_text(text)
        done = subprocess.run([*IMPORT, "robot.urdf", *words], cwd=self.folder, capture_output=True, text=True, check=False, env=ENVIRONMENT)
        self.assertEqual(done.returncode, code, done.stderr)
        return done.stderr if code else (self.folder / "robot.toml").read_text()

    def test_what_is_in_it(self):
        text = self.imported(ROBOT)
        scene = tomllib.loads(text)
        self.assertEqual(set(scene["body"]), {"rod", "a_slider_whose_name_is_longer_than_the_names_of_mechanisms_are_a"})
        rod = scene["body"]["rod"]
        self.assertEqual(rod["mass"], 5)
        self.near(rod["position"], [0.7, 0, 2], 1e-15)
        # Both about their common centre: 0.25 + 3 0.2^2 + 0.1 + 2 0.3^2.
        self.near(rod["inertia"], [0.1, 0.65, 0.65], 1e-15)
        self.assertIn("mesh package://a/rod.dae scale 1 1 1", rod["looks"][0])
        self.assertEqual([scene["joint"]["hinge"][key] for key in ("type", "at", "axis")], ["revolute", [0, 0, 2], [0, 1, 0]])
        self.assertIn("ramp", scene["force"]["hinge_stop"]["law"])
        slider = next(force for name, force in scene["force"].items() if name.endswith("_friction"))
        self.assertEqual([slider[key] for key in ("type", "normal")], ["friction", 1])
        self.tandem("check", "robot.toml")
        again = self.tandem("show", "robot.toml").stdout
        self.assertIn("looks = ", again)

    def test_rounded_inertias(self):
        """Moments that are negative by rounding, relative to the largest of all bodies, are zero; larger ones are refused."""
        for value, expected in (("-5e-20", 0), ("-5e-3", -5e-3)):
            text = ROBOT.replace('<inertia ixx="1" iyy="1" izz="1"', f'<inertia ixx="{value}" iyy="{value}" izz="0"')
            slider = next(body for name, body in tomllib.loads(self.imported(text, "--force"))["body"].items() if name != "rod")
            self.assertEqual(slider["inertia"], [expected, expected, 0])
        self.assertIn("negative moment of inertia", self.tandem("check", "robot.toml", code=2).stderr)

    def test_how_it_falls(self):
        """The rod starts with m g s/(J + m s^2) about its hinge; the slider falls as one with a damper and friction of 1 N, which is
        at its value from a speed of 0.01 m/s on. Down is the turn about y."""
        self.imported(ROBOT, "--limits", "none")
        with self.went("robot.toml", 'results.bodies="all"', "solver.rtol=1e-11", "time.end=0.5") as file:
            alpha = 5*G*0.7/(0.65 + 5*0.49)
            self.near(file["bodies/rod/acceleration"][0], [0, 0, -0.7*alpha], 1e-12)
            t = file["trajectory/time"][:]
            # Its axis points down.
            slider = file["bodies/a_slider_whose_name_is_longer_than_the_names_of_mechanisms_are_a"]
            # Until then it is less: by the integral of 1 - tanh(4 v/0.01) over an acceleration of at least G - 0.25.
            self.near(slider["velocity"][:, 2], -(G - 0.25)/2*(1 - np.exp(-2*t)), 0.01/4*np.log(2)*0.25/(G - 0.25))

    def test_limits_as_events(self):
        self.imported(ROBOT, "--limits", "events")
        with self.went("robot.toml", "time.end=2") as file:
            self.assertEqual(file["events/name"][0].decode(), "hinge_upper")
            angle = file["joints/hinge/angle"][:]
            self.assertTrue(np.max(angle) > 2)

    def test_limits_as_stops(self):
        """The rod falls onto the stop and rests there: within its deflection under the weight."""
        self.imported(ROBOT)
        with self.went("robot.toml", 'results.joints=["hinge"]', "time.end=6", "body.rod.omega=[0, 0, 0]") as file:
            angle = file["joints/hinge/angle"][:]
            self.assertTrue(np.max(angle) > 1.99)
            self.assertLess(np.max(angle), 2.3)

    def test_drawn_elsewhere(self):
        """At an angle, the same robot: the hinge's moment is that of the weight."""
        self.imported(ROBOT, "--at", "hinge=0.5")
        with self.went("robot.toml", 'results.bodies="all"', "time.end=0.01") as file:
            alpha = 5*G*0.7*np.cos(0.5)/(0.65 + 5*0.49)
            self.near(np.linalg.norm(file["bodies/rod/acceleration"][0]), 0.7*alpha, 1e-12)

    def test_a_free_body(self):
        self.imported(ROBOT.replace('<link name="world"/>', '<link name="world"><inertial><mass value="1"/>'
                                    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'), "--floating")
        with self.went("robot.toml", 'results.bodies="all"', "time.end=0.1") as file:
            for body in file["bodies"].values():
                self.near(body["acceleration"][0], [0, 0, -G], 1e-12)

    def test_mimic(self):
        """A wheel that turns as a joint says: an angle three times that of the hinge."""
        wheel = '<link name="wheel"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/>' \
            '</inertial></link><joint name="axle" type="continuous"><parent link="world"/><child link="wheel"/><axis xyz="0 1 0"/>' \
            '<mimic joint="hinge" multiplier="-3"/></joint></robot>'
        text = self.imported(ROBOT.replace("</robot>", wheel))
        (self.folder / "robot.toml").write_text(text.replace("[time]", '[results]\njoints = "all"\n\n[time]'))
        with self.went("robot.toml", "time.end=0.5", "solver.rtol=1e-8") as file:
            self.near(file["joints/axle/angle"][:], -3*file["joints/hinge/angle"][:], 1e-10)

    WHEEL = '<link name="{0}"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/>' \
        '</inertial></link><joint name="{0}_j" type="continuous"><parent link="world"/><child link="{0}"/><axis xyz="0 1 0"/>' \
        '<mimic joint="{1}" multiplier="{2}" offset="0.25"/></joint>'

    def test_mimics_of_mimics(self):
        """In any order of the file: the position of each follows from the last joint of the chain."""
        chain = self.WHEEL.format("b", "a_j", 2) + self.WHEEL.format("a", "hinge", 3)
        scene = tomllib.loads(self.imported(ROBOT.replace("</robot>", chain + "</robot>"), "--at", "hinge=0.1"))
        for name, angle in (("a", 0.55), ("b", 1.35)):
            self.near(scene["body"][name]["euler_parameters"], [np.cos(angle/2), 0, np.sin(angle/2), 0], 1e-15)

    def test_mimics_of_what_rests(self):
        """A joint that follows with factor 0, or follows a fixed joint, stays at its offset."""
        for other, factor in (("hinge", 0), ("bolted", 2)):
            with self.subTest(other):
                text = ROBOT.replace("</robot>", self.WHEEL.format("a", other, factor) + "</robot>")
                scene = tomllib.loads(self.imported(text, "--force"))
                self.assertEqual(scene["constraint"]["a_j_mimic"], {"type": "coupling", "joints": ["a_j"], "factors": [1]})
                self.near(scene["body"]["a"]["euler_parameters"], [np.cos(0.125), 0, np.sin(0.125), 0], 1e-15)
                self.tandem("check", "robot.toml")

    def test_hostile_names(self):
        """Line breaks in names cannot inject text into the scene."""
        text = ROBOT.replace('"a small robot"', '"a&#10;[body.evil]&#10;mass = 1"').replace('"stand"', '"st&#10;mass = 7&#10;and"')
        text = text.replace('"end"', '"e&#10;[x]&#10;nd"')
        scene = tomllib.loads(self.imported(text))
        self.assertEqual(set(scene["body"]), {"rod", "a_slider_whose_name_is_longer_than_the_names_of_mechanisms_are_a"})
        self.assertNotIn("x", scene)

    def test_a_closed_loop(self):
        """A loop, which URDF cannot express, is added to the scene: the tip on a rod to the ground; the energy balance closes."""
        text = self.imported(ROBOT)
        with open(self.folder / "robot.toml", "w") as file:
            file.write(text.replace("[time]", '[constraint.stay]\ntype = "distance"\nbetween = ["rod:[0.3, 0, 0]", "ground:[1.5, 0.2, 2.5]"]\n\n[time]'))
        # The stay leaves nothing of the hinge free.
        checked = self.tandem("check", "robot.toml").stdout
        self.assertIn("stay", checked)
        with self.went("robot.toml", "results.balance=true", 'results.constraints="all"', "solver.rtol=1e-9") as file:
            residual, scale = energies(file)
            self.assertLess(residual, 1e-8*scale)
            # It carries the moment of the weight alone.
            pull = np.array([0.5, 0.2, 0.5])
            lever = np.cross([1.0, 0, 0], pull/np.linalg.norm(pull))[1]
            self.near(file["constraints/stay/tension"][:], -5*G*0.7/lever, 1e-8)

    def test_wrong_files(self):
        cases = {
            "no XML": ("<robot", "is not XML"), "another": ("<sdf/>", "neither URDF nor MJCF"), "empty": ("<robot/>", "no links"),
            "macros": ('<robot xmlns:xacro="http://ros.org/xacro"><xacro:macro/></robot>', "xacro"),
            "loop": (ROBOT.replace('<child link="end"/>', '<child link="stand"/>'), "permits trees only"),
            "unknown": (ROBOT.replace('<child link="end"/>', '<child link="and"/>'), "there is no link and"),
            "type": (ROBOT.replace('type="prismatic"', 'type="sliding"'), "type"),
            "axis": (ROBOT.replace('<axis xyz="1 0 0"/>', '<axis xyz="0 0 0"/>'), "length zero"),
            "number": (ROBOT.replace('xyz="0.5 0 0"', 'xyz="0.5 0"'), "3 numbers"),
            "mass": (ROBOT.replace('mass value="3"', 'mass value="-3"'), "mass"),
            "twice": (ROBOT.replace('<link name="end">', '<link name="rod">'), "two links have the name rod"),
        }
        for name, (text, says) in cases.items():
            with self.subTest(name):
                self.assertIn(says, self.imported(text, "--output", "x.toml", code=2))
                self.assertFalse((self.folder / "x.toml").exists())
        self.assertIn("JOINT=NUMBER", self.imported(ROBOT, "--at", "hinge", code=2))
        self.assertIn("JOINT=NUMBER", self.imported(ROBOT, "--at", "hinge=nan", code=2))
        for ends, says in ((("a_j",), "form a cycle"), (("b_j", "a_j"), "form a cycle")):
            wheels = "".join(self.WHEEL.format(name, other, 1) for name, other in zip("ab", ends))
            self.assertIn(says, self.imported(ROBOT.replace("</robot>", wheels + "</robot>"), code=2))
        wheel = ROBOT.replace("</robot>", self.WHEEL.format("a", "hinge", 1) + "</robot>")
        self.assertIn("follows hinge", self.imported(wheel, "--at", "a_j=1", code=2))
        self.assertIn("no joint elbow", self.imported(ROBOT, "--at", "elbow=1", code=2))
        self.imported(ROBOT)
        self.assertIn("--force", self.imported(ROBOT, code=2))

    def test_the_program(self):
        """`tandem import` hands over to the package for Python, options and exit code."""
        environment = {"TANDEM_PYTHON": sys.executable, "PYTHONPATH": str(ROOT / "python" / "src")}
        expected = self.imported(ROBOT, "--at", "hinge=0.5", "--output", "robot.toml")
        done = self.tandem("import", "urdf", "robot.urdf", "--at", "hinge=0.5", "--output", "again.toml", env=environment)
        self.assertEqual(done.stdout.strip(), "again.toml")
        self.assertEqual((self.folder / "again.toml").read_text(), expected)
        self.assertIn("--force", self.tandem("import", "urdf", "robot.urdf", "--output", "again.toml", env=environment, code=2).stderr)
        self.assertIn("not MJCF", self.tandem("import", "mjcf", "robot.urdf", env=environment, code=2).stderr)
        self.assertIn("needs a FILE", self.tandem("import", code=2).stderr)

    def test_rotations(self):
        """Euler parameters of rotations of any angle, against the rotation that they make."""
        random = np.random.default_rng(1)
        for angle in (0, 1e-9, 1, np.pi - 1e-9, np.pi, 4):
            axis = random.normal(size=3)
            a = urdf.turned(axis/np.linalg.norm(axis), angle)
            e0, e1, e2, e3 = urdf.euler_parameters(a)
            made = np.array([[e0*e0 + e1*e1 - e2*e2 - e3*e3, 2*(e1*e2 - e0*e3), 2*(e1*e3 + e0*e2)],
                             [2*(e1*e2 + e0*e3), e0*e0 - e1*e1 + e2*e2 - e3*e3, 2*(e2*e3 - e0*e1)],
                             [2*(e1*e3 - e0*e2), 2*(e2*e3 + e0*e1), e0*e0 - e1*e1 - e2*e2 + e3*e3]])
            self.near(made, a, 1e-15)


if __name__ == "__main__":
    unittest.main()
