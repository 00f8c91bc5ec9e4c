"""Code that leaves a file when it runs, and the names by which files name it."""

COMMAND = "process:sh -c 'touch pwned'"
FUNCTION = "pwn:make"
MODULE = """
import pathlib
pathlib.Path("pwned").touch()
class Agent:
    def act(self, observation, action_mask):
        return action_mask.argmax(-1)
def make(scenario, spec):
    return Agent()
"""


def ran(folder):
    return (folder / "pwned").exists()
