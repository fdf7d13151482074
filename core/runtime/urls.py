"""URLs as they are shown and stored: without passwords."""

import re
from typing import Final

_PASSWORD: Final = re.compile(r"((?<=\w\w):/{1,2}[^\s/?#:@]*):(?!\d*(?:[/?#\s]|$))[^\s@]*@(?:[^\s/?#@]*@)*")
"""From the colon after a user's name to the last @ before the path; digits alone before the path are a port.

A URL that was taken for a path has one slash.
"""
_PARAMETER: Final = re.compile(r"(?i)([?&][\w-]*(?:password|passwd|secret|token|signature|sig)=)[^\s&#]*")


def without_passwords(text: str) -> str:
    """A text whose URLs have no passwords: neither ``user:password@`` nor secret parameters such as ``?token=…``."""
    if ":/" not in text:
        return text
    return _PARAMETER.sub(r"\1", _PASSWORD.sub(r"\1@", text))
