import importlib
import pkgutil
import re
from dataclasses import dataclass, fields

import pytest

import placement_planner_ros.core
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.settings import Settings, meaning_of, setting


@dataclass(frozen=True, slots=True)
class Example(Settings):
    share: float = setting(0.5, "[0, 1)", "", "A share.")
    size: float = setting(1.0, "(0, inf)", "m", "A size.")
    count: int = setting(3, "[1, 4]")
    free: float = setting(0.0)
    name: str = setting("a", text="A name.", choices=("a", "b"))
    limits: tuple[float, ...] = setting((1.0, 2.0), "[0.5, 10]", "rad/s")
    switch: bool = setting(True, text="A switch.")
    words: str = "anything"


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"share": 1.0}, r"share = 1\.0: must lie in \[0, 1\)$"),
        ({"share": -0.1}, r"share = -0\.1: must lie in"),
        ({"share": float("nan")}, "share = nan: must be finite: A share"),
        ({"size": 0.0}, r"size = 0\.0: must be above 0 m$"),
        ({"size": float("inf")}, "size = inf: must be finite"),
        ({"count": 0}, r"count = 0: must lie in \[1, 4\]$"),
        ({"free": float("inf")}, "free = inf: must be finite$"),
        ({"name": "c"}, "name = 'c': choose one of a, b: A name.$"),
        ({"limits": (1.0, 0.1)}, r"limits = 0\.1: must lie in \[0\.5, 10\] rad/s$"),
    ],
)
def test_what_does_not_is_refused_with_field_value_and_remedy(bad, message):
    with pytest.raises(ParameterError, match=message):
        Example(**bad)


def all_settings():
    """Every group of settings in core."""
    package = placement_planner_ros.core
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        if "ompl" not in module.name:
            importlib.import_module(module.name)
    found = [kind for kind in Settings.__subclasses__() if kind is not Example]
    for kind in found:
        found += kind.__subclasses__()
    return found


def test_every_setting_of_core_says_what_it_may_be():
    groups = all_settings()
    assert len(groups) > 10
    for kind in groups:
        made = kind()  # its defaults lie within
        for each in fields(kind):
            if isinstance(getattr(made, each.name), float):
                meaning = meaning_of(made, each.name)
                assert re.fullmatch(r"[\[(][^,]+, [^,]+[\])]", meaning.interval), each.name
                lower, upper = meaning.ends
                assert lower < upper, each.name
