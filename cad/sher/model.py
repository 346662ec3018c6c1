"""Draw the SHER 3.0 robot and write it as a STEP assembly.

    python cad/sher/model.py [--dimensions FILE] [--out sher.step]

The robot stands in the posture given in the dimension file.  Each rigid body
is one sub-assembly; its parts are named <body>_<part>.  All shapes are written
in world coordinates: no instance carries a placement.
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
LEGS = [f"{i}{k}" for i in (1, 2, 3) for k in "ab"]
ERRORS = {  # which manufacturing errors each body knows
    **{f"carriage{i}": {"rail_bore_offset_mm", "bore_a_offset_mm", "bore_b_offset_mm"} for i in (1, 2, 3)},
    **{f"cross{n}": {"pin2_offset_mm"} for n in LEGS},
    **{f"rod{n}": {"length_mm", "bore_offset_mm", "ball_offset_mm"} for n in LEGS},
    "platform": {"roll_offset_mm", *(f"s{n}_offset_mm" for n in LEGS)},
    "arm": {"pin_a_offset_mm", "pin_a_tilt_deg", "pin_b_offset_mm", "pin_b_tilt_deg"},
    "tilt_slider": {"rail_bore_offset_mm", "pin_r_offset_mm", "pin_r_tilt_deg"},
    "l5": {"length_mm", "bore_r_offset_mm", "bore_r_tilt_deg", "bore_q_offset_mm", "bore_q_tilt_deg"},
    "l4": {
        "DA_mm",
        "AQ_mm",
        "phi2_deg",
        "bore_a_offset_mm",
        "bore_a_tilt_deg",
        "pin_q_offset_mm",
        "pin_q_tilt_deg",
        "pin_d_offset_mm",
        "pin_d_tilt_deg",
    },
    "l3": {"tool_reach_mm", "bore_c_offset_mm", "bore_c_tilt_deg", "bore_d_offset_mm", "bore_d_tilt_deg"},
    "l2": {"length_mm", "bore_b_offset_mm", "bore_b_tilt_deg", "pin_c_offset_mm", "pin_c_tilt_deg"},
    "eye_phantom": {"centre_offset_mm"},
}
VECTORS = {"ball_offset_mm", "centre_offset_mm", *(f"s{n}_offset_mm" for n in LEGS)}  # three numbers, not two
BODIES = [
    "base",
    *(f"carriage{i}" for i in (1, 2, 3)),
    *(f"cross{n}" for n in LEGS),
    *(f"rod{n}" for n in LEGS),
    "platform",
    "arm",
    "tilt_slider",
    "l5",
    "l4",
    "l3",
    "l2",
    "eye_phantom",
    "microscope",
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
            known = ERRORS.get(body)
            if known is None:
                raise ValueError(f"{path}: [part.{body}] is no part that takes errors")
            if not set(given) <= known:
                raise ValueError(
                    f"{path}: [part.{body}] does not know {sorted(set(given) - known)}, only {sorted(known)}"
                )
            for key, value in given.items():
                count = np.size(value)
                fits = (
                    count == (3 if key in VECTORS else 2)
                    if key.endswith("offset_mm")
                    else count == 1 or (count == 2 and key.endswith("tilt_deg"))
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
def unit(v):
    """Direction of a vector."""
    return np.asarray(v, float) / np.linalg.norm(v)


def pose4(origin, x, y, z):
    """4x4 matrix of a frame."""
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([x, y, z, origin])
    return matrix


def spheres(centres, radius):
    """Upper point at one distance from three points; None if there is none."""
    a, b, c = centres
    n = np.cross(b - a, c - a)
    # on the planes midway between a and b, a and c, and in the plane of the three: their centre
    rows = np.array([b - a, c - a, n])
    centre = np.linalg.solve(rows, [(b @ b - a @ a) / 2, (c @ c - a @ a) / 2, n @ a])
    rest = radius**2 - np.sum((centre - a) ** 2)
    return None if rest < 0 else centre + np.sqrt(rest) * unit(n) * np.sign(n[2])


def circles(a, ra, b, rb, side):
    """Point at distance ra from a and rb from b, left (+1) or right (-1) of the way from a to b; None if none."""
    gap = np.linalg.norm(b - a)
    along = (gap**2 + ra**2 - rb**2) / (2 * gap)
    rest = ra**2 - along**2
    if rest < 0:
        return None
    u = (b - a) / gap
    return a + along * u + side * np.sqrt(rest) * np.array([-u[1], u[0]])


def direction(degrees):
    """Return a unit vector in the plane."""
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])


def turn(v, degrees):
    """Plane vector turned counter-clockwise."""
    c, s = direction(degrees)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1]])


def linkage(d, tilt):
    """Pins of the tilt mechanism in {a}, at an angle of the tool from the vertical; None if it cannot stand.

    Ruler and compasses from the tool back to the drive: the tool's direction turns the coupler; that carried
    to pin B closes the four-bar; the bell crank places Q, and Q the slider on its line.
    """
    A, B = np.zeros(2), np.array([0.0, d.AB])
    handle = direction(tilt + 90)
    to_p = -turn(handle, d.phi4)  # D to P: the tool makes phi4 with P to D
    to_c = turn(to_p, d.phi3)
    D = circles(A, d.DA, B - d.CD * to_c, d.BC, -1)  # C on its circle about B, moved by D - C
    if D is None:
        return None
    Q = d.AQ * turn(unit(D), d.phi2)
    rise = d.y_AR - Q[1]
    if abs(rise) > d.QR:
        return None
    R = np.array([Q[0] - np.sqrt(d.QR**2 - rise**2), d.y_AR])
    return {"A": A, "B": B, "C": D + d.CD * to_c, "D": D, "P": D + d.DP * to_p, "Q": Q, "R": R, "handle": handle}


def placements(d, q, roll, tilt):
    """World placement (4x4, mm) of every body; None if out of reach."""
    u = [np.array([*direction(w), 0.0]) for w in d.leg_azimuth]
    z = np.array([0.0, 0, 1])
    centre = spheres([(d.base_radius - d.platform_radius) * r + h * z for r, h in zip(u, q, strict=True)], d.rod_length)
    pins = linkage(d, tilt)
    if centre is None or pins is None:
        return None
    out = {"base": np.eye(4), "platform": pose4(centre, *np.eye(3)), "eye_phantom": np.eye(4), "microscope": np.eye(4)}
    for i, (radial, height) in enumerate(zip(u, q, strict=True), 1):
        t = np.cross(z, radial)
        foot = d.base_radius * radial + height * z
        way = unit(centre + d.platform_radius * radial - foot)
        e = unit(way - (way @ t) * t)
        f = np.cross(t, e)
        out[f"carriage{i}"] = pose4(foot, radial, t, z)
        for k, side in (("a", 1), ("b", -1)):
            at = foot + side * d.rod_spread * t
            out[f"cross{i}{k}"] = pose4(at, e, -t, f)
            out[f"rod{i}{k}"] = pose4(at, way, np.cross(f, way), f)
    x, (c, s) = np.array([1.0, 0, 0]), direction(roll)
    ya, za = np.array([0.0, -s, c]), np.array([0.0, -c, -s])
    pin_a = centre + d.d1 * z + d.d2 * x + d.d3 * ya

    def in_plane(origin, towards):
        v = unit(towards)
        along, across = v[0] * x + v[1] * ya, -v[1] * x + v[0] * ya
        return pose4(pin_a + origin[0] * x + origin[1] * ya, along, across, za)

    p = pins
    out["arm"] = in_plane(p["A"], (1, 0))
    out["tilt_slider"] = in_plane(p["R"], (1, 0))
    for body, start, end in (("l5", "R", "Q"), ("l4", "A", "D"), ("l3", "D", "C"), ("l2", "B", "C")):
        out[body] = in_plane(p[start], p[end] - p[start])
    return out


def drawn(d):
    """Placements in the drawn posture."""
    return placements(d, d.pose_q, d.pose_roll, d.pose_tilt)


def tool(d):
    """P and the direction of the handle, in l3."""
    p = d.DP * direction(-d.phi3)
    return p, turn(unit(-p), -d.phi4)


# ---- drawing ----------------------------------------------------------------
def drawing():
    """Load parts.py beside this file; late, because build123d takes seconds."""
    if "sher_parts" not in sys.modules:
        spec = importlib.util.spec_from_file_location("sher_parts", HERE / "parts.py")
        sys.modules["sher_parts"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules["sher_parts"])
    return sys.modules["sher_parts"]


def draw(d):
    """Parts of all bodies in their body frames: {body: [(part, solid, material)]}."""
    return {body: draw_body(d, body, d.error(body)) for body in BODIES}


def draw_body(d, body, err):
    """Parts of one body: [(part, solid, material)]."""
    parts = drawing()
    p, handle = tool(d)
    if body in ("base", "eye_phantom", "microscope"):  # where the tool points in the drawn posture
        T = drawn(d)["l3"]
        point = T[:3, :3] @ [*p, 0] + T[:3, 3]
        back = T[:3, :3] @ [*handle, 0]
        centre = point - (d.tool_reach + d.eye_gap + d.eye_radius) * back
    if body == "base":
        return parts.base(d, float(centre[0]))
    if body == "eye_phantom":
        return parts.eye_phantom(d, centre, back, err)
    if body == "microscope":
        return parts.microscope(d, float(centre[0]))
    if body == "l3":
        return parts.l3(d, err, tuple(map(float, p)), tuple(map(float, handle)))
    kind = body.rstrip("ab").rstrip("123") if body[0] in "cr" else body
    return getattr(parts, kind)(d, err)


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


def write_step(tree, path, title="sher"):
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
    name = f"FILE_NAME('{title}','1970-01-01T00:00:00',(''),(''),'','cad/sher/model.py','');"
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
        description="Draw the SHER 3.0 robot and write a STEP assembly (mm, world coordinates).",
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
        default=HERE / "sher.step",
        metavar="FILE",
        help="STEP file to write (default: %(default)s)",
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing")
    options = parser.parse_args(arguments)
    try:
        d = Dimensions(options.dimensions)
        where = drawn(d)
        if where is None:
            raise ValueError("the drawn posture is out of reach of these lengths")
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
    solids, tree, total = draw(d), {}, 0.0
    materials = drawing().MATERIALS
    for body in BODIES:
        tree[body] = []
        for part, solid, material in solids[body]:
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
