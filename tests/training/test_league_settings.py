"""Settings of a league of learners: what is refused, and how the roles differ."""

import pytest

from marl_cair.self_play.shared_folder import ROLES
from marl_cair.training.population.league_settings import LeagueSettings, RoleSettings
from tests.training.leagues import TRAINING, make_league

pytestmark = pytest.mark.usefixtures("test_game")


def exploiter_game(**changes):
    return {"main_exploiter": {"training": {"game": changes}}}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"slice_frames": 0}, "slice_frames is 0, it must be 1 or more"),
        ({"main": {"learners": 0}}, "main.learners is 0, it must be 1 or more"),
        ({"main": {"lerners": 1}}, "unknown option 'lerners': nearest are 'learners'"),
        ({"main": 3}, "main is 3, it must be options by name"),
        ({"main": {"mixture": {"pfps": 1}}}, "unknown opponent 'pfps': nearest are 'pfsp'"),
        ({"league_exploiter": {"reset_chance": 2}}, "league_exploiter.reset_chance is 2.0, it m"),
        ({"final_games": 3}, "final_games is 3, it must be even"),
        ({"final_bots": ["counter"]}, "unknown last_standing bot 'counter'"),
        ({"final_bots": ["idle", "idle"]}, "final_bots has 'idle' twice"),
        (
            {
                "final_games": 2,
                "final_bots": [],
                "main": {"learners": 1},
                "main_exploiter": {"learners": 0},
                "league_exploiter": {"learners": 0},
            },
            r"final_bots is \[\], it must be one or more with one learner, or final_games=0",
        ),
        ({"training": {**TRAINING, "seed": 1}}, "training.seed is given: the league has its own"),
        (
            {"training": {**TRAINING, "opponent": {"mixture": {}}}},
            "training.opponent.mixture is given: set it for a role",
        ),
        (exploiter_game(scenario="teams"), "main_exploiter.training.game is another than main's"),
        (exploiter_game(representation="planes"), "game.representation is 'planes', .* 'vector'"),
        ({"training": {**TRAINING, "opponent": None}}, "training.opponent is None, it must be opt"),
        ({"main": {"training": {"opponent": 3}}}, "main.training.opponent is 3, it must be opt"),
        (
            {"training": {**TRAINING, "game": {**TRAINING["game"], "scenario": "alone"}}},
            "training.game.scenario is 'alone', it must be a scenario of two or more teams",
        ),
    ],
)
def test_bad_settings_are_refused_before_anything_is_written(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        make_league(tmp_path / "league", **changes)
    assert not (tmp_path / "league").exists()


def test_roles_differ_as_in_the_paper():
    settings = LeagueSettings()
    assert [role for _, role in settings.learners] == list(ROLES)
    assert settings.main.reset_chance == 0
    assert settings.main_exploiter.mixture == {"main_agents": 1.0}
    assert settings.main_exploiter.reset_chance == 1
    assert settings.league_exploiter.mixture == RoleSettings().mixture == {"pfsp": 1.0}
    assert settings.league_exploiter.reset_chance == 0.25
