"""What an objective of somebody else's does wrong is told as its fault."""

import numpy as np
import pinocchio as pin
import pytest

from placement_planner_ros.core.errors import ObjectError, ParameterError
from placement_planner_ros.core.objective import by_name
from placement_planner_ros.core.objective.clearance import Clearance
from placement_planner_ros.core.objective.objective import (
    evaluate_batch,
    evaluate_objective,
    finite_answer,
    objective_gradient,
)
from placement_planner_ros.core.stopping import StoppedError, stoppable

AT = pin.SE3.Identity()
POSES = np.eye(4)[None].repeat(2, axis=0)


def ask_all(objective):
    """Everything that the planner may ask of it."""
    return (
        lambda: evaluate_objective(objective, AT),
        lambda: evaluate_batch(objective, POSES),
        lambda: finite_answer(objective, lambda: objective.estimates(POSES), len(POSES)),
        lambda: objective_gradient(objective, AT),
    )


def answering(answer):
    class Mine:
        def __call__(self, _):
            return answer()

        def values(self, _):
            return answer()

        estimates = gradient = values

    return Mine()


def raising(error):
    def raises(*_):
        raise error

    return raises


class SpeechlessError(Exception):
    def __str__(self):
        raise ValueError("nothing to say")


@pytest.mark.parametrize(
    "error",
    [
        ZeroDivisionError("mine"),
        SystemExit(3),
        GeneratorExit("mine"),
        StopIteration(),
        ObjectError("object", 1, "mend it"),
        StoppedError("mine"),
        SpeechlessError(),
    ],
    ids=repr,
)
def test_what_it_raises_is_a_bad_parameter_with_its_cause(error):
    """Errors like the planner's own are its fault, too."""
    for ask in ask_all(answering(raising(error))):
        with pytest.raises(ParameterError, match=type(error).__name__) as caught:
            ask()
        assert caught.value.field == "objective"
        assert caught.value.__cause__ is error


@pytest.mark.parametrize("answer", [float("nan"), float("inf"), "much", None], ids=str)
def test_what_is_no_finite_number_is_a_bad_parameter(answer):
    for ask in ask_all(answering(lambda: answer)):
        with pytest.raises(ParameterError, match="objective"):
            ask()


def test_the_user_at_the_keyboard_still_interrupts():
    for ask in ask_all(answering(raising(KeyboardInterrupt()))):
        with pytest.raises(KeyboardInterrupt):
            ask()


def test_a_bad_parameter_stays_what_it_is():
    for ask in ask_all(answering(raising(ParameterError("mine", 1, "mend it")))):
        with pytest.raises(ParameterError, match="mend it") as caught:
            ask()
        assert caught.value.field == "mine"


def test_what_it_says_can_be_sent():
    for ask in ask_all(answering(raising(ValueError("\ud800 \0 mine")))):
        with pytest.raises(ParameterError, match=r"\? \? mine") as caught:
            ask()
        str(caught.value).encode()


def test_it_is_asked_no_more_once_nobody_wants_to_know():
    asked = []
    with stoppable(lambda: len(asked) >= 2), pytest.raises(StoppedError):
        evaluate_batch(lambda T: asked.append(T) or 0.0, np.eye(4)[None].repeat(5, axis=0))
    assert len(asked) == 2


def test_a_fault_of_a_built_in_objective_is_not_the_users():
    broken = object.__new__(Clearance)
    for ask in ask_all(broken):
        with pytest.raises(AttributeError):
            ask()


@pytest.mark.parametrize("where", ["load", "make"])
def test_a_plug_in_that_cannot_be_made_is_a_bad_parameter(monkeypatch, where):
    class Entry:
        name = "mine"

        def load(self):
            if where == "load":
                raise ImportError("no such module")
            return raising(ZeroDivisionError("mine"))

    monkeypatch.setattr(by_name, "_plug_ins", lambda: (Entry(),))
    with pytest.raises(ParameterError, match="objective"):
        by_name.make_objective("mine", None)
