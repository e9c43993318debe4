# SPDX-License-Identifier: MIT
"""Accelerations of an imported robot at random states, beside those of MuJoCo (MJCF) or Pinocchio (URDF).

Contacts, limits and equalities are off on both sides, and what an import has left out is off in MuJoCo. Friction is the regularised law of the
scene. Accelerations are those of the centres of mass of bodies and the angular ones.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from . import mjcf, urdf
from .markup import InputError, format_of
from .program import run_program
from .robots import CREEP

#: Accelerations below this are compared absolutely (m/s^2, rad/s^2).
LEAST = 1.0
#: Range of random coordinates and rates.
WIDE = 0.5


def verify(path, states: int = 20, seed: int = 1) -> dict:
    """The largest differences at random states: a dictionary with a row for each body, (name, acceleration, angular acceleration), each
    relative to the largest value of any body in that state."""
    random = np.random.default_rng(seed)
    found, expected, names = (of_mjcf if format_of(path) == "mjcf" else of_urdf)(path, states, random)
    scale = np.stack([np.maximum(np.abs(expected[:, :, part]).max(axis=(1, 2)), LEAST) for part in (slice(0, 3), slice(3, 6))], axis=1)
    differences = np.stack([np.abs(found - expected)[:, :, part].max(axis=2) for part in (slice(0, 3), slice(3, 6))], axis=2)/scale[:, None, :]
    rows = [(name, *map(float, differences[:, k].max(axis=0))) for k, name in enumerate(names)]
    return {"bodies": rows, "largest": float(differences.max()), "states": states}


def table(found: dict) -> str:
    """The result of `verify` as text."""
    width = max(4, *(len(name) for name, *_ in found["bodies"]))
    lines = [f"{'body':{width}}  acceleration  angular"]
    lines += [f"{name:{width}}  {one:12.1e}  {other:7.1e}" for name, one, other in found["bodies"]]
    return "\n".join([*lines, f"largest relative difference at {found['states']} random states: {found['largest']:.1e}"])


def measured(text: str, names) -> np.ndarray:
    """Accelerations of bodies at the start of a scene."""
    import h5py

    with tempfile.TemporaryDirectory(prefix="tandem-") as folder:
        scene, target = Path(folder) / "model.toml", Path(folder) / "model.h5"
        scene.write_text(text, encoding="utf-8")
        run_program("run", scene, "--set", "time.end=1e-9", "--set", "solver.stepper=rk4", "--unset", "solver.rtol", "--output", target, "--force",
                    "--quiet", "--no-error")
        with h5py.File(target) as file:
            columns = [str(name.decode() if isinstance(name, bytes) else name).strip() for name in file["trajectory/q"].attrs["names"]]
            q, rates = file["trajectory/q"][0], file["trajectory/qdd"][0]
            found = []
            for name in names:
                place, k = (columns.index(f"{name}.{what}") for what in ("x", "e0"))
                e0, e1, e2, e3 = q[k:k + 4]
                e = np.array([[-e1, e0, -e3, e2], [-e2, e3, e0, -e1], [-e3, -e2, e1, e0]])
                found.append(np.concatenate([rates[place:place + 3], 2*e @ rates[k:k + 4]]))
    return np.array(found)


def of_mjcf(path, states, random):
    model = mjcf.compile_model(path)
    q, v = zip(*(random_state(model, random) for _ in range(states)))
    imports = [mjcf.Importer(model, "model", "", "stops", one, other, looks=False, equalities=False, stops=False) for one, other in zip(q, v)]
    control = np.zeros(1 + max([-1, *map(int, model.actuator_ctrladr)]))
    found = []
    for made in imports:
        if made is imports[0]:
            for i in made.controls:
                control[i] = random.uniform(-1, 1)
        for i, name in made.controls.items():
            made.scene.parameters[name] = control[i]
        bodies = [body for body in made.bodies if body.links != ["between"]]
        found.append(measured(made.toml(), [made.body_name[id(body)] for body in bodies]))
    made = imports[0]
    bodies = [body for body in made.bodies if body.links != ["between"]]
    index = {id(body): j for j, body in enumerate(bodies)}
    group = np.array([index.get(id(body), -1) for body, _ in made.places])
    given = {"q": np.array(q), "v": np.array(v), "ctrl": control, "group": group, "applied": made.friction_at(np.array(v)),
             "first": np.array([int(np.flatnonzero(group == j)[0]) for j in range(len(bodies))]), **made.kept()}
    with tempfile.TemporaryDirectory(prefix="tandem-") as folder:
        source, target = Path(folder) / "given.npz", Path(folder) / "found.npz"
        np.savez(source, **given)
        mjcf.run_mujoco("accelerate", Path(path).resolve(), source, target)
        with np.load(target) as file:
            expected = file["accelerations"]
    return np.array(found), expected, [made.body_name[id(body)] for body in bodies]


def random_state(model, random):
    q, v = model.qpos0.copy(), random.uniform(-1, 1, len(model.dof_damping))
    for k, kind in enumerate(model.jnt_type):
        at = model.jnt_qposadr[k]
        size = {mjcf.FREE: 7, mjcf.BALL: 4}.get(int(kind), 1)
        q[at:at + size] += random.uniform(-WIDE, WIDE, size)
        if size > 1:
            q[at + size - 4:at + size] /= np.linalg.norm(q[at + size - 4:at + size])
    return q, v


def of_urdf(path, states, random):
    try:
        import pinocchio
    except ImportError:
        raise InputError("accelerations of URDF are compared with Pinocchio, which this Python does not have: python -m pip install pin") from None
    robot = urdf.read(path)
    model = pinocchio.buildModelFromUrdf(str(path))
    data = model.createData()
    found, expected, labels = [], [], None
    for joint in robot.joints.values():
        joint.mimic = None
    names = [name for name, joint in robot.joints.items() if joint.type in urdf.SCALAR]
    if any(joint.type in ("planar", "floating") for joint in robot.joints.values()):
        raise InputError(f"{path} has planar or floating joints, whose random states are not supported")
    for _ in range(states):
        at, rates, q, v, force = {}, {}, pinocchio.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        for name in names:
            joint = model.joints[model.getJointId(name)]
            at[name], rates[name] = random.uniform(-1, 1, 2)
            q[joint.idx_q:joint.idx_q + joint.nq] = [at[name]] if joint.nq == 1 else [np.cos(at[name]), np.sin(at[name])]
            v[joint.idx_v] = rates[name]
            own = robot.joints[name]
            force[joint.idx_v] = -own.damping*rates[name] - (own.friction*regularised(rates[name]) if own.friction > 0 else 0)
        text = urdf.to_toml(robot, False, at, rates, looks=False, limits="none")
        bodies, body_of, _, _ = urdf.assemble(robot, False, at, rates)
        labels = [urdf.Names().take(body.name) for body in bodies]
        found.append(measured(text, labels))
        a = pinocchio.aba(model, data, q, v, force)
        pinocchio.forwardKinematics(model, data, q, v, a)
        row = []
        for body in bodies:
            frame = model.getFrameId(body.links[0], pinocchio.FrameType.BODY)
            here = pinocchio.updateFramePlacement(model, data, frame)
            classical = pinocchio.getFrameClassicalAcceleration(model, data, frame, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            spin = pinocchio.getFrameVelocity(model, data, frame, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED).angular
            away = here.rotation @ body.centre
            row.append(np.concatenate([classical.linear + np.cross(classical.angular, away) + np.cross(spin, np.cross(spin, away)),
                                       classical.angular]))
        expected.append(row)
    return np.array(found), np.array(expected), labels


def regularised(rate):
    """The friction law of a scene for a normal force and a coefficient of one."""
    return np.tanh(4*np.asarray(rate)/CREEP)
