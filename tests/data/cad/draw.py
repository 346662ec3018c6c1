"""Draw the small STEP files of this folder again: `python tests/data/cad/draw.py [FOLDER]`.

Needs build123d (a development extra); the tests read the committed files and do not.

crank.step     a robot of three bodies in world coordinates: plate with pin and rail, arm with two bores and a
               ball, slider with bore
nested.step    the same peg twice in a turned and shifted sub-assembly that is itself turned and shifted; a
               third one whose name is not ASCII; two instances share a name
mirrored.step  a wedge and its mirror image
folded.step    the robot of crank.step with plate and arm in one sub-assembly
inch.step, metre.step  one box of 40 x 30 x 20 mm with a bore of 5 mm radius, in other units
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

from build123d import Axis, Plane, Solid, Vector
from OCP.gp import gp_Ax1, gp_Ax2, gp_Dir, gp_Pnt, gp_Trsf, gp_Vec
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

X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
RED = (0.8, 0.1, 0.1)


def cyl(at, axis, r, h):
    return Solid.make_cylinder(r, h, Plane(origin=at, z_dir=axis))


def box(x0, x1, y0, y1, z0, z1):
    return Solid.make_box(x1 - x0, y1 - y0, z1 - z0, Plane(origin=(x0, y0, z0)))


def placed(shift, axis, degrees):
    """Turn about an axis through the origin, then shift."""
    turn, move = gp_Trsf(), gp_Trsf()
    turn.SetRotation(gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(*axis)), degrees * 3.141592653589793 / 180)
    move.SetTranslation(gp_Vec(*shift))
    return TopLoc_Location(move.Multiplied(turn))


HERE = TopLoc_Location()


def write(tree, path, unit="MM"):
    """Write (name, location, shape or list of such, rgb): an assembly is a list of children."""
    for printer in Message.DefaultMessenger_s().Printers():
        printer.SetTraceLevel(Message_Gravity.Message_Fail)
    doc = TDocStd_Document(TCollection_ExtendedString("XmlOcaf"))
    XCAFApp_Application.GetApplication_s().NewDocument(TCollection_ExtendedString("MDTV-XCAF"), doc)
    XCAFDoc_DocumentTool.SetLengthUnit_s(doc, 1e-3)
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(doc.Main())
    colours = XCAFDoc_DocumentTool.ColorTool_s(doc.Main())
    shapes.SetAutoNaming_s(False)
    known = {}

    def name(label, text):
        TDataStd_Name.Set_s(label, TCollection_ExtendedString(text, True))

    def label(text, content):
        if isinstance(content, list):
            node = shapes.NewShape()
            name(node, text)
            for child, location, inside in content:
                name(shapes.AddComponent(node, label(child, inside), location), child)
            return node
        if id(content) not in known:  # the same solid twice is one product with two instances
            known[id(content)] = shapes.AddShape(content.wrapped, False)
            name(known[id(content)], text)
            tint = Quantity_Color(*RED, Quantity_TypeOfColor.Quantity_TOC_sRGB)
            colours.SetColor(known[id(content)], tint, XCAFDoc_ColorType.XCAFDoc_ColorSurf)
        return known[id(content)]

    label(path.stem, tree)
    shapes.UpdateAssemblies()
    STEPCAFControl_Controller.Init_s()
    writer = STEPCAFControl_Writer(XSControl_WorkSession(), False)
    writer.SetColorMode(True)
    writer.SetNameMode(True)
    Interface_Static.SetCVal_s("write.step.schema", "AP214IS")
    Interface_Static.SetCVal_s("write.step.unit", unit)
    Interface_Static.SetIVal_s("write.surfacecurve.mode", 0)
    writer.Transfer(doc, STEPControl_StepModelType.STEPControl_AsIs)
    if writer.Write(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise OSError(f"STEP writer failed for {path}")
    tidy = runpy.run_path(str(Path(__file__).parents[3] / "cad/drawing.py"))["normalise"]
    text = tidy(path.read_bytes().decode("utf-8"), path.stem)
    text = text.replace(f"cad/{path.stem}/model.py", "tests/data/cad/draw.py")
    path.write_text(text, encoding="utf-8", newline="\n")


def crank():
    plate = box(-60, 60, -40, 60, -10, 0)
    pin = cyl((0, 0, 0), Z, 3, 12)
    rail = cyl((-60, 50, 10), X, 4, 120)
    arm = box(-8, 88, -8, 8, 0, 8) - cyl((0, 0, 0), Z, 3.02, 12) - cyl((80, 0, 0), Z, 2, 12)
    ball = Solid.make_sphere(5, Plane(origin=(80, 0, 20)))
    slider = box(-15, 15, 42, 58, 3, 20) - cyl((-60, 50, 10), X, 4.02, 120)
    return [
        ("base", HERE, [("base_plate", HERE, plate), ("base_pin", HERE, pin), ("base_rail", HERE, rail)]),
        ("arm", HERE, [("arm_bar", HERE, arm), ("arm_ball", HERE, ball)]),
        ("slider", HERE, [("slider_block", HERE, slider)]),
    ]


def folded():
    base, arm, slider = crank()
    return [("unit", HERE, [base, arm]), slider]


def nested():
    peg = cyl((10, 0, 0), Z, 5, 30)  # axis at x = 10, from z = 0 to 30
    pair = [("peg", HERE, peg), ("peg", placed((0, 40, 0), Y, 90), peg)]
    odd = cyl((0, 0, 0), X, 2, 8)
    return [
        ("group", placed((100, 200, 300), Z, 90), [("inner", placed((7, 0, 0), X, 30), pair)]),
        ("Träger_Ω", HERE, odd),
    ]


def mirrored():
    wedge = Solid.extrude(
        box(0, 30, 0, 20, 0, 10).faces().sort_by(Axis.Z)[-1], Vector(5, 0, 12)
    )  # a skewed prism: its mirror image is another solid
    mirror = gp_Trsf()
    mirror.SetMirror(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(1, 0, 0)))
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
    from OCP.TopoDS import TopoDS

    image = Solid(TopoDS.Solid(BRepBuilderAPI_Transform(wedge.wrapped, mirror, True).Shape()))
    return [("left", HERE, image), ("right", HERE, wedge)]


def block():
    return [("block", HERE, box(0, 40, 0, 30, 0, 20) - cyl((12, 15, 0), Z, 5, 20))]


def main(folder):
    write(crank(), folder / "crank.step")
    write(folded(), folder / "folded.step")
    write(nested(), folder / "nested.step")
    write(mirrored(), folder / "mirrored.step")
    write(block(), folder / "inch.step", "INCH")
    write(block(), folder / "metre.step", "M")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent)
