"""Adding a printer to printers.toml: its firmware is asked for its name, and compared with the profile."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from threading import Event, Thread

import pytest

from printer_slicer import load_profile
from printer_slicer.errors import UsageError
from printer_slicer.firmware import match_flavour
from printer_slicer.inspection.dry_run.machines import machine_of
from printer_slicer.print_queue.printer_setup import add_printer
from printer_slicer.print_queue.printers import PrinterEntry, read_printers
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.pty_server import serve
from tests.cli.command_line import typed


@pytest.fixture
def port(tmp_path: Path) -> Iterator[str]:
    """A simulated printer with Marlin 2."""
    stop, ready = Event(), Event()
    machine = machine_of(load_profile("marlin_220", "pla").printer)

    def simulate() -> None:
        serve(
            lambda: SimulatedPrinter(machine),
            tmp_path / "port",
            stop=stop.is_set,
            ready=lambda _: ready.set(),
        )

    thread = Thread(target=simulate)
    thread.start()
    ready.wait()
    yield str(tmp_path / "port")
    stop.set()
    thread.join()


def test_a_printer_is_added_whose_firmware_fits(port: str, tmp_path: Path) -> None:
    file = tmp_path / "new" / "printers.toml"
    said = typed(
        "queue", "add-printer", "left", port, "marlin_220", "--json", "--printers-file", file, cwd=tmp_path
    )
    assert said.code == 0, said.err
    assert json.loads(said.out)["firmware"].startswith("Marlin")
    add_printer(file, PrinterEntry(name="test", port="sim:", profile="voron_0_2", material="petg"))
    assert [(one.name, one.port, one.material) for one in read_printers(file)] == [
        ("left", port, "pla"),
        ("test", "sim:", "petg"),
    ]


def test_a_printer_whose_firmware_does_not_fit_needs_the_word_of_a_person(port: str, tmp_path: Path) -> None:
    file = tmp_path / "printers.toml"
    file.write_text("# mine\n[old]\nport = 'sim:'\nprofile = 'marlin_220'", encoding="utf-8")
    before = file.read_text("utf-8")
    entry = PrinterEntry(name="left", port=port, profile="voron_0_2")
    with pytest.raises(UsageError, match=r"the firmware is Marlin .* the profile voron_0_2 is for klipper"):
        add_printer(file, entry)
    assert file.read_text("utf-8") == before
    add_printer(file, entry, check=False)
    assert file.read_text("utf-8").startswith(before)
    assert len(read_printers(file)) == 2


@pytest.mark.parametrize(
    ("entry", "what"),
    [
        (PrinterEntry(name="old", port="sim:", profile="marlin_220"), "already a printer old"),
        (PrinterEntry(name="new", port="/dev/old", profile="marlin_220"), "have the same port"),
        (PrinterEntry(name="a]b", port="sim:", profile="marlin_220"), "is not a valid name of a printer"),
        (PrinterEntry(name="new", port="sim:", profile="nonesuch"), "nonesuch"),
        (PrinterEntry(name="new", port="moonraker:", profile="voron_0_2"), "not the address"),
    ],
)
def test_an_impossible_printer_changes_nothing(entry: PrinterEntry, what: str, tmp_path: Path) -> None:
    file = tmp_path / "printers.toml"
    file.write_text("[old]\nport = '/dev/old'\nprofile = 'marlin_220'\n", encoding="utf-8")
    with pytest.raises(UsageError, match=what):
        add_printer(file, entry)
    assert len(read_printers(file)) == 1


@pytest.mark.parametrize(
    ("name", "flavour"),
    [
        ("Marlin 2.1.2", "marlin"),
        ("Marlin 1.1.9", "marlin_legacy"),
        ("Prusa-Firmware 3.14", "prusa"),
        ("Prusa-Firmware-Buddy 6.1", "prusa"),
        ("Klipper", "klipper"),
        ("something else", "marlin"),
    ],
)
def test_the_name_of_a_firmware_tells_its_flavour(name: str, flavour: str) -> None:
    assert match_flavour(name) == flavour
