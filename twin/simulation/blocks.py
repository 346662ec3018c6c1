"""Devices, controllers, plants and hazards that a scene file names, each in a file of its own.

A file in the folders `devices`, `controllers`, `plants` or `hazards` can be named in the sections [device.NAME],
[controller.NAME], [plant.NAME] and [hazard.NAME] of a scene if it has a function `from_scene`. Another package names
such a function in its metadata, in the group of entry points `twin.devices`, `twin.controllers`, `twin.plants` or
`twin.hazards`: `pulse = "pulse_device:from_scene"`.

`from_scene(name, settings, setup)` returns a `Block` or a `Hazard`: `name` is that of the section, `settings` are its
settings.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules

from twin.core.entry_points import entry_points
from twin.core.errors import TwinError, unknown
from twin.simulation.setup import Setup
from twin.simulation.world import Block, Hazard


def blocks(setup: Setup, folder: str) -> list[Block]:
    """Return the blocks that a scene names of the folder "devices", "controllers" or "plants", in their order.

    Raises:
        TwinError: there is no such block, or its settings are wrong.
    """
    blocks_of_scene = []
    for block in _objects_of(setup, folder):
        if not isinstance(block, Block):
            raise TwinError(f"scene '{setup.scene.name}': {folder}: {block!r} is not a block")
        blocks_of_scene.append(block)
    return blocks_of_scene


def hazards(setup: Setup) -> list[Hazard]:
    """Return the hazards that a scene names, in their order.

    Raises:
        TwinError: there is no such hazard, or its settings are wrong.
    """
    hazards_of_scene = []
    for hazard in _objects_of(setup, "hazards"):
        if not isinstance(hazard, Hazard):
            raise TwinError(f"scene '{setup.scene.name}': {hazard!r} is not a hazard")
        hazards_of_scene.append(hazard)
    return hazards_of_scene


def _objects_of(setup: Setup, folder: str) -> list[object]:
    scene = setup.scene
    objects = []
    for name, table in scene.blocks.get(folder, {}).items():
        try:
            from_scene = _factory(folder, table.use)
            objects.append(from_scene(name, table.settings, setup))
        except KeyError as error:
            raise TwinError(f"{scene.file}: {folder}: '{name}': the setting {error} is missing") from error
        except (TwinError, TypeError, ValueError) as error:
            raise TwinError(f"{scene.file}: {folder}: '{name}': {error}") from error
    return objects


def _factory(folder: str, factory_name: str) -> Callable[..., object]:
    """Return the function `from_scene` of a file, or of an entry point.

    Raises:
        TwinError: there is no such file or entry point, the file has no such function, or both have the same name.
    """
    package = f"twin.simulation.{folder}"
    group = f"twin.{folder}"
    names_in_folder = [module.name for module in iter_modules(import_module(package).__path__)]
    others = entry_points(group)
    for name in sorted(set(names_in_folder) & set(others)):
        raise TwinError(f"the entry point '{name}' of {group} has the name of a file of {package}; it needs another")
    if factory_name in others:
        factory = others[factory_name]
    elif factory_name in names_in_folder:
        factory = getattr(import_module(f"{package}.{factory_name}"), "from_scene", None)
    else:
        # the folders have modules too that the World builds by itself, and helpers: neither is offered
        built_in = [name for name in names_in_folder if _has_function(f"{package}.{name}")]
        raise TwinError(unknown(folder.removesuffix("s"), factory_name, [*built_in, *others]))
    if not callable(factory):
        raise TwinError(f"'{factory_name}' of {folder} cannot be named in a scene: it has no function from_scene")
    return factory


def _has_function(module: str) -> bool:
    """Return whether the source of a module defines `from_scene`; the module, which may need much, is not imported."""
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        return False
    tree = ast.parse(Path(spec.origin).read_bytes())
    return any(isinstance(node, ast.FunctionDef) and node.name == "from_scene" for node in tree.body)
