"""All readers that are given damaged inputs. A new one joins by an entry in one of the lists."""

from __future__ import annotations

from tests.fuzz.images import IMAGES
from tests.fuzz.inertial import INERTIAL
from tests.fuzz.places import PLACES
from tests.fuzz.positions import POSITIONS
from tests.fuzz.products import PRODUCTS
from tests.fuzz.recordings import RECORDINGS
from tests.fuzz.texts import TEXTS
from tests.fuzz.trials import Entry

ENTRIES: dict[str, Entry] = {
    entry.name: entry for entry in (*RECORDINGS, *POSITIONS, *TEXTS, *PRODUCTS, *PLACES, *INERTIAL, *IMAGES)
}
