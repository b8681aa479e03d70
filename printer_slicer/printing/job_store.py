"""Store of running and unfinished prints: one folder per print."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any

from printer_slicer.errors import OutputError, UsageError
from printer_slicer.input_files import check_is_file, read_input

if TYPE_CHECKING:
    from filelock import BaseFileLock

    from printer_slicer.printing.host_settings import HostSettings

__all__ = [
    "DamagedPrint",
    "JobStore",
    "PortAddress",
    "Print",
    "begin",
    "damaged_prints",
    "default_job_store",
    "find",
    "find_damage",
    "load_print",
    "same_port",
    "stored_prints",
    "unfinished",
]

_PROBE_SECONDS = 0.04  # a check whether a print is running holds the lock for a shorter time
_MOST_HEAD = 1 << 24  # bytes
_HEAD, _JOB, _LOCK = "head.json", "job.gcode", "lock"
_IN_HEAD = {"name": str, "port": str, "baud": int, "begun": str, "boot": str, "setup": dict}
_KINDS = {str: "a string", int: "an integer", dict: "an object"}
JobStore = Path


def default_job_store() -> Path:
    """Return the folder of the store: $PRINTER_SLICER_STATE, or the state folder of the platform."""
    if named := os.environ.get("PRINTER_SLICER_STATE"):
        return Path(named) / "prints"
    from platformdirs import user_state_path  # noqa: PLC0415 - slow, and only needed here

    return Path(user_state_path("printer-slicer", appauthor=False)) / "prints"


@dataclass(slots=True)
class Print:
    """A stored print.

    Attributes:
        folder: folder with `head.json`, `job.gcode` and `journal`.
        name: name of the job.
        port, baud: port and baud rate of the print.
        begun: local time of the start, as text.
        boot: id of the boot of the computer at the start.
    """

    folder: Path
    name: str
    port: str
    baud: int
    begun: str
    boot: str
    _setup: Mapping[str, Any]
    _lock: BaseFileLock | None = None

    @property
    def setup(self) -> HostSettings:
        """Return the settings of the printer. They are read on demand, because their module is slow to import."""
        from printer_slicer.printing.host_settings import parse_host_settings  # noqa: PLC0415 - slow

        return parse_host_settings(self._setup)

    @property
    def text(self) -> bytes:
        """Return the copy of the G-code."""
        return (self.folder / _JOB).read_bytes()

    @property
    def same_boot(self) -> bool:
        """Return whether the computer has not restarted; else the last second of the journal may be missing."""
        return bool(self.boot) and self.boot == _boot()

    def hold(self) -> bool:
        """Lock the print for this process; return False if another process holds it."""
        return self._try_to_hold(_PROBE_SECONDS)

    def _try_to_hold(self, seconds: float) -> bool:
        """Lock the print; the lock ends with the process, however that ends."""
        from filelock import FileLock, Timeout  # noqa: PLC0415 - slow

        # A print may end in another thread than the one that started it.
        lock = FileLock(self.folder / _LOCK, mode=0o600, thread_local=False)
        try:
            lock.acquire(timeout=seconds, poll_interval=_PROBE_SECONDS / 4)
        except Timeout:
            return False
        self._lock = lock
        return True

    def release(self) -> None:
        """Release the lock."""
        if self._lock:
            self._lock.release()
            self._lock = None

    @property
    def is_running(self) -> bool:
        """Return whether a process prints it; False if its lock is damaged."""
        try:
            return self.running
        except OSError:
            return False

    @property
    def running(self) -> bool:
        """Return whether a process prints it.

        Raises:
            OSError: its lock is not a file.
        """
        if self._lock:
            return True
        if not self._try_to_hold(0):
            return True
        self.release()
        return False

    def forget(self) -> None:
        """Delete the print."""
        self.release()
        rmtree(self.folder, ignore_errors=True)


@dataclass(frozen=True, slots=True)
class DamagedPrint:
    """A print that cannot be resumed because one of its files is damaged.

    Attributes:
        folder: folder of the print.
        file: name of the damaged file.
        why: what is wrong with it.
    """

    folder: Path
    file: str
    why: str

    def __str__(self) -> str:
        return f"{self.folder / self.file}: {self.why}"

    @property
    def remedy(self) -> str:
        """Return what to do about it."""
        return f"Delete it with printer-slicer resume --discard {self.folder.name}; it cannot be resumed"

    def error(self) -> UsageError:
        """Return the error for an attempt to resume it."""
        return UsageError(str(self), remedy=self.remedy)

    def forget(self) -> None:
        """Delete the print."""
        rmtree(self.folder, ignore_errors=True)


class _InvalidHeadError(ValueError):
    """The head of a print is invalid."""


@dataclass(frozen=True, slots=True)
class PortAddress:
    """A port and its baud rate."""

    port: str
    baud: int


def begin(job_store: JobStore, name: str, text: bytes, place: PortAddress, setup: HostSettings) -> Print:
    """Store a new print, held by this process.

    Raises:
        OutputError: it cannot be stored.
    """
    now = datetime.now(UTC).astimezone()
    plain = re.sub(r"[^A-Za-z0-9._-]+", "_", name)[:40]
    folder = job_store / f"{now:%Y%m%d-%H%M%S-%f}-{plain}"
    head = {
        "version": 1,
        "name": name,
        "port": _lasting(place.port),
        "baud": place.baud,
        "begun": f"{now:%Y-%m-%d %H:%M}",
        "boot": _boot(),
        "setup": setup.as_json(),
    }
    try:
        job_store.mkdir(parents=True, exist_ok=True, mode=0o700)
        folder.mkdir(mode=0o700)
        (folder / _JOB).write_bytes(text)
        (folder / _HEAD).write_text(json.dumps(head), encoding="utf-8")
        (folder / "journal").touch(mode=0o600)
    except OSError as error:
        rmtree(folder, ignore_errors=True)
        raise OutputError(
            f"{job_store}: cannot store the print: {error.strerror}",
            remedy="Free some space, or set PRINTER_SLICER_STATE to another folder",
        ) from None
    made = load_print(folder)
    assert made is not None
    made.hold()
    return made


def stored_prints(job_store: JobStore) -> Iterator[Print]:
    """Yield the stored prints, the oldest first."""
    if not job_store.is_dir():
        return
    for folder in sorted(job_store.iterdir()):
        if found := load_print(folder):
            yield found


def load_print(folder: Path) -> Print | None:
    """Return the print in this folder; None if there is none, or its head is invalid."""
    with suppress(_InvalidHeadError):
        return _print_in(folder)
    return None


def _print_in(folder: Path) -> Print | None:
    """Return the print in this folder; None if there is none.

    Raises:
        _InvalidHeadError: its head is invalid.
    """
    try:
        check_is_file(folder / _HEAD)
        head = json.loads(read_input(folder / _HEAD, _MOST_HEAD))
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise _InvalidHeadError(f"it cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise _InvalidHeadError(f"it is not JSON: {error}") from None
    if not isinstance(head, dict):
        raise _InvalidHeadError("it is not a JSON object")
    for name, kind in _IN_HEAD.items():
        if type(head.get(name)) is not kind:
            raise _InvalidHeadError(f"{name!r} is missing, or is not {_KINDS[kind]}")
    if not _is_address(head["port"]):
        raise _InvalidHeadError("'port' is not a valid port name")
    return Print(folder, *(head[name] for name in _IN_HEAD))


def find_damage(print_: Print) -> DamagedPrint | None:
    """Return why a print cannot be resumed, as far as its files show; None if it can."""
    # A process that only controls a print does not need these imports.
    from printer_slicer.commands import split_gcode  # noqa: PLC0415
    from printer_slicer.printing.journal import read_journal  # noqa: PLC0415
    from printer_slicer.printing.reattach import find_journal_damage  # noqa: PLC0415

    try:
        _ = print_.setup
    except TypeError as error:
        return DamagedPrint(print_.folder, _HEAD, f"the printer's setup is invalid: {error}")
    file = "journal"
    try:
        journal_data = read_journal(print_.folder)
        file = _JOB
        check_is_file(print_.folder / _JOB)
        total = len(split_gcode(print_.text).commands)
    except OSError as error:
        return DamagedPrint(print_.folder, file, f"it cannot be read: {error.strerror}")
    if not total:
        return DamagedPrint(print_.folder, _JOB, "it holds no commands")
    why = find_journal_damage(journal_data, total)
    return DamagedPrint(print_.folder, "journal", why) if why else None


def _is_address(port: str) -> bool:
    """Return whether a text can be a port name."""
    with suppress(UnicodeEncodeError):
        return b"\0" not in os.fsencode(port)
    return False


def damaged_prints(job_store: JobStore) -> Iterator[DamagedPrint]:
    """Yield damaged prints that are not running, the oldest first."""
    for folder in sorted(job_store.iterdir()) if job_store.is_dir() else ():
        try:
            found = _print_in(folder)
        except _InvalidHeadError as error:
            yield DamagedPrint(folder, _HEAD, str(error))
        else:
            if not found:
                continue
            try:
                is_running = found.running
            except OSError as error:
                yield DamagedPrint(folder, _LOCK, f"it cannot be locked: {error.strerror}")
                continue
            if not is_running and (damage := find_damage(found)):
                yield damage


def same_port(one: str, other: str) -> bool:
    """Return whether two addresses mean the same port."""
    return one == other or ("://" not in one and os.path.realpath(one) == os.path.realpath(other))


def unfinished(job_store: JobStore, port: str) -> Print | None:
    """Return an unfinished print on this port that is not running, None if there is none."""
    for one in stored_prints(job_store):
        if same_port(one.port, port) and not one.is_running:
            return one
    return None


def find(job_store: JobStore, name: str, *, running: bool) -> Print:
    """Find the print of this name, or the only one.

    Args:
        job_store: the store.
        name: name of the job or of its folder, empty for the only print.
        running: whether to look among running or unfinished prints.

    Raises:
        UsageError: there is none, or more than one.
    """
    known = list(stored_prints(job_store))
    if not running:
        damaged = {one.folder: one for one in damaged_prints(job_store)}
        for one in known:
            if name and one.folder in damaged and name in {one.name, one.folder.name}:
                raise damaged[one.folder].error()
        known = [one for one in known if one.folder not in damaged]
    known = [one for one in known if one.is_running is running]
    named = [one for one in known if name in {"", one.name, one.folder.name}]
    if len(named) == 1:
        return named[0]
    kind = "running" if running else "unfinished"
    what = f"no {kind} print" if not named else f"{len(named)} {kind} prints"
    there = "; ".join(f"{one.name} on {one.port}, started {one.begun} ({one.folder.name})" for one in known)
    raise UsageError(
        what + (f" {name}" if name else ""),
        remedy=f"Available: {there}"
        if there
        else "Run printer-slicer resume --list to see unfinished prints",
    )


def _lasting(port: str) -> str:
    """Return an address that is valid in any working directory."""
    return port if "://" in port else str(Path(port).absolute())


def _boot() -> str:
    """Return the id of the current boot of the computer."""
    with suppress(OSError):
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    return ""
