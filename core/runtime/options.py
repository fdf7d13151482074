"""Settings that describe themselves as options of a command.

The command line, the parameters in QGIS and the reference are made from the descriptions. Imports nothing that takes
time, because the help of a command is made from them, too.
"""

import inspect
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Any, Final

from furrowmap.core.runtime.errors import OptionError
from furrowmap.core.runtime.languages.texts import Text

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


@dataclass(frozen=True)
class OptionSettings:
    """Base of settings: values keep to the choices and limits of their options, whoever makes them.

    Raises:
        OptionError: if one does not.
    """

    def __post_init__(self) -> None:
        for each in fields(self):
            option = each.metadata.get(OPTION_KEY)
            if option is not None:
                value = getattr(self, each.name)
                for one in value if option.multiple and value is not None else [value]:
                    _expect(option, one)


def _expect(option: Option, value: object) -> None:
    """OptionError for a value that is neither None nor the default and that the option does not take."""
    if value is None or value == option.default:
        return
    choices = tuple(option.choices.values() if isinstance(option.choices, Mapping) else option.choices)
    if choices and value not in choices:
        raise OptionError(option.name, value, Text("one of {choices:or}", choices=choices), str(choices[0]))
    number: Any = value
    if isinstance(value, float) and not math.isfinite(value):
        raise OptionError(option.name, value, Text("a finite number"), f"{option.maximum or option.minimum or 1.0:g}")
    if option.minimum is not None and not number >= option.minimum:
        raise OptionError(option.name, value, Text("{least:g} or more", least=option.minimum), f"{option.minimum:g}")
    if option.above is not None and not number > option.above:
        wanted = Text("more than {least:g}", least=option.above)
        raise OptionError(option.name, value, wanted, f"{option.above + 1.0:g}")
    if option.maximum is not None and not number <= option.maximum:
        raise OptionError(option.name, value, Text("{most:g} or less", most=option.maximum), f"{option.maximum:g}")
