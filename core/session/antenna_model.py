"""The lever arm of an antenna whose reference point was measured, by the calibration of its model."""

from pathlib import Path
from typing import Final

import msgspec

from furrowmap.core.readers.antex import antenna_model
from furrowmap.core.values.session import Session

IONOSPHERE_FREE: Final = "ionosphere-free"


def with_phase_centre(session: Session, antex: Path | None) -> Session:
    """The session with the phase centre of its antenna as the lever arm; unchanged without a model.

    Only the offset upwards is used: how the mark of an antenna is turned in the vehicle is not known, and the others
    are a millimetre or two.

    Raises:
        InputError: if the file is no ANTEX, or has no such antenna.
    """
    antenna = session.antenna
    if antenna is None or antenna.model is None or antex is None:
        return session
    up_m = antenna_model(antex, antenna.model).phase_centre_m(ionosphere_free=antenna.phase == IONOSPHERE_FREE)[2]
    x, y, z = antenna.xyz_m
    place = (x, y, round(z + float(up_m), 5))
    return msgspec.structs.replace(
        session, antenna=msgspec.structs.replace(antenna, xyz_m=place, model=None, antex=None)
    )
