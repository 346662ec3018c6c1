"""Functions for the drawings of all robots: dimension files, placements, and reproducible STEP files.

The model.py of a robot places its bodies and draws their parts; `command` is its command line:

    python cad/<robot>/model.py [--dimensions FILE] [--out <robot>.step]

Each function of its parts.py that draws a body returns a list of ``(part name, solid, material)``. Each rigid body is
one sub-assembly; its parts are named <body>_<part>. All shapes are written in world coordinates: no instance has a
placement.
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

PROVENANCES = {"PUBLISHED", "CITED", "DERIVED", "ASSUMED"}


class Dimensions:
    """Values of a dimension file as attributes; `error(body)` returns the manufacturing errors of a body."""

    def __init__(self, path, errors, vectors=frozenset()):
        """Read a dimension file.

        Args:
            path: TOML file; every entry has value, unit and provenance.
            errors: the manufacturing errors that can be set for each body, {body: {key}}.
            vectors: keys, or pairs (body, key), of offsets that have three numbers instead of two.
        """
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
            if not all(isfinite(v) for v in np.ravel(entry["value"])):
                raise ValueError(f"{path}: [{name}] is not finite")
            setattr(self, name, entry["value"])
        for body, given in self.parts.items():
            known = errors.get(body)
            if known is None:
                raise ValueError(f"{path}: [part.{body}]: no manufacturing errors can be set for this body")
            if not set(given) <= known:
                raise ValueError(
                    f"{path}: [part.{body}] has unknown keys {sorted(set(given) - known)}; allowed: {sorted(known)}"
                )
            for key, value in given.items():
                count = np.size(value)
                fits = (
                    count == (3 if key in vectors or (body, key) in vectors else 2)
                    if key.endswith("offset_mm")
                    else count == 1 or (count == 2 and key.endswith("tilt_deg"))
                )
                if not fits or not np.issubdtype(np.asarray(value).dtype, np.number) or not np.all(np.isfinite(value)):
                    raise ValueError(f"{path}: [part.{body}] {key} = {value!r} has the wrong number or type of values")

    def __getattr__(self, name):
        raise AttributeError(f"the dimension file has no [{name}]")

    def error(self, body):
        """Return a function (key, nominal value) that gives the value set for a body, or the nominal value."""
        given = self.parts.get(body, {})
        return lambda key, nominal: given.get(key, nominal)


def row(alpha, d, theta, r):
    """Return Rx(alpha) Tx(d) Rz(theta) Tz(r), a row of a table by Khalil and Kleinfinger; in mm and degrees."""
    (ca, ct), (sa, st) = np.cos(np.radians([alpha, theta])), np.sin(np.radians([alpha, theta]))
    return np.array([[ct, -st, 0, d], [ca * st, ca * ct, -sa, -r * sa], [sa * st, sa * ct, ca, r * ca], [0, 0, 0, 1.0]])


def unit(v):
    """Return the unit vector in the direction of v."""
    return np.asarray(v, float) / np.linalg.norm(v)


def pose4(origin, x, y, z):
    """Return the pose (4, 4) of a frame from its origin and axes."""
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([x, y, z, origin])
    return matrix


def bake(solid, matrix):
    """Return (shape, volume in mm3): the solid with its geometry transformed by a pose (4, 4).

    Raises:
        ValueError: the shape is not exactly one valid closed solid with positive volume.
    """
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


def write_step(tree, path, title):
    """Write {body: [(name, shape, rgb)]} as an AP214 assembly; the same input gives the same bytes."""
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
    """Return the text of a STEP file in a reproducible and shorter form.

    The header has no date, coordinates are rounded to 1e-10 mm, and equal points, directions and styles are stored
    once (OCC stores them for each use). Colours are sorted, because OCC writes them in the order of memory addresses.
    Representation contexts and the placements of the assembly are not changed.
    """
    header, body = text.split("DATA;", 1)
    name = f"FILE_NAME('{title}','1970-01-01T00:00:00',(''),(''),'','cad/{title}/model.py','');"
    header, count = re.subn(r"FILE_NAME\(.*?\);", name, header, count=1, flags=re.S)
    body = re.sub(r"\s*\n\s*", "", body.rsplit("ENDSEC;", 1)[0])
    entities = dict(re.findall(r"#(\d+) = (.*?);(?=#|$)", body))
    if count != 1 or not entities:
        raise ValueError("the STEP file does not have the expected structure")
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
    """Return a STEP real rounded to `digits` decimals, without a negative zero."""
    value = round(float(number), digits) + 0.0
    return re.sub(r"\.0$", ".", repr(value)).upper() if "e" not in repr(value) else f"{value:.{digits}f}".rstrip("0")


def parts(folder):
    """Load parts.py of a folder; call it only when drawing, because importing build123d takes seconds.

    The module has the name <robot>_parts, because each robot has a parts.py.
    """
    name = f"{folder.name}_parts"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, folder / "parts.py")
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def build(bodies, solids, where, materials):
    """Return ({body: [(name, shape, rgb)]}, total mass in kg): all parts in world coordinates, checked by `bake`.

    Args:
        bodies: names of the bodies, in the order of the file.
        solids: {body: [(part, solid, material)]} in the frames of the bodies.
        where: {body: pose (4, 4) in the world in mm}.
        materials: {name: (rgb, kg/m3)}.
    """
    tree, total = {}, 0.0
    for body in bodies:
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


def command(name, here, drawn, arguments=None):
    """Run the command line of a model.py: draw a robot and write its STEP assembly.

    Args:
        name: name of the robot and of its STEP file.
        here: folder of the model.
        drawn: function of the path of a dimension file that returns (tree, mass) like `build`.
        arguments: arguments of the command line; None: the arguments of the process.
    """
    parser = argparse.ArgumentParser(
        description=f"Draw the robot {name} and write a STEP assembly (mm, world coordinates).",
        epilog="A table [part.<body>] in the dimension file sets manufacturing errors of this body;"
        " placements stay nominal.",
    )
    for option, file, text in (
        ("--dimensions", "dimensions.toml", "dimension file"),
        ("--out", f"{name}.step", "STEP file to write"),
    ):
        parser.add_argument(
            option, type=Path, default=here / file, metavar="FILE", help=f"{text} (default: %(default)s)"
        )
    parser.add_argument("--quiet", action="store_true", help="print nothing")
    options = parser.parse_args(arguments)
    try:
        tree, total = drawn(options.dimensions)
        write_step(tree, options.out, name)
    except (OSError, ValueError, AttributeError) as trouble:
        parser.exit(1, f"model.py: {trouble}\n")
    if not options.quiet:
        count = sum(len(v) for v in tree.values())
        size = options.out.stat().st_size / 1e6
        print(f"{options.out}: {len(tree)} bodies, {count} parts, {total:.2f} kg, {size:.2f} MB")
