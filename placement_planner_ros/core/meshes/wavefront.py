"""The vertices that faces of an .obj file name, checked and counted from the file's start."""

from __future__ import annotations


def absolute_faces(data: bytes) -> bytes:
    """The file with faces that name vertices by their number from the start.

    Negative numbers count back from the face's own line; the loader counts them back from the end
    of the file, and so takes other vertices where several parts follow each other.

    Raises:
        ValueError: a face names a vertex that is not there; the message says which, and its line.
    """
    lines = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()
    count = sum(line.lstrip()[:2] in (b"v ", b"v\t") for line in lines)
    before, relative = 0, False
    for row, line in enumerate(lines):
        words = line.split()
        if words[:1] == [b"v"]:
            before += 1
        elif words[:1] == [b"f"]:
            named = [_number(word, row, count, before) for word in words[1:]]
            if b"-" in line:
                relative = True
                lines[row] = b"f " + b" ".join(b"%d" % each for each in named)
    return b"\n".join(lines) + b"\n" if relative else data


def _number(word: bytes, row: int, count: int, before: int) -> int:
    """The vertex that a word of a face names, from 1.

    Args:
        count: vertices of the file.
        before: those before the face.
    """
    try:
        given = int(word.split(b"/")[0])
    except ValueError:
        name = word.decode(errors="replace")[:40]
        raise ValueError(f"line {row + 1}: {name} is no vertex of a face") from None
    number = before + 1 + given if given < 0 else given
    if not 1 <= number <= count:
        raise ValueError(
            f"line {row + 1}: a face has vertex {given}; the file has {count} vertices, counted "
            "from 1"
        )
    return number
