"""How long the C# kinematics of a robot take for a call, in mono: microseconds, the least of eight rounds.

    python tests/benchmarks/device.py [robot ...] [--repeat 2000]

A move closes the loops at other joint values and computes all link poses; the inverse is that of the equations; the
check computes limits and measures; the grab is one step of the tool. IL2CPP on a headset compiles ahead of time and was
not measured. Exit code 1 if a call takes more than 0.5 ms. Not a test.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import twin
from twin.exchange.formats.unity.kinematics import DeviceModel, class_name, source
from twin.reference import ReferenceModel
from twin.reference.joint_range import joint_range
from unity import mono

BAR_US = 500.0
CALLS = ("move", "inverse", "check", "grab")


def times(name: str, folder: Path, repeat: int) -> list[float]:
    """Return the microseconds of each of `CALLS`."""
    robot = twin.load(name)
    file = folder / f"{class_name(name)}.cs"
    file.write_text(source(DeviceModel(robot.mechanism, robot.kinematics(), robot.gaps)))
    runtime = mono.PACKAGE / "Runtime"
    program = folder / f"{name}.exe"
    shared = [runtime / "IRobotKinematics.cs", runtime / "KinematicGrab.cs", mono.HERE / "device/Device.cs"]
    mono.compiled([file, *shared], program, define="TWIN_PLAYER")
    q = joint_range(ReferenceModel(robot.mechanism), 24).run.q
    home = robot.mechanism.home if robot.mechanism.home is not None else q[0]
    far = q[np.argmax(np.linalg.norm(q - home, axis=1))]
    there = home + 0.02 * (far - home)
    script = folder / f"{name}.txt"
    lines = []
    for command, numbers in (("move", home), (f"time {repeat}", there)):
        lines.append(" ".join([command, *(repr(float(x)) for x in numbers)]))
    script.write_text("\n".join(lines) + "\n")
    done = mono.run(["mono", str(program), class_name(name), str(script)])
    return [float(x) for x in done.stdout.splitlines()[-1].split("|")[2].split()]


def main() -> int:
    """Print a row for each robot."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", default=twin.names())
    parser.add_argument("--repeat", type=int, default=400)
    options = parser.parse_args()
    print(f"{'µs a call':16s}" + "".join(f"{call:>10s}" for call in CALLS))
    worst = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for name in options.robots:
            found = times(name, Path(folder), options.repeat)
            worst = max(worst, *found)
            print(f"{name:16s}" + "".join(f"{value:10.1f}" for value in found))
    return int(worst > BAR_US)


if __name__ == "__main__":
    sys.exit(main())
