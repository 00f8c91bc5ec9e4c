"""Files run no code: for each kind of file, one that tries to, and what the user can allow."""

import json
import logging
import os
import pickle
import shutil
import sqlite3
import sys

import pytest
import torch

from marl_cair.checkpoint import CheckpointError, load_network
from marl_cair.cli import main
from marl_cair.league.agents.allowed_code import CodeNotAllowedError, is_code, require_allowed
from marl_cair.league.agents.load import load_agent
from marl_cair.league.agents.mixtures import MIXTURE_FILE, save_mixture
from marl_cair.league.extend import plan_extension
from marl_cair.league.mixing import mix_league
from marl_cair.league.report.report import report_stored
from marl_cair.league.store.store import STORE_FILE
from marl_cair.training.population.league_run import train_league
from marl_cair.training.population.league_settings import build_league, load_settings
from marl_cair.training.population.league_slice import Budget, run_slice
from marl_cair.training.population.psro_settings import build_psro
from marl_cair.training.run import RESUME_FOLDER, TrainingRun
from marl_cair.training.settings.config_file import load_config
from marl_cair.training.settings.demonstration import DemonstrationSettings
from marl_cair.training.state_file import STATE_FILE
from marl_cair.training.trainer import train
from tests.damage import forget_checksums
from tests.games import last_standing
from tests.league.leagues import play_bots
from tests.league.players import save_network
from tests.refusals import assert_refused
from tests.security.foreign_code import COMMAND, FUNCTION, ran
from tests.training.leagues import make_league
from tests.training.runs import tiny

EVERY_CODE = pytest.mark.parametrize("source", [COMMAND, FUNCTION])


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    folder = tmp_path_factory.mktemp("played") / "league"
    play_bots(folder, "random", "rusher", "turtle")
    return folder


@pytest.fixture
def foreign_league(played, here):
    """The folder of a league, and what makes its file name an agent's source."""
    folder = here / "league"
    shutil.copytree(played, folder)

    def rename(source, kind="bot"):
        database = sqlite3.connect(folder / STORE_FILE)
        with database:
            shown = json.dumps({"source": source})
            database.execute("UPDATE agent SET configuration = ?, kind = ?", (shown, kind))
        database.close()
        return folder

    return rename


class TestLeagueStore:
    @pytest.mark.slow
    @EVERY_CODE
    @pytest.mark.parametrize("kind", ["bot", "network", "mixture", "foreign"])
    def test_a_report_runs_no_code_whatever_kind_the_file_calls_it(
        self, foreign_league, here, source, kind
    ):
        folder = foreign_league(source, kind)
        report_stored(folder)
        assert not ran(here)
        page = (folder / "report.html").read_text("utf-8")
        assert "is foreign code, which is run only where games are played" in page

    @pytest.mark.slow
    @pytest.mark.parametrize(
        "words", [["report"], ["status"], ["export"], ["report", "--no-replays"]], ids=" ".join
    )
    def test_commands_that_only_read_run_no_code_and_need_no_permission(
        self, foreign_league, here, capsys, words
    ):
        assert main(["league", *words, str(foreign_league(COMMAND))]) == 0
        assert not ran(here)

    @pytest.mark.slow
    @EVERY_CODE
    def test_a_league_with_code_is_not_added_to_unless_the_user_allows_it(
        self, foreign_league, here, source, capsys
    ):
        folder = foreign_league(source)
        words = ["league", "add", "economist", "--out", str(folder), "--no-replays"]
        assert_refused(capsys, "--allow-code", *words)
        assert not ran(here)
        main([*words, "--allow-code"])
        assert ran(here)

    def test_what_is_allowed_is_listed_before_it_runs(self, foreign_league, here, caplog):
        caplog.set_level(logging.WARNING)
        with pytest.raises(ValueError, match=r"exit code|no longer the agent"):
            plan_extension(foreign_league(COMMAND), ["economist"], allow_code=True)
        assert f"names: {COMMAND}" in caplog.text

    def test_who_names_a_source_again_allows_that_one_alone(self, here):
        require_allowed([COMMAND], frozenset({COMMAND}), "a file")
        with pytest.raises(CodeNotAllowedError, match="a file names code.*: pwn:make. If you"):
            require_allowed([COMMAND, FUNCTION], frozenset({COMMAND}), "a file")

    @EVERY_CODE
    def test_a_mixture_of_it_is_refused(self, foreign_league, here, source):
        with pytest.raises(ValueError, match="is code, which a mixture cannot hold"):
            mix_league(foreign_league(source), ["random"])
        assert not ran(here)

    def test_its_triggers_cannot_call_what_is_unsafe(self, foreign_league, here):
        folder = foreign_league("random")
        database = sqlite3.connect(folder / STORE_FILE)
        with database:
            database.execute(
                "CREATE TRIGGER t AFTER INSERT ON rating_run BEGIN "
                "SELECT load_extension('./pwn'); END"
            )
        database.close()
        with pytest.raises(ValueError, match="unsafe use of load_extension|not authorized"):
            report_stored(folder, with_replays=False)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trained") / "run"
    train(tiny(folder, frames=1_024), show_progress=False)
    return folder


class TestMixture:
    """Mixtures are data: no permission makes one run code."""

    @pytest.fixture
    def folder(self, here):
        members = [save_network(here / name, seed=n) for n, name in enumerate(("network", "other"))]
        save_mixture(here / "mixture", members, [1, 1])
        return here / "mixture"

    def change(self, folder, member):
        record = json.loads((folder / MIXTURE_FILE).read_text("utf-8"))
        record["members"][1] = {"weight": 0.5, **member}
        (folder / MIXTURE_FILE).write_text(json.dumps(record), "utf-8")
        forget_checksums(folder)

    def test_one_that_was_saved_plays(self, folder):
        assert len(load_agent(folder, "deep_line_wars", "11x11").members) == 2

    @EVERY_CODE
    def test_no_member_is_code(self, folder, here, source, capsys):
        self.change(folder, {"agent": source})
        with pytest.raises(CheckpointError, match="is no bot, written as game/bot"):
            load_agent(folder, "deep_line_wars", "11x11")
        for words in (
            ["match", str(folder), "random"],
            ["evaluate", str(folder)],
            ["league", "random", str(folder), "--out", "out"],
            ["league", "exploit", str(folder), "--out", "out"],
            ["train", f"opponent.agents={{m: {folder}}}", "opponent.mixture={m: 1}", "out=out"],
        ):
            assert_refused(capsys, "is no bot, written as game/bot", *words)
        assert not ran(here)

    @pytest.mark.parametrize("place", ["../network", "/etc", "members/../..", "link"])
    def test_no_member_lies_outside(self, folder, here, place):
        (folder / "link").symlink_to(here / "network")
        self.change(folder, {"folder": place})
        with pytest.raises(CheckpointError, match="lies outside its folder members"):
            load_agent(folder, "deep_line_wars", "11x11")

    def test_no_member_is_a_mixture_that_holds_itself(self, folder):
        shutil.rmtree(folder / "members" / "01")
        (folder / "members" / "01").symlink_to(folder / "members")
        shutil.copy(folder / MIXTURE_FILE, folder / "members")
        self.change(folder, {"folder": "members/01"})
        with pytest.raises(CheckpointError, match="is a mixture itself"):
            load_agent(folder, "deep_line_wars", "11x11")

    def test_too_many_members_are_refused(self, folder):
        record = json.loads((folder / MIXTURE_FILE).read_text("utf-8"))
        record["members"] = record["members"][1:] * 20_000
        (folder / MIXTURE_FILE).write_text(json.dumps(record), "utf-8")
        forget_checksums(folder)
        with pytest.raises(CheckpointError, match="it has 20000 members, it must have 1 to 256"):
            load_agent(folder, "deep_line_wars", "11x11")


class TestRun:
    """`config.yaml`, `run.json` and the state of a run of training."""

    @pytest.fixture
    def run(self, trained, here):
        shutil.copytree(trained, here / "run")
        return here / "run"

    def name_code(self, run, group, source):
        text = (run / "config.yaml").read_text("utf-8")
        head, found, rest = text.partition(f"\n{group}:\n")
        assert found
        assert "  agents: {}" in rest
        shown = f"  agents:\n    bad: {json.dumps(source)}"
        rest = rest.replace("  agents: {}", shown, 1)
        (run / "config.yaml").write_text(f"{head}{found}{rest}", "utf-8")
        forget_checksums(run)

    @EVERY_CODE
    @pytest.mark.parametrize("group", ["opponent", "demonstration"])
    def test_a_changed_configuration_runs_no_code(self, run, here, capsys, group, source):
        self.name_code(run, group, source)
        words = ["train", f"resume={run}", "total_frames=2048"]
        assert_refused(capsys, f"{source}. If you trust it, add", *words)
        assert not ran(here)
        # Allowed, it is compared with run.json before anything runs.
        assert main([*words, "allow_code=true"]) == 2
        assert "agents" in capsys.readouterr().err
        assert not ran(here)

    @pytest.mark.slow
    def test_a_run_with_code_goes_on_where_that_is_allowed(self, here, capsys):
        folder = here / "own"
        demonstration = DemonstrationSettings(agents={"mine": FUNCTION}, share=0.5)
        train(tiny(folder, frames=512, demonstration=demonstration), show_progress=False)
        (here / "pwned").unlink()
        sys.modules.pop("pwn")
        words = ["train", f"resume={folder}", "total_frames=768"]
        assert_refused(capsys, "config.yaml names code, which runs only if you allow it", *words)
        assert not ran(here)
        assert main([*words, "allow_code=true"]) == 0
        assert ran(here)

    @pytest.mark.slow
    def test_a_run_without_code_needs_no_permission(self, run, capsys):
        assert main(["train", f"resume={run}", "total_frames=1280"]) == 0

    @pytest.mark.parametrize("word", ["allow_code=yes", "allow_code="])
    def test_permission_is_true_or_false(self, run, capsys, word):
        assert_refused(capsys, "it must be true or false", "train", f"resume={run}", word)

    def test_permission_is_for_files(self, capsys):
        assert_refused(capsys, "is for resume=FOLDER", "train", "allow_code=true")

    def test_yaml_makes_no_objects(self, run, here):
        path = run / "config.yaml"
        text = path.read_text("utf-8")
        evil = "seed: !!python/object/apply:os.system ['touch pwned']\n"
        path.write_text("\n".join(x for x in text.split("\n") if not x.startswith("seed:")) + evil)
        forget_checksums(run)
        with pytest.raises(ValueError, match="cannot be read"):
            load_config(run)
        assert not ran(here)

    @pytest.mark.parametrize("name", ["../../elsewhere", "/etc", ".."])
    def test_a_snapshot_lies_in_the_pool(self, run, name):
        state = run / RESUME_FOLDER
        contents = torch.load(state / STATE_FILE, weights_only=True)
        contents["book"]["pool"]["snapshots"][0]["name"] = name
        torch.save(contents, state / STATE_FILE)
        forget_checksums(run)
        with pytest.raises(CheckpointError, match="must be the plain name of a folder"):
            TrainingRun(load_config(run), resume=True)


class Evil:
    def __reduce__(self):
        return os.system, ("touch pwned",)


class TestCheckpoint:
    @pytest.mark.filterwarnings("ignore:Detected pickle protocol")
    def test_weights_make_no_objects(self, here):
        save_network(here / "network")
        (here / "network" / "weights.pt").write_bytes(pickle.dumps(Evil()))
        forget_checksums(here)
        with pytest.raises(CheckpointError, match="holds more than tensors"):
            load_network(here / "network")
        assert not ran(here)

    @pytest.mark.parametrize("body", [FUNCTION, COMMAND])
    def test_a_network_is_chosen_by_a_known_name(self, here, body):
        save_network(here / "network")
        path = here / "network" / "agent.json"
        record = json.loads(path.read_text("utf-8"))
        record["network"]["body"] = body
        path.write_text(json.dumps(record), "utf-8")
        forget_checksums(here)
        with pytest.raises(ValueError, match="unknown|names code, which runs only if you allow"):
            load_agent(here / "network")
        assert not ran(here)

    def test_a_game_is_chosen_among_those_that_are_installed(self, here):
        save_network(here / "network")
        path = here / "network" / "agent.json"
        record = json.loads(path.read_text("utf-8"))
        path.write_text(json.dumps({**record, "game": "pwn:make"}), "utf-8")
        forget_checksums(here)
        with pytest.raises(ValueError, match="unknown game 'pwn:make'"):
            load_agent(here / "network")
        assert not ran(here)


class TestPlan:
    """The files of `league train` and `league psro`, and the folders that they resume."""

    PLAN = "training:\n  demonstration:\n    agents:\n      bad: {}\n"

    @EVERY_CODE
    @pytest.mark.parametrize("build", [build_league, build_psro])
    def test_a_plan_runs_no_code(self, here, build, source):
        (here / "plan.yaml").write_text(self.PLAN.format(json.dumps(source)), "utf-8")
        with pytest.raises(CodeNotAllowedError, match="plan.yaml names code"):
            load_settings("plan.yaml", build)
        load_settings("plan.yaml", build, allow_code=True)
        assert not ran(here)

    @pytest.mark.parametrize("command", ["train", "psro"])
    def test_the_commands_refuse_it(self, here, capsys, command):
        (here / "plan.yaml").write_text(self.PLAN.format(FUNCTION), "utf-8")
        assert_refused(capsys, "--allow-code", "league", command, "plan.yaml")
        assert not ran(here)

    def test_a_learners_folder_runs_no_code_that_the_plan_does_not_name(self, here, monkeypatch):
        last_standing.register(monkeypatch)
        settings = make_league(here / "league")

        def stop(*_):
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            train_league(settings, show_progress=False, play_slice=stop)
        member = here / "league" / "members" / "main_0"
        text = (member / "config.yaml").read_text("utf-8")
        changed = text.replace("agents: {}", f"agents: {{bad: {json.dumps(COMMAND)}}}")
        (member / "config.yaml").write_text(changed, "utf-8")
        forget_checksums(member)
        with pytest.raises(CodeNotAllowedError, match="names code"):
            train_league(settings, show_progress=False)
        with pytest.raises(CodeNotAllowedError, match="names code"):
            run_slice(member, here / "league" / "shared", Budget(384, 768), False)
        assert not ran(here)


def test_agents_of_this_package_and_folders_are_no_code(here):
    (here / "pwn:folder").mkdir()
    assert not is_code("marl_cair.games.deep_rts.teacher:make_teacher")
    assert not is_code("pwn:folder")
    assert not is_code("deep_line_wars/rusher")
    assert is_code("marl_cair.cli:main")
    assert is_code(COMMAND)


def test_python_names_code_by_loading_it(here):
    load_agent(FUNCTION, "deep_line_wars", "11x11")
    assert ran(here)
