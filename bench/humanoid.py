#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The CMU humanoid of dm_control (56 hinges) compared with MuJoCo: 1 s of motion, contacts and limits off.

It falls freely from a posture in which every hinge is bent by up to 0.5 rad at random, and its springs swing the limbs back.

Usage: bench/humanoid.py [--rounds N] [--rows N]

Runs `auto` and `dop853` at several tolerances, and MuJoCo's RK4 and implicitfast at several steps, in turn on one core; prints the median
processor times (ms) and the largest errors of centres of mass at the end (m), compared with RK4 at 1/32000 s, with which dop853 at 1e-12
must agree. Then prints the profile of `auto` at 1e-4. ROWS of output are 0 by default, the ends of steps. Takes the environment of
tools/compare_imports.py, build/robots or what ROBOTS names; the program is build/optimised/tandem, or what TANDEM names.
"""

import argparse
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TANDEM = os.path.abspath(os.environ.get("TANDEM", ROOT / "build" / "optimised" / "tandem"))
PLACE = Path(os.environ.get("ROBOTS", ROOT / "build" / "robots")).resolve()
ENVIRONMENT = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
TOLERANCES = ("1e-3", "1e-4", "1e-5", "1e-6", "1e-7", "1e-8", "1e-9")
STEPS = {"RK4": (250, 300, 400, 500, 1000, 2000, 4000), "implicitfast": (500, 2000, 8000)}
FINEST = 32000
#: Largest angle of a hinge at the start (rad).
BEND = 0.5


def centres_of_tandem(path):
    """Centres of mass at the start and the end by body name, processor time (ms), and numbers of steps and evaluations."""
    import h5py

    with h5py.File(path) as file:
        names = [name.decode() for name in file["trajectory/coordinate"][:]]
        first, last = (dict(zip(names, file["trajectory/q"][k], strict=True)) for k in (0, -1))
        spent = 1e3*float(file["report"].attrs["cpu_seconds"])
        steps = int(file["report"].attrs["steps"]), int(file["report"].attrs["right_hand_sides"])
    bodies = {name.rpartition(".")[0] for name in names if name.endswith(".x")}
    return *({body: [state[f"{body}.{axis}"] for axis in "xyz"] for body in bodies} for state in (first, last)), spent, steps


def run_tandem(scene, stepper, rtol, rows):
    target = scene.with_suffix(".h5")
    words = [word for key in (f"solver.stepper={stepper}", f"solver.rtol={rtol}", f"output.rows={rows}", "time.end=1") for word in ("--set", key)]
    subprocess.run([TANDEM, "run", str(scene), "--no-error", "--force", "--quiet", "--output", str(target), *words], env=ENVIRONMENT, check=True)
    return centres_of_tandem(target)


def run_mujoco(model, posture, integrator, steps):
    import mujoco

    def centres():
        mujoco.mj_forward(model, data)
        return {model.body(b).name: list(data.xipos[b]) for b in range(1, model.nbody)}

    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model.opt.timestep = 1/steps
    data = mujoco.MjData(model)
    for joint, angle in posture.items():
        data.qpos[model.joint(joint).qposadr[0]] = angle
    first = centres()
    began = time.process_time()
    mujoco.mj_step(model, data, nstep=steps)
    spent = 1e3*(time.process_time() - began)
    return first, centres(), spent, (steps, steps*(4 if integrator == "RK4" else 1))


def main():
    import mujoco

    from tandem import imports

    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--rows", type=int, default=0)
    given = parser.parse_args()
    os.sched_setaffinity(0, {sorted(os.sched_getaffinity(0))[-1]})
    path = next(PLACE.glob("lib/python*/site-packages/dm_control/suite/humanoid_CMU.xml"))
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    with tempfile.TemporaryDirectory() as folder:
        # MuJoCo writes its log there.
        os.chdir(folder)
        scene = Path(folder) / "humanoid.toml"
        source = random.Random(1)
        posture = {model.joint(j).name: source.uniform(-BEND, BEND) for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE}
        scene.write_text(imports.convert(path, limits="none", at=posture, looks=False)[0], encoding="utf-8")
        start, exact, *_ = run_mujoco(model, posture, "RK4", FINEST)
        same, tight, *_ = run_tandem(scene, "dop853", "1e-12", 0)
        # Links without joints are parts of their parents, which have another centre of mass.
        common = [body for body in tight if body in start and error_of(same, start, [body]) < 1e-12]
        print(f"{len(common)} bodies; the references differ by {error_of(tight, exact, common):.1e} m")
        cases = [(f"tandem {stepper} {rtol}", lambda s=stepper, r=rtol: run_tandem(scene, s, r, given.rows), tight)
                 for stepper in ("auto", "dop853") for rtol in TOLERANCES]
        cases += [(f"MuJoCo {name} {n}", lambda i=name, n=n: run_mujoco(model, posture, i, n), exact) for name, list_of in STEPS.items() for n in list_of]
        found = [[run() for _, run, _ in cases] for _ in range(given.rounds)]
        print("| run | steps | evaluations | time [ms] | error [m] |\n|---|---|---|---|---|")
        for k, (name, _, reference) in enumerate(cases):
            _, centres, _, (steps, evaluations) = found[0][k]
            print(f"| {name} | {steps} | {evaluations} | {statistics.median(one[k][2] for one in found):.1f} | "
                  f"{error_of(centres, reference, common):.1e} |")
        done = subprocess.run([TANDEM, "run", str(scene), "--no-error", "--force", "--profile", "--output", str(scene.with_suffix(".h5")),
                               "--set", "solver.rtol=1e-4", "--set", "time.end=1", "--set", f"output.rows={given.rows}"], env=ENVIRONMENT,
                              capture_output=True, text=True, check=True)
        print(done.stdout[done.stdout.index("  part of the run"):])


def error_of(centres, reference, bodies):
    return max(abs(a - b) for body in bodies for a, b in zip(centres[body], reference[body], strict=True))


if __name__ == "__main__":
    python = PLACE / "bin" / "python"
    if Path(sys.prefix).resolve() != PLACE:
        os.execve(str(python), [str(python), *sys.argv], ENVIRONMENT)
    sys.path.insert(0, str(ROOT / "python" / "src"))
    sys.exit(main())
