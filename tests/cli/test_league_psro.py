"""`marl-cair league psro`: examples that are complete and load, and what is refused."""

import pytest

from marl_cair.cli import main
from marl_cair.cli.league_train import format_options
from marl_cair.league.agents.mixtures import read_mixture
from marl_cair.training.population.league_examples import PSRO_EXAMPLES
from marl_cair.training.population.psro_settings import PsroSettings, build_psro, load_psro
from marl_cair.training.settings.options import list_options, read_comments


@pytest.mark.parametrize("name", PSRO_EXAMPLES)
def test_an_example_holds_every_option_with_its_comment_and_is_the_same_when_read(
    name, tmp_path, capsys
):
    assert main(["league", "psro", "--example", name]) == 0
    text = capsys.readouterr().out
    path = tmp_path / "psro.yaml"
    path.write_text(text, "utf-8")
    assert load_psro(path) == build_psro(PSRO_EXAMPLES[name])
    for option, comment in read_comments(PsroSettings).items():
        assert f"# {comment}" in text, option
        assert f"{option}: " in text or f"{option}:\n" in text
    assert all(len(option.comment) > 3 for option in list_options(PsroSettings))


def test_help_tells_every_option_with_its_default(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["league", "psro", "--help"])
    assert stopped.value.code == 0
    told = capsys.readouterr().out
    assert "usage: marl-cair league psro" in told
    assert "round_frames: 200000" in told
    assert "with more rounds in the file" in told


@pytest.mark.parametrize(
    ("words", "text", "message"),
    [
        ([], "", "no file is given: write marl-cair league psro psro.yaml"),
        (["--example", "tny"], "", "unknown example 'tny': nearest are 'tiny'"),
        (["psro.yaml"], "rounds: 0\n", "rounds is 0, it must be 1 or more"),
        (["psro.yaml"], "bots: [rusherr]\n", "unknown deep_line_wars bot 'rusherr'"),
        (["psro.yaml"], "begin_with: [nowhere]\n", "nowhere"),
    ],
)
def test_wrong_words_and_files_are_refused_in_a_line(
    words, text, message, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "psro.yaml").write_text(text, "utf-8")
    assert main(["league", "psro", *words]) == 2
    told = capsys.readouterr().err
    assert message in told
    assert "Traceback" not in told
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_the_tiny_example_runs_to_its_mixture_and_once_more_at_once(tmp_path, capsys):
    path, out = tmp_path / "psro.yaml", tmp_path / "out"
    path.write_text(format_options(build_psro(PSRO_EXAMPLES["tiny"])), "utf-8")
    words = ["league", "psro", str(path), "--out", str(out)]
    assert main([*words, "--minutes", "0.0001"]) == 0
    assert "time is over, 0 rounds are done: go on with" in capsys.readouterr().err
    assert main(words) == 0
    told = capsys.readouterr().out
    assert "Ladder" in told
    assert main(words) == 0
    again = capsys.readouterr().out
    assert "Ladder" in again
    assert told.endswith(again)
    assert 1 <= len(read_mixture(out / "mixture").sources) <= 2
