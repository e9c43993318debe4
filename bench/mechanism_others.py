# SPDX-License-Identifier: MIT
"""Some of the mechanisms in MuJoCo and Pinocchio, in their minimal coordinates with loops closed afterwards; see bench/mechanisms.py."""

import math
import time

import mechanism_loops as loops
import numpy as np
from mechanism_cases import CASES

GRAVITY = 9.81
ROLLS = "it rolls by contacts with regularised friction, which creep"
#: Reasons.
ROLLING = ("rattleback", "chaplygin_sphere", "turntable", "bicycle", "mechanism_disk", "trailers")
MUJOCO_CANNOT = {name: ROLLS for name in ROLLING}
PINOCCHIO_CANNOT = {name: "no rolling contact among its constraints" for name in ROLLING}

# --- MuJoCo -----------------------------------------------------------------------------------------------------------

MODELS = {
    "a01_pendulum": f'<mujoco><option gravity="0 {-GRAVITY} 0" integrator="RK4"><flag contact="disable"/></option><worldbody><body>'
    '<joint name="j" axis="0 0 1"/><inertial pos="-1 0 0" mass="1" diaginertia="1e-14 1e-14 1e-14"/><site name="m" pos="-1 0 0"/></body>'
    "</worldbody></mujoco>",
    "a05_governor": '<mujoco><compiler angle="radian" balanceinertia="false"/><option gravity="0 0 -9.81" integrator="RK4"/>'
    '<worldbody><body name="shaft" pos="0 0 0.5"><joint name="shaft" axis="0 0 1"/>'
    '<inertial pos="0 0 0" mass="0.3" diaginertia="0.0250025 0.0250025 5e-6"/>'
    '<body name="slider"><joint name="s" type="slide" axis="0 0 1"/><inertial pos="0 0 0" mass="3" diaginertia="0.005 0.005 0.005"/>'
    '<site name="a1" pos="0.05 0 0"/><site name="a2" pos="-0.05 0 0"/><site name="s"/></body>' + "".join(
        f'<body name="rod{k}" pos="{0.05*side} 0 0.5" euler="0 {side*math.pi/6!r} 0"><joint name="rod{k}" axis="0 1 0"/>'
        f'<inertial pos="{0.5*side} 0 0" mass="0.3" diaginertia="5e-6 0.0250025 0.0250025"/><site name="b{k}" pos="{0.5*side} 0 0"/>'
        f'<body pos="{side} 0 0"><inertial pos="0 0 0" mass="5" diaginertia="1e-14 1e-14 1e-14"/></body></body>'
        for k, side in ((1, 1), (2, -1))) + "</body></worldbody><tendon>" + "".join(
        f'<spatial stiffness="8e5" damping="4e4" springlength="0.5"><site site="a{k}"/><site site="b{k}"/></spatial>' for k in (1, 2))
    + "</tendon></mujoco>",
}
SPEEDS = {"a05_governor": {"shaft": 2*math.pi}}
MEASURES = {"a01_pendulum": lambda _, site: site("m")[:2], "a05_governor": lambda _, site: site("s")[2:]}


def mujoco_model(name, step):
    import mujoco

    # Equalities hold at the level of accelerations; drift is removed as fast as a step allows: a time constant of two.
    closed = loops.LOOPS[name]() if name in loops.LOOPS else None
    text = closed.mujoco() if closed else MODELS[name]
    model = mujoco.MjModel.from_xml_string(text.replace("{solref}", f"{2*step!r} 1"))
    model.opt.timestep = step
    data = mujoco.MjData(model)
    data.ctrl[:] = 1
    for joint, speed in (closed.speeds if closed else SPEEDS.get(name, {})).items():
        data.qvel[model.joint(joint).dofadr[0]] = speed
    return model, data, closed.measure if closed else MEASURES[name]


def run_mujoco(name, steps, repeats):
    """Error and processor time of a number of steps."""
    import mujoco

    case = CASES[name]
    best, error = math.inf, math.nan
    for _ in range(repeats):
        model, data, measure = mujoco_model(name, case.end/steps)
        begun = time.process_time()
        mujoco.mj_step(model, data, nstep=steps)
        best = min(best, time.process_time() - begun)
        mujoco.mj_forward(model, data)
        measured = measure(lambda joint: data.joint(joint).qpos[0], lambda site: data.site(site).xpos)
        error = float(np.max(np.abs(np.array(measured) - case.reference)))
        if best > 1:
            break
    return error, best


# --- Pinocchio --------------------------------------------------------------------------------------------------------


def pinocchio_pendulum():
    """A right-hand side for (q, v), a start, and the measured quantities."""
    import pinocchio

    model = pinocchio.Model()
    model.gravity.linear = np.array([0, -GRAVITY, 0])
    joint = model.addJoint(0, pinocchio.JointModelRZ(), pinocchio.SE3.Identity(), "j")
    model.appendBodyToJoint(joint, pinocchio.Inertia(1.0, np.array([-1.0, 0, 0]), np.zeros((3, 3))), pinocchio.SE3.Identity())
    data = model.createData()

    def rate(_, y):
        return np.concatenate([y[1:], pinocchio.aba(model, data, y[:1], y[1:], np.zeros(1))])

    return rate, [0.0, 0.0], lambda y: [-math.cos(y[0]), -math.sin(y[0])]


def pinocchio_governor():
    """The tree of the governor; its spring-dampers are external forces, by hand."""
    import pinocchio

    model = pinocchio.Model()
    model.gravity.linear = np.array([0, 0, -GRAVITY])

    def add(parent, joint, place, name, *parts):
        index = model.addJoint(parent, joint, place, name)
        for mass, at, inertia in parts:
            model.appendBodyToJoint(index, pinocchio.Inertia(mass, np.array(at, float), np.diag(inertia)), pinocchio.SE3.Identity())
        return index

    shaft = add(0, pinocchio.JointModelRZ(), pinocchio.SE3(np.eye(3), np.array([0, 0, 0.5])), "shaft",
                (0.3, (0, 0, 0), (0.0250025, 0.0250025, 5e-6)))
    slider = add(shaft, pinocchio.JointModelPZ(), pinocchio.SE3.Identity(), "slider", (3.0, (0, 0, 0), (0.005, 0.005, 0.005)))
    springs = []
    for side in (1, -1):
        c, s = math.cos(side*math.pi/6), math.sin(side*math.pi/6)
        place = pinocchio.SE3(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), np.array([0.05*side, 0, 0.5]))
        rod = add(shaft, pinocchio.JointModelRY(), place, f"rod{side}", (0.3, (0.5*side, 0, 0), (5e-6, 0.0250025, 0.0250025)),
                  (5.0, (side, 0, 0), (0, 0, 0)))
        springs.append(((slider, np.array([0.05*side, 0, 0])), (rod, np.array([0.5*side, 0, 0]))))
    data, none = model.createData(), np.zeros(model.nv)

    def rate(_, y):
        q, v = y[:model.nq], y[model.nq:]
        pinocchio.forwardKinematics(model, data, q, v)
        forces = [pinocchio.Force.Zero() for _ in range(model.njoints)]
        for ends in springs:
            places = [data.oMi[i].act(p) for i, p in ends]
            speeds = [data.oMi[i].rotation @ (data.v[i].linear + np.cross(data.v[i].angular, p)) for i, p in ends]
            way = places[1] - places[0]
            length = math.sqrt(way @ way)
            pull = (8e5*(length - 0.5) + 4e4*((speeds[1] - speeds[0]) @ way)/length)*way/length
            for (i, p), force in zip(ends, (pull, -pull), strict=True):
                own = data.oMi[i].rotation.T @ force
                forces[i] += pinocchio.Force(own, np.cross(p, own))
        return np.concatenate([v, pinocchio.aba(model, data, q, v, none, forces)])

    return rate, [0.0]*model.nq + [2*math.pi] + [0.0]*(model.nv - 1), lambda y: [0.5 + y[model.joints[slider].idx_q]]


PINOCCHIO = {"a01_pendulum": pinocchio_pendulum, "a05_governor": pinocchio_governor}
#: SciPy's methods; the governor is stiff.
METHODS = {"a05_governor": ("LSODA", "Radau")}


def run_pinocchio(name, tolerance, repeats, method="DOP853"):
    """Error and processor time: Pinocchio's accelerations, SciPy's method."""
    from scipy.integrate import solve_ivp

    case = CASES[name]
    best, error = math.inf, math.nan
    rate, start, measured = loops.LOOPS[name]().pinocchio() if name in loops.LOOPS else PINOCCHIO[name]()
    for _ in range(repeats):
        begun = time.process_time()
        y = solve_ivp(rate, (0, case.end), start, method=method, rtol=tolerance, atol=tolerance).y[:, -1]
        best = min(best, time.process_time() - begun)
        error = float(np.max(np.abs(np.array(measured(y)) - case.reference)))
        if best > 1:
            break
    return error, best
