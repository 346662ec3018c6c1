"""Optional packages that some commands require; if one is missing, the error message gives the install command."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from twin.core.errors import TwinError

EXTRAS = {
    "aiomqtt": "mqtt",
    "cbor2": "ros",
    "cuda.bindings.driver": "gpu",
    "distributed": "cluster",
    "mcap": "mcap",
    "mcap_ros2.writer": "mcap",
    "pyarrow": "parquet",
    "segno": "qr",
    "xacro": "xacro",
    "yaml": "yaml",
}
"""{module: extra of the package twin-robotics that installs the module}."""


def require(module: str, purpose: str) -> ModuleType:
    """Return the imported optional module; `purpose`, such as "the plot", begins the error message.

    Raises:
        TwinError: the module is not installed; the message gives the install command.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        text = f"{purpose} needs {error.name}: pip install 'twin-robotics[{EXTRAS[module]}]'"
        raise TwinError(text) from error
