"""Draw the SILS parallel robot and write it as a STEP assembly.

    python cad/sils/model.py [--dimensions FILE] [--out sils.step]

The robot stands in the posture given in the dimension file.  Each rigid body
is one sub-assembly (frame, limb1..3, carriage1..6, strut1..3, bar1..3,
platform); its parts are named <body>_<part>.  All shapes are written in world
coordinates: no instance carries a placement.
"""

import argparse
import importlib.util
import re
import sys
import tempfile
import tomllib
from math import isfinite
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
PROVENANCES = {"SEED", "CITED", "DERIVED", "ASSUMED"}
ERRORS = {  # which manufacturing errors each kind of body knows
    "carriage": {"l0_mm", "pin_offset_mm", "pin_tilt_deg", "bore_offset_mm", "bore_tilt_deg"},
    "strut": {
        "l1_mm",
        "pivot_bore_offset_mm",
        "pivot_bore_tilt_deg",
        "apex_pin_offset_mm",
        "apex_pin_tilt_deg",
    },
    "bar": {
        "l1_mm",
        "l2_mm",
        "pivot_bore_offset_mm",
        "pivot_bore_tilt_deg",
        "apex_bore_offset_mm",
        "apex_bore_tilt_deg",
        "ball_offset_mm",
    },
    "platform": {"s1_offset_mm", "s2_offset_mm", "s3_offset_mm", "scope_tip_mm"},
}
BODIES = [
    "frame",
    "limb1",
    "limb2",
    "limb3",
    *(f"carriage{k}" for k in range(1, 7)),
    *(f"strut{n}" for n in (1, 2, 3)),
    *(f"bar{n}" for n in (1, 2, 3)),
    "platform",
]


# ---- dimensions -------------------------------------------------------------
class Dimensions:
    """Values of the dimension file as attributes; `error(body)` gives its overrides."""

    def __init__(self, path):
        with Path(path).open("rb") as f:
            data = tomllib.load(f)
        self.parts = data.pop("part", {})
        for name, entry in data.items():
            if not isinstance(entry, dict) or not {"value", "unit", "provenance"} <= set(entry):
                raise ValueError(f"{path}: [{name}] needs value, unit and provenance")
            if entry["unit"] not in ("mm", "deg"):
                raise ValueError(f"{path}: [{name}] unit must be mm or deg, not {entry['unit']!r}")
            if entry["provenance"] not in PROVENANCES:
                raise ValueError(f"{path}: [{name}] provenance {entry['provenance']!r} unknown")
            if not all(isfinite(v) for v in np.atleast_1d(entry["value"])):
                raise ValueError(f"{path}: [{name}] is not finite")
            setattr(self, name, entry["value"])
        for body, given in self.parts.items():
            known = ERRORS.get(body.rstrip("0123456789"))
            if body not in BODIES or known is None:
                raise ValueError(f"{path}: [part.{body}] is no part that takes errors")
            if not set(given) <= known:
                raise ValueError(
                    f"{path}: [part.{body}] does not know {sorted(set(given) - known)}, only {sorted(known)}"
                )
            for key, value in given.items():
                count = np.size(value)
                fits = (
                    count == (3 if body == "platform" or key == "ball_offset_mm" else 2)
                    if key.endswith("offset_mm")
                    else count == 1 or (count == 2 and key.endswith("deg"))
                )
                if not fits or not np.issubdtype(np.asarray(value).dtype, np.number) or not np.all(np.isfinite(value)):
                    raise ValueError(f"{path}: [part.{body}] {key} = {value!r} has the wrong form")

    def __getattr__(self, name):
        raise AttributeError(f"the dimension file has no [{name}]")

    def error(self, body):
        """Lookup (key, nominal) -> value of one body."""
        given = self.parts.get(body, {})
        return lambda key, nominal: given.get(key, nominal)


# ---- placement, by construction ---------------------------------------------
def rotation(psi, theta, phi):
    """Rz(psi) Ry(theta) Rx(phi), angles in degrees."""
    (a, b, c), (u, v, w) = np.cos(np.radians([psi, theta, phi])), np.sin(np.radians([psi, theta, phi]))
    rz = np.array([[a, -u, 0], [u, a, 0], [0, 0, 1]])
    ry = np.array([[b, 0, v], [0, 1, 0], [-v, 0, b]])
    return rz @ ry @ np.array([[1, 0, 0], [0, c, -w], [0, w, c]])


def line_sphere(start, direction, centre, radius):
    """Both points of a line on a sphere, lower one first; None if it misses."""
    middle = direction @ (centre - start)
    gap = radius**2 - np.sum((start + middle * direction - centre) ** 2)
    if gap < 0:
        return None
    return [start + (middle + s * np.sqrt(gap)) * direction for s in (-1, 1)]


def pose4(origin, x, y, z):
    """4x4 matrix of a frame."""
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([x, y, z, origin])
    return matrix


def placements(d, position, angles):
    """World placement (4x4, mm) of every body at a platform pose; None if out of reach.

    Each limb is found with ruler and compasses: the ball centre gives the limb
    plane; in it the pivot line runs parallel to the rail; a sphere around the
    ball centre cuts the bar pivot out of it, a sphere around the apex the
    strut pivot.
    """
    turn, e = rotation(*angles), np.array(position, float)
    out = {"frame": np.eye(4), "platform": pose4(e, *turn.T)}
    third = d.lp / np.sqrt(3)
    balls = [(third / 2, -d.lp / 2, 0), (-third, 0, 0), (third / 2, d.lp / 2, 0)]
    up, along = np.array([0.0, 0, 1]), np.array([0.0, 1, 0])
    rails = [((0, 0, 0), up, 1), ((0, 0, d.LV), along, 0), ((0, d.LH, 0), up, 1)]
    for n, (origin, axis, which) in enumerate(rails, 1):
        origin, s = np.array(origin, float), e + turn @ balls[n - 1]
        radial = (s - origin) - axis * (axis @ (s - origin))
        radial /= np.linalg.norm(radial)
        t = np.cross(axis, radial)
        start = origin + d.l0 * radial
        cuts = line_sphere(start, axis, s, d.l1 + d.l2)
        if cuts is None:
            return None
        pivot = cuts[which]
        u = (s - pivot) / np.linalg.norm(s - pivot)
        apex = pivot + d.l1 * u
        foot = line_sphere(start, axis, apex, d.l1)[1 - which]
        v = (apex - foot) / np.linalg.norm(apex - foot)
        out[f"limb{n}"] = pose4(origin, radial, t, axis)
        for k, point in ((2 * n - 1, foot), (2 * n, pivot)):
            out[f"carriage{k}"] = pose4(point - d.l0 * radial, radial, t, axis)
        out[f"strut{n}"] = pose4(foot, v, np.cross(t, v), t)
        out[f"bar{n}"] = pose4(pivot, u, np.cross(t, u), t)
    return out


# ---- drawing ----------------------------------------------------------------
def drawing():
    """Load parts.py beside this file; late, because build123d takes seconds."""
    if "sils_parts" not in sys.modules:
        spec = importlib.util.spec_from_file_location("sils_parts", HERE / "parts.py")
        sys.modules["sils_parts"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules["sils_parts"])
    return sys.modules["sils_parts"]


def draw(d):
    """Parts of all bodies in their body frames: {body: [(part, solid, material)]}."""
    parts = drawing()
    out = {"frame": parts.frame(d)}
    for n in (1, 2, 3):
        out[f"limb{n}"] = parts.limb(d, n)
    for k in range(1, 7):
        out[f"carriage{k}"] = parts.carriage(d, k, d.error(f"carriage{k}"))
    for n in (1, 2, 3):
        out[f"strut{n}"] = parts.strut(d, d.error(f"strut{n}"))
    for n in (1, 2, 3):
        out[f"bar{n}"] = parts.bar(d, d.error(f"bar{n}"))
    out["platform"] = parts.platform(d, d.error("platform"))
    return out


def bake(solid, matrix):
    """Copy of a solid with the placement worked into its geometry; checked."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.BRepGProp import BRepGProp
    from OCP.gp import gp_Trsf
    from OCP.GProp import GProp_GProps
    from OCP.TopAbs import TopAbs_SHELL, TopAbs_SOLID
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    found = TopExp_Explorer(solid.wrapped, TopAbs_SOLID)
    if not found.More():
        raise ValueError("no solid")
    one = found.Current()
    found.Next()
    if found.More():
        raise ValueError("more than one solid")
    inner = one.Location().Transformation()
    trsf = gp_Trsf()
    trsf.SetValues(*[float(v) for v in matrix[:3].ravel()])
    trsf.Multiply(inner)
    shape = BRepBuilderAPI_Transform(one.Located(TopLoc_Location()), trsf, True).Shape()
    if not BRepCheck_Analyzer(shape).IsValid():
        raise ValueError("not valid")
    shells = TopExp_Explorer(shape, TopAbs_SHELL)
    while shells.More():
        if not TopoDS.Shell(shells.Current()).Closed():
            raise ValueError("open shell")
        shells.Next()
    mass = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, mass)
    if mass.Mass() <= 0:
        raise ValueError("no volume")
    return shape, mass.Mass()


def write_step(tree, path, title="sils"):
    """Write {body: [(name, shape, rgb)]} as an AP214 assembly, same bytes every time."""
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.Interface import Interface_Static
    from OCP.Message import Message, Message_Gravity
    from OCP.Quantity import Quantity_Color, Quantity_TypeOfColor
    from OCP.STEPCAFControl import STEPCAFControl_Controller, STEPCAFControl_Writer
    from OCP.STEPControl import STEPControl_StepModelType
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDataStd import TDataStd_Name
    from OCP.TDocStd import TDocStd_Document
    from OCP.TopLoc import TopLoc_Location
    from OCP.XCAFApp import XCAFApp_Application
    from OCP.XCAFDoc import XCAFDoc_ColorType, XCAFDoc_DocumentTool
    from OCP.XSControl import XSControl_WorkSession

    for printer in Message.DefaultMessenger_s().Printers():
        printer.SetTraceLevel(Message_Gravity.Message_Fail)
    doc = TDocStd_Document(TCollection_ExtendedString("XmlOcaf"))
    XCAFApp_Application.GetApplication_s().NewDocument(TCollection_ExtendedString("MDTV-XCAF"), doc)
    XCAFDoc_DocumentTool.SetLengthUnit_s(doc, 0.001)
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(doc.Main())
    colours = XCAFDoc_DocumentTool.ColorTool_s(doc.Main())
    shapes.SetAutoNaming_s(False)

    def name(label, text):
        TDataStd_Name.Set_s(label, TCollection_ExtendedString(text))

    def hang(parent, child, text):
        name(child, text)
        name(shapes.AddComponent(parent, child, TopLoc_Location()), text)

    root = shapes.NewShape()
    name(root, title)
    for body, entries in tree.items():
        node = shapes.NewShape()
        for text, shape, rgb in entries:
            label = shapes.AddShape(shape, False)
            tint = Quantity_Color(*rgb, Quantity_TypeOfColor.Quantity_TOC_sRGB)
            colours.SetColor(label, tint, XCAFDoc_ColorType.XCAFDoc_ColorSurf)
            hang(node, label, text)
        hang(root, node, body)
    shapes.UpdateAssemblies()

    STEPCAFControl_Controller.Init_s()
    writer = STEPCAFControl_Writer(XSControl_WorkSession(), False)
    writer.SetColorMode(True)
    writer.SetNameMode(True)
    Interface_Static.SetCVal_s("write.step.schema", "AP214IS")
    Interface_Static.SetCVal_s("write.step.unit", "MM")
    Interface_Static.SetIVal_s("write.surfacecurve.mode", 0)
    writer.Transfer(doc, STEPControl_StepModelType.STEPControl_AsIs)
    path = Path(path)
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        raw, clean = Path(folder, "raw.step"), Path(folder, path.name)
        if writer.Write(str(raw)) != IFSelect_ReturnStatus.IFSelect_RetDone:
            raise OSError(f"STEP writer failed for {path}")
        clean.write_bytes(normalise(raw.read_bytes().decode("ascii"), title).encode("ascii"))
        clean.replace(path)


SHARED = (
    "CARTESIAN_POINT(",
    "DIRECTION(",
    "VECTOR(",
    "AXIS2_PLACEMENT_3D(",
    "COLOUR_RGB(",
    "FILL_AREA_STYLE",
    "SURFACE_STYLE",
    "SURFACE_SIDE",
    "PRESENTATION_STYLE_ASSIGNMENT(",
    "( LENGTH_UNIT",
    "( NAMED_UNIT",
    "UNCERTAINTY_",
)
REAL = re.compile(r"-?\d+\.\d*(?:E[+-]\d+)?")
LINK = re.compile(r"#(\d+)")


def normalise(text, title):
    """Neutral header, coordinates to 1e-10 mm, equal points, directions and styles shared.

    OCC writes every point and direction anew, and the colours in the order of
    memory addresses.  Sharing shrinks the file, sorting makes it repeatable.
    Representation contexts and the placements of the assembly stay as they are.
    """
    header, body = text.split("DATA;", 1)
    name = f"FILE_NAME('{title}','1970-01-01T00:00:00',(''),(''),'','cad/sils/model.py','');"
    header, count = re.subn(r"FILE_NAME\(.*?\);", name, header, count=1, flags=re.S)
    body = re.sub(r"\s*\n\s*", "", body.rsplit("ENDSEC;", 1)[0])
    entities = dict(re.findall(r"#(\d+) = (.*?);(?=#|$)", body))
    if count != 1 or not entities:
        raise ValueError("STEP file not understood")
    digits = {"CARTESIAN_POINT(": 10, "DIRECTION(": 13, "COLOUR_RGB(": 4}
    placed, styles = set(), []
    for key, value in entities.items():
        kind = value[: value.find("(") + 1]
        if kind in digits:
            entities[key] = REAL.sub(lambda m, n=digits[kind]: short(m[0], n), value)
        elif kind in ("ITEM_DEFINED_TRANSFORMATION(", "SHAPE_REPRESENTATION("):
            placed.update(LINK.findall(value))
        elif kind == "STYLED_ITEM(":
            styles.append((int(LINK.findall(value)[-1]), key))
    changed = True
    while changed:
        seen, target = {}, {}
        for key, value in entities.items():
            if value.startswith(SHARED) and key not in placed:
                first = seen.setdefault(value, key)
                if first != key:
                    target[key] = first
        for key in target:
            del entities[key]
        for key, value in entities.items():
            entities[key] = LINK.sub(lambda m, t=target: "#" + t.get(m[1], m[1]), value)
        changed = bool(target)
    listed = {LINK.findall(v)[0]: k for k, v in entities.items() if v.startswith("MECHANICAL_DESIGN")}
    late = (
        "STYLED",
        "MECHANICAL_DESIGN",
        "PRESENTATION_STYLE",
        "SURFACE_STYLE",
        "SURFACE_SIDE",
        "FILL_AREA",
        "COLOUR",
    )
    order = [k for k, v in entities.items() if not v.startswith(late)]
    taken = set(order)

    def take(key):
        if key not in taken:
            taken.add(key)
            order.append(key)
            for link in LINK.findall(entities[key]):
                take(link)

    for _, key in sorted(styles):
        take(listed[key])
    number = {key: str(k) for k, key in enumerate(order, 1)}
    lines = [f"#{number[k]}={LINK.sub(lambda m: '#' + number[m[1]], entities[k])};" for k in order]
    return f"{header.replace(chr(13), '')}DATA;\n" + "\n".join(lines) + "\nENDSEC;\nEND-ISO-10303-21;\n"


def short(number, digits):
    """Round a STEP real; no negative zero."""
    value = round(float(number), digits) + 0.0
    return re.sub(r"\.0$", ".", repr(value)).upper() if "e" not in repr(value) else f"{value:.{digits}f}".rstrip("0")


def main(arguments=None):
    """Command line."""
    parser = argparse.ArgumentParser(
        description="Draw the SILS robot and write a STEP assembly (mm, world coordinates).",
        epilog="[part.<body>] tables in the dimension file draw single bodies with a manufacturing error;"
        " placements stay nominal.",
    )
    parser.add_argument(
        "--dimensions",
        type=Path,
        default=HERE / "dimensions.toml",
        metavar="FILE",
        help="dimension file (default: %(default)s)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=HERE / "sils.step",
        metavar="FILE",
        help="STEP file to write (default: %(default)s)",
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing")
    options = parser.parse_args(arguments)
    try:
        d = Dimensions(options.dimensions)
        where = placements(d, d.pose_position, d.pose_angles)
        if where is None:
            raise ValueError("the drawn pose is out of reach of these lengths")
        tree, total = build(d, where)
        write_step(tree, options.out)
    except (OSError, ValueError, AttributeError) as trouble:
        parser.exit(1, f"model.py: {trouble}\n")
    if not options.quiet:
        count = sum(len(v) for v in tree.values())
        size = options.out.stat().st_size / 1e6
        print(f"{options.out}: {len(tree)} bodies, {count} parts, {total:.2f} kg, {size:.2f} MB")


def build(d, where):
    """Baked, checked parts: {body: [(name, shape, rgb)]} and the total mass in kg."""
    drawn, tree, total = draw(d), {}, 0.0
    materials = drawing().MATERIALS
    for body in BODIES:
        tree[body] = []
        for part, solid, material in drawn[body]:
            text = f"{body}_{part}"
            rgb, density = materials[material]
            try:
                shape, volume = bake(solid, where[body])
            except ValueError as trouble:
                raise ValueError(f"part {text}: {trouble}") from None
            tree[body].append((text, shape, rgb))
            total += volume * density * 1e-9
    return tree, total


if __name__ == "__main__":
    main()
