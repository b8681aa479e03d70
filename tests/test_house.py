"""The rules of the house: sizes, docstrings, imports, public lists, words, and documents that are true."""

from __future__ import annotations

import ast
import contextlib
import importlib
import io
import os
import re
import shlex
import subprocess
import sys
import tokenize
import tomllib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from printer_slicer.cli.parser import build_parser
from tests.sources import PACKAGE, SOURCES, trees
from tests.waiting import LAST_RESORT

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("*/README.md")])
MAX_LINES = 600
LONGEST_FUNCTION = 50
USUAL_FUNCTION = 30
A_LIMIT = 0.1  # s; who waits for less looks again and again
NO_SOURCE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}
# Spelled in pieces, so that this file does not hold what it looks for.
WORDS = (
    (r"(?<![\w.])/wo", "rk/"),
    ("bash", "_jobs"),
    ("sub", "agent"),
    ("/tmp/ve", "nv"),
    ("shared", "/design"),
    (r"\bai ass", "istant"),
    ("cla", "ude"),
    ("chat", "gpt"),
)
WORKPLACE = re.compile("|".join(begin + end for begin, end in WORDS), re.IGNORECASE)


def name_of(path: Path) -> str:
    """The module's name as an import says it."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def shown(path: Path) -> str:
    return str(path.relative_to(ROOT))


def source_lines(path: Path) -> int:
    """Lines that hold code or docstrings; blank lines and comments are free."""
    text = path.read_text(encoding="utf-8")
    lines = text.split("\n")
    used: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in NO_SOURCE:
            used.update(range(token.start[0], token.end[0] + 1))
    return sum(1 for number in used if lines[number - 1].strip())


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield node


def own_names(tree: ast.Module) -> set[str]:
    """Public functions and classes that a module defines itself."""
    made = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    return {node.name for node in tree.body if isinstance(node, made) and not node.name.startswith("_")}


def public_list(tree: ast.Module) -> list[str]:
    """`__all__` of a module, empty without one."""
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        if any(isinstance(target, ast.Name) and target.id == "__all__" for target in targets):
            assert isinstance(node, ast.Assign)
            return list(ast.literal_eval(node.value))
    return []


PARSER = build_parser()


# Sizes and names


def test_test_files_have_names_of_their_own() -> None:
    """Two of one name cannot be collected together."""
    names = sorted(path.name for path in (ROOT / "tests").rglob("test_*.py"))

    assert len(names) > 100
    assert [one for one, after in pairwise(names) if one == after] == []


def test_no_two_public_classes_have_one_name() -> None:
    homes: dict[str, list[str]] = {}
    for path in SOURCES:
        for node in trees()[path].body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(name_of(path))

    assert {name: where for name, where in homes.items() if len(where) > 1} == {}


def test_no_file_is_so_long_that_it_holds_more_than_one_idea() -> None:
    sizes = {
        shown(path): source_lines(path) if path.read_bytes().count(b"\n") > MAX_LINES else 0
        for folder in ("printer_slicer", "tests", "benchmarks", "sample_parts")
        for path in sorted((ROOT / folder).rglob("*.py"))
    }

    assert len(sizes) > 100
    assert {path: size for path, size in sizes.items() if size > MAX_LINES} == {}


def test_a_package_is_more_than_a_few_small_files() -> None:
    sizes = {folder: len([*folder.rglob("*.py")]) - 1 for folder in {path.parent for path in SOURCES}}

    assert len(sizes) > 20
    assert [shown(folder) for folder, files in sizes.items() if files <= 3] == []


def test_no_function_is_longer_than_50_lines_and_hardly_any_longer_than_30() -> None:
    lengths = [
        ((node.end_lineno or 0) - node.lineno + 1, f"{shown(path)}:{node.lineno} {node.name}")
        for path, tree in trees().items()
        for node in functions(tree)
    ]
    lengths.sort()
    middle, p95, longest = (lengths[int(share * (len(lengths) - 1))] for share in (0.5, 0.95, 1))
    said = f"{len(lengths)} functions: median {middle[0]}, p95 {p95[0]}, longest {longest[0]}"
    sys.stdout.write(said + "\n")  # seen with -rP, and when something fails

    assert [place for length, place in lengths if length > LONGEST_FUNCTION] == []
    assert p95[0] <= USUAL_FUNCTION


# Docstrings


def undocumented(tree: ast.Module) -> list[str]:
    """Public things of a module without a docstring."""
    missing = [] if ast.get_docstring(tree) else ["the module"]
    for node in tree.body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
            missing += [] if ast.get_docstring(node) else [node.name]
            methods = node.body if isinstance(node, ast.ClassDef) else []
            missing += [
                f"{node.name}.{method.name}"
                for method in methods
                if isinstance(method, ast.FunctionDef)
                and not method.name.startswith("_")
                and not ast.get_docstring(method)
            ]
    return missing


def test_everything_public_has_a_docstring() -> None:
    missing = {shown(path): undocumented(tree) for path, tree in trees().items()}

    assert {path: names for path, names in missing.items() if names} == {}


# Imports


def test_the_import_contracts_hold() -> None:
    command = "from importlinter.cli import lint_imports_command; lint_imports_command(['--no-cache'])"
    done = subprocess.run(
        [sys.executable, "-c", command],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=LAST_RESORT,
        check=False,
    )

    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken" in done.stdout


def test_nobody_imports_what_another_module_does_not_offer() -> None:
    wrong = []
    by_name = {name_of(path): tree for path, tree in trees().items()}
    for path, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module in by_name:
                offered = set(public_list(by_name[node.module]))
                submodules = {
                    name for name in (a.name for a in node.names) if f"{node.module}.{name}" in by_name
                }
                taken = {alias.name for alias in node.names} - submodules - {"*"}
                wrong += [f"{shown(path)}: {node.module}.{name}" for name in sorted(taken - offered)]

    assert wrong == []


def test_no_relative_imports_and_no_stars() -> None:
    froms = [
        (path, node)
        for path, tree in trees().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
    ]

    assert [shown(path) for path, node in froms if node.level] == []
    assert [shown(path) for path, node in froms if any(alias.name == "*" for alias in node.names)] == []


# Public lists


def test_public_lists_name_only_what_there_is() -> None:
    wrong = {}
    for path, tree in trees().items():
        listed, module = public_list(tree), importlib.import_module(name_of(path))
        wrong[shown(path)] = [name for name in listed if not hasattr(module, name) or listed.count(name) > 1]

    assert {path: names for path, names in wrong.items() if names} == {}


def test_public_lists_name_every_public_function_and_class() -> None:
    missing = {
        shown(path): sorted(own_names(tree) - set(public_list(tree))) for path, tree in trees().items()
    }

    assert {path: names for path, names in missing.items() if names} == {}


# Printing and words


def last_name(node: ast.AST) -> str:
    """What stands behind the last dot of a name, "" of anything else."""
    return str(getattr(node, "attr", getattr(node, "id", "")))


def test_nothing_but_the_command_line_prints() -> None:
    found = []
    for path, tree in trees().items():
        for node in [] if path.is_relative_to(PACKAGE / "cli") else ast.walk(tree):
            said = node.func if isinstance(node, ast.Call) else node
            if last_name(said) not in {"print", "stdout", "stderr"}:  # quicker than to unparse everything
                continue
            printed = isinstance(node, ast.Call) and ast.unparse(said) in {"print", "builtins.print"}
            written = isinstance(node, ast.Attribute) and ast.unparse(node) in {"sys.stdout", "sys.stderr"}
            if printed or written:
                found.append(f"{shown(path)}:{getattr(node, 'lineno', 0)}")

    assert found == []


def limits_in(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Lines where a process, thread or connection is given a number of seconds, and where somebody sleeps or measures.

    The consoles of the simulator wait in simulated time.
    """
    limited = {
        "communicate",
        "run",
        "check_output",
        "Serial",
        "serial_for_url",
        "create_connection",
        "urlopen",
    }
    measured = {"sleep", "perf_counter", "process_time", "thread_time", "setitimer"}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute | ast.Name) and last_name(node) in measured:
            yield node.lineno, ast.unparse(node)
        if not isinstance(node, ast.Call) or last_name(node.func) not in limited | {"join", "wait"}:
            continue
        owner, _, name = ast.unparse(node.func).rpartition(".")
        given = [word.value for word in node.keywords if word.arg == "timeout"]
        given = [*node.args[:1], *given] if name in {"join", "wait"} else given if name in limited else []
        seconds = [
            one.value for one in given if isinstance(one, ast.Constant) and type(one.value) in {int, float}
        ]
        in_simulation = "console" in owner.lower() or owner == "self"
        if max(seconds, default=0) >= A_LIMIT and not in_simulation:
            yield node.lineno, ast.unparse(node)


def test_no_wall_clock_decides_a_test() -> None:
    """A busy machine makes no test fail: tests wait for states, see tests/waiting.py."""
    found = [
        f"{shown(path)}:{line}: {what}"
        for path in sorted((ROOT / "tests").rglob("*.py"))
        for line, what in limits_in(ast.parse(path.read_text(encoding="utf-8")))
        if path.name != "waiting.py"
    ]

    assert found == []


def texts() -> list[Path]:
    """All files of the project that git would keep and that are text."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=ROOT,
        capture_output=True,
        timeout=LAST_RESORT,
        check=False,
    )
    if listed.returncode:
        return [*SOURCES, *DOCUMENTS]
    paths = [ROOT / os.fsdecode(name) for name in listed.stdout.split(b"\0") if name]
    return [path for path in paths if path.is_file() and b"\0" not in path.read_bytes()[:4096]]


def test_the_project_speaks_of_itself_alone() -> None:
    found = [
        f"{shown(path)}:{number}: {line.strip()[:80]}"
        for path in texts()
        for number, line in enumerate(path.read_text("utf-8", "replace").splitlines(), start=1)
        if WORKPLACE.search(line)
    ]

    assert found == []


# Documents


def blocks(language: str) -> list[tuple[Path, int, str]]:
    """The fenced blocks of a language in all documents: file, line, text without its indentation."""
    found = []
    for path in DOCUMENTS:
        text = path.read_text(encoding="utf-8")
        for match in re.finditer(rf"(?ms)^( *)```{language}(?: not-here)?\n(.*?)^ *```", text):
            indent = match[1]
            lines = [line.removeprefix(indent) for line in match[2].splitlines()]
            found.append((path, text[: match.start()].count("\n") + 1, "\n".join(lines) + "\n"))
    return found


def place_of(block: tuple[Path, int, str]) -> str:
    return f"{shown(block[0])}:{block[1]}"


def test_the_readme_exists_and_shows_how_to_slice_and_print() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")

    assert "printer-slicer slice" in text
    assert "printer-slicer print" in text
    assert [path for path, _, _ in blocks("sh") if path.name == "README.md"] != []


def test_the_readme_has_at_most_700_words() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 700


@pytest.mark.parametrize("block", blocks("python"), ids=place_of)
def test_the_python_code_of_the_documents_runs(block: tuple[Path, int, str], tmp_path: Path) -> None:
    path, line, code = block
    (tmp_path / "sample_parts").symlink_to(ROOT / "sample_parts")

    with contextlib.chdir(tmp_path):  # it writes its files where it likes
        exec(compile("\n" * line + code, str(path), "exec"), {"__name__": "example"})


def commands_in(text: str) -> Iterator[list[str]]:
    """The calls of printer-slicer in shell text, as lists of arguments."""
    joined = text.replace("\\\n", " ")
    for line in joined.splitlines():
        words = shlex.shlex(line, posix=True, punctuation_chars="|&;<>()")
        words.whitespace_split = True
        command: list[str] = []
        for word in [*words, ";"]:
            if set(word) <= set("|&;<>()"):
                yield from arguments_of(command)
                command = []
            else:
                command.append(word)


def arguments_of(command: list[str]) -> Iterator[list[str]]:
    """What follows the program's name."""
    for place, word in enumerate(command):
        if word.endswith("printer-slicer") and place == 0:
            yield command[1:]
        if command[place : place + 2] == ["-m", "printer_slicer"]:
            yield command[place + 2 :]


def shell_texts() -> list[tuple[str, str]]:
    """Every piece of shell that people are told to type: where it stands, and the text."""
    found = [
        (place_of(block), block[2]) for language in ("sh", "bash", "console") for block in blocks(language)
    ]
    found += [
        (f"{shown(path)} (inline)", match)
        for path in DOCUMENTS
        for match in re.findall(r"(?<!`)`(printer-slicer [^`\n]+)`(?!`)", path.read_text(encoding="utf-8"))
    ]
    found.append(("justfile", (ROOT / "justfile").read_text(encoding="utf-8")))
    return [(place, text) for place, text in found if list(commands_in(text))]


@pytest.mark.parametrize(("place", "text"), shell_texts())
def test_the_commands_of_the_documents_can_be_typed(place: str, text: str) -> None:
    for arguments in commands_in(text):
        try:
            parsed = PARSER.parse_args(arguments)
        except SystemExit as error:
            if error.code:  # 0: it asked for help or the version
                pytest.fail(f"{place}: printer-slicer {shlex.join(arguments)}")
            continue
        for given in getattr(parsed, "models", []):
            model = Path(re.sub(r"\*\d+$", "", str(given)))  # copies
            assert model.parts[0] != "sample_parts" or (ROOT / model).is_file(), f"{place}: {model}"


def links() -> list[tuple[Path, str]]:
    """Relative links of all documents, pictures included."""
    return [
        (path, target)
        for path in DOCUMENTS
        for target in re.findall(r"\]\(([^)\s]+)[^)]*\)", path.read_text(encoding="utf-8"))
        if not re.match(r"[a-z]+:", target)
    ]


@pytest.mark.parametrize(("path", "target"), links(), ids=str)
def test_the_links_of_the_documents_lead_somewhere(path: Path, target: str) -> None:
    file, _, heading = target.partition("#")
    goal = (path.parent / file) if file else path

    assert goal.exists()
    assert not Path(file).is_absolute()
    if heading and goal.suffix == ".md":
        titles = re.findall(r"(?m)^#+ +(.*)$", goal.read_text(encoding="utf-8"))
        assert heading in {
            re.sub(r"[^\w\- ]", "", title).strip().lower().replace(" ", "-") for title in titles
        }


# The package


def test_the_wheel_takes_the_profiles_along() -> None:
    config = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = config["tool"]["hatch"]["build"]["targets"]["wheel"]

    assert wheel["force-include"]["profiles"] == "printer_slicer/profiles"
    assert config["project"]["scripts"]["printer-slicer"] == "printer_slicer.cli:main"
