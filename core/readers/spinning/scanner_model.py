"""What the decoder of a spinning scanner knows of a maker, his models, their data packets, and a sensor's own angles.

The latter are in a calibration file beside the recording, in Hesai's format: after a heading a line for each channel
with its number, elevation and azimuth in degrees; newer files begin with a line of "EEFF" and end with a hash.
`PandarView` and the sensor's web page export it.
"""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.file_names import found_beside
from furrowmap.core.runtime.plain_reads import read_plain_text

_LARGEST_BYTES: Final = 1 << 16
_APART_DEG: Final = 1.0
"""Elevations that differ more from those of the model are another model's: sensors of a model differ by 0.1."""


@dataclass(frozen=True)
class AngleTable:
    """Angles (n,) of each channel in the order of the packet, azimuths relative to that of the block."""

    path: Path
    elevation_deg: FloatArray
    azimuth_deg: FloatArray

    @classmethod
    def parsed(cls, path: Path) -> Self | None:
        """The angles in a file.

        None if it is no calibration; InputError if channels are damaged, missing or repeated.
        """
        if path.stat().st_size > _LARGEST_BYTES:
            return None
        lines = read_plain_text(path, errors="replace").lower().lstrip("\ufeff").splitlines()
        heading = next((i for i, line in enumerate(lines[:3]) if "elevation" in line and "azimuth" in line), None)
        if heading is None:
            return None
        rows = [line.split(",") for line in lines[heading + 1 :] if line.count(",") >= 2]
        try:
            table = np.array([[float(cell) for cell in row[:3]] for row in rows]).reshape(-1, 3)
        except ValueError:
            table = np.empty((0, 3))
        whole = np.array_equal(table[:, 0], np.arange(1, len(table) + 1)) and np.abs(table[:, 1:]).max(initial=0) < 90
        if not len(table) or not whole:
            raise InputError("angles-damaged", path=path)
        return cls(path, table[:, 1].copy(), table[:, 2].copy())

    @classmethod
    def beside(cls, paths: Sequence[Path]) -> Self | None:
        """The calibration in the folder of a recording, or in the folder that is a recording; None if there is none.

        InputError if there are several, or it is damaged.
        """
        folder = paths[0] if paths[0].is_dir() else paths[0].parent
        found = [table for path in found_beside(folder, "*.[cC][sS][vV]") if (table := cls.parsed(path)) is not None]
        own = [table for table in found if table.path.stem == paths[0].stem]
        if len(own or found) > 1:
            names = ", ".join(table.path.name for table in found)
            raise InputError("angles-ambiguous", folder=folder, names=names, recording=paths[0].name)
        return next(iter(own or found), None)

    def applied(self, model: "Model") -> "Model":
        """The model with these angles; InputError if they are those of another model."""
        lasers = len(self.elevation_deg)
        same = len(self.elevation_deg) == model.lasers
        apart_deg = float(np.abs(self.elevation_deg - model.elevation_deg).max()) if same else 0.0
        if not same or apart_deg > _APART_DEG:
            raise InputError(
                "angles-of-other-model",
                path=self.path,
                lasers=lasers,
                model=model.name,
                own=model.lasers,
                same=same,
                apart=apart_deg,
            )
        return replace(model, elevation_deg=self.elevation_deg, azimuth_deg=self.azimuth_deg)


ByteArray = NDArray[np.uint8]

MAX_RETURNS: Final = 3
"""Returns of a firing that a packet has, at most."""
RATE_TOLERANCE: Final = 0.02
"""By how much the interval of packets may differ from that of the model."""


@dataclass(frozen=True)
class PacketLayout:
    """Where a data packet has what: offsets in bytes from the start of the payload.

    A packet has blocks of the same length; a block has the azimuth of the rotor (hundredths of a degree) and returns:
    distance (two bytes), intensity (one), and bytes that are skipped. If firings have several returns, as many blocks
    in a row have the same azimuth. Numbers are little-endian.

    Attributes:
        signature: offset → byte, of all its packets.
        header: where the first block begins.
        azimuth: where a block has its azimuth, from the start of the block; its returns follow.
        marked: whether a block begins with the bytes FF EE.
        mode: where the return mode is.
        stamp: where the microseconds of the stamp are.
        date: where year, month, day, hour, minute and second of the stamp are, a byte each, or after a 0 the
            seconds since 1970 (big-endian); None if the stamp counts from the hour.
        product: where the model is; None if the signature is that of a model.
        distance_mm: where the unit of distances is, in millimetres; None if the model determines it.
    """

    lengths: tuple[int, ...]
    signature: Mapping[int, int]
    blocks: int
    header: int
    unit: int
    units: int
    mode: int
    stamp: int
    azimuth: int = 0
    marked: bool = False
    date: int | None = None
    product: int | None = None
    distance_mm: int | None = None

    @property
    def block(self) -> int:
        """Length of a block."""
        return self.azimuth + 2 + self.unit * self.units

    def stamp_us(self, data: ByteArray, offset: IntArray) -> NDArray[np.uint32]:
        """(m,) stamps of packets at `offset` (m,) in microseconds of the hour."""
        stamp: NDArray[np.uint32] = data[offset[:, None] + np.arange(self.stamp, self.stamp + 4)].view("<u4")[:, 0]
        if self.date is None:
            return stamp
        date = data[offset[:, None] + np.arange(self.date, self.date + 6)]
        clock_s = date[:, 4].astype(np.int64) * 60 + date[:, 5]
        epoch_s = np.ascontiguousarray(date[:, 2:]).view(">u4")[:, 0].astype(np.int64)
        past_hour_s = np.where(date[:, 0] == 0, epoch_s, clock_s) % 3600
        past_hour_us: NDArray[np.uint32] = (past_hour_s * 1_000_000 + stamp % 1_000_000).astype(np.uint32)
        return past_hour_us


class ModelTables(NamedTuple):
    """A model as the kernel takes it that decodes packets: numbers of its layout and of its own, and tables.

    Attributes:
        azimuths: (3,) number of azimuths in a packet, if firings have one, two and three returns.
        stride: (3,) bytes from one to the next.
        first_return: (3, n) where the first return of each laser is, from the start of the block.
        first_firing_s: (3,) start of the first firing sequence relative to the stamp.
        lasers: (n, 5) firing time, azimuth (rad), cosine and sine of the elevation, and height of each laser.
        order: (n,) rank of each laser by elevation.
    """

    header: int
    azimuth: int
    block: int
    unit: int
    blocks: int
    marked: bool
    firings_per_block: int
    cycle_s: float
    resolution_m: float
    azimuths: IntArray
    stride: IntArray
    first_return: IntArray
    first_firing_s: FloatArray
    lasers: FloatArray
    order: ByteArray


@dataclass(frozen=True)
class Model:
    """A sensor's geometry and timing.

    Attributes:
        product: how its packets state the model.
        cycle_s: time between the firing sequences, in which all lasers fire once.
        laser_s: (n,) firing time of each laser in the sequence, in the order of the packet. The azimuth of the block is
            that at 0.
        elevation_deg: (n,) of each laser, in the same order.
        azimuth_deg: (n,) azimuth of each laser relative to that of the block.
        height_m: (n,) height of each beam's origin on the vertical axis above the sensor's origin.
        start_s: start of the packet's first firing sequence, relative to the packet's stamp; of its last one if
            `stamp_at_last`.
        slowest_s: cycle of the slowest firmware, if that differs: the interval of packets shows which it is. 0 if not.
    """

    name: str
    product: int
    layout: PacketLayout
    resolution_m: float
    cycle_s: float
    laser_s: FloatArray
    elevation_deg: FloatArray
    azimuth_deg: FloatArray
    height_m: FloatArray
    start_s: float = 0.0
    stamp_at_last: bool = False
    slowest_s: float = 0.0

    @property
    def lasers(self) -> int:
        """Number of lasers."""
        return len(self.elevation_deg)

    @property
    def firings_per_block(self) -> int:
        """Firing sequences in a block, at least 1."""
        return max(1, self.layout.units // self.lasers)

    @property
    def blocks_per_firing(self) -> int:
        """Blocks that a firing sequence takes with one return, at least 1."""
        return max(1, self.lasers // self.layout.units)

    def groups(self, returns: int) -> int:
        """Azimuths in a packet whose firings have so many returns: blocks that are left over are empty."""
        return self.layout.blocks // (self.blocks_per_firing * returns)

    def packet_s(self, returns: int) -> float:
        """Time from one packet to the next if firings have so many returns."""
        return self.groups(returns) * self.firings_per_block * self.cycle_s

    def as_fired(self, packet_s: float, returns: int) -> "Model":
        """The model with the cycle of packets that follow each other by `packet_s`, if that is one of its own."""
        cycle_s = self.cycle_s * packet_s / self.packet_s(returns)
        if not (1.0 - RATE_TOLERANCE) * self.cycle_s < cycle_s < (1.0 + RATE_TOLERANCE) * self.slowest_s:
            return self
        return replace(self, cycle_s=cycle_s, laser_s=self.laser_s * (cycle_s / self.cycle_s))

    @cached_property
    def laser_order(self) -> ByteArray:
        """(n,) rank of each laser by elevation."""
        order = np.empty(self.lasers, np.uint8)
        order[np.argsort(self.elevation_deg, kind="stable")] = np.arange(self.lasers, dtype=np.uint8)
        return order

    @cached_property
    def tables(self) -> ModelTables:
        """What the decoder's kernel takes."""
        layout = self.layout
        laser = np.arange(self.lasers, dtype=np.int64)
        returns = range(1, MAX_RETURNS + 1)
        at = [laser // layout.units * layout.block * r + laser % layout.units * layout.unit for r in returns]
        before_s = [self.packet_s(r) - self.cycle_s if self.stamp_at_last else 0.0 for r in returns]
        elevation = np.radians(self.elevation_deg)
        azimuth = np.radians(self.azimuth_deg)
        columns = [self.laser_s, azimuth, np.cos(elevation), np.sin(elevation), self.height_m]
        return ModelTables(
            *(layout.header, layout.azimuth, layout.block, layout.unit, layout.blocks, layout.marked),
            *(self.firings_per_block, self.cycle_s, self.resolution_m),
            azimuths=np.array([self.groups(r) for r in returns], np.int64),
            stride=np.array([layout.block * self.blocks_per_firing * r for r in returns], np.int64),
            first_return=layout.azimuth + 2 + np.stack(at),
            first_firing_s=self.start_s - np.array(before_s),
            lasers=np.ascontiguousarray(np.stack(columns, axis=1)),
            order=self.laser_order,
        )


@dataclass(frozen=True)
class Maker:
    """The models of a maker.

    Attributes:
        modes: return mode byte → number of returns of a firing, and name.
        others: product → name, of models that cannot be decoded.
        other_names: further name of a model → its name.
        other_packets: signature (see `PacketLayout`) → product, of packets of models that cannot be decoded.
        calibrated: whether each sensor has angles of its own, in a file.
    """

    name: str
    models: tuple[Model, ...]
    modes: Mapping[int, tuple[int, str]]
    others: Mapping[int, str]
    other_names: Mapping[str, str] = field(default_factory=dict)
    other_packets: tuple[tuple[Mapping[int, int], int], ...] = ()
    calibrated: bool = False

    def products(self, data: ByteArray, offset: IntArray, length: IntArray) -> IntArray:
        """(m,) products of datagrams at `offset` (m,) of `length` (m,) bytes; -1 of those that are no data packets."""
        products = np.full(len(offset), -1, np.int64)
        for signature, product in self.other_packets:
            products[_signed(data, offset, length, signature)] = product
        for model in self.models:
            layout = model.layout
            mine = (length[:, None] == layout.lengths).any(axis=1)
            mine[mine] = _signed(data, offset[mine], length[mine], layout.signature)
            products[mine] = model.product if layout.product is None else data[offset[mine] + layout.product]
        return products

    def returns(self, data: ByteArray, offset: IntArray, model: Model) -> ByteArray:
        """(m,) returns of the firings of packets.

        Two in unknown modes if the first two blocks have the same azimuth.
        """
        number = np.zeros(256, np.uint8)
        for mode, (returns, _) in self.modes.items():
            number[mode] = returns
        found = number[data[offset + model.layout.mode]]
        at = offset + model.layout.header + model.layout.azimuth
        further = model.layout.block * model.blocks_per_firing
        twice = (data[at] == data[at + further]) & (data[at + 1] == data[at + further + 1])
        return np.where(found > 0, found, 1 + twice).astype(np.uint8)

    def layout_of(self, product: int) -> PacketLayout:
        """The layout of packets with this product; InputError if these cannot be decoded."""
        if any(product == other for _, other in self.other_packets):
            self.model_of(product)
        return next((m.layout for m in self.models if m.product == product), self.models[0].layout)

    def differently_packed(self, layout: PacketLayout) -> list[int]:
        """Products of packets with another layout."""
        return [m.product for m in self.models if m.layout is not layout] + [other for _, other in self.other_packets]

    def mode_name(self, mode: int) -> str:
        """Name of a return mode."""
        return self.modes[mode][1] if mode in self.modes else f"unknown (0x{mode:02x})"

    def named(self, name: str) -> Model:
        """The model with this name, ignoring case and punctuation; InputError if it is not supported."""
        by_name = {self._plain(model.name): model for model in self.models}
        by_name.update({self._plain(other): by_name[self._plain(to)] for other, to in self.other_names.items()})
        found = by_name.get(self._plain(name))
        if found is None:
            near = difflib.get_close_matches(self._plain(name), by_name, 1)
            raise InputError(
                "unknown-model", name=name, models=self.model_names, by_name=by_name[near[0]].name if near else None
            )
        return found

    def model_of(self, product: int, where: str = "") -> Model:
        """The model with this product; InputError if it is not supported."""
        for model in self.models:
            if model.product == product:
                return model
        stated = {"where": where or None, "product": product, "models": self.model_names}
        if product in self.others:
            raise InputError("unsupported-model", model=f"{self.name} {self.others[product]}", **stated)
        raise InputError("model-unknown", **stated)

    @property
    def model_names(self) -> str:
        """Names of the models, for messages."""
        return ", ".join(model.name for model in self.models)

    def _plain(self, name: str) -> str:
        return "".join(c for c in name.casefold() if c.isalnum()).removeprefix(self.name.casefold())


def _signed(data: ByteArray, offset: IntArray, length: IntArray, signature: Mapping[int, int]) -> NDArray[np.bool_]:
    """Which datagrams have these bytes."""
    signed: NDArray[np.bool_] = length > max(signature)
    for at, byte in signature.items():
        signed[signed] = data[offset[signed] + at] == byte
    return signed
