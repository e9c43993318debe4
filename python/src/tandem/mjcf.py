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
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

try:
    from .mjcf_text import to_toml
    from .urdf import Body, Link, Pose, UrdfError, add, numbers, parse_coordinates, turned
except ImportError:  # as a script
    from mjcf_text import to_toml
    from urdf import Body, Link, Pose, UrdfError, add, numbers, parse_coordinates, turned

#: Files in files, no deeper than this.
DEEPEST = 10
ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
#: What would change a model and is not taken.
REFUSED = ("composite", "flexcomp", "replicate", "attach", "flex")
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
    """What a file says: bodies that move, each with its joints and what carries it; which body and frame each name of the file is."""

    name: str
    gravity: np.ndarray
    bodies: list = field(default_factory=list)
    #: Of each body but the ground: (its joints, what carries it, its frame in that one's where joints are at their references).
    joints: dict = field(default_factory=dict)
    places: dict = field(default_factory=dict)
    sites: dict = field(default_factory=dict)
    equalities: list = field(default_factory=list)
    motors: list = field(default_factory=list)
    notes: list = field(default_factory=list)
    #: Where each joint with one coordinate is drawn.
    at: dict = field(default_factory=dict)

    def note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def expanded(path, depth=0):
    """The root of a file, with what it includes in its place."""
    if depth > DEEPEST:
        raise UrdfError(f"{path}: files include each other {DEEPEST} deep; do they go round?")
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise UrdfError(f"{path} is no XML: {error}") from error
    for parent in list(root.iter()):
        for k in reversed(range(len(parent))):
            if parent[k].tag == "include":
                inner = expanded(Path(path).parent / parent[k].get("file", ""), depth + 1)
                parent[k:k + 1] = list(inner)
    return root


class Reader:
    """Reads a file into a model."""

    def __init__(self, path, at=None, state=None):
        self.root = expanded(path)
        if self.root.tag != "mujoco":
            raise UrdfError(f"{path} is no MJCF: its first element is <{self.root.tag}>, not <mujoco>")
        self.compiler = {key: value for element in self.root.findall("compiler") for key, value in element.attrib.items()}
        self.per_degree = math.pi/180 if self.compiler.get("angle", "degree") == "degree" else 1.0
        self.groups = numbers(self.compiler.get("inertiagrouprange"), 2, (0, 5), "compiler, inertiagrouprange")
        self.sequence = self.compiler.get("eulerseq", "xyz")
        if len(self.sequence) != 3 or set(self.sequence.lower()) - set("xyz"):
            raise UrdfError(f'compiler, eulerseq: "{self.sequence}" should be three of x, y, z, X, Y, Z')
        if self.compiler.get("coordinate", "local") != "local":
            raise UrdfError("compiler, coordinate: global coordinates are of old versions; let MuJoCo save the model anew")
        self.classes = {"main": {}}
        for element in self.root.findall("default"):
            self.read_defaults(element, None)
        gravity = numbers(next((o.get("gravity") for o in self.root.findall("option") if o.get("gravity")), None), 3, (0, 0, -9.81),
                          "option, gravity")
        disabled = any(f.get("gravity") == "disable" for o in self.root.findall("option") for f in o.findall("flag"))
        self.model = Model(self.root.get("model") or Path(path).stem, 0*gravity if disabled else gravity)
        self.at, self.state, self.used = dict(at or {}), dict(state or {}), set()

    def read_defaults(self, element, parent):
        name = element.get("class") or ("main" if parent is None else "")
        content = {tag: dict(values) for tag, values in self.classes.get(name if parent is None else parent, {}).items()}
        for child in element:
            if child.tag != "default":
                content.setdefault(child.tag, {}).update(child.attrib)
        self.classes[name] = content
        for child in element.findall("default"):
            self.read_defaults(child, name)

    def attributes(self, element, given_class):
        """The attributes of an element, with those of its class; an orientation takes the place of any other one."""
        name = element.get("class") or given_class or "main"
        if name not in self.classes:
            raise UrdfError(f'there is no default class "{name}"; correct the name')
        defaults = self.classes[name].get(element.tag, {})
        if any(key in element.attrib for key in ORIENTATIONS):
            defaults = {key: value for key, value in defaults.items() if key not in ORIENTATIONS}
        return {**defaults, **element.attrib}

    def pose(self, given, where) -> Pose:
        r = numbers(given.get("pos"), 3, (0, 0, 0), f"{where}, pos")
        if "quat" in given:
            return Pose(r, rotation_of(numbers(given["quat"], 4, (1, 0, 0, 0), f"{where}, quat")))
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
        for world in self.root.findall("worldbody"):
            self.read_content(world, ground, Pose(), None, "world", counts=False)
        self.scale_masses()
        for name in (*self.at, *self.state):
            if name not in self.used:
                raise UrdfError(f"there is no joint {name} that turns or slides; correct the name")
        for element in self.root:
            if element.tag not in KNOWN:
                self.model.note(f"<{element.tag}> is left out")
        for section in self.root.findall("equality"):
            self.model.equalities += [(e.tag, self.attributes(e, None)) for e in section if e.get("active", "true") == "true"]
        for section in self.root.findall("actuator"):
            for element in section:
                given = self.attributes(element, None)
                if element.tag == "motor" and "joint" in given:
                    self.model.motors.append(given)
                else:
                    self.model.note(f"actuator {given.get('name', element.tag)} is left out: motors of joints alone are taken")
        for section in self.root.findall("option"):
            if any(float(numbers(section.get(key), 1, (0,), f"option, {key}")[0]) for key in ("density", "viscosity")):
                self.model.note("the medium around (option density, viscosity) is left out")
        return self.model

    def read_content(self, element, body, pose, given_class, name, counts=True):
        """Geoms, sites, frames and bodies inside of an element; `pose` is that of its frame in `body`."""
        geoms = []
        for child in element:
            if child.tag in REFUSED:
                raise UrdfError(f"body {name} has a <{child.tag}>, which is not taken; let MuJoCo save the model expanded")
            if child.tag == "geom":
                geoms.append((child, given_class, pose))
            elif child.tag == "site":
                given = self.attributes(child, given_class)
                self.model.sites[given.get("name", "")] = (body, pose @ self.pose(given, f"site {given.get('name', '')}"))
            elif child.tag == "frame":
                geoms += self.read_content(child, body, pose @ self.pose(child.attrib, f"frame in {name}"),
                                           child.get("childclass") or given_class, name, None)
            elif child.tag == "body":
                self.read_body(child, body, pose, given_class)
        if counts is None:
            return geoms
        if counts:
            self.weigh(element, geoms, body, pose, name)
        elif geoms:
            self.model.note("contacts are left out, and with them the geoms of the world")
        return []

    def read_body(self, element, parent, frame, given_class):
        name = element.get("name") or f"body{len(self.model.places)}"
        if name in self.model.places:
            raise UrdfError(f"there are two bodies {name}; give one another name")
        given_class = element.get("childclass") or given_class
        rest = frame @ self.pose(element.attrib, f"body {name}")
        joints = [self.read_joint(child, given_class, name, k) for k, child in enumerate(
            child for child in element if child.tag in ("joint", "freejoint"))]
        if float(element.get("gravcomp", 0)):
            self.model.note(f"gravcomp of body {name} is left out")
        body, pose = parent, rest
        if joints:
            body, pose = self.move(name, joints, parent, rest), Pose()
            self.model.bodies.append(body)
            self.model.joints[name] = (joints, parent, rest)
        elif body.name != "ground":
            body.links.append(name)
        self.model.places[name] = (body, pose)
        self.read_content(element, body, pose, given_class, name, counts=body.name != "ground")

    def read_joint(self, element, given_class, body, k) -> Joint:
        given = element.attrib if element.tag == "freejoint" else self.attributes(element, given_class)
        name = given.get("name") or f"{body}_joint{k or ''}"
        where = f"joint {name}"
        kind = "free" if element.tag == "freejoint" else given.get("type", "hinge")
        if kind not in ("hinge", "slide", "ball", "free"):
            raise UrdfError(f'{where} has the type "{kind}"; take one of ball, free, hinge, slide')
        scale = self.per_degree if kind == "hinge" else 1.0

        def number(key):
            return float(numbers(given.get(key), 1, (0,), f"{where}, {key}")[0])

        joint = Joint(name, kind, numbers(given.get("pos"), 3, (0, 0, 0), f"{where}, pos"),
                      unit(numbers(given.get("axis"), 3, (0, 0, 1), f"{where}, axis"), f"{where}, axis"), number("ref")*scale,
                      number("springref")*scale, float(given.get("stiffness", "0").split()[0]), float(given.get("damping", "0").split()[0]))
        if given.get("springdamper", "0 0").split() != ["0", "0"]:
            self.model.note(f"springdamper of joint {name} is left out: give stiffness and damping")
        for key in ("stiffness", "damping"):
            if any(float(x) for x in given.get(key, "0").split()[1:]):
                self.model.note(f"of the {key} of joint {name} what is not linear is left out")
        limited = given.get("limited", "auto")
        if "range" in given and (limited == "true" or limited == "auto" and self.compiler.get("autolimits", "true") == "true"):
            joint.range = tuple(numbers(given["range"], 2, (), f"{where}, range")*scale)
        for key, what in (("armature", "armatures (inertias of rotors)"), ("frictionloss", "friction of joints")):
            if number(key):
                self.model.note(f"{what} are left out" if key == "armature" else f"{what} is left out")
        return joint

    def move(self, name, joints, parent, rest) -> Body:
        """The body behind joints: one after the other, as MuJoCo does. Velocities are of the origins of frames."""
        here = parent.pose @ rest
        omega, velocity = parent.omega, parent.velocity + np.cross(parent.omega, here.r - parent.pose.r)
        for joint in joints:
            q, rate = self.state.get(joint.name, (None, None))
            self.used.add(joint.name)
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
        inertial, from_geoms = element.find("inertial"), self.compiler.get("inertiafromgeom", "auto")
        by_geoms = from_geoms == "true" or from_geoms == "auto" and inertial is None
        link = Link(name)
        if inertial is not None and not by_geoms:
            place = self.pose(inertial.attrib, f"body {name}, inertial")
            link.mass, link.centre = float(numbers(inertial.get("mass"), 1, (0,), f"body {name}, mass")[0]), place.r
            xx, yy, zz, xy, xz, yz = numbers(inertial.get("fullinertia"), 6, (*numbers(
                inertial.get("diaginertia"), 3, (0, 0, 0), f"body {name}, diaginertia"), 0, 0, 0), f"body {name}, fullinertia")
            link.inertia = place.a @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ place.a.T
        whole = Body(name, [], Pose())
        add(whole, link, Pose())
        for child, given_class, frame in geoms:
            self.add_geom(child, given_class, whole, inverse(pose) @ frame, name, by_geoms)
        self.bound(whole)
        add(body, Link(name, whole.mass, whole.centre, whole.inertia, whole.looks), pose)
        if geoms:
            self.model.note("contacts are left out")

    def add_geom(self, element, given_class, body, frame, name, weighs):
        given = self.attributes(element, given_class)
        where = f"geom {given.get('name', 'of ' + name)}"
        kind = "mesh" if "mesh" in given and "type" not in given else given.get("type", "sphere")
        place, size = self.geom_place(given, kind, where)
        if kind in ("plane", "hfield"):
            return
        group = int(numbers(given.get("group"), 1, (0,), f"{where}, group")[0])
        weighs = weighs and self.groups[0] <= group <= self.groups[1]
        mass = None if "mass" not in given else float(numbers(given["mass"], 1, (0,), f"{where}, mass")[0])
        density = float(numbers(given.get("density"), 1, (1000,), f"{where}, density")[0])
        look = None
        if kind in ("mesh", "sdf"):
            if weighs and mass != 0 and density != 0:
                raise UrdfError(f"{where} is a mesh that gives body {name} its mass; give the body an <inertial>, or let MuJoCo save the model")
            own, principal = 0.0, np.zeros(3)
        else:
            volume, per_mass, look = solid(kind, size, where)
            own = density*volume if mass is None else mass
            principal = own*np.array(per_mass)
            if weighs and given.get("shellinertia", "false") == "true":
                raise UrdfError(f"{where} has shellinertia, which is not taken; give body {name} an <inertial>")
        if not weighs:
            own, principal = 0.0, np.zeros(3)
        add(body, Link(name, own, np.zeros(3), np.diag(principal), [(*look, Pose())] if look else []), frame @ place)

    def geom_place(self, given, kind, where):
        """The frame of a geom, and its half sizes."""
        size = [float(x) for x in given.get("size", "").split()]
        if "fromto" not in given or kind in ("sphere", "plane", "mesh"):
            return self.pose(given, where), size
        ends = numbers(given["fromto"], 6, (), f"{where}, fromto").reshape(2, 3)
        half = float(np.linalg.norm(ends[0] - ends[1]))/2
        size = [*size[:1], half] if kind in ("capsule", "cylinder") else [*size[:1], *size[:1], half]
        return Pose(ends.mean(axis=0), upright(ends[0] - ends[1], where)), size

    def bound(self, body):
        """What the compiler asks of masses and inertias."""
        least = [float(numbers(self.compiler.get(key), 1, (0,), f"compiler, {key}")[0]) for key in ("boundmass", "boundinertia")]
        body.mass = max(body.mass, least[0])
        if least[1] or self.compiler.get("balanceinertia") == "true":
            values, axes = np.linalg.eigh(body.inertia)
            values = np.maximum(values, least[1])
            if self.compiler.get("balanceinertia") == "true" and values[0] + values[1] < values[2]:
                values[:] = values.mean()
            body.inertia = axes @ np.diag(values) @ axes.T

    def scale_masses(self):
        total = float(numbers(self.compiler.get("settotalmass"), 1, (-1,), "compiler, settotalmass")[0])
        if total > 0:
            self.model.note("settotalmass counts bodies that move alone")
            factor = total/sum(body.mass for body in self.model.bodies)
            for body in self.model.bodies:
                body.mass, body.inertia = factor*body.mass, factor*body.inertia


def solid(kind, size, where):
    """Volume, principal inertias for a mass of 1, and what it looks like, by half sizes."""
    needed = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}.get(kind)
    if needed is None:
        raise UrdfError(f'{where} has the type "{kind}", which is not taken; give its body an <inertial>')
    if len(size) < needed or min(size[:needed]) <= 0:
        raise UrdfError(f"{where}: a {kind} needs {needed} sizes above zero")
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
        raise UrdfError(f"{where} has the length zero; give a direction")
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
    """The model of a file, drawn with joints at their references, or as `at` says by name; `state` gives any joint its coordinates and
    their rates as MuJoCo has them."""
    return Reader(path, at, state).read()


def main(words=None) -> int:
    import argparse

    parser = argparse.ArgumentParser(prog="tandem import", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("format", choices=["mjcf"], help="what the file is")
    parser.add_argument("file", metavar="FILE")
    parser.add_argument("--output", metavar="PATH", help="the scene (the name of the file, .toml)")
    parser.add_argument("--at", metavar="JOINT=X,...", help="draw joints there (rad, m), not at their references")
    parser.add_argument("--force", action="store_true", help="overwrite a file that exists")
    given = parser.parse_args(words)
    try:
        target = Path(given.output or Path(given.file).with_suffix(".toml").name)
        if target.exists() and not given.force:
            raise UrdfError(f"{target} exists; name another by --output, or overwrite it by --force")
        model = read(given.file, parse_coordinates(given.at))
        text = to_toml(model, source=Path(given.file).name)
        target.write_text(text, encoding="utf-8")
        for note in model.notes:
            print(f"tandem: {note}", file=sys.stderr)
        print(target)
        return 0
    except (OSError, ValueError) as error:
        print(f"tandem: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
