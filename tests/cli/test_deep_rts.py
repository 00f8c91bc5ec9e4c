"""Deep RTS through the console command, for each number of seats, from training to the match."""

import pytest

from marl_cair.cli import main
from marl_cair.cli.compose import compose_config
from marl_cair.training.run_log import read_log

SMALL = (
    *("game=deep_rts", "torch_threads=1", "max_ticks=300", "policy.hidden_width=16"),
    *("collector.num_worlds=8", "collector.steps_per_batch=16", "learner.batch_size=32"),
    *("replay.min_transitions=300", "replay.capacity_transitions=4000"),
    *("generator.evaluate_every_frames=512", "evaluation.every_frames=512", "evaluation.games=2"),
)


def test_map_sets_are_named_for_training_and_beside_it():
    words = ["game=deep_rts", "map=train-15x15-2p", "heldout_map=test-15x15-2p"]
    config = compose_config(words)
    assert config.game.options == {"map": "train-15x15-2p"}
    assert config.evaluation.scenarios == {"heldout": {"map": "test-15x15-2p"}}
    trained, heldout = config.evaluated_scenarios().values()
    assert (trained.map, heldout.map) == ("train-15x15-2p", "test-15x15-2p")
    seeds = [{game_map.name for game_map in scenario.maps} for scenario in (trained, heldout)]
    assert seeds[0].isdisjoint(seeds[1])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "words", "logged"),
    [
        (
            "1v1-15x15",
            ["map=train-15x15-2p", "heldout_map=test-15x15-2p", "opponent=self_play"],
            {"win_rate/random", "win_rate/random@heldout", "win_rate/random@heldout/low"},
        ),
        ("FFA-3-15x15", ["opponent=self_play"], {"win_rate/random", "fair_share/learner"}),
        ("FFA-6-15x15", ["opponent=bots"], {"win_rate/random", "fair_share/learner"}),
        ("Teams-2v2-15x15", ["opponent=self_play"], {"win_rate/random", "episodes/return"}),
        ("Economy-15x15", [], {"return/learner", "return/random", "return_gain/random"}),
        ("FFA-4-15x15", ["actions=classic", "opponent=latest"], {"win_rate/random"}),
    ],
)
def test_a_run_goes_from_start_to_match(tmp_path, capsys, scenario, words, logged):
    out = str(tmp_path / "run")
    train = ["train", *SMALL, f"scenario={scenario}", *words, f"out={out}"]
    assert main([*train, "total_frames=1024"]) == 0
    assert main(["train", f"resume={out}", "total_frames=1152"]) == 0
    rows = read_log(tmp_path / "run" / "log.csv")
    assert logged <= set(rows[-2])
    assert rows[-1]["updates"] > rows[-2]["updates"] > 0
    capsys.readouterr()
    assert main(["match", f"{out}/latest", "random", "--games", "4"]) == 0
    shown = capsys.readouterr().out
    assert f"on deep_rts {scenario}\n" in shown
    assert ("mean score of A" in shown) == (scenario == "Economy-15x15")
    assert ("of the points" in shown) == (scenario != "Economy-15x15")
