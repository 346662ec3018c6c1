# usd-core contains no type information; pyright cannot see the names that its C++ modules define.
from typing import Any

def __getattr__(name: str) -> Any: ...
