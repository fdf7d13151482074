"""What a file is by its first bytes, to name it where another kind is expected."""

from typing import Final

SIGNATURES: Final = {
    b"# .PCD": "a PCD point cloud",
    b"LASF": "a LAS or LAZ point cloud",
    b"PK\x03\x04": "a zip archive",
    b"\x1f\x8b": "a gzip archive",
    b"\x28\xb5\x2f\xfd": "a Zstandard archive",
    b"SQLite format 3": "an SQLite database, such as a GeoPackage",
    b"PAR1": "a Parquet table",
    b"\xd0\xcf\x11\xe0": "an old Office document, such as .xls",
    b"\x89PNG": "a PNG picture",
    b"\xff\xd8\xff": "a JPEG picture",
    b"%PDF": "a PDF document",
    b"II*\x00": "a TIFF picture",
    b"MM\x00*": "a TIFF picture",
}
LOOKED_AT: Final = 4096
"""First bytes that tell text from binary data."""
_TEXT_CONTROLS: Final = b"\t\n\v\f\r\x1a"
_MOST_CONTROLS: Final = 0.02
"""Share of control characters from which content is no text in any encoding."""


def binary_kind(data: bytes) -> str | None:
    """What content is that is no text, such as "a PNG picture" or "binary data"; None for text in any encoding.

    It is told by the first :data:`LOOKED_AT` bytes.
    """
    named = next((words for start, words in SIGNATURES.items() if data.startswith(start)), None)
    if named is not None or data[:2] in (b"\xff\xfe", b"\xfe\xff"):  # the byte order marks of UTF-16
        return named
    data = data[:LOOKED_AT]
    controls = sum(byte < 32 and byte not in _TEXT_CONTROLS for byte in data)
    return "binary data" if b"\0" in data or controls > _MOST_CONTROLS * len(data) else None
