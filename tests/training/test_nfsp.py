"""Neural fictitious self-play in a training run: who plays, what is learned, kept and resumed."""

import dataclasses

import numpy as np
import pytest
import torch

from marl_cair.checkpoint import read_description
from marl_cair.league.agents.load import describe_agent, find_fingerprint, load_agent
from marl_cair.replay.transition import NO_ACTION
from marl_cair.training import trainer
from marl_cair.training.collecting.demonstrations import NO_DEMONSTRATOR
from marl_cair.training.run import TrainingRun
from marl_cair.training.run_log import read_log
from marl_cair.training.settings.config import ReplaySettings
from marl_cair.training.settings.learner import LearnerSettings, NfspSettings
from tests.damage import forget_checksums
from tests.games.last_standing import SCORE
from tests.training import runs
from tests.training.runs import small, tiny

pytestmark = pytest.mark.usefixtures("test_game")
NFSP = NfspSettings(enabled=True, eta=0.3, capacity_rows=400, min_rows=50, batch_size=16)


def average_digest(folder):
    state = torch.load(folder / "resume" / "state.pt", weights_only=True)
    weights = state["average_policy"]["network"].values()
    rows = (folder / "resume" / "reservoir" / "reservoir").glob("*.npy")
    parts = [value.numpy().tobytes() for value in weights]
    return parts, [path.read_bytes() for path in sorted(rows)]


@pytest.mark.slow
def test_the_q_network_plays_whole_games_of_whole_teams_in_its_share_of_them(tmp_path):
    run = TrainingRun(small(tmp_path / "a", "teams", {"latest": 1.0}, nfsp=NFSP))
    data = runs.collect(run, 12)
    teams = run.spec.team_of_seat
    answered = []
    for game in runs.by_game(data):
        for team in set(teams.tolist()):
            seats = torch.from_numpy(np.flatnonzero(teams == team))
            learned = game["player", "learned"][:, seats]
            by_q = game["player", "answered"][:, seats][learned]
            assert by_q.all() or not by_q.any()
            answered.append(bool(by_q[0]))
    share, sigma = np.mean(answered), (0.3 * 0.7 / len(answered)) ** 0.5
    assert len(answered) > 30
    assert abs(share - 0.3) < 4 * sigma


def test_only_own_real_decisions_of_the_q_network_with_a_choice_are_remembered(tmp_path):
    config = small(tmp_path / "a", "ffa-4", nfsp=NFSP)
    shown = dataclasses.replace(config.demonstration, bots=("idle",), share=0.5)
    run = TrainingRun(dataclasses.replace(config, demonstration=shown))
    data = next(iter(run.collector))
    group = data["player"]
    run.average_policy.remember(data)
    choice = group["action_mask"].sum(-1) > 1
    wanted = group["answered"] & choice
    assert run.average_policy.reservoir.num_seen == int(wanted.sum()) > 0
    assert not (
        group["answered"] & ((group["expert_action"] != NO_ACTION) | ~group["learned"])
    ).any()
    assert (run.demonstrators.playing != NO_DEMONSTRATOR).any()
    run.close()


def test_generated_rows_are_a_fifth_of_what_q_learns_from_and_none_of_the_averages(tmp_path):
    config = tiny(tmp_path / "a", nfsp=NFSP)
    run = TrainingRun(config)
    remembered = []
    run.average_policy.reservoir.extend = lambda *rows: remembered.append(rows)
    steps = runs.fill_replays(run)
    run.replay.generated_open = True
    batch = run.replay.sample()
    assert int(batch["is_generated"].sum()) == round(0.2 * len(batch))
    before = len(remembered)
    next(steps)
    assert len(remembered) == before + 1  # what the collector brought, and nothing else
    run.close()


@pytest.mark.slow
def test_a_resumed_run_equals_one_that_was_never_stopped(tmp_path):
    """With snapshots that draw their actions too."""
    folders = runs.train_whole_and_in_parts(
        tmp_path, lambda to: small(to, "teams", nfsp=NFSP), until=256
    )
    averages = [average_digest(folder) for folder in folders]
    assert averages[0] == averages[1]
    assert len(list((folders[0] / "snapshots").glob("frames_*"))) > 2
    row = read_log(folders[0] / "log.csv")[-1]
    assert row["average/loss"] > 0
    assert 0 < row["average/rows"] <= 400


@pytest.mark.parametrize("played", ["average", "greedy"])
def test_what_is_asked_for_is_rated_kept_and_frozen(tmp_path, played):
    settings = dataclasses.replace(NFSP, played=played)
    run = TrainingRun(small(tmp_path / "a", "duel", nfsp=settings))
    own = run.average_policy.network if played == "average" else run.learner.average
    plays = "sampled" if played == "average" else "greedy"
    assert run.rated.network is own
    run.save_agent()
    run.add_snapshot()
    frozen = run.book.pool.agent(run.book.pool.snapshots[0].number)
    kept = load_agent(tmp_path / "a" / "latest")
    for agent in (frozen, kept):
        assert agent.is_sampled == (played == "average")
        for mine, theirs in zip(own.parameters(), agent.network.parameters(), strict=True):
            assert torch.equal(mine, theirs)
    assert read_description(tmp_path / "a" / "latest").plays == plays
    assert describe_agent("a", kept, run.game).evaluation_policy == plays
    run.close()


def test_the_same_weights_are_another_agent_where_they_are_sampled(tmp_path):
    run = TrainingRun(small(tmp_path / "a", "duel", nfsp=NFSP))
    run.save_agent()
    kept = load_agent(tmp_path / "a" / "latest")
    path = tmp_path / "a" / "latest" / "agent.json"
    forget_checksums(path.parent)
    path.write_text(path.read_text().replace('"sampled"', '"greedy"'))
    greedy = load_agent(tmp_path / "a" / "latest")
    assert find_fingerprint(kept, run.game) != find_fingerprint(greedy, run.game)
    path.write_text(path.read_text().replace('"greedy"', '"gredy"'))
    with pytest.raises(ValueError, match="unknown way to play 'gredy': nearest are 'greedy'"):
        load_agent(tmp_path / "a" / "latest")
    run.close()


@pytest.mark.slow
def test_the_average_learns_what_the_q_network_does(tmp_path):
    """The Q-network always scores: the average policy learns to score."""
    config = small(
        tmp_path / "a",
        "duel",
        {"idle": 1.0},
        frames=4_096,
        nfsp=dataclasses.replace(NFSP, eta=1.0, frames_per_update=16, learning_rate=1e-2),
        replay=ReplaySettings(3_000, 300, min_transitions=2_999),
        learner=LearnerSettings(batch_size=16),
    )
    silent = dataclasses.replace(config.exploration, epsilon_start=0.0, epsilon_end=0.0)
    run = TrainingRun(dataclasses.replace(config, exploration=silent))
    with torch.no_grad():
        for name, value in run.learner.network.named_parameters():
            value.zero_()
            if name.endswith("bias") and value.shape == (run.spec.num_actions,):
                value[SCORE] = 1.0
    seen = run.env.current()["player", "observation"].flatten(0, 1)
    assert (run.actor.compute_values(seen).argmax(-1) == SCORE).all()
    steps = trainer.iterate(run, trainer.Timers())
    while run.frames < 2_000:
        next(steps)
    seen = run.env.current()["player", "observation"].flatten(0, 1)
    chances = run.average_policy.network(seen).softmax(-1)
    assert chances[:, SCORE].min() > 0.9
    run.close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"eta": 0.0}, "nfsp.eta is 0.0, it must be above 0, at most 1"),
        ({"played": "mean"}, "unknown nfsp.played 'mean'"),
        ({"capacity_rows": 10}, "nfsp.capacity_rows is 10, it must be 1000 .nfsp.min_rows. or mo"),
        ({"learning_rate": 0.0}, "nfsp.learning_rate is 0.0, it must be above 0"),
    ],
)
def test_settings_that_cannot_be_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        NfspSettings(enabled=True, **changes)
