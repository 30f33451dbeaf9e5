"""`gaitpref data import` and `export`: to and from the formats of others.

What a format needs is imported with it: few have all of it installed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from data.datasets.dataset import Dataset
from data.errors import DatasetError
from gaitpref.cli.options import data_options as options
from gaitpref.cli.shared.dataset_argument import address, open_dataset
from gaitpref.console.extras import require

if TYPE_CHECKING:
    from gaitpref.formats.export_source import Exported


def import_into(action: options.Import) -> dict[str, Any]:
    """Add what `action.source` holds to the data set; gives what was new."""
    match action.format:
        case "ros2":
            return _import_bag(action)
        case "uni-rlhf":
            from gaitpref.formats.uni_rlhf import import_uni_rlhf

            added = import_uni_rlhf(open_dataset(action), action.source, action.rater)
        case "imitation":
            from gaitpref.formats.imitation import import_imitation

            added = import_imitation(open_dataset(action), action.source, action.rater)
    return {"answers": added}


def _import_bag(action: options.Import) -> dict[str, Any]:
    if action.map is None:
        raise DatasetError(
            "--format ros2 needs --map FILE.toml; docs/how-to/ros2-bag.md shows one"
        )
    for module in ("mcap_ros2.decoder", "mujoco"):
        require(module, "train,view")
    from gaitpref.formats.ros2.bag_map import load_map
    from gaitpref.formats.ros2.convert import bag_episodes

    # Read first: a bag that cannot be used leaves no empty data set behind.
    bag_map = load_map(action.map)
    found = bag_episodes(action.source, bag_map, action.map.parent)
    dataset = Dataset.create(action.dataset, answers=address(action.answers))
    entries = dataset.add_episodes(found.episodes)
    missing = {entry.meta.extra["missing_features"] for entry in entries}
    return {
        "episodes": len(entries),
        "steps": sum(entry.num_steps for entry in entries),
        "stretches": found.stretches,
        "missing": sorted({name for names in missing for name in names.split()}),
        "left_out": dict(found.findings.left_out),
        "told": found.findings.told,
    }


def export(action: options.Export) -> Exported:
    """Write the data set in another format."""
    from gaitpref.formats.export_source import Source

    dataset = open_dataset(action)
    source = Source.of(dataset, with_actions=action.format != "hf")
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
