"""Import names on first use, so that importing a package is fast."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import Any

__all__ = ["LazyTable", "lazy_names"]


def lazy_names(
    package: str, modules: Mapping[str, str], renamed: Mapping[str, str] | None = None
) -> Callable[[str], object]:
    """Return a `__getattr__` for a package, which imports a public name when it is first used.

    Args:
        package: full name of the package.
        modules: public name -> module of the package that defines it.
        renamed: former public name -> the name that replaces it. If the package has the new name, the former one still
            works, with a warning; otherwise the error message names the new one.
    """

    def load(name: str) -> object:
        """Import a public name, and store it in the package.

        Raises:
            AttributeError: the package has no such name.
        """
        new = renamed.get(name) if renamed else None
        if new is not None and new in modules:
            from printer_slicer.deprecation import warn_renamed  # noqa: PLC0415 - rarely needed

            warn_renamed(f"{package}.{name}", f"{package}.{new}")
            return load(new)
        if name not in modules:
            hint = f"; it is now called {new!r}" if new else ""
            raise AttributeError(f"module {package!r} has no attribute {name!r}{hint}")
        value: object = getattr(import_module(f"{package}.{modules[name]}"), name)
        setattr(sys.modules[package], name, value)
        return value

    return load


class LazyTable(Mapping[str, Any]):
    """A table of functions, each of which is imported when it is read.

    Args:
        package: full name of the package.
        functions: key -> `module.function` in the package.
    """

    def __init__(self, package: str, functions: Mapping[str, str]) -> None:
        self._package, self._functions = package, functions

    def __getitem__(self, key: str) -> Any:
        """Return the function of a key."""
        module, _, name = self._functions[key].rpartition(".")
        return getattr(import_module(f"{self._package}.{module}"), name)

    def __iter__(self) -> Iterator[str]:
        """Iterate over the keys."""
        return iter(self._functions)

    def __len__(self) -> int:
        """Return the number of functions."""
        return len(self._functions)
