"""Extension of griffe for the API pages: fields that describe an option show their default, not how they are made."""

from __future__ import annotations

from dataclasses import MISSING
from importlib import import_module
from typing import Any

import griffe

from furrowmap.core.runtime.options import OPTION_KEY


class SettingDefaults(griffe.Extension):
    """Replaces the values of fields that are made by `setting`."""

    def on_attribute_instance(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Take the default from the class itself."""
        if attr.module.name not in ("settings", "cleaning_steps", "plot_grid") or not attr.parent.is_class:
            return
        field = getattr(import_module(attr.module.path), attr.parent.name).__dataclass_fields__.get(attr.name)
        if field is not None and OPTION_KEY in field.metadata:
            attr.value = None if field.default is MISSING else repr(field.default)
