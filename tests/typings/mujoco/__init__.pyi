# The package contains no type information; pyright cannot see the names that its C++ module defines.
from typing import Any

def __getattr__(name: str) -> Any: ...
