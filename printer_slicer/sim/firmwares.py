"""The table of simulated firmwares.

behaviour              MARLIN_2_1    MARLIN_2_1_ADVANCED   MARLIN_2_0_AVR
receive buffer      flow control  flow control          128 bytes, overflows silently
after an error      reads on      reads on              discards received bytes
repeated line       last two: no reply                  error and resend
ok                  plain         N, P and B            plain
M108, M112, M410    executed early if unnumbered; always with the emergency parser
sending text        takes no time takes no time         blocks the main loop (10 bits per byte)

`SIMULATED_FIRMWARES` has all firmwares. Their replies follow these sources:
Marlin 1.1's Marlin_main.cpp, Marlin's pull request 27090 (M110 alone), Prusa-Firmware's cmdqueue.cpp,
RepRapFirmware's StringParser.cpp, Repetier-Firmware's gcode.cpp, Smoothieware's GcodeDispatch.cpp; Klipper's were
recorded.
"""

from __future__ import annotations

from typing import Final

from printer_slicer.sim.simulated_firmware import SimulatedFirmware
from printer_slicer.values import replace

__all__ = [
    "KLIPPER",
    "MARLIN_1_1",
    "MARLIN_2_0_AVR",
    "MARLIN_2_0_BUFFERED",
    "MARLIN_2_1",
    "MARLIN_2_1_3",
    "MARLIN_2_1_ADVANCED",
    "OCTOPRINT_VIRTUAL",
    "PRUSA_MK3",
    "REPETIER",
    "REPRAPFIRMWARE",
    "SIMULATED_FIRMWARES",
    "SMOOTHIE",
    "SimulatedFirmware",
]

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


MARLIN_2_1: Final = SimulatedFirmware(name="bugfix-2.1.x (Jan  7 2023 12:00:00)", banner=_MARLIN_2_1_BANNER)
"""Marlin 2.1 of 2023 on a board with native USB."""

MARLIN_2_1_ADVANCED: Final = replace(
    MARLIN_2_1,
    advanced_ok=True,
    emergency_parser=True,
    host_actions=True,
    prompts=True,
    reports_position=True,
    reports_area=True,
    wait_seconds=1.0,
)
"""Marlin 2.1 with the options ADVANCED_OK, EMERGENCY_PARSER, HOST_ACTION_COMMANDS and NO_TIMEOUTS."""

MARLIN_2_0_AVR: Final = SimulatedFirmware(
    name="bugfix-2.0.x (May  1 2021 12:00:00)",
    banner=_MARLIN_2_0_BANNER,
    receive_buffer=127,
    flushes_on_error=True,
    repeats_dropped=0,
    # Measured: an ATmega2560 at 115200 baud replies 0.5 ms later than the transmission alone takes.
    seconds_per_line=0.0005,
    # TX_BUFFER_SIZE 0, the default: sending blocks.
    seconds_per_byte=10 / 115_200,
)
"""Marlin 2.0 of 2021 on an 8-bit board behind a USB to serial chip at 115200 baud."""

MARLIN_2_0_BUFFERED: Final = replace(MARLIN_2_0_AVR, seconds_per_byte=0.0)
"""Marlin 2.0 with a transmit buffer: it keeps reading while it sends an error message."""

MARLIN_1_1: Final = replace(
    MARLIN_2_0_AVR,
    name="1.1.9 (Github)",
    banner=("start", "echo:Marlin 1.1.9", "", "echo: Free Memory: 3619  PlannerBufferBytes: 1264"),
    dialect="marlin_legacy",
)
"""Marlin 1.1 of 2018 on an 8-bit board at 115200 baud; some forks send no ok after a resend request."""

MARLIN_2_1_3: Final = replace(
    MARLIN_2_1,
    name="2.1.3 (Apr 20 2025 12:00:00)",
    banner=("start", "Marlin 2.1.3"),
    reports_line_number=True,
    flushes_on_error=True,
    receive_buffer=127,
    seconds_per_line=0.0002,
    seconds_per_byte=10 / 115_200,
)
"""Marlin 2.1.3 behind a USB to serial chip: it drops repeated lines and reports its line number."""

PRUSA_MK3: Final = replace(
    MARLIN_2_0_AVR,
    name="3.13.3",
    banner=("start", "echo: 3.13.3-7094", "echo: Free Memory: 2121  PlannerBufferBytes: 1760"),
    identity="FIRMWARE_NAME:Prusa-Firmware {name} based on Marlin FIRMWARE_URL:https://github.com/prusa3d/Prusa-Firmware"
    " PROTOCOL_VERSION:1.0 MACHINE_TYPE:Prusa i3 MK3S EXTRUDER_COUNT:1 UUID:00000000-0000-0000-0000-000000000000",
    unnumbered_lines="bare",
    dialect="prusa",
    line_timeout=2.0,
    reports_overflow=True,
)
"""A Prusa MK3: it rejects a checksum without a number, and discards lines that stay incomplete for two seconds."""

REPRAPFIRMWARE: Final = replace(
    MARLIN_2_1,
    name="3.4.6",
    banner=("RepRapFirmware for Duet 2 WiFi/Ethernet version 3.4.6 is up and running.",),
    identity="FIRMWARE_NAME: RepRapFirmware for Duet 2 WiFi/Ethernet FIRMWARE_VERSION: {name}"
    " ELECTRONICS: Duet WiFi 1.02 FIRMWARE_DATE: 2023-07-21",
    lists_capabilities=False,
    any_case=True,
    dialect="reprapfirmware",
    accepted_lines="right",
    busy_seconds=0.0,
    queue_places=1,
    line_size=201,
    decimals=3,
    halt_messages=("Emergency Stop! Reset the controller to continue.",),
)
"""RepRapFirmware 3: accepts lines in any order, with a CRC or XOR checksum; drops bad lines silently."""

KLIPPER: Final = replace(
    MARLIN_2_1,
    name="v0.12.0",
    banner=("// Klipper state: Ready",),
    identity="ok FIRMWARE_NAME:Klipper FIRMWARE_VERSION:{name}",
    lists_capabilities=False,
    accepted_lines="any",
    busy_seconds=0.0,
    # Observed: Klipper acknowledges a dwell of 3 s at once, and does not plan much further ahead.
    ahead_seconds=3.0,
    queue_places=20,
    line_size=4096,
    unknown_reply='// Unknown command:"{text}"',
    decimals=3,
    halt_messages=("// Klipper state: Shutdown",),
    homing_failed_message="!! No trigger on {axis} after full movement",
    heater_fault_messages=("!! Heater {heater}: {what}",),
    language="klipper",
    any_case=True,
    dialect="klipper",
)
"""Klipper at its pseudo-terminal: executes every line, whatever its number and checksum."""

REPETIER: Final = replace(
    MARLIN_2_1,
    name="Repetier_1.0.4",
    banner=("start", "Info:PowerUp", "Free RAM:3402"),
    identity="FIRMWARE_NAME:{name} FIRMWARE_URL:https://github.com/repetier/Repetier-Firmware/ PROTOCOL_VERSION:1.0"
    " MACHINE_TYPE:Mendel EXTRUDER_COUNT:1 REPETIER_PROTOCOL:3",
    lists_capabilities=False,
    unnumbered_lines="never",
    checksum_first=True,
    any_case=True,
    dialect="repetier",
    wrong_number="Error:expected line {wanted} got {got}",
    wrong_checksum="Error:Wrong checksum",
    no_checksum="Error:Missing checksum",
    no_number="Error:Missing linenumber",
    resend="\nResend:{wanted}",
    repeats_dropped=0,
    repeats_skipped=40,
    lines_skipped=14,
    line_timeout=0.2,
    repeats_resend_request=True,
    ok_when_read=True,
    receive_buffer=127,
    flushes_on_error=True,
    queue_places=2,
    wait_seconds=1.0,
    busy_seconds=2.0,
    unknown_reply='Unknown command:"{text}"',
    halt_messages=("fatal:{reason}",),
    seconds_per_line=0.0005,
    seconds_per_byte=10 / 115_200,
)
"""Repetier-Firmware 1.0 on an 8-bit board at 115200 baud: sends ok when a line is read, not when it is executed."""

SMOOTHIE: Final = replace(
    MARLIN_2_1,
    name="edge-2021",
    banner=("Smoothie", "ok"),
    identity="FIRMWARE_NAME:Smoothieware, FIRMWARE_URL:http%3A//smoothieware.org, FIRMWARE_VERSION:{name},"
    " PROTOCOL_VERSION:1.0",
    lists_capabilities=False,
    dialect="smoothie",
    wrong_number="",
    wrong_checksum="",
    no_checksum="",
    resend="rs N{wanted}",
    ok_after_resend=False,
    repeats_dropped=0,
    busy_seconds=0.0,
    queue_places=1,
    line_size=131,
    halt_messages=("!! {reason}",),
)
"""Smoothieware on a board with native USB: requests a resend with `rs` and the number, without error or ok."""

OCTOPRINT_VIRTUAL: Final = replace(
    MARLIN_2_1,
    name="Virtual Marlin 1.0",
    banner=("start", "Marlin: Virtual Marlin!", "\xc2\x80", "SD card ok"),
    identity="FIRMWARE_NAME:{name} PROTOCOL_VERSION:1.0",
    lists_capabilities=False,
    language="virtual",
    checksum_first=True,
    checksum_needed=False,
    wrong_number="Error: expected line {wanted} got {got}",
    wrong_checksum="Error: Missing checksum",
    resend="Resend:{wanted}",
    repeats_dropped=0,
    unknown_reply="",
    halt_messages=("echo:EMERGENCY SHUTDOWN DETECTED. KILLED.",),
    heater_fault_messages=(),
    queue_places=1,
    line_size=256,
    busy_seconds=0.0,
    wait_seconds=1.0,
)
"""The virtual printer of OctoPrint: accepts every command, and reads nothing while it is busy."""

SIMULATED_FIRMWARES: Final[dict[str, SimulatedFirmware]] = {
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
    "octoprint virtual": OCTOPRINT_VIRTUAL,
}
"""All simulated firmwares, by their names for `--firmware`."""
