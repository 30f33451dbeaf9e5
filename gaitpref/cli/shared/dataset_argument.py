"""The data set a command is about, with its answers where the command says."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from data.answers.address import Address, parse_address
from data.datasets.dataset import Dataset


class OnAnswers(Protocol):
    """The options `--dataset` and `--answers`."""

    @property
    def dataset(self) -> Path: ...
    @property
    def answers(self) -> str | None: ...


def open_dataset(command: OnAnswers) -> Dataset:
    """The data set of a command.

    Raises:
        DatasetError: the directory is none.
        AnswerError: `--answers` is no URL of PostgreSQL.
    """
    return Dataset.open(command.dataset, answers=address(command.answers))


def address(answers: str | None) -> Address | None:
    """Where `--answers` says that pairs and answers are; None is the data set's file.

    Raises:
        AnswerError: it is no URL of PostgreSQL.
    """
    return None if answers is None else parse_address(answers)
