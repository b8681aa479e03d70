"""Join JavaScript modules into one script, which a page can contain or load with one request.

The modules of a folder import each other by name. Joined, each stands after those it imports, without the words
`import` and `export`. Their names at the top level are therefore unique, and they import and export in two simple
forms only.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from typing import Final

__all__ = ["join_modules"]

_IMPORT: Final = re.compile(r'^import \{[^}]*\} from "\./([a-z0-9_]+\.js)";\n', re.MULTILINE)
_EXPORT: Final = re.compile(r"^export (?=(?:async )?function |const |class )", re.MULTILINE)
_NAME: Final = re.compile(r"^(?:async )?(?:const|let|function|class) (\w+)", re.MULTILINE)
_LEFT: Final = re.compile(r"^(?:import|export)\b.*", re.MULTILINE)


def join_modules(read: Callable[[str], str], first: str) -> str:
    """Return a module and all that it imports as one script.

    Args:
        read: returns the text of the module with a name, such as `main.js`.
        first: name of the module that imports the others.

    Raises:
        ValueError: a module imports or exports in a form that is not supported, or two have a name in common.
    """
    done: dict[str, str] = {}
    _add_module(read, first, done)
    joined = "\n".join(done.values())
    names = Counter(_NAME.findall(joined))
    if twice := [name for name, count in names.items() if count > 1]:
        raise ValueError(f"modules share the names {', '.join(twice)}")
    return joined


def _add_module(read: Callable[[str], str], name: str, done: dict[str, str]) -> None:
    """Add a module to those in `done`, after the modules it imports."""
    if name in done:
        return
    text = read(name)
    for other in _IMPORT.findall(text):
        _add_module(read, other, done)
    joined = _EXPORT.sub("", _IMPORT.sub("", text))
    if left := _LEFT.search(joined):
        raise ValueError(f"{name}: cannot join {left[0]!r}")
    done[name] = joined
