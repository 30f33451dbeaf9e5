"""The command `gaitpref`: parse, run, and turn what the user can mend into one line."""

from __future__ import annotations

import contextlib
import importlib
import importlib.metadata
import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import tyro

from data.errors import GaitprefError, RankLost
from data.files.faults import is_full, told
from gaitpref.cli.options import options
from gaitpref.cli.options.bounds import require_bounds
from gaitpref.cli.options.team_options import TeamTrain
from gaitpref.console.extras import missing
from gaitpref.console.terminal import (
    EXIT_BAD_INPUT,
    EXIT_INTERRUPTED,
    UNSAID,
    complain,
    drop_output,
    finish,
    prepare,
)

from .shared.launched import is_ending, is_launched, is_to_say
from .usage import WELCOME, did_you_mean, overview, require_command

EXIT_NOT_READ = 141
"""Exit code of a program that SIGPIPE ends."""


def parse(args: Sequence[str] | None = None) -> options.Command:
    """The command of the arguments; exits without any, on `--help`, on bad usage.

    Raises:
        UsageError: there is no such command.
    """
    args = sys.argv[1:] if args is None else args
    if not args:
        print(WELCOME)
        raise SystemExit(0)
    if list(args) == ["--version"]:
        print(f"gaitpref {importlib.metadata.version('gaitpref')}")
        raise SystemExit(0)
    if list(args) in (["--help"], ["-h"]):
        print(overview())
        raise SystemExit(0)
    require_command(args)
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                options.Command,
                prog="gaitpref",
                description="Turns preferences between gaits into a better policy.",
                args=args,
                config=(tyro.conf.FlagCreatePairsOff, tyro.conf.OmitArgPrefixes),
            )
    except SystemExit as left:
        # Where it is clear what was meant, one line says more than a screen.
        if left.code and (meant := did_you_mean(args)):
            complain(meant)
        else:
            sys.stderr.write(said.getvalue())
        raise


def main(args: Sequence[str] | None = None) -> int:
    """Run one command; the exit code is 0 only on success."""
    prepare()
    command: options.Command | None = None
    try:
        try:
            command = parse(args)
            code = run(command)
        except SystemExit:
            finish()
            raise
        finish()
        if UNSAID:
            complain(UNSAID[0])
            return EXIT_BAD_INPUT
        return code
    except BrokenPipeError:
        # Whoever read along has had enough; nothing more can be said to them.
        drop_output()
        return EXIT_NOT_READ
    except GaitprefError as error:
        is_ending()
        line = " ".join(str(error).split())
        if is_to_say(line, cause=not isinstance(error, RankLost)):
            complain(line, error.lines)
        return EXIT_BAD_INPUT
    except OSError as error:
        return _failed(error, command)
    except KeyboardInterrupt:
        is_ending()
        how = "with --resume " if _resumes(command) else ""
        line = f"interrupted; the same command {how}goes on"
        if is_to_say(line, cause=False):
            complain(line)
        return EXIT_INTERRUPTED


def _failed(error: OSError, command: options.Command | None) -> int:
    """Say what the system refused; what nobody can mend is a bug and shown as one."""
    try:
        finish()
    except OSError as of_output:
        error = of_output
        drop_output()
    if error.filename is None:
        # A write that fails does not say where, but where it was to is known.
        error.filename = _place(command)
    line = told(error)
    if line is None:
        raise error
    if _resumes(command) and is_full(error):
        line += " with --resume"
    complain(line)
    return EXIT_BAD_INPUT


def _resumes(command: options.Command | None) -> bool:
    """Whether it only goes on with a training when told to."""
    if isinstance(command, options.Team):
        return isinstance(command.action, TeamTrain)
    return isinstance(command, options.Train)


_HOMES: dict[type, tuple[str, str]] = {
    options.Answer: ("answer", "train"),
    options.Arena: ("looking.arena", "train"),
    options.Doctor: ("doctor", "train,label"),
    options.Evaluate: ("looking.evaluate", "train"),
    options.Explain: ("looking.explain", "train"),
    options.Export: ("export", "train,onnx"),
    options.Film: ("looking.film", "train"),
    options.Fit: ("fit", "fit"),
    options.Label: ("label", "label"),
    options.Loop: ("loop", "train"),
    options.Method: ("method", "train"),
    options.Options: ("options", "train"),
    options.Pairs: ("pairs", "fit"),
    options.Play: ("looking.play", "train,label"),
    options.Policy: ("import_policy", "train,onnx"),
    options.Raters: ("raters", "label"),
    options.Record: ("record", "train"),
    options.Relabel: ("fit", "fit"),
    options.Report: ("looking.report", "train"),
    options.Robot: ("robot", "train,label"),
    options.Sweep: ("sweep", "train"),
    options.Team: ("team", "train"),
    options.Train: ("train", "train"),
    options.Trust: ("looking.trust", "train"),
    options.Watch: ("looking.watch", "train,label"),
}
"""Module of each command, and the extra that installs what it imports."""


def _place(command: options.Command | None) -> Path | None:
    """Where a command writes to, as it was told."""
    grouped = isinstance(command, options.Data | options.Team)
    told_to = command.action if grouped else command
    for name in ("out", "run", "dataset"):
        if isinstance(place := getattr(told_to, name, None), Path):
            return place
    return None


def run(command: options.Command) -> int:
    """Hand the command to its function."""
    require_bounds(command)
    if is_launched() and not isinstance(command, options.Train | options.Loop):
        raise GaitprefError(
            "torchrun is for `train` and for `loop`, whose trainings it makes several "
            "processes do together: start any other command once, without it"
        )
    _compute_with_one_thread()
    if isinstance(command, options.Data):
        from gaitpref.cli.commands import data as data_commands

        return data_commands.run(command.action)
    # Imported here: the packages a command needs are heavy, and a labeler has no torch.
    module, extra = _home_of(command)
    try:
        commands = importlib.import_module(f"gaitpref.cli.commands.{module}")
    except ModuleNotFoundError as error:
        raise missing(error, extra) from None
    return commands.run(command)


def _compute_with_one_thread() -> None:
    """The networks are small: a second thread wins little, loses a lot where another
    process wants the core, and would let results depend on the number of cores.

    Most commands import torch later, as late as they can; it asks the environment then.
    """
    os.environ["OMP_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "1"
    if torch := sys.modules.get("torch"):
        torch.set_num_threads(1)


def _home_of(command: options.Command) -> tuple[str, str]:
    """The module of a command, and the extra that installs what it imports."""
    for kind, home in _HOMES.items():
        if isinstance(command, kind):
            return home
    raise TypeError(f"no module runs the command {type(command).__name__}")


if __name__ == "__main__":
    sys.exit(main())
