"""How a firmware reads its serial port: one table of switches, and the firmwares that are rows of it.

switch              MARLIN_2_1    MARLIN_2_1_ADVANCED   MARLIN_2_0_AVR
receive buffer      flow control  flow control          128 bytes, overflows in silence
after an error      reads on      reads on              throws away what has arrived
repeated line       last two: no answer at all          error and resend
ok                  plain         N, P and B            plain
M108, M112, M410    read early when un-numbered; with the emergency parser always
text going out      costs no time costs no time         holds up the main loop (10 bits per byte)

The other firmwares differ from these in what `FRONT_ENDS` says of them. Their conversations follow their sources:
Marlin 1.1's Marlin_main.cpp, Marlin's pull request 27090 (M110 alone), Prusa-Firmware's cmdqueue.cpp,
RepRapFirmware's StringParser.cpp, Repetier-Firmware's gcode.cpp, Smoothieware's GcodeDispatch.cpp; Klipper's were
recorded.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Final, Literal

__all__ = [
    "FRONT_ENDS",
    "KLIPPER",
    "MARLIN_1_1",
    "MARLIN_2_0_AVR",
    "MARLIN_2_0_BUFFERED",
    "MARLIN_2_1",
    "MARLIN_2_1_3",
    "MARLIN_2_1_ADVANCED",
    "PRUSA_MK3",
    "REPETIER",
    "REPRAPFIRMWARE",
    "SMOOTHIE",
    "FrontEnd",
]

_MARLIN: Final = (
    "FIRMWARE_NAME:Marlin {name} SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin PROTOCOL_VERSION:1.0"
    " MACHINE_TYPE:Simulated EXTRUDER_COUNT:1 UUID:cede2a2f-41a2-4748-9b12-c55c62f367ff"
)
"""The number is Marlin's default, the same for every board whose owner did not make one."""

_MARLIN_2_1_BANNER: Final = (
    "start",
    "PowerUp",
    "Marlin bugfix-2.1.x",
    "echo: Last Updated: 2023-01-07 | Author: (none, default config)",
    "echo: Compiled: Jan  7 2023",
    "echo: Free Memory: 0  PlannerBufferBytes: 1280",
    "echo:No EEPROM.",
    "echo:Hardcoded Default Settings Loaded",
)

_MARLIN_2_0_BANNER: Final = (
    "start",
    "PowerUp",
    "Marlin bugfix-2.0.x",
    "",
    "echo: Last Updated: 2021-05-01 | Author: (none, default config)",
    "echo:Compiled: May  1 2021",
    "echo: Free Memory: 3619  PlannerBufferBytes: 1264",
    "echo:EEPROM version mismatch (EEPROM=? Marlin=V83)",
    "echo:Hardcoded Default Settings Loaded",
)


@dataclass(frozen=True, slots=True)
class FrontEnd:
    """The switches of a firmware's serial port and command queue.

    Attributes:
        name: version, as M115 says it.
        banner: lines said after a reset.
        identity: what M115 says, with `{name}` for the version.
        lists_capabilities: M115 says what the firmware can do.
        takes: which lines. "next": numbers in order, with a right exclusive or. "right": any number, with a right
            exclusive or or CRC if there is one; others are dropped without a word. "any": numbers and checksums are
            not looked at.
        strays: what happens to a line without number. "executed"; "bare": only without a checksum; "never": not behind
            a line with a number.
        wrong_number, wrong_checksum, no_checksum, no_number: what is said of a refused line, with `{last}` for the last
            line number, `{wanted}` for the next and `{got}` for the one that came; empty: nothing.
        resend: how a line is asked for.
        lines_skipped: so many lines with a wrong number behind a refused one get an ok and no error.
        repeats_skipped: how many of the last line numbers, when repeated, get "skip" and an ok.
        partial_seconds: a line that is not complete so long after its last byte is thrown away.
        partial_asks: and asked for again; so is a line that was asked for and has not come.
        counts: M110 alone says the last line number.
        ok_when_read: a line is answered when it is queued, not when it was executed, and what it says comes later.
        unknown: what is said of an unknown command, with `{text}`.
        decimals: of positions, in mm.
        killed: what it says when it halts, with `{reason}`.
        tells_overflow: says that its receive buffer was full, and throws away the line that it cut.
        klipper_words: temperatures and positions are said as Klipper does.
        receive_buffer: bytes the receive ring can hold unread (one less than its size); what comes when it is
            full is lost. None = flow control: nothing is lost, the sender has to wait.
        flushes_on_error: a refused line takes everything with it that has arrived behind it.
        repeats_dropped: how many of the last line numbers, when repeated, are dropped without any answer.
        ok_after_resend: whether `Resend: n` is followed by an ok of its own.
        advanced_ok: ok says the line number, the free planner places and the free queue places.
        emergency_parser: M108, M112 and M410 act when their bytes arrive, whatever is waiting in front of
            them.
        host_actions: says `//action:poweroff` when it halts.
        reports_area: M115 ends with the size of the machine.
        flavour: whose meanings commands have that differ from firmware to firmware.
        ignores_extended: words such as SET_PRESSURE_ADVANCE are answered with a plain ok, not as unknown.
        wait_seconds: an idle printer says `wait` so often; 0 = never.
        busy_seconds: a printer that works on a command says so so often; 0 = never. M113 changes it.
        queue_places: commands read ahead, the one being executed included.
        line_size: bytes of the line buffer; one less is kept of a longer line, the rest is cut off.
        boot_seconds: after a reset it hears nothing for so long.
        seconds_per_line: time of the main loop for one command.
        seconds_per_byte: time that each byte said holds up the main loop.
    """

    name: str
    banner: tuple[str, ...]
    identity: str = _MARLIN
    lists_capabilities: bool = True
    takes: Literal["next", "right", "any"] = "next"
    strays: Literal["executed", "bare", "never"] = "executed"
    wrong_number: str = "Error:Line Number is not Last Line Number+1, Last Line: {last}"
    wrong_checksum: str = "Error:checksum mismatch, Last Line: {last}"
    no_checksum: str = "Error:No Checksum with line number, Last Line: {last}"
    no_number: str = "Error:No Line Number with checksum, Last Line: {last}"
    resend: str = "Resend: {wanted}"
    lines_skipped: int = 0
    repeats_skipped: int = 0
    partial_seconds: float = inf
    partial_asks: bool = False
    counts: bool = False
    ok_when_read: bool = False
    unknown: str = 'echo:Unknown command: "{text}"'
    decimals: int = 2
    killed: tuple[str, ...] = ("echo:{reason}", "Error:Printer halted. kill() called!")
    tells_overflow: bool = False
    klipper_words: bool = False
    receive_buffer: int | None = None
    flushes_on_error: bool = False
    repeats_dropped: int = 2
    ok_after_resend: bool = True
    advanced_ok: bool = False
    emergency_parser: bool = False
    host_actions: bool = False
    reports_area: bool = False
    flavour: str = "marlin"
    ignores_extended: bool = False
    wait_seconds: float = 0.0
    busy_seconds: float = 2.0
    queue_places: int = 4
    line_size: int = 96
    boot_seconds: float = 0.0
    seconds_per_line: float = 0.0
    seconds_per_byte: float = 0.0

    @property
    def capabilities(self) -> tuple[tuple[str, bool], ...]:
        """What M115 says after `Cap:`, in the order it says it."""
        known = {
            "EMERGENCY_PARSER": self.emergency_parser,
            "HOST_ACTION_COMMANDS": self.host_actions,
        }
        return tuple((name, known.get(name, name in _PRESENT)) for name in _CAPABILITIES)


_CAPABILITIES: Final = (
    *("SERIAL_XON_XOFF", "BINARY_FILE_TRANSFER", "EEPROM", "VOLUMETRIC", "AUTOREPORT_POS", "AUTOREPORT_TEMP"),
    *("PROGRESS", "PRINT_JOB", "AUTOLEVEL", "RUNOUT", "Z_PROBE", "LEVELING_DATA", "BUILD_PERCENT"),
    *("SOFTWARE_POWER", "TOGGLE_LIGHTS", "CASE_LIGHT_BRIGHTNESS", "EMERGENCY_PARSER", "HOST_ACTION_COMMANDS"),
    *(
        "PROMPT_SUPPORT",
        "SDCARD",
        "MULTI_VOLUME",
        "REPEAT",
        "SD_WRITE",
        "AUTOREPORT_SD_STATUS",
        "LONG_FILENAME",
    ),
    *("LFN_WRITE", "CUSTOM_FIRMWARE_UPLOAD", "EXTENDED_M20", "THERMAL_PROTECTION", "MOTION_MODES", "ARCS"),
    *("BABYSTEPPING", "CHAMBER_TEMPERATURE", "COOLER_TEMPERATURE", "MEATPACK", "CONFIG_EXPORT"),
)

_PRESENT: Final = frozenset({"AUTOREPORT_TEMP", "PRINT_JOB", "BUILD_PERCENT", "THERMAL_PROTECTION", "ARCS"})
"""What the simulated firmware can do; thermal protection because its heaters cannot run away."""

MARLIN_2_1: Final = FrontEnd(name="bugfix-2.1.x (Jan  7 2023 12:00:00)", banner=_MARLIN_2_1_BANNER)
"""Marlin 2.1 of 2023 behind native USB."""

MARLIN_2_1_ADVANCED: Final = replace(
    MARLIN_2_1,
    advanced_ok=True,
    emergency_parser=True,
    host_actions=True,
    reports_area=True,
    wait_seconds=1.0,
)
"""The same with the options ADVANCED_OK, EMERGENCY_PARSER, HOST_ACTION_COMMANDS and NO_TIMEOUTS."""

MARLIN_2_0_AVR: Final = FrontEnd(
    name="bugfix-2.0.x (May  1 2021 12:00:00)",
    banner=_MARLIN_2_0_BANNER,
    receive_buffer=127,
    flushes_on_error=True,
    repeats_dropped=0,
    # An ATmega2560 at 115200 Bd was seen to answer a line 0.5 ms later than the wire explains.
    seconds_per_line=0.0005,
    # TX_BUFFER_SIZE 0, the default: printing waits for the wire.
    seconds_per_byte=10 / 115_200,
)
"""Marlin 2.0 of 2021 on an 8-bit board behind a USB to serial chip at 115200 Bd."""

MARLIN_2_0_BUFFERED: Final = replace(MARLIN_2_0_AVR, seconds_per_byte=0.0)
"""The same with a transmit buffer: it goes on reading while its error is still being said."""

MARLIN_1_1: Final = replace(
    MARLIN_2_0_AVR,
    name="1.1.9 (Github)",
    banner=("start", "echo:Marlin 1.1.9", "", "echo: Free Memory: 3619  PlannerBufferBytes: 1264"),
)
"""Marlin 1.1 of 2018 on an 8-bit board at 115200 Bd; no ok after a request is a fork's, see `ok_after_resend`."""

MARLIN_2_1_3: Final = replace(
    MARLIN_2_1,
    name="2.1.3 (Apr 20 2025 12:00:00)",
    banner=("start", "Marlin 2.1.3"),
    counts=True,
    flushes_on_error=True,
    receive_buffer=127,
    seconds_per_line=0.0002,
    seconds_per_byte=10 / 115_200,
)
"""Marlin 2.1.3 behind a USB to serial chip: it passes over repeats and says its line number when asked."""

PRUSA_MK3: Final = replace(
    MARLIN_2_0_AVR,
    name="3.13.3",
    banner=("start", "echo: 3.13.3-7094", "echo: Free Memory: 2121  PlannerBufferBytes: 1760"),
    identity="FIRMWARE_NAME:Prusa-Firmware {name} based on Marlin FIRMWARE_URL:https://github.com/prusa3d/Prusa-Firmware"
    " PROTOCOL_VERSION:1.0 MACHINE_TYPE:Prusa i3 MK3S EXTRUDER_COUNT:1 UUID:00000000-0000-0000-0000-000000000000",
    strays="bare",
    partial_seconds=2.0,
    tells_overflow=True,
)
"""A Prusa MK3: refuses a checksum without a number, gives a line two seconds to become complete."""

REPRAPFIRMWARE: Final = replace(
    MARLIN_2_1,
    name="3.4.6",
    banner=("RepRapFirmware for Duet 2 WiFi/Ethernet version 3.4.6 is up and running.",),
    identity="FIRMWARE_NAME: RepRapFirmware for Duet 2 WiFi/Ethernet FIRMWARE_VERSION: {name}"
    " ELECTRONICS: Duet WiFi 1.02 FIRMWARE_DATE: 2023-07-21",
    lists_capabilities=False,
    takes="right",
    busy_seconds=0.0,
    queue_places=1,
    line_size=201,
    decimals=3,
    killed=("Emergency Stop! Reset the controller to continue.",),
)
"""RepRapFirmware 3: no sequence, CRC or exclusive or, a bad line leaves no trace."""

KLIPPER: Final = replace(
    MARLIN_2_1,
    name="v0.12.0",
    banner=("// Klipper state: Ready",),
    identity="ok FIRMWARE_NAME:Klipper FIRMWARE_VERSION:{name}",
    lists_capabilities=False,
    takes="any",
    busy_seconds=0.0,
    queue_places=20,
    line_size=4096,
    unknown='// Unknown command:"{text}"',
    decimals=3,
    killed=("// Klipper state: Shutdown",),
    klipper_words=True,
)
"""Klipper's pseudo-terminal: every line counts, whatever its number and checksum."""

REPETIER: Final = replace(
    MARLIN_2_1,
    name="Repetier_1.0.4",
    banner=("start", "Info:PowerUp", "Free RAM:3402"),
    identity="FIRMWARE_NAME:{name} FIRMWARE_URL:https://github.com/repetier/Repetier-Firmware/ PROTOCOL_VERSION:1.0"
    " MACHINE_TYPE:Mendel EXTRUDER_COUNT:1 REPETIER_PROTOCOL:3",
    lists_capabilities=False,
    strays="never",
    wrong_number="Error:expected line {wanted} got {got}",
    wrong_checksum="Error:Wrong checksum",
    no_checksum="Error:Missing checksum",
    no_number="Error:Missing linenumber",
    resend="\nResend:{wanted}",
    repeats_dropped=0,
    repeats_skipped=40,
    lines_skipped=14,
    partial_seconds=0.2,
    partial_asks=True,
    ok_when_read=True,
    receive_buffer=127,
    flushes_on_error=True,
    queue_places=2,
    wait_seconds=1.0,
    busy_seconds=2.0,
    unknown='Unknown command:"{text}"',
    killed=("fatal:{reason}",),
    seconds_per_line=0.0005,
    seconds_per_byte=10 / 115_200,
)
"""Repetier-Firmware 1.0 on an 8-bit board at 115200 Bd: an ok means read, and it asks again five times a second."""

SMOOTHIE: Final = replace(
    MARLIN_2_1,
    name="edge-2021",
    banner=("Smoothie", "ok"),
    identity="FIRMWARE_NAME:Smoothieware, FIRMWARE_URL:http%3A//smoothieware.org, FIRMWARE_VERSION:{name},"
    " PROTOCOL_VERSION:1.0",
    lists_capabilities=False,
    wrong_number="",
    wrong_checksum="",
    no_checksum="",
    resend="rs N{wanted}",
    ok_after_resend=False,
    repeats_dropped=0,
    busy_seconds=0.0,
    queue_places=1,
    line_size=131,
    killed=("!! {reason}",),
)
"""Smoothieware behind native USB: `rs` and the number, no error and no ok."""

FRONT_ENDS: Final[dict[str, FrontEnd]] = {
    "marlin 1.1": MARLIN_1_1,
    "marlin 2.0": MARLIN_2_0_AVR,
    "marlin 2.1": MARLIN_2_1,
    "marlin 2.1 advanced": MARLIN_2_1_ADVANCED,
    "marlin 2.1.3": MARLIN_2_1_3,
    "prusa mk3": PRUSA_MK3,
    "reprapfirmware": REPRAPFIRMWARE,
    "klipper": KLIPPER,
    "repetier": REPETIER,
    "smoothie": SMOOTHIE,
}
"""All of them, by the names that people use."""
