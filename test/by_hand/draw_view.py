"""Take the pictures of docs/view.md: real searches, and their pages in a headless Chromium.

python test/by_hand draw_view --output docs/images
"""

from __future__ import annotations

import argparse
import io
import os
import tempfile
import time
from pathlib import Path

from PIL import Image

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

import rclpy
from helpers.browser import Browser

from placement_planner_ros.client import PlacementClient
from placement_planner_ros.demo.command import published
from placement_planner_ros.demo.processes import node_arguments, node_running, page_served
from placement_planner_ros.demo.setting import bundled
from placement_planner_ros.ros.process import begin_ros

SECONDS = 8.0
SIZE = (1280, 830)
FRAMES = 14
"""That a browser without a graphics card draws until all has faded in."""
PLAYED = 0.9
"""Share of the way there at which the motion is shown."""


def main() -> None:
    """Write view_table.png, view_playing.png and view_cabinet.png."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("docs/images"))
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    for scene, thing, names in (
        ("table", "wine_glass", ("view_table", "view_playing")),
        ("cabinet_high_clutter", "small_crayons_box", ("view_cabinet",)),
    ):
        for name, picture in zip(names, pictures(scene, thing, len(names) > 1), strict=True):
            image = Image.open(io.BytesIO(picture)).convert("RGB")
            image.save(folder / f"{name}.png", optimize=True)
            print(folder / f"{name}.png", flush=True)


def pictures(scene: str, thing: str, play: bool) -> list[bytes]:
    """The page after a search, and as it plays."""
    setting = bundled(scene, thing)
    namespace = f"/pictures_{os.getpid()}"
    begin_ros(["draw_view", "--ros-args", "-r", f"__ns:={namespace}", "--log-level", "warn"])
    with tempfile.TemporaryDirectory() as temporary:
        logs = Path(temporary)
        (logs / "profile").mkdir()
        arguments = node_arguments(setting.file, {**setting.parameters, "seed": 1})
        with (
            node_running(namespace, arguments, logs / "node.log"),
            published(setting),
            page_served(namespace, logs / "view.log") as address,
        ):
            with PlacementClient(planner=f"{namespace}/placement_planner") as planner:
                planner.wait_until_ready(900.0)
                run = planner.start({"time_limit": 0.0}, patience=60.0)
                while planner.improvement(run) is None:
                    time.sleep(0.2)
                time.sleep(SECONDS)
                best = planner.stop(run)
            with Browser(logs / "profile", *SIZE) as browser:
                browser.open(address)
                browser.wait_for(f"Placement {best.number}", "It can be carried out", timeout=120.0)
                taken = [shown(browser)]
                if play:
                    last = best.trajectory.points[-1].time_from_start
                    seconds = PLAYED * (last.sec + 1e-9 * last.nanosec)
                    browser.fill("0", f"{seconds:.2f}")
                    browser.wait_for("now: approach", timeout=60.0)
                    taken.append(shown(browser))
    rclpy.try_shutdown()
    return taken


def shown(browser: Browser) -> bytes:
    """The page once it has faded in, without the browser's remark on its graphics."""
    browser.run(
        "window.frames_drawn = 0; (function count() {window.frames_drawn++;"
        "requestAnimationFrame(count)})(); true"
    )
    while browser.run("window.frames_drawn") < FRAMES:
        time.sleep(0.5)
    browser.run(
        "[...document.querySelectorAll('.mantine-Notification-root')].forEach(e => e.remove())"
    )
    return browser.picture()


if __name__ == "__main__":
    main()
