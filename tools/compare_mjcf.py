#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Imported models compared with MuJoCo: masses, frames and the accelerations of a free fall from random states.

Usage: tools/compare_mjcf.py [FILE...]      files, or all that the packages gymnasium and dm-control ship

Installs mujoco, gymnasium, dm-control and h5py from PyPI into build/mujoco, or takes what MUJOCO names. The program is build/tandem, or
what TANDEM names. Features that the import omits are removed in MuJoCo too: contacts, limits, equalities, armatures, friction, actuators, and the springs
and dampers that no joint of its own has here. Prints a line for each and the largest difference, relative to the largest value, of accelerations
to 1 m/s^2 or 1 rad/s^2 at least; exit code 1 where one is above 1e-10.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TANDEM = os.path.abspath(os.environ.get("TANDEM", ROOT / "build" / "tandem"))
PLACE = Path(os.environ.get("MUJOCO", ROOT / "build" / "mujoco"))
BOUND = 1e-10
SEED = 1


def enter():
    """Go on in an environment that has MuJoCo."""
    python = PLACE / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(PLACE)], check=True)
        for words in (["mujoco", "gymnasium", "h5py"], ["--no-deps", "dm-control"]):
            subprocess.run([str(python), "-m", "pip", "install", "-q", *words], check=True)
    if Path(sys.prefix).resolve() != PLACE.resolve():
        os.execv(str(python), [str(python), __file__, *sys.argv[1:]])


def relative(found, expected, least):
    import numpy as np

    return float(np.abs(found - expected).max()/max(np.abs(expected).max(), least))


def state_of(model, random):
    """A random state, for MuJoCo and by the names of joints."""
    import mujoco
    import numpy as np

    state, q, v = {}, model.qpos0.copy(), random.uniform(-1, 1, model.nv)
    for k in range(model.njnt):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, k)
        kind, at, rate = model.jnt_type[k], model.jnt_qposadr[k], model.jnt_dofadr[k]
        size, rates = {0: (7, 6), 1: (4, 3), 2: (1, 1), 3: (1, 1)}[int(kind)]
        q[at:at + size] += random.uniform(-0.5, 0.5, size)
        if kind in (0, 1):
            q[at + size - 4:at + size] /= np.linalg.norm(q[at + size - 4:at + size])
        state[name] = (q[at:at + size].copy(), v[rate:rate + rates].copy())
    return state, q, v


def compare(path, folder, random):
    """The largest relative differences of masses, frames, accelerations; None where tandem refuses the model, and why."""
    import h5py
    import mjcf
    import mjcf_text
    import mujoco
    import numpy as np

    model = mujoco.MjModel.from_xml_path(str(path))
    for k in range(model.njnt):
        if not mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, k):
            return None, "a joint has no name, by which it would be found here"
    state, q, v = state_of(model, random)
    imported = mjcf.read(path, state=state)
    # Loops are springs there, and motors and couplings are compared by tests.
    imported.equalities, imported.motors = [], []
    text = mjcf_text.to_toml(imported, looks=False)
    model.opt.disableflags |= (mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    model.dof_armature[:] = 0
    model.opt.density = model.opt.viscosity = 0
    if model.ntendon:
        model.tendon_stiffness[:] = model.tendon_damping[:] = 0
        if hasattr(model, "tendon_armature"):
            model.tendon_armature[:] = 0
    taken = {joints[0].name for joints, *_ in imported.joints.values()
             if len(joints) == 1 and joints[0].type in ("hinge", "slide")}
    for k in range(model.njnt):
        if mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, k) not in taken:
            at, count = model.jnt_dofadr[k], (6, 3, 1, 1)[model.jnt_type[k]]
            model.jnt_stiffness[k] = 0
            model.dof_damping[at:at + count] = 0
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = q, v
    mujoco.mj_forward(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    scene = Path(folder) / "model.toml"
    scene.write_text(text)
    done = subprocess.run([TANDEM, "run", str(scene), "--set", "time.end=1e-9", "--set", 'results.bodies="all"', "--output",
                           str(scene.with_suffix(".h5")), "--force", "--quiet", "--no-error"], capture_output=True, text=True)
    if done.returncode:
        return None, done.stderr.splitlines()[0][:150] if done.stderr else "no reason"
    found, expected = [[] for _ in range(4)], [[] for _ in range(4)]
    names = mjcf_text.Names()
    with h5py.File(scene.with_suffix(".h5")) as file:
        columns = [name.decode().strip() if isinstance(name, bytes) else name.strip() for name in file["trajectory/q"].attrs["names"]]
        start, rate = file["trajectory/q"][0], file["trajectory/qdd"][0]
        for body in imported.bodies:
            name = names.take(body.name)
            parts = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, link) for link in body.links]
            # Those without a name are called by their number.
            parts = [part if part >= 0 else int(link.removeprefix("body")) for part, link in zip(parts, body.links)]
            masses = model.body_mass[parts]
            centre = masses @ data.xipos[parts]/masses.sum()
            r, place = data.xmat[parts[0]].reshape(3, 3), data.xpos[parts[0]]
            six, spin = np.zeros(6), np.zeros(6)
            mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_XBODY, parts[0], six, 0)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, parts[0], spin, 0)
            w, away = spin[:3], centre - place
            found[0].append([body.mass])
            expected[0].append([masses.sum()])
            found[1].append(np.concatenate([file[f"bodies/{name}/position"][0], body.pose.r, body.pose.a.ravel()]))
            expected[1].append(np.concatenate([centre, place, r.ravel()]))
            found[2].append(file[f"bodies/{name}/acceleration"][0])
            expected[2].append(six[3:] + imported.gravity + np.cross(six[:3], away) + np.cross(w, np.cross(w, away)))
            k = columns.index(f"{name}.e0")
            e0, e1, e2, e3 = start[k:k + 4]
            e = np.array([[-e1, e0, -e3, e2], [-e2, e3, e0, -e1], [-e3, -e2, e1, e0]])
            found[3].append(2*e @ rate[k:k + 4])
            expected[3].append(six[:3])
    return [relative(np.array(x), np.array(y), least) for x, y, least in zip(found, expected, (1e-300, 1e-300, 1, 1))], ""


def main(wanted):
    import numpy as np

    sys.path.insert(0, str(ROOT / "python" / "src" / "tandem"))
    site = next(PLACE.glob("lib/python*/site-packages"))
    files = [Path(word).resolve() for word in wanted] or sorted((site / "gymnasium/envs/mujoco/assets").glob("*.xml")) \
        + sorted((site / "dm_control/suite").glob("*.xml"))
    worst, compared = 0.0, 0
    with tempfile.TemporaryDirectory() as folder:
        # MuJoCo leaves its warnings in a file where it runs.
        os.chdir(folder)
        for path in files:
            random = np.random.default_rng(SEED)
            try:
                differences, reason = compare(path, folder, random)
            except (ValueError, RuntimeError, KeyError) as error:
                differences, reason = None, str(error).splitlines()[0][:150]
            words = f"{path.parent.name[:8]:8s} {path.stem:28s} "
            if differences is None:
                print(words + reason, flush=True)
                continue
            compared += 1
            worst = max(worst, *differences)
            print(words + " ".join(f"{what} {x:.1e}" for what, x in zip(("mass", "frame", "acceleration", "angular"), differences)), flush=True)
    print(f"{compared} compared, largest difference {worst:.1e}")
    return 0 if compared and worst <= BOUND else 1


if __name__ == "__main__":
    enter()
    sys.exit(main(sys.argv[1:]))
