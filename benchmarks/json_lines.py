"""Files of JSON lines that survive being cut off in the middle of a line, and told ones."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
"""The checkout."""


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


def replace_lines(path: Path, entries: Iterable[dict[str, Any]]) -> None:
    """Write a file of just these."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = (json.dumps(entry) + "\n" for entry in entries)
    path.write_text("".join(lines), encoding="utf-8")


def lines_told_by(*command: str) -> Iterator[dict[str, Any]]:
    """The JSON lines that a Python command prints, as they come; it knows the checkout's tests.

    Raises:
        RuntimeError: it failed; with the last line that it wrote of that.
    """
    known = filter(None, [str(ROOT), str(ROOT / "test"), os.environ.get("PYTHONPATH")])
    with tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(
            [sys.executable, *command],
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(known)},
        )
        assert process.stdout is not None
        with process:
            for line in process.stdout:
                if line.startswith("{"):
                    yield json.loads(line)
        if process.returncode != 0:
            errors.seek(0)
            raise RuntimeError((errors.read().strip() or "no answer").splitlines()[-1])
