"""Phase centres of GNSS antennas, from calibrations in ANTEX 1.4 (Rothacher and Schmid 2010), such as igs20.atx.

Receivers measure to the phase centre, people to the antenna reference point (ARP): the middle of the bottom of the
mount. A calibration states where the mean phase centre of each frequency lies: north and east of the mark on the
antenna, and above the ARP.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.runtime.plain_reads import open_plain, read_plain_bytes

L1: Final = "G01"
L2: Final = "G02"
L1_HZ: Final = 1575.42e6
L2_HZ: Final = 1227.60e6
MAX_OFFSET_MM: Final = 1000.0
"""No antenna is larger."""
MAX_LINE: Final = 200
"""Characters; the standard has 80, and tables of phase variations some more."""
_WITHOUT_RADOME: Final = "NONE"


@dataclass(frozen=True)
class AntennaModel:
    """A calibration.

    Attributes:
        name: type and radome, with one blank between.
        offset_m: (3,) north, east and up of the mean phase centre against the ARP, by frequency such as "G01".
    """

    name: str
    offset_m: Mapping[str, FloatArray]

    def phase_centre_m(self, *, ionosphere_free: bool) -> FloatArray:
        """(3,) north, east, up of the phase centre that positions are of.

        Args:
            ionosphere_free: of the combination of L1 and L2 without the ionosphere, as in PPP; else their mean, as in
                RTK over short baselines.
        """
        first = self.offset_m[L1]
        second = self.offset_m.get(L2, first)
        share = L1_HZ**2 / (L1_HZ**2 - L2_HZ**2) if ionosphere_free else 0.5
        return share * first + (1.0 - share) * second


def antenna_model(path: Path, name: str) -> AntennaModel:
    """The calibration of an antenna by its name in the IGS's list, such as "TRM57971.00 NONE".

    Without a radome in the name it is that without one.

    Raises:
        InputError: if the file is no ANTEX, has no such antenna, or none with this radome.
    """
    wanted = _with_radome(name)
    radomes = []
    number = 0
    try:
        with open_plain(path) as file:
            lines = _lines(path, iter(lambda: file.readline(MAX_LINE + 2), b""))
            if not next(lines, ("", ""))[1].startswith("ANTEX VERSION"):
                raise _unreadable(path, Text("it has no line ANTEX VERSION / SYST"))
            for text, label in lines:
                number += label == "START OF ANTENNA"
                if label != "TYPE / SERIAL NO":
                    continue
                found = _with_radome(text[:20])
                if found == wanted:
                    return AntennaModel(wanted, _offsets(path, found, lines))
                if wanted and found.split()[:1] == wanted.split()[:1]:
                    radomes.append(found)
    except OSError as error:
        raise _unreadable(path, reason(error)) from None
    raise InputError("antenna-model-unknown", path=path, name=name, number=number, radomes=radomes)


def copy_antex(path: Path, target: Path) -> None:
    """Copy calibrations to where another program reads them. Raises InputError if they cannot be read."""
    try:
        target.write_bytes(read_plain_bytes(path))
    except OSError as error:
        raise _unreadable(path, reason(error)) from None


def _with_radome(name: str) -> str:
    """Type and radome with one blank between; empty for an empty name."""
    words = name.upper().split()
    return " ".join(words if len(words) != 1 else [*words, _WITHOUT_RADOME])


def _lines(path: Path, raw: Iterator[bytes]) -> Iterator[tuple[str, str]]:
    """Each line's 60 columns of content, and its label."""
    for line in raw:
        if len(line) > MAX_LINE:
            raise _unreadable(path, Text("it has a line of more than {most} characters", most=MAX_LINE))
        text = line.decode("latin-1").rstrip("\r\n")
        yield text[:60], text[60:].strip()


def _offsets(path: Path, name: str, lines: Iterator[tuple[str, str]]) -> dict[str, FloatArray]:
    """Offsets of the frequencies up to the end of the antenna."""
    found: dict[str, FloatArray] = {}
    frequency = ""
    for text, label in lines:
        if label == "START OF FREQUENCY":
            frequency = text[3:6].strip()
        elif label == "NORTH / EAST / UP":
            try:
                values = np.array([float(text[k : k + 10]) for k in (0, 10, 20)])
            except ValueError:
                values = np.full(3, np.nan)
            if not (np.abs(values) <= MAX_OFFSET_MM).all():
                raise _unreadable(path, Text("the offsets of {name} are no millimetres of an antenna", name=name))
            found[frequency] = 1e-3 * values
        elif label == "END OF ANTENNA":
            break
    if L1 not in found:
        raise _unreadable(path, Text("{name} has no offsets of {frequency}", name=name, frequency=L1))
    return found


def _unreadable(path: Path, why: Words) -> InputError:
    return InputError("antex-unreadable", path=path, why=why)
