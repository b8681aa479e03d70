"""Options for the behaviour of simulated firmwares; the module `firmwares` has the table of firmwares."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Final, Literal

from printer_slicer.values import Struct

if TYPE_CHECKING:
    from printer_slicer.sim.machine import Machine

__all__ = ["MARLIN_IDENTITY", "SimulatedFirmware"]

MARLIN_IDENTITY: Final = (
    "FIRMWARE_NAME:Marlin {name} SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin PROTOCOL_VERSION:1.0"
    " MACHINE_TYPE:Simulated EXTRUDER_COUNT:{tools} UUID:cede2a2f-41a2-4748-9b12-c55c62f367ff"
)
"""Reply of Marlin to M115, with Marlin's default UUID."""


class SimulatedFirmware(Struct, frozen=True):
    """Behaviour of a firmware at its serial port and in its command queue.

    Attributes:
        name: version reported by M115.
        banner: lines sent after a reset.
        identity: reply to M115, with `{name}` for the version.
        lists_capabilities: whether M115 lists capabilities.
        accepted_lines: which lines are accepted. "next": lines with numbers in order and a right XOR checksum.
            "right": lines with any number and a right XOR or CRC checksum or none; other lines are dropped silently.
            "any": all lines; numbers and checksums are ignored.
        unnumbered_lines: which lines without a number are accepted. "executed": all; "bare": those without a
            checksum; "never": none after a numbered line.
        wrong_number, wrong_checksum, no_checksum, no_number: error messages for rejected lines, with `{last}` for the
            last line number, `{wanted}` for the next and `{got}` for the received one; empty: none.
        checksum_first: whether the checksum is checked before the number.
        checksum_needed: whether a numbered line needs a checksum.
        resend: resend request, with `{wanted}`.
        lines_skipped: number of lines with a wrong number after a rejected one that get an ok and no error.
        repeats_skipped: number of recent line numbers that get "skip" and an ok when repeated.
        line_timeout: time after the last byte at which an incomplete line is discarded, s.
        repeats_resend_request: whether a line is requested again if it was discarded or did not come.
        reports_line_number: whether M110 without N reports the last line number.
        ok_when_read: whether a line is acknowledged when it is queued, not when it is executed.
        unknown_reply: reply to an unknown command, with `{text}`; empty: none.
        decimals: number of decimals of reported positions.
        halt_messages: lines sent when the firmware halts, with `{reason}`.
        heater_fault_messages: lines sent before these if a heater is out of control, with `{what}` for the error
            and `{heater}`.
        homing_failed_message: message if an endstop never triggers, with `{axis}`; the motors are switched off then.
            Empty: the firmware halts.
        reports_overflow: whether it reports an overflow of the receive buffer and discards the damaged line.
        language: firmware whose commands are known, and whose formats are used for temperatures, positions, errors.
        receive_buffer: size of the receive buffer, bytes; further bytes are lost. None: flow control, so the sender
            has to wait.
        flushes_on_error: whether all bytes received behind a rejected line are discarded.
        repeats_dropped: number of recent line numbers that are dropped silently when repeated.
        ok_after_resend: whether `Resend: n` is followed by an ok.
        advanced_ok: whether ok reports line number, free planner places and free queue places.
        emergency_parser: whether M108, M112 and M410 are executed as soon as they arrive.
        host_actions: whether it sends `//action:` commands: paused, resumed, poweroff.
        prompts: whether it asks a person through the host (`//action:prompt_begin`), accepts M876 as the answer, and
            sends display messages as `//action:notification`.
        reports_position: whether M154 is known.
        reports_area: whether M115 ends with the size of the machine.
        dialect: name of the G-code dialect, for commands that differ between firmwares.
        babysteps: whether M290 is known.
        any_case: whether lower-case commands are accepted (Klipper, RepRapFirmware, Repetier; Marlin with
            GCODE_CASE_INSENSITIVE).
        ignores_extended: whether commands such as SET_PRESSURE_ADVANCE get an ok instead of an error.
        wait_seconds: interval of the `wait` messages of an idle printer, s; 0: never.
        busy_seconds: interval of busy reports, s, which M113 changes; 0: never.
        ahead_seconds: maximum motion planned ahead, s; further moves are acknowledged later.
        queue_places: number of places in the command queue, including the current command.
        line_size: size of the line buffer, bytes; longer lines are cut to one byte less.
        boot_seconds: time after a reset in which received bytes are lost, s.
        seconds_per_line: time that the main loop needs for one command, s.
        seconds_per_byte: time for which sending a byte blocks the main loop, s.
    """

    name: str
    banner: tuple[str, ...]
    identity: str = MARLIN_IDENTITY
    lists_capabilities: bool = True
    accepted_lines: Literal["next", "right", "any"] = "next"
    unnumbered_lines: Literal["executed", "bare", "never"] = "executed"
    wrong_number: str = "Error:Line Number is not Last Line Number+1, Last Line: {last}"
    wrong_checksum: str = "Error:checksum mismatch, Last Line: {last}"
    no_checksum: str = "Error:No Checksum with line number, Last Line: {last}"
    no_number: str = "Error:No Line Number with checksum, Last Line: {last}"
    checksum_first: bool = False
    checksum_needed: bool = True
    resend: str = "Resend: {wanted}"
    lines_skipped: int = 0
    repeats_skipped: int = 0
    line_timeout: float = inf
    repeats_resend_request: bool = False
    reports_line_number: bool = False
    ok_when_read: bool = False
    unknown_reply: str = 'echo:Unknown command: "{text}"'
    decimals: int = 2
    halt_messages: tuple[str, ...] = ("echo:{reason}", "Error:Printer halted. kill() called!")
    heater_fault_messages: tuple[str, ...] = ("Error:{what}, system stopped! Heater_ID: {heater}", "")
    homing_failed_message: str = ""
    reports_overflow: bool = False
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
    dialect: str = "marlin"
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

    def list_capabilities(self, machine: Machine) -> tuple[tuple[str, bool], ...]:
        """Return the capabilities that M115 lists for a machine: name, and whether it is present."""
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
"""Capabilities that are always present."""
