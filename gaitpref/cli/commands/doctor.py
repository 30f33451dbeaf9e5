"""`gaitpref doctor`: what is here, what is missing, and what to do about it."""

from __future__ import annotations

import json
from dataclasses import asdict

from rich import box
from rich.table import Table

from gaitpref.cli.options import options
from gaitpref.console.progress import console
from gaitpref.console.terminal import PlainConsole
from gaitpref.doctor import machine
from gaitpref.doctor.finding import Finding
from gaitpref.doctor.installed import own_packages, package_findings, python_finding

EXIT_BROKEN = 1
_STYLES = {"ok": "green", "missing": "yellow", "bad": "bold red"}


def run(command: options.Doctor) -> int:
    """Look at everything; gives the exit code, 0 where somebody can work."""
    found = [
        python_finding(),
        own_packages(),
        *package_findings(),
        machine.renderer(),
        machine.browser(),
        machine.gpu(),
        machine.place(),
        machine.processor(),
        machine.port(),
    ]
    broken = [finding for finding in found if finding.breaks]
    if command.json:
        told = [asdict(finding) for finding in found]
        print(json.dumps({"works": not broken, "findings": told}))
    else:
        PlainConsole().print(_table(found))
        console.next(_next(broken))
    return EXIT_BROKEN if broken else 0


def _table(found: list[Finding]) -> Table:
    table = Table("", "what", "found, and what to do", box=box.SIMPLE_HEAD)
    for finding in found:
        told = (
            f"{finding.told}\n-> {finding.advice}" if finding.advice else finding.told
        )
        table.add_row(finding.state, finding.name, told, style=None)
        table.rows[-1].style = "" if finding.state == "ok" else _STYLES[finding.state]
    return table


def _next(broken: list[Finding]) -> str:
    if broken:
        return f"{broken[0].advice} ({broken[0].name})"
    return "`gaitpref` alone says where to begin"
