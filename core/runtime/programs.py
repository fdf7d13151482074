"""Programs of others that are installed on this machine."""

import os
import shutil
from pathlib import Path


def program_on_path(name: str) -> str | None:
    """The path of a program in one of the folders of PATH; None if it is in none of them.

    Never one of the current folder, which may be a stranger's: Windows looks there first, and so does an empty or
    relative entry of PATH.
    """
    for folder in os.get_exec_path():
        found = shutil.which(name, path=folder) if Path(folder).is_absolute() else None
        if found is not None and Path(found).is_absolute():
            return found
    return None
