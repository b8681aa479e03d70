"""The base class of values: named fields, immutable with `frozen=True`.

It is msgspec's `Struct`. A command creates over two hundred classes of values before it does anything, and creating a
dataclass takes fifty times as long. Values with arrays are compared by identity: `eq=False`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec import field
from msgspec.structs import force_setattr, replace

__all__ = ["Struct", "as_dict", "field", "force_setattr", "replace"]

if TYPE_CHECKING:
    from inspect import Signature

    from msgspec import Struct
else:

    class _StructType(type(msgspec.Struct)):
        """The type of structs; their signatures show annotations as text, which may name types of upper layers."""

        @property
        def __signature__(cls) -> Signature:
            from inspect import Parameter, Signature  # noqa: PLC0415 - slow, and rarely needed

            names, defaults = cls.__struct_fields__, cls.__struct_defaults__
            missing = (msgspec.NODEFAULT,) * (len(names) - len(defaults))
            types = {
                name: text
                for base in cls.__mro__[::-1]
                for name, text in vars(base).get("__annotations__", {}).items()
            }
            parameters = [
                Parameter(
                    name,
                    Parameter.POSITIONAL_OR_KEYWORD if name in cls.__match_args__ else Parameter.KEYWORD_ONLY,
                    default=Parameter.empty if default is msgspec.NODEFAULT else default,
                    annotation=types[name],
                )
                for name, default in zip(names, (*missing, *defaults), strict=True)
            ]
            return Signature(parameters)

    class _DataclassFields:
        """The fields of a struct as `dataclasses` describes them, so that its `replace` and `asdict` accept it."""

        def __get__(self, value: object, kind: type[msgspec.Struct]) -> dict[str, Any]:
            from dataclasses import make_dataclass  # noqa: PLC0415 - slow, and rarely needed

            return make_dataclass(kind.__name__, kind.__struct_fields__, kw_only=True).__dataclass_fields__

    class Struct(msgspec.Struct, metaclass=_StructType):
        """A value with named fields."""

        __dataclass_fields__ = _DataclassFields()


def as_dict(value: Struct) -> dict[str, Any]:
    """Return the fields of a value by name; values inside it become dictionaries, too."""
    return {name: _convert_structs(getattr(value, name)) for name in value.__struct_fields__}


def _convert_structs(value: Any) -> Any:
    """Return a field's value, with all structs in it converted to dictionaries."""
    if isinstance(value, msgspec.Struct):
        return as_dict(value)
    if isinstance(value, Mapping):
        return {key: _convert_structs(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        return type(value)(map(_convert_structs, value))
    return value
