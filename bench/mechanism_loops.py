# SPDX-License-Identifier: MIT
"""Mechanisms with loops in MuJoCo: a tree of bodies whose axes are those of the world at the start, closed by equalities; see
bench/mechanism_others.py."""

import math

import numpy as np
from mechanism_cases import parameters, scene_of, value_of

EQUALITY = '<connect body1="{}" {}anchor="{}" solref="{{solref}}" solimp="0.9999 0.9999 0.001 0.5 2"/>'


def texts(values):
    return " ".join(repr(float(value)) for value in values)


class Body:
    """A body at a place of the world with the joints by which it moves against its parent: (name, type, axis, place in the world)."""

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


def model(gravity, bodies, closings, rest="", ground=""):
    """The text; closings are (body, place in the world, other body or nothing for the ground)."""
    places = {}

    def note(those):
        for body in those:
            places[body.name] = body.place
            note(body.children)

    note(bodies)
    equalities = "".join(EQUALITY.format(body, f'body2="{other}" ' if other else "", texts(np.array(at) - places[body]))
                         for body, at, other in closings)
    return (f'<mujoco><compiler balanceinertia="false"/><option gravity="{texts(gravity)}" integrator="RK4" tolerance="1e-14" '
            f'iterations="100"><flag contact="disable"/></option><worldbody>{ground}{"".join(body.text() for body in bodies)}</worldbody>'
            f"<equality>{equalities}</equality>{rest}</mujoco>")


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
        return Body(name, [*value_of(given["position"], values), 0.0], given["mass"], inertia, [(joint, "hinge", (0, 0, 1), place)], children,
                    sites)

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
    rest = (f'<tendon><spatial stiffness="{coil["stiffness"]}" springlength="{coil["length"]}"><site site="rests"/><site site="moves"/>'
            '</spatial></tendon><actuator><motor joint="o" gear="0.033"/></actuator>')
    return model([0, 0, 0], bodies, [("k2", meeting, other) for other in ("k3", "k4", "k6")], rest, '<site name="rests" pos="0.014 0.072 0"/>')


def bricard():
    """Five bars, the last hinged to the ground at two points of its axis."""
    bars = [("b1", (0.5, 0, 0), 0), ("b2", (1, -0.5, 0), 1), ("b3", (1, -1, 0.5), 2), ("b4", (0.5, -1, 1), 0), ("b5", (0, -0.5, 1), 1)]
    hinges = [((0, 1, 0), (0, 0, 0)), ((0, 0, 1), (1, 0, 0)), ((1, 0, 0), (1, -1, 0)), ((0, 1, 0), (1, -1, 1)), ((0, 0, 1), (0, -1, 1))]
    chain = ()
    for (name, place, along), (axis, at) in reversed(list(zip(bars, hinges, strict=True))):
        inertia = [1.01/12]*3
        inertia[along] = 0.02/12
        chain = (Body(name, place, 1.0, inertia, [(f"to_{name}", "hinge", axis, at)], chain, [("p", (1, -1, 0))] if name == "b2" else ()),)
    return model([0, -9.81, 0], chain, [("b5", (0, 0, 1), None), ("b5", (0.5, 0, 1), None)])


def spatial_slider_crank():
    """The rod hangs on the slider by two hinges and meets the crank."""
    values = parameters(scene_of("spatial_slider_crank"))
    x, length = values["x"], values["rod"]
    pin = np.array([0, 0.1, 0.12 + values["l"]])
    along = (np.array([x, 0, 0.12]) - pin)/length
    # Slender about its length, the same about all axes across.
    inertia = 0.5/12*(2*0.01**2*np.outer(along, along) + (length**2 + 0.01**2)*(np.eye(3) - np.outer(along, along)))
    rod = Body("rod", (pin + [x, 0, 0.12])/2, 0.5, inertia, [("across", "hinge", (0, 1, 0), (x, 0, 0.12)), ("axis", "hinge", (0, 0, 1), (x, 0, 0.12))])
    slider = Body("slider", (x, 0, 0.12), 2.0, [1e-3]*3, [("guide", "slide", (1, 0, 0), (x, 0, 0.12))], [rod], [("s", (x, 0, 0.12))])
    crank = Body("crank", (0, 0.1, 0.12 + values["l"]/2), 0.12, [1e-4, 1e-5, 1e-4], [("shaft", "hinge", (1, 0, 0), (0, 0.1, 0.12))])
    return model([0, 0, -9.81], [crank, slider], [("rod", pin, "crank")])


def spatial_speeds():
    """At 6 rad/s of the crank its pin goes along -y, the rod turns about z alone."""
    values = parameters(scene_of("spatial_slider_crank"))
    turn = 6*values["l"]/values["x"]
    return {"shaft": 6.0, "axis": turn, "guide": 0.1*turn}


def andrews_angles(data):
    values = parameters(scene_of("a03_andrews"))
    return [data.joint(joint).qpos[0] + values.get(zero, 0.0) for joint, zero in
            (("o", "beta"), ("p", ""), ("b", "gamma"), ("g", "phi"), ("a5", "delta"), ("h", "omega"), ("a7", "epsilon"))]


MODELS = {"a03_andrews": andrews, "a04_bricard": bricard, "spatial_slider_crank": spatial_slider_crank}
SPEEDS = {"spatial_slider_crank": spatial_speeds}
MEASURES = {"a03_andrews": andrews_angles, "a04_bricard": lambda data: data.site("p").xpos,
            "spatial_slider_crank": lambda data: data.site("s").xpos[:1]}
