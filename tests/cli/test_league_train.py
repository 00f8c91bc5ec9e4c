"""`marl-cair league train` and `league psro`: examples load, help lists all options, errors."""

import dataclasses
import re

import pytest

from marl_cair.cli import main
from marl_cair.cli.league_train import PSRO, TRAIN, format_options
from marl_cair.league.agents.mixtures import read_mixture
from marl_cair.training.population.league_settings import (
    LeagueSettings,
    RoleSettings,
    load_settings,
)
from marl_cair.training.population.psro_settings import PsroSettings
from marl_cair.training.settings.options import list_options, read_comments
from tests.refusals import assert_refused

COMMANDS = {"train": TRAIN, "psro": PSRO}
SETTINGS = {"train": (LeagueSettings, RoleSettings), "psro": (PsroSettings,)}


@pytest.mark.parametrize(
    ("command", "name"), [(c, name) for c, about in COMMANDS.items() for name in about.examples]
)
def test_an_example_holds_every_option_with_its_comment_and_is_the_same_when_read(
    command, name, tmp_path, capsys
):
    about = COMMANDS[command]
    assert main(["league", command, "--example", name]) == 0
    text = capsys.readouterr().out
    (tmp_path / "file.yaml").write_text(text, "utf-8")
    assert load_settings(tmp_path / "file.yaml", about.build) == about.build(about.examples[name])
    for owner in SETTINGS[command]:
        for option, comment in read_comments(owner).items():
            assert f"# {comment}" in text, option
            assert f"{option}: " in text or f"{option}:\n" in text


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_has_a_comment(command):
    for option in list_options(SETTINGS[command][0]):
        assert len(option.comment) > 3, option.path
    names = {field.name for field in dataclasses.fields(RoleSettings)}
    assert set(read_comments(RoleSettings)) == names


@pytest.mark.parametrize(
    ("command", "texts"),
    [
        ("train", ["slice_frames: 50000", "deep_rts", "with more total_frames in the file"]),
        ("psro", ["round_frames: 200000", "with more rounds in the file"]),
    ],
)
def test_help_lists_every_option_with_its_default(command, texts, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["league", command, "--help"])
    assert stopped.value.code == 0
    shown = capsys.readouterr().out
    for text in [f"usage: marl-cair league {command}", *texts]:
        assert text in shown
    defaults = COMMANDS[command].settings()
    assert format_options(defaults) == format_options(COMMANDS[command].settings)


@pytest.mark.parametrize(
    ("command", "words", "text", "message"),
    [
        ("train", ["file.yaml"], "", "must hold options by name"),
        ("train", ["file.yaml"], "- 1", "must hold options by name"),
        ("train", ["file.yaml"], "a: [", "cannot be read"),
        ("train", ["file.yaml"], "sed: 1", "unknown option 'sed': nearest are 'seed'"),
        ("train", ["file.yaml"], "seed: a", "seed is 'a', it must be a whole number"),
        ("train", ["file.yaml"], "training: {learner: {gama: 0.9}}", "nearest are 'gamma'"),
        ("train", [], "", "no file is given"),
        ("train", ["nowhere.yaml"], "", "nowhere.yaml is no file"),
        ("train", ["--example", "tny"], "", "unknown example 'tny': nearest are 'tiny'"),
        ("psro", [], "", "no file is given: write marl-cair league psro psro.yaml"),
        ("psro", ["--example", "tny"], "", "unknown example 'tny': nearest are 'tiny'"),
        ("psro", ["file.yaml"], "rounds: 0\n", "rounds is 0, it must be 1 or more"),
        ("psro", ["file.yaml"], "bots: [rusherr]\n", "unknown deep_line_wars bot 'rusherr'"),
        ("psro", ["file.yaml"], "begin_with: [nowhere]\n", "nowhere"),
    ],
)
def test_wrong_words_and_files_are_refused_in_a_line(
    command, words, text, message, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.yaml").write_text(text, "utf-8")
    assert_refused(capsys, message, "league", command, *words)
    assert [path.name for path in tmp_path.iterdir()] == ["file.yaml"]


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_the_tiny_example_runs_to_its_report_and_once_more_at_once(command, tmp_path, capsys):
    about, path, out = COMMANDS[command], tmp_path / "file.yaml", tmp_path / "out"
    path.write_text(format_options(about.build(about.examples["tiny"])), "utf-8")
    words = ["league", command, str(path), "--out", str(out)]
    assert main([*words, "--minutes", "0.0001"]) == 0
    shown = rf"time is over, [0-5] {about.parts} are done: resume with"  # a quick machine has some
    assert re.search(shown, capsys.readouterr().err)
    assert main(words) == 0
    report = capsys.readouterr().out
    assert "Ladder" in report
    assert main(words) == 0
    assert report.endswith(capsys.readouterr().out)
    if command == "psro":
        assert 1 <= len(read_mixture(out / "mixture").sources) <= 2
