"""docs/formats.md names every field that files may have: of scenes and plans by their schemas, of labels by their columns."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import documents
import pytest

from planning.learning.labelling.label_file import COLUMNS

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "formats.md").read_text(encoding="utf-8")
NAMED = frozenset(word for code in re.findall(r"`([^`]*)`", PAGE) for word in re.findall(r"\w+", code))


def fields(schema: Any) -> Iterator[str]:
    """The names of all properties in a JSON Schema, wherever they stand."""
    if isinstance(schema, list):
        for part in schema:
            yield from fields(part)
    elif isinstance(schema, dict):
        yield from schema.get("properties", {})
        for part in schema.values():
            yield from fields(part)


@pytest.mark.parametrize("kind", ["scene", "plan"])
def test_every_field_of_a_schema_is_named(kind: str) -> None:
    names = set(fields(json.loads((documents.SCHEMAS / f"{kind}.schema.json").read_text(encoding="utf-8"))))
    assert len(names) > 20
    assert sorted(names - NAMED) == []


def test_every_column_of_labels_is_named_and_no_other() -> None:
    section = PAGE[PAGE.index("## Labels") : PAGE.index("## Models")]
    columns = {name for row in re.findall(r"^\| (`.*?) \|", section, re.MULTILINE) for name in re.findall(r"`(\w+)`", row)}
    assert columns == set(COLUMNS)
