"""Cells are the product of a plan, each composed and checked before any runs."""

import dataclasses

import pytest
import torch

from marl_cair.experiments.cells import find_shortage, load_cell, name_agent
from marl_cair.training.settings.config import ENDLESS_FRAMES
from tests.experiments.plans import TINY, WORDS, change_task, list_cells, make_plan


@pytest.fixture(scope="module")
def cells():
    return list_cells(make_plan())


def test_cells_are_the_product_of_tasks_choices_and_seeds_and_the_agents(cells):
    kinds = "maze-dqn", "maze-pqn", "maze-oracle"
    assert [cell.name for cell in cells] == [f"{kind}-{seed}" for seed in (0, 1) for kind in kinds]
    assert [cell.agent for cell in cells[:3]] == [None, None, "oracle"]
    dqn, pqn, _ = cells[:3]
    assert (dqn.config.learner.algorithm, pqn.config.learner.algorithm) == ("dqn", "pqn")
    assert {cell.config.seed for cell in cells[3:]} == {1}
    assert dqn.config.out == "out/cells/maze-dqn-0/run"
    assert dqn.config.total_frames == 512
    assert dqn.config.torch_threads == 1


def test_later_words_override_and_a_task_leaves_choices_out():
    when = {"dqn": ["learner.batch_size=32"], "pqn": None}
    plan = make_plan(tasks=change_task(when=when, words=["learner.batch_size=8"]), seeds=[0])
    trained, _ = list_cells(plan)
    assert (trained.name, trained.config.learner.batch_size) == ("maze-dqn-0", 32)


def test_a_rate_that_falls_needs_an_end_in_steps():
    """Without one it would never fall, without a word."""
    falls = {"dqn": ["learner.learning_rate_end=0"], "pqn": None}
    plan = make_plan(tasks=change_task(when=falls), budget={"seconds": 60})
    with pytest.raises(ValueError, match=r"learner.learning_rate_end is 0.0.*total_frames"):
        list_cells(plan)
    falls["dqn"].append("total_frames=5000")
    plan = make_plan(tasks=change_task(when=falls), budget={"seconds": 60})
    assert list_cells(plan)[0].config.total_frames == 5000


def test_a_cell_is_read_back_as_it_was_written(cells, tmp_path):
    for cell in cells[:3]:
        cell.save(tmp_path)
        assert load_cell(tmp_path) == cell


def test_a_cell_that_was_begun_keeps_its_settings_alone(tmp_path):
    begun, *_ = list_cells(make_plan(), tmp_path)
    folder = tmp_path / "cells" / begun.name
    folder.mkdir(parents=True)
    config = dataclasses.replace(begun.config, torch_threads=3)
    dataclasses.replace(begun, config=config, agent="random", name="../elsewhere").save(folder)
    read, *_ = list_cells(make_plan(), tmp_path)
    assert (read.config, read.agent, read.name) == (config, None, "maze-dqn-0")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"words": [*WORDS, "polcy=mlp"]}, "the cell maze-dqn cannot be run: unknown option"),
        ({"words": [*WORDS, "seed=3"]}, "a word is 'seed=3', it must be left out"),
        ({"words": [*WORDS, "+hydra.searchpath=[pkg://a]"]}, "a word is '.hydra.* an option of"),
        ({"words": [*WORDS, "policy.head=quantile"]}, "maze-dqn cannot be run: policy.head is"),
        ({"tasks": change_task(rating={"bots": ["random"]})}, "left out: the game is played alone"),
        (
            {"factors": {"extra_steps": {"few": []}}},
            "factors is 'extra_steps', it must be another name than a number's of the game",
        ),
        (
            {"tasks": change_task(rating={"show": ["ended (5 % random)"]})},
            r"unknown number of a look \(rating.show\) 'ended \(5 % random\)'",
        ),
        ({"tasks": change_task(agents=["orakle"], scale=[])}, "nearest are 'oracle'"),
        (
            {"tasks": change_task(words=["game=deep_line_wars", "scenario=11x11"], agents=[])}
            | {"words": WORDS[2:4], "tasks": {"war": {"words": ["game=deep_line_wars"]}}},
            "rating.bots is .* one or more bots: random",
        ),
        (
            {"tasks": change_task(rating={"agent": "best"})},
            r"maze-dqn .* rating.agent is 'best', .*every_frames \(100,000\) .* in 512 steps",
        ),
        (
            {"words": ["game=deep_line_wars", "evaluation.bots=[]", "evaluation.every_frames=64"]}
            | {"tasks": {"war": {"rating": {"bots": ["random"], "agent": "best"}}}},
            "war-dqn cannot be run: rating.agent is 'best', .* or set evaluation.bots",
        ),
    ],
)
def test_a_cell_that_cannot_be_run_is_named(changes, message):
    with pytest.raises(ValueError, match=message):
        list_cells(make_plan(**changes))


def test_games_of_two_teams_are_played_in_both_seats():
    task = {"words": ["game=deep_line_wars"], "rating": {"bots": ["random"], "games": 3}}
    with pytest.raises(ValueError, match="rating.games is 3, it must be a multiple of 2"):
        list_cells(make_plan(words=[], tasks={"war": task}))


def test_a_plan_without_frames_keeps_those_of_recipes_and_scales_them():
    words = [*WORDS[4:8], "exploration.anneal_frames=1000"]
    plan = make_plan(
        words=words,
        budget={"seconds": 60},
        factors={"recipe": {"own": ["recipe=deep_maze_9x9"], "none": WORDS[:2]}},
        tasks=change_task(agents=[], scale=[], words=WORDS[8:9]),
        seeds=[0],
    )
    own, none = list_cells(plan)
    assert (own.config.total_frames, none.config.total_frames) == (80_000, ENDLESS_FRAMES)
    own, none = list_cells(plan, scale=0.1)
    assert (own.config.total_frames, none.config.total_frames) == (8_000, ENDLESS_FRAMES)
    assert own.config.exploration.anneal_frames == 100
    assert own.find_share(4_000, 3.0) == pytest.approx(0.5)


def test_a_cell_on_a_gpu_that_is_missing_says_so(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    cell, *_ = list_cells(make_plan(words=[*WORDS, "device=cuda"]))
    assert "device is 'cuda', but PyTorch" in find_shortage(cell)


def test_a_cell_that_this_machine_cannot_hold_says_why():
    words = [*TINY["words"], f"replay.capacity_transitions={10**12}"]
    cell, *_, agent = list_cells(make_plan(words=words))
    assert "replay.capacity_transitions = 1000000000000 needs" in find_shortage(cell)
    assert find_shortage(agent) == ""
    assert find_shortage(list_cells(make_plan())[0]) == ""


def test_two_agents_of_one_name_are_refused():
    agents = ["runs/a/latest", "other/a/best"]
    with pytest.raises(ValueError, match="names of cells .* 'maze-a' twice"):
        list_cells(make_plan(tasks=change_task(agents=agents, scale=[0, 1])))


def test_agents_are_named_by_the_run_that_they_are_of():
    assert [name_agent(one) for one in ("counter", "runs/a/latest", "/x/b/best", "agents/c")] == [
        *("counter", "a", "b", "c")
    ]
