"""`retrieve schema`: the JSON Schema of a kind of file."""

from __future__ import annotations

import json
import sys
from importlib import resources
from typing import Any

from kinematics.errors import choose

KINDS = ("scene", "plan", "observation", "labels", "model", "words")


def run(*, kind: str) -> None:
    """Print the schema. Raises: InputError for a kind that there is none of."""
    json.dump(schema(choose("kind of file", kind, KINDS)), sys.stdout, indent=2, ensure_ascii=False)
    print()


def schema(kind: str) -> dict[str, Any]:
    """The JSON Schema of one of `KINDS`: an observation is what a sensed scene carries, words are what `retrieve scene FILE.yaml` reads."""
    if kind == "observation":
        whole = schema("scene")
        part: dict[str, Any] = {"$schema": whole["$schema"], "title": "the field `observation` of a sensed scene"}
        return {**part, **whole["properties"]["observation"], "$defs": whole["$defs"]}
    text = resources.files("planning.io").joinpath("schema", f"{kind}.schema.json").read_text(encoding="utf-8")
    found: dict[str, Any] = json.loads(text)
    return found
