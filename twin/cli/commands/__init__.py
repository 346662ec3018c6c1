"""The commands of twin: one file for each, with its examples, its arguments and the function that runs it.

A file is imported only when its command is used. Packages that take long to import are imported inside functions, so
that `twin COMMAND --help` is fast. Each file defines:

- `EXAMPLES`: lines at the end of `twin COMMAND --help`;
- `arguments(command)`: adds the arguments of the command;
- `run(args)`: runs the command and returns the exit code.

A key of `HELP` is a command and the name of its file.
"""

HELP = {
    "list": "list the built-in robots and scenes",
    "info": "show a robot: joints, limits, frames, parameters with provenance; or a scene",
    "build": "write the USD stage of a robot from its CAD",
    "plan": "plan the timed motion of a protocol and check every sample",
    "validate": "compare the equations with the mechanism",
    "explain": "show which row of which equation disagrees with the mechanism, why, and the edit that fixes it",
    "prove": "prove that the equations agree with the mechanism at all poses, or show a pose where they do not",
    "run": "build, plan and validate: from CAD to report in one command",
    "selftest": "seed faults into a correct robot, and measure how many the validator finds (mutation score)",
    "view": "show a robot in the browser: play, drag, measure, redesign",
    "serve": "serve a robot or a scene to headsets and browsers: place it in the room, play, grab it",
    "operate": "simulate an operator (hands, pedals) who performs a protocol or a task, and measure the result",
    "session": "replay a session recorded at a console, compare it bit by bit, measure it, export it",
    "track": "simulate computed-torque control along a protocol, and the tip error caused by model mismatch",
    "machine": (
        "simulate a robot as a machine (control software, motors and links at 1 kHz): commands by UDP, states by TCP"
    ),
    "follow": "show a machine live: its measured pose, its desired pose as a ghost, and a plot of their deviation",
    "hazards": (
        "run a fault-injection campaign on the machine of a robot; the same command resumes an interrupted campaign"
    ),
    "study": "check a paper's tables: do totals and p-values follow from the printed rows?",
    "console": "check the published equations of a surgeon's console: hands, clutch, camera, forces",
    "new": "create a robot folder from URDF, MJCF, SDF, a USD stage, or the STEP file of an assembly",
    "export": "export a robot with its motions for headsets, game engines and simulators, and check the files",
    "audit": "check exported files, also from other tools, with independent readers, and compare the files",
    "compare": "compare two or more descriptions of one robot, and name joint, link, file and line that differ",
    "check": "check every robot description in a folder: meshes, masses, limits, loops; SARIF and JUnit for CI",
    "workspace": "compute the workspace: volume, conditioning, margins to limits and singularities",
    "tolerance": "compute the tool error caused by part and encoder errors, and compare it with a requirement",
    "sweep": "evaluate designs with other parameters or distances, on a grid or Latin hypercube",
    "diff": "compare two results in JSON: both verdicts, and the findings and residuals that differ",
    "open": "open the last report in the browser",
    "doctor": "check the installation: packages, programs, ports, graphics; ends with one verdict",
    "completion": "print a script with which bash, zsh or fish completes commands, robots and options",
}
"""What each command does."""

GROUPS = {
    "start": ("list", "info", "new", "run", "open", "doctor", "completion"),
    "judge equations": ("validate", "explain", "prove", "selftest", "diff"),
    "compare and check files": ("compare", "check", "audit"),
    "see and move": ("view", "serve"),
    "write files": ("build", "plan", "export"),
    "analyse a design": ("workspace", "tolerance", "sweep"),
    "operate and simulate": ("operate", "session", "track", "machine", "follow", "hazards"),
    "check publications": ("study", "console"),
}
"""The commands by job, in the order of `twin --help`."""

FIRST = """\
twin compares the equations of a robot with its CAD, and shows where they disagree.

  twin run sils --open       a robot that comes with twin, from CAD to report
  twin view sils             drag it in the browser
  twin new arm.urdf          your robot: from URDF, MJCF, SDF, xacro, USD, STEP or a DH table
  twin validate my_robot/    your equations (formula.py) against your CAD
  twin compare a.urdf b.xml  two descriptions of one robot

  twin list, twin doctor, twin --help, twin COMMAND --help
"""
"""What `twin` alone prints."""
