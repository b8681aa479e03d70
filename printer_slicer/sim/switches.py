"""The switches of a firmware's serial port, and what it says that it can do; the firmwares stand in `front_end`."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    from printer_slicer.sim.machine import Machine

__all__ = ["MARLIN_IDENTITY", "FrontEnd"]

MARLIN_IDENTITY: Final = (
    "FIRMWARE_NAME:Marlin {name} SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin PROTOCOL_VERSION:1.0"
    " MACHINE_TYPE:Simulated EXTRUDER_COUNT:{tools} UUID:cede2a2f-41a2-4748-9b12-c55c62f367ff"
)
"""The number is Marlin's default, the same for every board whose owner did not make one."""


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
        checksum_first: looks at the checksum before the number.
        checksum_needed: refuses a line with a number and no checksum.
        resend: how a line is asked for.
        lines_skipped: so many lines with a wrong number behind a refused one get an ok and no error.
        repeats_skipped: how many of the last line numbers, when repeated, get "skip" and an ok.
        partial_seconds: a line that is not complete so long after its last byte is thrown away.
        partial_asks: and asked for again; so is a line that was asked for and has not come.
        counts: M110 alone says the last line number.
        ok_when_read: a line is answered when it is queued, not when it was executed, and what it says comes later.
        unknown: what is said of an unknown command, with `{text}`; empty: nothing.
        decimals: of positions, in mm.
        killed: what it says when it halts, with `{reason}`.
        overheated: what it says before that when a heater is out of control, with `{what}` and `{heater}`.
        homing_failed: what it says when an endstop never closes, with `{axis}`: it goes on, with motors off; empty: it
            halts.
        tells_overflow: says that its receive buffer was full, and throws away the line that it cut.
        language: whose words temperatures, positions and errors are said in, and whose commands are known.
        receive_buffer: bytes the receive ring can hold unread (one less than its size); what comes when it is
            full is lost. None = flow control: nothing is lost, the sender has to wait.
        flushes_on_error: a refused line takes everything with it that has arrived behind it.
        repeats_dropped: how many of the last line numbers, when repeated, are dropped without any answer.
        ok_after_resend: whether `Resend: n` is followed by an ok of its own.
        advanced_ok: ok says the line number, the free planner places and the free queue places.
        emergency_parser: M108, M112 and M410 act when their bytes arrive, whatever is waiting in front of
            them.
        host_actions: says `//action:` and what it did or wants: paused, resumed, poweroff.
        prompts: asks a person through the host, `//action:prompt_begin` and so on, and takes M876 for the answer; says
            what stands on its display as `//action:notification`.
        reports_position: knows M154.
        reports_area: M115 ends with the size of the machine.
        flavour: whose meanings commands have that differ from firmware to firmware.
        babysteps: M290 is known.
        any_case: whether lower-case commands are accepted (Klipper, RepRapFirmware, Repetier; Marlin with
            GCODE_CASE_INSENSITIVE).
        ignores_extended: words such as SET_PRESSURE_ADVANCE are answered with a plain ok, not as unknown.
        wait_seconds: an idle printer says `wait` so often; 0 = never.
        busy_seconds: a printer that works on a command says so so often; 0 = never. M113 changes it.
        ahead_seconds: motion planned ahead, s; a move beyond is acknowledged when the plan has become shorter.
        queue_places: commands read ahead, the one being executed included.
        line_size: bytes of the line buffer; one less is kept of a longer line, the rest is cut off.
        boot_seconds: after a reset it hears nothing for so long.
        seconds_per_line: time of the main loop for one command.
        seconds_per_byte: time that each byte said holds up the main loop.
    """

    name: str
    banner: tuple[str, ...]
    identity: str = MARLIN_IDENTITY
    lists_capabilities: bool = True
    takes: Literal["next", "right", "any"] = "next"
    strays: Literal["executed", "bare", "never"] = "executed"
    wrong_number: str = "Error:Line Number is not Last Line Number+1, Last Line: {last}"
    wrong_checksum: str = "Error:checksum mismatch, Last Line: {last}"
    no_checksum: str = "Error:No Checksum with line number, Last Line: {last}"
    no_number: str = "Error:No Line Number with checksum, Last Line: {last}"
    checksum_first: bool = False
    checksum_needed: bool = True
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
    overheated: tuple[str, ...] = ("Error:{what}, system stopped! Heater_ID: {heater}", "")
    homing_failed: str = ""
    tells_overflow: bool = False
    language: Literal["marlin", "klipper", "virtual"] = "marlin"
    receive_buffer: int | None = None
    flushes_on_error: bool = False
    repeats_dropped: int = 2
    ok_after_resend: bool = True
    advanced_ok: bool = False
    emergency_parser: bool = False
    host_actions: bool = False
    prompts: bool = False
    reports_position: bool = False
    reports_area: bool = False
    flavour: str = "marlin"
    ignores_extended: bool = False
    any_case: bool = False
    babysteps: bool = True
    wait_seconds: float = 0.0
    busy_seconds: float = 2.0
    ahead_seconds: float = inf
    queue_places: int = 4
    line_size: int = 96
    boot_seconds: float = 0.0
    seconds_per_line: float = 0.0
    seconds_per_byte: float = 0.0

    def capabilities(self, machine: Machine) -> tuple[tuple[str, bool], ...]:
        """What M115 says after `Cap:`, in the order it says it."""
        known = {
            "AUTOLEVEL": machine.probe_points > 0,
            "AUTOREPORT_POS": self.reports_position,
            "BABYSTEPPING": self.babysteps,
            "EMERGENCY_PARSER": self.emergency_parser,
            "HOST_ACTION_COMMANDS": self.host_actions,
            "PROMPT_SUPPORT": self.prompts,
            "RUNOUT": machine.runout_sensor,
            "Z_PROBE": machine.probe_points > 0,
        }
        known |= dict.fromkeys(("AUTOREPORT_SD_STATUS", "LONG_FILENAME", "SDCARD", "SD_WRITE"), machine.card)
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

_PRESENT: Final = frozenset({"ARCS", "AUTOREPORT_TEMP", "BUILD_PERCENT", "PRINT_JOB", "THERMAL_PROTECTION"})
"""What the simulated firmware can always do."""
