"""Seeded defects of motors and transmissions in exports; `audit_seeds` has the other defects."""

from __future__ import annotations

from pathlib import Path

from pxr import Gf

from made.audit_seeds import Seed, attribute, by, layers, row, stored, xml

SEEDS: list[Seed] = []


def gain(factor: float):
    def change(root):
        pulling = root.find("actuator/general[@tendon]")
        pulling.set("gainprm", by(factor)(pulling.get("gainprm")))
        pulling.set("biasprm", row(lambda v: v * (factor, factor, 1))(pulling.get("biasprm")))

    return change


def without_motor(root):
    actuators = root.find("actuator")
    actuators.remove(actuators.find("*[@tendon]"))
    root.find("custom").remove(root.find("custom/tuple"))
    root.find("keyframe/key").attrib.pop("ctrl")


def reduction(new):
    def change(root):
        for e in (e for e in root.iter("mechanicalReduction") if e.text != "1"):
            e.text = new(e.text)

    return change


for name, suffix, change, says in (
    ("ratio x 1.001", "xml", attribute("tendon/fixed/joint", "coef", by(1.001)), "joint factors of the transmission"),
    (
        "ratio turned round",
        "xml",
        attribute("tendon/fixed/joint", "coef", by(-1.0), -1),
        "joint factors of the transmission",
    ),
    ("range", "xml", attribute("tendon/fixed", "range", by(1.1)), "motor .*limits"),
    ("force", "xml", attribute("actuator/*[@tendon]", "forcerange", by(10)), "motor .*maximum effort"),
    ("rotor", "xml", attribute("tendon/fixed", "armature", by(1e3)), "motor .*rotor inertia"),
    ("gain x 10", "xml", gain(10.0), "stiffness"),
    ("deleted", "xml", without_motor, "motor .*(missing|not in)"),
    ("kind", "xml", attribute("custom/text", "data", lambda _: "length"), "kind"),
    ("reduction halved", "urdf", reduction(by(0.5)), "joint factors of the transmission"),
    ("reduction turned round", "urdf", reduction(by(-1.0)), "joint factors of the transmission"),
    ("reduction forgotten", "urdf", reduction(lambda _: "1"), "joint factors of the transmission"),
):
    SEEDS.append(Seed(f"{suffix}: {name}", xml(f".{suffix}", change), rf"\.{suffix}", says))


def usd(change):
    """Return an edit of the robot's customData: `change` edits a dictionary with "actuators" and "transmissions"."""

    def edit(folder: Path):
        layer, name = layers(folder)
        spec = layer.GetPrimAtPath(f"/{name}")
        told = {k: dict(v) for k, v in dict(spec.customData)["twin"].items()}
        change(told)
        spec.customData = {"twin": told}
        stored(layer, folder)

    return edit


def entry(kind: str, key: str, new):
    def change(told):
        name = next(iter(told[kind]))
        told[kind][name] = {**told[kind][name], key: new(told[kind][name][key])}

    return change


for name, change, says in (
    (
        "matrix",
        entry("transmissions", "matrix", lambda m: type(m)([1.001 * v for v in m])),
        "joint factors of the transmission",
    ),
    ("limits", entry("actuators", "limits", lambda v: Gf.Vec2d(v[0], v[1] / 2)), "motor .*limits"),
    ("effort", entry("actuators", "max_effort", lambda v: 10 * v), "motor .*maximum effort"),
    ("rotor", entry("actuators", "rotor_inertia", lambda v: 10 * v), "motor .*rotor inertia"),
    ("forgotten", lambda told: [told.pop(k) for k in ("actuators", "transmissions")], "motor .*(missing|not in)"),
):
    SEEDS.append(Seed(f"usd: {name}", usd(change), r"\.usd", says))
