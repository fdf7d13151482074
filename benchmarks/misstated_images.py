"""What a run makes of images whose table `[camera]` is wrong: it says so and goes on without them, or is right.

    python benchmarks/misstated_images.py SESSION [FIRST LAST]

The session has [camera], an IMU, and truth/trajectory.csv beside it. Its images FIRST to LAST are used.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from time import process_time

import msgspec
import numpy as np
from image_adjustment import errors

from furrowmap.core.pipeline.session_aid import aid_session
from furrowmap.core.pipeline.solution import companions, ground_scale
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import silent
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.trajectory.located import locate
from furrowmap.core.values.images import Images
from furrowmap.core.values.session import CameraSource


def wrong(camera: CameraSource) -> dict[str, CameraSource]:
    """Ways to state a camera wrongly."""
    assert camera.fx is not None
    assert camera.fy is not None
    roll, pitch, yaw = camera.rpy_deg
    change = msgspec.structs.replace
    return {
        "as stated": camera,
        "times 1 s late": change(camera, minus_gnss_s=-1.0),
        "focal length + 10 %": change(camera, fx=1.1 * camera.fx, fy=1.1 * camera.fy),
        "yaw with the other sign": change(camera, rpy_deg=(roll, pitch, -yaw)),
        "focal length + 2 %": change(camera, fx=1.02 * camera.fx, fy=1.02 * camera.fy),
        "roll 180 deg off": change(camera, rpy_deg=(roll - 180.0, pitch, yaw)),
    }


class Chosen(OpenSession):
    """A session with some of its images."""

    span = slice(None)

    def images(self) -> tuple[Images, list[Notice]]:
        """As :meth:`OpenSession.images`, fewer."""
        whole, notices = super().images()
        return whole.chosen(np.arange(len(whole))[self.span]), notices


def main(session: Path, first: int | None, last: int | None) -> None:
    """Adjust and print."""
    Chosen.span = slice(first, last)
    stated = open_session(session)
    located = locate(stated.positions(), stated.session, stated.frame, companions(stated))
    truth = session.parent / "truth" / "trajectory.csv"
    print("without images:", errors(located.trajectory, truth), flush=True)
    scale = ground_scale(stated.frame, located.trajectory)
    assert stated.session.camera is not None
    for name, camera in wrong(stated.session.camera).items():
        changed = msgspec.structs.replace(stated.session, camera=camera)
        opened = Chosen(stated.file, changed, stated.inputs, stated.frame)
        begin = process_time()
        aided = aid_session(opened, replace(located), scale, silent)
        aid = aided.aid
        print(f"{name}: {'used' if aid is not None else 'not used'}, {process_time() - begin:.0f} s of the processor")
        for notice in aided.notices:
            print("   ", notice.code, notice.text)
        if aid is not None:
            print("   ", errors(aided.located.trajectory, truth), np.round(aid.adjusted.tension, 2), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *(int(text) for text in sys.argv[2:4] or (0, 10_000)))
