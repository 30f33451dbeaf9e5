"""When the samples of a bag were taken, and where their clock starts anew.

Time may start anew within a bag: a simulation was reset, another bag was played in a
loop. What lies between two such moments is a run, and runs are never mixed.

Shapes: M samples of a bag, S of one topic.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from gaitpref.formats.logs.log_findings import Findings
from gaitpref.formats.logs.log_map import LogMap

DISORDER_S = 0.1
"""Messages of one topic may be late by this much; a clock that goes back by more
starts anew."""

_RESTART_S = 1.0
"""All topics start anew within this time of one another."""


@dataclass(frozen=True, eq=False)
class Sample:
    """The numbers of one message."""

    topic: str
    log_s: float
    """When it was recorded."""
    stamp_s: float | None
    """The message's own time; None where it has none or nobody filled it in."""
    numbers: Mapping[str, list[float]]


Timed = tuple[float, Mapping[str, list[float]]]
"""Time and numbers of a sample."""

Run = dict[str, list[Timed]]
"""The samples of each topic, in the order of time."""


def runs_of(samples: list[Sample], log_map: LogMap, findings: Findings) -> list[Run]:
    """The samples of a bag, run by run.

    Args:
        samples: All of them, as they were written.
        log_map: Whose clock counts.
        findings: Told what is left out.
    """
    log_s = np.array([sample.log_s for sample in samples])
    own_s = np.array([_own_s(sample, log_map) for sample in samples])
    found: dict[str, list[int]] = defaultdict(list)
    for index, sample in enumerate(samples):
        found[sample.topic].append(index)
    topics = {
        topic: _believed(topic, np.array(indices), own_s, findings)
        for topic, indices in found.items()
    }
    order = _in_order(topics, log_s)
    run_of = _numbered(topics, order, own_s, log_s)
    count = int(run_of[order].max(initial=-1)) + 1
    if count > 1:
        findings.tell(
            f"the clock goes back, {count - 1} times in all: each time, what follows "
            "is in episodes of its own"
        )
    _tell_clocks(topics, own_s, log_s, log_map, findings)
    time_s = _placed(topics, run_of, own_s, log_s, log_map)
    runs: list[Run] = [defaultdict(list) for _ in range(count)]
    for index in order[np.argsort(time_s[order], kind="stable")]:
        sample = samples[index]
        timed = (float(time_s[index]), sample.numbers)
        runs[run_of[index]][sample.topic].append(timed)
    return runs


def _own_s(sample: Sample, log_map: LogMap) -> float:
    """The time of a sample by the clock that counts; NaN where it has none."""
    if log_map.time == "log":
        return sample.log_s
    return np.nan if sample.stamp_s is None else sample.stamp_s


def _believed(
    topic: str, indices: np.ndarray, own_s: np.ndarray, findings: Findings
) -> np.ndarray:
    """The samples of a topic whose time is known; all where none has a stamp."""
    times_s = own_s[indices]
    known = np.isfinite(times_s)
    if not known.any():
        return indices
    findings.leave_out(f"{topic} without a stamp", int((~known).sum()))
    alone = _alone(times_s[known])
    findings.leave_out(f"{topic} stamped far from their neighbours", int(alone.sum()))
    return indices[known][~alone]


def _alone(times_s: np.ndarray) -> np.ndarray:
    """Which times [S] are far off while those on both sides go on together."""
    alone = np.zeros(len(times_s), dtype=bool)
    before, here, after = times_s[:-2], times_s[1:-1], times_s[2:]
    goes_on = np.abs(after - before) <= DISORDER_S
    alone[1:-1] = goes_on & (np.abs(here - before) > 2 * DISORDER_S)
    return alone


def _in_order(topics: Mapping[str, np.ndarray], log_s: np.ndarray) -> np.ndarray:
    """All samples in the order in which they were recorded.

    That is by their log times, unless the recorder's clock went back.
    """
    order = np.sort(np.concatenate([np.zeros(0, dtype=int), *topics.values()]))
    for indices in topics.values():
        times_s = log_s[indices]
        if (times_s < np.maximum.accumulate(times_s) - DISORDER_S).any():
            return order
    return order[np.argsort(log_s[order], kind="stable")]


def _numbered(
    topics: Mapping[str, np.ndarray],
    order: np.ndarray,
    own_s: np.ndarray,
    log_s: np.ndarray,
) -> np.ndarray:
    """The run [M] of every sample; each topic begins one where it goes back itself."""
    rank_of = np.zeros(len(own_s), dtype=int)
    rank_of[order] = np.arange(len(order))
    went_back = sorted(
        (rank, topic)
        for topic, indices in topics.items()
        for rank in _goes_back(np.sort(rank_of[indices]), own_s[order])
    )
    restarts: list[dict[str, int]] = []
    for rank, topic in went_back:
        first = min(restarts[-1].values()) if restarts else rank
        at_once = abs(log_s[order[rank]] - log_s[order[first]]) <= _RESTART_S
        if not restarts or topic in restarts[-1] or not at_once:
            restarts.append({})
        restarts[-1][topic] = rank
    run_of = np.zeros(len(own_s), dtype=int)
    for topic, indices in topics.items():
        begins = [ranks.get(topic, min(ranks.values())) for ranks in restarts]
        run_of[indices] = np.searchsorted(begins, rank_of[indices], side="right")
    return run_of


def _goes_back(ranks: np.ndarray, time_s: np.ndarray) -> Iterator[int]:
    """The `ranks` of a topic at which its clock starts anew."""
    newest = -math.inf
    for rank in ranks.tolist():
        # A time that is not known, NaN, is neither earlier nor later.
        if time_s[rank] < newest - DISORDER_S:
            newest = -math.inf
            yield rank
        if time_s[rank] > newest:
            newest = float(time_s[rank])


def _placed(
    topics: Mapping[str, np.ndarray],
    run_of: np.ndarray,
    own_s: np.ndarray,
    log_s: np.ndarray,
    log_map: LogMap,
) -> np.ndarray:
    """The time [M] of every sample by one clock.

    What has no stamp is placed between the joints, or the base, that were recorded
    when it was.
    """
    time_s = np.where(np.isfinite(own_s), own_s, log_s)
    needed = (log_map.joints.topic, log_map.base_topic)
    stamped = [t for t in needed if t in topics and np.isfinite(own_s[topics[t]]).any()]
    if not stamped:
        return time_s
    clock = topics[stamped[0]]
    for indices in topics.values():
        without = indices[~np.isfinite(own_s[indices])]
        for run in np.unique(run_of[without]):
            here = clock[run_of[clock] == run]
            if len(here):
                here = here[np.argsort(log_s[here], kind="stable")]
                mine = without[run_of[without] == run]
                ahead_s = (own_s - log_s)[here]
                time_s[mine] += np.interp(log_s[mine], log_s[here], ahead_s)
    return time_s


def _tell_clocks(
    topics: Mapping[str, np.ndarray],
    own_s: np.ndarray,
    log_s: np.ndarray,
    log_map: LogMap,
    findings: Findings,
) -> None:
    """Tell of joints and base without stamps, or with those of two clocks."""
    lags: dict[str, float] = {}
    for topic in (log_map.joints.topic, log_map.base_topic):
        indices = topics.get(topic, np.zeros(0, dtype=int))
        known = indices[np.isfinite(own_s[indices])]
        if len(known):
            lags[topic] = float(np.median((log_s - own_s)[known]))
        elif len(indices):
            findings.tell(
                f"{topic} has no stamps; it is placed by when it was recorded"
            )
    if len(lags) == 2:
        apart_s = max(lags.values()) - min(lags.values())
        if apart_s > log_map.max_gap_s:
            findings.tell(
                f"the stamps of {' and '.join(lags)} are {apart_s:.3g} s apart at the "
                'same moment, as of two clocks; time = "log" in the map takes the '
                "recorder's"
            )
