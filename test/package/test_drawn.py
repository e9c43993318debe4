# SPDX-License-Identifier: MIT
"""Mechanisms in this process, against the program's runs of the same scenes and closed forms; what is refused, and how."""

import unittest

import numpy as np
import tandem
from models import ROOT
from tandem.library import library
from tandem.problem import Problem
from test_modes import CHAIN

SCENES = sorted(path.stem for path in (ROOT / "scenes").glob("*.toml") if 'model = "mechanism"' in path.read_text() and "steady" not in path.read_text())


def scene(name):
    return tandem.Mechanism.from_toml(ROOT / "scenes" / f"{name}.toml")


PENDULUM = {"scene.planar": True, "gravity.vector": [0, -9.81], "parameters.l": 1.0,
            "body.rod": {"mass": 1.0, "inertia": "l^2/12", "position": ["l/2", 0]},
            "joint.pivot": {"type": "revolute", "bodies": ["ground", "rod"], "at": [0, 0]}, "time.end": 2.0}


class Drawn(unittest.TestCase):
    def test_every_scene(self):
        """The same steps as the program's, to what another compilation rounds."""
        self.assertGreater(len(SCENES), 8)
        for name in SCENES:
            with self.subTest(name):
                end = 0.002 if name in ("a03_andrews", "a05_governor") else 0.05
                one = scene(name)
                settings = {"time.end": end, "solver.stepper": "rk4", "solver.step": end/10, "solver.rtol": 0.0,
                            "output.every": 1, "output.interval": 0.0}
                theirs, ours = one.run(settings, error=False), one.solve(settings=settings)
                self.assertEqual((ours.names, ours.units), (theirs.names, theirs.units))
                np.testing.assert_allclose(ours.t, theirs.time, atol=1e-15)
                # Ten steps from the same start; assembled starts are right to 1e-12 of their scale.
                np.testing.assert_allclose(ours.q, theirs.q, rtol=1e-9, atol=1e-9)
                np.testing.assert_allclose(ours.qd, theirs.qd, rtol=1e-8, atol=1e-8*np.abs(theirs.qd).max(initial=1))

    def test_by_words(self):
        """A rod from the horizontal: its energy is that of the start, and the time of a quarter swing the closed form."""
        from math import gamma, pi, sqrt

        solution = tandem.Mechanism(PENDULUM).solve(rtol=1e-10, events=tandem.Event(name="down", index="rod.x", value=0.0, stops=True))
        # A pendulum of the reduced length 2/3: K(sin(pi/4)) sqrt(l/g).
        self.assertAlmostEqual(solution.t[-1], gamma(0.25)**2/(4*sqrt(pi))*sqrt(2/3/9.81), places=8)
        self.assertEqual(solution.stopped_by, "down")
        rate = solution.qd[-1, solution.names.index("rod.angle")]
        self.assertAlmostEqual(abs(rate), sqrt(3*9.81), places=7)

    def test_an_imposed_angle_at_the_start(self):
        """A shaft that a motor has turned by 2 pi t at t = 0.3 s, by pi and by 20 rad: where it points, by words in this process."""
        for start, motion, angle in ((0.3, "2*pi*t", 0.6*np.pi), (0.0, "pi - t", np.pi), (-1.0, "20 + t", 19.0)):
            with self.subTest(motion):
                shaft = {"scene.model": "mechanism", "body.arm": {"mass": 1.0, "inertia": [0.1, 0.2, 0.3], "position": [2.5, 0, 0]},
                         "joint.motor": {"type": "revolute", "bodies": ["ground", "arm"], "at": [0, 0, 0], "axis": [0, 0, 1], "motion": motion},
                         "sensor.turn.joint": "motor", "initial.assemble": True, "time.start": start, "time.end": start + 0.5}
                mechanism = tandem.Mechanism(shaft)
                solution = mechanism.solve(rtol=1e-9)
                x, y = (solution.q[0, solution.names.index(f"arm.{name}")] for name in "xy")
                np.testing.assert_allclose([x, y], [2.5*np.cos(angle), 2.5*np.sin(angle)], atol=1e-10)
                result = mechanism.run(error=False)
                self.assertAlmostEqual(result.sensors["turn"]["angle"].values[0], angle, places=10)

    def test_a_motor_turns_the_way_its_torque_says(self):
        """J phi'' = T, as a function of time and as a law."""
        for given in ({"torque": 0.6}, {"law": "0.6 + 0*rate"}):
            with self.subTest(given):
                wheel = {"scene.planar": True, "body.wheel": {"mass": 1.0, "inertia": 0.3, "position": [0, 0]},
                         "joint.axle": {"type": "revolute", "bodies": ["ground", "wheel"], "at": [0, 0]},
                         "force.motor": {"type": "torsion", "joint": "axle", **given}, "time.end": 1.0}
                solution = tandem.Mechanism(wheel).solve(rtol=1e-10)
                np.testing.assert_allclose(solution.q[-1, solution.names.index("wheel.angle")], 1.0, atol=1e-9)

    def test_pictures_and_pages(self):
        solution = scene("slider_crank").solve(settings={"time.end": 0.2})
        solution.plot()
        page = solution.view()
        self.assertIn("slider", page.text)
        from tandem.viewer import drawing_of

        self.assertTrue(all(body.pieces for body in drawing_of(solution).bodies))

    def test_step_by_step_and_checkpoint(self):
        run = scene("slider_crank").simulation(stepper="dop853", rtol=1e-9)
        run.integrate(0.3)
        words = run.save()
        run.integrate(0.7)
        other = scene("slider_crank").simulation(stepper="dop853", rtol=1e-9)
        other.restore(words)
        other.integrate(0.7)
        np.testing.assert_array_equal(run.q, other.q)
        self.assertEqual(run.multipliers().shape, (run.problem.rows,))

    def test_error_estimate(self):
        solution = tandem.Mechanism(PENDULUM).solve(rtol=1e-6, error=True)
        exact = tandem.Mechanism(PENDULUM).solve(rtol=1e-12)
        difference = np.abs(solution.q[-1] - exact.q[-1]).max()
        self.assertLess(solution.error.q/difference, 3)
        self.assertGreater(solution.error.q/difference, 1/3)

    def test_events_of_the_scene(self):
        one = tandem.Mechanism(PENDULUM)
        one["event"] = [{"name": "low", "watch": "rod.angle", "value": -1.0, "direction": "falling"},
                        {"name": "fast", "watch": "qd:rod.angle", "value": -5.0, "action": "stop"}]
        theirs, ours = one.run({"solver.rtol": 1e-9, "solver.stepper": "dop853"}, error=False), one.solve(
            settings={"solver.rtol": 1e-9, "solver.stepper": "dop853"})
        self.assertEqual([event.name for event in ours.events], ["low", "fast"])
        np.testing.assert_allclose([event.t for event in ours.events], theirs.events["time"], atol=1e-10)

        def upright(t, q, qd):
            return q[0] - 0.25

        self.assertEqual(tandem.Mechanism(PENDULUM).solve(events=upright).events[0].name, "upright")
        one["event"] = [{"name": "pull", "watch": "/joints/pivot/force", "value": 1.0}]
        with self.assertRaisesRegex(ValueError, "'pull' watches /joints/pivot/force"):
            one.solve()

    def test_every_option_of_a_scene(self):
        """The library accepts all options of [solver]: with all defaults, and with separate tolerances of the velocities."""
        import tomllib

        one = tandem.Mechanism(PENDULUM)
        solver = tomllib.loads(one.show())["solver"]
        self.assertGreater(len(solver), 10)
        one["solver"] = {**solver, "stepper": "dop853", "rtol": 1e-9}
        plain = one.solve().q[-1]
        one["solver.rtol_qd"] = 1e-11
        tight = one.solve()
        np.testing.assert_allclose(tight.q[-1], plain, atol=1e-6)
        theirs = one.run(error=False)
        np.testing.assert_allclose(tight.q[-1], theirs.q[-1], atol=1e-9)
        self.assertEqual(tight.statistics["steps"], theirs.report["steps"])

    def test_eigenvalues(self):
        run = tandem.Mechanism.from_toml(CHAIN).simulation()
        values, matrix = run.linearise()
        np.testing.assert_allclose(np.sort(np.abs(values.imag)), [10, 10, 10*np.sqrt(3), 10*np.sqrt(3)], rtol=1e-9)
        np.testing.assert_allclose(np.sort(np.linalg.eigvals(matrix).imag), np.sort(values.imag), rtol=1e-7)
        one = tandem.Mechanism(PENDULUM)
        one["body.rod.angle"] = 0.3
        one["joint.pivot.at"] = [0.5 - 0.5*np.cos(0.3), -0.5*np.sin(0.3)]
        q = one.simulation().find_equilibrium()
        self.assertAlmostEqual(abs(np.sin(q[2])), 1.0, places=9)

    def test_what_is_refused(self):
        one = tandem.Mechanism(PENDULUM)
        one["body.rod.maas"] = 2
        with self.assertRaisesRegex(tandem.InvalidInput, "maas"):
            one.solve()
        with self.assertRaisesRegex(tandem.InvalidInput, "no body"):
            tandem.Mechanism({"time.end": 1}).solve()
        with self.assertRaisesRegex(ValueError, "time.end"):
            tandem.Mechanism().solve()
        with self.assertRaisesRegex(KeyError, "watches 'rod.z'"):
            tandem.Mechanism(PENDULUM).solve(events=tandem.Event(name="e", index="rod.z"))
        run = tandem.Mechanism(PENDULUM).simulation()
        with self.assertRaisesRegex(tandem.TandemError, "equations of a mechanism"):
            run.check()
        for option in ("constant_mass", "mass_blocks", "breakpoints"):
            with self.assertRaisesRegex(tandem.InvalidInput, "equations of a mechanism"):
                run.problem.set_option(option, 1 if option == "constant_mass" else [1])
        with self.assertRaisesRegex(TypeError, "no start of its own"):
            tandem.solve(tandem.Model(n=1, mass_matrix=[[1.0]]), (0, 1))

    def test_words_that_nobody_knows(self):
        """A table or a key that is misspelt counts for something or is refused."""
        for key, value, says in (("bodys.rod.mass", 1, 'no table "bodys".*"body"'), ("time.endd", 1, 'unknown key "endd".*"end"'),
                                 ("initial.asemble", True, 'unknown key "asemble".*"assemble"')):
            with self.subTest(key), self.assertRaisesRegex(ValueError, says):
                tandem.Mechanism({**PENDULUM, key: value}).solve((0, 1))
        with self.assertRaisesRegex(ValueError, "q is given without qd"):
            tandem.Mechanism(PENDULUM).solve((0, 1), q=[0, 0, 0])

    def test_values_as_texts(self):
        """Valid and invalid texts of values; problems that are not mechanisms, or incomplete."""
        called = library()
        problem = called.tandem_new_mechanism(None)
        try:
            for text in ("1", " -2.5e-3 ", '"a \\"b\\" \\\\"', "true", "[]", '[1, "l/2" , false]', "[1,]", "[[1, 2], [3, 4]]"):
                self.assertEqual(called.tandem_set_key(problem, b"body.a.mass", text.encode()), 0, text)
            for text in ("", "1 2", "[1", "[1 2]", '"a', "nan", "inf", "3*1", "'a'", "[[[1]]]", "1]", '"\\n"', "e", "-", "1e999", "[,]"):
                self.assertNotEqual(called.tandem_set_key(problem, b"body.a.mass", text.encode()), 0, text)
            self.assertNotEqual(called.tandem_set_key(problem, b"", b"1"), 0)
            start = np.zeros(3)
            self.assertNotEqual(called.tandem_start(problem, 0.0, start.ctypes.data, start.ctypes.data), 0)
            self.assertIn(b"not complete", called.tandem_message(problem))
            self.assertNotEqual(called.tandem_get_drawing(problem, start.ctypes.data, start.ctypes.data), 0)
            self.assertNotEqual(called.tandem_define(problem, 1, 0, 0.0, 1.0), 0)
            self.assertEqual(called.tandem_set_key(problem, b"body.a.mass", b"1"), 0)
            self.assertEqual(called.tandem_set_key(problem, b"body.a.position", b"[0, 0]"), 0)
            self.assertEqual(called.tandem_define(problem, 1, 0, 0.0, 1.0), 0, called.tandem_message(problem))
            self.assertNotEqual(called.tandem_define(problem, 1, 0, 0.0, 1.0), 0)
            self.assertIn(b"complete", called.tandem_message(problem))
            self.assertNotEqual(called.tandem_set_key(problem, b"body.b.mass", b"1"), 0)
        finally:
            called.tandem_free(problem)
        other = Problem(tandem.Model(n=1, mass_matrix=[[1.0]]))
        with self.assertRaisesRegex(tandem.InvalidInput, "not a mechanism"):
            other.call("set_key", b"body.a.mass", b"1")
        with self.assertRaisesRegex(tandem.InvalidInput, "no complete mechanism"):
            other.call("get_drawing", None or start.ctypes.data, start.ctypes.data)

    def test_it_needs_no_program(self):
        import os
        from unittest import mock

        with mock.patch.dict(os.environ, {"TANDEM_PROGRAM": "/nowhere/tandem"}):
            self.assertEqual(tandem.Mechanism(PENDULUM).solve().status, "ok")


if __name__ == "__main__":
    unittest.main()
