"""Fills the replay buffer with the steps of players in recorded games."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from marl_cair.games.replays import REPLAY_SUFFIX, Replay, ReplayError, read_replays, replay_steps
from marl_cair.replay.rollout import Rollout
from marl_cair.replay.storage import EpisodeStorage
from marl_cair.replay.transition import NO_OPPONENT, UNKNOWN_ACTION, TransitionSpec
from marl_cair.training.settings.demonstration import DemonstrationSettings

if TYPE_CHECKING:
    from marl_cair.games.engine import BatchedEngine

REWARD_FIELDS = ("reward", "shaping_discount")  # of scenarios: they do not change a game


def fill_from_replays(
    storage: EpisodeStorage,
    settings: DemonstrationSettings,
    engine: BatchedEngine,
    representation: str,
    reward_scale: float,
) -> None:
    """Store the steps of the demonstrating players, as those of demonstrators, with the rewards of
    the scenario of `engine`.

    Raises:
        ValueError: no replays, one of another scenario, a player who is in none of them, or more
            steps than the buffer holds; and as `read_replay`.
    """
    source, players = settings.replays or "", settings.players
    seen: set[str] = set()
    for name, replay in _list_games(source).items():
        fitted = _fit_scenario(name, replay, engine)
        seats = _find_seats(replay, players)
        seen |= set(replay.players)
        if seats:
            spec = storage.spec
            storage.append(_play_again(fitted, seats, representation, reward_scale, spec))
            storage.forget_streams()  # other games have other players
    if missing := sorted(set(players) - seen):
        raise ValueError(
            f"demonstration.players are {', '.join(missing)}, who play in no game of {source}: "
            f"there are {', '.join(sorted(seen))}"
        )
    if not 0 < storage.num_written <= storage.capacity:
        raise ValueError(
            f"the games of {source} have {storage.num_written} demonstrated steps and ends, "
            f"allowed are 1..{storage.capacity} (replay.capacity_transitions): name others in "
            "demonstration.replays and demonstration.players"
        )


def _list_games(source: str) -> dict[str, Replay]:
    """All games by FILE#NUMBER; of those that are there twice, as after a torn file, the longer."""
    place = Path(source)
    files = sorted(place.rglob(f"*{REPLAY_SUFFIX}")) if place.is_dir() else [place]
    if not files:
        raise ValueError(
            f"demonstration.replays is {source}, a folder without replays (*{REPLAY_SUFFIX}): "
            "`marl-cair match ... --record FOLDER` writes some"
        )
    held: dict[tuple[Any, ...], tuple[str, Replay]] = {}
    for path in files:
        for number, replay in enumerate(read_replays(path)):
            key = replay.game, repr(replay.scenario), replay.map_seed, replay.players
            if key not in held or len(replay.actions) > len(held[key][1].actions):
                held[key] = f"{path}#{number}", replay
    return dict(held.values())


def _fit_scenario(name: str, replay: Replay, engine: BatchedEngine) -> Replay:
    """The replay with the rewards of the engine's scenario, without hashes: they hold rewards."""
    if replay.game != engine.game.name:
        raise ValueError(f"{name} is a game of {replay.game}, the run plays {engine.game.name}")
    if differing := list_differences(vars(replay.scenario), engine.scenario, REWARD_FIELDS):
        raise ValueError(
            f"{name} is a game of another scenario: {differing}. `marl-cair match --record` plays "
            "the run's; games of `play` and `watch` may be recorded tick by tick"
        )
    try:
        for _ in replay_steps(replay):
            pass
    except ReplayError as error:
        raise ReplayError(f"{name}: {error}") from error
    return dataclasses.replace(replay, scenario=engine.scenario, hashes={})


def list_differences(theirs: Mapping[str, Any], scenario: Any, skipped: Sequence[str] = ()) -> str:
    """The fields of `theirs` that are not those of the run's scenario, in words; "" if none is."""
    return "; ".join(
        f"{name} is {theirs.get(name)!r} there, {value!r} in this run"
        for name, value in vars(scenario).items()
        if name not in skipped and theirs.get(name) != value
    )


def _find_seats(replay: Replay, players: tuple[str, ...]) -> list[int]:
    """The seats of these players; without names those of the team that has won, or the only one."""
    if players:
        return [seat for seat, name in enumerate(replay.players) if name in players]
    teams = replay.spec.team_of_seat
    if len(set(teams.tolist())) == 1:
        return list(range(len(teams)))
    return [] if replay.winner is None else np.flatnonzero(teams == teams[replay.winner]).tolist()


def _play_again(
    replay: Replay, seats: list[int], representation: str, reward_scale: float, spec: TransitionSpec
) -> Rollout:
    """The steps of the seats, each a stream, and a step that is not learned, which ends them."""
    state_size, num_others = spec.state_size, spec.num_others
    taken: dict[str, list[NDArray[Any]]] = {name: [] for name in _STEP_FIELDS}
    finals: list[tuple[int, NDArray[Any], NDArray[np.bool_]]] = []
    was_over = np.zeros(len(seats), np.bool_)
    for step, engine in enumerate(replay_steps(replay)):
        observation = engine.observe(representation)[0, seats]
        mask = engine.action_mask()[0, seats]
        if step:
            over = engine.eliminated[0, seats] | engine.terminated[0] | engine.truncated[0]
            truncated = over & engine.truncated[0] & ~engine.eliminated[0, seats]
            taken["reward"].append(engine.rewards[0, seats].copy())
            taken["truncated"].append(truncated)
            taken["terminated"].append(over & ~truncated)
            taken["learned"].append(~was_over)
            for stream in np.flatnonzero(over & ~was_over).tolist():
                place = (step - 1) * len(seats) + stream
                finals.append((place, observation[stream], mask[stream]))
            was_over |= over
        taken["observation"].append(observation)
        taken["action_mask"].append(mask)
        chosen = np.zeros(len(seats), np.int64)
        if step < len(replay.actions):
            chosen[:] = replay.actions[step, seats]
            is_legal = np.take_along_axis(mask, chosen[:, None], 1)[:, 0]
            chosen[~is_legal] = engine.spec.noop_action  # which is what the game did
        taken["action"].append(chosen)
    for name, kind in (("reward", np.float32), *((one, np.bool_) for one in _OF_ENDS)):
        taken[name].append(np.zeros(len(seats), kind))
    steps = {name: torch.from_numpy(np.stack(values)) for name, values in taken.items()}
    places, observations, masks = zip(*finals, strict=True) if finals else ((), (), ())
    shape = steps["action"].shape
    return Rollout(
        **{**steps, "reward": steps["reward"] * reward_scale},
        expert_action=steps["action"],
        opponent=torch.full(shape, NO_OPPONENT, dtype=torch.int16),
        final_step=torch.tensor(places, dtype=torch.int64),
        final_observation=_stack(observations, steps["observation"]),
        final_action_mask=_stack(masks, steps["action_mask"]),
        state=torch.zeros(*shape, state_size) if state_size else None,
        other_actions=_find_others(replay, seats, len(steps["action"])) if num_others else None,
    )


def _find_others(replay: Replay, seats: list[int], num_steps: int) -> torch.Tensor:
    """Actions of the seats after each of `seats`, int64 [T, S, P - 1]; unknown at the end."""
    played = np.asarray(replay.actions, np.int64)
    others = np.full((num_steps, len(seats), played.shape[1] - 1), UNKNOWN_ACTION)
    for stream, seat in enumerate(seats):
        others[: len(played), stream] = np.roll(played, -seat, 1)[:, 1:]
    return torch.from_numpy(others)


_OF_ENDS = ("terminated", "truncated", "learned")
_STEP_FIELDS = ("observation", "action_mask", "action", "reward", *_OF_ENDS)


def _stack(rows: tuple[NDArray[Any], ...], like: torch.Tensor) -> torch.Tensor:
    return torch.from_numpy(np.stack(rows)) if rows else like[0, :0]
