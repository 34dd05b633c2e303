"""Files of JSON lines that survive being cut off in the middle of a line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Every complete line; nothing where there is no file. A torn last line is left out.

    Raises:
        json.JSONDecodeError: a line other than the last is damaged.
    """
    if not path.exists():
        return []
    lines = path.read_text(encoding="utf-8").split("\n")
    return [json.loads(line) for line in lines[:-1] if line]


def append_line(path: Path, entry: dict[str, Any]) -> None:
    """Write one line to the end, after cutting off a torn one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+b") as file:
        end = file.tell()
        file.seek(0)
        content = file.read()
        if end and not content.endswith(b"\n"):
            file.truncate(content.rfind(b"\n") + 1)
        file.write((json.dumps(entry) + "\n").encode())
