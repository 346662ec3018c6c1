"""What to do about a finding of an audit, by its code."""

from __future__ import annotations

from collections.abc import Mapping

ADVICE: Mapping[str, str] = {
    "audit.no_checks": "audit an export of the same robot in another format with these files, or use --robot NAME",
    "claims.between_position": "measure the error between keys again",
    "claims.between_rotation": "measure the error between keys again",
    "claims.joint_gap": "measure the error between keys again",
    "compare.between": "use LINEAR interpolation between the keys",
    "compare.joint": "write joint values in radians and metres",
    "compare.model_hash": "export all files again, together",
    "compare.pose": "find out which file is wrong: `twin audit --robot NAME` computes the correct poses",
    "compare.shape": "check units, mirroring and the link of each mesh",
    "compare.times": "check the rate, and the units of time",
    "gltf.duplicate_name": "give each node a unique name",
    "gltf.matrix": "write translation, rotation and scale instead of a matrix",
    "gltf.quaternion": "normalise the quaternion; the order of components in glTF is x, y, z, w",
    "gltf.scale": "scale the mesh points instead",
    "index": "number the points from 0 to their count minus 1",
    "mjcf.loop": "check the anchors of the equality constraints, and the zero positions of the joints",
    "name": "use only letters, digits and underscores, which every format allows",
    "normals_against": "reverse the normals or the winding",
    "proof.hash": "export again; the measured values belong to the original file",
    "quaternion": "normalise the quaternion",
    "quaternion_sign": "negate quaternions so that successive quaternions have a positive dot product",
    "step": "write more keys",
    "usd.joint_gap": "check the joint's frames and the poses of its bodies",
    "usdz.alignment": "pad the extra field of the file's zip header",
    "winding": "reverse the faces of the mesh, so that they are counter-clockwise seen from outside",
    "winding_mixed": "orient all faces counter-clockwise seen from outside",
}
"""Suggestion for each finding code. A code without a format, such as "step", applies to all formats ("gltf.step")."""
