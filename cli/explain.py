"""`furrowmap explain`: what a code of an error or a warning means."""

from __future__ import annotations

import re
from difflib import get_close_matches

import click

from furrowmap.cli.console import Console
from furrowmap.cli.options import command
from furrowmap.core.runtime.errors import UsageError
from furrowmap.core.runtime.languages.catalogue import ENGLISH
from furrowmap.core.runtime.languages.messages import ERROR_PARTS, expansions, templates
from furrowmap.core.runtime.settings import language_of_user


@command("Explain the code of an error or a warning.", "furrowmap explain clock-offset")
@click.argument("code")
def explain(console: Console, code: str) -> None:
    """Print the messages that have CODE, and what to do about them. … stands for what varies, such as file names."""
    keys = [key for key in templates(ENGLISH) if key.partition(".")[0] == code]
    if not keys:
        codes = sorted({key.partition(".")[0] for key in templates(ENGLISH)})
        raise UsageError("no-such-code", code=code, near=" or ".join(get_close_matches(code, codes, 3, 0.5)))
    messages = [_messages(key, language_of_user()) for key in keys]
    console.answer({"code": code, "messages": messages}, "\n\n".join("\n".join(found.values()) for found in messages))


def _messages(key: str, language: str) -> dict[str, str]:
    """The parts of the message of a key, with … for its values; of choices, the first."""
    ours, english = templates(language)[key], templates(ENGLISH)[key]
    found = {part: next(expansions(english[part], ours[part])) for part in (*ERROR_PARTS, "text") if part in ours}
    return {
        part: source if language == ENGLISH else re.sub(r"\{\d+\}", "…", other)
        for part, (source, other) in found.items()
    }
