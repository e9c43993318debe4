# SPDX-License-Identifier: MIT
"""Makes scenes of mechanisms from a grammar: elements of every type with the keys of their type, most values of which make sense,
so that definitions are tried together and not only read. Some are right, many are impossible: wheels
off their planes, loops that contradict each other, masses of 0, numbers at the ends of the range."""

JOINTS = "revolute prismatic fixed primitive point_on_line cylindrical spherical universal screw planar point_on_plane".split()
WHEELS = ["knife_edge", "disk", "sphere", "ellipsoid", "massless"]
NUMBERS = "0 1 -1 0.5 2.0 1e-3 1e3 -0.25 1e-9 1e9 1e300 -1e300 1e-300 5e-324 nan inf".split()
TEXTS = ['"a"', '"2*a"', '"b - a"', '"a/c"', '"sqrt(-a)"', '"sin(a)*pi"', '"1/0"', '"nope"', '"2*"', '"t"', '"c^c^c^c"', '""']
TIMES = ['"sin(t)"', '"0.1*t"', '"0"', '"step(t - 0.5)"', '"abs(sin(9*t))"', '"1/t"', '"sqrt(t - 1)"', '"t^300"', '"table"', '"a"']
STATES = ['"bob.x"', '"rod.vy"', '"-rod.vx^3"', '"pin.angle"', '"1/bob.x"', '"sqrt(rod.y)"', '"exp(bob.x*1e3)"', '"a*t"']
POINTS = ['"bob"', '"rod"', '"arm"', '"ground"'] * 5 + ['"rod.tip"', '"rod:[0, 1, 0]"', '"arm:[0, 0, 0.5]"']
ELEMENTS = ["pin", "guide", "link", "sum", "roller", "coil", "twist", "push", "rub", "rod", "no"]


def mostly(random, right, wrong, chance=0.03):
    """One of the valid ones; in a wild scene seldom one of the others."""
    return random.choice(wrong if random.wild and random.random() < chance else right)


def a_number(random):
    what = random.random()
    if what < 0.97 or not random.wild:
        value = random.choice([1, 1, 1, -1]) * random.choice([0.1, 0.5, 1.0, 2.0, 10.0]) * random.choice([1, 1, random.random()])
        return f"{value:.6g}"
    return random.choice(NUMBERS) if what < 0.99 else random.choice(TEXTS)


def positive(random):
    return a_number(random).removeprefix("-")


def a_vector(random, planar, more=None):
    n = more or (2 if planar else 3)
    n += mostly(random, [0], [1, -1], 0.005)
    values = random.choice([["1", "0", "0"], ["0", "0", "1"], ["0", "1", "0"], ["0.5", "0", "0"], None] if not planar else
                           [["1", "0"], ["0", "1"], ["0", "0"] if random.wild else ["0", "-1"], None])
    if values is None or n > len(values):
        values = [a_number(random) for _ in range(n)]
    return "[" + ", ".join(values[:n]) + "]"


def some(random, keys):
    """Each of the keys with its chance, those that are likely in any scene that is not wild; seldom one that is none."""
    lines = [f"{key} = {value}" for key, chance, value in keys if random.random() < chance or (chance > 0.9 and not random.wild)]
    if random.wild and random.random() < 0.02:
        lines.append(random.choice(["radius", "mass", "colour", "at", "joint"]) + " = " + a_number(random))
    return lines


def a_pair(random):
    points = [point for point in POINTS if not (random.planar and "[" in point)]
    first = random.choice(points)
    second = mostly(random, [point for point in points if point[1:4] != first[1:4]], ['"no"', '"rod.no"', first], 0.01)
    return f"[{first}, {second}]" if random.random() < 0.995 or not random.wild else f"[{first}]"


def an_inertia(random):
    """Valid moments of inertia of a body, occasionally invalid ones."""
    moments = mostly(random, [[1.0, 1.0, 1.0], [1.0, 0.6, 0.5], [2.0, 1.0, 1.0]], [[1.0, 0.1, 0.1], [0.0, 0.0, 0.0], [1e300] * 3])
    factor = random.choice([1, 1, 1e-3])
    return "[" + ", ".join(f"{factor * moment:g}" for moment in moments) + "]"


def a_shape(random, planar):
    sizes = {"box": 3, "cylinder": 2, "sphere": 1}
    kind = mostly(random, list(sizes), ["bar", "disk", "no"])
    return f"{{ {kind} = [" + ", ".join(positive(random) for _ in range(sizes.get(kind, 1))) + "] }"


def a_body(random, planar, name):
    keys = [("mass", 0.999, positive(random)), ("position", 0.999, a_vector(random, planar)),
            ("velocity", 0.2, a_vector(random, planar)), ("density", 0.005 * random.wild, positive(random)),
            ("shape", 0.03, a_shape(random, planar)),
            ("points", 0.9 if name == "rod" else 0.3, "{ tip = " + a_vector(random, planar) + " }")]
    if random.random() < 0.9 or not random.wild:
        keys += [("inertia", 0.99, positive(random) if planar else an_inertia(random)),
                 ("omega", 0.3, a_number(random) if planar else a_vector(random, False)),
                 ("angle" if planar else "rotation", 0.2, a_number(random) if planar else a_vector(random, False))]
    return [f"[body.{name}]", *some(random, keys)]


def a_joint(random, planar, name):
    kind = random.choice(JOINTS[:2] if name != "hook" and not random.wild else JOINTS[:5] if planar else JOINTS)
    keys = [("bodies", 0.99, a_pair(random)), ("at", 0.99, mostly(random, [a_vector(random, planar)], POINTS)),
            ("axis", 0.95, a_vector(random, planar)),
            ("motion", 0.5 * (kind in ("revolute", "prismatic")), random.choice(TIMES)),
            ("pitch", 0.95 if kind == "screw" else 0.02 * random.wild, a_number(random)),
            ("across", 0.02 * random.wild, a_vector(random, planar)),
            ("hold", 0.95 if kind == "primitive" else 0.02 * random.wild,
             "[" + ", ".join(random.choices("01", k=3 if planar else 6)) + "]")]
    return [f"[joint.{name}]", f'type = "{kind}"', *some(random, keys)]


def a_wheel(random, planar):
    kind = random.choice(WHEELS[:1] if planar and random.random() < 0.7 else WHEELS)
    keys = [("at", 0.98, random.choice(POINTS[:3])), ("radius", 0.95 * (kind not in ("knife_edge", "ellipsoid")), positive(random)),
            ("axis", 0.95 * (kind in ("disk", "massless")), a_vector(random, planar)),
            ("across", 0.95 * (kind == "knife_edge"), a_vector(random, planar)), ("normal", 0.1, a_vector(random, False)),
            ("height", 0.2, a_number(random)), ("rise", 0.1, random.choice(TIMES)),
            ("crown", 0.1 * (kind == "disk"), positive(random)),
            ("semi_axes", 0.95 * (kind == "ellipsoid"), mostly(random, ["[1, 2, 0.5]"], ["[0, 1, 1]", "[1e9, 1, 1e-9]"])),
            ("steer", 0.1, random.choice(TIMES)),
            ("along", 0.4 * (kind == "massless"), a_vector(random, False)), ("rotation", 0.05, random.choice(TIMES))]
    return ["[wheel.roller]", f'type = "{kind}"', *some(random, keys)]


def a_force(random, planar, name):
    kind = {"coil": "spring", "twist": "torsion", "push": "load", "rub": "friction", "pad": "bushing"}[name]
    n = 3 if planar else 6
    keys = {
        "spring": [("between", 0.98, a_pair(random)), ("length", 0.5, positive(random)), ("tension", 0.1, random.choice(TIMES)),
                   ("stiffness", 0.9, a_number(random)), ("damping", 0.3, a_number(random)),
                   ("law", 0.2, random.choice(['"-length^3"', '"table"', '"rate"', '"1/(length - 1)"', *TIMES]))],
        "torsion": [("joint", 0.98, '"pin"'), ("stiffness", 0.9, a_number(random)), ("damping", 0.3, a_number(random)),
                    ("angle", 0.3, a_number(random)), ("torque", 0.1, random.choice(TIMES))],
        "bushing": [("bodies", 0.02 * random.wild, a_pair(random)), ("between", 0.99, a_pair(random)),
                    ("at", 0.95, a_vector(random, planar)),
                    ("stiffness", 0.9, a_vector(random, planar, n)), ("damping", 0.5, a_vector(random, planar, n))],
        "load": [("on", 0.98, random.choice(POINTS[:3])), ("in_body", 0.2, "true"), ("factor", 0.1, random.choice(TIMES)),
                 ("force", 0.95, random.choice([a_vector(random, planar),
                                               "[" + ", ".join(random.choice(STATES) for _ in range(2 if planar else 3)) + "]"])),
                 ("torque", 0.3, a_number(random) if planar else a_vector(random, False))],
        "friction": [("joint", 0.98, random.choice(['"pin"', '"guide"'])), ("normal", 0.6, positive(random)),
                     ("dynamic", 0.95, positive(random)), ("static", 0.3, positive(random)), ("speed", 0.95, positive(random)),
                     ("radius", 0.4, positive(random)), ("viscous", 0.1, positive(random))],
    }[kind]
    return [f"[force.{name}]", f'type = "{kind}"', *some(random, keys)]


def a_constraint(random, planar, name):
    kind = {"link": "distance", "sum": random.choice(["coupling", "velocity"])}[name]
    keys = {
        "distance": [("between", 0.98, a_pair(random)), ("length", 0.3, positive(random)), ("motion", 0.1, random.choice(TIMES))],
        "coupling": [("joints", 0.98, '["pin", "guide"]'), ("factors", 0.95, f"[1, {a_number(random)}]"),
                     ("motion", 0.1, random.choice(TIMES)), ("locked", 0.1, random.choice(["true", "false"]))],
        "velocity": [("velocities", 0.98, '["bob.vx", "rod.vy"]'),
                     ("coefficients", 0.95, "[1, " + mostly(random, [a_number(random), '"bob.x"', '"rod.y*t"'], STATES) + "]"),
                     ("value", 0.3, random.choice(TIMES))],
    }[kind]
    return [f"[constraint.{name}]", f'type = "{kind}"', *some(random, keys)]


def a_sensor(random, name):
    key = random.choice(["point", "joint", "distance", "energy", "body", "reaction", "force", "balance"])
    value = {"point": random.choice(POINTS), "distance": a_pair(random), "energy": "true", "balance": "true",
             "body": random.choice(POINTS)}.get(key, f'"{random.choice(ELEMENTS)}"')
    return [f"[sensor.{name}]", f"{key} = {value}", *(["zero = 1.0"] if random.random() < 0.1 else [])]


def a_repetition(random, planar):
    at = "[" + ", ".join(['"1.5*i"', "0", "0"][: 2 if planar else 3]) + "]"
    return ["[repeat.bay]", "count = " + mostly(random, ["1", "2", "3", "50"], ["0", "-1", "1e9", "9999999999", *TEXTS[:8]], 0.2),
            '[repeat.bay.body."part{i}"]', f"mass = {positive(random)}",
            "inertia = 1.0" if planar else "inertia = [1, 1, 1]", f"position = {at}",
            '[repeat.bay.joint."bay{i}"]', 'type = "revolute"',
            "bodies = [" + mostly(random, ['"ground"', '"rod"'], ['"part{i-1}"']) + ', "part{i}"]',
            f"at = {at}", "" if planar else "axis = [0, 0, 1]"]


def mechanical(random, texts, wild=None):
    """A mechanism of a few elements, in any order; by default half of them are wild."""
    random.wild = random.random() < 0.5 if wild is None else wild
    random.planar = planar = random.random() < 0.5
    parts = [["[parameters]", f"a = {a_number(random)}", f"c = {a_number(random)}",
              "b = " + random.choice(['"2*a"', a_number(random)])],
             ["[gravity]", f"vector = {a_vector(random, planar)}"]]
    if random.random() < 0.99:
        parts += [a_body(random, planar, name) for name in ("bob", "rod", "arm") if random.random() < 0.99]
    parts += [a_joint(random, planar, name) for name in ("pin", "guide", "hook")
              if random.random() < 0.6 or (name != "hook" and not random.wild)]
    parts += [a_constraint(random, planar, name) for name in ("link", "sum") if random.random() < 0.2]
    parts += [a_force(random, planar, name) for name in ("coil", "twist", "push", "rub", "pad") if random.random() < 0.2]
    if random.random() < 0.25:
        parts.append(a_wheel(random, planar))
    if random.random() < 0.15:
        parts.append(a_repetition(random, planar))
    if random.random() < 0.5 or not random.wild:
        parts.append(["[function.table]", *some(random, [
            ("at", 0.98, mostly(random, ["[0, 1, 2]"], ["[0, 0, 1]", "[2, 1, 0]", "[-1e300, 1e300, nan]"])),
            ("values", 0.98, mostly(random, ["[0, 1, 0]"], ["[0, 1]", "[1e300, -1e300, 1]"])),
            ("type", 0.5, mostly(random, ['"linear"', '"cubic"'], ['"step"'])),
            ("ends", 0.5, mostly(random, ['"hold"', '"extend"', '"repeat"'], ['"no"']))])])
    parts += [a_sensor(random, name) for name in ("one", "two") if random.random() < 0.3]
    if random.random() < 0.3:
        kinds = ("bodies", "joints", "wheels", "constraints", "forces")
        lists = ['["pin"]', '["rod", "bob"]', '"some"']
        parts.append(["[results]", *some(random, [(kind, 0.4, mostly(random, ['"all"'], lists, 0.3)) for kind in kinds])])
    parts.append(["[initial]", *some(random, [("assemble", 0.5, "true"), ("equilibrium", 0.05, "true"), ("steady", 0.05, '["any"]'),
                                              ("fixed", 0.05, '["rod.x"]')])])
    parts.append(["[time]", "end = " + random.choice(["1.0", "1.0", "1e-9", "1e9", a_number(random)])])
    stepper = random.choice("rk4 dopri5 dop853 trapezoid sdirk54 radau5 radau auto".split())
    parts.append(["[solver]", f'stepper = "{stepper}"', random.choice(["step = 1e-3", "rtol = 1e-6", "step = 0.5", "rtol = 1e-2"]),
                  *some(random, [("chart_kind", 0.1, random.choice(['"sparse"', '"dense"', '"automatic"']))])])
    random.shuffle(parts)
    if random.random() < 0.2:
        watch = mostly(random, ['"rod.x"', '"bob.y"'], ['"one/angle"', '"pin"', '"t"'], 0.5)
        number = random.choice(["2*100", "1e3", "sqrt(2)", "-pi", "2*", ",", "/", "1,2", "1e3 x", "1/0", "a", ""])
        parts.append(["[[event]]", 'name = "e"', f"watch = {watch}", f"value = {a_number(random)}",
                      *some(random, [("action", 0.5, random.choice(['"stop"', '"record"', '"lock"', '"change"'])),
                                     ("change", 0.3, f'"force.coil.stiffness = {number}"')])])
    head = ["[scene]", 'model = "mechanism"', *(["planar = true"] if planar else [])]
    return "\n\n".join("\n".join(part) for part in [head, *parts]) + "\n"
