"""Expressions of other slicers as ours, where they mean the same."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from printer_slicer.importing.conditions import Plain, matches, value_of
from printer_slicer.importing.foreign import Binary, Call, Choice, Literal, Name, Node, Unary, Unreadable
from printer_slicer.importing.names import ALIASES, FACTS, IN_LAYERS, Ours

__all__ = ["Said", "Translator", "literal", "plain_text"]

_ONE_TOOL: Final = (
    "initial_tool",
    "initial_extruder",
    "initial_extruder_nr",
    "current_extruder",
    "initial_no_support_extruder",
)
_TIGHT: Final = {"or": 1, "and": 2, "not": 3, "compare": 4, "sum": 5, "product": 6, "value": 8}
_LONGEST: Final = 20_000
_COMPARE: Final = ("==", "!=", "<", "<=", ">", ">=")
# Words, with anything before or behind them. A point is any character there: close enough within "0.25 nozzle".
_WORD: Final = r"(?:[^\\.*+?()\[\]{}|^$]|\\[^\w]|(?<=\d)\.(?=\d))+"
_PATTERN: Final = re.compile(
    rf"(?P<before>\.\*)?(?:(?P<word>{_WORD}(?:\|{_WORD})*)|\((?P<words>{_WORD}(?:\|{_WORD})*)\))(?P<behind>\.\*)?"
)


class Said(NamedTuple):
    """An expression of ours: its text, kind of value, and how tightly it holds together."""

    text: str
    kind: str
    binds: int = _TIGHT["value"]

    def within(self, binds: int) -> str:
        """The text, in parentheses where something around it binds as tightly or more."""
        return self.text if self.binds >= binds else f"({self.text})"


@dataclass(slots=True)
class Translator:
    """Turns trees into our expressions.

    Attributes:
        settings: of the printer whose macro it is; what has no name here becomes their values.
        dialect: whose names they are.
        in_layers: whether the macro stands between layers.
        bed: least and greatest x and y of the bed.
        notes: what differs a little, collected.
    """

    settings: Mapping[str, str]
    dialect: str = "prusaslicer"
    in_layers: bool = False
    bed: tuple[tuple[float, float], tuple[float, float]] = ((0.0, 0.0), (0.0, 0.0))
    notes: set[str] = field(default_factory=set)

    def said(self, node: Node) -> Said:
        """An expression of the same meaning.

        Raises:
            Unreadable: there is none, with the reason, or it is far too long: a remainder names its operands twice.
        """
        said = self._said(node)
        if len(said.text) > _LONGEST:
            raise Unreadable(f"over {_LONGEST} characters as an expression of ours")
        return said

    def _said(self, node: Node) -> Said:
        match node:
            case Literal():
                return literal(node.value)
            case Name():
                return self._named(node)
            case Unary(sign="not"):
                return _denied(self.condition(node.one))
            case Unary():
                one = self._number(node.one)
                return Said(f"-{one.within(_TIGHT['value'])}", one.kind, _TIGHT["product"])
            case Choice():
                return self._choice(node)
            case Call():
                return self._called(node)
            case Binary(sign="and" | "or"):
                return self._joined(node)
            case Binary(sign="=~" | "!~"):
                return self._matching(node)
            case Binary():
                return self._binary(node)

    def condition(self, node: Node) -> Said:
        """The same, for what must be true or false."""
        if isinstance(node, Name):
            with suppress(Unreadable):
                return literal(bool(value_of(node, self._constant(node))))
        said = self.said(node)
        if said.kind != "bool":
            raise Unreadable(f"{said.text} is no condition")
        return said

    def _constant(self, node: Name) -> Mapping[str, str]:
        """The printer's settings, if this name stands for one of them that has no name here."""
        name = ALIASES.get(self.dialect, {}).get(node.name, node.name)
        return {} if name in FACTS else self.settings

    def _named(self, node: Name) -> Said:
        name = ALIASES.get(self.dialect, {}).get(node.name, node.name)
        if name in ("print_bed_min", "print_bed_max", "print_bed_size"):
            return self._of_bed(name, node)
        if name == "is_extruder_used":
            return literal(self._place(node) == 0)
        ours = (IN_LAYERS.get(name) if self.in_layers else None) or FACTS.get(name) or self._suffixed(name)
        if ours is None:
            return literal(value_of(node, self.settings))
        if ours.differs:
            self.notes.add(f"{node.name} {ours.differs}")
        if ours.kind == "list":
            return Said(f"{ours.text}[{self._place(node)}]", "float")
        if self._place(node) != 0:
            raise Unreadable(f"{node.name} of another extruder")
        return Said(ours.text, ours.kind)

    def _suffixed(self, name: str) -> Ours | None:
        """`temperature_0` and the like, as old macros write an index."""
        return FACTS.get(name[:-2]) if name.endswith("_0") else None

    def _of_bed(self, name: str, node: Name) -> Said:
        axis = self._place(node)
        if axis not in (0, 1):
            raise Unreadable(f"{node.name}[{axis}]")
        low, high = self.bed[0][axis], self.bed[1][axis]
        return literal({"print_bed_min": low, "print_bed_max": high, "print_bed_size": high - low}[name])

    def _place(self, node: Name) -> int:
        """The index of a name, 0 without one and for the tool that prints."""
        if node.index is None or (isinstance(node.index, Name) and node.index.name in _ONE_TOOL):
            return 0
        value = value_of(node.index, self.settings)
        if isinstance(value, bool) or not isinstance(value, int):
            raise Unreadable(f"{value!r} is no index")
        return value

    def _number(self, node: Node) -> Said:
        said = self.said(node)
        if said.kind not in ("int", "float"):
            raise Unreadable(f"{said.text} is no number")
        return said

    def _choice(self, node: Choice) -> Said:
        condition, yes, no = self.condition(node.condition), self.said(node.yes), self.said(node.no)
        kind = yes.kind if yes.kind == no.kind else "float"
        if {yes.kind, no.kind} - {"int", "float"} and yes.kind != no.kind:
            raise Unreadable(f"{yes.text} and {no.text} are of two kinds")
        return Said(f"{condition.within(1)} ? {yes.within(1)} : {no.within(1)}", kind, 0)

    def _joined(self, node: Binary) -> Said:
        """`and`, `or`; a side that is known decides, or goes."""
        left, right = self.condition(node.left), self.condition(node.right)
        deciding = "false" if node.sign == "and" else "true"
        if deciding in (left.text, right.text):
            return Said(deciding, "bool")
        if left.text in ("true", "false"):
            return right
        if right.text in ("true", "false"):
            return left
        binds = _TIGHT[node.sign]
        return Said(f"{left.within(binds)} {node.sign} {right.within(binds + 1)}", "bool", binds)

    def _matching(self, node: Binary) -> Said:
        """A pattern on a text that is known, or one that is nothing but words."""
        if not isinstance(node.right, Literal):
            raise Unreadable("a pattern was expected")
        pattern, wanted = str(node.right.value), node.sign == "=~"
        left = self.said(node.left)
        if isinstance(value := _plain(left), str):
            return literal(matches(value, pattern) == wanted)
        found = _PATTERN.fullmatch(pattern)
        if left.kind != "text" or not found:
            raise Unreadable(f"{left.text} compared with the pattern /{pattern}/")
        words = (found["words"] or found["word"]).split("|")
        function = {
            (False, False): "",
            (True, False): "ends",
            (False, True): "begins",
            (True, True): "contains",
        }[bool(found["before"]), bool(found["behind"])]
        plain = [_quoted(re.sub(r"\\(.)", r"\1", word)) for word in words]
        each = [
            f"{function}({left.text}, {word})" if function else f"{left.text} == {word}" for word in plain
        ]
        same = Said(" or ".join(each), "bool", _TIGHT["or" if len(each) > 1 else "compare"])
        return same if wanted else _denied(same)

    def _binary(self, node: Binary) -> Said:
        left, right, sign = self.said(node.left), self.said(node.right), node.sign
        if sign in _COMPARE:
            return _comparison(sign, left, right)
        if sign == "+" and "text" in (left.kind, right.kind):
            return Said(f"{_as_text(left)} + {_as_text(right)}", "text", _TIGHT["sum"])
        if not {left.kind, right.kind} <= {"int", "float"}:
            raise Unreadable(f"{left.text} {sign} {right.text}")
        whole = left.kind == right.kind == "int"
        if sign in "+-" and right.text == "0":
            return left
        if sign == "+" and left.text == "0":
            return right
        binds = _TIGHT["sum" if sign in "+-" else "product"]
        text = f"{left.within(binds)} {sign} {right.within(binds + 1)}"
        if not whole or sign not in "/%":
            return Said(text, "int" if whole else "float", binds)
        if sign == "/":  # whole numbers divide to whole numbers there, not here
            return Said(f"int({text})", "int")
        product, divisor = left.within(_TIGHT["product"]), right.within(_TIGHT["product"] + 1)
        return Said(
            f"{left.within(_TIGHT['sum'])} - {divisor} * int({product} / {divisor})", "int", _TIGHT["sum"]
        )

    def _called(self, node: Call) -> Said:
        """The functions that both languages have."""
        arguments = [self._number(one) for one in node.arguments]
        texts = ", ".join(one.text for one in arguments)
        kind = "int" if all(one.kind == "int" for one in arguments) else "float"
        if node.name in ("min", "max") and len(arguments) >= 2:
            return Said(f"{node.name}({texts})", kind)
        if node.name in ("int", "round") and len(arguments) == 1:
            return Said(f"{node.name}({texts})", "int")
        if node.name == "zdigits" and len(arguments) == 2 and arguments[0].kind == "int":
            return Said(f"padded({texts})", "text")
        raise Unreadable(f"{node.name}() has no counterpart")


def _denied(said: Said) -> Said:
    if said.text in ("true", "false"):
        return Said("false" if said.text == "true" else "true", "bool")
    return Said(f"not {said.within(_TIGHT['not'])}", "bool", _TIGHT["not"])


def _comparison(sign: str, left: Said, right: Said) -> Said:
    """A comparison; of two known values its result."""
    numbers = {left.kind, right.kind} <= {"int", "float"}
    if not numbers and left.kind != right.kind:
        raise Unreadable(f"{left.text} {sign} {right.text}")
    first, second = _plain(left), _plain(right)
    if first is not None and second is not None:
        return literal(value_of(Binary(sign, Literal(first), Literal(second)), {}))
    binds = _TIGHT["compare"]
    return Said(f"{left.within(binds + 1)} {sign} {right.within(binds + 1)}", "bool", binds)


def literal(value: Plain) -> Said:
    """A value as it is written here."""
    if isinstance(value, bool):
        return Said("true" if value else "false", "bool")
    if isinstance(value, str):
        return Said(_quoted(value), "text")
    text = f"{value:.10f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)
    return Said(
        text, "int" if isinstance(value, int) else "float", _TIGHT["value" if value >= 0 else "product"]
    )


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'


def plain_text(said: Said) -> str | None:
    """What an expression that is nothing but a value looks like in a file; None for others."""
    value = _plain(said)
    if value is None or isinstance(value, bool):
        return None
    return value if isinstance(value, str) else f"{value:.10g}"


def _plain(said: Said) -> Plain | None:
    """The value of an expression that is nothing but a value."""
    if said.text in ("true", "false"):
        return said.text == "true"
    if said.kind == "text" and re.fullmatch(r'"(?:[^"\\]|\\.)*"', said.text):
        return re.sub(r"\\(.)", lambda one: "\n" if one[1] == "n" else one[1], said.text[1:-1])
    if re.fullmatch(r"-?\d+", said.text):
        return int(said.text)
    return float(said.text) if re.fullmatch(r"-?\d*\.\d+", said.text) else None


def _as_text(said: Said) -> str:
    """Something in a row of texts."""
    return said.within(_TIGHT["sum"]) if said.kind == "text" else f"text({said.text})"
