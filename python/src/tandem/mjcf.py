# SPDX-License-Identifier: MIT
"""A model from an MJCF file, the format of MuJoCo, as a mechanism: the text of a scene (see doc/mechanism.md).

    tandem import mjcf model.xml                             model.toml
    tandem import mjcf model.xml --output arm.toml --at elbow=1.2,wrist=-0.3

Bodies without joints become one with what carries them, or the ground. One hinge turns, one slide slides, a ball is spherical, a free joint
is none; several joints of a body become one that leaves the same motions: slides and a hinge of one frame, two hinges at right
angles through a point, three through a point. Masses and inertias that are not given come from geoms, as MuJoCo computes them. The equalities
connect and weld become joints that close loops, joint a coupling; motors forces that a parameter scales; limits events; springs and
dampers of joints forces along their coordinate. What is left out, contacts first of all, is said by comments in the scene.

Format: https://mujoco.readthedocs.io/en/stable/XMLreference.html
"""

from __future__ import annotations

import math
import os
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

try:
    from .markup import Budget, InputError, guarded, keyword, known, number, numbers, parse, say
    from .mjcf_schema import ATTRIBUTES, AUTO, ORIENTATIONS, TRUTH
    from .mjcf_text import to_toml
    from .urdf import Body, Link, Pose, add, parse_coordinates, turned
except ImportError:  # as a script
    from markup import Budget, InputError, guarded, keyword, known, number, numbers, parse, say
    from mjcf_schema import ATTRIBUTES, AUTO, ORIENTATIONS, TRUTH
    from mjcf_text import to_toml
    from urdf import Body, Link, Pose, add, parse_coordinates, turned

#: Files in files, no deeper than this.
DEEPEST = 10
#: Flags, any of which disables a part of the model, and the name of that part.
OFF = ((("spring", "passive"), "springs of joints"), (("damper", "passive"), "dampers of joints"), (("constraint", "equality"), "equalities"),
       (("constraint", "limit"), "limits of joints"), (("actuation",), "actuators"))
#: Elements that would change a model and are not supported.
REFUSED = ("composite", "flexcomp", "replicate", "attach", "flex")
#: Content of a body besides geoms, sites, frames and bodies.
INSIDE = ("joint", "freejoint", "inertial", "camera", "light", "plugin")
#: Sections of a file that are taken, or that do not matter to how it moves.
KNOWN = {"compiler", "option", "size", "statistic", "default", "asset", "worldbody", "equality", "actuator", "contact", "sensor", "keyframe",
         "visual", "custom", "extension"}


@dataclass
class Joint:
    """A joint of a body, in its frame; lengths in m, angles in rad."""

    name: str
    type: str
    pos: np.ndarray
    axis: np.ndarray
    ref: float = 0.0
    springref: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    range: tuple | None = None


@dataclass
class Model:
    """Contents of a file: moving bodies, each with its joints and its parent; body and frame of each name in the file."""

    name: str
    gravity: np.ndarray
    bodies: list = field(default_factory=list)
    #: For each body but the ground: (its joints, its parent, its frame in the parent's with joints at their references).
    joints: dict = field(default_factory=dict)
    places: dict = field(default_factory=dict)
    sites: dict = field(default_factory=dict)
    equalities: list = field(default_factory=list)
    motors: list = field(default_factory=list)
    #: Texts in the order of their occurrence, each once.
    notes: dict = field(default_factory=dict)
    #: Coordinate of each joint with one coordinate in the reference configuration.
    at: dict = field(default_factory=dict)

    def note(self, text: str) -> None:
        self.notes[text] = None


class Includes:
    """Replaces the includes of a file by their content. As in MuJoCo, an included file is looked for beside the main file, then beside the
    file that includes it, and may be included once."""

    def __init__(self, path):
        self.folder, self.budget, self.seen = Path(path).parent, Budget(), set()
        self.root = self.expanded(Path(path), 0)

    def expanded(self, path, depth):
        place = os.path.realpath(path)
        if place in self.seen:
            raise InputError(f"{path} is included twice, or includes are cyclic; MuJoCo permits each file once")
        if depth > DEEPEST:
            raise InputError(f"{path}: includes are nested more than {DEEPEST} deep; merge some files")
        self.seen.add(place)
        root = parse(path, self.budget)
        for parent in list(root.iter()):
            if all(child.tag != "include" for child in parent):
                continue
            content = list(parent)
            parent[:] = []
            for child in content:
                if child.tag == "include":
                    known(child.attrib, ("file", "prefix"), f"{path}, include")
                    if not child.get("file") or child.get("prefix"):
                        raise InputError(f"{path}: an include does not name a file, or has a prefix, which is not supported")
                    first = self.folder / child.get("file")
                    parent.extend(self.expanded(first if first.exists() else path.parent / child.get("file"), depth + 1))
                else:
                    parent.append(child)
        return root


class Reader:
    """Reads a file into a model."""

    def __init__(self, path, at=None, state=None):
        self.root = Includes(path).root
        if self.root.tag != "mujoco":
            raise InputError(f"{path} is not MJCF: its first element is <{self.root.tag}>, not <mujoco>")
        known(self.root.attrib, ATTRIBUTES["mujoco"], "mujoco")
        self.compiler, option = self.merged("compiler"), self.merged("option")
        self.read_compiler()
        #: Flags of the options: enable or disable.
        self.flags = {key: keyword(value, ("enable", "disable"), "", f"flag, {key}") for key, value in self.merged("option/flag").items()}
        self.classes = {"main": {}}
        for element in self.root.findall("default"):
            self.read_defaults(element)
        gravity = numbers(option.get("gravity"), 3, (0, 0, -9.81), "option, gravity")
        self.model = Model(self.root.get("model") or Path(path).stem, 0*gravity if self.disabled("gravity") else gravity)
        if any(number(option.get(key), 0, f"option, {key}", 0) for key in ("density", "viscosity")):
            self.model.note("the surrounding medium (option density, viscosity) is ignored")
        for flags, what in OFF:
            if self.disabled(*flags):
                self.model.note(f"{what} are ignored: the flag {next(flag for flag in flags if self.flags.get(flag) == 'disable')} disables them")
        self.at, self.state, self.used = dict(at or {}), dict(state or {}), set()
        self.named = {element.get("name") for element in self.root.iter("body")}

    def merged(self, path):
        """The attributes of all elements of a kind; later ones count."""
        found = {}
        for element in self.root.findall(path):
            known(element.attrib, ATTRIBUTES[element.tag], element.tag)
            found |= element.attrib
        return found

    def disabled(self, *flags):
        return any(self.flags.get(flag) == "disable" for flag in flags)

    def read_compiler(self):
        given = self.compiler
        self.per_degree = math.pi/180 if keyword(given.get("angle"), ("degree", "radian"), "degree", "compiler, angle") == "degree" else 1.0
        self.groups = numbers(given.get("inertiagrouprange"), 2, (0, 5), "compiler, inertiagrouprange")
        self.sequence = given.get("eulerseq", "xyz")
        if len(self.sequence) != 3 or set(self.sequence.lower()) - set("xyz"):
            raise InputError(f'compiler, eulerseq: "{self.sequence[:20]}" should be three of x, y, z, X, Y, Z')
        if keyword(given.get("coordinate"), ("local", "global"), "local", "compiler, coordinate") != "local":
            raise InputError("compiler, coordinate: global coordinates are of old versions; have a current MuJoCo save the model")
        self.limited_by_range = keyword(given.get("autolimits"), TRUTH, "true", "compiler, autolimits") == "true"
        self.from_geoms = keyword(given.get("inertiafromgeom"), AUTO, "auto", "compiler, inertiafromgeom")
        self.balances = keyword(given.get("balanceinertia"), TRUTH, "false", "compiler, balanceinertia") == "true"
        self.least = [number(given.get(key), 0, f"compiler, {key}", 0) for key in ("boundmass", "boundinertia")]
        self.total_mass = number(given.get("settotalmass"), -1, "compiler, settotalmass")

    def read_defaults(self, element):
        """The classes of a <default>, each of which begins with what its parent has."""
        waiting = [(element, None)]
        while waiting:
            element, parent = waiting.pop()
            known(element.attrib, ATTRIBUTES["default"], "default")
            name = element.get("class") or ("main" if parent is None else "")
            if not name or (name in self.classes and parent is not None):
                raise InputError(f'the default class "{name}" has no unique name; rename it')
            content = {tag: dict(values) for tag, values in self.classes.get(name if parent is None else parent, {}).items()}
            for child in element:
                if child.tag != "default":
                    if child.tag in ATTRIBUTES:
                        known(child.attrib, ATTRIBUTES[child.tag], f"class {name}, {child.tag}")
                    content.setdefault(child.tag, {}).update(child.attrib)
            self.classes[name] = content
            waiting += [(child, name) for child in reversed(element.findall("default"))]

    def attributes(self, element, given_class, kind=None):
        """The attributes of an element, with those of its class; an orientation takes the place of any other one. `kind` is that of its
        defaults, if its tag does not say."""
        kind = kind or element.tag
        tag = f"{kind} {element.tag}" if f"{kind} {element.tag}" in ATTRIBUTES else element.tag
        if tag in ATTRIBUTES:
            known(element.attrib, ATTRIBUTES[tag], f"{element.tag} {element.get('name', '')}".rstrip())
        name = element.get("class") or given_class or "main"
        if name not in self.classes:
            raise InputError(f'there is no default class "{name}"; correct the name')
        defaults = self.classes[name].get(kind, {})
        if any(key in element.attrib for key in ORIENTATIONS):
            defaults = {key: value for key, value in defaults.items() if key not in ORIENTATIONS}
        return {**defaults, **element.attrib}

    def pose(self, given, where) -> Pose:
        r = numbers(given.get("pos"), 3, (0, 0, 0), f"{where}, pos")
        if "quat" in given:
            return Pose(r, rotation_of(unit(numbers(given["quat"], 4, (), f"{where}, quat"), f"{where}, quat")))
        if "axisangle" in given:
            *axis, angle = numbers(given["axisangle"], 4, (), f"{where}, axisangle")
            return Pose(r, turned(unit(axis, f"{where}, axisangle"), angle*self.per_degree))
        if "xyaxes" in given:
            six = numbers(given["xyaxes"], 6, (), f"{where}, xyaxes")
            x = unit(six[:3], f"{where}, xyaxes")
            y = unit(six[3:] - x*(x @ six[3:]), f"{where}, xyaxes")
            return Pose(r, np.transpose([x, y, np.cross(x, y)]))
        if "zaxis" in given:
            return Pose(r, upright(numbers(given["zaxis"], 3, (), f"{where}, zaxis"), where))
        a = np.eye(3)
        for angle, letter in zip(numbers(given.get("euler"), 3, (0, 0, 0), f"{where}, euler"), self.sequence):
            turn = turned(np.eye(3)["xyz".index(letter.lower())], angle*self.per_degree)
            a = a @ turn if letter.islower() else turn @ a
        return Pose(r, a)

    # --- bodies -------------------------------------------------------------------------------------------------------

    def read(self) -> Model:
        ground = Body("ground", ["world"], Pose())
        self.model.places["world"] = (ground, Pose())
        for element in self.root:
            if element.tag not in KNOWN:
                self.model.note(f"<{element.tag}> is ignored")
        for world in self.root.findall("worldbody"):
            self.read_bodies(world, ground)
        self.scale_masses()
        for name in (*self.at, *self.state):
            if name not in self.used:
                raise InputError(f"no joint {name} rotates or slides; correct the name")
        if not self.disabled("constraint", "equality"):
            for section in self.root.findall("equality"):
                self.read_equalities(section)
        if not self.disabled("actuation"):
            for section in self.root.findall("actuator"):
                self.read_actuators(section)
        return self.model

    def read_equalities(self, section):
        for element in section:
            given = self.attributes(element, None, "equality")
            if keyword(given.get("active"), TRUTH, "true", f"equality {given.get('name', element.tag)}, active") == "true":
                self.model.equalities.append((element.tag, given))

    def read_actuators(self, section):
        for element in section:
            given = self.attributes(element, None)
            if element.tag == "motor" and "joint" in given:
                self.model.motors.append(given)
            else:
                self.model.note(f"actuator {given.get('name', element.tag)} is ignored: only motors of joints are supported")

    def read_bodies(self, world, ground):
        """All bodies, each before those that it carries, in the order of the file."""
        known(world.attrib, ATTRIBUTES["worldbody"], "worldbody")
        waiting = [(world, ground, Pose(), world.get("childclass"), "world")]
        while waiting:
            element, body, pose, given_class, name = waiting.pop()
            if element is not world:
                body, pose, given_class, name = self.read_body(element, body, pose, given_class)
            geoms, inner = self.content(element, body, pose, given_class, name)
            if body.name != "ground":
                self.weigh(element, geoms, body, pose, name)
            elif geoms:
                self.model.note("contacts and geoms of the world are ignored")
                for child, of_geom, frame in geoms:
                    self.add_geom(child, of_geom, Body("", [], Pose()), frame, name, False)
            waiting += reversed(inner)

    def content(self, element, body, pose, given_class, name):
        """Geoms inside of an element and of its frames, whose pose is that in `body`, and bodies, each with what carries it."""
        geoms, inner = [], []
        waiting = [(child, pose, given_class, False) for child in reversed(element)]
        while waiting:
            child, pose, given_class, in_frame = waiting.pop()
            if in_frame and child.tag in ("joint", "freejoint", "inertial"):
                raise InputError(f"body {name} has a <{child.tag}> in a <frame>, which is not supported; put it into the body")
            if child.tag in REFUSED:
                raise InputError(f"body {name} has a <{child.tag}>, which is not supported; have MuJoCo save the expanded model")
            if child.tag == "geom":
                geoms.append((child, given_class, pose))
            elif child.tag == "site":
                given = self.attributes(child, given_class)
                site = given.get("name", "")
                if site and site in self.model.sites:
                    raise InputError(f"two sites have the name {site}; rename one")
                self.model.sites[site] = (body, pose @ self.pose(given, f"site {site}"))
            elif child.tag == "frame":
                known(child.attrib, ATTRIBUTES["frame"], f"frame in {name}")
                place, of_frame = pose @ self.pose(child.attrib, f"frame in {name}"), child.get("childclass") or given_class
                waiting += [(one, place, of_frame, True) for one in reversed(child)]
            elif child.tag == "body":
                inner.append((child, body, pose, given_class, ""))
            elif child.tag not in INSIDE:
                raise InputError(f"body {name} has a <{child.tag}>, which MJCF does not permit there; remove it")
        return geoms, inner

    def read_body(self, element, parent, frame, given_class):
        """A body: what it is part of, its pose in that, the class of its content, and its name."""
        known(element.attrib, ATTRIBUTES["body"], f"body {element.get('name', '')}".rstrip())
        name, count = element.get("name"), len(self.model.places)
        while not name or (name in self.named and not element.get("name")):
            name, count = f"body{count}", count + 1
        if name in self.model.places:
            raise InputError(f"two bodies have the name {name}; rename one")
        given_class = element.get("childclass") or given_class
        rest = frame @ self.pose(element.attrib, f"body {name}")
        joints = [self.read_joint(child, given_class, name, k) for k, child in enumerate(
            child for child in element if child.tag in ("joint", "freejoint"))]
        if number(element.get("gravcomp"), 0, f"body {name}, gravcomp"):
            self.model.note(f"gravcomp of body {name} is ignored")
        body, pose = parent, rest
        if joints:
            body, pose = self.move(name, joints, parent, rest), Pose()
            self.model.bodies.append(body)
            self.model.joints[name] = (joints, parent, rest)
        elif body.name != "ground":
            body.links.append(name)
        self.model.places[name] = (body, pose)
        return body, pose, given_class, name

    def read_joint(self, element, given_class, body, k) -> Joint:
        if element.tag == "freejoint":
            known(element.attrib, ATTRIBUTES["freejoint"], f"freejoint of body {body}")
            given, kind = element.attrib, "free"
        else:
            given = self.attributes(element, given_class)
            kind = keyword(given.get("type"), ("ball", "free", "hinge", "slide"), "hinge", f"joint {given.get('name', 'of ' + body)}, type")
        name = given.get("name") or f"{body}_joint{k or ''}"
        where = f"joint {name}"
        if name in self.used:
            raise InputError(f"two joints have the name {name}; rename one")
        self.used.add(name)
        scale = self.per_degree if kind == "hinge" else 1.0
        joint = Joint(name, kind, numbers(given.get("pos"), 3, (0, 0, 0), f"{where}, pos"),
                      unit(numbers(given.get("axis"), 3, (0, 0, 1), f"{where}, axis"), f"{where}, axis"),
                      number(given.get("ref"), 0, f"{where}, ref")*scale, number(given.get("springref"), 0, f"{where}, springref")*scale)
        for key, off in (("stiffness", "spring"), ("damping", "damper")):
            first, *others = numbers(given.get(key), (1, 5), (0,), f"{where}, {key}")
            if self.disabled(off, "passive"):
                continue
            setattr(joint, key, float(first))
            if any(others):
                self.model.note(f"nonlinear {key} of joint {name} is ignored")
        if any(numbers(given.get("springdamper"), 2, (0, 0), f"{where}, springdamper")) and not self.disabled("spring", "damper", "passive"):
            self.model.note(f"springdamper of joint {name} is ignored: give stiffness and damping")
        limited = keyword(given.get("limited"), AUTO, "auto", f"{where}, limited")
        ends = numbers(given.get("range"), 2, (0, 0), f"{where}, range")*scale
        if "range" in given and (limited == "true" or limited == "auto" and self.limited_by_range) and kind != "free":
            if not ends[0] < ends[1] and kind != "ball":
                raise InputError(f'{where}, range: "{given["range"]}" is not ascending')
            if not self.disabled("constraint", "limit"):
                joint.range = tuple(ends)
        if number(given.get("armature"), 0, f"{where}, armature", 0):
            self.model.note("armatures (inertias of rotors) are ignored")
        if any(numbers(given.get("frictionloss"), (1, 3), (0,), f"{where}, frictionloss", 0)):
            self.model.note("friction of joints is ignored")
        if number(given.get("springyield"), 0, f"{where}, springyield"):
            self.model.note(f"springyield of joint {name} is ignored")
        return joint

    def move(self, name, joints, parent, rest) -> Body:
        """The body behind joints: one after the other, as MuJoCo does. Velocities are of the origins of frames."""
        here = parent.pose @ rest
        omega, velocity = parent.omega, parent.velocity + np.cross(parent.omega, here.r - parent.pose.r)
        for joint in joints:
            q, rate = self.state.get(joint.name, (None, None))
            if joint.type == "free":
                if q is not None:
                    here = Pose(np.array(q[:3], float), rotation_of(q[3:]))
                    velocity, omega = np.array(rate[:3], float), here.a @ rate[3:]
                continue
            anchor, axis = here.r + here.a @ joint.pos, here.a @ joint.axis
            if joint.type == "slide":
                x, v = (self.at.get(joint.name, joint.ref), 0.0) if q is None else (q[0], rate[0])
                self.model.at[joint.name] = x
                velocity = velocity + np.cross(omega, axis*(x - joint.ref)) + v*axis
                here = Pose(here.r + axis*(x - joint.ref), here.a)
                continue
            at_anchor = velocity + np.cross(omega, anchor - here.r)
            if joint.type == "ball":
                a = here.a @ (np.eye(3) if q is None else rotation_of(q))
                omega = omega + (0 if rate is None else a @ rate)
            else:
                x, v = (self.at.get(joint.name, joint.ref), 0.0) if q is None else (q[0], rate[0])
                self.model.at[joint.name] = x
                a, omega = here.a @ turned(joint.axis, x - joint.ref), omega + v*axis
            here = Pose(anchor - a @ joint.pos, a)
            velocity = at_anchor + np.cross(omega, here.r - anchor)
        return Body(name, [name], here, velocity=velocity, omega=omega)

    # --- masses -------------------------------------------------------------------------------------------------------

    def weigh(self, element, geoms, body, pose, name):
        """The inertial of a body, or its geoms; looks are of its geoms."""
        inertial = element.find("inertial")
        by_geoms = self.from_geoms == "true" or self.from_geoms == "auto" and inertial is None
        link = Link(name)
        if inertial is not None and not by_geoms:
            known(inertial.attrib, ATTRIBUTES["inertial"], f"body {name}, inertial")
            place = self.pose(inertial.attrib, f"body {name}, inertial")
            link.mass, link.centre = number(inertial.get("mass"), 0, f"body {name}, mass", 0), place.r
            xx, yy, zz, xy, xz, yz = numbers(inertial.get("fullinertia"), 6, (*numbers(
                inertial.get("diaginertia"), 3, (0, 0, 0), f"body {name}, diaginertia", 0), 0, 0, 0), f"body {name}, fullinertia")
            link.inertia = place.a @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ place.a.T
        whole = Body(name, [], Pose())
        add(whole, link, Pose())
        for child, given_class, frame in geoms:
            self.add_geom(child, given_class, whole, inverse(pose) @ frame, name, by_geoms)
        self.bound(whole)
        add(body, Link(name, whole.mass, whole.centre, whole.inertia, whole.looks), pose)
        if geoms:
            self.model.note("contacts are ignored")

    def add_geom(self, element, given_class, body, frame, name, weighs):
        given = self.attributes(element, given_class)
        where = f"geom {given.get('name', 'of ' + name)}"
        kind = "mesh" if "mesh" in given and "type" not in given else given.get("type", "sphere")
        place, size = self.geom_place(given, kind, where)
        if kind in ("plane", "hfield"):
            return
        weighs = weighs and self.groups[0] <= number(given.get("group"), 0, f"{where}, group") <= self.groups[1]
        mass = None if "mass" not in given else number(given["mass"], 0, f"{where}, mass", 0)
        density = number(given.get("density"), 1000, f"{where}, density", 0)
        shell = keyword(given.get("shellinertia"), TRUTH, "false", f"{where}, shellinertia") == "true"
        look = None
        if kind in ("mesh", "sdf"):
            if weighs and mass != 0 and density != 0:
                raise InputError(f"{where} is a mesh that gives body {name} its mass; give the body an <inertial>, or have MuJoCo save the model")
            own, principal = 0.0, np.zeros(3)
        else:
            volume, per_mass, look = solid(kind, size, where)
            own = density*volume if mass is None else mass
            principal = own*np.array(per_mass)
            if weighs and shell:
                raise InputError(f"{where} has shellinertia, which is not supported; give body {name} an <inertial>")
        if not weighs:
            own, principal = 0.0, np.zeros(3)
        add(body, Link(name, own, np.zeros(3), np.diag(principal), [(*look, Pose())] if look else []), frame @ place)

    def geom_place(self, given, kind, where):
        """The frame of a geom, and its half sizes."""
        size = list(numbers(given.get("size"), (1, 3), (), f"{where}, size"))
        if "fromto" not in given or kind in ("sphere", "plane", "mesh"):
            return self.pose(given, where), size
        ends = numbers(given["fromto"], 6, (), f"{where}, fromto").reshape(2, 3)
        half = float(np.linalg.norm(ends[0] - ends[1]))/2
        size = [*size[:1], half] if kind in ("capsule", "cylinder") else [*size[:1], *size[:1], half]
        return Pose(ends.mean(axis=0), upright(ends[0] - ends[1], where)), size

    def bound(self, body):
        """Apply the compiler's bounds on masses and inertias."""
        body.mass = max(body.mass, self.least[0])
        if self.least[1] or self.balances:
            values, axes = np.linalg.eigh(body.inertia)
            values = np.maximum(values, self.least[1])
            if self.balances and values[0] + values[1] < values[2]:
                values[:] = values.mean()
            body.inertia = axes @ np.diag(values) @ axes.T

    def scale_masses(self):
        whole = sum(body.mass for body in self.model.bodies)
        if self.total_mass > 0 and whole > 0:
            self.model.note("settotalmass includes moving bodies only")
            factor = self.total_mass/whole
            for body in self.model.bodies:
                body.mass, body.inertia = factor*body.mass, factor*body.inertia


def solid(kind, size, where):
    """Volume, principal inertias for a mass of 1, and what it looks like, by half sizes."""
    needed = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}.get(kind)
    if needed is None:
        raise InputError(f'{where} has the type "{kind}", which is not supported; give its body an <inertial>')
    if len(size) < needed or min(size[:needed]) <= 0:
        raise InputError(f"{where}: a {kind} requires {needed} positive sizes")
    r, h, c = [*size, 0, 0][:3]
    if kind == "sphere":
        return 4/3*math.pi*r**3, [0.4*r*r]*3, ("sphere", [r])
    if kind == "cylinder":
        return 2*math.pi*r*r*h, [(3*r*r + 4*h*h)/12]*2 + [r*r/2], ("cylinder", [r, 2*h])
    if kind == "capsule":
        middle, ends = 2*h/(2*h + 4/3*r), 4/3*r/(2*h + 4/3*r)
        across = middle*(3*r*r + 4*h*h)/12 + ends*(0.4*r*r + h*h + 0.75*h*r)
        return math.pi*r*r*(2*h + 4/3*r), [across, across, middle*r*r/2 + ends*0.4*r*r], ("cylinder", [r, 2*h])
    if kind == "box":
        return 8*r*h*c, [(h*h + c*c)/3, (r*r + c*c)/3, (r*r + h*h)/3], ("box", [2*r, 2*h, 2*c])
    return 4/3*math.pi*r*h*c, [(h*h + c*c)/5, (r*r + c*c)/5, (r*r + h*h)/5], ("box", [2*r, 2*h, 2*c])


def unit(v, where):
    v = np.array(v, float)
    if not np.linalg.norm(v) > 0:
        raise InputError(f"{where} has the length zero; give a direction")
    return v/np.linalg.norm(v)


def upright(z, where):
    """The smallest turn that brings z there."""
    z = unit(z, where)
    axis = np.cross([0, 0, 1.0], z)
    if not np.linalg.norm(axis) > 0:
        return np.eye(3) if z[2] > 0 else turned(np.array([1.0, 0, 0]), math.pi)
    return turned(axis/np.linalg.norm(axis), math.atan2(np.linalg.norm(axis), z[2]))


def rotation_of(p):
    e0, *e = np.array(p, float)/np.linalg.norm(p)
    k = np.array([[0, -e[2], e[1]], [e[2], 0, -e[0]], [-e[1], e[0], 0]])
    return np.eye(3) + 2*e0*k + 2*k @ k


def inverse(pose: Pose) -> Pose:
    return Pose(-pose.a.T @ pose.r, pose.a.T)


def read(path, at=None, state=None) -> Model:
    """The model of a file, defined with joints at their references, or at the values that `at` gives for their names; `state` gives
    coordinates of any joint and their rates in MuJoCo's convention."""
    return Reader(path, at, state).read()


def main(words=None) -> int:
    import argparse

    parser = argparse.ArgumentParser(prog="tandem import", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("format", choices=["mjcf"], help="format of the file")
    parser.add_argument("file", metavar="FILE")
    parser.add_argument("--output", metavar="PATH", help="the scene (the name of the file, .toml)")
    parser.add_argument("--at", metavar="JOINT=X,...", help="positions of joints (rad, m) in the reference configuration")
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")
    given = parser.parse_args(words)
    return guarded(lambda: run(given))


def run(given) -> None:
    target = Path(given.output or Path(given.file).with_suffix(".toml").name)
    if target.exists() and not given.force:
        raise InputError(f"{target} exists; name another by --output, or overwrite it by --force")
    model = read(given.file, parse_coordinates(given.at))
    text = to_toml(model, source=Path(given.file).name)
    target.write_text(text, encoding="utf-8")
    for note in model.notes:
        say(note)
    print(target)


if __name__ == "__main__":
    sys.exit(main())
