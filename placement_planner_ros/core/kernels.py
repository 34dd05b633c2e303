"""Where numba keeps compiled kernels.

A kernel is a function under `numba.njit(cache=True, nogil=True)`. Numba compiles it for each kind
of arguments, and keeps that on disk; it notices a change of the file that holds the kernel, but not
of what the kernel calls from other files. So each program has numba keep kernels in a folder named
after the sources of all kernels, where and when they were written, and numba and llvmlite. Nothing
here imports numba, which looks once at where to keep them.

A number that is written out, or counted from, is of a kind of its own to numba: kernels hand on
`int(count)`, `int(np.int64(0))`, or what they call is compiled once more. So are arrays that are
written into others as a whole, `a[i] = b`: the error that their shapes may differ is put together
by more code than most kernels have.
"""

from __future__ import annotations

import atexit
import functools
import hashlib
import json
import os
import re
import shutil
import tempfile
from importlib.metadata import version
from pathlib import Path

from placement_planner_ros.core.disk_cache import TROUBLES, cache_folder

CORE = Path(__file__).parent
_KERNEL = re.compile(r"^@njit\((?!.*inline).*\)\ndef (\w+)", re.MULTILINE)
"""How a kernel begins that is not only written into others, and its name."""
_ALL_KEPT = "all_kept.json"
"""The file that is there once a folder has all kernels."""
SHAPING = re.compile(r"njit\(|NamedTuple\)|DefaultPassBuilder")
"""In files that have kernels, or what kernels take."""


@functools.cache
def kernel_sources() -> dict[Path, str]:
    """The text of each file with kernels, or with named tuples that kernels take."""
    # All that shapes how kernels are compiled.
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(CORE.rglob("*.py"))}
    return {path: text for path, text in texts.items() if SHAPING.search(text)}


def kernel_names() -> set[str]:
    """Each kernel as numba names its file: that of its source, a dot and its own."""
    texts = kernel_sources().items()
    return {f"{path.stem}.{name}" for path, text in texts for name in _KERNEL.findall(text)}


def kernel_folder() -> Path | None:
    """Where this state of all kernels belongs: below NUMBA_CACHE_DIR, or `cache_folder`; None where
    there is neither."""
    # Numba takes a kernel for another where its file lies elsewhere or was written anew.
    files = [(str(path), path.stat().st_mtime_ns, text) for path, text in kernel_sources().items()]
    # Kernels that look whether each index is within its array are others, too.
    checked = os.environ.get("NUMBA_BOUNDSCHECK", "")
    parts = (files, version("numba"), version("llvmlite"), checked)
    name = f"kernels-{hashlib.sha256(repr(parts).encode()).hexdigest()[:16]}"
    # A folder below the given one; the same in processes that this one begins.
    given = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(given) if given else cache_folder()
    return folder / name if folder is not None and folder.name != name else folder


def are_all_kept(folder: Path) -> bool:
    """Whether the folder has all kernels."""
    return (folder / _ALL_KEPT).is_file()


def note_all_kept(folder: Path) -> None:
    """Write down that the folder has all kernels, and how long its files are.

    Raises:
        OSError: it cannot be written.
    """
    sizes = {str(path.relative_to(folder)): path.stat().st_size for path in folder.glob("*/*.nb?")}
    with tempfile.NamedTemporaryFile("w", dir=folder, delete=False) as aside:
        json.dump(sizes, aside)
    os.replace(aside.name, folder / _ALL_KEPT)


def _has_lost_content(folder: Path) -> bool:
    """Whether a file is gone, or shorter than it was; those that others add do not matter."""
    if not are_all_kept(folder):
        return False
    try:
        sizes = json.loads((folder / _ALL_KEPT).read_bytes())
        return any((folder / name).stat().st_size < size for name, size in sizes.items())
    except (ValueError, FileNotFoundError):
        return True


def use_kernel_folder() -> None:
    """Have numba keep kernels in that folder, in this process and those that it begins.

    For programs, before anything imports numba. Where the folder has lost content, as after a power
    cut, it is emptied. Where it cannot be written kernels are kept for as long as the program runs,
    and what is in there is used.
    """
    folder = kernel_folder()
    try:
        if folder is None:
            raise OSError("there is no home folder")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        if _has_lost_content(folder):
            words = f"compiled kernels in {folder} are damaged: they are removed and made anew"
            TROUBLES.note("damaged", words)
            shutil.rmtree(folder)
            folder.mkdir()
    except OSError as error:
        TROUBLES.note(
            "unwritten",
            f"kernels cannot be kept in {folder}: {error.strerror or error}; each start compiles "
            "what is missing there until NUMBA_CACHE_DIR or XDG_CACHE_HOME names a folder that can "
            "be written",
        )
        aside = tempfile.mkdtemp(prefix="kernels-")
        atexit.register(shutil.rmtree, aside, ignore_errors=True)
        os.environ["NUMBA_CACHE_DIR"] = aside
        unwritten, folder = folder, kernel_folder()
        if unwritten is not None and unwritten.is_dir():
            shutil.copytree(unwritten, str(folder))
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
