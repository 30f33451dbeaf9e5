"""What comes after a command of `gaitpref data`."""

from __future__ import annotations

from data.datasets.dataset import Dataset
from gaitpref.cli.options import data_options as options

from .next_of_answers import next_fit, next_pairs


def next_of_data(action: options.Action, *, damaged: bool) -> str:
    """In one sentence; empty where it ends the work, or says so itself."""
    match action:
        case options.Verify() if damaged:
            return f"`gaitpref data recover --dataset {action.dataset}` saves the rest"
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
            return (
                f"`gaitpref data pack --dataset {action.dataset} --out FILE.zip` puts "
                f"all in one file"
            )
        case options.View():
            return "open it in Foxglove, Rerun or PlotJuggler"
    return ""
