# SPDX-License-Identifier: MIT
"""Models in Python against motions in closed form, and what a user of Python expects where something is wrong."""

import ctypes
import math
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
import unittest

import numpy as np
import tandem
from models import AT_10, G, START, Pendulum, Skate, compiled_pendulum


class Motions(unittest.TestCase):
    def test_pendulum(self):
        solution = tandem.solve(Pendulum(), (0, 10), *START, rtol=1e-11, error=True)
        error = np.abs(solution.q[-1] - AT_10).max()
        # A run of 350 steps of 1e-11 each, which says itself that it is wrong by 1e-11.
        self.assertLess(error, 1e-10)
        self.assertLess(error, 3*solution.error.q)
        self.assertEqual(solution.t[0], 0)
        self.assertEqual(solution.t[-1], 10)
        self.assertEqual(solution.t.size, solution.statistics["steps"] + 1)
        self.assertTrue(solution.success)
        self.assertTrue(np.array_equal(solution["x"], solution.q[:, 0]))

    def test_every_stepper(self):
        for stepper in ("rk4", "dopri5", "dop853", "trapezoid", "sdirk54", "radau5", "radau", "auto"):
            with self.subTest(stepper):
                rough = {} if stepper == "rk4" else {"rtol": 1e-6}
                options = {"step": 1e-3} if stepper == "rk4" else rough
                solution = tandem.solve(Pendulum(), (0, 1), *START, stepper=stepper, **options)
                exact = tandem.solve(Pendulum(), (0, 1), *START, rtol=1e-12).q[-1]
                # A thousand times the tolerance: what its errors a step may sum up to.
                self.assertLess(np.abs(solution.q[-1] - exact).max(), 1e-3)

    def test_auto_finds_what_is_stiff(self):
        class Follower(tandem.Model):
            """A mass on a spring and a damper that are far stiffer than its motion, q = sin(t)."""

            n = 1
            mass_matrix = np.eye(1)

            def applied_force(self, t, q, qd):
                return -1e8*(q - math.sin(t)) - 2e4*(qd - math.cos(t)) - math.sin(t)

        solution = tandem.solve(Follower(), (0, 2), [0], [1], stepper="auto", rtol=1e-6)
        self.assertLess(abs(solution.q[-1, 0] - math.sin(2)), 1e-5)
        self.assertGreaterEqual(solution.statistics["switches"], 1)
        # dop853 alone would need some 1e4/6 steps a second.
        self.assertLess(solution.statistics["steps"], 1000)
        # It is the default, with the tolerance 1e-6.
        self.assertTrue(np.array_equal(tandem.solve(Follower(), (0, 2), [0], [1]).q, solution.q))

    def test_skate_at_wanted_times(self):
        times = np.linspace(0, 10, 101)
        skate = Skate()
        solution = tandem.solve(skate, (0, 10), [0, 0, 0], [0, 0, skate.spin], rtol=1e-10, t_eval=times)
        self.assertTrue(np.array_equal(solution.t, times))
        # 2e-8: what the tolerance of a step becomes over 300 of them, on 10 m.
        self.assertLess(np.abs(solution.q - skate.exact(times)).max(), 2e-8)

    def test_rows_on_the_constraints(self):
        solution = tandem.solve(Pendulum(), (0, 10), *START, rtol=1e-6, t_eval=np.linspace(0, 10, 1001))
        # The constraint tolerance is 1e-12 of the scale of a row.
        self.assertLess(np.abs((solution.q**2).sum(axis=1) - 1).max(), 1e-11)
        self.assertLess(np.abs((solution.q*solution.qd).sum(axis=1)).max(), 1e-10)

    def test_wanted_times_leave_the_steps_alone(self):
        plain = tandem.solve(Pendulum(), (0, 3), *START)
        dense = tandem.solve(Pendulum(), (0, 3), *START, t_eval=[0, 0.1, 0.1, 2.9, 3])
        self.assertTrue(np.array_equal(plain.q[-1], dense.q[-1]))
        self.assertEqual(dense.t.size, 5)
        self.assertEqual(tandem.solve(Pendulum(), (0, 3), *START, t_eval=[]).t.size, 0)
        # More than are gathered at once, many in a step.
        times = np.linspace(0, 3, 5001)
        many = tandem.solve(Pendulum(), (0, 3), *START, t_eval=times)
        self.assertTrue(np.array_equal(many.t, times))
        self.assertTrue(np.array_equal(many.q[::10], tandem.solve(Pendulum(), (0, 3), *START, t_eval=times[::10]).q))

    def test_functions_and_constants(self):
        model = tandem.Model(n=2, n_holonomic=1, holonomic=lambda t, q: [q[0]**2 + q[1]**2 - 1], mass_matrix=[[1, 0], [0, 1]],
                             holonomic_jacobian=lambda t, q: [[2*q[0], 2*q[1]]], applied_force=[0, -G])
        solution = tandem.solve(model, (0, 10), *START, rtol=1e-10)
        self.assertLess(np.abs(solution.q[-1] - AT_10).max(), 1e-7)

    def test_all_terms_at_once(self):
        class Fused(tandem.Model):
            n, n_holonomic, provides = 2, 1, tandem.PHI + tandem.JACOBIAN + tandem.GAMMA + tandem.MASS + tandem.FORCE

            def evaluate(self, need, t, q, qd):
                return {"phi": q @ q - 1, "jacobian": 2*q, "gamma": 2*qd @ qd, "mass": np.eye(2), "force": [0, -G]}

        fused = tandem.solve(Fused(), (0, 2), *START)
        single = tandem.solve(Pendulum(), (0, 2), *START)
        # The same arithmetic but for the constant mass: rounding only.
        self.assertLess(np.abs(fused.q[-1] - single.q[-1]).max(), 1e-12)

    def test_compiled_functions(self):
        model, alive = compiled_pendulum()
        if model is None:
            self.skipTest("no compiler of C")
        compiled = tandem.solve(model, (0, 10), *START, rtol=1e-11)
        python = tandem.solve(Pendulum(), (0, 10), *START, rtol=1e-11)
        self.assertLess(np.abs(compiled.q[-1] - python.q[-1]).max(), 1e-10)
        del alive

    def test_backward_and_nothing(self):
        with self.assertRaises(ValueError):
            tandem.solve(Pendulum(), (1, 0), *START)
        self.assertEqual(tandem.solve(Pendulum(), (1, 1), *START).t.tolist(), [1.0])

    def test_xarray(self):
        solution = tandem.solve(Pendulum(), (0, 1), *START)
        motion = solution.to_xarray()
        self.assertTrue(np.array_equal(motion.q.sel(coordinate="y"), solution["y"]))
        self.assertEqual(motion.time.attrs["units"], "s")


class Runs(unittest.TestCase):
    def test_steps_and_dense_output(self):
        run = tandem.Simulation(Pendulum(), *START, rtol=1e-9)
        before, state = run.t, run.step()
        middle = run.at((before + state.t)/2)
        self.assertLess(abs(middle.q @ middle.q - 1), 1e-12)
        with self.assertRaises(tandem.InvalidInput):
            run.at(state.t + 1)
        self.assertEqual(run.integrate(1.0).t, 1.0)
        self.assertEqual(run.integrate(1.0).t, 1.0)
        with self.assertRaises(tandem.InvalidInput):
            run.integrate(0.5)

    def test_energies_and_multipliers(self):
        run = tandem.Simulation(Pendulum(), *START, rtol=1e-10)
        run.integrate(1.3)
        kinetic, potential = run.energies()
        self.assertAlmostEqual(kinetic + potential, 0, delta=1e-8)
        # Along the rod: m (|v|^2 + g . q) = -2 lambda.
        self.assertAlmostEqual(run.multipliers()[0], -(-run.qd @ run.qd + G*run.q[1])/2, delta=1e-8)

    def test_events(self):
        def lowest(t, q, qd):
            return q[0]

        def high(t, q, qd):
            return q[0] - 0.9

        high.terminal, high.direction = True, 1
        solution = tandem.solve(Pendulum(), (0, 10), *START, rtol=1e-10, events=[lowest, high])
        self.assertEqual(solution.stopped_by, "high")
        self.assertEqual([event.name for event in solution.events], ["lowest", "high"])
        self.assertEqual(solution.events[0].direction, 1)
        # A quarter of the period: K(1/2)/sqrt(g).
        self.assertAlmostEqual(solution.events[0].t, 1.8540746773013719/np.sqrt(G), delta=1e-8)
        self.assertAlmostEqual(solution.q[-1, 0], 0.9, delta=1e-12)
        threshold = tandem.Event(quantity="q", index=0, value=0.9, direction=1, stops=True, name="high")
        again = tandem.solve(Pendulum(), (0, 10), *START, rtol=1e-10, events=threshold)
        self.assertAlmostEqual(again.t[-1], solution.t[-1], delta=1e-9)
        run = solution.simulation
        self.assertEqual(run.integrate(10.0).t > solution.t[-1], True)

    def test_checkpoint(self):
        run = tandem.Simulation(Pendulum(), *START, rtol=1e-9)
        run.integrate(1.0)
        words = run.save()
        run.integrate(3.0)
        other = tandem.Simulation(Pendulum(), *START, rtol=1e-9)
        other.restore(words)
        self.assertEqual(other.t, 1.0)
        other.integrate(3.0)
        self.assertTrue(np.array_equal(run.q, other.q))
        words[5] ^= 1
        with self.assertRaises(tandem.InvalidInput):
            other.restore(words)
        # It stays where it was, and can go on.
        self.assertEqual(other.t, 3.0)
        self.assertTrue(np.array_equal(run.integrate(4.0).q, other.integrate(4.0).q))

    def test_check_names_what_is_wrong(self):
        tandem.check(Pendulum(), *START)

        class Wrong(Pendulum):
            def constraint_acceleration(self, t, q, qd):
                return -2*qd @ qd

        with self.assertRaisesRegex(tandem.InvalidInput, "constraint_acceleration is wrong"):
            tandem.check(Wrong(), *START)

    def test_functions_that_contradict_each_other_are_told_at_once(self):
        class Halved(Pendulum):
            def holonomic_jacobian(self, t, q):
                return q

        with self.assertWarnsRegex(RuntimeWarning, "contradicts itself"), self.assertRaises(tandem.RunFailed):
            tandem.solve(Halved(), (0, 1), *START, max_steps=3000)

    def test_assemble(self):
        q, qd = tandem.assemble(Pendulum(), [-1.1, 0.1], [0.1, 0.3])
        self.assertAlmostEqual(q @ q, 1, delta=1e-12)
        self.assertAlmostEqual(q @ qd, 0, delta=1e-12)

    def test_time_is_counted(self):
        figures = tandem.solve(Pendulum(), (0, 20), *START, rtol=1e-10).statistics
        self.assertGreater(figures["cpu_seconds"], 0.0)
        self.assertGreater(figures["wall_seconds"], 0.5*figures["cpu_seconds"])

    def test_warnings_and_figures(self):
        run = tandem.Simulation(Pendulum(), *START, step=0.01, stepper="rk4")
        run.integrate(1.0)
        self.assertEqual(run.statistics["steps"], 100)
        self.assertIsInstance(run.warnings, list)
        with self.assertRaisesRegex(tandem.InvalidInput, "right_hand_sides"):
            run.statistic("nothing")
        with self.assertRaisesRegex(tandem.InvalidInput, "constraint_tolerance"):
            tandem.solve(Pendulum(), (0, 1), *START, no_option=1.0)

    def test_threads(self):
        """The lock is released while the library runs: problems of other threads proceed, with equal results."""
        model, alive = compiled_pendulum()
        if model is None:
            self.skipTest("no compiler of C")
        alone = tandem.solve(model, (0, 20), *START, rtol=1e-10).q[-1]
        found, ticks = [], []
        threads = [threading.Thread(target=lambda: found.append(tandem.solve(model, (0, 20), *START, rtol=1e-10).q[-1])) for _ in range(8)]
        for thread in threads:
            thread.start()
        while any(thread.is_alive() for thread in threads):
            ticks.append(time.monotonic())
            time.sleep(0.001)
        self.assertEqual(len(found), 8)
        self.assertTrue(all(np.array_equal(one, alone) for one in found))
        python = [threading.Thread(target=lambda: found.append(tandem.solve(Pendulum(), (0, 1), *START).q[-1])) for _ in range(4)]
        for thread in python:
            thread.start()
        for thread in python:
            thread.join()
        self.assertTrue(all(np.array_equal(one, found[8]) for one in found[8:]))
        del alive


def with_force(function):
    class Model(Pendulum):
        def applied_force(self, t, q, qd):
            return function(t, q, qd)

    return Model()


class Callbacks(unittest.TestCase):
    """Return values of functions, valid and invalid."""

    def test_kinds_and_orders(self):
        exact = tandem.solve(Pendulum(), (0, 1), *START).q[-1]
        class Fortran(Pendulum):
            mass_matrix = None

            def mass_matrix(self, q):
                return np.asfortranarray(np.array([[1.0, 0.0], [0.0, 1.0]]))

        for name, model in {
            "list": with_force(lambda t, q, qd: [0, -G]), "tuple": with_force(lambda t, q, qd: (0, -G)),
            "column": with_force(lambda t, q, qd: np.array([[0.0], [-G]])),
            "slice": with_force(lambda t, q, qd: np.array([0.0, 5.0, -G, 5.0])[::2]), "order": Fortran(),
        }.items():
            with self.subTest(name):
                # A mass matrix not declared constant is factorised anew: rounding.
                self.assertLess(np.abs(tandem.solve(model, (0, 1), *START).q[-1] - exact).max(), 1e-13)
        single = tandem.solve(with_force(lambda t, q, qd: np.array([0, -G], dtype=np.float32)), (0, 1), *START)
        # float32 numbers are taken for what they are.
        rounded = tandem.solve(with_force(lambda t, q, qd: [0, float(np.float32(-G))]), (0, 1), *START)
        self.assertTrue(np.array_equal(single.q, rounded.q))

    def test_a_matrix_in_fortran_order_is_not_transposed(self):
        class Skewed(Skate):
            def nonholonomic_jacobian(self, t, q):
                return np.asfortranarray(Skate.nonholonomic_jacobian(self, t, q))

            def mass_matrix(self, q):
                return np.asfortranarray(np.diag([1.0, 1.0, 0.2]))

        skate = Skewed()
        solution = tandem.solve(skate, (0, 5), [0, 0, 0], [0, 0, skate.spin], rtol=1e-10)
        self.assertLess(np.abs(solution.q[-1] - skate.exact(5.0)).max(), 1e-8)

    def test_wrong_shapes_and_kinds(self):
        for returned, kind, words in (
            ([1.0, 2.0, 3.0], ValueError, r"applied_force returned an array of the shape \(3,\): it must have the shape \(2,\)"),
            (None, TypeError, "applied_force returned None"), ("text", TypeError, "must return real ones"),
            (np.ones(2)*1j, TypeError, "complex128"), (np.ones((2, 2)), ValueError, r"\(2, 2\)"), ([[1.0], [2.0, 3.0]], ValueError, ""),
        ):
            with self.subTest(repr(returned)), self.assertRaisesRegex(kind, words):
                tandem.solve(with_force(lambda t, q, qd, returned=returned: returned), (0, 1), *START)

    def test_exceptions_arrive_as_themselves(self):
        class Mine(Exception):
            pass

        def force(t, q, qd):
            if t > 0.5:
                raise Mine("here", t)
            return [0, -G]

        run = tandem.Simulation(with_force(force), *START)
        with self.assertRaises(Mine) as caught:
            run.integrate(1.0)
        self.assertEqual(caught.exception.args[0], "here")
        # Nothing is lost: the state is that of the last accepted step, and the run can be asked.
        self.assertTrue(0 < run.t <= 0.5)
        self.assertAlmostEqual(run.q @ run.q, 1, delta=1e-12)
        # From elsewhere than a run, too.
        with self.assertRaises(Mine):
            tandem.check(with_force(lambda t, q, qd: (_ for _ in ()).throw(Mine())), *START)

    def test_not_a_number(self):
        with self.assertRaises(tandem.RunFailed) as caught:
            tandem.solve(with_force(lambda t, q, qd: [0, -G if t < 0.5 else np.nan]), (0, 1), *START)
        self.assertEqual(caught.exception.status, "not_finite")
        self.assertIn("force", str(caught.exception))
        self.assertAlmostEqual(caught.exception.solution.t[-1], 0.5, delta=1e-3)

    def test_not_evaluable(self):
        def force(t, q, qd):
            if t > 0.5:
                raise tandem.NotEvaluable
            return [0, -G]

        with self.assertRaises(tandem.RunFailed) as caught:
            tandem.solve(with_force(force), (0, 1), *START)
        self.assertEqual(caught.exception.status, "not_evaluable")

    def test_habits_of_scipy_that_mean_something_else(self):
        def high(t, q, qd):
            return q[0] - 0.9

        high.terminal = 2
        with self.assertRaisesRegex(tandem.InvalidInput, "remove step or rtol"):
            tandem.solve(Pendulum(), (0, 1), *START, step=1e-2, rtol=1e-5)
        for wrong, words in (({"events": high}, "terminal = 2"), ({"t_eval": [[0.1, 0.2], [0.3, 0.4]]}, "a list of times")):
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                tandem.solve(Pendulum(), (0, 1), *START, **wrong)
        for option, words in (("dense_output", "simulation.at"), ("method", "stepper")):
            with self.subTest(option), self.assertRaisesRegex(TypeError, words):
                tandem.solve(Pendulum(), (0, 1), *START, **{option: True})

    def test_wrong_states(self):
        for q, kind in (([1.0, 2.0, 3.0], ValueError), ([[-1.0, 0.0]], ValueError), (["a", "b"], TypeError), ([1j, 0], TypeError),
                        ([1.0, 1.0], tandem.InvalidInput), ([np.nan, 0.0], tandem.TandemError)):
            with self.subTest(repr(q)), self.assertRaises(kind):
                tandem.solve(Pendulum(), (0, 1), q, [0, 0])
        single = tandem.solve(Pendulum(), (0, 1), np.array([-1, 0], dtype=np.float32), np.zeros(2, dtype=int))
        self.assertEqual(single.q.dtype, np.float64)

    def test_what_a_function_is_given_can_be_kept_and_changed(self):
        kept = []

        def force(t, q, qd):
            kept.append(q)
            q[:] = 7.0
            return [0, -G]

        exact = tandem.solve(Pendulum(), (0, 1), *START).q[-1]
        self.assertTrue(np.array_equal(tandem.solve(with_force(force), (0, 1), *START).q[-1], exact))
        self.assertTrue(all(np.array_equal(q, [7.0, 7.0]) for q in kept))

    def test_wrong_models(self):
        with self.assertRaisesRegex(TypeError, "has no 'mas_matrix'"):
            tandem.Model(mas_matrix=1)
        with self.assertRaises(TypeError):
            tandem.solve(tandem.Model(n=2.5), (0, 1), *START)
        with self.assertRaisesRegex(TypeError, r"give an instance of tandem.Model, Pendulum\(\)"):
            tandem.solve(Pendulum, (0, 1), *START)
        with self.assertRaisesRegex(tandem.InvalidInput, "at most as many constraints"):
            tandem.solve(tandem.Model(n=1, n_holonomic=2), (0, 1), [0], [0])
        with self.assertRaisesRegex(tandem.InvalidInput, "mass_matrix"):
            tandem.solve(tandem.Model(n=1), (0, 1), [0], [0])


class Interrupts(unittest.TestCase):
    """Ctrl-C in a process of its own: what arrives, and that the state is still there."""

    def interrupted(self, code, after):
        text = "import sys; sys.path.insert(0, sys.argv[1])\nimport numpy as np, tandem, time\nfrom models import *\n" + textwrap.dedent(code)
        process = subprocess.Popen([sys.executable, "-c", text, os.path.dirname(os.path.abspath(__file__))], stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE, text=True)
        self.assertEqual(process.stdout.readline().strip(), "ready", "the program did not start")
        time.sleep(after)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
        return out, err

    def test_while_a_function_of_python_runs(self):
        for _ in range(3):
            out, err = self.interrupted("""
                run = tandem.Simulation(Pendulum(), *START, stepper="rk4", step=1e-6)
                print("ready", flush=True)
                try:
                    run.integrate(1e3)
                except KeyboardInterrupt:
                    print("interrupted", run.t > 0, abs(run.q @ run.q - 1) < 1e-12)
                """, 0.3)
            self.assertEqual(out.strip(), "interrupted True True", err)
            self.assertEqual(err, "")

    def test_while_a_function_sleeps(self):
        out, err = self.interrupted("""
            class Slow(Pendulum):
                def applied_force(self, t, q, qd):
                    if t > 0.1:
                        print("ready", flush=True)
                        time.sleep(60)
                    return [0, -G]
            try:
                tandem.solve(Slow(), (0, 10), *START)
            except KeyboardInterrupt:
                print("interrupted")
            """, 0.2)
        self.assertEqual(out.strip(), "interrupted", err)

    def test_while_compiled_functions_run(self):
        if compiled_pendulum()[0] is None:
            self.skipTest("no compiler of C")
        out, err = self.interrupted("""
            model, alive = compiled_pendulum()
            run = tandem.Simulation(model, *START, stepper="rk4", step=1e-6)
            print("ready", flush=True)
            try:
                run.integrate(1e3)
            except KeyboardInterrupt:
                print("interrupted", run.t > 0)
            """, 0.3)
        self.assertEqual(out.strip(), "interrupted True", err)


class Memory(unittest.TestCase):
    def test_problems_are_given_back(self):
        """A thousand problems leave no more than a megabyte."""
        def size():
            with open("/proc/self/statm") as file:
                return int(file.read().split()[1])*os.sysconf("SC_PAGE_SIZE")

        for _ in range(50):
            tandem.Simulation(Pendulum(), *START)
        before = size()
        for _ in range(1000):
            tandem.Simulation(Pendulum(), *START)
        self.assertLess(size() - before, 1e6 + 1000*ctypes.sizeof(ctypes.c_double)*64)


if __name__ == "__main__":
    unittest.main()
