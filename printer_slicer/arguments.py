"""Check the types of the arguments of public functions, so that messages name the argument and what to pass."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, Final, TypeVar

from printer_slicer.errors import UsageError
from printer_slicer.texts import describe_type

__all__ = ["PATH", "check_argument", "check_arguments"]

PATH: Final = (str, os.PathLike)
"""The types of a file name."""

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Kinds = type[Any] | tuple[type[Any], ...]

_REMEDIES: Final[Mapping[str, str]] = {
    "Certificate": "Compute it with ps.certify(ps.read_surface(mesh), plan)",
    "Job": 'Make it with ps.slice("part.stl"), or from G-code with ps.job_from("part.gcode", profile)',
    "LayerPlan": "Compute it with ps.plan_part(mesh, profile), or pass ps.LayerPlan.from_tops(tops)",
    "Mesh": 'Read it with ps.load_mesh("part.stl")',
    "Placement": "Pass a placement such as ps.Placement(center=(100, 100))",
    "Printer": "Pass the printer of a profile: profile.printer",
    "Profile": 'Load it with ps.load_profile("Ender 3", "pla")',
    "Program": "Pass stages.program of ps.slice_stages(mesh, profile)",
    "Sections": "Pass stages.sections of ps.slice_stages(mesh, profile)",
    "Strategies": "Pass your functions as ps.Strategies(planner=...)",
    "Surface": "Compute it with ps.read_surface(mesh)",
    "Volumes": "Pass meshes as ps.Volumes(enforce=mesh, block=mesh)",
    "bytes": 'Pass a file name, pathlib.Path("part.gcode").read_bytes(), or job.text',
    "list": "Pass a list, such as [mesh]",
    "int": "Pass a whole number, without quotes",
    "float": "Pass a number, without quotes",
    "str": 'Pass text such as "part.stl"',
}
"""Name of a type -> how to get a value of it."""
_NAME_REMEDIES: Final[Mapping[str, str]] = {
    "printer": 'Pass the name of a printer, such as "Ender 3"',
    "material": 'Pass the name of a material, such as "petg"',
    "quality": 'Pass the name of a quality, such as "standard"',
}
"""Argument that takes the name of a profile -> what to pass."""
_WORDS: Final[Mapping[str, str]] = {
    "int": "whole number",
    "float": "number",
    "str": "file name or a name",
    "bytes": "bytes object",
}


def check_argument(name: str, value: object, kinds: _Kinds) -> None:
    """Check the type of an argument.

    Args:
        name: name of the argument.
        value: value of the argument.
        kinds: one or several accepted types; messages name the first.

    Raises:
        UsageError: the value has none of these types.
    """
    if isinstance(value, kinds) and not (isinstance(value, bool) and kinds is int):
        return
    kind = (kinds[0] if isinstance(kinds, tuple) else kinds).__name__
    remedy = _REMEDIES.get(kind, "See the documentation of the function")
    raise UsageError(
        f"the argument `{name}` must be a {_WORDS.get(kind, kind)}, not {describe_type(value)}",
        remedy=_NAME_REMEDIES.get(name, remedy) if kind == "str" else remedy,
    )


def check_arguments(**kinds: _Kinds) -> Callable[[_Function], _Function]:
    """Return a decorator of functions that checks the types of arguments.

    Args:
        **kinds: name of an argument -> its type, or its types. Add `NoneType` if it may be None.
    """

    def decorate(function: _Function) -> _Function:
        """Check the arguments of one function."""
        names = function.__code__.co_varnames

        @wraps(function)
        def call(*args: Any, **options: Any) -> Any:
            """Check the arguments that are given, then call the function."""
            for name, value in (*zip(names, args, strict=False), *options.items()):
                if name in kinds:
                    check_argument(name, value, kinds[name])
            return function(*args, **options)

        return call  # type: ignore[return-value]

    return decorate
