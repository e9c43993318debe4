# SPDX-License-Identifier: MIT
"""Common to the imports: bodies and their inertias, text of a scene, names, limits and friction of joints, and what is lost."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from .markup import InputError, finite

#: The longest name of an element of a mechanism, or of an event.
LONGEST = 64
#: Moments of inertia that are negative by less than this part of the largest of all bodies are rounding.
ROUNDING = 1e-12
#: Transition speed of friction (rad/s, m/s): slower joints creep.
CREEP = 0.01
#: Part of a range over which the damping of a stop begins, and stiffness of stops without one of their own (1/s^2 times the inertia).
ONSET = 0.01


@dataclass
class Pose:
    """A place and a rotation, from a frame to the one that it stands in."""

    r: np.ndarray = field(default_factory=lambda: np.zeros(3))
    a: np.ndarray = field(default_factory=lambda: np.eye(3))

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.r + self.a @ other.r, self.a @ other.a)

    def inverse(self) -> Pose:
        return Pose(-self.a.T @ self.r, self.a.T)


@dataclass
class Link:
    """A link: its mass, the centre of mass and the inertia about it in the link's axes, and what there is to see."""

    name: str
    mass: float = 0.0
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    looks: list = field(default_factory=list)


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
    #: Named points in the frame.
    points: dict = field(default_factory=dict)

    def place(self) -> np.ndarray:
        """The centre of mass in the world."""
        return self.pose.r + self.pose.a @ self.centre


class Losses:
    """What a scene does not have, grouped by kind."""

    def __init__(self):
        self.kinds = {}

    def add(self, kind: str, name: str = "") -> None:
        self.kinds.setdefault(kind, []).append(name)

    def lines(self) -> list:
        """A line for each kind, with its count and the first names."""
        return [f"not imported: {len(names)} x {kind}" + (f" ({', '.join(shown[:5])}{', ...' if len(shown) > 5 else ''})" if shown else "")
                for kind, names in self.kinds.items() for shown in [[name for name in names if name]]]


def turned(axis: np.ndarray, angle: float) -> np.ndarray:
    """The rotation about a unit axis."""
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + math.sin(angle)*k + 2*math.sin(angle/2)**2*(k @ k)


def rotation_of(p) -> np.ndarray:
    """The rotation of four Euler parameters, which need not be of unit length."""
    e0, *e = np.array(p, float)/np.linalg.norm(p)
    k = np.array([[0, -e[2], e[1]], [e[2], 0, -e[0]], [-e[1], e[0], 0]])
    return np.eye(3) + 2*e0*k + 2*k @ k


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


def balanced(inertia: np.ndarray) -> np.ndarray:
    """An inertia whose largest principal moment is at most the sum of the others: otherwise all become their mean, as MuJoCo does."""
    values, axes = np.linalg.eigh(inertia)
    values = np.maximum(values, 0.0)
    if values[0] + values[1] < values[2]*(1 - 1e-9):
        values[:] = values.mean()
    return axes @ np.diag(values) @ axes.T


class Names:
    """Names of elements: letters, digits and a few signs, short, each once."""

    def __init__(self):
        self.taken = {"ground"}
        #: The next number to try, by what stands before and behind it and by its digits.
        self.numbers = {}

    def take(self, name: str, suffix: str = "", longest: int = LONGEST) -> str:
        clean = "".join(letter if letter.isascii() and (letter.isalnum() or letter in "_-") else "_" for letter in name)
        short = clean[:longest - len(suffix)] + suffix
        digits = 0
        while short in self.taken:
            digits += 1
            stem = clean[:longest - len(suffix) - digits - 1]
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


def term(value) -> str:
    """A number as an operand of an expression."""
    return f"({text_of(value)})" if value < 0 else text_of(value)


def look_text(shape, sizes, pose: Pose, centre) -> str:
    """A shape as one text: what, where from the centre of mass, how turned."""
    what = f"{shape} {sizes[0]} scale {' '.join(map(text_of, sizes[1]))}" if shape == "mesh" else \
        f"{shape} {' '.join(map(text_of, sizes))}"
    return f"{what} at {' '.join(map(text_of, pose.r - centre))} euler_parameters {' '.join(map(text_of, euler_parameters(pose.a)))}"


class Scene:
    """The text of a scene, element by element."""

    def __init__(self, name: str, source: str = "", gravity=(0, 0, -9.81), looks: bool = True, balance: bool = False):
        self.name, self.source, self.gravity, self.looks, self.balance = name, source, gravity, looks, balance
        self.names, self.lines, self.events, self.watched, self.parameters = Names(), [], [], [], {}
        #: Moment of inertia of the bodies, against which negative ones are rounding.
        self.largest = 0.0
        self.event_names, self.closes, self.sensors = Names(), False, Names()

    def add(self, table: str, name: str, keys: dict, note: str = "") -> None:
        """An element with its keys as TOML."""
        self.lines += [f"[{table}.{name}]" + (printable(f"  # {note}") if note and note != name else ""),
                       *(f"{key} = {value}" for key, value in keys.items()), ""]

    def body(self, body: Body, name: str) -> None:
        inertia = balanced(body.inertia) if self.balance else body.inertia
        values, axes = np.linalg.eigh(inertia)
        if -ROUNDING*max(values[2], self.largest) <= values[0] < 0:
            inertia = axes @ np.diag(np.maximum(values, 0.0)) @ axes.T
        # Values within rounding of zero are set to zero.
        rounding = 4*np.finfo(float).eps*np.max(np.abs(inertia))
        entries = [inertia[i, j] if abs(inertia[i, j]) > rounding else 0.0 for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        keys = {"mass": text_of(body.mass), "inertia": text_of(entries if any(entries[3:]) else entries[:3]), "position": text_of(body.place())}
        if not np.array_equal(body.pose.a, np.eye(3)):
            keys["euler_parameters"] = text_of(euler_parameters(body.pose.a))
        velocity = body.velocity + np.cross(body.omega, body.pose.a @ body.centre)
        if np.any(velocity):
            keys["velocity"] = text_of(velocity)
        if np.any(body.omega):
            keys["omega"] = text_of(body.omega)
        points = {"origin": np.zeros(3), **body.points}
        keys["points"] = "{ " + ", ".join(f"{point} = {text_of(place - body.centre)}" for point, place in points.items()) + " }"
        if self.looks and body.looks:
            keys["looks"] = "[" + ", ".join(quoted(look_text(*look, body.centre)) for look in body.looks) + "]"
        held = f"{body.name} with {', '.join(body.links[1:])}" if len(body.links) > 1 else body.name
        self.add("body", name, keys, held)

    def friction(self, joint: str, label: str, size: float) -> None:
        self.add("force", self.names.take(label, "_friction"), {"type": '"friction"', "joint": quoted(joint), "normal": text_of(size),
                                                               "dynamic": "1", "speed": text_of(CREEP)})

    def limit(self, joint: str, label: str, ends, at: float, what: str, kind: str, stiffness: float, damping: float) -> None:
        """The range of a joint that is drawn at a coordinate: events, or stops, which are springs beyond the ends with dampers that set in
        over a part of the range. `what` is angle or displacement; an end may be None."""
        lower, upper = (None if end is None else end - at for end in ends)
        if kind == "events":
            self.watched.append(joint)
            for end, value, direction in (("lower", lower, "falling"), ("upper", upper, "rising")):
                if value is not None:
                    self.events += ["[[event]]", f'name = "{self.event_names.take(joint, "_" + end)}"', f'watch = "/joints/{joint}/{what}"',
                                    f"value = {text_of(value)}", f'direction = "{direction}"', ""]
        elif kind == "stops":
            self.add("force", self.names.take(label, "_stop"), {"type": '"torsion"', "joint": quoted(joint),
                                                                "law": quoted(stop_law(lower, upper, stiffness, damping))})

    def toml(self, notes, tool: str) -> str:
        head = [printable(f"# {self.name}" + (f", from {self.source}" if self.source else "") + f", by {tool}.")]
        head += [printable(f"# {note[:1].upper()}{note[1:]}.") for note in notes]
        head += ["", "[scene]", f"description = {quoted(self.name[:80])}", 'model = "mechanism"', ""]
        if self.parameters:
            head += ["[parameters]  # the controls of actuators", *(f"{name} = {text_of(value)}" for name, value in self.parameters.items()), ""]
        head += ["[gravity]", f"vector = {text_of(self.gravity)}", ""]
        tail = ["[initial]", "assemble = true", ""] if self.closes else []
        if self.watched:
            tail += ["[results]", f"joints = [{', '.join(map(quoted, self.watched))}]", ""]
        tail += ["[time]", "end = 1.0", "", "[solver]", 'stepper = "auto"', "rtol = 1e-6", ""]
        return "\n".join([*head, *self.lines, *tail, *self.events]).rstrip("\n") + "\n"


def stop_law(lower, upper, stiffness: float, damping: float, x: str = "angle") -> str:
    """Force of stops along a coordinate, positive if it accelerates the coordinate; an end may be None."""
    onset = ONSET*(upper - lower) if lower is not None and upper is not None and upper > lower else ONSET
    parts = []
    for sign, end in ((1, lower), (-1, upper)):
        if end is None:
            continue
        beyond = f"{term(end)} - {x}" if sign > 0 else f"{x} - {term(end)}"
        parts.append(f"{'-' if sign < 0 else '+' if parts else ''}{text_of(stiffness)}*ramp({beyond})")
        if damping:
            parts.append(f"-{text_of(damping)}*smooth_step({beyond}, 0, {text_of(onset)})*rate")
    return "".join(parts)


def stop_of(solref, solimp, inverse_weight):
    """Stiffness and damping of a limit: those of MuJoCo's constraint for the inertia that it estimates."""
    inertia = 1/max(float(inverse_weight), 1e-10)
    if solref[0] <= 0:
        return -float(solref[0])*inertia, -float(solref[1])*inertia
    stiffest = max(float(solimp[1]), 1e-4)
    return inertia/(stiffest*solref[0]*max(float(solref[1]), 1e-4))**2, 2*inertia/(stiffest*solref[0])


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
