"""The folder of a game: what it holds, and what is refused before anything is compiled."""

import json

import pytest

from marl_cair.browser import runtime
from marl_cair.browser.folder import Opponent, describe_game, write_folder
from marl_cair.games import GAMES
from marl_cair.npm import InstallError

BOT = Opponent("random", bot="random")


def describe(name, scenario=None, **options):
    game = GAMES[name]
    chosen = game.scenario(scenario, **options)
    return describe_game(game, scenario or "default", chosen, BOT, "planes")


def write(folder, name, opponent=BOT, **options):
    game = GAMES[name]
    write_folder(folder, game, game.default_scenario, game.scenario(**options), opponent)


def test_the_board_of_line_wars_lies_below_its_bars():
    board = describe("deep_line_wars")["board"]
    assert board == {"left": 17.5, "top": 82.0, "tile": 51.0, "rows": 10, "columns": 15}


def test_the_board_of_deep_rts_is_its_picture():
    whole = {"left": 0.0, "top": 0.0, "tile": 32.0, "rows": 15, "columns": 15}
    assert describe("deep_rts")["board"] == whole


@pytest.mark.parametrize("name", ["deep_maze", "flappy_bird"])
def test_games_without_cells_have_no_board_to_click(name):
    assert describe(name)["board"] is None


def test_resources_are_shown_of_both_sides_where_both_are_seen():
    assert describe("deep_line_wars")["numbers"][1] == {"label": "gold", "own": 1, "enemy": 5}
    assert describe("deep_rts")["numbers"][0]["enemy"] is None


def test_what_an_order_costs_is_shown_in_games_with_prices():
    prices = describe("deep_line_wars")["actions"]["prices"]
    assert (prices["buy_grunt"], prices["build_fast"]) == ("40 gold", "20 gold, 2 lumber")
    assert describe("deep_rts")["actions"]["prices"]["make_smithy"] == (
        "150 gold, 80 lumber, 30 stone"
    )
    assert describe("deep_maze")["actions"]["prices"] == {}


def test_the_description_is_plain_data():
    about = describe("deep_rts")
    assert json.loads(json.dumps(about))["options"]["map"] == "15x15-2p-crossing"
    assert about["seconds_per_step"] == 1.0


def test_orders_for_every_unit_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"actions of shape \(15, 15\).*--set actions=unit"):
        write(tmp_path / "page", "deep_rts", actions="grid")


def test_flash_games_are_refused(tmp_path):
    with pytest.raises(ValueError, match="cannot be compiled for a browser.*play flash"):
        write(tmp_path / "page", "flash")


def test_a_folder_with_other_files_is_refused(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(ValueError, match="holds other files than index.html: give a new folder"):
        write(tmp_path, "flappy_bird")
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_network_needs_the_runtime(tmp_path, monkeypatch):
    monkeypatch.setenv("MARL_CAIR_CACHE", str(tmp_path / "cache"))
    with pytest.raises(InstallError, match="Run 'marl-cair play install', or choose a bot"):
        write(tmp_path / "page", "deep_line_wars", Opponent("net", representation="planes"))
    assert not (tmp_path / "page").exists()


def test_the_runtime_is_found_where_it_is_installed(tmp_path, monkeypatch):
    monkeypatch.setenv("MARL_CAIR_CACHE", str(tmp_path))
    folder = runtime.runtime_folder()
    folder.mkdir()
    for name in runtime.RUNTIME.files:
        (folder / name.rpartition("/")[2]).touch()
    assert [path.parent for path in runtime.find_runtime()] == [folder] * 2
    assert runtime.install_runtime() == folder  # it is not fetched twice
