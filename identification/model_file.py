"""``model.json``: the base model that ``identify`` and ``diagnose`` write and ``predict`` reads (``jointscope-model/1``).

The file holds the nameplate, the joint's values, which of them were estimated and their covariance. Keys of ``joint``
(SI, all referred to the joint output except the two motor-shaft inertias; a key is absent where it is unknown)::

    stiffness          K    [N m/rad]          damping         c    [N m s/rad]
    load_inertia       J_L  [kg m^2]           load_damping    b_l  [N m s/rad]
    motor_inertia      J_m  [kg m^2], shaft    reducer_inertia J_s  [kg m^2], shaft
    reduction_ratio    n    [-]                motor_damping   b_m  [N m s/rad]
    efficiency         eta  [-]

On a translational rig the same keys hold N/m, N s/m and kg. ``terms`` lists the single-mode systems (J~, c~, K~) of a
joint with several modes (paper, Equation 25); it is empty for one mode. ``input_unit`` is ``"N m"`` (``"N"``) where the
input is calibrated, else the unit in which every stiffness, inertia and damping is meant per unit of input (``"A"``).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.atomic import write_text
from jointscope.errors import InputError, RefusedError
from jointscope.models.parameters import Joint
from jointscope.recordings.campaign import Nameplate

FORMAT = "jointscope-model/1"

JOINT_KEYS = (
    "stiffness", "damping", "load_inertia", "motor_inertia", "reducer_inertia", "reduction_ratio", "motor_damping",
    "load_damping", "efficiency",
)  # fmt: skip
_REQUIRED = ("stiffness", "damping", "load_inertia", "motor_inertia", "reducer_inertia", "reduction_ratio")


@dataclass(frozen=True, kw_only=True)
class Term:
    """One decoupled single-mode system of a joint with several modes (paper, Equations 24-25).

    Attributes:
        inertia: J~ = 1/b1 [kg m^2]; negative where the mode moves hit point and sensor in opposite senses.
        damping: c~ = a1/b1 [N m s/rad].
        stiffness: K~ = a2/b1 [N m/rad].
    """

    inertia: float
    damping: float
    stiffness: float


@dataclass(frozen=True, kw_only=True, eq=False)
class BaseModel:
    """What the recordings and the nameplate say of the joint.

    Attributes:
        rig: The nameplate the campaign declared.
        joint: Values under the keys named in the module's docstring; unknown ones are absent.
        parameters: Names of the estimated entries of ``joint``, in the order of ``covariance``.
        covariance: Of those entries, in their own units, shape (n, n).
        terms: Single-mode systems in parallel; empty where one mode describes the joint.
        input_unit: Unit of the input that the values are meant per.
        joint_name: The joint of an arm campaign; ``None`` on a single-joint rig.
        drive: The drive's identified law (``identification/drive_law.py``), or ``None``.
        kind: ``base``, or what a later stage made of it.
        effects: Effects that a diagnosis added, as it wrote them.
    """

    rig: Nameplate
    joint: Mapping[str, float]
    parameters: tuple[str, ...] = ()
    covariance: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 0)))
    terms: tuple[Term, ...] = ()
    input_unit: str = "N m"
    joint_name: str | None = None
    drive: Mapping[str, Any] | None = None
    kind: Literal["base", "augmented"] = "base"
    effects: tuple[Mapping[str, Any], ...] = ()

    def __post_init__(self) -> None:
        unknown = [name for name in (*self.joint, *self.parameters) if name not in JOINT_KEYS]
        if unknown:
            raise ValueError(f"{unknown[0]!r} is not a joint value; known: {', '.join(JOINT_KEYS)}")
        absent = [name for name in self.parameters if name not in self.joint]
        if absent:
            raise ValueError(f"{absent[0]!r} has a covariance but no value")
        if self.covariance.shape != (len(self.parameters),) * 2:
            raise ValueError(f"covariance has shape {self.covariance.shape} for {len(self.parameters)} parameters")
        self.covariance.setflags(write=False)
        object.__setattr__(self, "joint", MappingProxyType(dict(self.joint)))

    def as_joint(self) -> Joint:
        """The two-inertia joint of the closed forms.

        Raises:
            RefusedError: A value that the two-inertia joint needs is unknown.
        """
        missing = [name for name in _REQUIRED if name not in self.joint]
        if missing:
            raise RefusedError(
                f"model.json: joint.{missing[0]} is unknown; give it under [rig] of the campaign and identify again"
            )
        return Joint(**{name: self.joint[name] for name in JOINT_KEYS if name in self.joint})

    def draw(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Joint values drawn from the estimate's Gaussian, shape (count, len(parameters))."""
        mean = np.array([self.joint[name] for name in self.parameters])
        return rng.multivariate_normal(mean, self.covariance, size=count, method="eigh")


def joint_values(rig: Nameplate, **estimated: float) -> dict[str, float]:
    """Nameplate values of the joint, overridden and completed by ``estimated`` ones (keys as in ``JOINT_KEYS``)."""
    values = {name: value for name in JOINT_KEYS if (value := getattr(rig, name, None)) is not None}
    return {**values, **estimated}


def to_json(model: BaseModel) -> dict[str, Any]:
    """The file's content as plain data."""
    return {
        "format": FORMAT,
        "kind": model.kind,
        "input_unit": model.input_unit,
        "joint_name": model.joint_name,
        "rig": {key: value for key, value in asdict(model.rig).items() if value is not None},
        "joint": dict(model.joint),
        "parameters": list(model.parameters),
        "covariance": model.covariance.tolist(),
        "terms": [asdict(term) for term in model.terms],
        "drive": None if model.drive is None else dict(model.drive),
        "effects": [dict(effect) for effect in model.effects],
    }


def write_model(path: Path, model: BaseModel) -> None:
    """Write ``model`` to ``path`` atomically."""
    write_text(path, json.dumps(to_json(model), indent=2, allow_nan=False) + "\n")


def read_model(path: Path) -> BaseModel:
    """Read a ``model.json``.

    Raises:
        InputError: The file is absent, is not JSON, or breaks the format; the message names the key.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            path, None, "no such file", fix="write one with: jointscope identify CAMPAIGN --out DIR"
        ) from None
    except ValueError as problem:
        raise InputError(path, None, f"not JSON: {problem}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = content.get("format") if isinstance(content, dict) else type(content).__name__
        raise InputError(path, "format", f"must be {FORMAT!r}", value=found)
    _check_keys(path, content)
    try:
        return BaseModel(
            kind=content.get("kind", "base"),
            rig=Nameplate(**content["rig"]),
            joint=content["joint"],
            parameters=tuple(content["parameters"]),
            covariance=np.asarray(content["covariance"], dtype=float).reshape((len(content["parameters"]),) * 2),
            terms=tuple(Term(**term) for term in content.get("terms", ())),
            input_unit=content.get("input_unit", "N m"),
            joint_name=content.get("joint_name"),
            drive=content.get("drive"),
            effects=tuple(content.get("effects", ())),
        )
    except (TypeError, ValueError) as problem:
        raise InputError(path, None, str(problem)) from None


def _check_keys(path: Path, content: Mapping[str, Any]) -> None:
    for key in ("rig", "joint", "parameters", "covariance"):
        if key not in content:
            raise InputError(path, key, "is missing")
    known: Sequence[str] = [entry.name for entry in fields(Nameplate)]
    for key in content["rig"]:
        if key not in known:
            raise InputError(path, f"rig.{key}", "unknown key", value=content["rig"][key])
    for key in content["joint"]:
        if key not in JOINT_KEYS:
            raise InputError(path, f"joint.{key}", "unknown key", value=content["joint"][key])
