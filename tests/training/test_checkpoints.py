"""Agent checkpoints: what does not fit, is cut short or holds code is refused by name."""

import json

import pytest
import torch

from marl_cair.checkpoint import CheckpointError, load_network, load_tensors, save_tensors
from marl_cair.league.agents.load import find_scenario, load_agent
from marl_cair.training.state_file import STATE_FILE
from tests.damage import forget_checksums
from tests.training.runs import GAME, tiny, train


@pytest.fixture
def agent(finished_copy):
    return finished_copy / "latest"


class TestCheckpoints:
    """The error names what does not fit."""

    def test_an_agent_plays_what_it_was_trained_on(self, agent):
        network, about = load_network(agent)
        assert about.scenario == "11x11"
        assert about.scenario_options["reward"] == "shaped"  # that it learned from
        assert find_scenario([str(agent)])[2]["reward"] == GAME.rated_reward
        assert network.num_actions == len(about.action_names)
        assert load_agent(agent).representation == "planes"

    def test_other_action_space(self, agent):
        classic = GAME.scenario("11x11", actions="classic")
        with pytest.raises(CheckpointError, match="has another action space"):
            load_agent(agent, "deep_line_wars", classic)

    def test_other_board(self, agent):
        with pytest.raises(CheckpointError, match="action space|of the size it was trained on"):
            load_agent(agent, "deep_line_wars", "10x15")

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ('"game_version": "1"', '"game_version": "0"', "was trained on version 0"),
            ('"game": "deep_line_wars"', '"game": "chess"', "was trained on chess|unknown game"),
            ('"format_version": 1', '"format_version": 9', "its format version is 9"),
            ('"format": "marl_cair agent"', '"format": "other"', "of another program"),
            ('"body": "conv"', '"body": "cnv"', "unknown network 'cnv': nearest are 'conv'"),
        ],
    )
    def test_description_of_something_else(self, agent, old, new, message):
        path = agent / "agent.json"
        text = path.read_text("utf-8")
        assert old in text
        forget_checksums(agent)
        path.write_text(text.replace(old, new), "utf-8")
        with pytest.raises(ValueError, match=message):
            load_agent(agent)

    def test_options_that_are_no_options(self, agent):
        path = agent / "agent.json"
        record = json.loads(path.read_text("utf-8"))
        forget_checksums(path.parent)
        path.write_text(json.dumps({**record, "scenario_options": [1]}), "utf-8")
        with pytest.raises(CheckpointError, match=r"scenario_options is \[1\], it must be values"):
            load_agent(agent)

    def test_truncated_weights(self, agent):
        path = agent / "weights.pt"
        forget_checksums(path.parent)
        path.write_bytes(path.read_bytes()[:1_000])
        with pytest.raises(CheckpointError, match="is cut short, or holds more than tensors"):
            load_agent(agent)

    def test_code_in_the_weights_is_not_run(self, agent, tmp_path):
        class Payload:
            def __reduce__(self):
                return (open, (str(tmp_path / "ran"), "w"))

        forget_checksums(agent)
        torch.save({"weights": Payload()}, agent / "weights.pt")
        with pytest.raises(CheckpointError, match="holds more than tensors"):
            load_agent(agent)
        assert not (tmp_path / "ran").exists()

    def test_missing_weights(self, agent):
        (agent / "weights.pt").unlink()
        with pytest.raises(CheckpointError, match="is missing: the checkpoint is incomplete"):
            load_agent(agent)


class TestStates:
    """The states of interrupted runs."""

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"version": 1}, r"has version 1, this marl_cair resumes 6: .*[\\/]first[\\/]latest"),
            ({"version": None}, "state.pt has version 0"),  # states had no versions at first
            ({"frames": None}, "does not fit .*settings, or is damaged: .*frames is missing"),
        ],
    )
    def test_state_of_something_else(self, finished_copy, change, message):
        path = finished_copy / "resume" / STATE_FILE
        state = {**load_tensors(path), **change}
        forget_checksums(path.parent)
        save_tensors({name: value for name, value in state.items() if value is not None}, path)
        with pytest.raises(CheckpointError, match=message):
            train(tiny(finished_copy, 768), resume=True)
