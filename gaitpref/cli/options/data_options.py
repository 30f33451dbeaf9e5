"""What `gaitpref data` can do and its options; a field's docstring is its `--help`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from data.datasets.card import OPEN

from .bounds import CountOrZero, Seed


@dataclass(frozen=True, kw_only=True)
class _OnDataset:
    dataset: Path
    """Data set directory."""


@dataclass(frozen=True, kw_only=True)
class _Reporting(_OnDataset):
    json: bool = False
    """Print one JSON object and nothing else."""


@dataclass(frozen=True, kw_only=True)
class _OnAnswers(_OnDataset):
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""


@dataclass(frozen=True, kw_only=True)
class _ReportingAnswers(_OnAnswers, _Reporting):
    pass


@dataclass(frozen=True, kw_only=True)
class Info(_ReportingAnswers):
    """Count episodes, steps, falls, policies, commands and answers."""


@dataclass(frozen=True, kw_only=True)
class Verify(_ReportingAnswers):
    """Compare every byte with what was written; exits 1 if something is damaged."""


@dataclass(frozen=True, kw_only=True)
class Recover(_Reporting):
    """Save every whole chunk of files that were cut short or damaged.

    What is replaced moves to damaged/ in the data set; nothing is deleted.
    """

    file: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction] = ()
    """A single episode file to save into the data set, which is made if it is missing;
    give it again for more. Without it, the data set itself is put in order."""


@dataclass(frozen=True, kw_only=True)
class Merge(_ReportingAnswers):
    """Take in other data sets: equal episodes once, answers apart by rater."""

    source: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction]
    """Data set to take in; give it again for more. It stays as it is."""


@dataclass(frozen=True, kw_only=True)
class Split(_ReportingAnswers):
    """Make one data set per part, by episode; pairs across two parts are left out."""

    out: Path
    """Directory the parts are made in."""
    part: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = (
        "train=0.8",
        "test=0.2",
    )
    """NAME=SHARE of a part; give it again for each. The shares make 1."""
    seed: Seed = 0
    """Which episodes go where."""


@dataclass(frozen=True, kw_only=True)
class Subset(_ReportingAnswers):
    """Copy the episodes that fit every filter, with the answers about them."""

    out: Path
    """Data set to copy to; made if it is not there."""
    policy: str | None = None
    """Beginning of the policy's hash."""
    round: CountOrZero | None = None
    """Round of the loop that recorded the episode."""
    robot: str | None = None
    """Name of the robot."""
    end: Literal["terminated", "truncated", "aborted"] | None = None
    """How the episode ended; terminated is a fall."""
    rater: str | None = None
    """Only episodes this rater answered about, and only the rater's answers."""


@dataclass(frozen=True, kw_only=True)
class Pack(_ReportingAnswers):
    """Write the whole data set to one archive."""

    out: Path
    """Archive to write, usually NAME.zip."""


@dataclass(frozen=True, kw_only=True)
class Unpack(_Reporting):
    """Make a data set out of an archive, every file compared with the manifest."""

    archive: Path
    """What `gaitpref data pack` wrote."""


@dataclass(frozen=True, kw_only=True)
class Card(_OnAnswers):
    """Write a data card in Markdown; says what the publisher still has to fill in."""

    out: Path | None = None
    """File to write; README.md of the data set by default."""
    title: str = OPEN
    """Name of the data set."""
    author: str = OPEN
    """Who publishes it, and how to reach them."""
    licence_rollouts: str = OPEN
    """Licence of the episodes; CC-BY-4.0 and CC0-1.0 are usual."""
    licence_answers: str = OPEN
    """Licence of the answers, to which the raters must have agreed."""
    licence_robot: str = OPEN
    """Licence of the robot model that every episode carries."""
    consent: str = OPEN
    """What the raters were told and agreed to."""


@dataclass(frozen=True, kw_only=True)
class Labels(_OnAnswers):
    """Print every answer in the published form, corrected ones too."""

    format: Literal["jsonl", "csv", "parquet"] = "jsonl"
    """parquet needs --out and the extra `parquet`."""
    out: Path | None = None
    """File to write; the terminal by default."""


@dataclass(frozen=True, kw_only=True)
class View(_OnAnswers):
    """Write clips for Foxglove, Rerun or PlotJuggler, and a Foxglove layout beside it.

    Both clips of a pair start at time 0 and run side by side. Needs the extra `view`.
    """

    out: Path
    """MCAP file to write, as view.mcap; the layout beside it is view.layout.json."""
    pair: str | None = None
    """Id of the pair to show, or its first letters."""
    episode: str | None = None
    """SHA-256 of the episode to show, or its first letters."""


@dataclass(frozen=True, kw_only=True)
class Import(_ReportingAnswers):
    """Take in what others recorded: logs of robots, or answers of other projects.

    Logs need --map and the extras `logs` and `train`: ros2 is a bag as ROS 2 writes it,
    a file or a folder, in MCAP or sqlite3, packed or not; csv, npz, parquet, lerobot
    and minari are tables. uni-rlhf (a directory that `data export --format uni-rlhf`
    made, with labels in it) and imitation (the file of a PreferenceDataset) add answers
    about episodes that are here; their pickles are read without running anything in
    them.
    """

    format: tyro.conf.Positional[
        Literal[
            "ros2",
            "csv",
            "npz",
            "parquet",
            "lerobot",
            "minari",
            "uni-rlhf",
            "imitation",
        ]
    ]
    """What it is."""
    source: tyro.conf.Positional[Path]
    """The bag, table, directory or file."""
    map: Path | None = None
    """TOML file that says which robot it is, and what topics, columns and joints are
    called."""
    rater: str = "imported"
    """Pseudonym of who gave the answers."""


@dataclass(frozen=True, kw_only=True)
class Export(_ReportingAnswers):
    """Write the data set in the format of another project; needs the extra `export`."""

    format: Literal["minari", "lerobot", "hf", "uni-rlhf", "d4rl"]
    """minari and lerobot hold episodes, d4rl the steps of all episodes in one array, hf
    preferences, uni-rlhf both."""
    out: Path
    """Directory to make."""


@dataclass(frozen=True, kw_only=True)
class _OnUrl:
    dataset: tyro.conf.Positional[Path]
    """Data set directory."""
    url: tyro.conf.Positional[str]
    """A directory, s3://BUCKET/PATH, gs://BUCKET/PATH, sftp://USER@HOST/PATH,
    hf://datasets/USER/NAME, or what else fsspec speaks."""
    answers: str | None = None
    """postgresql://USER@HOST/DATABASE that keeps pairs and answers; the data set's own
    file by default."""
    json: bool = False
    """Print one JSON object and nothing else."""


@dataclass(frozen=True, kw_only=True)
class Push(_OnUrl):
    """Send what a place lacks of a data set; needs the extra `remote`.

    Every file is sent once and compared on arrival, answers are merged with those that
    are there. Killed anywhere, the same command goes on.
    """


@dataclass(frozen=True, kw_only=True)
class Pull(_OnUrl):
    """Take what a data set lacks from a place; needs the extra `remote`.

    The data set is made if it is missing. Every file is compared with its name, answers
    are merged with those that are here. Killed anywhere, the same command goes on.
    """


Action = (
    Annotated[Info, tyro.conf.subcommand("info")]
    | Annotated[Verify, tyro.conf.subcommand("verify")]
    | Annotated[Recover, tyro.conf.subcommand("recover")]
    | Annotated[Merge, tyro.conf.subcommand("merge")]
    | Annotated[Split, tyro.conf.subcommand("split")]
    | Annotated[Subset, tyro.conf.subcommand("subset")]
    | Annotated[Pack, tyro.conf.subcommand("pack")]
    | Annotated[Unpack, tyro.conf.subcommand("unpack")]
    | Annotated[Card, tyro.conf.subcommand("card")]
    | Annotated[Labels, tyro.conf.subcommand("labels")]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[Import, tyro.conf.subcommand("import")]
    | Annotated[Export, tyro.conf.subcommand("export")]
    | Annotated[Push, tyro.conf.subcommand("push")]
    | Annotated[Pull, tyro.conf.subcommand("pull")]
)


@dataclass(frozen=True)
class Data:
    """Look after data sets: check, save, merge, split, pack, publish."""

    action: tyro.conf.OmitSubcommandPrefixes[Action]
