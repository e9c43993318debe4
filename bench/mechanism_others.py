# SPDX-License-Identifier: MIT
"""Some of the mechanisms in MuJoCo and Pinocchio, in their minimal coordinates with loops closed afterwards; see bench/mechanisms.py."""

import math
import time

import mechanism_loops as loops
import numpy as np
from mechanism_cases import CASES

GRAVITY = 9.81
ROLLS = "it rolls by contacts with regularised friction, which creep"
#: Why not.
MUJOCO_CANNOT = {name: ROLLS for name in ("rattleback", "chaplygin_sphere", "turntable", "bicycle", "mechanism_disk")}
NO_ROLLING = "no rolling contact among its constraints"
NOT_HERE = "loops only at the level of accelerations, and not in this comparison"
PINOCCHIO_CANNOT = {**{name: NOT_HERE for name in ("a02_four_bars", "a03_andrews", "a04_bricard", "slider_crank", "spatial_slider_crank")},
                    **{name: NO_ROLLING for name in ("rattleback", "chaplygin_sphere", "turntable", "bicycle", "mechanism_disk")}}

# --- MuJoCo -----------------------------------------------------------------------------------------------------------

HEAD = '<mujoco><option gravity="0 {} 0" integrator="RK4" tolerance="1e-14" iterations="100"><flag contact="disable"/></option>'
ROD = '<inertial pos="0 0.5 0" mass="1" diaginertia="0.08333333333333333 0.08333333333333333 0.08333333333333333"/>'
MODELS = {
    "a01_pendulum": HEAD + '<worldbody><body><joint name="j" axis="0 0 1"/><inertial pos="-1 0 0" mass="1" diaginertia="1e-14 1e-14 1e-14"/>'
    '<site name="m" pos="-1 0 0"/></body></worldbody></mujoco>',
    "a02_four_bars": HEAD + "<worldbody>" + "".join(
        f'<body name="u{k}" pos="{k} 0 0"><joint name="u{k}" axis="0 0 1"/>{ROD}<site name="t{k}" pos="0 1 0"/>'
        + (f'<body name="c{k}" pos="0 1 0"><joint name="c{k}" axis="0 0 1"/>{ROD.replace("0 0.5 0", "0.5 0 0")}</body>' if k < 2 else "")
        + "</body>" for k in range(3)) + "</worldbody><equality>" + "".join(
        f'<connect body1="c{k}" body2="u{k + 1}" anchor="1 0 0" solref="{{solref}}" solimp="0.9999 0.9999 0.001 0.5 2"/>'
        for k in range(2)) + "</equality></mujoco>",
    "slider_crank": HEAD + '<worldbody><body name="crank"><joint name="crank" axis="0 0 1"/>'
    '<inertial pos="0.04 0 0" mass="0.12" diaginertia="1e-4 1e-4 1e-4"/><body name="rod" pos="0.08 0 0"><joint name="rod" axis="0 0 1"/>'
    '<inertial pos="0.15 0 0" mass="0.5" diaginertia="4e-3 4e-3 4e-3"/></body></body><body name="slider" pos="0.38 0 0">'
    '<joint name="slider" type="slide" axis="1 0 0"/><inertial pos="0 0 0" mass="2" diaginertia="1e-3 1e-3 1e-3"/><site name="s"/></body>'
    '</worldbody><equality><connect body1="rod" body2="slider" anchor="0.3 0 0" solref="{solref}" solimp="0.9999 0.9999 0.001 0.5 2"/>'
    "</equality></mujoco>",
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
SPEEDS = {"a02_four_bars": {"u0": -1, "u1": -1, "u2": -1, "c0": 1, "c1": 1}, "a05_governor": {"shaft": 2*math.pi},
          "slider_crank": {"crank": 2*math.pi, "rod": -2*math.pi*(1 + 0.08/0.3)}}
SITES = {"a01_pendulum": ("m", slice(0, 2)), "a02_four_bars": ("t0", slice(0, 2)), "slider_crank": ("s", slice(0, 1)),
         "a05_governor": ("s", slice(2, 3))}


def mujoco_model(name, step):
    import mujoco

    # Equalities are held at the level of accelerations, with what drifts drawn back as fast as a step allows: a time constant of two.
    text = loops.MODELS[name]() if name in loops.MODELS else MODELS[name]
    text = text.replace("{solref}", f"{2*step!r} 1").replace("{}", repr(-GRAVITY))
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = step
    data = mujoco.MjData(model)
    data.ctrl[:] = 1
    for joint, speed in (loops.SPEEDS[name]() if name in loops.SPEEDS else SPEEDS.get(name, {})).items():
        data.qvel[model.joint(joint).dofadr[0]] = speed
    return model, data


def run_mujoco(name, steps, repeats):
    """Error and processor time of so many steps."""
    import mujoco

    case = CASES[name]
    best, error = math.inf, math.nan
    for _ in range(repeats):
        model, data = mujoco_model(name, case.end/steps)
        begun = time.process_time()
        mujoco.mj_step(model, data, nstep=steps)
        best = min(best, time.process_time() - begun)
        mujoco.mj_forward(model, data)
        if name in loops.MEASURES:
            measured = loops.MEASURES[name](data)
        else:
            site, part = SITES[name]
            measured = data.site(site).xpos[part]
        error = float(np.max(np.abs(np.array(measured) - case.reference)))
        if best > 1:
            break
    return error, best


# --- Pinocchio --------------------------------------------------------------------------------------------------------


def pinocchio_pendulum():
    """A right side for (q, v), a start, and what is measured."""
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


def run_pinocchio(name, tolerance, repeats):
    """Error and processor time: Pinocchio's accelerations, SciPy's DOP853."""
    from scipy.integrate import solve_ivp

    case = CASES[name]
    best, error = math.inf, math.nan
    rate, start, measured = PINOCCHIO[name]()
    for _ in range(repeats):
        begun = time.process_time()
        y = solve_ivp(rate, (0, case.end), start, method="DOP853", rtol=tolerance, atol=tolerance).y[:, -1]
        best = min(best, time.process_time() - begun)
        error = float(np.max(np.abs(np.array(measured(y)) - case.reference)))
        if best > 1:
            break
    return error, best
