"""An arm of six joints in a URDF's words, for hands that tests hang on it."""

from __future__ import annotations


def box(size: str, xyz: str = "0 0 0") -> str:
    return f'<collision><origin xyz="{xyz}"/><geometry><box size="{size}"/></geometry></collision>'


def joint(name: str, kind: str, parent: str, child: str, xyz: str, axis: str, limits: tuple[float, float], rpy: str = "0 0 0") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
        f'<axis xyz="{axis}"/><limit lower="{limits[0]}" upper="{limits[1]}" velocity="2" effort="9"/></joint>'
    )


def arm(hand: str) -> str:
    """Six joints and a palm."""
    lengths, axes = (0.12, 0.35, 0.20, 0.15, 0.06, 0.05), ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
    text = f'<robot name="six"><link name="base">{box("0.1 0.1 0.1")}</link>'
    for i, (length, axis) in enumerate(zip(lengths, axes)):
        at = f"0 0 {lengths[i - 1] if i else 0.05}"
        text += f'<link name="l{i}">{box(f"0.04 0.04 {0.8 * length}", f"0 0 {length / 2}")}</link>'
        text += joint(f"a{i}", "revolute", f"l{i - 1}" if i else "base", f"l{i}", at, axis, (-3, 3))
    palm = '<joint name="flange" type="fixed"><parent link="l5"/><child link="palm"/><origin xyz="0 0 0.06"/></joint>'
    return f'{text}<link name="palm">{box("0.08 0.06 0.02")}</link>{palm}{hand}</robot>'
