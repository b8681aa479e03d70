"""Import the public names of a package on first use, so that importing the package is fast."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module

__all__ = ["lazy_names"]


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
