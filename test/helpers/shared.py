"""Where the data that nobody here made lies: `../shared/data`, or PLACEMENT_PLANNER_SHARED."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("PLACEMENT_PLANNER_SHARED", ROOT.parent / "shared"))
