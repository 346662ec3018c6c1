"""Extract the robot's model from an SDF as one flat model: resolve includes, and merge nested models into their parent.

A link `palm` of a nested model `hand` gets the name `hand::palm`, as in SDF; of a model that is included with
`merge="true"`, it keeps its name.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from twin.core.errors import IncompleteError, NoMechanismError, SourceError, UnsupportedError, unknown
from twin.core.foreign.budget import INCLUDES, over
from twin.exchange.read.imported_robot import Findings, note, warning
from twin.exchange.read.shapes import find_file
from twin.exchange.read.xml_file import Xml

ORIGIN = "__model__"
"""Name of a model's own frame in SDF; the frame of a nested model `hand` becomes `hand::__model__`."""

_MERGED = "merged"
"""Attribute of a model that is included with `merge="true"`: its parts keep their names. SDF has no such attribute."""

_DEEPEST = 8
"""Maximum nesting depth of models; a model that includes itself exceeds this depth and causes an error."""


def robot_of(xml: Xml, root: str | None, findings: Findings) -> Element:
    """Return the selected model as a flat copy.

    `root` is the name of the model. None selects the only model with joints.

    Raises:
        UnsupportedError: `root` is None, and several models have joints, or none of several has; or a model uses a
            feature of SDF that is not supported.
        NoMechanismError: the file has no model.
        IncompleteError: a model of a server or of a package is included and is not there.
        SourceError: the model `root` does not exist, a name is used twice, an include is missing or has not one model,
            or models are nested too deeply. The three errors above are kinds of it.
        BudgetError: too many files are included, or one exceeds the limits for XML.
    """
    _state_frames_of_axes(xml.root)
    models: dict[str, Element] = {}
    included_files: list[Path] = []
    missing: list[str] = []
    for scope in (xml.root, *xml.root.findall("world")):
        for element in scope:
            if element.tag == "include":
                model = _included(xml, element, 0, included_files)
                if model is None:
                    uri = (element.findtext("uri") or "").strip()
                    where = f"include {uri}"
                    findings.warn("include", f"{where} is missing: the included model is left out.", where)
                    missing.append(uri)
                    continue
            elif element.tag == "model":
                model = copy.deepcopy(element)
                _resolve(xml, model, 0, included_files)
            else:
                continue
            name = model.get("name") or ""
            if name in models:
                raise SourceError(f"{xml.path}: model '{name}': the name is used twice")
            models[name] = model
    if missing and not models:
        text = f"the file has no <model>, and include {missing[0]} is missing: put it beside the folder of the SDF file"
        raise _error_for_missing(missing[0])(f"{xml.path}: {text}")
    if not models:
        raise NoMechanismError(f"{xml.path}: the file has no <model>")
    with_joints = [name for name, model in models.items() if model.find(".//joint") is not None]
    if root is not None:
        if root not in models:
            raise SourceError(f"{xml.path}: --root: {unknown('model', root, models)}")
        chosen = root
    else:
        robots = with_joints or list(models)
        if len(robots) > 1:
            kind = "models with joints" if with_joints else "models, none with joints"
            text = f"the file has {len(robots)} {kind}: {', '.join(robots)}. Choose one with --root NAME."
            raise UnsupportedError(f"{xml.path}: {text}")
        chosen = robots[0]
    for name in models:
        if name != chosen:
            text = f"model '{name}' is left out, because it does not belong to robot '{chosen}'."
            if name in with_joints:
                findings.append(warning("prop", text, name))
            else:
                findings.append(note("prop", text, name))
    _flatten(xml, models[chosen])
    return models[chosen]


def _state_frames_of_axes(root: Element) -> None:
    """State the axes of SDF before 1.7 as those of SDF 1.7: `use_parent_model_frame` becomes `expressed_in`.

    Until SDF 1.4, all axes are in the frame of the model. The same is done by the files 1_4.convert and 1_6.convert of
    sdformat.
    """
    before_choice = root.get("version", "").strip() in ("1.0", "1.2", "1.3", "1.4")
    for joint in root.iter("joint"):
        for axis in joint.findall("axis"):
            choice = axis.find("use_parent_model_frame")
            in_model = before_choice
            if choice is not None:
                in_model = (choice.text or "").strip().lower() in ("true", "1")
                axis.remove(choice)
            if not in_model:
                continue
            xyz = axis.find("xyz")
            if xyz is None:  # the default direction is in the frame of the model too
                xyz = SubElement(axis, "xyz")
                xyz.text = "0 0 1"
            xyz.set("expressed_in", ORIGIN)


def _resolve(xml: Xml, model: Element, depth: int, included_files: list[Path]) -> None:
    """Replace each include in a model by the included model; `included_files` contains the files included so far."""
    if depth > _DEEPEST:
        raise SourceError(
            f"{xml.path}: models are nested in more than {_DEEPEST} levels; check that no model includes itself"
        )
    for position, element in enumerate(list(model)):
        if element.tag == "include":
            uri = (element.findtext("uri") or "").strip()
            inner = _included(xml, element, depth + 1, included_files)
            if inner is None:
                text = f"model '{model.get('name')}': include {uri} is missing: put it into the folder of the SDF file"
                raise _error_for_missing(uri)(f"{xml.path}: {text}")
            model[position] = inner
        elif element.tag == "model":
            _resolve(xml, element, depth + 1, included_files)


def _included(xml: Xml, include: Element, depth: int, included_files: list[Path]) -> Element | None:
    """Return the included model, with the name, pose and <static> of the include; None if its file is missing."""
    uri = (include.findtext("uri") or "").strip()
    if not uri:
        xml.fail("<include>", "the <uri> is missing")
    frame = (include.findtext("placement_frame") or "").strip()
    if frame:
        text = f"placement_frame = '{frame}' is not supported: expand the model (gz sdf -p)"
        xml.refuse(f"include {uri}", text)
    file = _file(uri, xml.path.parent)
    if file is None:
        return None
    own_names = ("", xml.path.resolve().parent.name)
    if file.samefile(xml.path) and (_is_remote(uri) or _package(uri) not in own_names):
        return None  # the file that was found is the including one, although another model is named
    included_files.append(file)
    if len(included_files) > INCLUDES:
        over(file, "SDF", "number of included files so far", len(included_files), INCLUDES)
    included = Xml(file, "sdf")
    _state_frames_of_axes(included.root)
    models = included.root.findall("model")
    if len(models) != 1:
        raise SourceError(f"{file}: included by {xml.path.name}: expected one model, found {len(models)}")
    model = copy.deepcopy(models[0])
    for address in model.iter("uri"):  # resolve mesh files relative to the folder of the included file
        mesh_file = find_file((address.text or "").strip(), file.parent)
        if mesh_file is not None:
            address.text = str(mesh_file.resolve())
    _resolve(included, model, depth, included_files)
    name = (include.findtext("name") or "").strip()
    if name:
        model.set("name", name)
    if (include.get("merge") or "").strip() in ("true", "1"):
        model.set(_MERGED, "true")
    for tag in ("pose", "static"):
        stated = include.find(tag)
        if stated is None:
            continue
        for replaced in model.findall(tag):
            model.remove(replaced)
        model.append(copy.deepcopy(stated))
    return model


def _file(uri: str, beside: Path) -> Path | None:
    """Return the SDF file for a URI: the file with this name, or model.sdf in a folder with this name; else None.

    The search includes the folder `beside` and up to four of its parent folders.
    """
    if _is_remote(uri):
        uri = uri.rstrip("/").rpartition("/")[2]  # nothing is downloaded; search a local copy instead
    for name in (f"{uri}/model.sdf", f"{uri}.sdf", uri):
        file = find_file(name, beside)
        if file is not None:
            return file
    return None


def _error_for_missing(uri: str) -> type[SourceError]:
    """Return the error for a missing include: one of a server or a package may be elsewhere, a path is wrong."""
    if _is_remote(uri) or _package(uri):
        return IncompleteError
    return SourceError


def _is_remote(uri: str) -> bool:
    """Return whether a URI names a model on a server."""
    return uri.startswith(("http://", "https://"))


def _package(uri: str) -> str:
    """Return the name of the model in a `model://` or `package://` address; "" for other addresses."""
    scheme, separator, address = uri.partition("://")
    if not separator or scheme not in ("model", "package"):
        return ""
    return address.strip("/").partition("/")[0]


def _flatten(xml: Xml, model: Element) -> None:
    """Move the contents of nested models into the model itself."""
    for inner in model.findall("model"):
        name = xml.name(inner, "model")
        if inner.get("placement_frame"):
            xml.refuse(f"model '{name}'", "placement_frame is not supported: expand the model (gz sdf -p)")
        _flatten(xml, inner)
        model.remove(inner)
        links = inner.findall("link")
        if not links:
            continue
        inner_pose = inner.find("pose")  # pose of the inner model; it refers to frames of the outer model
        pose = Element("pose") if inner_pose is None else copy.deepcopy(inner_pose)
        merged = inner.get(_MERGED) is not None
        inner_frame = f"_merged__{name}__{ORIGIN}" if merged else f"{name}::{ORIGIN}"
        prefix = "" if merged else f"{name}::"
        canonical = inner.get("canonical_link") or links[0].get("name", "")
        for element in inner:
            for owner, key in _references(element):
                value = _reference(owner, key)
                if value == ORIGIN:
                    _set_reference(owner, key, inner_frame)
                elif value and value != "world":
                    _set_reference(owner, key, f"{prefix}{value}")
        origin = Element("frame", {"name": inner_frame, "hidden": "true", "attached_to": f"{prefix}{canonical}"})
        pose.set("relative_to", pose.get("relative_to") or ORIGIN)
        origin.append(pose)
        for element in inner:
            if element.tag in ("link", "frame") and not element.get("attached_to"):
                pose = element.find("pose")
                if pose is None:
                    pose = Element("pose")
                    element.append(pose)
                if not pose.get("relative_to"):
                    pose.set("relative_to", inner_frame)
                if element.tag == "frame":
                    element.set("attached_to", inner_frame)
        if not merged:
            _refer_to_frame(model, name, inner_frame)
        model.append(origin)
        for element in inner:
            if element.tag != "pose":
                model.append(element)


def _refer_to_frame(model: Element, name: str, frame: str) -> None:
    """Replace references to the nested model `name` by references to its frame; of other models, only in <pose>."""
    for element in model:
        searched = element
        if element.tag == "model":
            pose = element.find("pose")
            if pose is None:
                continue
            searched = pose
        for owner, key in _references(searched):
            if key != "name" and _reference(owner, key) == name:
                _set_reference(owner, key, frame)


def _references(element: Element) -> Iterator[tuple[Element, str]]:
    """Yield (element, attribute) for each reference to a link, joint or frame; "" if it is the element's text."""
    if element.tag in ("link", "joint", "frame"):
        yield element, "name"
    for inner in element.iter():
        for key in ("relative_to", "attached_to", "expressed_in"):
            if inner.get(key):
                yield inner, key
        if inner.tag in ("parent", "child", "joint_name") and not len(inner):
            yield inner, ""
        if inner.tag == "mimic" and inner.get("joint"):
            yield inner, "joint"


def _reference(element: Element, key: str) -> str | None:
    """Return the name that an attribute `key` states; of key "", that of the element's text."""
    if key:
        return element.get(key)
    return (element.text or "").strip()


def _set_reference(element: Element, key: str, value: str) -> None:
    if key:
        element.set(key, value)
    else:
        element.text = value
