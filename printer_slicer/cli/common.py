"""What several commands share: the profile, the progress, the output file."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Lock, Timer
from typing import TYPE_CHECKING, Any

from printer_slicer.cli.layer_height import apply_layer_height
from printer_slicer.errors import UsageError
from printer_slicer.saving import check_writable, save

if TYPE_CHECKING:
    from printer_slicer.profile import Profile

__all__ = [
    "PATIENCE",
    "Stages",
    "changes_from",
    "check_writable",
    "named_folders",
    "profile_facts",
    "profile_from",
    "refuse_mixing",
    "refuse_same",
    "say",
    "stages",
    "visible",
    "without_stdin",
    "write_file",
]

_OF_PLANNER = ("tolerance", "layer_height")  # what ranges of the planner have
PATIENCE = 1.0  # s before a progress bar appears
_STAGES = 11  # from loading to writing


def profile_from(
    arguments: argparse.Namespace, *, slices: bool = True, gcode: Path | None = None, tell: bool = True
) -> Profile:
    """Load the profile of --printer, --material, --quality, --planner and --set, and print its names and sources.

    Args:
        arguments: the command line; `profile_facts` returns the sources of the profile afterwards.
        slices: whether a part is sliced with it; what is only printed need not suit the quality.
        gcode: a file whose own machine, material and quality are used unless the command line names others.
        tell: whether to print them; `sim` prints its own line, and the console prints only lines of the printer.

    Raises:
        UsageError: a name or setting that does not exist or is out of bounds.
    """
    from printer_slicer.cli.own_settings import OwnSettings, own_settings, provenance
    from printer_slicer.profile import load_profile, profile_over

    names: dict[str, Any] = {
        kind: getattr(arguments, kind, None) for kind in ("printer", "material", "quality")
    }
    folders = named_folders(arguments)
    changes = changes_from(arguments)
    if gcode is None:
        own = OwnSettings({}, ())
        profile = load_profile(**names, changes=changes, slices=slices, folders=folders)
    else:
        own = own_settings(gcode, folders)
        profile = profile_over(own.values, names, changes, folders)
    used = {"printer", "material", *own.values, *(("quality",) if slices and gcode is None else ())}
    told = provenance({kind: name for kind, name in names.items() if kind in used}, own, folders)
    arguments.profile_facts = {"profile": told}
    if tell:
        _tell_profile(arguments, told, own.refused)
    return profile


def _tell_profile(
    arguments: argparse.Namespace, told: dict[str, dict[str, str]], refused: Sequence[str]
) -> None:
    """Print machine, material and quality with their sources as the first line.

    The line goes to stderr if stdout carries data; --json has it in `profile`.
    """
    if arguments.quiet:
        return
    for reason in refused:
        text = f"printer-slicer: warning: the settings in the file are not used: {reason}"
        print(visible(text), file=sys.stderr)
    if not arguments.json:
        data = any(str(getattr(arguments, name, "")) == "-" for name in ("output", "picture"))
        line = ", ".join(f"{one['name']} ({_origin(one)})" for one in told.values())
        print(visible(without_stdin(arguments, line)), file=sys.stderr if data else sys.stdout)


def _origin(told: dict[str, str]) -> str:
    """Return where a profile comes from, and the machine named by the file if no profile has that name."""
    named = told.get("named_in_file")
    return told["from"] + (f": the file names '{named}', which has no profile" if named else "")


def profile_facts(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return machine, material and quality of a command with their sources, for JSON."""
    facts: dict[str, Any] = getattr(arguments, "profile_facts", {})
    return facts


def named_folders(arguments: argparse.Namespace) -> Sequence[Path]:
    """The folders of --profiles.

    Raises:
        UsageError: one that there is not.
    """
    folders: Sequence[Path] = getattr(arguments, "profiles", ())
    for folder in folders:
        if not folder.is_dir():
            raise UsageError(
                f"--profiles {folder}: no such folder",
                remedy="name one that holds printers/, materials/ or qualities/",
            )
    return folders


def changes_from(arguments: argparse.Namespace) -> dict[str, object]:
    """The settings that --set and flags with names of their own change.

    Raises:
        UsageError: one that is no setting with a value, or an empty name of a profile.
    """
    changes = _dialled(arguments)
    if getattr(arguments, "baud", None):
        changes["printer.baud"] = arguments.baud
    for change in arguments.set:
        key, equals, value = change.partition("=")
        if not equals or not key.strip():
            raise UsageError(
                f"--set {change}: expected KEY=VALUE", remedy="for example --set infill_density=0.2"
            )
        changes[key.strip()] = value.strip()
    if getattr(arguments, "firmware", None) and not {"flavour", "printer.flavour"} & set(changes):
        changes["printer.flavour"] = _flavour_of(arguments.firmware)
    apply_layer_height(changes)
    for flag in ("printer", "material", "quality"):
        if getattr(arguments, flag, None) == "":
            raise UsageError(
                f"--{flag}: the name is empty", remedy="leave it out, or see `printer-slicer profiles`"
            )
    return changes


def _flavour_of(firmware: str) -> str:
    """Return the G-code flavour of a simulated firmware, for slicing and reading."""
    from printer_slicer.sim.front_end import FRONT_ENDS

    return FRONT_ENDS[firmware].flavour


def _dialled(arguments: argparse.Namespace) -> dict[str, object]:
    """The settings that flags with names of their own stand for."""
    given = {
        key.removeprefix("dial "): value for key, value in vars(arguments).items() if key.startswith("dial ")
    }
    changes: dict[str, object] = {key: value for key, value in given.items() if value is not None}
    heights = str(changes.pop("heights", ""))
    if ":" in heights:
        low, high, *step = heights.split(":")
        if len(step) > 1:
            raise UsageError(
                f"--heights {heights}: expected LOW:HIGH or LOW:HIGH:STEP", remedy="in mm: 0.1:0.3:0.02"
            )
        changes |= {
            "quality.thinnest_layer": low,
            "quality.thickest_layer": high,
            "quality.layer_heights": "",
        }
        changes |= {"quality.layer_step": step[0]} if step else {}
    elif heights:
        changes["quality.layer_heights"] = heights
    own = list(getattr(arguments, "set_for", ()))
    planned: list[str] = []
    for rule in getattr(arguments, "range", ()):
        of_planner = all(
            part.partition("=")[0].strip() in _OF_PLANNER for part in rule.split(":")[2:] if "=" in part
        )
        if not of_planner:
            _insist_on_heights(rule)
        (planned if of_planner else own).append(rule)
    # Behind those of the quality's file, over which they win.
    changes |= {"quality.planner.ranges+": ";".join(planned)} if planned else {}
    return changes | ({"quality.overrides+": ";".join(own)} if own else {})


def _insist_on_heights(rule: str) -> None:
    """A rule of --range begins with two numbers; otherwise their text would be taken for the name of an object.

    Raises:
        UsageError: it does not.
    """
    from printer_slicer.profile.overrides import HIGHEST, has_heights

    if not has_heights(rule):
        raise UsageError(
            f"--range {rule}: expected LOW:HIGH:KEY=VALUE",
            remedy=f"two heights in mm, as 5:10:perimeters=4, or up to the top 5:{HIGHEST:g}:perimeters=4; objects are"
            " named with --set-for",
        )


def refuse_mixing(arguments: argparse.Namespace) -> None:
    """Only one thing can go to stdout, and a picture must be of a kind that is made.

    Raises:
        UsageError: two would go there, or it is not.
    """
    if arguments.picture:
        from printer_slicer.drawing import check_picture

        check_picture(arguments.picture)
    wants = {"-o": getattr(arguments, "output", None), "--picture": arguments.picture}
    there = [f"{flag} -" for flag, path in wants.items() if str(path) == "-"]
    there += ["--json"] if arguments.json else []
    if len(there) > 1:
        raise UsageError(f"{' and '.join(there)} both want stdout", remedy="write one of them to a file")
    output, picture = wants.values()
    if output and picture and str(output) != "-" and output.absolute() == picture.absolute():
        raise UsageError(f"-o and --picture both want {output}", remedy="name another picture")


def refuse_same(output: Path, model: Path, flag: str = "-o") -> None:
    """Never write over the model.

    Raises:
        UsageError: it would be.
    """
    # Names that cannot be are refused when they are written to.
    with contextlib.suppress(OSError, ValueError):
        if not output.samefile(model):
            return
        raise UsageError(f"{output}: is the model itself", remedy=f"name another output with {flag}")


def say(arguments: argparse.Namespace, text: str) -> None:
    """A line for people; not with --quiet or --json."""
    if not (arguments.quiet or arguments.json):
        print(visible(without_stdin(arguments, text)))


def without_stdin(arguments: argparse.Namespace, text: str) -> str:
    """Text without the folder that stdin was kept in, of which people need not read."""
    hidden = getattr(arguments, "hidden", "")
    return text.replace(hidden, "") if hidden else text


def visible(text: str) -> str:
    """Text that may come from a file or a printer, without what would control the terminal."""
    return "".join(
        letter if letter.isprintable() or letter == "\n" else "\N{REPLACEMENT CHARACTER}" for letter in text
    )


Stages = Callable[[str], None]


@contextmanager
def stages(arguments: argparse.Namespace) -> Iterator[Stages]:
    """Says which stage the work is in: a bar once it takes longer than a second, on a terminal only.

    With --verbose every stage is a line on stderr, with the seconds since the beginning.
    """
    begun = time.monotonic()

    def tell(stage: str) -> None:
        """One line, with the time."""
        print(f"{time.monotonic() - begun:8.3f} s  {stage}", file=sys.stderr)

    if arguments.verbose and not arguments.quiet:
        yield tell
    elif arguments.quiet or not sys.stderr.isatty():
        yield lambda _stage: None
    else:
        bar = _LateBar()
        try:
            yield bar.report
        finally:
            bar.close()


class _LateBar:
    """A progress bar over the stages that appears when the work turns out to be long."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._stage, self._done, self._over = "", -1, False
        self._show: Callable[[], object] | None = None
        self._stop: Callable[[], object] | None = None
        self._timer = Timer(PATIENCE, self._open)
        self._timer.daemon = True
        self._timer.start()

    def report(self, stage: str) -> None:
        """A stage begins, or goes on: then its first word is the same."""
        with self._lock:
            goes_on = self._done >= 0 and stage.split(maxsplit=1)[0] == self._stage.split()[0]
            self._stage, self._done = stage, self._done + (not goes_on)
            if self._show:
                self._show()

    def close(self) -> None:
        """The work is done."""
        self._timer.cancel()
        with self._lock:
            self._over = True  # for a timer that had gone off already: its bar would take stdout and never give it back
            if self._stop:
                self._stop()

    def _open(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (TextColumn("{task.description:<12}"), BarColumn(), TimeElapsedColumn())
        bar = Progress(*columns, console=Console(stderr=True), transient=True)
        with self._lock:
            if self._over:
                return
            task = bar.add_task(self._stage, total=_STAGES, completed=max(self._done, 0))
            bar.start()
            self._stop = bar.stop
            self._show = lambda: bar.update(task, description=self._stage, completed=self._done)


def write_file(path: Path, data: bytes) -> None:
    """Write a whole file, or leave what was there before untouched; `-` is stdout, and links stay links.

    Raises:
        OutputError: the folder is missing, the disk full, or writing not allowed.
    """
    if str(path) != "-":
        save(path, data)
        return
    sys.stdout.buffer.write(data)
    sys.stdout.buffer.flush()
