"""`gaitpref data import` and `export`: to and from the formats of others.

What a format needs is imported with it: few have all of it installed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from data.datasets.dataset import Dataset, EpisodeEntry
from data.errors import DatasetError
from data.features import column
from data.files.telling import Tell
from gaitpref.cli.options import data_options as options
from gaitpref.cli.shared.dataset_argument import address, open_dataset
from gaitpref.console.extras import require
from gaitpref.console.progress import counted, each_counted

if TYPE_CHECKING:
    from gaitpref.formats.export_source import Exported
    from gaitpref.formats.logs.log_episodes import LogEpisodes
    from gaitpref.formats.logs.log_map import LogMap


def import_into(action: options.Import) -> dict[str, Any]:
    """Add what `action.source` holds to the data set; gives what was new."""
    match action.format:
        case "uni-rlhf":
            from gaitpref.formats.uni_rlhf import import_uni_rlhf

            added = import_uni_rlhf(open_dataset(action), action.source, action.rater)
        case "imitation":
            from gaitpref.formats.imitation import import_imitation

            with counted("looking for the fragments, episodes") as tell:
                added = import_imitation(
                    open_dataset(action), action.source, action.rater, tell
                )
        case _:
            return _import_log(action)
    return {"answers": added}


def _import_log(action: options.Import) -> dict[str, Any]:
    if action.map is None:
        raise DatasetError(
            f"data import {action.format} needs --map FILE.toml, which says what the "
            "log's names mean; docs/how-to/robot-log.md shows one"
        )
    require("mujoco", "train,logs")
    from gaitpref.formats.logs.log_map import load_map

    # Read first: a log that cannot be used leaves no empty data set behind.
    log_map = load_map(action.map)
    with counted("reading the log, stretches") as tell:
        found = _log_episodes(action, log_map, action.map.parent, tell)
    dataset = Dataset.create(action.dataset, answers=address(action.answers))
    made = found.episodes
    with each_counted("writing episodes", made, len(made)) as episodes:
        entries = dataset.add_episodes(episodes)

    def told(key: str) -> list[str]:
        return sorted({n for entry in entries for n in entry.meta.extra[key].split()})

    return {
        "episodes": len(entries),
        "steps": sum(entry.num_steps for entry in entries),
        "stretches": found.stretches,
        "robot": entries[0].meta.robot,
        "asked_m_s": _forward_m_s(dataset, entries, "command"),
        "seen_m_s": _forward_m_s(dataset, entries, "base_lin_vel_b"),
        "missing": told("missing_features"),
        "estimated": told("estimated_features"),
        "left_out": dict(found.findings.left_out),
        "told": found.findings.told,
    }


def _forward_m_s(
    dataset: Dataset, entries: Sequence[EpisodeEntry], feature: str
) -> float | None:
    """Mean of the first number of a feature, over all steps that have it."""
    firsts = [
        dataset.features(entry.sha256, keep=False)[:, column(feature)][:, 0]
        for entry in entries
    ]
    known = np.concatenate(firsts)
    known = known[np.isfinite(known)]
    return round(float(known.mean()), 2) if len(known) else None


def _log_episodes(
    action: options.Import, log_map: LogMap, root: Path, tell: Tell
) -> LogEpisodes:
    match action.format:
        case "csv" | "npz" | "parquet" | "lerobot" | "minari":
            from gaitpref.formats.tables.table_episodes import table_episodes

            return table_episodes(action.source, action.format, log_map, root, tell)
        case _:
            require("mcap_ros2.decoder", "logs")
            from gaitpref.formats.ros2.bag_episodes import bag_episodes

            return bag_episodes(action.source, log_map, root, tell)


def export(action: options.Export, tell: Tell) -> Exported:
    """Write the data set in another format; `tell` gets how far it is."""
    from gaitpref.formats.export_source import Source

    dataset = open_dataset(action)
    source = Source.of(dataset, with_actions=action.format != "hf", tell=tell)
    match action.format:
        case "minari":
            from gaitpref.formats.hdf5 import export_minari as write
        case "d4rl":
            from gaitpref.formats.hdf5 import export_d4rl as write
        case "lerobot":
            from gaitpref.formats.lerobot import export_lerobot as write
        case "hf":
            from gaitpref.formats.hugging_face import export_hugging_face as write
        case "uni-rlhf":
            from gaitpref.formats.uni_rlhf import export_uni_rlhf as write
    return write(source, action.out)
