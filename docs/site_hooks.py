"""Fills the reference pages of the site from the code: commands, records, tables.

The builder calls `on_page_markdown` for every page.
"""

from __future__ import annotations

import ast
import contextlib
import io
import re
from pathlib import Path
from typing import Any

from reference_tables import TABLES

from gaitpref.cli.main import parse

ROOT = Path(__file__).resolve().parents[1]
RECORDS = (
    "gaitpref.loop.loop_cfg.LoopCfg",
    "gaitpref.loop.loop_cfg.StepsCfg",
    "gaitpref.method.method.Method",
    "gaitpref.method.clip_sources.ClipSources",
    "gaitpref.method.budget.FrontLoaded",
    "gaitpref.method.questions.Questions",
    "gaitpref.method.paid.SurelyLiked",
    "gaitpref.method.exploration.Descending",
    "gaitpref.method.exploration.PutBack",
    "gaitpref.method.unstick.Optimism",
    "gaitpref.method.acceptance.Compared",
    "gaitpref.method.tracking.TrackingPrice",
    "policy.offpolicy.sac_cfg.SacCfg",
    "policy.offpolicy.sac_cfg.PriorityCfg",
    "gaitpref.raters.rater_cfg.RaterCfg",
    "rewardmodel.cfg.FitCfg",
    "rewardmodel.cfg.LinearCfg",
    "rewardmodel.cfg.PosteriorCfg",
    "rewardmodel.asking.clip_questions.ClipCfg",
    "policy.rollouts.record_cfg.RecordCfg",
    "policy.env.env_cfg.EnvCfg",
    "policy.env.known_terms.KnownTermsCfg",
    "policy.training.ppo.PpoCfg",
)
"""What a configuration is made of, from the loop down."""
_BRACES = re.compile(r"\{([\w,\s]+)\}")
_ANSI = re.compile(r"\x1b\[[0-9;]*m")
_NAMES = re.compile(r"<!-- names: (\w+) -->")
_TABLE = re.compile(r"<!-- table: ([\w ]+) -->")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The text of a page, with what stands between its marks written out."""
    if "<!-- commands -->" in markdown:
        markdown = markdown.replace("<!-- commands -->", _commands())
    if "<!-- records -->" in markdown:
        parts = [f"::: {name}" for name in RECORDS]
        markdown = markdown.replace("<!-- records -->", "\n\n".join(parts))
    markdown = _TABLE.sub(lambda found: TABLES[found[1]](), markdown)
    return _NAMES.sub(lambda found: _names(found[1]), markdown)


def _commands() -> str:
    names = _listed(_help())
    deeper = {"data": _listed(_help("data"))}
    return "\n\n".join(
        f"{'##' if len(command) == 1 else '###'} gaitpref {' '.join(command)}\n\n"
        f"```text\n{_help(*command)}\n```"
        for name in names
        for command in ((name,), *((name, action) for action in deeper.get(name, ())))
    )


def _listed(told: str) -> list[str]:
    """Subcommands in the braces of a usage line."""
    found = _BRACES.search(told)
    return re.findall(r"\w+", found[1]) if found else []


def _help(*command: str) -> str:
    told = io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.suppress(SystemExit):
        parse([*command, "--help"])
    return _ANSI.sub("", told.getvalue()).strip()


def _names(package: str) -> str:
    """A section for each name that a package's stub hands on."""
    stub = ast.parse((ROOT / package / "__init__.pyi").read_text())
    return "\n\n".join(
        _section(f"{package}.{node.module}.{alias.name}")
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    )


def _section(name: str) -> str:
    if name not in RECORDS:
        return f"::: {name}"
    short = name.rpartition(".")[2]
    return f"### {short}\n\nSee [Configuration](configuration.md#{name})."
