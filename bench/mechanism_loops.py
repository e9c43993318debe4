# SPDX-License-Identifier: MIT
"""Mechanisms with loops as trees of bodies whose axes are those of the world at the start, closed at points: for MuJoCo by equalities,
for Pinocchio by its constraints at the level of accelerations; see bench/mechanism_others.py."""

import math
from dataclasses import dataclass, field

import numpy as np
from mechanism_cases import parameters, scene_of, value_of

EQUALITY = '<connect body1="{}" {}anchor="{}" solref="{{solref}}" solimp="0.9999 0.9999 0.001 0.5 2"/>'


def texts(values):
    return " ".join(repr(float(value)) for value in values)


class Body:
    """A body at a position in the world with its joints to its parent: (name, type, axis, position in the world)."""

    def __init__(self, name, place, mass, inertia, joints, children=(), sites=()):
        self.name, self.place, self.mass, self.children, self.joints, self.sites = name, np.array(place, float), mass, children, joints, sites
        self.inertia = np.diag(inertia) if np.ndim(inertia) == 1 else inertia

    def text(self, origin=(0, 0, 0)):
        j = self.inertia
        joints = "".join(f'<joint name="{name}" type="{kind}" axis="{texts(axis)}" pos="{texts(np.array(at) - self.place)}"/>'
                         for name, kind, axis, at in self.joints)
        sites = "".join(f'<site name="{name}" pos="{texts(np.array(at) - self.place)}"/>' for name, at in self.sites)
        return (f'<body name="{self.name}" pos="{texts(self.place - origin)}">{joints}{sites}<inertial pos="0 0 0" mass="{self.mass}" '
                f'fullinertia="{texts([j[0, 0], j[1, 1], j[2, 2], j[0, 1], j[0, 2], j[1, 2]])}"/>'
                + "".join(child.text(self.place) for child in self.children) + "</body>")


@dataclass
class Loops:
    """Closures are (body, position in the world, other body or nothing for the ground)."""

    gravity: list
    bodies: list
    closings: list
    #: Takes the angle of a joint by its name, and the place of a site by its.
    measure: object
    #: Rates of joints at the start (rad/s, m/s), and their motors (N m).
    speeds: dict = field(default_factory=dict)
    motors: dict = field(default_factory=dict)
    #: From a place of the ground to a site: (place, site, stiffness, length).
    springs: list = field(default_factory=list)

    def all_bodies(self):
        waiting = list(self.bodies)
        while waiting:
            body = waiting.pop()
            yield body
            waiting += body.children

    def mujoco(self):
        """The text of the model, in which the step puts {solref}."""
        places = {body.name: body.place for body in self.all_bodies()}
        equalities = "".join(EQUALITY.format(body, f'body2="{other}" ' if other else "", texts(np.array(at) - places[body]))
                             for body, at, other in self.closings)
        ground = "".join(f'<site name="ground{k}" pos="{texts(place)}"/>' for k, (place, *_) in enumerate(self.springs))
        tendons = "".join(f'<spatial stiffness="{stiffness}" springlength="{length}"><site site="ground{k}"/><site site="{site}"/></spatial>'
                          for k, (_, site, stiffness, length) in enumerate(self.springs))
        motors = "".join(f'<motor joint="{joint}" gear="{torque}"/>' for joint, torque in self.motors.items())
        return (f'<mujoco><compiler balanceinertia="false"/><option gravity="{texts(self.gravity)}" integrator="RK4" tolerance="1e-14" '
                f'iterations="100"><flag contact="disable"/></option><worldbody>{ground}{"".join(body.text() for body in self.bodies)}'
                f"</worldbody><equality>{equalities}</equality><tendon>{tendons}</tendon><actuator>{motors}</actuator></mujoco>")

    def pinocchio(self):
        """A right-hand side for (q, v), a start, and the measured quantities."""
        import pinocchio

        model, carriers, frames = pinocchio.Model(), {}, {}
        model.gravity.linear = np.array(self.gravity, float)
        kinds = {"hinge": pinocchio.JointModelRevoluteUnaligned, "slide": pinocchio.JointModelPrismaticUnaligned}

        def moved(offset):
            return pinocchio.SE3(np.eye(3), np.array(offset, float))

        def add(body, parent, origin):
            for name, kind, axis, at in body.joints:
                parent = model.addJoint(parent, kinds[kind](np.array(axis, float)), moved(np.array(at) - origin), name)
                origin = np.array(at, float)
            model.appendBodyToJoint(parent, pinocchio.Inertia(body.mass, body.place - origin, body.inertia), pinocchio.SE3.Identity())
            carriers[body.name] = parent, origin
            for name, at in body.sites:
                frames[name] = model.addFrame(pinocchio.Frame(name, parent, 0, moved(np.array(at) - origin), pinocchio.FrameType.OP_FRAME))
            for child in body.children:
                add(child, parent, origin)

        for body in self.bodies:
            add(body, 0, np.zeros(3))
        closed = pinocchio.StdVec_RigidConstraintModel()
        for body, at, other in self.closings:
            (one, origin), (two, origin_two) = carriers[body], carriers.get(other, (0, np.zeros(3)))
            closed.append(pinocchio.RigidConstraintModel(pinocchio.ContactType.CONTACT_3D, model, one, moved(np.array(at) - origin), two,
                                                         moved(np.array(at) - origin_two), pinocchio.ReferenceFrame.LOCAL))
        data, held = model.createData(), pinocchio.StdVec_RigidConstraintData()
        held.extend([one.createData() for one in closed])
        pinocchio.initConstraintDynamics(model, data, closed, held)
        # Loops in the plane have redundant rows, which proximal iterations are for.
        settings = pinocchio.ProximalSettings(1e-13, 1e-10, 20)
        index = {name: model.joints[model.getJointId(name)].idx_v for body in self.all_bodies() for name, *_ in body.joints}
        constant, start = np.zeros(model.nv), np.zeros(2*model.nv)
        for joint, torque in self.motors.items():
            constant[index[joint]] = torque
        for joint, speed in self.speeds.items():
            start[model.nv + index[joint]] = speed

        def rate(_, y):
            q, v, effort = y[:model.nv], y[model.nv:], constant
            for place, site, stiffness, length in self.springs:
                way = site_of(q, site) - place
                across = pinocchio.computeFrameJacobian(model, data, q, frames[site], pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:3]
                size = math.sqrt(way @ way)
                effort = effort - across.T @ way*(stiffness*(size - length)/size)
            return np.concatenate([v, pinocchio.constraintDynamics(model, data, q, v, effort, closed, held, settings)])

        def site_of(q, site):
            pinocchio.forwardKinematics(model, data, q)
            return pinocchio.updateFramePlacement(model, data, frames[site]).translation.copy()

        return rate, start, lambda y: self.measure(lambda joint: y[index[joint]], lambda site: site_of(y[:model.nv], site))


HINGE = (0, 0, 1)


def rod(name, joint, at, to, mass=1.0, inertia=1/12, children=(), sites=()):
    """A slender rod in the plane from its hinge to a place."""
    at, to = np.array([*at, 0.0]), np.array([*to, 0.0])
    # Out of the plane nothing turns.
    return Body(name, (at + to)/2, mass, [inertia]*3, [(joint, "hinge", HINGE, at)], children, sites)


def four_bars():
    """Three uprights, two couplers on the first two of them."""
    bodies = [rod(f"u{k}", f"u{k}", (k, 0), (k, 1), children=[rod(f"c{k}", f"c{k}", (k, 1), (k + 1, 1))] if k < 2 else (),
                  sites=[(f"t{k}", (k, 1, 0))]) for k in range(3)]
    return Loops([0, -9.81, 0], bodies, [(f"c{k}", (k + 1, 1, 0), f"u{k + 1}") for k in range(2)], lambda _, site: site("t0")[:2],
                 {"u0": -1, "u1": -1, "u2": -1, "c0": 1, "c1": 1})


def slider_crank():
    slider = Body("slider", (0.38, 0, 0), 2.0, [1e-3]*3, [("slider", "slide", (1, 0, 0), (0.38, 0, 0))], (), [("s", (0.38, 0, 0))])
    crank = rod("crank", "crank", (0, 0), (0.08, 0), 0.12, 1e-4, [rod("rod", "rod", (0.08, 0), (0.38, 0), 0.5, 4e-3)])
    return Loops([0, -9.81, 0], [crank, slider], [("rod", (0.38, 0, 0), "slider")], lambda _, site: site("s")[:1],
                 {"crank": 2*math.pi, "rod": -2*math.pi*(1 + 0.08/0.3)})


def andrews():
    """Seven bodies in the plane: two chains and a bar on the ground, which meet at the end of the second bar."""
    scene = scene_of("a03_andrews")
    values = parameters(scene)

    def at(x, y):
        return [x, y, 0.0]

    def body(name, joint, place, *children, sites=()):
        given = scene["body"][name]
        # Out of the plane nothing turns.
        inertia = [given["inertia"]]*3
        return Body(name, [*value_of(given["position"], values), 0.0], given["mass"], inertia, [(joint, "hinge", HINGE, place)], children, sites)

    def on(name, x, y):
        """A point of a body in the world."""
        angle, place = value_of(scene["body"][name]["angle"], values), value_of(scene["body"][name]["position"], values)
        return at(place[0] + math.cos(angle)*x - math.sin(angle)*y, place[1] + math.sin(angle)*x + math.cos(angle)*y)

    meeting, foot = on("k2", -0.0165, 0), at(-0.06934, -0.00227)
    coil = scene["force"]["coil"]
    bodies = [body("k1", "o", at(0, 0), body("k2", "p", on("k1", 0.00608, 0))),
              body("k3", "b", at(-0.03635, 0.03273), sites=[("moves", on("k3", 0.00957, 0.00074))]),
              body("k5", "a5", foot, body("k4", "g", at(values["gx"], values["gy"]))),
              body("k7", "a7", foot, body("k6", "h", at(values["hx"], values["hy"])))]
    zeros = (("o", "beta"), ("p", ""), ("b", "gamma"), ("g", "phi"), ("a5", "delta"), ("h", "omega"), ("a7", "epsilon"))
    return Loops([0, 0, 0], bodies, [("k2", meeting, other) for other in ("k3", "k4", "k6")],
                 lambda angle, _: [angle(joint) + values.get(zero, 0.0) for joint, zero in zeros], motors={"o": 0.033},
                 springs=[(np.array([0.014, 0.072, 0]), "moves", coil["stiffness"], coil["length"])])


def bricard():
    """Five bars, the last hinged to the ground at two points of its axis."""
    bars = [("b1", (0.5, 0, 0), 0), ("b2", (1, -0.5, 0), 1), ("b3", (1, -1, 0.5), 2), ("b4", (0.5, -1, 1), 0), ("b5", (0, -0.5, 1), 1)]
    hinges = [((0, 1, 0), (0, 0, 0)), ((0, 0, 1), (1, 0, 0)), ((1, 0, 0), (1, -1, 0)), ((0, 1, 0), (1, -1, 1)), ((0, 0, 1), (0, -1, 1))]
    chain = ()
    for (name, place, along), (axis, at) in reversed(list(zip(bars, hinges, strict=True))):
        inertia = [1.01/12]*3
        inertia[along] = 0.02/12
        chain = (Body(name, place, 1.0, inertia, [(f"to_{name}", "hinge", axis, at)], chain, [("p", (1, -1, 0))] if name == "b2" else ()),)
    return Loops([0, -9.81, 0], list(chain), [("b5", (0, 0, 1), None), ("b5", (0.5, 0, 1), None)], lambda _, site: site("p"))


def spatial_slider_crank():
    """The rod hangs on the slider by two hinges and meets the crank; at 6 rad/s of that its pin goes along -y, and the rod turns about z alone."""
    values = parameters(scene_of("spatial_slider_crank"))
    x, length = values["x"], values["rod"]
    pin = np.array([0, 0.1, 0.12 + values["l"]])
    along = (np.array([x, 0, 0.12]) - pin)/length
    # Slender about its length, the same about all axes across.
    inertia = 0.5/12*(2*0.01**2*np.outer(along, along) + (length**2 + 0.01**2)*(np.eye(3) - np.outer(along, along)))
    hung = Body("rod", (pin + [x, 0, 0.12])/2, 0.5, inertia, [("across", "hinge", (0, 1, 0), (x, 0, 0.12)), ("axis", "hinge", (0, 0, 1), (x, 0, 0.12))])
    slider = Body("slider", (x, 0, 0.12), 2.0, [1e-3]*3, [("guide", "slide", (1, 0, 0), (x, 0, 0.12))], [hung], [("s", (x, 0, 0.12))])
    crank = Body("crank", (0, 0.1, 0.12 + values["l"]/2), 0.12, [1e-4, 1e-5, 1e-4], [("shaft", "hinge", (1, 0, 0), (0, 0.1, 0.12))])
    turn = 6*values["l"]/values["x"]
    return Loops([0, 0, -9.81], [crank, slider], [("rod", pin, "crank")], lambda _, site: site("s")[:1],
                 {"shaft": 6.0, "axis": turn, "guide": 0.1*turn})


LOOPS = {"a02_four_bars": four_bars, "a03_andrews": andrews, "a04_bricard": bricard, "slider_crank": slider_crank,
         "spatial_slider_crank": spatial_slider_crank}
