# SPDX-License-Identifier: MIT
"""Names of 64 characters for every element of a mechanism: whatever reads, computes, writes and reports names gives what it gives
with short ones."""

import json
import re
import unittest

import h5py
import numpy as np
from test_mechanisms import Mechanism

SHORT = """\
[scene]
model = "mechanism"

[gravity]
vector = [0, 0, -9.81]

[parameters]
span = 0.5

[function.table_f]
at = [0, 1, 2]
values = [0, 0.1, 0]

[body.rod_b]
mass = 2
inertia = [0.2, 0.3, 0.4]
position = ["span", 0, 0]
points = { tip_p = [0.5, 0, 0] }

[body.bob_b]
mass = 1
inertia = [0.1, 0.1, 0.1]
position = [1, 0, -0.5]

[joint.pivot_j]
type = "revolute"
bodies = ["ground", "rod_b"]
at = [0, 0, 0]
axis = [0, 1, 0]

[joint.hand_j]
type = "revolute"
bodies = ["rod_b.tip_p", "bob_b"]
axis = [0, 1, 0]

[constraint.latch_c]
type = "coupling"
joints = ["hand_j"]
factors = [1]
locked = false

[force.coil_f]
type = "torsion"
joint = "pivot_j"
stiffness = 30
damping = 0.2
law = "table_f"

[force.push_f]
type = "load"
on = "rod_b.tip_p"
force = ["-0.1*rod_b.vx", "0.1*hand_j.rate", 0]

[sensor.tip_s]
point = "rod_b.tip_p"

[sensor.hand_s]
joint = "hand_j"

[results]
bodies = "all"
joints = "all"
forces = "all"
constraints = "all"
balance = true

[time]
end = 1

[solver]
stepper = "dop853"
rtol = 1e-8

[[event]]
name = "catch_e"
watch = "/joints/hand_j/angle"
value = 0.1
change = "lock latch_c; force.coil_f.stiffness = 2*20"

[[event]]
name = "high_e"
watch = "rod_b.e2"
value = 0.02
"""
NAMES = sorted(set(re.findall(r"\b[a-z]+_[bpjcfse]\b", SHORT)))


LONG = {name: (name + "_" + "long_" * 13)[:64] for name in NAMES}


def lengthened(text):
    return re.sub(r"\b[a-z]+_[bpjcfse]\b", lambda match: LONG[match[0]], text)


class LongNames(Mechanism):
    def test_names_are_what_they_should_be(self):
        self.assertEqual({len(name) for name in LONG.values()}, {64})
        self.assertEqual(len(set(LONG.values())), len(NAMES))

    def both(self, *command, **kwargs):
        """Output of a command with short names, lengthened, and with long names."""
        short, long = self.scene(SHORT, "mechanism_s.toml"), self.scene(lengthened(SHORT), "mechanism_l.toml")
        texts = [self.tandem(command[0], scene, *command[1:], **kwargs).stdout for scene in (short, long)]
        return lengthened(texts[0].replace("mechanism_s", "mechanism_l")), texts[1]

    def test_results(self):
        def paths(file):
            found = {}
            file.visititems(lambda path, item: found.update({path: item[()]} if isinstance(item, h5py.Dataset) else {}))
            return found

        with self.went(self.scene(SHORT), output="short.h5") as one, self.went(self.scene(lengthened(SHORT)), output="long.h5") as two:
            self.assertEqual(len(one["events/time"]), 2)
            short, long = paths(one), paths(two)
            self.assertEqual({lengthened(path) for path in short}, set(long))
            for path, values in short.items():
                if re.search("checkpoint|checksums|scene|profile|report", path):
                    continue
                with self.subTest(path):
                    if values.dtype.kind in "fi":
                        np.testing.assert_array_equal(values, long[lengthened(path)])
                    else:
                        np.testing.assert_array_equal([lengthened(text.decode()) for text in np.ravel(values)],
                                                      [text.decode() for text in np.ravel(long[lengthened(path)])])

    def test_commands(self):
        one, two = self.both("show")
        self.assertEqual(re.sub(r" +", " ", one), re.sub(r" +", " ", two))
        one, two = self.both("check", "--json")
        self.assertEqual([row["name"] for row in json.loads(one)["elements"]], [row["name"] for row in json.loads(two)["elements"]])
        one, two = self.both("equilibrium")
        self.assertEqual(one.split(), two.split())
        one, two = self.both("linearise", "--set", "initial.equilibrium=true", "--shapes")
        self.assertEqual(re.sub(r"\s+", " ", one), re.sub(r"\s+", " ", two))

    def test_resumed(self):
        scene = self.scene(lengthened(SHORT))
        settings = ["--set", "solver.rtol=0", "--set", "solver.step=0.01", "--quiet", "--no-error"]
        self.tandem("run", scene, *settings, "--output", "whole.h5")
        self.tandem("run", scene, *settings, "--set", "solver.max_steps=40", "--output", "part.h5", code=1)
        self.tandem("resume", "part.h5", "--set", "solver.max_steps=100000", "--quiet")
        with h5py.File(self.folder / "whole.h5") as whole, h5py.File(self.folder / "part.h5") as part:
            np.testing.assert_array_equal(whole["trajectory/q"][:], part["trajectory/q"][:])

    def test_a_sweep(self):
        sensor, body = LONG["hand_s"], LONG["bob_b"]
        # Steps of a tolerance are shorter if the largest value between them is asked for.
        self.scene(lengthened(SHORT).replace("rtol = 1e-8", "step = 0.01"))
        self.scene(f'[sweep]\nscene = "scene.toml"\n\n[[vary]]\nkey = "body.{body}.mass"\nvalues = [1, 2]\n\n'
                   f'[[keep]]\nquantity = "sensor:{sensor}/angle"\ntake = "time_of_max"\n\n[[keep]]\nquantity = "q:{body}.x"\n',
                   "sweep.toml")
        self.tandem("sweep", "sweep.toml", "--output", "sweep.h5", "--quiet")
        self.tandem("run", "scene.toml", "--set", f"body.{body}.mass=2", "--output", "out.h5", "--quiet", "--no-error")
        with h5py.File(self.folder / "sweep.h5") as sweep, h5py.File(self.folder / "out.h5") as file:
            self.assertEqual(set(sweep["outputs"]), {f"sensor.{sensor}.angle_time_of_max", f"{body}.x_end"})
            self.assertEqual(list(sweep["inputs"]), [f"body.{body}.mass"])
            self.near(sweep[f"outputs/{body}.x_end"][1], file["trajectory/q"][-1][7], 1e-12)


if __name__ == "__main__":
    unittest.main()
