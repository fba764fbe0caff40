"""Radiance pictures (.hdr, RGBE) out: light of any range in four bytes a pixel (Ward, "Real Pixels", Graphics Gems II)."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array

_LEAST_WIDTH, _MOST_WIDTH = 8, 0x7FFF  # of rows that may be run-length coded
_RUN, _LITERAL = 127, 128  # bytes in one packet
_SHORTEST = 4  # a run that is worth its packet


def radiance_bytes(image: Array) -> bytes:
    """The bytes of a .hdr file of (h, w, 3) float32 linear light; what is negative becomes 0.

    The largest channel of a pixel is right to 1 part in 256, the others to the same absolute step.
    """
    height, width = image.shape[:2]
    rgbe = _rgbe(image)
    head = b"#?RADIANCE\nSOFTWARE=luxel\nFORMAT=32-bit_rle_rgbe\n\n" + f"-Y {height} +X {width}\n".encode()
    if not _LEAST_WIDTH <= width <= _MOST_WIDTH:
        return head + rgbe.tobytes()
    mark = bytes([2, 2, width >> 8, width & 255])
    rows = (mark + b"".join(_packed(row[:, component]) for component in range(4)) for row in rgbe)
    return head + b"".join(rows)


def _rgbe(image: Array) -> Array:
    """(h, w, 4) uint8: mantissas of one exponent, rounded to the nearest."""
    light = np.clip(np.nan_to_num(image[..., :3], nan=0.0, posinf=1e38), 0, 1e38).astype(np.float64)
    _, exponent = np.frexp(light.max(-1))
    exponent += np.rint(np.ldexp(light.max(-1), 8 - exponent)) > 255  # it rounds up to the next power
    mantissa = np.rint(np.ldexp(light, (8 - exponent)[..., None]))
    seen = (light.max(-1) > 0) & (exponent > -128)
    out = np.concatenate([mantissa, exponent[..., None] + 128], -1)
    return np.where(seen[..., None], out, 0).astype(np.uint8)


def _packed(values: Array) -> bytes:
    """One component of a row, (w,) uint8, in packets: a run has its length plus 128 before it, other bytes have their number."""
    starts = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    lengths = np.diff(starts, append=len(values))
    data, out, done = values.tobytes(), bytearray(), 0
    for start, length in zip(starts[lengths >= _SHORTEST].tolist(), lengths[lengths >= _SHORTEST].tolist(), strict=True):
        _literal(data, done, start, out)
        for left in range(length, 0, -_RUN):
            out += bytes([128 + min(left, _RUN), data[start]])
        done = start + length
    _literal(data, done, len(data), out)
    return bytes(out)


def _literal(data: bytes, start: int, end: int, out: bytearray) -> None:
    for place in range(start, end, _LITERAL):
        piece = data[place : min(place + _LITERAL, end)]
        out.append(len(piece))
        out += piece
