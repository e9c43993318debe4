# SPDX-License-Identifier: MIT
"""MuJoCo in a process of its own: a fault of its compiler cannot end an import without a message.

    python mujoco_process.py compile FILE OUT.npz            the compiled model
    python mujoco_process.py accelerate FILE GIVEN.npz OUT.npz    accelerations at given states, of what an import has taken

Exit code 3: this Python has no package `mujoco`.
"""

from __future__ import annotations

import sys

import numpy as np

#: Arrays of the compiled model that an import reads.
FIELDS = """qpos0 qpos_spring body_parentid body_pos body_quat body_ipos body_iquat body_mass body_inertia body_gravcomp body_mocapid
body_invweight0 body_jntnum body_jntadr jnt_type jnt_qposadr jnt_dofadr jnt_bodyid jnt_pos jnt_axis jnt_stiffness jnt_stiffnesspoly jnt_springyield
jnt_limited jnt_range jnt_solref jnt_solimp jnt_actfrclimited dof_armature dof_damping dof_dampingpoly dof_frictionloss dof_invweight0
eq_type eq_obj1id eq_obj2id eq_objtype eq_active0 eq_data eq_solref eq_solimp tendon_adr tendon_num tendon_limited tendon_range
tendon_stiffness tendon_stiffnesspoly tendon_damping tendon_dampingpoly tendon_armature tendon_frictionloss tendon_lengthspring tendon_length0
tendon_invweight0 tendon_solref_lim tendon_solimp_lim tendon_springyield tendon_actfrclimited wrap_type wrap_objid wrap_prm actuator_trntype
actuator_trnid actuator_gear actuator_gaintype actuator_biastype actuator_dyntype actuator_gainprm actuator_biasprm actuator_forcelimited
actuator_forcerange actuator_armature actuator_damping actuator_ctrladr actuator_ctrlnum site_bodyid site_pos site_quat sensor_type
sensor_objtype sensor_objid geom_type geom_bodyid geom_pos geom_quat geom_size geom_dataid geom_contype geom_conaffinity geom_group
mesh_pos mesh_quat mesh_scale key_qpos key_qvel key_ctrl""".split()
NAMED = ("body", "joint", "equality", "tendon", "actuator", "site", "sensor", "key")


def compiled(mujoco, path):
    try:
        return mujoco.MjModel.from_xml_path(path)
    except ValueError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        sys.exit(2)


def write_model(mujoco, path, target):
    model = compiled(mujoco, path)
    found = {name: np.array(getattr(model, name)) for name in FIELDS if hasattr(model, name)}
    for kind in NAMED:
        count = {"joint": model.njnt, "equality": model.neq, "actuator": model.nu}.get(kind, getattr(model, f"n{kind}", 0))
        of = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
        found[f"names_{kind}"] = np.array([mujoco.mj_id2name(model, of, k) or "" for k in range(count)], dtype=str)
    found["names_mesh"] = np.array([path_of(model, k) for k in range(model.nmesh)], dtype=str)
    option = model.opt
    numbers = {"disableflags": option.disableflags, "density": option.density, "viscosity": option.viscosity, "nflex": model.nflex}
    np.savez(target, gravity=np.array(option.gravity), **found, **{key: np.array(value) for key, value in numbers.items()})


def path_of(model, mesh):
    """The file of a mesh."""
    at = int(model.mesh_pathadr[mesh])
    return model.paths[at:].split(b"\0")[0].decode("utf-8", "replace") if at >= 0 else ""


def accelerate(mujoco, path, given, target):
    """Accelerations of bodies: of their centres of mass, and angular; contacts, limits and equalities are off."""
    model, given = compiled(mujoco, path), np.load(given)
    disable = mujoco.mjtDisableBit
    model.opt.disableflags |= disable.mjDSBL_CONSTRAINT | disable.mjDSBL_CLAMPCTRL
    model.opt.density = model.opt.viscosity = 0
    for name in ("jnt_stiffness", "jnt_stiffnesspoly", "dof_damping", "dof_dampingpoly", "dof_armature", "dof_frictionloss", "tendon_stiffness",
                 "tendon_stiffnesspoly", "tendon_damping", "tendon_dampingpoly", "tendon_armature", "actuator_gainprm", "actuator_biasprm",
                 "actuator_armature", "actuator_damping", "jnt_actfrclimited", "tendon_actfrclimited"):
        if hasattr(model, name):
            # What the import has not taken is off.
            array = getattr(model, name)
            array[:] = given[name].reshape(array.shape)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    data = mujoco.MjData(model)
    groups, first = given["group"], given["first"]
    found = []
    for k in range(len(given["q"])):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = given["q"][k], given["v"][k]
        data.ctrl[:] = given["ctrl"]
        for i in range(model.nu):
            if model.actuator_actadr[i] >= 0:
                data.act[model.actuator_actadr[i]] = given["ctrl"][model.actuator_ctrladr[i] if hasattr(model, "actuator_ctrladr") else i]
        data.qfrc_applied[:] = given["applied"][k]
        mujoco.mj_forward(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        found.append([of_group(mujoco, model, data, groups == j, first[j]) for j in range(len(first))])
    np.savez(target, accelerations=np.array(found))


def of_group(mujoco, model, data, chosen, first):
    """Acceleration of the common centre of mass of bodies, and their angular acceleration."""
    mass = model.body_mass*chosen
    centre = mass @ data.xipos/mass.sum() if mass.sum() > 0 else data.xpos[first]
    six, spin = np.zeros(6), np.zeros(6)
    mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_XBODY, int(first), six, 0)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, int(first), spin, 0)
    gravity = np.zeros(3) if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY else model.opt.gravity
    w, away = spin[:3], centre - data.xpos[first]
    return np.concatenate([six[3:] + gravity + np.cross(six[:3], away) + np.cross(w, np.cross(w, away)), six[:3]])


def main(words) -> int:
    try:
        import mujoco
    except ImportError:
        return 3
    if words[0] == "compile":
        write_model(mujoco, *words[1:])
    else:
        accelerate(mujoco, *words[1:])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
