"""SampleGoals on a plane with a known valid part: rewards, budgets, ablation, concentration."""

import numpy as np
import pinocchio as pin
import pytest

from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.search.climbers import Climbers
from placement_planner_ros.core.search.expected_improvement import GRADED_CELL, ImprovementModel
from placement_planner_ros.core.search.hierarchy import AfrHierarchy, AfrNode, HierarchySettings
from placement_planner_ros.core.search.mcts import MctsSampler, MctsSettings
from placement_planner_ros.core.search.optimistic import OptimisticSampler, OptimisticSettings
from placement_planner_ros.core.search.sampler import Draws, Outcome, SamplerSettings
from placement_planner_ros.core.search.uniform import UniformSampler
from placement_planner_ros.core.types import FULL_TURN, Goal, Verdict


def never() -> bool:
    return False


class CornerChecker:
    """Valid where x, y < 0.1 and θ < π/2 for arm 1 only; ξ = -x.

    Nowhere where an arm that turns things as it can is `turned` to where they collide.
    """

    turned = False

    def __init__(self) -> None:
        self.contacts: list[np.ndarray] = []

    def check_batch(self, draws: Draws, best: float, goals: int, should_stop, order) -> Outcome:
        rows = list(zip(draws.arm, draws.contact, draws.angle, strict=True))
        self.contacts += [np.array([*contact[:2], angle, arm]) for arm, contact, angle in rows]
        verdicts, values = np.array([self.judge(*row, best) for row in rows]).T
        free = verdicts >= Verdict.NOT_BETTER
        untried = np.minimum(verdicts, Verdict.NOT_BETTER).astype(int)
        outcome = Outcome(untried, values, free, np.zeros_like(free), [])
        for row in order(np.flatnonzero(verdicts > Verdict.NOT_BETTER), outcome, best):
            outcome.verdicts[row], outcome.tried[row] = verdicts[row], True
            if self.turned:
                outcome.verdicts[row], outcome.values[row] = Verdict.COLLIDING, best
            if verdicts[row] == Verdict.FEASIBLE:
                place = pin.SE3.Identity(), 0.0, np.zeros((1, 7)), values[row]
                outcome.goals.append(Goal("b", 0, 0, *place))
            if len(outcome.goals) == goals:
                break
        return outcome

    def judge(self, arm, contact, angle, best) -> tuple[Verdict, float]:
        if contact[0] > 0.1 or contact[1] > 0.1:
            return Verdict.COLLIDING, -np.inf
        value = -float(contact[0])
        if value <= best:
            return Verdict.NOT_BETTER, value
        reached = arm in (1, -1) and angle <= np.pi / 2
        return Verdict.FEASIBLE if reached else Verdict.NO_IK, value


def hierarchy(**settings) -> AfrHierarchy:
    square = Region(np.array([[0.0, 0.0, 0.4, 0.4]]), 0.0)
    strip = Region(np.array([[1.0, 0.0, 1.1, 0.1]]), 0.0)
    return AfrHierarchy([2, 1], 2, [square, strip], HierarchySettings(**settings))


KINDS = [MctsSampler, OptimisticSampler, UniformSampler]
SETTINGS = dict(zip(KINDS, [MctsSettings, OptimisticSettings, SamplerSettings], strict=True))


def sampler(kind=MctsSampler, seed=0, bounds=(), **settings):
    checker, chosen = CornerChecker(), SETTINGS[kind](**settings)
    return kind(hierarchy(), checker, chosen, np.random.default_rng(seed), *bounds), checker


def children(afr: AfrHierarchy, node: AfrNode) -> list[AfrNode]:
    return [afr.child(node, k) for k in range(afr.child_count(node))]


def test_levels_are_arm_grasp_face_region_then_cells():
    afr = hierarchy(angle_intervals=4)
    levels = [[afr.root]]
    for _ in range(5):
        levels.append(children(afr, levels[-1][0]))
    *_, regions, cells = levels
    assert [len(level) for level in levels] == [1, 2, 2, 2, 2, 16]
    assert sum(cell.region.area for cell in cells) / 4 == pytest.approx(regions[0].region.area)
    quarters = {(4 * c.angle_min / FULL_TURN, 4 * c.angle_max / FULL_TURN) for c in cells}
    assert quarters == {(0.0, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 4.0)}


def test_division_ends_at_the_minimal_area_and_angle():
    afr = hierarchy(min_area=1e-3, min_angle=FULL_TURN / 16)
    face = children(afr, children(afr, children(afr, afr.root)[0])[0])[0]
    level, leaves = [children(afr, face)[0]], []
    while level:
        below = children(afr, node := level.pop())
        leaves += [] if below else [(node.region.area, node.angle_max - node.angle_min)]
        level.extend(below)
    assert len(leaves) > 100
    assert (np.array(leaves) <= (1e-3, FULL_TURN / 16 * (1 + 1e-9))).all()


@pytest.mark.parametrize("kind", KINDS)
def test_a_call_ends_at_its_budgets(kind):
    made, _ = sampler(kind, samples_per_call=30, goals_per_call=1000, batch=10)
    made.sample_goals(-np.inf, never)
    assert 30 <= made.count.samples <= 40
    made, _ = sampler(kind, samples_per_call=100_000, goals_per_call=2)
    assert len(made.sample_goals(-np.inf, never)) == 2
    before = made.count.samples
    made.sample_goals(-np.inf, lambda: True)
    assert made.count.samples == before


def test_tree_search_finds_more_goals_than_uniform_sampling():
    found = {}
    for kind in (MctsSampler, UniformSampler):
        made, _ = sampler(kind, samples_per_call=3000, goals_per_call=10_000)
        found[kind] = len(made.sample_goals(-0.1, never))
    assert found[MctsSampler] > 3 * found[UniformSampler]


def test_optimistic_search_comes_closer_to_the_optimum_than_uniform_sampling():
    def gap(kind, seed):
        first = {"uniform_first": 500} if kind is OptimisticSampler else {}
        made, _ = sampler(kind, seed=seed, **first)
        best = -np.inf
        while made.count.samples < 3000:
            best = max(best, *(g.objective for g in made.sample_goals(best, never)), best)
        return -best

    optimistic, uniform = ([gap(kind, seed) for seed in range(9)] for kind in KINDS[1:])
    assert np.median(optimistic) < 0.5 * np.median(uniform)


@pytest.mark.parametrize("kind", KINDS)
def test_goals_beat_the_best_value_and_the_counts_add_up(kind):
    made, _ = sampler(kind, samples_per_call=2000, goals_per_call=10_000)
    goals = made.sample_goals(-0.05, never)
    assert min(goal.objective for goal in goals) > -0.05
    assert sum(made.count.verdicts.values()) == made.count.samples >= 2000
    assert made.count.verdicts[Verdict.FEASIBLE] == len(goals)


def test_uniform_sampling_is_uniform_over_the_regions_by_area():
    made, checker = sampler(UniformSampler, samples_per_call=4000, goals_per_call=10_000)
    made.sample_goals(-np.inf, never)
    contacts = np.array(checker.contacts)
    assert (contacts[:, 0] > 0.5).mean() == pytest.approx(0.01 / 0.17, abs=0.015)
    square = contacts[contacts[:, 0] < 0.5]
    assert np.allclose(square[:, :2].mean(axis=0), 0.2, atol=0.01)
    assert square[:, 2].mean() == pytest.approx(np.pi, abs=0.1)


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_goals(kind):
    def run(seed):
        made, _ = sampler(kind, seed=seed, samples_per_call=2000, goals_per_call=10_000)
        return [goal.objective for goal in made.sample_goals(-np.inf, never)]

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_what_is_better_and_hard_to_reach_is_not_put_aside():
    """The better half is reached by one try in a hundred, the other always."""

    class HardToReach(CornerChecker):
        rng, chance = np.random.default_rng(5), 0.01

        def judge(self, arm, contact, angle, best):
            value = 1.0 if contact[0] < 0.1 and contact[1] < 0.1 else 0.1 * float(contact[0])
            if value <= best:
                return Verdict.NOT_BETTER, value
            easy = value < 1.0 or self.rng.random() < self.chance
            return (Verdict.FEASIBLE if easy else Verdict.NO_IK), value

    checker, found = HardToReach(), []
    for seed in range(5):
        settings = OptimisticSettings(samples_per_call=100, uniform_first=200)
        made = OptimisticSampler(hierarchy(), checker, settings, np.random.default_rng(seed))
        best = -np.inf
        while made.count.samples < 50_000:
            best = max(best, *(g.objective for g in made.sample_goals(best, never)), best)
        found.append(best)
    assert found == [1.0] * 5
    # Tries that fail count to climbers, too, whatever becomes of the pose.
    checker.chance, checker.turned = 0.0, True
    while made.count.samples < 70_000:
        made.sample_goals(0.05, never)
    assert made._drawn["failed"].max() > 0.0


def test_tries_that_fail_in_one_part_say_little_of_the_others():
    def of(nodes):
        cells = np.zeros(len(nodes), GRADED_CELL)
        cells["node"] = nodes
        return cells

    model = ImprovementModel(1)
    whole = model.add_nodes(np.array([0]))
    parts = of(model.add_nodes(np.repeat(whole, 2)))
    for _ in range(1000):
        model.count_try(parts[0], 1.0, 0.0)
    of_parts = model.chances(parts)
    assert of_parts[0] < 0.01 * of_parts[1]
    assert of_parts[1] > 0.05
    # What nobody tried is expected to be as the whole, whenever it was split off.
    later = of(model.add_nodes(whole))
    assert model.chances(later) == model.chances(of(whole)) == of_parts[1]
    # A little more where no try succeeds promises less than a little less beside it.
    hopeless, other = model.promise_of_tries(parts, np.array([1.1, 1.0]), 0.0)
    assert hopeless < 0.5 * other
    # And so does a climber whose tries failed.
    parts["failed"][1] = 1e6
    assert np.argmax(model.promise_of_tries(parts, np.ones(2), 0.0)) == 0
    # The more parts fail, the less is expected of what is left.
    for node in model.add_nodes(np.repeat(whole, 100)):
        model.count_try(of([node])[0], 1.0, 0.0)
    assert model.chances(later) < 0.1 * of_parts[1]
    # Four tries say no more the smaller the part is that they were made in.
    model, node = ImprovementModel(1), np.array([0])
    for _ in range(6):
        node = model.add_nodes(node)
    model.count_try(of(node)[0], 4.0, 0.0)
    assert model.chances(of(node)) == pytest.approx(0.5 * 2.0 / 6.0)


def test_climbers_slide_along_an_oblique_wall_to_its_end():
    """Usable where x + y <= 0.3: steps along x or y alone end anywhere on the wall."""
    sets, highest = hierarchy().sets, []
    made = Climbers(sets, 40, np.random.default_rng(3))
    places = np.random.default_rng(4).uniform((0.0, 0.0, 0.5), (0.1, 0.1, 3.0), (90, 3))
    made.begin(np.zeros(90, int), places, places[:, 0], np.full(90, Verdict.FEASIBLE))
    for _ in range(1000):
        of, at, values, _ = made.propose(1.0)
        assert ((sets.low[of] <= at) & (at <= sets.high[of])).all()
        highest.extend(values)
        ups = at[:, 0] + 0.5 * at[:, 1] - 0.02 * np.abs(at[:, 2] - 6.0)
        made.learn(ups, np.where(at @ (1, 1, 0) <= 0.3, Verdict.FEASIBLE, Verdict.NO_RELEASE), 0)
    assert not len(of)
    assert max(highest) > 0.299


def test_blocked_climbers_wander_where_it_is_better_until_a_hand_is_free():
    """Better is a strip 2 mm wide for the middle, 5 cm from the contact point.

    Beyond 15 cm only a release lacks, in 1 cm and 0.3 rad nothing. They get there, and none goes
    back to where a hand is lacking. Where turns are thrown back the middle moves as drawn, too.
    """
    sets, seen = hierarchy().sets, []
    made, sets.middle[:] = Climbers(sets, 30, np.random.default_rng(3)), 0.05j
    made._gone, lacking = 60, np.array([Verdict.ARM_COLLIDING])
    places = np.repeat([[0.1, 0.1058, 5.0], [0.1, 0.093, 1.0]], (1, 39), axis=0)
    made.begin(np.zeros(40, int), places, np.zeros(40), np.repeat(lacking, 40))
    assert np.sum(made._all["place"][:, 2] == 5.0) == 30, "as many of both"
    for _ in range(1000):
        _, at, least, _ = made.propose(-1.0)
        x, y = at[:, 0] - 0.05 * np.sin(at[:, 2]), at[:, 1] + 0.05 * np.cos(at[:, 2])
        better, lacks = np.abs(y - 0.12) < 0.001, np.where(x > 0.15, Verdict.NO_RELEASE, lacking)
        hand = better & (np.abs(x - 0.25) < 0.005) & (np.abs(at[:, 2] - 2.0) < 0.15)
        seen.append((np.sum(hand & (least == -1.0)), np.sum(made._all["verdict"] == lacking)))
        made.learn(np.where(better, at[:, 2], -1.0), np.where(hand, Verdict.FEASIBLE, lacks), 0)
    assert sum(reached for reached, _ in seen) > 1
    assert (np.diff(seen, axis=0)[:, 1] <= 0).all()
    sets.low[:, 2], sets.high[:, 2] = 1.0, 1.1
    made = Climbers(sets, 40, np.random.default_rng(3))
    places, usable = np.tile([0.2, 0.2, 1.05], (40, 1)), np.full(40, Verdict.FEASIBLE)
    made.begin(np.zeros(40, int), places, np.zeros(40), usable)
    _, at, *_ = made.propose(0.0)
    moved = (at[:, :2] - 0.2) @ (1.0, 1.0j) + 0.05j * (np.exp(1j * at[:, 2]) - np.exp(1.05j))
    np.testing.assert_allclose(moved, made._moves[:, :2] @ (1.0, 1.0j), atol=1e-12)
    made.learn(np.zeros(40), usable, np.arange(40) % 2)
    assert (made.propose(0.0)[3] == np.arange(40) % 2).all(), "of each its own"


class BetterInTheLowerHalf:
    """ξ is at most -1 beyond y = 0.2."""

    bounded = True

    def most(self, cells, rough=False):
        return np.where(cells["low"][:, 1] >= 0.2, -1.0, 1.0)


@pytest.mark.parametrize(("best", "upper"), [(-2.0, 1.0 / 3.0), (-0.5, 0.0), (2.0, 1.0)])
def test_even_poses_are_drawn_by_what_they_may_add(best, upper):
    settings = {"samples_per_call": 2000, "uniform_first": 10_000, "even_share": 0.0}
    settings["goals_per_call"] = 10_000
    made, checker = sampler(OptimisticSampler, bounds=[BetterInTheLowerHalf()], **settings)
    made.sample_goals(best, never)
    share = (np.array(checker.contacts)[:, 1] > 0.2).mean()
    # Where nothing may be better all is drawn from still, and any number of poses.
    assert len(checker.contacts) >= 2000
    assert share == pytest.approx(0.08 * upper / (0.09 + 0.08 * upper), abs=0.05 * upper)


@pytest.mark.parametrize("even", [0.0, 0.5, 1.0])
def test_regions_are_drawn_by_area_and_evenly_as_asked(even):
    budget = {"samples_per_call": 4000, "goals_per_call": 10_000, "uniform_first": 100_000}
    made, checker = sampler(OptimisticSampler, even_share=even, **budget)
    made.sample_goals(-np.inf, never)
    in_strip = np.mean([contact[0] > 0.5 for contact in checker.contacts])
    assert in_strip == pytest.approx((1 - even) * 0.01 / 0.17 + even * 0.5, abs=0.03)


@pytest.mark.parametrize("kind", [OptimisticSampler, UniformSampler])
def test_uniform_poses_lie_on_their_region(kind):
    """A region like the letter L, whose extent is mostly empty."""
    bars = Region(np.array([[0.0, 0.0, 0.02, 0.4], [0.02, 0.0, 0.4, 0.02]]), 0.0)
    afr = AfrHierarchy([2, 1], 2, [bars], HierarchySettings())
    checker = CornerChecker()
    settings = SETTINGS[kind](samples_per_call=600, goals_per_call=1000)
    kind(afr, checker, settings, np.random.default_rng(0)).sample_goals(-np.inf, never)
    contacts = np.array(checker.contacts)
    assert (contacts[:, :2] < 0.02).any(axis=1).all()
    assert ((contacts[:, 0] > 0.02).mean()) == pytest.approx(0.38 / 0.78, abs=0.06)


@pytest.mark.parametrize("kind", KINDS)
def test_samplers_can_be_made_where_there_is_nothing_to_sample(kind):
    """The planner makes its sampler first and then says that there is no region."""
    empty = AfrHierarchy([1], 1, [], HierarchySettings())
    kind(empty, CornerChecker(), SETTINGS[kind](), np.random.default_rng(0))
