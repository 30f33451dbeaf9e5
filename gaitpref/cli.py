"""The command `gaitpref`: parse, run, and turn what the user can mend into one line."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence

import tyro

from data.errors import GaitprefError

from . import options
from .extras import missing

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130
EXIT_NOT_READ = 141
"""As of a program that SIGPIPE ends."""


def parse(args: Sequence[str] | None = None) -> options.Command:
    """The command of the arguments; exits on `--help` and on bad usage."""
    return tyro.cli(
        options.Command,
        prog="gaitpref",
        description="Turns preferences between gaits into a better policy.",
        args=args,
        config=(tyro.conf.FlagCreatePairsOff, tyro.conf.OmitArgPrefixes),
    )


def main(args: Sequence[str] | None = None) -> int:
    """Run one command; the exit code is 0 only on success."""
    try:
        code = run(parse(args))
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        # Whoever read along has had enough; nothing more can be said to them.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_NOT_READ
    except GaitprefError as error:
        print(f"gaitpref: {' '.join(str(error).split())}", file=sys.stderr)
        if error.lines:
            print(error.lines, file=sys.stderr)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("gaitpref: interrupted; the same command goes on", file=sys.stderr)
        return EXIT_INTERRUPTED


def run(command: options.Command) -> int:
    """Hand the command to its function."""
    options.check(command)
    if isinstance(command, options.Data):
        from . import data_commands

        return data_commands.run(command.action)
    # Imported here: the packages a command needs are heavy, and a labeler has no torch.
    module, extra = _home_of(command)
    try:
        commands = importlib.import_module(f".{module}", __package__)
    except ModuleNotFoundError as error:
        raise missing(error, extra) from None
    return commands.run(command)


def _home_of(command: options.Command) -> tuple[str, str]:
    """The module of a command, and the extra that installs what it imports."""
    match command:
        case options.Fit() | options.Relabel():
            return "fit_command", "fit"
        case options.Pairs():
            return "pairs_command", "fit"
        case options.Raters():
            return "raters_command", "label"
        case options.Label():
            return "label_command", "label"
        case options.Export():
            return "export_command", "train,onnx"
        case options.Robot():
            return "robot_command", "train,label"
        case options.Trust():
            return "trust_command", "train"
        case options.Explain():
            return "explain_command", "train"
        case options.Play():
            return "play_command", "train,label"
        case (
            options.Loop()
            | options.Train()
            | options.Record()
            | options.Answer()
            | options.Evaluate()
            | options.Report()
        ):
            return "commands", "train"
    raise TypeError(f"no module runs the command {type(command).__name__}")


if __name__ == "__main__":
    sys.exit(main())
