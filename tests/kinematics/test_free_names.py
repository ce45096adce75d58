"""Names that tell things apart."""

from __future__ import annotations

from kinematics.names import free_name


def test_a_taken_name_gets_the_first_number_that_is_free() -> None:
    assert free_name("box", []) == free_name("box", ["can", "box_1"]) == "box"
    assert free_name("box", ["box"]) == "box_1"
    assert free_name("box", {"box", "box_1", "box_3"}) == "box_2"
    assert free_name("box", {"box", "box_1", "box_2"}, 2) == "box_3"
