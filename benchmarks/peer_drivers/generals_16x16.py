"""generals-bots (its JAX version), for benchmarks/peers.py: run by the interpreter that has it."""

from __future__ import annotations

import jax
from generals import GeneralsEnv, compute_valid_move_mask
from serve import serve

WORLDS = 256
TICKS = 64  # of a round


def main() -> None:
    """Each player sees through the fog and plays a random move of its mask, or passes for lack."""
    env = GeneralsEnv(grid_dims=(16, 16), pool_size=1_000)
    key = jax.random.PRNGKey(0)
    pool, _ = env.reset(key)
    states = jax.tree.map(lambda leaf: leaf[:WORLDS], pool)

    def choose(seen, key):  # noqa: ANN001, ANN202  # JAX's types are not checked here
        legal = compute_valid_move_mask(seen.armies, seen.owned_cells, seen.mountains)
        draws = jax.random.uniform(key, legal.shape) * legal
        row, column, direction = jax.numpy.unravel_index(draws.argmax(), legal.shape)
        return jax.numpy.stack([~legal.any(), row, column, direction, 0]).astype("int32")

    choose_both = jax.vmap(jax.vmap(choose))

    @jax.jit
    def run(states, seen, key):  # noqa: ANN001, ANN202
        def tick(carried, key):  # noqa: ANN001, ANN202
            states, seen = carried
            actions = choose_both(seen, jax.random.split(key, (WORLDS, 2)))
            step, states = jax.vmap(env.step, (0, 0, None))(states, actions, pool)
            return (states, step.observation), None

        return jax.lax.scan(tick, (states, seen), jax.random.split(key, TICKS))[0]

    passing = jax.numpy.zeros((WORLDS, 2, 5), "int32").at[:, :, 0].set(1)
    first, states = jax.vmap(env.step, (0, 0, None))(states, passing, pool)
    seen = first.observation

    def play() -> int:
        nonlocal states, seen, key
        key, of_round = jax.random.split(key)
        states, seen = jax.block_until_ready(run(states, seen, of_round))
        return WORLDS * 2 * TICKS

    serve(play, f"16x16, 2 players, fog, masks, random legal moves, {WORLDS} worlds")


if __name__ == "__main__":
    main()
