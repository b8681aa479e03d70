"""The memory card: listed, written, printed, stopped; and what the printer says of it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from sim_console import Console, numbered

from printer_slicer.sim.firmwares import MARLIN_2_1, MARLIN_2_1_ADVANCED
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.sd_card import SdCard

READER = replace(Machine(), card=True, coldest_extrusion=0.0, first_move_delay=0.0)
PART = b"G28\nG90 ; absolute\n; a comment\nG1 X50 F3000\nG1 X100\nM117 done\n"


class CardConsole(Console):
    """A terminal at a printer with a card reader."""

    def __init__(self, files: dict[str, bytes], machine: Machine = READER) -> None:
        super().__init__(machine=machine)
        self.printer = SimulatedPrinter(
            machine, MARLIN_2_1, on_executed=self.executed.append, boots=False, card=files
        )


def test_a_card_is_listed_and_a_file_is_printed_to_its_end() -> None:
    console = CardConsole({"part one.gcode": PART})

    assert console.say("M20") == ["Begin file list", f"PARTONE.GCO {len(PART)}", "End file list", "ok"]
    assert console.say("M23 partone.gco") == [
        "echo:Now fresh file: PARTONE.GCO",
        f"File opened: PARTONE.GCO Size: {len(PART)}",
        "File selected",
        "ok",
    ]
    assert console.say("M27") == ["Not SD printing", "ok"]
    assert console.say("M24") == ["ok"]
    heard = [line for _, line in console.wait(60.0)]

    # Commands of the card get no ok; what they say is heard all the same.
    assert "ok" not in heard
    assert heard[-1] == "Done printing file"
    assert console.executed == [
        "M20",
        "M23 partone.gco",
        "M27",
        "M24",
        "G28",
        "G90",
        "G1 X50 F3000",
        "G1 X100",
        "M117 done",
    ]
    assert console.say("M114")[0].startswith("X:100.00 ")


def test_progress_is_told_by_itself_and_a_pause_holds_the_print() -> None:
    lines = b"".join(b"G1 X%d F600\n" % (n % 100) for n in range(200))
    console = CardConsole({"A.GCO": lines})
    console.say("M27 S2", "M32 A.GCO")
    told = [line for _, line in console.wait(10.0) if "printing byte" in line]
    read = [int(line.split()[3].split("/")[0]) for line in told]

    assert len(told) == 5
    assert read == sorted(read)
    assert read[-1] < len(lines)
    # Behind the lines of the card that are in the queue already.
    assert console.do("M25")[-1] == "ok"
    assert console.do("M27")[-2:] == ["Not SD printing", "ok"]
    executed = len(console.executed)
    console.wait(60.0)
    assert len(console.executed) == executed
    console.say("M24")
    console.wait(2000.0)
    assert sum(text.startswith("G1") for text in console.executed) == 200


def test_a_file_is_written_line_by_line_and_nothing_of_it_is_executed() -> None:
    console = CardConsole({})

    assert console.say("M28 new.gco") == ["Writing to file: NEW.GCO", "ok"]
    assert console.say(numbered(1, "G1 X10"), numbered(2, "G1 X20")) == ["ok", "ok"]
    assert console.say(numbered(3, "M29")) == ["Done saving file.", "ok"]
    assert console.say("M20")[1] == "NEW.GCO 14"
    assert console.executed == ["M28 new.gco", "M20"]
    console.say("M32 NEW.GCO")
    console.wait(10.0)
    assert console.executed[-2:] == ["G1 X10", "G1 X20"]


def test_m524_gives_the_print_up_and_turns_the_heaters_off() -> None:
    console = CardConsole({"A.GCO": b"M104 S200\n" + b"G1 X100 F60\nG1 X0\n" * 50})
    console.say("M32 A.GCO")
    console.wait(20.0)
    console.do("M524")

    assert "/0.00 B" in console.do("M105")[-1]
    assert console.do("M27") == ["Not SD printing", "ok"]
    executed = len(console.executed)
    console.wait(500.0)
    assert len(console.executed) == executed


def test_what_is_not_there_cannot_be_selected_or_deleted() -> None:
    console = CardConsole({"A.GCO": b"G90\n"})

    assert console.say("M23 B.GCO") == ["open failed, File: B.GCO.", "ok"]
    assert console.say("M30 B.GCO") == ["Deletion failed, File: B.GCO.", "ok"]
    assert console.say("M30 A.GCO") == ["File deleted:A.GCO", "ok"]
    assert console.say("M24") == ["ok"]
    assert console.say("M20") == ["Begin file list", "End file list", "ok"]


def test_a_card_that_was_released_shows_nothing() -> None:
    console = CardConsole({"A.GCO": b"G90\n"})

    assert console.say("M22") == ["echo:SD card released", "ok"]
    assert console.say("M20") == ["Begin file list", "End file list", "ok"]
    assert console.say("M23 A.GCO")[0] == "open failed, File: A.GCO."
    assert console.say("M21") == ["echo:SD card ok", "ok"]
    assert console.say("M20")[1] == "A.GCO 4"


def test_a_file_that_begins_itself_anew_takes_time_like_any_other() -> None:
    console = CardConsole({"A.GCO": b"M32 A.GCO\n"})
    console.say("M32 A.GCO")
    console.wait(0.1)

    assert 100 < len(console.executed) < 1000


def test_a_printer_that_is_reset_does_not_go_on_printing() -> None:
    console = CardConsole({"A.GCO": b"G1 X10 F60\nG1 X0\n" * 50})
    console.say("M32 A.GCO")
    console.wait(5.0)
    console.printer.reset(console.now)
    executed = len(console.executed)
    console.wait(100.0)

    assert len(console.executed) == executed
    assert console.say("M20")[1].startswith("A.GCO ")


@pytest.mark.parametrize("card", [True, False])
def test_m115_says_whether_there_is_a_reader(card: bool) -> None:
    console = Console(MARLIN_2_1_ADVANCED, replace(Machine(), card=card))

    assert f"Cap:SDCARD:{int(card)}" in console.say("M115")


def test_a_full_card_says_so() -> None:
    card = SdCard()
    card.begin_file("A.GCO")
    card._free_bytes = 10

    assert card.write_line("G90")
    assert not card.write_line("G1 X10 Y10")
    card.end_file()
    assert card.files == {"A.GCO": b"G90\n"}
