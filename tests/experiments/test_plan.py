"""Plans say what is wrong with them, and are scaled down as a whole."""

import dataclasses

import pytest

from marl_cair.experiments.plan import Length, read_plan, scale_plan
from marl_cair.training.settings.config_file import build_value
from tests.experiments.plans import change_task, make_plan


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"task": {}}, "unknown option 'task': nearest are 'tasks'"),
        ({"tasks": {}}, r"tasks is \{\}, it must be one or more by name"),
        ({"factors": {}}, r"factors is \{\}, it must be one or more by name"),
        ({"factors": {"learner": {}}}, "factors.learner is .* one or more choices"),
        ({"factors": {"a": {"x": []}, "b": {"x": []}}}, "factors and others has 'x' twice"),
        ({"factors": {"updates": {"x": []}}}, "factors is 'updates', it must be another name than"),
        ({"factors": {"ended": {"x": []}}}, "factors is 'ended', it must be another name than"),
        ({"factors": {"published": {"x": []}}}, "factors is 'published', it must be another name"),
        ({"factors": {"a b": {"x": []}}}, "a name is 'a b', it must be a text of letters"),
        ({"others": {"mine": "function"}}, "others.mine is 'function', it must be module:function"),
        ({"seeds": []}, "seeds is .* one or more"),
        ({"seeds": [1, 1]}, "seeds has 1 twice"),
        ({"seeds": [-1]}, "seeds is -1, it must be 0 or more"),
        ({"games_per_pair": 5}, "games_per_pair is 5, it must be an even number"),
        ({"budget": {}}, "budget is None, it must be frames, seconds, or both"),
        ({"budget": {"frames": 0}}, "frames is 0, it must be 1 or more"),
        ({"tasks": change_task(when={"pqm": []})}, "tasks.maze.when is 'pqm', it must be one of"),
        ({"tasks": change_task(published={"x": 1})}, "tasks.maze.published is 'x'"),
        ({"tasks": change_task(scale=[0])}, r"scale is \[0\], it must be two scores"),
        ({"tasks": change_task(scale=[0, "random"])}, "scale is 'random', it must be a number"),
        ({"tasks": change_task(rating={"games": 0})}, "rating.games is 0"),
        ({"tasks": change_task(rating={"statistic": "mode"})}, "rating.statistic is 'mode'"),
        ({"tasks": change_task(rating={"agent": "first"})}, "rating.agent is 'first'"),
        ({"tasks": change_task(rating={"epsilons": [2]})}, "rating.epsilons is 2"),
    ],
)
def test_a_wrong_plan_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        make_plan(**changes)


def test_the_error_of_a_file_names_it(tmp_path):
    path = tmp_path / "plan.yaml"
    with pytest.raises(ValueError, match="there is no plan .*plan.yaml"):
        read_plan(path)
    path.write_text("seed: [1]", "utf-8")
    with pytest.raises(ValueError, match="plan.yaml: unknown option 'seed': nearest are 'seeds'"):
        read_plan(path)
    path.write_text("[1, 2]", "utf-8")
    with pytest.raises(ValueError, match="it must be options by name"):
        read_plan(path)


def test_seeds_may_be_added_to_a_plan_and_nothing_else():
    assert make_plan().fixed == make_plan(seeds=[0, 1, 2]).fixed
    assert make_plan().fixed != make_plan(budget={"frames": 513}).fixed


def test_cells_are_named_in_the_order_of_factors_so_it_may_not_change():
    factors = {"a": {"x": []}, "b": {"y": []}}
    swapped = dict(reversed(factors.items()))
    assert make_plan(factors=factors).fixed != make_plan(factors=swapped).fixed


def test_a_length_is_over_at_the_limit_that_comes_first():
    both = Length(frames=100, seconds=10.0)
    assert both.count(50, 8.0) == pytest.approx(0.8)
    assert both.count(250, 8.0) == pytest.approx(2.5)
    assert Length().count(10, 10.0) == 0
    assert both.scale(0.25) == Length(25, 2.5)


def test_a_plan_is_scaled_with_its_looks_and_games():
    plan = make_plan(
        tasks=change_task(rating={"games": 200}), budget={"frames": 1000, "seconds": 60.0}
    )
    scaled = scale_plan(plan, 0.25)
    assert (scaled.budget, scaled.looks) == (Length(250, 15.0), Length(32))
    assert scaled.tasks["maze"].rating.games == 48  # for 2, 3, 4 or 6 teams
    assert scale_plan(plan, 0.01).tasks["maze"].rating.games == 24
    few = make_plan()
    assert scale_plan(few, 0.01).tasks["maze"].rating.games == 4


def test_plans_are_read_back_from_plain_values():
    plan = make_plan()
    assert build_value(type(plan), dataclasses.asdict(plan)) == plan
