# SPDX-License-Identifier: MIT
"""A model from an MJCF file, as MuJoCo's compiler understands it, as a mechanism: the text of a scene (see doc/mechanism.md).

Bodies without joints become one with what carries them, or the ground. Each hinge and slide is a joint of its own, and bodies without mass
stand between several of one body; where nothing acts on them they become one joint. What is left out is grouped by kind.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from .markup import Budget, InputError, read_bytes
from .mjcf_actuators import RIGHT, Drives, joined
from .robots import CREEP, Body, Link, Losses, Pose, Scene, add, quoted, rotation_of, stop_of, text_of, turned

#: Limits of MuJoCo's compiler in its own process: seconds, and bytes of memory.
LONGEST = 300
MEMORY = 16*2**30
FREE, BALL, SLIDE, HINGE = range(4)
#: Largest middle angle of a gimbal (rad).
STEEPEST = 1.5
SHAPES = {2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box", 7: "mesh"}
OFF = {name: 1 << bit for bit, name in enumerate(("constraint", "equality", "friction", "limit", "contact", "spring", "damper", "gravity", "clamp"))}
OFF["actuation"] = 1 << 11


def run_mujoco(*words) -> None:
    """MuJoCo in a process of its own."""
    script = Path(__file__).with_name("mujoco_process.py")

    def limits():
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    # MuJoCo leaves its warnings in a file where it runs.
    with tempfile.TemporaryDirectory(prefix="tandem-") as folder:
        try:
            done = subprocess.run([sys.executable, str(script), *map(str, words)], cwd=folder, capture_output=True, timeout=LONGEST,
                                  stdin=subprocess.DEVNULL, preexec_fn=limits if os.name == "posix" else None, check=False)
        except subprocess.TimeoutExpired:
            raise InputError(f"{words[1]}: MuJoCo's compiler has not ended after {LONGEST} s; reduce the model") from None
    said = done.stderr.decode("utf-8", "replace").strip().splitlines()
    if done.returncode == 3:
        raise InputError(f"MJCF files are read by MuJoCo's compiler, and {sys.executable} has no package mujoco: "
                         f"{sys.executable} -m pip install mujoco")
    if done.returncode:
        raise InputError(f"{words[1]}: MuJoCo refuses it: {(said or ['its compiler crashed'])[-1][:300]}")


def compile_model(path) -> SimpleNamespace:
    """The compiled model: arrays and names."""
    read_bytes(path, Budget())
    with tempfile.TemporaryDirectory(prefix="tandem-") as folder:
        target = Path(folder) / "model.npz"
        run_mujoco("compile", Path(path).resolve(), target)
        return load_model(target)


def load_model(path) -> SimpleNamespace:
    with np.load(path) as file:
        model = SimpleNamespace(**{name: file[name] for name in file.files})
    for name, of in (("jnt_stiffnesspoly", "jnt_stiffness"), ("jnt_springyield", "jnt_stiffness"), ("dof_dampingpoly", "dof_damping"),
                     ("tendon_stiffnesspoly", "tendon_stiffness"), ("tendon_dampingpoly", "tendon_damping"), ("tendon_armature", "tendon_damping"),
                     ("tendon_springyield", "tendon_damping"), ("actuator_armature", "actuator_trntype"), ("actuator_damping", "actuator_trntype"),
                     ("jnt_actfrclimited", "jnt_type"), ("tendon_actfrclimited", "tendon_num")):
        # Older versions of MuJoCo do not have all.
        if not hasattr(model, name):
            setattr(model, name, np.zeros(len(getattr(model, of))))
    if not hasattr(model, "actuator_ctrladr"):
        model.actuator_ctrladr = np.arange(len(model.actuator_trntype))
    return model


class Joint:
    """A joint of a body: its kind, addresses, and coordinate; `element` is its name in the scene where it has one of its own."""

    def __init__(self, model, k):
        self.k, self.type = k, int(model.jnt_type[k])
        self.name = str(model.names_joint[k]) or f"joint{k}"
        self.q, self.v = int(model.jnt_qposadr[k]), int(model.jnt_dofadr[k])
        self.pos, self.axis = model.jnt_pos[k], model.jnt_axis[k]
        self.element, self.parent, self.child, self.rotor = None, None, None, None
        #: Of its angle in the scene.
        self.sign = 1


class Importer(Drives):
    """Converts a compiled model to a scene."""

    def __init__(self, model, name, source="", limits="stops", q=None, v=None, looks=True, balance=False, equalities=True,
                 stops=True):
        #: Without stops, joints are those of a model with stops.
        self.stops = stops
        self.m, self.limits, self.losses = model, limits, Losses()
        flags = int(model.disableflags)
        self.off = {word for word, bit in OFF.items() if flags & bit}
        if "constraint" in self.off:
            self.off |= {"equality", "friction", "limit", "contact"}
        if "limit" in self.off:
            self.limits = "none"
        gravity = 0*model.gravity if "gravity" in self.off else model.gravity
        self.q = np.array(model.qpos0 if q is None else q, float)
        self.rates = np.zeros(len(model.dof_damping)) if v is None else np.array(v, float)
        self.scene = Scene(name, source, gravity, looks, balance)
        self.joints = [Joint(model, k) for k in range(len(model.jnt_type))]
        self.bodies, self.places, self.elements, self.taken_dofs, self.taken_actuators = [], [], [], set(), set()
        self.with_equalities = equalities and "equality" not in self.off
        #: Joints whose coordinates sensors observe.
        self.observed = {int(of) for kind, of in zip(model.sensor_type, model.sensor_objid) if kind in (9, 10)}
        self.attached = self.find_attached() | self.observed
        self.move_bodies()
        self.name_sites()
        self.write()

    def kept(self) -> dict:
        """Arrays of the model without what the scene lacks."""
        m, found = self.m, {}

        def only(name, taken):
            array = np.array(getattr(m, name), float)
            for k in range(len(array)):
                if not taken(k):
                    array[k] = 0
            found[name] = array

        only("jnt_stiffness", lambda k: ("spring", k) in self.taken_dofs)
        for name, what in (("dof_damping", "damping"), ("dof_armature", "armature"), ("tendon_stiffness", "tendon_spring"),
                           ("tendon_damping", "tendon_damping"), ("tendon_armature", "tendon_armature")):
            only(name, lambda k, what=what: (what, k) in self.taken_dofs)
        for name in ("actuator_gainprm", "actuator_biasprm"):
            only(name, lambda k: k in self.taken_actuators)
        for name in ("jnt_stiffnesspoly", "dof_dampingpoly", "dof_frictionloss", "tendon_stiffnesspoly", "tendon_dampingpoly",
                     "actuator_armature", "actuator_damping", "jnt_actfrclimited", "tendon_actfrclimited"):
            only(name, lambda k: False)
        return found

    def friction_at(self, rates) -> np.ndarray:
        """Generalised friction forces of joints at rates (states, dofs), and of tendons, by the law of the scene."""
        m, force = self.m, np.zeros(rates.shape)
        for k in range(rates.shape[1]):
            if ("friction", k) in self.taken_dofs:
                force[:, k] -= m.dof_frictionloss[k]*np.tanh(4*rates[:, k]/CREEP)
        for k in range(len(m.tendon_num)):
            if ("tendon_friction", k) in self.taken_dofs:
                wraps = range(int(m.tendon_adr[k]), int(m.tendon_adr[k] + m.tendon_num[k]))
                factors = {self.joints[int(m.wrap_objid[w])].v: float(m.wrap_prm[w]) for w in wraps}
                size = m.tendon_frictionloss[k]*np.tanh(4*sum(factor*rates[:, v] for v, factor in factors.items())/CREEP)
                for v, factor in factors.items():
                    force[:, v] -= factor*size
        return force

    def toml(self) -> str:
        return self.scene.toml(self.losses.lines(), "tandem import")

    # --- bodies and joints ----------------------------------------------------------------------------------------------

    def find_attached(self) -> set:
        """Joints on which something acts."""
        m, found = self.m, set()
        for joint in self.joints:
            if joint.type in (FREE, BALL):
                continue
            if m.jnt_stiffness[joint.k] or m.dof_damping[joint.v] or m.dof_armature[joint.v] or m.dof_frictionloss[joint.v] \
                    or (m.jnt_limited[joint.k] and self.limits != "none"):
                found.add(joint.k)
        found |= {int(m.actuator_trnid[i, 0]) for i in range(len(m.actuator_trntype)) if m.actuator_trntype[i] in (0, 1)}
        found |= {int(end) for i in range(len(m.eq_type)) if m.eq_type[i] == 2 for end in (m.eq_obj1id[i], m.eq_obj2id[i])}
        found |= {int(of) for kind, of in zip(m.wrap_type, m.wrap_objid) if kind == 1}
        return found

    def move_bodies(self) -> None:
        """Frames of all bodies with their joints one after the other, as MuJoCo moves them."""
        m = self.m
        ground = Body("ground", ["world"], Pose())
        self.places = [(ground, Pose())]
        for b in range(1, len(m.body_parentid)):
            parent, carried = self.places[m.body_parentid[b]]
            rest = Pose(m.body_pos[b], rotation_of(m.body_quat[b]))
            name = str(m.names_body[b]) or f"body{b}"
            own = self.joints[m.body_jntadr[b]:m.body_jntadr[b] + m.body_jntnum[b]] if m.body_jntnum[b] else []
            if not own:
                if m.body_mocapid[b] >= 0:
                    self.losses.add("bodies moved by the user (mocap), held in place", name)
                body, pose = parent, carried @ rest
                body.links.append(name)
            else:
                body, pose = self.move(name, own, parent, carried @ rest), Pose()
            self.places.append((body, pose))
            link = Link(name, float(m.body_mass[b]), m.body_ipos[b], self.inertia_of(b), self.looks_of(b))
            if body is not ground:
                add(body, link, pose)
        for body in self.bodies:
            if not np.any(body.inertia) and body.mass == 0 and body.links != ["between"]:
                body.inertia = np.zeros((3, 3))

    def inertia_of(self, b) -> np.ndarray:
        a = rotation_of(self.m.body_iquat[b])
        return a @ np.diag(self.m.body_inertia[b]) @ a.T

    def move(self, name, joints, parent, rest) -> Body:
        """The body behind joints, and those without mass between them; velocities are of the origins of frames until bodies are written."""
        here = parent.pose @ rest
        start, velocity = here, parent.velocity + np.cross(parent.omega, here.r - parent.pose.r)
        omega, before = parent.omega, parent
        one = None
        if len(joints) > 1:
            acts = any(joint.k in self.attached for joint in joints)
            one = self.angled(joints, rest, parent) if acts else joined(joints, rest, parent)
        for joint in joints:
            q, rate = self.q[joint.q:joint.q + 7], self.rates[joint.v:joint.v + 6]
            anchor, axis = here.r + here.a @ joint.pos, here.a @ joint.axis
            if joint.type == FREE:
                here = Pose(q[:3], rotation_of(q[3:7]))
                velocity, omega = rate[:3], here.a @ rate[3:6]
            elif joint.type == SLIDE:
                way = q[0] - self.m.qpos0[joint.q]
                velocity = velocity + np.cross(omega, axis*way) + rate[0]*axis
                here = Pose(here.r + axis*way, here.a)
            else:
                at_anchor = velocity + np.cross(omega, anchor - here.r)
                if joint.type == BALL:
                    a = here.a @ rotation_of(q[:4])
                    omega = omega + a @ rate[:3]
                else:
                    a, omega = here.a @ turned(joint.axis, q[0] - self.m.qpos0[joint.q]), omega + rate[0]*axis
                here = Pose(anchor - a @ joint.pos, a)
                velocity = at_anchor + np.cross(omega, here.r - anchor)
            if joint is joints[-1] or one is not None or joint.type == FREE:
                continue
            # A body without mass at the anchor.
            at = anchor if joint.type != SLIDE else here.r
            between = Body(f"{name}_{joint.name}", ["between"], Pose(at, here.a), velocity=velocity + np.cross(omega, at - here.r), omega=omega)
            self.bodies.append(between)
            self.connect(joint, before, between, anchor, axis)
            before = between
        body = Body(name, [name], here, velocity=velocity, omega=omega)
        self.bodies.append(body)
        if one is not None:
            self.elements.append((joints[0], parent, body, one(start, here)))
        else:
            self.connect(joints[-1], before, body, anchor, axis)
        return body

    def angled(self, joints, rest, parent):
        """A universal joint or a gimbal, on whose angles forces act: a procedure as of `joined`; None if the joints follow each other."""
        m = self.m
        turns = [joint for joint in joints if joint.type == HINGE]
        if len(turns) != len(joints) or len(joints) not in (2, 3) or any(np.linalg.norm(joint.pos - turns[0].pos) > 1e-12 for joint in turns) \
                or any(joint.k in self.observed for joint in joints) or max(abs(one.axis @ two.axis) for one, two in zip(turns, turns[1:])) > RIGHT:
            return None
        if len(turns) == 3:
            # The angle between the axes of the first and the last must stay away from its singularity.
            triple = np.cross(turns[2].axis, turns[0].axis) @ turns[1].axis
            middle = turns[1]
            lower, upper = m.jnt_range[middle.k] - m.qpos0[middle.q]
            zero = np.arcsin(np.clip(turns[0].axis @ turns[2].axis, -1, 1))*(1 if triple > 0 else -1)
            now = self.q[middle.q] - m.qpos0[middle.q] + zero
            if not m.jnt_limited[middle.k] or self.limits != "stops" or max(abs(lower + zero), abs(upper + zero), abs(now)) > STEEPEST:
                return None
        name = self.scene.names.take(turns[0].name, "", 50)
        for k, joint in enumerate(turns):
            joint.element, joint.rotor = f"{name}.angle{k + 1}", self.scene.names.take(joint.name, "_rotor")
        if len(turns) == 3 and triple < 0:
            # A gimbal rotates about across x axis in the middle.
            turns[2].sign = -1
        first = parent.pose.a @ rest.a

        def made(_, end):
            return {"type": quoted("universal" if len(turns) == 2 else "gimbal"), "at": text_of(end.r + end.a @ turns[0].pos),
                    "axis": text_of(first @ turns[0].axis), "across": text_of(turns[-1].sign*(end.a @ turns[-1].axis)), "name": name}

        return made

    def connect(self, joint, parent, body, anchor, axis) -> None:
        joint.parent, joint.child = parent, body
        if joint.type != FREE:
            kind = {BALL: "spherical", SLIDE: "prismatic", HINGE: "revolute"}[joint.type]
            self.elements.append((joint, parent, body, {"type": quoted(kind), "at": text_of(anchor),
                                                        **({} if joint.type == BALL else {"axis": text_of(axis)})}))

    def looks_of(self, b) -> list:
        m, found = self.m, []
        for k in np.flatnonzero((m.geom_bodyid == b) & (m.geom_group < 3)):
            kind, size = SHAPES.get(int(m.geom_type[k])), [float(x) for x in m.geom_size[k]]
            pose = Pose(m.geom_pos[k], rotation_of(m.geom_quat[k]))
            if kind == "sphere":
                found.append(("sphere", size[:1], pose))
            elif kind in ("capsule", "cylinder"):
                found.append(("cylinder", [size[0], 2*size[1]], pose))
                if kind == "capsule":
                    found += [("sphere", size[:1], pose @ Pose(np.array([0, 0, end*size[1]]))) for end in (-1, 1)]
            elif kind in ("box", "ellipsoid"):
                found.append(("box", [2*x for x in size], pose))
            elif kind == "mesh" and m.geom_dataid[k] >= 0:
                mesh = int(m.geom_dataid[k])
                inner = Pose(m.mesh_pos[mesh], rotation_of(m.mesh_quat[mesh]))
                if str(m.names_mesh[mesh]):
                    found.append(("mesh", (str(m.names_mesh[mesh]), m.mesh_scale[mesh]), pose @ inner.inverse()))
        return found

    def name_sites(self) -> None:
        """Sites that sensors observe become named points of their bodies."""
        m = self.m
        self.site_point = {}
        for s in sorted({int(of) for kind, of in zip(m.sensor_objtype, m.sensor_objid) if kind == 6}):
            body, pose = self.places[m.site_bodyid[s]]
            if body.name == "ground":
                continue
            clean = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in str(m.names_site[s]) or f"site{s}")[:40]
            point = clean if clean[:1].isalpha() else f"s_{clean}"
            while point in body.points or point == "origin":
                point += "_"
            body.points[point] = pose.r + pose.a @ m.site_pos[s]
            self.site_point[s] = point

    # --- the scene ------------------------------------------------------------------------------------------------------

    def write(self) -> None:
        if not self.bodies:
            raise InputError("nothing moves: no body has a joint")
        scene = self.scene
        self.body_name = {id(body): scene.names.take(body.name) for body in self.bodies}
        scene.largest = max(float(np.max(np.abs(body.inertia))) for body in self.bodies)
        for body in self.bodies:
            scene.body(body, self.body_name[id(body)])
        for joint, parent, body, keys in self.elements:
            name = keys.pop("name", None) or scene.names.take(joint.name, "", 57)
            keys = {"type": keys["type"], "bodies": f"[{quoted(self.name_of(parent))}, {quoted(self.name_of(body))}]", **keys}
            if joint.child is not None and joint.type in (SLIDE, HINGE):
                joint.element = name
                if self.m.dof_armature[joint.v]:
                    keys["rotor_inertia"] = text_of(self.m.dof_armature[joint.v])
                    scene.names.taken.add(f"{name}_rotor")
                    self.taken_dofs.add(("armature", joint.v))
            scene.add("joint", name, keys, joint.name)
        for joint in self.joints:
            if joint.rotor is not None and self.m.dof_armature[joint.v]:
                scene.add("constraint", joint.rotor, {"type": '"coupling"', "joints": f"[{quoted(joint.element)}]", "factors": "[1]",
                                                      "inertia": text_of(self.m.dof_armature[joint.v])})
                self.taken_dofs.add(("armature", joint.v))
        self.passive_forces()
        self.compensate_gravity()
        self.tendons()
        self.actuators()
        if self.with_equalities:
            self.equalities()
        self.write_sensors()
        self.count_losses()

    def name_of(self, body) -> str:
        return self.body_name.get(id(body), "ground")

    def point_text(self, b, place) -> str:
        """A point given in the frame of a body of the file."""
        body, pose = self.places[b]
        return f"{self.name_of(body)}:{text_of(pose.r + pose.a @ place - body.centre*(body.name != 'ground'))}"

    def passive_forces(self) -> None:
        m, scene = self.m, self.scene
        for joint in self.joints:
            dofs = slice(joint.v, joint.v + {FREE: 6, BALL: 3}.get(joint.type, 1))
            stiffness = 0.0 if "spring" in self.off else float(m.jnt_stiffness[joint.k])
            damping = 0.0 if "damper" in self.off else float(m.dof_damping[joint.v])
            if np.any(m.jnt_stiffnesspoly[joint.k]) or m.jnt_springyield[joint.k] or np.any(m.dof_dampingpoly[dofs]):
                self.losses.add("nonlinear springs or dampers of joints", joint.name)
            if joint.type in (FREE, BALL):
                self.free_forces(joint, stiffness, damping, dofs)
                continue
            if joint.element is None:
                continue
            at, label = self.q[joint.q], joint.name
            keys = {}
            if stiffness:
                keys |= {"stiffness": text_of(stiffness), "angle": text_of(joint.sign*(m.qpos_spring[joint.q] - at))}
            if damping:
                keys["damping"] = text_of(damping)
            if keys:
                scene.add("force", scene.names.take(label, "_spring"), {"type": '"torsion"', "joint": quoted(joint.element), **keys})
                self.taken_dofs |= {("spring", joint.k), ("damping", joint.v)}
            if m.dof_frictionloss[joint.v] and "friction" not in self.off:
                scene.friction(joint.element, label, m.dof_frictionloss[joint.v])
                self.taken_dofs.add(("friction", joint.v))
            if m.jnt_limited[joint.k] and self.limits != "none" and self.stops:
                ends = m.jnt_range[joint.k] - at
                scene.limit(joint.element, label, sorted(joint.sign*ends), 0.0, "displacement" if joint.type == SLIDE else "angle", self.limits,
                            *stop_of(m.jnt_solref[joint.k], m.jnt_solimp[joint.k], m.dof_invweight0[joint.v]))

    def free_forces(self, joint, stiffness, damping, dofs) -> None:
        """Forces of ball joints and of free ones."""
        m, scene = self.m, self.scene
        if stiffness:
            self.losses.add("springs of ball joints and free joints", joint.name)
        if np.any(m.dof_armature[dofs]):
            self.losses.add("armatures of ball joints and free joints", joint.name)
        if np.any(m.dof_frictionloss[dofs]):
            self.losses.add("friction of ball joints and free joints", joint.name)
        if m.jnt_limited[joint.k] and self.limits != "none":
            self.losses.add("limits of ball joints", joint.name)
        if not damping:
            return
        if joint.type == FREE or joint.child is None:
            self.losses.add("damping of free joints", joint.name)
            return
        # The torque is that of the relative angular velocity, whatever the axes.
        ends = [self.name_of(end) for end in (joint.parent, joint.child)]
        for end, other in (ends, ends[::-1]):
            if end != "ground":
                rate = [f"{end}.w{axis}" + (f" - {other}.w{axis}" if other != "ground" else "") for axis in "xyz"]
                scene.add("force", scene.names.take(joint.name, "_damper"), {
                    "type": '"load"', "on": quoted(end), "torque": f"[{', '.join(quoted(f'-{text_of(damping)}*({text})') for text in rate)}]"})
        self.taken_dofs |= {("damping", joint.v + k) for k in range(3)}

    def compensate_gravity(self) -> None:
        for b in np.flatnonzero(self.m.body_gravcomp):
            body, _ = self.places[b]
            if body.name != "ground":
                force = -self.m.body_gravcomp[b]*self.m.body_mass[b]*np.array(self.scene.gravity)
                self.scene.add("force", self.scene.names.take(str(self.m.names_body[b]) or f"body{b}", "_gravcomp"), {
                    "type": '"load"', "on": quoted(self.point_text(b, self.m.body_ipos[b])), "force": text_of(force)})

    def count_losses(self) -> None:
        m = self.m
        if "contact" not in self.off:
            for k in np.flatnonzero((m.geom_contype != 0) | (m.geom_conaffinity != 0)):
                self.losses.add("geoms that make contact")
        if m.density or m.viscosity:
            self.losses.add("surrounding medium (density, viscosity)")
        for _ in range(int(m.nflex)):
            self.losses.add("flexible bodies")

    def write_sensors(self) -> None:
        m, scene = self.m, self.scene
        for i, (kind, of) in enumerate(zip(m.sensor_type, m.sensor_objid)):
            name = str(m.names_sensor[i]) or f"sensor{i}"
            on = int(m.sensor_objtype[i])
            place = None
            if kind in (9, 10) and self.joints[of].element and self.joints[of].rotor is None:
                place = ("joint", self.joints[of].element)
            elif kind in (1, 2, 26, 31, 33) and on == 6 and int(of) in self.site_point:
                body, _ = self.places[m.site_bodyid[of]]
                place = ("point", f"{self.name_of(body)}.{self.site_point[int(of)]}")
            elif kind in (26, 27, 28, 29, 30, 31, 32, 33, 34) and on in (1, 2) and self.places[of][0].name != "ground":
                place = ("body", self.name_of(self.places[of][0]))
            elif kind in (3, 27, 28, 29, 30, 32, 34) and on == 6 and self.places[m.site_bodyid[of]][0].name != "ground":
                place = ("body", self.name_of(self.places[m.site_bodyid[of]][0]))
            elif kind in (43, 44):
                place = ("energy", True)
            if place is None:
                self.losses.add("sensors without an equivalent", name)
                continue
            scene.add("sensor", scene.sensors.take(name), {place[0]: "true" if place[1] is True else quoted(place[1])}, name)


def convert(path, *, limits="stops", at=None, key=None, looks=True, balance=False) -> Importer:
    """The scene of a file, with what it lacks."""
    model = compile_model(path)
    q, v = model.qpos0.copy(), np.zeros(len(model.dof_damping))
    if key is not None:
        names = [str(name) for name in model.names_key]
        if key not in names and not (key.isdigit() and int(key) < len(names)):
            raise InputError(f"there is no keyframe {key}; " + (f"use one of {', '.join(names[:10])}" if names else "the file has none"))
        k = names.index(key) if key in names else int(key)
        q, v = model.key_qpos[k].copy(), model.key_qvel[k].copy()
    for name, value in (at or {}).items():
        found = [k for k, other in enumerate(model.names_joint) if str(other) == name and model.jnt_type[k] in (SLIDE, HINGE)]
        if not found:
            raise InputError(f"no joint {name} rotates or slides; correct the name")
        q[model.jnt_qposadr[found[0]]] = value
    made = Importer(model, Path(path).stem, Path(path).name, limits, q, v, looks, balance)
    if key is not None and len(model.key_ctrl):
        for i, name in made.controls.items():
            made.scene.parameters[name] = float(model.key_ctrl[k][i])
    return made
