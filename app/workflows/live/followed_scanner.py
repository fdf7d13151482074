"""Which of several scanners a live session follows."""

import math
from dataclasses import replace

import msgspec

from furrowmap.core.session.opened import OpenSession, ToolInputs
from furrowmap.core.values.session import Implement, Lidar


def with_followed_scanner(opened: OpenSession) -> OpenSession:
    """The session with one scanner, which live follows: of several the nearest to the implement, which it observes.

    Without an implement it is the first. What an earlier session learned of an implement is as the first scanner sees
    it; with another scanner it is learned again.
    """
    session = opened.session
    if not session.further_lidars:
        return opened
    lidars = session.lidars
    implement = session.implement
    number = 0
    if implement is not None:
        number = min(range(len(lidars)), key=lambda k: _apart_m(lidars[k], implement))
    followed = lidars[number]
    minus_gnss_s = followed.minus_gnss_s or 0.0
    recording = msgspec.structs.replace(session.recording, lidar=followed.files, lidar_minus_gnss_s=minus_gnss_s)
    session = msgspec.structs.replace(session, recording=recording, lidar=followed, further_lidars=())
    inputs = opened.inputs
    files = (inputs.lidar, *inputs.further_lidars)[number]
    tools = inputs.tools if number == 0 else tuple(ToolInputs(tool.states) for tool in inputs.tools)
    return replace(opened, session=session, inputs=replace(inputs, lidar=files, further_lidars=(), tools=tools))


def _apart_m(lidar: Lidar, implement: Implement) -> float:
    """Between a scanner and the middle of the tool's line, in the horizontal plane."""
    x_m, y_m, _ = lidar.mounting.xyz_m
    return math.hypot(x_m - implement.xy_m[0], y_m - implement.xy_m[1])
