"""Every text that a template of a message can be, for who explains a code without the values of one case."""

from collections.abc import Iterator, Mapping
from itertools import product

from furrowmap.core.runtime.languages.templates import Choice, Hole, Part, parts_of, walk


def expansions(english: str, other: str) -> Iterator[tuple[str, str]]:
    """Every text that a template can be, with … for its values, and the other language's with {1}, {2}, … for them.

    Of choices by a number only the plural.
    """
    ours = parts_of(english)
    theirs = parts_of(other)
    choices = sorted({part.name for part in walk(ours) if isinstance(part, Choice) and not part.by_number})
    for picked in product((True, False), repeat=len(choices)):
        pick = dict(zip(choices, picked, strict=True))
        text = ""
        number = 0
        numbers: dict[int, list[str]] = {}
        for part in _chosen(ours, pick):
            if isinstance(part, str):
                text += part
            elif text.endswith("…"):
                numbers.setdefault(number, []).append(part.name)
            else:
                number += 1
                numbers[number] = [part.name]
                text += "…"
        target = "".join(part if isinstance(part, str) else "\0" + part.name + "\0" for part in _chosen(theirs, pick))
        for k, names in numbers.items():
            target = target.replace("".join(f"\0{name}\0" for name in names), f"{{{k}}}")
        yield " ".join(text.split()), target


def _chosen(parts: tuple[Part, ...], pick: Mapping[str, bool]) -> Iterator[str | Hole]:
    for part in parts:
        if isinstance(part, Choice):
            yield from _chosen(part.yes if not part.by_number and pick[part.name] else part.no, pick)
        else:
            yield part
