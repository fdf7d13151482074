"""`furrowmap explain` as it is typed."""

from __future__ import annotations

import json
import re

import pytest

from furrowmap.cli.main import command_line
from furrowmap.core.runtime.languages.texts import templates


def test_explain__every_code_has_a_message_in_every_language(capsys: pytest.CaptureFixture[str]) -> None:
    codes = sorted({key.partition(".")[0] for key in templates("en")})
    for code in codes[:: len(codes) // 20]:
        texts = []
        for language in ("en", "de", "ja"):
            assert command_line(["explain", code, "--json", "--lang", language]) == 0
            answer = json.loads(capsys.readouterr().out)
            assert answer["code"] == code
            texts.append("".join(part for message in answer["messages"] for part in message.values()))
        english, _, japanese = texts
        assert english.isprintable()
        assert not japanese.isascii(), code
        assert re.search(r"{\w", japanese) is None  # a value's place; JSON in a remedy begins with a quote


def test_explain__an_unknown_code_names_those_like_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line(["explain", "clock-ofset"]) == 2
    assert "Did you mean clock-offset" in capsys.readouterr().err
