"""Child processes import the same package, whatever the current folder holds."""

import os
import subprocess
import sys
from pathlib import Path

import placement_planner_ros
from placement_planner_ros.core.child_process import child_environment


def test_a_checkout_that_is_the_current_folder_is_not_taken_for_what_is_installed(tmp_path):
    other = tmp_path / placement_planner_ros.__name__
    other.mkdir()
    (other / "__init__.py").write_text("")
    plain = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    for asked in (child_environment(), plain):  # and this is how it went without
        found = subprocess.run(
            [sys.executable, "-c", "import placement_planner_ros as it; print(it.__file__)"],
            env=asked,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        same = Path(found.stdout.strip()) == Path(placement_planner_ros.__file__)
        assert same == (asked is not plain)
