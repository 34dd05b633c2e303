"""Run what is started by hand: `python test/by_hand NAME ...`, its options after its name.

From any folder: what it imports of the checkout and of the tests' helpers is found.
"""

import runpy
import sys
from importlib import import_module
from pathlib import Path

HERE = Path(__file__).resolve().parent
NAMES = sorted(file.stem for file in HERE.glob("*.py") if not file.stem.startswith("_"))


def main() -> None:
    """Run the script that is named, as if it were the program."""
    if len(sys.argv) < 2 or sys.argv[1] not in NAMES:
        sys.exit(
            f"usage: python test/by_hand NAME [option ...], where NAME is of {', '.join(NAMES)}"
        )
    sys.path[:1] = [str(HERE.parent), str(HERE.parents[1])]
    del sys.argv[0]
    import_module("placement_planner_ros.core.kernels").use_kernel_folder()
    runpy.run_module(f"by_hand.{sys.argv[0]}", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
