"""Life in a shell: stdin and stdout, patterns, colours, completion by Tab, the manual page."""

from __future__ import annotations

import json
import os
import pty
import re
import select
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Final

import pytest
from command_line import BOX, QUICK, ROOT, USUAL, is_message, process, typed

from printer_slicer.cli.commands.man import format_man_page, format_markdown_page
from printer_slicer.cli.parser import COMMANDS, build_parser
from printer_slicer.cli.shell_completion import SHELLS, iterate_actions, make_completion_script
from printer_slicer.mesh_io import load_mesh
from tests.waiting import LAST_RESORT

PRINTER: Final = [sys.executable, "-m", "printer_slicer"]


def piped(data: bytes, *arguments: object, cwd: Path) -> subprocess.CompletedProcess[bytes]:
    """A command with something in stdin."""
    return subprocess.run(
        [*PRINTER, *map(str, arguments)],
        input=data,
        cwd=cwd,
        env={**os.environ, **USUAL},
        capture_output=True,
        timeout=LAST_RESORT,
        check=False,
    )


@pytest.fixture(scope="module")
def gcode(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The box, sliced out of a pipe into a pipe."""
    done = piped(BOX.read_bytes(), "slice", "-", "-o", "-", *QUICK, cwd=tmp_path_factory.mktemp("pipe"))
    assert done.returncode == 0
    assert (
        done.stderr
        == b"printer marlin_220 (--printer), material pla (--material), quality standard (--quality) "
        b"with uniform layers of 0.3 mm\n"
    )
    return done.stdout


# - is stdin and stdout


def test_a_model_from_stdin_becomes_gcode_on_stdout(gcode: bytes, tmp_path: Path) -> None:
    assert typed("slice", BOX, "-o", tmp_path / "box.gcode", *QUICK).code == 0
    # The file tells the name of the model, which is all that differs.
    named = (tmp_path / "box.gcode").read_bytes().replace(b"box", b"stdin")

    assert gcode.replace(b"box", b"stdin") == named


def test_models_of_any_kind_are_told_by_what_they_hold(tmp_path: Path) -> None:
    corners = load_mesh(BOX).triangles.reshape(-1, 3)
    points = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in corners.tolist())
    facets = "".join(f"f {k} {k + 1} {k + 2}\n" for k in range(1, len(corners), 3))
    done = piped((points + facets).encode(), "slice", "-", "-o", "box.gcode", "--json", *QUICK, cwd=tmp_path)

    assert done.returncode == 0
    assert json.loads(done.stdout)["models"][0]["format"] == "obj"


def test_gcode_from_stdin_is_dry_run(gcode: bytes, tmp_path: Path) -> None:
    done = piped(gcode, "dry-run", "-", "--json", cwd=tmp_path)
    verdict = json.loads(done.stdout)

    assert (done.returncode, verdict["ok"], verdict["job"]) == (0, True, "stdin.gcode")


def test_gcode_from_stdin_is_checked_and_drawn(gcode: bytes, tmp_path: Path) -> None:
    checked = piped(gcode, "check", "-", "--model", BOX, "--json", cwd=tmp_path)
    drawn = piped(gcode, "draw", "-", "--layer", 2, "-o", "-", cwd=tmp_path)

    assert json.loads(checked.stdout)["ok"]
    assert drawn.stdout.startswith(b"<svg ")
    assert list(tmp_path.iterdir()) == []


def test_the_model_of_a_check_may_come_from_stdin(gcode: bytes, tmp_path: Path) -> None:
    (tmp_path / "box.gcode").write_bytes(gcode)
    done = piped(BOX.read_bytes(), "check", "box.gcode", "--model", "-", "--json", cwd=tmp_path)

    assert json.loads(done.stdout)["ok"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["slice", "-", "-o", "-", "--quality", "-"],
            "-: stdin can be read only once\n  Write one of the two inputs to a file\n",
        ),
        (
            ["contours", "-", "-o", "-"],
            "-o -: contours cannot be written to stdout\n  Name a .svg, .cli or .slc file\n",
        ),
        (
            ["slice", "-"],
            (
                "-: the model is read from stdin, so the G-code needs a file name\n"
                "  Name the output with -o FILE.gcode, or write it to stdout with -o -\n"
            ),
        ),
        (
            ["check", "-", "--model", "-"],
            "-: stdin can be read only once\n  Write one of the two inputs to a file\n",
        ),
        (
            ["slice", "-", "-", "-o", "x"],
            "-: stdin can be read only once\n  Write one of the two inputs to a file\n",
        ),
    ],
)
def test_what_stdin_cannot_be_is_told(arguments: list[str], message: str, tmp_path: Path) -> None:
    done = piped(BOX.read_bytes(), *arguments, cwd=tmp_path)

    assert (done.returncode, done.stderr.decode()) == (2, f"printer-slicer: {message}")


def test_an_empty_stdin_is_told(tmp_path: Path) -> None:
    done = piped(b"", "dry-run", "-", cwd=tmp_path)

    assert (done.returncode, done.stderr) == (
        2,
        b"printer-slicer: -: stdin is empty\n  Pipe a file into it, or give the name of a file\n",
    )


PROFILE = b'inherits = "standard"\nname = "mine"\nperimeters = 5\n'


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["profiles", "check", "-"], "stdin.toml: no errors\n"),
        (["profiles", "show", "-"], "  # stdin.toml:3\n"),
        (
            ["profiles", "show", "--quality", "-"],
            "quality.perimeters = 5                        # stdin.toml:3\n",
        ),
        (["profiles", "diff", "standard", "-"], "perimeters                          2 -> 5\n"),
        (["slice", BOX, "-o", "-", "--quality", "-", "--quiet"], "; quality.perimeters = 5\n"),
    ],
)
def test_a_profile_may_come_from_stdin(arguments: list[object], said: str, tmp_path: Path) -> None:
    done = piped(PROFILE, *arguments, cwd=tmp_path)

    assert (done.returncode, done.stderr) == (0, b"")
    assert said in done.stdout.decode()


def test_what_is_wrong_with_a_profile_from_stdin_is_told_by_its_lines(tmp_path: Path) -> None:
    done = piped(PROFILE + b"perimetres = 3\n", "profiles", "check", "-", cwd=tmp_path)
    used = piped(PROFILE + b"perimetres = 3\n", "slice", BOX, "-o", "-", "--quality", "-", cwd=tmp_path)
    told = "stdin.toml:4: quality.perimetres: no such setting\n  Did you mean 'perimeters'?\n"

    assert (done.returncode, done.stderr.decode()) == (2, told)
    assert (used.returncode, used.stderr.decode()) == (2, f"printer-slicer: {told}")


def test_patterns_of_profiles_are_expanded(tmp_path: Path) -> None:
    for name in ("a.toml", "b.toml"):
        (tmp_path / name).write_bytes(PROFILE)

    assert typed("profiles", "check", "*.toml", cwd=tmp_path).out == "a.toml, b.toml: no errors\n"
    assert is_message(
        typed("profiles", "check", "*.tml", cwd=tmp_path), "*.tml: no file matches this pattern"
    )


def test_messages_do_not_show_where_stdin_was_kept(tmp_path: Path) -> None:
    done = piped(b"solid nothing\nendsolid nothing\n", "slice", "-", "-o", "-", "--quiet", cwd=tmp_path)

    assert done.returncode == 3
    assert done.stderr.startswith(b"printer-slicer: stdin: ")


# Patterns


def test_patterns_that_the_shell_left_alone_are_expanded(tmp_path: Path) -> None:
    for name in ("a.stl", "b.stl"):
        shutil.copy(BOX, tmp_path / name)
    outcome = typed("slice", "*.stl", "-o", "plate.gcode", "--json", "--fuse", *QUICK, cwd=tmp_path)

    assert [one["file"] for one in json.loads(outcome.out)["models"]] == ["a.stl", "b.stl"]


def test_a_file_whose_name_is_a_pattern_is_that_file(tmp_path: Path) -> None:
    for name in ("part[1].stl", "part1.stl"):
        shutil.copy(BOX, tmp_path / name)
    outcome = typed("slice", "part[1].stl", "-o", "x.gcode", "--json", *QUICK, cwd=tmp_path)

    assert [one["file"] for one in json.loads(outcome.out)["models"]] == ["part[1].stl"]


def test_a_pattern_without_files_is_told(tmp_path: Path) -> None:
    assert is_message(
        typed("slice", "*.stl", cwd=tmp_path), "*.stl: no file matches this pattern", "the current folder"
    )


def test_a_pattern_for_one_file_must_mean_one(gcode: bytes, tmp_path: Path) -> None:
    (tmp_path / "one.gcode").write_bytes(gcode)
    assert typed("draw", "*.gcode", cwd=tmp_path).code == 0

    (tmp_path / "two.gcode").write_bytes(gcode)
    assert is_message(
        typed("draw", "*.gcode", cwd=tmp_path), "*.gcode: matches 2 files, such as one.gcode and two.gcode"
    )


# Colours


def on_a_terminal(
    *arguments: object, env: Mapping[str, str], said: str = "", until: str = ""
) -> tuple[int, str]:
    """A process whose stdout and stderr are a terminal: its exit code, and all that it showed."""
    pid, terminal = pty.fork()
    if pid == 0:  # the process that becomes the command
        os.execvpe(str(arguments[0]), [str(one) for one in arguments], {**os.environ, **USUAL, **env})
    shown, end = b"", monotonic() + LAST_RESORT
    os.write(terminal, said.encode()) if said else None
    while monotonic() < end:
        ready, _, _ = select.select([terminal], [], [], 0.5)
        try:
            piece = os.read(terminal, 65536) if ready else b""
        except OSError:  # it ended
            break
        shown += piece
        if ready and not piece:
            break
    os.close(terminal)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), shown.decode("utf-8", "replace")


MISSING = (*PRINTER, "slice", "missing.stl", "--quiet")


def test_errors_are_red_on_a_terminal() -> None:
    code, shown = on_a_terminal(*MISSING, env={"NO_COLOR": "", "TERM": "xterm"})

    assert code == 2
    assert shown.startswith("\x1b[1;31mprinter-slicer:\x1b[0m missing.stl: no such file")


@pytest.mark.parametrize("env", [{"NO_COLOR": "1", "TERM": "xterm"}, {"NO_COLOR": "", "TERM": "dumb"}])
def test_nobody_gets_colours_who_wants_none(env: dict[str, str]) -> None:
    code, shown = on_a_terminal(*MISSING, env=env)

    assert code == 2
    assert shown.startswith("printer-slicer: missing.stl: no such file")


def test_files_and_pipes_get_no_colours(tmp_path: Path) -> None:
    outcome = process("slice", "missing.stl", cwd=tmp_path, env={"NO_COLOR": "", "TERM": "xterm"})

    assert outcome.err.startswith("printer-slicer: missing.stl: no such file")


# Completion


@contextmanager
def on_the_path(folder: Path) -> Iterator[dict[str, str]]:
    """An environment in which `printer-slicer` is ours."""
    script = folder / "bin" / "printer-slicer"
    script.parent.mkdir()
    script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m printer_slicer "$@"\n')
    script.chmod(0o755)
    yield {
        **os.environ,
        "PATH": f"{script.parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "HOME": str(folder),
        "LC_ALL": "C.UTF-8",
    }


def needs(shell: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(shutil.which(shell) is None, reason=f"{shell} is not installed")


def bash_offers(line: str, folder: Path) -> list[str]:
    """What bash has to offer after a line."""
    script = f"""
    eval "$(printer-slicer completion bash)"
    COMP_LINE={line!r} COMP_POINT={len(line)} COMP_TYPE=9
    COMP_WORDS=($COMP_LINE) COMP_CWORD=1
    _python_argcomplete printer-slicer
    printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    with on_the_path(folder) as env:
        done = subprocess.run(
            ["bash", "--norc", "-c", script],
            env=env,
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=LAST_RESORT,
            check=True,
        )
    return [word.strip() for word in done.stdout.splitlines()]


CASES: Final = [
    ("printer-slicer sli", {"slice"}, {"plan"}),
    ("printer-slicer slice --mat", {"--material"}, {"--printer"}),
    ("printer-slicer slice --material pe", {"petg"}, {"pla"}),
    pytest.param("printer-slicer slice --quality ad", {"adaptive"}, {"standard"}, marks=pytest.mark.thorough),
    ("printer-slicer slice --set infill_den", {"infill_density="}, {"perimeters="}),
    ("printer-slicer dry-run --set quality.infill_den", {"quality.infill_density="}, {"infill_density="}),
    pytest.param("printer-slicer slice --planner op", {"optimal"}, {"uniform"}, marks=pytest.mark.thorough),
    pytest.param("printer-slicer slice --units in", {"inch"}, {"mm"}, marks=pytest.mark.thorough),
    ("printer-slicer check --allow ee", {"eeprom"}, {"temperature"}),
    ("printer-slicer slice --allow ", {"unsupported"}, {"eeprom"}),
    ("printer-slicer print --port si", {"sim:"}, set()),
    ("printer-slicer slice p", {"part.stl", "parts/"}, {"picture.png"}),
    ("printer-slicer check p", {"part.gcode", "parts/"}, {"part.stl"}),
    ("printer-slicer send part.gcode --to moon", {"moonraker"}, {"duet"}),
    pytest.param("printer-slicer completion f", {"fish"}, {"bash"}, marks=pytest.mark.thorough),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With some files to be named."""
    for name in ("part.stl", "part.gcode", "picture.png"):
        (tmp_path / name).touch()
    (tmp_path / "parts").mkdir()
    return tmp_path


@needs("bash")
@pytest.mark.parametrize(("line", "there", "absent"), CASES)
def test_bash_completes(line: str, there: set[str], absent: set[str], folder: Path) -> None:
    offered = {word.replace("\\", "") for word in bash_offers(line, folder)}

    assert there <= offered
    assert not absent & offered


@needs("bash")
def test_values_of_a_setting_with_few_of_them_are_completed(folder: Path) -> None:
    # Bash takes = for the end of a word: it wants what comes behind.
    assert set(bash_offers("printer-slicer slice --set infill=g", folder)) >= {"grid", "gyroid"}


@needs("fish")
@pytest.mark.parametrize(("line", "there", "absent"), CASES)
def test_fish_completes(line: str, there: set[str], absent: set[str], folder: Path) -> None:
    script = f"printer-slicer completion fish | source; complete -C {line!r}"
    with on_the_path(folder) as env:
        done = subprocess.run(
            ["fish", "--no-config", "-c", script],
            env=env,
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=LAST_RESORT,
            check=True,
        )
    offered = {row.partition("\t")[0] for row in done.stdout.splitlines()}

    assert there <= offered
    assert not absent & offered


@needs("zsh")
@pytest.mark.parametrize(
    ("begin", "completed"),
    [
        ("printer-slicer sli", "printer-slicer slice "),
        ("printer-slicer slice --mater", "printer-slicer slice --material "),
        ("printer-slicer slice --printer corexy_k", "printer-slicer slice --printer corexy_klipper "),
        ("printer-slicer slice --set infill_densi", "printer-slicer slice --set infill_density="),
    ],
)
def test_zsh_completes(begin: str, completed: str, folder: Path) -> None:
    # A terminal of zsh's own: what is typed there, and a key that shows the line as it has become.
    script = f"""
    zmodload zsh/zpty
    zpty inner zsh -f -i
    zpty -w inner 'PROMPT=READY; RPROMPT=; autoload -Uz compinit; compinit -u -D; zstyle ":completion:*" menu no'
    zpty -w inner 'eval "$(printer-slicer completion zsh)"'
    zpty -w inner 'show() {{ print -r -- "<<$BUFFER>>"; BUFFER=; zle accept-line }}'
    zpty -w inner 'zle -N show; bindkey "^O" show; print LISTEN""ING'
    zpty -r inner said '*LISTENING*'
    zpty -w -n inner {begin!r}$'\\t\\x0f'
    zpty -r inner said '*<<*>>*'
    print -r -- "$said"
    zpty -d inner
    """
    with on_the_path(folder) as env:
        done = subprocess.run(
            ["zsh", "-f", "-c", script],
            env=env,
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=LAST_RESORT,
            check=True,
        )

    assert re.findall(r"<<(.*?)>>", done.stdout)[-1:] == [completed]


@pytest.mark.parametrize("shell", SHELLS)
def test_the_code_for_each_shell_is_written(shell: str) -> None:
    outcome = typed("completion", shell)

    assert outcome.out == make_completion_script(shell)
    assert "printer-slicer" in outcome.out


def test_completion_of_names_costs_no_numpy(folder: Path) -> None:
    code = "import sys; from printer_slicer.cli import shell_completion\nprint('numpy' in sys.modules)"

    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        == "False\n"
    )


# The manual


def test_the_manual_has_every_command_flag_and_exit_code() -> None:
    outcome = typed("man")
    plain = outcome.out.replace("\\-", "-")
    flags = {flag for action in iterate_actions(build_parser()) for flag in action.option_strings}

    assert outcome.code == 0
    assert outcome.out == format_man_page()
    assert (
        sorted(flag for flag in flags - {"-h", "--help", "--help-all", "--version"} if flag not in plain)
        == []
    )
    for command in (*COMMANDS, "profiles import"):
        section = plain.partition(f".SS \\fBprinter-slicer {command}\\fR\n")[2].partition(".SS ")[0]
        assert f"usage: printer-slicer {command} [options]" in section
        assert f"\nexamples:\n  printer-slicer {command}" in section or command in (
            "console",
            "sim",
            "completion",
        )
    assert ".SH EXIT STATUS" in plain


@needs("groff")
def test_groff_has_nothing_to_say_against_the_manual() -> None:
    command = ["groff", "-man", "-ww", "-z"]
    done = subprocess.run(
        command, input=format_man_page(), capture_output=True, text=True, timeout=LAST_RESORT, check=True
    )

    assert done.stderr == ""


def test_the_page_for_the_site_has_every_flag() -> None:
    page = format_markdown_page()
    flags = {flag for action in iterate_actions(build_parser()) for flag in action.option_strings}

    assert (
        sorted(flag for flag in flags - {"-h", "--help", "--help-all", "--version"} if flag not in page) == []
    )


# Help


def test_the_usage_of_every_command_is_short_enough_to_be_read() -> None:
    for action in build_parser()._actions:
        for name, command in (action.choices or {}).items() if isinstance(action.choices, dict) else ():
            usage = command.format_usage()
            assert len(usage) < 160, usage
            assert usage.startswith(f"usage: printer-slicer {name}")


def test_every_argument_of_every_command_is_explained() -> None:
    silent = [
        action.dest
        for action in iterate_actions(build_parser())
        if not action.help and action.choices is None
    ]

    assert silent == []


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("--range 5:10:infill_den", ["5:10:infill_density="]),
        ("--range 5:10:tol", ["5:10:tolerance="]),
        ("--range 5:10:nozzle", ["5:10:nozzle_temperature="]),
        ("--range 5:10:elephant", []),
        ("--range 5:", []),
        ("--set-for lid:infill=g", ["lid:infill=grid", "lid:infill=gyroid"]),
        ("--set-for lid:elephant", ["lid:elephant_foot=", "lid:elephant_foot_height="]),
        ("--set-for lid:2:4:elephant", []),
        ("--set-for lid:nozzle", []),
        ("--set-for lid:retract_le", []),
        ("--set-for lid", []),
    ],
)
def test_settings_of_places_are_completed_behind_them(typed: str, offered: list[str]) -> None:
    from printer_slicer.cli.shell_completion import _complete_range, _complete_set_for

    flag, _, word = typed.partition(" ")
    known = _complete_range if flag == "--range" else _complete_set_for
    assert [one for one in known(word) if one.startswith(word)] == offered


@pytest.mark.parametrize(
    ("line", "some", "none"),
    [
        ("profiles import x --f", {"--force", "--for", "--folder"}, {"--printer"}),
        ("profiles  import x --", {"--out", "--cura"}, {"--printer", "--set"}),
        ("profiles import ", {"config.ini"}, {"pla", "list"}),
        ("profiles im", {"import"}, set()),
        ("profiles new ", {"printer", "material", "quality"}, {"pla"}),
        ("profiles new printer ", set(), {"pla", "printer"}),
        ("profiles diff pla ", {"petg"}, {"marlin_220", "fine", "printer"}),
        ("profiles diff printer ", {"marlin_220"}, {"pla"}),
        ("profiles show material p", {"pla"}, {"prusa_mini", "printer"}),
        ("profiles show p", {"pla", "prusa_mini", "printer"}, {"fine"}),
        ("profiles list ", {"printer"}, {"pla"}),
        ("sim --firmware m", {"marlin-2.1"}, {"mine.toml"}),
    ],
)
@needs("bash")
def test_what_may_come_next_is_offered(line: str, some: set[str], none: set[str], tmp_path: Path) -> None:
    for name in ("config.ini", "mine.toml"):
        (tmp_path / name).touch()
    offered = {word.strip() for word in bash_offers(f"printer-slicer {line}", tmp_path)}

    assert some <= offered
    assert not none & offered


def test_the_page_for_man_tells_of_import() -> None:
    page = format_man_page()

    assert ".SS \\fBprinter\\-slicer profiles import\\fR" in page
    assert "max\\-nozzle\\-temperature" in page


def test_every_dial_with_few_values_completes_them() -> None:
    from printer_slicer.cli.shell_completion import _make_choice_completer

    assert list(_make_choice_completer("quality.containment")("po")) == ["positive"]
    assert list(_make_choice_completer("quality.planner.objective")("")) == [
        "balanced",
        "layers",
        "time",
        "volume",
    ]
    assert list(_make_choice_completer("quality.tolerance")("")) == []
