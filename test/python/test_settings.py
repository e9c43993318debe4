# SPDX-License-Identifier: MIT
"""Options of scenes and of the command line: defaults, options without effect, settings that replace others, keys that are removed;
and advice that fits the cause.

Runs build/tandem, or what the environment variable TANDEM names.
"""

import subprocess
import unittest

import h5py
from test_output import ROOT, SHORT, Case, run

PENDULUM = """[scene]
model = "mechanism"
planar = true
[gravity]
vector = [0.0, -9.81]
[body.rod]
mass = 1.0
inertia = 0.1
position = [0.5, 0.0]
[joint.pin]
type = "revolute"
bodies = ["ground", "rod"]
at = [0.0, 0.0]
[force.damper]
type = "torsion"
joint = "pin"
damping = 0.1
[time]
end = 0.2
"""


class Solver(Case):
    def report(self, *arguments, **kwargs):
        """The line of the report on the solver."""
        lines = self.tandem("run", *arguments, "--no-error", "--force", "--output", "a.h5", **kwargs).stdout.splitlines()
        return next(line for line in lines if line.split()[0] == "solver").split(None, 1)[1]

    def shown(self, *arguments):
        """The keys of [solver] in the complete scene."""
        lines = self.tandem("show", *arguments).stdout.split("[solver]\n")[1].split("\n\n")[0].splitlines()
        return {line.split(" = ")[0]: line.split(" = ")[1].split("  #")[0].strip() for line in lines}

    def test_defaults(self):
        for solver, says, stepper, step, rtol in [
            ("", "auto, rtol 1e-6,", '"auto"', "0.0", "1e-6"),
            ('stepper = "dop853"', "dop853, rtol 1e-6,", '"dop853"', "0.0", "1e-6"),
            ('stepper = "trapezoid"', "trapezoid, rtol 1e-6,", '"trapezoid"', "0.0", "1e-6"),
            ('stepper = "radau"', "radau, rtol 1e-6,", '"radau"', "0.0", "1e-6"),
            ('stepper = "rk4"', "rk4, h = 0.001 s,", '"rk4"', "0.001", "0.0"),
            ("step = 2e-3", "rk4, h = 0.002 s,", '"auto"', "0.002", "0.0"),
            ('stepper = "dopri5"\nstep = 2e-3', "dopri5, h = 0.002 s,", '"dopri5"', "0.002", "0.0"),
            ("atol = 1e-9", "auto, rtol 1e-6, atol 1e-9,", '"auto"', "0.0", "1e-6"),
            ("rtol = 0", "auto, rtol 1e-6,", '"auto"', "0.0", "0.0"),
        ]:
            with self.subTest(solver):
                scene = self.disk(solver=solver)
                self.assertTrue(self.report(scene).startswith(says), self.report(scene))
                keys = self.shown(scene)
                self.assertEqual((keys["stepper"], keys["step"], keys["rtol"]), (stepper, step, rtol))
                # The complete scene is the same run.
                (self.folder / "whole.toml").write_text(self.tandem("show", scene).stdout)
                self.assertTrue(self.report("whole.toml").startswith(says))

    def test_options_without_effect(self):
        """An error that shows the line of the option, and says what to do."""
        for solver, key, remedy in [
            ("step = 1e-3\nrtol = 1e-6", "step is given beside a tolerance", "remove step or rtol"),
            ("step = 1e-3\nmax_step = 0.1", "max_step has no effect", "rtol instead of step"),
            ("step = 1e-3\nfirst_step = 0.1", "first_step has no effect", "rtol instead of step"),
            ("step = 1e-3\natol = 1e-6", "atol has no effect", "rtol instead of step"),
            ("step = 1e-3\natol_qd = 1e-6", "atol_qd has no effect", "rtol instead of step"),
            ('stepper = "rk4"\natol = 1e-6', "atol has no effect, since rk4", "choose another stepper"),
            ("v_limit = 0.5", 'v_limit has no effect with chart = "every_step"', 'set chart = "paper"'),
            ("iteration_limit = 3", "iteration_limit has no effect", 'set chart = "paper"'),
            ("secant_limit = 2.0", "secant_limit has no effect", 'set chart = "adaptive"'),
            ("Btol = 1e-9", "Btol", 'set refresh = "refine"'),
            ('stepper = "dop853"\nintol = 1e-9', "intol has no effect", "choose an implicit stepper"),
        ]:
            with self.subTest(solver):
                done = self.refused("show", self.disk(solver=solver), says=[key, remedy, "scene.toml:", "--unset solver."])
                self.assertIn("^", done.stderr)
        self.refused("show", self.disk(output="every = 2\ninterval = 0.1"), says=["every has no effect together with interval"])
        for words in (["solver.step=1e-3", "solver.rtol=1e-6"], ["output.every=2", "output.interval=0.1"], ["solver.v_limit=1"]):
            settings = [part for word in words for part in ("--set", word)]
            for command in ("show", "run", "check", "linearise", "equilibrium"):
                self.refused(command, self.disk(), *settings, says="--set:1:")

    def test_a_setting_replaces_what_the_file_says(self):
        controlled = self.disk(solver='stepper = "dop853"\nrtol = 1e-9\natol = 1e-10\nmax_step = 0.5\nfirst_step = 0.01')
        self.assertTrue(self.report(controlled, "--set", "solver.step=1e-3").startswith("dop853, h = 0.001 s"))
        self.assertTrue(self.report(controlled, "--set", "solver.stepper=rk4", "--set", "solver.step=1e-3").startswith("rk4, h = 0.001 s"))
        # Zero means that it is not given.
        self.assertTrue(self.report(controlled, "--set", "solver.step=0").startswith("dop853, rtol 1e-9, atol 1e-10"))
        self.refused("run", controlled, "--set", "solver.stepper=rk4", says="give step instead of rtol")
        fixed = self.disk(solver="step = 1e-3")
        self.assertTrue(self.report(fixed, "--set", "solver.rtol=1e-7").startswith("auto, rtol 1e-7"))
        self.assertTrue(self.report(fixed, "--set", "solver.rtol_qd=1e-7").startswith("auto, rtol 1e-7"))
        self.refused("run", fixed, "--set", "solver.atol=1e-7", says="atol has no effect on fixed steps")
        # Rows at steps, and at times.
        rows = self.disk(solver="step = 1e-3", output="every = 20")
        self.tandem("run", rows, "--set", "output.interval=0.025", "--output", "b.h5", "--no-error")
        with h5py.File(self.folder / "b.h5") as file:
            self.assertEqual(len(file["trajectory/time"]), 5)
        rows = self.disk(solver="step = 1e-3", output="interval = 0.02")
        self.tandem("run", rows, "--set", "output.every=25", "--output", "c.h5", "--no-error")
        with h5py.File(self.folder / "c.h5") as file:
            self.assertEqual(len(file["trajectory/time"]), 5)

    def test_keys_and_elements_are_removed(self):
        scene = self.disk(solver='stepper = "dop853"\nrtol = 1e-9\nmax_step = 0.5', model="mass = 7.0")
        self.assertTrue(self.report(scene, "--unset", "solver.rtol").startswith("dop853, rtol 1e-6"))
        self.assertTrue(self.report(scene, "--unset", "solver").startswith("auto, rtol 1e-6"))
        self.assertTrue(self.report(scene, "--unset=solver.rtol", "--set", "solver.rtol=1e-7").startswith("dop853, rtol 1e-7"))
        # In the order of the command line.
        self.assertTrue(self.report(scene, "--set", "solver.rtol=1e-7", "--unset", "solver.rtol").startswith("dop853, rtol 1e-6"))
        for command in ("show", "run", "check"):
            self.refused(command, scene, "--unset", "solver.rtoll", says=["no such key", 'did you mean "rtol"?'])
            self.refused(command, scene, "--unset", "solver.rtol=1", says="without a value")
        self.refused("run", scene, "--unset", says="needs a value after --unset")

    def test_elements_of_mechanisms_are_removed(self):
        scene = self.scene(PENDULUM)
        self.assertIn("damper", self.tandem("show", scene).stdout)
        self.assertNotIn("damper", self.tandem("show", scene, "--unset", "force.damper").stdout)
        self.assertNotIn("[gravity]\nvector = [0.0, -9.81]", self.tandem("show", scene, "--unset", "gravity.vector").stdout)
        self.refused("show", scene, "--unset", "force.dampr", says='did you mean "damper"?')
        self.refused("show", scene, "--unset", "joint.pin.type", says="type is missing")
        # The remaining scene must be a mechanism.
        self.refused("show", scene, "--unset", "joint.pin", says="pin")
        self.tandem("equilibrium", scene, "--set", "body.rod.position=[0.0, -0.5]", "--unset", "force.damper")
        self.tandem("linearise", scene, "--unset", "force.damper")

    def test_events_are_removed_by_number(self):
        events = "".join(f'[[event]]\nname = "e{i}"\nwatch = "rz"\nvalue = 0.{i}\n' for i in (1, 2, 3))
        scene = self.scene('[scene]\nmodel = "rolling_disk"\n[time]\nend = 0.1\n' + events)

        def names(*arguments):
            return [line.split('"')[1] for line in self.tandem("show", scene, *arguments).stdout.split("[[event]]")[1:]]

        self.assertEqual(names("--unset", "event.2"), ["e1", "e3"])
        self.assertEqual(names("--unset", "event"), [])
        self.assertEqual(names("--unset", "event.1", "--unset", "event.1"), ["e3"])
        # Numbers of settings before it count the elements that there were, those after it the ones that are left.
        text = self.tandem("show", scene, "--set", "event.3.value=0.7", "--unset", "event.2", "--set", "event.1.value=0.6").stdout
        self.assertEqual([part.split("value = ")[1].split()[0] for part in text.split("[[event]]")[1:]], ["0.6", "0.7"])
        self.refused("show", scene, "--unset", "event.4", says="no such key")

    def test_resume_and_studies_take_it_too(self):
        self.tandem("run", self.disk(solver="step = 1e-3\nmax_steps = 50"), "--output", "r.h5", "--no-error", code=1)
        self.refused("resume", "r.h5", "--unset", "model.mass", says="resume cannot set")
        self.tandem("resume", "r.h5", "--unset", "solver.max_steps", "--no-error")
        self.assertIn("--unset KEY", self.tandem("help", "run").stdout)


class Advice(Case):
    """Messages give advice that fits the cause and what the user has."""

    def run_fails(self, scene, *arguments, code=1):
        return self.tandem("run", scene, *arguments, "--output", "a.h5", "--force", "--quiet", code=code).stderr

    def test_a_mechanism_without_gravity_says_so(self):
        scene = self.scene(PENDULUM)
        self.assertNotIn("no gravity", self.tandem("run", scene, "--output", "a.h5").stdout)
        self.assertIn("no gravity", self.tandem("run", scene, "--unset", "gravity", "--output", "b.h5").stdout)
        self.assertNotIn("no gravity", self.tandem("run", "rolling_disk", *SHORT, "--output", "c.h5").stdout)

    def test_a_missing_direction_is_named(self):
        scene = self.scene('[scene]\nmodel = "mechanism"\n[body.a]\nmass = 1\ninertia = [1, 1, 1]\nposition = [0, 0, 0]\n'
                           '[joint.u]\ntype = "universal"\nbodies = ["ground", "a"]\nat = [0, 0, 0]\naxis = [0, 1, 0]\n[time]\nend = 1\n')
        done = self.refused("show", scene, says=["across is missing"])
        self.assertNotIn("cosine", done.stderr)
        self.refused("show", scene, "--set", "joint.u.across=[0, 0.6, 0.8]", says=["their cosine is 0.6"])

    def flat_four_bars(self, number):
        """Flat four-bars of hinges in space, side by side."""
        bodies = "".join(f"[body.{name}{y}]\nmass = 1\ninertia = [0.1, 0.1, 0.1]\nposition = [{x}, {y}, 0]\n"
                         for y in range(number) for name, x in (("a", 0.5), ("c", 2), ("b", 2.5)))
        joints = "".join(f'[joint.{name}{y}]\ntype = "revolute"\nbodies = ["{one}", "{two}{y}"]\nat = [{x}, {y}, 0]\n'
                         "axis = [0, 1, 0]\n" for y in range(number)
                         for name, one, two, x in (("p", "ground", "a", 0), ("q", f"a{y}", "c", 1), ("r", f"c{y}", "b", 3),
                                                   ("s", "ground", "b", 2)))
        return self.scene(f'[scene]\nmodel = "mechanism"\n{bodies}{joints}[time]\nend = 1\n')

    def test_singular_starts_are_refused_on_sparse_charts(self):
        """By the user's choice, and for many bodies."""
        for number, settings in ((1, ("solver.chart_kind=sparse",)), (2, ()), (20, ())):
            with self.subTest(number):
                says = self.run_fails(self.flat_four_bars(number), *(x for value in settings for x in ("--set", value)), code=2)
                self.assertIn("singular configuration", says)
                self.assertRegex(says, r'constraint "[pqrs][0-9]+ [^"]*" with "[pqrs][0-9]+ ')

    def test_contradictory_motions_are_named_on_sparse_charts(self):
        """Two sliders along one line, whose motions differ at one level."""
        for level, motion in (("position", "0.1 + sin(t)"), ("velocity", "2*sin(t)"), ("acceleration", "t + t^2")):
            with self.subTest(level):
                joints = "".join(f'[joint.{name}]\ntype = "prismatic"\nbodies = ["ground", "a"]\nat = [0, 0, 0]\naxis = [1, 0, 0]\n'
                                 f'motion = "{value}"\n' for name, value in (("p", "sin(t)"), ("q", motion)))
                scene = self.scene('[scene]\nmodel = "mechanism"\n[body.a]\nmass = 1\ninertia = [1, 1, 1]\nposition = [0, 0, 0]\n'
                                   f'velocity = [1, 0, 0]\n{joints}[time]\nend = 1\n')
                for kind in ("sparse", "automatic"):
                    says = self.run_fails(scene, "--set", f"solver.chart_kind={kind}", code=2)
                    self.assertRegex(says, f'constraint "[pq] [^"]*" depends on .* and contradicts it in the {level} at the start')

    def test_rows_of_a_singular_start_are_named(self):
        """A flat four-bar of hinges in space, whose rows are redundant besides."""
        says = self.run_fails(self.flat_four_bars(1), code=2)
        self.assertIn("singular configuration", says)
        self.assertRegex(says, r'constraint "[pqrs]0 [^"]*" with "[pqrs]0 ')
        self.assertIn("start beside this configuration, or remove one of these rows", says)

    def test_a_step_that_is_too_large(self):
        """Not to renew the chart more often where each step renews it, nor to remove a row where none is named."""
        for chart in ("every_step", "paper"):
            with self.subTest(chart):
                says = self.run_fails("rolling_disk", "--set", "solver.step=0.5", "--set", f"solver.chart={chart}")
                self.assertIn("take a smaller step", says)
                self.assertIn("radau5", says)
                self.assertEqual("renew the chart more often" in says, chart == "paper")
                self.assertNotIn("remove", says)

    def test_a_mechanism_has_no_procedures(self):
        """A crank that is driven further than its coupler is long jams, whatever the step."""
        bodies = "".join(f"[body.{name}]\nmass = 1\ninertia = 0.1\nposition = {place}\n"
                         for name, place in (("crank", [0.5, 0]), ("rod", [1, 0.25]), ("rocker", [1.25, 0.5])))
        joints = "".join(f'[joint.{name}]\ntype = "revolute"\nbodies = ["{one}", "{two}"]\nat = {place}\n{more}' for name, one, two, place, more in (
            ("o", "ground", "crank", [0, 0], 'motion = "3*t^2"\n'), ("a", "crank", "rod", [1, 0], ""),
            ("b", "rod", "rocker", [1, 0.5], ""), ("c", "rocker", "ground", [1.5, 0.5], "")))
        scene = self.scene(f'[scene]\nmodel = "mechanism"\nplanar = true\n{bodies}{joints}[time]\nend = 3\n')
        for words in ([], ["--set", "solver.stepper=rk4", "--set", "solver.step=0.01"], ["--set", "solver.stepper=radau5"]):
            says = self.run_fails(scene, *words)
            with self.subTest(words):
                for wrong in ("verify_model", "procedure", "q0", "qd0", "derivatives of the model"):
                    self.assertNotIn(wrong, says)

    def test_a_stiff_run_that_meets_a_limit(self):
        settings = ["--set", "model.stiffness=1.5e7", "--set", "model.damping=1.5e6", "--set", "solver.stepper=dopri5",
                    "--set", "solver.rtol=1e-5", "--set", "time.end=1", "--set", "solver.max_steps=2000"]
        says = self.run_fails("motorcycle", *settings)
        self.assertIn("choose an implicit stepper (radau5), since the model is stiff", says)
        self.assertIn("raise max_steps", says)

    def test_an_inconsistent_start_of_a_mechanism(self):
        says = self.run_fails(self.scene(PENDULUM), "--set", "body.rod.velocity=[1.0, 1.0]", code=2)
        self.assertIn("assemble the start", says)
        self.assertNotIn("q0", says)

    def test_no_shipped_scene_warns_at_its_own_settings(self):
        for path in sorted((ROOT / "scenes").glob("*.toml")):
            with self.subTest(path.stem):
                done = self.tandem("run", path.stem, "--quiet", "--output", "a.h5", "--force", timeout=600)
                self.assertNotIn("WARNING", done.stderr)


class Crash(Case):
    def test_a_crash_in_the_library_is_reported_as_damage(self):
        """A library that crashes while it reads: a file is damaged, and the exit code says so."""
        if "hdf5" not in run("version", cwd=self.folder, env={"LD_TRACE_LOADED_OBJECTS": "1"}).stdout:
            self.skipTest("the program holds HDF5, so that nothing takes the place of its functions")
        self.tandem("run", "rolling_disk", *SHORT, "--output", "run.h5", "--no-error")
        source = self.folder / "crash.c"
        source.write_text("#include <stdlib.h>\nint H5Dread(void) { abort(); }\n")
        library = self.folder / "crash.so"
        if subprocess.run(["cc", "-shared", "-fPIC", "-w", "-o", library, source], check=False).returncode != 0:
            self.skipTest("no C compiler")
        done = run("verify", "run.h5", cwd=self.folder, env={"LD_PRELOAD": str(library)})
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn("run.h5 is damaged: HDF5 crashes when it reads the file", done.stderr)
        self.assertEqual(done.stdout, "")


if __name__ == "__main__":
    unittest.main(verbosity=2)
