# SPDX-License-Identifier: MIT
"""The text of a scene for a model that `mjcf` has read: which joint several joints of a body make, what closes loops, what drives."""

from __future__ import annotations

import numpy as np

try:
    from .markup import InputError, numbers
    from .urdf import Names, body_lines, printable, quoted, text_of
except ImportError:  # as a script
    from markup import InputError, numbers
    from urdf import Names, body_lines, printable, quoted, text_of

#: Cosines below this are right angles.
RIGHT = 1e-9


def joined(name, joints, body, parent, rest):
    """The joint that replaces the joints of a body: its type and its keys, None for none. `rest` is the body's frame in its parent's
    with the joints at their references."""
    slides = [joint for joint in joints if joint.type == "slide"]
    turns = [joint for joint in joints if joint.type in ("hinge", "ball")]
    free = 6 if any(joint.type == "free" for joint in joints) else 0
    ways, angles = len(slides), sum(3 if joint.type == "ball" else 1 for joint in turns)
    named = f"body {name} has the joints {', '.join(joint.name for joint in joints)}, which make no joint here"
    if free or ways == 3 and angles == 3:
        return None
    if any(np.linalg.norm(joint.pos - turns[0].pos) > 1e-12 for joint in turns):
        raise InputError(f"{named}: their points differ; insert bodies with mass between them")
    if joints != slides + turns:
        raise InputError(f"{named}: slides must come first")
    first = parent.pose.a @ rest.a
    anchor = body.pose.r + body.pose.a @ (turns[0].pos if turns else np.zeros(3))
    axes = [first @ joint.axis for joint in slides]
    if ways == 0 and angles == 3:
        if len(turns) == 3 and abs(np.linalg.det([joint.axis for joint in turns])) < RIGHT:
            raise InputError(f"{named}: their axes are coplanar")
        return "spherical", {"at": anchor}
    if ways == 0 and angles == 2:
        if abs(turns[0].axis @ turns[1].axis) > RIGHT:
            raise InputError(f"{named}: their axes are not perpendicular")
        return "universal", {"at": anchor, "axis": first @ turns[0].axis, "across": body.pose.a @ turns[1].axis}
    if angles > 1:
        raise InputError(f"{named}: at most one hinge may follow slides")
    if angles:
        axes_of_turns = [body.pose.a @ turns[0].axis]
    elif ways == 1:
        return "prismatic", {"at": anchor, "axis": axes[0]}
    else:
        axes_of_turns = []
    if ways == 0:
        return "revolute", {"at": anchor, "axis": axes_of_turns[0]}
    return combined(axes, axes_of_turns, anchor, named)


def combined(ways, turns, anchor, named):
    """A joint of slides and at most one hinge, whose axes are some of a frame's."""
    frame = []
    for axis in (*turns, *ways):
        if not any(abs(abs(axis @ other) - 1) < RIGHT for other in frame):
            if any(abs(axis @ other) > RIGHT for other in frame):
                raise InputError(f"{named}: their axes are not perpendicular")
            frame.append(axis)
    z = frame[0]
    x = frame[1] if len(frame) > 1 else np.cross(z, np.eye(3)[np.argmin(abs(z))])
    x = x/np.linalg.norm(x)
    axes = (x, np.cross(z, x), z)
    hold = [int(not any(abs(axis @ given) > 0.5 for given in among)) for among in (ways, turns) for axis in axes]
    if hold == [0, 0, 1, 1, 1, 0]:
        return "planar", {"at": anchor, "axis": z}
    if hold == [1, 1, 0, 1, 1, 0]:
        return "cylindrical", {"at": anchor, "axis": z}
    return "primitive", {"at": anchor, "axis": z, "across": x, "hold": hold}


class Writer:
    """Writes the elements of a scene one after the other."""

    def __init__(self, model):
        self.model, self.names, self.lines = model, Names(), []
        self.body = {id(body): self.names.take(body.name) for body in model.bodies}
        #: Joints with one coordinate: their element, their MJCF joint.
        self.scalar, self.parameters, self.events = {}, [], []

    def name_of(self, body):
        return self.body.get(id(body), "ground")

    def add(self, table, name, keys):
        self.lines += [f"[{table}.{name}]", *(f"{key} = {value}" for key, value in keys.items()), ""]

    def joints(self):
        for body in self.model.bodies:
            joints, parent, rest = self.model.joints[body.name]
            made = joined(body.name, joints, body, parent, rest)
            alone = made is not None and len(joints) == 1 and joints[0].type in ("hinge", "slide")
            if made is not None:
                kind, keys = made
                name = self.names.take(joints[0].name, "" if joints[0].name not in self.model.places else "_j")
                self.add("joint", name, {"type": quoted(kind), "bodies": f"[{quoted(self.name_of(parent))}, {quoted(self.name_of(body))}]",
                                         **{key: text_of(value) for key, value in keys.items()}})
                if alone:
                    self.scalar[joints[0].name] = (name, joints[0])
            for joint in joints:
                if not alone and (joint.stiffness or joint.damping or joint.range):
                    self.model.note(f"stiffness, damping and range of {joint.name} are ignored: it is not a separate joint here")

    def forces(self):
        for name, joint in self.scalar.values():
            drawn = self.model.at[joint.name]
            if joint.stiffness or joint.damping:
                keys = {"type": '"torsion"', "joint": quoted(name)}
                if joint.stiffness:
                    keys |= {"stiffness": text_of(joint.stiffness), "angle": text_of(joint.springref - drawn)}
                if joint.damping:
                    keys["damping"] = text_of(joint.damping)
                self.add("force", self.names.take(joint.name, "_spring"), keys)
        for given in self.model.motors:
            joint = given["joint"]
            label = given.get("name", joint)
            if joint not in self.scalar:
                self.model.note(f"motor {label} is ignored: {joint} is not a separate joint here")
                continue
            gear = float(numbers(given.get("gear"), (1, 6), (1,), f"motor {label}, gear")[0])
            parameter = self.names.take("".join(x if x.isascii() and x.isalnum() else "_" for x in f"ctrl_{label}"))
            self.parameters.append(parameter)
            self.add("force", self.names.take(label, "_motor"), {"type": '"torsion"', "joint": quoted(self.scalar[joint][0]),
                                                                  "torque": quoted(f"{text_of(gear)}*{parameter}")})

    def equalities(self):
        for k, (kind, given) in enumerate(self.model.equalities):
            label = given.get("name") or f"{kind}{k + 1}"
            if kind == "joint":
                self.coupling(label, given)
            elif kind in ("connect", "weld"):
                self.loop(kind, label, given)
            else:
                self.model.note(f"equality {label} is ignored: only connect, weld and joint are supported")

    def coupling(self, label, given):
        ends = [given[key] for key in ("joint1", "joint2") if key in given]
        missing = [end for end in ends if end not in self.scalar]
        factors = [0.0, 1.0, 0.0, 0.0, 0.0]
        given_factors = numbers(given.get("polycoef"), (1, 5), (), f"equality {label}, polycoef")
        factors[:len(given_factors)] = map(float, given_factors)
        if missing or any(factors[2:]):
            self.model.note(f"equality {label} is ignored: "
                            + (f"{missing[0]} is no joint of its own here" if missing else "it is not linear"))
            return
        joints = [self.scalar[end] for end in ends]
        ways = [self.model.at[end] - joint.ref for end, (_, joint) in zip(ends, joints)]
        weights = [1.0] if len(ends) == 1 or factors[1] == 0 else [1.0, -factors[1]]
        if abs(sum(weight*way for weight, way in zip(weights, ways)) - factors[0]) > 1e-12:
            raise InputError(f"equality {label} is violated in the reference configuration of {' and '.join(ends)}; change it by --at")
        self.add("constraint", self.names.take(label), {
            "type": '"coupling"', "joints": f"[{', '.join(quoted(name) for name, _ in joints[:len(weights)])}]", "factors": text_of(weights)})

    def loop(self, kind, label, given):
        """A joint between points of two bodies, or sites; an anchor is given in the first body, with all joints at their references."""
        if "site1" in given:
            ends = [self.model.sites.get(given.get(key, "")) for key in ("site1", "site2")]
            if None in ends:
                raise InputError(f"equality {label} names an unknown site; correct the name")
        else:
            ends = [self.model.places.get(given.get(key, default)) for key, default in (("body1", ""), ("body2", "world"))]
            if None in ends:
                raise InputError(f"equality {label} names an unknown body; correct the name")
            # A weld is at the second body, a connection at its anchor in the first.
            here, there = (rest_of(self.model, body) @ pose for body, pose in ends)
            carrier = there if kind == "weld" else here
            place = carrier.a @ numbers(given.get("anchor"), 3, (0, 0, 0), f"equality {label}, anchor") + carrier.r
            ends = [(body, type(pose)(pose.r + pose.a @ (frame.a.T @ (place - frame.r)), pose.a))
                    for (body, pose), frame in zip(ends, (here, there))]
        if kind == "weld" and any(numbers(given.get("relpose"), 7, (0,)*7, f"equality {label}, relpose")[3:]):
            self.model.note(f"relpose of {label} is ignored: its bodies are welded in the reference configuration")
        if ends[0][0] is ends[1][0]:
            self.model.note(f"equality {label} is ignored: both sides belong to one body")
            return
        texts = [quoted(f"{self.name_of(body)}:{text_of(pose.r - body.centre*(body.name != 'ground'))}") for body, pose in ends]
        self.add("joint", self.names.take(label), {"type": quoted("spherical" if kind == "connect" else "fixed"),
                                                    "bodies": f"[{', '.join(texts)}]"})

    def limits(self):
        watched = [(name, joint) for name, joint in self.scalar.values() if joint.range]
        taken, lines = Names(), []
        for name, joint in watched:
            what = "displacement" if joint.type == "slide" else "angle"
            for end, value, direction in zip(("lower", "upper"), joint.range, ("falling", "rising")):
                lines += ["[[event]]", f'name = "{taken.take(name, "_" + end)}"', f'watch = "/joints/{name}/{what}"',
                          f"value = {text_of(value - self.model.at[joint.name])}", f'direction = "{direction}"', ""]
        return [name for name, _ in watched], lines


def rest_of(model, body):
    """The frame of a body in the world where all joints are at their references."""
    chain = []
    while body.name != "ground":
        _, body, rest = model.joints[body.name]
        chain.append(rest)
    pose = body.pose
    for rest in reversed(chain):
        pose = pose @ rest
    return pose


def to_toml(model, source="", looks=True) -> str:
    """The text of a scene; notes of the model become comments."""
    if not model.bodies:
        raise InputError("nothing moves: no body has a joint")
    for body in model.bodies:
        if not body.mass > 0:
            raise InputError(f"body {body.name} moves but has no mass; give it an <inertial> or geoms")
    writer = Writer(model)
    for body in model.bodies:
        writer.lines += body_lines(body, writer.body[id(body)], looks)
    writer.joints()
    writer.forces()
    before = len(writer.lines)
    writer.equalities()
    closes = any(line.startswith("[joint.") for line in writer.lines[before:])
    watched, events = writer.limits()
    head = [printable(f"# {model.name}" + (f", from {source}" if source else "") + ", by tandem import mjcf.")]
    head += [printable(f"# {note[:1].upper()}{note[1:]}.") for note in model.notes]
    head += ["", "[scene]", f"description = {quoted(model.name[:80])}", 'model = "mechanism"', ""]
    if writer.parameters:
        head += ["[parameters]  # the controls of motors", *(f"{name} = 0.0" for name in writer.parameters), ""]
    head += ["[gravity]", f"vector = {text_of(model.gravity)}", ""]
    tail = ["[initial]", "assemble = true", ""] if closes else []
    if watched:
        tail += ["[results]", f"joints = [{', '.join(map(quoted, watched))}]", ""]
    tail += ["[time]", "end = 1.0", "", "[solver]", 'stepper = "dopri5"', "rtol = 1e-8", ""]
    return "\n".join([*head, *writer.lines, *tail, *events]).rstrip("\n") + "\n"
