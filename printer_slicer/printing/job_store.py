"""Store running and unfinished prints, one folder per print, so that they can be resumed."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.errors import OutputError, UsageError
from printer_slicer.input_files import check_is_file, read_input
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from printer_slicer.printing.host_settings import HostSettings
    from printer_slicer.process_lock import ProcessLock

__all__ = [
    "DamagedPrint",
    "JobStore",
    "PortAddress",
    "Print",
    "create_print",
    "default_job_store",
    "find_damage",
    "find_damaged_prints",
    "find_print",
    "find_unfinished_print",
    "is_same_port",
    "load_print",
    "load_stored_prints",
]

_LOCK_TIMEOUT = 0.04  # s; longer than other processes hold the lock to check whether a print is running
_MAX_HEAD_BYTES = 1 << 24  # bytes
_HEAD_FILE, _JOB_FILE, _LOCK_FILE = "head.json", "job.gcode", "lock"
_HEAD_FIELDS = {"name": str, "port": str, "baud": int, "begun": str, "boot": str, "setup": dict}
_TYPE_NAMES = {str: "a string", int: "an integer", dict: "an object"}
JobStore = Path


def default_job_store() -> Path:
    """Return the folder of the store: $PRINTER_SLICER_STATE, or the state folder of the platform."""
    if named := os.environ.get("PRINTER_SLICER_STATE"):
        return Path(named) / "prints"
    from platformdirs import user_state_path  # noqa: PLC0415 - slow, and only needed here

    return Path(user_state_path("printer-slicer", appauthor=False)) / "prints"


class Print(Struct):
    """A print in the job store.

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
    _lock: ProcessLock | None = None

    @property
    def setup(self) -> HostSettings:
        """Return the settings of the printer; they are parsed on demand, because their module is slow to import."""
        from printer_slicer.printing.host_settings import parse_host_settings  # noqa: PLC0415 - slow

        return parse_host_settings(self._setup)

    @property
    def text(self) -> bytes:
        """Return the G-code of the print, which is a copy of the original file."""
        return (self.folder / _JOB_FILE).read_bytes()

    @property
    def is_same_boot(self) -> bool:
        """Return whether the computer has not restarted since the print began."""
        return bool(self.boot) and self.boot == _read_boot_id()

    def lock(self) -> bool:
        """Lock the print for this process; return False if another process has locked it."""
        return self._try_to_lock(_LOCK_TIMEOUT)

    def _try_to_lock(self, seconds: float) -> bool:
        """Try for `seconds` to lock the print for this process; return whether that succeeded."""
        from printer_slicer.process_lock import ProcessLock  # noqa: PLC0415 - an emergency stop needs no lock

        lock = ProcessLock(self.folder / _LOCK_FILE)
        if not lock.acquire(seconds):
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
        """Return whether a process is running this print; False if the lock file is damaged."""
        try:
            return self.is_locked
        except OSError:
            return False

    @property
    def is_locked(self) -> bool:
        """Return whether a process has locked the print.

        Raises:
            OSError: the lock is not a file.
        """
        if self._lock:
            return True
        if not self._try_to_lock(0):
            return True
        self.release()
        return False

    def delete(self) -> None:
        """Delete the files of the print."""
        self.release()
        rmtree(self.folder, ignore_errors=True)


class DamagedPrint(Struct, frozen=True):
    """A stored print that cannot be resumed, because one of its files is damaged.

    Attributes:
        folder: folder of the print.
        file: name of the damaged file.
        reason: description of the damage.
    """

    folder: Path
    file: str
    reason: str

    def __str__(self) -> str:
        return f"{self.folder / self.file}: {self.reason}"

    @property
    def remedy(self) -> str:
        """Return what the user can do about the damaged print."""
        return (
            f"The print cannot be resumed. Delete it with printer-slicer resume --discard {self.folder.name}"
        )

    def make_error(self) -> UsageError:
        """Return the error to raise when the user tries to resume the print."""
        return UsageError(str(self), remedy=self.remedy)

    def delete(self) -> None:
        """Delete the files of the print."""
        rmtree(self.folder, ignore_errors=True)


class _InvalidHeadError(ValueError):
    """Error: the head file of a print is invalid."""


class PortAddress(Struct, frozen=True):
    """Port and baud rate of a print."""

    port: str
    baud: int


def create_print(
    job_store: JobStore,
    name: str,
    text: bytes,
    address: PortAddress,
    setup: HostSettings,
    *,
    folder_name: str = "",
) -> Print:
    """Store a new print, and lock it for this process.

    Args:
        job_store: the store.
        name: name of the job.
        text: its G-code.
        address: port and baud rate.
        setup: settings of the printer.
        folder_name: name of its new folder; empty: made from time and name.

    Raises:
        OutputError: the print cannot be stored.
    """
    now = datetime.now(UTC).astimezone()
    safe_name = re.sub(r"[^A-Za-z0-9._-]+", "_", name)[:40]
    folder = job_store / (folder_name or f"{now:%Y%m%d-%H%M%S-%f}-{safe_name}")
    head = {
        "version": 1,
        "name": name,
        "port": _make_port_absolute(address.port),
        "baud": address.baud,
        "begun": f"{now:%Y-%m-%d %H:%M}",
        "boot": _read_boot_id(),
        "setup": setup.as_json(),
    }
    try:
        job_store.mkdir(parents=True, exist_ok=True, mode=0o700)
        folder.mkdir(mode=0o700)
        (folder / _JOB_FILE).write_bytes(text)
        (folder / _HEAD_FILE).write_text(json.dumps(head), encoding="utf-8")
        (folder / "journal").touch(mode=0o600)
    except OSError as error:
        if not isinstance(error, FileExistsError):
            rmtree(folder, ignore_errors=True)
        raise OutputError(
            f"{job_store}: cannot store the print: {error.strerror}",
            remedy="Free some disk space, or set PRINTER_SLICER_STATE to another folder",
        ) from None
    return _load_and_lock(folder)


def _load_and_lock(folder: Path) -> Print:
    """Load a print that was just stored, and lock it for this process."""
    made = load_print(folder)
    assert made is not None
    made.lock()
    return made


def load_stored_prints(job_store: JobStore) -> Iterator[Print]:
    """Yield the stored prints, the oldest first."""
    if not job_store.is_dir():
        return
    for folder in sorted(job_store.iterdir()):
        if print_ := load_print(folder):
            yield print_


def load_print(folder: Path) -> Print | None:
    """Load the print in a folder; return None if the folder holds no print, or its head file is invalid."""
    with suppress(_InvalidHeadError):
        return _read_print(folder)
    return None


def _read_print(folder: Path) -> Print | None:
    """Read the print in a folder; return None if the folder holds no print.

    Raises:
        _InvalidHeadError: its head file is invalid.
    """
    try:
        check_is_file(folder / _HEAD_FILE)
        head = json.loads(read_input(folder / _HEAD_FILE, _MAX_HEAD_BYTES))
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise _InvalidHeadError(f"the file cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise _InvalidHeadError(f"the file is not JSON: {error}") from None
    if not isinstance(head, dict):
        raise _InvalidHeadError("the file is not a JSON object")
    for name, kind in _HEAD_FIELDS.items():
        if type(head.get(name)) is not kind:
            raise _InvalidHeadError(f"{name!r} is missing, or is not {_TYPE_NAMES[kind]}")
    if not _is_valid_port(head["port"]):
        raise _InvalidHeadError("'port' is not a valid port name")
    return Print(folder, *(head[name] for name in _HEAD_FIELDS))


def find_damage(print_: Print) -> DamagedPrint | None:
    """Find a damaged file that prevents a resume of the print; return None if all files are valid."""
    # Imported here, because a process that only controls a print does not need these modules.
    from printer_slicer.commands import split_gcode  # noqa: PLC0415
    from printer_slicer.printing.journal import read_journal  # noqa: PLC0415
    from printer_slicer.printing.reattach import find_journal_damage  # noqa: PLC0415

    try:
        _ = print_.setup
    except TypeError as error:
        return DamagedPrint(print_.folder, _HEAD_FILE, f"the printer settings are invalid: {error}")
    file = "journal"
    try:
        journal_data = read_journal(print_.folder)
        file = _JOB_FILE
        check_is_file(print_.folder / _JOB_FILE)
        total = len(split_gcode(print_.text).commands)
    except OSError as error:
        return DamagedPrint(print_.folder, file, f"the file cannot be read: {error.strerror}")
    if not total:
        return DamagedPrint(print_.folder, _JOB_FILE, "the file contains no commands")
    reason = find_journal_damage(journal_data, total)
    return DamagedPrint(print_.folder, "journal", reason) if reason else None


def _is_valid_port(port: str) -> bool:
    """Return whether a text is a valid port name."""
    with suppress(UnicodeEncodeError):
        return b"\0" not in os.fsencode(port)
    return False


def find_damaged_prints(job_store: JobStore) -> Iterator[DamagedPrint]:
    """Yield damaged prints that are not running, the oldest first."""
    for folder in sorted(job_store.iterdir()) if job_store.is_dir() else ():
        try:
            found = _read_print(folder)
        except _InvalidHeadError as error:
            yield DamagedPrint(folder, _HEAD_FILE, str(error))
        else:
            if not found:
                continue
            try:
                is_running = found.is_locked
            except OSError as error:
                yield DamagedPrint(folder, _LOCK_FILE, f"the file cannot be locked: {error.strerror}")
                continue
            if not is_running and (damage := find_damage(found)):
                yield damage


def is_same_port(first: str, second: str) -> bool:
    """Return whether two addresses refer to the same port."""
    return first == second or ("://" not in first and os.path.realpath(first) == os.path.realpath(second))


def find_unfinished_print(job_store: JobStore, port: str) -> Print | None:
    """Find a stored print for this port that no process is running; return None if there is none."""
    for one in load_stored_prints(job_store):
        if is_same_port(one.port, port) and not one.is_running:
            return one
    return None


_START_REMEDY: Final = "Start a print with printer-slicer print FILE --port PORT"


def find_print(job_store: JobStore, name: str, *, running: bool) -> Print:
    """Find the stored print with this name; an empty name means the only print.

    Args:
        job_store: the store.
        name: name of the job or of its folder, empty for the only print.
        running: whether to search the running prints; otherwise the unfinished prints.

    Raises:
        UsageError: no print matches, or more than one does.
    """
    known = stored = list(load_stored_prints(job_store))
    if not running:
        damaged = {one.folder: one for one in find_damaged_prints(job_store)}
        for one in known:
            if name and one.folder in damaged and name in {one.name, one.folder.name}:
                raise damaged[one.folder].make_error()
        known = [one for one in known if one.folder not in damaged]
    known = [one for one in known if one.is_running is running]
    named = [one for one in known if name in {"", one.name, one.folder.name}]
    if len(named) == 1:
        return named[0]
    kind = "running" if running else "unfinished"
    problem = f"no {kind} print" if not named else f"there are {len(named)} {kind} prints"
    available = "; ".join(
        f"{one.name} on {one.port}, started {one.begun} ({one.folder.name})" for one in known
    )
    is_listed = any(not one.is_running for one in stored)
    remedy = "Run printer-slicer resume --list to see unfinished prints" if is_listed else _START_REMEDY
    raise UsageError(
        problem + (f" named {name}" if name else ""),
        remedy=f"Available: {available}" if available else remedy,
    )


def _make_port_absolute(port: str) -> str:
    """Make the path of a port absolute, so that the path is valid in any working directory."""
    return port if "://" in port else str(Path(port).absolute())


def _read_boot_id() -> str:
    """Read the id of the current boot of the computer; empty if unknown."""
    with suppress(OSError):
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    return ""
