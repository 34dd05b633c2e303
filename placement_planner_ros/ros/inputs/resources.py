"""Files that users name: paths, file:// and package:// URIs, and who may name which.

What the operator gives at start-up is read anywhere. What comes later, from whoever is on the
graph, is read only below the folders that the operator named, or that the ament index knows;
outside of them nothing is looked at, so that no answer depends on what is there.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote

import pinocchio as pin
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.share import PACKAGE, share_path

_NAME = re.compile(r"[A-Za-z0-9_][\w.-]*", re.ASCII)
_PIP_SHARE = Path(pin.__file__).parents[4] / "share"
"""Where pip puts what robots' makers and pinocchio share, as PyPI's example-robot-data."""
_PACKAGES = (
    "; write package://PACKAGE/PATH, and add the folder that holds PACKAGE to package_paths, or "
    "source its workspace"
)
_ELSEWHERE = (
    "is not below package_paths, file_roots or the ament index; only what is given at start-up may "
    "be elsewhere"
)


def package_share(package: str) -> Path:
    """Share folder of an installed package.

    Raises:
        FileNotFoundError: the ament index does not know it.
    """
    # this package may run from a checkout, which no index knows
    if package == PACKAGE:
        return share_path("urdf").parent
    try:
        return Path(get_package_share_directory(package))
    except (PackageNotFoundError, ValueError, OSError) as error:
        # OSError: there is no ament index at all, as AMENT_PREFIX_PATH is not set.
        folder = _PIP_SHARE / package
        if _NAME.fullmatch(package) and _exists(folder, Path.is_dir):
            return folder
        raise FileNotFoundError(
            f"package {package} is not in the ament index; source its workspace"
        ) from error


class Files:
    """Finds the files that users name.

    Args:
        package_paths: folders that hold packages, or are one.
        file_roots: folders from which files may be read later; relative ones count from where the
            node runs.
    """

    def __init__(self, package_paths: Sequence[str] = (), file_roots: Sequence[str] = ()) -> None:
        self.package_paths = tuple(_expanded(folder).absolute() for folder in package_paths)
        self.file_roots = tuple(_expanded(folder).absolute() for folder in file_roots)

    def find(self, uri: str, *, trusted: bool, beside: Path | None = None) -> Path:
        """The file that a path, a file:// or a package:// URI names.

        Args:
            trusted: whether the operator named it, or what the operator gave does.
            beside: the file that names it, from which relative paths count.

        Raises:
            FileNotFoundError: there is no such file, or nobody may name it.
        """
        if "\0" in uri:
            raise FileNotFoundError("no file's name holds a zero byte")
        candidates = list(self._candidates(uri, trusted, beside))
        # of files that are not open, not even whether they exist is told
        may = [path for path in candidates if trusted or self._is_open(path)]
        for path in may:
            if _exists(path, Path.is_file):
                return path
        scheme, found, _ = uri.partition("://")
        if found and scheme not in ("file", "package"):
            words = "is not read; use package://PACKAGE/PATH, file:///PATH or a path"
        else:
            words = "names no package that is known" if trusted else _ELSEWHERE
            if may:
                words = f"there is no file {' nor '.join(dict.fromkeys(map(str, may)))}"
            words += _PACKAGES if scheme == "package" else ""
        raise FileNotFoundError(words)

    def _candidates(self, uri: str, trusted: bool, beside: Path | None) -> Iterator[Path]:
        if uri.startswith("package://"):
            package, _, inside = unquote(uri.removeprefix("package://")).partition("/")
            if _NAME.fullmatch(package):
                for folder in self._package_folders(package, beside):
                    yield folder / inside.lstrip("/")
            return
        path = _expanded(unquote(uri.removeprefix("file://")))
        # relative ones: beside the file that names them, where the node runs, or in open folders
        if path.is_absolute():
            yield path
        elif beside is not None:
            yield beside.parent / path
        elif trusted:
            yield Path.cwd() / path
        else:
            for folder in (*self.file_roots, *self.package_paths):
                yield folder / path

    def _package_folders(self, package: str, beside: Path | None) -> Iterator[Path]:
        for folder in self.package_paths:
            yield folder / package
            if folder.name == package:
                yield folder
        # then what is installed
        with contextlib.suppress(FileNotFoundError):
            yield package_share(package)
        # then the folders above the file that names it, as in a source tree
        for folder in () if beside is None else beside.absolute().parents:
            if folder.name == package:
                yield folder
            yield folder / package

    def _is_open(self, path: Path) -> bool:
        """Whether anybody may name it; looks at no file outside of the folders that are open."""
        plain = Path(os.path.normpath(path))
        # Packages may be installed as links to where they are built from.
        prefixes = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
        installed = [*(Path(prefix, "share") for prefix in prefixes), share_path("urdf")]
        if ".." not in path.parts and any(plain.is_relative_to(root) for root in installed):
            return True
        roots = [*self.package_paths, *self.file_roots]
        real_roots = [Path(os.path.realpath(root)) for root in roots]
        # by its name first, so that no file elsewhere is looked at
        if not any(plain.is_relative_to(root) for root in [*roots, *real_roots]):
            return False
        # a link must lead to below one of the folders, too
        real = Path(os.path.realpath(path))
        return any(real.is_relative_to(root) for root in real_roots)


def _expanded(path: str) -> Path:
    """With ~ for the home folder; another user's is nobody's business."""
    return Path(os.path.expanduser(path) if path == "~" or path.startswith("~/") else path)


def _exists(path: Path, is_there: Callable[[Path], bool]) -> bool:
    try:
        return is_there(path)
    except OSError:  # a name too long, a folder that may not be entered
        return False


def description_text(parameter: str, value: str, files: Files) -> tuple[str, Path | None]:
    """XML text from XML text, a path or a URI given at start-up; and the file it is in.

    Raises:
        RobotError: the file cannot be read.
    """
    if value.lstrip().startswith("<"):
        return _expanded_xml(parameter, value, "the text"), None
    try:
        path = files.find(value, trusted=True)
        return _expanded_xml(parameter, path.read_text(encoding="utf-8"), str(path)), path
    except (OSError, UnicodeDecodeError) as error:
        raise RobotError(parameter, value, f"give XML text, a path or a URI: {error}") from error


def _expanded_xml(parameter: str, text: str, where: str) -> str:
    # comments of a plain URDF may mention xacro
    if "<xacro:" in re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL):
        raise RobotError(
            parameter, where, "is xacro; give what `ros2 run xacro xacro FILE` makes of it"
        )
    return text
