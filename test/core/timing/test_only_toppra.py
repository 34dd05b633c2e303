"""toppra is there without what it draws with, until somebody draws."""

import subprocess
import sys

PROGRAM = """
import sys
from placement_planner_ros.core.planner import PlacementPlanner
print(any(name.split(".")[0] == "matplotlib" for name in sys.modules))
from toppra.algorithm import algorithm
print(algorithm.plt.figure.__module__)
import matplotlib.pyplot
print(algorithm.plt.figure is matplotlib.pyplot.figure)
"""


def test_matplotlib_is_imported_once_toppra_draws():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False
    )
    assert done.stdout.split() == ["False", "matplotlib.pyplot", "True"], done.stderr


def test_matplotlib_stays_where_it_is_there_already():
    first = "import matplotlib.pyplot as own; import sys\n"
    then = "\nprint(sys.modules['matplotlib.pyplot'] is own)"
    done = subprocess.run(
        [sys.executable, "-c", first + PROGRAM + then], capture_output=True, text=True, check=False
    )
    assert done.stdout.split() == ["True", "matplotlib.pyplot", "True", "True"], done.stderr
