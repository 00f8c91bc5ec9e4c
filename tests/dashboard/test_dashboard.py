"""The dashboard: its numbers, what its server answers, and the page in a real browser."""

import json
import os
import shutil
import sys
from http.client import HTTPConnection
from threading import Event
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

from marl_cair.cli import main
from marl_cair.cli.compose import compose_config
from marl_cair.dashboard.runs import RunReader, list_files
from marl_cair.dashboard.server import make_server, make_viewer, write_dashboard
from marl_cair.games import make_engine
from marl_cair.games.replays import ReplayWriter
from marl_cair.stored import MAX_BYTES, REPLAY
from marl_cair.training.run_log import format_rows, parse_log
from marl_cair.training.settings.config_file import save_config
from tests.chromium import (
    FIND_CONTRAST,
    READABLE,
    browser,
    need_browser,
    serving,
    watched_page,
)

__all__ = ["browser"]  # a fixture
pytest.importorskip("plotly", reason="plotly is of the extra `dashboard`")
ROWS = [
    {"frames": 1000.0, "win_rate/random": 0.5, "win_rate/random/low": 0.4, "epsilon": 0.9},
    {"frames": 2000.0, "win_rate/random": 0.75, "win_rate/random/low": 0.6, "td_error/real": 0.1},
]


def make_run(folder, *words, rows=ROWS):
    """A folder as a run leaves it after two rows of its log."""
    folder.mkdir()
    save_config(compose_config([*words, f"out={folder}", "total_frames=4000"]))
    (folder / "log.csv").write_text(format_rows(rows))
    Image.new("RGB", (8, 8), "teal").save(folder / "generator.png")
    return folder


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder of two runs; Hydra takes half a second for each."""
    folder = tmp_path_factory.mktemp("runs")
    for name in ("conv", "capsule"):
        make_run(folder / name, f"policy={name}")
    return folder


@pytest.fixture
def runs(made, tmp_path):
    return {
        folder.name: shutil.copytree(folder, tmp_path / folder.name)
        for folder in sorted(made.iterdir(), reverse=True)
    }


def get(address, path, **headers):
    connection = HTTPConnection(urlsplit(address).netloc, timeout=10)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, body


def test_a_run_has_its_metrics_where_they_were_logged(runs):
    conv, capsule = (RunReader(label, folder).read() for label, folder in runs.items())
    assert conv["metrics"]["win_rate/random"] == ([1000.0, 2000.0], [0.5, 0.75])
    assert conv["metrics"]["td_error/real"] == ([2000.0], [0.1])
    assert (conv["steps"], conv["total_steps"]) == (2000.0, 4000)
    assert capsule["about"] == "deep_line_wars 10x15, capsule, seed 0"
    assert list(conv["pictures"]) == ["generator.png"]


def test_a_second_reading_parses_only_new_rows(runs, monkeypatch):
    parsed = []

    def parse(text, path):
        parsed.append(text)
        return parse_log(text, path)

    monkeypatch.setattr("marl_cair.dashboard.runs.parse_log", parse)
    reader, log = RunReader("conv", runs["conv"]), runs["conv"] / "log.csv"
    columns = "frames,win_rate/random,win_rate/random/low,epsilon,td_error/real"
    rows = [*ROWS, {"frames": 3000.0, "win_rate/random": 1.0}]
    with_a_column = [*rows, {"frames": 4000.0, "loss/q": 1.5}]
    resumed = [ROWS[0], {"frames": 3000.0, "win_rate/random": 0.25}]
    reader.read()
    for text in map(format_rows, (rows, with_a_column, resumed)):
        log.write_text(text)
        assert reader.read() == RunReader("conv", runs["conv"]).read()
        del parsed[-1]  # of the reader that reads all
    assert parsed[1] == f"{columns}\n3000.0,1.0,,,\n"
    assert parsed[2:] == [format_rows(with_a_column), format_rows(resumed)]


def test_a_run_that_is_resumed_for_longer_is_read_again(runs):
    settings = runs["conv"] / "config.yaml"
    with serving(make_server(runs, 0)) as address:
        for total in (4000, 9000):
            text = settings.read_text().partition("# checksum")[0]
            settings.write_text(text.replace("total_frames: 4000", f"total_frames: {total}"))
            shown = json.loads(get(address, "/data.json")[1])
            assert [run["total_steps"] for run in shown["runs"]] == [total, 4000]


def test_a_log_that_was_cut_in_a_row_is_read_as_a_whole(runs):
    reader = RunReader("conv", runs["conv"])
    for text in ("frames,epsilon\n1000,0.", "frames,epsilon\n1000,0.5\n"):
        (runs["conv"] / "log.csv").write_text(text)
        metrics = reader.read()["metrics"]
    assert metrics["epsilon"] == ([1000.0], [0.5])


def test_the_server_answers_with_page_numbers_and_pictures(runs):
    with serving(make_server(runs, 0)) as address:
        assert b"<!DOCTYPE html>" in get(address, "/")[1]
        data = json.loads(get(address, "/data.json")[1])
        assert [run["label"] for run in data["runs"]] == ["conv", "capsule"]
        status, picture = get(address, "/pictures/conv/generator.png?1")
    assert (status, picture) == (200, (runs["conv"] / "generator.png").read_bytes())


def test_runs_of_folders_of_one_name_show_their_pictures(runs, tmp_path):
    named = {"a/conv": runs["conv"]}
    with serving(make_server(named, 0)) as address:
        assert get(address, "/pictures/a%2Fconv/generator.png")[0] == 200


def test_numbers_that_json_does_not_have_are_left_out(runs):
    log = runs["conv"] / "log.csv"
    text = log.read_text("utf-8").rstrip("\n")
    log.write_text(f"{text.rpartition(',')[0]},inf\n", "utf-8")
    with serving(make_server(runs, 0)) as address:
        json.loads(get(address, "/data.json")[1], parse_constant=pytest.fail)


@pytest.mark.parametrize(
    "path",
    [
        "/config.yaml",
        "/pictures/conv/config.yaml",
        "/pictures/conv/../capsule/generator.png",
        "/pictures/conv/..%2Fcapsule%2Fgenerator.png",
        "/pictures/../conv/generator.png",
        "/pictures/nowhere/generator.png",
        "/pictures/conv/link.png",
        "//etc/passwd",
    ],
)
def test_nothing_else_is_served(runs, path):
    (runs["conv"] / "link.png").symlink_to("/etc/passwd")
    with serving(make_server(runs, 0)) as address:
        assert get(address, path)[0] == 404


def test_other_host_names_are_refused(runs):
    with serving(make_server(runs, 0)) as address:
        assert get(address, "/data.json", Host="example.org")[0] == 403
        assert get(address, "/data.json", Host=f"localhost:{urlsplit(address).port}")[0] == 200


def test_a_damaged_log_is_reported_and_the_server_goes_on(runs):
    with serving(make_server(runs, 0)) as address:
        (runs["conv"] / "log.csv").write_text("frames\nmany\n")
        status, text = get(address, "/data.json")
        assert status == 503
        assert b"log.csv, line 2" in text
        (runs["conv"] / "log.csv").write_text(format_rows(ROWS))
        assert get(address, "/data.json")[0] == 200


@need_browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [360, 1280])
def test_the_page_fits_and_can_be_read(browser, runs, width, scheme):
    record_game(runs["conv"])
    with serving(make_server(runs, 0)) as address, watched_page(browser, width, scheme) as page:
        page.goto(address)
        page.get_by_role("button", name="conv: conv-0000").wait_for()
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        contrast, text = page.evaluate(FIND_CONTRAST)
        assert contrast >= READABLE, text


@need_browser
@pytest.mark.parametrize(("width", "scheme"), [(360, "dark"), (1280, "light")])
def test_the_page_follows_the_runs(browser, runs, width, scheme):
    with serving(make_server(runs, 0)) as address, watched_page(browser, width, scheme) as page:
        page.goto(address)
        page.wait_for_selector(".js-plotly-plot .scatterlayer .trace")
        drawn = "document.querySelector('.js-plotly-plot').data.map(t => [t.name, t.y?.length])"
        assert ["conv: random", 2] in page.evaluate(drawn)
        rows = [*ROWS, {"frames": 3000.0, "win_rate/random": 1.0}]
        (runs["conv"] / "log.csv").write_text(format_rows(rows))
        for _ in range(100):  # the policy of the page forbids `wait_for_function`
            if ["conv: random", 3] in page.evaluate(drawn):
                break
            page.wait_for_timeout(100)
        assert ["conv: random", 3] in page.evaluate(drawn)
        page.get_by_label("conv").uncheck()
        assert not [name for name, _ in page.evaluate(drawn) if name and name.startswith("conv")]
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.locator("img").evaluate("image => image.naturalWidth") == 8


PLOTTED = """() => Object.fromEntries([...document.querySelectorAll(".js-plotly-plot")].flatMap(
  chart => chart.data.map(t => [`${chart.layout.title.text}/${t.name ?? "band"}`, [t.x, t.y]])))"""


@need_browser
def test_the_charts_plot_the_numbers_of_the_logs(browser, runs):
    steps = [500.0, 1000.0, 2500.0]
    scores = {"win_rate/random": [0.25, 0.5, 0.875], "win_rate/random/low": [0.0, 0.25, 0.625],
              "win_rate/random/high": [0.375, 0.625, 1.0]}  # fmt: skip
    for run, metrics in zip(runs.values(), (scores, {}), strict=True):
        columns = {"frames": steps, **metrics}
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        for row in (rows[0], rows[2]):
            row["td_error/real"] = len(run.name) / row["frames"]
        (run / "log.csv").write_text(format_rows(rows))
    with serving(make_server(runs, 0)) as address, watched_page(browser) as page:
        page.goto(address)
        page.wait_for_selector(".js-plotly-plot .scatterlayer .trace")
        plotted = page.evaluate(PLOTTED)
    games, ends = "Greedy games against each bot", [500.0, 2500.0]
    assert plotted == {
        f"{games}/conv: random": [steps, [0.25, 0.5, 0.875]],
        f"{games}/band": [steps + steps[::-1], [0.0, 0.25, 0.625, 1.0, 0.625, 0.375]],
        "TD error/conv: real": [ends, [4 / 500, 4 / 2500]],
        "TD error/capsule: real": [ends, [7 / 500, 7 / 2500]],
    }


def record_game(run, name="conv-0000", actions=(1, 2, 3), num_games=1):
    """Games of the last evaluation in the run's folder."""
    engine = make_engine("deep_maze", num_worlds=num_games)
    seeds = range(num_games)
    engine.reset(np.array(seeds, np.uint64))
    path = run / "games" / f"{name}.replay"
    players = [["conv"]] * num_games
    with ReplayWriter(path, engine, map_seeds=seeds, players=players) as writer:
        for action in actions:
            played = np.full((num_games, 1), action, np.int32)
            engine.step(played)
            writer.add(played)
    return path


def test_damaged_games_are_listed_too(runs, monkeypatch):
    record_game(runs["conv"], num_games=2)
    (runs["conv"] / "games" / "foreign.replay").write_bytes(b"GIF8")
    assert set(list_files(runs["conv"])["games"]) == {
        "conv-0000.replay#0",
        "conv-0000.replay#1",
        "foreign.replay",
    }
    monkeypatch.setitem(MAX_BYTES, REPLAY, 100)
    assert set(list_files(runs["conv"])["games"]) == {"conv-0000.replay", "foreign.replay"}


@need_browser
def test_the_last_evaluation_plays_in_the_viewer(browser, runs, monkeypatch):
    record_game(runs["conv"], num_games=2)
    is_seen = Event()

    def make_slowly(path):
        is_seen.wait(30)
        return make_viewer(path)

    monkeypatch.setattr("marl_cair.dashboard.server.make_viewer", make_slowly)
    with serving(make_server(runs, 0)) as address, watched_page(browser) as page:
        page.goto(address)
        page.get_by_role("button", name="conv: conv-0000#0").wait_for()
        page.get_by_role("button", name="conv: conv-0000#1").click()
        assert "The game is played again" in page.locator("#wait").inner_text()
        is_seen.set()
        viewer = page.frame_locator("#viewer")
        viewer.get_by_text("step 0 / 3").wait_for()  # raises if not
        viewer.get_by_role("slider").first.press("End")
        viewer.get_by_text("step 3 / 3").wait_for()
        page.locator("#wait:empty").wait_for(state="attached")
        assert get(address, "/games/conv/other.replay")[0] == 404


@need_browser
def test_the_page_is_used_by_keys_alone(browser, runs):
    record_game(runs["conv"])
    with serving(make_server(runs, 0)) as address, watched_page(browser) as page:
        page.goto(address)
        page.wait_for_selector(".js-plotly-plot .scatterlayer .trace")
        page.keyboard.press("Tab")
        page.keyboard.press("Tab")  # from conv to capsule
        page.keyboard.press("Space")
        drawn = "document.querySelector('.js-plotly-plot').data.map(t => t.name)"
        assert page.evaluate(drawn) == ["conv: random"]
        assert page.evaluate("document.activeElement.id") == "run 1"  # it was made again
        for key in ("Tab", "Enter", "Tab"):  # past the charts, to the first button
            page.keyboard.press(key)
        assert page.evaluate("document.activeElement.textContent") == "conv: conv-0000"
        page.keyboard.press("Enter")
        page.frame_locator("#viewer").get_by_text("step 0 / 3").wait_for()


@need_browser
def test_every_curve_of_a_chart_has_its_own_look_and_name(browser, runs):
    names = [f"actions/kind_{number}" for number in range(12)]
    for run in runs.values():
        rows = [{"frames": 1000.0 * row} | dict.fromkeys(names, 0.1 * row) for row in (1, 2)]
        (run / "log.csv").write_text(format_rows(rows))
    with serving(make_server(runs, 0)) as address, watched_page(browser) as page:
        page.goto(address)
        page.wait_for_selector(".js-plotly-plot .legend .traces")
        looks = page.evaluate("""document.querySelector('.js-plotly-plot').data
          .map(t => [t.line.color, t.line.dash, t.mode, t.marker.symbol].join())""")
        assert len(looks) == len(set(looks)) == 24
        assert page.locator(".js-plotly-plot .legend .traces").count() == 24
        page.get_by_label("capsule").uncheck()  # a colour for each metric of one run
        looks = page.evaluate("""document.querySelector('.js-plotly-plot').data
          .map(t => [t.line.color, t.line.dash, t.mode, t.marker.symbol].join())""")
        assert len(looks) == len(set(looks)) == 12


@need_browser
def test_an_exported_page_needs_no_server(browser, runs, tmp_path):
    for number, actions in enumerate([(1, 2, 3), (1, 2, 3, 4)]):
        game = record_game(runs["conv"], f"conv-000{number}", actions)
        os.utime(game, (number, number))
    write_dashboard({"</script><!--<script>": runs["conv"]}, tmp_path / "page.html")
    with watched_page(browser) as page:
        page.goto((tmp_path / "page.html").as_uri())
        page.wait_for_selector(".js-plotly-plot .scatterlayer .trace")
        assert page.locator("#runs").inner_text().startswith("</script><!--<script>")
        assert page.locator("img").evaluate("image => image.naturalWidth") == 8
        (button,) = page.locator("#list button").all()
        button.click()
        page.frame_locator("#viewer").get_by_text("step 0 / 4").wait_for()  # the newest game


@need_browser
def test_a_game_that_cannot_be_read_is_left_out_of_the_export(browser, runs, tmp_path):
    game = record_game(runs["conv"])
    game.write_bytes(game.read_bytes().replace(b'"rules_version": "', b'"rules_version": "0.'))
    write_dashboard(runs, tmp_path / "page.html")
    with watched_page(browser) as page:
        page.goto((tmp_path / "page.html").as_uri())
        page.wait_for_selector(".js-plotly-plot .scatterlayer .trace")
        assert not page.get_by_text("Games of the last evaluation").is_visible()


def test_the_command_writes_the_page(runs, tmp_path, capsys):
    out = tmp_path / "page.html"
    assert main(["dashboard", *map(str, runs.values()), "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}: conv, capsule\n"
    assert out.stat().st_size > 1_000_000


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["nowhere"], "'nowhere' has no config.yaml: give the folder of a run"),
        (["nowhere", "--port", "70000"], "'70000' is no port: give a number from 0 to 65535"),
    ],
)
def test_bad_input_is_refused(words, error, capsys):
    try:
        code = main(["dashboard", *words])
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    assert error in capsys.readouterr().err


def test_a_missing_extra_is_named(runs, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.offline", None)  # as if it were not installed
    assert main(["dashboard", str(runs["conv"])]) == 2
    assert 'pip install "marl_cair[dashboard]"' in capsys.readouterr().err


def test_a_port_in_use_is_refused(runs, capsys):
    with serving(make_server(runs, 0)) as address:
        port = str(urlsplit(address).port)
        assert main(["dashboard", str(runs["conv"]), "--port", port]) == 2
    assert port in capsys.readouterr().err
