"""Damaged stored files of every kind end in one of the errors that the command line shows."""

import copy
import json
import os
import random
import shutil
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import torch

from marl_cair.checkpoint import EXPLOIT, find_agent, load_network
from marl_cair.cli.verify import verify_folder
from marl_cair.files import write_json
from marl_cair.games.deep_rts.maps.maps import read_map
from marl_cair.league.agents.load import load_agent
from marl_cair.league.agents.mixtures import save_mixture
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.league.store.store import LeagueStore
from marl_cair.training.collecting.metrics import Timers
from marl_cair.training.population.league_run import read_progress
from marl_cair.training.population.league_slice import MemberRecord, read_member, save_member
from marl_cair.training.population.psro import _Plan, _read_plan
from marl_cair.training.run import TrainingRun
from marl_cair.training.run_log import read_log
from marl_cair.training.settings.config_file import load_config
from marl_cair.training.trainer import iterate, train
from tests.damage import forget_checksums
from tests.training.runs import tiny

SECONDS = float(os.environ.get("FUZZ_SECONDS", "20"))
SEED = int(os.environ.get("FUZZ_SEED", "0"))
ALLOWED = (ValueError, OSError, MemoryError, ArithmeticError, RecursionError)  # as `cli.main`
MOST_SECONDS = 6.0  # of one file, on a machine that is busy
MAP = Path(__file__).parents[2] / "marl_cair/games/deep_rts/maps/files/10x10-2p-clearing.txt"
HOSTILE = (None, -1, 0, 2**31, 2**63, 10**30, 1e308, float("nan"), float("inf"), True, "", "../x",
           "x" * 5_000, [], {}, [[]], {"a": {}})  # fmt: skip


def read_league(folder):
    with closing(LeagueStore(folder / "league.sqlite")) as store:
        store.read_agents()
        store.read_blocks()
        store.read_games()


# Each kind: its files, as patterns in its folder, and what reads them.
READERS = {
    "agent": (["agent.json", "weights.pt", "manifest.json"], load_network),
    "mixture": (["mixture.json", "manifest.json", "members/00/*"], lambda f: load_agent(str(f))),
    "run": (["run.json", "config.yaml"], lambda f: (load_config(f), find_agent(f))),
    "exploit": (["run.json", "exploit.json"], find_agent),
    "log": (["log.csv"], lambda f: read_log(f / "log.csv")),
    "plan": (["plan.json"], lambda f: _read_plan(f / "plan.json")),
    "progress": (["progress.json"], read_progress),
    "member": (["member.json"], read_member),
    "map": (["map.txt"], lambda f: read_map(f / "map.txt")),
    "tiled": (["map.json"], lambda f: read_map(f / "map.json")),
    "league": (["league.sqlite"], read_league),
}


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """One folder of each kind, and a run that goes on from its state."""
    folder = tmp_path_factory.mktemp("stored")
    config = tiny(folder / "run", 1_024)
    train(config, show_progress=False)
    shutil.copytree(folder / "run" / "latest", folder / "agent")
    save_mixture(folder / "mixture", [str(folder / "agent"), "deep_line_wars/random"], [1, 2])
    (folder / "log").mkdir()
    shutil.copy(folder / "run" / "log.csv", folder / "log")
    write_json(folder / "exploit" / "run.json", {"kind": EXPLOIT, "settings": {}})
    write_json(folder / "exploit" / "exploit.json", {"chosen": "seed_0_stage_001"})
    write_json(folder / "plan" / "plan.json", _Plan({"a": 0.5, "b": 0.5}, None)._asdict())
    write_json(folder / "progress" / "progress.json", {"slices": 3})
    save_member(folder / "member", MemberRecord("a", "main", ("a",), 0.0, False, 1, 0))
    for name in ("map", "tiled"):
        (folder / name).mkdir()
    shutil.copy(MAP, folder / "map" / "map.txt")
    (folder / "tiled" / "map.json").write_text(json.dumps(make_tiled()), "utf-8")
    bots = ("deep_line_wars/random", "deep_line_wars/rusher")
    run_league(
        LeagueConfig(bots, game="deep_line_wars", scenario="11x11", games_per_pair=2, replays=False,
                     scenario_options={"max_ticks": 100}, out=str(folder / "league")),
        show_progress=False,
    )  # fmt: skip
    run = TrainingRun(config, resume=True)
    yield folder, run
    run.close()


def make_tiled():
    size = {"width": 10, "height": 10}
    layer = {"type": "tilelayer", "name": "ground", "data": [300] * 100, **size}
    tileset = {"firstgid": 1, "tiles": [{"id": 299, "type": "grass"}]}
    spawn = {"type": "spawn", "x": 16, "y": 16, "properties": [{"name": "seat", "value": 1}]}
    objects = {"type": "objectgroup", "name": "spawns", "objects": [spawn]}
    sides = {"tilewidth": 16, "tileheight": 16}
    return {**size, **sides, "layers": [layer, objects], "tilesets": [tileset]}


def change_bytes(path, rng):
    data = bytearray(path.read_bytes())
    kind = rng.randrange(5)
    if kind == 0:
        for _ in range(rng.choice([1, 4, 64])):
            if data:
                data[rng.randrange(len(data))] = rng.randrange(256)
    elif kind == 1:
        data = data[: rng.randrange(len(data) + 1)]
    elif kind == 2:
        data += rng.randbytes(rng.choice([1, 100]))
    elif kind == 3:
        data = bytearray(rng.randbytes(rng.choice([0, 1, 200])))
    else:
        data = bytearray(rng.choice([b"[" * 100_000, b"null", b"{}", b"[]", b"1e999", b"\x00" * 50,
                                     b"a: &a [1]\nb: *a\n", b'{"a":' * 50_000]))  # fmt: skip
    path.write_bytes(data)


def change_node(value, rng, forbidden=()):
    """A copy of nested values with one node that is another."""
    value = copy.copy(value)
    if isinstance(value, dict) and value:
        keys = [key for key in value if key not in forbidden]
        key = rng.choice(keys)
        if rng.random() < 0.1:
            del value[key]
        else:
            value[key] = change_node(value[key], rng)
        return value
    if isinstance(value, list | tuple) and value and rng.random() < 0.8:
        place = rng.randrange(len(value))
        items = list(value)
        items[place] = change_node(items[place], rng)
        return type(value)(items) if type(value) in (list, tuple) else items
    if isinstance(value, torch.Tensor) and rng.random() < 0.9:
        return torch.from_numpy(change_array(value.numpy(), rng))
    return copy.deepcopy(rng.choice(HOSTILE))


def change_array(array, rng):
    array = np.array(array)
    kind = rng.randrange(5)
    if kind == 0:
        return array[: len(array) // 2] if array.ndim else array[None]
    if kind == 1:
        return array.astype(rng.choice([np.float64, np.int8, np.int64]))
    if array.size:
        if array.dtype.kind == "f":
            extreme = rng.choice([np.nan, np.inf, -np.inf, 1e30, -1.0])
        elif array.dtype.kind == "b":
            extreme = rng.random() < 0.5
        else:
            about = np.iinfo(array.dtype)
            extreme = rng.choice([about.min, about.max, 1, 0, about.max // 2])
        array.reshape(-1)[rng.randrange(array.size)] = extreme
    return array


def change_content(path, rng):
    """Another value in a file that is otherwise sound."""
    if path.suffix == ".json":
        value = json.loads(path.read_text("utf-8"))
        if isinstance(value, dict):
            value.pop("checksum", None)
        path.write_text(json.dumps(change_node(value, rng)), "utf-8")
    elif path.suffix == ".pt":
        torch.save(change_node(dict(torch.load(path, weights_only=True)), rng, ("env",)), path)
    elif path.suffix == ".npy":
        np.save(path, change_array(np.load(path), rng))
    else:
        change_bytes(path, rng)


def damage(folder, patterns, rng):
    path = rng.choice(sorted(p for pattern in patterns for p in folder.rglob(pattern)
                             if p.is_file()))  # fmt: skip
    if rng.random() < 0.8:
        forget_checksums(folder)
    if path.exists():
        (change_content if rng.random() < 0.6 else change_bytes)(path, rng)
    return path


def check(read, folder, shown):
    begun = time.monotonic()
    try:
        read(folder)
    except ALLOWED:
        pass
    except Exception as error:
        raise AssertionError(f"{shown}: {type(error).__name__}: {error}") from error
    assert time.monotonic() - begun < MOST_SECONDS, f"{shown} took {time.monotonic() - begun:.1f} s"


@pytest.mark.slow
def test_damaged_files_end_in_public_errors(stored, tmp_path):
    folder, _ = stored
    end, number = time.monotonic() + SECONDS / 2, 0
    while time.monotonic() < end:
        for kind, (patterns, read) in READERS.items():
            rng = random.Random(f"{SEED} {kind} {number}")  # no secrets
            place = tmp_path / f"{kind}{number}"
            shutil.copytree(folder / kind, place)
            path = damage(place, patterns, rng)
            shown = f"FUZZ_SEED={SEED}, {kind} {number}, {path.name}"
            check(read, place, shown)
            check(verify_folder, place, shown)
            shutil.rmtree(place)
        number += 1


@pytest.mark.slow
def test_damaged_states_end_in_public_errors(stored, tmp_path):
    _, run = stored
    state, kept = run.folder / "resume", tmp_path / "kept"
    shutil.copytree(state, kept)

    def resume(_):
        run.restore()
        next(iterate(run, Timers()))

    end, number = time.monotonic() + SECONDS / 2, 0
    while time.monotonic() < end:
        rng = random.Random(f"{SEED} state {number}")  # no secrets
        path = damage(state, ["*.npy", "facts.json", "state.pt", "generator.pt"], rng)
        check(resume, state, f"FUZZ_SEED={SEED}, state {number}, {path.relative_to(state)}")
        shutil.rmtree(state)
        shutil.copytree(kept, state)
        number += 1
