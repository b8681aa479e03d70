"""How a firmware reads its serial port: one table of switches, and the firmwares that are rows of it.

switch              MARLIN_2_1    MARLIN_2_1_ADVANCED   MARLIN_2_0_AVR
receive buffer      flow control  flow control          128 bytes, overflows in silence
after an error      reads on      reads on              throws away what has arrived
repeated line       last two: no answer at all          error and resend
ok                  plain         N, P and B            plain
M108, M112, M410    read early when un-numbered; with the emergency parser always
text going out      costs no time costs no time         holds up the main loop (10 bits per byte)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

__all__ = ["MARLIN_2_0_AVR", "MARLIN_2_1", "MARLIN_2_1_ADVANCED", "FrontEnd"]

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
        name: as M115 says it after "Marlin".
        banner: lines said after a reset.
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
        seconds_per_line: time of the main loop for one command.
        seconds_per_byte: time that each byte said holds up the main loop.
    """

    name: str
    banner: tuple[str, ...]
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
