"""`marl-cair play --browser`: which scenario and opponent it takes, and what it refuses."""

import pytest

from marl_cair.cli import EXIT_DONE, EXIT_REFUSED, main
from marl_cair.cli.viewing import browser_play
from marl_cair.games import GAMES
from tests.test_architecture import ROOT

AGENT = str(ROOT / "agents" / "deep_line_wars_10x15")


@pytest.fixture
def written(monkeypatch):
    """What would be written: (scenario name, scenario, opponent)."""
    found = []

    def keep(folder, game, name, scenario, opponent, write_network=None):
        found.append((name, scenario, opponent))

    monkeypatch.setattr("marl_cair.browser.folder.write_folder", keep)
    monkeypatch.setattr("marl_cair.browser.runtime.find_runtime", list)
    return found


def play(*words):
    return main(["play", *words, "--browser", "--no-server"])


def test_a_bot_plays_the_scenario_of_the_options(written, capsys):
    words = ("deep_line_wars", "--opponent", "deep_line_wars/rusher", "--scenario", "11x11")
    assert play(*words, "--set", "max_ticks=500") == EXIT_DONE
    ((name, scenario, opponent),) = written
    assert (name, scenario.rows, scenario.max_ticks, opponent.bot) == ("11x11", 11, 500, "rusher")
    assert "runs/play_deep_line_wars/index.html" in capsys.readouterr().out


def test_the_trained_agent_of_the_repository_plays_its_scenario(written):
    assert play("deep_line_wars") == EXIT_DONE
    ((name, _, opponent),) = written
    assert name == "10x15"
    assert (opponent.name, opponent.bot, opponent.representation) == ("sp_3", "", "planes")
    assert (opponent.dtype, opponent.state_size, opponent.plays) == ("uint8", 0, "greedy")


@pytest.mark.parametrize("words", [("--scenario", "11x11"), ("--set", "max_ticks=500")])
def test_another_scenario_is_played_against_a_bot(written, words):
    assert play("deep_line_wars", *words) == EXIT_DONE
    assert written[0][2].bot == [*GAMES["deep_line_wars"].bots][-1]


def test_a_game_for_one_has_no_opponent(written):
    assert play("flappy_bird") == EXIT_DONE
    assert written[0][2].name == "none"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("flappy_bird", "--opponent", AGENT), "plays deep_line_wars, not flappy_bird"),
        (("deep_line_wars", "--opponent", "rusher@0.3"), "choose rusher"),
        (
            ("deep_line_wars", "--opponent", AGENT, "--scenario", "11x11"),
            "others than those of the chosen scenario: leave --scenario and --set out",
        ),
        (("flapy_bird",), "nearest are 'flappy_bird'"),
        (("flash",), "cannot be compiled for a browser"),
    ],
)
def test_what_cannot_be_played_is_refused(written, capsys, words, message):
    assert play(*words) == EXIT_REFUSED
    assert message in capsys.readouterr().err
    assert written == []


def test_a_network_without_the_extra_is_refused_before_compiling(monkeypatch, capsys, tmp_path):
    compiled = []
    monkeypatch.setattr("marl_cair.browser.runtime.find_runtime", list)
    monkeypatch.setattr("marl_cair.browser.folder.find_runtime", list)
    monkeypatch.setattr("marl_cair.browser.folder.load_rules", lambda *_: compiled.append(1))
    monkeypatch.setattr("marl_cair.cli.agent.export.find_spec", lambda name: None)
    folder = tmp_path / "page"
    assert play("deep_line_wars", "--opponent", AGENT, "--out", str(folder)) == EXIT_REFUSED
    assert "export needs onnx, onnxscript, onnxruntime" in capsys.readouterr().err
    assert (compiled, folder.exists()) == ([], False)


def test_install_fetches_the_runtime(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("marl_cair.browser.runtime.install_runtime", lambda: tmp_path)
    assert main(["play", "install"]) == EXIT_DONE
    assert capsys.readouterr().out == f"onnxruntime-web is in {tmp_path}\n"


def test_the_folder_is_served_until_the_command_is_interrupted(monkeypatch, capsys, tmp_path):
    def stop(self):
        raise KeyboardInterrupt

    monkeypatch.setattr("http.server.ThreadingHTTPServer.serve_forever", stop)
    assert browser_play.serve(tmp_path, 0) == EXIT_DONE
    assert "Play at http://127.0.0.1:" in capsys.readouterr().out
