"""Objectives by name: the built-in ones and what other packages install."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib.metadata import EntryPoint, entry_points

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.objective.clearance import Clearance
from placement_planner_ros.core.objective.objective import (
    Objective,
    ObjectiveContext,
    ask_objective,
)
from placement_planner_ros.core.objective.terms import Term
from placement_planner_ros.core.objective.weighted import (
    BUILT_IN,
    PlugInTerm,
    Requirements,
    Weighted,
)

ENTRY_POINT_GROUP = "placement_planner_ros.objectives"

ObjectiveFactory = Callable[[ObjectiveContext], Objective]

_BUILT_IN: dict[str, ObjectiveFactory] = {
    "maximize_clearance": Clearance,
    "minimize_clearance": lambda context: Clearance(context, -1.0),
    "weighted": lambda context: Weighted(context, make_term),
}


def term_names() -> list[str]:
    """Every name a term of a weighted objective may have: the built-in ones and the plug-ins."""
    return [*BUILT_IN, *sorted(e.name for e in _plug_ins() if e.name not in BUILT_IN)]


def make_term(name: str, context: ObjectiveContext) -> Term:
    """Make the term of that name for one run.

    Raises:
        ParameterError: as `make_objective`, or the name is unknown.
    """
    if name in BUILT_IN:
        return BUILT_IN[name](context)
    if name not in term_names():
        raise ParameterError("`terms`", name, f"is no term; choose of {', '.join(term_names())}")
    return PlugInTerm(make_objective(name, context))


def make_requirements(context: ObjectiveContext) -> Requirements | None:
    """The terms that are required; None where none is.

    Raises:
        ParameterError: see `make_term`, or they do not fit together.
    """
    return Requirements(context, make_term) if context.wishes.required else None


def objective_names() -> list[str]:
    """Every name `make_objective` knows: the built-in ones and the installed plug-ins."""
    return sorted({*_BUILT_IN, *(e.name for e in _plug_ins())})


def make_objective(name: str, context: ObjectiveContext) -> Objective:
    """Make the objective of that name for one run.

    Raises:
        ParameterError: the name is unknown, its entry point raises, or what that makes cannot be
            called.
    """
    if name in _BUILT_IN:
        return _BUILT_IN[name](context)
    found = [e for e in _plug_ins() if e.name == name]
    if not found:
        known = ", ".join(objective_names())
        raise ParameterError("objective", name, f"is not known; choose one of {known}")
    factory = ask_objective(found[0], found[0].load)
    objective = ask_objective(factory, lambda: factory(context))
    if not callable(objective):
        raise ParameterError(
            "objective", name, f"its factory made a {type(objective).__name__}, not a callable"
        )
    return objective


@cache
def _plug_ins() -> tuple[EntryPoint, ...]:
    """What is installed; looked for once, as that takes some 20 ms."""
    return tuple(entry_points(group=ENTRY_POINT_GROUP))
