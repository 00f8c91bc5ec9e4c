"""The positive control of `league exploit` on a real game: a weakness that was planted is found."""

import pytest

from marl_cair.games.deep_line_wars.observation import ENEMY_UNITS
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.match import play_match
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.training.population.exploit import ExploitConfig, exploit
from marl_cair.training.settings import config as settings
from marl_cair.training.settings.config import GameSettings, TrainConfig
from marl_cair.training.settings.learner import LearnerSettings
from tests.league.players import GAME

FRAMES = 12_000
SCENARIO = GAME.scenario("11x11")
UNSEEN = [ENEMY_UNITS + kind for kind in (0, 2, 3)]  # all but footmen


class Blind:
    """The bot `counter`, which never sees most kinds of the enemy's units, and builds no towers
    against them.
    """

    representation = "planes"

    def __init__(self, bot):
        self.bot = bot

    def act(self, observation, action_mask):
        observation[:, UNSEEN] = 0
        return self.bot.act(observation, action_mask)


def make_sound(scenario, spec):
    return load_agent("counter", GAME.name, scenario)


def make_blind(scenario, spec):
    return Blind(make_sound(scenario, spec))


def look_for_a_weakness(folder, make):
    learner = TrainConfig(
        torch_threads=1,
        policy=QNetworkConfig(body="mlp"),
        game=GameSettings(scenario="11x11", representation="vector"),
        collector=settings.CollectorSettings(num_worlds=32),
        exploration=settings.ExplorationSettings(anneal_frames=FRAMES // 2),
        replay=settings.ReplaySettings(FRAMES, 100, min_transitions=1_000),
        learner=LearnerSettings(frames_per_update=16),
        generator=settings.GeneratorSettings(name="none"),
        synthetic_fraction=0.0,
        checkpoint=settings.CheckpointSettings(include_replay=False),
    )
    agent = f"{__name__}:{make.__name__}"
    config = ExploitConfig(agent, learner, FRAMES, seeds=2, games=128, out=str(folder))
    return exploit(config, show_progress=False).chosen


@pytest.mark.slow
def test_the_same_budget_exploits_the_bot_with_the_weakness_and_not_the_sound_one(tmp_path):
    """By learning: a random policy rarely wins against either."""
    rated = GAME.scenario("11x11", reward=GAME.rated_reward)
    idle = load_agent("random", GAME.name, rated)
    blind = load_agent(f"{__name__}:make_blind", GAME.name, rated)
    assert play_match(idle, blind, GAME, rated, 64, 0).score < 0.3
    weak = look_for_a_weakness(tmp_path / "weak", make_blind)
    sound = look_for_a_weakness(tmp_path / "sound", make_sound)
    assert weak.score >= 0.8
    assert sound.high < 0.5
    assert weak.low > sound.high
