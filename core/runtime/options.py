"""Settings that describe themselves as options of a command.

The command line, the parameters in QGIS and the reference are made from the descriptions. Imports nothing but the
standard library, so that the help of a command takes no time.
"""

import inspect
import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Any, Final

OPTION_KEY: Final = "option"
_ATTRIBUTE: Final = re.compile(r"^    (\w+): (.+(?:\n {8}.+)*)", re.MULTILINE)


@dataclass(frozen=True)
class Option:
    """An option of a command.

    Attributes:
        name: on the command line, such as ``--cell``.
        metavar: stands for the value in the help and implies its type (`VALUE_TYPES` in `cli/command_options.py`); ""
            for a flag and for choices.
        help: in the help of the command, in the reference and in QGIS.
        label: in QGIS, without the unit; "" for the words of the name.
        default: of the value.
        choices: of the value; a mapping has what each sets, the default first.
        minimum, above, maximum: limits of a number; `above` is an exclusive minimum.
    """

    name: str
    metavar: str = ""
    help: str = ""
    label: str = ""
    default: object = None
    choices: Sequence[str] | Mapping[str, object] = ()
    minimum: float | None = None
    above: float | None = None
    maximum: float | None = None
    required: bool = False
    multiple: bool = False


def setting(name: str, metavar: str = "", *, default: Any = None, **facts: Any) -> Any:
    """A field of a dataclass of settings that an option of a command sets.

    `facts` are other attributes of :class:`Option`. The help of the option is the entry of the field in the docstring
    of the class, under "Attributes".
    """
    choices = facts.get("choices")
    shown = next(iter(choices)) if isinstance(choices, Mapping) else None if default is MISSING else default
    option = Option(name, metavar, default=shown, **facts)
    return field(default=default, metadata={OPTION_KEY: option})


def options_of(settings: type) -> dict[str, Option]:
    """Field → option of each field of a dataclass that is made by :func:`setting`."""
    texts = dict(_ATTRIBUTE.findall(inspect.cleandoc(settings.__doc__ or "")))
    options = {each.name: each.metadata[OPTION_KEY] for each in fields(settings) if OPTION_KEY in each.metadata}
    return {
        name: replace(option, help=" ".join((option.help or texts[name]).split())) for name, option in options.items()
    }
