# SPDX-License-Identifier: MIT
"""A robot from a URDF file as a mechanism: the text of a scene (see doc/mechanism.md).

    tandem import urdf robot.urdf                             robot.toml
    tandem import urdf robot.urdf --output arm.toml --floating
    tandem import urdf robot.urdf --at elbow=1.2,wrist=-0.3

Links that fixed joints hold together become one body, whose axes are those of the first of them; what hangs on the root by fixed joints
is the ground, unless the robot floats. Revolute and continuous joints turn, prismatic ones slide, planar ones do both in their plane,
floating ones are none. Mimicking joints become couplings, limits events, damping a force along the joint's coordinate. Inertias are
taken as they are. Shapes and meshes are kept for looking; efforts, transmissions, sensors, controllers and friction are left out, and a
comment says so.

Format: https://wiki.ros.org/urdf/XML
"""

from __future__ import annotations

import math
import sys
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

try:
    from .markup import InputError, finite, guarded, number, numbers, parse
except ImportError:  # as a script
    from markup import InputError, finite, guarded, number, numbers, parse

#: The longest name of an element of a mechanism, or of an event.
LONGEST = 64
TYPES = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "planar": "planar"}

#: Joints with one coordinate.
SCALAR = ("revolute", "continuous", "prismatic")


@dataclass
class Pose:
    """A place and a rotation, from a frame to the one that it stands in."""

    r: np.ndarray = field(default_factory=lambda: np.zeros(3))
    a: np.ndarray = field(default_factory=lambda: np.eye(3))

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.r + self.a @ other.r, self.a @ other.a)


@dataclass
class Link:
    """A link: its mass, the centre of mass and the inertia about it in the link's axes, and what there is to see."""

    name: str
    mass: float = 0.0
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    looks: list = field(default_factory=list)


@dataclass
class Joint:
    """A joint: its frame on its parent, and its type and limits."""

    name: str
    type: str
    parent: str
    child: str
    origin: Pose
    axis: np.ndarray
    lower: float | None = None
    upper: float | None = None
    damping: float = 0.0
    friction: float = 0.0
    mimic: tuple | None = None


@dataclass
class Robot:
    """Contents of a file."""

    name: str
    links: dict
    joints: dict
    root: str


@dataclass
class Body:
    """Links that are one: their frame in the world, the centre of mass and the inertia about it in the axes of that frame."""

    name: str
    links: list
    pose: Pose
    mass: float = 0.0
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    omega: np.ndarray = field(default_factory=lambda: np.zeros(3))
    looks: list = field(default_factory=list)

    def place(self) -> np.ndarray:
        """The centre of mass in the world."""
        return self.pose.r + self.pose.a @ self.centre


def turned(axis: np.ndarray, angle: float) -> np.ndarray:
    """The rotation about a unit axis."""
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + math.sin(angle)*k + 2*math.sin(angle/2)**2*(k @ k)


def origin_of(element, where: str) -> Pose:
    """The <origin> of an element: the angles are about the fixed axes x, y, z, in this order."""
    given = None if element is None else element.find("origin")
    if given is None:
        return Pose()
    roll, pitch, yaw = numbers(given.get("rpy"), 3, (0, 0, 0), f"{where}, rpy")
    x, y, z = np.eye(3)
    return Pose(numbers(given.get("xyz"), 3, (0, 0, 0), f"{where}, xyz"), turned(z, yaw) @ turned(y, pitch) @ turned(x, roll))


def euler_parameters(a: np.ndarray) -> np.ndarray:
    """Of a rotation: the largest comes from its square, the others from sums and differences (Shepperd 1978)."""
    squares = np.array([np.trace(a), a[0, 0], a[1, 1], a[2, 2]])
    k = int(np.argmax(squares))
    p = np.empty(4)
    if k == 0:
        p[:] = 1 + np.trace(a), a[2, 1] - a[1, 2], a[0, 2] - a[2, 0], a[1, 0] - a[0, 1]
    else:
        i, j, l = k - 1, k % 3, (k + 1) % 3
        p[0] = a[l, j] - a[j, l]
        p[1 + i] = 1 + 2*a[i, i] - np.trace(a)
        p[1 + j] = a[j, i] + a[i, j]
        p[1 + l] = a[l, i] + a[i, l]
    return p/np.linalg.norm(p)*(1 if p[0] >= 0 else -1)


def named(element, what: str) -> str:
    name = (element.get("name") or "").strip()
    if not name:
        raise InputError(f"a {what} has no name")
    return name


def read_looks(element, kind: str, where: str) -> list:
    """The shapes of a link: (shape, sizes or file, pose in the link)."""
    looks = []
    for visual in element.findall(kind):
        geometry = visual.find("geometry")
        if geometry is None or len(geometry) == 0:
            continue
        shape = geometry[0]
        pose = origin_of(visual, where)
        if shape.tag == "box":
            looks.append(("box", numbers(shape.get("size"), 3, (0, 0, 0), f"{where}, box", 0), pose))
        elif shape.tag == "cylinder":
            looks.append(("cylinder", [number(shape.get(key), 0, f"{where}, {key}", 0) for key in ("radius", "length")], pose))
        elif shape.tag == "sphere":
            looks.append(("sphere", numbers(shape.get("radius"), 1, (0,), f"{where}, radius", 0), pose))
        elif shape.tag == "mesh":
            looks.append(("mesh", (shape.get("filename", ""), numbers(shape.get("scale"), 3, (1, 1, 1), where)), pose))
    return looks


def read_link(element) -> Link:
    link = Link(named(element, "link"))
    where = f"link {link.name}"
    inertial = element.find("inertial")
    if inertial is not None:
        pose = origin_of(inertial, where)
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        link.centre = pose.r
        if mass is not None:
            link.mass = number(mass.get("value"), 0, f"{where}, mass", 0)
        if inertia is not None:
            entry = {key: number(inertia.get(key), 0, f"{where}, {key}") for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")}
            tensor = np.array([[entry["ixx"], entry["ixy"], entry["ixz"]], [entry["ixy"], entry["iyy"], entry["iyz"]],
                               [entry["ixz"], entry["iyz"], entry["izz"]]])
            link.inertia = pose.a @ tensor @ pose.a.T
    link.looks = read_looks(element, "visual", where)
    return link


def read_joint(element) -> Joint:
    name = named(element, "joint")
    where = f"joint {name}"
    kind = element.get("type", "")
    if kind not in {*TYPES, "fixed", "floating"}:
        raise InputError(f'{where} has the type "{kind}"; use one of {", ".join(sorted({*TYPES, "fixed", "floating"}))}')
    ends = [element.find(end) for end in ("parent", "child")]
    if any(end is None or not end.get("link") for end in ends):
        raise InputError(f"{where} has no parent or no child")
    axis = element.find("axis")
    direction = numbers(None if axis is None else axis.get("xyz"), 3, (1, 0, 0), f"{where}, axis")
    if kind in TYPES and not np.linalg.norm(direction) > 0:
        raise InputError(f"{where} has an axis of length zero; give a direction")
    joint = Joint(name, kind, *(end.get("link") for end in ends), origin_of(element, where),
                  direction/max(np.linalg.norm(direction), 1e-300))
    limit, dynamics, mimic = (element.find(tag) for tag in ("limit", "dynamics", "mimic"))
    if limit is not None and kind in ("revolute", "prismatic"):
        joint.lower, joint.upper = (number(limit.get(key), 0, f"{where}, {key}") for key in ("lower", "upper"))
    if dynamics is not None:
        joint.damping, joint.friction = (number(dynamics.get(key), 0, f"{where}, {key}") for key in ("damping", "friction"))
    if mimic is not None:
        joint.mimic = (mimic.get("joint", ""), *(number(mimic.get(key), default, f"{where}, {key}")
                                                 for key, default in (("multiplier", 1), ("offset", 0))))
    return joint


def read(path) -> Robot:
    """The robot of a file: a tree of links."""
    root = parse(path)
    if root.tag != "robot":
        raise InputError(f"{path} is not URDF: its first element is <{root.tag}>, not <robot>"
                        + ("; let xacro expand it first" if "xacro" in root.tag else ""))
    links, joints = {}, {}
    for element in root:
        if element.tag.startswith("{") and "xacro" in element.tag:
            raise InputError(f"{path} has macros of xacro; expand them first: xacro {path} > robot.urdf")
        if element.tag == "link":
            link = read_link(element)
            if link.name in links:
                raise InputError(f"two links have the name {link.name}; rename one")
            links[link.name] = link
        elif element.tag == "joint":
            joint = read_joint(element)
            if joint.name in joints:
                raise InputError(f"two joints have the name {joint.name}; rename one")
            joints[joint.name] = joint
    if not links:
        raise InputError(f"{path} has no links")
    return Robot(root.get("name") or Path(path).stem, links, joints, find_root(links, joints))


def find_root(links, joints) -> str:
    """The only link without a parent; every other link must be reached from it exactly once."""
    parents = {}
    for joint in joints.values():
        for link in (joint.parent, joint.child):
            if link not in links:
                raise InputError(f"joint {joint.name}: there is no link {link}; correct the name")
        if joint.child in parents:
            raise InputError(f"link {joint.child} is the child of {parents[joint.child]} and of {joint.name}: URDF permits trees only; "
                            "close the loop by a joint of the mechanism")
        parents[joint.child] = joint.name
        if joint.mimic and joint.mimic[0] not in joints:
            raise InputError(f'joint {joint.name} mimics "{joint.mimic[0]}", which does not exist; correct the name')
    roots = [name for name in links if name not in parents]
    if len(roots) != 1:
        raise InputError(f"there are {len(roots)} links without a parent: {', '.join(roots[:5]) or 'the joints form a cycle'}; exactly one must be the root")
    return roots[0]


def assemble(robot: Robot, floating=False, at=None, rates=None, base=None):
    """The bodies and the moving joints in the world, drawn at given coordinates of the joints with given rates.

    Returns the bodies by their first link, None for the ground; for each link its body; and joints with their frames."""
    at, rates = dict(at or {}), dict(rates or {})
    for name in (*at, *rates):
        if name not in robot.joints or robot.joints[name].type not in SCALAR:
            raise InputError(f"no joint {name} rotates or slides; correct the name")
        if robot.joints[name].mimic:
            raise InputError(f"joint {name} follows {robot.joints[name].mimic[0]}: remove it, and give that one")
    for joint in robot.joints.values():
        follow(robot, joint, at, rates)
    children = {}
    for joint in robot.joints.values():
        children.setdefault(joint.parent, []).append(joint)
    ground = Body("ground", [robot.root], Pose())
    first = Body(robot.root, [robot.root], base or Pose()) if floating else ground
    bodies, body_of, frames = ([first] if floating else []), {robot.root: (first, Pose())}, {}
    waiting, done = deque([robot.root]), 0
    while waiting:
        link = waiting.popleft()
        done += 1
        body, pose = body_of[link]
        add(body, robot.links[link], pose)
        for joint in children.get(link, ()):
            here = pose @ joint.origin
            if joint.type == "fixed":
                body.links.append(joint.child)
                body_of[joint.child] = (body, here)
            else:
                frames[joint.name] = world = body.pose @ here
                child = move(body, joint, world, at.get(joint.name, 0.0), rates.get(joint.name, 0.0))
                bodies.append(child)
                body_of[joint.child] = (child, Pose())
            waiting.append(joint.child)
    if done < len(robot.links):
        raise InputError("joints form a cycle outside the tree; cut one")
    return bodies, body_of, frames, at


def follow(robot: Robot, joint: Joint, at: dict, rates: dict) -> None:
    """Set the coordinate and rate of a mimicking joint, after those of the joint that it follows."""
    chain = {}
    while joint.mimic and joint.type in SCALAR and joint.name not in at:
        if joint.name in chain:
            raise InputError(f"joint {joint.name} mimics itself: {' of '.join(list(chain)[:5])} form a cycle; cut one")
        chain[joint.name] = joint
        joint = robot.joints[joint.mimic[0]]
    for joint in reversed(chain.values()):
        other, factor, offset = joint.mimic
        at[joint.name] = finite(factor*at.get(other, 0.0) + offset)
        rates[joint.name] = finite(factor*rates.get(other, 0.0))


def move(parent: Body, joint: Joint, world: Pose, x: float, rate: float) -> Body:
    """The body behind a joint; velocities of bodies refer to the origins of their frames until all bodies are set."""
    axis = world.a @ joint.axis
    pose, omega = Pose(world.r, world.a), parent.omega
    velocity = parent.velocity + np.cross(parent.omega, world.r - parent.pose.r)
    if joint.type in ("revolute", "continuous"):
        pose = Pose(world.r, world.a @ turned(joint.axis, x))
        omega = omega + rate*axis
    elif joint.type == "prismatic":
        pose = Pose(world.r + x*axis, world.a)
        velocity = velocity + np.cross(parent.omega, x*axis) + rate*axis
    return Body(joint.child, [joint.child], pose, velocity=velocity, omega=omega)


def add(body: Body, link: Link, pose: Pose) -> None:
    """Put a link into a body, in whose frame it has a pose."""
    for shape, sizes, where in link.looks:
        body.looks.append((shape, sizes, pose @ where))
    mass = body.mass + link.mass
    centre = pose.r + pose.a @ link.centre
    inertia = pose.a @ link.inertia @ pose.a.T
    if mass > 0:
        both = (body.mass*body.centre + link.mass*centre)/mass
        body.inertia = body.inertia + steiner(body.mass, body.centre - both) + inertia + steiner(link.mass, centre - both)
        body.centre = both
    else:
        body.inertia = body.inertia + inertia
    body.mass = mass


def steiner(mass: float, d: np.ndarray) -> np.ndarray:
    return mass*(d @ d*np.eye(3) - np.outer(d, d))


class Names:
    """Names of elements: letters, digits and a few signs, short, each once."""

    def __init__(self):
        self.taken = {"ground"}
        #: The next number to try, by what stands before and behind it and by its digits.
        self.numbers = {}

    def take(self, name: str, suffix: str = "") -> str:
        clean = "".join(letter if letter.isascii() and (letter.isalnum() or letter in "_-") else "_" for letter in name)
        short = clean[:LONGEST - len(suffix)] + suffix
        digits = 0
        while short in self.taken:
            digits += 1
            stem = clean[:LONGEST - len(suffix) - digits - 1]
            count = self.numbers.get((stem, suffix, digits), max(2, 10**(digits - 1)))
            while short in self.taken and count < 10**digits:
                short = f"{stem}_{count}{suffix}"
                count += 1
            self.numbers[stem, suffix, digits] = count
        self.taken.add(short)
        return short


def text_of(value) -> str:
    """A number or a list of numbers as TOML, to the last digit."""
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(text_of(entry) for entry in value) + "]"
    value = finite(float(value))
    return "0" if value == 0 else repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def printable(text: str) -> str:
    """A text on one line, as comments take it."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def quoted(text: str) -> str:
    return '"' + printable(text).replace("\\", "\\\\").replace('"', '\\"') + '"'


def look_text(shape, sizes, pose: Pose, centre) -> str:
    """A shape as one text: what, where from the centre of mass, how turned."""
    what = f"{shape} {sizes[0]} scale {' '.join(map(text_of, sizes[1]))}" if shape == "mesh" else \
        f"{shape} {' '.join(map(text_of, sizes))}"
    return f"{what} at {' '.join(map(text_of, pose.r - centre))} euler_parameters {' '.join(map(text_of, euler_parameters(pose.a)))}"


def to_toml(robot: Robot, floating=False, at=None, rates=None, base=None, gravity=(0, 0, -9.81), source="", looks=True) -> str:
    """The text of a scene. `at` and `rates` draw joints of these names elsewhere than at 0, and move them at the start; `base` is the
    pose of the root of a robot that floats."""
    bodies, body_of, frames, at = assemble(robot, floating, at, rates, base)
    if not bodies:
        raise InputError("nothing moves: all joints are fixed; use --floating for a free body")
    names = Names()
    body_name = {id(body): names.take(body.name) for body in bodies}
    joint_name = {name: names.take(name, "" if name not in robot.links else "_j") for name in frames}
    moving = [name for name in frames if robot.joints[name].type in TYPES]
    lines = [printable(f"# {robot.name}" + (f", from {source}" if source else "") + ", by tandem import urdf."), *left_out(robot, moving), "",
             "[scene]", f"description = {quoted(robot.name[:80])}", 'model = "mechanism"', "", "[gravity]",
             f"vector = {text_of(gravity)}", ""]
    for body in bodies:
        lines += body_lines(body, body_name[id(body)], looks)
    for name in moving:
        lines += joint_lines(robot.joints[name], joint_name[name], frames[name], body_of, body_name)
    lines += coupling_lines(robot, moving, joint_name, names, at)
    for name in moving:
        if robot.joints[name].damping and robot.joints[name].type != "planar":
            lines += [f"[force.{names.take(name, '_damping')}]", 'type = "torsion"', f'joint = "{joint_name[name]}"',
                      f"damping = {text_of(robot.joints[name].damping)}", ""]
    limited = [name for name in moving if robot.joints[name].lower is not None and robot.joints[name].lower < robot.joints[name].upper]
    if limited:
        lines += ["[results]", f"joints = [{', '.join(quoted(joint_name[name]) for name in limited)}]", ""]
    lines += ["[time]", "end = 1.0", "", "[solver]", 'stepper = "dopri5"', "rtol = 1e-8", ""]
    events = Names()
    for name in limited:
        lines += limit_lines(robot.joints[name], joint_name[name], at.get(name, 0.0), events)
    return "\n".join(lines).rstrip("\n") + "\n"


def left_out(robot: Robot, moving) -> list:
    """Comments on what the scene does not have."""
    notes = []
    if any(robot.joints[name].friction for name in moving):
        notes.append("# Friction of joints is ignored.")
    return notes


def body_lines(body: Body, name: str, looks: bool) -> list:
    note = printable(f"  # {body.name}") if name != body.name else ""
    held = printable(f"  # with {', '.join(body.links[1:])}") if len(body.links) > 1 else ""
    inertia = body.inertia
    # Values within rounding of zero are set to zero.
    rounding = 4*np.finfo(float).eps*np.max(np.abs(inertia))
    entries = [inertia[i, j] if abs(inertia[i, j]) > rounding else 0.0 for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    lines = [f"[body.{name}]{note}{held}", f"mass = {text_of(body.mass)}",
             f"inertia = {text_of(entries if any(entries[3:]) else entries[:3])}", f"position = {text_of(body.place())}"]
    if not np.array_equal(body.pose.a, np.eye(3)):
        lines.append(f"euler_parameters = {text_of(euler_parameters(body.pose.a))}")
    velocity = body.velocity + np.cross(body.omega, body.pose.a @ body.centre)
    if np.any(velocity):
        lines.append(f"velocity = {text_of(velocity)}")
    if np.any(body.omega):
        lines.append(f"omega = {text_of(body.omega)}")
    lines.append(f"points = {{ origin = {text_of(-body.centre)} }}  # of the link's frame")
    if looks and body.looks:
        shown = [quoted(look_text(*look, body.centre)) for look in body.looks]
        lines.append("looks = [" + ", ".join(shown) + "]")
    return [*lines, ""]


def joint_lines(joint: Joint, name: str, frame: Pose, body_of, body_name) -> list:
    ends = [body_of[link][0] for link in (joint.parent, joint.child)]
    texts = [quoted(body_name.get(id(end), "ground")) for end in ends]
    note = printable(f"  # {joint.name}") if name != joint.name else ""
    at = frame.r if joint.type != "prismatic" else ends[1].pose.r
    return [f"[joint.{name}]{note}", f'type = "{TYPES[joint.type]}"', f"bodies = [{', '.join(texts)}]", f"at = {text_of(at)}",
            f"axis = {text_of(frame.a @ joint.axis)}", ""]


def coupling_lines(robot: Robot, moving, joint_name, names, at) -> list:
    """q = multiplier q' + offset. The reference configuration satisfies this, so that relative to it the offset vanishes."""
    lines = []
    for name in moving:
        mimic = robot.joints[name].mimic
        if mimic is None or robot.joints[name].type == "planar":
            continue
        joints, factors = [joint_name[name]], [1]
        # A joint that follows with factor 0, or follows a joint without a coordinate, is fixed.
        if mimic[1] != 0 and robot.joints[mimic[0]].type in SCALAR:
            joints.append(joint_name[mimic[0]])
            factors.append(-mimic[1])
        lines += [f"[constraint.{names.take(name, '_mimic')}]", 'type = "coupling"',
                  f"joints = [{', '.join(map(quoted, joints))}]", f"factors = {text_of(factors)}", ""]
    return lines


def limit_lines(joint: Joint, name: str, x: float, events: Names) -> list:
    what = "displacement" if joint.type == "prismatic" else "angle"
    lines = []
    for end, value, direction in (("lower", joint.lower, "falling"), ("upper", joint.upper, "rising")):
        lines += ["[[event]]", f'name = "{events.take(name, "_" + end)}"', f'watch = "/joints/{name}/{what}"',
                  f"value = {text_of(value - x)}", f'direction = "{direction}"', ""]
    return lines


def parse_coordinates(text: str | None) -> dict:
    """joint=value,joint=value."""
    found = {}
    for part in (text or "").split(","):
        if not part.strip():
            continue
        name, _, value = part.partition("=")
        try:
            found[name.strip()] = float(value)
            if not math.isfinite(found[name.strip()]):
                raise ValueError
        except ValueError:
            raise InputError(f'"{part}" should be JOINT=NUMBER') from None
    return found


def add_arguments(parser) -> None:
    parser.add_argument("format", choices=["urdf", "mjcf"], help="format of the file")
    parser.add_argument("file", metavar="FILE")
    parser.add_argument("--output", metavar="PATH", help="the scene (the name of the file, .toml)")
    parser.add_argument("--floating", action="store_true", help="the root is a free body, not the ground")
    parser.add_argument("--at", metavar="JOINT=X,...", help="positions of joints (rad, m) in the reference configuration (0)")
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")


def run(given) -> None:
    if given.format != "urdf":
        raise InputError("use mjcf.py for MuJoCo files")
    target = Path(given.output or Path(given.file).with_suffix(".toml").name)
    if target.exists() and not given.force:
        raise InputError(f"{target} exists; name another by --output, or overwrite it by --force")
    robot = read(given.file)
    target.write_text(to_toml(robot, given.floating, parse_coordinates(given.at), source=Path(given.file).name), encoding="utf-8")
    print(target)


def main(words=None) -> int:
    """python3 urdf.py FILE, where the package is not installed."""
    import argparse

    parser = argparse.ArgumentParser(prog="tandem import", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    given = parser.parse_args(words)
    return guarded(lambda: run(given))


if __name__ == "__main__":
    sys.exit(main())
