#!/usr/bin/env bash
# From nothing to a table of results: five scenes, planned by the local baseline.
#
#   examples/01_first_plan.sh [FOLDER]       FOLDER: where the files go, by default `out`
set -euo pipefail
out=${1:-out}
mkdir -p "$out"

# Five cabinets in which the target is blocked, yet can be reached once the others are gone. Same seed, same scenes.
retrieve gen -n 5 --seed 1 -o "$out/scenes.jsonl"

# For each: which objects to move and where to, and every motion of the arm, checked exactly.
retrieve plan "$out/scenes.jsonl" --policy local -o "$out/plans.jsonl"

# Success, objects moved, times and travel, beside the paper's Table I; then the same as a page.
retrieve report "$out/plans.jsonl"
retrieve report "$out/plans.jsonl" -o "$out/report.html"

# The three stages in one line, nothing kept:  retrieve gen -n 5 --seed 1 | retrieve plan --policy local | retrieve report
