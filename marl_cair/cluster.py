"""Runs functions in worker processes: of this machine, or of a Ray cluster (`--cluster ray`)."""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import re
import secrets
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor, wait
from functools import cache, partial
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

from marl_cair import outside

LOCAL, RAY = "local", "ray"
_LIBRARIES = ("marl_cair", "ray", "numba", "numpy", "torch", "torchrl")  # that change results
_RETRIES = 3  # of a task whose worker or machine died; errors of the task itself are final
_CONNECT_SECONDS = 20.0
_CANCEL_SECONDS = 60.0
_ANSWER_SECONDS = 120.0  # of a node: it starts a worker and imports torch
_STORE_BYTES = 256 << 20  # of a local Ray, for objects in transfer
_FORM = re.compile(r"local|ray|ray:auto|ray:[^/:]+:\d+")
MakePool = Callable[[], Executor]


class ClusterError(OSError):
    """A cluster that cannot be used, or a worker of it that has died."""


def check_cluster(cluster: str) -> str:
    """`cluster` itself; raises ValueError if it is none of local, ray, ray:auto, ray:HOST:PORT."""
    if not _FORM.fullmatch(cluster):
        raise ValueError(
            f"--cluster is {cluster!r}, it must be local, ray (starts Ray on this machine), "
            "ray:auto (joins the Ray that runs on this machine) or ray:HOST:PORT (joins that Ray)"
        )
    return cluster


def choose_pool(cluster: str, num_workers: int, shared: Path) -> MakePool | None:
    """How to start workers; None where this process is enough. shared: as `require_shared`."""
    if check_cluster(cluster) != LOCAL:
        return partial(_open_pool, cluster, num_workers, shared)
    if num_workers == 1:
        return None
    # Not forked: torch and numba hold threads.
    return partial(ProcessPoolExecutor, num_workers, get_context("spawn"))


def _open_pool(cluster: str, num_workers: int, shared: Path) -> RayPool:
    pool = RayPool(cluster, num_workers)
    try:
        pool.require_shared(shared)
    except OSError:  # ClusterError too
        pool.shutdown()
        raise
    return pool


class Node(NamedTuple):
    """A machine of a cluster."""

    key: str  # Ray's
    address: str
    num_cpus: int


class _Context(NamedTuple):
    """What a task needs of the process that started it."""

    versions: dict[str, str]
    folder: str
    allowed: tuple[str, ...] = ()  # code that files may name, see `outside.allow_code`


class RayPool(Executor):
    """Runs functions as Ray tasks; a task whose machine dies is run again, on another.

    Where this process uses Ray already, that one is used, and left running.

    Args:
        cluster: as of `check_cluster`, without "local".
        num_workers: processor cores of a Ray that is started here.

    Raises ClusterError: Ray is not installed, the address does not answer within 20 s, or Ray has
    another version there.
    """

    def __init__(self, cluster: str, num_workers: int) -> None:
        try:
            import ray
        except ImportError as error:
            raise ClusterError(
                f'--cluster {cluster} needs Ray: pip install "marl_cair[ray]"'
            ) from error
        self._ray: Any = ray
        self._is_owner = not ray.is_initialized()
        if self._is_owner:
            _connect(cluster, num_workers)
        self._context = _Context(_read_versions(), str(Path.cwd()))
        self._task, self._single = ray.remote(_run), ray.remote(max_calls=1)(_run)
        self._refs: dict[Future[Any], Any] = {}

    @property
    def nodes(self) -> list[Node]:
        """All machines that can be reached."""
        return [
            Node(one["NodeID"], one["NodeManagerAddress"], int(one["Resources"].get("CPU", 0)))
            for one in self._ray.nodes()
            if one["Alive"]
        ]

    @property
    def here(self) -> str:
        """The key of this machine."""
        return str(self._ray.get_runtime_context().get_node_id())

    def place_on(self, key: str) -> Any:
        """The option `scheduling_strategy` of a task that runs on one machine."""
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        return NodeAffinitySchedulingStrategy(key, soft=False)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **options: Any) -> Future[Any]:
        """Call `fn(*args)` in the current folder, on a machine that is free. options: of the Ray
        task, for example num_cpus; is_fresh=True: in a process of its own.

        The future raises what the function raises, or ClusterError.
        """
        task = self._single if options.pop("is_fresh", False) else self._task
        options = {"num_cpus": 1, "max_retries": _RETRIES, **options}
        context = self._context._replace(allowed=tuple(outside.list_allowed()))
        ref = task.options(**options).remote(context, fn, args)
        future: Future[Any] = Future()
        self._refs[future] = ref
        ref.future().add_done_callback(partial(self._finish, future))
        return future

    def _finish(self, future: Future[Any], source: Future[Any]) -> None:
        self._refs.pop(future, None)
        if not future.set_running_or_notify_cancel():
            return
        error = source.exception()
        if error is None:
            future.set_result(source.result())
        elif isinstance(error, self._ray.exceptions.RayTaskError):
            future.set_exception(error.cause)
        else:
            first = str(error).strip().partition("\n")[0]
            future.set_exception(ClusterError(
                f"a task has not ended in {_RETRIES + 1} tries ({type(error).__name__}: {first}): "
                "see whether memory is short on the machines, or whether they have left the "
                "cluster; the same command resumes it"
            ))  # fmt: skip

    def ask_nodes(self, fn: Callable[..., Any], *args: Any) -> dict[Node, Any]:
        """What `fn(*args)` returns on each machine. Raises what it raises, and ClusterError for a
        machine that does not answer, or has other versions.
        """
        futures = {}
        for node in self.nodes:
            options = {"num_cpus": 0, "scheduling_strategy": self.place_on(node.key)}
            futures[self.submit(fn, *args, **options)] = node
        _, late = wait(futures, _ANSWER_SECONDS)
        if late:
            raise ClusterError(
                f"the machine {futures[late.pop()].address} of the cluster has not answered within "
                f"{_ANSWER_SECONDS:.0f} s: see whether it is alive, or stop Ray there (ray stop)"
            )
        return {node: future.result() for future, node in futures.items()}

    def require_shared(self, folder: Path) -> None:
        """Raise ClusterError unless there is a core for tasks, and all machines have the versions
        of this one and see the current folder and `folder`, which exists, under the same paths.
        """
        if not any(node.num_cpus for node in self.nodes):
            raise ClusterError(
                "no machine of the cluster has cores for tasks: join one by `ray start --address`"
            )
        probe = folder.resolve() / f".{secrets.token_hex(6)}.unfinished"
        probe.touch()
        try:
            answers = self.ask_nodes(os.path.exists, probe)
        finally:
            probe.unlink(missing_ok=True)
        for node, is_there in answers.items():
            if not is_there:
                raise ClusterError(
                    f"the machine {node.address} of the cluster does not see {folder.resolve()}: "
                    "give a folder that all machines share under one path"
                )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Cancel all tasks, and leave the cluster; a Ray that was started here ends."""
        self.cancel()
        if self._is_owner:
            self._ray.shutdown()

    def cancel(self) -> None:
        """Raise KeyboardInterrupt in all tasks, and wait until they end."""
        left = dict(self._refs)
        for future, ref in left.items():
            future.cancel()
            self._ray.cancel(ref)
        if left:  # those of a machine that is gone never end
            self._ray.wait([*left.values()], num_returns=len(left), timeout=_CANCEL_SECONDS)


def _connect(cluster: str, num_workers: int) -> None:
    """Start Ray on this machine, without dashboard and usage statistics, or join one."""
    import ray

    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    if cluster == RAY:
        os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
        limits: dict[str, Any] = {"num_cpus": num_workers, "object_store_memory": _STORE_BYTES}
        ray.init("local", include_dashboard=False, **limits, **quiet)
        return
    address = cluster.partition(":")[2]
    advice = "start Ray there and on this machine, as docs/cluster.md shows"
    try:
        # Ray itself tries for minutes.
        command = [sys.executable, "-m", "ray.scripts.scripts", "status", "--address", address]
        subprocess.run(command, check=True, capture_output=True, timeout=_CONNECT_SECONDS)
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        last = (error.stderr or b"").decode("utf-8", "replace").strip().rpartition("\n")[2]
        raise ClusterError(
            f"no Ray answers at {address} within {_CONNECT_SECONDS:.0f} s{last and f' ({last})'}: "
            f"{advice}"
        ) from error
    try:
        ray.init(address, **quiet)
    except (RuntimeError, ConnectionError, ValueError) as error:  # other version, no Ray here
        raise ClusterError(f"the Ray at {address} cannot be joined ({error}): {advice}") from error


@cache
def digest_code() -> str:
    """A digest of the code of `marl_cair`: commits share a version."""
    code = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        code.update(path.read_text("utf-8").encode())  # without the line endings of a system
    return code.hexdigest()[:8]


@cache
def _read_versions() -> dict[str, str]:
    return {**{name: version(name) for name in _LIBRARIES}, "code of marl_cair": digest_code()}


def _run(context: _Context, function: Callable[..., Any], args: tuple[Any, ...]) -> Any:
    """Call a function in a worker. Machines may join at any time, so each task checks its own."""
    here = _read_versions()
    others = [f"{name} {here[name]} and not {own}" for name, own in context.versions.items()
              if own != here[name]]  # fmt: skip
    if others:
        raise ClusterError(
            f"the machine {platform.node()} of the cluster has {', '.join(others)}: install "
            "the same versions on all machines"
        )
    if not Path(context.folder).is_dir():
        raise ClusterError(
            f"the machine {platform.node()} of the cluster does not see {context.folder}: "
            "start the command in a folder that all machines share under one path"
        )
    os.chdir(context.folder)
    os.environ.setdefault("MPLBACKEND", "Agg")
    outside.allow_code(*context.allowed)
    return function(*args)
