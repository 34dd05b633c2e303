"""The paper's search: one sample at a time it is Algorithms 2 and 3 to the letter."""

import math

import numpy as np
import pytest

from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.search.hierarchy import AfrHierarchy, HierarchySettings
from placement_planner_ros.core.search.mcts import MctsSampler, MctsSettings, checks_passed
from placement_planner_ros.core.search.sampler import Outcome
from placement_planner_ros.core.types import Verdict


def never() -> bool:
    return False


def plane() -> list[Region]:
    """A square and a strip."""
    square = Region(np.array([[0.0, 0.0, 0.4, 0.4]]), 0.0)
    return [square, Region(np.array([[1.0, 0.0, 1.1, 0.1]]), 0.0)]


def judge(arm, contact, angle):
    """(reached, arm free, object free, stable) and ξ, each true on its own part of the plane."""
    x, y, _ = contact
    terms = (bool(arm == 1 and angle < 4.0), bool(y < 0.3), bool(x < 0.2), bool(x + y < 0.5))
    return terms, -float(x + 0.3 * y)


def verdict_of(terms, value, best):
    reached, arm_free, object_free, stable = terms
    return next(
        verdict
        for verdict, passed in {
            Verdict.UNSTABLE: stable,
            Verdict.COLLIDING: object_free,
            Verdict.NOT_BETTER: value > best,
            Verdict.NO_IK: reached,
            Verdict.ARM_COLLIDING: arm_free,
            Verdict.FEASIBLE: False,
        }.items()
        if not passed
    )


class Checker:
    """Remembers what it was asked; never finds a goal that would end the call."""

    def __init__(self):
        self.asked = []

    def check_batch(self, draws, best, goals, should_stop, order):
        columns = (draws.arm, draws.grasp, draws.face, *draws.contact.T, draws.angle)
        self.asked += zip(*columns, strict=True)
        found = [judge(*one) for one in zip(draws.arm, draws.contact, draws.angle, strict=True)]
        verdicts = np.array([verdict_of(*one, best) for one in found])
        values = np.array([v for _, v in found])
        free, tried = verdicts >= Verdict.NOT_BETTER, verdicts > Verdict.NOT_BETTER
        return Outcome(verdicts, values, free, tried, [])


class Letter:
    """Algorithms 2 and 3 as the paper prints them, over lists.

    Each sample counts as what it was with the ξ_best of its day.
    """

    def __init__(self, afr, c, rng):
        self.afr, self.c, self.rng = afr, c, rng
        self.nodes, self.parents, self.children, self.missing = [afr.root], [None], [[]], {}
        self.v, self.r, self.asked = [0], [0.0], []

    def sample_goals(self, g_max, best):
        for _ in range(g_max):
            n = self.select_afr_node()
            node = self.nodes[n]
            contact, angle = (
                node.region.sample(self.rng),
                self.rng.uniform(node.angle_min, node.angle_max),
            )
            self.asked.append((node.arm, node.grasp, node.face, *contact, angle))
            self.update(n, self.delta_r(n, *judge(node.arm, contact, angle), best))

    def update(self, n, reward):
        while n is not None:
            self.v[n] += 1
            self.r[n] += reward
            n = self.parents[n]

    def delta_r(self, n, terms, value, best):
        verdict = verdict_of(terms, value, best)
        if self.afr.child_count(self.nodes[n]) == 0:
            return float(verdict is Verdict.FEASIBLE)
        return (verdict - (verdict > Verdict.BREAKS_RULE)) / 9

    def select_afr_node(self):
        n = 0
        for _ in range(4):  # the paper's three, and the grasp
            n = self.select_child(n)
        while self.v[n] > 0 and self.afr.child_count(self.nodes[n]) > 0:
            n = self.select_child(n)
        return n

    def select_child(self, n):
        children, c, v = self.children[n], self.c, self.v
        means = [self.r[i] / v[i] for i in children]
        u = [
            mean + c * math.sqrt(2 * math.log(v[n]) / v[i])
            for i, mean in zip(children, means, strict=True)
        ]
        j, u_new = len(children), -math.inf
        if 0 < j < self.afr.child_count(self.nodes[n]):
            u_new = sum(means) / j + c * math.sqrt(2 * math.log(v[n]) / j)
        if not children or all(u_new > u_i for u_i in u):
            return self.add_child(n)
        return children[u.index(max(u))]

    def add_child(self, n):
        count = self.afr.child_count(self.nodes[n])
        missing = self.missing.setdefault(n, list(range(count)))
        pick = self.rng.integers(len(missing))
        missing[pick], missing[-1] = missing[-1], missing[pick]
        self.nodes.append(self.afr.child(self.nodes[n], missing.pop()))
        self.parents.append(n)
        self.children.append([])
        self.v.append(0)
        self.r.append(0.0)
        self.children[n].insert(0, len(self.nodes) - 1)  # of equals the youngest is preferred
        return len(self.nodes) - 1


@pytest.mark.parametrize("c", [0.1, 0.7])
@pytest.mark.parametrize("seed", range(3))
def test_a_batch_of_one_selects_rewards_and_counts_as_the_paper_does(c, seed):
    afr = AfrHierarchy([2, 1], 2, plane(), HierarchySettings(min_area=0.002, min_angle=0.8))
    letter = Letter(afr, c, np.random.default_rng(seed))
    settings = MctsSettings(samples_per_call=150, goals_per_call=10**6, batch=1, exploration=c)
    checker = Checker()
    made = MctsSampler(afr, checker, settings, np.random.default_rng(seed))
    for best in (-math.inf, -0.12, -0.06, -0.03):
        letter.sample_goals(150, best)
        made.sample_goals(best, never)
        assert checker.asked == letter.asked
        number = len(letter.nodes)
        assert len(made.tree.nodes) == number
        assert made.tree.visits[:number].tolist() == letter.v
        assert made.tree.rewards[:number] == pytest.approx(letter.r, abs=1e-9)
    leaves = [n for n in range(len(letter.nodes)) if afr.child_count(letter.nodes[n]) == 0]
    # else nothing is said of how leaves are rewarded
    assert sum(letter.v[n] for n in leaves) > 50


def test_a_larger_batch_spends_as_many_samples_and_forgets_none():
    afr = AfrHierarchy([2, 1], 2, plane(), HierarchySettings())
    settings = MctsSettings(samples_per_call=150, goals_per_call=10**6, batch=16)
    checker = Checker()
    made = MctsSampler(afr, checker, settings, np.random.default_rng(0))
    made.sample_goals(-math.inf, never)
    assert made.tree.visits[0] == len(checker.asked) == 160
    total = sum(
        checks_passed(verdict_of(*judge(arm, contact, angle), -math.inf))
        for arm, _, _, *contact, angle in checker.asked
    )
    assert made.tree.rewards[0] == pytest.approx(total)
