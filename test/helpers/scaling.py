"""Runs of the scaling benchmark, as it records them."""


def record(axis, factor, seed, steps, objective="maximize_clearance"):
    """A run with (seconds, ξ) steps."""
    return {
        "axis": axis,
        "factor": factor,
        "size": 100.0 * factor,
        "random": 0.1,
        "case": {"scene": "table", "object": "wine_glass", "objective": objective},
        "seed": seed,
        "time_limit": 9.0,
        "solutions": [{"time": t, "objective": value} for t, value in steps],
    }
