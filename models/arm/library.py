"""The arms of example-robot-data by name. The package holds data only; its files are found through its metadata."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from jointscope.errors import JointscopeError

ROBOTS = "cmeel.prefix/share/example-robot-data/robots"
_AXIS_TYPES = ("revolute", "continuous")


@dataclass(frozen=True, kw_only=True)
class LibraryArm:
    """A fixed-base serial arm of the library.

    Attributes:
        name: What to call it.
        urdf: Its file.
        axes: Names of the revolute joints, base to tip.
        mass: Of all links, the base's included [kg].
    """

    name: str
    urdf: Path
    axes: tuple[str, ...]
    mass: float


def robots_directory() -> Path:
    """Where the installed example-robot-data keeps its robots.

    Raises:
        JointscopeError: The package isn't installed or holds no robots.
    """
    try:
        folder = Path(str(distribution("example-robot-data").locate_file(ROBOTS)))
    except PackageNotFoundError:
        raise JointscopeError(
            "example-robot-data is not installed: pip install example-robot-data==6.0.0"
        ) from None
    if not folder.is_dir():
        raise JointscopeError(f"{folder}: example-robot-data holds no robots here; reinstall it")
    return folder


def library_arms() -> tuple[LibraryArm, ...]:
    """Every fixed-base arm of four to seven revolute axes in one chain, sorted by name."""
    arms = (_serial_arm(path) for path in sorted(robots_directory().rglob("*.urdf")))
    return tuple(sorted((arm for arm in arms if arm is not None), key=lambda arm: arm.name))


def find_arm(name: str) -> LibraryArm:
    """The library's arm of that name.

    Raises:
        JointscopeError: There is none; the message lists those there are.
    """
    arms = {arm.name: arm for arm in library_arms()}
    if name not in arms:
        raise JointscopeError(f"robot {name!r} is not in example-robot-data; its arms: {', '.join(arms)}")
    return arms[name]


def _serial_arm(path: Path) -> LibraryArm | None:
    """The file as a serial arm, or ``None`` where it is something else or can't be read."""
    try:
        robot = ElementTree.parse(path).getroot()
    except ElementTree.ParseError:
        return None
    if robot.tag != "robot" or "name" not in robot.attrib:
        return None
    joints = [joint for joint in robot.findall("joint") if joint.get("type") is not None]
    if any(joint.get("type") in ("floating", "planar", "prismatic") for joint in joints):
        return None
    ends = {joint: (_link(joint, "parent"), _link(joint, "child")) for joint in joints}
    chain = _chain(ends)
    if chain is None or not 4 <= len(chain) <= 7:
        return None
    mass = sum(float(node.get("value", "0")) for node in robot.iterfind("link/inertial/mass"))
    name = path.stem.removesuffix("_robot")
    return LibraryArm(name=name, urdf=path, axes=tuple(chain), mass=mass)


def _link(joint: ElementTree.Element, which: str) -> str:
    node = joint.find(which)
    return "" if node is None else node.get("link", "")


def _chain(ends: dict[ElementTree.Element, tuple[str, str]]) -> list[str] | None:
    """Names of the revolute joints along the one path that holds them all, or ``None`` if they branch."""
    by_child = {child: (joint, parent) for joint, (parent, child) in ends.items()}
    axes = [joint for joint in ends if joint.get("type") in _AXIS_TYPES]
    longest: list[str] = []
    for joint in axes:
        path, link = [], ends[joint][1]
        while link in by_child:
            upward, link = by_child[link]
            if upward.get("type") in _AXIS_TYPES:
                path.append(upward.get("name", ""))
        if len(path) > len(longest):
            longest = path
    return longest[::-1] if len(longest) == len(axes) else None
