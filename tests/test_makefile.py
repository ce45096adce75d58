"""`make table` asks for what it says: a plan of every policy under every rule, of the user's own, too."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.skipif(shutil.which("make") is None, reason="there is no make")
def test_a_table_has_own_policies() -> None:
    own, module = "examples/07_own_policy.py:side", "my_pkg.policies:f"
    words = ["TABLE_SPECS=paper", "RULES=deep strict", f"POLICIES=local neural-paper {own}", f"SENSED_POLICIES=local {module}"]
    make = ["make", "-n", "table", "TABLE_SCENES=2", "WORKERS=1", *words]
    done = subprocess.run(make, cwd=ROOT, capture_output=True, text=True, check=True)
    calls = [line.split() for line in done.stdout.replace("\\\n", " ").splitlines() if " plan out/table/" in line]
    said = [(call[call.index("--policy") + 1], call[call.index("--rule") + 1] if "--rule" in call else "--sense") for call in calls]
    plain = [(policy, rule) for rule in ("deep", "strict") for policy in ("local", "neural-paper", own)]
    assert said == [*plain, ("local", "--sense"), (module, "--sense")]
    files = [call[call.index("-o") + 1] for call in calls]
    assert len(set(files)) == len(files)
    (report,) = (line for line in done.stdout.splitlines() if "report $(ls" in line)
    assert all(file in report for file in files)
