"""TOML that others wrote is read, or refused by the one error of its parser."""

from __future__ import annotations

import tomllib

import pytest

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.session_file import parse_session, parse_toml
from furrowmap.core.simulator.scenario import scenario_from

HOSTILE = ["a = " + "9" * 5000, "a = 0x" + "f" * 5000, "a = [9223372036854775808]", "a = " + "[" * 5000, "a = ="]


@pytest.mark.parametrize("text", HOSTILE, ids=["digits", "hexadecimal", "65 bits", "nested", "syntax"])
def test_promise_23__toml_that_python_cannot_hold_is_a_syntax_error(text: str) -> None:
    with pytest.raises(tomllib.TOMLDecodeError):
        parse_toml(text)
    with pytest.raises(InputError) as error:
        parse_session(text)
    assert error.value.code == "session-syntax"
    with pytest.raises(InputError) as error:
        scenario_from(text, "scenario.toml")
    assert error.value.code.startswith("scenario-")


def test_parse_toml__reads_what_the_parser_of_python_reads() -> None:
    text = "a = 9223372036854775807\nb = [-9223372036854775808, 1.5, {c = true}]\n"
    assert parse_toml(text) == tomllib.loads(text)
