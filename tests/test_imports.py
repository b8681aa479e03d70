"""What gets imported when: help and the wire must not pay for numpy, names arrive when they are used."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import printer_slicer
from printer_slicer.cli.parser import COMMANDS
from printer_slicer.infill import PATTERNS
from printer_slicer.planning import PLANNERS
from printer_slicer.printing.commands import Abort
from printer_slicer.printing.control_socket import serve_control_socket
from printer_slicer.printing.controls import Controls
from printer_slicer.printing.host_settings import make_host_settings
from printer_slicer.printing.job_store import PortAddress, create_print
from printer_slicer.printing.print_controller import Request
from printer_slicer.profile import load_profile
from tests.cli.command_line import typed
from tests.waiting import LAST_RESORT

ROOT = Path(__file__).parents[1]
BOX = ROOT / "sample_parts" / "box.stl"
HEAVY = ("numpy", "rich", "serial", "trimesh", "scipy", "networkx", "shapely", "clipper2")
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for path in (ROOT / "printer_slicer").rglob("*.py")
    if path.name != "__main__.py"
)


def python(code: str, *arguments: str) -> str:
    """What a fresh interpreter writes to stdout; it must end well and say nothing on stderr."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, *arguments],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=LAST_RESORT,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stdout + done.stderr
    return done.stdout


def loaded(code: str, *arguments: str) -> set[str]:
    """Which of the heavy packages are imported once the code has run."""
    tail = (
        "\nimport sys; packages = {name.partition('.')[0] for name in sys.modules}"
        f"\nprint('loaded:', *[name for name in {HEAVY!r} if name in packages])"
    )
    return set(python(code + tail, *arguments).rpartition("loaded:")[2].split())


def after_command(*arguments: str) -> set[str]:
    """Which of the heavy packages a command imports."""
    run = (
        "import sys\nfrom printer_slicer.cli import main\n"
        "try:\n    code = main(sys.argv[1:])\nexcept SystemExit as error:\n    code = error.code\nassert not code, code"
    )
    return loaded(run, *arguments)


@pytest.mark.parametrize("arguments", [["--help"], ["slice", "--help"], ["print", "--help"]], ids=" ".join)
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    assert after_command(*arguments) == set()


def test_the_version_imports_nothing_heavy() -> None:
    assert after_command("--version") == set()


def test_importing_the_package_imports_nothing_heavy() -> None:
    assert loaded("import printer_slicer") == set()


def test_importing_the_package_loads_four_small_modules() -> None:
    code = "import sys, printer_slicer\nprint(*[name for name in sys.modules if name.startswith('printer_slicer.')])"

    names = ("deprecation", "lazy_names", "repr_svg", "version")
    assert set(python(code).split()) == {f"printer_slicer.{name}" for name in names}


def test_listing_ports_imports_only_the_serial_library() -> None:
    assert after_command("ports") == {"serial"}


def test_listing_profiles_imports_nothing_heavy() -> None:
    assert after_command("profiles") == set()


def test_the_wire_and_the_simulated_printer_import_no_numpy() -> None:
    names = [name for name in MODULES if name.startswith(("printer_slicer.stream", "printer_slicer.sim"))]

    assert loaded("\n".join(f"import {name}" for name in names)) <= {"serial"}


def test_serving_the_simulated_printer_needs_no_serial_library(tmp_path: Path) -> None:
    (tmp_path / "taken").touch()
    code = (
        "import sys\nfrom printer_slicer.cli import main\nimport io, contextlib\n"
        "with contextlib.redirect_stderr(io.StringIO()):\n    assert main(sys.argv[1:]) == 4"
    )

    assert "serial" not in loaded(code, "sim", "--pty", str(tmp_path / "taken"))


def after_slicing(folder: Path, *flags: str) -> list[str]:
    """All modules that slicing imports."""
    code = (
        "import sys\nfrom printer_slicer.cli import main\nassert main(sys.argv[1:]) == 0\n"
        "print('loaded:', *sys.modules)"
    )
    said = python(code, "slice", str(BOX), "-o", str(folder / "box.gcode"), *flags)
    return said.rpartition("loaded:")[2].split()


def test_slicing_an_stl_imports_neither_trimesh_nor_pillow_nor_the_serial_library_nor_a_ledger(
    tmp_path: Path,
) -> None:
    names = after_slicing(tmp_path, "--json", "--set", "thumbnails=")
    taken = {name.partition(".")[0] for name in names}

    assert "numpy" in taken
    assert taken & {"trimesh", "scipy", "networkx", "serial", "rich", "PIL"} == set()
    assert [name for name in names if "ledger" in name or "checking" in name] == []


def test_thumbnails_as_png_need_no_pillow_and_those_as_qoi_not_all_of_its_formats(tmp_path: Path) -> None:
    """They are more than 40."""
    png = after_slicing(tmp_path, "-q", "--set", "thumbnails=16x16, 300x300")
    qoi = after_slicing(tmp_path, "-q", "--set", "thumbnails=16x16, 16x16/QOI")

    assert [name for name in png if name.startswith("PIL")] == []
    assert 1 <= len([name for name in qoi if name.startswith("PIL") and name.endswith("Plugin")]) <= 9


def test_slicing_a_box_imports_nothing_that_a_box_does_without(tmp_path: Path) -> None:
    names = after_slicing(tmp_path, "-q", "--quality", "standard")
    own = {name.removeprefix("printer_slicer.") for name in names if name.startswith("printer_slicer.")}
    rooms = {"doctor", "drawing", "exports", "importing", "jobs", "printing", "sending", "sim", "slice_jobs"}
    patterns = {path.stem for path in (ROOT / "printer_slicer" / "infill").glob("[a-z]*.py")} & {*PATTERNS}

    assert not {name.partition(".")[0] for name in names} & {
        "PIL",
        "difflib",
        "rich",
        "subprocess",
        "trimesh",
    }
    assert {name for name in own if name.partition(".")[0] in rooms} == set()
    assert {name.partition(".")[2] for name in own if name.startswith("planning.")} & {*PLANNERS} == {
        "uniform"
    }
    assert {name.partition(".")[2] for name in own if name.startswith("infill.")} & patterns == {"grid"}
    assert len(own) <= 255


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere platformdirs finds the user's profiles")
def test_slicing_imports_no_library_for_folders_and_temporary_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("PRINTER_SLICER_PROFILES", "XDG_CONFIG_HOME", "ANDROID_ROOT"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))

    assert not {*after_slicing(tmp_path, "-q")} & {"platformdirs", "shutil", "tempfile"}


@pytest.mark.parametrize("name", printer_slicer.__all__)
def test_every_public_name_is_the_thing_of_its_module(name: str) -> None:
    home = import_module(f"printer_slicer.{printer_slicer._HOMES[name]}")

    assert getattr(printer_slicer, name) is getattr(home, name)


def test_an_unknown_public_name_is_an_attribute_error() -> None:
    assert not hasattr(printer_slicer, "nothing_of_this_name")


def test_the_public_names_are_listed() -> None:
    assert set(printer_slicer.__all__) <= set(dir(printer_slicer))


def test_every_module_imports_without_a_warning_and_hides_no_public_name() -> None:
    imports = "\n".join(f"import {name}" for name in MODULES)
    said = python(
        f"{imports}\nimport printer_slicer as ps\nfor name in ps.__all__: print(type(getattr(ps, name)).__name__)"
    )

    assert "module" not in said.split()


class Granting:
    """Grants everything, and remembers what was wanted."""

    def __init__(self) -> None:
        self.wanted: list[object] = []

    def submit(self, request: Request) -> None:
        self.wanted.append(request.command)
        request.done("the printer was told to halt")


@pytest.mark.parametrize("words", ["abort", "ABORT", "M112", "estop", "abort now", "stop"])
def test_an_emergency_stop_has_several_names(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    controls, granting = Controls(), Granting()
    controls.bind(granting)  # type: ignore[arg-type]
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(tmp_path))
    held = create_print(
        tmp_path / "prints", "job.gcode", b"G28\n", PortAddress("port", 1), make_host_settings(load_profile())
    )
    with serve_control_socket(held.folder, controls, held.name):
        outcome = typed("control", *words.split())
    held.delete()

    assert outcome.code == 0, outcome.err
    assert granting.wanted == [Abort()]
    assert ("'control abort'" in outcome.err) == (words == "stop")


def test_an_emergency_stop_imports_nothing_that_it_does_without(tmp_path: Path) -> None:
    """What is imported delays the first byte."""
    controls, granting = Controls(), Granting()
    controls.bind(granting)  # type: ignore[arg-type]
    run = (
        "import os, sys\nos.environ['PRINTER_SLICER_STATE'] = sys.argv[1]\n"
        "from printer_slicer.cli import main\nassert main(['control', 'abort']) == 0\n"
        "print('loaded:', *sys.modules)"
    )
    held = create_print(
        tmp_path / "prints", "job.gcode", b"G28\n", PortAddress("port", 1), make_host_settings(load_profile())
    )
    with serve_control_socket(held.folder, controls, held.name):
        names = python(run, str(tmp_path)).partition("loaded:")[2].split()
    held.delete()
    own = {name.removeprefix("printer_slicer.") for name in names if name.startswith("printer_slicer.")}

    assert granting.wanted == [Abort()]
    assert not {name.partition(".")[0] for name in names} & {
        *HEAVY,
        "httpx",
        "PIL",
        "asyncio",
        "platformdirs",
    }
    assert not {name.partition(".")[0] for name in own} & {
        "pipeline",
        "jobs",
        "profile",
        "stream",
        "sim",
        "gcode",
    }
    assert 5 < len(own) <= 23, own


def modules_of_commands(*arguments: str) -> set[str]:
    """Which modules of commands are imported when something is typed."""
    code = (
        "import sys, contextlib, io\nfrom printer_slicer.cli import main\n"
        "with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):\n    main(sys.argv[1:])\n"
        "print(*[name for name in sys.modules if name.startswith('printer_slicer.cli.commands.')])"
    )
    return {name.rpartition(".")[2] for name in python(code, *arguments).split()}


@pytest.mark.parametrize("name", COMMANDS)
def test_only_the_module_of_the_command_that_is_asked_for_is_imported(name: str) -> None:
    own = name.replace("-", "_")

    assert modules_of_commands(name, "--help") - {"profiles_import"} == {own}


@pytest.mark.parametrize("arguments", [["--help"], ["--version"]], ids=" ".join)
def test_the_table_of_commands_is_enough_for(arguments: list[str]) -> None:
    assert modules_of_commands(*arguments) == set()


def test_a_misspelt_command_is_answered_from_the_table() -> None:
    code = (
        "import sys\nfrom printer_slicer.cli import main\nsys.stderr = sys.stdout\nassert main(['slcie']) == 2\n"
        "assert not any(name.startswith('printer_slicer.cli.commands.') for name in sys.modules)"
    )

    assert "Did you mean 'slice'?" in python(code)


def test_every_module_of_a_command_is_in_the_table() -> None:
    names = {path.stem for path in (ROOT / "printer_slicer" / "cli" / "commands").glob("[a-z]*.py")}

    assert names - {"profiles_import"} == {name.replace("-", "_") for name in COMMANDS}
