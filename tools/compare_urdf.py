#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Imported robots compared with Pinocchio: masses, frames and the accelerations of a free fall from random states.

Usage: tools/compare_urdf.py [NAME...]      robots of the package example-robot-data whose names begin so; all without

Installs pin, example-robot-data (130 MB) and h5py from PyPI into build/pinocchio. The program is build/tandem, or what TANDEM names. Each
robot has its joints at random positions and rates, the root held and once as a free body. Prints a line for each and the largest
difference, relative to the largest value, of accelerations to 1 m/s^2 or 1 rad/s^2 at least; exit code 1 where one is above 1e-10.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TANDEM = os.environ.get("TANDEM", str(ROOT / "build" / "tandem"))
PLACE = ROOT / "build" / "pinocchio"
BOUND = 1e-10
SEED = 1


def enter():
    """Go on in an environment that has Pinocchio."""
    python = PLACE / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(PLACE)], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "-q", "pin", "example-robot-data", "h5py"], check=True)
    if Path(sys.prefix).resolve() != PLACE.resolve():
        os.execv(str(python), [str(python), __file__, *sys.argv[1:]])


def relative(found, expected, least):
    return float(abs(found - expected).max()/max(abs(expected).max(), least))


def state_of(model, names, random):
    """Random positions and rates of the joints, for tandem and for Pinocchio."""
    import numpy as np
    import pinocchio

    at, rates, q, v = {}, {}, pinocchio.neutral(model), np.zeros(model.nv)
    for name in names:
        joint = model.joints[model.getJointId(name)]
        at[name], rates[name] = random.uniform(-1, 1, 2)
        q[joint.idx_q:joint.idx_q + joint.nq] = [at[name]] if joint.nq == 1 else [np.cos(at[name]), np.sin(at[name])]
        v[joint.idx_v] = rates[name]
    return at, rates, q, v


def compare(path, floating, folder, random):
    """The largest relative differences of masses, frames, accelerations; None where tandem refuses the robot, and why."""
    import h5py
    import numpy as np
    import pinocchio
    import urdf

    robot = urdf.read(path)
    for joint in robot.joints.values():
        # Pinocchio's forward dynamics has neither.
        joint.mimic, joint.damping = None, 0.0
    model = pinocchio.buildModelFromUrdf(str(path), pinocchio.JointModelFreeFlyer()) if floating else \
        pinocchio.buildModelFromUrdf(str(path))
    names = [joint.name for joint in robot.joints.values() if joint.type in ("revolute", "continuous", "prismatic")]
    at, rates, q, v = state_of(model, names, random)
    bodies, body_of, *_ = urdf.assemble(robot, floating, at, rates)
    scene = Path(folder) / "robot.toml"
    scene.write_text(urdf.to_toml(robot, floating, at, rates, looks=False))
    done = subprocess.run([TANDEM, "run", str(scene), "--set", "time.end=1e-9", "--set", 'results.bodies="all"', "--output",
                           str(scene.with_suffix(".h5")), "--force", "--quiet", "--no-error"], capture_output=True, text=True)
    if done.returncode:
        return None, done.stderr.splitlines()[0][:150] if done.stderr else "no reason"
    data = model.createData()
    qdd = pinocchio.aba(model, data, q, v, np.zeros(model.nv))
    pinocchio.forwardKinematics(model, data, q, v, qdd)
    found, expected = [[] for _ in range(4)], [[] for _ in range(4)]
    taken = urdf.Names()
    with h5py.File(scene.with_suffix(".h5")) as file:
        columns = [name.decode().strip() if isinstance(name, bytes) else name.strip() for name in file["trajectory/q"].attrs["names"]]
        state, rate = file["trajectory/q"][0], file["trajectory/qdd"][0]
        for body in bodies:
            name = taken.take(body.name)
            joint = next((j for j in robot.joints.values() if j.child == body.links[0] and j.type != "fixed"), None)
            number = model.getJointId(joint.name) if joint else 1
            inertia, pose, a, w = model.inertias[number], data.oMi[number], data.a[number], data.v[number]
            r, c = pose.rotation, inertia.lever
            classical = a.linear + np.cross(w.angular, w.linear) + np.cross(a.angular, c) + np.cross(w.angular, np.cross(w.angular, c))
            found[0].append([body.mass])
            expected[0].append([inertia.mass])
            found[1].append(np.concatenate([file[f"bodies/{name}/position"][0], body.pose.r, body.pose.a.ravel()]))
            expected[1].append(np.concatenate([pose.act(c), pose.translation, r.ravel()]))
            found[2].append(file[f"bodies/{name}/acceleration"][0])
            expected[2].append(r @ classical)
            k = columns.index(f"{name}.e0")
            e0, e1, e2, e3 = state[k:k + 4]
            e = np.array([[-e1, e0, -e3, e2], [-e2, e3, e0, -e1], [-e3, -e2, e1, e0]])
            found[3].append(2*e @ rate[k:k + 4])
            expected[3].append(r @ a.angular)
    return [relative(np.array(x), np.array(y), least) for x, y, least in zip(found, expected, (1e-300, 1e-300, 1, 1))], ""


def main(wanted):
    import numpy as np

    sys.path.insert(0, str(ROOT / "python" / "src" / "tandem"))
    files = sorted(path for path in PLACE.glob("lib/python*/site-packages/cmeel.prefix/share/example-robot-data/robots/*/*/*.urdf")
                   if not wanted or path.stem.startswith(tuple(wanted)))
    worst, compared = 0.0, 0
    with tempfile.TemporaryDirectory() as folder:
        for path in files:
            for floating in (False, True):
                random = np.random.default_rng(SEED)
                try:
                    differences, reason = compare(path, floating, folder, random)
                except (ValueError, RuntimeError, KeyError) as error:
                    differences, reason = None, str(error).splitlines()[0][:150]
                words = f"{path.stem:28s} {'free' if floating else 'held'}  "
                if differences is None:
                    print(words + "not compared: " + reason)
                    continue
                print(words + "masses {:.1e}  frames {:.1e}  accelerations {:.1e}  of rotation {:.1e}".format(*differences), flush=True)
                worst, compared = max(worst, *differences), compared + 1
    print(f"{compared} robots compared, largest difference {worst:.1e}")
    return 0 if compared and worst <= BOUND else 1


if __name__ == "__main__":
    enter()
    sys.exit(main(sys.argv[1:]))
