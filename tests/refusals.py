"""How commands refuse words."""

from marl_cair.cli import main


def assert_refused(capsys, message, *words):
    """The command ends with 2, and one line that holds `message`."""
    assert main(words) == 2
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1
