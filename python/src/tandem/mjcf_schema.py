# SPDX-License-Identifier: MIT
"""Attributes of the MJCF elements that are read, of this and of older versions of MuJoCo, and the words that some of them take."""

from __future__ import annotations

ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
POSE = {"pos", *ORIENTATIONS}
TRUTH = ("false", "true")
AUTO = ("auto", *TRUTH)
LOOKS = {"group", "material", "rgba", "user"}
SOLVER = {"solimp", "solref"}
EQUALITY = {"active", "class", "name", *SOLVER}


def words(text: str) -> set:
    return set(text.split())


FLAGS = words("actuation autoreset clampctrl constraint contact damper diagexact energy equality eulerdamp filterparent frictionloss fwdinv "
              "gravity invdiscrete ipc island limit midphase multiccd nativeccd override passive refsafe sensor sensornoise sleep "
              "speculative spring warmstart")
ATTRIBUTES = {
    "mujoco": {"model"},
    "compiler": words("alignfree angle apirate assetdir autolimits balanceinertia boundinertia boundmass conflict convexhull coordinate "
                      "discardvisual eulerseq exactmeshinertia fitaabb fusestatic inertiafromgeom inertiagrouprange meshdir passthrough "
                      "savecanonical savecompiled saveinertial settotalmass strippath texturedir usethread"),
    "option": words("actuatorgroupdisable apirate ccd_iterations ccd_tolerance collision cone density gravity impratio integrator iterations "
                    "jacobian ls_iterations ls_tolerance magnetic mpr_iterations mpr_tolerance noslip_iterations noslip_tolerance "
                    "o_friction o_margin o_solimp o_solref sdf_initpoints sdf_iterations sleep_tolerance solver timestep tolerance "
                    "viscosity wind"),
    "flag": FLAGS,
    "default": {"class"},
    "worldbody": POSE | words("childclass gravcomp mocap name user"),
    "body": POSE | words("childclass fuse gravcomp mocap name simple sleep user"),
    "frame": POSE | {"childclass", "name"},
    "inertial": POSE | words("diaginertia fullinertia mass"),
    "joint": LOOKS | words("actuatorfrclimited actuatorfrcrange actuatorgravcomp armature axis class damping frictionloss limited margin "
                           "name pos range ref solimpfriction solimplimit solreffriction solreflimit springdamper springref springyield "
                           "stiffness type"),
    "freejoint": {"align", "group", "name"},
    "geom": POSE | LOOKS | SOLVER | words("adhesion castshadow class conaffinity condim contype density fitscale fluidcoef fluidshape "
                                          "friction fromto gap hfield margin mass mesh name priority shellinertia size solmix "
                                          "surfacevel type"),
    "site": POSE | LOOKS | words("class fromto mesh name size type"),
    "motor": words("armature class cranklength cranksite ctrllimited ctrlrange damping delay forcelimited forcerange gear group interp "
                   "joint jointinparent lengthrange name nsample refsite site slidersite tendon user"),
    "connect": EQUALITY | words("anchor body1 body2 site1 site2"),
    "weld": EQUALITY | words("anchor body1 body2 relpose site1 site2 torquescale"),
    "equality joint": EQUALITY | words("joint1 joint2 polycoef"),
    "equality": EQUALITY,
}
