"""`marl-cair league train`: examples that are complete and load, and what is refused."""

import dataclasses

import pytest

from marl_cair.cli import main
from marl_cair.cli.league_train import format_options
from marl_cair.training.population.league_examples import EXAMPLES
from marl_cair.training.population.league_settings import (
    LeagueSettings,
    RoleSettings,
    build_league,
    load_league,
)
from marl_cair.training.settings.options import list_options, read_comments


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_holds_every_option_with_its_comment_and_is_the_same_when_read(
    name, tmp_path, capsys
):
    assert main(["league", "train", "--example", name]) == 0
    text = capsys.readouterr().out
    path = tmp_path / "league.yaml"
    path.write_text(text, "utf-8")
    assert load_league(path) == build_league(EXAMPLES[name])
    for owner in (LeagueSettings, RoleSettings):
        for option, comment in read_comments(owner).items():
            assert f"# {comment}" in text, option
            assert f"{option}: " in text or f"{option}:\n" in text


def test_every_option_has_a_comment():
    for option in list_options(LeagueSettings):
        assert len(option.comment) > 3, option.path
    names = {field.name for field in dataclasses.fields(RoleSettings)}
    assert set(read_comments(RoleSettings)) == names


def test_help_tells_every_option_with_its_default(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["league", "train", "--help"])
    assert stopped.value.code == 0
    told = capsys.readouterr().out
    assert "usage: marl-cair league train" in told
    assert "slice_frames: 50000" in told
    assert "deep_rts" in told


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must hold options by name"),
        ("- 1", "must hold options by name"),
        ("a: [", "cannot be read"),
        ("sed: 1", "unknown option 'sed': nearest are 'seed'"),
        ("seed: a", "seed is 'a', it must be a whole number"),
        ("training: {learner: {gama: 0.9}}", "unknown option 'gama': nearest are 'gamma'"),
    ],
)
def test_a_file_that_says_nothing_sensible_is_refused_in_a_line(text, message, tmp_path, capsys):
    path = tmp_path / "league.yaml"
    path.write_text(text, "utf-8")
    assert main(["league", "train", str(path), "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "no file is given"),
        (["nowhere.yaml"], "nowhere.yaml is no file"),
        (["--example", "tny"], "unknown example 'tny': nearest are 'tiny'"),
    ],
)
def test_wrong_words_are_refused(words, message, capsys):
    assert main(["league", "train", *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_the_tiny_example_runs_to_its_report_and_once_more_at_once(tmp_path, capsys):
    path = tmp_path / "league.yaml"
    path.write_text(format_options(build_league(EXAMPLES["tiny"])), "utf-8")
    words = ["league", "train", str(path), "--out", str(tmp_path / "out")]
    assert main([*words, "--minutes", "0.0001"]) == 0
    assert "time is over, 0 slices are done" in capsys.readouterr().err
    assert main(words) == 0
    told = capsys.readouterr().out
    assert "Ladder" in told
    assert main(words) == 0
    assert told.endswith(capsys.readouterr().out)
