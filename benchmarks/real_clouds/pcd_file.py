"""Reads point clouds from PCD files: ascii, binary, and binary compressed by LZF."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.types import Array

_COORDINATES = ("x", "y", "z")


def read_pcd(path: Path) -> Array:
    """(n, 3) the points, metres, in the sensor's frame; NaN where nothing was measured.

    Raises:
        ParameterError: it is no PCD file, or lacks coordinates or data.
    """
    content = path.read_bytes()
    header, data = _read_header(path, content)
    names = header["FIELDS"]
    if not set(_COORDINATES) <= set(names):
        raise ParameterError("cloud", str(path), f"has the fields {names}: x, y and z are needed")
    counts = [int(count) for count in header.get("COUNT", ["1"] * len(names))]
    kinds = {"F": "f", "I": "i", "U": "u"}
    sizes, types = header["SIZE"], header["TYPE"]
    record = np.dtype(
        [
            (f"{name}_{number}", f"<{kinds[kind]}{size}", (count,))
            for number, (name, kind, size, count) in enumerate(
                zip(names, types, sizes, counts, strict=True)
            )
        ]
    )
    wanted = [f"{name}_{names.index(name)}" for name in _COORDINATES]
    number = int(header["POINTS"][0])
    how = header["DATA"][0]
    if how == "ascii":
        words = data.split()[: number * sum(counts)]
        _require_whole(path, len(words), number * sum(counts))
        rows = np.array(words, dtype=np.float64).reshape(number, -1)
        first = np.cumsum([0, *counts])
        return rows[:, [first[names.index(name)] for name in _COORDINATES]]
    if how == "binary":
        _require_whole(path, len(data), number * record.itemsize)
        points = np.frombuffer(data[: number * record.itemsize], record)
    elif how == "binary_compressed":
        packed, whole = np.frombuffer(data[:8], "<u4").tolist()
        try:
            data = _lzf_unpacked(data[8 : 8 + packed], whole)
        except (IndexError, ValueError) as error:
            raise ParameterError("cloud", str(path), f"its data are damaged: {error}") from error
        _require_whole(path, len(data), number * record.itemsize)
        points, at = np.empty(number, record), 0
        for name in record.names or ():  # field after field, not point after point
            column = points[name]
            column[:] = np.frombuffer(data, column.dtype, column.size, at).reshape(column.shape)
            at += column.nbytes
    else:
        raise ParameterError("cloud", str(path), f"its data are {how}, which is of no known kind")
    return np.column_stack([points[name][:, 0] for name in wanted]).astype(np.float64)


def _require_whole(path: Path, found: int, needed: int) -> None:
    if found < needed:
        raise ParameterError("cloud", str(path), "its data end too early")


def _read_header(path: Path, content: bytes) -> tuple[Mapping[str, list[str]], bytes]:
    """Its lines by their first words, and what follows them."""
    found: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in found:
        end = content.find(b"\n", at)
        if end < 0 or end - at > 10_000:
            raise ParameterError("cloud", str(path), "is no PCD file: it has no line DATA")
        words = content[at:end].decode("ascii", "replace").split()
        if words and not words[0].startswith("#"):
            found[words[0]] = words[1:]
        at = end + 1
    if missing := {"FIELDS", "SIZE", "TYPE", "POINTS"} - set(found):
        raise ParameterError("cloud", str(path), f"its header lacks {', '.join(sorted(missing))}")
    return found, content[at:]


def _lzf_unpacked(packed: bytes, size: int) -> bytes:
    """LZF: runs of bytes as they are, and repeats of what came up to 8 kB before."""
    out = bytearray()
    at = 0
    while at < len(packed):
        control = packed[at]
        at += 1
        if control < 32:
            out += packed[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += packed[at]
            at += 1
        back = ((control & 31) << 8) + packed[at] + 1
        at += 1
        length += 2
        if back >= length:
            out += out[-back : len(out) - back + length]
        else:  # it repeats itself
            piece = bytes(out[-back:])
            out += (piece * (length // back + 1))[:length]
    if len(out) != size:
        raise ValueError(f"LZF gave {len(out)} bytes, {size} were promised")
    return bytes(out)
