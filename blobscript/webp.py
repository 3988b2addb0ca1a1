"""A description inside a WebP file, which OpenImageIO's writer drops and its reader ignores.

A WebP file is a RIFF container: "RIFF", size, "WEBP", then chunks of a four-letter name, a length
(little endian) and the payload padded to an even length. A file with metadata is an extended
one: its first chunk is VP8X, with flags and the size of the canvas, and an "XMP " chunk stands
behind the pixels. Reference: Google, WebP Container Specification; RFC 9649, section 2.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from xml.sax.saxutils import escape, unescape

__all__ = ["description", "with_description"]

_XMP_FLAG, _ALPHA_FLAG = 0x04, 0x10
_BEFORE, _AFTER = '<rdf:li xml:lang="x-default">', "</rdf:li>"
_PACKET = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description rdf:about="" xmlns:dc="http://purl.org/dc/elements/1.1/"><dc:description><rdf:Alt>'
    f"{_BEFORE}%s{_AFTER}</rdf:Alt></dc:description></rdf:Description></rdf:RDF></x:xmpmeta>"
)


def with_description(data: bytes, text: str) -> bytes:
    """The same picture with `text` as its XMP dc:description."""
    chunks = [(name, payload) for name, payload in _chunks(data) if name != b"XMP "]
    if chunks[0][0] != b"VP8X":
        chunks.insert(0, (b"VP8X", _header(*chunks[0])))
    flags = chunks[0][1][0] | _XMP_FLAG
    chunks[0] = (b"VP8X", bytes([flags]) + chunks[0][1][1:])
    chunks.append((b"XMP ", (_PACKET % escape(text)).encode()))
    body = b"WEBP" + b"".join(_chunk(name, payload) for name, payload in chunks)
    return b"RIFF" + struct.pack("<I", len(body)) + body


def description(data: bytes) -> str:
    """What `with_description` put there; "" where nothing is."""
    packet = next((payload for name, payload in _chunks(data) if name == b"XMP "), b"").decode("utf-8", "replace")
    _, found, rest = packet.partition(_BEFORE)
    return unescape(rest.partition(_AFTER)[0]) if found else ""


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 12
    while at + 8 <= len(data):
        name, size = struct.unpack_from("<4sI", data, at)
        yield name, data[at + 8 : at + 8 + size]
        at += 8 + size + size % 2


def _chunk(name: bytes, payload: bytes) -> bytes:
    return name + struct.pack("<I", len(payload)) + payload + bytes(len(payload) % 2)


def _header(name: bytes, pixels: bytes) -> bytes:
    """The VP8X payload for a simple file, the size read from its one chunk of pixels."""
    if name == b"VP8L":  # signature byte, then 14 bits width - 1, 14 bits height - 1, 1 bit alpha
        (bits,) = struct.unpack_from("<I", pixels, 1)
        width, height, alpha = bits & 0x3FFF, bits >> 14 & 0x3FFF, bool(bits >> 28 & 1)
    else:  # VP8: a frame tag of 3 bytes, a start code of 3, then two 14-bit sizes
        width, height = ((size & 0x3FFF) - 1 for size in struct.unpack_from("<HH", pixels, 6))
        alpha = False
    flags = _ALPHA_FLAG if alpha else 0
    return struct.pack("<I", flags) + width.to_bytes(3, "little") + height.to_bytes(3, "little")
