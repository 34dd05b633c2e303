"""Runs pip for `make`, and says how far it is: `install_with_progress.py LOG WORDS COMMAND...`.

pip with --quiet says nothing for minutes, without it hundreds of lines, and nothing either while it
unpacks. This needs the standard library alone, since nothing is installed yet.
"""

from __future__ import annotations

import contextlib
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

LOOK = 0.5
"""Seconds between looks."""
PAUSE = 15.0
"""Seconds between lines where the output is no terminal."""
TAIL = 15
"""Lines of pip's that are shown where it failed."""

REMEDIES = (
    (r"No space left on device", "make room on the disk: some 2 GB are needed (TMPDIR, too)"),
    (
        r"NewConnectionError|name resolution|ConnectTimeout|ReadTimeout|ProxyError|Max retries",
        "PyPI is not reached: look at the network, or name a mirror or proxy in PIP_INDEX_URL or "
        "HTTPS_PROXY, and run make again; what was fetched is kept",
    ),
    (
        r"No matching distribution|not a supported wheel|requires a different Python",
        "a package has no wheel for this Python or machine: x86-64 and Python 3.11 or 3.12 are "
        "needed (make PYTHON=python3.12 ..., after make clean)",
    ),
    (r"Permission denied", "the folder of the virtual environment must be yours to write"),
    (r"Killed|MemoryError", "there was too little memory; end other programs and try again"),
)
"""What pip says where it fails, and what to try."""


class Pip:
    """What pip has said so far.

    Args:
        log: file that pip's output goes to.
    """

    def __init__(self, log: Path) -> None:
        self._log = log
        self._collected: set[str] = set()
        self._wanted: list[str] = []
        self._unpacked = 0
        self._doing = "looks what there is to do"

    def hear(self, line: str) -> None:
        """One line of pip's."""
        words = line.split()
        if not words:
            return
        if words[0] == "Collecting" or line.startswith("Requirement already satisfied: "):
            self._collected.add(words[-1])
            self._doing = "finds out what is needed"
        elif words[0] == "Downloading":
            size = re.search(r"\(([\d.]+ ?[kMG]?B)\)", line)
            name = words[1].rsplit("/", 1)[-1].split("-")[0]
            self._doing = f"fetches {name}" + (f", {size[1]}" if size else "")
        elif words[0] == "Building":
            self._doing = "builds " + " ".join(words[1:])
        elif line.startswith("Installing collected packages:"):
            self._wanted = [name.strip(",") for name in words[3:]]

    def progress(self, installed: int) -> str:
        """How far it is, where `installed` packages are there that were not before."""
        if self._wanted:
            # One that takes the place of another is not one more in the end.
            self._unpacked = max(self._unpacked, min(installed, len(self._wanted)))
            return f"unpacks: {self._unpacked} of {_packages(len(self._wanted))}"
        count = f"; {_packages(len(self._collected))} so far" if self._collected else ""
        return f"{self._doing}{count}"

    def remedy(self) -> str:
        """What to try where it failed."""
        text = self._log.read_text(errors="replace")
        return next(
            (words for pattern, words in REMEDIES if re.search(pattern, text)),
            f"read {self._log}, mend what it names, and run make again",
        )

    def tail(self) -> str:
        """The end of what it said."""
        lines = [line for line in self._log.read_text(errors="replace").splitlines() if line]
        return "\n".join(f"    {line}" for line in lines[-TAIL:])


def main(arguments: list[str]) -> int:
    """Run it; its exit code."""
    log, words, command = Path(arguments[0]), arguments[1], arguments[2:]
    print(words, flush=True)
    # As an exception, so that pip is ended too.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    pip, began = Pip(log), time.monotonic()
    before = _installed(command[0])
    try:
        code = _run(pip, command, log, began, before)
    except KeyboardInterrupt:
        print("\ninterrupted; run make again to go on", file=sys.stderr)
        return 130
    except OSError as error:
        print(f"{error}; run make clean and try again", file=sys.stderr)
        return 1
    seconds = time.monotonic() - began
    if code == 0:
        _show(f"  done after {seconds:.0f} s", last=True)
        return 0
    _show(f"  pip failed after {seconds:.0f} s, with code {code}; its last words:", last=True)
    print(f"{pip.tail()}\nwhat to try: {pip.remedy()}", file=sys.stderr)
    return 1


def _run(pip: Pip, command: list[str], log: Path, began: float, before: int) -> int:
    with log.open("w", encoding="utf-8") as file:
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
        )
        reader = threading.Thread(target=_read, args=(process, pip, file))
        reader.start()
        said = time.monotonic()
        try:
            while process.poll() is None:
                time.sleep(LOOK)
                new = _installed(command[0]) - before
                line = f"  {time.monotonic() - began:4.0f} s  {pip.progress(new)}"
                if sys.stdout.isatty():
                    _show(line)
                elif time.monotonic() > said + PAUSE:
                    said = time.monotonic()
                    _show(line, last=True)
        finally:
            if process.poll() is None:
                process.terminate()
            process.wait()
            reader.join()
    return process.returncode


def _read(process: subprocess.Popen[str], pip: Pip, file) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        with contextlib.suppress(OSError):  # no room; pip says so itself
            file.write(line)
            file.flush()
        pip.hear(line)


def _packages(number: int) -> str:
    return "1 package" if number == 1 else f"{number} packages"


def _installed(python: str) -> int:
    """How many packages are there."""
    return sum(1 for _ in Path(python).parent.parent.glob("lib/python*/site-packages/*.dist-info"))


def _show(line: str, last: bool = False) -> None:
    if sys.stdout.isatty():
        width = shutil.get_terminal_size().columns - 1
        print(f"\r\033[K{line[:width]}", end="\n" if last else "", flush=True)
    else:
        print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
