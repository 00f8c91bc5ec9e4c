"""Small data sets of random play for the tests of offline training."""

from marl_cair.games import GAMES
from marl_cair.games.players.random_player import RandomPlayer
from marl_cair.training.collecting.dataset import collect_dataset

LINE_WARS = GAMES["deep_line_wars"]


def collect(folder, num_rows=600, game=LINE_WARS, name="11x11", representation="planes", **options):
    """A data set; of Deep Line Wars in games of 100 steps with shaped rewards."""
    if game is LINE_WARS:
        options = {"max_ticks": 100, "reward": "shaped", **options}
    scenario = game.scenario(name, **options)
    spec = game.make_spec(scenario)
    agents = [RandomPlayer(scenario, spec) for _ in range(spec.num_players)]
    return collect_dataset(folder, game, (name, scenario), representation, agents, num_rows, seed=3)
