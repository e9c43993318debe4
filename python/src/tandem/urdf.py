# SPDX-License-Identifier: MIT
"""A robot from a URDF file as a mechanism: the text of a scene (see doc/mechanism.md).

Links that fixed joints hold together become one body, whose axes are those of the first of them; what hangs on the root by fixed joints
is the ground, unless the robot floats. Revolute and continuous joints turn, prismatic ones slide, planar ones do both in their plane,
floating ones are none. Mimicking joints become couplings, limits stops or events, damping and friction forces along the joint's coordinate.
Shapes and meshes are kept for looking; efforts, transmissions, sensors and controllers are left out.

Format: https://wiki.ros.org/urdf/XML
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .markup import InputError, finite, number, numbers, parse
from .robots import Body, Link, Losses, Names, Pose, Scene, add, euler_parameters, quoted, text_of, turned

__all__ = ["Names", "euler_parameters", "read", "to_toml", "turned"]
TYPES = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "planar": "planar"}

#: Joints with one coordinate.
SCALAR = ("revolute", "continuous", "prismatic")


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


def origin_of(element, where: str) -> Pose:
    """The <origin> of an element: the angles are about the fixed axes x, y, z, in this order."""
    given = None if element is None else element.find("origin")
    if given is None:
        return Pose()
    roll, pitch, yaw = numbers(given.get("rpy"), 3, (0, 0, 0), f"{where}, rpy")
    x, y, z = np.eye(3)
    return Pose(numbers(given.get("xyz"), 3, (0, 0, 0), f"{where}, xyz"), turned(z, yaw) @ turned(y, pitch) @ turned(x, roll))


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


def to_toml(robot: Robot, floating=False, at=None, rates=None, base=None, gravity=(0, 0, -9.81), source="", looks=True, limits="stops",
            balance=False, losses=None) -> str:
    """The text of a scene. `at` and `rates` draw joints of these names elsewhere than at 0, and move them at the start; `base` is the
    pose of the root of a robot that floats."""
    bodies, body_of, frames, at = assemble(robot, floating, at, rates, base)
    if not bodies:
        raise InputError("nothing moves: all joints are fixed; use --floating for a free body")
    losses = Losses() if losses is None else losses
    scene = Scene(robot.name, source, gravity, looks, balance)
    names = scene.names
    body_name = {id(body): names.take(body.name) for body in bodies}
    joint_name = {name: names.take(name, "" if name not in robot.links else "_j") for name in frames}
    moving = [name for name in frames if robot.joints[name].type in TYPES]
    scene.largest = max(float(np.max(np.abs(body.inertia))) for body in bodies)
    for body in bodies:
        scene.body(body, body_name[id(body)])
    for name in moving:
        write_joint(scene, robot.joints[name], joint_name[name], frames[name], body_of, body_name)
    write_couplings(scene, robot, moving, joint_name)
    for name in moving:
        joint = robot.joints[name]
        if joint.type == "planar":
            if joint.damping or joint.friction:
                losses.add("damping and friction of planar joints", name)
            continue
        if joint.damping:
            scene.add("force", names.take(name, "_damping"), {"type": '"torsion"', "joint": quoted(joint_name[name]),
                                                              "damping": text_of(joint.damping)})
        if joint.friction > 0:
            scene.friction(joint_name[name], name, joint.friction)
        if limits != "none" and joint.lower is not None and joint.lower < joint.upper:
            x = at.get(name, 0.0)
            if not joint.lower <= x <= joint.upper:
                losses.add("limits that the position at the start exceeds", name)
                continue
            inertia = beyond(robot, joint, body_of)
            scene.limit(joint_name[name], name, (joint.lower, joint.upper), x, "displacement" if joint.type == "prismatic" else "angle",
                        limits, inertia*STOP**2, 2*inertia*STOP)
    return scene.toml(losses.lines(), "tandem import")


#: Circular frequency (1/s) of what lies beyond a joint on its stops.
STOP = 50.0


def beyond(robot: Robot, joint: Joint, body_of) -> float:
    """A measure of the inertia that moves with a joint: of the body behind it."""
    body = body_of[joint.child][0]
    if joint.type == "prismatic":
        return max(body.mass, 1e-6)
    return max(float(np.trace(body.inertia))/2 + body.mass*float(body.centre @ body.centre), 1e-6)


def write_joint(scene: Scene, joint: Joint, name: str, frame: Pose, body_of, body_name) -> None:
    ends = [body_of[link][0] for link in (joint.parent, joint.child)]
    at = frame.r if joint.type != "prismatic" else ends[1].pose.r
    scene.add("joint", name, {"type": quoted(TYPES[joint.type]), "bodies": f"[{', '.join(quoted(body_name.get(id(end), 'ground')) for end in ends)}]",
                              "at": text_of(at), "axis": text_of(frame.a @ joint.axis)}, joint.name)


def write_couplings(scene: Scene, robot: Robot, moving, joint_name) -> None:
    """q = multiplier q' + offset. The reference configuration satisfies this, so that relative to it the offset vanishes."""
    for name in moving:
        mimic = robot.joints[name].mimic
        if mimic is None or robot.joints[name].type == "planar":
            continue
        joints, factors = [joint_name[name]], [1]
        # A joint that follows with factor 0, or follows a joint without a coordinate, is fixed.
        if mimic[1] != 0 and robot.joints[mimic[0]].type in SCALAR:
            joints.append(joint_name[mimic[0]])
            factors.append(-mimic[1])
        scene.add("constraint", scene.names.take(name, "_mimic"), {"type": '"coupling"', "joints": f"[{', '.join(map(quoted, joints))}]",
                                                                   "factors": text_of(factors)})
