"""Plans of experiments run no code, nor do the folders that they resume."""

import dataclasses

import pytest
import yaml

from marl_cair.cli import main
from tests.experiments.plans import TINY, list_cells, make_plan
from tests.refusals import assert_refused
from tests.security.foreign_code import COMMAND, FUNCTION, ran

OWN_BODY = ["policy=conv", "representation=planes", f"policy.body={FUNCTION}"]


class TestExperimentPlan:
    @pytest.mark.parametrize(
        "changes",
        [{"others": {"mine": FUNCTION}}, {"factors": {"learner": {"own": OWN_BODY}}}],
    )
    def test_it_runs_no_code_unless_the_user_allows_it(self, here, capsys, changes):
        (here / "plan.yaml").write_text(yaml.safe_dump({**TINY, **changes, "seeds": [0]}), "utf-8")
        words = ["experiment", "plan.yaml", "--only", *(changes.get("others") or ["own"])]
        assert_refused(capsys, f"names code, which runs only if you allow it: {FUNCTION}", *words)
        assert not ran(here)
        assert main([*words, "--allow-code"]) != 0  # it runs, and neither trains nor is a network
        assert ran(here)

    def test_nor_do_files_of_its_cells(self, here, capsys):
        cell, *_ = list_cells(make_plan(factors={"learner": {"dqn": OWN_BODY}}, seeds=[0]))
        cell = dataclasses.replace(cell, agent=COMMAND, trainer=FUNCTION, name="../elsewhere")
        folder = here / "out" / "cells" / "maze-dqn-0"
        folder.mkdir(parents=True)
        cell.save(folder)
        (here / "plan.yaml").write_text(yaml.safe_dump({**TINY, "seeds": [0]}), "utf-8")
        assert_refused(capsys, FUNCTION, "experiment", "plan.yaml", "--out", "out")
        assert not ran(here)
