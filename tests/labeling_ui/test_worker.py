"""The thread that stores: together, before it tells anybody, and each for itself."""

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from labeling_ui.page.store_thread import Worker

Together = Callable[[], AbstractContextManager[None]]


class Gate:
    """Keeps the worker from looking what waits, so that several things wait."""

    def __init__(self, worker: Worker) -> None:
        self._open = threading.Event()
        worker.submit(lambda: self._wait())

    def _wait(self) -> None:
        assert self._open.wait(10)

    def open(self) -> None:
        self._open.set()


def refuse() -> None:
    raise ValueError("this one is broken")


def run(together: Together, acts: dict[str, Callable[[], object]]) -> list[str]:
    """Have `acts` stored while all of them wait; what happened, in order."""
    log: list[str] = []
    worker = Worker(together)
    gate = Gate(worker)
    done = threading.Event()
    for name, act in acts.items():

        def stored(name: str = name, act: Callable[[], object] = act) -> object:
            log.append(f"{name} stores")
            return act()

        worker.store(
            stored,
            lambda result, name=name: log.append(f"{name} is told {result}"),
            lambda error, name=name: log.append(f"{name} failed: {error}"),
        )
    worker.submit(lambda: log.append("somebody looks"))
    worker.submit(done.set)
    gate.open()
    assert done.wait(10)
    worker.stop()
    return log


def test_nobody_is_told_before_everything_is_on_the_disk() -> None:
    """And who only looks waits behind those who answered."""
    order: list[str] = []

    @contextmanager
    def together() -> Iterator[None]:
        order.append("begin")
        yield
        order.append("on the disk")

    def act(name: str) -> Callable[[], object]:
        return lambda: order.append(name) or name

    log = run(together, {"ann": act("a"), "bob": act("b"), "eve": act("c")})
    assert order == ["begin", "a", "b", "c", "on the disk"]
    assert log == [
        "ann stores",
        "bob stores",
        "eve stores",
        "ann is told a",
        "bob is told b",
        "eve is told c",
        "somebody looks",
    ]


def test_one_that_fails_takes_nobody_along() -> None:
    """It is told so, and the others are told that theirs is stored."""

    @contextmanager
    def together() -> Iterator[None]:
        yield

    log = run(together, {"ann": lambda: 1, "bob": refuse, "eve": lambda: 3})
    assert log[3:6] == [
        "ann is told 1",
        "bob failed: this one is broken",
        "eve is told 3",
    ]


def test_where_the_disk_fails_nobody_is_told_otherwise() -> None:
    """Also those whose own part went well."""

    @contextmanager
    def together() -> Iterator[None]:
        yield
        raise OSError("the disk is full")

    log = run(together, {"ann": lambda: 1, "bob": lambda: 2})
    assert log[2:4] == ["ann failed: the disk is full", "bob failed: the disk is full"]


def test_what_waits_when_it_stops_is_stored() -> None:
    """It was given before the end, whether or not anybody can still be told."""
    stored: list[int] = []

    @contextmanager
    def together() -> Iterator[None]:
        yield

    worker = Worker(together)
    gate = Gate(worker)
    for number in range(3):
        worker.store(lambda n=number: stored.append(n), lambda _: None, lambda _: None)
    gate.open()
    worker.stop()
    assert stored == list(range(3))
