"""The quickstart, pasted block after block into one shell in an empty directory."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers import few_evaluated
from tests.helpers.local_host import free_port

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INSTALL = """\
python3 -m venv .venv
.venv/bin/pip install -c constraints.txt -e '.[train,label]'
source .venv/bin/activate
"""
SMALL = "--rounds 1 --labels 8 --steps 100"
INSTEAD = {
    INSTALL: 'mkdir bin; ln -s "$TESTED" bin/gaitpref; PATH="$PWD/bin:$PATH"\n',
    "gaitpref loop --run runs/demo": f"gaitpref loop --run runs/demo {SMALL}",
    "gaitpref loop --run runs/level": f"gaitpref loop --run runs/level {SMALL}",
    " --labels 20": "",
    "gaitpref loop --run runs/ours": "served $PORT gaitpref loop --run runs/ours",
    "gaitpref play": "served $PORT gaitpref play",
    "rounds/02": "rounds/01",
}
"""What is typed in place of what the page says; nothing else differs."""
SAVED = re.compile(r"Save this as `(\w+\.py)`")
PRELUDE = r"""
set -em
served() {
  local port=$1; shift
  "$@" --port "$port" & server=$!
  for _ in $(seq 600); do
    if { exec 3<>"/dev/tcp/127.0.0.1/$port"; } 2>/dev/null; then
      printf 'GET / HTTP/1.0\r\nHost: 127.0.0.1:%s\r\n\r\n' "$port" >&3
      read -r status <&3 || status='no answer'
      exec 3<&-
      kill -INT -- "-$server"
      wait "$server" || code=$?
      echo "served: $status, then ${code:-0}"
      return
    fi
    kill -0 "$server"; sleep 0.1
  done
  kill -- "-$server"; return 1
}
"""
"""A server is started, asked for its page once it listens, and stopped by Ctrl-C."""


def pasted() -> str:
    """All blocks in order, shell as it is, Python saved or run as the page says."""
    page = (ROOT / "docs" / "quickstart.md").read_text()
    script, end = PRELUDE, 0
    for found in BLOCK.finditer(page):
        said, end = page[end : found.start()], found.end()
        text = found[2]
        if found[1] == "python":
            saved = SAVED.search(said)
            to = f"cat > {saved[1]}" if saved else f'"{sys.executable}"'
            script += f"{to} <<'PYTHON'\n{text}PYTHON\n"
        else:
            for old, new in INSTEAD.items():
                text = text.replace(old, new)
            script += text
    return script


@pytest.mark.slow
def test_the_quickstart_works_as_it_is_pasted(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "quickstart.md").read_text()
    assert [old for old in INSTEAD if old not in page] == []
    typed = tmp_path / "few_evaluated"
    typed.write_text(
        f'#!/bin/sh\nexec {sys.executable} -m {few_evaluated.__name__} "$@"\n'
    )
    typed.chmod(0o755)
    environment = os.environ | {
        "PORT": str(free_port()),
        "TESTED": str(typed),
        "PYTHONPATH": str(ROOT),
    }
    done = subprocess.run(
        ["bash", "-c", pasted()],
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=500,
    )
    print(done.stdout)
    assert done.returncode == 0
    assert "Traceback" not in done.stdout
    assert (tmp_path / "runs/demo/report/index.html").exists()
    assert (tmp_path / "runs/level/report/index.html").exists()
    assert done.stdout.count("HTTP/1.0 200") == 2
