"""Output of a command: the result to standard output; progress, warnings and errors to standard error."""

import logging
import os
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, Final

import click

from furrowmap.cli.interruption import INTERRUPTION
from furrowmap.core.runtime.errors import FurrowmapError, Notice, printable
from furrowmap.core.runtime.languages.texts import Text, texts_of
from furrowmap.core.runtime.progress import Progress, Step, WholeShare
from furrowmap.core.runtime.settings import language_of_user

log = logging.getLogger("furrowmap.cli")

CLEARED_LINE: Final = "\r\x1b[2K"
"""What removes a bar from a terminal."""
BAR_WIDTH: Final = 30


@dataclass(frozen=True)
class Console:
    """Where a command writes its result, as text or JSON, its progress and its warnings.

    With `quiet` only warnings and errors go to standard error; with `verbose` steps, without a progress bar.
    """

    as_json: bool = False
    quiet: bool = False
    verbose: bool = False

    def answer(self, value: object, words: str) -> None:
        """Write the result: `value` as JSON, or `words`."""
        if self.as_json:
            put_json(value)
        else:
            click.echo(words)

    def say(self, text: str) -> None:
        """Write a message during the work."""
        log.info(text)
        if not (self.quiet or self.verbose):
            click.echo(f"{CLEARED_LINE}{text}" if sys.stderr.isatty() else text, err=True)

    def warn(self, notice: Notice) -> None:
        """Write a warning."""
        self.put_warning(notice.code, notice.text_in(language_of_user()))

    def warn_all(self, notices: Iterable[Notice]) -> None:
        """Write warnings."""
        for notice in notices:
            self.warn(notice)

    def warn_of(self, account: Mapping[str, Any]) -> None:
        """Write the warnings in the report of finished work, each cause before what it explains."""
        for warning in account["warnings"]:
            text = warning.get(f"text_{language_of_user()}") or warning["text"]
            self.put_warning(warning["code"], text, explained=warning.get("follows") is not None)

    def put_warning(self, code: str, text: str, *, explained: bool = False) -> None:  # noqa: ARG002 (programs read the code)
        """Write the text of a warning; one that is explained by the warning before stands under that."""
        if explained:
            explains = Text("explains:").in_language(language_of_user())
            click.echo(f"  {explains} {printable(text)}", err=True)
        else:
            line = f"{Text('warning:').in_language(language_of_user())} {printable(text)}"
            click.secho(line, err=True, fg="yellow", color=colour())

    def reporting_compilation(self) -> AbstractContextManager[None]:
        """Within it, compilations are reported, and other processes help with them."""
        from furrowmap.warm_up import reporting_compilation  # it imports numba

        context = click.get_current_context(silent=True)
        return reporting_compilation(self.say, context.find_root().invoked_subcommand if context else None)

    @contextmanager
    def work(self, *, passing: bool = False, steps: Sequence[Step] = ()) -> Iterator[Progress]:
        """Show progress on a terminal: bars with stage, share and remaining time, removed at the end if `passing`.

        Steps that are known ahead are listed, and have one bar.
        """
        with self.reporting_compilation():
            if self.quiet or self.verbose or not sys.stderr.isatty():
                yield _stages_to_log()
            else:
                bar = _WholeBar(steps) if steps else _Bar(passing=passing)
                try:
                    yield bar.show
                    bar.end()
                except BaseException:
                    bar.leave()
                    raise


def _stages_to_log() -> Progress:
    seen: set[str] = set()

    def show(stage: str, share: float) -> None:  # noqa: ARG001 (the signature of Progress)
        INTERRUPTION.check()
        if stage not in seen:
            seen.add(stage)
            log.info(stage)

    return show


class _Bar:
    """A bar for the stage that runs, with its share and the remaining time; a stage ends when the next begins."""

    def __init__(self, *, passing: bool) -> None:
        self._passing = passing
        self._begun_s: dict[str, float] = {}
        self._percent = 0

    def show(self, stage: str, share: float) -> None:
        """Draw the progress of a stage."""
        INTERRUPTION.check()
        percent = min(int(100.0 * share), 100)
        if stage not in self._begun_s:
            log.info(stage)
            self.end()
            self._begun_s[stage] = time.monotonic()
            self._draw(percent)
        elif stage == next(reversed(self._begun_s)) and percent > self._percent:
            self._draw(percent)

    def end(self) -> None:
        """Draw the last stage as finished, or remove its bar."""
        if self._begun_s:
            self._draw(100)
            self.leave()

    def leave(self) -> None:
        """Leave the bar as it is, or remove it."""
        if self._begun_s:
            click.echo(CLEARED_LINE if self._passing else "", nl=not self._passing, err=True)

    def _draw(self, percent: int) -> None:
        self._percent = percent
        stage, begun_s = next(reversed(self._begun_s.items()))
        passed_s = time.monotonic() - begun_s
        seconds = round(passed_s * (100 - percent) / percent if 0 < percent < 100 else passed_s)
        clock = f"{seconds // 60}:{seconds % 60:02}" if percent else "-:--"
        _draw_bar(stage, percent, clock)


class _WholeBar:
    """One bar for steps that are known ahead, which it lists: the step that runs, the share of all, the time left."""

    def __init__(self, steps: Sequence[Step]) -> None:
        self._whole = WholeShare(steps)
        self._begun_s = time.monotonic()
        self._stage = ""
        self._percent = 0
        names = ", ".join(_step_words(step.name) for step in steps)
        click.echo(f"{Text('steps:').in_language(language_of_user())} {names}", err=True)

    def show(self, stage: str, share: float) -> None:
        """Take the progress of a stage, and draw that of all steps."""
        INTERRUPTION.check()
        if stage != self._stage:
            log.info(stage)
        percent = min(int(100.0 * self._whole.take(stage, share)), 99)
        if (stage, percent) != (self._stage, self._percent):
            self._stage = stage
            self._percent = percent
            self._draw()

    def end(self) -> None:
        """Draw all steps as finished."""
        self._percent = 100
        self._draw()
        self.leave()

    def leave(self) -> None:
        """Leave the bar as it is."""
        click.echo(err=True)

    def _draw(self) -> None:
        percent = self._percent
        passed_s = time.monotonic() - self._begun_s
        seconds = round(passed_s * (100 - percent) / percent if 0 < percent < 100 else passed_s)
        _draw_bar(_step_words(self._stage), percent, f"{seconds // 60}:{seconds % 60:02}" if percent else "-:--")


def _step_words(step: str) -> str:
    return texts_of(language_of_user()).get(step, step)


def _draw_bar(stage: str, percent: int, clock: str) -> None:
    drawn = "#" * (BAR_WIDTH * percent // 100)
    click.echo(f"{CLEARED_LINE}{stage} [{drawn:.<{BAR_WIDTH}}] {percent:3} % {clock}", nl=False, err=True)


def put_json(value: object) -> None:
    """Write `value` as JSON to standard output, in UTF-8 whatever the encoding of the terminal."""
    from furrowmap.core.runtime.json_text import json_text

    click.echo(json_text(value).encode(), nl=False)


def put_error(error: FurrowmapError) -> None:
    """Write `error` to standard error."""
    what, *rest = error.lines_in(language_of_user())
    click.secho(what, err=True, fg="red", color=colour())
    for line in rest:
        click.echo(line, err=True)


def error_value(error: FurrowmapError) -> dict[str, Any]:
    """`error` for JSON, in the language of the user."""
    what, meaning, remedy = error.lines_in(language_of_user())
    value = {"code": error.code, "what": what, "meaning": meaning, "remedy": remedy}
    return value if error.setting is None else {**value, "set": error.setting}


def colour() -> bool | None:
    """None: colour on terminals; False: the user wants none (https://no-color.org)."""
    return False if os.environ.get("NO_COLOR") else None
