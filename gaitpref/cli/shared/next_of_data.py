"""What comes after a command of `gaitpref data`."""

from __future__ import annotations

from pathlib import Path

from data.datasets.dataset import Dataset
from gaitpref.cli.options import data_options as options

from .next_of_answers import next_fit, next_pairs

_READS = {
    "csv": "pandas.read_csv({})",
    "jsonl": "pandas.read_json({}, lines=True)",
    "parquet": "pandas.read_parquet({})",
}
_OPENS = {
    "minari": "minari.MinariDataset('{}/data')",
    "d4rl": "h5py.File('{}/dataset.hdf5')",
    "lerobot": "LeRobotDataset(NAME, root='{}')",
    "hf": "datasets.load_dataset('{}')",
}


def next_of_data(action: options.Action, *, damaged: bool) -> str:
    """In one sentence; empty where it says so itself."""
    match action:
        case options.Verify() if damaged:
            return f"`gaitpref data recover --dataset {action.dataset}` saves the rest"
        case options.Verify():
            return _packed(action.dataset)
        case options.Recover():
            return (
                f"`gaitpref data verify --dataset {action.dataset}` looks at it again"
            )
        case options.Import() if action.format not in ("uni-rlhf", "imitation"):
            return next_pairs(Dataset.open(action.dataset))
        case options.Merge() | options.Unpack() | options.Pull() | options.Import():
            return (
                f"`gaitpref data info --dataset {action.dataset}` counts what it holds"
            )
        case options.Split():
            first = action.part[0].partition("=")[0]
            return next_fit(Dataset.open(action.out / first))
        case options.Subset():
            return f"`gaitpref data info --dataset {action.out}` counts what it holds"
        case options.Pack():
            return (
                f"`gaitpref data unpack --archive {action.out} --dataset DIR` takes it "
                f"apart"
            )
        case options.Push():
            return f"`gaitpref data pull DIR {action.url}` takes it from there"
        case options.Card():
            return _packed(action.dataset)
        case options.Labels() if action.out is None:
            return (
                f"`gaitpref data card --dataset {action.dataset}` describes them, for "
                "who gets them"
            )
        case options.Labels():
            return f"{_READS[action.format].format(repr(str(action.out)))} reads them"
        case options.Export() if action.format == "uni-rlhf":
            return (
                f"`gaitpref data import uni-rlhf {action.out} --dataset "
                f"{action.dataset}` takes in labels that others put there"
            )
        case options.Export():
            return f"{_OPENS[action.format].format(action.out)} opens it"
        case options.View():
            return "open it in Foxglove, Rerun or PlotJuggler"
    return ""


def _packed(root: Path) -> str:
    return f"`gaitpref data pack --dataset {root} --out FILE.zip` puts all in one file"
