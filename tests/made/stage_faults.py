"""Faults in USD stages: for each, the edit of the stage, and code and place of the finding that it must cause."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, UsdGeom, UsdPhysics

CRANK, ELBOW, CLOSING = (f"/bars/joints/{n}" for n in ("crank_joint", "elbow", "closing"))


def put(path: str, value):
    """Return an edit that sets the default of an existing attribute."""

    def edit(stage):
        assert stage.GetAttributeAtPath(path).Set(value)

    return edit


def forget(field: str):
    """Return an edit that clears a field of the root layer."""

    def edit(stage):
        stage.GetRootLayer().pseudoRoot.ClearInfo(field)

    return edit


def metadata(field: str, value):
    def edit(stage):
        stage.GetRootLayer().pseudoRoot.SetInfo(field, value)

    return edit


def _no_root(stage):
    stage.GetPrimAtPath("/bars").RemoveAPI(UsdPhysics.ArticulationRootAPI)


def _second_root(stage):
    UsdPhysics.ArticulationRootAPI.Apply(stage.GetPrimAtPath("/bars/base"))


def _nested(stage):
    inner = UsdGeom.Xform.Define(stage, "/bars/crank/inner").GetPrim()
    UsdPhysics.RigidBodyAPI.Apply(inner)
    UsdPhysics.MassAPI.Apply(inner).CreateMassAttr(1.0)
    joint = UsdPhysics.FixedJoint.Define(stage, "/bars/joints/inner_joint")
    joint.CreateBody0Rel().SetTargets(["/bars/crank"])
    joint.CreateBody1Rel().SetTargets(["/bars/crank/inner"])
    joint.CreateCollisionEnabledAttr(False)


def _mirrored(stage):
    prim = stage.GetPrimAtPath("/bars/rocker")
    xform = UsdGeom.Xformable(prim)
    xform.AddScaleOp().Set((1, 1, -1))


def _stretched(stage):
    UsdGeom.Xformable(stage.GetPrimAtPath("/bars/rocker")).AddScaleOp().Set((1, 1, 2))


def _mirrored_mesh(stage):
    UsdGeom.Xformable(stage.GetPrimAtPath("/bars/rocker/rocker_visual")).AddScaleOp().Set((-1, 1, 1))


def _no_mass(stage):
    stage.GetPrimAtPath("/bars/rocker").RemoveAPI(UsdPhysics.MassAPI)


def _op_type(stage):
    prim = stage.GetPrimAtPath("/bars/rocker")
    prim.CreateAttribute("xformOp:scale", Sdf.ValueTypeNames.String).Set("1 1 1")
    order = UsdGeom.Xformable(prim).GetXformOpOrderAttr()
    order.Set([*order.Get(), "xformOp:scale"])


def _op_unlisted(stage):
    prim = stage.GetPrimAtPath("/bars/rocker")
    prim.CreateAttribute("xformOp:rotateZ", Sdf.ValueTypeNames.Float).Set(10.0)


def _op_missing(stage):
    order = UsdGeom.Xformable(stage.GetPrimAtPath("/bars/rocker")).GetXformOpOrderAttr()
    order.Set([*order.Get(), "xformOp:rotateX"])


def _op_order(stage):
    order = UsdGeom.Xformable(stage.GetPrimAtPath("/bars/rocker")).GetXformOpOrderAttr()
    order.Set(list(order.Get())[::-1])


def _reset_stack(stage):
    UsdGeom.Xformable(stage.GetPrimAtPath("/bars")).AddTranslateOp().Set((0, 0, 1))
    UsdGeom.Xformable(stage.GetPrimAtPath("/bars/rocker")).SetResetXformStack(True)


def _no_drive(stage):
    stage.GetPrimAtPath(CRANK).RemoveAPI(UsdPhysics.DriveAPI, "angular")


def _drive_elsewhere(stage):
    _no_drive(stage)
    UsdPhysics.DriveAPI.Apply(stage.GetPrimAtPath(ELBOW), "angular").CreateStiffnessAttr(1.0)


def _wrong_drive(stage):
    UsdPhysics.DriveAPI.Apply(stage.GetPrimAtPath(CRANK), "linear").CreateStiffnessAttr(1.0)


def _no_gains(stage):
    drive = UsdPhysics.DriveAPI(stage.GetPrimAtPath(CRANK), "angular")
    drive.GetStiffnessAttr().Set(0.0)
    drive.GetDampingAttr().Set(0.0)


def _no_state(stage):
    layer = Sdf.Layer.Find(str(Path(stage.GetRootLayer().realPath).with_name("physics.usda")))
    prim = layer.GetPrimAtPath(ELBOW)
    prim.RemoveProperty(prim.properties["state:angular:physics:position"])


def _dangling(stage):
    UsdPhysics.Joint(stage.GetPrimAtPath(ELBOW)).GetBody1Rel().SetTargets(["/bars/nothing"])


def _same_body(stage):
    UsdPhysics.Joint(stage.GetPrimAtPath(ELBOW)).GetBody1Rel().SetTargets(["/bars/crank"])


def _duplicate(stage):
    UsdGeom.Mesh.Define(stage, "/bars/rocker/crank_visual").CreateSubdivisionSchemeAttr("none")


def _excluded_too_much(stage):
    for name in ("rocker_joint", "closing"):
        joint = UsdPhysics.Joint(stage.GetPrimAtPath(f"/bars/joints/{name}"))
        joint.CreateExcludeFromArticulationAttr(True)


def _floating(stage):
    stage.GetPrimAtPath("/bars/joints/root_joint").SetActive(False)


def _sublayer_unit(stage):
    geometry = Path(stage.GetRootLayer().realPath).with_name("geometry.usdc")
    Sdf.Layer.Find(str(geometry)).pseudoRoot.SetInfo("metersPerUnit", 0.001)


def _inside_out(stage):
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/bars/rocker/rocker_visual"))
    triangles = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    mesh.GetFaceVertexIndicesAttr().Set(triangles[:, ::-1].ravel().tolist())


def _bad_index(stage):
    attribute = UsdGeom.Mesh(stage.GetPrimAtPath("/bars/rocker/rocker_visual")).GetFaceVertexIndicesAttr()
    attribute.Set([99, *list(attribute.Get())[1:]])


def _no_point(stage):
    attribute = UsdGeom.Mesh(stage.GetPrimAtPath("/bars/rocker/rocker_visual")).GetPointsAttr()
    attribute.Set([Gf.Vec3f(float("nan"), 0, 0), *list(attribute.Get())[1:]])


def _millimetres(stage):
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/bars/rocker/rocker_visual"))
    points = [p * 1000 for p in mesh.GetPointsAttr().Get()]
    mesh.GetPointsAttr().Set(points)
    mesh.GetExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))


HALF = Gf.Quatf(0.5, 0, 0, 0)


PRINTED = {
    # the defects of our survey that no public validator reports
    "loop": (put(f"{CLOSING}.physics:excludeFromArticulation", False), "stage.loop", CLOSING),
    "anchor": (put(f"{ELBOW}.physics:localPos0", Gf.Vec3f(0.102, 0, 0)), "stage.anchor", ELBOW),
    "axis": (put(f"{ELBOW}.physics:axis", "X"), "stage.axis", ELBOW),
    "inertia": (
        put("/bars/rocker.physics:diagonalInertia", Gf.Vec3f(1e-4, 1e-4, 9e-4)),
        "stage.inertia",
        "/bars/rocker",
    ),
    "com_in_mm": (put("/bars/rocker.physics:centerOfMass", Gf.Vec3f(110, 0, 0)), "stage.com", "/bars/rocker"),
    "limits": (put(f"{CRANK}.physics:lowerLimit", 180.0), "stage.limits", CRANK),
    "articulation_root": (_no_root, "stage.articulation_root", "/bars"),
    "nested": (_nested, "stage.nested", "/bars/crank/inner"),
    "radians": (put(f"{ELBOW}.state:angular:physics:position", -0.75702), "stage.radians", ELBOW),
    "quaternion": (put(f"{ELBOW}.physics:localRot0", HALF), "stage.quaternion", ELBOW),
    "kilograms": (forget("kilogramsPerUnit"), "stage.kilograms_per_unit", "/"),
    "mirrored": (_mirrored, "stage.mirrored", "/bars/rocker"),
    "mass_missing": (_no_mass, "stage.mass_missing", "/bars/rocker"),
    "op_type": (_op_type, "stage.xform_type", "/bars/rocker"),
}


MORE = {
    "default_prim": (forget("defaultPrim"), "stage.default_prim", "/"),
    "up_axis_missing": (forget("upAxis"), "stage.up_axis", "/"),
    "up_axis": (metadata("upAxis", "Y"), "stage.up_axis", "/"),
    "meters_missing": (forget("metersPerUnit"), "stage.meters_per_unit", "/"),
    "meters": (metadata("metersPerUnit", 0.01), "stage.meters_per_unit", "/"),
    "layer_units": (_sublayer_unit, "stage.layer_units", "geometry.usdc"),
    "frame_rate": (metadata("framesPerSecond", 24.0), "stage.frame_rate", "/"),
    "scale": (_stretched, "stage.scale", "/bars/rocker"),
    "mirrored_mesh": (_mirrored_mesh, "stage.mirrored", "/bars/rocker/rocker_visual"),
    "mass": (put("/bars/rocker.physics:mass", -1.0), "stage.mass", "/bars/rocker"),
    "inertia_negative": (
        put("/bars/rocker.physics:diagonalInertia", Gf.Vec3f(-1e-5, 1e-3, 1e-3)),
        "stage.inertia",
        "/bars/rocker",
    ),
    "inertia_unit": (
        put("/bars/rocker.physics:diagonalInertia", Gf.Vec3f(8.3, 961, 966)),
        "stage.inertia_size",
        "/bars/rocker",
    ),
    "principal_axes": (put("/bars/rocker.physics:principalAxes", HALF), "stage.quaternion", "/bars/rocker"),
    "orient": (put("/bars/rocker.xformOp:orient", Gf.Quatd(0.5, 0, 0, 0)), "stage.quaternion", "/bars/rocker"),
    "dangling": (_dangling, "stage.joint", ELBOW),
    "same_body": (_same_body, "stage.joint", ELBOW),
    "second_root": (_second_root, "stage.articulation_root", "/bars/base"),
    "excluded_too_much": (_excluded_too_much, "stage.disconnected", "/bars/rocker"),
    "floating": (_floating, "stage.floating", "/"),
    "self_collision": (
        put("/bars.physxArticulation:enabledSelfCollisions", True),
        "stage.self_collision",
        "/bars",
    ),
    "joint_collision": (put(f"{ELBOW}.physics:collisionEnabled", True), "stage.joint_collision", ELBOW),
    "state": (put(f"{ELBOW}.state:angular:physics:position", 5.0), "stage.state", ELBOW),
    "state_missing": (_no_state, "stage.state_missing", ELBOW),
    "beyond_limits": (put(f"{CRANK}.physics:upperLimit", 60.0), "stage.beyond_limits", CRANK),
    "radian_target": (
        put(f"{CRANK}.drive:angular:physics:targetPosition", 1.2217),
        "stage.radians",
        CRANK,
    ),
    "drive_target": (
        put(f"{CRANK}.drive:angular:physics:targetPosition", 720.0),
        "stage.drive_target",
        CRANK,
    ),
    "drive_target_nan": (
        put(f"{CRANK}.drive:angular:physics:targetPosition", float("nan")),
        "stage.not_finite",
        CRANK,
    ),
    "centre_nan": (
        put("/bars/rocker.physics:centerOfMass", Gf.Vec3f(float("nan"))),
        "stage.not_finite",
        "/bars/rocker",
    ),
    "inertia_nan": (
        put("/bars/rocker.physics:diagonalInertia", Gf.Vec3f(float("nan"))),
        "stage.not_finite",
        "/bars/rocker",
    ),
    "point_nan": (_no_point, "stage.not_finite", "/bars/rocker/rocker_visual"),
    "drive_missing": (_drive_elsewhere, "stage.drive_missing", CRANK),
    "no_drive_at_all": (_no_drive, "stage.drive_missing", "/"),
    "drive_gains": (_no_gains, "stage.drive_missing", CRANK),
    "drive_axis": (_wrong_drive, "stage.drive_axis", CRANK),
    "op_unlisted": (_op_unlisted, "stage.xform_order", "/bars/rocker"),
    "op_missing": (_op_missing, "stage.xform_order", "/bars/rocker"),
    "op_order": (_op_order, "stage.xform_order", "/bars/rocker"),
    "reset_stack": (_reset_stack, "stage.xform_reset", "/bars/rocker"),
    "duplicate_name": (_duplicate, "stage.duplicate_name", "/bars/rocker/crank_visual"),
    "winding": (_inside_out, "stage.winding", "/bars/rocker/rocker_visual"),
    "point_index": (_bad_index, "stage.point_index", "/bars/rocker/rocker_visual"),
    "extent": (
        put("/bars/rocker/rocker_visual.extent", [Gf.Vec3f(0), Gf.Vec3f(1)]),
        "stage.extent",
        "/bars/rocker/rocker_visual",
    ),
    "subdivision": (
        put("/bars/rocker/rocker_visual.subdivisionScheme", "catmullClark"),
        "stage.subdivision",
        "/bars/rocker/rocker_visual",
    ),
    "millimetres": (_millimetres, "stage.size", "/bars/rocker"),
}
