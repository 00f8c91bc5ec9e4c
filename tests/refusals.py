"""Errors of commands."""

from marl_cair.cli import main


def assert_refused(capsys, message, *words, num_lines=1):
    """The command returns 2 and prints `message` in one line of stderr, which is returned."""
    assert main(words) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == num_lines
    return error
