"""Demonstrations: bots play some of the learner's games, which it learns from."""

import dataclasses

import numpy as np
import pytest
import torch

from marl_cair.league.agents.mixtures import save_mixture
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.replay.transition import NO_ACTION
from marl_cair.training.collecting.demonstrations import Demonstrators
from marl_cair.training.collecting.rollout import make_rollout
from marl_cair.training.run import TrainingRun
from marl_cair.training.run_log import read_log
from marl_cair.training.settings.config import TrainConfig
from marl_cair.training.settings.demonstration import DemonstrationSettings
from tests.games import last_standing
from tests.games.last_standing import NOOP, SCORE
from tests.training import runs
from tests.training.runs import by_game, collect, count_by_hand, small, tiny, was_out

pytestmark = pytest.mark.usefixtures("test_game")


def shown_by(*bots, **settings):
    return DemonstrationSettings(bots=bots, **settings)


def shown_in(data):
    """Where a demonstrator plays, bool [..., P]; or, with `advise`, where one advises."""
    return data["player", "expert_action"] != NO_ACTION


def make_run(tmp_path, scenario, mixture, demonstration):
    return TrainingRun(small(tmp_path / "run", scenario, mixture, demonstration=demonstration))


# --- who plays -------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["ffa-3", "teams", "alone"])
def test_the_bot_plays_the_learners_team_for_whole_games_in_its_share_of_them(tmp_path, scenario):
    run = make_run(tmp_path, scenario, {"random": 1.0}, shown_by("idle", share=0.4))
    shares = []
    for game in by_game(collect(run, 12)):
        shown, learned = shown_in(game), game["player", "learned"]
        shares.append(bool(shown.any()))
        assert torch.equal(shown, learned & shares[-1])
        if shares[-1]:
            assert (game["player", "action"][shown] == NOOP).all()  # all that `idle` does
    assert len(shares) > 60
    assert np.mean(shares) == pytest.approx(0.4, abs=0.15)


@pytest.mark.slow
def test_against_itself_one_team_is_shown_and_the_other_plays_on(tmp_path):
    run = make_run(tmp_path, "teams", {"latest": 1.0}, shown_by("idle", share=1.0))
    for game in by_game(collect(run)):
        shown = shown_in(game)
        teams = {int(run.spec.team_of_seat[seat]) for seat in shown.any(0).nonzero().flatten()}
        assert len(teams) == 1
        assert torch.equal(game["player", "learned"], ~was_out(game))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "turn", "opponent"),
    [("teams", None, "random"), ("alone", 5, "latest"), ("teams", 5, "latest")],
)
def test_bots_that_advise_give_their_action_where_the_learner_plays(
    tmp_path, scenario, turn, opponent
):
    demonstration = shown_by("idle", share=0.4, turn_decisions=turn, advise=True)
    run = make_run(tmp_path, scenario, {opponent: 1.0}, demonstration)
    data = collect(run, 12)
    advice, learned = data["player", "expert_action"], data["player", "learned"]
    assert (advice[learned] == NOOP).all()  # the advice of `idle`
    assert (advice[~learned] == NO_ACTION).all()
    followed = (data["player", "action"][learned] == NOOP).float().mean().item()
    assert 0.25 < followed < 0.9  # it plays in its share of games alone


def test_several_bots_take_turns(tmp_path):
    run = make_run(tmp_path, "duel", {"idle": 1.0}, shown_by("random", "scorer", share=1.0))
    data = collect(run, 12)
    asked = {bot.name: len(bot.rows) for bot in run.demonstrators.agents}
    assert min(asked["random"], asked["scorer"]) > 100
    assert torch.equal(shown_in(data), data["player", "learned"])


def make_scorer(scenario, spec):
    """For `demonstration.agents`: an agent from outside of the package."""
    return last_standing.Bot("named by the settings", SCORE)


def make_drawer(scenario, spec):
    """Draws at random, so that its generator has to be saved and restored."""
    return last_standing.Bot("drawer")


def make_saved(tmp_path):
    return runs.make_agent(small(tmp_path / "saved", "duel", {"random": 1.0}))


@pytest.mark.slow
def test_bots_functions_and_checkpoints_take_turns_and_say_what_they_would_do(tmp_path):
    agents = {"scorer": f"{__name__}:make_scorer", "saved": make_saved(tmp_path)}
    demonstration = shown_by("idle", agents=agents, share=1.0, advise=True)
    run = make_run(tmp_path, "duel", {"random": 1.0}, demonstration)
    assert [agent.name for agent in run.demonstrators.agents] == ["idle", "scorer", "saved"]
    saved, seen = run.demonstrators.agents[2], set()
    for game in by_game(collect(run, 12)):
        advice, learned = game["player", "expert_action"], game["player", "learned"]
        mask = game["player", "action_mask"][learned].numpy()
        answers = saved.act(game["player", "observation"][learned].numpy(), mask)
        expected = {"idle": np.full(len(mask), NOOP), "scorer": np.where(mask[:, SCORE], SCORE, 0)}
        expected["saved"] = answers
        seen |= {name for name, said in expected.items() if (advice[learned].numpy() == said).all()}
        assert any((advice[learned].numpy() == said).all() for said in expected.values())
    assert {"idle", "scorer"} <= seen


@pytest.mark.slow
@pytest.mark.parametrize("advise", [False, True])
def test_no_game_is_shown_after_until_frames(tmp_path, advise):
    demonstration = shown_by("idle", share=1.0, until_frames=256, advise=advise)
    run = make_run(tmp_path, "duel", {"idle": 1.0}, demonstration)
    shown = shown_in(collect(run, 12)).any(-1)
    begun = run.config.collector.num_worlds
    assert shown[:, : 256 // begun].all()
    assert not shown[:, -32:].any()


def test_in_turns_bot_and_learner_play_the_same_games(tmp_path):
    demonstration = shown_by("idle", share=0.5, turn_decisions=4)
    run = make_run(tmp_path, "alone", {"random": 1.0}, demonstration)
    lengths, mixed = [], 0
    data = collect(run, 12)
    for game in by_game(data):
        shown = shown_in(game).any(-1).numpy()
        assert (game["player", "action"][shown_in(game)] == NOOP).all()
        mixed += len(set(shown.tolist())) > 1
        changes = np.flatnonzero(np.diff(shown))
        lengths += np.diff(changes).tolist()
    assert mixed > 20
    # The player changes after whole turns; a game's first turn is shorter, and not counted here.
    assert {length % 4 for length in lengths} == {0}
    assert min(lengths) == 4


def test_turns_are_drawn_in_their_share_and_not_by_all_worlds_at_once(tmp_path):
    run = make_run(tmp_path, "alone", {"random": 1.0}, shown_by("idle"))
    settings = shown_by("idle", share=0.3, turn_decisions=10)
    demonstrators = Demonstrators(settings, run.game, run.scenario, num_worlds=200, seed=0)
    starting = np.ones(200, np.bool_)
    seen = []
    for _ in range(100):
        demonstrators.draw(starting, frames=0)
        seen.append(demonstrators.playing.copy())
        starting = np.zeros(200, np.bool_)
    shown = np.array(seen) == 0
    assert shown.mean() == pytest.approx(0.3, abs=0.03)
    changes = (shown[1:] != shown[:-1]).sum(1)
    assert changes.min() > 0
    assert changes.max() < 40


# --- what is stored and counted --------------------------------------------------------------


def test_replay_knows_which_actions_were_shown(tmp_path):
    run = make_run(tmp_path, "duel", {"random": 1.0}, shown_by("idle", share=0.5))
    batches = iter(run.collector)
    rollouts = [make_rollout(next(batches), 1.0) for _ in range(6)]
    for rollout in rollouts:
        run.replay.real.extend_rollout(rollout)
    rows = run.replay.real.sample(4_000)
    shown = rows["expert_action"] != NO_ACTION
    stored = (
        torch.cat([rollout.expert_action[rollout.learned] for rollout in rollouts]) != NO_ACTION
    )
    assert shown.float().mean() == pytest.approx(stored.float().mean().item(), abs=0.05)
    assert (rows["action"][shown] == NOOP).all()
    assert (rows["expert_action"][shown] == NOOP).all()
    assert (rows["action"][~shown] != NOOP).any()
    run.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bot", "turns"), [("scorer", {"share": 0.5}), ("idle", {"share": 0.3, "turn_decisions": 3})]
)
def test_games_with_a_demonstrator_count_neither_as_wins_nor_as_actions(tmp_path, bot, turns):
    run = make_run(tmp_path, "duel", {"random": 1.0}, shown_by(bot, **turns))
    data = collect(run, 12)
    own = [game for game in by_game(data) if not shown_in(game).any()]
    shown = [game for game in by_game(data) if shown_in(game).any()]
    row = run.statistics.report(run.book.name, run.spec.action_group_names)

    def count(games):
        counted = [count_by_hand(game.unsqueeze(0), run.spec.team_of_seat) for game in games]
        return [np.mean([values[n][0] for values in counted]) for n in range(2)]

    points, returns = count(own)
    assert row["episodes/finished"] == len(own) > 5
    assert row["collect_win_rate/random"] == pytest.approx(points)
    assert row["episodes/return"] == pytest.approx(returns, abs=1e-6)
    assert row["demonstrations/return"] == pytest.approx(count(shown)[1], abs=1e-6)
    chosen = data["player", "learned"] & ~shown_in(data)
    share = (data["player", "action"][chosen] == NOOP).float().mean().item()
    assert row["actions/" + run.spec.action_group_names[NOOP]] == pytest.approx(share)


# --- the loss --------------------------------------------------------------------------------


def make_learner(**settings):
    return runs.make_learner(shown_by("random", **settings), 0.01, average_decay=0.0)


def make_batch(actions, expert_actions):
    rows = runs.make_batch()
    rows["action_mask"][:] = True
    rows["action"][:] = torch.tensor(actions)
    rows["expert_action"] = torch.tensor(expert_actions)
    return rows


def test_the_margin_loss_is_the_formula_over_legal_actions():
    learner, batch = make_learner(margin=0.3), runs.make_batch()
    batch["expert_action"] = torch.where(torch.arange(4) < 3, batch["action"], NO_ACTION)
    values = learner.network(batch["observation"]).detach()
    wanted = 0.0
    for row in range(3):
        shown = int(batch["action"][row])
        rivals = [
            float(values[row, action]) + (0.0 if action == shown else 0.3)
            for action in batch["action_mask"][row].nonzero().flatten().tolist()
        ]
        wanted += max(rivals) - float(values[row, shown])
    assert float(learner.update(batch)["loss/margin"]) == pytest.approx(wanted / 4, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("actions", "experts", "least"),
    [
        ([0, 0, 0, 0], [1, 2, 1, 2], 0.0),  # the learner did something else
        ([0, 2, 0, 2], [0, 2, NO_ACTION, NO_ACTION], 0.4),  # others have no expert's action
    ],
)
def test_the_margin_is_learned_for_the_experts_action(actions, experts, least):
    learner = make_learner(margin=0.5, margin_weight=10.0)
    batch = make_batch(actions, experts)
    for _ in range(300):
        learner.update(batch)
    values = learner.network(batch["observation"]).detach()
    for row, action in enumerate(experts):
        if action != NO_ACTION:
            others = [value for index, value in enumerate(values[row]) if index != action]
            assert values[row, action] > max(others) + least


def test_without_demonstrators_an_experts_action_changes_nothing():
    losses = []
    for expert in (NO_ACTION, 0):
        learner = runs.make_learner()
        losses.append(float(learner.update(make_batch([0] * 4, [expert] * 4))["loss/all"]))
        assert not learner.demonstration.is_given
    assert losses[0] == losses[1]


# --- whole runs ------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "turn"), [("teams", None), ("alone", 5)])
def test_a_resumed_run_with_demonstrations_equals_one_that_was_never_stopped(
    tmp_path, scenario, turn
):
    agents = {"drawer": f"{__name__}:make_drawer"} if turn else {}
    demonstration = shown_by(
        "random",
        "scorer",
        agents=agents,
        share=0.5,
        turn_decisions=turn,
        advise=scenario == "teams",
    )
    folders = runs.train_whole_and_in_parts(
        tmp_path, lambda to: small(to, scenario, demonstration=demonstration), until=256
    )
    logs = [read_log(folder / "log.csv") for folder in folders]
    assert any("loss/margin" in row for row in logs[0])
    assert logs[0][-1]["updates"] == logs[1][-1]["updates"] > 0


def test_bots_that_look_at_other_planes_than_the_learner_can_show(tmp_path):
    """Bots of Deep Line Wars need planes, whatever the learner's representation."""
    config = tiny(tmp_path / "a", 512, demonstration=shown_by("counter", share=1.0))
    game = dataclasses.replace(config.game, representation="vector")
    policy = QNetworkConfig(body="mlp", hidden_width=16)
    config = dataclasses.replace(config, game=game, policy=policy, synthetic_fraction=0.0)
    run = TrainingRun(config)
    data = next(iter(run.collector))
    assert shown_in(data).any()
    run.close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"bots": ("rushre",)}, "rushre"),
        ({"advise": True}, "demonstration.advise is True, it must be false where"),
        ({"bots": ("counter",), "share": 1.5}, "demonstration.share is 1.5, it must be in 0..1"),
        ({"bots": ("counter",), "margin": -0.1}, "demonstration.margin is -0.1, it must be 0 or"),
        ({"until_frames": -1}, "demonstration.until_frames is -1, it must be 0 or more"),
    ],
)
def test_settings_that_cannot_be_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        TrainConfig(demonstration=DemonstrationSettings(**changes))


def test_a_mixture_that_is_to_show_is_refused_before_any_work(tmp_path):
    member = make_saved(tmp_path)
    save_mixture(tmp_path / "mixed", [member, "last_standing/idle"], [0.5, 0.5])
    demonstration = DemonstrationSettings(agents={"mixed": str(tmp_path / "mixed")})
    with pytest.raises(ValueError, match="demonstration.agents.mixed is .*no mixture"):
        make_run(tmp_path, "duel", {"random": 1.0}, demonstration)
