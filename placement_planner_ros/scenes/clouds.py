"""Point clouds of a scene: its complete surface, or what depth cameras see of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.types import Array
from placement_planner_ros.scenes.primitives import COPLANAR_M, ConvexPrimitive
from placement_planner_ros.scenes.scenes import Scene


def complete_cloud(
    scene: Scene, spacing: float = 0.005, bounds: tuple[Array, Array] | None = None
) -> Array:
    """Points on the whole surface of the union of the scene's parts, the same at every call.

    Exact corner and edge points included. Points inside a part, or on a face that another part
    is pressed against (the deck beneath a standing box), are not on that surface and left out.

    Args:
        spacing: largest distance between neighbouring points along each face's axes, metres.
        bounds: (3,) corners; only points within are returned.

    Returns:
        (n, 3) points in the world frame.

    Raises:
        ParameterError: `spacing` is not a positive number.
    """
    if not (np.isfinite(spacing) and spacing > 0):
        raise ParameterError("spacing", spacing, "give a positive distance in metres")
    kept = []
    for part in scene.parts:
        # what is pressed against a face takes it off the surface
        others = [other for other in scene.parts if other is not part and _are_near(part, other)]
        for face in range(len(part.normals)):
            points = _polygon_points(part.polygon(face), part.normals[face], spacing)
            if bounds is not None:
                points = points[((points >= bounds[0]) & (points <= bounds[1])).all(axis=1)]
            # a point of the surface is outside of all others once moved outwards
            moved = points + 2.0 * COPLANAR_M * part.normals[face]
            covered = np.zeros(len(points), dtype=bool)
            for other in others:
                covered |= other.depth(moved) > COPLANAR_M
            kept.append(points[~covered])
    cloud = np.vstack(kept)
    # edges belong to two faces
    _, first = np.unique(np.round(cloud, 9), axis=0, return_index=True)
    return np.asarray(cloud[np.sort(first)])


def _are_near(a: ConvexPrimitive, b: ConvexPrimitive) -> bool:
    # between the upright boxes around both, axis by axis
    gap = np.maximum(
        a.vertices.min(axis=0) - b.vertices.max(axis=0),
        b.vertices.min(axis=0) - a.vertices.max(axis=0),
    )
    return bool(gap.max() <= 2.0 * COPLANAR_M)


def _interval_count(length: float, spacing: float) -> int:
    """Least number of equal steps no longer than `spacing`."""
    return int(np.ceil(length / spacing - 1e-9))


def _polygon_points(corners: Array, normal: Array, spacing: float) -> Array:
    """A lattice along the longest edge over a convex polygon, its corners and edges included."""
    # axes in the plane, along the longest edge
    following = np.roll(corners, -1, axis=0)
    lengths = np.linalg.norm(following - corners, axis=1)
    u = ((following - corners) / lengths[:, None])[np.argmax(lengths)]
    axes = np.column_stack([u, np.cross(normal, u)])
    flat = (corners - corners[0]) @ axes
    low, high = flat.min(axis=0), flat.max(axis=0)
    ticks = [
        np.linspace(low[i], high[i], _interval_count(high[i] - low[i], spacing) + 1)
        for i in range(2)
    ]
    lattice = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    edges = np.roll(flat, -1, axis=0) - flat
    relative = lattice[:, None] - flat
    # of each edge with the way from its first corner to each point
    cross = edges[:, 0] * relative[..., 1] - edges[:, 1] * relative[..., 0]
    # inside is to the left of every edge
    inner = lattice[(cross > COPLANAR_M * np.linalg.norm(edges, axis=1)).all(axis=1)]
    # and evenly along the edges, corners included
    rim = [
        a + np.linspace(0, 1, _interval_count(length, spacing) + 1)[:-1, None] * (b - a)
        for a, b, length in zip(corners, following, lengths, strict=True)
    ]
    return np.vstack([*rim, corners[0] + inner @ axes.T])


@dataclass(frozen=True, slots=True, eq=False)
class DepthCamera:
    """A pinhole depth camera.

    Attributes:
        name: name of its optical frame.
        T_world_camera: pose of the optical frame (z along the view, x right, y down in the image).
        width, height: pixels.
        focal_length: pixels, the same in both directions; the principal point is the centre.
    """

    name: str
    T_world_camera: pin.SE3
    width: int = 640
    height: int = 480
    focal_length: float = 340.0

    @classmethod
    def looking_at(cls, name: str, position: npt.ArrayLike, target: npt.ArrayLike) -> DepthCamera:
        """A camera at `position` that has `target` in the middle and the world's z upwards."""
        # z forward, x to the right, y down
        forward = np.subtract(target, position).astype(np.float64)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.column_stack([right, np.cross(forward, right), forward])
        return cls(name, pin.SE3(rotation, np.array(position, dtype=np.float64)))

    def project(self, points: Array) -> Array:
        """World points (..., 3) as column, row and depth; that of a pixel's middle is whole."""
        T = self.T_world_camera.inverse()
        seen = points @ T.rotation.T + T.translation
        # perspective: divided by the depth
        middle = np.array([self.width - 1, self.height - 1]) / 2
        seen[..., :2] = seen[..., :2] / seen[..., 2:] * self.focal_length + middle
        return np.asarray(seen)


@dataclass(frozen=True, slots=True, eq=False)
class CameraCloud:
    """An organised cloud as a depth camera delivers it.

    Attributes:
        camera: where it was taken from.
        points: (height, width, 3) float32 in the camera's optical frame, metres; NaN where
            nothing was seen.
    """

    camera: DepthCamera
    points: npt.NDArray[np.float32]

    def world_points(self) -> Array:
        """(n, 3) finite points in the world frame."""
        flat = self.points.reshape(-1, 3).astype(np.float64)
        flat = flat[np.isfinite(flat).all(axis=1)]
        T = self.camera.T_world_camera
        return np.asarray(flat @ T.rotation.T + T.translation)


@dataclass(frozen=True, slots=True)
class CameraNoise:
    """What a depth camera adds to the truth.

    Attributes:
        range_deviation: standard deviation along each ray, metres.
        flying_share: share of the pixels on a depth discontinuity that land between its sides.
        discontinuity: depth step between neighbouring pixels that counts as one, metres.
        stray_share: share of all pixels that land nearer on their ray than what they see, by up to
            `stray_length` metres.
        depth_step: between depths that are told apart at 1 m, metres; it grows with the square of
            the depth, as that of cameras which measure disparity. 0 for none.
    """

    range_deviation: float = 0.002
    flying_share: float = 0.05
    discontinuity: float = 0.03
    stray_share: float = 0.0
    stray_length: float = 0.15
    depth_step: float = 0.0


def scene_cameras(scene: Scene) -> tuple[DepthCamera, DepthCamera]:
    """Two cameras above the robot's left and right shoulder, looking at the middle of V.

    They look under the cabinet's top, whose front edge hides the upper part of its back wall.
    """
    target = (scene.volume.lower + scene.volume.upper) / 2
    return (
        DepthCamera.looking_at("camera_left_optical_frame", (0.0, 0.35, 0.65), target),
        DepthCamera.looking_at("camera_right_optical_frame", (0.0, -0.35, 0.65), target),
    )


def camera_clouds(
    scene: Scene,
    rng: np.random.Generator,
    *,
    extra: Sequence[ConvexPrimitive] = (),
    cameras: Sequence[DepthCamera] | None = None,
    noise: CameraNoise | None = None,
) -> tuple[CameraCloud, ...]:
    """What depth cameras see of a scene: occlusion, range noise, NaN and flying pixels.

    Args:
        extra: further solids in view, in the world frame: the robot, the object in its hand.
        cameras: `scene_cameras` unless given.
        noise: `CameraNoise()` unless given.
    """
    noise = CameraNoise() if noise is None else noise
    cameras = scene_cameras(scene) if cameras is None else cameras
    parts = [*scene.parts, *extra]
    return tuple(_camera_cloud(camera, parts, noise, rng) for camera in cameras)


def _camera_cloud(
    camera: DepthCamera,
    parts: Sequence[ConvexPrimitive],
    noise: CameraNoise,
    rng: np.random.Generator,
) -> CameraCloud:
    f, cx, cy = camera.focal_length, (camera.width - 1) / 2, (camera.height - 1) / 2
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    # through the middle of each pixel, at depth 1
    rays = np.stack([(u - cx) / f, (v - cy) / f, np.ones_like(u, dtype=np.float64)], axis=-1)
    depth = np.full((camera.height, camera.width), np.inf)
    # of all solids on a ray the nearest remains
    for part in parts:
        _cast_rays(part, camera, rays, depth)

    seen_depth = _with_flying_pixels(depth, noise, rng)
    # a ray that meets nothing delivers no point
    seen_depth[~np.isfinite(seen_depth)] = np.nan
    # noise is along the ray
    error = rng.normal(0.0, noise.range_deviation, depth.shape) if noise.range_deviation else 0.0
    scaled = seen_depth + error / np.linalg.norm(rays, axis=-1)
    if noise.stray_share:
        stray = rng.random(depth.shape) < noise.stray_share
        scaled[stray] -= rng.random(int(stray.sum())) * noise.stray_length
    if noise.depth_step:  # depths are 1 / disparity, whose steps are equal
        scaled = 1.0 / (np.round(1.0 / scaled / noise.depth_step) * noise.depth_step)
    return CameraCloud(camera, (rays * scaled[..., None]).astype(np.float32))


def _cast_rays(part: ConvexPrimitive, camera: DepthCamera, rays: Array, depth: Array) -> None:
    """Lower `depth` (height, width) to where each pixel's ray (height, width, 3) enters a solid."""
    T_camera_world = camera.T_world_camera.inverse()
    window = _window(camera.project(part.vertices), camera)
    # the planes of the solid in the frame of the camera
    normals = part.normals @ T_camera_world.rotation.T
    offsets = part.offsets + normals @ T_camera_world.translation
    along = rays[window] @ normals.T + 0.0  # no negative zeros
    with np.errstate(divide="ignore", invalid="ignore"):
        crossed = offsets / along
    # a ray is inside from the last plane that it enters through to the first that it leaves by
    enter = np.where(along < 0.0, crossed, 0.0).max(axis=-1)
    leave = np.where(along < 0.0, np.inf, crossed).min(axis=-1)
    seen = (enter < leave) & (enter < depth[window])
    depth[window][seen] = enter[seen]


def _window(corners: Array, camera: DepthCamera) -> tuple[slice, slice]:
    """Rows and columns in which a solid with such projected corners (n, 3) can be."""
    # what reaches behind the camera may be anywhere in the image
    if (corners[:, 2] <= 0.0).any():
        return slice(0, camera.height), slice(0, camera.width)
    size, pixels = (camera.width, camera.height), corners[:, :2]
    low = np.clip(np.floor(pixels.min(axis=0)), 0, size).astype(int)
    high = np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, size).astype(int)
    return slice(low[1], high[1]), slice(low[0], high[0])


def _with_flying_pixels(depth: Array, noise: CameraNoise, rng: np.random.Generator) -> Array:
    result = depth.copy()
    for axis in (0, 1):
        ahead = np.roll(depth, -1, axis=axis)
        with np.errstate(invalid="ignore"):
            step = ahead - depth
        # where neighbouring pixels see different things
        edge = np.isfinite(step) & (np.abs(step) > noise.discontinuity)
        # the last row, or column, has no neighbour: np.roll took it from the other side
        edge[(-1, slice(None)) if axis == 0 else (slice(None), -1)] = False
        flying = edge & (rng.random(depth.shape) < noise.flying_share)
        # anywhere between the two sides
        result[flying] += rng.random(int(flying.sum())) * step[flying]
    return result
