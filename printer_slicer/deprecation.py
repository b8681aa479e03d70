"""Warnings about names of the previous release, which still work in this one."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from enum import EnumMeta
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar

__all__ = [
    "RenamedMembers",
    "accept_former_arguments",
    "accept_former_fields",
    "accept_former_option",
    "renamed_attribute",
    "renamed_method",
    "warn_renamed",
]

_Class = TypeVar("_Class", bound=type[Any])
_Function = TypeVar("_Function", bound=Callable[..., Any])


def warn_renamed(old: str, new: str, stacklevel: int = 3) -> None:
    """Warn that a Python name was replaced by another one.

    Args:
        old: the former name.
        new: the name that replaces it.
        stacklevel: number of calls between the user's code and the warning, as for `warnings.warn`.
    """
    warnings.warn(
        f"{old} is now called {new}; the former name works in this release only",
        FutureWarning,
        stacklevel=stacklevel,
    )


def accept_former_option(options: dict[str, Any], old: str, new: str) -> None:
    """Replace a former keyword argument by the current one, with a warning.

    Args:
        options: keyword arguments; changed in place.
        old: the former name.
        new: the current name; if both are given, the value of this one is used.
    """
    if old in options:
        warn_renamed(old, new, stacklevel=4)
        value = options.pop(old)
        options.setdefault(new, value)


def renamed_method(old: str, new: str) -> Callable[..., Any]:
    """Return a method that warns and calls the method that replaces it.

    Args:
        old: the former name, with its class.
        new: the current name, with its class.
    """

    def call(owner: Any, *args: Any, **options: Any) -> Any:
        """Call the current method of an object or a class."""
        warn_renamed(old, new)
        return getattr(owner, new.rpartition(".")[2])(*args, **options)

    return call


def renamed_attribute(old: str, new: str) -> Any:
    """Return a property that warns and returns the attribute that replaces it.

    Args:
        old: the former name, with its class.
        new: the current name, with its class.
    """

    def read(owner: Any) -> Any:
        """Read the current attribute."""
        warn_renamed(old, new)
        return getattr(owner, new.rpartition(".")[2])

    return property(read)


def accept_former_arguments(**renamed: str) -> Callable[[_Function], _Function]:
    """Return a decorator of functions that accepts former names of keyword arguments, with a warning.

    Args:
        **renamed: former name -> current name.
    """

    def decorate(function: _Function) -> _Function:
        """Accept the former names in a function."""

        @wraps(function)
        def call(*args: Any, **options: Any) -> Any:
            """Call the function with the current names."""
            for old in renamed.keys() & options.keys():
                accept_former_option(options, old, renamed[old])
            return function(*args, **options)

        return call  # type: ignore[return-value]

    return decorate


def accept_former_fields(**renamed: str) -> Callable[[_Class], _Class]:
    """Return a decorator of structs that accepts former names of fields, with a warning.

    The former names are readable attributes, and arguments of the constructor and of `dataclasses.replace`.

    Args:
        **renamed: former name -> current name.
    """

    def call(kind: Any, *args: Any, **values: Any) -> Any:
        """Build a value from fields with current names."""
        for old in renamed.keys() & values.keys():
            warn_renamed(f"{kind.__name__}({old}=)", f"{kind.__name__}({renamed[old]}=)")
            # `dataclasses.replace` also passes the present value under the current name.
            values[renamed[old]] = values.pop(old)
        return type(kind).__mro__[1].__call__(kind, *args, **values)

    def decorate(kind: _Class) -> _Class:
        """Accept the former names in a struct."""
        for old, new in renamed.items():
            setattr(kind, old, renamed_attribute(f"{kind.__name__}.{old}", f"{kind.__name__}.{new}"))
        # The constructor of a struct is the call of its metaclass.
        kind.__class__ = type(type(kind).__name__, (type(kind),), {"__call__": call})
        return kind

    return decorate


class RenamedMembers(EnumMeta):
    """Metaclass of enums that accepts former names of members, with a warning.

    An enum class lists them as `__former_names__`: former name -> current name.
    """

    def __getitem__(cls, name: str) -> Any:
        """Return a member by its current or former name."""
        return super().__getitem__(cls._resolve(name))

    if not TYPE_CHECKING:  # otherwise type checkers would accept every name

        def __getattr__(cls, name: str) -> Any:
            """Return a member by its former name."""
            if name.startswith("_") or (new := cls._resolve(name)) == name:
                raise AttributeError(f"{cls.__name__} has no member {name!r}")
            return cls.__members__[new]

    def _resolve(cls, name: str) -> str:
        """Return the current name of a member, and warn if the name is a former one."""
        new: str = getattr(cls, "__former_names__", {}).get(name, name)
        if new != name:
            warn_renamed(f"{cls.__name__}.{name}", f"{cls.__name__}.{new}", stacklevel=4)
        return new
