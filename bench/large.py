#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Large mechanisms compared with Exudyn, MuJoCo and Pinocchio: cost of a step of 1 ms, and error of the motion.

Usage: bench/large.py [--repeats N] [--seconds S] [SCENE [N...]]

SCENE is planar_chain, spatial_chain, star, four_bars or net, as in test/src/subjects/large_mechanisms.f90, N even for chains; all
without. Installs exudyn, mujoco, pin, numpy and h5py from PyPI into build/large. The program is build/optimised/tandem, or what TANDEM names: it
takes rk4 with every stage on the manifold.
Exudyn integrates the same bodies and joints by generalised alpha, index 3, with a sparse matrix that is reused for several steps; MuJoCo in
joint coordinates by RK4; Pinocchio evaluates its articulated-body algorithm four times, without an integrator. These two need trees,
which four-bars and the net are not.
The time is that of a run to 0.3 s less that of one to 0.1 s, the best of the repeats, all solvers in turn, on one core. The error is that
of the centre of the last body at 0.3 s, compared with dop853 at 1e-11. A solver that would take longer than S seconds (60) is omitted.
"""

import argparse
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TANDEM = os.environ.get("TANDEM", str(ROOT / "build" / "optimised" / "tandem"))
PLACE = ROOT / "build" / "large"
ENVIRONMENT = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
GRAVITY, STEP, ENDS = 9.81, 1e-3, (0.1, 0.3)
SCENES = ("planar_chain", "spatial_chain", "star", "four_bars", "net")
LOOPS = ("four_bars", "net")
NUMBERS = (10, 100, 1000)
MOST_LINKS = 300


def enter():
    """Restart in an environment with the other packages, on the first core."""
    python = PLACE / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(PLACE)], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "-q", "exudyn", "mujoco", "pin", "numpy", "h5py"], check=True)
    if Path(sys.prefix).resolve() != PLACE.resolve():
        os.execve(str(python), [str(python), __file__, *sys.argv[1:]], ENVIRONMENT)
    os.sched_setaffinity(0, {0})


def bodies_of(scene, n):
    """Definition: (parent, mass, centre, angle about z, inertia, point and axis of the hinge, initial spin) of each body."""
    if scene == "star":
        found = [(-1, 10.0, (0, 0, 0), 0.0, (1, 1, 2), (0, 0, 0), (0, 0, 1), 1.0)]
        inertia = 0.1*0.3**2/12
        for i in range(1, n):
            angle = 2*math.pi*i/(n - 1)
            c, s = math.cos(angle), math.sin(angle)
            found.append((0, 0.1, (1.15*c, 1.15*s, 0), angle, (0.1*inertia, inertia, inertia), (c, s, 0), (-s, c, 0), 0.0))
        return found
    planar = scene == "planar_chain"
    axes = ((0, 0, 1), (0, 0, 1)) if planar else ((0, 0.8, 0.6), (0, 1, 0))
    moments = (1/12, 1/12, 1/12) if planar else (0.1/12, 1/12, 1/12)
    return [(i - 1, 1.0, (i + 0.5, 0, 0), 0.0, moments, (i, 0, 0), axes[(i + 1) % 2], 0.0) for i in range(n)]


def loops_of(scene, n):
    """Definition of a mechanism with loops: (name, mass, moments of inertia, centre, velocity, spin) of each body, (kind, bodies,
        point) of each joint; -1 is the ground, and a distance is that of two centres."""
    if scene == "four_bars":
        bars = max(n//2, 1)
        moments = (1/12, 1/12, 1/12)
        bodies = [(f"u{i}", 1.0, moments, (i, 0.5, 0), (0.5, 0, 0), -1.0) for i in range(bars + 1)]
        bodies += [(f"c{i}", 1.0, moments, (i - 0.5, 1, 0), (1, 0, 0), 0.0) for i in range(1, bars + 1)]
        joints = [("revolute", (-1, i), (i, 0, 0)) for i in range(bars + 1)]
        for i in range(1, bars + 1):
            joints += [("revolute", (i - 1, bars + i), (i - 1, 1, 0)), ("revolute", (bars + i, i), (i, 1, 0))]
        return bodies, joints
    k, length, mass = round(math.sqrt(n)), 0.1, 0.1
    moments = tuple(x*mass*length**2/12 for x in (1, 1, 2))
    bodies = [(f"b{j + 1}_{i + 1}", mass, moments, ((i + 1)*length, (j + 1)*length, 0), (0, 0, 0), 0.0) for j in range(k) for i in range(k)]
    joints = [("spherical", (i + k*(j - 1) if j else -1, i + k*j), ((i + 1)*length, (j + 0.5)*length, 0)) for j in range(k) for i in range(k)]
    joints += [("distance", (i - 1 + k*j, i + k*j), None) for j in range(k) for i in range(1, k, 4)]
    return bodies, joints


def is_planar(scene):
    return scene in ("planar_chain", "four_bars")


def weight_of(scene):
    """Acceleration due to gravity: mechanisms in the plane fall along y."""
    return (0.0, -GRAVITY, 0.0) if is_planar(scene) else (0.0, 0.0, -GRAVITY)


# --- tandem -----------------------------------------------------------------------------------------------------------


def text_of(scene, n):
    """The mechanism as a scene, in which equal parts are repeated."""
    planar = is_planar(scene)
    cut = slice(0, 2 if planar else 3)
    lines = ["[scene]", 'model = "mechanism"', f"planar = {str(planar).lower()}", "[gravity]", f"vector = {list(weight_of(scene)[cut])}",
             "[time]", "end = 1.0", "[parameters]"]
    if scene not in LOOPS:
        lines.append(f"n = {n}")

    def add(name, parent, body, centre, point, axis, heading="", more=()):
        moments = body[4]
        lines.extend([f'[{heading}body."{name}"]', f"mass = {body[1]!r}", f"inertia = {moments[2] if planar else list(moments)}",
                      f"position = {list(centre)[cut]}", *more, f'[{heading}joint."j{name}"]', 'type = "revolute"',
                      f'bodies = ["{parent}", "{name}"]', f"at = {list(point)[cut]}", *(() if planar else [f"axis = {list(axis)}"])])

    if scene in LOOPS:
        return "\n".join([*lines, *loops_in_text(scene, n)]).replace("'", '"') + "\n"
    drawn = bodies_of(scene, min(n, 3))
    if scene == "star":
        add("hub", "ground", drawn[0], drawn[0][2], drawn[0][5], drawn[0][6], more=["omega = [0, 0, 1]"])
        lines.extend(["[repeat.arm]", 'count = "n - 1"'])
        c, s = "cos(2*pi*i/(n - 1))", "sin(2*pi*i/(n - 1))"
        add("a{i}", "hub", drawn[1], (f"1.15*{c}", f"1.15*{s}", 0), (c, s, 0), (f"-{s}", c, 0), "repeat.arm.",
            ['rotation = [0, 0, "2*pi*i/(n - 1)"]', "omega = [0, 0, 1]", f'velocity = ["-1.15*{s}", "1.15*{c}", 0]'])
    else:
        # Pairs, since axes alternate.
        for i, name in enumerate(("a1", "c1")):
            add(name, ("ground", "a1")[i], drawn[i], drawn[i][2], drawn[i][5], drawn[i][6])
        lines.extend(["[repeat.pair]", f"count = {n//2 - 1}", "first = 2"])
        for i, name in enumerate(("a", "c")):
            add(name + "{i}", ("c{i - 1}", "a{i}")[i], drawn[i], (f"2*i - {1.5 - i}", 0, 0), (f"2*i - {2 - i}", 0, 0), drawn[i][6],
                "repeat.pair.")
    return "\n".join(lines).replace("'", '"') + "\n"


def loops_in_text(scene, n):
    """The bodies and joints of `loops_of`."""
    _, mass, moments, *_ = loops_of(scene, n)[0][0]
    if scene == "four_bars":
        body = [f"mass = {mass!r}", f"inertia = {moments[2]}"]
        return [f"n = {max(n//2, 1)}", "[repeat.up]", 'count = "n + 1"', "first = 0", "[repeat.up.body.'u{i}']", *body, "position = ['i', 0.5]",
                "velocity = [0.5, 0]", "omega = -1", "[repeat.up.joint.'f{i}']", "type = 'revolute'", "bodies = ['ground', 'u{i}']",
                "at = ['i', 0]", "[repeat.bay]", "count = 'n'", "[repeat.bay.body.'c{i}']", *body, "position = ['i - 0.5', 1]",
                "velocity = [1, 0]", "[repeat.bay.joint.'l{i}']", "type = 'revolute'", "bodies = ['u{i - 1}', 'c{i}']",
                "at = ['i - 1', 1]", "[repeat.bay.joint.'r{i}']", "type = 'revolute'", "bodies = ['c{i}', 'u{i}']", "at = ['i', 1]"]
    k = round(math.sqrt(n))
    return [f"k = {k}", "[repeat.row]", "count = 'k'", "[repeat.row.repeat.column]", "count = 'k'", "index = 'j'",
            "[repeat.row.repeat.column.body.'b{i}_{j}']", f"mass = {mass!r}", f"inertia = {list(moments)}", "position = ['0.1*j', '0.1*i', 0]",
            "[repeat.edge]", "count = 'k'", "[repeat.edge.joint.'g{i}']", "type = 'spherical'", "bodies = ['ground', 'b1_{i}']",
            "at = ['0.1*i', 0.05, 0]", "[repeat.up]", "count = 'k - 1'", "first = 2", "[repeat.up.repeat.column]", "count = 'k'", "index = 'j'",
            "[repeat.up.repeat.column.joint.'y{i}_{j}']", "type = 'spherical'", "bodies = ['b{i - 1}_{j}', 'b{i}_{j}']",
            "at = ['0.1*j', '0.1*(i - 0.5)', 0]", "[repeat.across]", "count = 'k'", "[repeat.across.repeat.pair]", f"count = {(k + 2)//4}",
            "index = 'j'", "[repeat.across.repeat.pair.constraint.'x{i}_{j}']", "type = 'distance'",
            "between = ['b{i}_{4*j - 3}', 'b{i}_{4*j - 2}']"]


def run_tandem(scene, n, folder, end, *settings):
    """Processor time of the integration, and position of the last centre."""
    import h5py

    path, target = Path(folder) / f"{scene}.toml", Path(folder) / "out.h5"
    if not path.exists():
        path.write_text(text_of(scene, n))
    words = [word for setting in (*settings, f"time.end={end}", f"output.interval={end}", 'output.fields=["q"]')
             for word in ("--set", setting)]
    done = subprocess.run([TANDEM, "run", str(path), *words, "--output", str(target), "--force", "--quiet", "--no-error"],
                          env=ENVIRONMENT, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr.strip())
    last = loops_of(scene, n)[0][-1][0] if scene in LOOPS else f"a{n - 1}" if scene == "star" else f"c{n//2}"
    with h5py.File(target) as file:
        q = file["trajectory/q"]
        names = [name.decode().strip() if isinstance(name, bytes) else name.strip() for name in q.attrs["names"]]
        at = names.index(f"{last}.x")
        return float(file["report"].attrs["cpu_seconds"]), list(q[-1, at:at + (2 if is_planar(scene) else 3)])


# --- the others: each returns a function that runs to a time and gives processor time and the last centre ---------------------


def exudyn(scene, n):
    """Generalised alpha, index 3."""
    import exudyn as exu
    import numpy as np
    from exudyn.itemInterface import (Force, MarkerBodyPosition, NodeRigidBody2D, ObjectGround, ObjectRigidBody2D, RevoluteJoint2D)
    from exudyn.utilities import RigidBodyInertia

    def add_planar(mbs, mass, moment, centre, velocity=(0, 0, 0), spin=0.0):
        node = mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[*centre[:2], 0], initialVelocities=[*velocity[:2], spin]))
        body = mbs.AddObject(ObjectRigidBody2D(mass=mass, inertia=moment, nodeNumber=node))
        mbs.AddLoad(Force(markerNumber=mbs.AddMarker(MarkerBodyPosition(bodyNumber=body)), loadVector=[0, -GRAVITY*mass, 0]))
        return node, body

    def add_pin(mbs, bodies, places):
        markers = [mbs.AddMarker(MarkerBodyPosition(bodyNumber=which, localPosition=list(place))) for which, place in zip(bodies, places)]
        mbs.AddObject(RevoluteJoint2D(markerNumbers=markers))

    def build_loops():
        mbs = exu.SystemContainer().AddSystem()
        ground, numbers = mbs.AddObject(ObjectGround()), []
        bodies, joints = loops_of(scene, n)
        for _, mass, moments, centre, velocity, spin in bodies:
            if is_planar(scene):
                node, body = add_planar(mbs, mass, moments[2], centre, velocity, spin)
            else:
                made = mbs.CreateRigidBody(inertia=RigidBodyInertia(mass=mass, inertiaTensor=np.diag(moments)), referencePosition=list(centre),
                                           gravity=[0, 0, -GRAVITY], returnDict=True)
                node, body = made["nodeNumber"], made["bodyNumber"]
            numbers.append(body)
        for kind, pair, point in joints:
            which = [numbers[i] if i >= 0 else ground for i in pair]
            if kind == "distance":
                mbs.CreateDistanceConstraint(itemNumbers=which, localPosition0=[0, 0, 0], localPosition1=[0, 0, 0], distance=None, show=False)
                continue
            places = [np.subtract(point, bodies[i][3] if i >= 0 else (0, 0, 0)).tolist() for i in pair]
            if is_planar(scene):
                add_pin(mbs, which, places)
            else:
                mbs.CreateSphericalJoint(itemNumbers=which, position=list(point), show=False)
        mbs.Assemble()
        return mbs, node

    def build():
        if scene in LOOPS:
            return build_loops()
        mbs = exu.SystemContainer().AddSystem()
        ground, numbers = mbs.AddObject(ObjectGround()), []
        for parent, mass, centre, angle, moments, point, axis, _ in bodies_of(scene, n):
            other = ground if parent < 0 else numbers[parent]
            if scene == "planar_chain":
                node, body = add_planar(mbs, mass, moments[2], centre)
                add_pin(mbs, (other, body), [[0.5, 0, 0] if parent >= 0 else list(point), [-0.5, 0, 0]])
            else:
                c, s = math.cos(angle), math.sin(angle)
                spin = 1.0 if scene == "star" else 0.0
                made = mbs.CreateRigidBody(
                    inertia=RigidBodyInertia(mass=mass, inertiaTensor=np.diag(moments)), referencePosition=list(centre),
                    referenceRotationMatrix=np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), gravity=[0, 0, -GRAVITY],
                    initialVelocity=[-spin*centre[1], spin*centre[0], 0], initialAngularVelocity=[0, 0, spin],
                    returnDict=True)
                node, body = made["nodeNumber"], made["bodyNumber"]
                mbs.CreateRevoluteJoint(itemNumbers=[other, body], position=list(point), axis=list(axis), useGlobalFrame=True,
                                        show=False)
            numbers.append(body)
        mbs.Assemble()
        return mbs, node

    def run(end):
        mbs, node = build()
        settings = exu.SimulationSettings()
        settings.timeIntegration.numberOfSteps = round(end/STEP)
        settings.timeIntegration.endTime = end
        settings.timeIntegration.newton.useModifiedNewton = True
        settings.solution.file.write = False
        settings.timeIntegration.verboseMode = 0
        settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        begin = time.process_time()
        mbs.SolveDynamic(settings)
        spent = time.process_time() - begin
        return spent, list(mbs.GetNodeOutput(node, exu.OutputVariableType.Position))
    return run


def mujoco(scene, n):
    """RK4 in joint coordinates."""
    import mujoco as mj
    import numpy as np

    spec = mj.MjSpec()
    spec.option.timestep = STEP
    spec.option.integrator = mj.mjtIntegrator.mjINT_RK4
    spec.option.gravity = weight_of(scene)
    spec.option.disableflags = mj.mjtDisableBit.mjDSBL_CONTACT | mj.mjtDisableBit.mjDSBL_CONSTRAINT
    drawn, made = bodies_of(scene, n), []
    for i, (parent, mass, centre, angle, moments, point, axis, _) in enumerate(drawn):
        above = spec.worldbody if parent < 0 else made[parent]
        origin = (0, 0, 0) if parent < 0 else drawn[parent][2]
        # The hinge in the frame of the body, turned about z by its angle; those above it are not turned.
        c, s = math.cos(angle), math.sin(angle)
        back = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        body = above.add_body(name=f"b{i}", pos=np.subtract(centre, origin), quat=[math.cos(angle/2), 0, 0, math.sin(angle/2)],
                              mass=mass, inertia=moments, ipos=[0, 0, 0], explicitinertial=True)
        body.add_joint(type=mj.mjtJoint.mjJNT_HINGE, pos=back @ np.subtract(point, centre), axis=back @ np.array(axis, float))
        made.append(body)
    model = spec.compile()

    def run(end):
        data = mj.MjData(model)
        data.qvel[:] = [body[-1] for body in drawn]
        begin = time.process_time()
        mj.mj_step(model, data, nstep=round(end/STEP))
        spent = time.process_time() - begin
        mj.mj_forward(model, data)
        return spent, list(data.xipos[-1])
    return run


def pinocchio(scene, n):
    """Four times the articulated-body algorithm."""
    import numpy as np
    import pinocchio as pin

    model, joints, placed = pin.Model(), [], []
    model.gravity.linear = np.array(weight_of(scene))
    for i, (parent, mass, centre, angle, moments, point, axis, _) in enumerate(bodies_of(scene, n)):
        # Frames of joints stay along those of the ground; that of the body is turned.
        origin = np.zeros(3) if parent < 0 else placed[parent]
        joint = model.addJoint(0 if parent < 0 else joints[parent], pin.JointModelRevoluteUnaligned(np.array(axis, float)),
                               pin.SE3(np.eye(3), np.array(point, float) - origin), f"j{i}")
        c, s = math.cos(angle), math.sin(angle)
        frame = pin.SE3(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.subtract(centre, point).astype(float))
        model.appendBodyToJoint(joint, pin.Inertia(mass, np.zeros(3), np.diag(moments).astype(float)), frame)
        joints.append(joint)
        placed.append(np.array(point, float))
    data = model.createData()
    q, qd, torque = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)

    def run(end):
        steps = round(end/STEP)
        begin = time.process_time()
        for _ in range(4*steps):
            pin.aba(model, data, q, qd, torque)
        return time.process_time() - begin, [math.nan]*3
    return run


# --- the comparison ---------------------------------------------------------------------------------------------------


def compare(scene, n, repeats, seconds):
    """A line of the table."""
    bodies = len(loops_of(scene, n)[0]) if scene in LOOPS else n
    with tempfile.TemporaryDirectory() as folder:
        settings = ('solver.stepper="rk4"', f"solver.step={STEP}")
        _, exact = run_tandem(scene, n, folder, ENDS[1], 'solver.stepper="dop853"', "solver.rtol=1e-11", "solver.atol=1e-11")
        solvers = {"tandem": lambda end: run_tandem(scene, n, folder, end, *settings)}
        for make in (exudyn, mujoco, pinocchio):
            # These need trees, and the data of Pinocchio take 48 N^3 bytes.
            if make is not exudyn and scene in LOOPS or make is pinocchio and n > MOST_LINKS:
                continue
            # Ten steps give an estimate of the time of the runs.
            solver = make(scene, n)
            if solver(10*STEP)[0]*sum(ENDS)/(10*STEP)*repeats < seconds*repeats:
                solvers[make.__name__] = solver
        best, errors = {}, {}
        for _ in range(repeats):
            for name, solver in solvers.items():
                spent = [solver(end) for end in ENDS]
                steps = round((ENDS[1] - ENDS[0])/STEP)
                cost = (spent[1][0] - spent[0][0])/steps/bodies*1e6
                best[name] = min(best.get(name, math.inf), cost)
                errors[name] = max(abs(a - b) for a, b in zip(spent[1][1], exact))
    print(f"| {scene} | {bodies} | " + " | ".join(
        f"{best[name]:.2f}" + ("" if math.isnan(errors[name]) else f" ({errors[name]:.0e})") if name in best else "-"
        for name in ("tandem", "exudyn", "mujoco", "pinocchio")) + " | " + " | ".join(
        f"{best['tandem']/best[name]:.2f}" if name in best else "-" for name in ("exudyn", "mujoco", "pinocchio")) + " |", flush=True)


def main():
    enter()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("scene", nargs="?", choices=SCENES)
    parser.add_argument("numbers", nargs="*", type=int)
    words = parser.parse_args()
    print("| scene | bodies | tandem | Exudyn | MuJoCo | Pinocchio | tandem/Exudyn | tandem/MuJoCo | tandem/Pinocchio |")
    print("|---|---|---|---|---|---|---|---|---|")
    for scene in [words.scene] if words.scene else SCENES:
        for n in words.numbers or NUMBERS:
            compare(scene, n, words.repeats, words.seconds)


if __name__ == "__main__":
    main()
