#!/usr/bin/env bash
# An arm of one's own: a URDF, the link between its finger pads and the joint that opens them are all it takes.
#
#   examples/04_own_arm.sh [FOLDER]          FOLDER: where the files go, by default `out`
set -euo pipefail
here=$(dirname "$0")/04_own_arm
out=${1:-out}
mkdir -p "$out"

# Scenes for this arm, in a cabinet of one's own. The first call covers the arm with spheres and keeps them for the next time.
retrieve gen -n 3 --seed 1 --robot "$here/arm.urdf" --hand-frame tcp --gripper-joint grip --spec "$here/cupboard.toml" -o "$out/own_scenes.jsonl"

# The scenes name their robot, so nobody has to say it again.
retrieve plan "$out/own_scenes.jsonl" --policy local -o "$out/own_plans.jsonl"
retrieve report "$out/own_plans.jsonl"
retrieve show "$out/own_plans.jsonl" --scenes "$out/own_scenes.jsonl" --png "$out/own_arm.png"
