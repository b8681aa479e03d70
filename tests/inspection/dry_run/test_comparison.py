"""What was executed against what should have been: one slip is one difference, and what follows is in step again."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.inspection.dry_run.comparison import Comparison

JOB = tuple(f"G1 X{at}".encode() for at in range(40))


def compared(lines: list[str], job: tuple[bytes, ...] = JOB) -> Comparison:
    """The comparison that was told these lines."""
    comparison = Comparison(job)
    for line in lines:
        comparison(line)
    return comparison


def test_an_altered_line_is_one_difference() -> None:
    lines = [line.decode() for line in JOB]
    lines[7] = "G1  X7"
    comparison = compared(lines)

    assert comparison.unexpected == [(7, "G1  X7")]
    assert comparison.skipped == [7]
    assert comparison.executed == len(JOB) - 1
    assert comparison.command_of(20) == 19


def test_a_lost_line_is_one_difference_and_no_stray() -> None:
    lines = [line.decode() for line in JOB if line != b"G1 X7"]
    comparison = compared(lines)

    assert comparison.unexpected == []
    assert comparison.n_unexpected == 0
    assert comparison.skipped == [7]
    assert comparison.executed == len(JOB) - 1
    assert comparison.command_of(8) == 8
    assert comparison.is_job_command(8)


def test_a_line_too_many_is_one_difference() -> None:
    lines = [line.decode() for line in JOB]
    lines.insert(7, "G1 X6")
    comparison = compared(lines)

    assert comparison.unexpected == [(7, "G1 X6")]
    assert comparison.skipped == []
    assert comparison.executed == len(JOB)
    assert not comparison.is_job_command(8)
    assert [comparison.command_of(number) for number in (7, 8, 9)] == [6, 6, 7]


@given(
    st.lists(st.sampled_from(["keep", "keep", "keep", "lose", "alter", "ask", "add"]), max_size=40),
    st.booleans(),
)
def test_behind_slips_the_commands_are_those_of_the_job(fates: list[str], alike: bool) -> None:
    job = tuple(b"G1 X%d" % (at % 3) for at in range(40)) if alike else JOB
    lines: list[str] = []
    for fate, command in zip(fates, job, strict=False):
        text = command.decode()
        lines += {
            "keep": [text],
            "lose": [],
            "alter": [f"{text}?"],
            "ask": ["M105", text],
            "add": ["M300", text],
        }[fate]
    comparison = compared(lines, job)
    own = [number for number in range(1, len(lines) + 1) if comparison.is_job_command(number)]

    assert len(own) == comparison.executed
    assert [job[comparison.command_of(number)].decode() for number in own] == [
        lines[number - 1] for number in own
    ]
    places = [comparison.command_of(number) for number in own]
    assert places == sorted(set(places))


def test_a_slip_is_got_over_wherever_others_are_far_enough() -> None:
    lines = [line.decode() for at, line in enumerate(JOB) if at not in (5, 20)]
    lines[10] = "G1 X10 Y0"
    asked = [line for at, text in enumerate(lines) for line in ([text, "M105"] if at % 5 == 0 else [text])]
    comparison = compared(asked)

    assert comparison.due == len(JOB)
    assert comparison.n_unexpected <= 3


def test_what_is_kept_does_not_grow_with_questions() -> None:
    """A host may ask for days, with a job or without one."""
    for job in ((), JOB):
        comparison = compared(["M105"] * 10_000, job)
        kept = [
            value for value in vars(comparison).values() if hasattr(value, "__len__") and value is not JOB
        ]

        assert max(map(len, kept)) < 10
    assert len(compared(["M105", "G1 X1"] * 10_000, ())._begins) == 1
