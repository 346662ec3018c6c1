"""The C# of the Unity package, compiled and run by mono against a stub of UnityEngine, and spoilt to see it fail.

The stub is ours: this shows that the arithmetic, the readers and the stream are right, not that Unity runs them.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from made.lanes import nightly
from unity import mono

pytestmark = pytest.mark.witness


def test_every_test_of_the_package_passes(build):
    outcome = mono.nunit(build.folder)
    assert outcome.failed == ()
    assert len(outcome.passed) >= 74, outcome.fault


def test_newer_syntax_is_refused(build, tmp_path):
    """What Unity takes and IL2CPP of an old Unity may not."""
    source = tmp_path / "New.cs"
    source.write_text("public static class New { public static int F(int a) { return a switch { 1 => 2, _ => 3 }; } }")
    with pytest.raises(ChildProcessError):
        mono.compiled([source], tmp_path / "New.dll", library=True)


@pytest.mark.parametrize("convention", mono.CONVENTIONS)
def test_every_link_of_every_track_is_where_it_should_be(build, case, judge, convention):
    """Played by TrackPlayer; what Unity's world shows is turned back with matrices."""
    mirror, root = mono.CONVENTIONS[convention]
    printed = {"version": f"Unity package on {mono.version()}, stub of the engine, {convention}"}
    for protocol, motion in case.motions.items():
        track = case.folder / f"tracks/{protocol}.json"
        times = [repr(float(t)) for t in motion.times]
        done = mono.run(["mono", str(build.folder / "PlayTrack.exe"), str(track), convention, *times])
        assert done.returncode == 0, done.stderr
        links = {}
        for name, seen in json.loads(done.stdout).items():
            corners = np.array(seen)  # images of the origin and of the ends of the axes, in Unity's world
            W = np.tile(np.eye(4), (len(corners), 1, 1))
            W[:, :3, 3] = mono.turned_back(convention, corners[:, 0])
            axes = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
            W[:, :3, :3] = mirror.T @ root.T @ axes @ mirror
            links[name] = W.reshape(len(W), 16).tolist()
        printed[f"tracks {protocol}"] = {"links": links}
    judge(printed, case)


MUTATIONS = {
    "glTFast: sign of a quaternion": (
        "Frames.cs",
        "? new Quaternion(-q.y, q.z, q.x, -q.w)\n                : new Quaternion(q.x, -q.y, -q.z, q.w);",
        "? new Quaternion(-q.y, q.z, q.x, -q.w)\n                : new Quaternion(q.x, q.y, q.z, q.w);",
    ),
    "FLU to RUF: sign of y": ("Frames.cs", "new Vector3(-p.y, p.z, p.x)", "new Vector3(p.y, p.z, p.x)"),
    "FLU to RUF: sign of w": (
        "Frames.cs",
        "? new Quaternion(-q.y, q.z, q.x, -q.w)",
        "? new Quaternion(-q.y, q.z, q.x, q.w)",
    ),
    "back from RUF": ("Frames.cs", "new Vector3(p.z, -p.x, p.y)", "new Vector3(p.z, p.x, p.y)"),
    "root is not turned": (
        "Frames.cs",
        "new Quaternion(-HalfRoot, 0f, 0f, HalfRoot)",
        "new Quaternion(HalfRoot, 0f, 0f, HalfRoot)",
    ),
    "slerp takes the long way": ("Frames.cs", "dot < 0.0 ? -1.0 : 1.0", "1.0"),
    "slerp is not even": ("Frames.cs", "if (sine > 1e-9)", "if (sine > 1e9)"),
    "wxyz instead of xyzw": (
        "Track.cs",
        "new Quaternion(from[at + 3], from[at + 4], from[at + 5], from[at + 6])",
        "new Quaternion(from[at + 4], from[at + 5], from[at + 6], from[at + 3])",
    ),
    "next frame": ("Keys.cs", "first = low;", "first = low + 1 < last ? low + 1 : low;"),
    "link-major poses": ("Track.cs", "(key * links.Length + link) * PoseSize", "(link * frames + key) * PoseSize"),
    "share of the wrong interval": ("Keys.cs", "(times[low + 1] - times[low])", "(times[last] - times[0])"),
    "end is the key before": (
        "Keys.cs",
        "first = last - 1;\n                share = 1.0;",
        "first = last - 1;\n                share = 0.0;",
    ),
    "phases begin late": ("Track.cs", "if (phase_start[i] <= time)", "if (phase_start[i] < time)"),
    "a joint steps": ("Track.cs", "value + share * (next - value)", "value"),
    "sign flips are not seen": ("TrackCheck.cs", "Dot(t.poses, i + 3, i + 3 - stride) < 0.0", "false"),
    "any quaternion is unit": (
        "TrackCheck.cs",
        "private const double UnitTolerance = 1e-5;",
        "private const double UnitTolerance = 1e5;",
    ),
    "seek past the end": ("Playhead.cs", "Math.Min(end, time)", "time"),
    "a loop starts at zero": (
        "Playhead.cs",
        "Seek(start + (along < 0.0 ? along + length : along));",
        "Seek(start);",
    ),
    "speed is ignored": ("Playhead.cs", "Time + passed * speed", "Time + passed"),
    "end is told for ever": ("Playhead.cs", "IsPlaying = !over;", ""),
    "a shape is left out": (
        "DeformableMotion.cs",
        "int s = 0; s < b.Shapes.Length; s++)\n            {\n                double",
        "int s = 1; s < b.Shapes.Length; s++)\n            {\n                double",
    ),
    "a factor steps": ("DeformableMotion.cs", "if (share > 0.0)", "if (share > 1.0)"),
    "factors by shape": (
        "DeformableMotion.cs",
        "b.Factors[key * b.Shapes.Length + s]",
        "b.Factors[s * b.Times.Length + key]",
    ),
    "vertices from the start of the view": (
        "GlbFile.cs",
        "(long)view.byteOffset + found.byteOffset;",
        "view.byteOffset;",
    ),
    "faces look inwards": ("DeformableMesh.cs", "corners[i - i % 3 + 2 - i % 3]", "corners[i]"),
    "colours stay linear": ("DeformableMesh.cs", "color = color.gamma", "color = color"),
    "the copy of a material stays": ("DeformableMesh.cs", "Destroy(mesh.own);", ""),
    "a paused motion is computed again": ("DeformablePlayer.cs", "if (head.Time != before)", ""),
    "organs do not wait for the robot": ("DeformablePlayer.cs", "Seek(player.Time);", "Seek(passed);"),
    "radians into a drive": ("ArticulationDriver.cs", "inUnity * Mathf.Rad2Deg", "inUnity"),
    "what was reached has no sign": (
        "ArticulationDriver.cs",
        "entry.sign * inUnity - entry.offset",
        "inUnity - entry.offset",
    ),
    "degrees into a slide": (
        "ArticulationDriver.cs",
        "track.IsAngle(joint) ? inUnity",
        "!track.IsAngle(joint) ? inUnity",
    ),
    "limits are passed": (
        "ArticulationDriver.cs",
        "Mathf.Clamp(value, track.joint_lower[joint], track.joint_upper[joint])",
        "value",
    ),
    "the copy of a drive is lost": ("ArticulationDriver.cs", "entry.body.xDrive = drive;", ""),
    "world instead of local": ("LinkBinding.cs", "flat = flat && link.parent == Root;", "flat = true;"),
    "inner links first": ("LinkBinding.cs", "depths[i]++;", "depths[i]--;"),
    "sequence at another offset": (
        "StreamFrame.cs",
        "Sequence = U32(data, begin + 4);",
        "Sequence = U32(data, begin + 8);",
    ),
    "big endian": (
        "StreamFrame.cs",
        "data[at] | data[at + 1] << 8 | data[at + 2] << 16 | data[at + 3] << 24",
        "data[at + 3] | data[at + 2] << 8 | data[at + 1] << 16 | data[at] << 24",
    ),
    "clip time is server time": (
        "StreamFrame.cs",
        "ClipTime = F64(data, begin + 16);",
        "ClipTime = F64(data, begin + 8);",
    ),
    "a torn frame passes": ("StreamFrame.cs", "if (count != size)", "if (count < 0)"),
    "NaN passes": ("StreamFrame.cs", "(U32(data, at) & 0x7F800000) == 0x7F800000", "false"),
    "sequence ends at 2^32": ("StreamFrame.cs", "unchecked((int)(sequence - than)) > 0", "sequence > than"),
    "the ghost stays": ("StreamFrame.cs", "Array.Clear(Ghost, 0, Ghost.Length);", ""),
    "the hand's turn is forgotten": ("Grab.cs", "hand + turn * inHand", "hand + inHand"),
    "the tool sits on its link's origin": ("Grab.cs", "position = position + rotation * onLink;", ""),
    "drags pile up": (
        "Grab.cs",
        "Requests.DragPose(position, Unit(rotation)), true",
        "Requests.DragPose(position, Unit(rotation)), false",
    ),
    "comma instead of point": (
        "StreamMessages.cs",
        'value.ToString("G9", CultureInfo.InvariantCulture)',
        'value.ToString("G9")',
    ),
    "five digits": ("StreamMessages.cs", '"G9"', '"G5"'),
    "a failed check passes": (
        "SelfChecks.cs",
        'get { return Fault == "" && Count > 0 && Worst <= Tolerance; }',
        "get { return true; }",
    ),
}
"""Name: file of the runtime, text that is there once, what takes its place."""


@pytest.mark.parametrize("name", nightly(MUTATIONS, every=4))
def test_a_mistake_turns_tests_red(build, tmp_path, name):
    said = build.mutant(tmp_path / "mutant", *MUTATIONS[name])
    assert said == "", f"the mutant does not compile, so it shows nothing: {said}"
    outcome = mono.nunit(tmp_path / "mutant")
    assert outcome.fault == ""
    assert outcome.failed, f"every test passes in spite of: {name}"
