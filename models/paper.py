"""The paper's printed numbers as data, the rig they describe, and whether they agree with each other.

Source: Li et al., Sensors 2022, 22(16), 6170; the numbers and where they stand are in ``paper.toml``.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from jointscope.models.joint import DirectForm
from jointscope.models.parameters import Joint, Rig


@dataclass(frozen=True, kw_only=True)
class JointFigures:
    """One column of Tables 2 and 4: K [N m/rad], J [kg m^2], c [N m s/rad]."""

    stiffness: float
    inertia: float
    damping: float


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Table 1: the single-joint bench (powers in W, inertias on the motor shaft in kg m^2, K in N m/rad)."""

    rated_power: float
    arm_length: float
    arm_mass: float
    motor_inertia: float
    reducer_inertia: float
    reducer_stiffness: float


@dataclass(frozen=True, kw_only=True)
class SecondJoint:
    """Table 3: joint 2 of the six-axis robot (power in W, inertias on the motor shaft in kg m^2, K_t in N m/A)."""

    rated_power: float
    motor_inertia: float
    reducer_inertia: float
    pole_pairs: int
    torque_constant: float


@dataclass(frozen=True, kw_only=True)
class Paper:
    """Everything that is printed and used here.

    Attributes:
        table2_identified: By hammer on the bench.
        table2_reference: The paper's comparison: a catalogue value and assumed figures, never ground truth.
        table4: Of the two modes of joint 2.
        equation26: The bench's hammer FRF.
        equation27: The two terms of joint 2's hammer FRF.
        prediction: b_m, b_l [N m s/rad] and eta [-] that section 3.3 predicts with.
        inferred: What the paper leaves open, by name, SI.
    """

    source: str
    table1: Bench
    table2_identified: JointFigures
    table2_reference: JointFigures
    table3: SecondJoint
    table4: tuple[JointFigures, ...]
    equation26: DirectForm
    equation27: tuple[DirectForm, ...]
    prediction: dict[str, float]
    inferred: dict[str, float]


@cache
def paper() -> Paper:
    """Load ``paper.toml``."""
    data = tomllib.loads((files("jointscope.models") / "paper.toml").read_text(encoding="utf-8"))
    return Paper(
        source=data["source"],
        table1=Bench(**data["table1"]),
        table2_identified=JointFigures(**data["table2"]["identified"]),
        table2_reference=JointFigures(**data["table2"]["reference"]),
        table3=SecondJoint(**data["table3"]),
        table4=tuple(JointFigures(**column) for column in data["table4"]),
        equation26=DirectForm(**data["equation26"]),
        equation27=tuple(DirectForm(**term) for term in data["equation27"]),
        prediction=data["prediction"],
        inferred=data["inferred"],
    )


def paper_rig() -> Rig:
    """The single-joint bench with the identified figures of Table 2 as its truth."""
    printed = paper()
    found, inferred = printed.table2_identified, printed.inferred
    joint = Joint(
        stiffness=found.stiffness,
        damping=found.damping,
        load_inertia=found.inertia,
        motor_inertia=printed.table1.motor_inertia,
        reducer_inertia=printed.table1.reducer_inertia,
        reduction_ratio=inferred["reduction_ratio"],
        motor_damping=printed.prediction["motor_damping"],
        load_damping=printed.prediction["load_damping"],
        efficiency=printed.prediction["efficiency"],
    )
    return Rig(
        joint=joint,
        arm_mass=printed.table1.arm_mass,
        arm_com_radius=inferred["arm_com_radius"],
        hammer_radius=inferred["hammer_radius"],
        accelerometer_radius=inferred["accelerometer_radius"],
    )


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """One printed table value beside what the printed equation gives.

    Attributes:
        where: Which equation and table.
        quantity: Name and unit.
        from_equation: By (21) or (24) from the printed coefficients.
        printed: In the table.
    """

    where: str
    quantity: str
    from_equation: float
    printed: float

    @property
    def relative_error(self) -> float:
        """(from_equation - printed)/printed [-]."""
        return self.from_equation / self.printed - 1.0


def printed_agreement() -> tuple[Agreement, ...]:
    """(21) on (26) against Table 2, and (24) on (27) against Table 4: three figures per mode."""
    printed = paper()
    pairs = [("(26) -> Table 2", printed.equation26, printed.table2_identified)]
    pairs += [
        (f"(27) -> Table 4, mode {mode}", term, column)
        for mode, (term, column) in enumerate(zip(printed.equation27, printed.table4, strict=True), start=1)
    ]
    return tuple(
        Agreement(where=where, quantity=quantity, from_equation=value, printed=table)
        for where, form, figures in pairs
        for quantity, value, table in (
            ("stiffness [N m/rad]", form.stiffness, figures.stiffness),
            ("inertia [kg m^2]", form.inertia, figures.inertia),
            ("damping [N m s/rad]", form.damping, figures.damping),
        )
    )
