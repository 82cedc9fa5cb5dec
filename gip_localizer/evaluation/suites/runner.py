# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Run the trials of suites in processes; the records do not depend on their number."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed, Future, ProcessPoolExecutor
from dataclasses import dataclass
import multiprocessing
import signal

from gip_localizer.core.threads import use_one_thread
from gip_localizer.evaluation.suites.cramer_rao import CramerRao
from gip_localizer.evaluation.suites.integrity import IntegritySuite
from gip_localizer.evaluation.suites.lane import Lane
from gip_localizer.evaluation.suites.model_error import ModelErrors
from gip_localizer.evaluation.suites.relocalize import Relocalize
from gip_localizer.evaluation.suites.single_frame import SingleFrame
from gip_localizer.evaluation.suites.suite import Record, Suite
from gip_localizer.evaluation.suites.trials import Bench
from gip_localizer.evaluation.suites.wide_start import WideStart
from gip_localizer.parameters.spec import Value

SUITES: dict[str, Suite] = {
    suite.name: suite
    for suite in (
        SingleFrame(), ModelErrors(), IntegritySuite(), WideStart(), CramerRao(), Relocalize(),
        Lane(),
    )
}
FRAMES_OF_A_WORLD = 10
"""Number of trials per world and job; chosen, since frames of one world have similar errors."""
SEEDS_APART = 104_729
"""Difference of the seeds of successive worlds (no unit): a prime, the 10,000th; chosen."""
MOST_SEED = 2**31
"""Number of allowed seeds: those of the synthetic camera."""


@dataclass(frozen=True)
class Job:
    """Trials of one setup in one world; `seed` is the seed of the world."""

    suite: str
    part: str
    first: int
    count: int
    seed: int
    overrides: tuple[tuple[str, Value], ...]


def jobs(
    suites: Sequence[str], *, frames: int, seed: int, overrides: Mapping[str, Value]
) -> list[Job]:
    """Return the jobs of suites, ordered by setup."""
    fixed = tuple(sorted(overrides.items()))
    return [
        Job(name, part, first, min(FRAMES_OF_A_WORLD, count - first), _world(seed, first), fixed)
        for name in suites for part in SUITES[name].setups
        for count in [SUITES[name].count(part, frames)]
        for first in range(0, count, FRAMES_OF_A_WORLD)
    ]


def _world(seed: int, index: int) -> int:
    """Return the seed of the world of a trial."""
    return (seed + SEEDS_APART * (index // FRAMES_OF_A_WORLD)) % MOST_SEED


def do(job: Job) -> list[Record]:
    """Run the trials of a job."""
    suite = SUITES[job.suite]
    bench = Bench(suite.setups[job.part], job.seed, dict(job.overrides))
    return [
        record for index in range(job.first, job.first + job.count)
        for record in suite.run(bench, job.part, index)
    ]


def run_all(
    work: Sequence[Job], *, processes: int, done: Callable[[Job], object]
) -> list[Record]:
    """
    Run all jobs.

    Parameters
    ----------
    work : sequence of Job
        Result of `jobs`.
    processes : int
        Number of processes; 1 runs the jobs in this process.
    done : callable
        Called after each job.

    Returns
    -------
    list of Record
        In the order of the jobs.

    """
    found: dict[Job, list[Record]] = {}
    if processes == 1:
        for job in work:
            found[job] = do(job)
            done(job)
    else:
        _spread(work, processes, done, found)
    return [record for job in work for record in found[job]]


def _spread(
    work: Sequence[Job], processes: int, done: Callable[[Job], object],
    found: dict[Job, list[Record]],
) -> None:
    context = multiprocessing.get_context('spawn')
    pool = ProcessPoolExecutor(processes, mp_context=context, initializer=_settle)
    try:
        waiting: dict[Future[list[Record]], Job] = {pool.submit(do, job): job for job in work}
        for future in as_completed(waiting):
            found[waiting[future]] = future.result()
            done(waiting[future])
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _settle() -> None:
    """Use one core, and ignore Ctrl-C, which the parent process handles."""
    use_one_thread()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
