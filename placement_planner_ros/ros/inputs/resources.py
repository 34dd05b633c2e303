"""Files that users name: paths, file:// and package:// URIs, and the meshes behind them."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt
import trimesh
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

from placement_planner_ros.core.errors import ObjectError, RobotError
from placement_planner_ros.core.robot.geometry import package_names
from placement_planner_ros.core.types import Array
from placement_planner_ros.share import PACKAGE, share_path


def package_share(package: str) -> Path:
    """Share folder of an installed package.

    Raises:
        FileNotFoundError: the ament index does not know it.
    """
    if package == PACKAGE:
        return share_path("urdf").parent
    try:
        return Path(get_package_share_directory(package))
    except (PackageNotFoundError, ValueError, OSError) as error:
        # OSError: there is no ament index at all, as AMENT_PREFIX_PATH is not set.
        raise FileNotFoundError(
            f"package {package} is not in the ament index; source its workspace"
        ) from error


def resolve(uri: str) -> Path:
    """The file that a path, a file:// or a package:// URI names.

    Raises:
        FileNotFoundError: there is no such file or package.
    """
    if uri.startswith("package://"):
        package, _, inside = unquote(uri.removeprefix("package://")).partition("/")
        path = package_share(package) / inside
    else:
        path = Path(unquote(uri.removeprefix("file://"))).expanduser()
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    return path


def description_text(parameter: str, value: str) -> str:
    """XML text from XML text, a path or a URI.

    Raises:
        RobotError: the file cannot be read.
    """
    if value.lstrip().startswith("<"):
        return value
    try:
        return resolve(value).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RobotError(parameter, value, f"give XML text, a path or a URI: {error}") from error


def package_dirs(urdf: str) -> dict[str, Path]:
    """Share folder of every package that a URDF refers to and the index knows."""
    folders = {}
    for package in package_names(urdf):
        try:
            folders[package] = package_share(package)
        except FileNotFoundError:
            continue  # Robot.from_urdf names the mesh that needs it.
    return folders


def load_mesh(uri: str) -> tuple[Array, npt.NDArray[np.int64]]:
    """Vertices (n, 3) and triangles (t, 3) of a mesh file, in the file's unit.

    Raises:
        ObjectError: there is no such file, or it holds no triangles.
    """
    try:
        path = resolve(uri)
        mesh = trimesh.load(path, force="mesh")
    except (OSError, ValueError, NotImplementedError, IndexError, KeyError) as error:
        raise ObjectError("object.mesh", uri, f"cannot be read: {error}") from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise ObjectError("object.mesh", uri, "holds no triangles")
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
