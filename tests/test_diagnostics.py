"""One value and one table for everything that is wrong with a print."""

from __future__ import annotations

import json

import pytest

from printer_slicer.diagnostics import CODES, NAMES, Diagnostic, as_former_json, raise_on_errors, sentence
from printer_slicer.errors import PolicyError

KINDS = {"unsupported": "air", "underfilled": "under", "overfilled": "over", "underrun": "link"}


def test_no_diagnostic_has_a_code_that_the_table_does_not_have() -> None:
    with pytest.raises(KeyError):
        Diagnostic("nonsense", "error", "")


def test_what_the_rules_on_commands_find_can_be_allowed() -> None:
    found_by_lint = {name for name, row in CODES.items() if "lint" in row.found_by}

    assert set(NAMES) == found_by_lint - {"unknown"}  # lint only warns of it


def test_the_keys_of_the_first_version_stay_in_json() -> None:
    for code in CODES:
        facts = json.loads(
            json.dumps(as_former_json(Diagnostic(code, "warning", "m", "r", place=(1.0, 2.0))))
        )

        assert (facts["name"], facts["kind"]) == (code, KINDS.get(code, code))
        assert facts["what"] == facts["text"] == facts["message"] == "m"
        assert (facts["why"], facts["x"], facts["y"]) == ("r", 1.0, 2.0)
        assert (facts["refused"], facts["harmless"]) == (False, True)


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (
            Diagnostic(
                "eeprom", "error", "stores", "it lasts", line=3, layer=2, times=3, index=7, command="M500"
            ),
            "line 3, layer 2: M500: stores (3 times). it lasts [eeprom]",
        ),
        (
            Diagnostic(
                "crash", "error", "deep", remedy="up", line=9, layer=4, z=0.8, times=2, place=(1.0, 2.0)
            ),
            "line 9, layer 4, z 0.8 mm: deep (and in 1 more layer). up",
        ),
        (Diagnostic("machine", "error", "halted", times=2), "halted (2 times)"),
        (
            Diagnostic("overlap", "error", "much", line=5, layer=4, first=3, last=6, z=0.8, place=(1.0, 2.0)),
            f"line 5, layers 3 to 6, worst in layer 4, z 0.8 mm, x 1.00 y 2.00: much. {CODES['overlap'].remedy}",
        ),
    ],
)
def test_a_sentence_says_where_what_how_often_and_what_helps(one: Diagnostic, said: str) -> None:
    assert sentence(one) == said


def test_only_errors_that_are_not_allowed_keep_a_job_from_being_printed() -> None:
    found = [Diagnostic("eeprom", "error", "stores"), Diagnostic("flow", "warning", "a little")]

    raise_on_errors(found, {"eeprom"})
    with pytest.raises(PolicyError, match="stores") as caught:
        raise_on_errors(found)
    assert caught.value.names == ("eeprom",)


def test_layers_of_a_run_are_indices_from_0() -> None:
    assert [*Diagnostic("outline", "error", "", layer=3, first=2, last=4).affected_layers] == [1, 2, 3]
    assert [*Diagnostic("outline", "error", "", layer=3).affected_layers] == [2]
