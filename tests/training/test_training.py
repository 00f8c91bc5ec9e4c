"""Training runs: they resume bit for bit, keep to the share of generated rows, and learn."""

import dataclasses
import os
import shutil
import sys

import pytest
import torch

from marl_cair.checkpoint import CheckpointError, load_network
from marl_cair.cli import main
from marl_cair.files import OutputFolderError
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.match import play_match
from marl_cair.policies.q_network import QNetworkConfig, make_q_network
from marl_cair.training.collecting.rollout import make_rollout
from marl_cair.training.evaluation import rate_on
from marl_cair.training.learner import Learner
from marl_cair.training.run import TrainingRun
from marl_cair.training.run_log import read_log
from marl_cair.training.settings.config import (
    CheckpointSettings,
    CollectorSettings,
    EvaluationSettings,
    ExplorationSettings,
    GameSettings,
    GeneratorSettings,
    OpponentSettings,
    ReplaySettings,
    TrainConfig,
)
from marl_cair.training.settings.config_file import load_config
from marl_cair.training.settings.learner import LearnerSettings
from tests.damage import forget_checksums
from tests.training import runs
from tests.training.runs import GAME, NEVER, digest, make_batch, make_learner, tiny, train


@pytest.mark.parametrize("body", ["conv", pytest.param("capsule", marks=pytest.mark.slow)])
def test_a_resumed_run_equals_one_that_was_never_stopped_and_one_of_another_seed_differs(
    tmp_path, body
):
    """The learning rate falls over the whole run, also where that is trained in parts."""
    policy = QNetworkConfig(body=body, hidden_width=32, cell_values=body == "capsule")

    def make(folder):
        config = tiny(folder, 768, policy=policy)
        learner = dataclasses.replace(config.learner, learning_rate_end=0.0)
        return dataclasses.replace(config, learner=learner)

    whole, _ = runs.train_whole_and_in_parts(tmp_path, make, until=512)
    train(dataclasses.replace(make(tmp_path / "other"), seed=1))
    assert digest(whole) != digest(tmp_path / "other")


def test_a_folder_of_another_run_is_refused_and_left_alone(finished_copy):
    before = digest(finished_copy)
    with pytest.raises(OutputFolderError, match="already holds this .* `marl-cair train resume="):
        train(tiny(finished_copy, 640))
    with pytest.raises(OutputFolderError, match=r"other settings \(seed is 0 there, 4 here\)"):
        train(tiny(finished_copy, 640, seed=4), resume=True)
    assert digest(finished_copy) == before


def test_a_cut_state_is_refused(finished_copy):
    state = finished_copy / "resume" / "state.pt"
    forget_checksums(state.parent)
    state.write_bytes(state.read_bytes()[: state.stat().st_size // 2])
    with pytest.raises(CheckpointError, match="is cut short"):
        train(tiny(finished_copy, 768), resume=True)


def test_generated_rows_are_a_fifth_of_each_batch_only_while_the_gate_is_open(tmp_path):
    run = TrainingRun(tiny(tmp_path / "a"))
    runs.fill_replays(run)
    assert not run.replay.sample()["is_generated"].any()
    run.replay.generated_open = True
    for _ in range(5):
        batch = run.replay.sample()
        assert batch.shape[0] == 20
        assert int(batch["is_generated"].sum()) == 4
        assert torch.isfinite(torch.as_tensor(run.learner.update(batch)["loss/all"]))
    run.close()


def test_only_the_learners_seats_are_stored_and_both_against_itself(tmp_path):
    for mixture, expected in (({"latest": 1.0}, 2), ({"counter": 1.0}, 1)):
        opponent = OpponentSettings(mixture, snapshot_every_frames=NEVER)
        folder = tmp_path / next(iter(mixture))
        run = TrainingRun(tiny(folder, opponent=opponent, synthetic_fraction=0.0))
        data = next(iter(run.collector))
        learned = data["player", "learned"]
        assert learned.sum(-1).eq(expected).all()
        run.close()


def test_an_opponent_stays_for_the_whole_game(tmp_path):
    opponent = OpponentSettings({"random": 0.5, "counter": 0.5})
    run = TrainingRun(tiny(tmp_path / "a", opponent=opponent, synthetic_fraction=0.0))
    data = runs.collect(run, 10)
    met, seat = data["player", "opponent"][..., 0], data["player", "learned"].int().argmax(-1)
    going_on = ~data["next", "done"].squeeze(-1)[:, :-1]
    assert (met[:, 1:] == met[:, :-1])[going_on].all()
    assert (seat[:, 1:] == seat[:, :-1])[going_on].all()
    assert (~going_on).any()
    assert len(met.unique()) == 2
    assert len(seat.unique()) == 2


def test_gradients_reach_every_parameter_of_both_networks(tmp_path):
    for body in ("conv", "capsule"):
        run = TrainingRun(tiny(tmp_path / body, policy=QNetworkConfig(body=body)))
        batches = iter(run.collector)
        for _ in range(3):
            run.replay.real.extend_rollout(make_rollout(next(batches), 1.0, num_others=1))
        learner = Learner(run.learner.network, LearnerSettings())
        learner.update(run.replay.sample(64))
        for name, parameter in run.learner.network.named_parameters():
            assert parameter.grad is not None, name
            assert parameter.grad.abs().sum() > 0, name
        run.close()


def test_averaged_weights_have_the_newest_running_means():
    network = make_q_network(QNetworkConfig(hidden_width=8), (2, 8, 8), 3, seed=0)
    network.body.norm = torch.nn.BatchNorm2d(2)
    learner = Learner(network, LearnerSettings())
    network.body.norm.running_mean.fill_(2.0)
    learner._follow()
    for following in (learner.average, learner.behaviour):
        assert following.body.norm.running_mean.tolist() == [2.0, 2.0]


@pytest.mark.parametrize("behaviour", ["newest", "averaged"])
def test_a_network_that_collects_values_a_row_alone(behaviour):
    network = make_q_network(QNetworkConfig(hidden_width=4), (2, 11, 11), 3, seed=0)
    network.body.norm = torch.nn.BatchNorm2d(2)
    learner = Learner(network, LearnerSettings(behaviour=behaviour))
    assert network.training
    for acting in (learner.behaviour, learner.newest):
        assert not acting.training
    weights = zip(network.parameters(), learner.newest.parameters(), strict=True)
    assert all(one is other for one, other in weights)


def test_an_error_frees_the_folder_and_a_resume_goes_on(tmp_path):
    config, kept = tiny(tmp_path / "run", generator=GeneratorSettings("none")), []

    def fail(run):
        if run.frames:
            raise RuntimeError("no luck")
        return True

    try:
        train(config, watch=fail)
    except RuntimeError as error:
        kept.append(error)  # with all that its traceback holds, as in a notebook
    assert kept
    assert train(config, resume=True).frames == config.total_frames


def test_averaged_weights_are_the_moving_average_of_the_weights():
    learner = make_learner(average_decay=0.6)
    expected = [value.clone() for value in learner.network.parameters()]
    for _ in range(20):
        learner.update(make_batch())
        newest = list(learner.network.parameters())
        pairs = zip(expected, newest, strict=True)
        expected = [0.6 * old + 0.4 * new for old, new in pairs]
    averaged = list(learner.average.parameters())
    for average, wanted in zip(averaged, expected, strict=True):
        assert not average.requires_grad
        torch.testing.assert_close(average, wanted)
    assert any(not torch.equal(a, b) for a, b in zip(newest, averaged, strict=True))


def test_without_decay_the_average_is_the_newest_network():
    learner = make_learner(average_decay=0.0)
    learner.update(make_batch())
    pairs = zip(learner.network.parameters(), learner.average.parameters(), strict=True)
    for newest, average in pairs:
        torch.testing.assert_close(newest, average)


@pytest.mark.parametrize("is_on", [False, True])
def test_with_autocast_the_body_learns_in_bfloat16_and_weights_stay_float32(is_on):
    """Acting, as in evaluations, computes in float32."""
    learner, dtypes = make_learner(autocast=is_on), []
    for network in (learner.network, learner.average):
        network.body.dense.register_forward_hook(lambda _, inputs, out: dtypes.append(out.dtype))
    losses = [float(learner.update(make_batch())["loss/all"]) for _ in range(30)]
    assert set(dtypes) == {torch.bfloat16 if is_on else torch.float32}
    dtypes.clear()
    learner.network(make_batch()["observation"])
    learner.average(make_batch()["observation"])
    assert dtypes == [torch.float32] * 2
    assert {value.dtype for value in learner.network.parameters()} == {torch.float32}
    exact = float(make_learner().update(make_batch())["loss/all"])
    assert (losses[0] != exact) == is_on
    assert losses[0] == pytest.approx(exact, rel=0.02)
    assert sum(losses[-5:]) / 5 < 0.5 * exact


def test_the_learning_rate_falls_in_a_straight_line_to_its_end():
    learner = make_learner(learning_rate_end=0.01)
    for done, wanted in ((0.0, 0.05), (0.5, 0.03), (1.0, 0.01), (1.2, 0.01)):
        learner.update(make_batch(), done)
        assert learner.optimizer.param_groups[0]["lr"] == pytest.approx(wanted)
    still = make_learner(learning_rate_end=0.0)
    before = [value.clone() for value in still.network.parameters()]
    still.update(make_batch(), 1.0)
    for old, new in zip(before, still.network.parameters(), strict=True):
        assert torch.equal(old, new)


def test_the_best_agent_is_kept_and_the_bound_survives_a_resume(finished_copy):
    config = tiny(finished_copy, 640)
    run = TrainingRun(config, resume=True)
    for score, is_kept in ((0.5, True), (0.4, False), (0.5, True)):
        run.frames += 1
        run.note_score(score)
        assert (load_network(finished_copy / "best")[1].frames == run.frames) == is_kept
    run.save_state()
    run.close()
    again = TrainingRun(config, resume=True)
    assert again.best_score == 0.5
    again.close()


def test_evaluation_rates_the_averaged_weights_and_leaves_exploration_alone(tmp_path):
    run = TrainingRun(tiny(tmp_path / "a"))
    assert run.rated.network is run.learner.average
    before = run.actor.state_dict()["generator"].clone()
    rate_on(run.rated, run.game, run.scenario, ("random",), 2, 0)
    assert torch.equal(run.actor.state_dict()["generator"], before)
    run.save_agent()
    saved, _ = load_network(tmp_path / "a" / "latest")
    for kept, average in zip(saved.parameters(), run.learner.average.parameters(), strict=True):
        assert torch.equal(kept, average)
    run.close()


def test_the_learner_beats_random_on_a_small_board(tmp_path):
    config = TrainConfig(
        out=str(tmp_path / "a"),
        total_frames=8_192,
        torch_threads=1,
        synthetic_fraction=0.0,
        policy=QNetworkConfig(body="mlp", hidden_width=64),
        game=GameSettings(representation="vector", options={"rows": 8, "columns": 9}),
        opponent=OpponentSettings({"random": 1.0}),
        collector=CollectorSettings(num_worlds=32, steps_per_batch=16),
        exploration=ExplorationSettings(anneal_frames=4_000),
        replay=ReplaySettings(min_transitions=1_000),
        learner=LearnerSettings(batch_size=64, frames_per_update=16, learning_rate=1e-3),
        evaluation=EvaluationSettings(every_frames=NEVER, bots=()),
        checkpoint=CheckpointSettings(every_frames=NEVER, include_replay=False),
    )
    train(config)
    agent = load_agent(tmp_path / "a" / "latest")
    scenario = GAME.scenario("10x15", **config.game.options)
    match = play_match(agent, GAME.bot("random", scenario), GAME, scenario, 60, 0)
    assert match.score >= 0.8


def test_the_log_holds_losses_action_shares_and_the_speed_of_each_sitting(finished_copy):
    """The gate was evaluated once, at 512 steps."""
    train(tiny(finished_copy, 768), resume=True)
    rows = read_log(finished_copy / "log.csv")
    assert [row["frames"] for row in rows] == [640, 768]
    assert {"td_error/real", "loss/all", "gate/passed"} <= set(rows[0])
    shares = [value for name, value in rows[0].items() if name.startswith("actions/")]
    assert sum(shares) == pytest.approx(1.0)
    for row, frames in zip(rows, (640, 128), strict=True):
        seconds = sum(value for name, value in row.items() if name.startswith("seconds/"))
        assert row["frames_per_second"] == pytest.approx(frames / seconds)
    assert (finished_copy / "snapshots" / "frames_0000000384" / "agent.json").is_file()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TrainConfig(synthetic_fraction=0.95), "synthetic_fraction is 0.95"),
        (lambda: GameSettings(name="chess"), "unknown game 'chess'"),
        (lambda: GameSettings(scenario="10x16"), "nearest are '10x15'"),
        (lambda: GameSettings(representation="plane"), "nearest are 'planes'"),
        (lambda: GameSettings(reward="dense"), "unknown deep_line_wars reward"),
        (lambda: OpponentSettings({}), "one or more weights"),
        (lambda: OpponentSettings({"random": -1.0}), "it must be 0 or more"),
        (lambda: TrainConfig(opponent=OpponentSettings({"conter": 1.0})), "nearest are 'counter'"),
        (lambda: LearnerSettings(gamma=1.5), "learner.gamma is 1.5"),
        (lambda: LearnerSettings(target="sof"), "nearest are 'soft'"),
        (lambda: ReplaySettings(10, min_transitions=20), "it must be 20 or more"),
        (lambda: GeneratorSettings(name="gan"), "unknown generator 'gan'"),
        (lambda: EvaluationSettings(games=0), "evaluation.games is 0, it must be 1 or more"),
        (lambda: TrainConfig(torch_threads=0), r"torch_threads is 0, it must be 1\.\.1024"),
        (lambda: OpponentSettings({"uniform": float("inf")}), "it must be 0 or more"),
        (lambda: OpponentSettings(warmup_frames=-5), "opponent.warmup_frames is -5"),
        (lambda: OpponentSettings(delta=1.0), "opponent.delta is 1.0, it must be 0 or more, below"),
        (lambda: OpponentSettings(half_life_frames=0), "opponent.half_life_frames is 0"),
        (lambda: OpponentSettings(snapshot_margin=0.5), "opponent.snapshot_margin is 0.5"),
        (lambda: OpponentSettings(prior_games=0), "opponent.prior_games is 0"),
        (lambda: OpponentSettings(agents={"pfsp": "a:b"}), "opponent.agents is 'pfsp'"),
        (lambda: opposed(agents={"counter": "a:b"}), "agents is 'counter', .* bots have"),
        (lambda: CollectorSettings(num_worlds=2.5), "num_worlds is 2.5, it must be a whole number"),
        (lambda: CollectorSettings(num_worlds=True), "num_worlds is True, it must be a whole"),
        (lambda: CollectorSettings(num_worlds="4"), "num_worlds is '4', it must be a whole number"),
        (lambda: LearnerSettings(double="false"), "double is 'false', it must be True or False"),
        (lambda: LearnerSettings(gamma="0.9"), "gamma is '0.9', it must be a number"),
        (lambda: GameSettings(options={"reward": "sparse"}), "left out: set game.reward"),
        (lambda: GameSettings(options={"shaping_discount": 0.9}), "left out: set learner.gamma"),
    ],
)
def test_bad_settings_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def opposed(**changes):
    return TrainConfig(opponent=OpponentSettings(**changes))


def test_the_generator_needs_planes_frames_or_a_vector(tmp_path):
    settings = GameSettings(scenario="11x11", representation="heatmap")
    with pytest.raises(
        ValueError, match=r"works on `planes`, `gray`, stacks of frames .* not on .heatmap."
    ):
        TrainingRun(tiny(tmp_path / "a", game=settings))


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="limits the files of a forked process")
def test_a_full_disk_ends_the_run_with_a_clear_error_and_keeps_what_was_saved(finished_copy, capfd):
    """The operating system refuses the write, as it does on a full disk."""
    import resource

    before = digest(finished_copy)
    child = os.fork()
    if child == 0:
        code = 99
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
            code = main(["train", f"resume={finished_copy}", "total_frames=768"])
            sys.stderr.flush()
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 2
    error = capfd.readouterr().err
    assert "could not be written, the disk is full" in error
    assert "Traceback" not in error
    assert digest(finished_copy) == before
    assert not list(finished_copy.rglob("*unfinished*"))
    train(tiny(finished_copy, 768), resume=True)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        # A network that cannot read the observation.
        ({"game": GameSettings(scenario="11x11", representation="vector")}, "use body='mlp'"),
        (
            {
                "game": GameSettings("deep_rts", "1v1-15x15", options={"actions": "classic"}),
                "evaluation": EvaluationSettings(bots=("random", "mixed")),
            },
            "actions",
        ),
    ],
)
def test_settings_that_no_run_can_have_leave_the_folder_free(tmp_path, changes, message):
    changes |= {"generator": GeneratorSettings("none"), "opponent": OpponentSettings({"random": 1})}
    with pytest.raises(ValueError, match=message):
        train(tiny(tmp_path / "a", **changes))
    assert not (tmp_path / "a").exists()


def test_a_moved_run_resumes_where_it_lies_now(finished, tmp_path):
    shutil.copytree(finished, tmp_path / "b")
    before = digest(finished)
    config = dataclasses.replace(load_config(tmp_path / "b"), total_frames=768)
    assert config.out == str(tmp_path / "b")
    train(config, resume=True)
    assert digest(finished) == before != digest(tmp_path / "b")
    assert load_config(tmp_path / "b").total_frames == 768
