"""Runs a plan in a folder: composes all cells, runs what is missing, writes tables and figures."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from marl_cair import __version__
from marl_cair.cluster import LOCAL, RayPool, check_cluster
from marl_cair.experiments import scheduler
from marl_cair.experiments.cells import (
    CELLS,
    DONE_FILE,
    RUN,
    Cell,
    Compose,
    Draft,
    list_drafts,
    make_cells,
    make_scenario,
)
from marl_cair.experiments.figures import draw_panels, draw_results, name_task
from marl_cair.experiments.looks import LOOKS_FILE, read_looks
from marl_cair.experiments.plan import Plan, find_begun, scale_plan
from marl_cair.experiments.remote import RayTasks
from marl_cair.experiments.scheduler import LocalProcesses, Runner
from marl_cair.experiments.summary import Run, find_levels, summarise
from marl_cair.experiments.tables import LOOKS, write_looks, write_tables
from marl_cair.files import RUN_MARKER, claim_output_folder, read_run_marker, write_json
from marl_cair.games import GAMES
from marl_cair.league.agents.allowed_code import AllowCode, require_allowed
from marl_cair.league.agents.load import find_distinct, load_agent
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.lookup import check_name
from marl_cair.memory import count_cores
from marl_cair.outside import import_outside
from marl_cair.stored import read_json
from marl_cair.training.run_log import RunLog
from marl_cair.training.settings.checks import require
from marl_cair.training.settings.config_file import list_sources

KIND = "experiment"  # of an output folder
_SCALE_FILE = "scale.json"
_LOOKS_SHARE = 0.2  # of the time of an experiment, a guess
_START_SECONDS = 5.0  # of a cell's process
FIGURE, LEAGUES = "figure.png", "leagues"


@dataclass(frozen=True)
class ExperimentConfig:
    """How a plan is run."""

    out: Path
    workers: int | None = None  # processes side by side; None: as the cores allow
    cluster: str = LOCAL  # where they run, see `cluster.check_cluster`
    budget: str = ""  # as it was typed
    budget_seconds: float | None = None  # for the cells of the first call in a folder
    only: tuple[str, ...] = ()  # tasks and choices; cells with one of each kind run
    panels: bool = False  # draw the thesis's panels of each task
    allow_code: AllowCode = False  # code of the plan that may run, see `league.agents.allowed_code`


@dataclass(frozen=True)
class ExperimentResult:
    """What has been run.

    Attributes:
        text: the tables as Markdown.
        failed: why cells failed, by name.
        skipped: why this machine cannot run cells, by name.
    """

    text: str
    failed: dict[str, str]
    skipped: dict[str, str]


def run_experiment(plan: Plan, config: ExperimentConfig, compose: Compose) -> ExperimentResult:
    """Run all cells of a plan that are not finished.

    Raises:
        OutputFolderError: the folder holds another plan, version or budget.
        CodeNotAllowedError: the plan, or a cell of the folder, names code that is not allowed.
        ClusterError: the cluster cannot be used.
        ValueError: a cell that cannot be composed or rated; before any work.
    """
    workers = config.workers or count_cores()
    if check_cluster(config.cluster) == LOCAL:
        return _run(plan, config, compose, LocalProcesses(workers), workers)
    with RayPool(config.cluster, workers) as pool:
        config.out.mkdir(parents=True, exist_ok=True)
        pool.require_shared(config.out)
        num_cpus = sum(node.num_cpus for node in pool.nodes)
        return _run(plan, config, compose, RayTasks(pool), num_cpus)


def _run(
    plan: Plan, config: ExperimentConfig, compose: Compose, runner: Runner, workers: int
) -> ExperimentResult:
    settings = {"version": __version__, "budget": config.budget, "plan": plan.fixed}
    marker, begun = config.out / RUN_MARKER, settings
    if marker.is_file():
        held = read_run_marker(marker)[1].get("plan", {})
        begun = settings | {"plan": find_begun(plan.fixed, held)}
    claim = partial(claim_output_folder, config.out, KIND, begun, resume=True)
    if marker.is_file():
        with claim():
            pass  # files of another version or plan are refused before they are read
    keys = {draft.key for draft in _choose(plan, config.only)}
    require(len(keys) > 0, "--only", list(config.only), "a task and choices that have a cell")
    scale = _find_scale(plan, config, workers)
    scaled = scale_plan(plan, scale) if scale < 1.0 else plan
    cells = make_cells(scaled, compose, scale, config.out)
    chosen = [cell for cell in cells if cell.key in keys]
    code = [one for cell in chosen for one in (*list_sources(cell.config), cell.trainer)]
    require_allowed(filter(None, code), config.allow_code, f"the plan of {config.out}")
    for cell in chosen:
        if cell.trainer is not None:
            import_outside(cell.trainer)  # raises now where it is missing
    waiting = [cell for cell in chosen if not scheduler.is_finished(cell, config.out)]
    skipped = runner.find_shortages(waiting)
    with claim():
        write_json(marker, {"kind": KIND, "settings": settings})
        write_json(config.out / _SCALE_FILE, {"factor": scale})
        todo = [cell for cell in chosen if cell.name not in skipped]
        notes = _describe(scaled, scale, config, skipped)
        write = partial(_write, scaled, cells, config.out, notes)
        try:
            failed = scheduler.run_cells(todo, config.out, runner, write)
        finally:
            text = write()  # of an interrupted plan too
        if plan.games_per_pair and not failed:
            _play_leagues(scaled, cells, config)
        if config.panels:
            _draw_panels(scaled, cells, config.out)
        return ExperimentResult(text, failed, skipped)


def _find_scale(plan: Plan, config: ExperimentConfig, workers: int) -> float:
    """The part of each budget that fits into `--budget`; once for a folder."""
    file = config.out / _SCALE_FILE
    if file.is_file():
        return float(read_json(file)["factor"])
    if config.budget_seconds is None:
        return 1.0
    if plan.budget.seconds is None:
        raise ValueError("--budget needs budget.seconds in the plan, the time of a whole cell")
    count = sum(one.agent is None for one in _choose(plan, config.only)) * len(plan.seeds)
    left = config.budget_seconds * workers * (1.0 - _LOOKS_SHARE) - count * _START_SECONDS
    if left <= 0.0:
        least = count * _START_SECONDS / workers / (1.0 - _LOOKS_SHARE)
        raise ValueError(
            f"--budget {config.budget} is too short to start {count} cells: give more than "
            f"{least:.0f}s, or choose cells by --only"
        )
    return min(1.0, left / (max(1, count) * plan.budget.seconds))


def _choose(plan: Plan, only: Sequence[str]) -> list[Draft]:
    """Cells with one of `only` as task, and as choice of each factor, wherever one is named."""
    drafts = list(list_drafts(plan))
    columns = [set(column) for column in zip(*(one.key for one in drafts), strict=True)]
    for name in only:
        check_name("task or choice", name, sorted(set.union(*columns) - {""}))
    asked = [column & set(only) for column in columns]
    return [
        one
        for one in drafts
        if all(not some or name in ("", *some) for name, some in zip(one.key, asked, strict=True))
    ]


def _describe(plan: Plan, scale: float, config: ExperimentConfig, skipped: dict[str, str]) -> str:
    """What a reader must know of the tables: their statistic, the budget, what is missing."""
    limits = []
    if plan.budget.frames:
        limits.append(f"{plan.budget.frames:,} environment steps")
    if plan.budget.seconds:
        limits.append(f"{plan.budget.seconds:,.0f} s of processor time")
    notes = [
        "Interquartile means over runs (of less than four: means), 95 % stratified bootstrap.",
        "These intervals hold the truth in 51 % (two runs), 76 % (three) and 90 % (five) of cases.",
        f"A run trains for at most {' or '.join(limits)}.",
        f"marl_cair {__version__}.",
    ]
    if scale < 1.0:
        notes.append(
            f"Scaled down by --budget {config.budget}: each run has {100 * scale:.3g} % of the "
            "plan's budget, schedules and games of a look, so its numbers are not those of the "
            "whole plan."
        )
    notes += [f"Not run on this machine: {name} ({why})." for name, why in skipped.items()]
    return " ".join(notes)


def read_runs(cells: Sequence[Cell], out: Path) -> list[Run]:
    """The looks of all finished cells."""
    return [
        Run(cell.task, tuple(cell.choices.values()), cell.seed, rows)
        for cell in cells
        if scheduler.is_finished(cell, out)
        and (rows := read_looks(out / CELLS / cell.name / LOOKS_FILE))
    ]


def _write(plan: Plan, cells: Sequence[Cell], out: Path, notes: str) -> str:
    """Tables and the figure of all finished cells; returns the tables."""
    runs = read_runs(cells, out)
    if not runs:
        return f"No cell is finished. {notes}\n"
    if len(runs) < len(cells):
        notes += f" {len(cells) - len(runs)} of {len(cells)} cells are not finished."
    code = {path.read_text("utf-8") for path in (out / CELLS).glob(f"*/{DONE_FILE}")}
    if len(code) > 1:
        notes += f" Cells were run by {len(code)} versions of the code: see each {DONE_FILE}."
    entries = summarise(plan, runs)
    write_looks(plan, runs, out / LOOKS)
    text = write_tables(plan, entries, find_levels(plan, runs), notes, out)
    draw_results(plan, runs, entries, out / FIGURE)
    return text


def _draw_panels(plan: Plan, cells: Sequence[Cell], out: Path) -> None:
    """The thesis's panels of each task."""
    for task in plan.tasks:
        logs: dict[str, list[Path]] = {}
        for cell in (cell for cell in cells if cell.task == task and cell.agent is None):
            name = ", ".join(cell.choices.values())
            logs.setdefault(name, []).append(out / CELLS / cell.name / RUN / RunLog.FILE)
        draw_panels(name_task(task), logs, out / f"panels_{task}.png")


def _play_leagues(plan: Plan, cells: Sequence[Cell], config: ExperimentConfig) -> None:
    """A league of all trained agents and bots of each task, of games for two or more."""
    for task in plan.tasks:
        own = [cell for cell in cells if cell.task == task and not (cell.agent or cell.trainer)]
        own = [cell for cell in own if scheduler.is_finished(cell, config.out)]
        if not own or own[0].config.game.spec.num_teams == 1:
            continue
        game, scenario = own[0].config.game, make_scenario(own[0].config, own[0].rating)
        folders = [config.out / CELLS / cell.name / RUN / cell.rating.agent for cell in own]
        agents = find_distinct(map(str, folders), GAMES[game.name], scenario).values()
        run_league(
            LeagueConfig(
                agents=(*agents, *plan.tasks[task].rating.bots),
                game=game.name,
                scenario=game.scenario,
                scenario_options=dataclasses.asdict(scenario),
                games_per_pair=plan.games_per_pair,
                out=str(config.out / LEAGUES / task),
                workers=config.workers or count_cores(),
                cluster=config.cluster,
            ),
            partial(load_agent, game=game.name),
        )
