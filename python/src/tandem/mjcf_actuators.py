# SPDX-License-Identifier: MIT
"""What drives and couples the joints of an MJCF model: tendons, actuators, equalities; and joints that stand for several."""

from __future__ import annotations

import numpy as np

from .robots import Pose, quoted, rotation_of, stop_law, stop_of, term, text_of

#: Cosines below this are right angles.
RIGHT = 1e-9
FREE, BALL, SLIDE, HINGE = range(4)
#: Joints of a coupling.
MOST_COUPLED = 8
#: A kind of losses.
SUM_LIMITS = "limits of the sum of actuator forces on a joint or a tendon"


def joined(joints, rest, parent):
    """A joint that stands for all joints of a body: a procedure that makes its keys from the frames of the body before and behind them;
    None if there is no such joint."""
    slides = [joint for joint in joints if joint.type == SLIDE]
    turns = [joint for joint in joints if joint.type == HINGE]
    if list(joints) != slides + turns or not turns or any(np.linalg.norm(joint.pos - turns[0].pos) > 1e-12 for joint in turns):
        return None
    first = parent.pose.a @ rest.a

    def anchor(end):
        return end.r + end.a @ turns[0].pos

    if not slides and len(turns) == 3 and abs(np.linalg.det([joint.axis for joint in turns])) > 0.1:
        return lambda _, end: {"type": quoted("spherical"), "at": text_of(anchor(end))}
    if not slides and len(turns) == 2 and abs(turns[0].axis @ turns[1].axis) < RIGHT:
        return lambda _, end: {"type": quoted("universal"), "at": text_of(anchor(end)), "axis": text_of(first @ turns[0].axis),
                               "across": text_of(end.a @ turns[1].axis)}
    if len(slides) in (1, 2) and len(turns) == 1:
        across = [abs(joint.axis @ turns[0].axis) for joint in slides]
        if len(slides) == 2 and max(*across, abs(slides[0].axis @ slides[1].axis)) < RIGHT:
            return lambda _, end: {"type": quoted("planar"), "at": text_of(anchor(end)), "axis": text_of(first @ turns[0].axis)}
        if len(slides) == 1 and abs(across[0] - 1) < RIGHT:
            return lambda _, end: {"type": quoted("cylindrical"), "at": text_of(anchor(end)), "axis": text_of(first @ turns[0].axis)}
    return None


class Drives:
    """Part of the importer of `mjcf`."""

    def tendons(self) -> None:
        """Tendons on which something acts. A fixed one is a sum of joint coordinates with a coordinate of its own."""
        m = self.m
        self.sums, self.springs = {}, {}
        driven = {int(m.actuator_trnid[i, 0]) for i in range(len(m.actuator_trntype)) if m.actuator_trntype[i] == 3}
        for k in range(len(m.tendon_num)):
            name = str(m.names_tendon[k]) or f"tendon{k}"
            limited = bool(m.tendon_limited[k]) and self.limits != "none" and self.stops
            acts = any((m.tendon_stiffness[k], m.tendon_damping[k], m.tendon_armature[k], m.tendon_frictionloss[k], k in driven, limited))
            if not acts:
                continue
            if np.any(m.tendon_stiffnesspoly[k]) or np.any(m.tendon_dampingpoly[k]) or m.tendon_springyield[k]:
                self.losses.add("nonlinear springs or dampers of tendons", name)
            wraps = range(int(m.tendon_adr[k]), int(m.tendon_adr[k] + m.tendon_num[k]))
            kinds = [int(m.wrap_type[w]) for w in wraps]
            if set(kinds) == {1}:
                self.fixed_tendon(k, name, wraps, limited)
            elif kinds == [3, 3] and not m.tendon_armature[k] and not m.tendon_frictionloss[k]:
                self.span(k, name, [int(m.wrap_objid[w]) for w in wraps], limited)
            else:
                self.losses.add("tendons along several sites, or around bodies", name)

    def sum_of(self, wraps):
        """Joints and factors of a fixed tendon, and its length in the drawing."""
        m = self.m
        terms, length = {}, 0.0
        for w in wraps:
            joint = self.joints[int(m.wrap_objid[w])]
            terms[joint.element] = terms.get(joint.element, 0.0) + joint.sign*float(m.wrap_prm[w])
            length += float(m.wrap_prm[w])*self.q[joint.q]
        return {joint: factor for joint, factor in terms.items() if factor}, length

    def coupled(self, name, terms, keys) -> str:
        """A coupling of any number of joints: sums of eight at a time are joints of their own."""
        scene, terms = self.scene, dict(terms)
        while len(terms) > MOST_COUPLED:
            part = dict(list(terms.items())[:MOST_COUPLED])
            inner = self.coupled(f"{name}_part", part, {"inertia": "0"})
            terms = {**{joint: factor for joint, factor in terms.items() if joint not in part}, inner: 1.0}
        taken = scene.names.take(name)
        scene.add("constraint", taken, {"type": '"coupling"', "joints": f"[{', '.join(map(quoted, terms))}]",
                                        "factors": text_of(list(terms.values())), **keys}, name)
        return taken

    def fixed_tendon(self, k, name, wraps, limited) -> None:
        m, scene = self.m, self.scene
        terms, length = self.sum_of(wraps)
        if not terms:
            return
        coordinate = self.coupled(name, terms, {"inertia": text_of(m.tendon_armature[k])})
        self.sums[k] = coordinate, length
        self.taken_dofs |= {(what, k) for what in ("tendon_spring", "tendon_damping", "tendon_armature")}
        stiffness = 0.0 if "spring" in self.off else float(m.tendon_stiffness[k])
        damping = 0.0 if "damper" in self.off else float(m.tendon_damping[k])
        low, high = m.tendon_lengthspring[k]
        keys = {"damping": text_of(damping)} if damping else {}
        if stiffness and low == high:
            keys |= {"stiffness": text_of(stiffness), "angle": text_of(low - length)}
        elif stiffness:
            keys["law"] = quoted(stop_law(low - length, high - length, stiffness, 0))
        if keys:
            scene.add("force", scene.names.take(name, "_spring"), {"type": '"torsion"', "joint": quoted(coordinate), **keys})
        if m.tendon_frictionloss[k] and "friction" not in self.off:
            scene.friction(coordinate, name, m.tendon_frictionloss[k])
            self.taken_dofs.add(("tendon_friction", k))
        if limited:
            self.limit_tendon(k, name, coordinate, length)

    def limit_tendon(self, k, name, coordinate, length) -> None:
        m = self.m
        if self.limits == "stops":
            self.scene.limit(coordinate, name, m.tendon_range[k], length, "displacement", "stops",
                             *stop_of(m.tendon_solref_lim[k], m.tendon_solimp_lim[k], m.tendon_invweight0[k]))
        else:
            self.losses.add("limits of tendons", name)

    def span(self, k, name, sites, limited) -> None:
        """A tendon between two sites is a spring."""
        m, scene = self.m, self.scene
        ends = [self.point_text(m.site_bodyid[s], m.site_pos[s]) for s in sites]
        if self.places[m.site_bodyid[sites[0]]][0] is self.places[m.site_bodyid[sites[1]]][0]:
            return
        stiffness = 0.0 if "spring" in self.off else float(m.tendon_stiffness[k])
        damping = 0.0 if "damper" in self.off else float(m.tendon_damping[k])
        low, high = m.tendon_lengthspring[k]
        keys = {"type": '"spring"', "between": f"[{', '.join(map(quoted, ends))}]"}
        laws = []
        if damping:
            keys["damping"] = text_of(damping)
        if stiffness and low == high:
            keys |= {"stiffness": text_of(stiffness), "length": text_of(low)}
        elif stiffness:
            laws.append(f"{text_of(stiffness)}*ramp(length - {term(high)})" + (f"-{text_of(stiffness)}*ramp({term(low)} - length)" if low > 0 else ""))
        if limited and self.limits == "stops":
            stiff, damp = stop_of(m.tendon_solref_lim[k], m.tendon_solimp_lim[k], m.tendon_invweight0[k])
            lower, upper = m.tendon_range[k]
            laws.append(f"-({stop_law(lower if lower > 0 else None, upper, stiff, damp, 'length')})")
        elif limited:
            self.losses.add("limits of tendons", name)
        self.taken_dofs |= {(what, k) for what in ("tendon_spring", "tendon_damping")}
        self.springs[k] = keys, laws, name
        if laws:
            keys["law"] = quoted("+".join(laws).replace("+-", "-"))
        if len(keys) > 2:
            scene.add("force", scene.names.take(name, "_spring"), keys)

    # --- actuators ------------------------------------------------------------------------------------------------------

    def actuators(self) -> None:
        self.controls = {}
        m = self.m
        if "actuation" in self.off:
            return
        for i in range(len(m.actuator_trntype)):
            name = str(m.names_actuator[i]) or f"actuator{i}"
            force = self.force_of(i, name)
            reason = "actuators of an unsupported kind" if force is None else self.transmit(i, name, *force)
            if reason:
                self.losses.add(reason, name)
            else:
                self.taken_actuators.add(i)

    def force_of(self, i, name):
        """The name of the control, gain and bias: three numbers each, for 1, length and velocity; None for kinds that are not supported."""
        m = self.m
        if m.actuator_gaintype[i] > 1 or m.actuator_biastype[i] > 1 or m.actuator_dyntype[i] > 3 or m.actuator_armature[i] \
                or m.actuator_damping[i].any():
            return None
        gain = np.array(m.actuator_gainprm[i][:3])*([1, 0, 0] if m.actuator_gaintype[i] == 0 else 1)
        bias = np.array(m.actuator_biasprm[i][:3])*(m.actuator_biastype[i] == 1)
        if m.actuator_dyntype[i] > 0:
            self.losses.add("dynamics of activations; the control acts at once", name)
        return gain, bias

    def law_of(self, i, name, gain, bias, gear, at, x):
        """The force along a coordinate x whose value in the drawing is `at`: gear (gain u + bias) of the length gear x."""
        m = self.m
        control = self.scene.names.take("".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in f"ctrl_{name}"), "", 60)
        self.scene.names.taken.discard(control)
        while control in self.scene.parameters:
            control += "_"
        self.scene.parameters[control] = 0.0
        self.controls[int(m.actuator_ctrladr[i])] = control

        def affine(numbers):
            parts = [text_of(numbers[0])] if numbers[0] else []
            if numbers[1]:
                parts.append(f"{term(numbers[1]*gear)}*({x} + {term(at)})" if at else f"{term(numbers[1]*gear)}*{x}")
            if numbers[2]:
                parts.append(f"{term(numbers[2]*gear)}*rate")
            return " + ".join(parts) or "0"

        text = f"({affine(gain)})*{control}" + (f" + {affine(bias)}" if np.any(bias) else "")
        if m.actuator_forcelimited[i]:
            low, high = m.actuator_forcerange[i]
            text = f"min(max({text}, {term(low)}), {term(high)})"
        return f"{term(gear)}*({text})"

    def transmit(self, i, name, gain, bias):
        """Write an actuator; why it is left out, if it is."""
        m, scene = self.m, self.scene
        kind, of, gear = int(m.actuator_trntype[i]), int(m.actuator_trnid[i, 0]), float(m.actuator_gear[i, 0])
        sign = 1
        if kind == 3 and m.tendon_actfrclimited[of]:
            self.losses.add(SUM_LIMITS, str(m.names_tendon[of]))
        if kind in (0, 1) and self.joints[of].element:
            joint = self.joints[of]
            if m.jnt_actfrclimited[of]:
                self.losses.add(SUM_LIMITS, joint.name)
            coordinate, at, sign = joint.element, joint.sign*self.q[joint.q], joint.sign
        elif kind == 3 and of in self.sums:
            coordinate, at = self.sums[of]
        elif kind == 3 and of in self.springs:
            keys, _, _ = self.springs[of]
            law = self.law_of(i, name, gain, bias, gear, 0.0, "length")
            scene.add("force", scene.names.take(name, "_motor"), {"type": keys["type"], "between": keys["between"], "law": quoted(f"-({law})")})
            return None
        elif kind == 4 and m.actuator_trnid[i, 1] < 0 and not np.any(gain[1:]) and not np.any(bias):
            return self.wrench(i, name, gain, of)
        else:
            return {4: "actuators of sites with a reference or a bias", 5: "actuators of contacts"}.get(kind, "actuators of ball, free or other joints")
        scene.add("force", scene.names.take(name, "_motor"), {"type": '"torsion"', "joint": quoted(coordinate), "law": quoted(
            self.law_of(i, name, gain, bias, sign*gear, at, "angle"))})
        return None

    def wrench(self, i, name, gain, site):
        """Force and torque in the frame of a site."""
        m = self.m
        body, pose = self.places[m.site_bodyid[site]]
        if body.name == "ground" or m.actuator_forcelimited[i]:
            return "actuators of sites with a reference or a bias"
        a = (pose @ Pose(np.zeros(3), rotation_of(m.site_quat[site]))).a
        factor = self.law_of(i, name, np.array([1.0, 0, 0]), np.zeros(3), 1.0, 0.0, "t")
        gear = m.actuator_gear[i]*gain[0]
        self.scene.add("force", self.scene.names.take(name, "_motor"), {
            "type": '"load"', "on": quoted(self.point_text(m.site_bodyid[site], m.site_pos[site])), "force": text_of(a @ gear[:3]),
            "torque": text_of(a @ gear[3:]), "in_body": "true", "factor": quoted(factor)})
        return None

    # --- equalities -----------------------------------------------------------------------------------------------------

    def equalities(self) -> None:
        m = self.m
        for k in np.flatnonzero(m.eq_active0):
            name = str(m.names_equality[k]) or f"equality{k}"
            kind = int(m.eq_type[k])
            if kind in (0, 1):
                self.loop(k, kind, name)
            elif kind in (2, 3):
                self.couple(k, kind, name)
            else:
                self.losses.add("equalities of an unsupported kind", name)

    def loop(self, k, kind, name) -> None:
        """A joint between points of two bodies, which MuJoCo holds by springs. So does the scene if the user moves one of them: the other
        one need not be able to follow exactly."""
        m = self.m
        data, ids = m.eq_data[k], (int(m.eq_obj1id[k]), int(m.eq_obj2id[k]))
        if m.eq_objtype[k] == 6:
            bodies, points = [int(m.site_bodyid[s]) for s in ids], [m.site_pos[s] for s in ids]
        else:
            bodies = [max(end, 0) for end in ids]
            # A connection has both anchors, a weld that in the second body.
            points = [data[:3], data[3:6]] if kind == 0 else [rotation_of(data[6:10]) @ data[:3] + data[3:6], data[:3]]
        one, two = (self.places[b] for b in bodies)
        if one[0] is two[0]:
            self.losses.add("equalities within one body", name)
            return
        if kind == 1 and m.eq_objtype[k] != 6:
            frames = [body.pose @ pose for body, pose in (one, two)]
            if np.abs(frames[0].a.T @ frames[1].a - rotation_of(data[6:10])).max() > 1e-6:
                self.losses.add("relative rotations of welds, which hold that of the drawing", name)
        texts = [quoted(self.point_text(b, point)) for b, point in zip(bodies, points)]
        if any(m.body_mocapid[b] >= 0 for b in bodies):
            along, about = (stop_of(m.eq_solref[k], m.eq_solimp[k], sum(m.body_invweight0[b][i] for b in bodies)) for i in (0, 1))
            parts = 3*[along] + 3*[about if kind == 1 else (0.0, 0.0)]
            self.scene.add("force", self.scene.names.take(name), {"type": '"bushing"', "between": f"[{', '.join(texts)}]", **{
                key: text_of([part[j] for part in parts]) for j, key in enumerate(("stiffness", "damping"))}})
            return
        self.scene.add("joint", self.scene.names.take(name), {"type": quoted("spherical" if kind == 0 else "fixed"), "bodies": f"[{', '.join(texts)}]"})
        self.scene.closes = True

    def couple(self, k, kind, name) -> None:
        """y - y0 = a0 + a1 (x - x0) of joints or of tendons."""
        m = self.m
        data, sums = m.eq_data[k], []
        if np.any(data[2:5]):
            self.losses.add("nonlinear equalities of joints and tendons", name)
            return
        for end in (int(m.eq_obj1id[k]), int(m.eq_obj2id[k])):
            if end < 0:
                continue
            if kind == 2:
                joint = self.joints[end]
                sums.append(({joint.element: float(joint.sign)}, self.q[joint.q] - m.qpos0[joint.q]) if joint.element else (None, 0))
            else:
                wraps = range(int(m.tendon_adr[end]), int(m.tendon_adr[end] + m.tendon_num[end]))
                if any(m.wrap_type[w] != 1 for w in wraps):
                    sums.append((None, 0))
                else:
                    terms, length = self.sum_of(wraps)
                    sums.append((terms, length - m.tendon_length0[end]))
        if any(terms is None for terms, _ in sums):
            self.losses.add("equalities of other joints or tendons", name)
            return
        terms, away = dict(sums[0][0]), sums[0][1] - data[0]
        if len(sums) > 1 and data[1]:
            for joint, factor in sums[1][0].items():
                terms[joint] = terms.get(joint, 0.0) - data[1]*factor
            away -= data[1]*sums[1][1]
        terms = {joint: factor for joint, factor in terms.items() if factor}
        if not terms:
            return
        keys = {}
        if abs(away) > 1e-12:
            keys["motion"] = text_of(-away)
            self.scene.closes = True
        self.coupled(name, terms, keys)
